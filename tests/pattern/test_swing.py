"""The path of the swing foot: smooth, soft, vertical at both ends."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comwalk.pattern.footsteps import Foothold
from comwalk.pattern.phases import wrapped
from comwalk.pattern.records import PHASE, REFERENCE
from comwalk.pattern.reference import (
    VERTICAL_SHARE,
    FootMotion,
    fill_feet,
    minimum_jerk,
    reference_of,
)

HOLDS = st.builds(
    Foothold, st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-9.0, 9.0)
)
START, END = Foothold(0.1, -0.09, 0.2), Foothold(0.5, -0.05, -0.3)


def swing_foot(
    start: Foothold, end: Foothold, height: float, duration: float, time: float
) -> FootMotion:
    """Return the left foot of a phase in which it swings, as the kernel has it."""
    piece, reference = np.zeros(1, PHASE)[0], np.zeros(1, REFERENCE)[0]
    piece["duration"], piece["swinging"], piece["clearance"] = duration, 0, height
    piece["resting"][0] = start.x, start.y, start.yaw
    turn = wrapped(end.yaw - start.yaw)
    piece["travel"] = end.x - start.x, end.y - start.y, turn
    fill_feet(piece, time, reference)
    return reference_of(reference).left


def state(foot: FootMotion) -> np.ndarray:
    return np.array([*foot.position, foot.yaw])


def rate(foot: FootMotion) -> np.ndarray:
    return np.array([*foot.velocity, foot.yaw_rate])


@given(HOLDS, HOLDS, st.floats(0.0, 0.2), st.floats(0.1, 2.0))
def test_ends_are_the_footholds_at_rest(start, end, height, duration):
    begin, final = (swing_foot(start, end, height, duration, t) for t in (0, duration))
    np.testing.assert_allclose(begin.position, [start.x, start.y, 0.0], atol=0)
    np.testing.assert_allclose(final.position, [end.x, end.y, 0.0], atol=1e-15)
    assert math.remainder(final.yaw - end.yaw, math.tau) == pytest.approx(0, abs=1e-12)
    assert not rate(begin).any()
    assert not rate(final).any()


@given(HOLDS, HOLDS, st.floats(0.01, 0.99))
def test_velocity_is_the_derivative(start, end, s):
    h = 1e-6
    before, after = (swing_foot(start, end, 0.05, 1.0, s + d) for d in (-h, h))
    here = swing_foot(start, end, 0.05, 1.0, s)
    difference = (state(after) - state(before)) / (2 * h)
    np.testing.assert_allclose(rate(here), difference, atol=2e-8)


def test_path_is_twice_continuously_differentiable():
    """No jump of the acceleration anywhere, the ends and the 5 % marks included."""
    t = np.linspace(0.0, 0.8, 20001)
    v = np.array([rate(swing_foot(START, END, 0.04, 0.8, x)) for x in t])
    a = np.diff(v, axis=0) / (t[1] - t[0])
    assert np.abs(np.diff(a, axis=0)).max() < 0.02
    assert np.abs(a).max() > 1.0


def test_foot_leaves_and_lands_vertically_and_clears_in_the_middle():
    for t in (0.999 * VERTICAL_SHARE, 1.0 - 0.999 * VERTICAL_SHARE):
        foot = swing_foot(START, END, 0.04, 1.0, t)
        assert not foot.velocity[:2].any()
        assert foot.position[2] > 0.0
    assert swing_foot(START, END, 0.04, 1.0, 0.5).position[2] == pytest.approx(0.04)


def test_height_is_never_negative_nor_above_the_clearance():
    z = [
        swing_foot(START, END, 0.04, 1.0, t).position[2] for t in np.linspace(0, 1, 301)
    ]
    assert min(z) == 0.0
    assert max(z) <= 0.04 + 1e-15


def test_zero_step_goes_straight_up_and_down():
    for t in np.linspace(0.0, 0.8, 9):
        foot = swing_foot(START, START, 0.04, 0.8, t)
        assert foot.position[:2].tolist() == [START.x, START.y]
        assert foot.yaw == START.yaw
        assert foot.yaw_rate == 0.0


@pytest.mark.parametrize("turn", [math.pi, -math.pi])
def test_half_turn_is_exact(turn):
    start, end = Foothold(0, 0, 0.0), Foothold(0, 0, turn)
    assert swing_foot(start, end, 0.04, 1.0, 0.5).yaw == turn / 2
    assert swing_foot(start, end, 0.04, 1.0, 1.0).yaw == turn


def test_yaw_goes_the_short_way():
    foot = swing_foot(Foothold(0, 0, 3.0), Foothold(0, 0, -3.0), 0.0, 1.0, 0.5)
    assert foot.yaw == pytest.approx(math.pi)
    assert foot.yaw_rate > 0.0


@given(st.floats(0.0, 1.0))
def test_minimum_jerk_is_symmetric_and_monotone(s):
    h, dh = minimum_jerk(s)
    assert h + minimum_jerk(1.0 - s)[0] == pytest.approx(1.0, abs=1e-14)
    assert dh >= 0.0
    assert minimum_jerk(-1.0) == (0.0, 0.0)
    assert minimum_jerk(2.0) == (1.0, 0.0)
