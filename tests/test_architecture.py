"""How the code is built: one direction of imports, small bodies, documented names."""

from __future__ import annotations

import ast
import statistics
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import comwalk

SOURCE = Path(comwalk.__file__).parent

ORDER = (
    # The paper on paper: numpy and scipy only.
    "errors",
    "compiled",
    "rows",
    "spatial",
    "sensing",
    "polygon",
    "pendulum",
    "footsteps",
    "swing",
    "motion",
    "dances",
    "motion_files",
    "pattern",
    "lookup",
    "planning",
    "replanning",
    "stability",
    "sampled",
    "bounds",
    "margins",
    "sampled_bounds",
    "response",
    "measured_loop",
    "monte_carlo",
    "control",
    "certificate",
    "certificate_table",
    "design",
    "published",
    "experiment",
    "plant",
    "resolution",
    "resolver",
    "settings",
    "record",
    "observed",
    # The whole body, in MuJoCo.
    "model_parts",
    "mesh_files",
    "meshes",
    "up_axis",
    "urdf_tree",
    "urdf",
    "mjcf",
    "model_files",
    "coupling",
    "skeleton",
    "profile",
    "soles",
    "anatomy",
    "roles",
    "posture",
    "servos",
    "marking",
    "marked",
    "robot",
    "flat",
    "handles",
    "kernels",
    "fast",
    "reach",
    "terrain",
    "simulator",
    "footing",
    "weighing",
    "whole_body",
    "dynamics",
    "self_collision",
    "feasibility",
    "defaults",
    "description",
    # The loop, its record and its pictures.
    "walk",
    "identification",
    "identified",
    "tick_records",
    "measure_kernels",
    "act_kernels",
    "tick_kernels",
    "tick",
    "batch",
    "plant_kernels",
    "log",
    "ros_messages",
    "mcap_file",
    "robot_urdf",
    "topics",
    "mcap_log",
    "run_log",
    "export",
    "compiled_loop",
    "closed_loop",
    "summary",
    "plot",
    "gain_plane",
    "response_plot",
    "recording",
    "gl",
    "video",
    "render",
    "portrait",
    "shapes",
    "page_server",
    "scene",
    "charts",
    "run_charts",
    "tables",
    "page",
    "report",
    "run",
    "viewer",
    # For people.
    "config",
    "trials",
    "generate",
    "bench",
    "bench_report",
    "figures",
    "flags",
    "bars",
    "page_commands",
    "page_flags",
    "live",
    "live_page",
    "view_commands",
    "commands",
    "robot_commands",
    "log_commands",
    "bench_commands",
    "certify_commands",
    "identify_commands",
    "generate_commands",
    "cli",
    "__main__",
)
"""Import order: a module may import what stands before it, never what stands after."""

_COMMANDS = {
    *("bench_commands", "certify_commands", "cli", "commands", "log_commands"),
    *("generate_commands", "identify_commands", "page_commands"),
    *("robot_commands", "view_commands"),
}

PACKAGES = {
    "mujoco": {
        *("model_parts", "meshes", "up_axis", "urdf", "mjcf", "model_files"),
        *("skeleton", "soles", "anatomy", "roles", "posture", "servos"),
        *("marking", "marked", "robot"),
        *("robot_urdf", "topics"),
        *("simulator", "dynamics", "self_collision", "feasibility", "compiled_loop"),
        *("run", "recording", "render", "portrait", "shapes", "scene"),
        *("viewer", "live_page"),
    },
    "numba": {"compiled", "handles"},
    "trimesh": {"mesh_files"},
    "viser": {"live_page", "page_server", "scene", "viewer"},
    "av": {"video"},
    "mcap": {"mcap_file", "run_log"},
    "zstandard": {"mcap_file"},
    "matplotlib": {"gain_plane", "plot", "response_plot", "figures", "render"},
    "rich": {*_COMMANDS, "bars", "page_server"},
    "cyclopts": {*_COMMANDS, "flags", "page_flags"},
}
"""Where a package may be imported."""

PRINTERS = _COMMANDS
"""Where something may be printed."""

MODULES = sorted(path.stem for path in SOURCE.glob("*.py") if path.stem != "__init__")


@cache
def text_of(module: str) -> str:
    """Return a module's source."""
    return (SOURCE / f"{module}.py").read_text(encoding="utf-8")


@cache
def tree_of(module: str) -> ast.Module:
    """Return a module's syntax tree."""
    return ast.parse(text_of(module))


def nodes_at_run_time(tree: ast.AST) -> Iterator[ast.AST]:
    """Return all nodes but those under `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        yield node
        yield from nodes_at_run_time(node)


def own_imports(module: str) -> set[str]:
    """Return the modules of this package that a module imports at run time."""
    found = set()
    for node in nodes_at_run_time(tree_of(module)):
        if isinstance(node, ast.ImportFrom) and node.level:
            names = [node.module] if node.module else [n.name for n in node.names]
            found |= {str(name).split(".")[0] for name in names}
    return found


def packages_of(module: str) -> set[str]:
    """Return the other packages that a module imports."""
    found = set()
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(str(node.module).split(".")[0])
    return found


@cache
def functions_of(module: str) -> list[tuple[str, ast.FunctionDef]]:
    """Return every function and method, at any depth, with its qualified name."""
    found: list[tuple[str, ast.FunctionDef]] = []

    def below(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            name = prefix
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                name = f"{prefix}.{child.name}"
            if isinstance(child, ast.FunctionDef):
                found.append((name, child))
                name += "._inside"
            below(child, name)

    below(tree_of(module), module)
    return found


def body_lines(function: ast.FunctionDef) -> int:
    """Return the number of lines of a body, its docstring not counted."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return body[-1].end_lineno - body[0].lineno + 1 if body else 0


def is_public(name: str) -> bool:
    """Return whether no part of a dotted name is private."""
    return not any(part.startswith("_") for part in name.split("."))


def test_every_module_has_its_place():
    """The order above is the table of contents of the package."""
    assert set(MODULES) <= set(ORDER)
    assert len(set(ORDER)) == len(ORDER)


@pytest.mark.parametrize("module", MODULES)
def test_imports_flow_one_way(module):
    """Nothing is imported from further down, inside functions neither."""
    later = ORDER[ORDER.index(module) :]
    assert not own_imports(module) & set(later)


@pytest.mark.parametrize("module", MODULES)
def test_imports_inside_the_package_are_relative(module):
    """The package does not name itself."""
    assert "comwalk" not in packages_of(module)


@pytest.mark.parametrize("module", MODULES)
def test_packages_stay_where_they_belong(module):
    """All that is on paper runs with numpy and scipy alone."""
    for package in packages_of(module) & set(PACKAGES):
        assert module in PACKAGES[package], package


@pytest.mark.parametrize("module", sorted(set(MODULES) - PRINTERS))
def test_nothing_is_printed(module):
    """A library returns values and raises errors."""
    calls = [n for n in ast.walk(tree_of(module)) if isinstance(n, ast.Call)]
    names = [c.func.id for c in calls if isinstance(c.func, ast.Name)]
    assert not {"print", "input", "exit"} & set(names)


@pytest.mark.parametrize("module", [*MODULES, "__init__"])
def test_no_assertions_globals_or_leftovers(module):
    """Input is refused by errors; nothing is left to be done later."""
    nodes = list(ast.walk(tree_of(module)))
    assert not [n.lineno for n in nodes if isinstance(n, (ast.Assert, ast.Global))]
    assert not any(word in text_of(module) for word in ("TODO", "FIXME", "XXX", "HACK"))
    assert text_of(module).isascii()


@pytest.mark.parametrize("module", [*MODULES, "__init__"])
def test_everything_public_is_documented(module):
    """Modules, classes, functions and methods, and every field under itself."""
    assert ast.get_docstring(tree_of(module))
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.ClassDef) and is_public(node.name):
            assert ast.get_docstring(node), node.name
            fields = [n for n in node.body if isinstance(n, ast.AnnAssign)]
            for field in fields:
                if not is_public(ast.unparse(field.target)):
                    continue
                after = node.body[node.body.index(field) + 1 :][:1]
                documented = (
                    bool(after)
                    and isinstance(after[0], ast.Expr)
                    and isinstance(after[0].value, ast.Constant)
                    and isinstance(after[0].value.value, str)
                )
                assert documented, f"{node.name}.{ast.unparse(field.target)}"
    for name, function in functions_of(module):
        if is_public(name):
            assert ast.get_docstring(function), name


@pytest.mark.parametrize("module", MODULES)
def test_every_function_is_typed(module):
    """Every argument but self and cls, and every return value."""
    for name, function in functions_of(module):
        given = function.args
        every = [*given.posonlyargs, *given.args, *given.kwonlyargs]
        every += [a for a in (given.vararg, given.kwarg) if a is not None]
        bare = [a.arg for a in every if a.annotation is None]
        assert set(bare) <= {"self", "cls"}, name
        assert function.returns is not None, name


@pytest.mark.parametrize("module", MODULES)
def test_no_body_is_long(module):
    """At most 40 lines: what does not fit a screen is two functions."""
    lengths = {name: body_lines(f) for name, f in functions_of(module)}
    assert {n: lines for n, lines in lengths.items() if lines > 40} == {}


def test_most_bodies_are_short():
    """Half of all have at most 8 lines, nine tenths at most 20."""
    lengths = [body_lines(f) for m in MODULES for _, f in functions_of(m)]
    assert statistics.median(lengths) <= 8
    assert statistics.quantiles(lengths, n=10)[-1] <= 20


def test_classes_are_abstract_or_final():
    """Nothing is inherited but protocols, tuples, enumerations, errors and flags."""
    roots = {"Protocol", "NamedTuple", "IntEnum", "StrEnum", "Enum", "TypedDict"}
    roots |= {"event.Listener"}  # numba's, by which it tells that it compiles
    for module in sorted({*MODULES} - {"config"}):
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.ClassDef) and not node.name.endswith("Error"):
                bases = {ast.unparse(base).split("[")[0] for base in node.bases}
                assert bases <= roots, f"{module}.{node.name}"
