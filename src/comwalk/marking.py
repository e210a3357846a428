"""From any model to one that walks: frames, sensors, servos, soles and a posture.

A model that was not made for comwalk gets what `robots/paper.xml` has: sites named
after REP-120, ankle sensors and an IMU, one position servo a joint, a contact box
under each foot and a keyframe "walk". What the file has already is kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from .anatomy import Anatomy, find_anatomy
from .errors import ModelError, one_line
from .footsteps import Side
from .model_files import ModelFile
from .posture import Limbs, find_posture
from .spatial import rotation_yaw

LEG_STIFFNESS = 22.0
"""Position gain of designed leg servos, in units of weight times CoM height [1/rad]."""

ARM_FREQUENCY = 50.0
"""Natural frequency of designed servos of the upper body [rad/s]."""

SERVO_LAG = 0.02
"""Velocity gain over position gain of designed servos [s]."""

ARMATURE = 1.8e-5
"""Rotor inertia at the joint over position gain, where the file has none [s^2]."""

_SOLE_HEIGHT = 0.01  # half height of a contact box [m]


def mark(file: ModelFile, profile: Mapping[str, object] | None = None) -> Anatomy:
    """Give a model all that walking needs.

    Args:
        file: The model; its spec is changed.
        profile: What a user knows better than `anatomy` and `posture`.

    Returns:
        Its parts.

    Raises:
        ModelError: If it is no humanoid, or cannot stand.
    """
    profile, name = profile or {}, str(file.path)
    spec = file.spec
    _name_geoms(spec)
    model = compile_model(spec, name)
    anatomy = find_anatomy(model, file.meshes, name, profile)
    gains = _given_gains(spec)
    _lock(spec, model, anatomy.locked)
    _drop_actuators(spec)
    _mute(spec)
    _turn_base(spec, anatomy.forward)
    _add_frames(spec, anatomy, model)
    model = compile_model(spec, name)
    q = find_posture(
        model,
        _limbs_of(model, anatomy),
        profile.get("home"),
        torque_limits(model, file.torque),
        **profile.get("stance", {}),
    )
    _add_servos(spec, model, anatomy, q, gains, file)
    spec.add_key(name="walk", qpos=q.tolist())
    return anatomy


def compile_model(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    """Compile a model.

    Args:
        spec: The model.
        name: What messages call it.

    Returns:
        The compiled model.

    Raises:
        ModelError: If it does not compile, or has no free joint at its root, or a
            joint that is neither hinge nor slide.
    """
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{name} does not compile: {one_line(error)}") from None
    types = model.jnt_type
    if model.njnt == 0 or types[0] != int(mujoco.mjtJoint.mjJNT_FREE):
        raise ModelError(
            f"{name} has no free joint at its root: add <freejoint/> to the first body"
        )
    simple = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for i in range(1, model.njnt):
        if int(types[i]) not in simple:
            raise ModelError(
                f'{name}: joint "{model.joint(i).name}" is neither hinge nor slide'
            )
    return model


def _name_geoms(spec: mujoco.MjSpec) -> None:
    """Give every geom a name, by which it can be found again."""
    taken = {geom.name for geom in spec.geoms}
    for k, geom in enumerate(spec.geoms):
        if not geom.name:
            name = f"geom_{k}"
            while name in taken:
                name += "_"
            geom.name = name


def _lock(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joints: Iterable[str]
) -> None:
    """Fix joints where they are in the zero posture; the masses stay."""
    locked = set(joints)
    for joint in [j for j in spec.joints if j.name in locked]:
        k = model.joint(joint.name).id
        low, high = model.jnt_range[k]
        angle = float(np.clip(0.0, low, high)) if model.jnt_limited[k] else 0.0
        if abs(angle) > 1e-9:
            _move_body(joint, angle, model.jnt_type[k])
        spec.delete(joint)


def _move_body(joint: mujoco.MjsJoint, value: float, kind: int) -> None:
    """Put the body of a joint where the joint would have it."""
    body, axis = joint.parent, np.asarray(joint.axis, float)
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, np.asarray(body.quat, float))
    R = R.reshape(3, 3)
    if kind == int(mujoco.mjtJoint.mjJNT_SLIDE):
        body.pos = np.asarray(body.pos) + R @ (value * axis)
        return
    turn = np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, axis / np.linalg.norm(axis), value)
    pivot, moved = np.asarray(joint.pos, float), np.empty(3)
    mujoco.mju_rotVecQuat(moved, pivot, turn)
    body.pos = np.asarray(body.pos) + R @ (pivot - moved)
    body.quat = _product(body.quat, turn)


def _given_gains(spec: mujoco.MjSpec) -> dict[str, tuple[float, float]]:
    """Return position and velocity gain of the file's own position servos, by joint."""
    gains = {}
    for actuator in spec.actuators:
        stiffness = -float(actuator.biasprm[1])
        if stiffness > 0.0 and actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            gains[actuator.target] = (stiffness, -float(actuator.biasprm[2]))
    return gains


def _drop_actuators(spec: mujoco.MjSpec) -> None:
    """Remove what the file has instead of one servo a joint."""
    for kind in (spec.actuators, spec.sensors, spec.keys):
        for element in list(kind):
            spec.delete(element)


def _mute(spec: mujoco.MjSpec) -> None:
    """Let nothing collide: the soles, which come later, are all that does."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0


def _turn_base(spec: mujoco.MjSpec, forward: float) -> None:
    """Give the base a frame whose x axis points forward: turn all that is in it."""
    if abs(forward) < 1e-9:
        return
    base, R = spec.worldbody.first_body(), rotation_yaw(-forward)
    turn = np.array([math.cos(0.5 * forward), 0.0, 0.0, -math.sin(0.5 * forward)])
    base.ipos = R @ np.asarray(base.ipos, float)
    if np.isfinite(base.fullinertia[0]):
        xx, yy, zz, xy, xz, yz = base.fullinertia.tolist()
        full = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
        base.fullinertia = full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    else:
        base.iquat = _product(turn, base.iquat)
    for part in (*base.bodies, *base.geoms, *base.sites, *base.cameras, *base.frames):
        part.pos = R @ np.asarray(part.pos, float)
        part.quat = _product(turn, part.quat)
        if getattr(part, "fromto", None) is not None and np.isfinite(part.fromto[0]):
            part.fromto = np.concatenate([R @ part.fromto[:3], R @ part.fromto[3:]])


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two quaternions wxyz."""
    product = np.empty(4)
    mujoco.mju_mulQuat(product, a, np.asarray(b, float))
    return product


def _add_frames(spec: mujoco.MjSpec, anatomy: Anatomy, model: mujoco.MjModel) -> None:
    """Add sites, contact boxes and sensors."""
    for site in [s for s in spec.sites if s.name in _SITES]:
        spec.delete(site)
    for side, sole in anatomy.soles.items():
        _add_foot(spec, side, sole, anatomy, model)
    trunk = _body_of(model, anatomy.torso) or model.body(model.jnt_bodyid[0]).name
    _add_upright(spec, model, trunk, "imu", anatomy.forward)
    if anatomy.torso:
        _add_upright(spec, model, trunk, "torso", anatomy.forward)
    for side, joints in anatomy.arms.items():
        body = _body_of(model, joints)
        spec.body(body).add_site(
            name=f"{side.value[0]}_gripper", pos=_welded_com(model, body), group=4
        )
    if anatomy.head:
        _add_upright(spec, model, _body_of(model, anatomy.head), "gaze", anatomy.forward)
    _add_sensors(spec)


_SITES = (
    *(f"{s}_{n}" for s in "lr" for n in ("sole", "ankle_ft", "gripper", "wrist")),
    "imu",
    "torso",
    "gaze",
)


def _add_foot(
    spec: mujoco.MjSpec, side: Side, sole, anatomy: Anatomy, model: mujoco.MjModel
) -> None:
    """Add the sole's contact box, its site and that of the ankle sensor."""
    letter, body = side.value[0], spec.body(sole.body)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, sole.rotation.ravel())
    ankle = np.asarray(model.joint(anatomy.legs[side][-1]).pos, float)
    below = sole.rotation.T @ (ankle - sole.position)
    under = sole.position + sole.rotation @ [below[0], below[1], 0.0]
    geoms = [geom for geom in spec.geoms if geom.name in sole.geoms]
    for k, (x, y, length, width) in enumerate(sole.boxes):
        box = body.add_geom(
            name=f"{letter}_sole_contact_{k}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * length, 0.5 * width, _SOLE_HEIGHT],
            pos=sole.position + sole.rotation @ [x, y, _SOLE_HEIGHT],
            quat=quat,
            mass=0.0,
            group=3,
            rgba=[0.15, 0.16, 0.18, 1.0],
        )
        geoms.append(box)
    for geom in geoms:
        geom.contype, geom.conaffinity, geom.condim, geom.priority = 1, 0, 3, 1
        geom.friction, geom.solref = [1.0, 0.02, 0.001], [0.005, 1.0]
    body.add_site(name=f"{letter}_sole", pos=under, quat=quat, group=4)
    body.add_site(
        name=f"{letter}_sole_centre", pos=sole.position, quat=quat, group=4
    )
    body.add_site(name=f"{letter}_ankle_ft", pos=ankle, quat=quat, group=4)


def _add_upright(
    spec: mujoco.MjSpec, model: mujoco.MjModel, body: str, name: str, forward: float
) -> None:
    """Add a site at a body's CoM that is upright in the zero posture, x forward."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    k = model.body(body).id
    R = data.xmat[k].reshape(3, 3).T @ rotation_yaw(forward)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, R.ravel())
    spec.body(body).add_site(
        name=name, pos=_welded_com(model, body), quat=quat, group=4
    )


def _welded_com(model: mujoco.MjModel, body: str) -> np.ndarray:
    """Return the CoM of a body and what is fixed to it [m], in its frame, (3,)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    k = model.body(body).id
    bodies = np.flatnonzero(model.body_weldid == model.body_weldid[k])
    mass = model.body_mass[bodies] + 1e-12
    centre = mass @ data.xipos[bodies] / mass.sum()
    return data.xmat[k].reshape(3, 3).T @ (centre - data.xpos[k])


def _body_of(model: mujoco.MjModel, joints: tuple[str, ...]) -> str:
    """Return the body that the last of some joints moves; empty if there is none."""
    if not joints:
        return ""
    return model.body(model.jnt_bodyid[model.joint(joints[-1]).id]).name


def _add_sensors(spec: mujoco.MjSpec) -> None:
    """Add ankle sensors and the IMU."""
    kinds, site = mujoco.mjtSensor, mujoco.mjtObj.mjOBJ_SITE
    rows = [
        ("imu_quat", kinds.mjSENS_FRAMEQUAT, "imu"),
        ("imu_gyro", kinds.mjSENS_GYRO, "imu"),
        ("imu_acc", kinds.mjSENS_ACCELEROMETER, "imu"),
    ]
    for letter in "lr":
        rows.append((f"{letter}_force", kinds.mjSENS_FORCE, f"{letter}_ankle_ft"))
        rows.append((f"{letter}_torque", kinds.mjSENS_TORQUE, f"{letter}_ankle_ft"))
    for name, kind, place in rows:
        spec.add_sensor(name=name, type=kind, objtype=site, objname=place)


def _limbs_of(model: mujoco.MjModel, anatomy: Anatomy) -> Limbs:
    """Return the limbs as indices into a marked model."""

    def index(names: Iterable[str]) -> list[int]:
        return [model.joint(name).id for name in names]

    return Limbs(
        legs={s: index(anatomy.legs[s]) for s in Side},
        arms={s: index(joints) for s, joints in anatomy.arms.items()},
        soles={s: _sole_site(model, s) for s in Side},
        hands={s: model.site(f"{s.value[0]}_gripper").id for s in anatomy.arms},
        widths={s: anatomy.soles[s].size[1] for s in Side},
    )


def _sole_site(model: mujoco.MjModel, side: Side) -> int:
    """Return the site at the centre of a sole."""
    return model.site(f"{side.value[0]}_sole_centre").id


# ---- Servos -----------------------------------------------------------------------


def torque_limits(
    model: mujoco.MjModel, torque: Mapping[str, float]
) -> np.ndarray:
    """Return torque limits, infinite where a file gives none or zero.

    Args:
        model: The compiled model.
        torque: Limits [N m] by joint.

    Returns:
        Limits [N m], of shape (joints,).
    """
    names = [model.joint(k).name for k in range(1, model.njnt)]
    limits = np.array([torque.get(name, math.inf) for name in names])
    return np.where(limits > 0.0, limits, math.inf)


def _add_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    anatomy: Anatomy,
    q: np.ndarray,
    gains: Mapping[str, tuple[float, float]],
    file: ModelFile,
) -> None:
    """Give each joint a position servo: the file's own, or a designed one."""
    designed = design_stiffness(model, anatomy, q)
    limits = torque_limits(model, file.torque)
    for joint in spec.joints:
        if joint.name not in designed:
            continue
        stiffness, damping = gains.get(
            joint.name, (designed[joint.name], SERVO_LAG * designed[joint.name])
        )
        k = model.joint(joint.name).id
        if model.dof_armature[model.jnt_dofadr[k]] <= 0.0:
            joint.armature = ARMATURE * stiffness
        actuator = spec.add_actuator(name=joint.name, target=joint.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = stiffness
        actuator.biasprm[1], actuator.biasprm[2] = -stiffness, -damping
        torque = float(limits[k - 1])
        if math.isfinite(torque):
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-torque, torque]


def design_stiffness(
    model: mujoco.MjModel, anatomy: Anatomy, q: np.ndarray
) -> dict[str, float]:
    """Return position gains for all joints [N m/rad], by joint.

    Legs and torso carry the body as an inverted pendulum: their gain is a multiple of
    m g c_z. Arms and head swing freely: theirs follows from the inertia they move.

    Args:
        model: The compiled model.
        anatomy: Its parts.
        q: The posture to design at.

    Returns:
        The gains.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    root = int(model.jnt_bodyid[0])
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    weight = model.body_subtreemass[root] * np.linalg.norm(model.opt.gravity)
    stiff = LEG_STIFFNESS * weight * data.subtree_com[root][2]
    carrying = {*(j for leg in anatomy.legs.values() for j in leg), *anatomy.torso}
    gains = {}
    for k in range(1, model.njnt):
        name = model.joint(k).name
        inertia = float(M[model.jnt_dofadr[k], model.jnt_dofadr[k]])
        free = ARM_FREQUENCY**2 * inertia
        gains[name] = float(
            f"{stiff if name in carrying else min(max(free, 2e-3 * stiff), stiff):.3g}"
        )
    return gains
