"""Build the documentation as a site: `python docs/make_site.py [--out site]`.

The pages of this folder, the API out of the docstrings, and a gallery with a replay of
each robot that is installed. Nothing is fetched, neither while building nor while
reading: mathematics becomes MathML, fonts are the reader's own. Needs the extra `docs`.
"""

from __future__ import annotations

import argparse
import ast
import re
import shutil
import subprocess
import sys
import tempfile
from html import unescape
from pathlib import Path

from comwalk.views import choose_backend

choose_backend()  # before anything imports mujoco

from latex2mathml.converter import convert

from comwalk.cli import main as comwalk
from comwalk.errors import ComwalkError
from comwalk.robot.loaders import ROBOTS, read_model

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "comwalk"
PAGES = {
    "Architecture": "architecture.md",
    "The paper": "paper.md",
    "Certificates": "certificates.md",
    "Conventions": "conventions.md",
    "Files": "files.md",
    "Pages and films": "pages.md",
    "Robots": "robots.md",
    "Descriptions that were tried": "descriptions.md",
}
"""Titles of pages first in the menu, and their files; others follow by name."""

CONFIG = """\
[project]
site_name = "comwalk"
site_description = "Humanoid walking by the CoM Jacobian with embedded motion"
docs_dir = "docs"
site_dir = "site"
use_directory_urls = false
nav = [
{nav}
]

[project.theme]
language = "en"
font = false
features = ["content.code.copy", "navigation.sections", "navigation.top", "toc.follow"]

[[project.theme.palette]]
media = "(prefers-color-scheme: light)"
scheme = "default"
toggle.icon = "lucide/sun"
toggle.name = "Dark"

[[project.theme.palette]]
media = "(prefers-color-scheme: dark)"
scheme = "slate"
toggle.icon = "lucide/moon"
toggle.name = "Light"

[project.markdown_extensions]
attr_list = {{}}
md_in_html = {{}}
tables = {{}}
toc.permalink = true
pymdownx.arithmatex.generic = true
pymdownx.highlight.anchor_linenums = true
pymdownx.inlinehilite = {{}}
pymdownx.superfences = {{}}

[project.plugins.mkdocstrings.handlers.python]
paths = ["src"]

[project.plugins.mkdocstrings.handlers.python.options]
docstring_style = "google"
heading_level = 2
members_order = "source"
separate_signature = true
show_root_heading = false
show_root_toc_entry = false
show_signature_annotations = true
show_source = true
show_if_no_docstring = true
docstring_section_style = "list"
filters = ["!^_"]
"""


# ---- Pages ------------------------------------------------------------------------


def stage_pages(docs: Path) -> dict[str, str]:
    """Copy README and pages; return the files of the menu by their titles."""
    ignored = shutil.ignore_patterns("*.py")
    shutil.copytree(ROOT / "docs", docs, ignore=ignored)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (docs / "index.md").write_text(_relinked(readme, "docs/"), encoding="utf-8")
    for page in docs.glob("*.md"):
        text = _relinked(page.read_text(encoding="utf-8"), "../docs/")
        page.write_text(text, encoding="utf-8")
    known = {title: file for title, file in PAGES.items() if (docs / file).is_file()}
    others = sorted({p.name for p in docs.glob("*.md")} - {*known.values(), "index.md"})
    more = {Path(name).stem.replace("_", " ").capitalize(): name for name in others}
    return {"comwalk": "index.md", **known, **more}


def _relinked(text: str, prefix: str) -> str:
    """Return a page whose links lead to pages of the site, or are plain words."""

    def link(found: re.Match[str]) -> str:
        label, target = found[1], found[2]
        if target.startswith(("http", "#")):
            return found[0]
        path = target.removeprefix(prefix).removeprefix("../")
        module = re.fullmatch(r"src/comwalk/([\w/]+)\.py", path)
        if module:
            return f"[{label}](api/{module[1].replace('/', '.')}.md)"
        if (ROOT / "docs" / path.partition("#")[0]).is_file():
            return f"[{label}]({path})"
        return label

    return re.sub(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)", link, text).replace(
        f"]({prefix}images/", "](images/"
    )


def stage_api(root: Path) -> list[str]:
    """Write a page per module, and its source with mathematics for Markdown.

    Returns:
        The names of the modules.
    """
    shutil.copytree(SOURCE, root / "src" / "comwalk")
    (root / "docs" / "api").mkdir()
    names = []
    for file in sorted(SOURCE.rglob("*.py")):
        if file.stem.startswith("__"):
            continue
        inside = file.relative_to(SOURCE)
        name = ".".join(inside.with_suffix("").parts)
        text = file.read_text(encoding="utf-8")
        staged = root / "src" / "comwalk" / inside
        staged.write_text(_math_blocks(text), encoding="utf-8")
        summary = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
        page = f"# {name}\n\n::: comwalk.{name}\n"
        target = root / "docs" / "api" / f"{name}.md"
        target.write_text(page, encoding="utf-8")
        names.append((name, summary))
    rows = "".join(f"| [{name}]({name}.md) | {text} |\n" for name, text in names)
    index = f"# API\n\nEvery module, and what it is for.\n\n| | |\n|---|---|\n{rows}"
    (root / "docs" / "api" / "index.md").write_text(index, encoding="utf-8")
    return [name for name, _ in names]


def _math_blocks(text: str) -> str:
    """Return a source whose `.. math::` blocks stand between dollars."""
    block = r"^([ ]*)\.\. math::[ ]*(.*(?:\n\n?\1[ ]{3,}\S.*)*)"

    def dollars(found: re.Match[str]) -> str:
        formula = " ".join(found[2].split())
        if "&" in formula and r"\begin" not in formula:
            formula = rf"\begin{{align*}}{formula}\end{{align*}}"
        return f"\n{found[1]}$${formula}$$\n"

    return re.sub(block, dollars, text, flags=re.M)


# ---- Gallery ----------------------------------------------------------------------


def stage_gallery(docs: Path, robots: list[str], steps: int) -> None:
    """Walk with each robot, and write the page of each run and of them all."""
    (docs / "gallery").mkdir()
    cards = []
    for name in robots:
        print(f"walking with {name}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / name
            words = ["walk", name, "--steps", str(steps), "--report", "--out", str(run)]
            if comwalk(words) != 0:
                continue
            shutil.copy(run / "report.html", docs / "gallery" / f"{name}.html")
        picture = f"images/robot-{name}.webp"
        shown = f"![{name}]({picture})" if (docs / picture).is_file() else name
        what = ROBOTS[name].partition("; ")[0]
        cards.append(f"[{shown}](gallery/{name}.html)<br>**{name}**: {what}")
    rows = "".join(
        "| " + " | ".join([*cards[k : k + 3], "", ""][:3]) + " |\n"
        for k in range(0, len(cards), 3)
    )
    text = (
        "# Gallery\n\nEvery robot that is installed walks with the defaults that are "
        "derived from its file. A picture opens the page of its run: the walk in 3D, "
        f"its figures and its settings.\n\n| | | |\n|---|---|---|\n{rows}"
    )
    (docs / "gallery.md").write_text(text, encoding="utf-8")


def installed() -> list[str]:
    """Return the robots that load here."""
    names = []
    for name in ROBOTS:
        try:
            read_model(name)
        except ComwalkError:
            continue
        names.append(name)
    return names


# ---- Building ---------------------------------------------------------------------


def build(root: Path, titles: dict[str, str], modules: list[str], out: Path) -> None:
    """Build the site of the staged pages."""
    lines = [f'  {{ "{title}" = "{file}" }},' for title, file in titles.items()]
    api = ", ".join(f'{{ "{name}" = "api/{name}.md" }}' for name in modules)
    lines.append(f'  {{ "API" = [{{ "Overview" = "api/index.md" }}, {api}] }},')
    config = root / "zensical.toml"
    config.write_text(CONFIG.format(nav="\n".join(lines)), encoding="utf-8")
    command = [sys.executable, "-m", "zensical", "build", "-f", str(config)]
    subprocess.run(command, check=True, cwd=root)
    for page in (root / "site").rglob("*.html"):
        if page.parent.name != "gallery":
            text = page.read_text(encoding="utf-8")
            page.write_text(with_mathml(text), encoding="utf-8")
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(root / "site", out)


def with_mathml(text: str) -> str:
    r"""Return a page whose TeX is MathML, which browsers draw by themselves.

    Args:
        text: HTML with formulas as `<span class="arithmatex">\(...\)</span>`.

    Returns:
        HTML.
    """
    form = r'<(span|div) class="arithmatex">\s*\\[(\[](.*?)\\[)\]]\s*</\1>'

    def math(found: re.Match[str]) -> str:
        display = "block" if found[1] == "div" else "inline"
        return convert(unescape(found[2]).strip(), display=display)

    return re.sub(form, math, text, flags=re.S)


def main() -> None:
    """Build the site."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "site")
    parser.add_argument("--robots", help="for the gallery, comma-separated; or none")
    parser.add_argument("--steps", type=int, default=8, help="steps of each robot")
    given = parser.parse_args()
    robots = installed() if given.robots is None else given.robots.split(",")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        titles = stage_pages(root / "docs")
        modules = stage_api(root)
        if robots != ["none"]:
            stage_gallery(root / "docs", robots, given.steps)
            titles["Gallery"] = "gallery.md"
        build(root, titles, modules, given.out)
    size = sum(f.stat().st_size for f in given.out.rglob("*") if f.is_file())
    print(f"written to {given.out} ({size / 1e6:.1f} MB)")


if __name__ == "__main__":
    main()
