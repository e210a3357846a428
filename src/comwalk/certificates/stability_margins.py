"""Stability margins of the sampled loop, per axis.

All is read from the loop cut open at u, on the unit circle: the loop gain
:math:`L(z) = k_c C(z) - k_p P(z)`, with u = -L u when the loop is closed. A pole on the
circle means L = -1; `sampled_loop.spectral_radius` finds the same by eigenvalues.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..control import low_pass_coefficient
from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .sampled_loop import SampledLoop, crossings, on_circle, open_loop, spectral_radius


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Stability margins of a loop."""

    gain_up: float
    """Factor on both gains at which the loop becomes unstable [-], above 1."""
    gain_down: float
    """The same below 1 [-]; 0 if they may vanish."""
    phase: float
    """Least phase that makes the loop unstable, in either direction [rad]."""
    delay: float
    """Least further delay that makes it unstable [s]; infinite if none does. Exact for
    whole ticks: n more of them are stable if n periods are less than this."""
    modulus: float
    """Least distance of the loop gain from -1 [-]: 1 over the peak of the
    sensitivity."""


Gain: TypeAlias = Any
"""A gain [1/s], or an array of them that a formula is applied to at once."""


def loop_gain(
    k_p: Gain, k_c: Gain, loop: SampledLoop, z: Any, C: Any, P: Any
) -> np.ndarray:
    r"""Return the loop gain :math:`L = k_c C - k_p F P`, F the filter of each tick.

    Args:
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].
        loop: Gives the filter.
        z: Complex numbers, of shape (n,).
        C: Of `open_loop`, of shape (n,).
        P: Of `open_loop`, of shape (n,).

    Returns:
        L [-], of shape (n,).
    """
    cutoff = None if loop.analog_filter else loop.zmp_cutoff
    alpha = low_pass_coefficient(cutoff, loop.period)
    return k_c * C - k_p * P * alpha * z / (z - 1.0 + alpha)


def margins(pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop) -> Margins:
    """Return the margins of the sampled loop.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], above 0.
        loop: The loop.

    Returns:
        Margins of gain, phase, delay and modulus.

    Raises:
        ParameterError: If the loop is unstable, or a gain out of range.

    Example:
        >>> m = margins(Pendulum(), 3.0, 6.6, SampledLoop())
        >>> f"{m.gain_up:.2f} {math.degrees(m.phase):.0f} deg {1e3 * m.delay:.1f} ms"
        '2.14 64 deg 4.5 ms'
    """
    checked_number("k_c", k_c, unit="1/s", low=0.0, open_low=True)
    if spectral_radius(pendulum, k_p, k_c, loop) >= 1.0:
        raise ParameterError("the sampled loop is unstable and has no margins")

    def lead(z: np.ndarray, C: np.ndarray, P: np.ndarray) -> np.ndarray:
        """Phase above -pi; its imaginary part vanishes where |L| = 1."""
        L = loop_gain(k_p, k_c, loop, z, C, P)
        return np.mod(np.angle(L) + math.pi, 2.0 * math.pi) + 1j * np.log(np.abs(L))

    factors = _unstable_factors(pendulum, k_p, k_c, loop)
    leads = crossings(pendulum, loop, lead)
    angles, C, P = on_circle(pendulum, loop)
    L = loop_gain(k_p, k_c, loop, np.exp(1j * angles), C, P)
    up = min((g for g in factors if g > 1.0), default=math.inf)
    phase = min((min(p, 2.0 * math.pi - p) for _, p in leads), default=math.pi)
    near = float(np.abs(1.0 + L).min())
    return Margins(
        gain_up=up,
        gain_down=max((g for g in factors if g < 1.0), default=0.0),
        phase=phase,
        delay=loop.period * min((p / t for t, p in leads), default=math.inf),
        modulus=min(near, 1.0 - 1.0 / up, 2.0 * math.sin(0.5 * phase)),
    )


def gain_limit(pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop) -> float:
    """Return by what factor both gains may grow from zero before the loop is unstable.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], above k_p.
        loop: The loop.

    Returns:
        Factor [-]: every smaller one is stable; infinite if all are.

    Example:
        >>> round(gain_limit(Pendulum(), 3.0, 6.6, SampledLoop()), 2)
        2.14
    """
    return min(_unstable_factors(pendulum, k_p, k_c, loop), default=math.inf)


def _unstable_factors(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> list[float]:
    def factor(z: np.ndarray, C: np.ndarray, P: np.ndarray) -> np.ndarray:
        return -1.0 / loop_gain(k_p, k_c, loop, z, C, P)

    return [g for _, g in crossings(pendulum, loop, factor) if g > 0.0]


def zmp_sensitivity(
    pendulum: Pendulum, k_p: Gain, k_c: Gain, loop: SampledLoop, frequency: float
) -> Gain:
    r"""Return the sensitivity to a periodic ZMP error, such as the swing foot's.

    .. math:: S = \frac{1 + k_c C}{1 + k_c C - k_p F P}, \quad
        S(0) = \frac{k_c}{k_c - k_p}

    Without the law the ZMP under the soles would be off by 1 where it is off by S.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], or an array.
        k_c: CoM gain [1/s], or an array of the same shape.
        loop: The loop.
        frequency: Of the error [Hz], above 0, below half the sampling frequency.

    Returns:
        |S| [-], of the shape of the gains.

    Raises:
        ParameterError: If the frequency is out of range.

    Example:
        >>> f"{zmp_sensitivity(Pendulum(), 3.0, 6.6, SampledLoop(), 1.0):.2f}"
        '0.85'
    """
    high, name = 0.5 / loop.period, "frequency"
    f = checked_number(name, frequency, unit="Hz", low=0.0, high=high, open_low=True)
    z = np.exp([2j * math.pi * f * loop.period])
    (C,), (P,) = open_loop(pendulum, loop, z)
    L = loop_gain(k_p, k_c, loop, z[0], C, P)
    return abs((1.0 + k_c * C) / (1.0 + L))


def largest_zmp_gain(pendulum: Pendulum, k_c: float, loop: SampledLoop) -> float:
    """Return the ZMP gain up to which the sampled loop is stable, at a CoM gain.

    Take half of it or less for a gain margin of 2.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_c: CoM gain [1/s], 0 or above.
        loop: The loop.

    Returns:
        k_p [1/s], at most k_c: every smaller one is stable; 0 if none is.

    Raises:
        ParameterError: If the gain is out of range.

    Example:
        >>> round(largest_zmp_gain(Pendulum(), 6.6, SampledLoop()), 2)
        6.41
    """
    k_c = checked_number("k_c", k_c, unit="1/s", low=0.0)
    if k_c == 0.0 or spectral_radius(pendulum, 1e-6 * k_c, k_c, loop) >= 1.0:
        return 0.0

    def gain(z: np.ndarray, C: np.ndarray, P: np.ndarray) -> np.ndarray:
        return -(1.0 + k_c * C) / loop_gain(1.0, 0.0, loop, z, C, P)

    found = [k_p for _, k_p in crossings(pendulum, loop, gain) if k_p > 0.0]
    return min([k_c, *found])


def decay_rate(pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop) -> float:
    """Return the slowest decay rate of the sampled loop.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: The loop.

    Returns:
        Rate [1/s]; negative if the loop is unstable.

    Raises:
        ParameterError: If a gain is out of range.

    Example:
        >>> loop = SampledLoop(period=0.005, zmp_cutoff=1.0, analog_filter=True)
        >>> round(decay_rate(Pendulum(), 3.0, 6.6, loop), 2)
        2.69
    """
    radius = spectral_radius(pendulum, k_p, k_c, loop)
    return -math.log(radius) / loop.period if radius > 0.0 else math.inf
