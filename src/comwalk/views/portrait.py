"""A picture of a robot as comwalk understands it: soles, frames, CoM, posture."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from ..control import SimulatorSettings
from ..robot import Kinematics, Robot
from ..robot.loaders import rotation_of
from ..sides import Side
from ..walking import build_scene
from .render import View, still

VIEW = View(
    width=720,
    height=900,
    azimuth=math.radians(35.0),
    elevation=math.radians(8.0),
    distance=1.5,
    shadows=True,
    smooth=2,
    overlays=False,
)
"""From where the picture is taken."""

_SOLES = {Side.LEFT: (0.0, 0.45, 0.7, 1.0), Side.RIGHT: (0.84, 0.37, 0.0, 1.0)}
_AXES = ((0.85, 0.1, 0.1, 1.0), (0.1, 0.6, 0.1, 1.0), (0.1, 0.2, 0.9, 1.0))
_COM = (0.95, 0.75, 0.05, 1.0)
_SEEN = 0.55  # opacity of the robot, so that frames show through
_FRAMES = ("imu", "torso", "gaze", "l_gripper", "r_gripper", "l_ankle_ft", "r_ankle_ft")
_VISIBLE_GROUPS = 3  # MuJoCo shows geoms of the groups below


def draw_portrait(
    robot: Robot, path: str | Path | None, view: View | None = None
) -> np.ndarray:
    """Draw a robot in its walking posture.

    Args:
        robot: The robot, loaded with `geometry=True` for its meshes.
        path: Where to write the picture; not written if None.
        view: From where; `VIEW` if None.

    Returns:
        The picture, of shape (height, width, 3), uint8.

    Raises:
        RenderError: If this machine cannot draw.
        RunError: If the file cannot be written.
    """
    spec = robot.spec.copy()
    _show(spec)
    kinematics = Kinematics(robot)
    com = kinematics.posture(robot.home).com
    size = float(com[2])
    for side in Side:
        _draw_sole(spec, robot, side, size)
    names = {site.name for site in spec.sites}
    for name in _FRAMES:
        if name in names:
            _draw_axes(spec, name, 0.12 * size)
    _draw_com(spec, robot, com, size)
    scene = build_scene(replace(robot, spec=spec), SimulatorSettings(scene=False))
    return still(scene, robot.home, path, view=view or VIEW)


def _show(spec: mujoco.MjSpec) -> None:
    """Make the robot translucent; if it has no visuals, show what it touches with."""
    seen = [geom for geom in spec.geoms if geom.group < _VISIBLE_GROUPS]
    for geom in seen or list(spec.geoms):
        geom.group = 1
        geom.rgba = np.array([*geom.rgba[:3], _SEEN * geom.rgba[3]])
    for material in spec.materials:
        material.rgba = np.array([*material.rgba[:3], _SEEN * material.rgba[3]])


def _draw_sole(spec: mujoco.MjSpec, robot: Robot, side: Side, size: float) -> None:
    """Draw the outline of a sole."""
    site = spec.site(f"{side.value[0]}_sole_centre")
    corners = robot.feet[side].sole
    compiled = robot.model.site(robot.feet[side].site)
    R = rotation_of(compiled.quat)
    points = compiled.pos + np.pad(corners, ((0, 0), (0, 1))) @ R.T
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        _add_rod(site.parent, a, b, 0.006 * size, _SOLES[side])


def _draw_axes(spec: mujoco.MjSpec, name: str, length: float) -> None:
    """Draw the axes of a site: red x, green y, blue z."""
    site = spec.site(name)
    R = rotation_of(np.asarray(site.quat, float))
    start = np.asarray(site.pos, float)
    for axis, color in zip(R.T, _AXES, strict=True):
        _add_rod(site.parent, start, start + length * axis, 0.05 * length, color)


def _draw_com(spec: mujoco.MjSpec, robot: Robot, com: np.ndarray, size: float) -> None:
    """Draw the CoM, and the line from there to the ground."""
    base = spec.worldbody.first_body()
    R = rotation_of(robot.home[3:7])
    local, ground = (
        R.T @ (point - robot.home[:3]) for point in (com, com * [1.0, 1.0, 0.0])
    )
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[0.03 * size, 0.0, 0.0],
        pos=local.tolist(),
        rgba=list(_COM),
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
    _add_rod(base, local, ground, 0.004 * size, _COM)


def _add_rod(
    body: mujoco.MjsBody,
    start: np.ndarray,
    end: np.ndarray,
    radius: float,
    color: tuple[float, ...],
) -> None:
    """Add a rod between two points of a body."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*start.tolist(), *end.tolist()],
        size=[radius, 0.0, 0.0],
        rgba=list(color),
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
