"""The paper's closed form of a regular walk, Eqs. (4)-(13), with its coefficients.

`comwalk pattern` prints them, and tests hold the pattern to them. A walk gets the same
numbers from `phases`, which solves for any footsteps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..errors import checked_number
from .footsteps import Gait


class TransferZmp(NamedTuple):
    """The ZMP at the end of double support, seen from the middle of the feet."""

    x: float
    """K_x [m]."""

    y: float
    """K_y [m]."""


class Coefficients(NamedTuple):
    """The coefficients of the CoM in single support."""

    C_x1: float
    """Of cosh in x, Eq. (6) [m]."""

    C_x2: float
    """Of sinh in x, Eq. (7) [m]."""

    C_y1: float
    """Of cosh in y, Eq. (11) [m]."""

    C_y2: float
    """Of sinh in y, Eq. (12) [m]."""


class ComMotion(NamedTuple):
    """The horizontal motion of the CoM."""

    position: np.ndarray
    """c [m], shape (..., 2)."""

    velocity: np.ndarray
    """cdot [m/s], shape (..., 2)."""

    acceleration: np.ndarray
    """cddot [m/s^2], shape (..., 2)."""


def transfer_zmp(gait: Gait, omega: float) -> TransferZmp:
    r"""Return the ZMP at the end of double support, Eqs. (8) and (13).

    .. math::
        K_x = \frac{B t_d \omega_n}{t_d \omega_n + \tanh(\omega_n (T/2 - t_d))}, \quad
        K_y = \frac{A t_d \omega_n \tanh(\omega_n (T/2 - t_d))}
                   {1 + t_d \omega_n \tanh(\omega_n (T/2 - t_d))}

    Args:
        gait: Uses T, t_d [s] and A, B [m].
        omega: Natural frequency omega_n [rad/s].

    Returns:
        K_x and K_y [m].

    Example:
        >>> K_x, K_y = transfer_zmp(Gait(), math.sqrt(9.81 / 0.687))
        >>> round(K_x, 6), round(K_y, 6)
        (0.029405, 0.022977)
    """
    T, t_d, A, B = gait.period, gait.transfer_time, gait.half_width, gait.half_step
    u = t_d * omega
    th = math.tanh(omega * (T / 2 - t_d))
    return TransferZmp(B * u / (u + th), A * u * th / (1 + u * th))


def coefficients(gait: Gait, omega: float) -> Coefficients:
    r"""Return the coefficients of the CoM, Eqs. (6), (7), (11) and (12).

    .. math:: C_{x1} = K_x - B, \; C_{x2} = K_x / (t_d \omega_n), \;
        C_{y1} = K_y - A, \; C_{y2} = K_y / (t_d \omega_n)

    Args:
        gait: Uses T, t_d [s] and A, B [m].
        omega: Natural frequency omega_n [rad/s].

    Returns:
        C_x1, C_x2, C_y1 and C_y2 [m].

    Example:
        >>> round(coefficients(Gait(), math.sqrt(9.81 / 0.687)).C_x2, 6)
        0.077815
    """
    K_x, K_y = transfer_zmp(gait, omega)
    t_d, A, B = gait.transfer_time, gait.half_width, gait.half_step
    return Coefficients(K_x - B, K_x / (t_d * omega), K_y - A, K_y / (t_d * omega))


def paper_zmp(gait: Gait, omega: float, time: np.ndarray | float) -> np.ndarray:
    r"""Return the desired ZMP of one step, Eqs. (4) and (9).

    The step begins in the middle of a double support, seen from the middle of the feet,
    and the left foot at (B, A) carries the body in single support.

    Args:
        gait: Uses T, t_d [s] and A, B [m].
        omega: Natural frequency omega_n [rad/s].
        time: Times t [s] in [0, T), any shape.

    Returns:
        p [m], shape of `time` + (2,).

    Raises:
        ParameterError: If a time is outside [0, T).

    Note:
        Differs from the paper: its y-ZMP carries no number; it is counted as (9).

    Example:
        >>> paper_zmp(Gait(), math.sqrt(9.81 / 0.687), 0.5).tolist()
        [0.1, 0.09]
    """
    t = _times_of_step(gait, time)
    T, t_d, A, B = gait.period, gait.transfer_time, gait.half_width, gait.half_step
    K_x, K_y = transfer_zmp(gait, omega)
    phase = [t < t_d, t < T - t_d]
    p_x = np.select(
        phase,
        [K_x / t_d * t, np.full_like(t, B)],
        (2 * B - K_x) + K_x / t_d * (t - (T - t_d)),
    )
    p_y = np.select(phase, [K_y / t_d * t, np.full_like(t, A)], -K_y / t_d * (t - T))
    return np.stack([p_x, p_y], axis=-1)


def paper_com(gait: Gait, omega: float, time: np.ndarray | float) -> ComMotion:
    r"""Return the desired CoM of one step, Eqs. (5) and (10).

    .. math:: c(t) = C_1 \cosh(\omega_n (t - t_d)) + C_2 \sinh(\omega_n (t - t_d)) + p

    in single support with p = (B, A), and c = p in double support.

    Args:
        gait: Uses T, t_d [s] and A, B [m].
        omega: Natural frequency omega_n [rad/s].
        time: Times t [s] in [0, T), any shape, as in `paper_zmp`.

    Returns:
        Position, velocity and acceleration, each of the shape of `time` + (2,).

    Raises:
        ParameterError: If a time is outside [0, T).

    Example:
        >>> motion = paper_com(Gait(), math.sqrt(9.81 / 0.687), 0.5)
        >>> motion.position.round(6).tolist()
        [0.1, 0.061805]
    """
    t = _times_of_step(gait, time)
    T, t_d, A, B = gait.period, gait.transfer_time, gait.half_width, gait.half_step
    K_x, K_y = transfer_zmp(gait, omega)
    C_x1, C_x2, C_y1, C_y2 = coefficients(gait, omega)
    single = ((t >= t_d) & (t < T - t_d))[..., None]
    cosh = np.cosh(omega * (t - t_d))[..., None]
    sinh = np.sinh(omega * (t - t_d))[..., None]
    C_1, C_2, foot = np.array([C_x1, C_y1]), np.array([C_x2, C_y2]), np.array([B, A])
    sign = np.where(t < t_d, 1.0, -1.0)
    slope = np.stack([np.full_like(t, K_x / t_d), sign * K_y / t_d], axis=-1)
    swing = C_1 * cosh + C_2 * sinh
    return ComMotion(
        np.where(single, swing + foot, paper_zmp(gait, omega, t)),
        np.where(single, omega * (C_1 * sinh + C_2 * cosh), slope),
        np.where(single, omega**2 * swing, 0.0),
    )


def _times_of_step(gait: Gait, time: np.ndarray | float) -> np.ndarray:
    """Return times as an array inside [0, T)."""
    t = np.asarray(time, dtype=float)
    inside = (t >= 0.0) & (t < gait.period)
    if not inside.all():
        checked_number(
            "time",
            t[~inside].flat[0],
            unit="s",
            low=0.0,
            high=gait.period,
            open_high=True,
        )
    return t
