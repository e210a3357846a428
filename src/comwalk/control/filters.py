"""First-order filters and lags, sampled."""

from __future__ import annotations

import math

from ..errors import checked_number


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
    r"""Return the decay of a speed difference over dt, and its integral.

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
