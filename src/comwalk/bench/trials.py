"""Trials as data: walks, dances, disturbances and the search for limits.

A `Case` says in a robot's own measures what is to be done, so that one list of cases
serves all robots; `perform` does it with one of them and returns plain numbers. A fall,
and a robot or a plan that comwalk refuses, are results like others.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..certificates import SIDE_STEP, default_gait
from ..config import DanceConfig, WalkConfig
from ..config_files import make_config
from ..control import End, Push
from ..errors import ComwalkError, ParameterError, PlanError
from ..pattern import (
    PAPER_GAIT,
    Gait,
    Pattern,
    Phase,
    foot_poses,
    make_pattern,
    plan_segments,
)
from ..robot import Robot, load_robot
from ..run import Run, plain
from ..setup import Setup, build_dance, build_walk
from ..sides import Side
from .cases import Case, Keys, RelativePush

# ---- The list ---------------------------------------------------------------------

TUNING_SEEDS, REPORT_SEEDS = range(20), range(100, 120)
"""Seeds of rough floors: to choose settings by, and to report. Nothing is ever chosen
by the second, so that what is reported holds for floors that nobody has seen."""


# ---- Doing it ---------------------------------------------------------------------


def perform(robot: str, case: Case) -> dict[str, Any]:
    """Do a case with a robot.

    Args:
        robot: Name or file of the robot.
        case: What to do.

    Returns:
        Plain numbers and names with units in their keys; "outcome" is "completed",
        "fell", "aborted" or "refused", and for a search "found".
    """
    try:
        return plain(_TASKS[case.task](robot, case))
    except ComwalkError as error:
        return {"outcome": "refused", "cause": str(error)}


def prepare(robot: str, case: Case) -> Setup:
    """Return the setup of a case.

    Args:
        robot: Name or file of the robot.
        case: A walk or a dance.

    Returns:
        Robot, pattern and settings.

    Raises:
        ComwalkError: If comwalk refuses the robot, the plan or a setting.
    """
    keys = {"robot": robot, "actuation": "position", **case.keys}
    if case.task == "dance":
        return build_dance(make_config(DanceConfig, tables_of(keys)))
    gait = gait_of(robot, case)
    keys |= {"steps": case.steps} | {f"gait.{k}": v for k, v in plain(gait).items()}
    setup = build_walk(make_config(WalkConfig, tables_of(keys)))
    if case.stops:
        pattern = stop_and_go(setup.pattern, gait, case.steps)
        setup = dataclasses.replace(setup, pattern=pattern)
    if case.push is not None and setup.robot is not None:
        push = push_of(case.push, setup.pattern, setup.robot.mass)
        physics = dataclasses.replace(setup.physics, pushes=(push,))
        setup = dataclasses.replace(setup, physics=physics)
    return setup


def tables_of(keys: Keys) -> dict[str, Any]:
    """Return dotted keys as tables in tables.

    Args:
        keys: Values by dotted key.

    Returns:
        What `make_config` takes.

    Example:
        >>> tables_of({"robot": "paper", "gains.zmp": 3.0, "gains.com": 6.6})
        {'robot': 'paper', 'gains': {'zmp': 3.0, 'com': 6.6}}
    """
    tables: dict[str, Any] = {}
    for key, value in keys.items():
        *path, name = key.split(".")
        table = tables
        for part in path:
            table = table.setdefault(part, {})
        table[name] = value
    return tables


@cache
def _loaded(robot: str) -> Robot:
    return load_robot(robot, actuation="position")


def _natural_gait(robot: str) -> Gait:
    return default_gait(_loaded(robot))


def gait_of(robot: str, case: Case) -> Gait:
    """Return the gait of a case in a robot's own measures.

    Args:
        robot: Name or file of the robot.
        case: A walk.

    Returns:
        The gait.

    Raises:
        ComwalkError: If the robot does not load, or the gait is out of range.
    """
    gait = _natural_gait(robot)
    size = gait.half_step / PAPER_GAIT.half_step
    if case.speed_ratio != 1.0:
        speed = case.speed_ratio * gait.speed
        return default_gait(_loaded(robot), speed=speed)
    return default_gait(
        _loaded(robot),
        half_step=case.forward * gait.half_step,
        lateral=case.sideways * SIDE_STEP * size,
        turn=case.turn,
    )


def stop_and_go(
    pattern: Pattern, gait: Gait, steps: int, pause: float = 2.0
) -> Pattern:
    """Return a walk that stops on the way with the feet side by side.

    Args:
        pattern: Uses its pendulum and the size of its soles.
        gait: The walk before and after.
        steps: Number of steps before, and after.
        pause: Time to stand still between them [s].

    Returns:
        The pattern.

    Raises:
        ComwalkError: If it cannot be walked.
    """
    segments = ((gait, steps), pause, (gait, steps))
    plan = plan_segments(segments, sole_size=pattern.plan.sole_size)
    return make_pattern(plan, pattern.pendulum)


def push_of(push: RelativePush, pattern: Pattern, mass: float) -> Push:
    """Return the force of a push.

    Args:
        push: When, where to and how hard.
        pattern: What is walked.
        mass: Of the robot [kg].

    Returns:
        The push, in the world.

    Raises:
        PlanError: If the walk has fewer steps.
    """
    singles = (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
    spans = [span for span in pattern.phases if span.phase in singles]
    if push.step > len(spans):
        raise PlanError(
            f"the push is in step {push.step}, and the plan has {len(spans)}; walk "
            "more steps"
        )
    span = spans[push.step - 1]
    start = span.start + push.share * span.duration
    outward = Side.LEFT.sign if span.phase is Phase.SINGLE_LEFT else Side.RIGHT.sign
    x, y = {
        "forward": (1.0, 0.0),
        "back": (-1.0, 0.0),
        "outward": (0.0, outward),
        "inward": (0.0, -outward),
    }[push.way]
    c, s = np.cos(heading := pattern.at(start).heading), np.sin(heading)
    f = mass * push.speed / push.duration
    force = (float(f * (c * x - s * y)), float(f * (s * x + c * y)), 0.0)
    return Push(start=start, force=force, duration=push.duration)


def figures_of(run: Run) -> dict[str, Any]:
    """Return the figures of a run, its settings and versions left out.

    Args:
        run: A run of a robot.

    Returns:
        The summary; with the length of the path that the middle of the feet is to go,
        and the error at its end as a share of it, unless the path is short.
    """
    figures = run.summary()
    for key in ("settings", "versions"):
        del figures[key]
    middles = foot_poses(run.pattern.plan)[:, :, :2].mean(axis=1)
    length = float(np.hypot(*np.diff(middles, axis=0).T).sum())
    if length > _PATH:
        figures["path_m"] = length
        figures["end_error_pct"] = 100.0 * figures["position_error_m"] / length
    return figures


_PATH = 0.3  # shortest path that an error can be a share of [m]


# ---- Searches ---------------------------------------------------------------------


class Limit(NamedTuple):
    """The limit at which a robot begins to fail."""

    value: float
    """The largest value found that does not fail."""
    cause: str
    """What fails just above; empty if nothing did up to the highest value."""
    tries: int
    """How many values were tried."""


def find_limit(
    fault: Callable[[float], str], low: float, high: float, tolerance: float
) -> Limit:
    """Return the largest value without a fault, by bisection.

    It is taken that what fails at one value fails at all larger ones.

    Args:
        fault: Returns what fails at a value, or an empty text.
        low: Lowest value; the limit if even that one fails.
        high: Highest value.
        tolerance: Largest distance of the limit from the first failure, above 0.

    Returns:
        The limit.

    Raises:
        ParameterError: If the tolerance is not above 0.

    Example:
        >>> find_limit(lambda x: "too much" if x > 2.0 else "", 0.0, 8.0, 0.01)
        Limit(value=2.0, cause='too much', tries=12)
    """
    if not tolerance > 0.0:
        raise ParameterError(f"tolerance must be above 0, got {tolerance:g}")
    if cause := fault(low):
        return Limit(low, cause, 1)
    if not (cause := fault(high)):
        return Limit(high, "", 2)
    tries = 2
    while high - low > tolerance:
        middle, tries = 0.5 * (low + high), tries + 1
        if found := fault(middle):
            high, cause = middle, found
        else:
            low = middle
    return Limit(low, cause, tries)


def fault_of(figures: Mapping[str, Any], *, limits: bool) -> str:
    """Return why a walk does not count as good, empty if it does.

    Args:
        figures: What `perform` returned.
        limits: Whether joint speeds and torques must stay inside their limits.

    Returns:
        The fault, empty if there is none.
    """
    if figures["outcome"] != "completed":
        return f"{figures['outcome']}: {figures['cause']}"
    if limits and figures["joint_speed_max_pct"] > 100.0:
        return f"speed of {figures['joint_speed_max_joint']}"
    if limits and figures["torque_saturation_pct"] > _SPIKES:
        return f"torque of {figures['torque_max_joint']}"
    return ""


_SPIKES = 1.0  # share of the time that a torque may be at its limit, at impacts [%]
_SLOWEST, _FASTEST = 0.25, 4.0  # [natural speeds]
_HARDEST = 2.0  # [m/s]


def _run(robot: str, case: Case) -> dict[str, Any]:
    """Do a walk or a dance; an interruption by the user is no result.

    A robot whose joints do not allow it makes smaller turns, and more of them, or
    smaller steps to the side.
    """
    try:
        run = prepare(robot, case).run()
    except PlanError:
        gentler = _gentler(case)
        if gentler is None:
            raise
        return _run(robot, gentler)
    if run.outcome.end is End.ABORTED and "by the user" in run.outcome.cause:
        raise KeyboardInterrupt
    return figures_of(run) | {"turn_deg": math.degrees(case.turn)}


def _gentler(case: Case) -> Case | None:
    """Return a case with half the turn or a smaller step to the side, if there is."""
    if abs(case.turn) >= _LEAST_TURN:
        return dataclasses.replace(case, turn=case.turn / 2, steps=2 * case.steps)
    if abs(case.sideways) > 0.5:
        return dataclasses.replace(case, sideways=0.7 * case.sideways)
    return None


_LEAST_TURN = math.radians(5.0)  # turn per step that is not halved further [rad]


def _find_speed(robot: str, case: Case) -> dict[str, Any]:
    """Find the largest speed inside the joints' limits."""

    def fault(speed_ratio: float) -> str:
        keys = {**case.keys, "force": True}  # physics is to tell, not the plan
        walk = dataclasses.replace(
            case, task="walk", speed_ratio=speed_ratio, keys=keys
        )
        return fault_of(perform(robot, walk), limits=True)

    natural = _natural_gait(robot)
    unit = natural.speed
    limit = find_limit(fault, _SLOWEST, _FASTEST, case.tolerance)
    return _found(limit, limit.cause and limit.value == _SLOWEST, speed_m_s=unit)


def _find_push(robot: str, case: Case) -> dict[str, Any]:
    """Find the largest push that is survived."""
    push = case.push or RelativePush(way="forward", share=0.0)

    def fault(speed: float) -> str:
        pushed = dataclasses.replace(push, speed=speed)
        walk = dataclasses.replace(case, task="walk", push=pushed)
        return fault_of(perform(robot, walk), limits=False)

    limit = find_limit(fault, 0.0, _HARDEST, case.tolerance)
    setup = prepare(robot, dataclasses.replace(case, task="walk"))
    start = setup.physics.pushes[0].start
    foot = setup.pattern.at(start).phase.name.lower().removeprefix("single_")
    failed = limit.cause and limit.value == 0.0
    return _found(limit, failed, push_m_s=1.0) | {"foot": foot, "start_s": start}


def _found(limit: Limit, failed: object, **unit: float) -> dict[str, Any]:
    """Return a limit as a result, its value in the unit's key."""
    ((key, scale),) = unit.items()
    return {
        "outcome": "failed" if failed else "found",
        key: 0.0 if failed else scale * limit.value,
        "cause": limit.cause,
        "tries": limit.tries,
    }


def _about(robot: str, case: Case) -> dict[str, Any]:
    """Describe a robot and its natural gait."""
    setup = prepare(robot, dataclasses.replace(case, task="walk"))
    gait, model = _natural_gait(robot), setup.robot
    mass, joints = (model.mass, len(model.joints)) if model else (0.0, 0)
    return {
        "outcome": "completed",
        "mass_kg": mass,
        "joints": joints,
        "com_height_m": setup.pattern.pendulum.height,
        "sole_mm": [1e3 * x for x in setup.pattern.plan.sole_size],
        "step_m": gait.step_length,
        "period_s": gait.period,
        "speed_m_s": gait.speed,
    }


_TASKS: dict[str, Callable[[str, Case], dict[str, Any]]] = {
    "walk": _run,
    "dance": _run,
    "speed": _find_speed,
    "push": _find_push,
    "about": _about,
}
