"""Tables of benchmarks, printed or put into the page that shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

Rows = Iterator[tuple[Any, ...]]
"""Rows of cells, the head first."""


def table_of(rows: Rows) -> str:
    """Return rows as a table, the first one its head."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    rule = "|" + "---|" * (lines[0].count(" | ") + 1)
    return "\n".join([lines[0], rule, *lines[1:]])


def tell(
    words: list[str], tables: Mapping[str, Callable[[], Rows]], page: Path
) -> None:
    """Print the tables that are named, or all; with --write put them into a page."""
    for name in [word for word in words if word in tables] or list(tables):
        table = table_of(tables[name]())
        print(f"\n## {name}\n\n{table}", flush=True)
        if "--write" in words:
            text, mark = page.read_text(encoding="utf-8"), f"<!-- {name} -->\n"
            before, rest = text.split(mark)
            after = rest.split(f"<!-- /{name} -->")[1]
            text = f"{before}{mark}{table}\n<!-- /{name} -->{after}"
            page.write_text(text, encoding="utf-8")
