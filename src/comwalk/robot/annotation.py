"""From any model to one that walks: frames, sensors, servos, soles and a posture.

A model that was not made for comwalk gets what `robots/paper.xml` has: sites named
after REP-120, ankle sensors and an IMU, one position servo a joint, a contact box
under each foot and a keyframe "walk". Its own position servos are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..embedding import rotation_yaw
from ..errors import ModelError, one_line
from ..sides import Side
from .anatomy import Anatomy, find_anatomy
from .kinematic_tree import Skeleton, zero_posture
from .loaders import Mimic, ModelFile, first_key, quaternion_of, rotation_of
from .mimic import Coupling, couple
from .posture import Limbs, find_posture
from .profile import Profile
from .servos import (
    add_servos,
    design_servos,
    given_gains,
    replaced_actuators,
    soft_servos,
)
from .soles import Sole

_SOLE_HEIGHT = 0.013  # half height of a contact box, in leg lengths
_GRIP = {"friction": [1.0, 0.02, 0.001], "solref": [0.005, 1.0]}
"""How soles touch the ground: sliding, spinning, rolling; time [s] and damping."""
_FORWARD = "comwalk_forward"  # frame that turns what is in the base
_SITES = {
    *(f"{s}_{n}" for s in "lr" for n in ("sole", "ankle_ft", "gripper", "wrist")),
    *("l_sole_centre", "r_sole_centre", "imu", "torso", "gaze"),
}


def mark(file: ModelFile, profile: Profile | None = None) -> Anatomy:
    """Give a model all that walking needs.

    Args:
        file: The model; its spec is changed.
        profile: What a user knows better.

    Returns:
        Its parts.

    Raises:
        ModelError: If it is no humanoid, or cannot stand.
    """
    profile, name, spec = profile or Profile(), f"robot {file.path}", file.spec
    _name_geoms(spec)
    model = compile_model(spec, name)
    anatomy = find_anatomy(model, file.meshes, name, file.mimics, profile)
    zero = zero_posture(model, name, file.mimics)
    own = given_gains(spec)
    notes = [replaced_actuators(spec)]
    _lock(spec, zero, anatomy.locked, profile.home)
    _drop_what_drives(spec)
    solid = _mute(spec)
    _add_frames(spec, zero, anatomy)
    solid |= _soles_like(spec, anatomy, solid)
    _turn_base(spec, zero, anatomy.forward)
    couple_in_physics(spec, anatomy.coupled)
    model = compile_model(spec, name)
    try:
        q = find_posture(
            model,
            _limbs_of(model, anatomy),
            {j: q for j, q in profile.home.items() if j not in anatomy.locked},
            torque_limits(model, file.torque),
            profile.stance,
        )
    except ModelError as error:
        raise ModelError(f"{name}: {error}") from None
    design = design_servos(model, anatomy, q)
    gains = {
        joint: own.get(joint, designed).over(profile.servo.get(joint))
        for joint, designed in design.gains.items()
    }
    add_servos(spec, model, gains, file.torque, design.armature)
    spec.add_key(name="walk", qpos=q.tolist())
    mass = float(model.body_subtreemass[model.jnt_bodyid[0]])
    notes.append(soft_servos(design, anatomy, own, mass))
    made = tuple(j for j in gains if j not in own and gains[j] == design.gains[j])
    notes = [*anatomy.notes, *(note for note in notes if note)]
    return replace(anatomy, designed=made, solid=solid, notes=tuple(notes))


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
        raise ModelError(f"{name}: it does not compile: {one_line(error)}") from None
    types = model.jnt_type
    if model.njnt == 0 or types[0] != int(mujoco.mjtJoint.mjJNT_FREE):
        raise ModelError(
            f"{name}: it has no free joint at its root; add <freejoint/> to the "
            "first body"
        )
    simple = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for i in range(1, model.njnt):
        if int(types[i]) not in simple:
            raise ModelError(
                f'{name}: joint "{model.joint(i).name}" is neither hinge nor slide'
            )
    return model


# ---- What the file has ------------------------------------------------------------


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
    spec: mujoco.MjSpec,
    zero: Skeleton,
    joints: Iterable[str],
    home: Mapping[str, float],
) -> None:
    """Fix joints where a profile has them, else as in the zero posture."""
    model, locked = zero.model, set(joints)
    for joint in [j for j in spec.joints if j.name in locked]:
        place = int(model.jnt_qposadr[model.joint(joint.name).id])
        angle = home.get(joint.name, float(zero.data.qpos[place]))
        moved = angle - float(model.qpos0[place])
        if abs(moved) > 1e-9:
            _resolve(joint.parent, model)
            _move_body(joint, moved)
        spec.delete(joint)


def _resolve(body: mujoco.MjsBody, model: mujoco.MjModel) -> None:
    """Write the orientation of a body as a quaternion, however the file gives it."""
    quaternion = mujoco.mjtOrientation.mjORIENTATION_QUAT
    if body.frame is None and body.alt.type != quaternion:
        body.quat = model.body(body.name).quat.copy()
        body.alt.type = quaternion


def _move_body(joint: mujoco.MjsJoint, value: float) -> None:
    """Put the body of a joint where the joint, moved by a value, would have it."""
    body, axis = joint.parent, np.asarray(joint.axis, float)
    axis = axis / np.linalg.norm(axis)
    R = rotation_of(np.asarray(body.quat, float))
    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        body.pos = np.asarray(body.pos) + R @ (value * axis)
        return
    turn, moved, product = np.empty(4), np.empty(3), np.empty(4)
    mujoco.mju_axisAngle2Quat(turn, axis, value)
    pivot = np.asarray(joint.pos, float)
    mujoco.mju_rotVecQuat(moved, pivot, turn)
    mujoco.mju_mulQuat(product, np.asarray(body.quat, float), turn)
    body.pos = np.asarray(body.pos) + R @ (pivot - moved)
    body.quat = product


def _drop_what_drives(spec: mujoco.MjSpec) -> None:
    """Remove actuators, sensors and keyframes, and tendons, which pull on joints."""
    tied = (mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtEq.mjEQ_JOINT)
    bonds = [bond for bond in spec.equalities if bond.type in tied]
    for kind in (bonds, spec.actuators, spec.sensors, spec.keys, spec.tendons):
        for element in list(kind):
            spec.delete(element)


def _mute(spec: mujoco.MjSpec) -> dict[str, tuple[int, int]]:
    """Disable all collisions; the soles, added later, are the only contacts.

    Returns:
        Contype and conaffinity of the shapes that collided, by name.
    """
    types = {geom.name: (geom.contype, geom.conaffinity) for geom in spec.geoms}
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0
    for pair in list(spec.pairs):
        spec.delete(pair)
    return {name: own for name, own in types.items() if any(own)}


def _soles_like(
    spec: mujoco.MjSpec, anatomy: Anatomy, solid: Mapping[str, tuple[int, int]]
) -> dict[str, tuple[int, int]]:
    """Return contype and conaffinity of the soles: those that their feet had."""
    found = {}
    for sole in anatomy.soles.values():
        geoms = spec.body(sole.body).geoms
        own = [solid[geom.name] for geom in geoms if geom.name in solid] or [(1, 1)]
        contype, conaffinity = np.bitwise_or.reduce(own).tolist()
        found |= {g.name: (contype, conaffinity) for g in geoms if g.contype}
    return found


def couple_in_physics(spec: mujoco.MjSpec, mimics: Iterable[Mimic]) -> None:
    """Couple followers to their leaders in the simulator.

    Args:
        spec: The model, changed in place.
        mimics: Which joint follows which.
    """
    for mimic in mimics:
        bond = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=mimic.joint,
            name2=mimic.primary,
        )
        data = np.zeros_like(bond.data)
        data[:2] = mimic.offset, mimic.ratio
        bond.data, bond.solref = data, np.array(_GRIP["solref"])


def _turn_base(spec: mujoco.MjSpec, zero: Skeleton, forward: float) -> None:
    """Give the base axes that are x forward, z up in the zero posture."""
    base = spec.worldbody.first_body()
    R = rotation_yaw(forward).T @ zero.rotation(1)
    base.quat = np.array([1.0, 0.0, 0.0, 0.0])
    base.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    if np.allclose(R, np.eye(3), atol=1e-9):
        return
    _turn_inertia(base, zero.model.body(1), R)
    frame = base.add_frame(name=_FORWARD, quat=quaternion_of(R).tolist())
    for part in (*base.bodies, *base.geoms, *base.sites, *base.cameras, *base.lights):
        _put_in(part, frame)


def _put_in(part: Any, frame: mujoco.MjsFrame) -> None:
    """Put an element, or the outermost of the frames it is in, into a frame."""
    while part.frame is not None and part.frame.name != _FORWARD:
        part = part.frame
    if part.frame is None:
        part.set_frame(frame)


def _turn_inertia(base: mujoco.MjsBody, compiled: Any, R: np.ndarray) -> None:
    """Turn the inertia of the base, as the compiler has understood it."""
    turn, product = quaternion_of(R), np.empty(4)
    mujoco.mju_mulQuat(product, turn, compiled.iquat)
    base.explicitinertial, base.mass = True, float(compiled.mass[0])
    base.ipos, base.iquat = R @ compiled.ipos, product
    base.inertia, base.fullinertia = compiled.inertia, np.full(6, np.nan)
    base.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


# ---- What walking needs -----------------------------------------------------------


def _add_frames(spec: mujoco.MjSpec, zero: Skeleton, anatomy: Anatomy) -> None:
    """Add sites, contact boxes and sensors."""
    for site in [s for s in spec.sites if s.name in _SITES]:
        spec.delete(site)
    for side, sole in anatomy.soles.items():
        _add_foot(spec, zero, side, sole, anatomy.legs[side])
    upright = rotation_yaw(anatomy.forward)
    _add_upright(spec, zero, anatomy.imu, "imu", upright)
    if anatomy.torso:
        _add_upright(spec, zero, _body_of(zero, anatomy.torso), "torso", upright)
    for side, joints in anatomy.arms.items():
        body = _body_of(zero, joints)
        place = _welded_com(zero, body).tolist()
        spec.body(body).add_site(name=f"{side.value[0]}_gripper", pos=place, group=4)
    if anatomy.head:
        _add_upright(spec, zero, _body_of(zero, anatomy.head), "gaze", upright)
    _add_sensors(spec)


def _add_foot(
    spec: mujoco.MjSpec,
    zero: Skeleton,
    side: Side,
    sole: Sole,
    leg: tuple[str, ...],
) -> None:
    """Add the sole's contact boxes, its sites and that of the ankle sensor."""
    letter, body = side.value[0], spec.body(sole.body)
    R, r = sole.rotation, sole.position
    quat = quaternion_of(R).tolist()
    x, y, height = sole.ankle
    half = _SOLE_HEIGHT * zero.leg_length([zero.model.joint(j).id for j in leg])
    geoms = [geom for geom in spec.geoms if geom.name in sole.geoms]
    for k, (a, b, length, width) in enumerate(sole.boxes):
        box = body.add_geom(
            name=f"{letter}_sole_contact_{k}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * length, 0.5 * width, half],
            pos=(r + R @ [a, b, half]).tolist(),
            quat=quat,
            mass=0.0,
            group=3,
            rgba=[0.15, 0.16, 0.18, 1.0],
        )
        geoms.append(box)
    for geom in geoms:
        geom.contype, geom.conaffinity, geom.condim, geom.priority = 1, 0, 3, 1
        geom.friction, geom.solref = _GRIP["friction"], _GRIP["solref"]
    places = {"sole": (x, y, 0.0), "sole_centre": (0, 0, 0), "ankle_ft": (x, y, height)}
    for name, place in places.items():
        pos = (r + R @ np.array(place)).tolist()
        body.add_site(name=f"{letter}_{name}", pos=pos, quat=quat, group=4)


def _add_upright(
    spec: mujoco.MjSpec, zero: Skeleton, body: str, name: str, upright: np.ndarray
) -> None:
    """Add a site at a body's CoM that is upright in the zero posture, x forward."""
    R = zero.rotation(zero.model.body(body).id).T @ upright
    place, quat = _welded_com(zero, body).tolist(), quaternion_of(R).tolist()
    spec.body(body).add_site(name=name, pos=place, quat=quat, group=4)


def _welded_com(zero: Skeleton, body: str) -> np.ndarray:
    """Return the CoM of a body and what is fixed to it [m], in its frame, (3,)."""
    k = zero.model.body(body).id
    return zero.rotation(k).T @ (zero.centre(k) - zero.data.xpos[k])


def _body_of(zero: Skeleton, joints: tuple[str, ...]) -> str:
    return zero.model.body(zero.body_of(zero.model.joint(joints[-1]).id)).name


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
        soles={s: model.site(f"{s.value[0]}_sole_centre").id for s in Side},
        hands={s: model.site(f"{s.value[0]}_gripper").id for s in anatomy.arms},
        widths={s: anatomy.soles[s].size[1] for s in Side},
        coupling=coupling_of(model, anatomy.coupled),
    )


def coupling_of(model: mujoco.MjModel, mimics: Iterable[Mimic]) -> Coupling | None:
    """Return the coupling of a model's joints, the free joint of the base left out.

    Args:
        model: The compiled model.
        mimics: Which joint follows which.

    Returns:
        The coupling; None if nothing follows.
    """
    return couple(mimics, [model.joint(k).name for k in range(1, model.njnt)])


def torque_limits(model: mujoco.MjModel, torque: Mapping[str, float]) -> np.ndarray:
    """Return torque limits, infinite where a file gives none or zero.

    Args:
        model: The compiled model.
        torque: Limits [N m] by joint.

    Returns:
        Limits [N m], of shape (joints,).
    """
    names = [model.joint(k).name for k in range(1, model.njnt)]
    limits = np.array([torque.get(name, np.inf) for name in names])
    return np.where(limits > 0.0, limits, np.inf)


def home_of(model: mujoco.MjModel, path: Path, profile: Profile) -> np.ndarray:
    """Return the configuration of the keyframe "walk", or of the first one.

    Args:
        model: The compiled model.
        path: Its file, for messages.
        profile: Angles that are to be otherwise.

    Returns:
        MuJoCo's qpos, of shape (7 + joints,).

    Raises:
        ModelError: If there is no keyframe, or a joint in it is out of its range.
    """
    key = first_key(model)
    if key < 0:
        raise ModelError(
            f'robot {path}: it has no keyframe: add <key name="walk" qpos="..."/> with '
            "bent knees"
        )
    name, q = model.key(key).name, model.key_qpos[key].copy()
    if not np.isfinite(q).all():
        raise ModelError(
            f'robot {path}: keyframe "{name}" holds something that is no number'
        )
    if profile.home:
        q, name = _with_angles(model, q, profile), "walk of the profile"
    low, high = model.jnt_range[1:, 0] - 1e-6, model.jnt_range[1:, 1] + 1e-6
    past = (model.jnt_limited[1:] > 0) & ((q[7:] < low) | (q[7:] > high))
    if past.any():
        j = int(np.flatnonzero(past)[0])
        raise ModelError(
            f'robot {path}: keyframe "{name}" has joint "{model.joint(j + 1).name}" at '
            f"{q[7 + j]:.4g} rad, outside its range [{low[j]:.4g}, {high[j]:.4g}]"
        )
    return q


def _with_angles(model: mujoco.MjModel, q: np.ndarray, profile: Profile) -> np.ndarray:
    """Return a configuration with other angles, its lower sole as high as before."""
    data, sites = mujoco.MjData(model), []
    q, sites = q.copy(), [model.site(f"{s.value[0]}_sole").id for s in Side]

    def lowest() -> float:
        """Return the height of the lower sole [m]."""
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        return float(data.site_xpos[sites, 2].min())

    before = lowest()
    for joint, angle in profile.home.items():
        q[model.joint(joint).qposadr[0]] = angle
    q[2] += before - lowest()
    return q
