"""Rotations and twist transport, with scipy's rotations as the oracle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import rotation_log, yaw_of
from scipy.spatial.transform import Rotation

from comwalk.embedding.rotations import (
    level_error,
    rotate_twist,
    rotation_yaw,
    shift,
    skew,
    yaw_of_quaternion,
)

examples = settings(max_examples=60)
number = st.floats(-10.0, 10.0)
vector = st.tuples(number, number, number).map(np.array)
angle = st.floats(-math.pi, math.pi)
direction = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)
AXES = [
    *np.eye(3),
    *-np.eye(3),
    *(np.array(v) / math.sqrt(2) for v in ((1, 1, 0), (1, 0, -1), (0, -1, 1))),
    *(np.array(v) / math.sqrt(3) for v in ((1, 1, 1), (-1, 1, 1), (1, -1, -1))),
]


def turn(axis: np.ndarray, theta: float) -> np.ndarray:
    """Return a rotation by Rodrigues' formula."""
    K = skew(axis)
    return np.eye(3) + math.sin(theta) * K + (1.0 - math.cos(theta)) * K @ K


@examples
@given(vector, vector)
def test_skew_is_the_cross_product(v, w):
    """Eq. (16): [v x] w."""
    assert np.allclose(skew(v) @ w, np.cross(v, w), atol=1e-12)
    assert np.array_equal(skew(v).T, -skew(v))


@examples
@given(vector, vector)
def test_arms_add(a, b):
    """Eqs. (16), (20): X(a) X(b) = X(a + b), and X(-a) is the inverse."""
    assert np.allclose(shift(a) @ shift(b), shift(a + b), atol=1e-12)
    assert np.allclose(shift(a) @ shift(-a), np.eye(6), atol=1e-12)


@examples
@given(vector, vector, vector, vector)
def test_shift_takes_the_twist_of_an_end_to_the_body(r_o, r_i, v, omega):
    """Eqs. (15), (16): a rigid body turning about an end point."""
    at_end, r = np.concatenate([v, omega]), r_i - r_o
    at_body = shift(r) @ at_end
    assert np.allclose(at_body[:3], v + np.cross(omega, r_o - r_i), atol=1e-9)
    assert np.array_equal(at_body[3:], omega)


@examples
@given(direction, angle, vector, vector)
def test_rotate_twist_turns_both_halves(axis, theta, v, omega):
    """Eq. (17): and it commutes with the shift in the other frame's axes."""
    R = turn(axis, theta)
    X_o, x = rotate_twist(R), np.concatenate([v, omega])
    assert np.allclose(X_o @ x, np.concatenate([R @ v, R @ omega]), atol=1e-12)
    assert np.allclose(X_o @ shift(v) @ X_o.T, shift(R @ v), atol=1e-9)


@examples
@given(direction, st.floats(0.0, math.pi))
def test_log_is_the_one_of_scipy(axis, theta):
    """Anywhere: the same rotation vector, or its twin at exactly pi."""
    R = Rotation.from_rotvec(theta * axis).as_matrix()
    log = rotation_log(R)
    assert np.linalg.norm(log) == pytest.approx(theta, abs=1e-7)
    assert np.allclose(turn(axis, theta), R, atol=1e-12)
    back = Rotation.from_rotvec(log).as_matrix()
    assert np.abs(back - R).max() < 1e-9
    if theta < math.pi - 1e-5:
        assert np.abs(log - theta * axis).max() < 1e-8


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("theta", [0.0, 1e-300, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3])
def test_log_near_zero(axis, theta):
    """Small rotations keep all their digits."""
    log = rotation_log(turn(axis, theta))
    assert np.abs(log - theta * axis).max() < 1e-15 + 1e-9 * theta


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize(
    "gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-7, 5e-7, 1e-6, 2e-6, 1e-5, 1e-3]
)
def test_log_near_a_half_turn(axis, gap):
    """Near pi the axis comes from R + R^T; on both sides of it the log is right."""
    for theta in (math.pi - gap, math.pi + gap):
        R = turn(axis, theta)
        log = rotation_log(R)
        expected = theta * axis if theta <= math.pi else (theta - math.tau) * axis
        assert np.linalg.norm(log) <= math.pi + 1e-12
        error = np.abs(log - expected).max()
        if gap < 1e-12:  # the half turn has two logs
            error = min(error, np.abs(log + expected).max())
        assert error < 2e-9


@pytest.mark.parametrize("axis", AXES, ids=str)
def test_an_exact_half_turn_is_not_zero(axis):
    """R = 2 a a^T - I is symmetric: R - R^T says nothing, not even the axis."""
    R = 2.0 * np.outer(axis, axis) - np.eye(3)
    log = rotation_log(R)
    assert np.linalg.norm(log) == pytest.approx(math.pi, abs=1e-12)
    assert abs(log @ axis) == pytest.approx(math.pi, abs=1e-12)


@examples
@given(direction, angle, direction, angle)
def test_error_takes_one_rotation_to_the_other(a, alpha, b, beta):
    """log(R_d R^T) in world axes: exp of it times R is R_d."""
    R_d, R = turn(a, alpha), turn(b, beta)
    error = Rotation.from_rotvec(rotation_log(R_d @ R.T)).as_matrix()
    assert np.abs(error @ R - R_d).max() < 1e-9


@examples
@given(st.floats(-20.0, 20.0), direction, angle)
def test_level_error_is_the_error_to_a_yaw(yaw, axis, theta):
    """The quick way equals the plain one."""
    R = turn(axis, theta)
    plain = rotation_log(rotation_yaw(yaw) @ R.T)
    quick = level_error(yaw, R)
    if np.linalg.norm(plain) < math.pi - 1e-5:
        assert np.abs(quick - plain).max() < 1e-9
    R_d = Rotation.from_rotvec(quick).as_matrix() @ R
    assert np.abs(R_d - rotation_yaw(yaw)).max() < 1e-9


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("yaw", [0.0, 1.0, math.pi, -math.pi / 2])
def test_level_error_at_exact_half_turns(axis, yaw):
    """A trunk turned by exactly 180 degrees has somewhere to go."""
    R = (2.0 * np.outer(axis, axis) - np.eye(3)) @ rotation_yaw(yaw)
    error = level_error(yaw, R)
    assert np.linalg.norm(error) == pytest.approx(math.pi, abs=1e-9)
    assert abs(error @ axis) == pytest.approx(math.pi, abs=1e-9)


@examples
@given(st.floats(-50.0, 50.0))
def test_yaw_round_trip(yaw):
    """Modulo whole turns, and the x axis is where the yaw says."""
    R = rotation_yaw(yaw)
    assert math.remainder(yaw_of(R) - yaw, math.tau) == pytest.approx(0, abs=1e-12)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.allclose(R[:, 0], [math.cos(yaw), math.sin(yaw), 0.0], atol=0)


def test_yaw_of_a_half_turn():
    """The yaw of exactly 180 degrees is pi, not -pi."""
    assert yaw_of(np.diag([-1.0, -1.0, 1.0])) == math.pi


def test_yaw_of_a_tilted_frame_is_its_heading():
    """Pitch and roll do not change where the x axis points on the ground."""
    R = Rotation.from_euler("ZYX", [0.7, 0.4, -0.3]).as_matrix()
    assert yaw_of(R) == pytest.approx(0.7, abs=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_yaw_of_a_quaternion_is_that_of_its_matrix(yaw, pitch, roll):
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    x, y, z, w = rotation.as_quat()
    ours = yaw_of_quaternion(np.array([w, x, y, z]))
    assert ours == pytest.approx(yaw_of(rotation.as_matrix()), abs=1e-9)
    assert ours == pytest.approx(yaw, abs=1e-9)
