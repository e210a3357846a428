"""What is identified is what was built in, on plants whose answer is known."""

from __future__ import annotations

import json
import re
import shlex
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures import inked

from comwalk.certificates.identification.excitation import (
    Experiment,
    Shaker,
    make_excitation,
    standing_pattern,
)
from comwalk.certificates.identification.frequency_response import (
    Estimate,
    Orders,
    Responses,
    fit_responses,
    onset,
)
from comwalk.certificates.identification.identification import Identified, identify
from comwalk.certificates.identification.loop_fit import (
    equivalent_loop,
    measured_margin,
)
from comwalk.certificates.sampled_loop import SampledLoop
from comwalk.certificates.stability_margins import margins
from comwalk.cli.app import main
from comwalk.config import IdentifyConfig
from comwalk.control.loop import PointBody
from comwalk.control.plant import Command, PendulumPlant, Sensors
from comwalk.errors import ParameterError, RunError
from comwalk.pattern.pendulum import Pendulum
from comwalk.setup import build_identify

SOLE = (0.24, 0.13)
SHORT = Experiment(sweeps=2, sweep_time=4.0, lines=12, lowest=0.5, taps=8)


class LatePlant:
    """A pendulum whose sensors are late and noisy."""

    def __init__(self, lag: float, late: int, period: float, noise: float) -> None:
        self._plant = PendulumPlant(Pendulum(), period=period, servo_lag=lag)
        self._late, self._noise = late, noise
        self._rng = np.random.default_rng(1)
        self.joint_names, self.period = self._plant.joint_names, period

    def start(self, command: Command) -> Sensors:
        self._readings = deque(maxlen=self._late + 1)
        return self._seen(self._plant.start(command))

    def write(self, command: Command) -> None:
        self._plant.write(command)

    def read(self) -> Sensors:
        return self._seen(self._plant.read())

    def stop(self, reason: str) -> None:
        self._plant.stop(reason)

    def _seen(self, sensors: Sensors) -> Sensors:
        normal = self._rng.standard_normal
        noisy = replace(
            sensors,
            positions=sensors.positions + 1e-4 * self._noise * normal(2),
            wrenches=sensors.wrenches + 0.2 * self._noise * normal((2, 6)),
        )
        self._readings.append(noisy)
        return self._readings[0]


def standing(duration: float):
    return standing_pattern(Pendulum(), 0.1, SOLE, duration)


def of_pendulum(
    lag: float, late: int, period: float = 0.002, noise: float = 0.0
) -> Identified:
    plant = LatePlant(lag, late, period, noise)
    return identify(plant, PointBody(), standing, replace(SHORT, highest=0.1 / period))


@pytest.mark.parametrize(("lag", "late", "period"), [(0.02, 5, 0.004), (0.05, 0, 0.01)])
def test_lag_and_dead_time_of_a_pendulum_are_found(lag, late, period):
    """Without noise: the lag to 1 %, the dead time to the tick, and no mode."""
    found = of_pendulum(lag, late, period)
    assert found.dead_time.value == pytest.approx(late * period, abs=1e-9)
    assert found.delay == late
    for fit in found.axes:
        assert fit.lag.value == pytest.approx(lag, rel=0.01)
        assert fit.gain.value == pytest.approx(1.0, abs=0.003)
        assert fit.frequency is None
    assert max(found.noise.com) < 1e-9


def test_noise_is_found_and_told_in_the_deviations():
    """The noise that was added comes out; the lag is as near as it says."""
    found = of_pendulum(0.02, 3, 0.004, noise=3.0)
    assert found.noise.encoders == pytest.approx(3e-4, rel=0.05)
    assert found.noise.torque == pytest.approx(0.6, rel=0.05)
    assert found.delay == 3
    for fit in found.axes:
        assert abs(fit.lag.value - 0.02) < 4.0 * fit.lag.deviation
        assert 1e-5 < fit.lag.deviation < 2e-3


def test_the_margin_of_a_measured_pendulum_is_that_of_its_model():
    """Two ways: by the fitted response, and by the loop it was made of."""
    found = of_pendulum(0.02, 1, 0.004)
    loop = SampledLoop(period=0.004, servo_lag=0.02, zmp_cutoff=2.0, delay=1)
    for k_p, k_c in ((1.0, 3.0), (1.8, 3.8)):
        exact = margins(Pendulum(), k_p, k_c, loop).delay
        measured = measured_margin(found.axes[0], k_p, k_c, 2.0)
        assert measured.stable
        assert measured.delay == pytest.approx(exact, rel=0.06)
    unstable = measured_margin(found.axes[0], 3.0, 6.6, 20.0)
    with pytest.raises(ParameterError):
        margins(Pendulum(), 3.0, 6.6, replace(loop, zmp_cutoff=20.0))
    assert (unstable.stable, unstable.delay) == (False, 0.0)
    near = equivalent_loop(found.axes[0], Pendulum(), 2.0)
    assert near.servo_lag == pytest.approx(0.02, rel=0.12)
    assert near.dead_time == pytest.approx(0.004, abs=1e-9)


def rational(f, g, zero, frequency, damping, omega, T, dt):
    """Return responses of CoM and ZMP of a mode: made apart from the fit's formulas."""
    w = 2.0 * np.pi * np.asarray(f)
    w_m = 2.0 * np.pi * frequency
    com = g * (1.0 + 1j * w * zero) / (1.0 - (w / w_m) ** 2 + 2j * damping * w / w_m)
    zmp = com * (1.0 + (w / omega) ** 2)
    return np.array([com * np.exp(-1j * w * T), zmp * np.exp(-1j * w * (T + dt / 2))])


@given(
    frequency=st.floats(2.0, 8.0),
    damping=st.floats(0.1, 0.5),
    zero=st.floats(0.0, 0.02),
    omega=st.floats(2.5, 5.0),
    ticks=st.integers(0, 20),
)
@settings(max_examples=15)
def test_a_known_mode_is_found(frequency, damping, zero, omega, ticks):
    """Frequency, damping, lag and pendulum of a response that is made up."""
    dt, f = 0.002, np.geomspace(0.4, 16.0, 24)
    values = rational(f, 1.04, zero, frequency, damping, omega, ticks * dt, dt)
    data = Responses(f, values, 1e-4 * np.abs(values))
    fit = fit_responses(data, Estimate(ticks * dt, dt / 4), dt, (Orders(2, 1, 3),))
    assert fit.misfit < 0.1
    assert fit.frequency.value == pytest.approx(frequency, rel=2e-3)
    assert fit.damping.value == pytest.approx(damping, rel=1e-2)
    assert fit.omega.value == pytest.approx(omega, rel=5e-3)
    lag = 2.0 * damping / (2.0 * np.pi * frequency) - zero
    assert fit.lag.value == pytest.approx(lag, abs=3e-4)
    assert np.allclose(fit.at(f), values, rtol=5e-3)


@given(start=st.integers(1, 30), noise=st.floats(0.0, 0.1), seed=st.integers(0, 99))
@settings(max_examples=25)
def test_the_onset_of_a_step_is_found(start, noise, seed):
    """To the sample while the noise of the mean is far below the step."""
    times = 0.002 * np.arange(-40, start + 15)
    clean = np.where(times >= start * 0.002 - 1e-9, 1.0 + 20.0 * times, 0.0)
    rng = np.random.default_rng(seed)
    rows = clean + noise * rng.standard_normal((16, len(times)))
    found = onset(times, rows)
    assert found.value == pytest.approx(start * 0.002, abs=1e-9)
    assert found.deviation >= 0.002 / np.sqrt(12.0) - 1e-12


def test_the_excitation_stays_within_its_amplitude():
    """The ZMP of a rigid robot swings by the share of the sole that was asked for."""
    excitation = make_excitation(Experiment(), Pendulum(), SOLE, 0.002)
    path, dt = excitation.path, excitation.period
    zmp = path[1:-1] - np.diff(path, 2, axis=0) / dt**2 / Pendulum().omega ** 2
    swept = zmp[: excitation.taps[0] - 1]
    assert np.abs(swept).max(axis=0) == pytest.approx(0.1 * np.array(SOLE), rel=0.05)
    assert np.all(path[[0, -1]] == 0.0)
    first, second = (
        path[k : k + excitation.sweep_ticks] for k in excitation.sweeps[:2]
    )
    assert np.allclose(first, second, atol=1e-15)
    assert not set(excitation.bins[0]) & set(excitation.bins[1])


def test_the_commanded_velocity_is_the_rate_of_the_commanded_place():
    """As the walking controller's are."""
    excitation = make_excitation(SHORT, Pendulum(), SOLE, 0.004)
    shaker, pattern = Shaker(excitation), standing(1.0)
    shaker.reset((0.0, 0.0), (0.0, 0.0))
    at = None
    for k in range(800):
        output = shaker.step(pattern.at(0.0), np.zeros(3), np.zeros(2))
        if at is not None:
            assert np.allclose(output.com_command, at, atol=1e-15)
        at = output.com_command + output.u * 0.004
        assert np.allclose(output.com_command, excitation.path[k], atol=1e-12)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"amplitude": 0.9}, "amplitude"),
        ({"sweeps": 1}, "sweeps"),
        ({"lowest": 0.1}, "lowest"),
        ({"highest": 1.0}, "highest"),
    ],
)
def test_wrong_experiments_are_refused(words, message):
    """With the name of what is wrong."""
    with pytest.raises(ParameterError, match=message):
        Experiment(**words)


def test_what_does_not_fit_is_refused():
    """Too many frequencies, or too slow a loop."""
    with pytest.raises(ParameterError, match="take fewer lines"):
        make_excitation(Experiment(lines=60), Pendulum(), SOLE, 0.002)
    with pytest.raises(ParameterError, match="control period"):
        make_excitation(Experiment(), Pendulum(), SOLE, 0.05)


def test_a_robot_near_the_edge_of_its_soles_is_stopped():
    """A servo so fast that the taps throw the ZMP off the soles."""
    plant = LatePlant(0.002, 0, 0.002, 0.0)
    with pytest.raises(RunError, match="lower the amplitude"):
        identify(plant, PointBody(), standing, replace(SHORT, amplitude=0.5))


def test_a_robot_in_physics_is_identified():
    """Dead time to the tick, and the lag that its motors' dampers give it."""
    short = replace(SHORT, sweeps=2, sweep_time=5.0, lines=16)
    config = IdentifyConfig(experiment=short)
    late = replace(config.simulator, latency=0.008)
    lags = []
    for damping in (1.0, 2.0):
        setup = build_identify(replace(config, simulator=late))
        plant = setup.plant
        plant.model.actuator_biasprm[setup.robot.servo.actuators, 2] *= damping
        found = identify(plant, setup.body, setup.standing, short)
        assert found.dead_time.value == pytest.approx(0.008, abs=0.002)
        lags.append([fit.lag.value for fit in found.axes])
        gains = [fit.gain.value for fit in found.axes]
        assert found.axes[0].frequency.value == pytest.approx(3.01, rel=0.02)
        assert found.axes[1].frequency.value == pytest.approx(4.5, rel=0.08)
    servo = setup.robot.servo
    built_in = float(np.median(servo.damping / servo.stiffness))
    # Set-points lead by what the dampers of the data sheet hold back: nothing is left
    # but the doubled part, which a yielding robot feels a little more.
    assert np.abs(lags[0]).max() < 0.003
    added = np.subtract(lags[1], lags[0])
    assert added == pytest.approx(built_in * np.array(gains), rel=0.1)


DOCUMENT = (Path(__file__).parents[2] / "docs" / "identification.md").read_text()


def test_the_commands_of_the_document_run(tmp_path, monkeypatch, capsys):
    """Table, JSON, picture, and loop.toml, which certify reads."""
    monkeypatch.chdir(tmp_path)
    block = re.search(r"<!-- run -->\n```bash\n(.*?)```", DOCUMENT, re.DOTALL)
    assert block is not None
    first, second = (shlex.split(line)[1:] for line in block[1].splitlines())
    short = ["--experiment.sweeps", "2", "--experiment.taps", "4", "--json"]
    assert main([*first, *short]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["delay_ticks"] == 0
    assert facts["axes"]["y"]["more_delay_ms"]["walking"] == pytest.approx(20.0, abs=2)
    assert inked("found/identify.png") > 0.02
    assert json.loads(Path("found/identify.json").read_text()) == facts
    assert main([*second, "--json"]) == 0
    certified = json.loads(capsys.readouterr().out)["loop"]
    for name, value in facts["axes"]["y"]["loop"].items():
        assert certified[name] == pytest.approx(value, rel=1e-4)


def test_the_program_of_the_document_prints_what_it_says(capsys):
    """On the simplified model."""
    code = re.search(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
    text = re.search(r"```text\n(.*?)```", DOCUMENT, re.DOTALL)
    assert code is not None
    assert text is not None
    exec(compile(code[1], "identification.md", "exec"), {})
    assert capsys.readouterr().out == text[1]
