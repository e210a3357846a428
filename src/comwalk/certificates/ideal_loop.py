"""Stability of the walking controller, Eqs. (28) and (32) to (38), per axis.

Every function looks at one axis (x or y) on its own: the axes do not couple. This is
the paper's theory on the ideal model (30), with the exact facts beside it;
`sampled_loop` has the loop as it is sampled, filtered and delayed on a robot.

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
