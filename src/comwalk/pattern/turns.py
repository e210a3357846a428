"""Headings of a walk: cubics through the mean yaws of the feet, as kernels."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from .reference import DOUBLE, STAND


@kernel
def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi]."""
    return angle - math.tau * np.rint(angle / math.tau)


@kernel
def mean_yaw(piece: Record, near: float) -> float:
    """Return the mean heading of the resting feet that is nearest to one [rad]."""
    left, right = piece.resting[0, 2], piece.resting[1, 2]
    mean = left + 0.5 * wrapped(right - left)
    return near + wrapped(mean - near)


@kernel
def fill_turns(table: np.ndarray, first: int, last: int, work: np.ndarray) -> None:
    """Fill the headings of one walk, from standing (row `first`) to standing (`last`).

    Its knots are the landings; it rests until the first double support.
    """
    yaw = mean_yaw(table[first], table[first].resting[0, 2])
    if first > 0:
        yaw = mean_yaw(table[first], table[first - 1].turn[3])
    work[0].knot, work[0].yaw = table[first + 1].start, yaw
    n = collect_knots(table, first + 2, last, work)
    work[0].rate = work[n - 1].rate = 0.0
    for row in range(first, first + 2):
        set_turn(table[row], work[0].knot, 1.0, yaw, 0.0, yaw, 0.0, work[n - 1].knot)
    set_turns(table, first + 2, last, n, work)


@kernel
def collect_knots(table: np.ndarray, first: int, last: int, work: np.ndarray) -> int:
    """Write the knots of the heading after knot 0 and their slopes; return how many.

    Args:
        table: The phases.
        first: The row from which on knots are looked for.
        last: The row of standing at the end, which is the last knot.
        work: Scratch, records of `WORK`; knot 0 is there.
    """
    n = 1
    for i in range(first, last + 1):
        if table[i].kind == DOUBLE or i == last:
            work[n].knot = table[i].start
            work[n].yaw = mean_yaw(table[i], work[n - 1].yaw)
            n += 1
    for k in range(1, n - 1):
        before, here, behind = work[k - 1], work[k], work[k + 1]
        h_0, h_1 = here.knot - before.knot, behind.knot - here.knot
        m_0, m_1 = (here.yaw - before.yaw) / h_0, (behind.yaw - here.yaw) / h_1
        here.rate = monotone_slope(h_0, h_1, m_0, m_1)
    work[n - 1].rate = 0.0
    return n


@kernel
def monotone_slope(h_0: float, h_1: float, m_0: float, m_1: float) -> float:
    """Return the slope of a monotone cubic at a knot (PCHIP)."""
    if m_0 * m_1 <= 0.0:
        return 0.0
    w_0, w_1 = 2.0 * h_1 + h_0, h_1 + 2.0 * h_0
    return (w_0 + w_1) / (w_0 / m_0 + w_1 / m_1)


@kernel
def set_turns(
    table: np.ndarray, first: int, last: int, n: int, work: np.ndarray
) -> None:
    """Write the cubics between n knots into the rows from `first` to `last`."""
    k, end = 0, work[n - 1].knot
    for i in range(first, last + 1):
        while k < n - 2 and table[i].start >= work[k + 1].knot:
            k += 1
        a, b = work[k], work[k + 1]
        span = b.knot - a.knot
        set_turn(table[i], a.knot, span, a.yaw, a.rate, b.yaw, b.rate, end)


@kernel
def set_turn(
    piece: Record,
    start: float,
    length: float,
    yaw_0: float,
    rate_0: float,
    yaw_1: float,
    rate_1: float,
    end: float,
) -> None:
    """Write the cubic of a phase's heading from its values at two ends."""
    mean = (yaw_1 - yaw_0) / length
    piece.turn[0] = (rate_0 + rate_1 - 2.0 * mean) / (length * length)
    piece.turn[1] = (3.0 * mean - 2.0 * rate_0 - rate_1) / length
    piece.turn[2], piece.turn[3] = rate_0, yaw_0
    piece.turn_start, piece.turn_end = start, end


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
