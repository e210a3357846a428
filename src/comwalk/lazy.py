"""Import a package's public names when they are first used, so that starting is quick.

A package lists its exports once, under `if TYPE_CHECKING`, where type checkers and
editors read them; `exports_of` reads the same lines.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

_EXPORT = re.compile(r"^    from \.([\w.]+) import (\w+) as \2$", re.MULTILINE)


def exports_of(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package, Python's hooks for its names.

    Args:
        package: The package's `__name__`.
        file: Its `__file__`, with one line `from .room import Name as Name` per export.

    Returns:
        Both functions.
    """
    text = Path(file).read_text(encoding="utf-8")
    homes = {name: room for room, name in _EXPORT.findall(text)}

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f".{homes[name]}", package), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*homes, *vars(sys.modules[package])})

    return find, names
