"""The pattern: Eqs. (4)-(13), and its form for any footsteps."""

import dataclasses
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_bvp, solve_ivp

from comwalk.errors import ParameterError, PlanError
from comwalk.pattern.closed_form import coefficients, paper_com, paper_zmp, transfer_zmp
from comwalk.pattern.footsteps import (
    PAPER_GAIT,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
    foot_poses,
    shortest_turn,
)
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum, state_matrices
from comwalk.pattern.plans import plan_segments, plan_steps
from comwalk.pattern.polygon import polygon_margin
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.sides import Side

OMEGA = PAPER_PENDULUM.omega
SOLE = (0.2, 0.12)
STYLES = ("paper", "minjerk")
FOOT = np.array([0.1, 0.09])

GOLDEN = {
    OMEGA: {
        "K": (0.02940505564082988, 0.02297677952541488),
        "C": (
            -0.07059494435917012,
            0.07781545664326768,
            -0.06702322047458512,
            0.06080412201224397,
        ),
        "c_mid": (0.1, 0.06180477293751663),
        "v_mid": (0.1237007435195597, 0.0),
        "v_td": (0.2940505564082988, 0.2297677952541488),
        "a_td": (-1.008058812465006, -0.9570564670388355),
        "a_mid_y": -0.4026130676607887,
    },
    math.sqrt(9.80665 / 0.687): {
        "K": (0.02940255615069639, 0.02297299591106451),
        "C": (
            -0.07059744384930361,
            0.07782213097691427,
            -0.06702700408893549,
            0.06080449222033488,
        ),
        "c_mid": (0.1, 0.06179657816921129),
        "v_mid": (0.1237191942700048, 0.0),
        "v_td": (0.2940255615069639, 0.2297299591106451),
        "a_td": (-1.007750251418884, -0.9567836530549625),
        "a_mid_y": -0.4025925570551734,
    },
    3.78: {
        "K": (0.02940962898391071, 0.02298370081749406),
        "C": (
            -0.07059037101608929,
            0.07780325128018706,
            -0.06701629918250594,
            0.06080344131612185,
        ),
        "c_mid": (0.1, 0.06181976082010529),
        "v_mid": (0.1236669868477177, 0.0),
        "v_td": (0.2940962898391071, 0.2298370081749406),
        "a_td": (-1.00862345722629, -0.9575556892393179),
        "a_mid_y": -0.4026505294980076,
    },
}
SAMPLES = [  # t, c_x, cdot_x, c_y, cdot_y at g = 9.81
    (0.2, 0.05441438186779, 0.2120738520964, 0.04166180700499, 0.1483690803728),
    (0.3, 0.07283649220232, 0.1607422570567, 0.05336186584415, 0.08841000378566),
    (0.9, 0.1705949443592, 0.2940505564083, 0.02297677952541, -0.2297677952541),
]

GAITS = st.builds(
    lambda T, share, A, B: Gait(
        period=T, transfer_time=share * (T / 2 - 0.05), half_width=A, half_step=B
    ),
    st.floats(0.4, 2.0),
    st.floats(0.05, 1.0),
    st.floats(0.05, 0.2),
    st.floats(-0.2, 0.2),
)


def pattern_of(gait=PAPER_GAIT, steps=6, **given):
    return make_pattern(plan_steps(gait, steps, **given), PAPER_PENDULUM)


def near(actual, expected, tolerance=1e-12):
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance)


# The paper's closed form.


@pytest.mark.parametrize("omega", GOLDEN)
def test_golden_coefficients(omega):
    """Eqs. (6)-(8), (11)-(13): golden numbers of the paper's gait."""
    golden = GOLDEN[omega]
    np.testing.assert_allclose(transfer_zmp(PAPER_GAIT, omega), golden["K"], rtol=1e-12)
    np.testing.assert_allclose(coefficients(PAPER_GAIT, omega), golden["C"], rtol=1e-12)


@pytest.mark.parametrize("omega", GOLDEN)
def test_golden_motion(omega):
    """Eqs. (5) and (10): golden numbers at t_d and T/2."""
    golden = GOLDEN[omega]
    middle, start = (paper_com(PAPER_GAIT, omega, t) for t in (0.5, 0.1))
    near(middle.position, golden["c_mid"])
    near(middle.velocity, golden["v_mid"])
    near(middle.acceleration[1], golden["a_mid_y"])
    near(start.velocity, golden["v_td"])
    near(start.acceleration, golden["a_td"])


@pytest.mark.parametrize("row", SAMPLES)
def test_golden_samples(row):
    """Eqs. (5) and (10): golden samples, 13 digits."""
    t, c_x, v_x, c_y, v_y = row
    motion = paper_com(PAPER_GAIT, OMEGA, math.nextafter(t, 0.0))
    near(motion.position, (c_x, c_y), 3e-13)
    near(motion.velocity, (v_x, v_y), 3e-13)


@given(GAITS, st.floats(2.0, 6.0))
def test_closed_form_is_continuous_and_periodic(gait, omega):
    """Eqs. (4)-(13): c, cdot join at t_d, T - t_d and T (2B ahead, y mirrored)."""
    T, t_d, B = gait.period, gait.transfer_time, gait.half_step
    h = 1e-13
    for t in (t_d, T - t_d):
        before, after = (paper_com(gait, omega, t + d) for d in (-h, h))
        near(before.position, after.position, 1e-11)
        near(before.velocity, after.velocity, 1e-11)
    end, begin = paper_com(gait, omega, T - h), paper_com(gait, omega, 0.0)
    near(end.position, begin.position + np.array([2 * B, 0.0]), 1e-11)
    near(end.velocity, begin.velocity * np.array([1.0, -1.0]), 1e-11)


@given(GAITS, st.floats(2.0, 6.0), st.floats(0.0, 0.999))
def test_closed_form_obeys_the_pendulum(gait, omega, share):
    """Eqs. (1), (2), (4), (5), (9), (10): p = c - cddot / omega_n^2."""
    t = share * gait.period
    c, _, a = paper_com(gait, omega, t)
    near(paper_zmp(gait, omega, t), c - a / omega**2)


def test_closed_form_takes_arrays():
    """Eqs. (4), (5), (9), (10): velocity and acceleration are derivatives."""
    t = np.linspace(0.0, 0.99, 60).reshape(6, 10)
    h = 1e-6
    motion = paper_com(PAPER_GAIT, OMEGA, t + h)
    assert motion.position.shape == (6, 10, 2)
    away = (np.abs(t[..., None] + h - [0.1, 0.9]).min(-1)) > 3 * h
    after, before = (paper_com(PAPER_GAIT, OMEGA, x) for x in (t + 2 * h, t))
    for k in (0, 1):
        difference = (after[k] - before[k]) / (2 * h)
        np.testing.assert_allclose(difference[away], motion[k + 1][away], atol=1e-8)


def test_limits_of_the_transfer_zmp():
    """Eqs. (8) and (13): t_d -> 0 gives the pendulum without double support."""
    gait = Gait(transfer_time=0.005)
    th = math.tanh(OMEGA / 2)
    K_x, K_y = transfer_zmp(gait, OMEGA)
    assert K_x / 0.005 == pytest.approx(0.1 * OMEGA / th, rel=0.02)
    assert K_y / 0.005 == pytest.approx(0.09 * OMEGA * th, rel=0.02)


@pytest.mark.parametrize("t", [-0.1, 1.0, math.nan, math.inf])
def test_closed_form_refuses_times_outside_the_step(t):
    for function in (paper_zmp, paper_com):
        with pytest.raises(
            ParameterError, match=r"time must be a number in \[0, 1\) s"
        ):
            function(PAPER_GAIT, OMEGA, np.array([0.2, t]))


# The pattern over a plan equals the closed form.


@pytest.mark.parametrize("steps", [30, 31])
def test_middle_of_a_walk_is_the_paper_pattern(steps):
    """Eqs. (4)-(13): the general plan reduces to them, x and y, both feet."""
    pattern = pattern_of(steps=steps)
    for k in (14, 15):
        origin = pattern.phases[2 + 2 * k].start + 0.1
        sign = np.array([1.0, 1.0 if k % 2 == 0 else -1.0])
        for t in np.arange(0.005, 1.0, 0.01):
            r = pattern.at(origin + t)
            paper = paper_com(PAPER_GAIT, OMEGA, t)
            shift = [0.2 * k - 0.1, 0.0]
            near(r.com[:2], sign * paper.position + shift)
            near(r.com_velocity[:2], sign * paper.velocity)
            near(r.com_acceleration[:2], sign * paper.acceleration)
            near(r.zmp, sign * paper_zmp(PAPER_GAIT, OMEGA, t) + shift)


@settings(max_examples=15)
@given(GAITS.filter(lambda gait: gait.period > 0.6), st.floats(0.3, 1.0))
def test_middle_of_any_regular_walk_has_the_transfer_zmp(gait, height):
    """Eqs. (8) and (13): K of the general plan."""
    pendulum = Pendulum(height=height)
    pattern = make_pattern(plan_steps(gait, 40, sole_size=(0.1, 0.05)), pendulum)
    span = pattern.phases[2 + 2 * 20]
    start, end = (
        pattern.at(t).com[:2] for t in (span.start, span.start + span.duration)
    )
    K = np.array(transfer_zmp(gait, pendulum.omega))
    near(np.abs(end - start) / 2, np.abs(K), 1e-11)


def test_influence_of_the_start_decays_per_step():
    """Deviation from the periodic pattern shrinks by 1/lambda = 0.0353 per step."""
    pattern = pattern_of(steps=30)
    K_y = transfer_zmp(PAPER_GAIT, OMEGA).y
    ends = [pattern.phases[2 + 2 * k] for k in range(1, 5)]
    e = [abs(abs(pattern.at(s.start + s.duration).com[1]) - K_y) for s in ends]
    np.testing.assert_allclose(np.array(e[1:]) / e[:-1], 0.0353, atol=1e-3)


def test_minjerk_steady_state_matches_an_integral():
    """The bounded CoM is the integral of the ZMP weighed by the Green function."""
    walk = plan_steps(Gait(double_support="minjerk"), 24)
    pattern = make_pattern(walk, PAPER_PENDULUM)
    t_0 = pattern.phases[2 + 2 * 12].start
    for t in (t_0, t_0 + 0.07, t_0 + 0.5):
        for i in (0, 1):

            def weighed(x, i=i, t=t):
                p = float(pattern.at(x).zmp[i])
                return 0.5 * OMEGA * math.exp(-OMEGA * abs(x - t)) * p

            spans = pattern.phases
            knots = [s.start for s in spans if abs(s.start - t) < 9.0] + [t]
            edges = sorted(set(knots))
            total = sum(
                quad(weighed, a, b, epsabs=1e-12)[0] for a, b in pairwise(edges)
            )
            assert pattern.at(t).com[i] == pytest.approx(total, abs=1e-7)


def test_minjerk_transfer():
    """K of the smooth double support: 0.03260 and 0.02612 m on the paper's gait."""
    pattern = pattern_of(Gait(double_support="minjerk"), steps=24)
    span = pattern.phases[2 + 2 * 12]
    ends = [pattern.at(t).com[:2] for t in (span.start, span.start + span.duration)]
    near(np.abs(ends[1] - ends[0]) / 2, [0.03260, 0.02612], 5e-6)


@pytest.mark.parametrize("style", STYLES)
def test_one_step_matches_a_boundary_value_solver(style):
    """Eq. (3): scipy's collocation, given the ZMP and both ends, finds the CoM."""
    pattern = pattern_of(Gait(double_support=style), steps=3)
    A, B = state_matrices(PAPER_PENDULUM)
    spans = pattern.phases
    for span in spans[3:6:2] if style == "paper" else spans[1:5]:
        a, b = span.start + 1e-12, span.start + span.duration - 1e-12
        ends = [pattern.at(t).com[1] for t in (a, b)]

        def rate(t, y):
            p = np.array([[pattern.at(x).zmp[1] for x in t]])
            return A @ y + B @ p

        def edge(ya, yb, ends=ends):
            return np.array([ya[0] - ends[0], yb[0] - ends[1]])

        t = np.linspace(a, b, 30)
        solution = solve_bvp(rate, edge, t, np.zeros((2, 30)), tol=1e-9)
        reference = pattern.sample(t)
        np.testing.assert_allclose(solution.sol(t)[0], reference.com[:, 1], atol=1e-8)
        np.testing.assert_allclose(
            solution.sol(t)[1], reference.com_velocity[:, 1], atol=1e-6
        )


def test_pendulum_driven_by_the_zmp_stays_on_the_pattern():
    """Eq. (3): integration of the unstable pendulum through a whole step."""
    pattern = pattern_of(Gait(double_support="minjerk", turn=0.1), steps=5)
    A, B = state_matrices(PAPER_PENDULUM)
    t_0, t_1 = pattern.phases[4].start, pattern.phases[6].start
    r_0, r_1 = pattern.at(t_0), pattern.at(t_1)
    for i in (0, 1):
        y = solve_ivp(
            lambda t, y, i=i: A @ y + B[:, 0] * pattern.at(t).zmp[i],
            (t_0, t_1),
            [r_0.com[i], r_0.com_velocity[i]],
            rtol=1e-9,
            atol=1e-11,
            max_step=0.05,
        ).y[:, -1]
        np.testing.assert_allclose(y, [r_1.com[i], r_1.com_velocity[i]], atol=1e-6)


# Consistency of any plan.

WALKS = {
    "straight": (Gait(), 5),
    "back": (Gait(half_step=-0.1), 4),
    "in place": (Gait(half_step=0.0), 4),
    "side": (Gait(half_step=0.0, lateral=0.06), 5),
    "turn": (Gait(half_step=0.0, turn=-0.35), 6),
    "curve": (Gait(half_step=0.08, turn=0.25), 7),
    "tiny transfer": (Gait(transfer_time=0.005), 4),
    "long transfer": (Gait(transfer_time=0.45), 4),
    "one step": (Gait(), 1),
    "fast": (Gait(period=0.6, transfer_time=0.06), 6),
    "no standing": (Gait(stand_time=0.0), 3),
}


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", WALKS)
def test_walks_are_consistent(name, style):
    """Eqs. (1), (2): the ZMP fits, c and cdot are continuous, the ZMP stays inside."""
    gait, steps = WALKS[name]
    fields = {**vars(gait), "double_support": style}
    walk = plan_steps(Gait(**fields), steps, sole_size=SOLE)
    if style == "minjerk" and name == "tiny transfer":
        with pytest.raises(PlanError, match="before footstep 1 is too short"):
            make_pattern(walk, PAPER_PENDULUM)
        return
    pattern = make_pattern(walk, PAPER_PENDULUM)
    times = np.linspace(-0.1, pattern.duration + 0.1, 701)
    assert pattern.zmp_residual(times) < 1e-12
    assert pattern.continuity_residual() < 1e-9
    least = 0.03 if name == "long transfer" else 0.05
    assert pattern.hull_margin(times).min() > least


RANDOM_STEPS = st.lists(
    st.tuples(
        st.floats(-0.15, 0.3),
        st.floats(-0.02, 0.05),
        st.floats(-0.25, 0.25),
        st.floats(0.4, 1.0),
        st.floats(0.06, 0.4),
    ),
    min_size=1,
    max_size=8,
)


@settings(max_examples=40)
@given(RANDOM_STEPS, st.sampled_from(STYLES), st.floats(0.6, 1.5), st.booleans())
def test_random_plans_are_consistent(moves, style, time, left_first):
    """Eqs. (1), (2) and (29): any plan; the ZMP stays 3 cm inside the soles."""
    side = Side.LEFT if left_first else Side.RIGHT
    feet = {s: Foothold(0.0, 0.11 * s.sign) for s in Side}
    start, steps = dict(feet), []
    for dx, dy, turn, S, D in moves:
        away = Foothold(dx, side.sign * (0.22 + dy), turn)
        hold = feet[side] = feet[side.other].compose(away)
        steps.append(
            Footstep(
                side=side,
                x=hold.x,
                y=hold.y,
                yaw=hold.yaw,
                single_support=S,
                double_support=D,
            )
        )
        side = side.other
    try:
        walk = FootstepPlan(
            left=start[Side.LEFT],
            right=start[Side.RIGHT],
            steps=tuple(steps),
            start_time=time,
            stop_time=time,
            double_support=style,
            sole_size=SOLE,
        )
    except PlanError:
        return
    pattern = make_pattern(walk, PAPER_PENDULUM)
    times = np.linspace(0.0, pattern.duration, 150)
    assert pattern.zmp_residual(times) < 1e-11
    assert pattern.continuity_residual() < 1e-9
    assert pattern.hull_margin(times).min() > 0.03
    com, feet = pattern.sample(times).com[:, :2], foot_poses(walk)[..., :2]
    assert (com >= feet.min(axis=(0, 1)) - 1e-9).all()
    assert (com <= feet.max(axis=(0, 1)) + 1e-9).all()


@pytest.mark.parametrize("style", STYLES)
def test_starts_and_stops_at_rest_in_the_middle_of_the_feet(style):
    pattern = pattern_of(Gait(double_support=style, turn=0.2), steps=5)
    poses = foot_poses(pattern.plan)
    h = 1e-7
    for t, k in ((0.5, 0), (pattern.duration - 0.5, -1)):
        for x in (t - h, t, t + h):
            r = pattern.at(x)
            near(r.com[:2], poses[k, :, :2].mean(axis=0))
            near(r.com_velocity, 0.0, 1e-9)
            near(r.com_acceleration, 0.0, 3e-5)
        near(pattern.at(t).com_acceleration, 0.0)


@pytest.mark.parametrize("style", STYLES)
def test_velocities_are_derivatives_everywhere(style):
    """Velocity, acceleration and rates against finite differences."""
    gait = Gait(double_support=style, turn=0.15, half_step=0.06)
    pattern = pattern_of(gait, steps=4)
    h = 1e-6
    edges = np.array([s.start for s in pattern.phases] + [pattern.duration])
    for t in np.linspace(0.01, pattern.duration - 0.01, 97):
        if np.abs(edges - t).min() < 2 * h:
            continue
        a, r, b = (pattern.at(x) for x in (t - h, t, t + h))
        near((b.com - a.com) / (2 * h), r.com_velocity, 1e-7)
        near((b.com_velocity - a.com_velocity) / (2 * h), r.com_acceleration, 2e-6)
        near((b.heading - a.heading) / (2 * h), r.heading_rate, 1e-7)
        for foot in Side:
            before, here, after = (getattr(x, foot) for x in (a, r, b))
            near((after.position - before.position) / (2 * h), here.velocity, 1e-7)
            near(shortest_turn(before.yaw, after.yaw) / (2 * h), here.yaw_rate, 1e-7)


# Phases, feet, loads, heading.


def test_phases_follow_each_other():
    """Fig. 2: supporting phases with their times."""
    pattern = pattern_of(Gait(stop_time=0.8), steps=2)
    kinds = [(s.phase, s.stance.value, round(s.duration, 12)) for s in pattern.phases]
    assert kinds == [
        (Phase.STAND, "left", 0.5),
        (Phase.START, "left", 1.0),
        (Phase.DOUBLE, "left", 0.2),
        (Phase.SINGLE_LEFT, "left", 0.8),
        (Phase.DOUBLE, "right", 0.2),
        (Phase.SINGLE_RIGHT, "right", 0.8),
        (Phase.DOUBLE, "left", 0.2),
        (Phase.SINGLE_LEFT, "left", 0.8),
        (Phase.DOUBLE, "left", 0.2),
        (Phase.STOP, "left", 0.8),
        (Phase.STAND, "left", 0.5),
    ]
    assert pattern.duration == pytest.approx(6.0)
    assert repr(pattern) == "Pattern(2 steps, 6 s)"


def test_at_a_junction_the_later_phase_counts():
    pattern = pattern_of(steps=3)
    for before, span in zip(pattern.phases, pattern.phases[1:], strict=False):
        assert pattern.at(span.start).phase is span.phase
        assert pattern.at(math.nextafter(span.start, 0.0)).phase is before.phase


def test_zmp_stays_at_the_stance_foot_in_single_support():
    """Eqs. (4) and (9): p = the centre of the stance sole."""
    pattern = pattern_of(Gait(turn=0.2), steps=4)
    for span in pattern.phases:
        if span.phase not in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
            continue
        for s in (0.0, 0.5, 0.999):
            r = pattern.at(span.start + s * span.duration)
            stance, swing = getattr(r, span.stance), getattr(r, span.stance.other)
            assert r.zmp.tolist() == stance.position[:2].tolist()
            assert stance.position[2] == 0.0
            assert not stance.velocity.any()
            assert (swing.position[2] > 0.0) == (s > 0.0)
            assert r.support is span.stance
            assert r.left_load == (1.0 if span.stance is Side.LEFT else 0.0)


def test_base_limb_changes_in_the_middle_of_double_support():
    pattern = pattern_of(steps=3)
    span = pattern.phases[4]
    middle = span.start + 0.5 * span.duration
    assert pattern.at(middle - 1e-6).support is Side.LEFT
    assert pattern.at(middle + 1e-6).support is Side.RIGHT
    assert pattern.at(middle).left_load == pytest.approx(0.5)


def test_minjerk_zmp_is_continuous_where_the_paper_one_jumps():
    """Eqs. (4) and (9): the ZMP jumps by foot - K; the smooth style does not."""
    jumps = {}
    for style in STYLES:
        pattern = pattern_of(Gait(double_support=style), steps=12)
        starts = [span.start for span in pattern.phases[1:]]
        jumps[style] = np.array(
            [pattern.at(t).zmp - pattern.at(math.nextafter(t, 0)).zmp for t in starts]
        )
    assert np.abs(jumps["minjerk"]).max() < 1e-9
    near(np.abs(jumps["paper"][14]), FOOT - transfer_zmp(PAPER_GAIT, OMEGA), 1e-9)


@pytest.mark.parametrize("style", STYLES)
def test_everything_is_continuous_over_the_whole_plan(style):
    """Feet, load, heading and its rate, walking: no jumps at any junction."""
    gait = Gait(double_support=style, turn=0.3, half_step=0.05)
    pattern = pattern_of(gait, steps=6)
    for span in pattern.phases:
        a, b = (pattern.at(span.start + d) for d in (-1e-9, 1e-9))
        for name in ("left_load", "heading", "heading_rate", "walking"):
            assert getattr(a, name) == pytest.approx(getattr(b, name), abs=1e-7)
        for side in Side:
            before, after = getattr(a, side), getattr(b, side)
            near(before.position, after.position, 1e-9)
            near(before.velocity, after.velocity, 1e-9)
            assert before.yaw == pytest.approx(after.yaw, abs=1e-9)


def test_heading_follows_the_mean_of_the_feet():
    pattern = pattern_of(Gait(turn=0.25, half_step=0.0), steps=6)
    poses = foot_poses(pattern.plan)
    spans = pattern.phases[3:-3:2]
    for k, span in enumerate(spans, 1):
        r = pattern.at(span.start + span.duration)
        assert r.heading == pytest.approx(poses[k, :, 2].mean(), abs=1e-12)
        assert r.step == k
    ends = pattern.at(0.0), pattern.at(pattern.duration)
    assert [r.heading for r in ends] == pytest.approx([0.0, 1.5])
    assert [r.heading_rate for r in ends] == [0.0, 0.0]
    headings = pattern.sample(np.linspace(0, pattern.duration, 400)).heading
    assert np.diff(headings).min() >= -1e-15
    middle = pattern.phases[2 + 2 * 3].start
    assert pattern.at(middle).heading_rate == pytest.approx(0.25, rel=1e-9)


def test_heading_keeps_turning_past_pi():
    pattern = pattern_of(Gait(turn=0.4, half_step=0.0), steps=20, sole_size=SOLE)
    assert pattern.at(99.0).heading == pytest.approx(8.0)
    h = pattern.sample(np.linspace(0, pattern.duration, 2000)).heading
    assert np.abs(np.diff(h)).max() < 0.01


def test_heading_of_feet_that_differ_by_whole_turns():
    left, right = Foothold(0, 0.09, math.tau + 0.1), Foothold(0, -0.09, -0.1)
    standing = make_pattern(FootstepPlan(left=left, right=right), PAPER_PENDULUM)
    assert math.remainder(standing.at(0.0).heading, math.tau) == pytest.approx(0.0)


def test_walking_blends_inside_start_and_stop():
    pattern = pattern_of(steps=2)
    spans = pattern.phases
    values = [pattern.at(s.start + 0.5 * s.duration).walking for s in spans]
    assert values == pytest.approx([0.0, 0.5, *[1.0] * (len(spans) - 4), 0.5, 0.0])


def test_standing_before_and_after():
    pattern = pattern_of(steps=2)
    before, after = pattern.at(-5.0), pattern.at(1e6)
    assert (before.phase, after.phase) == (Phase.STAND, Phase.STAND)
    assert (before.time, after.time) == (-5.0, 1e6)
    assert (before.left_load, after.left_load) == (0.5, 0.5)
    near(after.com, [0.4, 0.0, 0.687])
    near(after.zmp, [0.4, 0.0])
    assert not after.com_velocity.any()
    assert (before.step, after.step) == (0, 3)


def test_a_plan_without_steps_stands():
    feet: Any = {"left": Foothold(0.1, 0.1), "right": Foothold(0.1, -0.08)}
    pattern = make_pattern(FootstepPlan(**feet, stand_time=2.0), PAPER_PENDULUM)
    assert pattern.duration == 4.0
    r = pattern.at(3.0)
    near(r.com, [0.1, 0.01, 0.687])
    near(r.zmp, [0.1, 0.01])
    assert (r.phase, r.heading, r.walking) == (Phase.STAND, 0.0, 0.0)
    assert pattern.continuity_residual() == 0.0


def test_the_same_foot_may_step_twice():
    steps = [Footstep(side=Side.LEFT, x=x, y=0.1) for x in (0.1, 0.2)]
    feet: Any = {"left": Foothold(0.0, 0.09), "right": Foothold(0.0, -0.09)}
    for style in STYLES:
        walk = FootstepPlan(**feet, steps=tuple(steps), double_support=style)
        pattern = make_pattern(walk, PAPER_PENDULUM)
        times = np.linspace(0, pattern.duration, 300)
        assert pattern.hull_margin(times).min() > 0.05
        assert pattern.continuity_residual() < 1e-9


def test_support_polygon():
    pattern = pattern_of(steps=2, sole_size=SOLE)
    stand, single = pattern.support_polygon(0.0), pattern.support_polygon(2.0)
    expected = [(-0.1, -0.15), (0.1, -0.15), (0.1, 0.15), (-0.1, 0.15)]
    np.testing.assert_allclose(stand, expected, atol=1e-15)
    assert polygon_margin(single, (0.0, 0.09)) == pytest.approx(0.06)
    assert polygon_margin(single, (0.0, -0.09)) < 0.0
    times = np.linspace(0, pattern.duration, 100)
    one_by_one = [
        polygon_margin(pattern.support_polygon(t), pattern.at(t).zmp) for t in times
    ]
    assert pattern.hull_margin(times).tolist() == one_by_one


def test_start_keeps_the_zmp_near_the_middle():
    """The quintic start of 1 s moves the ZMP as little as the pattern needs."""
    samples = pattern_of(steps=8).sample(np.linspace(0.5, 1.4999, 400))
    near(samples.zmp.min(axis=0), [-0.0005, -0.0053], 1e-4)
    near(samples.zmp.max(axis=0), [0.0036, 0.0410], 1e-4)


def test_segments_with_different_times_are_joined():
    walk = plan_segments([(Gait(), 3), (Gait(period=0.7, half_step=0.05, turn=0.1), 4)])
    pattern = make_pattern(walk, PAPER_PENDULUM)
    times = np.linspace(0, pattern.duration, 500)
    assert pattern.continuity_residual() < 1e-12
    assert pattern.hull_margin(times).min() > 0.05


def test_a_very_long_walk_keeps_its_digits():
    pattern = pattern_of(steps=3000)
    span = pattern.phases[2 + 2 * 2000]
    y = abs(pattern.at(span.start + span.duration).com[1])
    assert y == pytest.approx(transfer_zmp(PAPER_GAIT, OMEGA).y, rel=1e-12)


def test_sample_shapes():
    samples = pattern_of(steps=2).sample(np.linspace(0, 3, 7))
    assert samples.com.shape == samples.left.shape == (7, 3)
    assert samples.zmp.shape == (7, 2)
    assert samples.phase.shape == samples.time.shape == (7,)
    with pytest.raises(ParameterError, match="at least one time"):
        pattern_of(steps=2).sample([])


@pytest.mark.parametrize("time", [math.nan, math.inf, "1", None, True])
def test_bad_times_are_refused(time):
    with pytest.raises(ParameterError, match="time must be a number"):
        pattern_of(steps=1).at(time)


def test_integer_and_numpy_times_are_accepted():
    pattern = pattern_of(steps=2)
    assert pattern.at(3).com.tolist() == pattern.at(3.0).com.tolist()
    assert pattern.at(np.float64(3)).com.tolist() == pattern.at(3.0).com.tolist()


# ---- Pauses -----------------------------------------------------------------------

STOP_AND_GO = (
    (Gait(), 3),
    (Gait(half_step=-0.05, turn=0.15), 2),
    (Gait(half_step=0.0, lateral=-0.05), 3),
)


@pytest.mark.parametrize("style", ["paper", "minjerk"])
@pytest.mark.parametrize("pause", [0.0, 1.3])
def test_a_walk_with_pauses_is_its_walks_one_after_the_other(style, pause):
    """Each moved to where the one before ended; the same to the last digit but one."""
    parts = [(dataclasses.replace(g, double_support=style), n) for g, n in STOP_AND_GO]
    (a, b, c) = parts
    whole = make_pattern(plan_segments([a, pause, b, pause, c]), PAPER_PENDULUM)
    begin, place, landed = 0.0, Foothold(0.0, 0.0), 0
    for part in parts:
        alone = make_pattern(plan_segments([part]), PAPER_PENDULUM)
        for t in np.linspace(0.5, alone.duration - 0.5, 60)[:-1].tolist():
            ours, theirs = whole.at(begin + t), alone.at(t)
            x, y, _ = theirs.com.tolist()
            com = place.compose(Foothold(x, y, theirs.heading))
            near(ours.com[:2], [com.x, com.y], 1e-9)
            near(ours.heading, com.yaw, 1e-9)
            zmp = place.compose(Foothold(*theirs.zmp.tolist()))
            near(ours.zmp, [zmp.x, zmp.y], 1e-9)
            foot = place.compose(Foothold(*theirs.left.position[:2].tolist()))
            near(ours.left.position[:2], [foot.x, foot.y], 1e-9)
            assert ours.phase is theirs.phase
            assert ours.step == theirs.step + landed
            assert ours.walking == pytest.approx(theirs.walking)
        begin += alone.duration - 1.0 + pause
        landed += len(alone.plan.steps)
        end = alone.at(alone.duration)
        place = place.compose(Foothold(*end.com[:2].tolist(), end.heading))
    assert whole.duration == pytest.approx(begin + 1.0 - pause)


@pytest.mark.parametrize("style", ["paper", "minjerk"])
def test_in_a_pause_everything_rests(style):
    parts = [(dataclasses.replace(g, double_support=style), n) for g, n in STOP_AND_GO]
    pattern = make_pattern(plan_segments([parts[0], 2.0, *parts[1:]]), PAPER_PENDULUM)
    spans = [span for span in pattern.phases if span.phase is Phase.STAND]
    assert [span.duration for span in spans] == [0.5, 2.0, 0.5]
    for share in (0.0, 0.3, 0.999):
        rest = pattern.at(spans[1].start + share * spans[1].duration)
        middle = 0.5 * (rest.left.position + rest.right.position)
        near(rest.com[:2], middle[:2], 1e-12)
        near(rest.zmp, middle[:2], 1e-12)
        assert not rest.com_velocity.any()
        assert not rest.com_acceleration.any()
        assert rest.heading_rate == 0.0
        assert (rest.walking, rest.left_load) == (0.0, 0.5)
    assert pattern.continuity_residual() < 1e-9
    times = np.linspace(0.0, pattern.duration, 999)
    assert pattern.zmp_residual(times) < 1e-9
    assert pattern.hull_margin(times).min() > 0.0


def test_a_pause_after_the_last_step_is_the_stand_at_the_end():
    plan = plan_steps(PAPER_GAIT, 2)
    last = dataclasses.replace(plan.steps[-1], stand=9.0)
    paused = dataclasses.replace(plan, steps=(*plan.steps[:-1], last))
    assert make_pattern(paused, PAPER_PENDULUM).duration == pytest.approx(
        make_pattern(plan, PAPER_PENDULUM).duration
    )
