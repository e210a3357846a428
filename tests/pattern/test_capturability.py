"""Bounds of pushes: against linear programs that choose ZMP and footholds freely."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from comwalk.errors import ParameterError
from comwalk.pattern.capturability import (
    PHASES,
    Stepping,
    capture_limits,
    largest_push,
    lengths,
)
from comwalk.pattern.footsteps import Foothold, FootstepPlan, Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern

SOLE = 0.24, 0.13
FAST = Stepping(forward=0.5, aside=0.4, beside=0.15, foot_speed=40.0)
OMEGA = PAPER_PENDULUM.omega
PATTERN = make_pattern(plan_steps(Gait(), 6, sole_size=SOLE), PAPER_PENDULUM)


def farthest(steps: int, half: float, ranges: list[tuple[float, float]]) -> float:
    """Return the largest DCM from the first sole's centre that N steps can catch.

    Unknown are the DCM at the start, and for each step the ZMP and where it goes, in
    the range of its place in the list, seen from the sole before.
    """
    growth = math.exp(OMEGA * FAST.least_time)
    # DCM from the sole: x_{k+1} = p_k + (x_k - p_k) growth - l_k; |p_k|, |x_N| <= half.
    count = 1 + 2 * steps
    last = np.zeros(count)
    last[0] = growth**steps
    for k in range(steps):
        after = growth ** (steps - 1 - k)
        last[1 + 2 * k], last[2 + 2 * k] = (1.0 - growth) * after, -after
    bounds = [(None, None)]
    for k in range(steps):
        bounds += [(-half, half), ranges[k % len(ranges)]]
    goal = np.zeros(count)
    goal[0] = -1.0
    ends = np.array([last, -last]), np.array([half, half])
    found = linprog(goal, *ends, bounds=bounds)
    assert found.success
    return -float(found.fun)


@pytest.mark.parametrize("steps", [0, 1, 2, 5])
def test_limits_are_those_of_the_best_zmp_and_footholds(steps):
    ahead, inward, outward = capture_limits(PAPER_PENDULUM, SOLE, FAST, steps)
    assert ahead == pytest.approx(farthest(steps, 0.12, [(-0.5, 0.5)]), rel=1e-6)
    # Inward is positive for the first sole; for the next one it is the other way.
    inside, outside = (0.15, 0.4), (-0.4, -0.15)
    for found, ranges in ((inward, [inside, outside]), (outward, [outside, inside])):
        best = max(farthest(n, 0.065, ranges) for n in range(steps + 1))
        assert found == pytest.approx(best, rel=1e-6)


def test_a_foot_from_behind_takes_its_time():
    """By trying steps at random: none is better, and the best come near."""
    slow = Stepping(forward=0.5, foot_speed=1.5)
    ahead, _, _ = capture_limits(PAPER_PENDULUM, SOLE, slow, 3)
    random, h, best = np.random.default_rng(0), 0.12, 0.0
    for _ in range(20000):
        steps, behind, gone, reached = random.uniform(0.0, 0.5, 3), 0.5, 0.0, h
        for length in steps:
            gone += max((length + behind) / slow.foot_speed, slow.least_time)
            reached += length * math.exp(-OMEGA * gone)
            behind = length
        best = max(best, reached)
    assert best <= ahead[-1] + 1e-9
    assert best > 0.98 * ahead[-1]
    assert np.all(np.diff(ahead) <= 0.0)
    assert lengths(slow)[-1] == slow.forward


def survives(push: float, share: float) -> bool:
    """Return whether a step can catch a push ahead, by integrating the pendulum."""
    spans = [s for s in PATTERN.phases if s.phase is Phase.SINGLE_LEFT]
    span = spans[1]
    now = PATTERN.at(span.start + share * span.duration)
    sole, limit = now.left.position[0], farthest(7, 0.12, [(-0.5, 0.5)])
    start = [float(now.com[0]), float(now.com_velocity[0])]
    for T in np.linspace(max(FAST.least_time - share * span.duration, 0.1), 1.6, 60):
        end = start
        for begin, stop, force in ((0.0, 0.1, push / 0.1), (0.1, T, 0.0)):
            if stop > begin:
                found = solve_ivp(
                    lambda _, x, f=force: [
                        x[1],
                        OMEGA**2 * (x[0] - sole - 0.12) + f,
                    ],
                    (begin, stop),
                    end,
                    rtol=1e-9,
                    atol=1e-12,
                )
                end = found.y[:, -1].tolist()
        if end[0] + end[1] / OMEGA - sole <= FAST.forward + limit:
            return True
    return False


def test_the_largest_push_ahead_is_just_caught():
    """The ZMP at the front edge, the longest step, at the best time."""
    most = largest_push(PATTERN, FAST).forward
    assert all(survives(0.99 * most, share) for share in PHASES)
    assert not all(survives(1.01 * most, share) for share in PHASES)


def test_bounds_grow_with_what_feet_can_do():
    usual = largest_push(PATTERN, Stepping())
    wide = largest_push(PATTERN, Stepping(aside=0.6, beside=0.14))
    quick = largest_push(PATTERN, Stepping(least_time=0.2, foot_speed=3.0))
    assert wide.inward > usual.inward
    assert wide.outward > usual.outward
    for name in ("forward", "back", "inward", "outward"):
        assert getattr(quick, name) >= getattr(usual, name)
    # The walk goes forward, so that a push back is easier; outward nothing can be done
    # but to hasten, by less than the foot beside it is far.
    assert usual.back > usual.forward > usual.inward > usual.outward > 0.0


def test_left_and_right_are_alike():
    """The same walk that begins with the other foot, and one that is turned."""
    other = make_pattern(plan_steps(Gait(), 7, sole_size=SOLE), PAPER_PENDULUM)
    a, b = (largest_push(p, Stepping()) for p in (PATTERN, other))
    for name in ("forward", "back", "inward", "outward"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=2e-2)


def test_bad_numbers_are_refused():
    with pytest.raises(ParameterError, match=r"beside must be at most aside, 0\.1 m"):
        Stepping(aside=0.1)
    left, right = Foothold(0.0, 0.09), Foothold(0.0, -0.09)
    plan = FootstepPlan(left=left, right=right, sole_size=SOLE)
    standing = make_pattern(plan, PAPER_PENDULUM)
    with pytest.raises(ParameterError, match="no step that could be pushed"):
        largest_push(standing, Stepping())
