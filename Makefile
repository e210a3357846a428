# make check: lint and types; make test: all tests; make docs: its pictures and its table;
# make speed: the tables of docs/speed.md, without peers that need their own interpreters;
# make site: the documentation with its gallery, in site/.
PYTHON ?= .venv/bin/python

check:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m ty check --python $(PYTHON) src

test:
	$(PYTHON) -m pytest

docs:
	$(PYTHON) docs/make_settings.py
	$(PYTHON) docs/make_images.py
	$(PYTHON) docs/make_view_image.py
	$(PYTHON) docs/make_results.py

speed:
	$(PYTHON) benchmarks/speed --write

site:
	$(PYTHON) docs/make_site.py

.PHONY: check test docs speed site
