"""Accelerations of the feet are the rates of their velocities."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.records import REFERENCE
from comwalk.pattern.reference import (
    VERTICAL_SHARE,
    FootMotion,
    Phase,
    Reference,
    bend_of_minimum_jerk,
    minimum_jerk,
    record_of,
    reference_of,
)
from comwalk.pattern.walk_pattern import Pattern, make_pattern
from comwalk.sides import Side

H = 1e-5  # [s]
WALKS = {
    "ahead": Gait(half_step=0.12),
    "a curve": Gait(half_step=0.05, turn=0.25),
    "on the spot": Gait(half_step=0.0, turn=-0.3),
}
PATTERNS = {
    name: make_pattern(plan_steps(gait, 4), PAPER_PENDULUM)
    for name, gait in WALKS.items()
}
shares = st.floats(0.0, 1.0)


def rate(foot: FootMotion) -> np.ndarray:
    return np.array([*foot.velocity, foot.yaw_rate])


def bend(foot: FootMotion) -> np.ndarray:
    return np.array([*foot.acceleration, foot.yaw_acceleration])


def junctions(pattern: Pattern) -> np.ndarray:
    """Return times where the formula of a foot changes [s]."""
    starts = [span.start for span in pattern.phases]
    marks = [
        span.start + share * span.duration
        for span in pattern.phases
        for share in (VERTICAL_SHARE, 1.0 - VERTICAL_SHARE)
    ]
    return np.array([*starts, *marks, pattern.duration])


@pytest.mark.parametrize("name", WALKS)
@given(share=shares)
def test_accelerations_of_feet_are_the_rates_of_their_velocities(name, share):
    """At any time of a walk, for way, height and heading."""
    pattern = PATTERNS[name]
    t = share * pattern.duration
    assume(np.abs(junctions(pattern) - t).min() > 2 * H)
    before, here, after = (pattern.at(t + d) for d in (-H, 0.0, H))
    for side in Side:
        expected = (rate(after.foot(side)) - rate(before.foot(side))) / (2 * H)
        assert bend(here.foot(side)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", WALKS)
def test_swinging_feet_accelerate_and_others_rest(name):
    """By as much as the step asks for: 5.77 D / S^2 at most, for a way D in S."""
    pattern = PATTERNS[name]
    most = np.zeros(4)
    for t in np.linspace(0.0, pattern.duration, 2001):
        reference = pattern.at(t)
        swinging = {Phase.SINGLE_LEFT: Side.RIGHT, Phase.SINGLE_RIGHT: Side.LEFT}
        for side in Side:
            found = bend(reference.foot(side))
            if side is swinging.get(reference.phase):
                most = np.maximum(most, np.abs(found))
            else:
                assert not found.any()
    table = pattern.table[pattern.table["swinging"] >= 0]
    S = (1.0 - 2.0 * VERTICAL_SHARE) * table["duration"]
    peak = 10.0 / np.sqrt(3.0) / S**2
    expected = np.abs(table["travel"] * peak[:, None]).max(axis=0)
    assert most[[0, 1, 3]] == pytest.approx(expected, rel=1e-3, abs=1e-12)
    assert most[2] > 1.0
    assert most[:2].max() > 1.0 or name == "on the spot"
    assert most[3] > 0.3 or name == "ahead"


@pytest.mark.parametrize("name", WALKS)
def test_accelerations_do_not_jump(name):
    """Feet leave, and meet, the ground without."""
    pattern = PATTERNS[name]
    for t in junctions(pattern):
        before, after = (pattern.at(t + d) for d in (-1e-9, 1e-9))
        for side in Side:
            there = bend(before.foot(side))
            assert bend(after.foot(side)) == pytest.approx(there, abs=1e-5)


def test_a_step_is_the_double_integral_of_its_acceleration():
    """From rest to rest: the moments of order 0 and 1 of the acceleration."""
    pattern = PATTERNS["a curve"]
    piece = next(p for p in pattern.table if p["swinging"] >= 0)
    side = tuple(Side)[piece["swinging"]]
    # Exact for the polynomials between the marks.
    x, w = np.polynomial.legendre.leggauss(8)
    marks = np.array([0.0, VERTICAL_SHARE, 1.0 - VERTICAL_SHARE, 1.0])
    times, weights = [], []
    for low, high in pairwise(marks):
        times.extend((0.5 * (high - low) * (x + 1.0) + low) * piece["duration"])
        weights.extend(0.5 * (high - low) * w * piece["duration"])
    bends = [bend(pattern.at(piece["start"] + t).foot(side)) for t in times]
    speed = np.array(weights) @ bends
    travel = (np.array(weights) * (piece["duration"] - np.array(times))) @ bends
    assert speed == pytest.approx(np.zeros(4), abs=1e-12)
    expected = [*piece["travel"][:2], 0.0, piece["travel"][2]]
    assert travel == pytest.approx(expected, abs=1e-12)
    assert np.abs(expected).min(where=[True, False, False, True], initial=9.0) > 0.01


@given(s=st.floats(1e-3, 1.0 - 1e-3))
def test_the_bend_of_the_blend_is_the_slope_of_its_slope(s):
    h = 1e-5
    expected = (minimum_jerk(s + h)[1] - minimum_jerk(s - h)[1]) / (2 * h)
    assert bend_of_minimum_jerk(s) == pytest.approx(expected, abs=1e-7)


@given(s=shares)
def test_the_bend_of_the_blend_is_odd_about_its_middle(s):
    there = bend_of_minimum_jerk(1.0 - s)
    assert bend_of_minimum_jerk(s) == pytest.approx(-there, abs=1e-12)


@pytest.mark.parametrize("s", [-1.0, 0.0, 0.5, 1.0, 2.0])
def test_the_blend_is_straight_at_its_ends_and_in_the_middle(s):
    assert bend_of_minimum_jerk(s) == 0.0


def test_records_keep_accelerations():
    """From a reference to a record and back."""
    pattern = PATTERNS["a curve"]
    swing = next(s for s in pattern.phases if s.phase is Phase.SINGLE_LEFT)
    reference = pattern.at(swing.start + 0.3 * swing.duration)
    record = np.zeros(1, REFERENCE)[0]
    record_of(reference, record)
    assert record["feet"]["acceleration"][1].all()
    again: Reference = reference_of(record)
    for side in Side:
        assert np.array_equal(bend(again.foot(side)), bend(reference.foot(side)))
    assert bend(again.right).all()
