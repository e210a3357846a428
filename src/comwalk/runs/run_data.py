"""Run data: summary, columns, model and plan, from memory or from a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from zipfile import BadZipFile

import mujoco
import numpy as np

from ..errors import ComwalkError, RunError, utf8
from ..pattern import Foothold, Footstep, FootstepPlan, Phase
from ..sides import Side
from .columns import load_columns


class Moment(NamedTuple):
    """The visible state at one time, world."""

    time: float
    """Time [s]."""
    qpos: np.ndarray
    """MuJoCo's configuration, of shape (nq,)."""
    com: np.ndarray
    """CoM [m], of shape (3,)."""
    com_ref: np.ndarray
    """Its reference [m], of shape (3,)."""
    zmp: np.ndarray
    """ZMP [m], of shape (2,)."""
    zmp_ref: np.ndarray
    """Its reference [m], of shape (2,)."""
    phase: Phase
    """What the legs are to do."""
    wrenches: np.ndarray
    """What the ankle sensors feel, in their own frames [N, N m], of shape (2, 6)."""


@dataclass(frozen=True, eq=False)
class RunData:
    """A run to look at. Made by `load_run` of a folder, or by a `Run` itself."""

    name: str
    """What its reader calls it."""
    summary: Mapping[str, Any]
    """What `Run.summary` returns."""
    columns: Mapping[str, np.ndarray]
    """One row per control period."""
    model: mujoco.MjModel | None
    """The compiled scene; None for the simplified model."""
    plan: FootstepPlan | None
    """The footsteps, as far as they are known."""

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings of the run."""
        return self.summary["settings"]

    @property
    def ok(self) -> bool:
        """Whether the plan was walked to its end."""
        return self.summary["outcome"] == "completed"

    @property
    def walked(self) -> bool:
        """Whether there were steps; if not, it danced or stood."""
        return bool(self.summary["steps_planned"])

    @property
    def t(self) -> np.ndarray:
        """Times [s], of shape (rows,)."""
        return self.columns["t"]

    @property
    def com(self) -> np.ndarray:
        """CoM [m], the true one if it is known, of shape (rows, 2) or (rows, 3)."""
        return self.columns["com_true" if "com_true" in self.columns else "com"]

    @cached_property
    def center(self) -> np.ndarray:
        """The robot's path without its sway [m], of shape (rows, 2)."""
        return smoothed(self.columns["qpos"][:, :2], self.t)

    def row(self, time: float) -> int:
        """Return the row of a time.

        Args:
            time: When [s].

        Returns:
            The first row not before it; the last one after the end.
        """
        return min(int(np.searchsorted(self.t, time)), len(self.t) - 1)

    def rows(self, fps: float) -> np.ndarray:
        """Return the rows of pictures at equal times.

        Args:
            fps: Pictures per second.

        Returns:
            Rows, of shape (k,), from the first to about the last.
        """
        start, stop = float(self.t[0]), float(self.t[-1])
        times = start + np.arange(int((stop - start) * fps) + 1) / fps
        return np.minimum(np.searchsorted(self.t, times - 1e-9), len(self.t) - 1)

    def moment(self, row: int) -> Moment:
        """Return the visible state of a row.

        Args:
            row: Which.

        Returns:
            The moment.
        """
        c = self.columns
        return Moment(
            float(c["t"][row]),
            c["qpos"][row],
            self.com[row],
            c["com_ref"][row],
            c["zmp_filtered"][row],
            c["zmp_ref"][row],
            Phase(int(c["phase"][row])),
            c["wrenches"][row],
        )


class Run(Protocol):
    """A run in memory."""

    @property
    def data(self) -> RunData:
        """The run as views take it."""
        ...


Source = Run | str | Path
"""A run, or its folder."""


def data_of(
    source: Source | RunData, name: str | None = None, *, whole: bool = True
) -> RunData:
    """Return the data of a run.

    Args:
        source: The run, or its folder.
        name: What its reader calls it; the folder's name or the robot's if None.
        whole: Whether a folder needs a summary, as in `load_run`.

    Returns:
        The data.

    Raises:
        RunError: If the folder is no readable run.
    """
    if isinstance(source, RunData):
        data = source
    else:
        is_folder = isinstance(source, (str, Path))
        data = load_run(source, whole=whole) if is_folder else source.data
    return data if name is None else replace(data, name=name)


def load_run(folder: str | Path, *, whole: bool = True) -> RunData:
    """Load a saved run.

    Args:
        folder: A folder that `Run.save` wrote.
        whole: Whether it needs a summary; its motion can be seen without.

    Returns:
        The data.

    Raises:
        RunError: If a file is missing or broken, or they do not go together.
    """
    path = Path(folder)
    columns: Mapping[str, np.ndarray] = {} if whole else read_columns(path)
    try:
        summary = read_summary(path)
    except RunError:
        if whole:
            raise
        summary = {"settings": {}}
    columns = columns or read_columns(path)
    plan = _plan_of(summary["settings"].get("plan"))
    model = _model_in(path, columns)
    return RunData(utf8(path.resolve().name), summary, columns, model, plan)


def _model_in(folder: Path, columns: Mapping[str, np.ndarray]) -> mujoco.MjModel | None:
    """Return the scene of a saved run, checked against its columns."""
    path = folder / "scene.mjb"
    if not path.is_file():
        return None
    try:
        held = {path.name: path.read_bytes()}  # MuJoCo opens only UTF-8 names
        model = mujoco.MjModel.from_binary_path(path.name, held)
    except (OSError, ValueError, mujoco.FatalError):
        raise RunError(
            f"{path} is broken: it is no model of this version of MuJoCo"
        ) from None
    widths = {"qpos": model.nq, "qvel": model.nv, "ctrl": model.nu}
    missing = {*widths, "substeps"} - set(columns)
    if missing:
        raise RunError(f"{folder}/run.npz lacks {', '.join(sorted(missing))}")
    rows = len(columns["qpos"])
    for name, width in widths.items():
        if columns[name].shape != (rows, width):
            raise RunError(
                f"{folder}/run.npz does not fit scene.mjb: {name} has the shape "
                f"{columns[name].shape}, and the model asks for {(rows, width)}"
            )
    return model


def _plan_of(table: Any) -> FootstepPlan | None:
    """Return the plan that a summary holds; None if it holds none."""
    try:
        parts: dict[str, Any] = dict(table)
        feet = [Foothold(**parts.pop(side)) for side in ("left", "right")]
        parts["steps"] = tuple(_step_of(dict(step)) for step in parts["steps"])
        parts["sole_size"] = tuple(parts["sole_size"])
        return FootstepPlan(left=feet[0], right=feet[1], **parts)
    except (KeyError, TypeError, ValueError, ComwalkError):
        return None


def _step_of(table: dict[str, Any]) -> Footstep:
    return Footstep(side=Side(table.pop("side")), **table)


def smoothed(path: np.ndarray, t: np.ndarray, window: float = 2.0) -> np.ndarray:
    """Return a path without its sway: the mean over a window of time.

    Args:
        path: Points [m], of shape (n, 2).
        t: Equidistant times [s], of shape (n,).
        window: Its length [s].

    Returns:
        Points [m], of shape (n, 2).
    """
    if len(t) < 3:
        return path
    half = max(1, round(0.5 * window / float(t[1] - t[0])))
    padded = np.pad(path, ((half + 1, half), (0, 0)), mode="edge")
    sums = np.cumsum(padded, axis=0)
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


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
