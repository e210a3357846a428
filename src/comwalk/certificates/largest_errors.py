"""Largest errors that bounded disturbances of the ideal loop can cause."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .ideal_loop import Output, _check_gains
from .pole_placement import _second_order, poles


def frequency_response(
    pendulum: Pendulum, k_p: float, k_c: float, frequency: float
) -> tuple[complex, complex]:
    r"""Return the response of the CoM and ZMP errors to a sine disturbance.

    .. math:: G_c = \frac{-1}{D(s)}, \quad G_p = \frac{s^2/\omega_n^2 - 1}{D(s)}, \quad
        D(s) = \frac{k_p}{\omega_n^2} s^2 + s + (k_c - k_p)

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.
        frequency: Of the disturbance [Hz], 0 or above.

    Returns:
        G_c and G_p [s]: error [m] per disturbance [m/s], complex.

    Raises:
        ParameterError: If the loop is not stable or the frequency out of range.

    Example:
        >>> G_c, G_p = frequency_response(Pendulum(), 3.0, 6.6, 1.0)
        >>> round(abs(G_c), 6), round(abs(G_p), 6)
        (0.127502, 0.480006)
    """
    _check_gains(k_p, k_c, stable=True)
    f = checked_number("frequency", frequency, unit="Hz", low=0.0)
    s, omega = 2j * math.pi * f, pendulum.omega
    D = k_p / omega**2 * s**2 + s + (k_c - k_p)
    return -1.0 / D, (s**2 / omega**2 - 1.0) / D


def _first_zero(h_0: float, h_1: float, a_1: float, a_0: float) -> tuple[float, float]:
    """Return slope at, and decay per lobe after, the first zero of h (slope 0: none).

    h'' + a_1 h' + a_0 h = 0 from h(0) = h_0 >= 0, h'(0) = h_1, at t > 0.
    """
    sigma = 0.5 * a_1
    square, B = a_0 - sigma**2, h_1 + sigma * h_0
    if square > 0.0:
        w = math.sqrt(square)
        t = (0.5 * math.pi + math.atan2(B / w, h_0)) / w
        slope = -math.hypot(h_0 * w, B) * math.exp(-sigma * t)
        return slope, math.exp(-sigma * math.pi / w)
    d, x = math.sqrt(-square), -h_0 / B if B != 0.0 else math.inf
    if not (x > 0.0 and x * d < 1.0):
        return 0.0, 0.0
    t = math.atanh(x * d) / d if d > 0.0 else x
    slope = h_0 * d * math.sinh(d * t) + B * math.cosh(d * t)
    return slope * math.exp(-sigma * t), 0.0


def _absolute_area(h_0: float, h_1: float, a_1: float, a_0: float) -> float:
    """Return the integral of |h| from 0 on; h as in `_first_zero`.

    The integral of h from t on is (h' + a_1 h) / a_0, thus h' / a_0 at a zero; after
    the first zero the lobes of |h| form a geometric series.
    """
    slope, decay = _first_zero(h_0, h_1, a_1, a_0)
    whole, tail = (h_1 + a_1 * h_0) / a_0, slope / a_0
    return abs(whole - tail) + abs(tail) * (1.0 + decay) / (1.0 - decay)


def com_peak_gain(pendulum: Pendulum, k_p: float, k_c: float) -> float:
    r"""Return the exact peak of the CoM error per peak of the disturbance.

    .. math:: \sup |e_c| / \sup |\epsilon| =
        \coth\!\left(\frac{\pi\zeta}{2\sqrt{1-\zeta^2}}\right) \frac{1}{k_c - k_p}

    for damping below 1, and :math:`1 / (k_c - k_p)` from 1 on (the L1 norm of the
    impulse response).

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.

    Returns:
        Peak gain [s]: |e_c| [m] per |eps| [m/s].

    Raises:
        ParameterError: If the loop is not stable.

    Example:
        >>> round(com_peak_gain(Pendulum(), 3.0, 6.6), 6)
        0.346424
    """
    _check_gains(k_p, k_c, stable=True)
    a_1, a_0 = _second_order(pendulum, k_p, k_c)
    return _absolute_area(0.0, a_1, a_1, a_0)


def zmp_peak_gain(pendulum: Pendulum, k_p: float, k_c: float) -> float:
    r"""Return the exact peak of the ZMP error per peak of the disturbance.

    .. math:: \sup |e_p| / \sup |\epsilon| \ge \frac{2}{k_p} + \frac{1}{k_c - k_p}

    with equality where the impulse response keeps one sign (the L1 norm of it, of
    which 1 / k_p is the feed-through). No bound on the rate of eps is needed.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.

    Returns:
        Peak gain [s]: |e_p| [m] per |eps| [m/s].

    Raises:
        ParameterError: If the loop is not stable.

    Example:
        >>> round(zmp_peak_gain(Pendulum(), 3.0, 6.6), 6)
        1.14359
    """
    _check_gains(k_p, k_c, stable=True)
    a_1, a_0 = _second_order(pendulum, k_p, k_c)
    h_0 = a_1 / k_p
    return 1.0 / k_p + _absolute_area(h_0, h_0 * (k_c - a_1), a_1, a_0)


def ramp_step(
    pendulum: Pendulum, k_p: float, k_c: float, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F, G_0, G_1 of x+ = F x + G_0 eps + G_1 eps+, with x = (e_c, e_c').

    It is exact for a disturbance that is linear over the step.
    """
    from scipy.linalg import expm

    a_1, a_0 = _second_order(pendulum, k_p, k_c)
    M = np.zeros((4, 4))
    M[0, 1], M[1, :3], M[2, 3] = 1.0, (-a_0, -a_1, -a_1), 1.0 / dt
    E = expm(M * dt)
    return E[:2, :2], E[:2, 2] - E[:2, 3], E[:2, 3]


class WorstCase(NamedTuple):
    """The largest error that a bounded disturbance can cause, and how."""

    bound: float
    """Largest |e_c| or |e_p| [m]."""
    disturbance: np.ndarray
    """eps [m/s] that reaches it at its last sample, linear between samples, (n,)."""
    dt: float
    """Time between samples [s]."""


def _output_weights(
    pendulum: Pendulum, k_p: float, k_c: float, output: Output, n: int, dt: float
) -> np.ndarray:
    """Return w with final error = w @ eps, from rest, of shape (n,)."""
    F, G_0, G_1 = ramp_step(pendulum, k_p, k_c, dt)
    row = np.array([1.0, 0.0] if output == "com" else [k_c / k_p, 1.0 / k_p])
    w = np.zeros(n)
    w[-1] = 0.0 if output == "com" else 1.0 / k_p
    for i in range(n - 2, -1, -1):
        w[i + 1] += row @ G_1
        w[i] += row @ G_0
        row = row @ F
    return w


def worst_case(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    a: float,
    b: float,
    output: Output,
    samples: int = 1501,
) -> WorstCase:
    r"""Return the exact ultimate bound under the paper's assumption on eps.

    .. math:: \max |e| \text{ over all } |\epsilon| \le a, \; |\dot\epsilon| \le b

    found by a linear program over piecewise linear disturbances on a horizon of twelve
    time constants. It is the tight form of Theorem 1; `com_peak_gain` times a and
    `zmp_peak_gain` times a are the limits for large b.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.
        a: Bound on |eps| [m/s], 0 or above.
        b: Bound on the rate of eps [m/s^2], 0 or above.
        output: Which error, "com" or "zmp".
        samples: Number of samples of the disturbance, at least 2.

    Returns:
        The bound, the disturbance that reaches it, and its sample time.

    Raises:
        ParameterError: If the loop is not stable or a number out of range.

    Example:
        >>> round(worst_case(Pendulum(), 3.0, 6.6, 0.05, 0.5, "zmp").bound, 4)
        0.0403
    """
    _check_gains(k_p, k_c, stable=True)
    a = checked_number("a", a, unit="m/s", low=0.0)
    b = checked_number("b", b, unit="m/s^2", low=0.0)
    checked_number("samples", samples, low=2)
    if output not in ("com", "zmp"):
        raise ParameterError(f'output must be "com" or "zmp", got {output!r}')
    n = int(samples)
    horizon = 12.0 / float(-poles(pendulum, k_p, k_c).real.max())
    dt = horizon / (n - 1)
    w = _output_weights(pendulum, k_p, k_c, output, n, dt)
    eps = worst_disturbance(w, a, np.full(n - 1, b * dt))
    return WorstCase(float(w @ eps), eps, dt)


def worst_disturbance(weights: np.ndarray, a: float, rises: np.ndarray) -> np.ndarray:
    """Return the bounded samples of a disturbance whose weighted sum is largest.

    A linear program, solved by HiGHS.

    Args:
        weights: Weight of each sample, of shape (n,).
        a: Bound on the samples, 0 or above.
        rises: Bounds on the differences of neighbours, of shape (n - 1,).

    Returns:
        The samples, of shape (n,).

    Example:
        >>> worst_disturbance(np.array([-1.0, 1.0]), 5.0, np.array([2.0])).tolist()
        [-5.0, -3.0]
    """
    from scipy import sparse
    from scipy.optimize import linprog

    n = len(weights)
    difference = sparse.diags([-1.0, 1.0], [0, 1], shape=(n - 1, n), format="csr")
    rates = sparse.vstack([difference, -difference])
    room = np.concatenate([rises, rises])
    answer = linprog(-weights, rates, room, bounds=(-a, a), method="highs")
    return answer.x
