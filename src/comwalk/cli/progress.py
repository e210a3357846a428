"""Progress bars for long commands."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


@contextmanager
def counting_bar(
    what: str, total: int, quiet: bool
) -> Generator[Callable[[int], None] | None]:
    """Show a progress bar that counts, on a terminal.

    Args:
        what: What is counted.
        total: How many there are.
        quiet: Whether to show none.

    Yields:
        What is to be called with how many are done; None if no bar is shown.
    """
    head, tail = (TextColumn(what), MofNCompleteColumn()), (TimeElapsedColumn(),)
    with _bar(head, tail, total, quiet) as advance:
        yield advance


@contextmanager
def share_bar(
    what: str, quiet: bool = False
) -> Generator[Callable[[float], None] | None]:
    """Show a progress bar on a terminal.

    Args:
        what: What is made.
        quiet: Whether to show none.

    Yields:
        What is to be called with the share that is done, from 0 to 1; None if no bar is
        shown.
    """
    with _bar((TextColumn(what),), (), 1.0, quiet) as advance:
        yield advance


@contextmanager
def time_bar(duration: float, quiet: bool) -> Generator[Callable[[float], None] | None]:
    """Show a progress bar of simulated time, on a terminal.

    Args:
        duration: How much there is [s].
        quiet: Whether to show none.

    Yields:
        What is to be called with the time that is over [s]; None if no bar is shown.
    """
    head = (TextColumn("{task.completed:.1f} of {task.total:.1f} s"),)
    with _bar(head, (), duration, quiet) as advance:
        yield advance


@contextmanager
def _bar(
    head: tuple[ProgressColumn, ...],
    tail: tuple[ProgressColumn, ...],
    total: float,
    quiet: bool,
) -> Generator[Callable[[float], None] | None]:
    """Show a progress bar with columns before and after it; yield what moves it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    columns = (*head, BarColumn(), *tail, TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)
