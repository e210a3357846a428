"""The build of the code: layers that know only those below, small rooms and bodies."""

from __future__ import annotations

import ast
import statistics
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import comwalk

SOURCE = Path(comwalk.__file__).parent

LAYERS = {
    "errors": set(),
    "sides": set(),
    "lazy": set(),
    "settings": set(),
    "compiled": {"numba"},
    "handles": {"numba"},
    "pattern": set(),
    "embedding": set(),
    "control": set(),
    "robot": {"mujoco", "trimesh"},
    "runs": {"mcap", "mujoco"},
    "walking": {"mujoco"},
    "certificates": {"mujoco"},
    "views": {"av", "matplotlib", "mujoco", "rich", "viser"},
    "config": set(),
    "config_files": set(),
    "run": {"mujoco"},
    "replay": {"mujoco"},
    "setup": set(),
    "generate": set(),
    "bench": set(),
    "cli": {"cyclopts", "matplotlib", "mujoco", "rich", "viser"},
    "__main__": set(),
}
"""Layers from the bottom up, and the heavy packages that each may import."""

HEAVY = set().union(*LAYERS.values())
MOST_ROOMS, LONGEST_ROOM, LONGEST_BODY = 16, 500, 40

FILES = sorted(SOURCE.rglob("*.py"))
ROOMS = [path for path in FILES if path.name != "__init__.py"]


def name_of(path: Path) -> str:
    """Return a file's place in the package, as in pattern.footsteps."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def layer_of(name: str) -> str:
    """Return the layer of a module."""
    return name.split(".")[0]


@cache
def tree_of(path: Path) -> ast.Module:
    """Return a file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imports_of(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the modules of comwalk, and the names, that a file imports anywhere."""
    package = name_of(path).split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            module = ".".join([*base, *((node.module or "").split("."))]).strip(".")
            for alias in node.names:
                yield module, alias.name


def exports_of(package: str) -> dict[str, str]:
    """Return the rooms of a package's exports by name."""
    return {n: m for m, n in imports_of(SOURCE / package / "__init__.py")}


def room_of(module: str, name: str) -> str:
    """Return the file that an import is read from in the end."""
    path = SOURCE.joinpath(*module.split(".")) if module else SOURCE
    if not path.is_dir():
        return module
    inside = path / name
    if inside.with_suffix(".py").is_file() or inside.is_dir():
        return f"{module}.{name}".strip(".")
    return exports_of(module.replace(".", "/")).get(name, module)


def functions_of(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield every function and method, at any depth."""
    return (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))


def body_lines(function: ast.FunctionDef) -> int:
    """Return the number of lines of a body, its docstring not counted."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    return body[-1].end_lineno - body[0].lineno + 1 if body else 0


def test_every_module_is_in_a_layer():
    """The table above is the table of contents."""
    assert {layer_of(name_of(path)) for path in ROOMS} == set(LAYERS)


def test_no_layer_imports_what_is_above_it():
    """Not inside functions, not for types either."""
    order = list(LAYERS)
    wrong = [
        f"{name_of(path)} imports {module}.{name}"
        for path in ROOMS
        for module, name in imports_of(path)
        if order.index(layer_of(room_of(module, name)))
        > order.index(layer_of(name_of(path)))
    ]
    assert wrong == []


def test_packages_are_entered_by_their_doors():
    """Other packages use what a package exports; its rooms are its own affair."""
    wrong = [
        f"{name_of(path)} reaches into {module} for {name}"
        for path in ROOMS
        for module, name in imports_of(path)
        if "." in module
        and not name_of(path).startswith(layer_of(module))
        and not SOURCE.joinpath(*module.split(".")).is_dir()
    ]
    assert wrong == []


def test_no_room_has_the_name_of_an_export():
    """What `from package import name` gives must not depend on what ran before."""
    for folder in {path.parent for path in ROOMS}:
        door = folder / "__init__.py"
        exports = {name for module, name in imports_of(door) if module}
        rooms = {path.stem for path in folder.glob("*.py")}
        assert not exports & rooms - {"lazy"}, folder


def test_no_circles():
    """Modules can be read one after the other, types included."""
    below = {
        name_of(path): {room_of(m, n) for m, n in imports_of(path)} for path in ROOMS
    }
    done: set[str] = set()

    def visit(name: str, way: tuple[str, ...]) -> None:
        assert name not in way, " -> ".join([*way, name])
        if name in done:
            return
        for other in below.get(name, ()):
            visit(other, (*way, name))
        done.add(name)

    for name in below:
        visit(name, ())


def test_packages_and_rooms_are_small():
    """At most 16 rooms a package, of at most 500 lines each."""
    rooms: dict[Path, int] = {}
    for path in ROOMS:
        rooms[path.parent] = rooms.get(path.parent, 0) + 1
    assert {p.name: n for p, n in rooms.items() if n > MOST_ROOMS} == {}
    lines = {name_of(p): len(p.read_text().splitlines()) for p in ROOMS}
    assert {p: n for p, n in lines.items() if n > LONGEST_ROOM} == {}


def test_heavy_packages_stay_where_they_belong():
    """All that is on paper runs with numpy and scipy alone."""
    for path in FILES:
        found = set()
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(str(node.module).split(".")[0])
        assert "comwalk" not in found, path
        allowed = LAYERS.get(layer_of(name_of(path)), set())
        assert not (found & HEAVY) - allowed, path


def test_libraries_return_values_and_raise_errors():
    """Only commands print; nothing is asserted, global, or left to be done later."""
    for path in FILES:
        text, nodes = path.read_text(encoding="utf-8"), list(ast.walk(tree_of(path)))
        calls = [n.func for n in nodes if isinstance(n, ast.Call)]
        names = {f.id for f in calls if isinstance(f, ast.Name)}
        if layer_of(name_of(path)) != "cli":
            assert not {"print", "input", "exit"} & names, path
        assert not [n for n in nodes if isinstance(n, (ast.Assert, ast.Global))], path
        assert not [w for w in ("TODO", "FIXME", "XXX", "HACK") if w in text], path
        assert text.isascii(), path


def test_public_names_are_documented_and_all_functions_are_typed():
    """Modules, classes, fields, functions: unit, shape and frame stand there."""
    for path in FILES:
        assert ast.get_docstring(tree_of(path)), path
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                check_class(path, node)
        for function in functions_of(tree_of(path)):
            check_types(path, function)
        for function in public_functions(tree_of(path)):
            assert ast.get_docstring(function), (path, function.name)


def public_functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods that users can call."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node)
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node


def check_class(path: Path, node: ast.ClassDef) -> None:
    """Assert that a class and each of its public fields is documented."""
    assert ast.get_docstring(node), (path, node.name)
    for field, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign):
            continue
        name = ast.unparse(field.target)
        told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        told |= ast.unparse(field.value or field.target).startswith("setting(")
        assert name.startswith("_") or told, (path, node.name, name)


def check_types(path: Path, function: ast.FunctionDef) -> None:
    """Assert that every argument but self and cls, and the result, is typed."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    every += [a for a in (given.vararg, given.kwarg) if a is not None]
    bare = {a.arg for a in every if a.annotation is None}
    assert bare <= {"self", "cls"}, (path, function.name)
    assert function.returns is not None, (path, function.name)


def test_bodies_are_short():
    """At most 40 lines: half of all at most 8, nine tenths at most 20."""
    found = [
        (body_lines(f), f"{name_of(p)}.{f.name}")
        for p in ROOMS
        for f in functions_of(tree_of(p))
    ]
    assert [x for x in found if x[0] > LONGEST_BODY] == []
    lengths = [n for n, _ in found]
    assert statistics.median(lengths) <= 8
    assert statistics.quantiles(lengths, n=10)[-1] <= 20


def test_classes_are_abstract_or_final():
    """Only protocols, tuples, enumerations, errors and abstract classes have heirs."""
    roots = {
        "Protocol",
        "Generic",
        "NamedTuple",
        "IntEnum",
        "StrEnum",
        "Enum",
        "TypedDict",
    }
    roots |= {"event.Listener"}  # numba's, which announces that it compiles
    for path in ROOMS:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                if "Abstract." in (ast.get_docstring(node) or ""):
                    roots.add(node.name)
    for path in ROOMS:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef) and not node.name.endswith("Error"):
                bases = {ast.unparse(base).split("[")[0] for base in node.bases}
                assert bases <= roots, f"{name_of(path)}.{node.name}"
