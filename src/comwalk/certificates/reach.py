"""Reach of the legs, and the motion of the whole body along a plan."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from ..control import (
    Actuation,
    BodySettings,
    ControlOutput,
    SimulatorSettings,
    Walkable,
)
from ..embedding import EmbeddedMotion, rotation_yaw
from ..errors import ModelError, PlanError
from ..pattern import PAPER_PENDULUM, Agility, OnlinePattern, Pattern, Phase, Stepping
from ..robot import (
    DOUBTED_FRICTION,
    LEGS,
    MOST_FRICTION,
    Kinematics,
    Robot,
    Skeleton,
)
from ..sides import Side
from ..walking import STRETCH, WholeBody

SOLE_GAP = 0.01
"""Smallest distance of the soles when they pass, for the paper's robot [m]."""
REACH_SHARE = 0.99
"""Share of a leg's whole length that a plan may use [-]."""


def leg_reaches(
    robot: Robot, pattern: Pattern
) -> dict[Side, tuple[float, float, float]]:
    """Return the leg lengths required while a foot is on the ground.

    The hips are taken where the CoM carries them in the walking posture, upright.

    Args:
        robot: The robot.
        pattern: The pattern.

    Returns:
        For each side the largest length needed [m], the length there is [m], and when
        it is needed [s].

    Raises:
        ModelError: If a leg has not six joints.
    """
    kinematics = Kinematics(robot)
    posture = kinematics.posture(robot.home)
    times = [
        time
        for span in pattern.phases
        if span.phase is not Phase.STAND or len(pattern.phases) == 1
        for time in (span.start, span.start + 0.5 * span.duration)
    ]
    reaches = {}
    for i, side in enumerate(Side):
        anchors = _joint_anchors(robot, kinematics, LEGS[side])
        hip = posture.rotation.T @ (anchors[0] - posture.com)
        ankle = posture.end_rotations[i].T @ (anchors[-1] - posture.ends[i])
        length = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
        needed = [(_needed(pattern, side, hip, ankle, t), t) for t in times]
        most, when = max(needed, key=lambda pair: pair[0])
        reaches[side] = most, REACH_SHARE * length, when
    return reaches


def least_width(robot: Robot) -> float:
    """Return the least distance of the feet at which soles do not meet [m].

    Args:
        robot: The robot.
    """
    r = round(robot.com_height, 3) / PAPER_PENDULUM.height
    return robot.sole_size[1] + SOLE_GAP * r


def stepping_of(robot: Robot) -> Stepping:
    """Return how far and how fast the feet of a robot may be taken to go.

    Its legs reach as far as they are long while the hips keep their height, as far
    behind as ahead; a foot swings at 2 m/s and for 0.3 s at least, to the scale of the
    paper's robot.

    Args:
        robot: The robot.

    Returns:
        Largest and least steps, for `pattern.largest_push`.

    Raises:
        ModelError: If a leg has not six joints.
    """
    kinematics = Kinematics(robot)
    kinematics.update(robot.home)
    anchors = [_joint_anchors(robot, kinematics, LEGS[side]) for side in Side]
    longest = REACH_SHARE * _leg_length(robot, kinematics)
    tall = max(x[0, 2] - x[-1, 2] for x in anchors)
    swings = math.sqrt(max(longest**2 - tall**2, 0.0))
    apart = float(np.linalg.norm(anchors[0][0, :2] - anchors[1][0, :2]))
    r = robot.com_height / PAPER_PENDULUM.height
    beside = least_width(robot)
    return Stepping(
        forward=2.0 * swings,
        aside=max(apart + swings, beside),
        beside=beside,
        foot_speed=2.0 * math.sqrt(r),
        least_time=0.3 * math.sqrt(r),
    )


def agility_of(robot: Robot) -> Agility:
    """Return what the legs of a robot can do to catch a fall.

    Args:
        robot: The robot.

    Returns:
        Reach of the legs, of which a seventh of their length may be lowered, and how
        fast a foot may swing: a fourth faster than `stepping_of`, at six times gravity.

    Raises:
        ModelError: If a leg has not six joints.
    """
    can, kinematics = stepping_of(robot), Kinematics(robot)
    kinematics.update(robot.home)
    anchors = _joint_anchors(robot, kinematics, LEGS[Side.LEFT])
    (sole,), _ = kinematics.sites(np.array([robot.feet[Side.LEFT].site]))
    com = kinematics.com
    hip = (anchors[0] - com) - (anchors[-1] - sole)
    length = _leg_length(robot, kinematics)
    return Agility(
        half=(_USED * 0.5 * robot.sole_size[0], _USED * 0.5 * robot.sole_size[1]),
        leg=STRETCH * length,
        tall=float(anchors[0, 2] - anchors[-1, 2]),
        hip=(float(hip[0]), float(hip[1])),
        lowest=_LOWERED * length,
        aside=can.aside,
        beside=can.beside,
        speed=1.25 * can.foot_speed,
        rush=6.0 * robot.gravity,
    )


_USED = 0.85  # share of the sole that the ZMP may use
_LOWERED = 0.15  # share of a leg's length


def adaptive(robot: Robot, pattern: Pattern) -> Walkable:
    """Return a pattern whose steps move to catch a fall, where the robot can do so.

    Args:
        robot: The robot.
        pattern: What is to be walked.

    Returns:
        The same pattern if its joints take positions, or if legs have not six joints.
    """
    legs = [limb for limb in robot.limbs if limb.name in LEGS.values()]
    whole = all(len(limb.joints) == 6 for limb in legs)
    if robot.servos is None or not whole:
        return pattern
    return OnlinePattern.of(pattern, agility=agility_of(robot))


def stance_stiffness(robot: Robot) -> dict[Side, np.ndarray]:
    r"""Return how stiffly each leg's servos hold the CoM over its foot.

    With the foot fixed, the joints of the leg move the CoM by :math:`G = J_{c,i} -
    J_{c,o} J_o^{-1} J_i`, with the Jacobians of the CoM and of the foot over the base
    (o) and the leg (i). A force at the CoM bends servos of stiffness K, and

    .. math:: k = 1 / (G K^{-1} G^T)_{ii}

    Gravity pulls a CoM at the height h with m g / h away from the foot: a robot that
    walks by position tips over by itself if k is less, and sways at
    :math:`\omega_n \sqrt{k h / (m g) - 1}` if it is more.

    Args:
        robot: The robot, in its home posture.

    Returns:
        k forward and to the left [N/m], (2,), by the side of the leg.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robot.home
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    J_c, J_p, J_r = (np.zeros((3, model.nv)) for _ in range(3))
    mujoco.mj_jacSubtreeCom(model, data, J_c, robot.base_body)
    found = {}
    for side in Side:
        mujoco.mj_jacSite(model, data, J_p, J_r, robot.feet[side].site)
        legs = (limb.joints for limb in robot.limbs if limb.name == LEGS[side])
        joints = list(next(legs))
        J, own = np.vstack([J_p, J_r]), [6 + j for j in joints]
        G = J_c[:2, own] - J_c[:2, :6] @ np.linalg.solve(J[:, :6], J[:, own])
        heading = data.site_xmat[robot.feet[side].site].reshape(3, 3)[:2, :2]
        G = heading.T @ G
        found[side] = 1.0 / np.sum(G * G / robot.servo.stiffness[joints], axis=1)
    return found


LEAST_STANCE = 1.5
"""Least stiffness of a stance leg over m g / h [-]. Below 1 the robot tips over by
itself; of six robots G1 still fell at 1.3, and none at 1.35 or more."""


def stance_ratio(robot: Robot) -> float | None:
    """Return the least stiffness of a stance leg over m g / h [-].

    Args:
        robot: The robot.

    Returns:
        Of both legs, forward and sideways; see `stance_stiffness`. None if torques hold
        the robot, whatever its gains.
    """
    if robot.actuation is not Actuation.POSITION:
        return None
    least = min(float(both.min()) for both in stance_stiffness(robot).values())
    return least * robot.com_height / (robot.mass * robot.gravity)


def friction_fault(
    robot: Robot | None,
    pattern: Pattern,
    physics: SimulatorSettings | None,
    body: BodySettings,
) -> str | None:
    """Return why joints resist too much to walk by torque, and what to change.

    Args:
        robot: The robot; None for the simplified model.
        pattern: What is to be walked.
        physics: Tells the friction that there is besides the file's; none if None.
        body: Tells what is known of it.

    Returns:
        None if they do not, if no step is made, or if stiff servos overcome it.
    """
    by_position = robot is None or robot.actuation is Actuation.POSITION
    if by_position or not pattern.plan.steps:
        return None
    more = 0.0 if physics is None else physics.joint_friction - body.known_friction
    own = DOUBTED_FRICTION * float(robot.model.dof_frictionloss[6:].max(initial=0.0))
    unknown = max(more, 0.0) + own
    width = robot.sole_size[1]
    most = MOST_FRICTION * robot.mass * robot.gravity * 0.5 * width
    if unknown <= most:
        return None
    told = ", a fifth of what the file tells," if own else ""
    known = f"body.known_friction {more + body.known_friction:.2g}"
    known = f"state what is known, such as {known}, or " if own <= most else ""
    return (
        f"joints with {unknown:.3g} N m of unknown friction{told} shift the ZMP too "
        f"far for soles of {1e3 * width:.0f} mm, which bear {most:.2g} N m by torque; "
        f"{known}walk by actuation position"
    )


def check_friction(
    robot: Robot,
    pattern: Pattern,
    physics: SimulatorSettings | None,
    body: BodySettings,
) -> None:
    """Refuse steps on joints that resist too much.

    Args:
        robot: The robot.
        pattern: What is to be walked.
        physics: Tells the friction that there is; none if None.
        body: Tells what is known of it.

    Raises:
        PlanError: Says what to change.
    """
    if (fault := friction_fault(robot, pattern, physics, body)) is not None:
        raise PlanError(f"{fault}; --force walks it all the same")


def _joint_anchors(robot: Robot, kinematics: Kinematics, name: str) -> np.ndarray:
    """Return the anchors of a leg's joints [m], world, of shape (n, 3)."""
    limb = next(limb for limb in robot.limbs if limb.name == name)
    joints = np.array(limb.joints) + 1
    lacks = Skeleton(robot.model, kinematics.data, robot.name).lacks(joints.tolist())
    if lacks:
        leg = name.replace("_", " ")
        raise ModelError(f"the {leg} of {robot.name} has {lacks}")
    return kinematics.data.xanchor[joints]


def _leg_length(robot: Robot, kinematics: Kinematics) -> float:
    """Return the length of the shorter leg, stretched [m]."""
    skeleton = Skeleton(robot.model, kinematics.data, robot.name)
    limbs = [limb for limb in robot.limbs if limb.name in LEGS.values()]
    return min(skeleton.leg_length([j + 1 for j in limb.joints]) for limb in limbs)


def _needed(
    pattern: Pattern, side: Side, hip: np.ndarray, ankle: np.ndarray, time: float
) -> float:
    """Return the distance of hip and ankle at a time [m]; 0 for a foot in the air."""
    reference = pattern.at(time)
    foot = reference.foot(side)
    if foot.position[2] != 0.0:
        return 0.0
    where = foot.position + rotation_yaw(foot.yaw) @ ankle
    R = rotation_yaw(reference.heading)
    return float(np.linalg.norm(reference.com + R @ hip - where))


_ON_ONE_FOOT = {Phase.SINGLE_LEFT: 1.0, Phase.SINGLE_RIGHT: 0.0}


class _Sweep(NamedTuple):
    """The reference of the whole body at n times."""

    times: np.ndarray  # (n,) [s]
    phases: np.ndarray  # (n,) index of the phase
    configurations: np.ndarray  # (n, 7 + joints)
    velocities: np.ndarray  # (n, 6 + joints), world axes
    loads: np.ndarray  # (n,) share of the left foot, None on two feet
    jacobians: np.ndarray  # (n, legs, 6, 6)


def _period(pattern: Pattern, period: float) -> float:
    swings = [step.single_support for step in pattern.plan.steps]
    return min([period, *(time / _SAMPLES_PER_SWING for time in swings)])


def _times(
    pattern: Pattern, motion: EmbeddedMotion | None, dt: float
) -> Iterator[tuple[float, int]]:
    """Yield times, and the index of the phase; few where nothing moves."""
    for i, span in enumerate(pattern.phases):
        still = span.phase is Phase.STAND and motion is None
        first = math.ceil(span.start / dt - 1e-9)
        last = math.ceil((span.start + span.duration) / dt - 1e-9)
        last = min(last, first + _STANDING) if still else last
        yield from ((k * dt, i) for k in range(first, last))


def _sweep(
    robot: Robot, pattern: Pattern, motion: EmbeddedMotion | None, dt: float
) -> _Sweep:
    """Follow the reference, without joint limits, until a posture is singular.

    The whole body steps by its rates (Euler); half of their change makes it a step of
    second order (Adams-Bashforth).
    """
    far = np.full(len(robot.joints), np.inf)
    free = dataclasses.replace(robot, lower=-far, upper=far, speed=far)
    free = dataclasses.replace(free, actuation=Actuation.POSITION)
    settings = BodySettings(deflection_compensation=False, imu=False, landing=0.0)
    body = WholeBody(free, dt, motion, settings)
    body.start(pattern.at(0.0))
    legs = [limb for limb in robot.limbs if limb.name in LEGS.values()]
    kinematics, rows = Kinematics(robot, LEGS.values()), []
    last, joints = np.zeros(6 + len(far)), () if motion is None else motion.joints
    dancing = [7 + robot.joints.index(joint) for joint in joints]
    for time, phase in _times(pattern, motion, dt):
        reference, q = pattern.at(time), body.configuration.copy()
        if motion is not None:  # without the errors of long steps
            q[dancing] = motion.at(time)[0]
        control = dataclasses.replace(
            ControlOutput.still(reference), u=reference.com_velocity[:2]
        )
        body.act(control, reference)
        v = body.velocity.copy()
        lead, last = 0.5 * (v - last), v
        body.configuration = kinematics.integrate(body.configuration, lead, dt)
        J = kinematics.posture(q).jacobian
        blocks = [J[3 + 6 * i : 9 + 6 * i, x.columns] for i, x in enumerate(legs)]
        damped = body.resolution is not None and body.resolution.damped
        if damped:  # its rates jump: no acceleration is made of them
            phase = -1
        load = _ON_ONE_FOOT.get(reference.phase)
        rows.append((time, phase, q, v, load, blocks))
        if damped:
            break
    return _Sweep(*(np.array(column) for column in zip(*rows, strict=True)))


_SAMPLES_PER_SWING = 20


_STANDING = 5  # samples of a phase in which nothing moves
