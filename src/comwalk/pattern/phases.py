r"""A pattern made without objects: footsteps in, a table of phases out.

`pattern.make_pattern` derives what is computed here and is the reference. These kernels
do the same on the rows of `rows`, fast enough to plan anew in every control period. A
phase of known ends is a link between the positions of the CoM at its start and its end;
continuous velocity makes all links one tridiagonal system, solved in one sweep.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
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

WORK_COLUMNS = 8
"""Columns of the scratch array that `link` and `fill_turns` use; a row per phase."""

STEP_COLUMNS = 7
"""Numbers of a footstep: foot, x, y [m], yaw [rad], single and double support [s],
clearance [m]."""


def plan_table(plan: FootstepPlan, pendulum: Pendulum) -> np.ndarray:
    """Return the table of a plan's pattern, `make_pattern(plan, pendulum).table`.

    Args:
        plan: Footsteps with times.
        pendulum: Gives omega_n and c_z.

    Returns:
        The phases, (k, `rows.PHASE_SIZE`), for `lookup.fill_reference`.

    Raises:
        PlanError: If a double support is too short for "minjerk".

    Example:
        >>> from comwalk.pattern import Gait, plan_steps
        >>> plan_table(plan_steps(Gait(), 2), Pendulum()).shape
        (11, 44)
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
    numbers = (number for step in plan.steps for number in _numbers_of(step))
    steps = np.fromiter(numbers, float, STEP_COLUMNS * len(plan.steps))
    steps = steps.reshape(-1, STEP_COLUMNS)
    stands = np.array([-1.0 if s.stand is None else s.stand for s in plan.steps])
    pauses = int(np.count_nonzero(stands[:-1] >= 0.0))
    table = np.empty((2 * len(steps) + 5 + 4 * pauses, r.PHASE_SIZE))
    work = np.empty((len(table), WORK_COLUMNS))
    poses = [(foot.x, foot.y, foot.yaw) for foot in (plan.left, plan.right)]
    feet = np.ravel(poses)
    times = np.array([plan.stand_time, plan.start_time, plan.stop_time])
    fill_plan(table, steps, stands, feet, times, omega, minjerk, work)
    return table


def _standing_table(plan: FootstepPlan) -> np.ndarray:
    """Return the one phase of a plan without steps."""
    table = np.zeros((1, r.PHASE_SIZE))
    poses = [(foot.x, foot.y, foot.yaw) for foot in (plan.left, plan.right)]
    still(
        table[0], 0.0, 2 * plan.stand_time, STAND, 0.0, 0.0, 0.0, 0.0, np.ravel(poses)
    )
    yaw = mean_yaw(table[0], float(plan.left.yaw))
    set_turn(table[0], 0.0, 1.0, yaw, 0.0, yaw, 0.0, 1.0)
    return table


def _numbers_of(step: Footstep) -> tuple[float, ...]:
    foot = 0.0 if step.side is Side.LEFT else 1.0
    S, D = step.single_support, step.double_support
    return foot, step.x, step.y, step.yaw, S, D, step.swing_height


@kernel
def fill_plan(
    table: np.ndarray,
    steps: np.ndarray,
    stands: np.ndarray,
    feet: np.ndarray,
    times: np.ndarray,
    omega: float,
    minjerk: bool,
    work: np.ndarray,
) -> None:
    """Fill the table of a plan.

    Args:
        table: Where to write, 2 n + 5 rows and four more per pause.
        steps: The n footsteps, (n, `STEP_COLUMNS`), n > 0.
        stands: Pause after each step [s], negative for none, (n,).
        feet: x, y [m], yaw [rad] of the left, then of the right foot; (6,), which then
            holds where they are at the end.
        times: Times of standing, starting and stopping [s], (3,).
        omega: Natural frequency omega_n [rad/s].
        minjerk: Whether the ZMP crosses by minimum jerk.
        work: Scratch, as many rows as the table.
    """
    stand, start, stop = times[0], times[1], times[2]
    begin, i, time = 0, 0, 0.0
    while begin < len(steps):
        end = begin + 1
        while end < len(steps) and stands[end - 1] < 0.0:
            end += 1
        base = 1.0 - steps[begin, 0]
        still(table[i], time, stand, STAND, begin, base, 0.0, 0.0, feet)
        still(table[i + 1], time + stand, start, START, begin, base, 0.0, 1.0, feet)
        first, i = i + 1, i + 2
        for k in range(begin, end):
            add_double(table, i, feet, 1.0 - steps[k, 0], steps[k, 5])
            add_single(table, i + 1, feet, steps[k])
            i += 2
        stand = times[0] if end == len(steps) else stands[end - 1]
        add_end(table, i, feet, steps[end - 1, 5], stop, stand)
        kappa = fill_start(table[first], omega, minjerk)
        x, y = weight_point(table[first], 0)
        link(table, first + 1, i + 1, omega, minjerk, kappa, kappa * x, kappa * y, work)
        place_start(table[first], work[0, 2], work[0, 3])
        fill_turns(table, first - 1, i + 2, work)
        begin, i, time = end, i + 2, table[i + 2, r.START]


# Rows of phases.


@kernel
def still(
    piece: np.ndarray,
    start: float,
    duration: float,
    kind: int,
    landed: float,
    base: float,
    walking_0: float,
    walking_1: float,
    feet: np.ndarray,
) -> None:
    """Write a phase in which both feet bear the same and the CoM rests between them."""
    piece[:] = 0.0
    piece[r.START], piece[r.DURATION] = start, duration
    piece[r.KIND], piece[r.LANDED] = kind, landed
    piece[r.BASES] = piece[r.BASES + 1] = base
    piece[r.LOADS] = piece[r.LOADS + 1] = 0.5
    piece[r.BLENDS], piece[r.BLENDS + 1] = walking_0, walking_1
    piece[r.SWINGING] = -1.0
    piece[r.RESTING : r.RESTING + 6] = feet
    piece[r.CURVE_X], piece[r.CURVE_Y] = weight_point(piece, 0)


@kernel
def add_double(
    table: np.ndarray, i: int, feet: np.ndarray, base: float, duration: float
) -> None:
    """Write the double support after row i - 1 that brings the weight on one foot."""
    before, piece = table[i - 1], table[i]
    start, landed = after(before)
    still(piece, start, duration, DOUBLE, landed, base, 1.0, 1.0, feet)
    piece[r.BASES], piece[r.LOADS] = before[r.BASES + 1], before[r.LOADS + 1]
    piece[r.LOADS + 1] = 1.0 - base


@kernel
def add_single(table: np.ndarray, i: int, feet: np.ndarray, step: np.ndarray) -> None:
    """Write the single support of a footstep after row i - 1; the feet then move."""
    piece, foot = table[i], int(step[0])
    start, landed = after(table[i - 1])
    kind = SINGLE_RIGHT if foot == 0 else SINGLE_LEFT
    still(piece, start, step[4], kind, landed, 1.0 - foot, 1.0, 1.0, feet)
    piece[r.LOADS] = piece[r.LOADS + 1] = float(foot)
    piece[r.SWINGING], piece[r.CLEARANCE] = foot, step[6]
    at = 3 * foot
    piece[r.TRAVEL] = step[1] - feet[at]
    piece[r.TRAVEL + 1] = step[2] - feet[at + 1]
    piece[r.TRAVEL + 2] = wrapped(step[3] - feet[at + 2])
    feet[at], feet[at + 1] = step[1], step[2]
    feet[at + 2] += piece[r.TRAVEL + 2]


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
    base = table[i - 1, r.BASES + 1]
    add_double(table, i, feet, base, double)
    table[i, r.LOADS + 1] = 0.5
    start, landed = after(table[i])
    still(table[i + 1], start, stop, STOP, landed, base, 1.0, 0.0, feet)
    start, landed = after(table[i + 1])
    still(table[i + 2], start, stand, STAND, landed, base, 0.0, 0.0, feet)


@kernel
def after(piece: np.ndarray) -> tuple[float, float]:
    """Return when a phase ends, and how many footsteps have landed then."""
    landed = piece[r.LANDED] + (1.0 if piece[r.SWINGING] >= 0.0 else 0.0)
    return piece[r.START] + piece[r.DURATION], landed


@kernel
def weight_point(piece: np.ndarray, end: int) -> tuple[float, float]:
    """Return the point between the feet where the weight is at an end (0 or 1) [m]."""
    left, at = piece[r.LOADS + end], r.RESTING
    x = left * piece[at] + (1.0 - left) * piece[at + 3]
    y = left * piece[at + 1] + (1.0 - left) * piece[at + 4]
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
        work: Scratch; columns 2 and 3 then hold u [m] in rows 0, 1, ...
    """
    n = last - first
    work[: n + 1, :4] = 0.0
    work[0, 0], work[0, 2], work[0, 3] = kappa, load_x, load_y
    for k in range(n):
        piece = table[first + k]
        if int(piece[r.KIND]) == DOUBLE and not minjerk:
            rate = 1.0 / piece[r.DURATION]
            work[k, 0] += rate
            work[k + 1, 0] += rate
            work[k, 1] = -rate
        else:
            fill_particular(piece, omega, minjerk)
            add_pendulum(piece, omega, work[k], work[k + 1])
    stop = fill_start(table[last], omega, minjerk)
    x, y = weight_point(table[last], 0)
    work[n, 0] += stop
    work[n, 2] += stop * x
    work[n, 3] += stop * y
    solve(work, n + 1)
    for k in range(n):
        place(table[first + k], work[k], work[k + 1], minjerk)
    place_start(table[last], work[n, 2], work[n, 3])
    reverse(table[last])


@kernel
def fill_particular(piece: np.ndarray, omega: float, minjerk: bool) -> None:
    """Fill the polynomial CoM of a phase, as `pattern` derives it from its ZMP."""
    angle = omega * piece[r.DURATION]
    piece[r.INVERSE_SINH] = 1.0 / math.sinh(angle)
    a_2 = 1.0 / (angle * angle)
    a_4 = a_2 * a_2
    ends_0, ends_1 = weight_point(piece, 0), weight_point(piece, 1)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        p = ends_0[axis]
        q[0], q[1], q[2], q[3], q[4], q[5] = p, 0.0, 0.0, 0.0, 0.0, 0.0
        if int(piece[r.KIND]) == DOUBLE:
            d = ends_1[axis] - p
            q[0] = p - 360.0 * d * a_4
            q[1] = 60.0 * d * a_2 + 720.0 * d * a_4
            q[2] = -180.0 * d * a_2
            q[3] = 10.0 * d + 120.0 * d * a_2
            q[4], q[5] = -15.0 * d, 6.0 * d


@kernel
def add_pendulum(
    piece: np.ndarray, omega: float, here: np.ndarray, there: np.ndarray
) -> None:
    """Add the link of a phase that is a pendulum to the system."""
    S = piece[r.DURATION]
    b = omega * piece[r.INVERSE_SINH]
    a = omega / math.tanh(omega * S)
    here[0] += a
    there[0] += a
    here[1] = -b
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        q_1, dq_1 = polynomial_end(q)
        here[2 + axis] += q[1] / S + a * q[0] - b * q_1
        there[2 + axis] += -dq_1 / S + a * q_1 - b * q[0]


@kernel
def polynomial_end(q: np.ndarray) -> tuple[float, float]:
    """Return the value and the slope at 1 of a polynomial of degree 5."""
    value = q[0] + q[1] + q[2] + q[3] + q[4] + q[5]
    return value, q[1] + 2.0 * q[2] + 3.0 * q[3] + 4.0 * q[4] + 5.0 * q[5]


@kernel
def solve(work: np.ndarray, n: int) -> None:
    """Solve the tridiagonal system: diagonal, off-diagonal, two right sides."""
    for k in range(1, n):
        share = work[k - 1, 1] / work[k - 1, 0]
        work[k, 0] -= share * work[k - 1, 1]
        work[k, 2] -= share * work[k - 1, 2]
        work[k, 3] -= share * work[k - 1, 3]
    for k in range(n - 1, -1, -1):
        for axis in range(2, 4):
            if k < n - 1:
                work[k, axis] -= work[k, 1] * work[k + 1, axis]
            work[k, axis] /= work[k, 0]


@kernel
def place(
    piece: np.ndarray, here: np.ndarray, there: np.ndarray, minjerk: bool
) -> None:
    """Fill the rest of a phase's curves from the CoM at its ends."""
    straight = int(piece[r.KIND]) == DOUBLE and not minjerk
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        c_0, c_1 = here[2 + axis], there[2 + axis]
        if straight:
            q[0], q[1] = c_0, c_1 - c_0
        else:
            q[6], q[7] = c_0 - q[0], c_1 - polynomial_end(q)[0]


@kernel
def fill_start(piece: np.ndarray, omega: float, minjerk: bool) -> float:
    """Fill a start over a unit distance from 0; return its end speed kappa [1/s]."""
    S, q = piece[r.DURATION], piece[r.CURVE_X : r.CURVE_X + 8]
    q[:] = 0.0
    if not minjerk:
        eta = START_SPEED
        q[3], q[4], q[5] = 10.0 - 4.0 * eta, 7.0 * eta - 15.0, 6.0 - 3.0 * eta
        piece[r.CURVE_Y : r.CURVE_Y + 8] = q
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
    q /= way
    piece[r.INVERSE_SINH] = 1.0 / sinh
    piece[r.CURVE_Y : r.CURVE_Y + 8] = q
    return speed / way


@kernel
def place_start(piece: np.ndarray, u_x: float, u_y: float) -> None:
    """Scale the unit start of a phase to a way from the middle of the feet to u."""
    middle = weight_point(piece, 0)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        q *= (u_x if axis == 0 else u_y) - middle[axis]
        q[0] += middle[axis]


@kernel
def reverse(piece: np.ndarray) -> None:
    """Make the curves of a phase run backward in time."""
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        for i in range(5):
            for j in range(4, i - 1, -1):
                q[j] += q[j + 1]
        for j in range(1, 6, 2):
            q[j] = -q[j]
        q[6], q[7] = q[7], q[6]


# The heading.
