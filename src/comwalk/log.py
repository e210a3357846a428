"""The record of a run: one row per control period, and what it amounts to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .errors import RunError
from .walk import Tick

Columns = Mapping[str, np.ndarray]
"""Arrays by name."""


class Log:
    """Rows of a run, in arrays allocated beforehand. Final."""

    def __init__(
        self, capacity: int, extra: Callable[[], Mapping[str, Any]] | None = None
    ) -> None:
        """Prepare a log.

        Args:
            capacity: Largest number of rows.
            extra: Returns more columns of a row, such as a simulator's state.
        """
        self._capacity = capacity
        self._extra = extra
        self._arrays: dict[str, np.ndarray] = {}
        self._rows = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._rows

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column.

        Args:
            column: Its name.

        Returns:
            Values, of shape (rows, ...).

        Raises:
            RunError: If the run has no such column.
        """
        if column not in self._arrays:
            raise RunError(f'no column "{column}"; there are {", ".join(self._arrays)}')
        return self._arrays[column][: self._rows]

    def __contains__(self, column: str) -> bool:
        """Return whether the run has a column."""
        return column in self._arrays

    def record(self, tick: Tick) -> None:
        """Append a row.

        Args:
            tick: One control period.
        """
        reference, sensors, measured, control, command, seconds = tick
        row = {
            "t": reference.time,
            "phase": int(reference.phase),
            "step": reference.step,
            "com": measured.com,
            "com_ref": reference.com,
            "zmp": measured.zmp,
            "zmp_ref": reference.zmp,
            "zmp_filtered": control.zmp_filtered,
            "zmp_ref_filtered": control.zmp_reference,
            "com_command": control.com_command,
            "u": control.u,
            "bounded": control.saturated,
            "left_load": reference.left_load,
            "feet_ref": (reference.left.position, reference.right.position),
            "heading_ref": reference.heading,
            "joints": sensors.positions,
            "joint_set_points": command.positions,
            "wrenches": sensors.wrenches,
            "load": measured.load,
            "tilt": measured.tilt,
            "compute_s": seconds,
        }
        if self._extra is not None:
            row.update(self._extra())
        if not self._arrays:
            self._allocate(row)
        k = self._rows
        for name, value in row.items():
            self._arrays[name][k] = value
        self._rows += 1

    def _allocate(self, row: Mapping[str, object]) -> None:
        """Allocate the columns after the first row's shapes."""
        for name, value in row.items():
            sample = np.asarray(value)
            self._arrays[name] = np.zeros((self._capacity, *sample.shape), sample.dtype)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All columns by name."""
        return {name: array[: self._rows] for name, array in self._arrays.items()}


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
