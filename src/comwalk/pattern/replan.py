"""Replanning of the phases ahead while walking, as kernels on the table in use."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..handles import records_at
from . import phases as p
from .placement import MAX_STRIDE, MAX_TOE
from .records import COMMAND, ONLINE, PHASE, REFERENCE, WORK
from .reference import DOUBLE, STAND, START, STOP, fill_reference
from .turns import collect_knots, mean_yaw, set_turn, set_turns, wrapped


@kernel
def advance(handle: np.ndarray, time: float) -> bool:
    """Go on to a time and write its reference into a record, or to a landing before it.

    Args:
        handle: The phases from now on; one `ONLINE`, one `COMMAND`; scratch, as many
            records of `WORK` as phases; the record of `REFERENCE` to write.
        time: Time [s], not before the last one.

    Returns:
        Whether a foot has just landed: then the record is not written yet.
    """
    table, work = records_at(handle, 0, PHASE), records_at(handle, 3, WORK)
    state, command = records_at(handle, 1, ONLINE)[0], records_at(handle, 2, COMMAND)[0]
    reference = records_at(handle, 4, REFERENCE)[0]
    while state.rows > 1 and time >= table[1].start:
        landed = leave(table, state)
        kind, begin = table[0].kind, table[0].start
        if kind == DOUBLE:
            state.knot_yaw = mean_yaw(table[0], state.knot_yaw)
            state.knot = begin
        elif kind != STOP and kind != START:
            if kind != STAND:
                command.given = False
            replan(table, state, command, work, begin)
        if landed:
            return True
    fill_reference(table[:1], command.omega, command.height, time, reference)
    return False


@kernel
def leave(table: np.ndarray, state: Record) -> bool:
    """Forget the phase that is over; return whether a foot landed at its end."""
    landed = table[0].swinging >= 0
    if landed:
        state.single = table[0].duration
        state.clearance = table[0].clearance
    elif table[0].kind == DOUBLE:
        state.double = table[0].duration
    count = state.rows
    for i in range(count - 1):
        table[i] = table[i + 1]
    state.rows = count - 1
    return landed


@kernel
def replan(
    table: np.ndarray,
    state: Record,
    command: Record,
    work: np.ndarray,
    time: float,
) -> bool:
    """Make all phases anew that have not begun, and the rest of this one.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, as many rows as the table.
        time: Time of now [s].

    Returns:
        Whether there is a new plan: a robot that stops first comes to rest.
    """
    kept = kept_rows(table, state, command, time)
    if kept == 0:
        if table[0].kind == STAND:
            state.rows = 1
        return False
    omega, minjerk = command.omega, command.minjerk
    if table[0].kind == STAND:
        begin_walk(table, state, command, time)
    double = table[kept - 1].kind == DOUBLE
    pivot = kept if double else kept - 1
    since = max(time - table[pivot].start, 0.0)
    stop = add_steps(table, kept, state, command)
    state.rows = stop + 2
    if table[0].kind == STAND:
        kappa = p.fill_start(table[1], omega, minjerk)
        x, y = p.weight_point(table[1], 0)
        p.link(table, 2, stop, omega, minjerk, kappa, kappa * x, kappa * y, work)
        p.place_start(table[1], work[0].com)
    else:
        if pivot > 0:
            fill_from_state(table[pivot - 1], table[pivot], omega)
        shift(table, pivot, stop, since, omega, minjerk, work)
    turn(table, state, command, stop + 1, time, work)
    return True


@kernel
def kept_rows(table: np.ndarray, state: Record, command: Record, time: float) -> int:
    """Return the number of phases to keep, or 0 if nothing can change."""
    kind, count = table[0].kind, state.rows
    if kind == STAND:
        return 2 if command.walk or command.given else 0
    if kind == STOP:
        return 0
    late = table[0].start + table[0].duration - time < command.least
    kept = 1 if kind == DOUBLE or not late else 2
    last = table[kept - 1]
    ends = last.kind == DOUBLE and last.loads[1] == 0.5
    return 0 if ends or kept >= count else kept


@kernel
def begin_walk(table: np.ndarray, state: Record, command: Record, time: float) -> None:
    """Write the start from rest after the row of standing."""
    stand = table[0]
    begin = max(time, stand.start + stand.duration)
    stand.duration = begin - stand.start
    base = 1 - command.first
    feet, landed, yaw = stand.resting, stand.landed, stand.turn[3]
    p.still(table[1], begin, command.start, START, landed, base, 0.0, 1.0, feet)
    stand.bases[0] = stand.bases[1] = base
    state.knot, state.knot_yaw = begin, mean_yaw(stand, yaw)
    for row in range(2):
        piece, yaw = table[row], state.knot_yaw
        set_turn(piece, begin, 1.0, yaw, 0.0, yaw, 0.0, begin)


@kernel
def add_steps(table: np.ndarray, kept: int, state: Record, command: Record) -> int:
    """Write the steps after the phases that are kept; return the row of the stop."""
    last, feet, step, i = table[kept - 1], state.feet, state.step[0], kept
    kind = last.kind
    foot = feet_after(last, feet)
    swinging = last.swinging
    step.single, step.clearance = command.single, command.clearance
    step.double = command.double
    ahead = command.ahead + (0 if swinging >= 0 else 1)
    walking = ahead - 1 if command.walk else 0
    body = body_beside(feet[1 - foot], 1 - foot, command.width)
    n = 0
    while True:
        closing = n >= walking and not (n == 0 and command.given)
        body = next_foothold(feet, foot, body, n, closing, command, step)
        if closing and n + (swinging >= 0) > 0 and is_there(feet[foot], step.pose):
            break
        if i > kept or kind != DOUBLE:
            p.add_double(table, i, feet, 1 - foot, command.double)
            i += 1
        p.add_single(table, i, feet, step)
        i, n, foot = i + 1, n + 1, 1 - foot
        if closing:
            break
    p.add_end(table, i, feet, command.double, command.stop, 0.0)
    return i + 1


@kernel
def feet_after(piece: Record, feet: np.ndarray) -> int:
    """Write where the feet are when a phase ends; return which one swings next."""
    for k in range(3):
        feet[0, k], feet[1, k] = piece.resting[0, k], piece.resting[1, k]
    swinging = piece.swinging
    if swinging < 0:
        return 1 - piece.bases[1]
    for k in range(3):
        feet[swinging, k] += piece.travel[k]
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
    command: Record,
    step: Record,
) -> tuple[float, float, float]:
    """Write where a foot goes next into a step; return where the body is then."""
    step.foot, at = foot, step.pose
    if n == 0 and command.given:
        for k in range(3):
            at[k] = command.foothold[k]
        return body_beside(at, foot, command.width)
    x, y, yaw = body
    if not closing:
        leading = 0 if command.shift > 0.0 else 1
        shift = 2.0 * command.shift if foot == leading else 0.0
        half = yaw + 0.5 * command.turn
        cos, sin, ahead = math.cos(half), math.sin(half), command.length
        x, y = x + cos * ahead - sin * shift, y + sin * ahead + cos * shift
        yaw += command.turn
    across = command.width if foot == 0 else -command.width
    at[0], at[1] = x - math.sin(yaw) * across, y + math.cos(yaw) * across
    at[2] = yaw
    if shorten(feet, foot, at, command):
        return body_beside(at, foot, command.width)
    return x, y, yaw


@kernel
def is_there(foot: np.ndarray, at: np.ndarray) -> bool:
    """Return whether a foot already stands where a step would put it."""
    far = max(abs(foot[0] - at[0]), abs(foot[1] - at[1]))
    return max(far, abs(wrapped(foot[2] - at[2]))) < 1e-9


@kernel
def shorten(feet: np.ndarray, foot: int, at: np.ndarray, command: Record) -> bool:
    """Move a foothold toward the place beside the other foot until it is walkable.

    Returns:
        Whether it had to be moved.
    """
    if is_walkable(feet, foot, at, command):
        return False
    x, y, yaw = feet[1 - foot, 0], feet[1 - foot, 1], feet[1 - foot, 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = at[0] - x, at[1] - y
    ahead, across = cos * dx + sin * dy, cos * dy - sin * dx
    turn = wrapped(at[2] - yaw)
    beside = 2.0 * command.width * (1.0 if foot == 0 else -1.0)
    for k in range(1, 9):
        factor = 1.0 - 0.125 * k
        a, b = factor * ahead, beside + factor * (across - beside)
        at[0], at[1] = x + cos * a - sin * b, y + sin * a + cos * b
        at[2] = yaw + factor * turn
        if is_walkable(feet, foot, at, command):
            break
    return True


@kernel
def is_walkable(feet: np.ndarray, foot: int, at: np.ndarray, command: Record) -> bool:
    """Return whether a step keeps the rules of `footsteps.FootstepPlan`."""
    own, other = feet[foot], feet[1 - foot]
    dx, dy = at[0] - own[0], at[1] - own[1]
    turn = wrapped(at[2] - own[2])
    x, y, yaw = other[0], other[1], other[2]
    ax, ay = at[0] - x, at[1] - y
    across = math.cos(yaw) * ay - math.sin(yaw) * ax
    sign = 1.0 if foot == 0 else -1.0
    if math.hypot(dx, dy) > MAX_STRIDE or math.hypot(ax, ay) > MAX_STRIDE:
        return False
    if abs(wrapped(at[2] - yaw)) > MAX_TOE or sign * across <= 0.0:
        return False
    for k in range(11):
        s = 0.1 * k
        gap = sole_gap(
            own[0] + s * dx - x,
            own[1] + s * dy - y,
            yaw,
            own[2] + s * turn,
            0.5 * command.sole[0],
            0.5 * command.sole[1],
        )
        if gap <= 0.0:
            return False
    return True


@kernel
def sole_gap(
    dx: float, dy: float, yaw_0: float, yaw_1: float, length: float, width: float
) -> float:
    """Return the gap of two soles along their best separating axis [m].

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
def given_is_walkable(table: np.ndarray, state: Record, command: Record) -> bool:
    """Return whether the foothold of one's own can be stepped on."""
    last, feet = table[0], state.feet
    kind = last.kind
    foot = feet_after(last, feet)
    rests = kind == STAND or kind == STOP
    if rests or (kind == DOUBLE and last.loads[1] == 0.5):
        foot = command.first
    return is_walkable(feet, foot, command.foothold, command)


@kernel
def end_state(piece: Record, axis: int, omega: float) -> tuple[float, float]:
    """Return CoM [m] and velocity [m/s] of one axis at the end of a phase."""
    q = piece.curve[axis]
    S, csch = piece.duration, piece.inverse_sinh
    c, slope = p.polynomial_end(q)
    v = slope / S
    if csch != 0.0:
        c += q[7]
        v += omega * (q[7] / math.tanh(omega * S) - q[6] * csch)
    return c, v


@kernel
def fill_from_state(before: Record, piece: Record, omega: float) -> None:
    """Fill the curves of a single support from the end of the phase before it."""
    angle = omega * piece.duration
    sinh, cosh = math.sinh(angle), math.cosh(angle)
    piece.inverse_sinh = 1.0 / sinh
    foot = p.weight_point(piece, 0)
    for axis in range(2):
        q = piece.curve[axis]
        c, v = end_state(before, axis, omega)
        for k in range(8):
            q[k] = 0.0
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
    S = piece.duration
    tau = S - since
    kappa = omega / math.tanh(0.5 * omega * tau)
    c_x, v_x = end_state(piece, 0, omega)
    c_y, v_y = end_state(piece, 1, omega)
    load_x, load_y = kappa * c_x - v_x, kappa * c_y - v_y
    p.link(table, pivot + 1, stop, omega, minjerk, kappa, load_x, load_y, work)
    rest, gone = math.cosh(omega * tau), math.cosh(omega * since)
    piece.inverse_sinh = 1.0 / math.sinh(omega * S)
    for axis in range(2):
        q = piece.curve[axis]
        free = c_x if axis == 0 else c_y
        delta = (work[0].com[axis] - free) / (1.0 - rest)
        q[0] += delta
        q[6] -= delta * gone
        q[7] -= delta * rest


@kernel
def turn(
    table: np.ndarray,
    state: Record,
    command: Record,
    last: int,
    time: float,
    work: np.ndarray,
) -> None:
    """Fill the headings anew, from the heading and its rate now on."""
    piece = table[0]
    stands = piece.kind == STAND
    first = work[0]
    first.knot, first.yaw = state.knot, state.knot_yaw
    n = collect_knots(table, 2 if stands else 1, last, work)
    if stands:
        first.rate = 0.0
        set_turns(table, 2, last, n, work)
        table[0].turn_end = table[1].turn_end = work[n - 1].knot
        return
    left = work[1].knot - time
    if left < command.least:
        work[1].rate = heading_at(piece, work[1].knot)[1]
    first.knot = time
    first.yaw, first.rate = heading_at(piece, time)
    set_turns(table, 0 if left > 1e-6 else 1, last, n, work)
    piece.turn_end = work[n - 1].knot


@kernel
def heading_at(piece: Record, time: float) -> tuple[float, float]:
    """Return the heading [rad] of a phase at a time [s], and its rate [rad/s]."""
    s = max(time - piece.turn_start, 0.0)
    a, b = piece.turn[0], piece.turn[1]
    c, d = piece.turn[2], piece.turn[3]
    return ((a * s + b) * s + c) * s + d, (3.0 * a * s + 2.0 * b) * s + c
