"""Contents of a robot's model file, before its anatomy is known."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError

DEEPEST = 200
"""Most bodies, or elements of a file, inside each other; robots have a tenth."""


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: q_joint = ratio q_primary + offset."""

    joint: str
    """Name of the joint that follows."""
    primary: str
    """Name of the joint that leads; it follows none itself."""
    ratio: float
    """Factor on the angle of the primary joint."""
    offset: float
    """Angle [rad] at zero of the primary joint."""


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """A mesh file of a body, with its pose and scale."""

    body: str
    """Name of the body."""
    file: Path
    """The file; it exists."""
    position: np.ndarray
    """Origin of the mesh [m] in the body's frame, of shape (3,)."""
    rotation: np.ndarray
    """Rotation mesh to body, of shape (3, 3)."""
    scale: np.ndarray
    """Factors on the file's coordinates along its axes, of shape (3,)."""
    collides: bool
    """Whether it is meant for contact, not for the eye."""
    color: tuple[float, ...] | None = None
    """Red, green, blue, alpha in [0, 1] if the robot's file names a color."""


Pose = tuple[np.ndarray, np.ndarray]
"""Position [m], (3,), and rotation to the world, (3, 3)."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A file without its robot, and how the robot stands in it."""

    spec: mujoco.MjSpec
    """What is beside the robot, in the file's own frame; it compiles."""
    base: str
    """The robot's first body."""
    zero: np.ndarray
    """Rotation of that body in the file's zero posture, (3, 3)."""
    poses: Mapping[str, Pose]
    """All bodies as they are at first, in the file's own frame."""
    qpos: np.ndarray
    """Where the joints of the spec begin."""
    qvel: np.ndarray
    """How fast they are then."""
    ctrl: np.ndarray
    """What the actuators of the spec are given, all the time."""
    excluded: tuple[tuple[str, str], ...]
    """Pairs of bodies, one of the robot and one of the spec, that do not touch."""


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A robot as its file describes it, as one editable model with a floating base."""

    name: str
    """Name, for tables: that of the registry, or the stem of the file."""
    path: Path
    """The file."""
    spec: mujoco.MjSpec
    """The robot alone: the only body in the world has a free joint, all other joints
    are hinges or slides. It compiles; what is added follows its `compiler`'s angles."""
    mimics: tuple[Mimic, ...]
    """Joints that follow others; the spec does not couple them."""
    speed: dict[str, float]
    """Speed limits [rad/s, m/s] of the joints that have one."""
    torque: dict[str, float]
    """Torque limits [N m, N] of the joints that have one."""
    meshes: tuple[LinkMesh, ...]
    """All meshes of the bodies that exist on disk, whether in the spec or not."""
    notes: tuple[str, ...]
    """What was repaired, dropped or missing, one line each."""
    is_urdf: bool
    """Whether the file is a URDF, else an MJCF."""
    around: Surroundings | None = None
    """What the file holds beside the robot; None for a level floor at most."""


def resolve_mimics(mimics: list[Mimic]) -> tuple[Mimic, ...]:
    """Resolve chains of followers: each joint follows a leader directly.

    Args:
        mimics: The rules as the file gives them, at most one for a joint.

    Returns:
        The rules, in the same order.

    Raises:
        ModelError: If joints follow each other in a circle.
    """
    rules = {mimic.joint: mimic for mimic in mimics}
    return tuple(_resolve(mimic, rules) for mimic in mimics)


def _resolve(mimic: Mimic, rules: dict[str, Mimic]) -> Mimic:
    """Return a rule after the joint at the head of its chain."""
    primary, ratio, offset = mimic.primary, mimic.ratio, mimic.offset
    seen = {mimic.joint}
    while primary in rules:
        if primary in seen:
            raise ModelError(
                f'joint "{mimic.joint}" follows others in a circle; let one lead'
            )
        seen.add(primary)
        above = rules[primary]
        primary, offset = above.primary, ratio * above.offset + offset
        ratio *= above.ratio
    return Mimic(mimic.joint, primary, ratio, offset)


def with_limbs_leading(file: ModelFile, model: mujoco.MjModel) -> ModelFile:
    """Return a model whose motors beside a limb follow the joint that they drive.

    A gear's motor that moves nothing else is often the leader in a file. The limb needs
    its joint, which takes the motor's limits through the gear.

    Args:
        file: The model.
        model: The same, compiled.

    Returns:
        The model.
    """
    below = [0] * model.nbody  # joints of a body and of all that hang on it
    for body in range(model.nbody - 1, 0, -1):
        below[body] += int(model.body_jntnum[body])
        below[model.body_parentid[body]] += below[body]
    leaders = [mimic.primary for mimic in file.mimics]
    mimics, speed, torque = [], dict(file.speed), dict(file.torque)
    for m in file.mimics:
        motor, moved = (
            below[model.jnt_bodyid[model.joint(name).id]]
            for name in (m.primary, m.joint)
        )
        if motor > 1 or moved < 2 or not m.ratio or leaders.count(m.primary) > 1:
            mimics.append(m)
            continue
        mimics.append(Mimic(m.primary, m.joint, 1.0 / m.ratio, -m.offset / m.ratio))
        geared = (torque, 1.0 / abs(m.ratio)), (speed, abs(m.ratio))
        for limits, factor in geared:
            if m.primary in limits:
                most = factor * limits[m.primary]
                limits[m.joint] = min(most, limits.get(m.joint, most))
        _narrow(file.spec, model, m)
    return replace(file, mimics=tuple(mimics), speed=speed, torque=torque)


def _narrow(spec: mujoco.MjSpec, model: mujoco.MjModel, m: Mimic) -> None:
    """Give a driven joint the range that its motor has."""
    motor, driven = model.joint(m.primary), model.joint(m.joint)
    if not model.jnt_limited[motor.id]:
        return
    ends = m.ratio * motor.range + m.offset
    low, high = float(ends.min()), float(ends.max())
    if model.jnt_limited[driven.id]:
        low, high = max(low, driven.range[0]), min(high, driven.range[1])
    joint = spec.joint(m.joint)
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    unit = 180.0 / np.pi if spec.compiler.degree else 1.0
    joint.range = unit * np.array([low, high])


def check_depth(root: ET.Element) -> None:
    """Check that elements are not nested too deep, which parsers do not survive.

    Args:
        root: The root of a file.

    Raises:
        ModelError: If they are.
    """
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    if level:
        raise ModelError(f"its elements are nested more than {DEEPEST} deep")


def first_of(names: Sequence[str], count: int = 4) -> str:
    """Return the first few names for a message, and how many more there are.

    Args:
        names: The names.
        count: How many to show.

    Returns:
        `a, b, c, d and 7 more`.
    """
    more = f" and {len(names) - count} more" if len(names) > count else ""
    return ", ".join(names[:count]) + more


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """Return the quaternion wxyz of a rotation matrix.

    Args:
        R: Rotation, of shape (3, 3).

    Returns:
        Unit quaternion, of shape (4,).
    """
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R, dtype=float).ravel())
    return quaternion


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion wxyz.

    Args:
        quaternion: Unit quaternion, of shape (4,).

    Returns:
        Rotation, of shape (3, 3).
    """
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return R.reshape(3, 3)
