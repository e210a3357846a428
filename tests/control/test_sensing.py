"""ZMP from wrenches and tilt, against cases that a hand can check."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import tilt_of
from scipy.spatial.transform import Rotation

from comwalk.control.sensing import Contact, ground_load, zmp_from_wrenches
from comwalk.embedding.rotations import rotation_yaw

examples = settings(max_examples=60)
metre = st.floats(-5.0, 5.0)
newton = st.floats(-500.0, 500.0)
point = st.tuples(metre, metre, st.floats(0.0, 0.2))
push = st.tuples(newton, newton, st.floats(50.0, 1000.0))
moment = st.tuples(newton, newton, newton)
contact = st.builds(Contact, point, push, moment)
contacts = st.lists(contact, min_size=1, max_size=4)


def test_a_force_through_a_point_on_the_ground():
    """The ZMP is the point, whatever the force's direction."""
    foot = Contact((0.3, -0.2, 0.0), (40.0, -70.0, 600.0), (0.0, 0.0, 3.0))
    assert zmp_from_wrenches([foot]).tolist() == pytest.approx([0.3, -0.2], abs=1e-15)


def test_two_feet_with_equal_load():
    """The ZMP is midway between them."""
    left = Contact((0.1, 0.09, 0.0), (0.0, 0.0, 330.0), (0.0, 0.0, 0.0))
    right = Contact((0.3, -0.09, 0.0), (0.0, 0.0, 330.0), (0.0, 0.0, 0.0))
    assert zmp_from_wrenches([left, right]).tolist() == pytest.approx([0.2, 0.0])


def test_signs_of_the_moment():
    """p_x = -M_y / F_z: a moment that lifts the toes moves the ZMP back."""
    foot = Contact((0.0, 0.0, 0.0), (0.0, 0.0, 500.0), (10.0, 20.0, 0.0))
    assert zmp_from_wrenches([foot]).tolist() == pytest.approx([-0.04, 0.02])


def test_a_horizontal_force_above_the_ground():
    """A sensor at 0.08 m that feels 50 N forward has its ZMP 8 mm behind it.

    About the ground point below it, the force makes the moment z f_x about y.
    """
    foot = Contact((0.0, 0.0, 0.08), (50.0, 0.0, 500.0), (0.0, 0.0, 0.0))
    assert zmp_from_wrenches([foot]).tolist() == pytest.approx([-0.008, 0.0])


@examples
@given(contacts)
def test_there_is_no_horizontal_moment_about_the_zmp(feet):
    """The definition: the moment of all contacts about the ZMP is vertical."""
    x, y = zmp_from_wrenches(feet)
    total = np.zeros(3)
    for r, f, m in feet:
        total += np.cross(np.array(r) - [x, y, 0.0], f) + m
    size = 1.0 + max(np.abs(np.concatenate(foot)).max() for foot in feet) ** 2
    assert np.abs(total[:2]).max() < 1e-12 * size * len(feet)


@examples
@given(contacts, point)
def test_the_point_of_reference_does_not_matter(feet, other):
    """Moments taken about any other point give the same ZMP."""
    moved = [
        Contact(other, f, tuple(np.cross(np.subtract(r, other), f) + m))
        for r, f, m in feet
    ]
    assert zmp_from_wrenches(moved) == pytest.approx(zmp_from_wrenches(feet), abs=1e-9)


@examples
@given(contacts, metre, metre, st.floats(-4.0, 4.0))
def test_the_zmp_moves_with_the_world(feet, x, y, yaw):
    """A robot elsewhere, turned, has its ZMP elsewhere, turned."""
    R, t = rotation_yaw(yaw), np.array([x, y, 0.0])
    moved = [
        Contact(tuple(R @ r + t), tuple(R @ f), tuple(R @ m))
        for r, f, m in (map(np.array, foot) for foot in feet)
    ]
    expected = R[:2, :2] @ zmp_from_wrenches(feet) + t[:2]
    assert zmp_from_wrenches(moved) == pytest.approx(expected, abs=1e-9)


@examples
@given(contacts)
def test_vertical_forces_without_moments_keep_the_zmp_in_their_hull(feet):
    """A centre of pressure is a weighted mean of the points."""
    feet = [Contact(r, (0.0, 0.0, f[2]), (0.0, 0.0, 0.0)) for r, f, _ in feet]
    weights = np.array([foot.force[2] for foot in feet])
    points = np.array([foot.point[:2] for foot in feet])
    mean = weights @ points / weights.sum()
    assert zmp_from_wrenches(feet) == pytest.approx(mean, abs=1e-12)


@pytest.mark.parametrize("f_z", [0.0, 1.0, -300.0, math.nan])
def test_without_load_there_is_no_zmp(f_z):
    """At most the least load, a pull, and a sensor that reads no number."""
    foot = Contact((0.0, 0.0, 0.0), (0.0, 0.0, f_z), (0.0, 0.0, 0.0))
    assert zmp_from_wrenches([foot]) is None


def test_the_least_load_is_of_all_feet():
    """33 N on each of two feet are 66 N."""
    foot = Contact((0.0, 0.0, 0.0), (0.0, 0.0, 33.0), (0.0, 0.0, 0.0))
    assert zmp_from_wrenches([foot], least_load=40.0) is None
    assert zmp_from_wrenches([foot, foot], least_load=40.0) is not None
    assert zmp_from_wrenches([]) is None


def test_ground_load():
    """Forces add, moments are taken about the world's origin."""
    foot = Contact((0.5, 0.2, 0.0), (0.0, 0.0, 100.0), (1.0, 2.0, 3.0))
    assert ground_load([foot, foot]) == pytest.approx((200.0, 42.0, -96.0))


@examples
@given(st.floats(-math.pi, math.pi), st.floats(0.0, math.pi), st.floats(-3.0, 3.0))
def test_tilt_is_the_angle_to_the_vertical(heading, tilt, spin):
    """Whatever way it leans and turns about its own axis, and for either quaternion."""
    R = Rotation.from_euler("ZYZ", [heading, tilt, spin])
    x, y, z, w = R.as_quat()
    for quaternion in (np.array([w, x, y, z]), -np.array([w, x, y, z])):
        assert tilt_of(quaternion) == pytest.approx(tilt, abs=1e-7)


def test_tilt_at_its_ends():
    """Upright is exactly 0, upside down is exactly pi."""
    assert tilt_of(np.array([1.0, 0.0, 0.0, 0.0])) == 0.0
    assert tilt_of(np.array([0.0, 1.0, 0.0, 0.0])) == math.pi
    assert tilt_of(np.array([0.0, 0.0, 1.0, 0.0])) == math.pi
    half = math.sqrt(0.5)
    right = tilt_of(np.array([half, 0.0, half, 0.0]))
    assert right == pytest.approx(math.pi / 2, abs=1e-15)
