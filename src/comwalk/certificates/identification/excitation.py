r"""A short, safe experiment on a standing robot: sweeps and taps of the CoM.

Nothing is fed back. The commanded CoM goes through sums of sines that repeat (sweeps),
so that what differs from one to the next is noise, and then through short ramps (taps),
whose answer begins one dead time later. Both axes move at once: each has its own
frequencies, and its own signs of the taps. The sines are weighted so that all shake the
ZMP of the rigid pendulum alike,

.. math:: |c_u| \propto \frac{1}{1 + \omega^2 / \omega_n^2}
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...control import ControlOutput
from ...errors import ParameterError, checked_number
from ...pattern import (
    Foothold,
    FootstepPlan,
    Pattern,
    Pendulum,
    Reference,
    make_pattern,
    minimum_jerk,
)
from ...settings import check_settings, setting

LEAD_TIME = 1.0
"""Time of standing still before the first sweep, in which it is weighed [s]."""

_RAMP = 1.0  # time in which the sweeps grow to their size [s]
_TAP = 0.1  # time that a tap goes out; it goes back at a third of its speed [s]
_REST = 0.8  # time from one tap to the next [s]
_TAP_LAG = 0.02  # a servo this slow would shake the ZMP by the planned amount [s]
_SIGNS = ((1, 1, -1, -1), (1, -1, -1, 1))  # of the taps in x and y, repeated


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Excitation of a standing robot for its identification."""

    amplitude: float = setting(
        0.2,
        "How far the ZMP of a rigid robot would swing, as a share of the sole's half "
        "size",
        "",
        "[0.01, 0.6]",
    )
    sweeps: int = setting(
        4, "Number of sweeps that are measured, after one to get going", "", "[2, 100]"
    )
    sweep_time: float = setting(5.0, "Time of a sweep", "s", "[2, 60]")
    lowest: float = setting(
        0.4, "Lowest frequency, at least two cycles a sweep", "Hz", "(0, 2]"
    )
    highest: float = setting(
        16.0, "Highest frequency, at most a fifth of the control rate", "Hz", "(0, 100]"
    )
    lines: int = setting(24, "Number of frequencies of each axis", "", "[6, 200]")
    taps: int = setting(16, "Number of taps", "", "[4, 200]")

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)
        least = 2.0 / self.sweep_time
        checked_number("lowest", self.lowest, unit="Hz", low=least, high=2)
        least = 4.0 * self.lowest
        checked_number("highest", self.highest, unit="Hz", low=least, high=100)


@dataclass(frozen=True, eq=False)
class Excitation:
    """The path of the commanded CoM, with the places of its sweeps and taps."""

    path: np.ndarray
    """Commanded CoM from where it stands [m], at each tick, (n, 2)."""
    period: float
    """Control period [s]."""
    sweep_ticks: int
    """Ticks of one sweep."""
    sweeps: tuple[int, ...]
    """First tick of each sweep that is measured."""
    bins: tuple[np.ndarray, np.ndarray]
    """Cycles a sweep of each sine, for x and for y."""
    taps: tuple[int, ...]
    """Tick at which each tap begins."""
    signs: np.ndarray
    """Sign of each tap in x and y, (taps, 2)."""

    @property
    def duration(self) -> float:
        """Time of the whole experiment [s]."""
        return len(self.path) * self.period


def make_excitation(
    experiment: Experiment,
    pendulum: Pendulum,
    sole_size: tuple[float, float],
    period: float,
) -> Excitation:
    """Return the path of the commanded CoM of an experiment.

    Args:
        experiment: How the robot is shaken.
        pendulum: Gives omega_n, by which the sines are weighted.
        sole_size: Length and width of a sole [m], what the amplitude is a share of.
        period: Control period [s].

    Returns:
        The path.

    Raises:
        ParameterError: If the control rate is too low for the highest frequency.
    """
    if experiment.highest > 0.2 / period:
        raise ParameterError(
            f"experiment.highest = {experiment.highest:g} Hz needs a control period of "
            f"at most {200.0 / experiment.highest:.3g} ms, got {1e3 * period:g} ms; "
            f"take {0.2 / period:.3g} Hz or less"
        )
    swing = 0.5 * experiment.amplitude * np.array(sole_size)
    lead, n = round(LEAD_TIME / period), round(experiment.sweep_time / period)
    bins = _bins(experiment)
    sweep = np.stack(
        [
            size * _sweep(k, n, experiment.sweep_time, pendulum.omega)
            for k, size in zip(bins, swing.tolist(), strict=True)
        ],
        axis=1,
    )
    tail = sweep[: round(_RAMP / period)]
    sweeps = np.concatenate([*[sweep] * (experiment.sweeps + 1), tail])
    times = period * np.arange(len(sweeps))
    sweeps *= _envelope(times, times[-1])[:, None]
    signs = np.array([s * (experiment.taps // 4 + 1) for s in _SIGNS]).T
    signs = signs[: experiment.taps]
    speed = swing * _TAP_LAG * pendulum.omega**2
    rest = np.zeros((round(_REST / period), 2))
    taps = [rest, *(sign * speed * _tap(period)[:, None] for sign in signs)]
    begin = lead + len(sweeps) + len(rest)
    each = len(_tap(period))
    return Excitation(
        path=np.concatenate([np.zeros((lead, 2)), sweeps, *taps]),
        period=period,
        sweep_ticks=n,
        sweeps=tuple(lead + n * (k + 1) for k in range(experiment.sweeps)),
        bins=bins,
        taps=tuple(begin + k * each for k in range(len(signs))),
        signs=signs,
    )


def _bins(experiment: Experiment) -> tuple[np.ndarray, np.ndarray]:
    """Return the cycles a sweep of both axes: each one's own, evenly spaced in log."""
    P, n = experiment.sweep_time, 2 * experiment.lines
    low, high = math.ceil(P * experiment.lowest), math.floor(P * experiment.highest)
    wanted = np.geomspace(low, high, n).tolist()
    taken: list[int] = []
    for k, f in enumerate(wanted):  # dense at the low end: every whole number once
        last = taken[-1] if taken else low - 1
        taken.append(min(max(round(f), last + 1), high - (n - 1 - k)))
    if taken[0] < low:
        raise ParameterError(
            f"experiment.lines = {experiment.lines} do not fit between "
            f"{experiment.lowest:g} and {experiment.highest:g} Hz: sweeps of {P:g} s "
            "tell too few frequencies apart; take fewer lines or longer sweeps"
        )
    return np.array(taken[::2]), np.array(taken[1::2])


def _sweep(bins: np.ndarray, n: int, P: float, omega: float) -> np.ndarray:
    """Return one period of the path for a ZMP swing of 1 at most, (n,).

    The phases are those of a chirp (Schroeder), which keeps the peak low.
    """
    k = np.arange(len(bins))
    w = 2.0 * math.pi * bins / P
    phases = np.outer(np.arange(n) * (P / n), w) - math.pi * k * (k - 1) / len(bins)
    waves = np.cos(phases)
    peak = float(np.abs(waves.sum(axis=1)).max())
    return waves @ (1.0 / (1.0 + (w / omega) ** 2)) / peak


def _envelope(times: np.ndarray, end: float) -> np.ndarray:
    """Return a factor that grows from 0 to 1 at the start and falls to 0 at the end."""
    shares = np.clip(np.minimum(times, end - times) / _RAMP, 0.0, 1.0)
    return np.array([minimum_jerk(share)[0] for share in shares.tolist()])


def _tap(period: float) -> np.ndarray:
    t = period * np.arange(round(_REST / period))
    return np.maximum(0.0, np.minimum(t, (4.0 * _TAP - t) / 3.0))


class Shaker:
    """Commands the CoM of an experiment in place of the walking controller. Final."""

    def __init__(self, excitation: Excitation) -> None:
        """Start at the first tick.

        Args:
            excitation: The path.
        """
        self._path, self._period = excitation.path, excitation.period
        self._tick = 0

    def reset(
        self,
        reference_com: np.ndarray | Sequence[float],
        reference_zmp: np.ndarray | Sequence[float],
    ) -> None:
        """Go back to the first tick.

        Args:
            reference_com: Not used.
            reference_zmp: Not used.
        """
        self._tick = 0

    def step(
        self,
        reference: Reference,
        com: np.ndarray,
        zmp: np.ndarray,
        feedback_scale: float = 1.0,
    ) -> ControlOutput:
        """Return the command of one tick, whatever is measured.

        Args:
            reference: Where the robot stands.
            com: Not used.
            zmp: Measured ZMP [m], world, (2,), for the record.
            feedback_scale: Not used.

        Returns:
            The CoM velocity from now to the next tick, and where the CoM should be.
        """
        last = len(self._path) - 1
        now = self._path[min(self._tick, last)]
        after = self._path[min(self._tick + 1, last)]
        self._tick += 1
        rest = np.zeros(2)
        return ControlOutput(
            u=(after - now) / self._period,
            com_command=reference.com[:2] + now,
            com_error=rest,
            zmp_error=rest,
            zmp_reference=reference.zmp[:2],
            zmp_filtered=np.asarray(zmp),
            saturated=False,
        )


def standing_pattern(
    pendulum: Pendulum,
    half_width: float,
    sole_size: tuple[float, float],
    duration: float,
) -> Pattern:
    """Return the pattern of standing on both feet.

    Args:
        pendulum: The simplified model.
        half_width: Half of the distance between both feet [m].
        sole_size: Length and width of each sole [m].
        duration: For how long [s].

    Returns:
        The pattern.
    """
    plan = FootstepPlan(
        left=Foothold(0.0, half_width),
        right=Foothold(0.0, -half_width),
        stand_time=0.5 * duration,
        sole_size=sole_size,
    )
    return make_pattern(plan, pendulum)
