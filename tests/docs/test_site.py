"""The site of the documentation: links, mathematics, modules."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

import comwalk

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site():
    """The script that builds the site."""
    pytest.importorskip("latex2mathml", reason="needs the extra docs")
    spec = importlib.util.spec_from_file_location("s", ROOT / "docs" / "make_site.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_of_all_pages_lead_somewhere(site, tmp_path):
    """To other pages, to modules or out; to nothing that the site does not hold."""
    titles = site.stage_pages(tmp_path / "docs")
    modules = site.stage_api(tmp_path)
    assert {"comwalk", "The paper", "Files"} <= set(titles)
    assert {"errors", "pattern.footsteps", "robot.loaders.urdf"} <= set(modules)
    for page in (tmp_path / "docs").glob("*.md"):
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
            if not target.startswith(("http", "#")):
                path = tmp_path / "docs" / target.partition("#")[0]
                assert path.exists(), (page.name, target)


def test_every_formula_of_the_source_becomes_mathml(site):
    """No formula is left as TeX, and none loses its lines."""
    found = 0
    for file in Path(comwalk.__file__).parent.rglob("*.py"):
        text = site._math_blocks(file.read_text())
        assert ".. math::" not in text, file.name
        for formula in re.findall(r"\$\$(.*?)\$\$", text, flags=re.S):
            html = f'<div class="arithmatex">\\[{formula}\\]</div>'
            drawn = site.with_mathml(html)
            assert drawn.startswith("<math"), (file.name, formula)
            assert "(1)" not in drawn, formula  # numbers are the paper's own
            assert "\\" not in re.sub("<annotation.*?</annotation>", "", drawn), formula
            found += 1
    assert found > 10


def test_formulas_in_a_line(site):
    """Both kinds of formulas are found, entities are read."""
    html = 'a <span class="arithmatex">\\(k_p &lt; k_c\\)</span> b'
    assert re.fullmatch(r"a <math.*inline.*</math> b", site.with_mathml(html))
    assert "&#x0003C;" in site.with_mathml(html)
