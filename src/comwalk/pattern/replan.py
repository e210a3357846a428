"""Plan the phases that lie ahead while walking, as kernels on the table in use."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
from . import phases as p
from . import records as r
from .placement import MAX_STRIDE, MAX_TOE
from .reference import DOUBLE, STAND, START, STOP, fill_reference
from .turns import collect_knots, mean_yaw, set_turn, set_turns, wrapped

_LENGTH, _SHIFT, _TURN, _WIDTH = 0, 1, 2, 3  # of a step: 2 B, sideways, turn, A


_SINGLE, _DOUBLE, _CLEARANCE, _START, _STOP = 4, 5, 6, 7, 8  # times and height


_WALK, _GIVEN, _GIVEN_POSE = 9, 10, 11  # whether to walk, one foothold of one's own


_AHEAD, _LEAST, _MINJERK, _OMEGA, _SOLE, _FIRST = 14, 15, 16, 17, 18, 20


_COMMAND_SIZE = 21


_ROWS, _KNOT, _KNOT_YAW = 0, 1, 2  # rows of the table in use, last knot of the heading


_LAST_SINGLE, _LAST_DOUBLE, _LAST_CLEARANCE = 3, 4, 5  # of the last step that landed


_STATE_SIZE = 6


@kernel
def advance(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    work: np.ndarray,
    time: float,
    height: float,
    references: np.ndarray,
) -> bool:
    """Go on to a time and write its reference into a record, or to a landing before it.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, two rows more than the table.
        time: Time [s], not before the last one.
        height: Height of the CoM [m].
        references: Where to write, one record of `REFERENCE`.

    Returns:
        Whether a foot has just landed: then the record is not written yet.
    """
    while state[_ROWS] > 1.0 and time >= table[1, r.START]:
        landed = leave(table, state)
        kind, begin = int(table[0, r.KIND]), table[0, r.START]
        if kind == DOUBLE:
            state[_KNOT_YAW] = mean_yaw(table[0], state[_KNOT_YAW])
            state[_KNOT] = begin
        elif kind != STOP and kind != START:
            if kind != STAND:
                command[_GIVEN] = 0.0
            replan(table, state, command, work, begin)
        if landed:
            return True
    fill_reference(table[:1], command[_OMEGA], height, time, references[0])
    return False


@kernel
def leave(table: np.ndarray, state: np.ndarray) -> bool:
    """Forget the phase that is over; return whether a foot landed at its end."""
    landed = table[0, r.SWINGING] >= 0.0
    if landed:
        state[_LAST_SINGLE] = table[0, r.DURATION]
        state[_LAST_CLEARANCE] = table[0, r.CLEARANCE]
    elif int(table[0, r.KIND]) == DOUBLE:
        state[_LAST_DOUBLE] = table[0, r.DURATION]
    count = int(state[_ROWS])
    for i in range(count - 1):
        table[i] = table[i + 1]
    state[_ROWS] = count - 1
    return landed


@kernel
def replan(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    work: np.ndarray,
    time: float,
) -> bool:
    """Make all phases anew that have not begun, and the rest of this one.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, two rows more than the table.
        time: Time of now [s].

    Returns:
        Whether there is a new plan: a robot that stops first comes to rest.
    """
    kept = kept_rows(table, state, command, time)
    if kept == 0:
        if int(table[0, r.KIND]) == STAND:
            state[_ROWS] = 1.0
        return False
    omega, minjerk = command[_OMEGA], command[_MINJERK] != 0.0
    if int(table[0, r.KIND]) == STAND:
        begin_walk(table, state, command, time)
    double = int(table[kept - 1, r.KIND]) == DOUBLE
    pivot = kept if double else kept - 1
    since = max(time - table[pivot, r.START], 0.0)
    stop = add_steps(table, kept, command, work)
    state[_ROWS] = stop + 2
    if int(table[0, r.KIND]) == STAND:
        kappa = p.fill_start(table[1], omega, minjerk)
        x, y = p.weight_point(table[1], 0)
        p.link(table, 2, stop, omega, minjerk, kappa, kappa * x, kappa * y, work)
        p.place_start(table[1], work[0, 2], work[0, 3])
    else:
        if pivot > 0:
            fill_from_state(table[pivot - 1], table[pivot], omega)
        shift(table, pivot, stop, since, omega, minjerk, work)
    turn(table, state, command, stop + 1, time, work)
    return True


@kernel
def kept_rows(
    table: np.ndarray, state: np.ndarray, command: np.ndarray, time: float
) -> int:
    """Return how many phases stay as they are, or 0 if nothing can change."""
    kind, count = int(table[0, r.KIND]), int(state[_ROWS])
    if kind == STAND:
        return 2 if command[_WALK] + command[_GIVEN] > 0.0 else 0
    if kind == STOP:
        return 0
    late = table[0, r.START] + table[0, r.DURATION] - time < command[_LEAST]
    kept = 1 if kind == DOUBLE or not late else 2
    last = table[kept - 1]
    ends = int(last[r.KIND]) == DOUBLE and last[r.LOADS + 1] == 0.5
    return 0 if ends or kept >= count else kept


@kernel
def begin_walk(
    table: np.ndarray, state: np.ndarray, command: np.ndarray, time: float
) -> None:
    """Write the start from rest after the row of standing."""
    stand = table[0]
    begin = max(time, stand[r.START] + stand[r.DURATION])
    stand[r.DURATION] = begin - stand[r.START]
    base = 1.0 - command[_FIRST]
    feet = stand[r.RESTING : r.RESTING + 6]
    landed, yaw = stand[r.LANDED], stand[r.TURN + 3]
    p.still(table[1], begin, command[_START], START, landed, base, 0.0, 1.0, feet)
    stand[r.BASES] = stand[r.BASES + 1] = base
    state[_KNOT], state[_KNOT_YAW] = begin, mean_yaw(stand, yaw)
    for row in range(2):
        piece, yaw = table[row], state[_KNOT_YAW]
        set_turn(piece, begin, 1.0, yaw, 0.0, yaw, 0.0, begin)


@kernel
def add_steps(
    table: np.ndarray, kept: int, command: np.ndarray, work: np.ndarray
) -> int:
    """Write the steps after the phases that are kept; return the row of the stop."""
    last = table[kept - 1]
    kind = int(last[r.KIND])
    feet, step, i = work[-1, :6], work[-2], kept
    foot = feet_after(last, feet)
    swinging = last[r.SWINGING]
    step[4], step[5], step[6] = command[_SINGLE], command[_DOUBLE], command[_CLEARANCE]
    ahead = int(command[_AHEAD]) + (0 if swinging >= 0.0 else 1)
    walking = ahead - 1 if command[_WALK] != 0.0 else 0
    body = body_beside(feet[3 - 3 * foot : 6 - 3 * foot], 1 - foot, command[_WIDTH])
    n = 0
    while True:
        closing = n >= walking and not (n == 0 and command[_GIVEN] != 0.0)
        body = next_foothold(feet, foot, body, n, closing, command, step)
        if closing and n + (swinging >= 0.0) > 0 and is_there(feet, foot, step):
            break
        if i > kept or kind != DOUBLE:
            p.add_double(table, i, feet, float(1 - foot), command[_DOUBLE])
            i += 1
        p.add_single(table, i, feet, step)
        i, n, foot = i + 1, n + 1, 1 - foot
        if closing:
            break
    p.add_end(table, i, feet, command[_DOUBLE], command[_STOP], 0.0)
    return i + 1


@kernel
def feet_after(piece: np.ndarray, feet: np.ndarray) -> int:
    """Write where the feet are when a phase ends; return which one swings next."""
    feet[:] = piece[r.RESTING : r.RESTING + 6]
    swinging = int(piece[r.SWINGING])
    if swinging < 0:
        return 1 - int(piece[r.BASES + 1])
    for k in range(3):
        feet[3 * swinging + k] += piece[r.TRAVEL + k]
    return 1 - swinging


@kernel
def body_beside(
    pose: np.ndarray, foot: int, half_width: float
) -> tuple[float, float, float]:
    """Return the pose of the body that has a foot of a pose at its side."""
    x, y, yaw = pose[0], pose[1], pose[2]
    across = -half_width if foot == 0 else half_width
    return x - math.sin(yaw) * across, y + math.cos(yaw) * across, yaw


@kernel
def next_foothold(
    feet: np.ndarray,
    foot: int,
    body: tuple[float, float, float],
    n: int,
    closing: bool,
    command: np.ndarray,
    step: np.ndarray,
) -> tuple[float, float, float]:
    """Write where a foot goes next into a step; return where the body is then."""
    step[0] = foot
    if n == 0 and command[_GIVEN] != 0.0:
        step[1:4] = command[_GIVEN_POSE : _GIVEN_POSE + 3]
        return body_beside(step[1:4], foot, command[_WIDTH])
    x, y, yaw = body
    if not closing:
        leading = 0 if command[_SHIFT] > 0.0 else 1
        shift = 2.0 * command[_SHIFT] if foot == leading else 0.0
        half = yaw + 0.5 * command[_TURN]
        cos, sin, ahead = math.cos(half), math.sin(half), command[_LENGTH]
        x, y = x + cos * ahead - sin * shift, y + sin * ahead + cos * shift
        yaw += command[_TURN]
    across = command[_WIDTH] if foot == 0 else -command[_WIDTH]
    step[1], step[2] = x - math.sin(yaw) * across, y + math.cos(yaw) * across
    step[3] = yaw
    if shorten(feet, foot, step, command):
        return body_beside(step[1:4], foot, command[_WIDTH])
    return x, y, yaw


@kernel
def is_there(feet: np.ndarray, foot: int, step: np.ndarray) -> bool:
    """Return whether a foot already stands where a step would put it."""
    at = 3 * foot
    far = max(abs(feet[at] - step[1]), abs(feet[at + 1] - step[2]))
    return max(far, abs(wrapped(feet[at + 2] - step[3]))) < 1e-9


@kernel
def shorten(feet: np.ndarray, foot: int, step: np.ndarray, command: np.ndarray) -> bool:
    """Move a foothold toward the place beside the other foot until it is walkable.

    Returns:
        Whether it had to be moved.
    """
    if is_walkable(feet, foot, step, command):
        return False
    at = 3 * (1 - foot)
    x, y, yaw = feet[at], feet[at + 1], feet[at + 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = step[1] - x, step[2] - y
    ahead, across = cos * dx + sin * dy, cos * dy - sin * dx
    turn = wrapped(step[3] - yaw)
    beside = 2.0 * command[_WIDTH] * (1.0 if foot == 0 else -1.0)
    for k in range(1, 9):
        factor = 1.0 - 0.125 * k
        a, b = factor * ahead, beside + factor * (across - beside)
        step[1], step[2] = x + cos * a - sin * b, y + sin * a + cos * b
        step[3] = yaw + factor * turn
        if is_walkable(feet, foot, step, command):
            break
    return True


@kernel
def is_walkable(
    feet: np.ndarray, foot: int, step: np.ndarray, command: np.ndarray
) -> bool:
    """Return whether a step keeps the rules of `footsteps.FootstepPlan`."""
    at, other = 3 * foot, 3 * (1 - foot)
    dx, dy = step[1] - feet[at], step[2] - feet[at + 1]
    turn = wrapped(step[3] - feet[at + 2])
    x, y, yaw = feet[other], feet[other + 1], feet[other + 2]
    ax, ay = step[1] - x, step[2] - y
    across = math.cos(yaw) * ay - math.sin(yaw) * ax
    sign = 1.0 if foot == 0 else -1.0
    if math.hypot(dx, dy) > MAX_STRIDE or math.hypot(ax, ay) > MAX_STRIDE:
        return False
    if abs(wrapped(step[3] - yaw)) > MAX_TOE or sign * across <= 0.0:
        return False
    for k in range(11):
        s = 0.1 * k
        gap = sole_gap(
            feet[at] + s * dx - x,
            feet[at + 1] + s * dy - y,
            yaw,
            feet[at + 2] + s * turn,
            0.5 * command[_SOLE],
            0.5 * command[_SOLE + 1],
        )
        if gap <= 0.0:
            return False
    return True


@kernel
def sole_gap(
    dx: float, dy: float, yaw_0: float, yaw_1: float, length: float, width: float
) -> float:
    """Return how far two soles are apart along their best separating axis [m].

    Args:
        dx: From the one to the other, world [m].
        dy: From the one to the other, world [m].
        yaw_0: Heading of the one [rad].
        yaw_1: Heading of the other [rad].
        length: Half the length of both [m].
        width: Half their width [m].
    """
    turn = yaw_1 - yaw_0
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    reach_x = length + length * along + width * across
    reach_y = width + length * across + width * along
    best = -math.inf
    for yaw in (yaw_0, yaw_1):
        cos, sin = math.cos(yaw), math.sin(yaw)
        best = max(best, abs(cos * dx + sin * dy) - reach_x)
        best = max(best, abs(cos * dy - sin * dx) - reach_y)
    return best


@kernel
def given_is_walkable(table: np.ndarray, command: np.ndarray, work: np.ndarray) -> bool:
    """Return whether the foothold of one's own can be stepped on."""
    last, feet, step = table[0], work[-1, :6], work[-2]
    kind = int(last[r.KIND])
    foot = feet_after(last, feet)
    rests = kind == STAND or kind == STOP
    if rests or (kind == DOUBLE and last[r.LOADS + 1] == 0.5):
        foot = int(command[_FIRST])
    step[1:4] = command[_GIVEN_POSE : _GIVEN_POSE + 3]
    return is_walkable(feet, foot, step, command)


@kernel
def end_state(piece: np.ndarray, axis: int, omega: float) -> tuple[float, float]:
    """Return CoM [m] and velocity [m/s] of one axis at the end of a phase."""
    q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
    S, csch = piece[r.DURATION], piece[r.INVERSE_SINH]
    c, slope = p.polynomial_end(q)
    v = slope / S
    if csch != 0.0:
        c += q[7]
        v += omega * (q[7] / math.tanh(omega * S) - q[6] * csch)
    return c, v


@kernel
def fill_from_state(before: np.ndarray, piece: np.ndarray, omega: float) -> None:
    """Fill the curves of a single support from the end of the phase before it."""
    angle = omega * piece[r.DURATION]
    sinh, cosh = math.sinh(angle), math.cosh(angle)
    piece[r.INVERSE_SINH] = 1.0 / sinh
    foot = p.weight_point(piece, 0)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        c, v = end_state(before, axis, omega)
        q[:] = 0.0
        q[0] = foot[axis]
        q[6] = c - foot[axis]
        q[7] = cosh * q[6] + sinh * v / omega


@kernel
def shift(
    table: np.ndarray,
    pivot: int,
    stop: int,
    since: float,
    omega: float,
    minjerk: bool,
    work: np.ndarray,
) -> None:
    """Shift the ZMP of the rest of a phase by delta, and plan what comes after it.

    Args:
        table: The phases.
        pivot: Row of the phase that is shifted.
        stop: Row of the stop.
        since: Time since its start [s].
        omega: Natural frequency omega_n [rad/s].
        minjerk: Whether the ZMP crosses by minimum jerk.
        work: Scratch.
    """
    piece = table[pivot]
    S = piece[r.DURATION]
    tau = S - since
    kappa = omega / math.tanh(0.5 * omega * tau)
    c_x, v_x = end_state(piece, 0, omega)
    c_y, v_y = end_state(piece, 1, omega)
    load_x, load_y = kappa * c_x - v_x, kappa * c_y - v_y
    p.link(table, pivot + 1, stop, omega, minjerk, kappa, load_x, load_y, work)
    rest, gone = math.cosh(omega * tau), math.cosh(omega * since)
    piece[r.INVERSE_SINH] = 1.0 / math.sinh(omega * S)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        free = c_x if axis == 0 else c_y
        delta = (work[0, 2 + axis] - free) / (1.0 - rest)
        q[0] += delta
        q[6] -= delta * gone
        q[7] -= delta * rest


@kernel
def turn(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    last: int,
    time: float,
    work: np.ndarray,
) -> None:
    """Fill the headings anew, from the heading and its rate now on."""
    piece = table[0]
    stands = int(piece[r.KIND]) == STAND
    work[0, 4], work[0, 5] = state[_KNOT], state[_KNOT_YAW]
    n = collect_knots(table, 2 if stands else 1, last, work)
    if stands:
        work[0, 6] = 0.0
        set_turns(table, 2, last, n, work)
        table[0, r.TURN_END] = table[1, r.TURN_END] = work[n - 1, 4]
        return
    left = work[1, 4] - time
    if left < command[_LEAST]:
        work[1, 6] = heading_at(piece, work[1, 4])[1]
    work[0, 4] = time
    work[0, 5], work[0, 6] = heading_at(piece, time)
    set_turns(table, 0 if left > 1e-6 else 1, last, n, work)
    piece[r.TURN_END] = work[n - 1, 4]


@kernel
def heading_at(piece: np.ndarray, time: float) -> tuple[float, float]:
    """Return the heading [rad] of a phase at a time [s], and its rate [rad/s]."""
    s = max(time - piece[r.TURN_START], 0.0)
    a, b = piece[r.TURN], piece[r.TURN + 1]
    c, d = piece[r.TURN + 2], piece[r.TURN + 3]
    return ((a * s + b) * s + c) * s + d, (3.0 * a * s + 2.0 * b) * s + c
