"""A progress bar that counts, for commands that take long."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


@contextmanager
def counting_bar(
    what: str, total: int, quiet: bool
) -> Generator[Callable[[int], None] | None]:
    """Show a progress bar on a terminal.

    Args:
        what: What is counted.
        total: How many there are.
        quiet: Whether to show none.

    Yields:
        What is to be called with how many are done; None if no bar is shown.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    columns = (
        TextColumn(what),
        MofNCompleteColumn(),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)
