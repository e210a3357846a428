"""Footsteps, Fig. 2: regular walks, checks, plan files."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comwalk.errors import ParameterError, PlanError
from comwalk.pattern.footsteps import (
    PAPER_GAIT,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
    foot_poses,
    shortest_turn,
)
from comwalk.pattern.placement import MAX_TOE
from comwalk.pattern.plan_files import load_plan
from comwalk.pattern.plans import plan_segments, plan_steps
from comwalk.pattern.polygon import convex_hull, polygon_margin, rectangle
from comwalk.sides import Side

LEFT, RIGHT = Foothold(0.0, 0.09), Foothold(0.0, -0.09)


def step(side, x, y, yaw=0.0, **given):
    return Footstep(side=side, x=x, y=y, yaw=yaw, **given)


def build(kind: Any, defaults, given):
    return kind(**{**defaults, **given})


def plan(*steps, **given):
    return FootstepPlan(left=LEFT, right=RIGHT, steps=steps, **given)


def soles_are_apart(a, b, size):
    """Two convex sets are apart iff 0 is not in their Minkowski difference."""
    p, q = (rectangle(*pose, size) for pose in (a, b))
    difference = convex_hull((p[:, None] - q[None]).reshape(-1, 2))
    return polygon_margin(difference, (0.0, 0.0)) < 0.0


def body_end(walk):
    """Middle of the feet and mean heading at the end."""
    return foot_poses(walk)[-1].mean(axis=0)


# Sides, poses, angles.


def test_sides():
    assert Side.LEFT == "left"
    assert Side.LEFT.other is Side.RIGHT
    assert Side.RIGHT.other is Side.LEFT
    assert (Side.LEFT.sign, Side.RIGHT.sign) == (1.0, -1.0)


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_shortest_turn_ends_at_the_same_direction(a, b):
    turn = shortest_turn(a, b)
    assert abs(turn) <= math.pi
    assert math.cos(a + turn) == pytest.approx(math.cos(b), abs=1e-12)
    assert math.sin(a + turn) == pytest.approx(math.sin(b), abs=1e-12)


def test_shortest_turn_of_a_half_turn_is_exact():
    assert shortest_turn(0.0, math.pi) == math.pi
    assert shortest_turn(0.0, math.tau) == 0.0


@given(*[st.floats(-3, 3)] * 6)
def test_compose_is_the_product_of_homogeneous_matrices(x, y, a, u, v, b):
    def matrix(f):
        c, s = math.cos(f.yaw), math.sin(f.yaw)
        return np.array([[c, -s, f.x], [s, c, f.y], [0, 0, 1]])

    f, g = Foothold(x, y, a), Foothold(u, v, b)
    np.testing.assert_allclose(matrix(f.compose(g)), matrix(f) @ matrix(g), atol=1e-12)


# Regular walks.


def test_paper_walk():
    """Fig. 2: footprint k at x = 2 B k, y = -+A; 20 steps are 4.0 m."""
    walk = plan_steps(PAPER_GAIT, 20)
    assert (walk.count, walk.closing, len(walk.steps)) == (20, 1, 21)
    for k, footstep in enumerate(walk.steps[:-1], 1):
        assert footstep.x == pytest.approx(0.2 * k, abs=1e-14)
        assert footstep.y == pytest.approx(-0.09 if k % 2 else 0.09)
        assert footstep.side == ("right" if k % 2 else "left")
        assert footstep.single_support == pytest.approx(0.8)
        assert footstep.double_support == pytest.approx(0.2)
    assert body_end(walk) == pytest.approx([4.0, 0.0, 0.0], abs=1e-13)


@given(
    B=st.floats(-0.15, 0.15),
    lateral=st.floats(-0.1, 0.1),
    turn=st.floats(-0.3, 0.3),
    n=st.integers(1, 12),
)
def test_regular_walks_never_collide_and_end_parallel(B, lateral, turn, n):
    gait = Gait(half_step=B, lateral=lateral, turn=turn, half_width=0.13)
    walk = plan_steps(gait, n)
    poses = foot_poses(walk)
    for left, right in poses:
        assert soles_are_apart(left, right, walk.sole_size)
    left, right = poses[-1]
    assert left[2] == pytest.approx(right[2], abs=1e-8)
    assert np.hypot(*(left - right)[:2]) == pytest.approx(0.26, abs=1e-8)
    assert left[2] == pytest.approx(n * turn, abs=1e-8)


@pytest.mark.parametrize("n", [1, 2, 3, 8])
@pytest.mark.parametrize("lateral", [0.1, -0.1])
def test_side_steps_shift_the_body_by_lateral_per_step(lateral, n):
    walk = plan_steps(Gait(half_step=0.0, lateral=lateral), n)
    assert body_end(walk)[:2] == pytest.approx([0.0, n * lateral], abs=1e-12)
    assert walk.steps[0].side == ("left" if lateral > 0 else "right")
    assert walk.closing == n % 2
    for left, right in foot_poses(walk):
        assert left[1] - right[1] >= 0.18 - 1e-12


def test_side_steps_may_start_with_the_trailing_foot():
    walk = plan_steps(Gait(half_step=0.0, lateral=0.1), 4, first=Side.RIGHT)
    assert body_end(walk)[1] == pytest.approx(0.4)


def test_backward_walk_mirrors_the_forward_one():
    forward, back = (foot_poses(plan_steps(Gait(half_step=b), 5)) for b in (0.1, -0.1))
    np.testing.assert_allclose(back[..., 0], -forward[..., 0], atol=1e-14)
    np.testing.assert_allclose(back[..., 1], forward[..., 1], atol=1e-14)


def test_right_turn_mirrors_the_left_turn():
    left, right = (foot_poses(plan_steps(Gait(turn=a), 7)) for a in (0.2, -0.2))
    mirror = np.array([1.0, -1.0, -1.0])
    np.testing.assert_allclose(right, left[:, ::-1] * mirror, atol=1e-13)


def test_a_full_circle_closes():
    """2 pi / n of turn per step brings the body back; the yaw keeps its turns."""
    walk = plan_steps(Gait(turn=math.tau / 24, half_step=0.08), 24)
    assert body_end(walk) == pytest.approx([0.0, 0.0, math.tau], abs=1e-12)


def test_longest_double_support_leaves_a_tenth_of_a_second():
    walk = plan_steps(Gait(transfer_time=0.45), 2)
    assert walk.steps[0].single_support == pytest.approx(0.1)


@pytest.mark.parametrize("B", [0.2, -0.2])
def test_longest_step_is_accepted_whatever_the_rounding(B):
    assert plan_steps(Gait(half_step=B), 40).count == 40


def test_marching_in_place_needs_no_closing_step():
    walk = plan_steps(Gait(half_step=0.0), 4)
    assert (walk.count, walk.closing) == (4, 0)
    assert np.ptp(foot_poses(walk), axis=0).max() == 0.0


def test_foot_poses_never_jump_by_a_whole_turn():
    turned = plan(
        step("right", 0.0, -0.09, math.tau), step("left", 0.0, 0.09, -math.tau)
    )
    assert np.abs(foot_poses(turned)[..., 2]).max() < 1e-12


def test_segments_are_joined():
    straight, curve = Gait(), Gait(turn=0.15, period=1.2, stop_time=0.8)
    walk = plan_segments([(straight, 4), (curve, 6)])
    reference = plan_steps(straight, 4)
    assert walk.steps[:4] == reference.steps[:4]
    assert walk.count == 10
    assert walk.steps[4].single_support == pytest.approx(1.0)
    assert (walk.start_time, walk.stop_time) == (1.0, 0.8)
    assert body_end(walk)[2] == pytest.approx(0.9)


def test_the_same_foot_may_step_twice():
    walk = plan(
        step("left", 0.1, 0.1), step("left", 0.2, 0.1), step("right", 0.2, -0.09)
    )
    assert walk.count == 3


def test_words_and_integers_are_accepted():
    assert step("left", 1, 0).side is Side.LEFT
    assert isinstance(Gait(period=2).period, float)
    count: Any = np.int64(3)
    assert plan_steps(Gait(), count).count == 3


def test_a_plan_without_steps_stands():
    assert plan().count == 0


def test_closing_is_excluded_from_the_count():
    assert plan(step("right", 0.1, -0.09), closing=1).count == 0


# What cannot be walked.


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"period": 0.1}, "period must be a number in [0.15, 10] s, got 0.1"),
        ({"period": math.nan}, "period must be"),
        ({"transfer_time": 0.46}, "transfer_time must be a number in [0.002, 0.45] s"),
        ({"transfer_time": 0.0}, "transfer_time must be"),
        ({"half_step": 3.0}, "half_step must be a number in [-2, 2] m, got 3"),
        ({"half_width": 0.0}, "half_width must be"),
        ({"swing_height": -0.01}, "swing_height must be"),
        ({"start_time": 0.01}, "start_time must be"),
        ({"stop_time": math.inf}, "stop_time must be"),
        ({"stand_time": -1}, "stand_time must be"),
        ({"lateral": "left"}, "lateral must be a number in [-2, 2] m, got 'left'"),
        ({"turn": True}, "turn must be"),
        ({"double_support": "min-jerk"}, 'did you mean "minjerk"?'),
    ],
)
def test_bad_gaits_are_refused(given, text):
    with pytest.raises(ParameterError) as caught:
        Gait(**given)
    assert text in str(caught.value)


@pytest.mark.parametrize("count", [0, -1, 100_001, 2.0, True, "3", None])
def test_bad_counts_are_refused(count):
    with pytest.raises(
        ParameterError, match=r"steps must be a whole number in \[1, 100"
    ):
        plan_steps(Gait(), count)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"side": "lefft"}, 'did you mean "left"?'),
        ({"x": math.nan}, "x must be a number"),
        ({"yaw": math.inf}, "yaw must be a number"),
        ({"single_support": 0.0}, "single_support must be a number in [0.03, 10] s"),
        ({"double_support": 0.0}, "double_support must be a number in [0.001, 10] s"),
        ({"swing_height": 4.0}, "swing_height must be a number in [0, 3] m"),
    ],
)
def test_bad_footsteps_are_refused(given, text):
    with pytest.raises(ParameterError) as caught:
        build(Footstep, {"side": "left", "x": 0.0, "y": 0.0}, given)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("steps", "text"),
    [
        ([step("right", 0.9, -0.09)], "footstep 1 (right): swing foot travels 0.900 m"),
        ([step("left", 0.0, 0.75)], "footstep 1 (left): feet are 0.840 m apart"),
        (
            [step("right", 0.1, -0.09), step("left", 0.1, 0.3, 1.3)],
            f"footstep 2 (left): feet point 1.300 rad apart, more than {MAX_TOE:g} rad",
        ),
        (
            [step("right", 0.3, 0.15)],
            "footstep 1 (right): foot lands -0.060 m to its own",
        ),
        (
            [step("right", 0.05, -0.03)],
            "footstep 1 (right): soles meet: their gap is -0.010 m",
        ),
        (
            [step("left", -0.3, y) for y in (0.09, 0.0)] + [step("left", 0.3, 0.0)],
            "footstep 3 (left): soles meet: their gap is -0.040 m",
        ),
    ],
)
def test_steps_that_cannot_be_walked_are_named(steps, text):
    with pytest.raises(PlanError) as caught:
        plan(*steps)
    assert str(caught.value).startswith(text)


def test_turn_too_tight_is_refused_with_the_step():
    with pytest.raises(PlanError, match=r"footstep 1 \(left\): soles meet"):
        plan_steps(Gait(half_step=0.0, turn=0.6), 5)


def test_narrow_gait_is_refused_at_the_start():
    with pytest.raises(
        PlanError,
        match=r"the feet at the start: soles meet: their gap is -0\.01",
    ):
        plan_steps(Gait(half_width=0.06), 5)
    assert plan_steps(Gait(half_width=0.06), 5, sole_size=(0.2, 0.1)).count == 5


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"start_time": 0.0}, "start_time"),
        ({"stand_time": math.nan}, "stand_time"),
        ({"double_support": None}, "double_support"),
        ({"sole_size": (0.2, math.nan)}, "sole_size (width)"),
        ({"sole_size": 6.0}, "sole_size (length)"),
        ({"sole_size": (0.2, 0.1, 0.3)}, "sole_size must be one number or 2"),
        ({"closing": 1}, "closing must be a whole number in [0, 0]"),
        ({"steps": "left"}, "steps must be a tuple of Footstep"),
        ({"steps": [1]}, "footstep 1 must be a Footstep"),
        ({"left": (0, 1)}, "left must be a Foothold"),
        ({"left": Foothold(math.nan, 0.1)}, "left.x must be a number"),
    ],
)
def test_bad_plans_are_refused(given, text):
    with pytest.raises(ParameterError) as caught:
        build(FootstepPlan, {"left": LEFT, "right": RIGHT}, given)
    assert text in str(caught.value)


def test_crossed_feet_at_the_start_are_refused():
    with pytest.raises(PlanError, match="the feet at the start: foot lands"):
        FootstepPlan(left=RIGHT, right=LEFT)


@pytest.mark.parametrize(
    ("segments", "text"),
    [
        ([], "at least one segment"),
        ([(Gait(), 2), (Gait(), 0)], "segment 2: steps must be a whole number"),
        (
            [(Gait(), 2), (Gait(double_support="minjerk"), 2)],
            "segment 2: double_support",
        ),
        ([("walk", 2)], "gait must be a Gait"),
    ],
)
def test_bad_segments_are_refused(segments, text):
    with pytest.raises((ParameterError, PlanError), match=text):
        plan_segments(segments)


# Plan files.


def load(tmp_path, text):
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return load_plan(path)


def test_file_of_segments_equals_the_function(tmp_path):
    walk = load(
        tmp_path,
        """
        first = "left"
        sole_size = [0.2, 0.12]
        [gait]
        period = 1
        turn_deg = 5
        [[segment]]
        steps = 4
        turn = 0
        [[segment]]
        steps = 3
        half_step = -0.05
        """,
    )
    turn = math.radians(5)
    expected = plan_segments(
        [(Gait(), 4), (Gait(turn=turn, half_step=-0.05), 3)],
        first=Side.LEFT,
        sole_size=(0.2, 0.12),
    )
    assert walk == expected


def test_file_of_footsteps(tmp_path):
    walk = load(
        tmp_path,
        """
        left = { x = 0.0, y = 0.1 }
        [gait]
        transfer_time = 0.15
        double_support = "minjerk"
        [[footstep]]
        side = "right"
        x = 0.2
        y = -0.09
        yaw_deg = -10.0
        [[footstep]]
        side = "left"
        x = 0.2
        y = 0.1
        single_support = 0.6
        """,
    )
    assert walk.left == Foothold(0.0, 0.1)
    assert walk.right == RIGHT
    assert walk.double_support == "minjerk"
    assert walk.steps[0].yaw == pytest.approx(-math.pi / 18)
    assert [s.single_support for s in walk.steps] == pytest.approx([0.7, 0.6])
    assert walk.steps[0].double_support == pytest.approx(0.3)


SEGMENT = "[[segment]]\nsteps = 2\n"
FOOTSTEP = '[[footstep]]\nside = "right"\nx = 0.1\ny = -0.09\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "give either [[segment]] or [[footstep]] tables"),
        (SEGMENT + FOOTSTEP, "give either"),
        ("steps = 3", 'the file: unknown key "steps"'),
        (
            "[[segment]]\nstep = 3",
            '[[segment]] 1: unknown key "step"; did you mean "ste',
        ),
        ("[[segment]]\nperiod = 1.0", '[[segment]] 1: "steps" or "stand" is missing'),
        ("[[segment]]\nsteps = 2.5", "[[segment]] 1: steps must be a whole number"),
        (SEGMENT + "[[segment]]\nsteps = 0", "[[segment]] 2: steps must be a whole"),
        (SEGMENT + "half_step = 9", "[[segment]] 1: half_step must be a number in"),
        (SEGMENT + 'half_step = "a"', "[[segment]] 1: half_step must be a number in"),
        (SEGMENT + "turn_deg = nan", "[[segment]] 1: turn_deg must be a number"),
        (SEGMENT + "turn = 0.1\nturn_deg = 1", 'give "turn" or "turn_deg", not both'),
        (
            SEGMENT + "[gait]\nperoid = 1",
            '[gait]: unknown key "peroid"; did you mean "p',
        ),
        ('first = "up"\n' + SEGMENT, 'first must be "left" or "right"'),
        ("segment = 3", "segment: write it as [[segment]] tables"),
        ("segment = [3]", "[[segment]] 1: must be a table"),
        ("gait = 3\n" + SEGMENT, "[gait]: must be a table"),
        ("left = {x = 0, y = 0.1}\n" + SEGMENT, '"left" is for [[footstep]]'),
        ('first = "left"\n' + FOOTSTEP, '"first" is for [[segment]]'),
        ("left = {z = 0}\n" + FOOTSTEP, '"left": unknown key "z"'),
        ('left = {x = "a"}\n' + FOOTSTEP, "left.x must be a number"),
        ('[[footstep]]\nside = "left"\nx = 1', '[[footstep]] 1: "y" is missing'),
        (FOOTSTEP + "yaw = inf", "[[footstep]] 1: yaw must be a number"),
        (
            FOOTSTEP.replace("0.1", "2"),
            "footstep 1 (right): swing foot travels 2.000 m",
        ),
        ("sole_size = 6\n" + SEGMENT, "sole_size (length) must be"),
        ("[[segment", "not valid TOML"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(PlanError) as caught:
        load(tmp_path, text)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "plan.toml"))
    assert "\n" not in str(caught.value)


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(PlanError, match=r"none.toml: cannot be read: No such file"):
        load_plan(tmp_path / "none.toml")
    with pytest.raises(PlanError, match="cannot be read"):
        load_plan(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PlanError, match="not a text file"):
        load_plan(str(binary))


def test_values_cannot_change():
    gait: Any = PAPER_GAIT
    with pytest.raises(dataclasses.FrozenInstanceError):
        gait.period = 2.0


# ---- Pauses -----------------------------------------------------------------------

PAUSED = """
[[segment]]
steps = 3
[[segment]]
stand = 1.5
[[segment]]
steps = 2
half_step = 0.0
lateral = 0.05
"""


def test_a_pause_brings_the_feet_together_and_starts_anew(tmp_path):
    plan = load(tmp_path, PAUSED)
    assert [step.stand for step in plan.steps[:-1]].count(None) == len(plan.steps) - 2
    k = next(i for i, step in enumerate(plan.steps) if step.stand is not None)
    assert (k, plan.steps[k].stand) == (3, 1.5)
    left, right = foot_poses(plan)[k + 1]
    assert left - right == pytest.approx([0.0, 0.18, 0.0])
    after = plan.steps[k + 1 :]
    assert after[0].side is Side.LEFT
    alone = plan_steps(Gait(half_step=0.0, lateral=0.05), 2)
    moves = [(s.side, round(s.x - left[0], 9), s.y) for s in after]
    assert moves == [(s.side, round(s.x, 9), s.y) for s in alone.steps]


def test_a_pause_needs_no_step_where_the_feet_are_together():
    marching = Gait(half_step=0.0)
    plan = plan_segments([(marching, 2), 0.5, (marching, 2)])
    assert len(plan.steps) == 4
    assert [step.stand for step in plan.steps] == [None, 0.5, None, None]
    assert plan.closing == 0


def test_footsteps_of_ones_own_may_pause(tmp_path):
    rows = [("right", 0.1, -0.09), ("left", 0.1, 0.09), ("right", 0.2, -0.09)]
    text = "".join(
        f'[[footstep]]\nside = "{s}"\nx = {x}\ny = {y}\n' for s, x, y in rows
    )
    plan = load(tmp_path, text.replace("y = 0.09", "y = 0.09\nstand = 2"))
    assert [step.stand for step in plan.steps] == [None, 2.0, None]


@pytest.mark.parametrize(
    ("segments", "message"),
    [
        ([(Gait(), 2), 1.0], "between steps"),
        ([1.0, (Gait(), 2)], "between steps"),
        ([(Gait(), 2), 1.0, 2.0, (Gait(), 1)], "between steps"),
        ([1.0], "at least one segment"),
        ([(Gait(), 2), -1.0, (Gait(), 1)], "segment 2: stand must be"),
        ([(Gait(), 2), math.nan, (Gait(), 1)], "segment 2: stand must be"),
        ([(Gait(), 2), "soon", (Gait(), 1)], "segment 2: stand must be"),
    ],
)
def test_pauses_that_make_no_sense_are_refused(segments, message):
    with pytest.raises((ParameterError, PlanError), match=message):
        plan_segments(segments)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stand = 1\nsteps = 2", '"stand" goes alone'),
        ('stand = "a"', "[[segment]] 2: stand must be a number"),
        ("stand = -1", "segment 2: stand must be a number in [0, 3600] s"),
    ],
)
def test_bad_pauses_in_files_are_refused(tmp_path, text, message):
    with pytest.raises(PlanError) as caught:
        load(tmp_path, PAUSED.replace("stand = 1.5", text))
    assert message in str(caught.value)
