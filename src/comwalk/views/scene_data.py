"""The scene of a run for 3-D views, with meshes and soles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ..control import SimulatorSettings
from ..errors import ComwalkError, RunError
from ..pattern import FootstepPlan
from ..robot import Skeleton, load_robot
from ..runs import RunData, Source, data_of
from ..sides import Side
from ..walking import BEGIN, TERRAIN_BIT, build_scene

_SEEN = ("t", "phase", "com", "com_ref", "zmp_filtered", "zmp_ref", "wrenches")


def scene_of(data: RunData) -> mujoco.MjModel:
    """Return the scene of a run.

    Args:
        data: The run.

    Returns:
        The compiled model.

    Raises:
        RunError: If the run had no robot.
    """
    if data.model is None:
        raise RunError(
            f"{data.name} is not a run of a robot: the simplified model cannot be seen"
        )
    return data.model


def seen_of(source: Source | RunData, *, geometry: bool = False) -> RunData:
    """Return a run that can be shown in 3-D.

    Args:
        source: A run of a robot, or its folder.
        geometry: Whether the robot is loaded anew with its meshes, which a run leaves
            out; if it is not found any more, the run's own model is taken.

    Returns:
        Its data, with a model.

    Raises:
        RunError: If the run had no robot, or the folder is no readable run.
    """
    data = data_of(source, whole=False)
    model, columns = scene_of(data), data.columns
    missing = [name for name in _SEEN if name not in columns]
    if missing:
        raise RunError(f"the run lacks {', '.join(missing)}; walk it anew")
    if not len(columns["t"]) or not np.isfinite(columns["qpos"]).all():
        raise RunError("the run holds no configurations, or some that are no numbers")
    if not geometry:
        return data
    return replace(data, model=model_with_meshes(model, data.settings, data.plan))


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
    silent = (model.geom_contype | model.geom_conaffinity) == 0
    meshes = model.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)
    if (silent & meshes & of_robot(model)[model.geom_bodyid]).any():
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


def of_robot(model: mujoco.MjModel) -> np.ndarray:
    """Return which bodies are the robot's, and not what is around it.

    Args:
        model: A compiled scene.

    Returns:
        True or false, of shape (nbody,).
    """
    return np.isin(model.body_rootid, model.jnt_bodyid[:1])


def whole_state(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Return the configuration of a scene whose robot stands somewhere.

    Args:
        model: A compiled scene.
        qpos: The robot's configuration, or the whole, of shape (nq,).

    Returns:
        The whole, of shape (nq,): what is around the robot is where it begins.
    """
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, BEGIN)
    whole = np.array(model.qpos0 if key < 0 else model.key_qpos[key])
    whole[: len(qpos)] = qpos
    return whole


def highest_box(model: mujoco.MjModel) -> float:
    """Return the height of the highest box of a rough floor [m], 0 without one.

    Args:
        model: A compiled scene.

    Returns:
        The height above the floor.
    """
    box = (model.geom_bodyid == 0) & (model.geom_conaffinity == TERRAIN_BIT)
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
    foot = Skeleton(model, data, "").welded(int(model.site_bodyid[site]))
    geoms = np.flatnonzero(collides & np.isin(model.geom_bodyid, foot))
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
