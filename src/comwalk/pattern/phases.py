r"""From footsteps to a table of phases, as kernels: Eqs. (4)-(13).

A phase of known ends is a link between the positions of the CoM at its start and its
end; continuous velocity makes all links one tridiagonal system, solved in one sweep,
fast enough to plan anew in every control period. For a regular walk the solution is the
paper's: K_x and K_y of Eqs. (8) and (13), which `closed_form` writes out, are where the
CoM is at the end of double support.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..compiled import Record, kernel
from ..errors import PlanError
from ..sides import Side
from . import records as r
from .footsteps import Footstep, FootstepPlan
from .pendulum import Pendulum
from .reference import DOUBLE, SINGLE_LEFT, SINGLE_RIGHT, STAND, START, STOP
from .turns import fill_turns, mean_yaw, set_turn, wrapped

START_SPEED = 2.25
"""Velocity at the end of the quintic start, in units of distance over duration [-]."""


MIN_MINJERK = 0.2
"""Shortest omega_n times duration of a "minjerk" double support [-]; below, the
particular solution loses too many digits."""


def plan_table(plan: FootstepPlan, pendulum: Pendulum) -> np.ndarray:
    """Return the table of a plan's pattern, `make_pattern(plan, pendulum).table`.

    Args:
        plan: Footsteps with times.
        pendulum: Gives omega_n and c_z.

    Returns:
        The phases, records of `PHASE`, for `fill_reference`.

    Raises:
        PlanError: If a double support is too short for "minjerk".

    Example:
        >>> from comwalk.pattern import Gait, plan_steps
        >>> plan_table(plan_steps(Gait(), 2), Pendulum()).shape
        (11,)
    """
    omega, minjerk = pendulum.omega, plan.double_support == "minjerk"
    if not plan.steps:
        return _standing_table(plan)
    shortest = min(step.double_support for step in plan.steps)
    if minjerk and omega * shortest < MIN_MINJERK:
        k = int(np.argmin([step.double_support for step in plan.steps]))
        least = MIN_MINJERK / (omega * shortest)
        raise PlanError(
            f"double support before footstep {k + 1} is too short for double_support "
            f'= "minjerk": make it {least:.3g} times longer, or use "paper"'
        )
    steps = step_records(plan)
    pauses = int(np.count_nonzero(steps["stand"][:-1] >= 0.0))
    table = np.zeros(2 * len(steps) + 5 + 4 * pauses, r.PHASE)
    work = np.zeros(len(table), r.WORK)
    feet = np.array([(foot.x, foot.y, foot.yaw) for foot in (plan.left, plan.right)])
    times = np.array([plan.stand_time, plan.start_time, plan.stop_time])
    fill_plan(table, steps, feet, times, omega, minjerk, work)
    return table


def _standing_table(plan: FootstepPlan) -> np.ndarray:
    """Return the one phase of a plan without steps."""
    table = np.zeros(1, r.PHASE)
    feet = np.array([(foot.x, foot.y, foot.yaw) for foot in (plan.left, plan.right)])
    fill_standing(table, 2 * plan.stand_time, feet)
    return table


def step_records(plan: FootstepPlan) -> np.ndarray:
    """Return the footsteps of a plan as records of `STEP`."""
    return np.array([_record_of(step) for step in plan.steps], r.STEP)


def _record_of(step: Footstep) -> tuple[Any, ...]:
    foot, pose = list(Side).index(step.side), (step.x, step.y, step.yaw)
    times = step.single_support, step.double_support
    return foot, pose, *times, step.swing_height, _stand_of(step)


def _stand_of(step: Footstep) -> float:
    return -1.0 if step.stand is None else step.stand


@kernel
def fill_standing(table: np.ndarray, duration: float, feet: np.ndarray) -> None:
    """Fill the first row of a table: standing, from time 0 on."""
    piece, yaw = table[0], feet[0, 2]
    landed, base = piece.landed, piece.bases[0]
    still(piece, 0.0, duration, STAND, landed, base, 0.0, 0.0, feet)
    yaw = mean_yaw(piece, yaw)
    set_turn(piece, 0.0, 1.0, yaw, 0.0, yaw, 0.0, 1.0)


@kernel
def fill_plan(
    table: np.ndarray,
    steps: np.ndarray,
    feet: np.ndarray,
    times: np.ndarray,
    omega: float,
    minjerk: bool,
    work: np.ndarray,
) -> None:
    """Fill the table of a plan.

    Args:
        table: Where to write, 2 n + 5 rows and four more per pause.
        steps: The n footsteps, records of `STEP`, n > 0.
        feet: x, y [m], yaw [rad] of the left and of the right foot, (2, 3); then it
            holds where they are at the end.
        times: Times of standing, starting and stopping [s], (3,).
        omega: Natural frequency omega_n [rad/s].
        minjerk: Whether the ZMP crosses by minimum jerk.
        work: Scratch, records of `WORK`, as many as the table has.
    """
    stand, start, stop = times[0], times[1], times[2]
    begin, i, time = 0, 0, 0.0
    while begin < len(steps):
        end = begin + 1
        while end < len(steps) and steps[end - 1].stand < 0.0:
            end += 1
        base = 1 - steps[begin].foot
        still(table[i], time, stand, STAND, begin, base, 0.0, 0.0, feet)
        still(table[i + 1], time + stand, start, START, begin, base, 0.0, 1.0, feet)
        first, i = i + 1, i + 2
        for k in range(begin, end):
            add_double(table, i, feet, 1 - steps[k].foot, steps[k].double)
            add_single(table, i + 1, feet, steps[k])
            i += 2
        stand = times[0] if end == len(steps) else steps[end - 1].stand
        add_end(table, i, feet, steps[end - 1].double, stop, stand)
        kappa = fill_start(table[first], omega, minjerk)
        x, y = weight_point(table[first], 0)
        link(table, first + 1, i + 1, omega, minjerk, kappa, kappa * x, kappa * y, work)
        place_start(table[first], work[0].com)
        fill_turns(table, first - 1, i + 2, work)
        begin, i, time = end, i + 2, table[i + 2].start


# Rows of phases.


@kernel
def still(
    piece: Record,
    start: float,
    duration: float,
    kind: np.int64,
    landed: int,
    base: int,
    walking_0: float,
    walking_1: float,
    feet: np.ndarray,
) -> None:
    """Write a phase in which both feet bear the same and the CoM rests between them."""
    piece.inverse_sinh = piece.clearance = piece.path_time = 0.0
    for k in range(8):
        piece.curve[0, k] = piece.curve[1, k] = 0.0
    piece.start, piece.duration = start, duration
    piece.kind, piece.landed = kind, landed
    piece.bases[0] = piece.bases[1] = base
    piece.loads[0] = piece.loads[1] = 0.5
    piece.blends[0], piece.blends[1] = walking_0, walking_1
    piece.swinging = -1
    for k in range(3):
        piece.travel[k] = 0.0
        piece.resting[0, k], piece.resting[1, k] = feet[0, k], feet[1, k]
    piece.curve[0, 0], piece.curve[1, 0] = weight_point(piece, 0)


@kernel
def add_double(
    table: np.ndarray, i: int, feet: np.ndarray, base: int, duration: float
) -> None:
    """Write the double support after row i - 1 that brings the weight on one foot."""
    before, piece = table[i - 1], table[i]
    start, landed = after(before)
    still(piece, start, duration, DOUBLE, landed, base, 1.0, 1.0, feet)
    piece.bases[0], piece.loads[0] = before.bases[1], before.loads[1]
    piece.loads[1] = 1.0 - base


@kernel
def add_single(table: np.ndarray, i: int, feet: np.ndarray, step: Record) -> None:
    """Write the single support of a footstep after row i - 1; the feet then move."""
    piece, foot = table[i], step.foot
    start, landed = after(table[i - 1])
    kind = SINGLE_RIGHT if foot == 0 else SINGLE_LEFT
    still(piece, start, step.single, kind, landed, 1 - foot, 1.0, 1.0, feet)
    piece.loads[0] = piece.loads[1] = float(foot)
    piece.swinging, piece.clearance = foot, step.clearance
    for k in range(3):
        piece.travel[k] = step.pose[k] - feet[foot, k]
    piece.travel[2] = wrapped(piece.travel[2])
    feet[foot, 0], feet[foot, 1] = step.pose[0], step.pose[1]
    feet[foot, 2] += piece.travel[2]


@kernel
def add_end(
    table: np.ndarray,
    i: int,
    feet: np.ndarray,
    double: float,
    stop: float,
    stand: float,
) -> None:
    """Write the last double support after row i - 1, the stop and the standing."""
    base = table[i - 1].bases[1]
    add_double(table, i, feet, base, double)
    table[i].loads[1] = 0.5
    start, landed = after(table[i])
    still(table[i + 1], start, stop, STOP, landed, base, 1.0, 0.0, feet)
    start, landed = after(table[i + 1])
    still(table[i + 2], start, stand, STAND, landed, base, 0.0, 0.0, feet)


@kernel
def after(piece: Record) -> tuple[float, int]:
    """Return the end time of a phase, and the footsteps landed by then."""
    landed = piece.landed + (1 if piece.swinging >= 0 else 0)
    return piece.start + piece.duration, landed


@kernel
def weight_point(piece: Record, end: int) -> tuple[float, float]:
    """Return the point between the feet where the weight is at an end (0 or 1) [m]."""
    left, feet = piece.loads[end], piece.resting
    x = left * feet[0, 0] + (1.0 - left) * feet[1, 0]
    y = left * feet[0, 1] + (1.0 - left) * feet[1, 1]
    return x, y


# The CoM.


@kernel
def link(
    table: np.ndarray,
    first: int,
    last: int,
    omega: float,
    minjerk: bool,
    kappa: float,
    load_x: float,
    load_y: float,
    work: np.ndarray,
) -> None:
    r"""Fill the curves of rows `first` to `last`, the row of the stop.

    The unknowns are the CoM u at the start of each row. What comes before gives the
    velocity :math:`v = \kappa u - load` there, and the stop one of the same form.

    Args:
        table: The phases; all but their curves is filled.
        first: Row of the first double or single support.
        last: Row of the stop.
        omega: Natural frequency omega_n [rad/s].
        minjerk: Whether the ZMP crosses by minimum jerk.
        kappa: Of what comes before [1/s].
        load_x: Of what comes before, in x [m/s].
        load_y: Of what comes before, in y [m/s].
        work: Scratch, records of `WORK`; `com` then is u [m].
    """
    n = last - first
    for k in range(n + 1):
        clear(work[k])
    work[0].diag, work[0].com[0], work[0].com[1] = kappa, load_x, load_y
    for k in range(n):
        piece = table[first + k]
        if piece.kind == DOUBLE and not minjerk:
            rate = 1.0 / piece.duration
            work[k].diag += rate
            work[k + 1].diag += rate
            work[k].beside = -rate
        else:
            fill_particular(piece, omega, minjerk)
            add_pendulum(piece, omega, work[k], work[k + 1])
    stop = fill_start(table[last], omega, minjerk)
    x, y = weight_point(table[last], 0)
    work[n].diag += stop
    work[n].com[0] += stop * x
    work[n].com[1] += stop * y
    solve(work, n + 1)
    for k in range(n):
        place(table[first + k], work[k], work[k + 1], minjerk)
    place_start(table[last], work[n].com)
    reverse(table[last])


@kernel
def fill_particular(piece: Record, omega: float, minjerk: bool) -> None:
    """Fill the polynomial CoM of a phase, as `pattern` derives it from its ZMP."""
    angle = omega * piece.duration
    piece.inverse_sinh = 1.0 / math.sinh(angle)
    a_2 = 1.0 / (angle * angle)
    a_4 = a_2 * a_2
    ends_0, ends_1 = weight_point(piece, 0), weight_point(piece, 1)
    for axis in range(2):
        q = piece.curve[axis]
        p = ends_0[axis]
        q[0], q[1], q[2], q[3], q[4], q[5] = p, 0.0, 0.0, 0.0, 0.0, 0.0
        if piece.kind == DOUBLE:
            d = ends_1[axis] - p
            q[0] = p - 360.0 * d * a_4
            q[1] = 60.0 * d * a_2 + 720.0 * d * a_4
            q[2] = -180.0 * d * a_2
            q[3] = 10.0 * d + 120.0 * d * a_2
            q[4], q[5] = -15.0 * d, 6.0 * d


@kernel
def add_pendulum(piece: Record, omega: float, here: Record, there: Record) -> None:
    """Add the link of a phase that is a pendulum to the system."""
    S = piece.duration
    b = omega * piece.inverse_sinh
    a = omega / math.tanh(omega * S)
    here.diag += a
    there.diag += a
    here.beside = -b
    for axis in range(2):
        q = piece.curve[axis]
        q_1, dq_1 = polynomial_end(q)
        here.com[axis] += q[1] / S + a * q[0] - b * q_1
        there.com[axis] += -dq_1 / S + a * q_1 - b * q[0]


@kernel
def polynomial_end(q: np.ndarray) -> tuple[float, float]:
    """Return the value and the slope at 1 of a polynomial of degree 5."""
    value = q[0] + q[1] + q[2] + q[3] + q[4] + q[5]
    return value, q[1] + 2.0 * q[2] + 3.0 * q[3] + 4.0 * q[4] + 5.0 * q[5]


@kernel
def clear(work: Record) -> None:
    """Set a row of the system to zero."""
    work.diag = work.beside = work.com[0] = work.com[1] = 0.0


@kernel
def solve(work: np.ndarray, n: int) -> None:
    """Solve the tridiagonal system: diagonal, off-diagonal, two right sides."""
    for k in range(1, n):
        before = work[k - 1]
        share = before.beside / before.diag
        work[k].diag -= share * before.beside
        work[k].com[0] -= share * before.com[0]
        work[k].com[1] -= share * before.com[1]
    for k in range(n - 1, -1, -1):
        for axis in range(2):
            if k < n - 1:
                work[k].com[axis] -= work[k].beside * work[k + 1].com[axis]
            work[k].com[axis] /= work[k].diag


@kernel
def place(piece: Record, here: Record, there: Record, minjerk: bool) -> None:
    """Fill the rest of a phase's curves from the CoM at its ends."""
    straight = piece.kind == DOUBLE and not minjerk
    for axis in range(2):
        q = piece.curve[axis]
        c_0, c_1 = here.com[axis], there.com[axis]
        if straight:
            q[0], q[1] = c_0, c_1 - c_0
        else:
            q[6], q[7] = c_0 - q[0], c_1 - polynomial_end(q)[0]


@kernel
def fill_start(piece: Record, omega: float, minjerk: bool) -> float:
    """Fill a start over a unit distance, as x; return its end speed kappa [1/s]."""
    S, q = piece.duration, piece.curve[0]
    for k in range(8):
        q[k] = 0.0
    if not minjerk:
        eta = START_SPEED
        q[3], q[4], q[5] = 10.0 - 4.0 * eta, 7.0 * eta - 15.0, 6.0 - 3.0 * eta
        return eta / S
    angle = omega * S
    a_2 = 1.0 / (angle * angle)
    sinh, cosh = math.sinh(angle), math.cosh(angle)
    q[0] = -(384.0 * a_2 * a_2 + 32.0 * a_2)
    q[1], q[2] = 192.0 * a_2, -(16.0 + 192.0 * a_2)
    q[3], q[4] = 32.0, -16.0
    q[6] = -q[0]
    q[7] = cosh * q[6] - sinh * q[1] / angle
    way, slope = polynomial_end(q)
    way += q[7]
    speed = slope / S + omega * (q[7] * cosh - q[6]) / sinh
    for k in range(8):
        q[k] /= way
    piece.inverse_sinh = 1.0 / sinh
    return speed / way


@kernel
def place_start(piece: Record, u: np.ndarray) -> None:
    """Scale the unit start of a phase to a way from the middle of the feet to u."""
    middle = weight_point(piece, 0)
    for k in range(8):
        unit = piece.curve[0, k]
        for axis in range(2):
            piece.curve[axis, k] = unit * (u[axis] - middle[axis])
    for axis in range(2):
        piece.curve[axis, 0] += middle[axis]


@kernel
def reverse(piece: Record) -> None:
    """Make the curves of a phase run backward in time."""
    for axis in range(2):
        q = piece.curve[axis]
        for i in range(5):
            for j in range(4, i - 1, -1):
                q[j] += q[j + 1]
        for j in range(1, 6, 2):
            q[j] = -q[j]
        q[6], q[7] = q[7], q[6]


# The heading.
