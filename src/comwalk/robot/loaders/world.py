"""The world that a robot stands in, in its file: what is left when it is taken out.

A walk starts in the origin, along x, on a floor at z = 0; so the world is placed as it
is seen from where the robot stands in the file's keyframe, or as the file has it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from ...errors import ModelError
from .meshes import compile_without_bad_meshes
from .mjcf_assets import (
    delete_geoms,
    drop_meshes,
    drop_unused_looks,
    drop_unused_meshes,
    mesh_path,
    missing_meshes,
)
from .parts import Surroundings, first_of, rotation_of

_PLANE = mujoco.mjtGeom.mjGEOM_PLANE
_FREE = mujoco.mjtJoint.mjJNT_FREE
_LEVEL = 1e-3  # heights [m] and cosines that are as good as equal
_ABOVE = 0.1  # how far above the robot's first body, or off its soles, it may be [m]
_HIGH = 100.0  # above all that there is [m]


@dataclass(frozen=True, eq=False)
class World:
    """What is around a robot, as the robot sees it. Made by `place_world`."""

    spec: mujoco.MjSpec
    """What is there, in the file's own frame."""
    position: np.ndarray
    """The file's origin [m], in the world of the walk, (3,)."""
    quaternion: np.ndarray
    """Rotation of the file's frame to the world of the walk, wxyz, (4,)."""
    qpos: np.ndarray
    """Where the joints in the spec begin, in the world of the walk."""
    qvel: np.ndarray
    """How fast they do."""
    ctrl: np.ndarray
    """What its actuators are given, all the time."""
    floor: tuple[int, int] | None
    """Contype and conaffinity of the plane that the robot stands on, and that is not in
    the spec; None if it stands on a shape that is."""
    excluded: tuple[tuple[str, str], ...]
    """Pairs of bodies, one of the robot and one of the spec, that do not touch."""
    note: str
    """What there is, in one line."""


def take_world(
    spec: mujoco.MjSpec,
    outline: mujoco.MjModel,
    base: str,
    notes: list[str],
    *,
    geometry: bool,
) -> Surroundings | None:
    """Return what a file holds beside its robot.

    Args:
        spec: The file, whole; it stays as it is.
        outline: The same, compiled without meshes.
        base: The robot's first body.
        notes: Gets a line for each thing that is not readable.
        geometry: Whether textures and meshes that touch nothing stay.

    Returns:
        The surroundings; None if there is nothing but a level floor, lights and sky.
    """
    world = spec.copy()
    for i, actuator in enumerate(world.actuators):
        actuator.name = f"{i} {actuator.name}"  # to find it when others are gone
    excluded = _excluded(world, base)
    try:
        empty = _strip(world, base, notes, geometry=geometry)
        model = compile_without_bad_meshes(world, notes)
    except ModelError as error:
        notes.append(f"the file's world is left out: {error}")
        return None
    if len(_level_planes(world, model)) == len(world.geoms):
        return None
    if empty:
        notes.append(
            f"without a rigid shape beside the robot, dropped: {first_of(empty)}"
        )
    data = mujoco.MjData(outline)
    mujoco.mj_resetDataKeyframe(outline, data, first_key(outline))
    mujoco.mj_kinematics(outline, data)
    poses = {
        outline.body(b).name: (data.xpos[b].copy(), data.xmat[b].reshape(3, 3).copy())
        for b in range(outline.nbody)
    }
    begin = [data.joint(model.joint(j).name) for j in range(model.njnt)]
    drives = [int(actuator.name.split()[0]) for actuator in world.actuators]
    for actuator in world.actuators:
        actuator.name = actuator.name.partition(" ")[2]
    return Surroundings(
        spec=world,
        base=base,
        zero=rotation_of(outline.body(base).quat),
        poses=poses,
        qpos=np.concatenate([[], *(joint.qpos for joint in begin)]),
        qvel=np.concatenate([[], *(joint.qvel for joint in begin)]),
        ctrl=data.ctrl[drives],
        excluded=excluded,
    )


def _excluded(world: mujoco.MjSpec, base: str) -> tuple[tuple[str, str], ...]:
    """Return the pairs that do not touch: a body of the robot, and one of another."""
    trunk = world.body(base)
    robot = {base, *(body.name for body in trunk.find_all("body"))}
    pairs = [(e.bodyname1, e.bodyname2) for e in world.excludes]
    pairs += [(b, a) for a, b in pairs]
    return tuple((a, b) for a, b in pairs if a in robot and b not in robot)


def first_key(model: mujoco.MjModel) -> int:
    """Return the keyframe "walk", else the first one; -1 without any.

    Args:
        model: A compiled model.
    """
    names = [model.key(k).name for k in range(model.nkey)]
    return names.index("walk") if "walk" in names else min(0, model.nkey - 1)


def _strip(
    world: mujoco.MjSpec, base: str, notes: list[str], *, geometry: bool
) -> list[str]:
    """Take out the robot, what sees and lights the scene, and files that miss.

    Returns:
        Bodies that were taken out too, as nothing that hangs on them has a shape.
    """
    soft = {flex.name for flex in world.flexes}
    bonds = [bond for bond in world.equalities if bond.name1 in soft]
    lists = (world.lights, world.cameras, world.sensors, world.keys, world.skins)
    for kind in (*lists, world.tuples, bonds, world.flexes):
        for element in list(kind):
            world.delete(element)
    trees = list(world.worldbody.bodies)
    empty = [body.name for body in trees if not body.find_all("geom")]
    for name in {base, *empty}:
        world.delete(world.body(name))
    drop_unused_meshes(world)
    _drop_missing(world, notes)
    if not geometry:
        drop_meshes(world, notes, solid=False)
    drop_unused_looks(world, sky=True)
    return [name for name in empty if name != base]


def _drop_missing(world: mujoco.MjSpec, notes: list[str]) -> None:
    """Drop shapes without their files, and bodies that have no mass without them."""
    missing = missing_meshes(world)
    geoms = [geom for geom in world.geoms if geom.meshname in missing]
    bodies = {geom.parent.name for geom in geoms if not geom.parent.explicitinertial}
    delete_geoms(world, geoms)
    for name in bodies - {"world"}:
        body = world.body(name)
        if body is not None and body.joints and not body.geoms:
            world.delete(body)
    for mesh in missing.values():
        world.delete(mesh)
    if geoms:
        names = [mesh_path(world, mesh).name for mesh in missing.values()]
        notes.append(f"meshes of the file's world not found: {first_of(names)}")


def _level_planes(
    world: mujoco.MjSpec, model: mujoco.MjModel
) -> list[tuple[mujoco.MjsGeom, float]]:
    """Return the level planes that do not move, and their heights [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return [
        (geom, float(data.geom_xpos[geom.id, 2]))
        for geom in world.geoms
        if geom.type == _PLANE
        and model.body_weldid[model.geom_bodyid[geom.id]] == 0
        and data.geom_xmat[geom.id, 8] > 1.0 - _LEVEL
    ]


def place_world(
    around: Surroundings,
    forward: float | None,
    soles: Iterable[tuple[str, np.ndarray]],
) -> World:
    """Return what is around a robot, as seen from where it stands.

    Args:
        around: The file without the robot.
        forward: Yaw of the robot's forward axis in the file's zero posture [rad];
            None if it is the x axis of its first body.
        soles: Bodies of the feet, and the centres of their soles in them [m], (3,).

    Returns:
        The world: below the robot's first body the origin, its forward axis along x,
        the ground under its feet at z = 0.
    """
    spec, (place, R) = around.spec.copy(), around.poses[around.base]
    ahead = R[:, 0]
    if forward is not None:
        ahead = R @ around.zero.T @ [math.cos(forward), math.sin(forward), 0.0]
    turn = -math.atan2(ahead[1], ahead[0])
    feet = [p + A @ r for (p, A), r in ((around.poses[b], r) for b, r in soles)]
    height, floor, note = _find_ground(spec, np.array(feet), float(place[2]))
    quaternion = np.array([math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)])
    origin = rotation_of(quaternion) @ [-place[0], -place[1], -height]
    qpos, qvel = around.qpos.copy(), around.qvel.copy()
    i = k = 0
    for joint in spec.joints:
        if joint.type == _FREE:
            seen = qpos[i : i + 3].copy()
            qpos[i : i + 3] = origin + rotation_of(quaternion) @ seen
            mujoco.mju_mulQuat(qpos[i + 3 : i + 7], quaternion, qpos[i + 3 : i + 7])
            qvel[k : k + 3] = rotation_of(quaternion) @ qvel[k : k + 3]
        i, k = i + _SIZES[joint.type][0], k + _SIZES[joint.type][1]
    return World(
        spec=spec,
        position=origin,
        quaternion=quaternion,
        qpos=qpos,
        qvel=qvel,
        ctrl=around.ctrl,
        floor=floor,
        excluded=around.excluded,
        note=note,
    )


_SIZES = {  # numbers of a joint in qpos and qvel
    _FREE: (7, 6),
    mujoco.mjtJoint.mjJNT_BALL: (4, 3),
    mujoco.mjtJoint.mjJNT_HINGE: (1, 1),
    mujoco.mjtJoint.mjJNT_SLIDE: (1, 1),
}


def _find_ground(
    spec: mujoco.MjSpec, feet: np.ndarray, top: float
) -> tuple[float, tuple[int, int] | None, str]:
    """Find the ground under the feet, and take out the level plane that it may be.

    Args:
        spec: The world; it is changed.
        feet: Centres of the soles [m], (n, 3).
        top: Height of the robot's first body [m]; the ground is below.

    Returns:
        Height of the ground [m]; contype and conaffinity of the plane, None if it is
        no plane; what there is, for the user.
    """
    model = spec.compile()
    planes = _level_planes(spec, model)
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    solid &= model.body_weldid[model.geom_bodyid] == 0
    tops = [_tops(model, solid, foot) for foot in feet]
    below = [z for own in tops for z in own if z < max(top, *feet[:, 2]) + _ABOVE]
    under = zip(tops, feet[:, 2], strict=True)
    near = [z for own, sole in under for z in own if abs(z - sole) < _ABOVE]
    found = [max(near or below)] if below else [min(own) for own in tops if own]
    firm = [(geom, z) for geom, z in planes if solid[geom.id]]
    height = max(found or [z for _, z in firm], default=0.0)
    floor, told = None, f"its ground at {height:.4g} m is one of its shapes"
    level = [(geom, z) for geom, z in firm if abs(z - height) < _LEVEL]
    if level:
        height = level[0][1]
        types = [(geom.contype, geom.conaffinity) for geom, _ in level]
        contype, conaffinity = np.bitwise_or.reduce(types).tolist()
        floor = contype, conaffinity
        told = f"its floor at {height:.4g} m"
    elif not found:
        floor, told = (1, 1), "no floor in it, so there is one at its z = 0"
    delete_geoms(spec, [geom for geom, z in planes if abs(z - height) < _LEVEL])
    return height, floor, f"the file's world is kept: {_counted(spec)}; {told}"


def _tops(model: mujoco.MjModel, solid: np.ndarray, point: np.ndarray) -> list[float]:
    """Return how high each solid geom is above or below a point [m], highest first."""
    model.geom_group[:] = np.where(solid, 0, 1)
    model.geom_rgba[:, 3], model.geom_matid[:] = 1.0, -1  # rays pass what is unseen
    model.geom_size[model.geom_type == _PLANE] = 0.0  # without end, as for contacts
    data, hit, heights = mujoco.MjData(model), np.zeros(1, np.int32), list[float]()
    mujoco.mj_kinematics(model, data)
    start, down = point + np.array([0.0, 0.0, _HIGH]), np.array([0.0, 0.0, -1.0])
    groups = np.eye(6, dtype=np.uint8)[0]
    while True:
        away = mujoco.mj_ray(model, data, start, down, groups, True, -1, hit)
        if hit[0] < 0:
            return heights
        heights.append(float(start[2] - away))
        model.geom_group[hit[0]] = 1


def _counted(spec: mujoco.MjSpec) -> str:
    """Return how many shapes and bodies there are."""
    model = spec.compile()
    moves = model.body_weldid[model.geom_bodyid] > 0
    moves &= model.body_mocapid[model.geom_bodyid] < 0
    shapes, bodies = int((~moves).sum()), int((model.body_dofnum > 0).sum())
    words = (
        "1 shape" if shapes == 1 else f"{shapes} shapes",
        "1 movable body" if bodies == 1 else f"{bodies} movable bodies",
    )
    return ", ".join(word for word in words if not word.startswith("0"))
