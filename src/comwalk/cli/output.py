"""Tables and JSON on standard output."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    pass


def _print(text: str) -> None:
    """Print a line as it is."""
    print(text)


def _print_json(value: Any) -> None:
    """Print one JSON value."""
    print(json.dumps(value, indent=2, allow_nan=False))


def _print_rows(rows: list[dict[str, Any]], as_json: bool) -> None:
    """Print dictionaries of the same keys as a table, or as JSON."""
    if as_json:
        _print_json(rows)
        return
    cells = [tuple(_cell(v) for v in row.values()) for row in rows]
    _print_table(cells, tuple(rows[0]))


def _print_table(rows: list[tuple], head: tuple[str, ...] = ("", "")) -> None:
    """Print a table without lines."""
    table = Table(*head, box=None, show_header=any(head), pad_edge=False)
    for row in rows:
        table.add_row(*row)
    Console(markup=False, emoji=False, highlight=False).print(table)


def _number(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _cell(value: Any) -> str:
    return ", ".join(value) if isinstance(value, list) else _number(value)


def _plain(value: Any) -> Any:
    from ..run import plain

    return plain(value)
