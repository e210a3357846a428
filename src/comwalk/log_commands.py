"""The commands `comwalk log` and `comwalk export`: what a run left in run.mcap."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from .errors import ParameterError
from .export import export_csv, export_parquet, export_rosbag2
from .run_log import LogFacts, inspect, log_path, repair

_Run = Annotated[Path, Parameter(help="Folder of a run, or its run.mcap.")]
_Json = Annotated[
    bool, Parameter(help="Print one JSON object instead of a table.", negative=())
]


def log(run: _Run, /, *, json: _Json = False) -> int:
    """Tell what the log of a run holds; one that a crash cut off is repaired first."""
    path = log_path(run)
    with Console(stderr=True).status("reading"):
        facts = repair(path)
    if json:
        _print_json(_table_of(facts, path))
        return 0
    console = Console(markup=False, emoji=False, highlight=False)
    about = Table("", "", box=None, show_header=False, pad_edge=False)
    for name, text in _about(facts):
        about.add_row(name, text)
    console.print(about)
    head = ("topic", "messages", "Hz", "from", "to", "type")
    rows = Table(*head, box=None, pad_edge=False)
    for topic in facts.topics:
        rate = "" if topic.rate is None else f"{topic.rate:.6g}"
        times = f"{topic.first_s:.3f} s", f"{topic.last_s:.3f} s"
        rows.add_row(topic.topic, str(topic.messages), rate, *times, topic.kind)
    console.print(rows)
    print(f"in {path}")
    return 0


def _about(facts: LogFacts) -> list[tuple[str, str]]:
    """Return what a table says of the whole log."""
    robot, command = facts.settings.get("robot"), facts.settings.get("command")
    rows = [("outcome", facts.outcome or "not known: the log was cut off before")]
    rows += [("robot", robot)] if robot else []
    rows += [("command", command)] if command else []
    if not facts.end.whole:
        rows.append(("repaired", _cut(facts)))
    return rows


def _cut(facts: LogFacts) -> str:
    """Return where a log was cut off."""
    return (
        f"it was cut off at byte {facts.end.size}; all {facts.messages} messages "
        f"before the cut, up to {facts.duration:.3f} s, are there"
    )


def _table_of(facts: LogFacts, path: Path) -> dict[str, Any]:
    """Return what a log holds, ready for JSON."""
    topics = [
        {"topic": t.topic, "type": t.kind, "messages": t.messages, "rate_hz": t.rate}
        | {"first_s": t.first_s, "last_s": t.last_s}
        for t in facts.topics
    ]
    return {
        "log": str(path),
        "repaired": not facts.end.whole,
        "outcome": facts.outcome,
        "duration_s": facts.duration,
        "messages": facts.messages,
        "topics": topics,
        "settings": facts.settings,
    }


def export(
    run: _Run,
    /,
    *,
    csv: Annotated[bool, Parameter(help="A CSV file a topic.", negative=())] = False,
    parquet: Annotated[
        bool,
        Parameter(
            help="A Parquet file a topic (pip install 'comwalk[parquet]').", negative=()
        ),
    ] = False,
    rosbag2: Annotated[
        bool, Parameter(help="A folder for `ros2 bag play`.", negative=())
    ] = False,
    out: Annotated[
        Path | None,
        Parameter(help="Where the folders csv, parquet, rosbag2 go; RUN if not given."),
    ] = None,
    json: _Json = False,
) -> int:
    """Write the log of a run for other programs; one cut off, up to the cut."""
    path = log_path(run)
    asked = {"csv": csv, "parquet": parquet, "rosbag2": rosbag2}
    if not any(asked.values()):
        raise ParameterError("say what to export: --csv, --parquet or --rosbag2")
    base = path.parent if out is None else out
    facts, written = inspect(path), {}
    with Console(stderr=True).status("exporting"):
        for name, write in _WRITERS.items():
            if asked[name]:
                written[name] = [str(file) for file in write(path, base / name)]
    if json:
        _print_json({"cut_off": not facts.end.whole, "files": written})
        return 0
    if not facts.end.whole:
        print(f"the log was cut off: what follows ends at {facts.duration:.3f} s")
    for name, files in written.items():
        print(f"{len(files)} files in {base / name}")
    return 0


_WRITERS = {"csv": export_csv, "parquet": export_parquet, "rosbag2": export_rosbag2}


def _print_json(value: Any) -> None:
    """Print one JSON value."""
    print(json_format.dumps(value, indent=2, allow_nan=False))
