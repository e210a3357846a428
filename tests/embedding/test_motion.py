"""Embedded motions (section VI): splines, blends, limits, dances and files."""

import dataclasses
import io
import math
import pickle
import re
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline

from comwalk.embedding.dances import BUILTIN_MOTIONS, builtin_motion
from comwalk.embedding.motion import EmbeddedMotion, JointLimit, Motion, embed_in
from comwalk.embedding.motion_checks import prepare_motion
from comwalk.embedding.motion_edits import renamed, scaled, select
from comwalk.embedding.motion_files import load_motion, save_motion
from comwalk.errors import MotionError, ParameterError

ARMS = ("l_shoulder_pitch", "l_elbow_pitch", "head_yaw")


def make(times=(0.0, 0.7, 1.0, 2.5), joints=ARMS[:2], loops=False, seed=1, **more):
    """Return a motion of random samples."""
    times = np.array(times, dtype=float)
    positions = np.random.default_rng(seed).uniform(-1, 1, (times.size, len(joints)))
    if loops:
        positions[-1] = positions[0]
    return Motion("test", tuple(joints), times, positions, loops, **more)


def free(joints):
    """Return limits that allow everything."""
    return {joint: JointLimit() for joint in joints}


def zeros(joints):
    return dict.fromkeys(joints, 0.0)


def finite_difference(at, t, h=1e-4):
    """Return the fourth-order central difference of the angles."""
    a, b, c, d = (at(t + k * h)[0] for k in (-2, -1, 1, 2))
    return (a - 8 * b + 8 * c - d) / (12 * h)


# ---- The spline ---------------------------------------------------------------------


@pytest.mark.parametrize("loops", [False, True])
def test_the_motion_passes_through_its_samples(loops):
    motion = make(loops=loops)
    for t, q in zip(motion.times, motion.positions, strict=True):
        np.testing.assert_allclose(motion.at(t)[0], q, atol=1e-12)
    assert motion.duration == 2.5


@pytest.mark.parametrize("loops", [False, True])
@given(t=st.floats(-3.0, 6.0))
def test_rates_are_the_derivative_of_the_angles(loops, t):
    motion = make(loops=loops)
    phase = t % 2.5 if loops else t
    assume(np.abs(motion.times - phase).min() > 1e-3)
    expected = finite_difference(motion.at, t)
    np.testing.assert_allclose(motion.at(t)[1], expected, atol=1e-6)


@pytest.mark.parametrize("loops", [False, True])
def test_angles_rates_and_accelerations_are_continuous_at_every_knot(loops):
    """The spline is C2, at the seam of a loop too."""
    motion, h = make(loops=loops), 1e-6
    inner = [0.7, 1.0, *([0.0, 2.5, 5.0, -2.5] if loops else [])]
    for t in inner:
        (q_0, dq_0), (q_1, dq_1) = motion.at(t - h), motion.at(t + h)
        np.testing.assert_allclose(q_0, q_1, atol=1e-4)
        np.testing.assert_allclose(dq_0, dq_1, atol=1e-3)
        before = (dq_0 - motion.at(t - 2 * h)[1]) / h
        after = (motion.at(t + 2 * h)[1] - dq_1) / h
        np.testing.assert_allclose(before, after, atol=1e-3 * np.abs(before).max())


def test_a_motion_that_does_not_loop_holds_its_ends_at_rest():
    motion = make()
    for t, row in ((-1.0, 0), (0.0, 0), (2.5, -1), (1e9, -1)):
        q, dq = motion.at(t)
        assert q == pytest.approx(motion.positions[row], abs=1e-12)
        assert (dq == 0.0).all()
    assert np.abs(motion.at(2.5 - 1e-7)[1]).max() < 1e-4
    assert np.abs(motion.at(1e-7)[1]).max() < 1e-4


def test_a_motion_that_loops_repeats():
    motion = make(loops=True)
    for t in (0.0, 0.3, 2.4999):
        for cycles in (-2, 1, 7):
            for a, b in zip(motion.at(t), motion.at(t + 2.5 * cycles), strict=True):
                np.testing.assert_allclose(a, b, atol=1e-9)
    np.testing.assert_allclose(motion.at(-1e-20)[0], motion.positions[0], atol=1e-12)


def test_two_samples_are_a_smooth_step():
    motion = Motion("lift", ("a",), np.array([0, 2]), np.array([[0], [1]]))
    for t in (0.2, 1.0, 1.7):
        s = t / 2
        assert motion.at(t)[0][0] == pytest.approx(3 * s**2 - 2 * s**3, abs=1e-12)


def test_a_motion_is_a_read_only_copy():
    times, positions = np.array([0.0, 1.0]), np.array([[0.0], [1.0]])
    motion = Motion("m", ("a",), times, positions)
    positions[0, 0] = 9.0
    assert motion.positions[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        motion.positions[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        motion.loops = True


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": [0.0, 1.0, 1.0]}, "sample 3 at 1 s follows 1 s"),
        ({"times": [0.0, 2.0, 1.0]}, "sample 3 at 1 s follows 2 s"),
        ({"times": [0.5, 1.0, 2.0]}, "must start at time 0 s, got 0.5 s"),
        ({"times": [-1.0, 1.0, 2.0]}, "must start at time 0 s, got -1 s"),
        ({"times": [0.0, math.nan, 2.0]}, "time of sample 2 is nan"),
        ({"times": [0.0, 1.0, math.inf]}, "time of sample 3 is inf"),
        ({"times": [0.0, 1.0]}, "shape (samples, joints) = (2, 2), got (3, 2)"),
        ({"times": [0.0]}, "at least 2 samples"),
        ({"times": 1.0}, "at least 2 samples"),
        ({"times": "soon"}, "times must be an array of real numbers"),
        ({"times": None}, "times must be an array of real numbers"),
        ({"times": [True, False]}, "times must be an array of real numbers"),
        ({"positions": [[0, 0], [0, math.nan], [0, 0]]}, 'joint "b" at 1 s is nan'),
        ({"positions": [[0, 0], [0, 0], [-math.inf, 0]]}, 'joint "a" at 2 s is -inf'),
        ({"positions": [[0, 1e300], [0, 0], [0, 0]]}, "within +-10000 rad"),
        ({"positions": [[0, 0], [0], [0, 0]]}, "positions must be an array of real"),
        ({"positions": [[0, 1j]] * 3}, "positions must be an array of real numbers"),
        ({"joints": ()}, "moves no joint"),
        ({"joints": ("a", "a")}, 'joint "a" more than once'),
        ({"joints": ("a", " ")}, "must be printable text, got ' '"),
        ({"joints": ("a", 3)}, "must be printable text, got 3"),
        ({"name": ""}, "name must be printable text"),
        ({"name": "a\nb"}, "name must be printable text"),
        ({"loops": True}, 'joint "b" ends 0.5 rad away from where it starts'),
    ],
)
def test_samples_that_are_no_motion_are_refused(change, message):
    positions = [[0.0, 0.0], [1.0, 1.0], [0.1, 0.5]]
    good = {"name": "m", "joints": ("a", "b"), "times": [0, 1, 2]}
    good = {**good, "positions": positions}
    Motion(**good)
    with pytest.raises(MotionError, match=re.escape(message)) as caught:
        Motion(**{**good, **change})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("t", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_not_finite_is_refused(t):
    motion = make()
    with pytest.raises(ParameterError, match="t must be a number"):
        motion.at(t)
    with pytest.raises(ParameterError, match="t must be a number"):
        embed_in(motion, zeros(motion.joints)).at(t)


# ---- The blend ----------------------------------------------------------------------


HOME = {"l_shoulder_pitch": 0.3, "l_elbow_pitch": -0.8, "other": 5.0}


def embedded_motion(**more):
    return embed_in(make(loops=True), HOME, **{"start": 1.0, "stop": 7.3, **more})


def test_the_blend_is_exactly_home_at_rest_outside_its_window():
    embedded = embedded_motion()
    for t in (-5.0, 0.0, 1.0, 7.3, 7.4, 100.0):
        q, dq = embedded.at(t)
        assert q.tolist() == [0.3, -0.8]
        assert dq.tolist() == [0.0, 0.0]


def test_between_the_blends_it_is_the_motion():
    embedded = embedded_motion()
    for t in (2.0, 3.3, 6.3):
        for ours, original in zip(
            embedded.at(t), embedded.motion.at(t - 1.0), strict=True
        ):
            np.testing.assert_allclose(ours, original, atol=1e-14)


def test_the_blend_weight_is_the_minimum_jerk_step():
    """Independent oracle: w solves w^(6) = 0 with w, w', w'' given at both ends."""
    still = Motion("still", ("a",), np.array([0.0, 9.0]), np.array([[1.0], [1.0]]))
    embedded = embed_in(still, {"a": 0.0}, blend=2.0)
    s = np.array([0.0, 1.0])
    rows = [[n * (n - 1) * x ** max(n - 2, 0) for n in range(6)] for x in s]
    rows += [[n * x ** max(n - 1, 0) for n in range(6)] for x in s]
    rows += [[x**n for n in range(6)] for x in s]
    c = np.linalg.solve(np.array(rows), [0, 0, 0, 0, 0, 1])
    for x in np.linspace(0.01, 0.99, 17):
        w = float(np.polyval(c[::-1], x))
        assert embedded.at(2 * x)[0][0] == pytest.approx(w, abs=1e-12)
        assert embedded.at(9 - 2 * x)[0][0] == pytest.approx(w, abs=1e-12)


def test_embedded_rates_are_the_derivative_of_the_angles():
    embedded = embedded_motion()
    knots = np.concatenate(
        ([1, 2, 6.3, 7.3], *(embedded.motion.times + 1 + 2.5 * k for k in range(3)))
    )
    for t in np.linspace(0.5, 7.8, 211):
        if np.abs(knots - t).min() > 1e-3:
            expected = finite_difference(embedded.at, t)
            np.testing.assert_allclose(embedded.at(t)[1], expected, atol=1e-6)


@pytest.mark.parametrize("t", [1.0, 2.0, 3.5, 6.0, 6.3, 7.3])
def test_angles_and_rates_are_continuous_at_blends_and_seams(t):
    embedded, h = embedded_motion(), 1e-7
    for before, after in zip(embedded.at(t - h), embedded.at(t + h), strict=True):
        np.testing.assert_allclose(before, after, atol=1e-5)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 99),
    home=st.floats(-2.0, 2.0),
    blend=st.floats(0.05, 1.2),
    where=st.floats(0.0, 1.0),
    loops=st.booleans(),
)
def test_the_blend_stays_between_home_and_motion(seed, home, blend, where, loops):
    """A weighted mean: limits kept by home and motion are kept by the blend."""
    motion = make(loops=loops, seed=seed)
    embedded = embed_in(motion, zeros(motion.joints) | {ARMS[0]: home}, blend=blend)
    t = where * 2.5
    q_m, q = motion.at(t)[0], embedded.at(t)[0]
    low, high = np.minimum(q_m, embedded.home), np.maximum(q_m, embedded.home)
    assert (low - 1e-12 <= q).all()
    assert (q <= high + 1e-12).all()


def test_without_a_stop_a_loop_plays_for_ever_and_a_clip_once():
    assert embed_in(make(loops=True), HOME).stop == math.inf
    assert embed_in(make(), HOME, start=3).stop == 5.5


@pytest.mark.parametrize("loops", [False, True])
@given(st.floats(-2.0, 14.0))
def test_the_embedding_is_the_spline_of_scipy_blended(loops, t):
    """Angles and rates, before, while and after it plays."""
    embedded = embed_in(make(loops=loops), HOME, start=1.0, stop=9.0, blend=1.5)
    motion, since = embedded.motion, t - 1.0
    ends = "periodic" if loops else "clamped"
    spline = CubicSpline(motion.times, motion.positions, bc_type=ends)
    since = since % motion.duration if loops else min(max(since, 0), motion.duration)
    q_m, dq_m = spline(since), spline(since, 1)
    jerk = Polynomial([0, 0, 0, 10, -15, 6])
    s = min(max(min(t - 1.0, 9.0 - t) / 1.5, 0.0), 1.0)
    sign = 1.0 if t < 5.0 else -1.0
    away = q_m - embedded.home
    q, dq = embedded.at(t)
    assert q == pytest.approx(embedded.home + jerk(s) * away, abs=1e-11)
    rate = jerk(s) * dq_m + sign * jerk.deriv()(s) / 1.5 * away
    assert dq == pytest.approx(rate, abs=1e-9)


def test_a_clip_can_be_held_after_its_end():
    embedded = embed_in(make(), HOME, stop=10.0)
    q, dq = embedded.at(5.0)
    assert q == pytest.approx(embedded.motion.positions[-1], abs=1e-12)
    assert dq.tolist() == [0.0, 0.0]


def test_the_embedding_names_its_joints_in_the_order_of_its_columns():
    embedded = embed_in(make(joints=("b", "a")), {"a": 1.0, "b": 2.0})
    assert embedded.joints == ("b", "a")
    assert embedded.at(0.0)[0].tolist() == [2.0, 1.0]


@pytest.mark.parametrize(
    ("more", "error", "message"),
    [
        ({"stop": 2.5}, MotionError, "blend over at most 0.75 s, or stop later"),
        ({"stop": 0.5}, MotionError, "plays for -0.5 s"),
        ({"blend": 0.0}, ParameterError, "blend must be a number in (0, inf) s"),
        ({"blend": math.inf}, ParameterError, "blend must be"),
        ({"blend": "slow"}, ParameterError, "blend must be"),
        ({"start": math.nan}, ParameterError, "start must be"),
        ({"start": -math.inf}, ParameterError, "start must be"),
        ({"stop": math.nan}, ParameterError, "stop must be"),
        ({"stop": True}, ParameterError, "stop must be"),
    ],
)
def test_a_window_that_cannot_be_played_is_refused(more, error, message):
    with pytest.raises(error, match=re.escape(message)):
        embedded_motion(**more)


def test_the_advised_blend_fits_the_window():
    assert embedded_motion(stop=2.5, blend=0.75).at(2.5)[1].tolist() == [0.0, 0.0]


def test_a_home_that_misses_a_joint_is_refused():
    with pytest.raises(MotionError, match='no home angle; did you mean "l_elbow_pich"'):
        embed_in(make(), {"l_shoulder_pitch": 0.0, "l_elbow_pich": 0.0})
    with pytest.raises(MotionError, match="home must be 2 finite angles"):
        embed_in(make(), {"l_shoulder_pitch": 0.0, "l_elbow_pitch": math.nan})


def test_a_blend_faster_than_a_joint_is_refused_and_the_advice_helps():
    """Peak of the minimum-jerk rate: 15/8 of the distance over the blend time."""
    up = Motion("up", ("a",), np.array([0.0, 9.0]), np.array([[2.0], [2.0]]))
    peak = 2.0 * 15 / 8 / 0.5
    limits = {"a": JointLimit(speed=peak * 1.001)}
    embed_in(up, {"a": 0.0}, blend=0.5, limits=limits)
    limits = {"a": JointLimit(speed=3.0)}
    message = 'needs 7.5 rad/s of joint "a" at 0.250 s, its limit is 3 rad/s'
    with pytest.raises(MotionError, match=message) as caught:
        embed_in(up, {"a": 0.0}, blend=0.5, limits=limits)
    advised = float(re.search(r"over about (\S+) s", str(caught.value))[1])
    embed_in(up, {"a": 0.0}, blend=advised, limits=limits)


def test_a_blend_out_that_is_too_fast_is_refused():
    times, positions = np.array([0.0, 5.0]), np.array([[0.0], [2.0]])
    away = Motion("away", ("a",), times, positions)
    with pytest.raises(MotionError, match=r"at 4\.\d+ s, its limit is 1 rad/s"):
        embed_in(away, {"a": 0.0}, limits={"a": JointLimit(speed=1.0)})


# ---- Against a robot ----------------------------------------------------------------


def prepared(motion, **more):
    """Return the motion prepared for a robot with the joints ARMS and a leg."""
    default = {"allowed": ARMS, "ignored": ("l_knee",), "limits": free(ARMS)}
    return prepare_motion(motion, **{**default, "home": zeros(ARMS), **more})


def test_a_motion_of_known_joints_inside_the_limits_is_unchanged():
    motion = make()
    ready = prepared(motion)
    assert ready.joints == motion.joints
    assert (ready.positions == motion.positions).all()
    assert ready.dropped == ()


def test_the_legs_of_a_whole_body_clip_are_dropped_and_reported():
    motion = make(joints=("l_knee", "head_yaw"), whole_body=True)
    ready = prepared(motion)
    assert ready.joints == ("head_yaw",)
    assert ready.dropped == ("l_knee",)
    assert (ready.positions[:, 0] == motion.positions[:, 1]).all()


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (make(joints=("l_knee", "head_yaw")), "which the walking moves; remove it"),
        (make(joints=("head_jaw",)), 'did you mean "head_yaw"'),
        (make(joints=("head_jaw",), whole_body=True), 'did you mean "head_yaw"'),
        (make(joints=("tail",)), "known: head_yaw, l_elbow_pitch, l_shoulder_pitch"),
        (make(joints=("l_knee",), whole_body=True), "none of the joints asked for"),
    ],
)
def test_a_motion_of_other_joints_is_refused(motion, message):
    with pytest.raises(MotionError, match=re.escape(message)):
        prepared(motion)


def bump(height, joint="head_yaw"):
    """Return a motion that rises to a height between its samples and returns."""
    times = np.array([0.0, 1.0, 2.0, 3.0])
    positions = height * np.array([[0.0], [0.8], [0.8], [0.0]])
    return Motion("bump", (joint,), times, positions)


def peak_angle(motion):
    """Return the largest angle and its time, by brute force."""
    times = np.linspace(0.0, motion.duration, 30001)
    q = np.array([motion.at(t)[0] for t in times])
    k = np.unravel_index(np.argmax(q), q.shape)
    return q[k], times[k[0]]


def test_an_overshoot_between_the_samples_is_found():
    motion = bump(1.0)
    top, when = peak_angle(motion)
    assert top > 0.85
    prepared(motion, limits={"head_yaw": JointLimit(-1, top + 1e-6)})
    with pytest.raises(MotionError) as caught:
        prepared(motion, limits={"head_yaw": JointLimit(-1, 0.82)})
    text = str(caught.value)
    assert f'joint "head_yaw" reaches {top:.4g} rad at {when:.3f} s' in text
    assert "its limit is 0.82 rad; make it smaller: scale 0." in text


@settings(max_examples=40)
@given(
    seed=st.integers(0, 99),
    home=st.floats(-0.4, 0.4),
    limit=st.floats(0.45, 0.9),
    loops=st.booleans(),
)
def test_following_the_advice_on_amplitude_satisfies_the_limits(
    seed, home, limit, loops
):
    motion = make(loops=loops, seed=seed)
    robot = {
        "limits": dict.fromkeys(ARMS, JointLimit(-limit, limit)),
        "home": dict.fromkeys(ARMS, home),
    }
    try:
        prepared(motion, **robot)
    except MotionError as error:
        factor = float(re.search(r"smaller: scale (\S+) or less", str(error))[1])
        assert 0.0 < factor < 1.0
        prepared(scaled(motion, factor, about=robot["home"]), **robot)
        with pytest.raises(MotionError):
            prepared(scaled(motion, factor * 1.05, about=robot["home"]), **robot)


@settings(max_examples=40)
@given(seed=st.integers(0, 99), limit=st.floats(0.1, 3.0), loops=st.booleans())
def test_following_the_advice_on_speed_satisfies_the_limits(seed, limit, loops):
    motion = make(loops=loops, seed=seed)
    robot = {"limits": dict.fromkeys(ARMS, JointLimit(speed=limit))}
    times = np.linspace(0, 2.5, 3001).tolist()
    fastest = np.abs([motion.at(t)[1] for t in times]).max()
    try:
        prepared(motion, **robot)
        assert fastest <= limit * (1 + 1e-6)
    except MotionError as error:
        found = re.search(r"needs (\S+) rad/s.*at (\S+) times its", str(error))
        assert float(found[1]) == pytest.approx(fastest, rel=2e-3)
        prepared(scaled(motion, speed=float(found[2])), **robot)
        with pytest.raises(MotionError):
            prepared(scaled(motion, speed=float(found[2]) * 1.02), **robot)


def test_a_lower_limit_is_named_too():
    with pytest.raises(
        MotionError, match=r"reaches -\S+ rad at \S+ s, its limit is -1"
    ):
        prepared(bump(-2.0), limits={"head_yaw": JointLimit(-1, 1)})


def test_degrees_are_recognized():
    with pytest.raises(
        MotionError, match="must be in radians, these look like degrees"
    ):
        prepared(bump(90.0), limits={"head_yaw": JointLimit(-1, 1)})


def test_a_home_at_or_beyond_a_limit_is_explained():
    limits = {"head_yaw": JointLimit(-1, 0.5)}
    with pytest.raises(MotionError, match="home posture is at this limit"):
        prepared(bump(1.0), limits=limits, home={"head_yaw": 0.5})
    message = r'home angle of joint "head_yaw" must be in \[-1, 0.5\] rad, got 0.6 rad'
    with pytest.raises(MotionError, match=message):
        prepared(bump(0.1), limits=limits, home={"head_yaw": 0.6})


def test_a_joint_without_limit_or_home_is_refused():
    with pytest.raises(MotionError, match='joint "head_yaw", which has no limit'):
        prepared(bump(1.0), limits={})
    with pytest.raises(MotionError, match='joint "head_yaw", which has no home angle'):
        prepared(bump(1.0), home={})


@pytest.mark.parametrize(
    "limit",
    [
        {"lower": math.nan},
        {"lower": math.inf},
        {"upper": math.nan},
        {"upper": -math.inf},
        {"lower": 1.0, "upper": 0.5},
        {"speed": 0.0},
        {"speed": math.nan},
        {"speed": "fast"},
    ],
)
def test_impossible_limits_are_refused(limit):
    with pytest.raises(ParameterError, match=list(limit)[-1]):
        JointLimit(**limit)


# ---- Variations ---------------------------------------------------------------------


def test_scaled_changes_angles_about_a_posture_and_time():
    motion, about = make(), {"l_elbow_pitch": 0.4}
    other = scaled(motion, 0.5, 2.0, about=about)
    center = np.array([0.0, 0.4])
    for t in (0.1, 0.9, 2.2):
        q, dq = motion.at(t)
        q_s, dq_s = other.at(t / 2)
        np.testing.assert_allclose(q_s, center + 0.5 * (q - center), atol=1e-12)
        np.testing.assert_allclose(dq_s, dq, atol=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"amplitude": -1}, {"speed": 0}, {"speed": math.nan}]
)
def test_scaled_refuses_factors_out_of_range(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        scaled(make(), **wrong)


def test_select_keeps_order_and_lists_what_it_dropped():
    motion = make(joints=("a", "b", "c"))
    kept = select(motion, ["c", "a", "unknown"])
    assert kept.joints == ("a", "c")
    assert kept.dropped == ("b",)
    assert select(kept, ["c"]).dropped == ("b", "a")
    with pytest.raises(MotionError, match="moves a, b, c"):
        select(motion, ["x"])


def test_renamed_puts_joint_names_for_roles():
    motion = builtin_motion("disco")
    other = renamed(motion, {"l_elbow_pitch": "LARM_ELBOW", "tail": "T"})
    assert other.joints == ("LARM_ELBOW",)
    assert set(other.dropped) == set(motion.joints) - {"l_elbow_pitch"}
    column = motion.joints.index("l_elbow_pitch")
    assert other.at(0.4)[0][0] == motion.at(0.4)[0][column]
    with pytest.raises(MotionError, match='joint "E" more than once'):
        renamed(motion, {"l_elbow_pitch": "E", "r_elbow_pitch": "E"})


# ---- Dances -------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUILTIN_MOTIONS)
@pytest.mark.parametrize(("amplitude", "frequency"), [(0.5, 0.5), (1.5, 2), (2.5, 3)])
def test_the_amplitude_is_the_largest_angle_of_every_dance(name, amplitude, frequency):
    motion = builtin_motion(name, amplitude=amplitude, frequency=frequency)
    assert motion.loops
    assert motion.duration == pytest.approx(1 / frequency, rel=1e-14)
    assert np.abs(motion.positions).max() == pytest.approx(amplitude, rel=1e-12)


@pytest.mark.parametrize("name", BUILTIN_MOTIONS)
def test_every_dance_describes_the_joints_it_moves(name):
    moved = " ".join(builtin_motion(name).joints)
    for part in ("shoulder", "elbow", "waist", "head"):
        assert (part in moved) == (part in BUILTIN_MOTIONS[name])
    arm = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch")
    roles = {f"{side}_{role}" for side in "lr" for role in arm}
    roles |= {"waist_yaw", "waist_pitch", "head_yaw", "head_pitch"}
    assert set(moved.split()) <= roles


def test_the_paper_dance_is_the_one_minus_cosine_of_both_arms():
    """Fig. 5: shoulder pitch and roll and elbow of both arms, in phase."""
    motion = builtin_motion("paper", amplitude=0.5, frequency=0.5)
    for t in np.linspace(0.0, 2.0, 37):
        u, du = (
            0.25 * (1 - math.cos(math.pi * t)),
            0.25 * math.pi * math.sin(math.pi * t),
        )
        q, dq = motion.at(t)
        signs = np.array([-1, 1, -1, -1, -1, -1])
        np.testing.assert_allclose(q, signs * u, atol=1e-6)
        np.testing.assert_allclose(dq, signs * du, atol=1e-4)


def hand(pitch, roll, yaw, elbow):
    """Return where a hand is, from its shoulder: x forward, y left, z up."""

    def turn(axis, angle):
        k = np.zeros((3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        k[j, i], k[i, j] = 1.0, -1.0
        return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k

    arm = turn(1, pitch) @ turn(0, roll) @ turn(2, yaw)
    link = np.array([0.0, 0.0, -0.3])
    return arm @ (link + turn(1, elbow) @ link)


def hands(motion, t):
    """Return where both hands are."""
    q = dict(zip(motion.joints, motion.at(t)[0], strict=True))
    roles = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch")
    return [hand(*(q.get(f"{side}_{role}", 0.0) for role in roles)) for side in "lr"]


@pytest.mark.parametrize("name", ["paper", "counter", "swing", "disco", "conduct"])
def test_the_arms_move_to_mirrored_places(name):
    """Half a cycle later in counter-phase, at once in phase."""
    motion, mirror = builtin_motion(name), np.array([1.0, -1.0, 1.0])
    shift = 0.5 * motion.duration if name in ("counter", "swing", "disco") else 0.0
    for t in (0.0, 0.3, 0.9):
        left = hands(motion, t)[0]
        right = hands(motion, t + shift)[1]
        np.testing.assert_allclose(left, mirror * right, atol=1e-6)


def test_the_signs_raise_arms_forward_and_outward():
    left, right = hands(builtin_motion("paper"), 1.0)
    assert left[0] > 0.2
    assert left[1] > 0.1
    assert left[2] > -0.55
    assert right[1] < -0.1


def test_the_raised_hand_waves_up_on_the_right_side():
    motion = builtin_motion("wave", amplitude=1.5)
    heights = [hands(motion, t)[1] for t in np.linspace(0, 2, 21)]
    assert all(p[1] < -0.3 for p in heights)
    assert max(p[2] for p in heights) > 0.0


def test_swing_turns_the_waist_with_the_arm_that_is_forward():
    motion = builtin_motion("swing")
    forward = hands(motion, 0.75 * motion.duration)
    assert forward[0][0] > 0.2 > 0.0 > forward[1][0]
    q = dict(zip(motion.joints, motion.at(1.5)[0], strict=True))
    assert q["waist_yaw"] < 0.0


def test_a_dance_is_built_around_home():
    base = builtin_motion("bow")
    moved = builtin_motion("bow", home={"waist_pitch": 0.1})
    column = base.joints.index("waist_pitch")
    gap = moved.positions - base.positions
    np.testing.assert_allclose(gap[:, column], 0.1, atol=1e-15)
    assert (np.delete(gap, column, axis=1) == 0.0).all()


def test_unknown_dances_and_parameters_out_of_range_are_refused():
    with pytest.raises(MotionError, match='did you mean "disco"'):
        builtin_motion("disko")
    for wrong in (
        {"amplitude": 0},
        {"amplitude": 2.6},
        {"amplitude": math.nan},
        {"frequency": 0},
        {"frequency": 3.1},
        {"frequency": "1"},
    ):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            builtin_motion("paper", **wrong)
    with pytest.raises(ParameterError, match="waist_pitch"):
        builtin_motion("bow", home={"waist_pitch": math.nan})


# ---- Files --------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["csv", "npz", "CSV"])
@pytest.mark.parametrize(
    "motion",
    [
        make(),
        make(loops=True, joints=('odd, "name"', "b-2", "Arm_é")),
        make(joints=("l_knee", "a"), whole_body=True),
        builtin_motion("disco"),
    ],
)
def test_a_saved_motion_is_loaded_exactly(tmp_path, ending, motion):
    path = tmp_path / f"file.{ending}"
    save_motion(motion, path)
    back = load_motion(path)
    for key in ("name", "joints", "loops", "whole_body"):
        assert getattr(back, key) == getattr(motion, key)
    assert (back.times == motion.times).all()
    assert (back.positions == motion.positions).all()


def write(tmp_path, content, name="clip.csv"):
    path = tmp_path / name
    if isinstance(content, str):
        content = content.encode()
    path.write_bytes(content)
    return path


def test_a_csv_with_comments_blank_lines_and_a_late_start_is_loaded(tmp_path):
    text = "\ufeff# a dance\n\ntime, a ,b\n# middle\n2,0,1e-1\n,,\n2.5,1,-1\n"
    motion = load_motion(write(tmp_path, text.replace("\n", "\r\n")))
    assert motion.name == "clip"
    assert motion.joints == ("a", "b")
    assert motion.times.tolist() == [0.0, 0.5]
    assert motion.positions.tolist() == [[0.0, 0.1], [1.0, -1.0]]
    assert not motion.loops
    assert not motion.whole_body


def test_the_caller_can_make_a_file_loop(tmp_path):
    path = write(tmp_path, "# loops: true\ntime,a\n0,0\n1,1\n2,0\n")
    assert load_motion(path).loops
    assert not load_motion(path, loops=False).loops
    path = write(tmp_path, "time,a\n0,0\n1,1\n2,0.5\n")
    with pytest.raises(MotionError, match=r"cannot loop: .*append the first sample"):
        load_motion(path, loops=True)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "it is empty"),
        ("\n# only a comment\n", "it is empty"),
        ("time,a\n", "at least 2 samples"),
        ("time,a\n0,1\n", "at least 2 samples"),
        ("time\n0\n1\n", "first line must be time,<joint>,..."),
        ("t,a\n0,0\n1,0\n", 'it starts with "t,a"'),
        ("0.1,0.2\n0.2,0.3\n", 'it starts with "0.1,0.2"'),
        ("time;a\n0;0\n", 'it starts with "time;a"'),
        ("time,a\n0,0\n1,0,7\n", "line 3 has 3 columns, the header has 2"),
        ("time,a\n0\n", "line 2 has 1 columns"),
        ("time,a\n0,0\n1,left\n", 'line 3, column "a": "left" is not a number'),
        ("time,a\n0,\n1,0\n", 'line 2, column "a": "" is not a number'),
        ("time,a,a\n0,0,0\n1,0,0\n", 'joint "a" more than once'),
        ("time,a,\n0,0,0\n1,0,0\n", "must be printable text, got ''"),
        ("time,a\n0,0\n1,nan\n", 'angle of joint "a" at 1 s is nan'),
        ("time,a\n0,0\ninf,0\n", "time of sample 2 is inf"),
        ("time,a\ninf,0\n1,0\n", "time of sample 1 is inf"),
        ("time,a\nnan,0\n1,0\n", "time of sample 1 is nan"),
        ("time,a\n0,0\n2,0\n1,0\n", "sample 3 at 1 s follows 2 s"),
        ("time,a\n0,0\n1,0\n1,0\n", "sample 3 at 1 s follows 1 s"),
        ("time,a\n-1,0\n1,0\n", "must not be negative, the first is -1 s"),
        (b"time,a\n\xff\xfe\x00,0\n", "it is not a text file"),
        ("time,a\n0," + "1" * 200_000 + "\n", "line 2: field larger than field limit"),
    ],
)
def test_a_malformed_csv_gives_one_clear_line(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(MotionError) as caught:
        load_motion(path)
    text = str(caught.value)
    assert text.startswith(f'cannot load motion "{path}": ')
    assert message in text
    assert "\n" not in text
    assert len(text) < 400


def test_files_that_cannot_be_read_give_one_clear_line(tmp_path):
    for name in ("gone.csv", "gone.npz"):
        with pytest.raises(MotionError, match=f"{name}.*no such file"):
            load_motion(tmp_path / name)
    for name in ("dance.txt", "dance"):
        with pytest.raises(MotionError, match=r"must end in \.csv or \.npz"):
            load_motion(tmp_path / name)
        with pytest.raises(MotionError, match=r"must end in \.csv or \.npz"):
            save_motion(make(), tmp_path / name)
    for name in ("folder.csv", "folder.npz"):
        (tmp_path / name).mkdir()
        with pytest.raises(MotionError, match="directory"):
            load_motion(tmp_path / name)
        with pytest.raises(MotionError, match="directory"):
            save_motion(make(), tmp_path / name)
    with pytest.raises(MotionError, match="cannot save motion"):
        save_motion(make(), tmp_path / "no" / "where.csv")


def savez(tmp_path, **arrays):
    path = tmp_path / "clip.npz"
    np.savez(path, **arrays)
    return path


OWN = {
    "time": np.array([3, 4, 6]),
    "joint_names": np.array(["a", "b"]),
    "positions": np.arange(6, dtype=np.float32).reshape(3, 2) / 8,
}


@pytest.mark.parametrize("names", ["joint_names", "joints"])
@pytest.mark.parametrize("kind", ["U", "S"])
def test_an_npz_of_times_names_and_positions_is_loaded(tmp_path, names, kind):
    arrays = {key: value for key, value in OWN.items() if key != "joint_names"}
    path = savez(tmp_path, **arrays, **{names: OWN["joint_names"].astype(kind)})
    motion = load_motion(path)
    assert motion.name == "clip"
    assert motion.joints == ("a", "b")
    assert motion.times.tolist() == [0.0, 1.0, 3.0]
    assert (motion.positions == OWN["positions"]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": None}, "it holds joint_names, positions"),
        ({"joint_names": None}, "it must hold time, joint_names and positions"),
        ({"positions": None}, "or fps and joint_pos"),
        ({"time": np.zeros((3, 1))}, "shape (3, 1)"),
        ({"time": np.array(["0", "1", "2"])}, "time must be an array of real numbers"),
        ({"time": np.array([-1.0, 0.0, 1.0])}, "must not be negative"),
        ({"positions": np.zeros((2, 2))}, "(3, 2), got (2, 2)"),
        ({"positions": np.full((3, 2), np.nan)}, 'joint "a" at 0 s is nan'),
        (
            {"positions": np.array([{}, 1], dtype=object)},
            'array "positions" is damaged',
        ),
        (
            {"joint_names": np.array(["a", 1], dtype=object)},
            'array "joint_names" is da',
        ),
        ({"joint_names": np.zeros(2)}, "joint_names must be an array of strings"),
        ({"joint_names": np.array(["a", "a"])}, 'joint "a" more than once'),
    ],
)
def test_a_malformed_npz_gives_one_clear_line(tmp_path, change, message):
    arrays = {k: v for k, v in {**OWN, **change}.items() if v is not None}
    path = savez(tmp_path, **arrays)
    with pytest.raises(MotionError) as caught:
        load_motion(path)
    assert str(caught.value).startswith(f'cannot load motion "{path}": ')
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_npz_gives_one_clear_line(tmp_path):
    whole = savez(tmp_path, **OWN).read_bytes()
    npy = tmp_path / "one.npy"
    np.save(npy, np.zeros(3))
    broken = bytearray(whole)
    broken[60:200] = bytes(140)
    contents = [
        b"",
        b"time,a\n0,0\n",
        whole[: len(whole) // 2],
        npy.read_bytes(),
        pickle.dumps({"time": [0]}),
        bytes(broken),
    ]
    for content in contents:
        path = write(tmp_path, content, "bad.npz")
        with pytest.raises(MotionError, match=r'cannot load motion ".*bad.npz": '):
            load_motion(path)


def test_a_pickle_is_never_executed(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("the file ran code",))

    path = savez(tmp_path, **{**OWN, "positions": np.array([Bomb()], dtype=object)})
    with pytest.raises(MotionError, match="holds Python objects"):
        load_motion(path)


ROBOT = ("l_hip", "l_knee", *ARMS)


def clip_arrays(frames=6, joints=5, **more):
    """Return the arrays that mjlab and whole_body_tracking write for one motion."""
    rng = np.random.default_rng(3)
    joint_pos = rng.uniform(-1, 1, (frames, joints)).astype(np.float32)
    arrays = {
        "fps": [50.0],
        "joint_pos": joint_pos,
        "joint_vel": np.zeros_like(joint_pos),
        "body_pos_w": np.zeros((frames, joints + 1, 3), np.float32),
        "body_quat_w": np.zeros((frames, joints + 1, 4), np.float32),
        "body_lin_vel_w": np.zeros((frames, joints + 1, 3), np.float32),
        "body_ang_vel_w": np.zeros((frames, joints + 1, 3), np.float32),
    }
    return {**arrays, **more}


@pytest.mark.parametrize("fps", [50, 50.0, [50], [50.0], np.int64(50)])
def test_a_whole_body_clip_without_names_takes_those_of_the_robot(tmp_path, fps):
    arrays = clip_arrays(fps=fps)
    motion = load_motion(savez(tmp_path, **arrays), robot_joints=ROBOT)
    assert motion.joints == ROBOT
    assert motion.whole_body
    np.testing.assert_allclose(motion.times, np.arange(6) / 50, atol=1e-15)
    assert (motion.positions == arrays["joint_pos"]).all()
    ready = prepared(motion, ignored=ROBOT[:2])
    assert ready.joints == ARMS
    assert ready.dropped == ROBOT[:2]


def test_a_whole_body_clip_with_names_keeps_them(tmp_path):
    names = np.array(ROBOT[::-1])
    path = savez(tmp_path, **clip_arrays(joint_names=names))
    assert load_motion(path).joints == ROBOT[::-1]
    assert load_motion(path, robot_joints=("x",)).joints == ROBOT[::-1]


def test_a_clip_of_generalized_coordinates_loses_the_pose_of_its_base(tmp_path):
    arrays = clip_arrays(joints=12, joint_names=np.array(ROBOT))
    motion = load_motion(savez(tmp_path, **arrays))
    assert motion.joints == ROBOT
    assert (motion.positions == arrays["joint_pos"][:, 7:]).all()


@pytest.mark.parametrize(
    ("change", "robot", "message"),
    [
        ({}, None, "has 5 joints and no joint_names; give the names of the robot's"),
        ({}, ROBOT[:4], "joint_pos has 5 joints, the robot has 4"),
        ({"joint_names": np.array(ROBOT[:3])}, ROBOT, "its joint_names has 3"),
        ({"fps": None}, ROBOT, "joint_pos without fps"),
        ({"fps": 0}, ROBOT, "fps must be one number in (0, 10000] Hz, got 0"),
        ({"fps": math.nan}, ROBOT, "got nan"),
        ({"fps": [30, 50]}, ROBOT, "got 2 numbers"),
        ({"fps": "fast"}, ROBOT, "fps must be an array of real numbers"),
        ({"joint_pos": np.zeros((1, 5))}, ROBOT, "at least 2 samples"),
        ({"joint_pos": np.zeros((2, 9, 5))}, ROBOT, "shape (frames, joints)"),
        ({"joint_pos": np.full((2, 5), np.nan)}, ROBOT, 'joint "l_hip" at 0 s is nan'),
    ],
)
def test_a_clip_that_does_not_fit_gives_one_clear_line(
    tmp_path, change, robot, message
):
    arrays = {k: v for k, v in clip_arrays(**change).items() if v is not None}
    with pytest.raises(MotionError, match=re.escape(message)) as caught:
        load_motion(savez(tmp_path, **arrays), robot_joints=robot)
    assert "\n" not in str(caught.value)


def test_an_embedding_made_by_hand_is_checked_like_one_of_embed_in():
    motion = make()
    with pytest.raises(MotionError, match="home must be 2 finite angles"):
        EmbeddedMotion(
            motion=motion, home=np.zeros(3), start=0.0, stop=math.inf, blend=1.0
        )


def test_a_clip_that_swells_is_refused_by_its_header(tmp_path):
    """Before it is unpacked: 1 MB of file, 1 GB of zeros."""
    header = io.BytesIO()
    about = {"descr": "<f8", "fortran_order": False, "shape": (2**27,)}
    np.lib.format.write_array_header_1_0(header, about)
    path = tmp_path / "big.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        entry = zipfile.ZipInfo("joint_pos.npy")
        entry.compress_type = zipfile.ZIP_DEFLATED
        with archive.open(entry, "w", force_zip64=True) as file:
            file.write(header.getvalue())
            for _ in range(2**9):
                file.write(bytes(2**20))
    tracemalloc.start()
    with pytest.raises(MotionError, match="unpacks to 512 MB, at most 256 MB are read"):
        load_motion(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**24


def test_a_clip_cut_off_at_a_limit_is_repaired():
    """Samples never pass the limit, but the spline between them does."""
    t = np.arange(200) / 50
    q = np.clip(1.2 * np.sin(1.2 * t), -0.52, 0.52)[:, None]
    clip = Motion(name="clip", joints=("a",), times=t, positions=q)
    room = {
        "allowed": ["a"],
        "limits": {"a": JointLimit(-0.52, 0.52, 9.0)},
        "home": {"a": 0.0},
    }
    found = prepare_motion(clip, **room)
    (told,) = found.repairs
    assert re.fullmatch(r"a moves 0\.99\d times as far", told)
    fine = np.linspace(0.0, t[-1], 20001)
    most = np.abs(CubicSpline(t, found.positions, bc_type="natural")(fine)).max()
    assert most <= 0.5205
    assert np.abs(found.positions - q).max() < 0.005
    room["limits"] = {"a": JointLimit(-0.5, 0.5, 9.0)}
    with pytest.raises(MotionError, match=r"make it smaller: scale 0\.9\d+ or less"):
        prepare_motion(clip, **room)
