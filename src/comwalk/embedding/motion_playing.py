r"""Kernels that play an embedded motion: its spline, and its blend with home.

.. math::
    q = q_h + w (q_m - q_h), \quad \dot q = w \dot q_m + \dot w (q_m - q_h)

`Motion.at` and `EmbeddedMotion.at` call them, and so does the control tick.
"""

from __future__ import annotations

import numpy as np

from ..compiled import Record, kernel
from ..pattern import bend_of_minimum_jerk, minimum_jerk

DANCE = np.dtype(
    [
        ("start", "f8"),  # when it leaves the home posture [s]
        ("stop", "f8"),  # when it is back there [s]
        ("blend", "f8"),  # time to blend in, and to blend out [s]
        ("loops", "i8"),
    ],
    align=True,
)
"""When an embedded motion plays."""


@kernel
def find_segment(knots: np.ndarray, loops: int, t: float) -> tuple[int, float, float]:
    """Return where a motion is.

    Args:
        knots: Its knots [s], rising from 0.
        loops: Whether it repeats; otherwise its ends are held.
        t: Time since its start [s].

    Returns:
        The segment, the time since its first knot [s], and 0 where the motion rests.
    """
    n = len(knots)
    if loops:
        t = t % knots[n - 1]
    elif t <= 0.0:
        return 0, 0.0, 0.0
    elif t >= knots[n - 1]:
        return n - 2, knots[n - 1] - knots[n - 2], 0.0
    k = min(np.searchsorted(knots, t, "right"), n - 1) - 1
    return k, t - knots[k], 1.0


@kernel
def find_weight(dance: Record, t: float) -> tuple[float, float, float]:
    """Return the weight of a motion against home, its rate [1/s], and the rate of that.

    Args:
        dance: A record of `DANCE`.
        t: Time from the plan's start [s].
    """
    t_in, t_out = t - dance.start, dance.stop - t
    s, T = min(t_in, t_out) / dance.blend, dance.blend
    w, dw = minimum_jerk(s)
    return w, dw / T if t_in < t_out else -dw / T, bend_of_minimum_jerk(s) / (T * T)


@kernel
def blended(
    c: np.ndarray,
    s: float,
    moves: float,
    home: float,
    weight: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return angle [rad], rate [rad/s] and acceleration [rad/s^2] of one joint.

    Args:
        c: Its cubic, highest power first.
        s: Time since the segment's first knot [s].
        moves: 0 where the motion rests, 1 elsewhere.
        home: Home angle [rad].
        weight: Weight of the motion, its rate [1/s] and the rate of that [1/s^2].
    """
    w, dw, ddw = weight
    q = ((c[0] * s + c[1]) * s + c[2]) * s + c[3]
    dq = moves * ((3.0 * c[0] * s + 2.0 * c[1]) * s + c[2])
    ddq = moves * (6.0 * c[0] * s + 2.0 * c[1])
    away = q - home
    rate = w * dq + dw * away
    return home + w * away, rate, w * ddq + 2.0 * dw * dq + ddw * away


@kernel
def play(
    knots: np.ndarray,
    cubics: np.ndarray,
    loops: int,
    t: float,
    weight: tuple[float, float, float],
    home: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write angles [rad], rates [rad/s] and accelerations of a motion, (3, m).

    Args:
        knots: Its knots [s], (n,).
        cubics: The cubics between them, highest power first, (n - 1, 4, m).
        loops: Whether it repeats.
        t: Time since its start [s].
        weight: Its weight against home, and two rates of that, as `find_weight`.
        home: Home angles [rad], (m,).
        out: Where they go.
    """
    k, s, moves = find_segment(knots, loops, t)
    for i in range(len(home)):
        c = cubics[k, :, i]
        out[0, i], out[1, i], out[2, i] = blended(c, s, moves, home[i], weight)
