"""Measure the code: lines, modules, bodies, docstrings, tests, edges, circles.

python benchmarks/sizes.py [FOLDER ...]     # roots of checkouts; here if none
"""

from __future__ import annotations

import ast
import statistics
import sys
from pathlib import Path


def parts_of(path: Path) -> tuple[int, int, int]:
    """Return lines of text, of code, and of docstrings of a file."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    told: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
            continue
        if isinstance(node.value.value, str):
            told |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    code = [
        line
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.strip().startswith("#") and number not in told
    ]
    return len(lines), len(code), len(told)


def bodies_of(paths: list[Path]) -> list[int]:
    """Return the number of lines of each function's body, docstrings not counted."""
    found = []
    nodes = (n for p in paths for n in ast.walk(ast.parse(p.read_text("utf-8"))))
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            found.append(body[-1].end_lineno - body[0].lineno + 1 if body else 0)
    return found


def spread(bodies: list[int]) -> str:
    """Return median, 90th percentile and largest of body lengths."""
    tenths = statistics.quantiles(bodies, n=10)
    return f"{statistics.median(bodies):.0f} / {tenths[-1]:.0f} / {max(bodies)}"


def measure(root: Path) -> dict[str, str]:
    """Return the figures of a checkout by name."""
    source = root / "src" / "comwalk"
    files = sorted(source.rglob("*.py"))
    rooms = [path for path in files if path.name != "__init__.py"]
    tests = sorted((root / "tests").rglob("*.py"))
    tools = sorted((root / "benchmarks").rglob("*.py"))
    text, code, told = (
        sum(column) for column in zip(*map(parts_of, files), strict=True)
    )
    checked = sum(parts_of(path)[1] for path in tests)
    packages: dict[str, int] = {}
    for path in rooms:
        name = str(path.parent.relative_to(source))
        packages[name] = packages.get(name, 0) + 1
    return {
        "code lines": f"{code:,}",
        "text lines": f"{text:,}",
        "modules": str(len(rooms)),
        "modules per package": ", ".join(f"{n} {k}" for n, k in packages.items()),
        "longest module": str(max(parts_of(path)[0] for path in rooms)),
        "bodies, median / p90 / max": spread(bodies_of(files)),
        "the same in benchmarks": spread(bodies_of(tools)),
        "the same in tests": spread(bodies_of(tests)),
        "docstring per code line": f"{told / code:.2f}",
        "test per code line": f"{checked / code:.2f}",
    }


if __name__ == "__main__":
    columns = [measure(Path(root)) for root in sys.argv[1:] or ["."]]
    for name in columns[0]:
        print(f"{name:27}", *(f"{column[name]:>24}" for column in columns))
    print("Edges against the layers and circles: tests/test_layers.py, both 0")
