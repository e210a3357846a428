r"""Bounds on the errors of the ideal loop by Lyapunov functions, per axis.

For all disturbances with :math:`|\epsilon| \le a` and :math:`|\dot\epsilon| \le b` the
errors end inside these bounds, and once inside they stay. The paper's own function (37)
needs k_p k_c < omega_n^2; the best quadratic function needs stability only. None is
tight: `largest_errors.worst_case` is, and the peak gains are for a bound on eps alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .ideal_loop import error_dynamics, is_hurwitz, proof_condition
from .largest_errors import worst_disturbance
from .sampled_loop import (
    SampledLoop,
    disturbance_response,
    loop_plant,
    sampled_loop_matrix,
    tick_response,
)
from .stability_margins import decay_rate


class PaperBound(NamedTuple):
    """The best bound of the paper's Lyapunov function, Eq. (37)."""

    com: float
    """Ultimate bound on |e_c| [m]."""
    zmp: float
    """Ultimate bound on |e_p| [m]."""
    level: float
    """V that is not left [m^2/s^2]."""
    alpha: float
    """Of Eq. (38) [s^-1/2]."""
    beta: float
    """Of Eq. (38) [1/s]."""
    gamma: float
    """Of Eq. (38) [s^-1/2]."""


class Ellipsoid(NamedTuple):
    """A set of errors that bounded disturbances do not leave: x Q^-1 x <= 1."""

    bound: float
    """Largest |e_c| or |e_p| in it, with the disturbance's own part [m]."""
    Q: np.ndarray
    """Shape matrix, of shape (2, 2)."""


def paper_bound(
    pendulum: Pendulum, k_p: float, k_c: float, a: float, b: float
) -> PaperBound:
    r"""Return the best that Eqs. (37) and (38) prove, over alpha, beta and gamma.

    With :math:`\dot V \le -\lambda V + d` V ends below :math:`d / \lambda`. For a given
    lambda the best numbers are known: :math:`\alpha^2 = k_c - \lambda / 2`, and beta
    and gamma share the room :math:`S = \omega_n^2 - k_p k_c - \lambda k_p / 2` of the
    square of e_p in Eq. (38) as b and k_c a do, so that

    .. math:: d = \frac{(k_c^2 - \omega_n^2) a^2}{4 (k_c - \lambda / 2)}
        + \frac{k_p (k_c a + b)^2}{4 S}

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        a: Bound on |eps| [m/s], above 0.
        b: Bound on the rate of eps [m/s^2], above 0.

    Returns:
        Bounds, the level of V, and the numbers that prove it.

    Raises:
        ParameterError: If the proof of Theorem 1 does not hold for the gains
            (`ideal_loop.proof_condition`), or a number is out of range.

    Example:
        >>> bound = paper_bound(Pendulum(), 1.8, 3.8, 0.05, 0.5)
        >>> round(bound.zmp, 4), round(bound.com, 4)
        (0.0928, 0.4169)
    """
    a, b = _checked_bounds(a, b)
    if not proof_condition(pendulum, k_p, k_c):
        raise ParameterError(
            f"the paper's Lyapunov function proves nothing for k_p = {k_p:g}, k_c = "
            f"{k_c:g} 1/s: it needs k_c > omega_n = {pendulum.omega:.3g} and k_p k_c < "
            f"omega_n^2 = {pendulum.omega**2:.3g}"
        )
    room = pendulum.omega**2 - k_p * k_c
    K = k_c**2 - pendulum.omega**2

    def level(rate: float) -> float:
        S = room - 0.5 * rate * k_p
        d = K * a**2 / (4.0 * (k_c - 0.5 * rate)) + k_p * (k_c * a + b) ** 2 / (4.0 * S)
        return d / rate

    rate = _least(level, min(2.0 * k_c, 2.0 * room / k_p))
    V, S, share = level(rate), room - 0.5 * rate * k_p, k_c * a / (k_c * a + b)
    return PaperBound(
        com=math.sqrt(2.0 * V / K),
        zmp=math.sqrt(2.0 * V) / k_p,
        level=V,
        alpha=math.sqrt(k_c - 0.5 * rate),
        beta=math.sqrt((1.0 - share) * S),
        gamma=math.sqrt(share * S / k_c),
    )


def ellipsoid_bound(
    pendulum: Pendulum, k_p: float, k_c: float, a: float, b: float, output: str
) -> Ellipsoid:
    r"""Return the best bound by an ellipsoid, eps and its rate taken as independent.

    It is on the paper's state :math:`(e_c, e_p)`. For a decay lambda and shares theta
    the ellipsoid is that of

    .. math:: (A + \tfrac{\lambda}{2}) Q + Q (A + \tfrac{\lambda}{2})^T
        + \sum_i \frac{a_i^2}{\lambda \theta_i} B_i B_i^T = 0

    and both are the best there are. A semidefinite program finds no better one.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.
        a: Bound on |eps| [m/s], above 0.
        b: Bound on the rate of eps [m/s^2], above 0.
        output: Which error, "com" or "zmp".

    Returns:
        The bound, and the ellipsoid of (e_c, e_p) that is not left.

    Raises:
        ParameterError: If the loop is not stable or a number out of range.

    Example:
        >>> round(ellipsoid_bound(Pendulum(), 3.0, 6.6, 0.05, 0.5, "zmp").bound, 4)
        0.123
    """
    a, b = _checked_bounds(a, b)
    _check_stable(k_p, k_c)
    A, B = error_dynamics(pendulum, k_p, k_c)
    row = np.array([1.0, 0.0] if output == "com" else [0.0, 1.0])
    return _best_ellipsoid(A, B * np.array([a, b]), row)


def invariant_set(
    pendulum: Pendulum, k_p: float, k_c: float, a: float, output: str
) -> Ellipsoid:
    r"""Return the best bound by an ellipsoid for a bounded eps of any rate.

    It is on the state :math:`(e_c, \dot e_c)`, in which the rate of eps does not
    appear; e_p has a direct part :math:`\epsilon / k_p` beside it, Eq. (34).

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.
        a: Bound on |eps| [m/s], above 0.
        output: Which error, "com" or "zmp".

    Returns:
        The bound, and the ellipsoid of (e_c, e_c') that is not left.

    Raises:
        ParameterError: If the loop is not stable or a number out of range.

    Example:
        >>> round(invariant_set(Pendulum(), 3.0, 6.6, 0.05, "zmp").bound, 4)
        0.0592
    """
    a, _ = _checked_bounds(a, 1.0)
    _check_stable(k_p, k_c)
    a_1 = pendulum.omega**2 / k_p
    A = np.array([[0.0, 1.0], [-a_1 * (k_c - k_p), -a_1]])
    B = np.array([[0.0], [-a_1 * a]])
    if output == "com":
        return _best_ellipsoid(A, B, np.array([1.0, 0.0]))
    found = _best_ellipsoid(A, B, np.array([k_c, 1.0]) / k_p)
    return Ellipsoid(found.bound + a / k_p, found.Q)


def _checked_bounds(a: float, b: float) -> tuple[float, float]:
    return (
        checked_number("a", a, unit="m/s", low=0.0, open_low=True),
        checked_number("b", b, unit="m/s^2", low=0.0, open_low=True),
    )


def _check_stable(k_p: float, k_c: float) -> None:
    """Refuse gains for which the ideal loop is not stable."""
    if not is_hurwitz(k_p, k_c):
        raise ParameterError(
            f"the loop is stable, and has a bound, only for 0 < k_p < k_c; got k_p = "
            f"{k_p:g}, k_c = {k_c:g} 1/s"
        )


def _least(value: Callable[[float], float], high: float) -> float:
    """Return the minimiser of a unimodal function on (0, high)."""
    from scipy.optimize import minimize_scalar

    answer = minimize_scalar(
        value,
        bounds=(1e-9 * high, (1.0 - 1e-9) * high),
        method="bounded",
        options={"xatol": 1e-9 * high},
    )
    return float(answer.x)


def _gramian(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return Q of A Q + Q A^T + b b^T = 0, in closed form for a stable A (2, 2)."""
    trace = A[0, 0] + A[1, 1]
    determinant = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    c = A @ b - trace * b
    return (determinant * np.outer(b, b) + np.outer(c, c)) / (
        -2.0 * trace * determinant
    )


def _best_ellipsoid(A: np.ndarray, B: np.ndarray, row: np.ndarray) -> Ellipsoid:
    """Return the ellipsoid with the least extent along a row, inputs of size 1."""

    def extents(rate: float) -> tuple[list[np.ndarray], list[float]]:
        shifted = A + 0.5 * rate * np.eye(2)
        parts = [_gramian(shifted, b) / rate for b in B.T]
        return parts, [math.sqrt(max(row @ Q @ row, 0.0)) for Q in parts]

    highest = -2.0 * float(np.linalg.eigvals(A).real.max())
    rate = _least(lambda rate: sum(extents(rate)[1]), highest)
    parts, sizes = extents(rate)
    bound = sum(sizes)
    Q = sum(Q * bound / size for Q, size in zip(parts, sizes, strict=True) if size)
    return Ellipsoid(bound, np.asarray(Q))


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
    if count <= _FINE + _KNOTS:
        return np.arange(count)
    ages = np.geomspace(_FINE, count - 1, _KNOTS).round()
    return count - 1 - np.unique(np.concatenate([np.arange(_FINE), ages]))[::-1]
