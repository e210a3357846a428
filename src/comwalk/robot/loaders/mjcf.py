"""MJCF: a robot alone, out of a model or a scene of MuJoCo, with a floating base."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError, one_line
from .mjcf_tree import whole_tree
from .parts import LinkMesh, Mimic, ModelFile, first_of, resolve_mimics, rotation_of

_UNKNOWN = re.compile(r"unrecognized attribute: '([^']+)' Element '([^']+)'")
_MESH = mujoco.mjtGeom.mjGEOM_MESH
_FREE = mujoco.mjtJoint.mjJNT_FREE
_NEEDED = "GRAVITY", "CONTACT", "CONSTRAINT", "EQUALITY", "LIMIT", "ACTUATION", "SENSOR"
_STAND_IN = "comwalk stand-in "


def read_mjcf(root: ET.Element, path: Path, *, geometry: bool) -> ModelFile:
    """Read an MJCF: the heaviest tree of bodies in its world is the robot.

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
    outline = _outline(spec)
    meshes = _link_meshes(spec, outline)
    for key in list(spec.keys):
        spec.delete(key)
    base = _keep_robot(spec, outline, notes)
    _drop_missing_meshes(spec, notes)
    if not geometry:
        _drop_meshes(spec)
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


def _files(spec: mujoco.MjSpec) -> dict[str, mujoco.MjsMesh]:
    return {m.name or Path(m.file).stem: m for m in spec.meshes if m.file}


def _outline(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model compiled without its files.

    A small sphere, named after its place in the list of geoms, stands in for each
    mesh, so that frames, masses and keyframes are known before a file is read.
    """
    copy = spec.copy()
    _drop_textures(copy)
    meshes = _files(copy)
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


def _drop_textures(spec: mujoco.MjSpec) -> None:
    """Delete textures that come from files."""
    dropped = set()
    for texture in list(spec.textures):
        if texture.file or any(texture.cubefiles):
            dropped.add(texture.name or Path(texture.file).stem)
            spec.delete(texture)
    for material in spec.materials:
        for i, name in enumerate(material.textures):
            if name in dropped:
                material.textures[i] = ""


def _keep_robot(
    spec: mujoco.MjSpec, outline: mujoco.MjModel, notes: list[str]
) -> mujoco.MjsBody:
    """Remove all but the heaviest tree from the world, and return its first body."""
    world = spec.worldbody
    trees = list(world.bodies)
    if not trees:
        raise ModelError("it has no bodies; is this a robot?")
    mass = {b.name: outline.body_subtreemass[outline.body(b.name).id] for b in trees}
    base = max(trees, key=lambda body: mass[body.name])
    others = [body.name for body in trees if body is not base]
    for body in trees:
        if body is not base:
            spec.delete(body)
    if others:
        notes.append(f"beside the robot in the world, dropped: {first_of(others)}")
    geoms = list(world.geoms)
    if geoms:
        notes.append(f"{len(geoms)} shapes fixed to the world dropped")
    _delete_geoms(spec, geoms)
    for light in list(world.lights):
        spec.delete(light)
    return base


def _link_meshes(spec: mujoco.MjSpec, outline: mujoco.MjModel) -> list[LinkMesh]:
    """Return the meshes of all bodies whose files exist."""
    files, found = _files(spec), []
    for i, geom in enumerate(spec.geoms):
        asset = files.get(geom.meshname)
        body = geom.parent.name
        if asset is None or geom.type != _MESH or body == "world":
            continue
        file = _mesh_path(spec, asset)
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


def _mesh_path(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> Path:
    name = Path(mesh.file).name if spec.strippath else mesh.file
    return Path(spec.modelfiledir, mesh.compiler.meshdir, name)


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    unit = np.array(quaternion, dtype=float)
    return rotation_of(unit / np.linalg.norm(unit))


def _color(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> tuple[float, ...]:
    material = spec.material(geom.material) if geom.material else None
    rgba = geom.rgba if material is None else material.rgba
    return tuple(float(x) for x in rgba)


def _delete_geoms(spec: mujoco.MjSpec, geoms: list[mujoco.MjsGeom]) -> None:
    """Delete geoms, and the contact pairs and sensors that name them."""
    names = {geom.name for geom in geoms} - {""}
    is_geom = mujoco.mjtObj.mjOBJ_GEOM
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & names:
            spec.delete(pair)
    for sensor in list(spec.sensors):
        own = sensor.objtype == is_geom and sensor.objname in names
        if own or (sensor.reftype == is_geom and sensor.refname in names):
            spec.delete(sensor)
    for geom in geoms:
        spec.delete(geom)


def _drop_missing_meshes(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Drop the meshes that are not on disk; what needs their mass is at fault."""
    missing = {
        name: mesh
        for name, mesh in _files(spec).items()
        if not _mesh_path(spec, mesh).is_file()
    }
    geoms = [geom for geom in spec.geoms if geom.meshname in missing]
    for geom in geoms:
        if _gives_inertia(spec, geom):
            raise ModelError(
                f'body "{geom.parent.name}" has no <inertial>, and its mesh '
                f"{_mesh_path(spec, missing[geom.meshname])} does not exist; add one"
            )
    _delete_geoms(spec, geoms)
    for mesh in missing.values():
        spec.delete(mesh)
    if geoms:
        names = [Path(mesh.file).name for mesh in missing.values()]
        notes.append(f"{len(names)} mesh files not found: {first_of(names)}")


def _drop_meshes(spec: mujoco.MjSpec) -> None:
    """Drop all meshes from files; bodies keep the inertia that they had from them."""
    _drop_textures(spec)
    files = _files(spec)
    needed, spare = [], []
    for geom in spec.geoms:
        if geom.meshname in files and geom.type == _MESH and not _is_named(spec, geom):
            (needed if _gives_inertia(spec, geom) else spare).append(geom)
    _delete_geoms(spec, spare)
    _drop_unused_meshes(spec)
    if needed:
        _freeze_inertia(spec)
        _delete_geoms(spec, needed)
        _drop_unused_meshes(spec)


def _gives_inertia(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if geom.parent.explicitinertial and spec.compiler.inertiafromgeom != always:
        return False
    return bool(geom.density if np.isnan(geom.mass) else geom.mass)


def _is_named(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    names = {n for pair in spec.pairs for n in (pair.geomname1, pair.geomname2)}
    names |= {n for sensor in spec.sensors for n in (sensor.objname, sensor.refname)}
    return bool(geom.name) and geom.name in names


def _drop_unused_meshes(spec: mujoco.MjSpec) -> None:
    """Delete the meshes that no geom uses, unless something soft may."""
    used = {geom.meshname for geom in spec.geoms}
    for name, mesh in _files(spec).items():
        if name not in used and not spec.skins and not spec.flexes:
            spec.delete(mesh)


def _freeze_inertia(spec: mujoco.MjSpec) -> None:
    """Write the inertia that each body gets from its geoms into the body itself."""
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"it does not compile: {one_line(error)}") from None
    for body in spec.bodies[1:]:
        compiled = model.body(body.name)
        body.explicitinertial = True
        body.mass, body.inertia = float(compiled.mass[0]), compiled.inertia
        body.ipos, body.iquat = compiled.ipos, compiled.iquat
        body.fullinertia = np.full(6, np.nan)
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


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
    bits = {n: int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{n}")) for n in _NEEDED}
    if off := [n.lower() for n, bit in bits.items() if spec.option.disableflags & bit]:
        notes.append(f"flags dropped that disable a part of physics: {', '.join(off)}")
    spec.option.disableflags &= ~sum(bits.values())
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
