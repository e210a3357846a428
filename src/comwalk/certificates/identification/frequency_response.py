r"""Frequency responses of CoM and ZMP to the commanded CoM, fitted by one model.

.. math:: \frac{c}{c_u} = e^{-sT} \frac{g + b_1 s + \ldots}{1 + a_1 s + \ldots}, \quad
    \frac{p}{c_u} = e^{-s(T + dt/2)} \frac{g + p_1 s + \ldots}{1 + a_1 s + \ldots}

c_u is the integral of the commanded CoM velocity u. Both share the static gain g, the
dead time T and the poles: at rest the ZMP is under the CoM. A servo of time constant
tau is a_1 = tau; compliance adds pairs of poles. The ZMP is half a period older, since
forces are averaged over it, and u is held over it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.optimize

_ROUNDS = 12  # of the linear fit, each weighted by the poles of the last
_TRIES = 80  # of the fit that follows
_ENOUGH = 0.2  # misfit at which a larger model has nothing left to explain [-]
_MODEL_ERROR = 0.005  # share of a response up to which the model is believed [-]
_SCALE = 20.0  # frequency that makes the coefficients comparable [rad/s]
_MOST_DAMPED = 0.7  # damping ratio up to which a pair of poles is a mode [-]


class Estimate(NamedTuple):
    """A number with its standard deviation."""

    value: float
    """The number."""
    deviation: float
    """Its standard deviation, of the same unit."""


class Orders(NamedTuple):
    """Size of a model: degrees of its polynomials."""

    poles: int
    """Of the common denominator."""
    com: int
    """Of the numerator of the CoM."""
    zmp: int
    """Of the numerator of the ZMP."""


MODELS = (
    Orders(1, 0, 2),
    Orders(2, 1, 3),
    Orders(3, 2, 3),
    Orders(4, 3, 4),
    Orders(4, 4, 4),
    Orders(6, 6, 6),
)
"""Models that are tried: a servo's lag, one mode, a mode and a lag, more modes."""


@dataclass(frozen=True, eq=False)
class Responses:
    """Measured frequency responses of one axis."""

    frequencies: np.ndarray
    """Frequencies [Hz], (n,)."""
    values: np.ndarray
    """Response of the CoM, then of the ZMP, to the commanded CoM [-], complex, (2, n).
    """
    deviations: np.ndarray
    """Standard deviations of both [-], (2, n)."""


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A model of both responses of one axis, and what it says."""

    orders: Orders
    """Size of the model."""
    dead_time: float
    """T [s]."""
    period: float
    """Control period dt [s]."""
    coefficients: np.ndarray
    """g, the higher coefficients of CoM and ZMP, of s / (20 rad/s), the logarithms of
    the denominator's sections, and what the fit adds to T [periods]."""
    highest: float
    """Highest frequency that was measured [Hz]."""
    misfit: float
    """Root mean square of the residual over its expected size [-]."""
    gain: Estimate
    """Static gain g [-]: how far the CoM goes of what it is told."""
    lag: Estimate
    """Lag of the CoM behind its command at low frequency, beyond T [s]."""
    omega: Estimate
    """Natural frequency of the pendulum that CoM and ZMP show [rad/s]."""
    frequency: Estimate | None
    """Natural frequency of the compliance mode [Hz]; None without one."""
    damping: Estimate | None
    """Its damping ratio [-]; None without one."""

    def at(self, frequencies: np.ndarray) -> np.ndarray:
        """Return the model's responses.

        Args:
            frequencies: Frequencies [Hz], (n,).

        Returns:
            Response of the CoM and of the ZMP [-], complex, (2, n).
        """
        s = 2j * np.pi * np.asarray(frequencies)
        return _evaluate(self.coefficients, self.orders, s, self.dead_time, self.period)


def _split(
    theta: np.ndarray, orders: Orders
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return both numerators and the denominator, lowest power first.

    The denominator is a product of sections 1 + a s + b s^2 with positive a and b, of
    which theta has the logarithms: whatever the numbers, the model is stable.
    """
    n, m = orders.com, orders.zmp
    g, com, zmp = theta[:1], theta[1 : n + 1], theta[n + 1 : n + m + 1]
    poles = np.ones(1)
    sections = np.exp(np.clip(theta[n + m + 1 : n + m + 1 + orders.poles], -30, 30))
    for k in range(0, orders.poles, 2):
        poles = np.convolve(poles, np.concatenate([[1.0], sections[k : k + 2]]))
    return np.concatenate([g, com]), np.concatenate([g, zmp]), poles


def _sections(roots: np.ndarray) -> np.ndarray:
    """Return the logarithms of sections that have these poles, made stable."""
    stable = np.array([-abs(q.real) - 1e-3 * abs(q) + 1j * q.imag for q in roots])
    pairs = [q for q in stable if q.imag > 1e-9 * abs(q)]
    alone = sorted(q.real for q in stable if abs(q.imag) <= 1e-9 * abs(q))
    logs = [(-2.0 * q.real / abs(q) ** 2, abs(q) ** -2) for q in pairs]
    logs += [
        (-1.0 / p - 1.0 / q, 1.0 / (p * q))
        for p, q in zip(alone[::2], alone[1::2], strict=False)
    ]
    last = [(-1.0 / alone[-1],)] if len(alone) % 2 else []
    return np.log(np.concatenate([*logs, *last]))


def _evaluate(
    theta: np.ndarray, orders: Orders, s: np.ndarray, T: float, dt: float
) -> np.ndarray:
    """Return the responses of a model, (2, n)."""
    com, zmp, poles = (np.polyval(k[::-1], s / _SCALE) for k in _split(theta, orders))
    late = T + theta[-1] * dt
    return (
        np.stack([com * np.exp(-s * late), zmp * np.exp(-s * (late + dt / 2))]) / poles
    )


def _linear_fit(
    data: Responses, weights: np.ndarray, orders: Orders, T: float, dt: float
) -> np.ndarray:
    """Return coefficients by linear fits weighted with the poles of the last one."""
    s = 2j * np.pi * data.frequencies
    E = np.exp(-s * np.array([[T], [T + dt / 2.0]]))
    powers = (s / _SCALE)[:, None] ** np.arange(max(orders) + 1)
    numerators = 1 + orders.com + orders.zmp
    poles, x = np.ones(len(s), complex), np.zeros(numerators + orders.poles)
    for _ in range(_ROUNDS):
        rows, right = [], []
        for k, m in enumerate((orders.com, orders.zmp)):
            w = weights[k] / np.abs(poles)
            own, other = E[k][:, None] * powers[:, 1 : m + 1], orders[2 - k]
            none = np.zeros((len(s), other))
            parts = [own, none] if k == 0 else [none, own]
            den = -data.values[k][:, None] * powers[:, 1 : orders.poles + 1]
            rows.append(w[:, None] * np.hstack([E[k][:, None], *parts, den]))
            right.append(w * data.values[k])
        A, y = np.vstack(rows), np.concatenate(right)
        x = np.linalg.lstsq(
            np.vstack([A.real, A.imag]), np.concatenate([y.real, y.imag]), rcond=None
        )[0]
        poles = powers[:, : orders.poles + 1] @ np.append(1.0, x[numerators:])
    roots = np.roots(np.append(x[numerators:][::-1], 1.0)).astype(complex)
    return np.concatenate([x[:numerators], _sections(roots), [0.0]])


def _mode(theta: np.ndarray, orders: Orders, highest: float) -> complex | None:
    """Return the pole that shakes the CoM most, above the real axis; None without.

    A pole counts by its residue over its damping: the height of its own resonance.
    Those beyond the measured frequencies are guesses.
    """
    com, _, poles = _split(theta, orders)
    slope = np.polyder(poles[::-1])
    pairs = [q for q in np.roots(poles[::-1]).tolist() if q.imag > 1e-3 * abs(q)]
    most, top = _MOST_DAMPED, math.tau * highest / _SCALE
    pairs = [q for q in pairs if -q.real < most * abs(q) and abs(q) < top]

    def height(q: complex) -> float:
        residue = np.polyval(com[::-1], q) / np.polyval(slope, q)
        return abs(residue) / max(-q.real, 1e-3 * abs(q))

    mode = max(pairs, key=height, default=None)
    return None if mode is None else mode * _SCALE


def _figures(
    theta: np.ndarray, orders: Orders, dt: float, highest: float
) -> np.ndarray:
    """Return g, lag [s], omega [rad/s], mode frequency [Hz] and damping; nan without.

    p / c = 1 + r_1 s + r_2 s^2 + ..., and r_2 = -1 / omega^2.
    """
    com, zmp, poles = (np.append(k, [0.0, 0.0]) for k in _split(theta, orders))
    g, r_1 = com[0], (zmp[1] - com[1]) / com[0]
    r_2 = (zmp[2] - com[2] - com[1] * r_1) / g
    omega = _SCALE / math.sqrt(-r_2) if r_2 < 0.0 else math.nan
    lag = (poles[1] - com[1] / g) / _SCALE + theta[-1] * dt
    mode = _mode(theta, orders, highest)
    if mode is None:
        return np.array([g, lag, omega, math.nan, math.nan])
    return np.array([g, lag, omega, abs(mode) / math.tau, -mode.real / abs(mode)])


def _estimates(
    theta: np.ndarray, C: np.ndarray, orders: Orders, dt: float, highest: float
) -> list[Estimate]:
    """Return the figures, with deviations from the covariance C of theta."""
    columns = []
    for j, width in enumerate(np.sqrt(np.abs(np.diag(C)))):
        step = np.zeros_like(theta)
        step[j] = min(max(1e-3 * width, 1e-9), 1e-3)
        more, less = (_figures(theta + x, orders, dt, highest) for x in (step, -step))
        columns.append((more - less) / (2.0 * step[j]))
    J = np.stack(columns, axis=1)
    variances = np.maximum(np.einsum("ij,jk,ik->i", J, C, J), 0.0)
    values = _figures(theta, orders, dt, highest).tolist()
    pairs = zip(values, np.sqrt(variances).tolist(), strict=True)
    return [Estimate(x, d) for x, d in pairs]


def fit_model(
    data: Responses, orders: Orders, dead_time: Estimate, period: float
) -> ResponseFit | None:
    """Return the model of one size that fits best, least squares.

    At low frequency CoM and ZMP lag alike: that their lags differ by half a period is
    held for one standard deviation.

    Args:
        data: The measured responses.
        orders: Size of the model.
        dead_time: T [s]; the fit may change it by as much as its deviation.
        period: Control period [s].

    Returns:
        The fit; its deviations are the Cramer-Rao bounds of the measured ones, widened
        where the residual is larger. None if it has no start to improve.
    """
    believed = _MODEL_ERROR * np.abs(data.values)
    weights = 1.0 / np.hypot(data.deviations, believed)
    s, T = 2j * np.pi * data.frequencies, dead_time.value

    def residual(theta: np.ndarray) -> np.ndarray:
        model = _evaluate(theta, orders, s, T, period)
        r = (weights * (model - data.values)).ravel()
        com, zmp, _ = _split(theta, orders)
        first = (zmp[1] - com[1] if orders.com else zmp[1]) / com[0] / _SCALE
        known = [theta[-1] * period / dead_time.deviation, 2.0 * first / period]
        return np.concatenate([r.real, r.imag, known])

    first = _linear_fit(data, weights, orders, T, period)
    if not (np.isfinite(first).all() and np.isfinite(residual(first)).all()):
        return None
    options: dict[str, Any] = {"method": "lm", "x_scale": "jac", "max_nfev": _TRIES}
    found = scipy.optimize.least_squares(residual, first, ftol=1e-6, **options)
    free = len(found.fun) - len(found.x)
    misfit, highest = 2.0 * found.cost / free, float(data.frequencies.max())
    C = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True) * max(misfit, 1.0)
    gain, lag, omega, *mode = _estimates(found.x, C, orders, period, highest)
    frequency, damping = mode if math.isfinite(mode[0].value) else (None, None)
    return ResponseFit(
        orders=orders,
        dead_time=T,
        period=period,
        coefficients=found.x,
        highest=highest,
        misfit=math.sqrt(misfit),
        gain=gain,
        lag=lag,
        omega=omega,
        frequency=frequency,
        damping=damping,
    )


def fit_responses(
    data: Responses,
    dead_time: Estimate,
    period: float,
    models: Sequence[Orders] = MODELS,
) -> ResponseFit:
    """Return the smallest model that explains both responses.

    Larger models must earn their coefficients (Bayesian information criterion).

    Args:
        data: The measured responses.
        dead_time: T [s]; the fit may change it by as much as its deviation.
        period: Control period [s].
        models: Sizes to try.

    Returns:
        The fit.
    """
    n, fits = 4 * len(data.frequencies), []
    for orders in models:
        if (fit := fit_model(data, orders, dead_time, period)) is not None:
            fits.append(fit)
            if fit.misfit < _ENOUGH:
                break

    def cost(fit: ResponseFit) -> float:
        k = len(fit.coefficients)
        return fit.misfit**2 * (n - k) + k * math.log(n)

    return min(fits, key=cost)


def onset(times: np.ndarray, responses: np.ndarray) -> Estimate:
    """Return the onset of repeated responses to a step.

    Before it there is noise alone, after it a curve of second degree; the time between
    at which both explain the mean best is the onset (a change point, least squares).

    Args:
        times: Times of the samples after the step [s], evenly spaced, some before 0,
            (n,).
        responses: Responses, of one sign, with zero mean before the step,
            (repetitions, n).

    Returns:
        Time of the first sample that answers [s]; its deviation is no less than that
        of a clock of one sample.
    """
    mean = responses.mean(axis=0)
    count = len(responses)
    noise = float(responses[:, times < 0.0].std()) / math.sqrt(count)
    noise = max(noise, 1e-3 * float(np.abs(mean).max()), 1e-12)
    first = int(np.searchsorted(times, 0.0, side="right"))
    starts = np.arange(first, len(times) - 4)
    costs = np.array([_broken_curve_cost(times, mean, k) for k in starts]) / noise**2
    best = int(np.argmin(costs))
    near = np.exp(-0.5 * (costs - costs[best]))
    spread = math.sqrt(
        float(near @ (times[starts] - times[starts[best]]) ** 2 / near.sum())
    )
    step = float(times[1] - times[0])
    return Estimate(float(times[starts[best]]), max(spread, step / math.sqrt(12.0)))


def _broken_curve_cost(times: np.ndarray, mean: np.ndarray, k: int) -> float:
    x = times[k:] - times[k]
    A = np.stack([np.ones_like(x), x, x**2], axis=1)
    fitted = A @ np.linalg.lstsq(A, mean[k:], rcond=None)[0]
    return float(np.sum(mean[:k] ** 2) + np.sum((mean[k:] - fitted) ** 2))
