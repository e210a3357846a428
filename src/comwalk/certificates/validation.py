r"""Validation of a certificate against a run: its disturbance and what that implies.

The CoM error that a run shows is the answer of the loop to one disturbance eps, which
can be solved for. In the ideal loop, Eqs. (33) and (34),

.. math:: \epsilon = -\frac{k_p}{\omega_n^2} \ddot e_c - \dot e_c - (k_c - k_p) e_c

and in the loop as it runs

.. math:: \epsilon = -\dot e_c - v, \quad \tau \dot v = w - v, \quad
    w = k_c e_c - k_p F(e_c - \ddot e_c / \omega_n^2)

late by the delay, with F the ZMP filter. All that the model leaves out is in it:
servos, landings, pushes, bounds. Its size a and the size b of its rate imply bounds on
the errors, and no error may exceed them. What the ZMP does beyond its model is told
beside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from ..control import (
    Control,
    ControlSettings,
    Gains,
    low_pass_coefficient,
    servo_response,
)
from ..errors import ParameterError, RunError
from ..pattern import Pendulum
from ..runs import read_columns, read_summary
from .bounds import sampled_weights, sampled_worst_case
from .gain_check import sampled_loop_of
from .largest_errors import worst_case
from .sampled_loop import SampledLoop

BANDWIDTH = 10.0
"""Frequency up to which errors are looked at [Hz]: the loop is linear, so that what is
smoothed obeys the same bounds."""

_REACH = 5.0  # of the smoothing [standard deviations]
_NEEDED = ("t", "com", "com_ref", "zmp", "zmp_ref", "u", "heading_ref")


@dataclass(frozen=True)
class Compared:
    """An error's bound that a disturbance implies, and the error that was observed."""

    a: float
    """Largest |eps| [m/s]."""
    b: float
    """Largest rate of eps [m/s^2]."""
    com_bound: float
    """Largest CoM error that such an eps can cause [m]."""
    com: float
    """Largest CoM error observed [m]."""
    zmp_bound: float
    """Largest ZMP error that such an eps can cause [m]."""
    zmp: float
    """Largest ZMP error observed, of the model's ZMP c - c'' / omega_n^2 [m]."""

    @property
    def holds(self) -> bool:
        """Whether no error exceeds its bound, a thousandth for rounding."""
        close = 1.001
        return self.com <= close * self.com_bound and self.zmp <= close * self.zmp_bound


@dataclass(frozen=True)
class ObservedAxis:
    """Observed errors and disturbance of one axis."""

    axis: str
    """x or y, along the heading."""
    k_p: float
    """ZMP gain [1/s]."""
    k_c: float
    """CoM gain [1/s]."""
    a: float
    """Largest |c' - u|, the eps of Eq. (30) itself [m/s]."""
    b: float
    """Largest rate of it [m/s^2]."""
    ideal: Compared
    """By the ideal loop."""
    loop: Compared | None
    """By the loop as it runs; None if it has no bound."""
    sensed_zmp: float
    """Largest ZMP error by the sensors [m]."""
    zmp_gap: float
    """Largest difference of the sensed ZMP error from the model's [m]."""


def observe(
    columns: Mapping[str, np.ndarray],
    pendulum: Pendulum,
    gains: Gains,
    loop: SampledLoop,
) -> tuple[ObservedAxis, ObservedAxis]:
    """Observe both axes of a run, with the true CoM if it is known.

    Args:
        columns: Columns of the log.
        pendulum: Gives omega_n.
        gains: The gains; those of walking are looked at, whatever the robot did.
        loop: The loop as it runs, on rigid ground.

    Returns:
        Disturbance, bounds and errors in x and y.

    Raises:
        RunError: If a column is missing, or the run is too short.
        ParameterError: If the gains have no bounds.
    """
    missing = [name for name in _NEEDED if name not in columns]
    if missing or len(columns["t"]) < 10:
        lacks = ", ".join(missing) or "more than ten ticks"
        raise RunError(f"the run lacks {lacks}; take one of comwalk walk")
    com = columns["com_true" if "com_true" in columns else "com"][:, :2]
    heading = columns["heading_ref"]
    e_c = _along(columns["com_ref"][:, :2] - com, heading)
    e_p = _along(columns["zmp_ref"] - columns["zmp"], heading)
    drift = _along(np.gradient(com, loop.period, axis=0) - columns["u"], heading)
    found = []
    for k, (axis, k_p, k_c) in enumerate(zip("xy", *gains.walking, strict=True)):
        model = _Axis(pendulum, k_p, k_c, loop)
        found.append(_observed(axis, model, e_c[:, k], e_p[:, k], drift[:, k]))
    return found[0], found[1]


@dataclass(frozen=True)
class _Axis:
    """The loop of one axis."""

    pendulum: Pendulum
    k_p: float
    k_c: float
    loop: SampledLoop


def _along(values: np.ndarray, heading: np.ndarray) -> np.ndarray:
    c, s = np.cos(heading), np.sin(heading)
    x, y = values.T
    return np.stack([c * x + s * y, c * y - s * x], axis=1)


def _smooth(values: np.ndarray, dt: float) -> np.ndarray:
    return gaussian_filter1d(values, _width(dt), mode="nearest", truncate=_REACH)


def _width(dt: float) -> float:
    """Return the standard deviation of the smoothing [ticks]."""
    return math.sqrt(math.log(2.0)) / (2.0 * math.pi * BANDWIDTH * dt)


def _size(eps: np.ndarray, dt: float) -> tuple[float, float]:
    return float(np.abs(eps).max()), float(np.abs(np.diff(eps)).max() / dt)


def _observed(
    axis: str, x: _Axis, e_c: np.ndarray, e_p: np.ndarray, drift: np.ndarray
) -> ObservedAxis:
    """Observe one axis of a run."""
    dt = x.loop.period
    e_c, e_p, drift = (_smooth(values, dt) for values in (e_c, e_p, drift))
    rate = np.gradient(e_c, dt)
    model = e_c - np.gradient(rate, dt) / x.pendulum.omega**2
    # A run begins at rest, but may end in full motion, which cannot be smoothed.
    end = max(len(e_c) - math.ceil(_REACH * _width(dt)) - 3, 3)
    e_c, e_p, drift, rate, model = (y[:end] for y in (e_c, e_p, drift, rate, model))
    a, b = _size(drift, dt)
    return ObservedAxis(
        axis=axis,
        k_p=x.k_p,
        k_c=x.k_c,
        a=a,
        b=b,
        ideal=_ideal(x, e_c, rate, model),
        loop=_as_it_runs(x, e_c, rate, model),
        sensed_zmp=float(np.abs(e_p).max()),
        zmp_gap=float(np.abs(e_p - model).max()),
    )


def _ideal(x: _Axis, e_c: np.ndarray, rate: np.ndarray, e_p: np.ndarray) -> Compared:
    a, b = _size(x.k_p * e_p - rate - x.k_c * e_c, x.loop.period)
    gains = x.pendulum, x.k_p, x.k_c
    com, zmp = (worst_case(*gains, a, b, output).bound for output in ("com", "zmp"))
    return Compared(a, b, com, _largest(e_c), zmp, _largest(e_p))


def _as_it_runs(
    x: _Axis, e_c: np.ndarray, rate: np.ndarray, e_p: np.ndarray
) -> Compared | None:
    """Return bounds and errors of the sampled loop; None if it has no bound."""
    try:
        weights = sampled_weights(x.pendulum, x.k_p, x.k_c, x.loop)
    except ParameterError:
        return None
    dt, late = x.loop.period, int(x.loop.delay) + x.loop.dead_ticks[0]
    alpha = low_pass_coefficient(x.loop.zmp_cutoff, dt)
    w = x.k_c * e_c - x.k_p * _lagged(e_p, alpha)
    w = np.concatenate([np.full(late, w[0]), w])[: len(w)]
    decay, _ = servo_response(x.loop.servo_lag, dt)
    v = _lagged(np.concatenate([w[:1], w[:-1]]), 1.0 - decay)
    a, b = _size(-rate - v, dt)
    com, zmp = (sampled_worst_case(y, x.loop, a, b).bound for y in weights)
    return Compared(a, b, com, _largest(e_c), zmp, _largest(e_p))


def _lagged(values: np.ndarray, alpha: float) -> np.ndarray:
    first = np.array([(1.0 - alpha) * values[0]])
    return lfilter([alpha], [1.0, alpha - 1.0], values, zi=first)[0]


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max())


# ---- Saved runs -------------------------------------------------------------------


def observe_run(folder: str | Path) -> tuple[ObservedAxis, ObservedAxis]:
    """Observe both axes of a saved run.

    Args:
        folder: A folder that `comwalk walk` wrote.

    Returns:
        Disturbance, bounds and errors in x and y.

    Raises:
        RunError: If it is not such a run.
        ParameterError: If the gains have no bounds.
    """
    made = read_summary(folder)["settings"]
    try:
        control, pendulum = _control_of(made["control"]), Pendulum(**made["pendulum"])
    except (ValueError, KeyError, TypeError, AttributeError):
        raise RunError(
            f"{folder} is not a run of a walking controller: its summary.json does not "
            "tell control and pendulum"
        ) from None
    columns = read_columns(folder)
    return observe(columns, pendulum, control.gains, sampled_loop_of(control))


def _control_of(table: Mapping[str, Any]) -> Control:
    """Return the controller of a run, from its summary."""
    gains = {k: v and tuple(v) for k, v in table["gains"].items()}
    settings = dict(table["settings"])
    if settings["zmp_cutoff"] == "inf":
        settings["zmp_cutoff"] = None
    made = ControlSettings(**settings)
    return replace(Control(period=table["period"]), gains=Gains(**gains), settings=made)


def numbers_of_observed(axes: tuple[ObservedAxis, ObservedAxis]) -> dict[str, Any]:
    """Return an observation as plain numbers, units in their names.

    Args:
        axes: What `observe` returned.

    Returns:
        Numbers by axis, ready for JSON.
    """
    return {x.axis: _numbers(x) for x in axes}


def _numbers(x: ObservedAxis) -> dict[str, Any]:
    """Return the numbers of one axis."""
    return {
        "k_p": x.k_p,
        "k_c": x.k_c,
        "eps_m_s": x.a,
        "eps_rate_m_s2": x.b,
        "zmp_error_sensed_mm": 1e3 * x.sensed_zmp,
        "zmp_error_beyond_model_mm": 1e3 * x.zmp_gap,
        "ideal": _compared(x.ideal),
        "loop": None if x.loop is None else _compared(x.loop),
    }


def _compared(c: Compared) -> dict[str, Any]:
    """Return a comparison as plain numbers."""
    return {
        "holds": c.holds,
        "a_m_s": c.a,
        "b_m_s2": c.b,
        "com_error_mm": {"bound": 1e3 * c.com_bound, "observed": 1e3 * c.com},
        "zmp_error_mm": {"bound": 1e3 * c.zmp_bound, "observed": 1e3 * c.zmp},
    }


def lines_of_observed(x: ObservedAxis) -> list[str]:
    """Return the observation of one axis as lines of text.

    Args:
        x: What `observe` returned for the axis.

    Returns:
        Lines of text.
    """
    lines = [
        f"{x.axis}: c' = u + eps with |eps| <= {x.a:.3f} m/s, rate <= {x.b:.2f} m/s^2; "
        f"sensed ZMP error {1e3 * x.sensed_zmp:.1f} mm"
    ]
    for name, c in (("ideal loop", x.ideal), ("as it runs", x.loop)):
        if c is None:
            lines.append(f"   {name}: no bound")
            continue
        parts = (("CoM", c.com, c.com_bound), ("ZMP", c.zmp, c.zmp_bound))
        texts = [
            f"{what} error {1e3 * e:.1f} <= {1e3 * bound:.1f} mm ({e / bound:.0%})"
            for what, e, bound in parts
        ]
        verdict = "" if c.holds else "  EXCEEDED"
        lines.append(
            f"   {name}: eps <= {c.a:.3f} m/s, {c.b:.2f} m/s^2 allows "
            + ", ".join(texts)
            + verdict
        )
    return lines
