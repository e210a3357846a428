"""What about a robot will make it walk badly or not at all, worst first.

What a file says of a robot is looked at as a walk will need it: its own default gait is
tried, and what comes near a limit, is missing, is not alike on both sides or looks like
another unit is told before anything moves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..control import BodySettings
from ..errors import ComwalkError
from ..pattern import Gait
from ..robot import LEGS, Kinematics, Robot, fitted_note
from ..robot.loaders import first_of
from ..sides import Side
from .defaults import default_gait, demands_of_gait, similar_gait, walk_pattern
from .plan_check import Demand, Feasibility
from .reach import friction_fault

STOPS, DOUBT, NOTE = "stops", "doubt", "note"
"""Levels of a finding: it does not walk; it may walk badly; so it was handled."""
NEARLY = 0.9
"""Share of a limit from which too little is left for feedback [-]."""
_DENSITIES = 15.0, 1500.0  # mass over CoM height cubed [kg/m^3]: robots have 45 to 240
_TURN = 4.0 * np.pi  # wider ranges are not those of a joint in rad
_SPEEDS = 0.3, 100.0  # of a leg's joints [rad/s]
_STRONG = 10.0  # torques beyond this many m g c_z are no motor's
_ALIKE = 0.05  # by which left and right may differ [-]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a robot that matters for walking."""

    level: str
    """"stops", "doubt" or "note"."""
    where: str
    """Joints, links or part of the file; empty where the text names it."""
    what: str
    """What is so."""
    why: str = ""
    """Why it matters."""
    change: str = ""
    """What to change, and where."""

    def __str__(self) -> str:
        """Return it as one sentence."""
        text = f"{self.where}: {self.what}" if self.where else self.what
        return "; ".join(part for part in (text, self.why, self.change) if part)


def default_walk(robot: Robot) -> tuple[Feasibility | None, str | None]:
    """Return what the default gait asks of a robot.

    Args:
        robot: The robot.

    Returns:
        The demands of a few steps, None if there are no such steps, and why they cannot
        be walked, None if they can.
    """
    return _tried(robot, default_gait(robot))


def _tried(robot: Robot, gait: Gait) -> tuple[Feasibility | None, str | None]:
    """Return what a few steps ask of a robot, and why they cannot be walked."""
    try:
        result = demands_of_gait(robot, gait)
    except ComwalkError as error:
        return None, str(error)
    return result, None if result.ok else str(result.worst)


def findings(robot: Robot) -> tuple[Finding, ...]:
    """Return what about a robot matters for walking, worst first.

    Args:
        robot: The robot.

    Returns:
        What stops it, what is doubtful, and notes on what was changed or assumed.
    """
    result, fault = default_walk(robot)
    assumed = {fitted_note(k) for k, s in robot.anatomy.soles.items() if s.is_fitted}
    found = [
        *_faults(robot, result, fault),
        *_ankles(robot),
        *(_friction(robot) if result is not None else ()),
        *_narrow(robot, result, fault),
        *_uneven(robot),
        *_units(robot),
        *_missing(robot),
        *(Finding(DOUBT, "", n, *_ASSUMED) for n in robot.notes if n in assumed),
        *(Finding(NOTE, "", n) for n in robot.notes if n not in assumed),
    ]
    return tuple(sorted(found, key=lambda f: (STOPS, DOUBT, NOTE).index(f.level)))


def _faults(
    robot: Robot, result: Feasibility | None, fault: str | None
) -> Iterator[Finding]:
    """Yield why the robot does not walk."""
    if fault is None:
        return
    if result is None:
        yield Finding(STOPS, "", fault)
        return
    stated = "half_step" in robot.profile.gait.values
    why = "no gait fits, not even stepping in place"
    for demand in result.demands:
        if demand.share > 1.0:
            yield Finding(
                STOPS,
                demand.joint,
                _text(demand),
                "the profile states this gait" if stated else why,
                _LIMITS if demand.what in _OF_JOINTS else "",
            )


_LIMITS = "state it under [limits] of a profile if the robot has more"
_OF_JOINTS = "position", "speed", "torque"
_ASSUMED = "the true sole may be smaller", "state it under [soles] of a profile"


def _text(demand: Demand) -> str:
    if demand.what not in _OF_JOINTS:
        return f"the default gait: {demand}"
    used, there = f"{demand.demanded:.3g}", f"{demand.limit:.3g} {demand.unit}"
    return f"the default gait needs a {demand.what} of {used}, and {there} are there"


def _narrow(
    robot: Robot, result: Feasibility | None, fault: str | None
) -> Iterator[Finding]:
    """Yield what is nearly used up, and what makes the steps smaller than usual."""
    if result is None or fault is not None:
        return
    for demand in result.demands:
        if demand.share >= NEARLY and demand.what in _OF_JOINTS:
            left = f"{1.0 - demand.share:.0%} is left for feedback"
            yield Finding(DOUBT, demand.joint, _text(demand), left, _LIMITS)
    gait, usual = default_gait(robot), similar_gait(robot)
    if gait.speed < 0.99 * usual.speed and not robot.profile.gait.values:
        limit, why = _tried(robot, usual)
        share = f"the default gait is {gait.speed / usual.speed:.0%} of the usual speed"
        where = limit.worst.joint if limit is not None else ""
        yield Finding(DOUBT, where, f"{share}: {why}" if why else share)


def _ankles(robot: Robot) -> Iterator[Finding]:
    """Yield ankles too weak for the length of their soles."""
    weight, axes = robot.mass * robot.gravity, Kinematics(robot)
    axes.update(robot.home)
    for side in Side:
        sole, pair = robot.anatomy.soles[side], robot.anatomy.legs[side][-2:]
        joints = [robot.joints.index(name) for name in pair]
        pitch = max(joints[::-1], key=lambda j: abs(axes.data.xaxis[1 + j][1]))
        arm = robot.torque[pitch] / weight
        reach = 0.5 * sole.size[0] + abs(sole.ankle[0])
        if arm < 0.5 * reach:
            yield Finding(
                DOUBT,
                robot.joints[pitch],
                f"its torque bears the weight {1e3 * arm:.0f} mm from the ankle, and "
                f"the sole reaches {1e3 * reach:.0f} mm",
                "the rest of the sole cannot catch the robot",
                _LIMITS,
            )


def _friction(robot: Robot) -> Iterator[Finding]:
    """Yield friction that unsettles a walk by torque."""
    pattern = walk_pattern(robot, 1)
    if (text := friction_fault(robot, pattern, None, BodySettings())) is not None:
        yield Finding(STOPS, "", text)


def _uneven(robot: Robot) -> Iterator[Finding]:
    """Yield what differs between left and right."""
    widest: dict[str, tuple[float, float]] = {}
    for name, left, right in _pairs(robot):
        most, apart = max(abs(left), abs(right)), abs(left - right)
        if left == right or (apart <= _ALIKE * most and not np.isinf(most)):
            continue
        before = widest.setdefault(name, (left, right))
        if apart > abs(before[0] - before[1]):
            widest[name] = left, right
    for name, (left, right) in widest.items():
        yield Finding(
            DOUBT,
            "left and right",
            f"{name} {left:.4g} and {right:.4g}",
            "it walks as the file says, which is often a slip",
            "correct the file if the robot is alike on both sides",
        )


def _pairs(robot: Robot) -> Iterator[tuple[str, float, float]]:
    """Yield what should be alike: name with its unit, left and right."""
    m, anatomy, kinematics = robot.model, robot.anatomy, Kinematics(robot)
    kinematics.update(robot.home)
    anchors = kinematics.data.xanchor
    for part, limbs in (("leg", anatomy.legs), ("arm", anatomy.arms)):
        if len({len(limb) for limb in limbs.values()}) != 1 or len(limbs) != 2:
            continue
        pairs = zip(limbs[Side.LEFT], limbs[Side.RIGHT], strict=True)
        for left, right in ([robot.joints.index(n) for n in pair] for pair in pairs):
            masses = m.body_subtreemass[m.jnt_bodyid[[1 + left, 1 + right]]]
            yield f"mass of the {part} [kg]", float(masses[0]), float(masses[1])
            if part == "leg":
                torque, width = robot.torque, robot.upper - robot.lower
                yield "torque limit [N m]", float(torque[left]), float(torque[right])
                yield "joint range [rad]", float(width[left]), float(width[right])
        both = [anchors[[1 + robot.joints.index(n) for n in limbs[s]]] for s in Side]
        spans = [float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()) for x in both]
        yield f"length of the {part} [m]", spans[0], spans[1]
    soles = [anatomy.soles[side].size for side in Side]
    for what, left, right in zip(("length", "width"), *soles, strict=True):
        yield f"{what} of the sole [m]", left, right


def _units(robot: Robot) -> Iterator[Finding]:
    """Yield numbers that look like those of another unit."""
    density = robot.mass / robot.com_height**3
    if not _DENSITIES[0] <= density <= _DENSITIES[1]:
        yield Finding(
            DOUBT,
            "",
            f"{robot.mass:.3g} kg with a CoM height of {robot.com_height:.3g} m",
            "no robot is so light or heavy for its size: are masses in kg, and "
            "lengths in m",
        )
    strongest = _STRONG * robot.mass * robot.gravity * robot.com_height
    columns = {
        "a range": (robot.upper - robot.lower, 0.0, _TURN, "rad"),
        "a speed": (robot.speed, *_SPEEDS, "rad/s"),
        "a torque": (robot.torque, 0.0, strongest, "N m"),
    }
    for what, (values, low, high, unit) in columns.items():
        odd = [
            f"{name} {values[j]:.4g}"
            for j, name in _leg_joints(robot)
            if np.isfinite(values[j]) and not low <= values[j] <= high
        ]
        if odd:
            yield Finding(
                DOUBT,
                first_of(odd),
                f"{what} that no leg has, if it is in {unit}",
                "limits in other units do not hold the robot, or hold it too much",
                "correct them under [limits] of a profile, or in the file",
            )


def _missing(robot: Robot) -> Iterator[Finding]:
    """Yield limits that the legs do not have."""
    legs = {name for _, name in _leg_joints(robot)}
    for what, joints in missing_limits(robot).items():
        if names := [name for name in joints if name in legs]:
            yield Finding(
                DOUBT,
                first_of(names, 1),
                f"no {what} limit",
                f"whether a plan keeps to the {what} of the legs cannot be checked",
                "state it under [limits] of a profile",
            )


def missing_limits(robot: Robot) -> dict[str, list[str]]:
    """Return the joints that lack a limit, by its kind: range, speed, torque.

    Args:
        robot: The robot.
    """
    columns = {"range": robot.upper - robot.lower, "speed": robot.speed}
    columns |= {"torque": robot.torque}
    names = np.array(robot.joints)
    return {what: names[np.isinf(x)].tolist() for what, x in columns.items()}


def _leg_joints(robot: Robot) -> Iterator[tuple[int, str]]:
    """Yield place and name of the legs' joints."""
    for limb in robot.limbs:
        if limb.name in LEGS.values():
            for j in limb.joints:
                yield j, robot.joints[j]
