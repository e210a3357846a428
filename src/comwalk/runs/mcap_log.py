"""The log of a run as `run.mcap`: written while it runs, off the control thread.

The loop hands rows to a `Log` and knows nothing of files. A thread looks now and then
how many rows there are, makes messages of half a second of them at once, and writes a
chunk; what a crash can lose is what is not in a chunk yet. The same code writes a log
after the run, and gives the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np

from ..errors import RunError
from ..robot import Robot
from .columns import Log
from .mcap_file import MESSAGE, McapWriter, Topic
from .topics import Columns, Latched, Stream, latched_of, streams_of

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None

MCAP_NAME = "run.mcap"
"""Name of the log in the folder of a run."""
CHUNK_TIME = 0.5
"""Time in a chunk [s]: as much as a crash can lose."""
SLOW_TIME = 0.02
"""Time between messages of slow topics [s]."""

_LOOK_TIME = 0.05  # between two looks at how many rows there are [s]


class McapLog:
    """Writes rows of a run as messages. Final."""

    def __init__(
        self, file: BinaryIO, robot: Robot | None, period: float, notes: Any
    ) -> None:
        """Begin a log.

        Args:
            file: Open for writing, at its start.
            robot: The robot; None for the simplified model.
            period: Control period [s].
            notes: What the run is made with, ready for JSON.
        """
        self._writer, self._robot = McapWriter(file), robot
        self._every = max(1, round(SLOW_TIME / period))
        self._rows = self._every * max(1, round(CHUNK_TIME / period / self._every))
        self._written, self._packer = 0, None
        self.say("settings", notes)

    def say(self, name: str, notes: Any) -> None:
        """Write something that is said once.

        Args:
            name: What it is.
            notes: Ready for JSON.
        """
        self._writer.add_notes(name, {"json": json.dumps(notes, sort_keys=True)})

    def write(self, log: Log, *, to_the_end: bool = False) -> None:
        """Write the rows that are new, as far as they fill chunks.

        Args:
            log: The record.
            to_the_end: Whether the last chunk may be shorter.
        """
        least = 1 if to_the_end else self._rows
        if len(log) - self._written < least:
            return
        columns = log.columns
        count = len(columns["t"])
        if self._packer is None:
            self._packer = self._start(columns)
        while count - self._written >= least:
            end = min(self._written + self._rows, count)
            part = {name: array[self._written : end] for name, array in columns.items()}
            self._writer.add_chunk(*self._packer.chunk(part, self._written))
            self._written = end

    def finish(self, outcome: str | None) -> None:
        """Finish the file.

        Args:
            outcome: How the run ended; None if an error ended it.
        """
        if outcome is not None:
            self.say("outcome", outcome)
        self._writer.finish()

    def _start(self, columns: Columns) -> _Packer:
        """Write what comes before the first row, once its columns are known."""
        latched = latched_of(self._robot)
        streams = streams_of(self._robot, columns.keys())
        topics = [Topic(x.topic, x.kind, latched=True) for x in latched]
        topics += [Topic(x.topic, x.layout.kind) for x in streams]
        self._writer.add_topics(topics)
        if latched:
            self._writer.add_chunk(*_said_once(latched, _nanoseconds(columns["t"])[0]))
        return _Packer(streams, 1 + len(latched), self._every)


def _nanoseconds(times: np.ndarray) -> np.ndarray:
    return np.rint(times * 1e9).astype(np.int64)


def _said_once(
    latched: Sequence[Latched], time: int
) -> tuple[bytes, dict[int, np.ndarray]]:
    """Return the chunk of messages that are said once, and its index."""
    data, index = b"", {}
    for channel, one in enumerate(latched, start=1):
        index[channel] = np.array([[time, len(data)]], np.int64)
        head = _head(channel, len(one.message))
        head["log_time"] = head["publish_time"] = time
        data += head.tobytes() + one.message
    return data, index


def _head(channel: int, length: int) -> np.ndarray:
    head: Any = np.zeros((), MESSAGE)
    head["opcode"], head["channel"] = 5, channel
    head["length"] = MESSAGE.itemsize - 9 + length
    return head


class _Packer:
    """Makes chunks of rows: `every` rows, with one of the slow topics, are a group.

    A group is one record of a structured array, so that a chunk takes a few assignments
    and is in order of time. Final.
    """

    def __init__(self, streams: Sequence[Stream], first: int, every: int) -> None:
        self._channels = {s.topic: k for k, s in enumerate(streams, start=first)}
        self._slow = [s for s in streams if s.slow]
        self._fast = [s for s in streams if not s.slow]
        self._every = every
        self._offsets = {**_offsets(self._slow), **_offsets(self._fast)}
        self._slow_record, self._fast_record = _record(self._slow), _record(self._fast)
        group = [("slow", self._slow_record), ("fast", self._fast_record, (every,))]
        self._group = np.dtype(group)
        # Bytes, since numpy copies fields and not what is between them.
        blank = bytearray(self._group.itemsize)
        for stream, _, messages in self._parts(np.frombuffer(blank, self._group)):
            length = len(stream.layout.template)
            messages["head"] = _head(self._channels[stream.topic], length)
            bodies = messages["body"].view(np.dtype((np.void, length)))
            bodies[...] = np.void(stream.layout.template)
        self._blank = bytes(blank)

    def _parts(self, groups: np.ndarray) -> list[tuple[Stream, bool, np.ndarray]]:
        parts = [(s, True, groups["slow"][s.topic]) for s in self._slow]
        return parts + [(s, False, groups["fast"][s.topic]) for s in self._fast]

    def chunk(self, rows: Columns, first: int) -> tuple[bytes, dict[int, np.ndarray]]:
        """Return the messages of some rows, and when and where they are.

        Args:
            rows: Columns, a multiple of `every` rows long, or less at the end.
            first: Number of the first row.

        Returns:
            A chunk and its index.
        """
        k, n = self._every, len(rows["t"])
        count = -(-n // k)
        places = np.minimum(np.arange(count * k), n - 1)
        full = {name: array[places] for name, array in rows.items()}
        thin = {name: array[::k] for name, array in rows.items()}
        buffer, index = bytearray(self._blank * count), {}
        for stream, slow, messages in self._parts(np.frombuffer(buffer, self._group)):
            part, number = (thin, first // k) if slow else (full, first)
            times = _nanoseconds(part["t"]).reshape(messages.shape)
            _stamp(messages, times, number)
            for field, values in stream.values(part).items():
                body = messages["body"][field]
                body[...] = values.reshape(body.shape)
            many = count if slow else n
            pairs = np.stack([times.ravel(), self._places(stream, count)], axis=1)
            index[self._channels[stream.topic]] = pairs[:many]
        unused = (count * k - n) * self._fast_record.itemsize
        return bytes(buffer[: len(buffer) - unused]), index

    def _places(self, stream: Stream, count: int) -> np.ndarray:
        """Return where the messages of a topic are in groups."""
        starts = np.arange(count) * self._group.itemsize
        record = self._slow_record if stream.slow else self._fast_record
        starts += self._offsets[stream.topic]
        if stream.slow:
            return starts
        inside = np.arange(self._every) * record.itemsize + self._slow_record.itemsize
        return (starts[:, None] + inside).ravel()


def _record(streams: Sequence[Stream]) -> np.dtype:
    kinds = [np.dtype([("head", MESSAGE), ("body", s.layout.dtype)]) for s in streams]
    return np.dtype([(s.topic, k) for s, k in zip(streams, kinds, strict=True)])


def _offsets(streams: Sequence[Stream]) -> dict[str, int]:
    sizes = [MESSAGE.itemsize + len(s.layout.template) for s in streams]
    return {s.topic: sum(sizes[:i]) for i, s in enumerate(streams)}


def _stamp(messages: np.ndarray, times: np.ndarray, first: int) -> None:
    """Set times and numbers of messages."""
    head, body = messages["head"], messages["body"]
    head["log_time"] = head["publish_time"] = times
    head["sequence"] = first + np.arange(times.size).reshape(times.shape)
    seconds, rest = np.divmod(times, 1_000_000_000)
    for name in body.dtype.names or ():
        if name.endswith("stamp.sec"):
            body[name] = seconds
        elif name.endswith("stamp.nanosec"):
            body[name] = rest


# ---- While running, and after -----------------------------------------------------


class Recorder:
    """Writes a log while it grows, in a thread of its own. Final.

    Used as a context: the file is finished when it is left, whatever happened.
    """

    def __init__(
        self,
        path: str | Path | None,
        log: Log,
        robot: Robot | None,
        period: float,
        notes: dict[str, Any],
    ) -> None:
        """Open the file.

        Args:
            path: The file, written anew: .npy for the rows alone, which costs the walk
                nothing, else MCAP. Nothing is written if None.
            log: The record, which the run fills.
            robot: The robot; None for the simplified model.
            period: Control period [s].
            notes: What the run is made with, ready for JSON.

        Raises:
            RunError: If the file cannot be written.
        """
        self.outcome: str | None = None
        self.path = None if path is None else Path(path)
        self.log, self.notes, self._over = log, notes, Event()
        self._fault: Exception | None = None
        self._thread: Thread | None = None
        if self.path is not None and self.path.suffix == ".npy":
            self._file = _open(self.path)  # locked; the log maps the same file
            log.file = self.path
            _write_settings(self.path, notes)
        elif self.path is not None:
            self._file = _open(self.path)
            self._mcap = McapLog(self._file, robot, period, notes)
            self._thread = Thread(target=self._follow, name="comwalk log", daemon=True)

    def __enter__(self) -> Recorder:
        """Start to write."""
        if self._thread is not None:
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the rest and close the file.

        Raises:
            RunError: If not all could be written.
        """
        if self._thread is None:
            if self.path is not None:
                _ = self.log.columns  # puts the rows that wait into the file
                self._file.close()
            return
        self._over.set()
        self._thread.join()
        self._file.close()
        if isinstance(self._fault, OSError) and error is None:
            raise RunError(f"cannot write {self.path}: {self._fault.strerror}")
        if self._fault is not None and error is None:
            raise self._fault

    def _follow(self) -> None:
        """Write what is new, until the run is over."""
        try:
            while not self._over.wait(_LOOK_TIME):
                self._mcap.write(self.log)
            self._mcap.write(self.log, to_the_end=True)
            self._mcap.finish(self.outcome)
        except Exception as error:  # such as a full disk: the robot walks on
            self._fault = error


def save_mcap(
    path: Path,
    log: Log,
    robot: Robot | None,
    period: float,
    notes: dict[str, Any],
    outcome: str | None,
) -> None:
    """Write the log of a run that is over.

    Args:
        path: The file, written anew.
        log: The record.
        robot: The robot; None for the simplified model.
        period: Control period [s].
        notes: What the run is made with, ready for JSON.
        outcome: How it ended; None if it was killed.

    Raises:
        RunError: If it cannot be written.
    """
    with Recorder(path, log, robot, period, notes) as recorder:
        recorder.outcome = outcome


def _write_settings(path: Path, notes: dict[str, Any]) -> None:
    """Write what a run is made with beside its rows, for the case of a crash."""
    try:
        text = json.dumps(notes, allow_nan=False)
        path.with_suffix(".json").write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None


def _open(path: Path) -> BinaryIO:
    """Open a file to write it anew; as long as it is open, `is_open` says so."""
    try:
        file = path.open("ab")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None
    if not _lock(file):
        file.close()
        raise RunError(
            f"{path} is being written by another run; choose another by --out"
        )
    file.truncate(0)
    return file


def is_open(path: Path) -> bool:
    """Return whether a run is writing a log now.

    Args:
        path: The file.

    Returns:
        Whether it is; never where the system has no such locks.

    Raises:
        RunError: If the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return not _lock(file)
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror}") from None


def _lock(file: BinaryIO) -> bool:
    """Lock a file until it is closed; return whether no other process has done so."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True
