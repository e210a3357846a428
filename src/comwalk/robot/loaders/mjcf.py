"""MJCF: a robot alone, out of a model or a scene of MuJoCo, with a floating base."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError, one_line
from .mjcf_assets import (
    delete_geoms,
    drop_meshes,
    drop_missing_heights,
    drop_missing_meshes,
    drop_missing_textures,
    drop_textures,
    drop_unused_looks,
    mesh_path,
    meshes_of,
)
from .mjcf_tree import whole_tree
from .parts import LinkMesh, Mimic, ModelFile, first_of, resolve_mimics, rotation_of
from .world import take_world

_UNKNOWN = re.compile(r"unrecognized attribute: '([^']+)' Element '([^']+)'")
_MESH = mujoco.mjtGeom.mjGEOM_MESH
_FREE = mujoco.mjtJoint.mjJNT_FREE
_STAND_IN = "comwalk stand-in "
_LEGS = 8  # joints that two legs have, at least


def read_mjcf(root: ET.Element, path: Path, *, geometry: bool) -> ModelFile:
    """Read an MJCF: the heaviest tree of bodies with joints for two legs is the robot.

    Args:
        root: The element `mujoco`.
        path: The file.
        geometry: Whether its meshes stay in the model; if not, they are dropped, and
            bodies keep the inertia that they had from them.

    Returns:
        The model, not compiled yet.

    Raises:
        ModelError: If the model is broken; the text does not name the file.
    """
    notes: list[str] = []
    spec = _parse(root, path, notes)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    _name_all(spec)
    lost: list[str] = []
    drop_missing_heights(spec, notes)
    drop_missing_textures(spec, lost)
    outline = _outline(spec)
    meshes = _link_meshes(spec, outline)
    base = _find_robot(spec, outline)
    around = take_world(spec, outline, base.name, notes, geometry=geometry)
    for key in list(spec.keys):
        spec.delete(key)
    _keep_robot(spec, base, notes if around is None else [])
    if around is not None:
        drop_unused_looks(spec, sky=False)
        for site in list(spec.worldbody.sites):
            spec.delete(site)
    drop_missing_meshes(spec, notes)
    if geometry or around is not None:
        notes += lost
    if not geometry:
        drop_meshes(spec, notes, solid=around is None)
    _set_free(spec, outline, base, notes)
    bodies = {body.name for body in spec.bodies}
    return ModelFile(
        name=path.stem,
        path=path,
        spec=spec,
        mimics=resolve_mimics(_take_mimics(spec, outline, notes)),
        speed=_speed_limits(outline, spec),
        torque=_torque_limits(outline, spec),
        meshes=tuple(mesh for mesh in meshes if mesh.body in bodies),
        notes=tuple(notes),
        is_urdf=False,
        around=around,
    )


def _parse(root: ET.Element, path: Path, notes: list[str]) -> mujoco.MjSpec:
    """Return the model of a tree, whatever its file is called."""
    folder = path.absolute().parent
    tree, dropped = whole_tree(root, folder)
    notes += dropped
    try:
        if any(tree.iter("model")) or any(tree.iter("flexcomp")):  # read other files
            return mujoco.MjSpec.from_file(str(path.absolute()))
        spec = _parse_tolerantly(tree, notes)
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"it is not a readable MJCF: {one_line(error)}") from None
    spec.modelfiledir = str(folder)
    return spec


def _parse_tolerantly(tree: ET.Element, notes: list[str]) -> mujoco.MjSpec:
    """Return the model of a tree, without attributes that MuJoCo no longer knows."""
    while True:
        try:
            return mujoco.MjSpec.from_string(ET.tostring(tree, encoding="unicode"))
        except ValueError as error:
            found = _UNKNOWN.search(one_line(error))
            if found is None:
                raise
            name, tag = found.groups()
            holders = [
                x for x in tree.iter(tag) if x.attrib.pop(name, None) is not None
            ]
            if not holders:
                raise
            notes.append(f"<{tag} {name}> is unknown to this MuJoCo, left out")


def _name_all(spec: mujoco.MjSpec) -> None:
    """Give a name to each body and joint that has none."""
    for what, elements in (("body", spec.bodies[1:]), ("joint", spec.joints)):
        taken = {element.name for element in elements}
        for i, element in enumerate(elements):
            if not element.name:
                name = f"{what}_{i}"
                element.name = name if name not in taken else f"{name}_of_comwalk"


def _outline(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model compiled without its files.

    A small sphere, named after its place in the list of geoms, stands in for each
    mesh, so that frames, masses and keyframes are known before a file is read.
    """
    copy = spec.copy()
    drop_textures(copy)
    meshes = meshes_of(copy)
    for i, geom in enumerate(copy.geoms):
        if geom.meshname in meshes:
            geom.name = f"{_STAND_IN}{i}"
            geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
            geom.size, geom.meshname = (0.01, 0.0, 0.0), ""
    for kind in (copy.pairs, copy.sensors, copy.skins, meshes.values()):
        for element in list(kind):
            copy.delete(element)
    try:
        return copy.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"it does not compile: {one_line(error)}") from None


def _find_robot(spec: mujoco.MjSpec, outline: mujoco.MjModel) -> mujoco.MjsBody:
    """Return the first body of the heaviest tree, of those with joints for two legs."""
    trees = list(spec.worldbody.bodies)
    if not trees:
        raise ModelError("it has no bodies; is this a robot?")
    roots = [outline.body(body.name).id for body in trees]
    joints = np.bincount(outline.body_rootid, outline.body_jntnum, outline.nbody)
    ranks = [(joints[k] >= _LEGS, outline.body_subtreemass[k]) for k in roots]
    return trees[ranks.index(max(ranks))]


def _keep_robot(spec: mujoco.MjSpec, base: mujoco.MjsBody, notes: list[str]) -> None:
    """Remove all but the tree of a body from the world."""
    world = spec.worldbody
    others = [body.name for body in world.bodies if body.name != base.name]
    limbs = [body.name for body in world.bodies if _hangs(body)]
    if _hangs(base) and len(limbs) > 1:
        raise ModelError(
            f"{first_of(limbs)} hang on the world by hinges, so that the trunk between "
            "them has no mass and does not move; put them into one body with an "
            "<inertial> and a <freejoint/>"
        )
    for name in others:
        spec.delete(spec.body(name))
    if others:
        notes.append(f"beside the robot in the world, dropped: {first_of(others)}")
    geoms = list(world.geoms)
    if geoms:
        notes.append(f"{len(geoms)} shapes fixed to the world dropped")
    delete_geoms(spec, geoms)
    for light in list(world.lights):
        spec.delete(light)


def _hangs(body: mujoco.MjsBody) -> bool:
    """Return whether a limb hangs by hinges, and not a door, on what bears it."""
    kinds = {joint.type for joint in body.joints}
    many = 2 * len(body.find_all("joint")) >= _LEGS
    return kinds == {mujoco.mjtJoint.mjJNT_HINGE} and many


def _link_meshes(spec: mujoco.MjSpec, outline: mujoco.MjModel) -> list[LinkMesh]:
    """Return the meshes of all bodies whose files exist."""
    files, found = meshes_of(spec), []
    for i, geom in enumerate(spec.geoms):
        asset = files.get(geom.meshname)
        body = geom.parent.name
        if asset is None or geom.type != _MESH or body == "world":
            continue
        file = mesh_path(spec, asset)
        if file.is_file():
            stand_in = outline.geom(f"{_STAND_IN}{i}")
            R, R_ref = _rotation(stand_in.quat), _rotation(asset.refquat)
            scale = np.array(asset.scale)
            found.append(
                LinkMesh(
                    body=body,
                    file=file,
                    position=stand_in.pos - R @ R_ref.T @ (scale * asset.refpos),
                    rotation=R @ R_ref.T,
                    scale=scale,
                    collides=bool(geom.contype or geom.conaffinity),
                    color=_color(spec, geom),
                )
            )
    return found


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    unit = np.array(quaternion, dtype=float)
    return rotation_of(unit / np.linalg.norm(unit))


def _color(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> tuple[float, ...]:
    material = spec.material(geom.material) if geom.material else None
    rgba = geom.rgba if material is None else material.rgba
    return tuple(float(x) for x in rgba)


def _set_free(
    spec: mujoco.MjSpec,
    outline: mujoco.MjModel,
    base: mujoco.MjsBody,
    notes: list[str],
) -> None:
    """Give the first body a free joint, and the keyframes its pose."""
    joints = list(base.joints)
    is_free = len(joints) == 1 and joints[0].type == _FREE
    if not is_free:
        tied = [joint.name for joint in joints]
        how = (
            f"it was tied to the world by {first_of(tied)}" if tied else "it was fixed"
        )
        notes.append(f'free joint added to "{base.name}": {how}')
        _delete_joints(spec, joints)
        base.add_freejoint(name=_free_name(spec))
    _let_go(spec, notes)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_BALL:
            raise ModelError(
                f'joint "{joint.name}" is a ball; make it three hinges in a row'
            )
    if len(spec.joints) < 2:
        raise ModelError("it has no joints that move; a robot to walk needs two legs")
    _write_keys(spec, outline, base)


def _let_go(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Let nothing but the ground hold the robot."""
    free = next(joint for joint in spec.joints if joint.type == _FREE)
    if free.armature or np.any(free.damping) or free.frictionloss:
        notes.append("damping, friction and armature of the floating base dropped")
    free.armature, free.frictionloss, free.damping = 0.0, 0.0, 0.0 * free.damping
    borne = [body for body in spec.bodies if body.gravcomp]
    for body in borne:
        body.gravcomp = 0.0
    if borne:
        names = first_of([body.name for body in borne])
        notes.append(f"gravcomp dropped, which bears a part of the weight: {names}")


def _free_name(spec: mujoco.MjSpec) -> str:
    name = "floating_base"
    while spec.joint(name) is not None:
        name += "_"
    return name


def _delete_joints(spec: mujoco.MjSpec, joints: list[mujoco.MjsJoint]) -> None:
    """Delete joints, and what drives, measures or couples them."""
    names = {joint.name for joint in joints}
    for actuator in list(spec.actuators):
        if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.target in names:
            spec.delete(actuator)
    for sensor in list(spec.sensors):
        if sensor.objtype == mujoco.mjtObj.mjOBJ_JOINT and sensor.objname in names:
            spec.delete(sensor)
    for equality in list(spec.equalities):
        is_joint = equality.type == mujoco.mjtEq.mjEQ_JOINT
        if is_joint and {equality.name1, equality.name2} & names:
            spec.delete(equality)
    for joint in joints:
        spec.delete(joint)


def _write_keys(
    spec: mujoco.MjSpec, outline: mujoco.MjModel, base: mujoco.MjsBody
) -> None:
    """Write the keyframes anew for the joints and actuators that are left."""
    free = next(joint.name for joint in spec.joints if joint.type == _FREE)
    left = {joint.name for joint in spec.joints} - {free}
    kept = [i for i in range(outline.njnt) if outline.joint(i).name in left]
    body, was_free = outline.body(base.name), free in _joint_names(outline)
    for k in range(outline.nkey):
        q, dq = outline.key_qpos[k], outline.key_qvel[k]
        pose, twist = np.concatenate([body.pos, body.quat]), np.zeros(6)
        if was_free:
            first = outline.joint(free)
            pose, twist = q[first.qposadr[0] :][:7], dq[first.dofadr[0] :][:6]
        key = spec.add_key(name=outline.key(k).name, time=float(outline.key_time[k]))
        key.qpos = np.concatenate([pose, q[outline.jnt_qposadr[kept]]])
        key.qvel = np.concatenate([twist, dq[outline.jnt_dofadr[kept]]])
        if len(spec.actuators) == outline.nu:
            key.ctrl, key.act = outline.key_ctrl[k], outline.key_act[k]


def _joint_names(model: mujoco.MjModel) -> set[str]:
    return {model.joint(i).name for i in range(model.njnt)}


def _take_mimics(
    spec: mujoco.MjSpec, outline: mujoco.MjModel, notes: list[str]
) -> list[Mimic]:
    """Remove the couplings of two joints from the model, and return them."""
    found: dict[str, Mimic] = {}
    for equality in list(spec.equalities):
        joint, primary = equality.name1, equality.name2
        is_joint = equality.type == mujoco.mjtEq.mjEQ_JOINT
        if not (is_joint and primary and equality.active):
            notes += _drop_constraint(spec, equality)
            continue
        constant, ratio, *bends = equality.data[:5]
        if any(bends):
            notes.append(
                f'joint "{joint}" follows "{primary}" along a line, not a curve'
            )
        zero, zero_primary = (
            outline.qpos0[outline.joint(name).qposadr[0]] for name in (joint, primary)
        )
        offset = zero + constant - ratio * zero_primary
        found.setdefault(joint, Mimic(joint, primary, float(ratio), float(offset)))
        spec.delete(equality)
    return list(found.values())


def _drop_constraint(
    spec: mujoco.MjSpec, equality: mujoco.MjsEquality
) -> Iterator[str]:
    """Delete a constraint that is no coupling of joints, and tell what it held."""
    name = equality.name or equality.type.name
    if equality.active and equality.type == mujoco.mjtEq.mjEQ_JOINT:
        yield f'constraint "{name}" is kept, which locks {equality.name1}'
        return
    ends = sorted({equality.name1, equality.name2} - {"", "world"})
    is_body = equality.objtype == mujoco.mjtObj.mjOBJ_BODY
    ties = equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
    active = equality.active
    spec.delete(equality)
    if active and ties and is_body and len(ends) < 2:
        yield f'constraint "{name}" dropped: it ties {first_of(ends)} to the world'
    elif active and ties:
        yield (
            f'closed loop "{name}" opened: its rods move with the links that bear '
            "them, and the joints in the loop are driven directly"
        )
    elif active:
        yield f'constraint "{name}" dropped'


def _speed_limits(outline: mujoco.MjModel, spec: mujoco.MjSpec) -> dict[str, float]:
    if outline.nuser_jnt == 0:
        return {}
    values = {j.name: float(outline.joint(j.name).user[0]) for j in _moving(spec)}
    return {name: value for name, value in values.items() if value > 0.0}


def _moving(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [joint for joint in spec.joints if joint.type != _FREE]


def _torque_limits(outline: mujoco.MjModel, spec: mujoco.MjSpec) -> dict[str, float]:
    """Return torque limits: of the joint itself, or of what drives it if lower."""
    names = {joint.name for joint in _moving(spec)}
    limits: dict[str, float] = {}
    for a in range(outline.nu):
        joint = int(outline.actuator_trnid[a, 0])
        drives = outline.actuator_trntype[a] == int(mujoco.mjtTrn.mjTRN_JOINT)
        torque = _actuator_limit(outline, a)
        if drives and torque is not None:
            limits[outline.joint(joint).name] = torque
    for i in range(outline.njnt):
        if outline.jnt_actfrclimited[i]:
            name, own = outline.joint(i).name, float(outline.jnt_actfrcrange[i, 1])
            limits[name] = min(own, limits.get(name, own))
    return {name: x for name, x in limits.items() if name in names and x > 0.0}


def _actuator_limit(model: mujoco.MjModel, a: int) -> float | None:
    """Return the largest torque [N m] of an actuator on its joint, None if any."""
    gear = abs(float(model.actuator_gear[a, 0]))
    if model.actuator_forcelimited[a]:
        return gear * float(model.actuator_forcerange[a, 1])
    is_motor = model.actuator_biastype[a] == int(mujoco.mjtBias.mjBIAS_NONE)
    if is_motor and model.actuator_ctrllimited[a]:
        gain = abs(float(model.actuator_gainprm[a, 0]))
        return gear * gain * float(model.actuator_ctrlrange[a, 1])
    return None
