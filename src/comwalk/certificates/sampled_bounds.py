r"""Bounds on the errors of the loop as it is sampled, filtered and delayed, per axis.

The disturbance enters as in Eq. (30), :math:`\dot c = v + \epsilon`, and unlike in the
ideal loop its rate counts: a jump of eps is a jump of the CoM's velocity, and the ZMP
feels :math:`-\dot\epsilon / \omega_n^2` before the law can answer.

Disturbances are linear over each tick, with the rate of a tick from its beginning on.
One that swings within a tick is not covered: sampled at single instants it could look
like another. Sensors average over the tick, which keeps such disturbances out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .sampled_loop import (
    SampledLoop,
    disturbance_response,
    loop_plant,
    sampled_loop_matrix,
    tick_response,
)
from .stability_margins import decay_rate
from .worst_case import worst_disturbance

MAX_TICKS = 200_000
"""Longest horizon [ticks]."""

_TIME_CONSTANTS = 12.0  # of the slowest error, as the horizon
_FINE = 200  # last ticks with a knot each
_KNOTS = 200  # further back, ever farther apart


class SampledWeights(NamedTuple):
    r"""How the last error depends on the disturbance before it, linear over a tick.

    .. math:: e_N = \sum_n w_n \epsilon_n
    """

    eps: np.ndarray
    """Weights of the samples [s], of shape (N + 2,); the last one is a tick after e_N,
    for its slope."""
    peak: float
    """Largest |e| for |eps| <= 1 if the rate were free on its own [s]."""
    rate_peak: float
    """Largest |e| for a rate of at most 1 if eps were free on its own [s^2]."""


class SampledWorstCase(NamedTuple):
    """The largest error that a bounded disturbance can cause in the sampled loop."""

    bound: float
    """Largest |e_c| or |e_p| at a tick [m]."""
    disturbance: np.ndarray
    """eps at each tick [m/s], linear between ticks, of shape (n,); the error is reached
    at the last sample but one."""
    dt: float
    """Time between samples, the control period [s]."""


def sampled_weights(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> tuple[SampledWeights, SampledWeights]:
    """Return how the errors of CoM and ZMP depend on the disturbance before them.

    The ZMP is that under the soles, as the sensor gets it at the end of a period,
    before the filter. The rate of the disturbance at a tick is that to the right of it.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: The loop.

    Returns:
        Weights for the CoM and for the ZMP.

    Raises:
        ParameterError: If the loop is unstable, or so slow to settle that there is no
            horizon for it.
    """
    M, count = _settling(pendulum, k_p, k_c, loop)
    g_eps, g_rate, g_next = _disturbed(pendulum, loop, len(M))
    rows, through = _outputs(pendulum, k_p, k_c, loop, M)
    found = []
    for row, (on_eps, on_rate, on_next) in zip(rows, through, strict=True):
        # newest tick first: what it does one tick before the end, two ticks before ...
        S = _powers(row, M, count - 1)
        w_eps = np.concatenate([[0.0, 0.0, on_eps], S @ g_eps])
        w_rate = np.concatenate([[0.0, on_next, on_rate], S @ g_rate])
        w_rate[2:-1] += S @ g_next
        found.append(_combined(-w_eps[::-1], -w_rate[::-1], loop.period))
    return found[0], found[1]


def _settling(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> tuple[np.ndarray, int]:
    """Return the matrix of a tick, and the ticks until nothing is left of an error."""
    decay = decay_rate(pendulum, k_p, k_c, loop)
    count = _TIME_CONSTANTS / (decay * loop.period) if decay > 0.0 else math.inf
    if count > MAX_TICKS:
        raise ParameterError(
            f"the sampled loop with k_p = {k_p:g}, k_c = {k_c:g} 1/s is unstable or "
            f"next to it (decay {decay:.3g} 1/s) and has no bound"
        )
    M = sampled_loop_matrix(pendulum, k_p, k_c, loop)
    return M, max(math.ceil(count), len(M)) + 2


def _powers(row: np.ndarray, M: np.ndarray, count: int) -> np.ndarray:
    """Return row, row M, row M^2, ... of shape (count, n), by doubling."""
    S, power = row[None, :], M
    while len(S) < count:
        S, power = np.vstack([S, S @ power]), power @ power
    return S[:count]


def _disturbed(
    pendulum: Pendulum, loop: SampledLoop, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what eps, its rate, and its rate of the next tick do to the state."""
    x, (_, alpha) = loop_plant(pendulum, loop), tick_response(pendulum, loop)
    n, E = len(x.b), disturbance_response(pendulum, loop)
    g = np.zeros((size, 3))
    g[:n, :2] = E
    if loop.analog_cutoff is None:
        g[2] = *(alpha * (x.row @ E)), alpha * x.through_rate
    return g[:, 0], g[:, 1], g[:, 2]


def _outputs(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop, M: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[float, float, float]]]:
    """Return rows of c and p at the end of a tick on the state at its beginning.

    Beside each are its parts by eps and its rate in that tick, and by the next rate.
    """
    x = loop_plant(pendulum, loop)
    n, (ticks, _) = len(x.b), loop.dead_ticks
    lag = int(loop.delay) + ticks
    law = np.zeros(len(M))  # the command that acts at the end of the tick
    law[n + 2 * lag - 1 if lag else 2] += k_p
    law[n + 2 * lag - 2 if lag else 0] -= k_c
    g_eps, g_rate, _ = _disturbed(pendulum, loop, len(M))
    plain = np.zeros((2, n))
    plain[0, 0], plain[1] = 1.0, x.row
    rows = plain @ M[:n]
    rows[1] += x.through * law
    parts = np.column_stack(
        [plain @ g_eps[:n], plain @ g_rate[:n], [0.0, x.through_rate]]
    )
    return list(rows), [tuple(part) for part in parts.tolist()]


def _combined(w_eps: np.ndarray, w_rate: np.ndarray, dt: float) -> SampledWeights:
    """Return weights of the samples alone: a rate is the difference of two."""
    w = w_eps.copy()
    w[1:] += w_rate[:-1] / dt
    w[:-1] -= w_rate[:-1] / dt
    return SampledWeights(w, float(np.abs(w_eps).sum()), float(np.abs(w_rate).sum()))


def sampled_worst_case(
    weights: SampledWeights, loop: SampledLoop, a: float, b: float
) -> SampledWorstCase:
    r"""Return the exact worst case of the sampled loop under the paper's assumption.

    .. math:: \max |e| \text{ over all } |\epsilon| \le a, \; |\dot\epsilon| \le b

    by a linear program, with a knot of the disturbance at each of the last ticks and
    fewer the longer ago.

    Args:
        weights: Of the error, from `sampled_weights`.
        loop: Gives the period.
        a: Bound on |eps| [m/s], 0 or above.
        b: Bound on the rate of eps [m/s^2], 0 or above.

    Returns:
        The bound, and the disturbance that attains it.

    Raises:
        ParameterError: If a number is out of range.

    Example:
        >>> loop = SampledLoop(period=0.005, zmp_cutoff=1.0, analog_filter=True)
        >>> com, zmp = sampled_weights(Pendulum(), 3.0, 6.6, loop)
        >>> round(sampled_worst_case(zmp, loop, 0.05, 0.5).bound, 3)
        0.07
    """
    a = checked_number("a", a, unit="m/s", low=0.0)
    b = checked_number("b", b, unit="m/s^2", low=0.0)
    w = weights.eps
    ticks = np.arange(len(w))
    knots = _knots(len(w))
    left = np.searchsorted(knots, ticks, side="right").clip(1, len(knots) - 1) - 1
    gaps = np.diff(knots)
    part = (ticks - knots[left]) / gaps[left]
    at_knots = np.bincount(left, w * (1.0 - part), len(knots))
    at_knots += np.bincount(left + 1, w * part, len(knots))
    found = worst_disturbance(at_knots, a, b * loop.period * gaps)
    eps = np.interp(ticks, knots, found)
    return SampledWorstCase(float(w @ eps), eps, loop.period)


def _knots(count: int) -> np.ndarray:
    """Return ticks with a knot: the last ones all, then fewer the longer ago."""
    if count <= _FINE + _KNOTS:
        return np.arange(count)
    ages = np.geomspace(_FINE, count - 1, _KNOTS).round()
    return count - 1 - np.unique(np.concatenate([np.arange(_FINE), ages]))[::-1]
