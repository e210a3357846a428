# make check: lint and types; make test: all tests; make images: docs and their figures.
PYTHON ?= .venv/bin/python

check:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m ty check --python $(PYTHON) src

test:
	$(PYTHON) -m pytest

images:
	$(PYTHON) docs/make_images.py

.PHONY: check test images
