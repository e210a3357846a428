"""The columns of a run as ROS 2 messages in an MCAP file, for other tools."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer

from ..errors import RunError
from ..robot import Robot
from .ros_messages import definition
from .topics import Columns, Latched, Stream, latched_of, streams_of

MCAP_NAME = "run.mcap"
"""Name of the file in the folder of a run."""

LIBRARY = "comwalk"
"""What the files say of who wrote them."""

_SLOW_TIME = 0.02  # between messages of slow topics [s]


def write_mcap(
    path: Path,
    columns: Columns,
    robot: Robot | None,
    settings: dict[str, Any],
    outcome: str | None,
) -> None:
    """Write the columns of a run as messages, in order of time.

    Args:
        path: The file; replaced at once when all is written, or not at all.
        columns: The run's columns.
        robot: The robot; None for the simplified model.
        settings: What the run is made with, ready for JSON.
        outcome: How it ended; None if it was killed.

    Raises:
        RunError: If it cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="ros2", library=LIBRARY)
            _add_note(writer, "settings", settings)
            _add_messages(writer, columns, robot, settings["control"]["period"])
            if outcome is not None:
                _add_note(writer, "outcome", outcome)
            writer.finish()
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RunError(f"cannot write {path}: {error.strerror}") from None


def _add_note(writer: Writer, name: str, value: Any) -> None:
    writer.add_metadata(name, {"json": json.dumps(value, sort_keys=True)})


def _add_messages(
    writer: Writer, columns: Columns, robot: Robot | None, period: float
) -> None:
    """Write all messages: those that are said once, then row by row."""
    times = nanoseconds(columns["t"])
    latched, streams = latched_of(robot), streams_of(robot, columns.keys())
    channels = _register(writer, latched, streams)
    for one in latched:
        start = int(times[0])
        writer.add_message(channels[one.topic], start, one.message, start)
    every = max(1, round(_SLOW_TIME / period))
    queues = [_messages(x, columns, times, every if x.slow else 1) for x in streams]
    ids = [channels[stream.topic] for stream in streams]
    for row, time in enumerate(times.tolist()):
        for stream, channel, queue in zip(streams, ids, queues, strict=True):
            if not stream.slow or row % every == 0:
                number = row // every if stream.slow else row
                writer.add_message(channel, time, next(queue), time, number)


def _register(
    writer: Writer, latched: Sequence[Latched], streams: Sequence[Stream]
) -> dict[str, int]:
    """Name all topics and their types; return the channel of each topic."""
    kinds = [(x.topic, x.kind, True) for x in latched]
    kinds += [(x.topic, x.layout.kind, False) for x in streams]
    schemas = {
        kind: writer.register_schema(
            kind.replace("/", "/msg/"), "ros2msg", definition(kind).encode()
        )
        for kind in dict.fromkeys(kind for _, kind, _ in kinds)
    }
    return {
        topic: writer.register_channel(
            topic, "cdr", schemas[kind], {"offered_qos_profiles": qos(is_latched)}
        )
        for topic, kind, is_latched in kinds
    }


def nanoseconds(times: np.ndarray) -> np.ndarray:
    """Return times [s] in whole nanoseconds, as messages count them."""
    return np.rint(times * 1e9).astype(np.int64)


def _messages(
    stream: Stream, columns: Columns, times: np.ndarray, every: int
) -> Iterator[bytes]:
    """Yield the messages of a topic, each a copy of the layout's with its numbers."""
    thin = {name: array[::every] for name, array in columns.items() if array.ndim}
    stamps, layout = times[::every], stream.layout
    buffer = bytearray(layout.template * len(stamps))
    numbers = np.frombuffer(buffer, layout.dtype)
    for name in layout.dtype.names or ():
        if name.endswith("stamp.sec"):
            numbers[name] = stamps // 1_000_000_000
        elif name.endswith("stamp.nanosec"):
            numbers[name] = stamps % 1_000_000_000
    for field, values in stream.values(thin).items():
        numbers[field] = values.reshape(numbers[field].shape)
    size = layout.dtype.itemsize
    return (bytes(buffer[i : i + size]) for i in range(0, len(buffer), size))


def qos(latched: bool) -> str:
    """Return the quality of service that ROS 2 is to offer, as rosbag2 writes it.

    Args:
        latched: Whether who comes late is to get the last message.

    Returns:
        YAML.
    """
    policies = {"history": 3 - 2 * latched, "depth": int(latched), "reliability": 1}
    policies["durability"] = 1 if latched else 2
    lines = [f"{name}: {value}" for name, value in policies.items()]
    for name in ("deadline", "lifespan"):
        lines += [f"{name}:", "  sec: 9223372036", "  nsec: 854775807"]
    lines += ["liveliness: 1", "liveliness_lease_duration:"]
    lines += ["  sec: 9223372036", "  nsec: 854775807"]
    lines += ["avoid_ros_namespace_conventions: false"]
    return "- " + "\n  ".join(lines)


# ---- What a file holds ------------------------------------------------------------


class TopicFacts(NamedTuple):
    """Contents of a topic."""

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
    qos: str
    """Quality of service, as rosbag2 writes it."""

    @property
    def rate(self) -> float | None:
        """Messages a second [Hz], None if they are too few to tell."""
        span = self.last_s - self.first_s
        return (self.messages - 1) / span if span > 0.0 else None


@dataclass(frozen=True)
class LogFacts:
    """Contents of a file."""

    topics: tuple[TopicFacts, ...]
    """All topics that have messages, in the order of the file."""
    settings: dict[str, Any]
    """The settings of the run."""
    outcome: str | None
    """How it ended; None if it was killed."""

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)

    @property
    def duration(self) -> float:
        """Time of the last message [s]."""
        return max((topic.last_s for topic in self.topics), default=0.0)


def inspect(path: Path) -> LogFacts:
    """Return the contents of a run's MCAP file.

    Args:
        path: The file.

    Returns:
        Its topics and notes.

    Raises:
        RunError: If it cannot be read, or comwalk did not write it.
    """
    counts: dict[int, list[int]] = {}
    try:
        with path.open("rb") as file:
            reader = make_reader(file)
            library = reader.get_header().library
            if library != LIBRARY:
                raise RunError(f"{path} was written by {library}, not by comwalk")
            summary = reader.get_summary()
            notes = {
                m.name: json.loads(m.metadata["json"]) for m in reader.iter_metadata()
            }
            for _, channel, message in reader.iter_messages():
                counts.setdefault(channel.id, []).append(message.log_time)
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror}") from None
    except (McapError, struct.error, KeyError, ValueError, EOFError) as error:
        raise RunError(
            f"{path} is cut off or no MCAP file ({error}); `comwalk log` of the run's "
            "folder writes it anew from run.npz"
        ) from None
    if summary is None or not counts:
        raise RunError(f"{path} holds no messages")
    topics = tuple(
        TopicFacts(
            summary.channels[i].topic,
            summary.schemas[summary.channels[i].schema_id].name.replace("/msg/", "/"),
            len(times),
            times[0] / 1e9,
            times[-1] / 1e9,
            summary.channels[i].metadata["offered_qos_profiles"],
        )
        for i, times in sorted(counts.items())
    )
    return LogFacts(topics, notes.get("settings", {}), notes.get("outcome"))
