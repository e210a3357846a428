"""Variations of a footstep plan: shorter, slower, an excerpt."""

from __future__ import annotations

import dataclasses
import math
from itertools import groupby

from ..settings import settings_of
from ..sides import Side
from .footsteps import (
    Foothold,
    Footstep,
    FootstepPlan,
    _row,
    foot_poses,
    shortest_turn,
)


def shortened(plan: FootstepPlan, factor: float) -> FootstepPlan:
    """Return a plan with shorter, narrower and less turning steps.

    Each foothold, seen from the other foot, moves toward the place beside it.

    Args:
        plan: The plan.
        factor: Length of the steps, relative to the plan's, in [0, 1].

    Returns:
        The plan with the same sides and times.

    Raises:
        PlanError: If it cannot be walked.
    """
    start = _seen_from(plan.left, plan.right)
    apart = abs(start.y)
    feet = {Side.LEFT: plan.left}
    feet[Side.RIGHT] = plan.left.compose(_toward_side(start, -apart, factor))
    left, right, steps = *feet.values(), []
    old = {Side.LEFT: plan.left, Side.RIGHT: plan.right}
    for step in plan.steps:
        side, stance = step.side, step.side.other
        seen = _seen_from(old[stance], step.foothold)
        place = _toward_side(seen, side.sign * apart, factor)
        feet[side], old[side] = feet[stance].compose(place), step.foothold
        x, y, yaw = _row(feet[side])
        steps.append(dataclasses.replace(step, x=x, y=y, yaw=yaw))
    return dataclasses.replace(plan, left=left, right=right, steps=tuple(steps))


def slowed(plan: FootstepPlan, factor: float) -> FootstepPlan:
    """Return a plan whose steps, start and stop take longer.

    Args:
        plan: The plan.
        factor: Times, relative to the plan's; times stay within their ranges.

    Returns:
        The plan with the same footholds.
    """

    def times(owner: object, *names: str) -> dict[str, float]:
        spans = {name: settings_of(type(owner))[name].range for name in names}
        return {
            name: min(max(factor * getattr(owner, name), span.low), span.high)
            for name, span in spans.items()
        }

    names = ("single_support", "double_support")
    steps = [dataclasses.replace(step, **times(step, *names)) for step in plan.steps]
    ends = times(plan, "start_time", "stop_time")
    return dataclasses.replace(plan, steps=tuple(steps), **ends)


def excerpt(plan: FootstepPlan, first: int, last: int) -> FootstepPlan:
    """Return some of the steps of a plan, with a start and a stop of their own.

    Args:
        plan: The plan.
        first: Number of the first step, from 0; may be negative.
        last: Number of the step after the last one.

    Returns:
        A plan that starts where the feet then are.
    """
    first = min(max(first, 0), len(plan.steps))
    left, right = (Foothold(*pose) for pose in foot_poses(plan)[first].tolist())
    steps = plan.steps[first:last]
    closing = plan.closing if last >= len(plan.steps) and steps else 0
    return dataclasses.replace(
        plan, left=left, right=right, steps=steps, closing=closing
    )


def without_repeats(plan: FootstepPlan, keep: int) -> FootstepPlan:
    """Return a plan with fewer of the steps that only repeat those two before.

    A step repeats another if it is the same seen from the other foot, in place, time
    and height. Such steps are taken out in pairs, from the middle of each row of them.

    Args:
        plan: The plan.
        keep: How many of each row of repeating steps are left at least.

    Returns:
        The plan, what comes after a gap moved up to it; the same plan if none is.
    """
    seen = _seen_steps(plan)
    repeats = [k > 1 and _repeats(seen[k], seen[k - 2]) for k in range(len(seen))]
    left: list[Footstep] = []
    for again, row in groupby(zip(repeats, seen, strict=True), key=lambda x: x[0]):
        steps = [step for _, step in row]
        spare = 2 * ((len(steps) - keep) // 2) if again else 0
        if spare > 0:
            first = keep // 2
            steps = steps[:first] + steps[first + spare :]
        left += steps
    if len(left) == len(seen):
        return plan
    feet, steps = {Side.LEFT: plan.left, Side.RIGHT: plan.right}, []
    for step in left:
        place = feet[step.side.other].compose(step.foothold)
        feet[step.side] = place
        x, y, yaw = _row(place)
        steps.append(dataclasses.replace(step, x=x, y=y, yaw=yaw))
    return dataclasses.replace(plan, steps=tuple(steps))


def _seen_steps(plan: FootstepPlan) -> list[Footstep]:
    """Return the steps, each where it is seen from the other foot."""
    feet, seen = {Side.LEFT: plan.left, Side.RIGHT: plan.right}, []
    for step in plan.steps:
        x, y, yaw = _row(_seen_from(feet[step.side.other], step.foothold))
        seen.append(dataclasses.replace(step, x=x, y=y, yaw=yaw))
        feet[step.side] = step.foothold
    return seen


def _repeats(step: Footstep, other: Footstep) -> bool:
    rest = (step.side, step.single_support, step.double_support, step.swing_height)
    same = (other.side, other.single_support, other.double_support, other.swing_height)
    near = math.dist(_row(step.foothold), _row(other.foothold)) < 1e-9
    return near and rest == same and step.stand is None and other.stand is None


def _seen_from(foot: Foothold, other: Foothold) -> Foothold:
    dx, dy = other.x - foot.x, other.y - foot.y
    cos, sin = math.cos(foot.yaw), math.sin(foot.yaw)
    turn = shortest_turn(foot.yaw, other.yaw)
    return Foothold(cos * dx + sin * dy, cos * dy - sin * dx, turn)


def _toward_side(seen: Foothold, side: float, factor: float) -> Foothold:
    return Foothold(factor * seen.x, side + factor * (seen.y - side), factor * seen.yaw)
