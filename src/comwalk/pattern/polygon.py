"""Flat convex polygons: the soles and their hull, on which the ZMP must stay.

Every polygon is an array of vertices [m], shape (k, 2), counter-clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def rectangle(x: float, y: float, yaw: float, size: tuple[float, float]) -> np.ndarray:
    """Return the vertices of a turned rectangle, such as a sole.

    Args:
        x: Centre [m].
        y: Centre [m].
        yaw: Direction of its length [rad].
        size: Length and width [m].

    Returns:
        Vertices [m], shape (4, 2), counter-clockwise, front left first.

    Example:
        >>> rectangle(0.0, 0.0, 0.0, (0.24, 0.13))[0].tolist()
        [0.12, 0.065]
    """
    cos, sin = math.cos(yaw), math.sin(yaw)
    l, w = size[0] / 2, size[1] / 2  # noqa: E741
    corners = ((l, w), (-l, w), (-l, -w), (l, -w))
    return np.array(
        [(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in corners]
    )


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the convex hull of points in the plane (Andrew's monotone chain).

    Args:
        points: Points [m], shape (n, 2), n >= 1.

    Returns:
        Vertices [m], shape (k, 2), counter-clockwise from the lowest x, without points
        on the edges; k is 1 or 2 if all points are equal or in one line.

    Example:
        >>> square = np.array([(0, 0), (2, 0), (1, 1), (2, 2), (0, 2)])
        >>> convex_hull(square).tolist()
        [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) == 1:
        return np.array(ordered)
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the part of the hull on the right of the way through sorted points."""
    chain: list[tuple[float, float]] = []
    for x, y in points:
        while len(chain) > 1:
            (x_0, y_0), (x_1, y_1) = chain[-2], chain[-1]
            if (x_1 - x_0) * (y - y_0) - (y_1 - y_0) * (x - x_0) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def polygon_margin(polygon: np.ndarray, point: np.ndarray | Sequence[float]) -> float:
    """Return the distance of a point to the nearest edge of a convex polygon.

    Args:
        polygon: Vertices [m], shape (k, 2), counter-clockwise, k >= 1.
        point: The point [m], shape (2,).

    Returns:
        The distance to the nearest edge [m]: positive inside, zero on the edge,
        negative outside. A polygon of one or two vertices has no inside.

    Example:
        >>> sole = rectangle(0.0, 0.0, 0.0, (0.2, 0.12))
        >>> round(polygon_margin(sole, np.array([0.05, 0.0])), 6)
        0.05
        >>> round(polygon_margin(sole, np.array([0.13, 0.10])), 6)
        -0.05
    """
    x, y = float(point[0]), float(point[1])
    vertices = polygon.tolist() if isinstance(polygon, np.ndarray) else polygon
    inside = len(vertices) > 2
    nearest = math.inf
    x_0, y_0 = vertices[-1]
    for x_1, y_1 in vertices:
        dx, dy, px, py = x_1 - x_0, y_1 - y_0, x - x_0, y - y_0
        length_2 = dx * dx + dy * dy
        s = (px * dx + py * dy) / length_2 if length_2 > 0.0 else 0.0
        s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
        nearest = min(nearest, math.hypot(px - s * dx, py - s * dy))
        inside = inside and dx * py - dy * px >= 0.0
        x_0, y_0 = x_1, y_1
    return nearest if inside else -nearest


def rectangle_in(
    polygon: np.ndarray, weight: float = 1.0
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the largest rectangle along x and y inside a convex polygon.

    It is the one of largest area: a concave problem, log(l) + log(w) within the
    polygon's half planes.

    Args:
        polygon: Vertices [m], shape (k, 2), counter-clockwise, k >= 3.
        weight: How much more length counts than width, as the power of l [-].

    Returns:
        Its centre (x, y) and its length along x and width along y [m].

    Example:
        >>> (x, y), size = rectangle_in(np.array([(0, 0), (4, 0), (4, 2), (0, 2)]))
        >>> [round(v, 6) for v in (x, y, *size)]
        [2.0, 1.0, 4.0, 2.0]
    """
    from scipy.optimize import minimize

    polygon = np.asarray(polygon, dtype=float)
    edges = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.einsum("kd,kd->k", normals, polygon)
    A = np.hstack([normals, np.abs(normals)])  # of (x, y, half length, half width)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    scale = float((high - low).max())
    start = np.array([*polygon.mean(axis=0), *(0.02 * (high - low))])
    found = minimize(
        lambda v: -weight * math.log(v[2]) - math.log(v[3]),
        start / scale,
        jac=lambda v: np.array([0.0, 0.0, -weight / v[2], -1.0 / v[3]]),
        bounds=[(None, None)] * 2 + [(1e-6, None)] * 2,
        constraints={
            "type": "ineq",
            "fun": lambda v: offsets / scale - A @ v,
            "jac": lambda v: -A,
        },
        options={"maxiter": 200, "ftol": 1e-12},
    )
    x, y, l, w = (found.x * scale).tolist()  # noqa: E741
    return (x, y), (2.0 * l, 2.0 * w)


def share_between(zmp: np.ndarray, left: np.ndarray, right: np.ndarray) -> float:
    """Return the share of the weight on the left foot, from where the ZMP is.

    Args:
        zmp: The ZMP [m], (2,).
        left: Middle of the left sole [m], in the same axes, (2,).
        right: Middle of the right sole [m], (2,).

    Returns:
        Share [-]: 0 at the right sole or beyond, 1 at the left one.
    """
    (p_x, p_y), (x_l, y_l), (x_r, y_r) = zmp.tolist(), left.tolist(), right.tolist()
    d_x, d_y = x_l - x_r, y_l - y_r
    share = ((p_x - x_r) * d_x + (p_y - y_r) * d_y) / (d_x * d_x + d_y * d_y)
    return min(max(share, 0.0), 1.0)
