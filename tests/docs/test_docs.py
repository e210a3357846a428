"""The README and the doctests do what they say."""

from __future__ import annotations

import ast
import doctest
import importlib
import json
import pkgutil
import re
import runpy
import shlex
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from pictures import inked
from PIL import Image
from robots import jvrc_path

import comwalk
from comwalk.cli.app import main
from comwalk.robot.profile import read_profile
from comwalk.runs.run_data import read_columns
from comwalk.views.gl import choose_backend

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_python_example_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out == blocks("text")[0]
    assert inked(tmp_path / "walk.png") > 0.02


def test_eight_lines_from_robot_to_plot():
    (code,) = blocks("python")
    lines = [x for x in code.splitlines() if x.strip() and not x.startswith("import")]
    assert len(lines) <= 8


def commands() -> list[str]:
    lines = [line for block in blocks("bash") for line in block.splitlines()]
    live = "--view"  # ends when its page says so: test_live.py
    return [x for x in lines if x.startswith("comwalk ") and live not in x]


def prepared(words: list[str]) -> list[str]:
    """Return a command with the files that it needs: a run, a robot, its profile."""
    if "runs/..." in words:
        assert main(["walk", "--steps", "1", "--out", "made"]) == 0
        words[words.index("runs/...")] = "made"
    if "my_robot.urdf" in words:
        Path("my_robot.urdf").write_bytes(jvrc_path().read_bytes())
    if "found/loop.toml" in words:  # as test_identification.py finds it
        Path("found").mkdir()
        Path("found/loop.toml").write_text("[loop]\nservo_lag = 0.03\n")
    if "--profile" in words:
        profile = words[words.index("--profile") + 1]
        assert main(["robot", "my_robot.urdf", "--write-profile", profile]) == 0
    return words


@pytest.mark.parametrize("line", commands())
def test_commands_run(line, tmp_path, monkeypatch):
    """Each command of the README ends as its comment says: by itself, or in a fall."""
    monkeypatch.chdir(tmp_path)
    command, _, comment = line.partition("#")
    words = prepared(shlex.split(command)[1:])
    if words[0] == "walk" and "--steps" not in words and "falls" not in comment:
        words += ["--steps", "5"]  # all twenty are walked in test_walk.py
    assert main(words) == (1 if "falls" in comment else 0)
    if "--picture" in words:
        assert inked(words[words.index("--picture") + 1]) > 0.1
    if "--write-profile" in words:
        assert read_profile(words[words.index("--write-profile") + 1]).given


def test_the_two_single_commands_are_there():
    for marker, command in (("walk", "comwalk walk"), ("test", "-m pytest")):
        block = re.search(rf"<!-- {marker} -->\n```bash\n(.*?)```", README, re.DOTALL)
        assert block is not None
        assert command in block[1]
        assert len(block[1].strip().splitlines()) == 1
        assert block[1].startswith("python3 -m venv")


def test_each_command_is_told_of(capsys):
    """In the README or a page of the docs, and in the changelog."""
    assert main(["--help"]) == 0
    names = re.findall(r"^\W ([a-z]+)  +[A-Z]", capsys.readouterr().out, re.MULTILINE)
    assert {"walk", "certify", "film", "export"} <= set(names)
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md")]
    text, changes = (
        "".join([README, *pages]),
        (ROOT / "CHANGELOG.md").read_text("utf-8"),
    )
    assert [n for n in names if not re.search(rf"comwalk {n}\b", text)] == []
    assert [n for n in names if not re.search(rf"`(comwalk )?{n}\b", changes)] == []


def test_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target


def modules() -> list[str]:
    names = [info.name for info in pkgutil.iter_modules(comwalk.__path__)]
    return [name for name in names if not name.startswith("__")]


@pytest.mark.parametrize("name", modules())
def test_doctests(name):
    result = doctest.testmod(
        importlib.import_module(f"comwalk.{name}"),
        optionflags=doctest.NORMALIZE_WHITESPACE,
    )
    assert result.failed == 0


EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_examples_run(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()


def test_examples_are_single_files_a_stranger_can_run():
    assert len(EXAMPLES) >= 6
    for path in EXAMPLES:
        text = path.read_text(encoding="utf-8")
        assert text.startswith("# /// script\n")
        assert len(text.splitlines()) <= 60


FILES = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")


def marked(kind: str) -> list[str]:
    return re.findall(rf"<!-- {kind} -->\n```\w+\n(.*?)```", FILES, flags=re.DOTALL)


@pytest.mark.parametrize("text", marked("plan"))
def test_plans_in_the_docs_walk(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plan.toml").write_text(text)
    assert main(["walk", "--plan", "plan.toml", "--out", "run"]) == 0


def test_configuration_in_the_docs_walks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (text,) = marked("config")
    Path("walk.toml").write_text(text)
    assert main(["walk", "--config", "walk.toml", "--out", "run"]) == 0
    again = ["walk", "--config", "run/summary.json", "--out", "again", "--steps", "1"]
    assert main(again) == 0


def test_motion_in_the_docs_dances(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (text,) = marked("motion")
    Path("motion.csv").write_text(text)
    command = ["dance", "--motion", "motion.csv", "--duration", "5", "--out", "run"]
    assert main(command) == 0


def test_every_column_is_in_the_docs(tmp_path):
    push = ["--push", "1.0:0,10,0"]
    assert main(["walk", "--steps", "1", "--out", str(tmp_path), *push]) == 0
    columns = set(np.load(tmp_path / "run.npz").files)
    table = FILES.split("Columns of `run.npz`")[1]
    named = set(re.findall(r"`(\w+)`", table))
    assert columns <= named, columns - named


CERTIFICATES = (ROOT / "docs" / "certificates.md").read_text(encoding="utf-8")


def test_certificates_print_what_the_page_says(capsys):
    """Its snippets run one after the other, each with its output below it."""
    pattern = r"```python\n(.*?)```\n\n```text\n(.*?)```"
    pairs = re.findall(pattern, CERTIFICATES, flags=re.DOTALL)
    assert len(pairs) == CERTIFICATES.count("```python") == 7
    names: dict[str, object] = {}
    for code, text in pairs:
        exec(compile(code, "certificates.md", "exec"), names)
        assert capsys.readouterr().out == text


@pytest.mark.parametrize("line", re.findall(r"^comwalk .*", CERTIFICATES, re.MULTILINE))
def test_commands_of_the_certificates_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line.partition("#")[0])[1:]) == 0


def test_tests_and_pictures_of_the_certificates_exist():
    for file, name in re.findall(r"`(test_\w+\.py)::(\w+)`", CERTIFICATES):
        assert f"def {name}(" in (ROOT / "tests" / file).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", CERTIFICATES):
        assert (ROOT / "docs" / target).exists(), target


def test_logs_in_the_docs_are_told_and_exported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["walk", "--steps", "1", "--out", "made"]) == 0
    for line in marked("log")[0].splitlines():
        words = shlex.split(line.partition("#")[0].replace("runs/...", "made"))
        assert main(words[1:]) == 0
    made, rows = Path("made"), len(read_columns("made")["t"])
    assert len((made / "csv/zmp.csv").read_text().splitlines()) == rows + 1
    assert (made / "parquet/zmp.parquet").read_bytes().startswith(b"PAR1")
    about = (made / "rosbag2/metadata.yaml").read_text()
    assert about.count(f"message_count: {rows}\n") == 9
    capsys.readouterr()
    assert main(["log", "made", "--json"]) == 0
    topics = {
        (t["topic"], t["type"]) for t in json.loads(capsys.readouterr().out)["topics"]
    }
    table = FILES.split("<!-- topics -->")[1].split("\n\n")[0]
    rows = [line.split("|")[1:3] for line in table.splitlines()[3:]]
    told = {
        (topic, kind.strip(" `"))
        for names, kind in rows
        for topic in re.findall(r"`([^`]+)`", names)
    }
    assert told == topics


PAGES = (ROOT / "docs" / "pages.md").read_text(encoding="utf-8")


def test_pages_and_films_in_the_docs(tmp_path, monkeypatch):
    """Every command of the page runs, and its Python writes a page."""
    monkeypatch.chdir(tmp_path)
    quick = ["--steps", "1", "--gait.period", "0.6", "--gait.stand-time", "0.05"]
    quick += ["--gait.start-time", "0.6", "--gait.stop-time", "0.6"]
    assert main(["walk", *quick, "--out", "runs/walk"]) == 0
    for name in ("law", "open-loop"):
        Path("runs", name).symlink_to("walk")
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    drawing = choose_backend() in ("egl", "osmesa")
    small = ["--fps", "2", "--width", "96", "--height", "72"]
    for line in re.findall(r"^comwalk .*", PAGES, flags=re.M):
        words = shlex.split(line.partition("#")[0])[1:]
        words += {"walk": quick, "film": small}.get(words[0], [])
        film = words[0] == "film" or "--video" in words
        assert main(words) == (0 if drawing or not film else 2), line
    (code,) = re.findall(r"```python\n(.*?)```", PAGES, flags=re.DOTALL)
    exec(compile(code, "pages.md", "exec"), {})
    assert Path("walk.html").stat().st_size > 500_000


def test_pictures_show_the_figures_of_the_readme():
    """The table, figures.json and the titles inside the pictures are of one run."""
    images = ROOT / "docs" / "images"
    ours = json.loads((images / "figures.json").read_text())["fig7"]
    com, zmp = (
        [round(ours[f"{name}_rms_{axis}"]["ours"], 1) for axis in "xy"]
        for name in ("com", "zmp")
    )
    readme = (ROOT / "README.md").read_text()
    [row] = [x for x in readme.splitlines() if x.startswith("| the paper's walk, 4 m")]
    assert f"{com[0]} / {com[1]}" in row
    assert f"{zmp[0]} / {zmp[1]}" in row
    with Image.open(images / "fig7.png") as picture:
        title = picture.text["Title"]
    assert f"CoM (true) {com[0]}, {com[1]} mm;  ZMP {zmp[0]}, {zmp[1]} mm" in title


def test_the_page_of_settings_is_what_the_code_declares():
    """`python docs/make_settings.py` writes it."""
    made = runpy.run_path(str(ROOT / "docs" / "make_settings.py"))
    assert made["PAGE"].read_text(encoding="utf-8") == made["page"]()


def test_rooms_that_are_named_exist():
    """Pages and docstrings name files by `room.py` and `room.Thing`."""
    places = (ROOT / folder for folder in ("src", "docs", "tests", "benchmarks"))
    rooms = {path.stem for place in places for path in place.rglob("*.py")}
    others = {"numba", "mujoco", "matplotlib", "numpy", "math", "gc", "comwalk"}
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    gone = set()
    for path in [*pages, *(ROOT / "src").rglob("*.py")]:
        text = path.read_text(encoding="utf-8")
        files = re.findall(r"`(?:[\w/]+/)?(\w+)\.py`", text)
        things = re.findall(r"`([a-z_]{2,})\.[A-Z]\w+`", text)
        gone |= {(path.name, x) for x in [*files, *things]} - {
            (path.name, x) for x in [*rooms, *others]
        }
    assert gone == set()


def test_things_that_docstrings_name_exist():
    """As `room.thing` or `Class.thing`, where the code of that has such a word."""
    words, named = defaultdict(set), []
    for path in (ROOT / "src" / "comwalk").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        room = path.parent if path.name == "__init__.py" else path
        words[room.stem] |= set(re.findall(r"\w+", text))
        words[path.parent.name].add(path.stem)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                own = ast.get_source_segment(text, node) or ""
                words[node.name] |= set(re.findall(r"\w+", own))
        things = re.findall(r"`(?:\w+\.)*(\w+)\.(\w+)`", text)
        named += [(path.name, *thing) for thing in things]
    elsewhere = {"numpy", "numba", "math", "mujoco", "optimize", "matplotlib"}
    elsewhere |= {"zmpControllerParams", "window", "state", "wanted"}
    gone = [x for x in named if x[1] not in elsewhere and x[2] not in words[x[1]]]
    assert gone == []


def test_scripts_import_what_there_is():
    """Pictures, tables and benchmarks are made of names that still exist."""
    scripts = [
        p for d in ("docs", "benchmarks", "examples") for p in (ROOT / d).glob("*.py")
    ]
    missing = []
    for path in scripts:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.ImportFrom)
                and (node.module or "")[:7] == "comwalk"
            ):
                module = importlib.import_module(str(node.module))
                missing += [a.name for a in node.names if not hasattr(module, a.name)]
    assert missing == []
