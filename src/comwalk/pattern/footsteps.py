r"""Footsteps and supporting phases, the upper half of Fig. 2.

One *step* lasts T seconds and sets one foot down: a double support of 2 t_d, then a
single support of T - 2 t_d. The footprints of a straight walk are 2B apart and 2A wide.
A foot's pose is that of the centre of its sole; the left foot is on +y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import ParameterError, PlanError, checked_count, checked_number
from ..settings import check_settings, same_setting, setting, settings_of
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


_MIN_SINGLE_SUPPORT = 0.1


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

    period: float = setting(1.0, "Time of one step, T", "s", "[0.15, 10]")

    transfer_time: float = setting(
        0.1, "Half of the double support, t_d, at most T/2 - 0.05", "s", "[0.002, 5]"
    )

    half_step: float = setting(
        0.1,
        "Half of the distance between footprints, B; negative walks backward, 0 "
        "marches in place",
        "m",
        "[-2, 2]",
    )

    half_width: float = setting(
        0.09, "Half of the distance between both feet, A", "m", "[0.002, 4]"
    )

    swing_height: float = setting(
        0.04, "Clearance of the swing foot in mid-swing", "m", "[0, 3]"
    )

    start_time: float = setting(
        1.0, "Time from standing still to the first double support", "s", "[0.05, 20]"
    )

    stop_time: float = setting(
        1.0, "Time from the last double support to standing still", "s", "[0.05, 20]"
    )

    stand_time: float = setting(
        0.5,
        "Time of standing still before the start and after the stop",
        "s",
        "[0, 3600]",
    )

    double_support: DoubleSupport = setting(
        "paper",
        'ZMP in double support: "paper" (linear with the CoM, jumps when a foot lifts '
        'or lands) or "minjerk" (smooth between the feet)',
    )

    lateral: float = setting(
        0.0,
        "Sideways shift of the body per step, left positive; every second step is "
        "wide, so that the feet never meet",
        "m",
        "[-2, 2]",
    )

    turn: float = setting(
        0.0, "Turn of the body per step, left positive", "rad", "[-0.8, 0.8]"
    )

    def __post_init__(self) -> None:
        """Check the ranges; store floats."""
        check_settings(self)
        checked_number(
            "transfer_time",
            self.transfer_time,
            unit="s",
            low=0.002,
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

    @property
    def step_length(self) -> float:
        """Distance between footprints, 2 B [m]."""
        return 2.0 * self.half_step

    @property
    def speed(self) -> float:
        """Forward speed, 2 B / T [m/s]."""
        return self.step_length / self.period


PAPER_GAIT = Gait()
"""The walk of the paper's experiment: 0.2 m per step of 1 s."""


@dataclass(frozen=True, kw_only=True)
class Footstep:
    """One step: a transfer of the weight, then a swing to a new foothold.

    Raises:
        ParameterError: If a number is not finite or out of its range.
    """

    side: Side = setting(..., "The foot that swings")

    x: float = setting(
        ..., "Where the centre of its sole lands, world", "m", "[-1e5, 1e5]"
    )

    y: float = setting(
        ..., "Where the centre of its sole lands, world", "m", "[-1e5, 1e5]"
    )

    yaw: float = setting(0.0, "Heading of the landed foot, world", "rad", "[-1e6, 1e6]")

    single_support: float = setting(0.8, "Duration of the swing", "s", "[0.03, 10]")

    double_support: float = setting(
        0.2, "Duration of the transfer just before the swing", "s", "[0.001, 10]"
    )

    swing_height: float = setting(0.04, "Clearance in mid-swing", "m", "[0, 3]")

    stand: float | None = setting(
        None,
        "Time to stand still after this step, before the next one starts from rest; "
        "None to walk on",
        "s",
        "[0, 3600]",
    )

    def __post_init__(self) -> None:
        """Check the ranges; store floats and a `Side`."""
        check_settings(self)

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

    start_time: float = same_setting(Gait, "start_time")
    """As `Gait.start_time` [s]."""

    stop_time: float = same_setting(Gait, "stop_time")
    """As `Gait.stop_time` [s]."""

    stand_time: float = same_setting(Gait, "stand_time")
    """As `Gait.stand_time` [s]."""

    double_support: DoubleSupport = setting(
        "paper", "ZMP in double support, as in `Gait`"
    )

    closing: int = 0
    """How many of the last steps only bring the feet together: 0 or 1."""

    sole_size: tuple[float, float] = setting(
        PAPER_SOLE,
        "Length and width of each sole",
        "m",
        "[0.002, 5]",
        items=("length", "width"),
    )

    def __post_init__(self) -> None:
        """Check times, then the geometry of every step."""
        object.__setattr__(self, "steps", _checked_steps(self.steps))
        check_settings(self)
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


def _check_stand(plan: FootstepPlan) -> None:
    """Check the two footholds at the start."""
    for side in Side:
        foothold = getattr(plan, side)
        if not isinstance(foothold, Foothold):
            raise ParameterError(f"{side} must be a Foothold, got {foothold!r}")
        for name in ("x", "y", "yaw"):
            settings_of(Footstep)[name].checked(
                f"{side}.{name}", getattr(foothold, name)
            )
    left, right = (np.array([_row(f)], dtype=float) for f in (plan.left, plan.right))
    where = "the feet at the start"
    _refuse(_placement_faults(left, right, np.ones(1)), [where])
    _refuse([_overlap_fault(_sole_gap(right, left, plan.sole_size))], [where])


def _row(foothold: Foothold) -> tuple[float, float, float]:
    """Return x [m], y [m], yaw [rad]."""
    return foothold.x, foothold.y, foothold.yaw


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
