"""The walking controller's loop as it runs: sampled, filtered, delayed, per axis.

The paper's proof knows of none of these. A ZMP filter, a servo lag and a delay make the
gains of Theorem 1 unstable or not: `spectral_radius` tells. The same loop is here as a
matrix from tick to tick, and cut open at u as a frequency response, of which
`stability_margins` makes margins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np

from ..control import low_pass_coefficient, servo_response
from ..errors import checked_number
from ..pattern import Pendulum
from ..settings import check_settings, setting


@dataclass(frozen=True, kw_only=True)
class SampledLoop:
    """The loop as a robot runs it: sampled, with servo lag, ZMP filter and delay."""

    period: float = setting(0.002, "Control period dt", "s", "[1e-5, 1]")

    servo_lag: float = setting(
        0.02, "Time constant tau of the CoM velocity servo", "s", "[1e-5, 100]"
    )

    zmp_cutoff: float | None = setting(
        4.0,
        "Cut-off of the first-order ZMP filter, above 0; None for the raw ZMP",
        "Hz",
        "(0, inf]",
    )

    delay: int = setting(1, "Delay of all measurements", "ticks", "[0, 1000]")

    analog_filter: bool = setting(
        False,
        "Whether the ZMP is filtered at the sensor's own high rate, not once a tick",
    )

    dead_time: float = setting(
        0.0,
        "Dead time between the command and the servo, at most 1000 periods",
        "s",
        "[0, 1000]",
    )

    mode_frequency: float | None = setting(
        None,
        "Frequency at which the ZMP swings on the yielding contact; None for rigid "
        "ground",
        "Hz",
        "[0.01, 1e4]",
    )

    mode_damping: float = setting(0.5, "Damping ratio of that swing", "", "(0, 10]")

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        check_settings(self)
        high = 1000.0 * self.period
        checked_number("dead_time", self.dead_time, unit="s", low=0.0, high=high)

    @property
    def analog_cutoff(self) -> float | None:
        """Cut-off of the filter in real time [Hz]; None if there is no such filter."""
        infinite = self.zmp_cutoff is None or self.zmp_cutoff == math.inf
        return None if infinite or not self.analog_filter else self.zmp_cutoff

    @property
    def dead_ticks(self) -> tuple[int, float]:
        """The dead time as whole ticks, and the rest of it [s]."""
        ticks = math.floor(self.dead_time / self.period + 1e-9)
        rest = self.dead_time - ticks * self.period
        return ticks, rest if rest > 1e-9 * self.period else 0.0


class LoopPlant(NamedTuple):
    r"""The plant in real time, with the command u and the disturbance as inputs.

    .. math:: \dot x = A x + b u + b_0 \epsilon + b_1 \dot\epsilon, \quad
        p = r x + r_u u + r_1 \dot\epsilon

    The state x is (c, v, f), and where the contact yields (q, q') behind it, with q the
    ZMP as it swings.
    """

    A: np.ndarray
    """(n, n) [1/s]."""
    b: np.ndarray
    """Of u, (n,)."""
    b_eps: np.ndarray
    """Of eps, (n, 2), and of its rate."""
    row: np.ndarray
    """Of the ZMP p that is sensed, (n,)."""
    through: float
    """Of u in p [s]."""
    through_rate: float
    """Of the rate of eps in p [s^2]."""


def loop_plant(pendulum: Pendulum, loop: SampledLoop) -> LoopPlant:
    r"""Return CoM, servo, contact and analog filter as one linear system.

    .. math:: \dot c = v + \epsilon, \quad \tau \dot v = u - v, \quad
        p = c - (\dot v + \dot\epsilon) / \omega_n^2

    With a contact that yields, the sensed ZMP q follows this p as
    :math:`\ddot q + 2 \zeta \omega_m \dot q + \omega_m^2 q = \omega_m^2 p`.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: Servo lag, contact, and the filter if it is analog.

    Returns:
        The system; without an analog filter f only rests.
    """
    tau, omega = loop.servo_lag, pendulum.omega
    n = 3 if loop.mode_frequency is None else 5
    A, b, b_eps = np.zeros((n, n)), np.zeros(n), np.zeros((n, 2))
    A[0, 1] = b_eps[0, 0] = 1.0
    A[1, 1], b[1] = -1.0 / tau, 1.0 / tau
    row = np.zeros(n)
    row[:2] = 1.0, 1.0 / (tau * omega**2)
    through, rate = -row[1], -1.0 / omega**2
    if loop.mode_frequency is not None:
        w = 2.0 * math.pi * loop.mode_frequency
        A[3, 4] = 1.0
        A[4] = w**2 * row
        A[4, 3:] = -(w**2), -2.0 * loop.mode_damping * w
        b[4], b_eps[4, 1] = w**2 * through, w**2 * rate
        row, through, rate = np.eye(n)[3], 0.0, 0.0
    if loop.analog_cutoff is not None:
        w = 2.0 * math.pi * loop.analog_cutoff
        A[2] = w * (row - np.eye(n)[2])
        b[2], b_eps[2, 1] = w * through, w * rate
    return LoopPlant(A, b, b_eps, row, through, rate)


class TickResponse(NamedTuple):
    """Transition of the state x = (c, v, f, ...) over a period, before any filter."""

    F: np.ndarray
    """From x, (n, n)."""
    G: np.ndarray
    """From the command that acts at the period's end, (n,)."""
    G_before: np.ndarray
    """From the one before it, which acts for the rest of the dead time, (n,)."""
    row: np.ndarray
    """From x to what is filtered or, if analog, f itself, (n,)."""
    through: float
    """From the acting command to the same [s]."""


def _response(x: LoopPlant, time: float) -> np.ndarray:
    """Return state (n, n) and command (n,) side by side, after a time."""
    n = len(x.b)
    if n == 3 and not x.A[2].any():  # a servo alone: no need of the general form
        decay, area = servo_response(-1.0 / x.A[1, 1], time)
        rows = [1.0, area, 0.0, time - area], [0.0, decay, 0.0, 1.0 - decay]
        return np.array([*rows, [0.0, 0.0, 1.0, 0.0]])
    from scipy.linalg import expm

    M = np.zeros((n + 1, n + 1))
    M[:n, :n], M[:n, n] = x.A, x.b
    return expm(M * time)[:n]


@lru_cache(maxsize=256)
def _tick(pendulum: Pendulum, loop: SampledLoop) -> TickResponse:
    """Return the exact response over a period; all of the loop but a digital filter."""
    x = loop_plant(pendulum, loop)
    n, (_, rest) = len(x.b), loop.dead_ticks
    late, early = _response(x, loop.period - rest), _response(x, rest)
    F = late[:, :n]
    parts = F @ early[:, :n], late[:n, n], F @ early[:, n]
    if loop.analog_cutoff is not None:
        return TickResponse(*parts, np.eye(n)[2], 0.0)
    return TickResponse(*parts, x.row, x.through)


def tick_response(pendulum: Pendulum, loop: SampledLoop) -> tuple[TickResponse, float]:
    """Return the exact response of the plant over a control period, and the filter.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: Period, servo lag, dead time, contact and filter.

    Returns:
        The response, and alpha of the filter that follows it once a tick [-]: 1 if
        there is none.
    """
    alpha = 1.0
    if loop.analog_cutoff is None:
        alpha = low_pass_coefficient(loop.zmp_cutoff, loop.period)
        loop = replace(loop, zmp_cutoff=None)
    return _tick(pendulum, replace(loop, delay=0)), alpha


def disturbance_response(pendulum: Pendulum, loop: SampledLoop) -> np.ndarray:
    """Return the disturbance's effect on the state over a period, before the filter.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: Period, servo lag, contact, and the filter if analog.

    Returns:
        From eps at the start of the period, and from its rate, which is constant, to
        the state of `loop_plant`, (n, 2).
    """
    from scipy.linalg import expm

    x = loop_plant(pendulum, loop)
    n = len(x.b)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n], A[:n, n:], A[n, n + 1] = x.A, x.b_eps, 1.0
    return expm(A * loop.period)[:n, n:]


def sampled_loop_matrix(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop
) -> np.ndarray:
    r"""Return the matrix of one tick of the sampled loop under Eq. (31).

    .. math:: \tau \dot v = u - v, \quad \dot c = v, \quad p = c - \dot v / \omega_n^2,
        \quad u_n = k_p f_{n-k} - k_c c_{n-k}

    with u held over the period and f the filtered p. The state is (c, v, f) now, the
    swinging ZMP and its rate if the contact yields, and the pairs (c, f) of the last k
    ticks, newest first. Whole ticks of dead time count as delay; a part of a tick needs
    one pair more.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], 0 or above.
        k_c: CoM gain [1/s], 0 or above.
        loop: Period, servo lag, filter, delay k, dead time and contact.

    Returns:
        Matrix of shape (3 + 2 k, 3 + 2 k) on rigid ground without dead time.

    Raises:
        ParameterError: If a gain is out of range.
    """
    checked_number("k_p", k_p, unit="1/s", low=0.0)
    checked_number("k_c", k_c, unit="1/s", low=0.0)
    x, alpha = tick_response(pendulum, loop)
    ticks, rest = loop.dead_ticks
    n, k = len(x.G), int(loop.delay) + ticks
    pairs = k + (rest > 0.0)
    M = np.zeros((n + 2 * pairs, n + 2 * pairs))
    F, G, G_before = x.F.copy(), x.G.copy(), x.G_before.copy()
    if loop.analog_cutoff is None:
        F[2] = alpha * (x.row @ x.F) + (1.0 - alpha) * np.eye(n)[2]
        G[2] = alpha * (x.row @ x.G + x.through)
        G_before[2] = alpha * (x.row @ x.G_before)
    M[:n, :n] = F
    for lag, column in ((k, G), (k + 1, G_before))[: 1 + (rest > 0.0)]:
        c, f = (0, 2) if lag == 0 else (n + 2 * lag - 2, n + 2 * lag - 1)
        M[:n, c] -= k_c * column
        M[:n, f] += k_p * column
    if pairs > 0:
        M[n, 0] = M[n + 1, 2] = 1.0
        M[n + 2 :, n : n + 2 * pairs - 2] = np.eye(2 * pairs - 2)
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
    return _radius(pendulum, k_p, k_c, loop)


@lru_cache(maxsize=1024)
def _radius(pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop) -> float:
    M = sampled_loop_matrix(pendulum, k_p, k_c, loop)
    return float(np.abs(np.linalg.eigvals(M)).max())


def open_loop(
    pendulum: Pendulum, loop: SampledLoop, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the open loop from u to the measured CoM and ZMP, delays included.

    With the loop cut open at u, it is the response of the sampled signals to
    :math:`u_n = z^n`; the loop gain of the law is k_c C - k_p P, filtered.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: Period, servo lag, delay, dead time, contact, and the filter if analog.
        z: Complex numbers, not 1, of shape (n,).

    Returns:
        C and P [s], each of shape (n,); P without the digital filter.
    """
    x, _ = tick_response(pendulum, loop)
    ticks, rest = loop.dead_ticks
    late = z ** -float(loop.delay + ticks)
    G = np.multiply.outer(late, x.G)
    if rest:
        G = G + np.multiply.outer(late / z, x.G_before)
    M = np.multiply.outer(z, np.eye(len(x.G))) - x.F
    X = np.linalg.solve(M, G[..., None])[..., 0]
    return X[:, 0], X @ x.row + x.through * late / z


@lru_cache(maxsize=16)
def on_circle(
    pendulum: Pendulum, loop: SampledLoop
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the open loop on the unit circle.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: The loop.

    Returns:
        Angles of z [rad], from 0.01 rad/s to half the sampling frequency, as many as a
        late loop needs to be followed around, and C and P of `open_loop` there.
    """
    count = 16 * (loop.delay + loop.dead_ticks[0] + 2)
    low = 0.01 * loop.period
    even = np.linspace(low, math.pi, count, endpoint=False)[1:]
    angles = np.sort(np.concatenate([np.geomspace(low, math.pi, 800), even]))
    z = np.exp(1j * angles)
    return angles, *open_loop(pendulum, loop, z)


Parameter: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""From z, C and P on the unit circle to what a number of the loop would have to be for
z to be a pole: a number that is not complex is one at which stability changes."""


def crossings(
    pendulum: Pendulum, loop: SampledLoop, parameter: Parameter
) -> list[tuple[float, float]]:
    """Return the frequencies at which poles can cross the unit circle.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: The loop.
        parameter: The number that is varied, solved for.

    Returns:
        Angle of z [rad], in (0, pi], and real value of the number, by angle.
    """
    # what happens once a tick is the caller's: all cut-offs share one response
    loop = loop if loop.analog_cutoff is not None else replace(loop, zmp_cutoff=None)
    angles, C, P = on_circle(pendulum, loop)

    def value(angles: np.ndarray) -> np.ndarray:
        z = np.exp(1j * angles)
        return parameter(z, *open_loop(pendulum, loop, z))

    with np.errstate(divide="ignore", invalid="ignore"):
        values = parameter(np.exp(1j * angles), C, P)
        signs = np.sign(values.imag[:-1])
        (i,) = np.nonzero(signs[:-1] * signs[1:] < 0.0)
        t = _zeros(lambda t: value(t).imag, angles[i], angles[i + 1], values.imag[i])
        t, at = np.append(t, math.pi), np.append(value(t), values[-1])
        real = np.abs(at.imag) < 1e-6 * np.abs(at)  # else it went through infinity
    return list(zip(t[real].tolist(), at.real[real].tolist(), strict=True))


def _zeros(
    f: Callable[[np.ndarray], np.ndarray], a: np.ndarray, b: np.ndarray, f_a: np.ndarray
) -> np.ndarray:
    """Return the zeros of f between a and b, of shape (n,), by the Illinois method."""
    f_b = f(b)
    for _ in range(40):
        c = b - f_b * (b - a) / (f_b - f_a)
        f_c = f(c)
        over = f_c * f_b < 0.0
        a, f_a = np.where(over, b, a), np.where(over, f_b, 0.5 * f_a)
        step, b, f_b = np.abs(c - b), c, f_c
        if not (step > 1e-13 * b).any():
            break
    return b


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

    low, high = _CUTOFFS
    if not is_stable(low):
        return 0.0
    if loop.analog_filter:
        return _highest_analog(is_stable)

    def coefficient(z: np.ndarray, C: np.ndarray, P: np.ndarray) -> np.ndarray:
        return (1.0 - z) * (1.0 + k_c * C) / (1.0 + k_c * C - k_p * P * z)

    least, most = (low_pass_coefficient(f_c, loop.period) for f_c in (low, high))
    found = [a for _, a in crossings(pendulum, loop, coefficient) if least < a < most]
    if not found:
        return math.inf
    return -math.log1p(-min(found)) / (2.0 * math.pi * loop.period)


_CUTOFFS = (0.02, 2000.0)  # between which the highest is sought [Hz]


def _highest_analog(is_stable: Callable[[float], bool]) -> float:
    """Return the highest stable cut-off by trying [Hz]; infinite if all are."""
    low = _CUTOFFS[0]
    for high in np.geomspace(*_CUTOFFS, 120).tolist():
        if not is_stable(high):
            break
        low = high
    else:
        return math.inf
    while high > 1.0001 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return low


def text_of_loop(loop: SampledLoop) -> str:
    """Return a loop in a few words.

    Args:
        loop: The loop.

    Returns:
        Period, lag, delay, filter, and what else it has.
    """
    cutoff, ticks = loop.zmp_cutoff, "tick" if loop.delay == 1 else "ticks"
    words = [
        f"{1e3 * loop.period:g} ms period",
        f"{1e3 * loop.servo_lag:.3g} ms lag",
        f"{loop.delay} {ticks} late",
        "no filter" if cutoff is None else f"{cutoff:.3g} Hz filter",
    ]
    if loop.dead_time:
        words.append(f"{1e3 * loop.dead_time:.3g} ms dead")
    if loop.mode_frequency is not None:
        words.append(f"ZMP swings at {loop.mode_frequency:.3g} Hz")
    return ", ".join(words)
