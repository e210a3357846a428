"""Convex polygons against slower, independent ways."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from comwalk.pattern.polygon import convex_hull, polygon_margin, rectangle, rectangle_in

COORDINATES = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))
POINTS = st.tuples(COORDINATES, COORDINATES)
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def signed_area(vertices):
    x, y = vertices.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_rectangle_is_turned_about_its_centre():
    vertices = rectangle(1.0, 2.0, math.pi / 2, (0.24, 0.13))
    expected = [(0.935, 2.12), (0.935, 1.88), (1.065, 1.88), (1.065, 2.12)]
    np.testing.assert_allclose(vertices, expected, atol=1e-15)
    assert signed_area(vertices) == pytest.approx(0.24 * 0.13)


@given(st.lists(POINTS, min_size=3, max_size=20))
def test_hull_agrees_with_qhull(points):
    points = np.array(points)
    hull = convex_hull(points)
    assume(len(hull) > 2 and signed_area(hull) > 1e-3)
    assert signed_area(hull) == pytest.approx(ConvexHull(points).volume, rel=1e-9)
    assert all(polygon_margin(hull, point) >= -1e-12 for point in points)


def test_hull_of_degenerate_points():
    assert convex_hull(np.array([(1, 2), (1, 2)])).tolist() == [[1.0, 2.0]]
    line = convex_hull(np.array([(0, 0), (1, 1), (2, 2), (0.5, 0.5)]))
    assert line.tolist() == [[0.0, 0.0], [2.0, 2.0]]


@given(st.floats(-3.0, 3.0), POINTS)
def test_margin_outside_is_the_distance_found_by_optimisation(yaw, point):
    sole = rectangle(0.1, -0.2, yaw, (0.24, 0.13))
    margin = polygon_margin(sole, np.array(point))
    assume(margin < -1e-3)

    def cost(a):
        return float(np.sum((rectangle(*_inside(a, yaw)).mean(0) - point) ** 2))

    result = minimize(cost, [0.0, 0.0], bounds=[(-0.12, 0.12), (-0.065, 0.065)])
    assert math.sqrt(result.fun) == pytest.approx(-margin, abs=1e-5)


def _inside(a, yaw):
    """A tiny rectangle at a point of the sole, given in its frame."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return 0.1 + cos * a[0] - sin * a[1], -0.2 + sin * a[0] + cos * a[1], 0.0, (0, 0)


@given(st.floats(-0.12, 0.12), st.floats(-0.065, 0.065), st.floats(-3.0, 3.0))
def test_margin_inside_is_the_distance_to_the_nearest_edge(a, b, yaw):
    x, y, *_ = _inside((a, b), yaw)
    margin = polygon_margin(rectangle(0.1, -0.2, yaw, (0.24, 0.13)), [x, y])
    assert margin == pytest.approx(min(0.12 - abs(a), 0.065 - abs(b)), abs=1e-12)


def test_margin_is_zero_on_edges_and_corners():
    for point in [(0.5, 0.0), (1.0, 0.3), (0.0, 0.0), (1.0, 1.0)]:
        assert polygon_margin(SQUARE, point) == 0.0


def test_margin_of_one_or_two_vertices_is_never_positive():
    assert polygon_margin(np.array([(0.0, 0.0)]), (3.0, 4.0)) == -5.0
    line = np.array([(0.0, 0.0), (2.0, 0.0)])
    assert polygon_margin(line, (1.0, 0.5)) == -0.5
    assert polygon_margin(line, (1.0, 0.0)) == 0.0


@pytest.mark.parametrize("weight", [1.0 / 3.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_no_rectangle_of_many_is_larger_than_the_largest(seed, weight):
    """It lies inside, and none of 200,000 random ones that do is larger."""
    rng = np.random.default_rng(seed)
    hull = convex_hull(rng.normal(size=(9, 2)) * [0.1, 0.05])
    (x, y), (length, width) = rectangle_in(hull, weight)
    for corner in rectangle(x, y, 0.0, (length, width)):
        assert polygon_margin(hull, corner) > -1e-7
    low, high = hull.min(axis=0), hull.max(axis=0)
    centres = rng.uniform(low, high, size=(200_000, 2))
    halves = rng.uniform(0.0, 0.5 * (high - low), size=(200_000, 2))
    inside = np.ones(len(centres), dtype=bool)
    for *normal, offset in ConvexHull(hull).equations:
        inside &= centres @ normal + halves @ np.abs(normal) + offset <= 0.0
    sizes = 2.0 * halves[inside]
    assert inside.any()
    assert (sizes[:, 0] ** weight * sizes[:, 1]).max() <= length**weight * width
