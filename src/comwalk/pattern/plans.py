"""Footstep plans: of regular gaits with pauses between them, shorter, slower, cut."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import groupby

from ..errors import ParameterError, PlanError, checked_count
from ..settings import settings_of
from ..sides import Side
from .footsteps import (
    MAX_STEPS,
    PAPER_SOLE,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
    _row,
    foot_poses,
    shortest_turn,
)

_Walk = tuple["Gait", int]


_Segments = Sequence[_Walk | float]


def plan_steps(
    gait: Gait,
    steps: int,
    *,
    first: Side | None = None,
    sole_size: tuple[float, float] = PAPER_SOLE,
) -> FootstepPlan:
    """Return a regular walk: straight, back, sideways, in a curve or on the spot.

    The body goes 2B forward, `lateral` sideways and `turn` around per step, and the
    feet follow at +-A beside it; one more step brings them together, if they are not.

    Args:
        gait: Step lengths [m], turn [rad] and times [s].
        steps: Number of steps without the closing one, in [1, 100000].
        first: The foot that swings first; by default the one on the side to which the
            body shifts or turns, or the right foot if it goes straight.
        sole_size: Length and width of each sole [m].

    Returns:
        A plan that starts with the feet at (0, +-A) and ends 2B * steps ahead.

    Raises:
        ParameterError: If `steps` is not a whole number in its range.
        PlanError: If the feet would meet or the steps are too long.

    Example:
        >>> plan = plan_steps(PAPER_GAIT, 20)
        >>> plan.count, round(plan.steps[-1].x, 6), plan.steps[0].side.value
        (20, 4.0, 'right')
    """
    return plan_segments([(gait, steps)], first=first, sole_size=sole_size)


def plan_segments(
    segments: _Segments,
    *,
    first: Side | None = None,
    sole_size: tuple[float, float] = PAPER_SOLE,
) -> FootstepPlan:
    """Return a walk made of regular pieces, joined without a halt, and of pauses.

    Args:
        segments: Pairs of a gait and its number of steps, at least one; between them
            numbers are times to stand still [s]. The first gait gives the start and the
            time of standing, the last one gives the stop.
        first: The foot that swings first, as in `plan_steps`. After a pause it is the
            one that `plan_steps` would take.
        sole_size: Length and width of each sole [m].

    Returns:
        One plan, with a closing step at its end and before each pause, if the feet are
        not parallel.

    Raises:
        ParameterError: If a number of steps is not a whole number in its range.
        PlanError: If there is no segment, the styles of double support differ, the feet
            would meet, or the steps are too long.
    """
    walks = _between_pauses(_checked_segments(segments))
    begin, end = walks[0][0][0][0], walks[-1][0][-1][0]
    declared = settings_of(Footstep)["side"]
    side = _first_side(begin) if first is None else declared.checked("first", first)
    body = Foothold(0.0, 0.0)
    feet = _beside(body, begin)
    left, right, steps = feet[Side.LEFT], feet[Side.RIGHT], []
    for k, (pieces, pause) in enumerate(walks):
        side = _first_side(pieces[0][0]) if k else side
        body, more, closing = _walk(pieces, body, feet, side)
        more[-1] = dataclasses.replace(more[-1], stand=pause)
        steps += more
    return FootstepPlan(
        left=left,
        right=right,
        steps=tuple(steps),
        start_time=begin.start_time,
        stop_time=end.stop_time,
        stand_time=begin.stand_time,
        double_support=begin.double_support,
        closing=closing,
        sole_size=sole_size,
    )


def _checked_segments(segments: _Segments) -> _Segments:
    """Check numbers of steps, times, and that all gaits agree on the style."""
    segments = list(segments)
    gaits = [item[0] for item in segments if isinstance(item, tuple)]
    if not gaits:
        raise PlanError("a plan needs at least one segment of steps")
    for i, item in enumerate(segments, 1):
        name = f"segment {i}: " if len(segments) > 1 else ""
        if not isinstance(item, tuple):
            settings_of(Footstep)["stand"].checked(f"{name}stand", item)
            continue
        gait, count = item
        if not isinstance(gait, Gait):
            raise ParameterError(f"{name}gait must be a Gait, got {gait!r}")
        checked_count(f"{name}steps", count, 1, MAX_STEPS)
        if gait.double_support != gaits[0].double_support:
            raise PlanError(f"{name}double_support must be the same in all segments")
    return segments


def _between_pauses(segments: _Segments) -> list[tuple[list[_Walk], float | None]]:
    """Return the pieces between pauses, and the pause after each, None after the last.

    Raises:
        PlanError: If no steps come before, after or between pauses.
    """
    walks: list[tuple[list[_Walk], float | None]] = [([], None)]
    for item in segments:
        if isinstance(item, tuple):
            walks[-1][0].append(item)
        else:
            walks[-1] = walks[-1][0], float(item)
            walks.append(([], None))
    if not all(pieces for pieces, _ in walks):
        raise PlanError(
            "a pause (stand) must come between steps; before the first and after the "
            "last step the plan stands for stand_time"
        )
    return walks


def _walk(
    pieces: Sequence[_Walk], body: Foothold, feet: dict[Side, Foothold], side: Side
) -> tuple[Foothold, list[Footstep], int]:
    """Walk some pieces and bring the feet together, which `feet` then holds.

    Returns:
        Where the body is then, the steps, and how many of them only close the feet.
    """
    steps: list[Footstep] = []
    for gait, count in pieces:
        for shift in _shifts(gait, count, side):
            body = _advanced(body, gait, shift)
            steps.append(_footstep(_beside(body, gait)[side], side, gait))
            feet[side] = steps[-1].foothold
            side = side.other
    gait = pieces[-1][0]
    goal = _beside(body, gait)[side]
    closing = int(not _same(goal, feet[side]))
    steps += [_footstep(goal, side, gait)] * closing
    feet[side] = goal
    return body, steps, closing


def _first_side(gait: Gait) -> Side:
    way = gait.lateral or gait.turn
    return Side.LEFT if way > 0.0 else Side.RIGHT


def _shifts(gait: Gait, count: int, side: Side) -> list[float]:
    """Return the shift of the body in each step [m]: by the leading foot only."""
    leading = Side.LEFT if gait.lateral > 0.0 else Side.RIGHT
    begin = 0 if side is leading or count == 1 else 1
    wide = range(begin, count, 2)
    return [
        gait.lateral * count / len(wide) if k in wide else 0.0 for k in range(count)
    ]


def _advanced(body: Foothold, gait: Gait, shift: float) -> Foothold:
    half_turn = Foothold(0.0, 0.0, gait.turn / 2)
    move = Foothold(gait.step_length, shift)
    return body.compose(half_turn).compose(move).compose(half_turn)


def _beside(body: Foothold, gait: Gait) -> dict[Side, Foothold]:
    A = gait.half_width
    return {side: body.compose(Foothold(0.0, side.sign * A)) for side in Side}


def _footstep(foothold: Foothold, side: Side, gait: Gait) -> Footstep:
    """Return a step with the times of a gait."""
    return Footstep(
        side=side,
        x=foothold.x,
        y=foothold.y,
        yaw=foothold.yaw,
        single_support=gait.single_support_time,
        double_support=gait.double_support_time,
        swing_height=gait.swing_height,
    )


def _same(a: Foothold, b: Foothold) -> bool:
    """Tell whether two footholds are equal but for rounding."""
    return max(abs(a.x - b.x), abs(a.y - b.y), abs(a.yaw - b.yaw)) < 1e-9


# Variations of a plan.


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
