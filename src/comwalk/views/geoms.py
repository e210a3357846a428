"""Shapes of a robot: triangles by body and colour, for pages in a browser.

Meshes with more triangles than a page needs are made coarser: of all vertices in a cell
of a fine lattice, their mean is left.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

from ..robot.loaders import rotation_of
from ..walking import FLOOR
from .scene_data import of_robot

_GEOM = mujoco.mjtGeom
_DRAWN = {
    int(kind)
    for kind in (
        *(_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_ELLIPSOID),
        *(_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_BOX, _GEOM.mjGEOM_MESH),
        *(_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD),
    )
}
_VISIBLE_GROUPS = 3  # MuJoCo shows geoms of the groups below
_ROUND = 20  # corners of a circle
_WIDE = 10.0  # half length of a plane without end [m]
_FINEST = 100  # points along each side of a height field
_MANY = 40_000  # triangles above which a robot is made coarser
_COARSE, _FINE = 2e-3, 1e-4  # lattice whose cells have one vertex each [m]
_STEPS = 2.0**13  # of a vertex, per m: few bytes in a page

_Triangles = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), faces (m, 3)


class Shape(NamedTuple):
    """Triangles of one colour on one body."""

    body: int
    """Index of the body."""
    color: tuple[int, int, int]
    """Red, green and blue, 0 to 255."""
    opacity: float
    """Opacity, in (0, 1]."""
    vertices: np.ndarray
    """Corners [m], in the frame of the body, of shape (n, 3)."""
    faces: np.ndarray
    """Indices of corners, of shape (m, 3), counter-clockwise from outside."""


def shapes_of(model: mujoco.MjModel) -> list[Shape]:
    """Return the visible shapes of a model.

    A robot without visual shapes shows those that it touches with. The level floor is
    left out, as pages have their own.

    Args:
        model: A compiled model.

    Returns:
        Its shapes; those of the world, such as boxes on the floor, have body 0.
    """
    parts: dict[tuple, list[_Triangles]] = defaultdict(list)
    cell = _COARSE if model.nmeshface > _MANY else _FINE
    for geom in _seen(model):
        rgba = tuple(np.round(255.0 * _rgba(model, geom)).astype(int).tolist())
        if rgba[3]:
            key = (int(model.geom_bodyid[geom]), rgba)
            parts[key].append(_placed(model, geom, _triangles(model, geom, cell)))
    return [
        Shape(body, rgba[:3], rgba[3] / 255.0, *_joined(pieces))
        for (body, rgba), pieces in parts.items()
    ]


def _seen(model: mujoco.MjModel) -> list[int]:
    """Return the geoms to draw: visual ones, or all of a robot that has none."""
    drawn = np.isin(model.geom_type, list(_DRAWN))
    floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, FLOOR)
    drawn &= np.arange(model.ngeom) != floor
    visual = drawn & (model.geom_group < _VISIBLE_GROUPS)
    robot = of_robot(model)[model.geom_bodyid]
    seen = visual if (visual & robot).any() else visual | (drawn & robot)
    return np.flatnonzero(seen).tolist()


def _rgba(model: mujoco.MjModel, geom: int) -> np.ndarray:
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    unset = np.array_equal(own, np.array([0.5, 0.5, 0.5, 1.0], np.float32))
    return model.mat_rgba[material] if material >= 0 and unset else own


def _placed(model: mujoco.MjModel, geom: int, triangles: _Triangles) -> _Triangles:
    vertices, faces = triangles
    R = rotation_of(model.geom_quat[geom])
    return vertices @ R.T + model.geom_pos[geom], faces


def _joined(pieces: Iterable[_Triangles]) -> _Triangles:
    """Return several sets of triangles as one."""
    vertices, faces, count = [], [], 0
    for points, corners in pieces:
        vertices.append(points)
        faces.append(corners + count)
        count += len(points)
    return (
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.uint32),
    )


def _triangles(model: mujoco.MjModel, geom: int, cell: float) -> _Triangles:
    """Return the triangles of a geom in its own frame."""
    kind, (a, b, c) = int(model.geom_type[geom]), model.geom_size[geom].tolist()
    if kind == _GEOM.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]), cell)
    if kind == _GEOM.mjGEOM_BOX:
        return _box(a, b, c)
    if kind == _GEOM.mjGEOM_PLANE:
        return _field(a or _WIDE, b or _WIDE, np.zeros((2, 2)))
    if kind == _GEOM.mjGEOM_HFIELD:
        k = int(model.geom_dataid[geom])
        (a, b, c, _), start = model.hfield_size[k].tolist(), int(model.hfield_adr[k])
        shape = int(model.hfield_nrow[k]), int(model.hfield_ncol[k])
        heights = model.hfield_data[start : start + shape[0] * shape[1]]
        return _field(a, b, c * heights.reshape(shape))
    if kind == _GEOM.mjGEOM_CYLINDER:
        side = _revolved([(a, -b), (a, b)])
        return _joined(
            [side, _revolved([(0, -b), (a, -b)]), _revolved([(a, b), (0, b)])]
        )
    angles = np.linspace(-np.pi / 2, np.pi / 2, _ROUND // 2 + 2)
    r, z = np.cos(angles), np.sin(angles)
    if kind == _GEOM.mjGEOM_CAPSULE:
        z = a * z + np.where(angles < 0.0, -b, b)
        return _revolved(np.column_stack([a * r, z]))
    size = (a, a, a) if kind == _GEOM.mjGEOM_SPHERE else (a, b, c)
    vertices, faces = _revolved(np.column_stack([r, z]))
    return vertices * size, faces


def _box(a: float, b: float, c: float) -> _Triangles:
    """Return a box of half lengths a, b, c [m], its edges sharp."""
    corners, faces = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v, n = np.roll(np.eye(3), -axis, axis=0)
            u = sign * u
            square = [-u - v, u - v, u + v, v - u]
            faces += [
                np.array([0, 1, 2]) + len(corners),
                np.array([0, 2, 3]) + len(corners),
            ]
            corners += [sign * n + s for s in square]
    return np.array(corners) * (a, b, c), np.array(faces)


def _field(a: float, b: float, heights: np.ndarray) -> _Triangles:
    """Return the surface of heights [m], (rows, columns), over 2 a by 2 b [m]."""
    rows, columns = (max(2, min(n, _FINEST)) for n in heights.shape)
    i = np.linspace(0, len(heights) - 1, rows).round().astype(int)
    j = np.linspace(0, heights.shape[1] - 1, columns).round().astype(int)
    x = a * (2.0 * j / (heights.shape[1] - 1) - 1.0)
    y = b * (2.0 * i / (len(heights) - 1) - 1.0)
    grid = np.stack([*np.meshgrid(x, y), heights[np.ix_(i, j)]], axis=-1)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, back = corner + 1, corner + columns
    faces = [(corner, right, back + 1), (corner, back + 1, back)]
    return grid.reshape(-1, 3), np.concatenate([np.stack(f, axis=1) for f in faces])


def _revolved(profile: np.ndarray | list[tuple[float, float]]) -> _Triangles:
    """Return a profile of radii and heights [m], from below, turned about z."""
    n, (r, z) = _ROUND, np.asarray(profile, dtype=float).T
    angles = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    x, y = np.outer(r, np.cos(angles)), np.outer(r, np.sin(angles))
    vertices = np.stack([x, y, np.repeat(z[:, None], n, axis=1)], axis=-1)
    i, j = np.meshgrid(np.arange(len(r) - 1), np.arange(n), indexing="ij")
    k, l = i * n + j, i * n + (j + 1) % n  # noqa: E741
    faces = np.stack([np.stack([k, l, l + n]), np.stack([k, l + n, k + n])])
    return vertices.reshape(-1, 3), faces.transpose(0, 2, 3, 1).reshape(-1, 3)


# ---- Meshes -----------------------------------------------------------------------


def _mesh(model: mujoco.MjModel, mesh: int, cell: float) -> _Triangles:
    """Return a mesh with its vertices on a lattice, and its edges sharp."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = model.mesh_vert[first : first + count].astype(float)
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return _sharpened(
        *_coarsened(vertices, model.mesh_face[first : first + count], cell)
    )


def _coarsened(vertices: np.ndarray, faces: np.ndarray, cell: float) -> _Triangles:
    """Join vertices near a point of a lattice; drop triangles without area."""
    lattice = np.round(vertices / cell).astype(np.int64)
    _, place, count = np.unique(
        lattice, axis=0, return_inverse=True, return_counts=True
    )
    place = place.reshape(-1)
    sums = [np.bincount(place, column) for column in vertices.T]
    points = np.column_stack(sums) / count[:, None]
    faces = place[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    turned = np.argmin(faces, axis=1)[:, None] + np.arange(3)
    faces = np.unique(np.take_along_axis(faces, turned % 3, axis=1), axis=0)
    return np.round(points * _STEPS) / _STEPS, faces


_DIRECTIONS = np.array(
    [
        (x, y, z)
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
        for z in (-1, 0, 1)
        if (x, y, z) != (0, 0, 0)
    ]
)
_DIRECTIONS = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)


def _sharpened(vertices: np.ndarray, faces: np.ndarray) -> _Triangles:
    """Part triangles that look different ways, so that their edge is shaded sharp.

    A browser shades the triangles around a shared vertex as one smooth surface.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    way = np.argmax(np.cross(b - a, c - a) @ _DIRECTIONS.T, axis=1)
    keys = faces * len(_DIRECTIONS) + way[:, None]
    used, place = np.unique(keys, return_inverse=True)
    return vertices[used // len(_DIRECTIONS)], place.reshape(faces.shape)
