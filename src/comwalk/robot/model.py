"""A robot: its limbs, soles, limits and servos, from any humanoid, Eq. (14), (21).

Frames have their REP-120 names (`l_sole`, `r_gripper`, `gaze`, ...), which a file gives
or `annotation` adds; limbs are the tree between them and the floating base.
`Kinematics` turns a configuration into a `Posture` with MuJoCo's kinematics in C.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..control import Actuation, JointServos
from ..embedding import Damping, JointLimit, Limb
from ..errors import ModelError, ParameterError, checked_number
from ..sides import Side
from .anatomy import Anatomy
from .annotated import Role, find_roles, is_marked, read_marks
from .annotation import compile_model, couple_in_physics, coupling_of, home_of, mark
from .kinematic_tree import Skeleton
from .loaders import ModelFile, World, place_world, profile_of_known, read_model
from .mimic import Coupling
from .profile import Profile, ServoGains, check_names, read_profile
from .servos import Gains, set_gains, set_torque, suit_servos

LEGS = {Side.LEFT: "left_leg", Side.RIGHT: "right_leg"}
"""Names of the two legs among a robot's limbs."""

_PAPER_COM_HEIGHT = 0.687  # [m]

# Limb, and the REP-120 frames (sites) that may mark its end, best first.
_ENDS = {
    "left_leg": ("l_sole_centre",),
    "right_leg": ("r_sole_centre",),
    "torso": ("torso",),
    "left_arm": ("l_gripper", "l_wrist"),
    "right_arm": ("r_gripper", "r_wrist"),
    "head": ("gaze",),
}
_BY_MARKED = (
    "home",
    "limits",
    "servo",
    "gait",
    "gains",
    "control",
    "pendulum",
)  # what marked models take of a profile


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot: its sole on the ground and its ankle sensor."""

    sole: np.ndarray
    """Corners of the sole [m] about its centre, counter-clockwise, of shape (k, 2)."""
    site: int
    """Site at the sole's centre: x forward, z up, on the contact surface."""
    sensor_site: int
    """Site of the ankle's force/torque sensor."""
    mass: float
    """Mass below the sensor [kg]."""
    com: np.ndarray
    """CoM of that mass [m], in the frame of the sensor's site, of shape (3,)."""


@dataclass(frozen=True, eq=False)
class Servo:
    """Joint position servos: torque = stiffness (q_set - q) - damping dq."""

    stiffness: np.ndarray
    """Position gain [N m/rad], of shape (joints,)."""
    damping: np.ndarray
    """Velocity gain, with the joint's own damping [N m s/rad], of shape (joints,)."""
    actuators: np.ndarray
    """Actuator of each joint, of shape (joints,)."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A humanoid as the controller knows it. Made by `load_robot`."""

    name: str
    """Name, for tables and folders."""
    spec: mujoco.MjSpec
    """The editable model, without floor or light."""
    model: mujoco.MjModel
    """The compiled model that kinematics run on."""
    joints: tuple[str, ...]
    """Names of the joints, in the order of qdot."""
    limbs: tuple[Limb, ...]
    """Legs, torso, arms, head: parents before children."""
    ends: tuple[int, ...]
    """Site at the end of each limb, -1 if none is marked."""
    feet: dict[Side, Foot]
    """The feet."""
    servo: Servo
    """The position servos."""
    lower: np.ndarray
    """Lower joint limits [rad], of shape (joints,)."""
    upper: np.ndarray
    """Upper joint limits [rad], of shape (joints,)."""
    speed: np.ndarray
    """Speed limits [rad/s], inf where the model gives none, of shape (joints,)."""
    torque: np.ndarray
    """Torque limits [N m], inf where the model gives none, of shape (joints,)."""
    home: np.ndarray
    """Configuration in the walking posture, MuJoCo's qpos, of shape (7 + joints,)."""
    anatomy: Anatomy
    """Its parts, and what was found out about them."""
    roles: dict[str, Role]
    """Which joint does what in a dance, and its sign, such as "l_shoulder_pitch"."""
    notes: tuple[str, ...] = ()
    """What was repaired, assumed or left out, a line each."""
    coupling: Coupling | None = None
    """Joints that follow others, None if none does."""
    profile: Profile = field(default_factory=Profile)
    """What its profile says, and what it walks with by default."""
    actuation: Actuation = Actuation.POSITION
    """What its joints take."""
    world: World | None = None
    """What its file holds around it; None for a level floor at most."""

    @property
    def servos(self) -> JointServos | None:
        """Gains of the joints if they take torques; None if positions alone."""
        n, gains = len(self.joints), self.servo
        if self.actuation is Actuation.POSITION:
            return None
        if self.actuation is Actuation.TORQUE:
            return JointServos(np.zeros(n), np.zeros(n))
        passive = self.model.dof_damping[6:]
        return JointServos(gains.stiffness, gains.damping - passive)

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(self.model.body_subtreemass[self.base_body])

    @property
    def gravity(self) -> float:
        """Gravitational acceleration of the model [m/s^2]."""
        return float(np.linalg.norm(self.model.opt.gravity))

    @property
    def base_body(self) -> int:
        """Body of the body center, the one with the free joint."""
        return int(self.model.jnt_bodyid[0])

    @property
    def imu_site(self) -> int:
        """Site of the IMU, on the trunk."""
        return int(self.model.site("imu").id)

    @cached_property
    def _stance(self) -> tuple[float, float]:
        data, base = mujoco.MjData(self.model), self.base_body
        data.qpos[:] = self.home
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        left, right = (data.site_xpos[self.feet[side].site] for side in Side)
        width = float(np.hypot(*(left - right)[:2]))
        height = data.subtree_com[base, 2] - 0.5 * (left[2] + right[2])
        return float(height), width

    @property
    def com_height(self) -> float:
        """Height of the CoM above the soles in the walking posture [m]."""
        return self._stance[0]

    @property
    def damping(self) -> Damping:
        """Damping of its resolution, that of the paper's robot to scale."""
        usual = Damping().threshold
        return Damping(threshold=usual * self.com_height / _PAPER_COM_HEIGHT)

    @property
    def omega(self) -> float:
        """sqrt(g / c_z) of its walking posture [rad/s]."""
        return math.sqrt(self.gravity / self.com_height)

    @property
    def stance_width(self) -> float:
        """Distance of the soles' centres in the walking posture [m]."""
        return self._stance[1]

    @property
    def sole_size(self) -> tuple[float, float]:
        """Length and width [m] of the larger sole about its centre."""
        extents = [2.0 * np.abs(foot.sole).max(axis=0) for foot in self.feet.values()]
        length, width = np.max(extents, axis=0).round(9).tolist()
        return length, width

    @property
    def home_angles(self) -> dict[str, float]:
        """Joint angles of the walking posture [rad], by joint."""
        return dict(zip(self.joints, self.home[7:].tolist(), strict=True))

    @property
    def joint_limits(self) -> dict[str, JointLimit]:
        """Limits by joint."""
        columns = (self.lower.tolist(), self.upper.tolist(), self.speed.tolist())
        rows = zip(self.joints, *columns, strict=True)
        return {name: JointLimit(*limits) for name, *limits in rows}

    @property
    def upper_body(self) -> tuple[str, ...]:
        """Names of the joints outside the legs: those that may dance."""
        fixed = {j for x in self.limbs if x.name in LEGS.values() for j in x.joints}
        if self.coupling is not None:
            fixed |= set(self.coupling.followers.tolist())
        return tuple(n for j, n in enumerate(self.joints) if j not in fixed)


def load_robot(
    source: str | Path = "paper",
    *,
    stiffness: float = 1.0,
    profile: str | Path | Mapping[str, Any] | None = None,
    geometry: bool = False,
    actuation: Actuation | str | None = None,
    pd: tuple[float, float, float] | None = None,
) -> Robot:
    """Load a robot by name, or from a URDF or MJCF file.

    Args:
        source: Name of a known robot, or path of a file.
        stiffness: Factor on the servos' position and velocity gains, in (0, 100].
        profile: TOML file, or table of its keys, that tells what cannot be seen in
            the robot's file, or is to be otherwise; see `profile.Profile`.
        geometry: Whether meshes are loaded, for pictures; nothing else depends on it.
        actuation: What its joints take; as its data suggest if None.
        pd: Gains under torque instead of its own: of all joints but ankles, of ankles
            [N m/rad], and the velocity gain of all [N m s/rad].

    Returns:
        The robot.

    Raises:
        ModelError: If the name is unknown, the file is missing or broken, or it is
            no humanoid that can stand.
        ParameterError: If the stiffness is out of range, or the profile is wrong.
    """
    factor = checked_number(
        "stiffness", stiffness, low=0, high=100, open_low=True, hint="1 is the default"
    )
    own = read_profile(profile_of_known(source))
    told = read_profile(profile).over(own)
    file = read_model(source, geometry=geometry)
    joints = [j.name for j in file.spec.joints if j.type != mujoco.mjtJoint.mjJNT_FREE]
    check_names(told, joints, [body.name for body in file.spec.bodies[1:]])
    _set_limits(file, told)
    _set_armature(file.spec, told.servo)
    marked = is_marked(file.spec)
    anatomy = _read_marked(file, told) if marked else mark(file, told)
    model = compile_model(file.spec, f"robot {file.path}")
    home = home_of(model, file.path, told if marked else Profile())
    wanted = None if actuation is None else Actuation(actuation)
    takes, anatomy = suit_servos(
        file.spec, model, anatomy, home, pd, wanted, told.servo
    )
    for actuator in file.spec.actuators:
        actuator.gainprm[0] *= factor
        actuator.biasprm[1] *= factor
        actuator.biasprm[2] *= factor
    return _robot_of(file, anatomy, told, takes)


def _set_limits(file: ModelFile, profile: Profile) -> None:
    """Give joints the limits that a profile gives."""
    for joint in file.spec.joints:
        limits = profile.limits.get(joint.name)
        if limits is None:
            continue
        if limits.speed is not None:
            file.speed[joint.name] = limits.speed
        if limits.torque is not None:
            file.torque[joint.name] = limits.torque
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        if limits.lower is None and limits.upper is None:
            continue
        low, high = _range_of(file.spec, joint)
        low = low if limits.lower is None else limits.lower
        high = high if limits.upper is None else limits.upper
        degrees = 180.0 / np.pi if file.spec.compiler.degree else 1.0
        hinge = joint.type == mujoco.mjtJoint.mjJNT_HINGE
        joint.range = np.array([low, high]) * (degrees if hinge else 1.0)
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE


def _set_armature(spec: mujoco.MjSpec, servos: Mapping[str, ServoGains]) -> None:
    """Give joints the rotor inertias that a profile gives, before servos are added."""
    for joint in spec.joints:
        if joint.name in servos and servos[joint.name].armature is not None:
            joint.armature = servos[joint.name].armature


def _range_of(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> tuple[float, float]:
    """Return the range of a joint [rad], very wide if it has none."""
    compiled = compile_model(spec.copy(), "the robot").joint(joint.name)
    if not compiled.limited[0]:
        return -100.0, 100.0
    return float(compiled.range[0]), float(compiled.range[1])


def _read_marked(file: ModelFile, profile: Profile) -> Anatomy:
    """Return the anatomy of a model that marks its frames; a profile says the rest."""
    wrong = [key for key in profile.given if key not in _BY_MARKED]
    if wrong:
        raise ParameterError(
            f"profile: {file.path} marks its frames itself, so that a profile can say "
            f"{', '.join(_BY_MARKED)}, but not {wrong[0]}"
        )
    anatomy = read_marks(file.spec, file.path, file.mimics)
    couple_in_physics(file.spec, anatomy.coupled)
    for actuator in file.spec.actuators:
        name = actuator.target
        if name in profile.servo:
            own = Gains(actuator.gainprm[0], -actuator.biasprm[2])
            set_gains(actuator, own.over(profile.servo[name]))
        limits = profile.limits.get(name)
        if limits is not None and limits.torque is not None:
            set_torque(actuator, limits.torque)
    return anatomy


def _robot_of(
    file: ModelFile, anatomy: Anatomy, profile: Profile, actuation: Actuation
) -> Robot:
    """Return the robot of a model that has all that walking needs."""
    model, path = compile_model(file.spec, f"robot {file.path}"), file.path
    joints = tuple(model.joint(i).name for i in range(1, model.njnt))
    limbs, ends = _find_limbs(model, anatomy)
    home = home_of(model, path, profile if anatomy.marked else Profile())
    servo = _read_servo(model, joints, path)
    ranges = np.where(
        model.jnt_limited[1:, None] > 0, model.jnt_range[1:], [[-np.inf, np.inf]]
    )
    speed = np.array([file.speed.get(j, np.inf) for j in joints])
    limits = ranges[:, 0], ranges[:, 1], speed
    coupling = coupling_of(model, anatomy.coupled)
    if coupling is not None:
        limits = coupling.limits(*limits)
    world = _world_of(file, anatomy)
    notes = (*file.notes, *anatomy.notes, *([] if world is None else [world.note]))
    return Robot(
        name=file.name,
        spec=file.spec,
        model=model,
        joints=joints,
        limbs=limbs,
        ends=ends,
        feet={side: _read_foot(model, side, anatomy) for side in Side},
        servo=servo,
        lower=limits[0],
        upper=limits[1],
        speed=limits[2],
        torque=_torque_limits(model, servo),
        home=home,
        anatomy=anatomy,
        roles=find_roles(model, home, anatomy),
        notes=notes,
        coupling=coupling,
        profile=profile,
        actuation=actuation,
        world=world,
    )


def _world_of(file: ModelFile, anatomy: Anatomy) -> World | None:
    """Return what a file holds around its robot, as the robot sees it."""
    if file.around is None:
        return None
    forward = None if anatomy.marked else anatomy.forward
    soles = [(sole.body, sole.position) for sole in anatomy.soles.values()]
    return place_world(file.around, forward, soles)


def _read_foot(model: mujoco.MjModel, side: Side, anatomy: Anatomy) -> Foot:
    """Return a foot from its sites."""
    letter = side.value[0]
    sole = model.site(f"{letter}_sole").id
    names = [model.site(i).name for i in range(model.nsite)]
    sensor_name = f"{letter}_ankle_ft"
    sensor = names.index(sensor_name) if sensor_name in names else sole
    body = int(model.site_bodyid[sensor])
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    arm = data.subtree_com[body] - data.site_xpos[sensor]
    return Foot(
        sole=anatomy.soles[side].polygon,
        site=model.site(f"{letter}_sole_centre").id,
        sensor_site=sensor,
        mass=float(model.body_subtreemass[body]),
        com=data.site_xmat[sensor].reshape(3, 3).T @ arm,
    )


def _find_limbs(
    model: mujoco.MjModel, anatomy: Anatomy
) -> tuple[tuple[Limb, ...], tuple[int, ...]]:
    """Return the limbs and the sites of their ends, -1 where none is marked.

    The torso carries the limbs whose joints come after its own; what is in no limb
    makes the limb "rest".
    """
    parts = {LEGS[side]: anatomy.legs[side] for side in Side}
    parts |= {"torso": anatomy.torso}
    parts |= {f"{side}_arm": anatomy.arms.get(side, ()) for side in Side}
    parts |= {"head": anatomy.head}
    index = {model.joint(i).name: i - 1 for i in range(1, model.njnt)}
    look, limbs = Skeleton(model, mujoco.MjData(model), ""), []
    for name, joints in parts.items():
        if joints:
            own = tuple(index[j] for j in joints)
            path = look.names(look.chain(look.body_of(own[-1] + 1)))
            carried = name != "torso" and {*anatomy.torso} & {*path}
            parent = "torso" if carried else None
            limbs.append(Limb(name=name, joints=own, parent=parent))
    used = {j for limb in limbs for j in limb.joints}
    rest = tuple(j for j in index.values() if j not in used)
    if rest:
        limbs.append(Limb(name="rest", joints=rest))
    sites = {model.site(i).name: i for i in range(model.nsite)}
    ends = [
        next((sites[frame] for frame in _ENDS.get(x.name, ()) if frame in sites), -1)
        for x in limbs
    ]
    return tuple(limbs), tuple(ends)


def _read_servo(model: mujoco.MjModel, joints: Iterable[str], path: Path) -> Servo:
    """Return the position servo of each joint."""
    actuators = []
    for i, name in enumerate(joints, start=1):
        driving = [
            a
            for a in range(model.nu)
            if model.actuator_trnid[a, 0] == i
            and model.actuator_trntype[a] == int(mujoco.mjtTrn.mjTRN_JOINT)
            and model.actuator_biasprm[a, 1] < 0
        ]
        if len(driving) != 1:
            raise ModelError(
                f'robot {path}: joint "{name}" has {len(driving)} position actuators; '
                f'add <position joint="{name}" kp="..." kv="..."/>'
            )
        actuators.append(driving[0])
    index = np.array(actuators)
    return Servo(
        stiffness=model.actuator_gainprm[index, 0].copy(),
        damping=-model.actuator_biasprm[index, 2] + model.dof_damping[6:],
        actuators=index,
    )


def _torque_limits(model: mujoco.MjModel, servo: Servo) -> np.ndarray:
    limited = model.actuator_forcelimited[servo.actuators] > 0
    return np.where(limited, model.actuator_forcerange[servo.actuators, 1], np.inf)
