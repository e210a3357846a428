r"""The walking controller's loop around a measured response, per axis.

`stability_margins` looks at the loop of a model: a servo, a dead time, a contact that
yields. Here CoM and ZMP answer as they were measured to, compliance and all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from ...errors import ComwalkError
from ...pattern import Pendulum
from .. import SampledLoop, loop_gain, open_loop
from .frequency_response import ResponseFit

_POINTS = 2000  # on the unit circle
_LOWEST = 0.02  # lowest frequency that is looked at [Hz]
_BAND = (0.5, 3.0)  # in which a loop is fitted: from [Hz], to so many mode frequencies
_RIGID_BAND = 10.0  # to this frequency without a mode [Hz]


@dataclass(frozen=True)
class MeasuredMargin:
    """Delay margin of a measured loop."""

    stable: bool
    """Whether the loop is stable as it is."""
    delay: float
    """Further delay that makes it unstable [s]; 0 if it is unstable, infinite if none
    does."""
    frequency: float
    """Frequency at which it then swings [Hz]; nan if it never does."""


def measured_margin(
    fit: ResponseFit, k_p: float, k_c: float, cutoff: float | None
) -> MeasuredMargin:
    """Return the delay margin of the loop of Eq. (31) on a measured response.

    Nothing is known beyond the highest frequency that was measured: a loop gain that is
    not below 1 there counts as unstable.

    Args:
        fit: The response of the axis.
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], above 0.
        cutoff: Cut-off of the ZMP filter [Hz]; None for none.

    Returns:
        Stability by the winding of 1 + L (Nyquist), and the delay margin.
    """
    dt = fit.period
    f = np.geomspace(_LOWEST, fit.highest, _POINTS)
    z = np.exp(2j * np.pi * f * dt)
    C, P = fit.at(f) * dt / (z - 1.0)
    L = loop_gain(k_p, k_c, SampledLoop(period=dt, zmp_cutoff=cutoff), z, C, P)
    # From the pole of the integrator, at -90 deg, to L = 0: a quarter turn.
    turn = np.unwrap(np.angle(1.0 + L))
    around = abs(turn[-1] - turn[0] - 0.5 * math.pi) > 0.5 * math.pi
    if around or abs(L[-1]) >= 1.0:
        return MeasuredMargin(False, 0.0, math.nan)
    size = np.log(np.abs(L))
    (at,) = np.nonzero(size[:-1] * size[1:] < 0.0)
    part = size[at] / (size[at] - size[at + 1])
    crossing = f[at] * (f[at + 1] / f[at]) ** part
    phase = np.unwrap(np.angle(L))
    lead = np.mod(phase[at] + part * (phase[at + 1] - phase[at]) + math.pi, 2 * math.pi)
    delays = lead / (2.0 * np.pi * crossing)
    if not len(delays):
        return MeasuredMargin(True, math.inf, math.nan)
    k = int(np.argmin(delays))
    return MeasuredMargin(True, float(delays[k]), float(crossing[k]))


def equivalent_loop(
    fit: ResponseFit, pendulum: Pendulum, cutoff: float | None
) -> SampledLoop:
    """Return the model loop whose CoM and ZMP answer most like a measured response.

    Its servo lag and its yielding contact share what was measured; they are numbers of
    the loop, not of the joints.

    Args:
        fit: The response of the axis.
        pendulum: The simplified model.
        cutoff: Cut-off of the ZMP filter [Hz]; None for none.

    Returns:
        The loop, without delay: what is late is its dead time.
    """
    dt, mode = fit.period, fit.frequency
    top = _RIGID_BAND if mode is None else _BAND[1] * mode.value
    f = np.geomspace(_BAND[0], min(top, fit.highest), 60)
    z = np.exp(2j * np.pi * f * dt)
    wanted = fit.at(f) * dt / (z - 1.0)
    dead_time = max(0.0, fit.dead_time)

    def loop_of(x: np.ndarray) -> SampledLoop:
        lag, *contact = np.exp(np.clip(x, -9.0, 4.0)).tolist()
        names = ("mode_frequency", "mode_damping")
        return SampledLoop(
            period=dt,
            servo_lag=lag,
            zmp_cutoff=cutoff,
            delay=0,
            dead_time=dead_time,
            **dict(zip(names, contact, strict=False)),
        )

    def residual(x: np.ndarray) -> np.ndarray:
        own = np.array(open_loop(pendulum, loop_of(x), z))
        r = ((own - wanted) / np.abs(wanted).max(axis=1, keepdims=True))[1]
        return np.concatenate([r.real, r.imag])

    start = [math.log(max(fit.lag.value, 0.005))]
    if mode is not None and fit.damping is not None:
        start += [math.log(mode.value), math.log(fit.damping.value)]
    found = scipy.optimize.least_squares(residual, start)
    if not np.isfinite(found.x).all():
        raise ComwalkError("no loop answers like the measured one")
    return loop_of(found.x)
