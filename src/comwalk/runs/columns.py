"""Columns of a run: one row per control period."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from ..control import Tick
from ..errors import RunError

Columns = Mapping[str, np.ndarray]
"""Arrays by name."""


class Log:
    """Rows of a run, in arrays allocated beforehand. Final.

    The loop only hands a row over; many rows at a time become numbers in arrays, in
    whichever thread asks for them first. So nothing in a row may change later.
    """

    def __init__(
        self, capacity: int, extra: Callable[[], Mapping[str, Any]] | None = None
    ) -> None:
        """Prepare a log.

        Args:
            capacity: Largest number of rows.
            extra: Returns more columns of a row, such as a simulator's state.
        """
        self._capacity = capacity
        self._extra = extra or dict
        self._arrays: dict[str, np.ndarray] = {}
        self._rows = 0
        self._waiting: deque[tuple[Tick, Mapping[str, Any]]] = deque()
        self._lock = Lock()
        self.table = np.zeros(0)
        """The rows as records; see `take`."""
        self.file: Path | None = None
        """A .npy file that holds the rows while they grow; memory alone if None."""

    def take(self, kind: np.dtype, capacity: int) -> np.ndarray:
        """Allocate the rows: records whose fields are columns.

        With a `file`, they are mapped from it, so that they outlive a killed process.

        Args:
            kind: The record of a row.
            capacity: Largest number of rows.

        Returns:
            The records, to be written from the first on; `grow` tells how far.

        Raises:
            RunError: If the file cannot be written.
        """
        self.table = np.zeros(capacity, kind)
        if self.file is not None:
            self.table = _mapped(self.file, kind, capacity)
        self._arrays = {name: self.table[name] for name in kind.names or ()}
        return self.table

    def grow(self, rows: int) -> None:
        """Set the number of rows in the table.

        Args:
            rows: Number of rows written.
        """
        self._rows = rows

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._rows + len(self._waiting)

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column.

        Args:
            column: Its name.

        Returns:
            Values, of shape (rows, ...).

        Raises:
            RunError: If the run has no such column.
        """
        columns = self.columns
        if column not in columns:
            raise RunError(f'no column "{column}"; there are {", ".join(columns)}')
        return columns[column]

    def __contains__(self, column: str) -> bool:
        """Return whether the run has a column."""
        return column in self.columns

    def record(self, tick: Tick) -> None:
        """Append a row.

        Args:
            tick: One control period.
        """
        self._waiting.append((tick, self._extra()))
        if len(self._waiting) >= _MOST_WAITING:
            self._absorb()

    def _absorb(self) -> None:
        """Put the rows that wait into the arrays."""
        with self._lock:
            n = len(self._waiting)
            rows = [self._waiting.popleft() for _ in range(n)]
            if not rows:
                return
            ticks, extras = [tick for tick, _ in rows], [extra for _, extra in rows]
            values = {
                k: [value(tick) for tick in ticks] for k, value in _OF_TICK.items()
            }
            values |= {k: [extra[k] for extra in extras] for k in extras[0]}
            if not self._arrays:
                samples = {k: np.asarray(column[0]) for k, column in values.items()}
                kind = [(k, s.dtype, s.shape) for k, s in samples.items()]
                self.take(np.dtype(kind), self._capacity)
            for name, column in values.items():
                rows = self._arrays[name][self._rows : self._rows + n]
                if isinstance(column[0], np.ndarray):  # faster than an assignment
                    column = np.concatenate(column).reshape(rows.shape)
                rows[:] = column
            self._rows += n

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by name, up to the last row."""
        self._absorb()
        rows = self._rows
        return {name: array[:rows] for name, array in self._arrays.items()}


_MOST_WAITING = 256  # rows, which a crash can lose; another thread may take them before


def _mapped(file: Path, kind: np.dtype, capacity: int) -> np.ndarray:
    """Map rows of zeros from a new file, whose space is reserved: no late SIGBUS."""
    try:
        table = np.lib.format.open_memmap(file, "w+", kind, (capacity,))
        if hasattr(os, "posix_fallocate"):
            with file.open("r+b") as stream:
                os.posix_fallocate(stream.fileno(), 0, file.stat().st_size)
    except OSError as error:
        raise RunError(f"cannot write {file}: {error.strerror}") from None
    return np.asarray(table)


def rows_left(file: Path) -> dict[str, np.ndarray]:
    """Return the columns that a killed run left in the file of its `Log`.

    Args:
        file: The .npy file.

    Returns:
        Arrays by name; the last row, which may be torn, is dropped.

    Raises:
        RunError: If the file cannot be read, or holds no whole row.
    """
    try:
        table = np.load(file, mmap_mode="r", allow_pickle=False)
        written = np.flatnonzero(table["t"])
    except (OSError, ValueError, IndexError, EOFError):
        raise RunError(f"{file} is broken: it holds no rows of a run") from None
    if not len(written):
        raise RunError(f"{file} was cut off before its first row: nothing is left")
    return {name: table[name][: written[-1]] for name in table.dtype.names}


_OF_TICK: Mapping[str, Callable[[Tick], Any]] = {
    "t": lambda k: k.reference.time,
    "phase": lambda k: int(k.reference.phase),
    "step": lambda k: k.reference.step,
    "com": lambda k: k.measured.com,
    "com_ref": lambda k: k.reference.com,
    "zmp": lambda k: k.measured.zmp,
    "zmp_ref": lambda k: k.reference.zmp,
    "zmp_filtered": lambda k: k.control.zmp_filtered,
    "zmp_ref_filtered": lambda k: k.control.zmp_reference,
    "com_command": lambda k: k.control.com_command,
    "u": lambda k: k.control.u,
    "bounded": lambda k: k.control.saturated,
    "left_load": lambda k: k.reference.left_load,
    "feet_ref": lambda k: np.array(
        (k.reference.left.position, k.reference.right.position)
    ),
    "heading_ref": lambda k: k.reference.heading,
    "joints": lambda k: k.sensors.positions,
    "joint_rates": lambda k: k.sensors.velocities,
    "joint_set_points": lambda k: k.command.positions,
    "wrenches": lambda k: k.sensors.wrenches,
    "imu_quat": lambda k: k.sensors.orientation,
    "imu_gyro": lambda k: k.sensors.gyro,
    "imu_acc": lambda k: k.sensors.acceleration,
    "load": lambda k: k.measured.load,
    "tilt": lambda k: k.measured.tilt,
    "compute_s": lambda k: k.seconds,
}


_STATE = ("t", "qpos", "qvel", "act", "ctrl", "xfrc_applied")
_TWINS = {
    "joints": "qpos",
    "joint_rates": "qvel",
    "joint_set_points": "ctrl",
    "wrenches_true": "wrenches",
}
_IN = "_in_"


def save_columns(path: Path, columns: Columns) -> None:
    """Write the columns of a run as a compressed npz.

    What MuJoCo needs to replay the run is exact; other real numbers are float32. A
    column that only repeats columns of another, as encoders without noise repeat qpos,
    is stored as their indices, such as `joints_in_qpos`; `load_columns` restores it.

    Args:
        path: The file.
        columns: Arrays by name.

    Raises:
        RunError: If it cannot be written.
    """
    stored = {}
    for name, array in columns.items():
        source = _TWINS.get(name, "")
        places = _places(array, columns[source]) if source in columns else None
        if places is not None:
            stored[f"{name}{_IN}{source}"] = places
        elif name not in _STATE and array.dtype == np.float64 and array.ndim:
            stored[name] = array.astype(np.float32)
        else:
            stored[name] = array
    write_npz(path, stored)


def _places(column: np.ndarray, source: np.ndarray) -> np.ndarray | None:
    """Return the columns of a source that a column repeats; None if it does not."""
    rows, wanted = len(column), column.reshape(len(column), -1)
    known = {c.tobytes(): k for k, c in enumerate(source.reshape(rows, -1).T)}
    places = [known.get(c.tobytes(), -1) for c in wanted.T]
    return (
        None if -1 in places or not rows else np.array(places).reshape(column.shape[1:])
    )


def load_columns(file: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns that `save_columns` wrote.

    Args:
        file: What `numpy.load` returns.

    Returns:
        Arrays by name.
    """
    columns = {name: file[name] for name in file if _IN not in name}
    for name in file:
        twin, _, source = name.partition(_IN)
        if source:
            flat = columns[source].reshape(len(columns[source]), -1)
            columns[twin] = flat[:, file[name]]
    return columns


def write_npz(path: Path, arrays: Columns) -> None:
    """Write arrays as an npz, compressed as quickly as zlib can.

    Args:
        path: The file.
        arrays: Arrays by name.

    Raises:
        RunError: If it cannot be written.
    """
    try:
        with ZipFile(path, "w", ZIP_DEFLATED, compresslevel=1) as archive:
            for name, array in arrays.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, np.asarray(array, order="C"))
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file; on a full disk nothing is left of it.

    Args:
        path: The file.
        content: Text, or bytes as they are.

    Raises:
        RunError: If it cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        path.write_bytes(data)
    except OSError as error:
        with contextlib.suppress(OSError):
            path.unlink()
        raise RunError(f"cannot write {path}: {error.strerror}") from None
