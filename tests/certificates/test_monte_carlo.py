"""Batches of the simplified model are the simplified model."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import simulate_error_dynamics

from comwalk.certificates.bounds import sampled_weights, sampled_worst_case
from comwalk.certificates.ensemble import (
    TURN_SHARE,
    _seeds,
    errors_under,
    fill_noise,
    monte_carlo,
)
from comwalk.certificates.largest_errors import worst_case
from comwalk.certificates.sampled_loop import SampledLoop
from comwalk.control.gains import Gains
from comwalk.control.law import ControlSettings, WalkingController
from comwalk.control.plant import Command, PendulumPlant
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum

K_P, K_C = (3.0, 1.8), (6.6, 3.8)
NOISE = {"a": 0.05, "b": 0.5}


def random_disturbance(
    robot: int, axis: int, *, a: float, b: float, dt: float, ticks: int, seed: int = 0
) -> np.ndarray:
    """Return the disturbance that one robot of `monte_carlo` gets.

    Args:
        robot: Number of the robot, from 0.
        axis: 0 for x, 1 for y.
        a: Bound on |eps| [m/s].
        b: Bound on the rate of eps [m/s^2].
        dt: Time of a tick [s].
        ticks: How many.
        seed: As given to `monte_carlo`.

    Returns:
        eps at the ticks [m/s], (ticks + 1,): from 0 on.
    """
    lane = 2 * robot + axis
    found, state = np.zeros(ticks + 1), _seeds(seed, lane + 1)[lane]
    fill_noise(found, state, a, b * dt, np.uint32(TURN_SHARE * 2**32))
    return found


@settings(max_examples=10, deadline=None)
@given(
    st.floats(0.5, 5.0),
    st.floats(0.5, 9.0),
    st.floats(0.001, 0.1),
    st.floats(0.01, 5.0),
    st.integers(0, 2**31),
)
def test_each_robot_runs_the_ideal_loop(k_p, k_c, a, b, seed):
    """Eqs. (33), (34), with the disturbance that `random_disturbance` gives back."""
    noise = {"a": a, "b": b, "seed": seed}
    found = monte_carlo(PAPER_PENDULUM, k_p, k_c, robots=3, duration=0.8, **noise)
    for robot in range(3):
        for axis in range(2):
            eps = random_disturbance(robot, axis, dt=0.002, ticks=400, **noise)
            e_c, e_p = simulate_error_dynamics(PAPER_PENDULUM, k_p, k_c, eps, 0.002)
            got = found.com[robot, axis], found.zmp[robot, axis]
            want = np.abs(e_c).max(), np.abs(e_p).max()
            np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-15)


def test_one_disturbance_for_many_gains():
    eps = np.random.default_rng(1).normal(0.0, 0.03, 500)
    gains = np.random.default_rng(2).uniform((0.5, 4.0), (3.0, 8.0), (150, 2))
    found = errors_under(PAPER_PENDULUM, gains[:, :1], gains[:, 1:], eps)
    for robot in (0, 63, 64, 149):
        e_c, e_p = simulate_error_dynamics(PAPER_PENDULUM, *gains[robot], eps, 0.002)
        np.testing.assert_allclose(found.com[robot], np.abs(e_c).max(), rtol=1e-9)
        np.testing.assert_allclose(found.zmp[robot], np.abs(e_p).max(), rtol=1e-9)


def loop_by_hand(loop, eps):
    """Return the largest errors of the plant under the walking controller."""
    slopes = np.diff(eps) / loop.period

    def linear(time):
        i = math.floor(time / loop.period + 1e-9)
        value = eps[i] + slopes[i] * (time - i * loop.period)
        return np.full(2, value), np.full(2, slopes[i])

    plant = PendulumPlant(
        PAPER_PENDULUM,
        period=loop.period,
        servo_lag=loop.servo_lag,
        disturbance=linear,
    )
    free = ControlSettings(
        zmp_cutoff=loop.zmp_cutoff, max_correction=1e6, max_offset=1e6
    )
    controller = WalkingController(Gains(zmp=K_P, com=K_C), free, loop.period)

    @dataclasses.dataclass
    class Rest:
        com = com_velocity = zmp = np.zeros(2)
        heading, walking = 0.0, 1.0

    sensors, com, zmp = plant.start(Command(np.zeros(2), np.zeros(2))), [], []
    for k in range(len(eps) - 1):
        f_z = sensors.wrenches[0, 2]
        p = np.array([-sensors.wrenches[0, 4], sensors.wrenches[0, 3]]) / f_z
        com.append(np.abs(sensors.positions))
        zmp.append(np.abs(p))
        plant.write(
            Command(np.zeros(2), controller.step(Rest(), sensors.positions, p).u)
        )
        if k < len(eps) - 2:
            sensors = plant.read()
    return np.max(com, axis=0), np.max(zmp, axis=0)


@pytest.mark.parametrize("cutoff", [1.0, 4.0])
@pytest.mark.parametrize("period", [0.001, 0.005])
def test_sampled_loop_is_the_controller_on_the_plant(cutoff, period):
    """Eqs. (30), (31): the classes that run tick by tick, on the same disturbance."""
    loop = SampledLoop(period=period, zmp_cutoff=cutoff, delay=0)
    rng = np.random.default_rng(3)
    eps = np.clip(np.cumsum(rng.normal(0.0, 0.004, 400)), -0.05, 0.05)
    eps[0] = 0.0
    found = errors_under(PAPER_PENDULUM, K_P, K_C, eps, loop=loop)
    com, zmp = loop_by_hand(loop, eps)
    np.testing.assert_allclose(found.com[0], com, rtol=1e-9)
    np.testing.assert_allclose(found.zmp[0], zmp, rtol=1e-9)


@pytest.mark.parametrize(
    "loop",
    [
        SampledLoop(),
        SampledLoop(period=0.005, zmp_cutoff=1.0, analog_filter=True),
        SampledLoop(zmp_cutoff=2.0, delay=3, dead_time=0.0031),
        SampledLoop(zmp_cutoff=1.0, mode_frequency=20.0, mode_damping=0.7),
    ],
)
def test_sampled_loop_against_its_weights_and_bounds(loop):
    """Filter, delay, dead time and contact, by the response to each single sample."""
    eps = np.clip(np.cumsum(np.random.default_rng(4).normal(0, 0.004, 300)), -0.1, 0.1)
    eps[0] = 0.0
    found = errors_under(PAPER_PENDULUM, 3.0, 6.6, eps, loop=loop)
    for weights, which in zip(
        sampled_weights(PAPER_PENDULUM, 3.0, 6.6, loop), ("com", "zmp"), strict=True
    ):
        w = weights.eps
        errors = [w[-m:] @ eps[:m] for m in range(2, len(eps) + 1)]
        largest = getattr(found, which)[0]
        np.testing.assert_allclose(largest, np.abs(errors).max(), rtol=1e-6)
        worst = sampled_worst_case(weights, loop, **NOISE)
        noisy = monte_carlo(
            PAPER_PENDULUM, 3.0, 6.6, loop=loop, robots=40, duration=3.0, **NOISE
        )
        assert getattr(noisy, which).max() < 1.001 * worst.bound


def test_chance_stays_below_the_exact_bound_and_comes_near():
    """Theorem 1 in its tight form."""
    found = monte_carlo(PAPER_PENDULUM, K_P, K_C, robots=4000, duration=10.0, **NOISE)
    for axis in range(2):
        for name in ("com", "zmp"):
            gains = K_P[axis], K_C[axis]
            bound = worst_case(PAPER_PENDULUM, *gains, *NOISE.values(), name).bound
            reached = getattr(found, name)[:, axis].max()
            assert 0.8 * bound < reached < 1.001 * bound


def test_a_robot_does_not_depend_on_the_others():
    few = monte_carlo(PAPER_PENDULUM, K_P, K_C, robots=3, duration=1.0, **NOISE)
    many = monte_carlo(PAPER_PENDULUM, K_P, K_C, robots=100, duration=1.0, **NOISE)
    np.testing.assert_array_equal(few.zmp, many.zmp[:3])
    assert len(np.unique(many.zmp)) == 200
    other = monte_carlo(
        PAPER_PENDULUM, K_P, K_C, robots=3, duration=1.0, seed=1, **NOISE
    )
    assert not np.isin(other.zmp, few.zmp).any()


def test_an_unstable_loop_grows_without_end():
    found = monte_carlo(Pendulum(), 5.0, 3.0, robots=1, duration=900.0, **NOISE)
    assert np.isinf(found.com).all()


def test_random_disturbance_uses_its_bounds_and_keeps_them():
    eps = random_disturbance(5, 1, dt=0.002, ticks=20_000, **NOISE)
    rates = np.abs(np.diff(eps)) / 0.002
    assert np.abs(eps).max() == 0.05
    assert rates.max() == pytest.approx(0.5)
    assert (np.abs(eps) == 0.05).mean() > 0.2
    assert abs(eps.mean()) < 0.01


@pytest.mark.parametrize(
    ("k_p", "k_c", "noise"),
    [
        (0.0, 1.0, {}),
        (np.nan, 1.0, {}),
        (np.ones(3), 2.0, {}),
        (np.ones((4, 2)), np.ones((3, 2)), {}),
        (3.0, 6.6, {"a": -1.0}),
        (3.0, 6.6, {"duration": 0.0}),
    ],
)
def test_bad_numbers_are_refused(k_p, k_c, noise):
    with pytest.raises(ParameterError):
        monte_carlo(PAPER_PENDULUM, k_p, k_c, **{**NOISE, **noise})


def test_bad_disturbances_are_refused():
    for eps in (np.zeros(2), np.full(9, np.inf), np.zeros((9, 2))):
        with pytest.raises(ParameterError):
            errors_under(PAPER_PENDULUM, 3.0, 6.6, eps)
