"""What the log of a run holds, its repair after a crash, and its numbers as tables."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Metadata, Schema

from ..control import End as Ending
from ..control import Outcome
from ..errors import RunError
from ..pattern import Phase
from ..robot import load_robot
from .columns import Log, rows_left, save_columns
from .mcap_file import Block, End, McapWriter, Topic, read_mcap
from .mcap_log import (
    MCAP_NAME,
    is_open,
    save_mcap,
)
from .ros_messages import decode, layout_of
from .run_data import read_columns, read_summary

ROWS_NAME = "run.npy"
"""Rows of a run that is not saved yet, in its folder."""


def log_path(run: str | Path) -> Path:
    """Return the log of a run, which is made of its columns if it is not there yet.

    A run that was killed before it was saved is saved first, as far as it came.

    Args:
        run: Folder of the run, or the log itself.

    Returns:
        The file.

    Raises:
        RunError: If there is none, and no columns to make it of.
    """
    path = Path(run)
    file = path / MCAP_NAME if path.is_dir() else path
    if path.is_dir():
        recover(path)
        if not file.is_file() and (path / "run.npz").is_file():
            _make_log(path)
    if not file.is_file():
        raise RunError(f"{path} is not a run: it has no {MCAP_NAME}")
    return file


def recover(folder: Path) -> bool:
    """Write run.npz of the rows that a killed run left, in place of an earlier run.

    Args:
        folder: Folder of the run.

    Returns:
        Whether there was something to recover.

    Raises:
        RunError: If a run still writes the rows, they cannot be read, or run.npz
            cannot be written.
    """
    rows = folder / ROWS_NAME
    if not rows.is_file():
        return False
    if is_open(rows):
        raise RunError(f"{rows} is still being written; wait until the run is over")
    columns = rows_left(rows)
    for name in ("summary.json", MCAP_NAME):
        (folder / name).unlink(missing_ok=True)
    save_columns(folder / "run.npz", columns)
    rows.unlink()
    return True


def _make_log(folder: Path) -> None:
    """Write run.mcap of the columns of a saved run."""
    columns, outcome = read_columns(folder), None
    try:
        summary = read_summary(folder)
        settings = summary["settings"]
        outcome = _ending(summary)
    except RunError:
        settings = _left_settings(folder)
    known = settings.get("config") or {}
    robot = None
    if settings.get("robot") is not None:
        name = known.get("robot") or settings["robot"]
        robot = load_robot(name, profile=known.get("profile"))
    log = Log(len(columns["t"]))
    kind = [(k, c.dtype, c.shape[1:]) for k, c in columns.items() if c.ndim]
    table = log.take(np.dtype(kind), len(columns["t"]))
    for name in table.dtype.names or ():
        table[name] = columns[name]
    log.grow(len(table))
    period = settings["control"]["period"]
    save_mcap(folder / MCAP_NAME, log, robot, period, settings, outcome)


def _ending(summary: dict[str, Any]) -> str:
    """Return how a saved run ended, in the words of its outcome."""
    phase, step = Phase[summary["phase"].upper()], summary["steps_completed"]
    end, time = Ending(summary["outcome"]), summary["time_s"]
    outcome = Outcome(
        end=end, time=time, phase=phase, step=step, cause=summary["cause"]
    )
    return str(outcome)


def _left_settings(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise RunError(f"{folder} is not a run: it has no readable settings") from None


# ---- What it holds ----------------------------------------------------------------


@dataclass(frozen=True)
class TopicFacts:
    """What a log holds of a topic."""

    topic: str
    """Its name."""
    kind: str
    """Type of its messages."""
    messages: int
    """How many there are."""
    first_s: float
    """Time of the first [s]."""
    last_s: float
    """Time of the last [s]."""
    latched: bool = False
    """Whether who comes late is to get the last message."""

    @property
    def rate(self) -> float | None:
        """Messages a second [Hz], None if they are too few to tell."""
        span = self.last_s - self.first_s
        return (self.messages - 1) / span if span > 0.0 else None


@dataclass(frozen=True)
class LogFacts:
    """What a log holds."""

    topics: tuple[TopicFacts, ...]
    """All topics that have messages, in the order of the file."""
    settings: dict[str, Any]
    """What the run was made with."""
    outcome: str | None
    """How it ended; None if the log was cut off before."""
    end: End
    """Whether the file is whole."""

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)

    @property
    def duration(self) -> float:
        """Time of the last message [s]."""
        return max((topic.last_s for topic in self.topics), default=0.0)


def inspect(path: Path) -> LogFacts:
    """Return what a log holds, cut off or not.

    Args:
        path: The file.

    Returns:
        What is whole in it.

    Raises:
        RunError: If it cannot be read, comwalk did not write it, or nothing is in it.
    """
    names: dict[int, Topic] = {}
    notes: dict[str, Any] = {}
    counts: dict[int, int] = {}
    spans: dict[int, tuple[int, int]] = {}
    end = End(False, 0, 0)
    for item in _Log(path, names):
        if isinstance(item, Metadata):
            notes[item.name] = _note(item, path)
        elif isinstance(item, End):
            end = item
        elif isinstance(item, Block):
            for channel, entries in item.index().items():
                first, last = int(entries[0, 0]), int(entries[-1, 0])
                first = spans.get(channel, (first, last))[0]
                spans[channel] = first, last
                counts[channel] = counts.get(channel, 0) + len(entries)
    if not counts:
        raise RunError(
            f"{path} was cut off before its first message: nothing is left of the run"
        )
    topics = tuple(
        TopicFacts(t.name, t.kind, counts[i], *(x / 1e9 for x in spans[i]), t.latched)
        for i, t in names.items()
        if i in counts
    )
    return LogFacts(topics, notes.get("settings", {}), notes.get("outcome"), end)


def _note(record: Metadata, path: Path) -> Any:
    try:
        return json.loads(record.metadata["json"])
    except (KeyError, ValueError):
        raise RunError(f"{path} is broken: {record.name} in it is unreadable") from None


class _Log:
    """The items of a file; topics go into a table as they come. Final."""

    def __init__(self, path: Path, names: dict[int, Topic]) -> None:
        self._path, self._names = path, names

    def __iter__(self) -> Iterator[Metadata | Block | End]:
        """Yield what is said once, the messages, and the end."""
        kinds: dict[int, str] = {}
        for item in read_mcap(self._path):
            if isinstance(item, Schema):
                kinds[item.id] = item.name.replace("/msg/", "/")
            elif isinstance(item, Channel):
                latched = "durability: 1" in item.metadata["offered_qos_profiles"]
                kind = kinds[item.schema_id]
                self._names[item.id] = Topic(item.topic, kind, latched)
            else:
                yield item


# ---- Repair -----------------------------------------------------------------------


def repair(path: Path) -> LogFacts:
    """Finish a log that was cut off, so that every tool can open it.

    All messages before the cut are kept; a log that is whole is left alone.

    Args:
        path: The file; it is replaced at once, or not at all.

    Returns:
        What it holds. `end` tells whether it was whole before.

    Raises:
        RunError: If it cannot be read or written, a run still writes it, or nothing
            is in it.
    """
    if is_open(path):
        raise RunError(f"{path} is still being written; wait until the run is over")
    facts = inspect(path)
    if facts.end.whole:
        return facts
    part = path.with_name(f".{path.name}.part")
    try:
        copy_whole(path, part)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RunError(f"cannot write {path}: {error.strerror}") from None
    return facts


def copy_whole(path: Path, target: Path) -> None:
    """Copy all that can be read of a log into a new, finished one.

    A log that was not cut off before its last message gives the bytes that it had or
    would have had.

    Args:
        path: The log.
        target: The new file.

    Raises:
        RunError: If the log cannot be read.
        OSError: If the new file cannot be written.
    """
    names: dict[int, Topic] = {}
    known = 0
    with target.open("wb") as file:
        writer = McapWriter(file)
        for item in _Log(path, names):
            if len(names) > known:
                writer.add_topics(tuple(names.values()))
                known = len(names)
            if isinstance(item, Metadata):
                writer.add_notes(item.name, item.metadata)
            elif isinstance(item, Block):
                writer.add_chunk(item.messages, item.index())
        writer.finish()


# ---- Tables -----------------------------------------------------------------------


def tables(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Return the numbers of a log, a table for each topic.

    Args:
        path: The file, whole or cut off.

    Returns:
        Columns by name, by topic, such as "point.x" of "/com" and
        "position.l_knee" of "/joint_states"; "time" [s] is the first. Topics of text
        are left out.

    Raises:
        RunError: If the file cannot be read, or comwalk did not write it.
    """
    names: dict[int, Topic] = {}
    times: dict[int, list[np.ndarray]] = {}
    messages: dict[int, list[bytes]] = {}
    for item in _Log(path, names):
        if isinstance(item, Block):
            for channel in item.index():
                when, data = item.of(channel)
                times.setdefault(channel, []).append(when)
                messages.setdefault(channel, []).extend(data)
    return {
        names[i].name: {"time": np.concatenate(times[i]) / 1e9, **columns}
        for i, data in sorted(messages.items())
        if (columns := _columns(names[i].kind, data))
    }


def _columns(kind: str, messages: list[bytes]) -> dict[str, np.ndarray]:
    """Return the numbers of messages of one topic, which have one layout."""
    example = decode(kind, messages[0])
    layout = layout_of(kind, example)
    size = layout.dtype.itemsize
    if any(len(message) != size for message in messages):
        raise RunError(f"messages of the type {kind} are not all of one layout")
    rows, found = layout.read(b"".join(messages)), {}
    for path in layout.dtype.names or ():
        if "stamp" in path or "covariance" in path:
            continue
        values = rows[path].reshape(len(rows), -1)
        for name, column in zip(_names(kind, path, example), values.T, strict=True):
            found[name] = column
    return found


def _names(kind: str, path: str, example: dict[str, Any]) -> list[str]:
    """Return names for the numbers of a field: of joints, of frames, or x, y, z."""
    value: Any = example
    parts = path.split(".")
    for part in parts:
        value = value[int(part)] if isinstance(value, list) else value[part]
    if parts[0] == "transforms":
        child = example["transforms"][int(parts[1])]["child_frame_id"]
        path = f"{child}.{parts[-1]}"
    letters = example["name"] if kind == "sensor_msgs/JointState" else list(value)
    return [f"{path}.{letter}" for letter in letters]
