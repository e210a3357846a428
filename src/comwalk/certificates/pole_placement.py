"""Poles of the ideal loop, and gains that place them, Eqs. (35) and (36)."""

from __future__ import annotations

import math

import numpy as np

from ..errors import checked_number
from ..pattern import Pendulum
from .ideal_loop import _check_gains


def _second_order(pendulum: Pendulum, k_p: float, k_c: float) -> tuple[float, float]:
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
