"""Designed gains: against the ideal formulas, margins and a simulation of the loop."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comwalk.certificates.certificate import certify
from comwalk.certificates.gain_check import check_gains
from comwalk.certificates.gain_design import DesignGoal, design
from comwalk.certificates.pole_placement import damping, natural_frequency
from comwalk.certificates.sampled_loop import (
    SampledLoop,
    sampled_loop_matrix,
    spectral_radius,
)
from comwalk.certificates.stability_margins import gain_limit, margins, zmp_sensitivity
from comwalk.control.gains import Gains
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

loops = st.builds(
    SampledLoop,
    period=st.sampled_from([0.001, 0.002, 0.005, 0.01]),
    servo_lag=st.floats(0.005, 0.06),
    delay=st.integers(1, 4),
)
pendulums = st.floats(0.3, 1.2).map(lambda height: Pendulum(height=height))


def simulated_sensitivity(
    pendulum: Pendulum, k_p: float, k_c: float, loop: SampledLoop, frequency: float
) -> float:
    """Swing the ZMP that the sensor feels in the time domain, and look what is left."""
    M = sampled_loop_matrix(pendulum, k_p, k_c, loop)
    alpha = 1.0 - math.exp(-2.0 * math.pi * (loop.zmp_cutoff or 0.0) * loop.period)
    tau, omega = loop.servo_lag, pendulum.omega
    x, left, rounds = np.zeros(len(M)), [], round(40.0 / loop.period)
    for n in range(rounds):
        d = math.cos(2.0 * math.pi * frequency * n * loop.period)
        c, v, f = x[:3]
        oldest = x[:3] if loop.delay == 0 else x[-2:]
        u = k_p * oldest[-1] - k_c * oldest[0]
        x = M @ x
        x[2] += alpha * d  # the filter feels it at the tick's end
        # the ZMP at the end of the tick, under the command that acted in it
        p = x[0] - (u - x[1]) / (tau * omega**2)
        left.append(p + d)
        del c, v, f
    tail = np.array(left[-round(1.0 / (frequency * loop.period)) :])
    return float(np.abs(tail).max())


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
def test_the_sensitivity_is_what_a_simulation_of_the_loop_leaves(frequency):
    loop, gains = SampledLoop(zmp_cutoff=2.0), (3.0, 6.6)
    told = zmp_sensitivity(Pendulum(), *gains, loop, frequency)
    found = simulated_sensitivity(Pendulum(), *gains, loop, frequency)
    assert found == pytest.approx(told, rel=2e-3)


def test_the_sensitivity_of_constant_errors_is_the_amplification():
    for k_p, k_c in ((3.0, 6.6), (1.8, 3.8), (0.5, 5.0)):
        S = zmp_sensitivity(Pendulum(), k_p, k_c, SampledLoop(), 1e-4)
        assert S == pytest.approx(k_c / (k_c - k_p), rel=1e-4)
    assert zmp_sensitivity(Pendulum(), 0.0, 3.0, SampledLoop(), 1.0) == 1.0


@given(pendulums, loops, st.floats(0.1, 5.0), st.floats(1.1, 5.0))
@settings(deadline=None, max_examples=40)
def test_the_gain_limit_is_where_the_loop_becomes_unstable(pendulum, loop, k_p, ratio):
    g = gain_limit(pendulum, k_p, ratio * k_p, loop)
    assert 0.0 < g < math.inf
    inside, outside = (
        spectral_radius(pendulum, x * g * k_p, x * g * ratio * k_p, loop)
        for x in (0.999, 1.001)
    )
    assert inside < 1.0 < outside


@given(pendulums, loops, st.floats(0.5, 1.5), st.sampled_from(["gait", "disturbance"]))
@settings(deadline=None, max_examples=12)
def test_designs_keep_what_they_are_to_keep(pendulum, loop, step_time, aim):
    goal = DesignGoal(aim=aim, step_time=step_time)
    gains, cutoff = design(pendulum, loop, goal)
    sampled = replace(loop, zmp_cutoff=cutoff)
    check_gains(gains, pendulum, sampled)
    for (k_p, _), (k_c, _) in (gains.walking, gains.standing):
        assert k_c / (k_c - k_p) < 1.01 * goal.amplification
        assert margins(pendulum, k_p, k_c, sampled).gain_up > 0.99 * goal.gain_margin
    (k_p, _), (k_c, _) = gains.standing
    assert damping(pendulum, k_p, k_c) > 0.99 * goal.standing_damping


@pytest.mark.parametrize("height", [0.4, 0.687, 0.95])
def test_a_design_leaves_less_of_a_steps_zmp_error_than_the_papers_gains(height):
    """The paper's gains, scaled, and with the filter at half of what is stable."""
    pendulum, loop = Pendulum(height=height), SampledLoop()
    f = pendulum.omega / Pendulum().omega
    step_time = 1.0 / f  # as gaits scale
    gains, cutoff = design(pendulum, loop, DesignGoal(step_time=step_time))
    ours = zmp_sensitivity(
        pendulum,
        gains.zmp[0],
        gains.com[0],
        replace(loop, zmp_cutoff=cutoff),
        1.0 / step_time,
    )
    for k_p, k_c in ((3.0, 6.6), (1.8, 3.8)):
        filtered = replace(loop, zmp_cutoff=4.0 * f)
        theirs = zmp_sensitivity(pendulum, f * k_p, f * k_c, filtered, 1.0 / step_time)
        assert ours < 0.85 * theirs


def test_no_other_gains_of_the_same_restraint_leave_less():
    """A coarse search over all three, with the same margins, finds no better."""
    pendulum, loop, goal = Pendulum(), SampledLoop(), DesignGoal()
    gains, cutoff = design(pendulum, loop, goal)

    def left(k_p: float, k_c: float, f_c: float) -> float:
        sampled = replace(loop, zmp_cutoff=f_c)
        return zmp_sensitivity(pendulum, k_p, k_c, sampled, 1.0)

    ours = left(gains.zmp[0], gains.com[0], cutoff)
    rng = np.random.default_rng(4)
    tried = 0
    for k_p, k_c, f_c in rng.uniform((0.2, 0.5, 0.3), (9.0, 14.0, 5.0), (300, 3)):
        if not k_p < k_c or k_c / (k_c - k_p) > goal.amplification:
            continue
        sampled = replace(loop, zmp_cutoff=f_c)
        if gain_limit(pendulum, k_p, k_c, sampled) >= goal.gain_margin:
            tried += 1
            assert left(k_p, k_c, f_c) > 0.99 * ours
    assert tried > 20


def test_the_aim_disturbance_survives_more_than_the_papers_gains():
    pendulum, loop = Pendulum(), SampledLoop()
    gains, cutoff = design(pendulum, loop, DesignGoal(aim="disturbance"))
    worst = [
        certify(pendulum, g, replace(loop, zmp_cutoff=f_c)).axes[0].loop.zmp.bound
        for g, f_c in ((gains, cutoff), (Gains(), 4.0))
    ]
    assert worst[0] < 0.9 * worst[1]


@given(pendulums, st.floats(1.0, 6.0), st.floats(0.5, 1.5))
@settings(deadline=None, max_examples=25)
def test_poles_are_placed(pendulum, frequency, zeta):
    goal = DesignGoal(aim="poles", frequency=frequency, damping=zeta)
    gains, cutoff = design(pendulum, SampledLoop(), goal)
    k_p, k_c = gains.zmp[0], gains.com[0]
    assert natural_frequency(pendulum, k_p, k_c) == pytest.approx(frequency, rel=5e-3)
    assert damping(pendulum, k_p, k_c) == pytest.approx(zeta, rel=5e-3)
    sampled = SampledLoop(zmp_cutoff=cutoff)
    assert gain_limit(pendulum, k_p, k_c, sampled) > 0.99 * goal.gain_margin


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"aim": "gate"}, 'did you mean "gait"'),
        ({"aim": "poles", "damping": 0.7}, "needs a frequency and a damping"),
        ({"aim": "poles", "frequency": 3.0, "damping": -1.0}, "damping"),
        ({"step_time": 0.0}, "step_time"),
        ({"amplification": 1.0}, "amplification"),
        ({"gain_margin": math.nan}, "gain_margin"),
    ],
)
def test_goals_out_of_range_are_refused(values, words):
    with pytest.raises(ParameterError, match=words):
        DesignGoal(**values)


def test_poles_that_the_loop_cannot_have_are_refused():
    goal = DesignGoal(aim="poles", frequency=30.0, damping=0.1)
    slow = SampledLoop(period=0.02, delay=20)
    with pytest.raises(ParameterError, match="no gains have a gain margin of 3"):
        design(Pendulum(), slow, goal)
