"""What there is to see of a run, row by row, from memory or from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ..control import SimulatorSettings
from ..errors import ComwalkError, RunError
from ..pattern import Foothold, Footstep, FootstepPlan, Phase
from ..robot import load_robot
from ..runs import RunData, read_columns, read_summary
from ..sides import Side
from ..walking import build_scene


class Moment(NamedTuple):
    """What there is to see at one time; all in world axes."""

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
class Recording:
    """A run as it can be looked at. Made by `recording_of`."""

    model: mujoco.MjModel
    """The compiled scene."""
    columns: Mapping[str, np.ndarray]
    """The record, one row per control period."""
    settings: Mapping[str, Any]
    """What the run was made with, as in its summary."""
    plan: FootstepPlan | None
    """The footsteps, as far as they are known."""

    @property
    def t(self) -> np.ndarray:
        """Times [s], of shape (rows,)."""
        return self.columns["t"]

    @property
    def com(self) -> np.ndarray:
        """CoM [m], the true one if it is known, of shape (rows, 3)."""
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
        """Return what there is to see in a row.

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


_SEEN = ("t", "phase", "com", "com_ref", "zmp_filtered", "zmp_ref", "wrenches")


def recording_of(source: RunData | str | Path, *, geometry: bool = False) -> Recording:
    """Return what there is to see of a run.

    Args:
        source: A run of a robot, or its folder.
        geometry: Whether the robot is loaded anew with its meshes, which a run leaves
            out; if it is not found any more, the run's own model is taken.

    Returns:
        The recording.

    Raises:
        RunError: If the run had no robot, or the folder is no readable run.
    """
    if isinstance(source, (str, Path)):
        model, columns = load_recording(source)
        settings = _settings_in(Path(source))
        plan = _plan_of(settings.get("plan"))
    elif source.scene is None:
        raise RunError("the simplified model cannot be seen; run it with a robot")
    else:
        model, columns = source.scene, source.log.columns
        settings, plan = source.settings, source.pattern.plan
    missing = [name for name in _SEEN if name not in columns]
    if missing:
        raise RunError(f"the run lacks {', '.join(missing)}; walk it anew")
    if not len(columns["t"]) or not np.isfinite(columns["qpos"]).all():
        raise RunError("the run holds no configurations, or some that are no numbers")
    if geometry:
        model = model_with_meshes(model, settings, plan)
    return Recording(model, columns, settings, plan)


def load_recording(folder: str | Path) -> tuple[mujoco.MjModel, dict[str, np.ndarray]]:
    """Load the model and the columns of a saved run.

    Args:
        folder: A folder that `Run.save` wrote.

    Returns:
        The compiled model, and run.npz as arrays by name.

    Raises:
        RunError: If a file is missing or broken, or the run had no robot.
    """
    path = Path(folder)
    columns = read_columns(path)
    if not (path / "scene.mjb").is_file():
        raise RunError(f"{path} is not a run of a robot: it has no scene.mjb")
    try:
        model = mujoco.MjModel.from_binary_path(str(path / "scene.mjb"))
    except (OSError, ValueError, mujoco.FatalError):
        raise RunError(
            f"{path}/scene.mjb is broken: it is no model of this version of MuJoCo"
        ) from None
    widths = {"qpos": model.nq, "qvel": model.nv, "ctrl": model.nu}
    missing = {*widths, "substeps"} - set(columns)
    if missing:
        raise RunError(f"{path}/run.npz lacks {', '.join(sorted(missing))}")
    rows = len(columns["qpos"])
    for name, width in widths.items():
        if columns[name].shape != (rows, width):
            raise RunError(
                f"{path}/run.npz does not fit scene.mjb: {name} has the shape "
                f"{columns[name].shape}, and the model asks for {(rows, width)}"
            )
    return model, columns


def _settings_in(folder: Path) -> dict[str, Any]:
    try:
        return read_summary(folder)["settings"]
    except RunError:
        return {}


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


def model_with_meshes(
    model: mujoco.MjModel, settings: Mapping[str, Any], plan: FootstepPlan | None
) -> mujoco.MjModel:
    """Return a scene with the meshes of its robot, which is loaded anew.

    Args:
        model: The scene as it is simulated.
        settings: What a run is made with: its config, robot and physics.
        plan: Its footsteps.

    Returns:
        The scene with meshes; the model itself if the robot is not found any more.
    """
    if model.nmesh:
        return model
    config = settings.get("config") or {}
    try:
        robot = load_robot(
            config.get("robot") or settings["robot"],
            profile=config.get("profile"),
            geometry=True,
        )
        physics: dict[str, Any] = {**settings["physics"], "pushes": ()}
        scene = build_scene(robot, SimulatorSettings(**physics), plan)
    except (KeyError, TypeError, ComwalkError):
        return model
    same = scene.nq == model.nq and scene.nbody == model.nbody
    if same and np.allclose(scene.body_mass, model.body_mass, rtol=1e-3):
        return scene
    return model


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


def highest_box(model: mujoco.MjModel) -> float:
    """Return the height of the highest box of a rough floor [m], 0 without one.

    Args:
        model: A compiled scene.

    Returns:
        The height above the floor.
    """
    box = (model.geom_bodyid == 0) & (model.geom_type == int(mujoco.mjtGeom.mjGEOM_BOX))
    tops = model.geom_pos[box, 2] + model.geom_size[box, 2]
    return float(tops.max(initial=0.0))


class SoleBox(NamedTuple):
    """The box around what a foot touches the ground with."""

    corners: np.ndarray
    """Its outline [m], world, counter-clockwise, of shape (4, 2)."""
    center: np.ndarray
    """Its centre [m], world, of shape (3,)."""
    rotation: np.ndarray
    """Its axes, box to world, of shape (3, 3)."""
    size: np.ndarray
    """Its half lengths [m], of shape (3,)."""


def sole_box(model: mujoco.MjModel, data: mujoco.MjData, side: Side) -> SoleBox | None:
    """Return the box around a foot's contacts.

    Args:
        model: A compiled scene.
        data: Its state, after kinematics.
        side: Which foot.

    Returns:
        The box along the sole's axes; None if the model has no sole.
    """
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{side.value[0]}_sole")
    if site < 0:
        return None
    collides = (model.geom_contype | model.geom_conaffinity) > 0
    geoms = np.flatnonzero(collides & (model.geom_bodyid == model.site_bodyid[site]))
    R, origin = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
    points = np.vstack([_corners(model, data, geom) for geom in geoms]) - origin
    low, high = (points @ R).min(axis=0), (points @ R).max(axis=0)
    center, size = origin + R @ (0.5 * (low + high)), 0.5 * (high - low)
    local = size[:2] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return SoleBox(center[:2] + local @ R[:2, :2].T, center, R.copy(), size)


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Return the corners of the box around a geom [m], world, of shape (8, 3)."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    middle, size = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    R = data.geom_xmat[geom].reshape(3, 3)
    return data.geom_xpos[geom] + (middle + signs * size) @ R.T
