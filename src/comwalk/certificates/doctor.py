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
from ..pattern import Gait, make_pattern, plan_steps
from ..robot import LEGS, Kinematics, Robot
from ..robot.loaders import first_of
from ..sides import Side
from .defaults import default_gait, default_pendulum, similar_gait, walk_pattern
from .plan_check import Demand, Feasibility, feasibility
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
_STEPS = 4


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
        plan = plan_steps(gait, _STEPS, sole_size=robot.sole_size)
        result = feasibility(robot, make_pattern(plan, default_pendulum(robot)))
    except ComwalkError as error:
        return None, str(error)
    return result, None if result.ok else str(result.worst)


def findings(
    robot: Robot, walk: tuple[Feasibility | None, str | None] | None = None
) -> tuple[Finding, ...]:
    """Return what about a robot matters for walking, worst first.

    Args:
        robot: The robot.
        walk: What `default_walk` says of it, if it is known.

    Returns:
        What stops it, what is doubtful, and notes on what was changed or assumed.
    """
    result, fault = walk or default_walk(robot)
    found = [
        *_faults(robot, result, fault),
        *_ankles(robot),
        *(_friction(robot) if result is not None else ()),
        *_narrow(robot, result, fault),
        *_uneven(robot),
        *_units(robot),
        *_missing(robot),
        *_assumed(robot),
        *(Finding(NOTE, "", note) for note in robot.notes if _SOLE not in note),
    ]
    return tuple(sorted(found, key=lambda f: (STOPS, DOUBT, NOTE).index(f.level)))


def _faults(
    robot: Robot, result: Feasibility | None, fault: str | None
) -> Iterator[Finding]:
    """Yield why the robot does not walk."""
    stated = "half_step" in robot.profile.gait.values
    why = "no gait fits, not even stepping in place"
    if fault is None:
        return
    if result is None:
        yield Finding(STOPS, "", fault)
        return
    for demand in result.demands:
        if demand.share > 1.0:
            yield Finding(
                STOPS,
                demand.joint,
                _text(demand),
                "the profile states this gait" if stated else why,
                _CHANGES.get(demand.what, ""),
            )


_LIMITS = "state it under [limits] of a profile if the robot has more"
_CHANGES = dict.fromkeys(("position", "speed", "torque"), _LIMITS)
_SOLE = "a sole of usual proportions is assumed"


def _text(demand: Demand) -> str:
    if demand.what not in _CHANGES:
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
        if demand.share >= NEARLY and demand.what in ("torque", "speed", "position"):
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
    columns: dict[str, list[tuple[str, str, float, float]]] = {}
    for what, unit, left, right in _pairs(robot):
        most = max(abs(left), abs(right))
        if left != right and (np.isinf(most) or abs(left - right) > _ALIKE * most):
            columns.setdefault(f"{what} [{unit}]", []).append((what, unit, left, right))
    for name, rows in columns.items():
        _, _, left, right = max(rows, key=lambda row: abs(row[2] - row[3]))
        yield Finding(
            DOUBT,
            "left and right",
            f"{name} {left:.4g} and {right:.4g}",
            "it walks as the file says, which is often a slip",
            "correct the file if the robot is alike on both sides",
        )


def _pairs(robot: Robot) -> Iterator[tuple[str, str, float, float]]:
    """Yield what should be alike: name, unit, left and right."""
    m, anatomy, kinematics = robot.model, robot.anatomy, Kinematics(robot)
    kinematics.update(robot.home)
    anchors = kinematics.data.xanchor
    for part, limbs in (("leg", anatomy.legs), ("arm", anatomy.arms)):
        if len({len(limb) for limb in limbs.values()}) != 1 or len(limbs) != 2:
            continue
        pairs = zip(limbs[Side.LEFT], limbs[Side.RIGHT], strict=True)
        for left, right in ([robot.joints.index(n) for n in pair] for pair in pairs):
            masses = m.body_subtreemass[m.jnt_bodyid[[1 + left, 1 + right]]]
            yield f"mass of the {part}", "kg", float(masses[0]), float(masses[1])
            if part == "leg":
                torque, width = robot.torque, robot.upper - robot.lower
                yield "torque limit", "N m", float(torque[left]), float(torque[right])
                yield "joint range", "rad", float(width[left]), float(width[right])
        both = [anchors[[1 + robot.joints.index(n) for n in limbs[s]]] for s in Side]
        spans = [float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum()) for x in both]
        yield f"length of the {part}", "m", spans[0], spans[1]
    soles = [anatomy.soles[side].size for side in Side]
    for what, left, right in zip(("length", "width"), *soles, strict=True):
        yield f"{what} of the sole", "m", left, right


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
    columns = {"range": robot.upper - robot.lower, "speed": robot.speed}
    columns |= {"torque": robot.torque}
    for what, values in columns.items():
        names = [name for j, name in _leg_joints(robot) if np.isinf(values[j])]
        if names:
            yield Finding(
                DOUBT,
                names[0]
                if len(names) == 1
                else f"{names[0]} and {len(names) - 1} more",
                f"no {what} limit",
                f"whether a plan keeps to the {what} of the legs cannot be checked",
                "state it under [limits] of a profile",
            )


def _assumed(robot: Robot) -> Iterator[Finding]:
    """Yield soles that were made up."""
    notes = [note for note in robot.notes if _SOLE in note]
    for note in notes:
        yield Finding(
            DOUBT,
            "",
            note,
            "the true sole may be smaller",
            "state it under [soles] of a profile",
        )


def _leg_joints(robot: Robot) -> Iterator[tuple[int, str]]:
    """Yield place and name of the legs' joints."""
    for limb in robot.limbs:
        if limb.name in LEGS.values():
            for j in limb.joints:
                yield j, robot.joints[j]
