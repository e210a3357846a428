"""The record of a run: one row per control period, and what it amounts to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock
from typing import Any

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
        """Rows that someone else writes, as records; see `take`."""

    def take(self, kind: np.dtype, capacity: int) -> np.ndarray:
        """Let someone else write the rows: return records whose fields are columns.

        Args:
            kind: The record of a row.
            capacity: Largest number of rows.

        Returns:
            The records, to be written from the first on; `grow` tells how far.
        """
        self.table = np.zeros(capacity, kind)
        self._arrays = {name: self.table[name] for name in kind.names or ()}
        return self.table

    def grow(self, rows: int) -> None:
        """Tell how many rows there are in the table.

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
            for name, value in _OF_TICK.items():
                self._put(name, [value(tick) for tick in ticks])
            for name in extras[0]:
                self._put(name, [extra[name] for extra in extras])
            self._rows += n

    def _put(self, name: str, values: list[Any]) -> None:
        """Append values to a column; allocate it after the first value's shape."""
        if name not in self._arrays:
            sample = np.asarray(values[0])
            self._arrays[name] = np.zeros((self._capacity, *sample.shape), sample.dtype)
        rows = self._arrays[name][self._rows : self._rows + len(values)]
        if isinstance(values[0], np.ndarray):  # many times faster than an assignment
            np.concatenate(values, out=rows.reshape(-1, *rows.shape[2:]))
        else:
            rows[:] = values

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by name, up to the last row."""
        self._absorb()
        rows = self._rows
        return {name: array[:rows] for name, array in self._arrays.items()}


_MOST_WAITING = 1024  # rows; another thread may take them before

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


def save_columns(path: Path, columns: Columns) -> None:
    """Write columns as a compressed npz.

    Args:
        path: The file.
        columns: Arrays by name.

    Raises:
        RunError: If it cannot be written.
    """
    try:
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **columns)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None
