"""Tables and JSON on standard output."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from ..errors import printable


def print_json(value: Any) -> None:
    """Print one JSON value.

    Args:
        value: Dictionaries, lists, texts and finite numbers.
    """
    print(json.dumps(value, indent=2, allow_nan=False))


def print_text(text: str) -> None:
    """Print text, broken between words where the terminal ends.

    Args:
        text: Printed as it is.
    """
    Console(markup=False, emoji=False, highlight=False).print(printable(text))


def print_table(
    rows: Iterable[Sequence[str]], head: Sequence[str] = ("", ""), title: str = ""
) -> None:
    """Print a table without lines.

    Args:
        rows: Texts, as many as the head has.
        head: Names of the columns; no line for them if all are empty.
        title: What stands above it, if anything.
    """
    options: dict[str, Any] = {"title": title, "title_justify": "left"} if title else {}
    table = Table(*head, box=None, show_header=any(head), pad_edge=False, **options)
    for row in rows:
        table.add_row(*map(printable, row))
    Console(markup=False, emoji=False, highlight=False).print(table)


def print_rows(rows: Sequence[dict[str, Any]], as_json: bool) -> None:
    """Print dictionaries of the same keys as a table, or as JSON.

    Args:
        rows: The dictionaries, at least one.
        as_json: Whether JSON is wanted.
    """
    if as_json:
        print_json(rows)
        return
    print_table([[_cell(v) for v in row.values()] for row in rows], tuple(rows[0]))


def short_number(value: Any) -> str:
    """Return a number with six digits, nothing for None, other values as text."""
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _cell(value: Any) -> str:
    return ", ".join(value) if isinstance(value, list) else short_number(value)
