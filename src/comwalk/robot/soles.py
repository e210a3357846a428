"""The sole of a foot: its largest flat face that points down.

Collision shapes count first, then what is only seen. A foot without any shape gets a
sole of usual proportions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from ..embedding import rotation_yaw
from ..errors import ModelError
from ..pattern import convex_hull, rectangle, rectangle_in
from ..settings import table_of
from ..sides import Side
from .kinematic_tree import Skeleton
from .loaders import LinkMesh, mesh_vertices
from .profile import SoleNumbers

Box = tuple[float, float, float, float]
"""Centre x, y and length and width of a contact box [m], in the plane of the sole."""

CROSSWISE = 1.3
"""How much wider than long a foot must be to lie across [-]."""

_LEAST_AREA = 0.003  # smallest flat that a robot can stand on, in leg lengths squared
_LONGEST = 1.0  # length of the longest foot, in leg lengths
_DEPTH = 0.012  # how far above the lowest face a point touches, in leg lengths
_LOWEST = 0.03  # how far above all that collides a sole may be, in leg lengths
_STEEPEST = 0.85  # least share of a face's normal that looks down
_TILTED = 0.07  # angle from which on a sole is taken to be tilted, not rough [rad]
_FLAT, _LEVEL = (
    1e-5,
    1e-4,
)  # a sole that is exactly flat [m] may be tilted by less [rad]
_USUAL = 0.28, 0.13, 0.1  # length, width, ankle height of a sole, in leg lengths
_SAME = 5e-4  # difference under which a given sole is the one that was found [m]
_NOWHERE = np.zeros((0, 3))

SHAPES, FITTED = "collision geometry", "fitted"
"""What a sole was found from: the file's own contact shapes; nothing at all."""


@dataclass(frozen=True, eq=False)
class Sole:
    """The flat of a foot, in the frame of the foot's body."""

    body: str
    """Body that the last joint of the leg moves."""
    position: np.ndarray
    """Centre of the contact rectangle [m], of shape (3,)."""
    rotation: np.ndarray
    """Axes of the sole: x forward, z away from the ground, of shape (3, 3)."""
    size: tuple[float, float]
    """Length and width of the largest rectangle in it [m]."""
    polygon: np.ndarray
    """Its corners [m], about the centre, counter-clockwise, of shape (k, 2)."""
    origin: str
    """What it was found from: "collision geometry", "meshes", "fitted", "profile"."""
    ankle: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The leg's last joint, seen from the centre in the sole's axes [m]."""
    geoms: tuple[str, ...] = ()
    """The file's own geoms that touch the ground; none if contact boxes must do."""
    boxes: tuple[Box, ...] = ()
    """Contact boxes that fill it, about the centre."""
    crosswise: bool = False
    """Whether the foot lay across the walking direction and was turned lengthwise."""

    @property
    def is_fitted(self) -> bool:
        """Whether it is of usual proportions, as nothing tells its own."""
        return self.origin == FITTED


def sole_notes(soles: Mapping[Side, Sole]) -> list[str]:
    """Return what the user is told of soles that are not as the file has them."""
    notes = []
    for side, sole in soles.items():
        if sole.crosswise:
            notes.append(
                f"the {side} foot lies across the walking direction in the file: its "
                "sole is turned lengthwise"
            )
        if sole.is_fitted:
            notes.append(fitted_note(side))
    return notes


def fitted_note(side: Side) -> str:
    """Return the note on a foot whose sole is made up."""
    return f"the {side} foot has no shape: a sole of usual proportions is assumed"


@dataclass(frozen=True, eq=False)
class Face:
    """The surface that a sole is made of."""

    points: np.ndarray
    """Points on the largest flat face that looks down [m], world, of shape (n, 3)."""
    origin: str
    """What they are from, as `Sole.origin`."""
    depth: float
    """How far above the lowest a point still touches the ground [m]."""


def find_face(zero: Skeleton, leg: Sequence[int], meshes: Sequence[LinkMesh]) -> Face:
    """Return the face that a foot stands on.

    Args:
        zero: The model in its zero posture.
        leg: Joints of the leg.
        meshes: Meshes of the model's bodies.

    Returns:
        The face.

    Raises:
        ModelError: If the foot has shapes, but none with a flat face.
    """
    length = zero.leg_length(leg)
    body = zero.body_of(leg[-1])
    tries = _shapes_of(zero, zero.beyond(body), meshes)
    floor = min((p[:, 2].min() for _, p in tries[:2] if len(p)), default=math.inf)
    high = None
    for origin, points in tries:
        found = _lowest_face(points, length)
        if found is None:
            continue
        face = Face(found, origin, _DEPTH * length)
        if found[:, 2].min() < floor + _LOWEST * length:
            return face
        high = high or face
    if high is not None:
        return high
    if any(len(points) for _, points in tries):
        raise ModelError(
            f"{zero.name}: {zero.model.body(body).name} reaches the ground with no "
            f"flat of {1e4 * _LEAST_AREA * length**2:.0f} cm^2 at most "
            f"{_LONGEST * length:.2g} m long, so it is no foot; comwalk walks on flat "
            "soles (a file of --profile can name other legs)"
        )
    return Face(_fitted_face(zero, leg, length), FITTED, 0.0)


def _shapes_of(
    zero: Skeleton, bodies: Sequence[int], meshes: Sequence[LinkMesh]
) -> list[tuple[str, np.ndarray]]:
    """Return the points [m] of all that bodies consist of, world, best first."""
    names = {zero.model.body(b).name for b in bodies}
    own = [mesh for mesh in meshes if mesh.body in names]
    return [
        (SHAPES, _geom_points(zero, bodies, collides=True)),
        ("collision meshes", _mesh_points(zero, [x for x in own if x.collides])),
        ("meshes", _mesh_points(zero, [x for x in own if not x.collides])),
        ("visual geometry", _geom_points(zero, bodies, collides=False)),
    ]


def _lowest_face(points: np.ndarray, length: float) -> np.ndarray | None:
    """Return the points on the largest face that looks down, None if it is small.

    Args:
        points: Points [m], world, (n, 3).
        length: Length of the leg [m].
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points) if len(points) > 3 else None
    except QhullError:
        hull = None
    if hull is None:
        return None
    corners, planes = points[hull.vertices], hull.equations
    best, area = None, _LEAST_AREA * length**2
    for *normal, offset in planes[planes[:, 2] < -_STEEPEST]:
        face = corners[-(corners @ normal + offset) < _DEPTH * length]
        size = _area(_flattened(face, np.array(normal)))
        long = np.ptp(face[:, :2], axis=0).max() > _LONGEST * length
        if size > 1.02 * area and not long:
            best, area = face, size
    return best


def _flattened(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    along = points[:, 2:] / normal[2]
    return convex_hull((points - along * normal)[:, :2])


def _area(polygon: np.ndarray) -> float:
    """Return the area of a polygon [m^2]."""
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


# ---- Points -----------------------------------------------------------------------


def _geom_points(zero: Skeleton, bodies: Sequence[int], collides: bool) -> np.ndarray:
    """Return points on the primitive geoms of bodies [m], world, (n, 3)."""
    geoms = np.flatnonzero(np.isin(zero.model.geom_bodyid, bodies)).tolist()
    found = [_points_of_geom(zero, geom, collides) for geom in geoms]
    return np.vstack([_NOWHERE, *found])


def _points_of_geom(zero: Skeleton, geom: int, collides: bool) -> np.ndarray:
    """Return points on a primitive geom [m], world, if it is of the wanted kind."""
    m, d = zero.model, zero.data
    touches = bool(m.geom_contype[geom] or m.geom_conaffinity[geom])
    R = d.geom_xmat[geom].reshape(3, 3)
    local = _primitive_points(int(m.geom_type[geom]), m.geom_size[geom], R)
    return local @ R.T + d.geom_xpos[geom] if touches == collides else _NOWHERE


def _primitive_points(kind: int, size: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return corners of a geom in its own frame; of balls, their lowest and highest."""
    kinds = mujoco.mjtGeom
    a, b, c = size.tolist()
    if kind == kinds.mjGEOM_BOX:
        return np.array(np.meshgrid([-a, a], [-b, b], [-c, c])).reshape(3, -1).T
    if kind == kinds.mjGEOM_CYLINDER:
        turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.stack([a * np.cos(turn), a * np.sin(turn), np.full(16, b)], axis=1)
        return np.vstack([ring, ring * [1, 1, -1]])
    if kind == kinds.mjGEOM_SPHERE:
        return np.outer([-a, a], R[2])
    if kind == kinds.mjGEOM_CAPSULE:
        ends = np.array([[0, 0, -b], [0, 0, b]])
        return np.vstack([ends - a * R[2], ends + a * R[2]])
    if kind == kinds.mjGEOM_ELLIPSOID:
        radii = np.array([a, b, c])
        low = radii**2 * R[2] / np.linalg.norm(radii * R[2])
        return np.vstack([-low, low])
    return _NOWHERE


def _mesh_points(zero: Skeleton, meshes: Sequence[LinkMesh]) -> np.ndarray:
    """Return the vertices of meshes [m], world, (n, 3)."""
    found = [_NOWHERE]
    for mesh in meshes:
        body = zero.model.body(mesh.body).id
        found.append(mesh_vertices(mesh) @ zero.rotation(body).T + zero.data.xpos[body])
    return np.vstack(found)


def _fitted_face(zero: Skeleton, leg: Sequence[int], length: float) -> np.ndarray:
    l, w, h = (share * length for share in _USUAL)  # noqa: E741
    x, y = np.array([-0.4, 0.6, 0.6, -0.4]) * l, np.array([-0.5, -0.5, 0.5, 0.5]) * w
    return zero.anchors(leg)[-1] + np.stack([x, y, np.full(4, -h)], axis=1)


# ---- From a face to a sole --------------------------------------------------------


def make_sole(
    zero: Skeleton,
    leg: Sequence[int],
    face: Face,
    forward: float,
    given: SoleNumbers | None = None,
) -> Sole:
    """Return the sole of a foot.

    Args:
        zero: The model in its zero posture.
        leg: Joints of the leg.
        face: What the foot stands on.
        forward: Yaw of the forward axis [rad].
        given: What is known of it.

    Returns:
        The sole, in the frame of its foot's body; the one that was found, if what is
        given does not differ.
    """
    sole = _found_sole(zero, leg, face, forward)
    wanted = sole_numbers(sole) | table_of(given or SoleNumbers())
    near = (abs(wanted[k] - v) < _SAME for k, v in sole_numbers(sole).items())
    if all(near):
        return sole
    size = wanted["length"], wanted["width"]
    ankle = -wanted["x"], -wanted["y"], wanted["height"]
    return replace(
        sole,
        position=sole.position + sole.rotation @ np.subtract(sole.ankle, ankle),
        size=size,
        polygon=rectangle(0.0, 0.0, 0.0, size),
        ankle=ankle,
        boxes=((0.0, 0.0, *size),),
        geoms=(),
        origin="profile",
        crosswise=False,
    )


def sole_numbers(sole: Sole) -> dict[str, float]:
    """Return the numbers of a sole as a profile has them.

    Args:
        sole: The sole.

    Returns:
        `length`, `width`, `x`, `y` and `height` [m], as in `SoleNumbers`.
    """
    (length, width), (x, y, height) = sole.size, sole.ankle
    return {"length": length, "width": width, "x": -x, "y": -y, "height": height}


def _found_sole(zero: Skeleton, leg: Sequence[int], face: Face, forward: float) -> Sole:
    """Return the sole of a face."""
    body, ankle = zero.body_of(leg[-1]), zero.anchors(leg)[-1]
    R = _face_axes(face, forward)
    local = (face.points - ankle) @ R
    ground = float(local[:, 2].min())
    corners, crosswise = _lengthwise(convex_hull(local[:, :2]))
    own = face.origin == SHAPES and not crosswise
    top = float(ankle @ R[:, 2]) + ground + face.depth
    boxes = () if own else _boxes_in(corners)
    (x, y), size = rectangle_in(corners)
    shape = [rectangle(*box[:2], 0.0, box[2:]) for box in boxes] or [corners]
    R_body, r = zero.rotation(body), zero.data.xpos[body]
    return Sole(
        body=zero.model.body(body).name,
        position=R_body.T @ (ankle + R @ [x, y, ground] - r),
        rotation=R_body.T @ R,
        size=size,
        polygon=convex_hull(np.vstack(shape)) - [x, y],
        ankle=(-x, -y, -ground),
        boxes=tuple((a - x, b - y, c, d) for a, b, c, d in boxes),
        origin=face.origin,
        geoms=_ground_geoms(zero, body, R[:, 2], top) if own else (),
        crosswise=crosswise,
    )


def _face_axes(face: Face, forward: float) -> np.ndarray:
    """Return the axes of a sole: its normal, and the forward axis in its plane."""
    centred = face.points - face.points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    normal = normal if normal[2] > 0 else -normal
    upright, tilt = rotation_yaw(forward), math.acos(min(1.0, float(normal[2])))
    is_flat = np.abs(centred @ normal).max() < _FLAT
    if tilt < (_LEVEL if is_flat else _TILTED):
        return upright
    x = upright[:, 0] - (upright[:, 0] @ normal) * normal
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _lengthwise(corners: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the corners of a sole about the ankle, longer than wide.

    No foot is much wider than long: a mesh that is was turned by a right angle.
    """
    length, width = np.ptp(corners, axis=0)
    if width < CROSSWISE * length:
        return corners, False
    x, y = corners.T
    toes = math.copysign(1.0, float(y.min() + y.max()))
    return convex_hull(np.stack([toes * y, -toes * x], axis=1)), True


def _boxes_in(corners: np.ndarray) -> tuple[Box, ...]:
    """Return one or two boxes that fill a sole: a long one, and a wide one."""
    long, wide = (
        (*centre, *size)
        for centre, size in (rectangle_in(corners, w) for w in (3.0, 1.0 / 3.0))
    )
    alike = long[2] - wide[2] < 0.05 * long[2] and wide[3] - long[3] < 0.05 * wide[3]
    return (long,) if alike else (long, wide)


def _ground_geoms(
    zero: Skeleton, body: int, normal: np.ndarray, height: float
) -> tuple[str, ...]:
    """Return the geoms of a foot that reach down to a height along a normal [m]."""
    bodies, found = zero.beyond(body), []
    for geom in np.flatnonzero(np.isin(zero.model.geom_bodyid, bodies)).tolist():
        points = _points_of_geom(zero, geom, collides=True)
        if len(points) and (points @ normal).min() < height:
            found.append(zero.model.geom(geom).name)
    return tuple(found)
