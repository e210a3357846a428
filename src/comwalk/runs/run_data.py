"""What a run leaves behind: summary and columns, from memory or from its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import mujoco
import numpy as np

from ..control import Outcome
from ..errors import RunError
from ..pattern import Pattern
from ..robot import Robot
from .columns import Log, load_columns
from .summary import summarize, versions


@dataclass(frozen=True, eq=False)
class RunData:
    """What a run leaves in memory, which is all that a view needs. Abstract."""

    outcome: Outcome
    """How, when and why it ended."""
    log: Log
    """One row per control period."""
    pattern: Pattern
    """What was to be walked."""
    seconds: float
    """Wall-clock time of the whole run [s]."""
    settings: dict[str, Any]
    """Everything that the run was made with, as plain numbers and names."""
    robot: Robot | None = None
    """The robot; None for the simplified model."""
    scene: mujoco.MjModel | None = None
    """The compiled model of the simulation; None for the simplified model."""
    substeps: int = 1
    """Physics steps per control period."""
    recording: Path | None = None
    """Log of ROS 2 messages that was written while it ran."""

    def summary(self) -> dict[str, Any]:
        """Return the figures of the run, with units in their names."""
        figures = summarize(
            self.log, self.pattern, self.outcome, self.seconds, self.robot
        )
        return {**figures, "versions": versions(), "settings": self.settings}


@dataclass(frozen=True, eq=False)
class Record:
    """A run to read about. Made by `record_of`."""

    name: str
    """What its reader calls it."""
    summary: Mapping[str, Any]
    """What `Run.summary` returns."""
    columns: Mapping[str, np.ndarray]
    """One row per control period."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """What the run was made with."""
        return self.summary["settings"]

    @property
    def walked(self) -> bool:
        """Whether there were steps; if not, it danced or stood."""
        return bool(self.summary["steps_planned"])

    @property
    def com_column(self) -> str:
        """Name of the column of the CoM: the true one if it is known."""
        return "com_true" if "com_true" in self.columns else "com"


def record_of(source: RunData | str | Path, name: str | None = None) -> Record:
    """Return what a run leaves behind.

    Args:
        source: A run, or its folder.
        name: What its reader calls it; the folder's name or the robot's if None.

    Returns:
        The record.

    Raises:
        RunError: If the folder is no readable run.
    """
    if isinstance(source, (str, Path)):
        folder = Path(source)
        summary = read_summary(folder)
        columns = read_columns(folder)
        return Record(name or folder.resolve().name, summary, columns)
    summary = source.summary()
    known = name or summary["settings"]["robot"] or "simplified model"
    return Record(known, summary, source.log.columns)


def read_summary(folder: str | Path) -> dict[str, Any]:
    """Return the summary of a saved run.

    Args:
        folder: Where `Run.save` wrote.

    Returns:
        What `Run.summary` returned.

    Raises:
        RunError: If it is missing, or not such a file.
    """
    try:
        text = Path(folder, "summary.json").read_text(encoding="utf-8")
        summary = json.loads(text)
        known = {"outcome", "time_s", "steps_planned", "com_error_rms_mm", "settings"}
        if not known <= set(summary) or not isinstance(summary["settings"], dict):
            raise KeyError
    except (OSError, ValueError, KeyError, TypeError):
        hint = ""
        if Path(folder, "run.mcap").is_file() or Path(folder, "run.npy").is_file():
            hint = "; if it was cut off, `comwalk log` tells what is left of it"
        raise RunError(
            f"{folder} is not a run: it has no readable summary.json{hint}"
        ) from None
    return summary


def read_columns(folder: str | Path) -> dict[str, np.ndarray]:
    """Return the columns of a saved run.

    Args:
        folder: Where `Run.save` wrote.

    Returns:
        Arrays by name.

    Raises:
        RunError: If run.npz is missing, or no archive of numbers.
    """
    path = Path(folder, "run.npz")
    if not path.is_file():
        raise RunError(f"{folder} is not a run: it has no run.npz")
    try:
        # A broken archive would leave open a file that numpy opened.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            return load_columns(file)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        raise RunError(f"{path} is broken: it is no archive of numbers") from None
