"""The compiled lookup is the pattern, to the last digits."""

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable_pattern import ReadablePattern, readable_pattern

from comwalk.pattern import records as rows
from comwalk.pattern.footsteps import Foothold, Footstep, FootstepPlan, Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum
from comwalk.pattern.plans import plan_segments, plan_steps
from comwalk.pattern.reference import (
    FootMotion,
    Reference,
    fill_reference,
    reference_of,
)
from comwalk.pattern.walk_pattern import Pattern, make_pattern
from comwalk.sides import Side


def looked_up(pattern: Pattern, time: float) -> np.ndarray:
    """Return a record that was filled with rubbish before."""
    records, pendulum = np.zeros(1, rows.REFERENCE), pattern.pendulum
    records.view(np.uint8)[:] = 255
    fill_reference(pattern.table, pendulum.omega, pendulum.height, time, records[0])
    return records[0]


def numbers_of(reference: Reference) -> list[float]:
    """Return all numbers of a reference in the order of its fields."""
    numbers: list[float] = []
    for field in dataclasses.fields(reference):
        value = getattr(reference, field.name)
        if isinstance(value, FootMotion):
            numbers += [*value.position, value.yaw, *value.velocity, value.yaw_rate]
        elif isinstance(value, Side):
            numbers.append(value.sign)
        else:
            numbers += np.ravel(value).tolist()
    return numbers


@lru_cache(maxsize=4)
def expected_of(pattern: Pattern) -> ReadablePattern:
    """Return the same pattern by readable objects."""
    return readable_pattern(pattern.plan, pattern.pendulum)


def same(pattern: Pattern, time: float) -> None:
    """Compare every field of the two references."""
    expected = expected_of(pattern).at(time)
    found = reference_of(looked_up(pattern, time))
    if found.phase != expected.phase:  # a junction, which rounding moves
        gaps = [abs(span.start - time) for span in pattern.phases]
        assert min(gaps) < 1e-9
        return
    a, b = np.array(numbers_of(expected)), np.array(numbers_of(found))
    assert a.shape == b.shape
    assert (abs(a - b) <= 1e-9 * (1.0 + abs(a))).all(), (time, a - b)
    assert found.support == expected.support


def times_of(pattern: Pattern, shares: list[float]) -> list[float]:
    """Return every junction and its neighbours, and some times between and outside."""
    starts = [span.start for span in pattern.phases]
    near = [math.nextafter(t, way) for t in starts for way in (-1e9, 1e9)]
    middles = [span.start + 0.5 * span.duration for span in pattern.phases]
    inside = [share * pattern.duration for share in shares]
    ends = [-1.0, pattern.duration, pattern.duration + 7.0, 1e6]
    return [*starts, *near, *middles, *inside, *ends]


STYLES = st.sampled_from(("paper", "minjerk"))
SHARES = st.lists(st.floats(0.0, 1.0), max_size=20)
GAITS = st.builds(
    lambda T, share, B, turn, stand: Gait(
        period=T,
        transfer_time=share * (T / 2 - 0.05),
        half_step=B,
        half_width=0.15,
        turn=turn,
        stand_time=stand,
    ),
    st.floats(0.5, 2.0),
    st.floats(0.3, 1.0),
    st.floats(-0.15, 0.15),
    st.floats(-0.2, 0.2),
    st.sampled_from((0.0, 0.5)),
)


@settings(max_examples=60, deadline=None)
@given(GAITS, STYLES, st.integers(1, 6), SHARES, st.floats(0.3, 1.2))
def test_regular_walks(gait, style, steps, shares, height):
    gait = dataclasses.replace(gait, double_support=style)
    pendulum = Pendulum(height=height, inertia=0.1)
    pattern = make_pattern(plan_steps(gait, steps), pendulum)
    for time in times_of(pattern, shares):
        same(pattern, time)


@settings(max_examples=25, deadline=None)
@given(GAITS, STYLES, st.floats(0.0, 3.0), SHARES)
def test_curves_and_pauses(gait, style, pause, shares):
    straight = dataclasses.replace(gait, turn=0.0, lateral=0.03, double_support=style)
    curved = dataclasses.replace(gait, double_support=style)
    plan = plan_segments([(straight, 3), pause, (curved, 2), (straight, 2)])
    pattern = make_pattern(plan, PAPER_PENDULUM)
    for time in times_of(pattern, shares):
        same(pattern, time)


def test_footsteps_that_go_round_past_pi():
    """Yaws are continuous, and swings turn the short way."""
    gait = Gait(half_step=0.02, half_width=0.15, turn=0.5)
    pattern = make_pattern(plan_steps(gait, 16), PAPER_PENDULUM)
    for time in times_of(pattern, [0.3, 0.7]):
        same(pattern, time)


def test_no_steps_and_the_same_foot_twice():
    feet = {"left": Foothold(0.0, 0.1, 0.1), "right": Foothold(0.0, -0.1)}
    steps = [Footstep(side=Side.LEFT, x=x, y=0.1, stand=0.4) for x in (0.1, 0.2)]
    for plan in (FootstepPlan(**feet), FootstepPlan(**feet, steps=tuple(steps))):
        pattern = make_pattern(plan, PAPER_PENDULUM)
        for time in times_of(pattern, [0.3, 0.7]):
            same(pattern, time)


def test_rows_are_rewritten_whole():
    """No number of the tick before is left in a row."""
    pattern = make_pattern(plan_steps(Gait(), 3), PAPER_PENDULUM)
    old = looked_up(pattern, 2.3)
    fill_reference(pattern.table, PAPER_PENDULUM.omega, 0.687, 0.0, old)
    assert old == looked_up(pattern, 0.0)
    assert np.isfinite(numbers_of(reference_of(old))).all()


def test_table_cannot_be_written():
    table = make_pattern(plan_steps(Gait(), 1), PAPER_PENDULUM).table
    assert table.dtype == rows.PHASE
    with pytest.raises(ValueError, match="read-only"):
        table["start"][0] = 1.0
