"""Headings of a walk: cubics through the mean yaws of the feet, as kernels."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
from . import records as r
from .reference import DOUBLE


@kernel
def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi]."""
    return angle - math.tau * np.rint(angle / math.tau)


@kernel
def mean_yaw(piece: np.ndarray, near: float) -> float:
    """Return the mean heading of the resting feet that is nearest to one [rad]."""
    left, right = piece[r.RESTING + 2], piece[r.RESTING + 5]
    mean = left + 0.5 * wrapped(right - left)
    return near + wrapped(mean - near)


@kernel
def fill_turns(table: np.ndarray, first: int, last: int, work: np.ndarray) -> None:
    """Fill the headings of one walk, from standing (row `first`) to standing (`last`).

    Its knots are the landings; it rests until the first double support.
    """
    yaw = mean_yaw(table[first], table[first, r.RESTING + 2])
    if first > 0:
        yaw = mean_yaw(table[first], table[first - 1, r.TURN + 3])
    work[0, 4], work[0, 5] = table[first + 1, r.START], yaw
    n = collect_knots(table, first + 2, last, work)
    work[0, 6] = work[n - 1, 6] = 0.0
    for row in range(first, first + 2):
        set_turn(table[row], work[0, 4], 1.0, yaw, 0.0, yaw, 0.0, work[n - 1, 4])
    set_turns(table, first + 2, last, n, work)


@kernel
def collect_knots(table: np.ndarray, first: int, last: int, work: np.ndarray) -> int:
    """Write the knots of the heading after knot 0 and their slopes; return how many.

    Args:
        table: The phases.
        first: The row from which on knots are looked for.
        last: The row of standing at the end, which is the last knot.
        work: Columns 4, 5, 6: time [s], yaw [rad], rate [rad/s]; knot 0 is there.
    """
    n = 1
    for i in range(first, last + 1):
        if int(table[i, r.KIND]) == DOUBLE or i == last:
            work[n, 4] = table[i, r.START]
            work[n, 5] = mean_yaw(table[i], work[n - 1, 5])
            n += 1
    for k in range(1, n - 1):
        h_0, h_1 = work[k, 4] - work[k - 1, 4], work[k + 1, 4] - work[k, 4]
        m_0 = (work[k, 5] - work[k - 1, 5]) / h_0
        m_1 = (work[k + 1, 5] - work[k, 5]) / h_1
        work[k, 6] = monotone_slope(h_0, h_1, m_0, m_1)
    work[n - 1, 6] = 0.0
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
    k, end = 0, work[n - 1, 4]
    for i in range(first, last + 1):
        while k < n - 2 and table[i, r.START] >= work[k + 1, 4]:
            k += 1
        a, b = work[k], work[k + 1]
        set_turn(table[i], a[4], b[4] - a[4], a[5], a[6], b[5], b[6], end)


@kernel
def set_turn(
    piece: np.ndarray,
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
    piece[r.TURN] = (rate_0 + rate_1 - 2.0 * mean) / (length * length)
    piece[r.TURN + 1] = (3.0 * mean - 2.0 * rate_0 - rate_1) / length
    piece[r.TURN + 2], piece[r.TURN + 3] = rate_0, yaw_0
    piece[r.TURN_START], piece[r.TURN_END] = start, end
