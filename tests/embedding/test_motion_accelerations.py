"""Accelerations of an embedded motion are the rates of its rates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from comwalk.embedding.motion import EmbeddedMotion, Motion, embed_in
from comwalk.embedding.motion_playing import (
    blended,
    find_segment,
    find_weight,
    play,
)

JOINTS = ("l_shoulder_pitch", "l_elbow_pitch", "head_yaw")
HOME = dict(zip(JOINTS, (0.3, -0.8, 0.1), strict=True))
TIMES = np.array([0.0, 0.7, 1.0, 2.5])
START, BLEND, H = 0.4, 0.6, 1e-5  # [s]


def make(loops: bool) -> EmbeddedMotion:
    """Return random samples, blended in and out; a loop is played twice and a half."""
    positions = np.random.default_rng(1).uniform(-1, 1, (len(TIMES), len(JOINTS)))
    if loops:
        positions[-1] = positions[0]
    motion = Motion("test", JOINTS, TIMES, positions, loops)
    stop = START + (2.5 * TIMES[-1] if loops else TIMES[-1])
    return embed_in(motion, HOME, start=START, stop=stop, blend=BLEND)


MOTIONS = {loops: make(loops) for loops in (False, True)}
both = pytest.mark.parametrize("loops", [False, True], ids=["once", "loop"])
shares = st.floats(-0.1, 1.1)


def played(embedded: EmbeddedMotion, t: float) -> np.ndarray:
    """Return angles, rates and accelerations at a time, (3, joints)."""
    motion, out = embedded.motion, np.full((3, len(JOINTS)), np.nan)
    weight = find_weight(embedded.record[0], t)
    since = t - embedded.start
    play(*motion.spline, int(motion.loops), since, weight, embedded.home, out)
    return out


def junctions(embedded: EmbeddedMotion) -> np.ndarray:
    """Return times at which a third derivative may jump [s]."""
    a, b, T = embedded.start, embedded.stop, embedded.blend
    knots = np.concatenate([k * TIMES[-1] + TIMES for k in range(-1, 4)])
    return np.array([*(a + knots), a, a + T, b - T, b])


def moment(embedded: EmbeddedMotion, share: float) -> float:
    """Return a time that is some share of the way from start to stop [s]."""
    t = embedded.start + share * (embedded.stop - embedded.start)
    assume(np.abs(junctions(embedded) - t).min() > 2 * H)
    return t


@both
@given(share=shares)
def test_accelerations_are_the_rates_of_the_rates(loops, share):
    """While it is blended in and out, too, and where it is at home."""
    embedded = MOTIONS[loops]
    t = moment(embedded, share)
    before, after = (played(embedded, t + d) for d in (-H, H))
    found = played(embedded, t)
    expected = (after - before) / (2 * H)
    assert found[1] == pytest.approx(expected[0], abs=1e-6)
    assert found[2] == pytest.approx(expected[1], abs=1e-5)


@both
def test_what_is_played_does_accelerate(loops):
    """All through it, and not outside."""
    embedded = MOTIONS[loops]
    a, b = embedded.start, embedded.stop
    inside = [played(embedded, t)[2] for t in np.linspace(a + 0.05, b - 0.05, 50)]
    assert np.abs(inside).max(axis=0).min() > 1.0
    for t in (a - 0.3, a, b, b + 0.3):
        assert np.array_equal(played(embedded, t)[0], embedded.home)
        assert not played(embedded, t)[1:].any()


@both
def test_accelerations_do_not_jump(loops):
    """Neither at knots, the seam of a loop among them, nor where the blends begin."""
    embedded = MOTIONS[loops]
    for t in junctions(embedded):
        before, after = played(embedded, t - 1e-9), played(embedded, t + 1e-9)
        assert after[2] == pytest.approx(before[2], abs=1e-5)


@both
def test_a_motion_that_is_over_rests(loops):
    """One that plays once holds its last sample; a loop goes on."""
    motion = MOTIONS[loops].motion
    out, home = np.full((3, len(JOINTS)), np.nan), np.zeros(len(JOINTS))
    for t in (-0.5, TIMES[-1] + 0.3):
        play(*motion.spline, int(loops), t, (1.0, 0.0, 0.0), home, out)
        assert out[1:].any() == loops
        assert out[2].any() == loops


@both
@given(share=shares, home=st.floats(-1.0, 1.0))
def test_one_joint_is_blended_like_all(loops, share, home):
    """The product rule, with the weight's own two rates."""
    embedded = MOTIONS[loops]
    t = moment(embedded, share)
    knots, cubics = embedded.motion.spline

    def at(time: float) -> tuple[float, float, float]:
        k, s, moves = find_segment(knots, int(loops), time - embedded.start)
        weight = find_weight(embedded.record[0], time)
        return blended(np.ascontiguousarray(cubics[k, :, 1]), s, moves, home, weight)

    before, here, after = (np.array(at(t + d)) for d in (-H, 0.0, H))
    assert here[1:] == pytest.approx(((after - before) / (2 * H))[:2], abs=1e-5)


@both
@given(share=shares)
def test_the_weights_rates_are_its_derivatives(loops, share):
    """Rising at first, and falling at the end."""
    embedded = MOTIONS[loops]
    t = moment(embedded, share)
    record = embedded.record[0]
    before, here, after = (np.array(find_weight(record, t + d)) for d in (-H, 0, H))
    assert here[1:] == pytest.approx(((after - before) / (2 * H))[:2], abs=1e-6)
    assert 0.0 <= here[0] <= 1.0
    if BLEND < t - embedded.start < embedded.stop - embedded.start - BLEND:
        assert here.tolist() == [1.0, 0.0, 0.0]
