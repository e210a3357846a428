"""Stability of the walking controller, Eqs. (28) and (32) to (38), per axis.

Every function looks at one axis (x or y) on its own: the axes do not couple. This is
the paper's theory on the ideal model (30), with the exact facts beside it; `sampled`
has the loop as it is sampled, filtered and delayed on a robot.

The letters are the paper's: gains `k_p`, `k_c` [1/s] of the ZMP and of the CoM, errors
`e_p`, `e_c` [m] (desired minus actual), disturbance `eps` [m/s] and its rate `eps_dot`
[m/s^2], natural frequency `omega` [rad/s] of the pendulum.

Note:
    What holds and what does not: the ideal loop is stable if and only if
    0 < k_p < k_c (`is_hurwitz`). Theorem 1 (32) and Remark 1 both imply that, so what
    they claim is true, but the Lyapunov function (37) proves it only where
    k_p k_c < omega^2 (`proof_condition`), which is narrower than (32) as printed.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from ..control import Value
from ..errors import ParameterError, checked_number
from ..pattern import Pendulum

Output: TypeAlias = Literal["com", "zmp"]
"""Which error is meant."""


def _check_gains(k_p: float, k_c: float, *, stable: bool = False) -> None:
    """Refuse gains for which the second-order error dynamics do not exist."""
    checked_number("k_p", k_p, unit="1/s", low=1e-9)
    checked_number("k_c", k_c, unit="1/s", low=0.0)
    if stable and not is_hurwitz(k_p, k_c):
        raise ParameterError(
            f"k_p = {k_p:g} must be below k_c = {k_c:g} 1/s: the loop is unstable and "
            "has no bound; lower k_p or raise k_c"
        )


def error_acceleration(pendulum: Pendulum, e_c: Value, e_p: Value) -> Value:
    r"""Return the acceleration of the CoM error, Eq. (33).

    .. math:: \ddot e_c = \omega_n^2 (e_c - e_p)

    Args:
        pendulum: Gives omega_n [rad/s].
        e_c: CoM error [m].
        e_p: ZMP error [m].

    Returns:
        CoM error acceleration [m/s^2], of the shape of the errors.

    Example:
        >>> round(error_acceleration(Pendulum(), 0.02, 0.01), 6)
        0.142795
    """
    omega = pendulum.omega
    return omega**2 * (e_c - e_p)


def zmp_error_from_com(
    k_p: float, k_c: float, e_c: Value, e_c_rate: Value, eps: Value
) -> Value:
    r"""Return the ZMP error that goes with a motion of the CoM error, Eq. (34).

    .. math:: k_p e_p = \dot e_c + k_c e_c + \epsilon

    Args:
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s].
        e_c: CoM error [m].
        e_c_rate: Rate of the CoM error [m/s].
        eps: Disturbance [m/s].

    Returns:
        ZMP error e_p [m], of the shape of the errors.

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> round(zmp_error_from_com(3.0, 6.6, 0.01, 0.0, 0.0), 6)
        0.022
    """
    _check_gains(k_p, k_c)
    return (e_c_rate + k_c * e_c + eps) / k_p


def error_dynamics(
    pendulum: Pendulum, k_p: float, k_c: float
) -> tuple[np.ndarray, np.ndarray]:
    r"""Return the error dynamics on the state (e_c, e_p), Eqs. (35) and (36).

    .. math:: \frac{d}{dt} \begin{bmatrix} e_c \\ e_p \end{bmatrix} =
        A \begin{bmatrix} e_c \\ e_p \end{bmatrix} +
        B \begin{bmatrix} \epsilon \\ \dot\epsilon \end{bmatrix}

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s].

    Returns:
        A, of shape (2, 2), and B, of shape (2, 2).

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> A, B = error_dynamics(Pendulum(), 3.0, 6.6)
        >>> A.round(4).tolist()
        [[-6.6, 3.0], [-9.7602, 1.8402]]
        >>> B.round(4).tolist()
        [[-1.0, 0.0], [-2.2, 0.3333]]
    """
    _check_gains(k_p, k_c)
    omega = pendulum.omega
    A = [
        [-k_c, k_p],
        [(omega**2 - k_c**2) / k_p, -(omega**2 - k_p * k_c) / k_p],
    ]
    B = [[-1.0, 0.0], [-k_c / k_p, 1.0 / k_p]]
    return np.array(A), np.array(B)


def lyapunov(
    pendulum: Pendulum, k_p: float, k_c: float, e_c: Value, e_p: Value
) -> Value:
    r"""Return the paper's Lyapunov function, Eq. (37).

    .. math:: V = \frac12 \left[ (k_c^2 - \omega_n^2) e_c^2 + k_p^2 e_p^2 \right]

    It is positive definite for k_c > omega_n and k_p > 0 only.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        e_c: CoM error [m].
        e_p: ZMP error [m].

    Returns:
        V [m^2/s^2], of the shape of the errors.

    Example:
        >>> round(lyapunov(Pendulum(), 1.8, 3.8, 0.1, 0.1), 6)
        0.017003
    """
    omega = pendulum.omega
    return 0.5 * ((k_c**2 - omega**2) * e_c**2 + k_p**2 * e_p**2)


def lyapunov_rate(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    e_c: Value,
    e_p: Value,
    eps: Value,
    eps_dot: Value,
) -> Value:
    r"""Return the exact rate of the Lyapunov function, second line above Eq. (38).

    .. math:: \dot V = -k_c (k_c^2 - \omega_n^2) e_c^2
        - k_p (\omega_n^2 - k_p k_c) e_p^2
        - (k_c^2 - \omega_n^2) e_c \epsilon
        + k_p e_p \dot\epsilon - k_p k_c e_p \epsilon

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        e_c: CoM error [m].
        e_p: ZMP error [m].
        eps: Disturbance [m/s].
        eps_dot: Rate of the disturbance [m/s^2].

    Returns:
        The rate of V [m^2/s^3], of the shape of the errors.

    Note:
        With the paper's x gains V can grow without any disturbance: (37) is not a
        Lyapunov function there, although the loop is stable.

    Example:
        >>> round(lyapunov_rate(Pendulum(), 3.0, 6.6, 0.0, 1.0, 0.0, 0.0), 2)
        16.56
    """
    omega = pendulum.omega
    K = k_c**2 - omega**2
    return (
        -k_c * K * e_c**2
        - k_p * (omega**2 - k_p * k_c) * e_p**2
        - K * e_c * eps
        + k_p * e_p * eps_dot
        - k_p * k_c * e_p * eps
    )


class RateBound(NamedTuple):
    """Coefficients of the four squares of Eq. (38), in printed order."""

    com: float
    """Of -e_c^2 [1/s^3]."""
    zmp: float
    """Of -e_p^2 [1/s^3]."""
    disturbance: float
    """Of eps^2 [1/s]."""
    disturbance_rate: float
    """Of eps_dot^2 [s]."""


def rate_bound_coefficients(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    alpha: float,
    beta: float,
    gamma: float,
) -> RateBound:
    r"""Return the coefficients of the bound on the Lyapunov rate, Eq. (38).

    .. math:: (k_c - \alpha^2)(k_c^2 - \omega_n^2), \;
        k_p [\omega_n^2 - (k_p + \gamma^2) k_c - \beta^2], \;
        \frac{k_c^2 - \omega_n^2}{4 \alpha^2} + \frac{k_p k_c}{4 \gamma^2}, \;
        \frac{k_p}{4 \beta^2}

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        alpha: Free number [s^-1/2], above 0.
        beta: Free number [1/s], above 0.
        gamma: Free number [s^-1/2], above 0.

    Returns:
        The four coefficients.

    Raises:
        ParameterError: If alpha, beta or gamma is not above 0.

    Example:
        >>> q = rate_bound_coefficients(Pendulum(), 1.8, 3.8, 1.0, 1.0, 0.5)
        >>> [round(value, 4) for value in q]
        [0.4495, 9.8811, 6.8801, 0.45]
    """
    for name, value in (("alpha", alpha), ("beta", beta), ("gamma", gamma)):
        checked_number(name, value, low=0.0, open_low=True)
    omega = pendulum.omega
    K = k_c**2 - omega**2
    return RateBound(
        com=(k_c - alpha**2) * K,
        zmp=k_p * (omega**2 - (k_p + gamma**2) * k_c - beta**2),
        disturbance=K / (4.0 * alpha**2) + k_p * k_c / (4.0 * gamma**2),
        disturbance_rate=k_p / (4.0 * beta**2),
    )


def lyapunov_rate_bound(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    e_c: Value,
    e_p: Value,
    alpha: float,
    beta: float,
    gamma: float,
    eps: Value,
    eps_dot: Value,
) -> Value:
    r"""Return the upper bound on the Lyapunov rate, Eq. (38).

    It is above `lyapunov_rate` for all positive alpha, beta and gamma, if
    k_c >= omega_n. The coefficients are those of `rate_bound_coefficients`.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        e_c: CoM error [m].
        e_p: ZMP error [m].
        alpha: Free number [s^-1/2], above 0.
        beta: Free number [1/s], above 0.
        gamma: Free number [s^-1/2], above 0.
        eps: Disturbance [m/s].
        eps_dot: Rate of the disturbance [m/s^2].

    Returns:
        Bound on the rate of V [m^2/s^3], of the shape of the errors.

    Raises:
        ParameterError: If alpha, beta or gamma is not above 0.
    """
    q = rate_bound_coefficients(pendulum, k_p, k_c, alpha, beta, gamma)
    return (
        -q.com * e_c**2
        - q.zmp * e_p**2
        + q.disturbance * eps**2
        + q.disturbance_rate * eps_dot**2
    )


class DissipationGains(NamedTuple):
    r"""The functions of Eq. (28), :math:`\gamma_1(s) = g_1 s^2`, :math:`g_2 s^2`."""

    error: float
    """g_1 of the norm of (e_c, e_p) [1/s^3]."""
    disturbance: float
    """g_2 of the norm of (eps, eps_dot), the larger coefficient of Eq. (38)."""


def dissipation_gains(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    alpha: float,
    beta: float,
    gamma: float,
) -> DissipationGains:
    r"""Return the class K functions of the dissipation inequality, Eq. (28).

    .. math:: \dot V \le -\gamma_1(|e|) + \gamma_2(|\epsilon|)

    They follow from Eq. (38) and exist only where `proof_condition` holds.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        alpha: Free number [s^-1/2], above 0.
        beta: Free number [1/s], above 0.
        gamma: Free number [s^-1/2], above 0.

    Returns:
        Coefficients of the two quadratic functions.

    Raises:
        ParameterError: If Eq. (38) is not negative definite in the errors.

    Example:
        >>> g = dissipation_gains(Pendulum(), 1.8, 3.8, 1.0, 1.0, 0.5)
        >>> round(g.error, 4), round(g.disturbance, 4)
        (0.4495, 6.8801)
    """
    q = rate_bound_coefficients(pendulum, k_p, k_c, alpha, beta, gamma)
    if not (k_c > pendulum.omega and q.com > 0.0 and q.zmp > 0.0):
        raise ParameterError(
            f"Eq. (38) is not negative definite (e_c: {q.com:.4g}, e_p: {q.zmp:.4g}); "
            "it needs k_c > omega and k_p k_c < omega^2, then small alpha, beta, gamma"
        )
    return DissipationGains(min(q.com, q.zmp), max(q.disturbance, q.disturbance_rate))


def theorem_1(
    pendulum: Pendulum, k_p: float, k_c: float, beta: float, gamma: float
) -> bool:
    r"""Return whether the gains meet Theorem 1 as printed, Eq. (32).

    .. math:: k_c > \omega_n, \quad
        0 < k_p < \frac{\omega_n^2 - \beta^2}{\omega_n} - \gamma^2

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        beta: Free number [1/s], in (0, omega_n).
        gamma: Free number [s^-1/2], above 0, below the root of
            (omega_n^2 - beta^2) / omega_n.

    Returns:
        Whether Eq. (32) holds.

    Raises:
        ParameterError: If beta or gamma is out of its range.

    Note:
        Sufficient for stability (it implies 0 < k_p < k_c), but not for the paper's
        proof of it: the e_p^2 term of Eq. (38) has k_c where Eq. (32) has omega_n.

    Example:
        >>> theorem_1(Pendulum(), 3.0, 6.6, 0.5, 0.5)
        True
    """
    omega = pendulum.omega
    checked_number("beta", beta, low=0, high=omega, open_low=True, open_high=True)
    room = (omega**2 - beta**2) / omega
    high = math.sqrt(room)
    checked_number("gamma", gamma, low=0, high=high, open_low=True, open_high=True)
    return bool(k_c > omega and 0.0 < k_p < room - gamma**2)


def remark_1(pendulum: Pendulum, k_p: float, k_c: float) -> bool:
    r"""Return whether the gains meet Remark 1, the practical form of Eq. (32).

    .. math:: k_c > \omega_n, \quad 0 < k_p < \omega_n

    It is the union of Eq. (32) over all beta and gamma.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].

    Returns:
        Whether Remark 1 holds.

    Example:
        >>> remark_1(Pendulum(), 3.0, 6.6), remark_1(Pendulum(), 1.0, 3.0)
        (True, False)
    """
    omega = pendulum.omega
    return bool(k_c > omega and 0.0 < k_p < omega)


def proof_condition(pendulum: Pendulum, k_p: float, k_c: float) -> bool:
    r"""Return whether Eq. (38) proves stability for some alpha, beta and gamma.

    .. math:: k_c > \omega_n, \quad 0 < k_p k_c < \omega_n^2

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].

    Returns:
        Whether `dissipation_gains` exist.

    Note:
        Differs from the paper: Eq. (32) does not imply it. The paper's y gains meet it,
        its x gains do not.

    Example:
        >>> proof_condition(Pendulum(), 1.8, 3.8), proof_condition(Pendulum(), 3.0, 6.6)
        (True, False)
    """
    omega = pendulum.omega
    return bool(k_c > omega and 0.0 < k_p * k_c < omega**2)


def is_hurwitz(k_p: float, k_c: float) -> bool:
    r"""Return whether the ideal loop is stable: exactly, :math:`0 < k_p < k_c`.

    The error dynamics (35), (36) have trace -omega^2 / k_p and determinant
    omega^2 (k_c - k_p) / k_p, so that omega_n does not matter.

    Args:
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].

    Returns:
        Whether both poles are left of the imaginary axis.

    Example:
        >>> is_hurwitz(3.0, 6.6), is_hurwitz(6.6, 6.6)
        (True, False)
    """
    return bool(0.0 < k_p < k_c and math.isfinite(k_c))


def _second_order(pendulum: Pendulum, k_p: float, k_c: float) -> tuple[float, float]:
    """Return a_1, a_0 of s^2 + a_1 s + a_0, the polynomial of the error dynamics."""
    a_1 = pendulum.omega**2 / k_p
    return a_1, a_1 * (k_c - k_p)


def poles(pendulum: Pendulum, k_p: float, k_c: float) -> np.ndarray:
    r"""Return the poles of the ideal loop, the roots of the error dynamics.

    .. math:: \frac{k_p}{\omega_n^2} s^2 + s + (k_c - k_p) = 0

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s].

    Returns:
        Two complex poles [1/s], of shape (2,).

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> [f"{s:.3f}" for s in poles(Pendulum(), 3.0, 6.6)]
        ['-2.380+3.387j', '-2.380-3.387j']
    """
    _check_gains(k_p, k_c)
    a_1, a_0 = _second_order(pendulum, k_p, k_c)
    return np.roots([1.0, a_1, a_0]).astype(complex)


def natural_frequency(pendulum: Pendulum, k_p: float, k_c: float) -> float:
    r"""Return the natural frequency of the stable ideal loop.

    .. math:: \omega_{cl} = \omega_n \sqrt{(k_c - k_p) / k_p}

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.

    Returns:
        Natural frequency [rad/s].

    Raises:
        ParameterError: If the loop is not stable.

    Example:
        >>> round(natural_frequency(Pendulum(), 3.0, 6.6), 3)
        4.139
    """
    _check_gains(k_p, k_c, stable=True)
    return math.sqrt(_second_order(pendulum, k_p, k_c)[1])


def damping(pendulum: Pendulum, k_p: float, k_c: float) -> float:
    r"""Return the damping ratio of the stable ideal loop.

    .. math:: \zeta = \frac{\omega_n}{2 \sqrt{k_p (k_c - k_p)}}

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s], above k_p.

    Returns:
        Damping ratio [1].

    Raises:
        ParameterError: If the loop is not stable.

    Example:
        >>> round(damping(Pendulum(), 3.0, 6.6), 3)
        0.575
        >>> round(damping(Pendulum(), 1.8, 3.8), 3)
        0.996
    """
    _check_gains(k_p, k_c, stable=True)
    return pendulum.omega / (2.0 * math.sqrt(k_p * (k_c - k_p)))


def design_gains(
    pendulum: Pendulum, natural_frequency: float, damping: float
) -> tuple[float, float]:
    r"""Return the gains that give the ideal loop a frequency and a damping.

    .. math:: k_p = \frac{\omega_n^2}{2 \zeta \omega_{cl}}, \quad
        k_c = k_p (1 + \omega_{cl}^2 / \omega_n^2)

    Args:
        pendulum: Gives omega_n [rad/s].
        natural_frequency: Of the closed loop [rad/s], above 0.
        damping: Ratio [1], above 0.

    Returns:
        k_p and k_c [1/s]; always stable in the ideal model.

    Raises:
        ParameterError: If a number is out of range.

    Example:
        >>> [round(k, 3) for k in design_gains(Pendulum(), 4.0, 1.0)]
        [1.785, 3.785]
    """
    name = "natural_frequency"
    w = checked_number(name, natural_frequency, unit="rad/s", low=0, open_low=True)
    zeta = checked_number("damping", damping, low=0.0, open_low=True)
    omega = pendulum.omega
    k_p = omega**2 / (2.0 * zeta * w)
    return k_p, k_p * (1.0 + w**2 / omega**2)


def frequency_response(
    pendulum: Pendulum, k_p: float, k_c: float, frequency: float
) -> tuple[complex, complex]:
    r"""Return what a sine disturbance does to the CoM and ZMP errors.

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


def simulate_error_dynamics(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    disturbance: np.ndarray,
    dt: float,
    initial: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray]:
    r"""Return the errors under a piecewise linear disturbance, Eqs. (33) and (34).

    .. math:: \frac{k_p}{\omega_n^2} \ddot e_c + \dot e_c + (k_c - k_p) e_c = -\epsilon

    integrated exactly (matrix exponential) on the state (e_c, e_c'), which avoids the
    algebraic loop between u and p.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s]; the loop need not be stable.
        disturbance: eps at the sample times [m/s], linear between, of shape (n,).
        dt: Sample time [s], above 0.
        initial: e_c [m] and its rate [m/s] at the start.

    Returns:
        e_c and e_p [m] at the sample times, each of shape (n,).

    Raises:
        ParameterError: If a gain, dt, the disturbance or the start is out of range.

    Example:
        >>> e_c, e_p = simulate_error_dynamics(Pendulum(), 3, 6.6, np.ones(500), 0.02)
        >>> [round(float(e), 6) for e in (e_c[-1], e_p[-1])]
        [-0.277778, -0.277778]
    """
    _check_gains(k_p, k_c)
    h = checked_number("dt", dt, unit="s", low=0.0, open_low=True)
    eps = np.asarray(disturbance, dtype=float)
    if eps.ndim != 1 or not (np.isfinite(eps).all() and np.isfinite(initial).all()):
        raise ParameterError("disturbance (n,) and initial (2,) must be finite numbers")
    F, G_0, G_1 = ramp_step(pendulum, k_p, k_c, h)
    x = np.empty((len(eps), 2))
    x[:1] = initial
    for i in range(len(eps) - 1):
        x[i + 1] = F @ x[i] + G_0 * eps[i] + G_1 * eps[i + 1]
    return x[:, 0], zmp_error_from_com(k_p, k_c, x[:, 0], x[:, 1], eps)


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
