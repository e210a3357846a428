r"""Many robots of the simplified model at once, Eqs. (30)-(36), each disturbed alone.

Each robot runs the ideal loop of Theorem 1, or the sampled one by its exact response
over a period; only its largest errors are kept. The disturbance rises or falls at the
full rate b, turns at random, and stays within a: as bad as noise can be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import batch_kernel, kernel, parallel_range
from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .largest_errors import ramp_step
from .sampled_loop import SampledLoop, disturbance_response, loop_plant, tick_response

LANES = 64
"""Axes that one pass of the inner loop advances [-]."""

TURN_SHARE = 0.02
"""Share of the ticks at which a random disturbance turns [-]."""


class LargestErrors(NamedTuple):
    """The largest errors of each robot, in x and y."""

    com: np.ndarray
    """Largest |e_c| [m], shape (n, 2)."""

    zmp: np.ndarray
    """Largest |e_p| at a tick [m], shape (n, 2)."""


def monte_carlo(
    pendulum: Pendulum,
    k_p: np.ndarray | float,
    k_c: np.ndarray | float,
    *,
    a: float,
    b: float,
    duration: float = 20.0,
    dt: float = 0.002,
    loop: SampledLoop | None = None,
    robots: int | None = None,
    seed: int = 0,
) -> LargestErrors:
    """Return the largest errors of robots under random bounded disturbances.

    All begin at rest and on their reference.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gains [1/s], above 0: one number, (2,) for x and y, or (n, 2).
        k_c: CoM gains [1/s], 0 or above, as k_p.
        a: Bound on |eps| [m/s], 0 or above.
        b: Bound on the rate of eps [m/s^2], 0 or above.
        duration: How long each robot is disturbed [s], at least a tick.
        dt: Time of a tick of the ideal loop [s], above 0.
        loop: The loop as it is sampled; the ideal one if None.
        robots: How many robots, if the gains do not tell.
        seed: Of the random numbers: each robot and each axis has its own.

    Returns:
        Largest errors; those of an unstable loop grow until they are infinite.

    Raises:
        ParameterError: If a number or a shape is out of range.

    Example:
        >>> errors = monte_carlo(Pendulum(), 3.0, 6.6, a=0.05, b=0.5, robots=100)
        >>> bool(errors.zmp.max() < 0.0403)
        True
    """
    k_p, k_c = _gains(k_p, k_c, robots)
    dt = checked_number("dt", loop.period if loop else dt, low=0.0, open_low=True)
    a = checked_number("a", a, unit="m/s", low=0.0)
    b = checked_number("b", b, unit="m/s^2", low=0.0)
    ticks = round(checked_number("duration", duration, unit="s", low=dt) / dt)
    seeds = _padded(_seeds(seed, k_p.size))
    gains = _padded(k_p.ravel()), _padded(k_c.ravel())
    out = np.zeros((2, len(seeds)))
    noise = np.array([a, b * dt])
    turn = np.uint32(TURN_SHARE * 2**32)
    none = np.zeros(0)
    if loop is None:
        ideal_errors(
            _coefficients(pendulum, *gains, dt), seeds, noise, turn, ticks, none, out
        )
    else:
        system = _System.of(pendulum, loop)
        sampled_errors(*system, *gains, seeds, noise, turn, ticks, none, out)
    return _errors(out, k_p)


def errors_under(
    pendulum: Pendulum,
    k_p: np.ndarray | float,
    k_c: np.ndarray | float,
    disturbance: np.ndarray,
    *,
    dt: float = 0.002,
    loop: SampledLoop | None = None,
    robots: int | None = None,
) -> LargestErrors:
    """Return the largest errors of many robots under one disturbance.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gains [1/s], as in `monte_carlo`.
        k_c: CoM gains [1/s].
        disturbance: eps [m/s] at the ticks, for both axes, linear between; (ticks,).
        dt: Time of a tick of the ideal loop [s], above 0.
        loop: The loop as it is sampled, the ideal one if None. Its last error is that
            of the last tick but one, whose rate of eps is the last that is known.
        robots: How many robots, if the gains do not tell.

    Returns:
        Largest errors.

    Raises:
        ParameterError: If a number or a shape is out of range.
    """
    k_p, k_c = _gains(k_p, k_c, robots)
    dt = checked_number("dt", loop.period if loop else dt, low=0.0, open_low=True)
    eps = np.ascontiguousarray(disturbance, dtype=float)
    if eps.ndim != 1 or len(eps) < 3 or not np.isfinite(eps).all():
        raise ParameterError("disturbance must be at least 3 finite numbers (ticks,)")
    gains = _padded(k_p.ravel()), _padded(k_c.ravel())
    seeds = np.ones(len(gains[0]), np.uint32)
    out, noise, turn = np.zeros((2, len(seeds))), np.zeros(2), np.uint32(0)
    if loop is None:
        given = _coefficients(pendulum, *gains, dt)
        ideal_errors(given, seeds, noise, turn, len(eps) - 1, eps, out)
    else:
        system = _System.of(pendulum, loop)
        sampled_errors(*system, *gains, seeds, noise, turn, len(eps) - 2, eps, out)
    return _errors(out, k_p)


def _gains(
    k_p: np.ndarray | float, k_c: np.ndarray | float, robots: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return gains as two arrays (n, 2)."""
    try:
        shape = np.broadcast_shapes(np.shape(k_p), np.shape(k_c), (robots or 1, 2))
    except ValueError:
        shape = ()
    if len(shape) != 2 or shape[1] != 2:
        raise ParameterError(
            "k_p and k_c must be one number, (2,) for x and y, or (n, 2) for n robots, "
            f"got the shapes {np.shape(k_p)} and {np.shape(k_c)} for {robots} robots"
        )
    found = [np.ascontiguousarray(np.broadcast_to(k, shape), float) for k in (k_p, k_c)]
    if not (
        np.isfinite(found).all() and (found[0] > 0.0).all() and found[1].min() >= 0.0
    ):
        raise ParameterError("k_p must be above 0 and k_c 0 or above [1/s], all finite")
    return found[0], found[1]


def _seeds(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(1, 2**32, count, dtype=np.uint32)


def _padded(values: np.ndarray) -> np.ndarray:
    return np.pad(values, (0, -len(values) % LANES), mode="edge")


def _errors(out: np.ndarray, k_p: np.ndarray) -> LargestErrors:
    com, zmp = out[:, : k_p.size].reshape(2, *k_p.shape)
    return LargestErrors(com, zmp)


def _coefficients(
    pendulum: Pendulum, k_p: np.ndarray, k_c: np.ndarray, dt: float
) -> np.ndarray:
    """Return F, G_0, G_1 of `largest_errors.ramp_step` and the row of e_p, (10, n)."""
    pairs, which = np.unique(k_p + 1j * k_c, return_inverse=True)
    table = np.empty((10, len(pairs)))
    for i, (p, c) in enumerate(zip(pairs.real, pairs.imag, strict=True)):
        F, G_0, G_1 = ramp_step(pendulum, p, c, dt)
        table[:, i] = (*F.ravel(), *G_0, *G_1, c / p, 1.0 / p)
    return np.ascontiguousarray(table[:, which.ravel()])


class _System(NamedTuple):
    """A sampled loop without its gains, for the kernel."""

    F: np.ndarray  # of the state over a tick, (n, n)
    G: np.ndarray  # of the acting command and the one before it, (n, 2)
    E: np.ndarray  # of eps and its rate, (n, 2)
    row: np.ndarray  # of the state in the ZMP, then of the command, and of the rate
    sensed: np.ndarray  # alpha of the filter, 1 if it is digital, and dt
    delay: int

    @classmethod
    def of(cls, pendulum: Pendulum, loop: SampledLoop) -> _System:
        x, (tick, alpha) = loop_plant(pendulum, loop), tick_response(pendulum, loop)
        digital = float(loop.analog_cutoff is None)
        return cls(
            np.ascontiguousarray(tick.F),
            np.stack([tick.G, tick.G_before], axis=1),
            disturbance_response(pendulum, loop),
            np.array([*x.row, x.through, x.through_rate]),
            np.array([alpha, digital, loop.period]),
            int(loop.delay) + loop.dead_ticks[0],
        )


# The disturbance.


@kernel
def next_random(state: np.uint32) -> np.uint32:
    """Return the next state of the random numbers (xorshift, 32 bits)."""
    state = np.uint32(state ^ np.uint32(state << np.uint32(13)))
    state = np.uint32(state ^ np.uint32(state >> np.uint32(17)))
    return np.uint32(state ^ np.uint32(state << np.uint32(5)))


@kernel
def larger(x: float, y: float) -> float:
    """Return y if it is larger, else x: no branch, and no NaN that comes after x."""
    return y if y > x else x


@kernel
def held(x: float, bound: float) -> float:
    """Return x within +-bound."""
    x = bound if x > bound else x
    return -bound if x < -bound else x


@kernel
def fill_noise(
    eps: np.ndarray, state: np.uint32, bound: float, rise: float, turn: np.uint32
) -> None:
    """Fill a random disturbance that starts at 0, as the batches make it."""
    slope = rise
    for k in range(len(eps) - 1):
        state = next_random(state)
        slope = -slope if state < turn else slope
        eps[k + 1] = held(eps[k] + slope, bound)


# The batches. `w` is a row of lanes per quantity: the state (5) and in the sampled loop
# the next one (5); the slope of eps; eps now, next, and after it; the largest |e_c| and
# |e_p|; then F, G_0, G_1 and the row of e_p (10), or gains, commands and the past.

_SLOPE, _EPS, _NEXT, _AFTER = (k * LANES for k in (10, 11, 12, 13))
_COM, _ZMP, _GIVEN = (k * LANES for k in (14, 15, 16))
_K_P, _K_C, _U, _PAST = 16 * LANES, 17 * LANES, 18 * LANES, 20


@batch_kernel
def ideal_errors(
    coefficients: np.ndarray,
    seeds: np.ndarray,
    noise: np.ndarray,
    turn: np.uint32,
    ticks: int,
    given: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run the ideal loop of each lane and keep its largest errors.

    Args:
        coefficients: (10, lanes): F by rows, G_0, G_1, the row of e_p without eps.
        seeds: States of the random numbers, (lanes,).
        noise: Bound on eps [m/s], and its rise per tick [m/s].
        turn: A random number below it turns the disturbance.
        ticks: How many.
        given: eps for all lanes, (ticks + 1,); of length 0 for random ones.
        out: Largest |e_c| and |e_p| [m], (2, lanes).
    """
    for group in parallel_range(coefficients.shape[1] // LANES):
        ideal_group(group, coefficients, seeds, noise, turn, ticks, given, out)


@kernel
def ideal_group(
    group: int,
    coefficients: np.ndarray,
    seeds: np.ndarray,
    noise: np.ndarray,
    turn: np.uint32,
    ticks: int,
    given: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run one group of lanes; the arguments are those of `ideal_errors`."""
    L, first = LANES, group * LANES
    w, s = np.zeros(26 * L), np.empty(L, np.uint32)
    for j in range(L):
        s[j], w[_SLOPE + j] = seeds[first + j], noise[1]
        w[_NEXT + j] = given[0] if len(given) else 0.0
        w[_ZMP + j] = abs(w[_NEXT + j] * coefficients[9, first + j])
        for i in range(10):
            w[_GIVEN + i * L + j] = coefficients[i, first + j]
    for k in range(ticks):
        advance_noise(w, s, noise[0], turn, given, k + 1)
        respond_ideally(w)
    for j in range(L):
        out[0, first + j], out[1, first + j] = w[_COM + j], w[_ZMP + j]


@kernel
def respond_ideally(w: np.ndarray) -> None:
    """Advance the ideal loop of all lanes by a tick, and keep the errors."""
    L, m = LANES, _GIVEN
    for j in range(L):
        c, v, e_0, e_1 = w[j], w[L + j], w[_NEXT + j], w[_AFTER + j]
        c_1 = w[m + j] * c + w[m + L + j] * v
        c_1 += w[m + 4 * L + j] * e_0 + w[m + 6 * L + j] * e_1
        v_1 = w[m + 2 * L + j] * c + w[m + 3 * L + j] * v
        v_1 += w[m + 5 * L + j] * e_0 + w[m + 7 * L + j] * e_1
        p_1 = w[m + 8 * L + j] * c_1 + w[m + 9 * L + j] * (v_1 + e_1)
        w[j], w[L + j], w[_NEXT + j] = c_1, v_1, e_1
        w[_COM + j] = larger(w[_COM + j], abs(c_1))
        w[_ZMP + j] = larger(w[_ZMP + j], abs(p_1))


@kernel
def advance_noise(
    w: np.ndarray,
    s: np.ndarray,
    bound: float,
    turn: np.uint32,
    given: np.ndarray,
    k: int,
) -> None:
    """Write eps of tick k, which follows the next one.

    Args:
        w: Lanes.
        s: States of the random numbers.
        bound: Bound on eps [m/s].
        turn: A random number below it turns the disturbance.
        given: eps of all ticks for all lanes, or nothing.
        k: The tick.
    """
    if len(given):
        for j in range(LANES):
            w[_AFTER + j] = given[k]
        return
    for j in range(LANES):
        x = next_random(s[j])
        s[j] = x
        slope = w[_SLOPE + j]
        slope = -slope if x < turn else slope
        w[_SLOPE + j] = slope
        w[_AFTER + j] = held(w[_NEXT + j] + slope, bound)


@batch_kernel
def sampled_errors(
    F: np.ndarray,
    G: np.ndarray,
    E: np.ndarray,
    row: np.ndarray,
    sensed: np.ndarray,
    delay: int,
    k_p: np.ndarray,
    k_c: np.ndarray,
    seeds: np.ndarray,
    noise: np.ndarray,
    turn: np.uint32,
    ticks: int,
    given: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run the sampled loop of each lane and keep its largest errors.

    Args:
        F: Response of the state (c, v, f, ...) over a tick, (n, n).
        G: Of the acting command and the one before it, (n, 2).
        E: Of eps and its rate, (n, 2).
        row: The ZMP by the state, the acting command and the rate, (n + 2,).
        sensed: Coefficient of the filter, 1 if it is digital, and the period [s].
        delay: Delay of the law [ticks].
        k_p: ZMP gains [1/s], (lanes,).
        k_c: CoM gains [1/s], (lanes,).
        seeds: States of the random numbers, (lanes,).
        noise: Bound on eps [m/s], and its rise per tick [m/s].
        turn: A random number below it turns the disturbance.
        ticks: How many.
        given: eps for all lanes, (ticks + 2,); of length 0 for random ones.
        out: Largest |e_c| and |e_p| [m], (2, lanes).
    """
    for group in parallel_range(len(k_p) // LANES):
        system = F, G, E, row, sensed, delay
        gains = k_p, k_c
        sampled_group(group, system, gains, seeds, noise, turn, ticks, given, out)


@kernel
def sampled_group(
    group: int,
    system: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, int],
    gains: tuple[np.ndarray, np.ndarray],
    seeds: np.ndarray,
    noise: np.ndarray,
    turn: np.uint32,
    ticks: int,
    given: np.ndarray,
    out: np.ndarray,
) -> None:
    """Run one group of lanes; the arguments are those of `sampled_errors`."""
    F, G, E, row, sensed, delay = system
    k_p, k_c = gains
    L, n, ring, first = LANES, len(F), delay + 2, group * LANES
    w, s = np.zeros((_PAST + 2 * ring) * L), np.empty(L, np.uint32)
    for j in range(L):
        s[j], w[_SLOPE + j] = seeds[first + j], noise[1]
        w[_K_P + j], w[_K_C + j] = k_p[first + j], k_c[first + j]
        w[_NEXT + j] = given[0] if len(given) else 0.0
    for k in range(ticks + 1):
        advance_noise(w, s, noise[0], turn, given, k + 1)
        for j in range(2 * L):
            w[_EPS + j] = w[_NEXT + j]
        sense(w, 5 * L if k else 0, n, row, sensed)
        if k < ticks:
            act(w, k, delay)
            respond(w, F, G, E, sensed[2])
    for j in range(L):
        out[0, first + j], out[1, first + j] = w[_COM + j], w[_ZMP + j]


@kernel
def act(w: np.ndarray, k: int, delay: int) -> None:
    """Remember c and f of tick k, and write the command that acts, and the one before.

    Args:
        w: Lanes.
        k: The tick.
        delay: Delay of the law [ticks].
    """
    L, ring = LANES, delay + 2
    now = (_PAST + 2 * (k % ring)) * L
    for j in range(L):
        w[now + j], w[now + L + j] = w[j], w[2 * L + j]
    for late in range(2):
        seen = (_PAST + 2 * ((k - delay - late) % ring)) * L
        to = _U + late * L
        for j in range(L):
            w[to + j] = w[_K_P + j] * w[seen + L + j] - w[_K_C + j] * w[seen + j]


@kernel
def respond(
    w: np.ndarray, F: np.ndarray, G: np.ndarray, E: np.ndarray, dt: float
) -> None:
    """Write the next state of all lanes, before a digital filter."""
    L, rate = LANES, 1.0 / dt
    for i in range(len(F)):
        to, g, g_before = (5 + i) * L, G[i, 0], G[i, 1]
        eps, slope = E[i, 0] - E[i, 1] * rate, E[i, 1] * rate
        for j in range(L):
            w[to + j] = g * w[_U + j] + g_before * w[_U + L + j]
            w[to + j] += eps * w[_EPS + j] + slope * w[_NEXT + j]
        for m in range(len(F)):
            f, at = F[i, m], m * L
            for j in range(L):
                w[to + j] += f * w[at + j]


@kernel
def sense(
    w: np.ndarray, state: int, n: int, row: np.ndarray, sensed: np.ndarray
) -> None:
    """Filter the ZMP of a state, keep the errors, and make it the state of now.

    Args:
        w: Lanes.
        state: Where the state is.
        n: Numbers of a state.
        row: The ZMP by the state, the acting command and the rate, (n + 2,).
        sensed: Coefficient of the filter, 1 if it is digital, and the period [s].
    """
    L, p = LANES, _U + LANES
    rate, through = row[n + 1] / sensed[2], row[n]
    for j in range(L):
        w[p + j] = through * w[_U + j] + rate * (w[_NEXT + j] - w[_EPS + j])
    for i in range(n):
        share, at = row[i], state + i * L
        for j in range(L):
            w[p + j] += share * w[at + j]
    if sensed[1] > 0.0:
        for j in range(L):
            f = w[2 * L + j]
            w[state + 2 * L + j] = f + sensed[0] * (w[p + j] - f)
    for i in range(n):
        for j in range(L):
            w[i * L + j] = w[state + i * L + j]
    for j in range(L):
        w[_COM + j] = larger(w[_COM + j], abs(w[j]))
        w[_ZMP + j] = larger(w[_ZMP + j], abs(w[p + j]))
