"""The names that `import comwalk` offers, and how little it costs."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from pictures import inked

import comwalk as cw

PUBLIC = {
    "BodySettings", "ComwalkError", "Control", "ControlSettings", "Foothold",
    "Footstep", "FootstepPlan", "Gains", "Gait", "Outcome", "Pattern", "Pendulum",
    "Push", "Robot", "Run", "SimulatorSettings", "builtin_motion", "certify",
    "default_gains", "default_gait", "default_pendulum", "embed_in", "load_motion",
    "load_plan", "load_robot", "make_pattern", "plan_steps", "simulate",
    "simulate_pendulum", "walk_pattern",
}  # fmt: skip


def python(code: str) -> str:
    """Return what a fresh interpreter prints."""
    run = [sys.executable, "-c", code]
    return subprocess.run(run, capture_output=True, text=True, check=True).stdout


def homes() -> dict[str, str]:
    """Return the modules that the names for type checkers are imported from."""
    tree = ast.parse(Path(cw.__file__).read_text(encoding="utf-8"))
    [block] = [node for node in tree.body if isinstance(node, ast.If)]
    return {
        alias.asname: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname == alias.name
    }


def test_there_are_at_most_30_names():
    """What most users need, no more."""
    assert len(PUBLIC) <= 30
    assert set(homes()) == PUBLIC


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_every_name_exists_and_is_documented(name):
    """And it is the thing itself, under its own name."""
    value = getattr(cw, name)
    assert value.__name__ == name
    assert inspect.getdoc(value)
    assert value.__module__.startswith(f"comwalk.{homes()[name]}")


def test_dir_lists_them():
    """So that an interactive shell completes them."""
    assert set(dir(cw)) >= PUBLIC
    public = {name for name in dir(cw) if not name.startswith("_")}
    modules = {path.stem for path in Path(cw.__file__).parent.iterdir()}
    helpers = {"TYPE_CHECKING", "Any", "annotations", "exports_of", "metadata"}
    assert public - modules - helpers == PUBLIC


def test_unknown_names_are_attribute_errors():
    """As of any module."""
    with pytest.raises(AttributeError, match="has no attribute 'walk_on_water'"):
        _ = cw.walk_on_water
    assert not hasattr(cw, "numpy")


def test_the_version_is_the_installed_one():
    """Read from the package's metadata, when asked."""
    try:
        version = metadata.version("comwalk")
    except metadata.PackageNotFoundError:
        with pytest.raises(metadata.PackageNotFoundError):
            _ = cw.__version__
    else:
        assert cw.__version__ == version


HEAVY = ("mujoco", "matplotlib", "scipy", "numpy", "numba", "trimesh")


def loaded(code: str, packages: tuple[str, ...]) -> list[str]:
    """Return which of some packages are loaded after some code, in a new process."""
    last = f"print([m for m in {packages} if m in sys.modules])"
    return ast.literal_eval(python(f"import sys; {code}; {last}").splitlines()[-1])


def test_import_is_light():
    """No work at import: neither physics nor plots nor numerics are loaded."""
    assert loaded("import comwalk", (*HEAVY, "rich", "cyclopts")) == []


@pytest.mark.parametrize("words", ["--help", "--version"])
def test_what_needs_no_numerics_loads_none(words):
    """The page of help takes hardly longer than the interpreter."""
    run = f"from comwalk.cli import main; print(main(['{words}']))"
    assert loaded(run, HEAVY) == []


@pytest.mark.parametrize("command", ["walk", "check", "dance", "pattern"])
def test_help_of_a_command_needs_no_physics(command):
    """It shows defaults, a few of which are arrays."""
    run = f"from comwalk.cli import main; print(main(['{command}', '--help']))"
    assert loaded(run, tuple(name for name in HEAVY if name != "numpy")) == []


def test_a_walk_loads_nothing_that_only_others_need():
    """No pictures, no meshes, no splines for dances: they cost half a second."""
    run = (
        "from comwalk.config import WalkConfig;from comwalk.setup import build_walk;"
        "print(build_walk(WalkConfig(steps=1)).run().outcome.ok)"
    )
    assert loaded(run, ("matplotlib", "trimesh", "scipy.interpolate")) == []


def test_the_paper_theory_needs_no_physics():
    """Pattern and controller run without MuJoCo and without matplotlib."""
    code = (
        "import sys, comwalk as cw;"
        "cw.make_pattern(cw.plan_steps(cw.Gait(), 4), cw.Pendulum()).at(1.0);"
        "cw.Control(gains=cw.Gains());"
        "print([m for m in ('mujoco', 'matplotlib') if m in sys.modules])"
    )
    assert python(code).strip() == "[]"


def test_eight_lines_from_robot_to_plot(tmp_path, monkeypatch):
    """The lines of the module's own docstring run, with fewer steps."""
    lines = re.findall(r"^    (.+)$", inspect.getdoc(cw), flags=re.MULTILINE)
    assert len(lines) == 8
    code = "\n".join(lines)
    assert ", 20)" in code
    monkeypatch.chdir(tmp_path)
    exec(code.replace(", 20)", ", 1)"), {})
    assert inked(tmp_path / "walk.png") > 0.02
