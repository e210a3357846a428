r"""Footsteps and supporting phases, the upper half of Fig. 2.

One *step* lasts T seconds and sets one foot down: a double support of 2 t_d, then a
single support of T - 2 t_d. The footprints of a straight walk are 2B apart and 2A wide.
A foot's pose is that of the centre of its sole; the left foot is on +y.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..errors import ParameterError, PlanError, checked_number, nearest
from ..sides import Side

DoubleSupport = Literal["paper", "minjerk"]
"""How the ZMP crosses in double support: Eqs. (4), (9), or by minimum jerk."""

MAX_STEPS = 100_000
"""Most footsteps of one plan [-]."""

MAX_STRIDE = 0.8
"""Longest travel of a swing foot, and widest distance of the feet [m]."""

MAX_TOE = 1.2
"""Largest angle between the two feet [rad]."""

PAPER_SOLE = (0.24, 0.13)
"""Length and width of a sole [m] when the robot does not say."""

_Walk = tuple["Gait", int]
_Segments = Sequence[_Walk | float]


def shortest_turn(start: float, end: float) -> float:
    """Return the angle from one heading to another by the short way.

    Args:
        start: Heading [rad].
        end: Heading [rad].

    Returns:
        The turn [rad], in [-pi, pi].

    Example:
        >>> round(shortest_turn(3.0, -3.0), 6)
        0.283185
    """
    return math.remainder(end - start, math.tau)


_GAIT_LIMITS = {
    "period": ("s", 0.3, 10.0),
    "transfer_time": ("s", 0.005, 5.0),
    "half_step": ("m", -0.2, 0.2),
    "half_width": ("m", 0.02, 0.4),
    "swing_height": ("m", 0.0, 0.3),
    "start_time": ("s", 0.2, 10.0),
    "stop_time": ("s", 0.2, 10.0),
    "stand_time": ("s", 0.0, 3600.0),
    "lateral": ("m", -0.2, 0.2),
    "turn": ("rad", -0.8, 0.8),
}
_STEP_LIMITS = {
    "x": ("m", -1e5, 1e5),
    "y": ("m", -1e5, 1e5),
    "yaw": ("rad", -1e6, 1e6),
    "single_support": ("s", 0.05, 10.0),
    "double_support": ("s", 1e-3, 10.0),
    "swing_height": ("m", 0.0, 0.3),
}
_STAND_LIMITS = ("s", 0.0, 3600.0)
_MIN_SINGLE_SUPPORT = 0.1


def checked_count(name: str, value: object, low: int, high: int) -> int:
    """Return a whole number inside its range.

    Args:
        name: What the number is called where the user wrote it.
        value: The number, an int or a numpy integer.
        low: Smallest value allowed.
        high: Largest value allowed.

    Returns:
        The number as an int.

    Raises:
        ParameterError: If it is not a whole number in [low, high].
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or not low <= int(value) <= high:  # type: ignore[call-overload]
        raise ParameterError(
            f"{name} must be a whole number in [{low}, {high}], got {value!r}"
        )
    return int(value)  # type: ignore[call-overload]


def _check_fields(
    owner: object, limits: Mapping[str, tuple[str, float, float]]
) -> None:
    """Check fields of a frozen dataclass against their ranges and store floats."""
    for name, (unit, low, high) in limits.items():
        value = getattr(owner, name)
        x = checked_number(name, value, unit=unit, low=low, high=high)
        object.__setattr__(owner, name, x)


def _check_style(style: object) -> None:
    """Refuse an unknown style of double support."""
    known = get_args(DoubleSupport)
    if style not in known:
        hint = nearest(str(style), known)
        raise ParameterError(
            f'double_support must be "paper" or "minjerk", got {style!r}; {hint}'
        )


def _checked_side(side: object) -> Side:
    """Return a side from itself or its word."""
    if side not in tuple(Side):
        hint = nearest(str(side), tuple(Side))
        raise ParameterError(f'side must be "left" or "right", got {side!r}; {hint}')
    return Side(side)


def _checked_sole(size: object) -> tuple[float, float]:
    """Return the length and width of a sole as floats."""
    if not isinstance(size, Sequence | np.ndarray) or len(size) != 2:
        raise ParameterError(f"sole_size must be (length, width) in m, got {size!r}")
    length, width = (
        checked_number(f"sole_size ({name})", value, unit="m", low=0.01, high=1.0)
        for name, value in zip(("length", "width"), size, strict=True)
    )
    return length, width


def _checked_steps(steps: object) -> tuple[Footstep, ...]:
    """Return the footsteps as a tuple of a length that can be handled."""
    if isinstance(steps, str) or not isinstance(steps, Sequence):
        raise ParameterError(f"steps must be a tuple of Footstep, got {steps!r}")
    for i, step in enumerate(steps, 1):
        if not isinstance(step, Footstep):
            raise ParameterError(f"footstep {i} must be a Footstep, got {step!r}")
    if len(steps) > MAX_STEPS + 1:
        raise PlanError(
            f"a plan can have {MAX_STEPS} footsteps and a closing one, got {len(steps)}"
        )
    return tuple(steps)


@dataclass(frozen=True, slots=True)
class Foothold:
    """A level pose of a sole on the ground."""

    x: float
    """Centre [m], world."""

    y: float
    """Centre [m], world."""

    yaw: float = 0.0
    """Heading [rad], world."""

    def compose(self, other: Foothold) -> Foothold:
        """Return a pose given relative to this one in world coordinates.

        Example:
            >>> Foothold(1.0, 0.0).compose(Foothold(0.2, 0.09))
            Foothold(x=1.2, y=0.09, yaw=0.0)
        """
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Foothold(
            self.x + cos * other.x - sin * other.y,
            self.y + sin * other.x + cos * other.y,
            self.yaw + other.yaw,
        )


@dataclass(frozen=True, kw_only=True)
class Gait:
    """The numbers of a regular walk (Fig. 2); defaults are the paper's.

    Raises:
        ParameterError: If a number is not finite or out of its range.

    Example:
        >>> Gait().single_support_time
        0.8
    """

    period: float = 1.0
    """Time of one step, T [s], in [0.3, 10]."""

    transfer_time: float = 0.1
    """Half of the double support, t_d [s], in [0.005, T/2 - 0.05]."""

    half_step: float = 0.1
    """Half of the distance between footprints, B [m], in [-0.2, 0.2]; negative walks
    backward, 0 marches in place."""

    half_width: float = 0.09
    """Half of the distance between both feet, A [m], in [0.02, 0.4]."""

    swing_height: float = 0.04
    """Clearance of the swing foot in mid-swing [m], in [0, 0.3]."""

    start_time: float = 1.0
    """Time from standing still to the first double support [s], in [0.2, 10]."""

    stop_time: float = 1.0
    """Time from the last double support to standing still [s], in [0.2, 10]."""

    stand_time: float = 0.5
    """Time of standing still before the start and after the stop [s], in [0, 3600]."""

    double_support: DoubleSupport = "paper"
    """ZMP in double support: "paper" (linear with the CoM, jumps when a foot lifts or
    lands) or "minjerk" (smooth between the feet)."""

    lateral: float = 0.0
    """Sideways shift of the body per step, left positive [m], in [-0.2, 0.2]; every
    second step is wide, so that the feet never meet."""

    turn: float = 0.0
    """Turn of the body per step, left positive [rad], in [-0.8, 0.8]."""

    def __post_init__(self) -> None:
        """Check the ranges; store floats."""
        _check_fields(self, _GAIT_LIMITS)
        _check_style(self.double_support)
        checked_number(
            "transfer_time",
            self.transfer_time,
            unit="s",
            low=0.005,
            high=self.period / 2 - _MIN_SINGLE_SUPPORT / 2,
            hint="it must leave a single support of 0.1 s, so raise period or lower it",
        )

    @property
    def single_support_time(self) -> float:
        """Duration of single support, T - 2 t_d [s]."""
        return self.period - 2 * self.transfer_time

    @property
    def double_support_time(self) -> float:
        """Duration of double support, 2 t_d [s]."""
        return 2 * self.transfer_time


PAPER_GAIT = Gait()
"""The walk of the paper's experiment: 0.2 m per step of 1 s."""


@dataclass(frozen=True, kw_only=True)
class Footstep:
    """One step: a transfer of the weight, then a swing to a new foothold.

    Raises:
        ParameterError: If a number is not finite or out of its range.
    """

    side: Side
    """The foot that swings."""

    x: float
    """Where the centre of its sole lands [m], world."""

    y: float
    """Where the centre of its sole lands [m], world."""

    yaw: float = 0.0
    """Heading of the landed foot [rad], world."""

    single_support: float = 0.8
    """Duration of the swing [s], in [0.05, 10]."""

    double_support: float = 0.2
    """Duration of the transfer just before the swing [s], in [0.001, 10]."""

    swing_height: float = 0.04
    """Clearance in mid-swing [m], in [0, 0.3]."""

    stand: float | None = None
    """Time to stand still after this step, before the next one starts from rest [s], in
    [0, 3600]; None to walk on."""

    def __post_init__(self) -> None:
        """Check the ranges; store floats and a `Side`."""
        object.__setattr__(self, "side", _checked_side(self.side))
        _check_fields(self, _STEP_LIMITS)
        if self.stand is not None:
            _check_fields(self, {"stand": _STAND_LIMITS})

    @property
    def foothold(self) -> Foothold:
        """Where the foot lands."""
        return Foothold(self.x, self.y, self.yaw)


@dataclass(frozen=True, kw_only=True)
class FootstepPlan:
    """Footsteps with times, from standing still to standing still.

    Raises:
        ParameterError: If a time or the sole is not finite or out of its range.
        PlanError: If a step is too long, turns too far, crosses the stance leg or would
            put a sole on the other; the message names the first such step.
    """

    left: Foothold
    """Left foot at the start, world."""

    right: Foothold
    """Right foot at the start, world."""

    steps: tuple[Footstep, ...] = ()
    """The steps in order, at most 100000; none means to stand."""

    start_time: float = 1.0
    """Time from standing still to the first double support [s], in [0.2, 10]."""

    stop_time: float = 1.0
    """Time from the last double support to standing still [s], in [0.2, 10]."""

    stand_time: float = 0.5
    """Time of standing still before the start and after the stop [s], in [0, 3600]."""

    double_support: DoubleSupport = "paper"
    """ZMP in double support: "paper" or "minjerk", as in `Gait`."""

    closing: int = 0
    """How many of the last steps only bring the feet together: 0 or 1."""

    sole_size: tuple[float, float] = PAPER_SOLE
    """Length and width of each sole [m], each in [0.01, 1]."""

    def __post_init__(self) -> None:
        """Check times, then the geometry of every step."""
        object.__setattr__(self, "steps", _checked_steps(self.steps))
        times = {k: _GAIT_LIMITS[k] for k in ("start_time", "stop_time", "stand_time")}
        _check_fields(self, times)
        _check_style(self.double_support)
        object.__setattr__(self, "sole_size", _checked_sole(self.sole_size))
        high = min(1, len(self.steps))
        object.__setattr__(
            self, "closing", checked_count("closing", self.closing, 0, high)
        )
        _check_stand(self)
        _check_geometry(self)

    @property
    def count(self) -> int:
        """Number of steps without the closing one."""
        return len(self.steps) - self.closing


def foot_poses(plan: FootstepPlan) -> np.ndarray:
    """Return both feet before the first step and after each one.

    Args:
        plan: A plan of n steps.

    Returns:
        Poses (x [m], y [m], yaw [rad]), shape (n + 1, 2, 3), left foot first, world.
        Each foot's yaw is continuous: it may leave [-pi, pi], but never jumps by a
        whole turn.
    """
    feet = {Side.LEFT: _row(plan.left), Side.RIGHT: _row(plan.right)}
    poses = [(feet[Side.LEFT], feet[Side.RIGHT])]
    for step in plan.steps:
        yaw = feet[step.side][2]
        feet[step.side] = (step.x, step.y, yaw + shortest_turn(yaw, step.yaw))
        poses.append((feet[Side.LEFT], feet[Side.RIGHT]))
    return np.array(poses, dtype=float)


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
    side = _first_side(begin) if first is None else _checked_side(first)
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


# Variations of a plan.


# Checks of the geometry.


def _check_stand(plan: FootstepPlan) -> None:
    """Check the two footholds at the start."""
    for side in Side:
        foothold = getattr(plan, side)
        if not isinstance(foothold, Foothold):
            raise ParameterError(f"{side} must be a Foothold, got {foothold!r}")
        for name in ("x", "y", "yaw"):
            unit, low, high = _STEP_LIMITS[name]
            value = getattr(foothold, name)
            checked_number(f"{side}.{name}", value, unit=unit, low=low, high=high)
    left, right = (np.array([_row(f)], dtype=float) for f in (plan.left, plan.right))
    where = "the feet at the start"
    _refuse(_placement_faults(left, right, np.ones(1)), [where])
    _refuse([_overlap_fault(_sole_gap(right, left, plan.sole_size))], [where])


def _check_geometry(plan: FootstepPlan) -> None:
    """Check each step: its length, its turn, and that it passes the stance foot."""
    if not plan.steps:
        return
    poses = foot_poses(plan)
    swing = np.array([0 if step.side is Side.LEFT else 1 for step in plan.steps])
    k = np.arange(len(swing))
    start, end = poses[k, swing], poses[k + 1, swing]
    stance, sign = poses[k, 1 - swing], 1.0 - 2.0 * swing
    travel = np.hypot(*(end - start)[:, :2].T)
    gap = np.min(
        [
            _sole_gap(stance, start + s * (end - start), plan.sole_size)
            for s in np.linspace(0.0, 1.0, 11)
        ],
        axis=0,
    )
    names = [f"footstep {i} ({step.side})" for i, step in enumerate(plan.steps, 1)]
    faults = [
        (
            travel,
            travel > MAX_STRIDE + _ROUNDING,
            f"swing foot travels {{:.3f}} m, {_STRIDE_RULE}",
        ),
        *_placement_faults(end, stance, sign),
        _overlap_fault(gap),
    ]
    _refuse(faults, names)


_ROUNDING = 1e-9
_Fault = tuple[np.ndarray, np.ndarray, str]
_STRIDE_RULE = f"more than {MAX_STRIDE:g} m; shorten the stride"


def _placement_faults(foot: np.ndarray, stance: np.ndarray, sign: np.ndarray) -> list:
    """Return values, faults and messages of feet placed beside stance feet."""
    d = foot[:, :2] - stance[:, :2]
    across = sign * (np.cos(stance[:, 2]) * d[:, 1] - np.sin(stance[:, 2]) * d[:, 0])
    spread = np.hypot(d[:, 0], d[:, 1])
    toe = np.abs(np.remainder(foot[:, 2] - stance[:, 2] + np.pi, 2 * np.pi) - np.pi)
    return [
        (
            spread,
            spread > MAX_STRIDE + _ROUNDING,
            f"feet are {{:.3f}} m apart, {_STRIDE_RULE}",
        ),
        (
            toe,
            toe > MAX_TOE + _ROUNDING,
            f"feet point {{:.3f}} rad apart, more than {MAX_TOE:g} rad; turn less",
        ),
        (
            across,
            across <= 0.0,
            "foot lands {:.3f} m to its own side of the other foot, must be above 0 m; "
            "the legs would cross",
        ),
    ]


def _overlap_fault(gap: np.ndarray) -> _Fault:
    """Return values, faults and message of soles that meet."""
    return (
        gap,
        gap <= 0.0,
        "soles meet: their gap is {:.3f} m and must stay above 0 m; step wider",
    )


def _refuse(faults: Iterable[_Fault], names: Sequence[str]) -> None:
    """Raise an error about the first step with a fault."""
    found = [
        (int(np.argmax(bad)), i, values, text)
        for i, (values, bad, text) in enumerate(faults)
        if bad.any()
    ]
    if found:
        k, _, values, text = min(found, key=lambda fault: fault[:2])
        raise PlanError(f"{names[k]}: {text.format(float(values[k]))}")


def _sole_gap(a: np.ndarray, b: np.ndarray, size: tuple[float, float]) -> np.ndarray:
    """Return how far pairs of soles are apart along their best separating axis.

    Args:
        a: Poses, shape (n, 3).
        b: Poses, shape (n, 3).
        size: Length and width of both soles [m].

    Returns:
        Gap [m], shape (n,): positive if they are apart, negative if they overlap.
    """
    half = np.array(size) / 2
    d, turn = b[:, :2] - a[:, :2], np.abs(np.cos(b[:, 2] - a[:, 2]))
    side = np.abs(np.sin(b[:, 2] - a[:, 2]))
    reach = half + np.stack(
        [half[0] * turn + half[1] * side, half[0] * side + half[1] * turn], axis=1
    )
    gaps = [np.abs(_turned(d, yaw)) - reach for yaw in (a[:, 2], b[:, 2])]
    return np.max(np.concatenate(gaps, axis=1), axis=1)


def _turned(d: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Return world vectors (n, 2) in frames of the given headings (n,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * d[:, 0] + sin * d[:, 1], cos * d[:, 1] - sin * d[:, 0]], 1)


# Regular walks.


def _checked_segments(segments: _Segments) -> _Segments:
    """Check numbers of steps, times, and that all gaits agree on the style."""
    segments = list(segments)
    gaits = [item[0] for item in segments if isinstance(item, tuple)]
    if not gaits:
        raise PlanError("a plan needs at least one segment of steps")
    for i, item in enumerate(segments, 1):
        name = f"segment {i}: " if len(segments) > 1 else ""
        if not isinstance(item, tuple):
            unit, low, high = _STAND_LIMITS
            checked_number(f"{name}stand", item, unit=unit, low=low, high=high)
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
    """Return the foot that can start without meeting the other."""
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
    """Return the pose of the body one step later, along an arc."""
    half_turn = Foothold(0.0, 0.0, gait.turn / 2)
    move = Foothold(2 * gait.half_step, shift)
    return body.compose(half_turn).compose(move).compose(half_turn)


def _beside(body: Foothold, gait: Gait) -> dict[Side, Foothold]:
    """Return the footholds at +-A beside the body."""
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


def _row(foothold: Foothold) -> tuple[float, float, float]:
    """Return x [m], y [m], yaw [rad]."""
    return foothold.x, foothold.y, foothold.yaw


# Plans in files.
