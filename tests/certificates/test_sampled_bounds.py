"""The exact worst case of the sampled loop, injected into the pendulum plant."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from comwalk.certificates import bounds as b
from comwalk.certificates.largest_errors import worst_disturbance
from comwalk.certificates.sampled_loop import SampledLoop
from comwalk.control.gains import Gains
from comwalk.control.law import ControlSettings, WalkingController
from comwalk.control.plant import (
    Command,
    PendulumPlant,
    random_bounded,
    sampled_disturbance,
)
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
X, Y = (3.0, 6.6), (1.8, 3.8)
GAINS = Gains(zmp=(X[0], Y[0]), com=(X[1], Y[1]))
STAND = SimpleNamespace(
    com=np.zeros(2), com_velocity=np.zeros(2), zmp=np.zeros(2), heading=0.0, walking=1.0
)


def run_plant(loop, disturbance, ticks):
    """Return e_c and e_p (ticks, 2) of the controller on the plant, tick by tick."""
    far = {"max_correction": 1e6, "max_offset": 1e6}
    settings = ControlSettings(zmp_cutoff=loop.zmp_cutoff, **far)
    controller = WalkingController(GAINS, settings, loop.period)
    plant = PendulumPlant(
        PAPER, period=loop.period, servo_lag=loop.servo_lag, disturbance=disturbance
    )
    still = Command(np.zeros(2), np.zeros(2))
    seen = [plant.start(still)] * (loop.delay + 1)
    errors = []
    for _ in range(ticks):
        late = seen[-1 - loop.delay]
        u = controller.step(STAND, late.positions, zmp_of(late)).u
        plant.write(Command(np.zeros(2), u))
        seen.append(plant.read())
        errors.append((-seen[-1].positions, -zmp_of(seen[-1])))
    return np.array(errors).transpose(1, 0, 2)


def zmp_of(sensors):
    """Return the ZMP of the one sole."""
    f_z, m_x, m_y = sensors.wrenches[0, 2:5]
    return np.array([-m_y / f_z, m_x / f_z])


LOOPS = [
    SampledLoop(period=0.005, zmp_cutoff=2.0, delay=1),
    SampledLoop(period=0.002, zmp_cutoff=4.0, delay=1),
    SampledLoop(period=0.01, zmp_cutoff=1.0, delay=0, servo_lag=0.03),
]


@pytest.mark.parametrize("loop", LOOPS)
def test_worst_disturbance_attains_the_bound_on_the_plant(loop):
    """Theorem 1, sampled: bounds are attained within 0.1 %, in x and in y."""
    weights = [b.sampled_weights(PAPER, *gains, loop) for gains in (X, Y)]
    for output in (0, 1):
        worst = [b.sampled_worst_case(w[output], loop, 0.05, 0.5) for w in weights]
        n = max(len(w.disturbance) for w in worst)
        eps = np.zeros((n, 2))  # both end at the same time, and begin at rest
        for axis, w in enumerate(worst):
            eps[n - len(w.disturbance) :, axis] = w.disturbance
            eps[: n - len(w.disturbance), axis] = w.disturbance[0]
            assert np.abs(w.disturbance).max() <= 0.05 * (1 + 1e-9)
            rates = np.abs(np.diff(w.disturbance)) / loop.period
            assert rates.max() <= 0.5 * (1 + 1e-6)
        errors = run_plant(loop, sampled_disturbance(eps, loop.period), n - 2)
        reached = errors[output][-1]
        assert reached == pytest.approx([w.bound for w in worst], rel=1e-3)


def test_random_disturbances_on_the_plant_stay_inside():
    """Theorem 1, sampled: 24 disturbances of 6 s, at full rate and at their bounds."""
    loop = LOOPS[0]
    bounds = np.array(
        [
            [b.sampled_worst_case(w, loop, 0.05, 0.5).bound for w in pair]
            for pair in (b.sampled_weights(PAPER, *gains, loop) for gains in (X, Y))
        ]
    ).T
    peak = np.zeros((2, 2))
    for seed in range(12):
        eps = random_bounded(0.05, 0.5, seed, duration=6.0, knot=0.02)
        errors = run_plant(loop, eps, 1200)
        peak = np.maximum(peak, np.abs(errors).max(axis=1))
    assert (peak <= bounds * (1 + 1e-9)).all()
    assert (peak > 0.5 * bounds).all()


@pytest.mark.parametrize("gains", [X, Y])
def test_a_thousand_random_disturbances_stay_inside(gains):
    """Theorem 1, sampled: all at once, by the weights that the plant agreed with."""
    loop, a, rate = LOOPS[0], 0.05, 0.5
    rng = np.random.default_rng(3)
    for weights in b.sampled_weights(PAPER, *gains, loop):
        n = len(weights.eps)
        chances = rng.choice([0.005, 0.02, 0.1], size=(1, 1000))
        signs = np.where(np.cumsum(rng.random((n, 1000)) < chances, axis=0) % 2, 1, -1)
        eps = np.zeros((n, 1000))
        eps[0] = rng.uniform(-a, a, 1000)
        for i in range(n - 1):
            step = rate * loop.period * signs[i]
            eps[i + 1] = np.clip(eps[i] + step, -a, a)
        errors = np.abs(weights.eps @ eps)
        bound = b.sampled_worst_case(weights, loop, a, rate).bound
        assert errors.max() <= bound * (1 + 1e-9)
        assert errors.max() > 0.6 * bound


@pytest.mark.parametrize("loop", LOOPS)
def test_fewer_knots_long_ago_cost_nothing(loop):
    """Theorem 1, sampled: a knot at every tick gives the same bound to 0.01 %."""
    for weights in b.sampled_weights(PAPER, *X, loop):
        n = len(weights.eps)
        every = worst_disturbance(weights.eps, 0.05, np.full(n - 1, 0.5 * loop.period))
        bound = b.sampled_worst_case(weights, loop, 0.05, 0.5).bound
        assert bound == pytest.approx(float(weights.eps @ every), rel=1e-4)
        assert bound <= 0.05 * weights.peak + 0.5 * weights.rate_peak


@pytest.mark.parametrize(
    ("gains", "period", "lag", "cutoff", "zmp", "com"),
    [
        (X, 0.005, 0.02, 1.0, 0.072, 0.0140),
        (X, 0.005, 0.02, 2.0, 0.116, 0.0151),
        (X, 0.001, 0.01, 5.0, 0.147, None),
        (Y, 0.005, 0.02, 1.0, 0.075, 0.0250),
        (Y, 0.005, 0.02, 2.0, 0.089, None),
    ],
)
def test_known_worst_cases(gains, period, lag, cutoff, zmp, com):
    """Theorem 1, sampled: values known elsewhere.

    For the ZMP they are the mean over a tick: half a tick's jump of u above the value
    at the tick, by up to 8 %.
    """
    loop = SampledLoop(
        period=period, servo_lag=lag, zmp_cutoff=cutoff, analog_filter=True
    )
    found = [
        b.sampled_worst_case(w, loop, 0.05, 0.5).bound
        for w in b.sampled_weights(PAPER, *gains, loop)
    ]
    assert 0.92 * zmp < found[1] < zmp
    if com is not None:
        assert found[0] == pytest.approx(com, abs=6e-5)


def test_short_periods_tend_to_the_ideal_loop():
    """Theorem 1: the CoM's bound is that of the ideal loop when nothing is late."""
    loop = SampledLoop(period=1e-3, servo_lag=2e-3, zmp_cutoff=1.0, delay=0)
    com, _ = b.sampled_weights(PAPER, *Y, loop)
    assert b.sampled_worst_case(com, loop, 0.05, 50.0).bound == pytest.approx(
        0.0250, rel=5e-3
    )


@pytest.mark.parametrize("mode", [None, 6.0])
@pytest.mark.parametrize("dead_time", [0.0, 0.003])
def test_a_constant_disturbance_shifts_com_and_zmp_alike(mode, dead_time):
    """Eqs. (35), (36): at rest e_c = e_p = -eps / (k_c - k_p), sampled too."""
    loop = SampledLoop(dead_time=dead_time, mode_frequency=mode, zmp_cutoff=2.0)
    for weights in b.sampled_weights(PAPER, *Y, loop):
        assert weights.eps.sum() == pytest.approx(-1.0 / (Y[1] - Y[0]), rel=1e-4)


def test_bounds_that_do_not_exist():
    with pytest.raises(ParameterError, match="no bound"):
        b.sampled_weights(PAPER, 7.0, 6.6, SampledLoop())
    with pytest.raises(ParameterError, match="no bound"):
        b.sampled_weights(PAPER, 6.59999, 6.6, SampledLoop(zmp_cutoff=1.0))
    com, _ = b.sampled_weights(PAPER, *Y, SampledLoop())
    with pytest.raises(ParameterError, match="a must be"):
        b.sampled_worst_case(com, SampledLoop(), -0.1, 0.5)
