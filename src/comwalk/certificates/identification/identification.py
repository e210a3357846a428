"""System identification of a robot's loop, by exciting the standing robot.

`identify` works on any `Plant`: it needs neither a simulator nor a data sheet.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...control import Body, Plant, Tick, Watch, walk
from ...errors import RunError
from ...pattern import Pattern, polygon_margin
from .excitation import Excitation, Experiment, Shaker, make_excitation
from .frequency_response import Estimate, ResponseFit, Responses, fit_responses, onset

_LOOK_BACK = 0.1  # time before a tap that tells where the ZMP was [s]
_LOOK_AHEAD = 0.3  # time after a tap in which an answer must begin [s]
_CURVE = 0.03  # time of the answer that is looked at [s]
_FEWEST = 8  # least number of its samples
_CLEAR = 6.0  # noise deviations at which an answer is certain
_ENOUGH = 0.15  # share of the largest answer at which it is certain
_NEIGHBOURS = 3  # frequencies on each side that the noise is averaged over
_LEAST_MARGIN = 0.1  # of the ZMP to the edge, as a share of the sole's half width


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of what the sensors read, from one sweep to the next."""

    encoders: float
    """Joint encoders [rad]."""
    force: float
    """Ankle sensors, forces [N]."""
    torque: float
    """Ankle sensors, torques [N m]."""
    tilt: float
    """Tilt of the IMU [rad]."""
    com: tuple[float, float]
    """Measured CoM in x and y [m]."""
    zmp: tuple[float, float]
    """Measured ZMP in x and y [m]."""


@dataclass(frozen=True, eq=False)
class Identified:
    """The identified loop of a robot."""

    period: float
    """Control period [s]."""
    duration: float
    """Time of the experiment [s]."""
    dead_time: Estimate
    """Time from a command until the sensors show it, beyond one period [s]."""
    axes: tuple[ResponseFit, ResponseFit]
    """Responses in x and y."""
    measured: tuple[Responses, Responses]
    """What they were fitted to."""
    noise: SensorNoise
    """Noise of the sensors."""

    @property
    def delay(self) -> int:
        """The dead time in whole periods [ticks]."""
        return max(0, round(self.dead_time.value / self.period))


def identify(
    plant: Plant,
    body: Body,
    standing: Callable[[float], Pattern],
    experiment: Experiment | None = None,
    *,
    watch: Watch | None = None,
    progress: Callable[[float], None] | None = None,
) -> Identified:
    """Shake a standing robot, and learn how CoM and ZMP answer.

    Args:
        plant: The robot, simulated or real.
        body: What lies between CoM velocity and set-points.
        standing: From the time [s] to the pattern of standing that long.
        experiment: How it is shaken.
        watch: When it counts as a fall; `usual_watch` if None.
        progress: Called with the share that is done [-].

    Returns:
        Lag, dead time, compliance, noise, each with its deviation.

    Raises:
        RunError: If the robot fell, or its ZMP came near the edge of its soles.
        ParameterError: If the experiment does not fit the control period, or noise
            drowns the answers.
    """
    experiment = experiment or Experiment()
    pattern = standing(1.0)
    excitation = make_excitation(
        experiment, pattern.pendulum, pattern.plan.sole_size, plant.period
    )
    pattern = standing(excitation.duration + plant.period)
    record = _Record(excitation, pattern, progress)
    outcome = walk(
        pattern,
        Shaker(excitation),
        body,
        plant,
        on_tick=record.add,
        watch=watch,
    )
    if not outcome.ok:
        raise RunError(f"the experiment {outcome}; lower its amplitude")
    return _analyse(excitation, record)


class _Record:
    """Commanded and measured signals, one row a tick. Final."""

    def __init__(
        self,
        excitation: Excitation,
        pattern: Pattern,
        progress: Callable[[float], None] | None,
    ) -> None:
        self._hull = pattern.support_polygon(0.0)
        self._least = 0.5 * _LEAST_MARGIN * pattern.plan.sole_size[1]
        self._progress, self._total = progress, len(excitation.path)
        self.command: list[np.ndarray] = []
        self.com: list[np.ndarray] = []
        self.zmp: list[np.ndarray] = []
        self.positions: list[np.ndarray] = []
        self.wrenches: list[np.ndarray] = []
        self.tilts: list[np.ndarray] = []

    def add(self, tick: Tick) -> None:
        """Keep a tick; stop the experiment near the edge of the soles."""
        reference, sensors, measured = tick.reference, tick.sensors, tick.measured
        if polygon_margin(self._hull, measured.zmp) < self._least:
            raise RunError(
                f"the ZMP came near the edge of the soles at {reference.time:.2f} s; "
                "the robot was stopped: lower the amplitude of the experiment"
            )
        self.command.append(tick.control.com_command - reference.com[:2])
        self.com.append(measured.com[:2] - reference.com[:2])
        self.zmp.append(measured.zmp - reference.zmp)
        self.positions.append(sensors.positions)
        self.wrenches.append(sensors.wrenches)
        self.tilts.append(2.0 * sensors.orientation[1:3])
        if self._progress is not None and len(self.com) % 50 == 0:
            self._progress(len(self.com) / self._total)


def _analyse(excitation: Excitation, record: _Record) -> Identified:
    """Identify the loop from the record of an experiment."""
    dt = excitation.period
    dead_time = _dead_time(excitation, np.array(record.zmp))
    path, com, zmp = (
        _sweeps(excitation, np.array(rows))
        for rows in (record.command, record.com, record.zmp)
    )
    fits, data = [], []
    for axis, bins in enumerate(excitation.bins):
        f = bins / (excitation.sweep_ticks * dt)
        spectra = [np.fft.rfft(x[..., axis], axis=1)[:, bins] for x in (path, com, zmp)]
        data.append(_responses(f, *spectra))
        fits.append(fit_responses(data[-1], dead_time, dt))
    return Identified(
        period=dt,
        duration=excitation.duration,
        dead_time=dead_time,
        axes=(fits[0], fits[1]),
        measured=(data[0], data[1]),
        noise=_noise(excitation, record, com, zmp),
    )


def _sweeps(excitation: Excitation, rows: np.ndarray) -> np.ndarray:
    n = excitation.sweep_ticks
    return np.stack([rows[k : k + n] for k in excitation.sweeps])


def _responses(
    f: np.ndarray, path: np.ndarray, com: np.ndarray, zmp: np.ndarray
) -> Responses:
    each = np.stack([com / path, zmp / path])
    rough = np.stack([com, zmp]).var(axis=1, ddof=1)
    size = np.abs(path).mean(axis=0) * math.sqrt(each.shape[1])
    return Responses(f, each.mean(axis=1), np.sqrt(_smooth(rough)) / size)


def _smooth(spectra: np.ndarray) -> np.ndarray:
    """Return noise spectra averaged over neighbouring frequencies, (..., n).

    A few sweeps alone tell the noise at one frequency poorly.
    """
    kernel = np.ones(2 * _NEIGHBOURS + 1)
    count = np.convolve(np.ones(spectra.shape[-1]), kernel, mode="same")
    rows = [np.convolve(row, kernel, mode="same") / count for row in spectra]
    return np.stack(rows)


def _spread(sweeps: np.ndarray) -> np.ndarray:
    rest = sweeps - sweeps.mean(axis=0)
    rest -= rest.mean(axis=1, keepdims=True)
    count = len(sweeps)
    return np.sqrt((rest**2).mean(axis=(0, 1)) * count / (count - 1))


def _noise(
    excitation: Excitation, record: _Record, com: np.ndarray, zmp: np.ndarray
) -> SensorNoise:
    """Return the noise: the differences between sweeps."""

    def spread(rows: list[np.ndarray], part: slice = slice(None)) -> float:
        each = _spread(_sweeps(excitation, np.array(rows)))[..., part]
        return float(np.sqrt(np.mean(each**2)))

    c_x, c_y = _spread(com).tolist()
    p_x, p_y = _spread(zmp).tolist()
    return SensorNoise(
        encoders=spread(record.positions),
        force=spread(record.wrenches, slice(3)),
        torque=spread(record.wrenches, slice(3, 6)),
        tilt=spread(record.tilts),
        com=(c_x, c_y),
        zmp=(p_x, p_y),
    )


def _dead_time(excitation: Excitation, zmp: np.ndarray) -> Estimate:
    """Return the dead time by the onset of the answers to the taps, both axes."""
    found = [_tap_onset(excitation, zmp[:, axis], axis) for axis in range(2)]
    weights = np.array([x.deviation**-2 for x in found])
    mean = float(weights @ [x.value for x in found] / weights.sum())
    floor = excitation.period / math.sqrt(12.0)
    return Estimate(
        mean - excitation.period, max(floor, 1.0 / math.sqrt(float(weights.sum())))
    )


def _tap_onset(excitation: Excitation, zmp: np.ndarray, axis: int) -> Estimate:
    """Return the onset of the ZMP's response to the taps, one axis."""
    dt = excitation.period
    back, ahead = round(_LOOK_BACK / dt), round(_LOOK_AHEAD / dt)
    rows = np.stack([zmp[k - back : k + ahead] for k in excitation.taps])
    rows -= rows[:, : back + 1].mean(axis=1, keepdims=True)
    rows *= excitation.signs[:, axis, None]
    mean = np.abs(rows.mean(axis=0))
    noise = float(rows[:, :back].std()) / math.sqrt(len(rows))
    clear = max(_CLEAR * noise, _ENOUGH * float(mean[back:].max()))
    seen = back + 1 + int(np.argmax(mean[back + 1 :] > clear))
    end = seen + max(round(_CURVE / dt), _FEWEST)
    times = dt * (np.arange(len(mean)) - back)
    return onset(times[:end], rows[:, :end])
