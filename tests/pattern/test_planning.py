"""The kernels build the pattern that the readable objects do."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable_pattern import readable_pattern
from test_lookup import GAITS, STYLES, numbers_of

from comwalk.errors import PlanError
from comwalk.pattern.footsteps import Foothold, Footstep, FootstepPlan, Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum
from comwalk.pattern.phases import plan_table
from comwalk.pattern.plans import plan_segments, plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.sides import Side


def same(plan: FootstepPlan, pendulum: Pendulum = PAPER_PENDULUM) -> None:
    """Assert that the kernels build and fill what the readable pattern says."""
    pattern, expected = make_pattern(plan, pendulum), readable_pattern(plan, pendulum)
    assert [x[2:] for x in pattern.phases] == [x[2:] for x in expected.phases]
    ours, theirs = ([x[:2] for x in y.phases] for y in (pattern, expected))
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)
    for span in expected.phases:
        if span.duration < 1e-6:
            continue
        for share in (0.001, 0.01, 0.3, 0.49, 0.77, 0.999):  # junctions may differ
            time = span.start + share * span.duration
            ours, theirs = numbers_of(pattern.at(time)), numbers_of(expected.at(time))
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)


@settings(max_examples=40, deadline=None)
@given(GAITS, STYLES, st.integers(1, 7), st.floats(0.3, 1.2))
def test_regular_walks(gait, style, steps, height):
    gait = dataclasses.replace(gait, double_support=style)
    same(plan_steps(gait, steps), Pendulum(height=height, inertia=0.1))


@settings(max_examples=25, deadline=None)
@given(GAITS, STYLES, st.floats(0.0, 3.0))
def test_curves_and_pauses(gait, style, pause):
    straight = dataclasses.replace(gait, turn=0.0, lateral=0.03, double_support=style)
    curved = dataclasses.replace(gait, double_support=style)
    same(
        plan_segments(
            [(straight, 3), pause, (curved, 2), (straight, 2), 1.0, (curved, 1)]
        )
    )


def test_whole_turns_and_a_very_long_walk():
    same(plan_steps(Gait(half_step=0.02, half_width=0.15, turn=0.5), 16))
    plan = plan_steps(Gait(), 3000)
    pattern = make_pattern(plan, PAPER_PENDULUM)
    expected = readable_pattern(plan, PAPER_PENDULUM)
    for time in (3.3, 1500.7, 2999.9):
        ours, theirs = numbers_of(pattern.at(time)), numbers_of(expected.at(time))
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_no_steps_and_the_same_foot_twice():
    feet = {"left": Foothold(0.0, 0.1, 0.1), "right": Foothold(0.0, -0.1)}
    steps = [Footstep(side=Side.LEFT, x=x, y=0.1, stand=0.4) for x in (0.1, 0.2)]
    same(FootstepPlan(**feet))
    same(FootstepPlan(**feet, steps=tuple(steps)))


def test_a_short_minjerk_is_refused_as_by_the_reference():
    gait = Gait(transfer_time=0.01, double_support="minjerk")
    with pytest.raises(PlanError, match="too short"):
        plan_table(plan_steps(gait, 3), PAPER_PENDULUM)
