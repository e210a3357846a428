r"""Footsteps and supporting phases, the upper half of Fig. 2.

One *step* lasts T seconds and sets one foot down: a double support of 2 t_d, then a
single support of T - 2 t_d. The footprints of a straight walk are 2B apart and 2A wide.
A foot's pose is that of the centre of its sole; the left foot is on +y.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..errors import ParameterError, PlanError, checked_number, nearest
from ..sides import Side
from .placement import (
    _ROUNDING,
    _STRIDE_RULE,
    MAX_STRIDE,
    _overlap_fault,
    _placement_faults,
    _refuse,
    _sole_gap,
)

DoubleSupport = Literal["paper", "minjerk"]
"""How the ZMP crosses in double support: Eqs. (4), (9), or by minimum jerk."""

MAX_STEPS = 100_000
"""Most footsteps of one plan [-]."""


PAPER_SOLE = (0.24, 0.13)
"""Length and width of a sole [m] when the robot does not say."""


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


# Regular walks.


def _row(foothold: Foothold) -> tuple[float, float, float]:
    """Return x [m], y [m], yaw [rad]."""
    return foothold.x, foothold.y, foothold.yaw


# Plans in files.


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
