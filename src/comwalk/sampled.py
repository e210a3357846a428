"""The walking controller's loop as it runs: sampled, filtered, delayed, per axis.

The paper's proof knows of none of these. A ZMP filter, a servo lag and a delay make the
gains of Theorem 1 unstable or not: `spectral_radius` tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .errors import ParameterError, checked_number
from .pendulum import Pendulum


def low_pass_coefficient(cutoff: float | None, dt: float) -> float:
    r"""Return the coefficient of a sampled first-order low-pass filter.

    .. math:: y \leftarrow y + \alpha (x - y), \quad \alpha = 1 - e^{-2 \pi f_c \, dt}

    which is exact for an input held between samples.

    Args:
        cutoff: Cut-off f_c [Hz], above 0; None or infinite for no filter.
        dt: Sample time [s], above 0.

    Returns:
        alpha [1], in (0, 1].

    Raises:
        ParameterError: If a number is out of range.

    Example:
        >>> round(low_pass_coefficient(5.0, 0.002), 6)
        0.060899
    """
    dt = checked_number("dt", dt, unit="s", low=0.0, open_low=True)
    if cutoff is None or cutoff == math.inf:
        return 1.0
    f_c = checked_number("cutoff", cutoff, unit="Hz", low=0.0, open_low=True)
    return -math.expm1(-2.0 * math.pi * f_c * dt)


def servo_response(lag: float, dt: float) -> tuple[float, float]:
    r"""Return what is left of a speed difference after dt, and its integral.

    .. math:: \tau \dot v = u - v: \quad e^{-dt/\tau}, \; \tau (1 - e^{-dt/\tau})

    Args:
        lag: Servo time constant tau [s], above 0.
        dt: Time [s].

    Returns:
        Decay [1] and integral of the decay [s].

    Example:
        >>> [round(x, 6) for x in servo_response(0.02, 0.002)]
        [0.904837, 0.001903]
    """
    return math.exp(-dt / lag), -lag * math.expm1(-dt / lag)


@dataclass(frozen=True, kw_only=True)
class SampledLoop:
    """The loop as a robot runs it: sampled, with servo lag, ZMP filter and delay."""

    period: float = 0.002
    """Control period dt [s], above 0."""

    servo_lag: float = 0.02
    """Time constant tau of the CoM velocity servo [s], above 0."""

    zmp_cutoff: float | None = 4.0
    """Cut-off of the first-order ZMP filter [Hz], above 0; None for the raw ZMP."""

    delay: int = 1
    """Delay of all measurements [ticks], 0 to 1000."""

    analog_filter: bool = False
    """Whether the ZMP is filtered at the sensor's own high rate, not once a tick."""

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        for name, unit in (("period", "s"), ("servo_lag", "s"), ("zmp_cutoff", "Hz")):
            value = getattr(self, name)
            if not (name == "zmp_cutoff" and value in (None, math.inf)):
                checked_number(name, value, unit=unit, low=0.0, open_low=True)
        checked_number("delay", self.delay, unit="ticks", low=0, high=1000)
        if self.delay != int(self.delay):
            raise ParameterError(f"delay must be whole ticks, got {self.delay:g}")


def _analog_step(
    pendulum: Pendulum, loop: SampledLoop, f_c: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return F (3, 3), G (3,) of (c, v, f) over a period, ZMP filter in real time."""
    from scipy.linalg import expm

    tau, w, omega = loop.servo_lag, 2.0 * math.pi * f_c, pendulum.omega
    M = np.zeros((4, 4))
    M[0, 1], M[1, 1], M[1, 3] = 1.0, -1.0 / tau, 1.0 / tau
    q = 1.0 / (tau * omega**2)
    M[2] = w, w * q, -w, -w * q
    E = expm(M * loop.period)
    return E[:3, :3], E[:3, 3]


def _digital_step(
    pendulum: Pendulum, loop: SampledLoop
) -> tuple[np.ndarray, np.ndarray]:
    """Return F (3, 3), G (3,) of (c, v, f) over a period, ZMP filter once a tick."""
    decay, area = servo_response(loop.servo_lag, loop.period)
    c = np.array([1.0, area, 0.0, loop.period - area])
    v = np.array([0.0, decay, 0.0, 1.0 - decay])
    u, f = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, 0.0])
    p = c - (u - v) / (loop.servo_lag * pendulum.omega**2)
    f = f + low_pass_coefficient(loop.zmp_cutoff, loop.period) * (p - f)
    M = np.array([c, v, f])
    return M[:, :3], M[:, 3]


def sampled_loop_matrix(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> np.ndarray:
    r"""Return the matrix of one tick of the sampled loop under Eq. (31).

    .. math:: \tau \dot v = u - v, \quad \dot c = v, \quad p = c - \dot v / \omega_n^2,
        \quad u_n = k_p f_{n-k} - k_c c_{n-k}

    with u held over the period and f the filtered p. The state is (c, v, f) now and the
    pairs (c, f) of the last k ticks, newest first.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: Period, servo lag, filter and delay k.

    Returns:
        Matrix of shape (3 + 2 k, 3 + 2 k).

    Raises:
        ParameterError: If a gain is out of range.
    """
    checked_number("k_p", k_p, unit="1/s", low=0.0)
    checked_number("k_c", k_c, unit="1/s", low=0.0)
    f_c, k = loop.zmp_cutoff, int(loop.delay)
    if loop.analog_filter and f_c is not None and math.isfinite(f_c):
        F, G = _analog_step(pendulum, loop, f_c)
    else:
        F, G = _digital_step(pendulum, loop)
    M = np.zeros((3 + 2 * k, 3 + 2 * k))
    M[:3, :3] = F
    oldest = (0, 2) if k == 0 else (1 + 2 * k, 2 + 2 * k)
    M[:3, oldest[0]] -= k_c * G
    M[:3, oldest[1]] += k_p * G
    if k > 0:
        M[3, 0] = M[4, 2] = 1.0
        M[5:, 3 : 1 + 2 * k] = np.eye(2 * k - 2)
    return M


def spectral_radius(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> float:
    """Return the growth of the sampled loop per tick; it is stable below 1.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: Period, servo lag, filter and delay.

    Returns:
        Spectral radius [1] of `sampled_loop_matrix`.

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> loop = SampledLoop(period=0.001, zmp_cutoff=None)
        >>> round(spectral_radius(Pendulum(), 3.0, 6.6, loop), 1)
        3.2
    """
    M = sampled_loop_matrix(pendulum, k_p, k_c, loop)
    return float(np.abs(np.linalg.eigvals(M)).max())


def highest_cutoff(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> float:
    """Return the ZMP cut-off up to which the sampled loop is stable.

    Take half of it or less for a gain margin of 2.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: Period, servo lag and delay; its own cut-off is ignored.

    Returns:
        Cut-off [Hz] to 0.01 %: every lower one down to 0.02 Hz is stable; 0 if that
        is not, infinite if the loop is stable up to 2000 Hz.

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> loop = SampledLoop(period=0.005, analog_filter=True)
        >>> round(highest_cutoff(Pendulum(), 3.0, 6.6, loop), 2)
        3.56
    """

    def is_stable(f_c: float) -> bool:
        sampled = replace(loop, zmp_cutoff=f_c)
        return spectral_radius(pendulum, k_p, k_c, sampled) < 1.0

    low = 0.0
    for high in np.geomspace(0.02, 2000.0, 120).tolist():
        if not is_stable(high):
            break
        low = high
    else:
        return math.inf
    while low > 0.0 and high > 1.0001 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return low
