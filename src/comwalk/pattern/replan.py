"""Replanning of the phases ahead while walking, as kernels on the table in use."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..handles import records_at
from . import phases as p
from .placement import is_walkable, shorten
from .records import COMMAND, ONLINE, PHASE, REFERENCE, STEP, WORK
from .reference import DOUBLE, STAND, START, STOP, fill_reference
from .turns import heading_at, mean_yaw, set_turn, turn, wrapped


@kernel
def advance(handle: np.ndarray, time: float) -> bool:
    """Go on to a time and write its reference into a record, or to a landing before it.

    Args:
        handle: The phases from now on; one `ONLINE`, one `COMMAND`; scratch, as many
            records of `WORK` as phases; the record of `REFERENCE` to write; the
            footsteps to follow, records of `STEP`.
        time: Time [s], not before the last one.

    Returns:
        Whether a foot has just landed: then the record is not written yet.
    """
    table, work = records_at(handle, 0, PHASE), records_at(handle, 3, WORK)
    state, command = records_at(handle, 1, ONLINE)[0], records_at(handle, 2, COMMAND)[0]
    reference, steps = records_at(handle, 4, REFERENCE)[0], records_at(handle, 5, STEP)
    while state.rows > 1 and time >= table[1].start:
        landed = leave(table, state)
        kind, begin = table[0].kind, table[0].start
        if kind == DOUBLE:
            state.knot_yaw = mean_yaw(table[0], state.knot_yaw)
            state.knot = begin
        elif kind != STOP and kind != START:
            if kind != STAND:
                command.given = False
            replan(table, state, command, work, steps, begin)
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
    steps: np.ndarray,
    time: float,
) -> bool:
    """Make all phases anew that have not begun, and the rest of this one.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, as many rows as the table.
        steps: The footsteps to follow.
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
        begin_walk(table, state, command, steps, time)
    double = table[kept - 1].kind == DOUBLE
    pivot = kept if double else kept - 1
    since = max(time - table[pivot].start, 0.0)
    stop = plan_ahead(table, kept, state, command, steps)
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
        follows = table[0].landed < command.steps
        return 2 if follows or command.walk or command.given else 0
    if kind == STOP:
        return 0
    late = table[0].start + table[0].duration - time < command.least
    kept = 1 if kind == DOUBLE or not late else 2
    last = table[kept - 1]
    ends = last.kind == DOUBLE and last.loads[1] == 0.5
    return 0 if ends or kept >= count else kept


@kernel
def begin_walk(
    table: np.ndarray, state: Record, command: Record, steps: np.ndarray, time: float
) -> None:
    """Write the start from rest after the row of standing."""
    stand = table[0]
    begin = max(time, stand.start + stand.duration)
    stand.duration = begin - stand.start
    feet, landed, yaw = stand.resting, stand.landed, stand.turn[3]
    first = steps[landed].foot if landed < command.steps else command.first
    base = 1 - first
    p.still(table[1], begin, command.start, START, landed, base, 0.0, 1.0, feet)
    stand.bases[0] = stand.bases[1] = base
    state.knot, state.knot_yaw = begin, mean_yaw(stand, yaw)
    for row in range(2):
        piece, yaw = table[row], state.knot_yaw
        set_turn(piece, begin, 1.0, yaw, 0.0, yaw, 0.0, begin)


@kernel
def plan_ahead(
    table: np.ndarray, kept: int, state: Record, command: Record, steps: np.ndarray
) -> int:
    """Write the steps after the phases that are kept; return the row of the stop."""
    if command.steps:
        return follow_steps(table, kept, state, command, steps)
    return add_steps(table, kept, state, command)


@kernel
def follow_steps(
    table: np.ndarray, kept: int, state: Record, command: Record, steps: np.ndarray
) -> int:
    """Write the next steps of a plan that is followed; return the row of the stop.

    A step that was moved takes along those after it, each of which comes back a bit.
    If some of it is left after the last one, a step brings the feet together.
    """
    last, feet, step, i = table[kept - 1], state.feet, state.step[0], kept
    foot, known = feet_after(last, feet), command.steps
    n = p.after(last)[1]
    x, y, double = moved_by(feet, steps, n, known, command)
    pauses = last.swinging >= 0 and 0 < n <= known and steps[n - 1].stand >= 0.0
    end = n if pauses else min(n + command.ahead, known)
    while n < end:
        x, y = brought_back(x, y, command.back)
        copy_step(steps[n], x, y, step)
        if x != 0.0 or y != 0.0:
            shorten(feet, step.foot, step.pose, command)
        i = add_step(table, i, kept, feet, step)
        n, double, foot = n + 1, step.double, 1 - step.foot
        if step.stand >= 0.0:
            break
    if n >= known and (x != 0.0 or y != 0.0):
        body = body_beside(feet[1 - foot], 1 - foot, command.width)
        step.single, step.double = command.single, command.double
        step.clearance = command.clearance
        next_foothold(feet, foot, body, 1, True, command, step)
        if not is_there(feet[foot], step.pose):
            i = add_step(table, i, kept, feet, step)
    pauses = 0 < n < known and steps[n - 1].stand >= 0.0
    stand = steps[n - 1].stand if pauses else command.stand
    p.add_end(table, i, feet, double, command.stop, stand)
    return i + 1


@kernel
def moved_by(
    feet: np.ndarray, steps: np.ndarray, n: int, known: int, command: Record
) -> tuple[float, float, float]:
    """Return by how much the last of n steps is away from its plan, and its transfer.

    Returns:
        The way, x and y [m], world; 1 m for one that no plan has; and the time of
        double support before it [s].
    """
    if n == 0:
        return 0.0, 0.0, command.double
    if n > known:
        return 1.0, 0.0, command.double
    step = steps[n - 1]
    x, y = feet[step.foot, 0] - step.pose[0], feet[step.foot, 1] - step.pose[1]
    if math.hypot(x, y) < 1e-9:
        return 0.0, 0.0, step.double
    return x, y, step.double


@kernel
def brought_back(x: float, y: float, most: float) -> tuple[float, float]:
    """Return a way [m] that is shorter by some length, at least 0."""
    far = math.hypot(x, y)
    left = 0.0 if far <= most else 1.0 - most / far
    return left * x, left * y


@kernel
def copy_step(planned: Record, x: float, y: float, step: Record) -> None:
    """Write a planned step, moved by x and y [m]."""
    step.foot, step.single, step.double = planned.foot, planned.single, planned.double
    step.clearance, step.stand = planned.clearance, planned.stand
    step.pose[0], step.pose[1] = planned.pose[0] + x, planned.pose[1] + y
    step.pose[2] = planned.pose[2]


@kernel
def add_step(
    table: np.ndarray, i: int, kept: int, feet: np.ndarray, step: Record
) -> int:
    """Write a step from row i on, with its transfer if missing; return the next."""
    if i > kept or table[kept - 1].kind != DOUBLE:
        p.add_double(table, i, feet, 1 - step.foot, step.double)
        i += 1
    p.add_single(table, i, feet, step)
    return i + 1


@kernel
def add_steps(table: np.ndarray, kept: int, state: Record, command: Record) -> int:
    """Write the steps after the phases that are kept; return the row of the stop."""
    last, feet, step, i = table[kept - 1], state.feet, state.step[0], kept
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
        i = add_step(table, i, kept, feet, step)
        n, foot = n + 1, 1 - foot
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
def pass_through(
    piece: Record, since: float, axis: int, c: float, v: float, zmp: float, omega: float
) -> None:
    """Write the curve of a pendulum on a ZMP that is at c, v some time after its start.

    Args:
        piece: The phase.
        since: That time [s].
        axis: 0 for x, 1 for y.
        c: CoM [m].
        v: Its velocity [m/s].
        zmp: The ZMP [m].
        omega: Natural frequency omega_n [rad/s].
    """
    S, q = piece.duration, piece.curve[axis]
    for k in range(8):
        q[k] = 0.0
    q[0] = zmp
    a, b = 0.5 * (c - zmp + v / omega), 0.5 * (c - zmp - v / omega)
    e, f = math.exp(omega * since), math.exp(omega * (S - since))
    q[6] = a / e + b * e
    q[7] = a * f + b / f
    piece.inverse_sinh = 1.0 / math.sinh(omega * S)


@kernel
def step_out(
    table: np.ndarray,
    state: Record,
    command: Record,
    work: np.ndarray,
    steps: np.ndarray,
    reference: Record,
    stance: int,
) -> None:
    """Begin a step from rest at once, with a foot that is to land where it is.

    Args:
        table: The phases; the first one, of standing or stopping, ends.
        state: How many they are.
        command: How long the step takes.
        work: Scratch.
        steps: The footsteps that were followed.
        reference: The reference of now.
        stance: The foot that stays.
    """
    rest, step, time, omega = table[0], state.step[0], reference.time, command.omega
    yaw, rate = heading_at(rest, time)
    rest.duration = time - rest.start
    for i in range(3):
        state.feet[0, i], state.feet[1, i] = rest.resting[0, i], rest.resting[1, i]
        step.pose[i] = rest.resting[1 - stance, i]
    step.foot, step.single, step.double = 1 - stance, command.single, command.double
    step.clearance = command.clearance
    p.add_single(table, 1, state.feet, step)
    state.rows, state.double = 2, command.double
    leave(table, state)
    state.knot, state.knot_yaw = time, yaw
    set_turn(table[0], time, 1.0, yaw, rate, yaw, rate, time)
    stop = plan_ahead(table, 1, state, command, steps)
    state.rows = stop + 2
    c, v = reference.com, reference.com_velocity
    for i in range(2):
        foot = table[0].resting[stance, i]
        pass_through(table[0], 0.0, i, c[i], v[i], foot, omega)
    shift(table, 0, stop, 0.0, omega, command.minjerk, work)
    turn(table, state, command, stop + 1, time, work)
