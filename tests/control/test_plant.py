"""Eq. (30): the simplified robot, alone and under the walking controller."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
import scipy.integrate

from comwalk.certificates import largest_errors
from comwalk.certificates import sampled_loop as sampled
from comwalk.control import plant as module
from comwalk.control.gains import Gains
from comwalk.control.law import ControlSettings, WalkingController
from comwalk.control.plant import Command, PendulumPlant, Plant
from comwalk.errors import ComwalkError, ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
STILL = Command(np.zeros(2), np.zeros(2))


def zmp_of(sensors):
    """ZMP of the left wrench, the one sole."""
    f_z, m_x, m_y = sensors.wrenches[0, 2:5]
    return np.array([-m_y / f_z, m_x / f_z])


def rates(x, y):
    return Command(np.zeros(2), np.array([x, y], float))


def test_start_is_at_rest_where_the_command_is():
    """Eq. (30): at rest the ZMP is below the CoM, and the sole bears the weight."""
    robot = PendulumPlant(PAPER)
    sensors = robot.start(Command(np.array([0.1, -0.2]), np.array([5.0, 5.0])))
    assert sensors.time == 0.0
    assert sensors.positions.tolist() == [0.1, -0.2]
    assert sensors.velocities.tolist() == [0.0, 0.0]
    assert zmp_of(sensors) == pytest.approx([0.1, -0.2])
    assert sensors.wrenches[0, 2] == pytest.approx(67.68 * 9.81)
    assert not sensors.wrenches[1].any()
    assert sensors.orientation.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert sensors.acceleration == pytest.approx([0.0, 0.0, 9.81])


def test_response_against_an_integrator():
    """Eq. (30): c' = v + eps behind the servo, p = c - c''/omega^2, by solve_ivp."""
    a, f, tau, dt = 0.03, 1.3, 0.03, 0.004
    robot = PendulumPlant(
        PAPER,
        period=dt,
        servo_lag=tau,
        disturbance=module.sine_disturbance((a, 0.0), f),
    )
    robot.start(STILL)
    rng, w = np.random.default_rng(2), 2 * math.pi * f
    state, t = np.zeros(2), 0.0
    for k in range(30):
        u = rng.normal()
        robot.write(rates(u, 0.0))
        sensors = robot.read()

        def rate(time, x, u=u):
            return [x[1] + a * math.sin(w * time), (u - x[1]) / tau]

        state = scipy.integrate.solve_ivp(
            rate, (t, t + dt), state, rtol=1e-11, atol=1e-13
        ).y[:, -1]
        t += dt
        assert sensors.time == pytest.approx((k + 1) * dt)
        c, v = state
        cdot = v + a * math.sin(w * t)
        cddot = (u - v) / tau + a * w * math.cos(w * t)
        assert sensors.positions[0] == pytest.approx(c, abs=1e-9)
        assert sensors.velocities[0] == pytest.approx(cdot, abs=1e-9)
        assert sensors.acceleration[0] == pytest.approx(cddot, abs=1e-7)
        w2 = PAPER.gravity / PAPER.height
        assert zmp_of(sensors)[0] == pytest.approx(c - cddot / w2, abs=1e-8)
        assert sensors.positions[1] == 0.0


def test_linear_disturbance_is_integrated_exactly():
    """Eq. (30): the CoM drifts by the integral of eps."""
    samples = np.array([[0.0, 0.1], [0.1, 0.1], [-0.1, 0.3]])
    robot = PendulumPlant(
        PAPER, period=0.05, disturbance=module.sampled_disturbance(samples, 0.5)
    )
    robot.start(STILL)
    for _ in range(20):
        sensors = robot.read()
    assert sensors.positions == pytest.approx([0.025, 0.15], abs=1e-12)


@dataclass
class Asked:
    """A reference at rest, standing on the world's origin."""

    com: np.ndarray = field(default_factory=lambda: np.zeros(2))
    com_velocity: np.ndarray = field(default_factory=lambda: np.zeros(2))
    zmp: np.ndarray = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    walking: float = 1.0


def closed_loop(robot, gains, ticks, start=(0.0, 0.0), **fields):
    """Errors (ticks, 2 for com and zmp, 2 axes) of the law on the pendulum."""
    settings = ControlSettings(max_correction=1e9, max_offset=1e9, **fields)
    controller = WalkingController(gains, settings, robot.period)
    sensors = robot.start(Command(np.array(start), np.zeros(2)))
    errors = np.empty((ticks, 2, 2))
    for k in range(ticks):
        out = controller.step(Asked(), sensors.positions, zmp_of(sensors))
        robot.write(Command(out.com_command, out.u))
        sensors = robot.read()
        errors[k] = -sensors.positions, -zmp_of(sensors)
    return errors


@pytest.mark.parametrize("cutoff", [1.0, 5.0, 8.0])
@pytest.mark.parametrize("period", [0.002, 0.005])
def test_loop_decays_as_the_matrix_says(cutoff, period):
    """Eqs. (30), (31): the controller on the plant is the sampled loop's matrix."""
    robot = PendulumPlant(PAPER, period=period)
    errors = closed_loop(robot, Gains(), 60, (0.01, 0.0), zmp_cutoff=cutoff)
    loop = sampled.SampledLoop(period=period, zmp_cutoff=cutoff, delay=0)
    M = sampled.sampled_loop_matrix(PAPER, 3.0, 6.6, loop)
    # The controller filters the first reading once from 0; the matrix starts after.
    alpha = sampled.low_pass_coefficient(cutoff, period)
    z = np.array([0.01, 0.0, alpha * 0.01])
    expected = []
    for _ in range(60):
        z = M @ z
        expected.append(-z[0])
    assert errors[:, 0, 0] == pytest.approx(np.array(expected), rel=1e-6, abs=1e-10)


def test_zmp_gain_above_com_gain_falls():
    """Theorem 1: k_p > k_c diverges, the paper's gains do not."""
    bad = Gains(zmp=(7.5, 4.5), com=(6.6, 3.8))
    robot = PendulumPlant(PAPER)
    start = (0.01, 0.01)
    good = np.abs(closed_loop(robot, Gains(), 4000, start)[-1, 0])
    bad_end = np.abs(closed_loop(robot, bad, 4000, start)[-1, 0])
    assert (good < 1e-4).all()
    assert (bad_end > 0.05).all()


def test_constant_disturbance_on_the_loop():
    """Eq. (34) at rest: e_c = e_p = -eps / (k_c - k_p), servo and filter or not."""
    robot = PendulumPlant(PAPER, disturbance=module.constant_disturbance((0.05, 0.02)))
    errors = closed_loop(robot, Gains(), 4000)[-1]
    expected = [-0.05 / 3.6, -0.02 / 2.0]
    assert errors[0] == pytest.approx(expected, rel=1e-4)
    assert errors[1] == pytest.approx(expected, rel=1e-4)


def test_sine_on_the_loop_approaches_the_ideal_response():
    """Eqs. (30), (31): in a quick loop the amplitudes are |G_c| a, |G_p| a to 4 %."""
    f, a, dt = 0.5, 0.05, 5e-4
    disturbance = module.sine_disturbance(a, f)
    robot = PendulumPlant(PAPER, period=dt, servo_lag=0.01, disturbance=disturbance)
    errors = closed_loop(robot, Gains(), 12_000, zmp_cutoff=20.0)
    last = np.abs(errors[-4000:]).max(axis=0)
    for axis, (k_p, k_c) in enumerate(((3.0, 6.6), (1.8, 3.8))):
        ideal = np.abs(largest_errors.frequency_response(PAPER, k_p, k_c, f))
        assert last[:, axis] == pytest.approx(a * ideal, rel=0.04)


def test_com_stays_in_the_ideal_bound_under_bounded_disturbances():
    """Theorem 1: |eps| <= .05, |eps'| <= .5 on the sampled loop, CoM within 15 %."""
    for seed in range(3):
        robot = PendulumPlant(
            PAPER, disturbance=module.random_bounded(0.05, 0.5, seed, duration=10.0)
        )
        peak = np.abs(closed_loop(robot, Gains(), 5000)[:, 0]).max(axis=0)
        bounds = [
            largest_errors.worst_case(PAPER, k_p, k_c, 0.05, 0.5, "com").bound
            for k_p, k_c in ((3.0, 6.6), (1.8, 3.8))
        ]
        assert (peak < 1.15 * np.array(bounds)).all()
        assert (peak > 0.4 * np.array(bounds)).all()


# --- Disturbances ------------------------------------------------------------------


@pytest.mark.parametrize(
    "disturbance",
    [
        module.no_disturbance,
        module.constant_disturbance((0.01, -0.02)),
        module.sine_disturbance((0.05, 0.02), 0.7),
        module.sampled_disturbance(np.array([0.0, 0.1, -0.2]), 0.5),
        module.random_bounded(0.05, 0.5, 4),
    ],
)
def test_rate_is_the_derivative(disturbance):
    """eps_dot against a central difference, away from knots."""
    for t in (0.011, 0.113, 0.777, 5.013):
        _, slope = disturbance(t)
        ahead, behind = disturbance(t + 1e-6)[0], disturbance(t - 1e-6)[0]
        assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-6)


def test_random_disturbance_uses_its_bounds_and_keeps_them():
    disturbance = module.random_bounded(0.05, 0.5, seed=1, duration=20.0)
    values = np.array([disturbance(t) for t in np.arange(0.0, 25.0, 0.003)])
    eps, slope = values[:, 0], values[:, 1]
    assert np.abs(eps).max(axis=0) == pytest.approx([0.05, 0.05])
    assert np.abs(slope).max() == pytest.approx(0.5)
    assert np.abs(np.diff(eps, axis=0)).max() <= 0.5 * 0.003 * (1 + 1e-9)
    assert (eps[:, 0] != eps[:, 1]).any()
    again = module.random_bounded(0.05, 0.5, seed=1, duration=20.0)
    assert (again(7.7)[0] == disturbance(7.7)[0]).all()
    other = module.random_bounded(0.05, 0.5, seed=2, duration=20.0)
    assert any((other(t)[0] != disturbance(t)[0]).any() for t in range(20))


def test_samples_at_their_times_and_outside():
    table = np.array([[0.1, 1.0], [0.2, 3.0]])
    disturbance = module.sampled_disturbance(table, 0.5)
    assert disturbance(-1.0)[0].tolist() == [0.1, 1.0]
    assert disturbance(0.0)[0].tolist() == [0.1, 1.0]
    assert disturbance(0.25)[0] == pytest.approx([0.15, 2.0])
    assert disturbance(0.5)[0].tolist() == [0.2, 3.0]
    assert disturbance(9.0)[1].tolist() == [0.0, 0.0]


# --- Use and misuse ----------------------------------------------------------------


def test_pendulum_is_a_plant():
    robot: Plant = PendulumPlant(PAPER, period=0.004)
    assert robot.joint_names == ("com_x", "com_y")
    assert robot.period == 0.004


def test_readings_do_not_share_memory():
    robot = PendulumPlant(PAPER)
    first = robot.start(STILL)
    first.positions[0] = 9.0
    assert robot.read().positions[0] == 0.0
    u = np.array([0.1, 0.0])
    robot.write(Command(np.zeros(2), u))
    u[0] = math.nan
    assert np.isfinite(robot.read().positions).all()


def test_start_again_begins_anew():
    robot = PendulumPlant(PAPER)
    robot.start(STILL)
    robot.write(rates(1.0, 0.0))
    robot.read()
    sensors = robot.start(STILL)
    assert sensors.time == 0.0
    assert not sensors.positions.any()
    assert not sensors.velocities.any()


def test_use_before_start_and_after_stop():
    robot = PendulumPlant(PAPER)
    with pytest.raises(ComwalkError, match="start"):
        robot.read()
    with pytest.raises(ComwalkError, match="start"):
        robot.write(STILL)
    robot.start(STILL)
    robot.stop("done")
    robot.stop("again")
    with pytest.raises(ComwalkError, match="start"):
        robot.read()


@pytest.mark.parametrize(
    "command",
    [rates(math.nan, 0.0), rates(0.0, math.inf), Command(np.zeros(3), np.zeros(3))],
)
def test_bad_commands_are_refused(command):
    robot = PendulumPlant(PAPER)
    with pytest.raises(ParameterError, match="2 finite"):
        robot.start(command)
    robot.start(STILL)
    with pytest.raises(ParameterError, match="2 finite"):
        robot.write(command)


@pytest.mark.parametrize("name", ["period", "servo_lag", "mass"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", None])
def test_bad_numbers_are_refused(name, bad):
    fields: dict[str, Any] = {name: bad}
    with pytest.raises(ParameterError, match=name):
        PendulumPlant(PAPER, **fields)


def test_bad_disturbances_are_refused():
    with pytest.raises(ParameterError, match="value"):
        module.constant_disturbance(math.nan)
    bad: Any = (1.0, 2.0, 3.0)
    with pytest.raises(ParameterError, match="amplitude"):
        module.sine_disturbance(bad, 1.0)
    with pytest.raises(ParameterError, match="frequency"):
        module.sine_disturbance(1.0, -1.0)
    with pytest.raises(ParameterError, match="samples"):
        module.sampled_disturbance(np.zeros((3, 3)), 0.1)
    with pytest.raises(ParameterError, match="samples"):
        module.sampled_disturbance(np.array([]), 0.1)
    with pytest.raises(ParameterError, match="dt"):
        module.sampled_disturbance(np.zeros(3), 0.0)
    with pytest.raises(ParameterError, match="b must be"):
        module.random_bounded(0.05, math.nan, 0)


def test_rate_at_a_sample_time_is_that_to_the_right():
    """Eq. (30): also where the quotient of two times rounds to just below a whole."""
    samples, h = np.arange(300.0) ** 2, 0.02
    disturbance = module.sampled_disturbance(samples, h)
    for k in range(299):
        for time in (k * h, k * 4 * 0.005, k * 10 * 0.002):
            eps, rate = disturbance(time)
            assert rate[0] == pytest.approx((2 * k + 1) / h)
            assert eps[0] == pytest.approx(k**2, abs=1e-6)
