"""A pattern made without objects is the pattern."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_lookup import GAITS, STYLES

from comwalk.errors import PlanError
from comwalk.pattern import records as rows
from comwalk.pattern.footsteps import Foothold, Footstep, FootstepPlan, Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum
from comwalk.pattern.phases import plan_table
from comwalk.pattern.reference import fill_reference
from comwalk.pattern.regular_steps import plan_segments, plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.sides import Side


def row_at(table: np.ndarray, pendulum: Pendulum, time: float) -> np.ndarray:
    row = np.zeros(rows.ROW_SIZE)
    fill_reference(table, pendulum.omega, pendulum.height, time, row)
    return row


def same(plan: FootstepPlan, pendulum: Pendulum = PAPER_PENDULUM) -> None:
    pattern, table = make_pattern(plan, pendulum), plan_table(plan, pendulum)
    assert table.shape == pattern.table.shape
    starts = slice(rows.START, rows.DURATION + 1)
    np.testing.assert_allclose(table[:, starts], pattern.table[:, starts], atol=1e-12)
    for k, span in enumerate(pattern.phases):  # junctions may differ by rounding
        for share in (0.0, 0.01, 0.3, 0.5, 0.77, 1.0):
            time = span.start + share * span.duration
            a = row_at(pattern.table[k : k + 1], pendulum, time)
            b = row_at(table[k : k + 1], pendulum, time)
            np.testing.assert_allclose(b, a, rtol=1e-10, atol=1e-10)


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
    table, pattern = (
        plan_table(plan, PAPER_PENDULUM),
        make_pattern(plan, PAPER_PENDULUM),
    )
    curves = slice(rows.CURVE_X, rows.INVERSE_SINH)
    np.testing.assert_allclose(table[:, curves], pattern.table[:, curves], atol=1e-9)


def test_no_steps_and_the_same_foot_twice():
    feet = {"left": Foothold(0.0, 0.1, 0.1), "right": Foothold(0.0, -0.1)}
    steps = [Footstep(side=Side.LEFT, x=x, y=0.1, stand=0.4) for x in (0.1, 0.2)]
    same(FootstepPlan(**feet))
    same(FootstepPlan(**feet, steps=tuple(steps)))


def test_a_short_minjerk_is_refused_as_by_the_reference():
    gait = Gait(transfer_time=0.01, double_support="minjerk")
    with pytest.raises(PlanError, match="too short"):
        plan_table(plan_steps(gait, 3), PAPER_PENDULUM)


def test_between_phases_too():
    """One lookup over the whole table, not phase by phase."""
    plan = plan_steps(Gait(turn=0.1, half_width=0.12), 4)
    pattern, table = (
        make_pattern(plan, PAPER_PENDULUM),
        plan_table(plan, PAPER_PENDULUM),
    )
    for time in np.linspace(-1.0, pattern.duration + 1.0, 997):
        a, b = (row_at(t, PAPER_PENDULUM, time) for t in (pattern.table, table))
        np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-12)
