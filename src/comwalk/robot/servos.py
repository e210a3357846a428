"""Position servos of a model: those of the file, or designed from mass and inertia.

Legs and torso carry the body as an inverted pendulum: their gain is a multiple of
m g c_z. Arms and head swing freely: theirs follows from the inertia they move. All
times are those of the paper's robot times the root of the CoM heights' ratio.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ..control import Actuation
from ..pattern import PAPER_PENDULUM
from .anatomy import Anatomy
from .loaders import first_of
from .profile import ServoGains

LEG_STIFFNESS = 22.0
"""Position gain of designed leg servos, in units of weight times CoM height [1/rad]."""

ARM_FREQUENCY = 50.0
"""Natural frequency of designed servos of the upper body [rad/s]."""

SERVO_LAG = 0.02
"""Velocity gain over position gain of designed servos [s]."""

ARMATURE = 1.8e-5
"""Rotor inertia at the joint over position gain, where the file has none [s^2]."""

SOFTEST = 5.0
"""Gain of a leg's servo, in units of weight times CoM height, under which a note
warns [1/rad]."""

PD_STIFFNESS, PD_ANKLES = 0.4, 0.4
"""Position gain of legs under torque, in units of weight times CoM height [1/rad], and
that of ankles as a share of it [-]."""

PD_FREQUENCY, PD_DAMPING = 60.0, 2.0
"""Natural frequency [rad/s] and damping [-] of a rotor alone on its gains under torque,
as current sim-to-real code chooses them for robots of this height."""

_PD_ARM, _PD_LEAST = 15.0, 0.05  # of free limbs [rad/s]; least gain, as `PD_STIFFNESS`
_LEAST = 2e-3  # smallest gain of an arm's servo, as a share of a leg's
_IDLE = 1e-3  # gains of a joint that follows another, as a share of the leader's
_SLIDE = 0.3  # lever by which a slide's gain stands for a hinge's, in CoM heights


@dataclass(frozen=True)
class Gains:
    """Gains of one joint's position servo."""

    stiffness: float
    """Position gain [N m/rad], of a slide [N/m]."""
    damping: float
    """Velocity gain [N m s/rad], of a slide [N s/m]."""

    def times(self, factor: float) -> Gains:
        """Return gains as many times as high."""
        return Gains(factor * self.stiffness, factor * self.damping)

    def over(self, given: ServoGains | None) -> Gains:
        """Return the gains with what a profile gives; damping follows stiffness."""
        if given is None:
            return self
        stiffness = self.stiffness if given.stiffness is None else given.stiffness
        damping = self.damping * (stiffness / self.stiffness)
        return Gains(stiffness, damping if given.damping is None else given.damping)


@dataclass(frozen=True)
class Design:
    """Servos designed for a robot."""

    gains: Mapping[str, Gains]
    """Gains by joint."""
    armature: float
    """Rotor inertia over position gain [s^2]."""
    weight: float
    """Weight times CoM height [N m], what legs balance."""
    quickness: float
    """Natural frequencies over those of a robot of the paper's height [-]."""


def given_gains(spec: mujoco.MjSpec) -> dict[str, Gains]:
    """Return the gains of the file's own position servos.

    Args:
        spec: The model.

    Returns:
        Gains at the joint, by joint, for joints that one position servo drives.
    """
    found: dict[str, Gains] = {}
    for actuator in spec.actuators:
        gear = float(actuator.gear[0]) ** 2
        stiffness = -float(actuator.biasprm[1]) * gear
        if stiffness > 0.0 and actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT:
            damping = max(0.0, -float(actuator.biasprm[2])) * gear
            found[actuator.target] = Gains(stiffness, damping)
    return found


def replaced_actuators(spec: mujoco.MjSpec) -> str:
    """Return a note on actuators that are no position servos; empty without any.

    Args:
        spec: The model.

    Returns:
        How many there are and what they become.
    """
    servos = given_gains(spec)
    others = [a.name or a.target for a in spec.actuators if a.target not in servos]
    if not others:
        return ""
    return f"{len(others)} motors get gains that comwalk designs: " + first_of(others)


def design_servos(model: mujoco.MjModel, anatomy: Anatomy, q: np.ndarray) -> Design:
    """Return position servos for all joints.

    Args:
        model: The compiled model.
        anatomy: Its parts.
        q: The posture to design at, the soles at z = 0.

    Returns:
        The servos.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    root = int(model.jnt_bodyid[0])
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    height = float(data.subtree_com[root][2])
    r = height / PAPER_PENDULUM.height
    weight = float(model.body_subtreemass[root] * np.linalg.norm(model.opt.gravity))
    stiff, arm = LEG_STIFFNESS * weight * height, ARM_FREQUENCY**2 / r
    carrying = {j for leg in anatomy.legs.values() for j in leg} | {*anatomy.torso}
    carrying |= {m.joint for m in anatomy.coupled if m.primary in carrying}
    gains = {}
    for k in range(1, model.njnt):
        name, column = model.joint(k).name, int(model.jnt_dofadr[k])
        slides = model.jnt_type[k] == int(mujoco.mjtJoint.mjJNT_SLIDE)
        most = stiff / (_SLIDE * height) ** 2 if slides else stiff
        free = min(max(arm * float(M[column, column]), _LEAST * most), most)
        stiffness = float(f"{most if name in carrying else free:.3g}")
        gains[name] = Gains(stiffness, SERVO_LAG * math.sqrt(r) * stiffness)
    for mimic in anatomy.coupled:
        lead = gains[mimic.primary]
        gains[mimic.joint] = lead.times(_IDLE)
        gains[mimic.primary] = lead.times(1.0 + mimic.ratio**2)
    return Design(gains, ARMATURE * r, weight * height, 1.0 / math.sqrt(r))


MOST_FRICTION = 0.12
"""Largest unknown dry friction of a robot that walks by torque, over m g times half a
sole's width [-]: it shifts the ZMP. Six robots walked with as much; at 0.135 G1 fell,
at 0.21 all of them."""

DOUBTED_FRICTION = 0.2
"""Share of the dry friction that a file tells that is not known well enough [-]."""


def suit_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    anatomy: Anatomy,
    q: np.ndarray,
    pd: tuple[float, float, float] | None,
    wanted: Actuation | None,
    stated: Collection[str] = (),
) -> tuple[Actuation, Anatomy]:
    """Give joints the servos that suit what they take.

    Args:
        spec: The model with its position servos, changed in place.
        model: The same, compiled.
        anatomy: Its parts.
        q: The walking posture.
        pd: Gains of all joints but ankles, of ankles [N m/rad], and velocity gain of
            all [N m s/rad], for joints that take torques; found if None.
        wanted: What the joints take. If None, positions where legs have gains of their
            own that hold the body without torques, or joints whose friction only stiff
            servos overcome, and else torques with gains about positions.
        stated: Joints whose gains a profile states; they stay.

    Returns:
        What the joints take; and the parts, with the joints whose servos are designed.
    """
    rubs, design = _rubs(model, anatomy), design_servos(model, anatomy, q)
    legs = {j for leg in anatomy.legs.values() for j in leg}
    usual = Actuation.PD
    if pd is None and (rubs or _are_stiff(spec, legs - {*anatomy.designed}, design)):
        usual = Actuation.POSITION
    takes = wanted or usual
    if takes is not Actuation.POSITION:
        _soften(spec, model, anatomy, design, pd)
    elif rubs and not _are_stiff(spec, legs, design):
        anatomy = _stiffen(spec, anatomy, design, stated)
    return takes, anatomy


def _rubs(model: mujoco.MjModel, anatomy: Anatomy) -> bool:
    """Return whether only stiff servos overcome the friction of the joints."""
    width = min(sole.size[1] for sole in anatomy.soles.values())
    mass, gravity = float(model.body_subtreemass[1]), abs(float(model.opt.gravity[2]))
    most = MOST_FRICTION * mass * gravity * 0.5 * width
    return DOUBTED_FRICTION * float(model.dof_frictionloss[6:].max(initial=0.0)) > most


def _are_stiff(spec: mujoco.MjSpec, joints: Collection[str], design: Design) -> bool:
    """Return whether joints have servos, all of which hold the body without torques."""
    gains = [-a.biasprm[1] for a in spec.actuators if a.target in joints]
    return min(gains, default=0.0) >= SOFTEST * design.weight


def _stiffen(
    spec: mujoco.MjSpec, anatomy: Anatomy, design: Design, stated: Collection[str]
) -> Anatomy:
    """Give legs and torso designed servos, but where a profile states the gains."""
    carrying = {*anatomy.torso, *(j for leg in anatomy.legs.values() for j in leg)}
    servos = [a for a in spec.actuators if a.target in carrying - {*stated}]
    for actuator in servos:
        set_gains(actuator, design.gains[actuator.target])
    made = dict.fromkeys((*anatomy.designed, *(a.target for a in servos)))
    return replace(anatomy, designed=tuple(made))


def _soften(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    anatomy: Anatomy,
    design: Design,
    pd: tuple[float, float, float] | None,
) -> None:
    """Give joints that torques are fed forward to the gains that builders choose.

    Gains of the file or the profile stay if the legs' are soft.
    """
    legs = {j for leg in anatomy.legs.values() for j in leg}
    ankles = {j for leg in anatomy.legs.values() for j in leg[-2:]}
    servos = [a for a in spec.actuators if a.target in design.gains]
    own = {a.target for a in servos if a.target in legs} - {*anatomy.designed}
    soft = bool(own) and not _are_stiff(spec, own, design)
    follows = {mimic.joint for mimic in anatomy.coupled}
    for actuator in servos:
        name = actuator.target
        if pd is not None:
            gains = Gains(pd[1] if name in ankles else pd[0], pd[2])
        elif soft and name not in anatomy.designed:
            continue
        else:
            gains = _pd_gains(model, name, design, name in legs, name in ankles)
        set_gains(actuator, gains.times(_IDLE) if name in follows else gains)


def _pd_gains(
    model: mujoco.MjModel, name: str, design: Design, leg: bool, ankle: bool
) -> Gains:
    """Return the gains of a joint under torque."""
    frequency = PD_FREQUENCY * design.quickness
    rotor = float(model.dof_armature[model.joint(name).dofadr[0]])
    most = PD_STIFFNESS * design.weight * (PD_ANKLES if ankle else 1.0)
    stiffness = min(rotor * frequency**2, most) if rotor > 0.0 else most
    if not leg:
        free = design.gains[name].stiffness * (_PD_ARM / ARM_FREQUENCY) ** 2
        stiffness = min(max(stiffness, free, _PD_LEAST * design.weight), most)
    return Gains(stiffness, 2.0 * PD_DAMPING / frequency * stiffness)


def add_servos(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    gains: Mapping[str, Gains],
    torque: Mapping[str, float],
    armature: float,
) -> None:
    """Give joints position servos.

    Args:
        spec: The model, without actuators.
        model: The same, compiled.
        gains: Gains by joint.
        torque: Torque limits [N m] of the joints that have one.
        armature: Rotor inertia over position gain [s^2], where the file has none.
    """
    for joint in [j for j in spec.joints if j.name in gains]:
        own = gains[joint.name]
        column = int(model.jnt_dofadr[model.joint(joint.name).id])
        if model.dof_armature[column] <= 0.0:
            joint.armature = armature * own.stiffness
        actuator = spec.add_actuator(name=joint.name, target=joint.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        _forget_defaults(actuator)
        set_gains(actuator, own)
        limit = torque.get(joint.name, 0.0)
        if 0.0 < limit < math.inf:
            set_torque(actuator, limit)


def _forget_defaults(actuator: mujoco.MjsActuator) -> None:
    """Take back what a file says of its motors in general: gears, ranges, dynamics."""
    never = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator.gear = np.eye(6)[0]
    actuator.ctrllimited = actuator.forcelimited = actuator.actlimited = never
    actuator.ctrlrange = actuator.forcerange = actuator.actrange = np.zeros(2)
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE


def set_gains(actuator: mujoco.MjsActuator, gains: Gains) -> None:
    """Make an actuator a position servo.

    Args:
        actuator: The actuator, without gear.
        gains: Its gains.
    """
    actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.gainprm[0] = gains.stiffness
    actuator.biasprm[1], actuator.biasprm[2] = -gains.stiffness, -gains.damping


def set_torque(actuator: mujoco.MjsActuator, limit: float) -> None:
    """Limit the torque of an actuator.

    Args:
        actuator: The actuator.
        limit: Largest torque [N m], both ways.
    """
    actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.forcerange = np.array([-limit, limit])


def soft_servos(
    design: Design, anatomy: Anatomy, given: Mapping[str, Gains], mass: float
) -> str:
    """Return a note on legs whose own servos are soft; empty if none is.

    Args:
        design: The servos designed for the robot.
        anatomy: Its parts.
        given: The file's own gains, by joint.
        mass: Mass of the robot [kg].

    Returns:
        The softest joint, and the natural frequency at which the body sways on it.
    """
    legs: Iterable[str] = (j for leg in anatomy.legs.values() for j in leg)
    own = {j: given[j].stiffness for j in legs if j in given}
    softest = min(own, key=own.__getitem__, default="")
    if not own or own[softest] >= SOFTEST * design.weight:
        return ""
    height = design.weight / (mass * 9.81)
    rest = own[softest] - design.weight
    sway = math.sqrt(max(rest, 0.0) / (mass * height**2)) / (2.0 * math.pi)
    how = f"the body sways at {sway:.1f} Hz" if rest > 0.0 else "the body sinks"
    return (
        f"the file's own servos are soft: {softest} has {own[softest]:.4g} N m/rad, on "
        f"which {how}: it walks by torque or, against much friction, on stiffer ones "
        "(--actuation)"
    )
