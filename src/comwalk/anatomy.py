"""What is what in a humanoid model: legs, arms, torso, head, soles, forward axis.

Nothing is read from names. The model is looked at in its zero posture, z up: the two
limbs that reach the ground are the legs, the soles are the largest flat faces that
look down, the toes tell what is forward; of the other limbs those on the left and the
right are arms, the one in the middle is the head, and joints which these share are the
torso. Joints in no limb (fingers, eyes, toes) are to be locked.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError

from .errors import ModelError
from .footsteps import Side
from .model_files import LinkMesh, mesh_vertices
from .polygon import convex_hull, rectangle, rectangle_in
from .spatial import rotation_yaw


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
    geoms: tuple[str, ...] = ()
    """The file's own geoms that touch the ground; none if contact boxes must do."""
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    """Contact boxes that fill it: centre x, y, length, width [m], about the centre."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """The parts of a humanoid; joints by name, from the base outwards."""

    forward: float
    """Yaw of the forward axis in the base's frame of the file [rad]."""
    legs: Mapping[Side, tuple[str, ...]]
    """Joints of the legs."""
    arms: Mapping[Side, tuple[str, ...]]
    """Joints of the arms; a side without an arm is missing."""
    torso: tuple[str, ...]
    """Joints between the base and what arms and head share."""
    head: tuple[str, ...]
    """Joints of the neck."""
    locked: tuple[str, ...]
    """Joints that do not move: fingers, eyes, toes."""
    soles: Mapping[Side, Sole]
    """The soles."""
    notes: tuple[str, ...] = ()
    """What a user should know, a line each."""


@dataclass(frozen=True, eq=False)
class _Zero:
    """A model in its zero posture."""

    model: mujoco.MjModel
    data: mujoco.MjData
    name: str

    def chain(self, body: int) -> tuple[int, ...]:
        """Return the joints between the base and a body, base first."""
        m, chain = self.model, []
        while body != 0 and m.jnt_bodyid[0] != body:
            first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
            chain = list(range(first, first + count)) + chain
            body = int(m.body_parentid[body])
        return tuple(chain)

    def names(self, joints: Iterable[int]) -> tuple[str, ...]:
        """Return the names of joints."""
        return tuple(self.model.joint(j).name for j in joints)

    def welded(self, body: int) -> list[int]:
        """Return all bodies that move with one."""
        weld = self.model.body_weldid
        return [b for b in range(self.model.nbody) if weld[b] == weld[body]]

    def centre(self, body: int) -> np.ndarray:
        """Return the CoM of a body and all that is fixed to it [m], (3,)."""
        bodies = self.welded(body)
        mass = self.model.body_mass[bodies] + 1e-12
        return mass @ self.data.xipos[bodies] / mass.sum()

    def anchor(self, joint: int) -> np.ndarray:
        """Return where a joint is [m], (3,)."""
        return self.data.xanchor[joint]


def find_anatomy(
    model: mujoco.MjModel,
    meshes: Sequence[LinkMesh],
    name: str,
    given: Mapping[str, object] | None = None,
) -> Anatomy:
    """Find the parts of a humanoid.

    Args:
        model: The compiled model; its first joint is the free joint of the base.
        meshes: Meshes of its bodies, for the soles.
        name: What messages call the model.
        given: Parts that are known, by their name in `Anatomy` (`forward`, `arms`,
            `head`, `locked`, `feet`, `soles`); they replace what would be found.

    Returns:
        The anatomy.

    Raises:
        ModelError: If there are not two legs with feet, which the message explains.
    """
    given = given or {}
    zero = zero_posture(model, name)
    feet, chains = _find_feet(zero, given.get("feet"))
    faces = [_find_face(zero, body, meshes) for body in feet]
    forward = given.get("forward")
    if forward is None:
        forward = _find_forward(zero, feet, chains, faces)
    sides = _sides(zero, feet, forward)
    soles, legs, notes = {}, {}, []
    for body, chain, (points, origin), side in zip(
        feet, chains, faces, sides, strict=True
    ):
        legs[side] = chain
        soles[side] = _sole(zero, body, chain, points, origin, forward)
    soles |= {s: _given_sole(soles[s], g) for s, g in given.get("soles", {}).items()}
    legs = {side: legs[side] for side in Side}
    arms, torso, head = _find_upper_body(zero, legs, forward, given)
    used = {j for part in (*legs.values(), *arms.values(), torso, head) for j in part}
    used -= {model.joint(j).id for j in given.get("locked", ())}
    loose = [j for j in range(1, model.njnt) if j not in used]
    keep = _without(loose)
    notes += _notes(zero, legs, arms, soles)
    return Anatomy(
        forward=forward,
        legs={side: zero.names(keep(legs[side])) for side in Side},
        arms={side: zero.names(keep(arms[side])) for side in arms},
        torso=zero.names(keep(torso)),
        head=zero.names(keep(head)),
        locked=zero.names(loose),
        soles={side: soles[side] for side in Side},
        notes=tuple(notes),
    )


def _without(loose: Iterable[int]):
    """Return a filter that leaves out some joints."""
    out = set(loose)
    return lambda joints: [j for j in joints if j not in out]


def zero_posture(model: mujoco.MjModel, name: str) -> _Zero:
    """Return a model with all joints at zero, or as near as their ranges allow.

    Args:
        model: The compiled model.
        name: What messages call it.

    Returns:
        The posture, its base upright in the world's origin.
    """
    data = mujoco.MjData(model)
    data.qpos[:7] = 0, 0, 0, 1, 0, 0, 0
    angles = np.zeros(model.njnt - 1)
    limited = model.jnt_limited[1:] > 0
    low, high = model.jnt_range[1:].T
    data.qpos[7:] = np.where(limited, np.clip(angles, low, high), angles)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return _Zero(model, data, name)


# ---- Legs -------------------------------------------------------------------------


def _find_feet(
    zero: _Zero, given: Sequence[str] | None
) -> tuple[list[int], list[tuple[int, ...]]]:
    """Return the bodies of the two feet and the joints that lead to them."""
    ends = [_ground_end(zero, zero.model.body(b).id) for b in given or ()]
    if not ends:
        ends = _lowest_ends(zero)
    chains = [zero.chain(body) for body in ends]
    shared = set(chains[0]).intersection(*chains[1:]) if len(chains) > 1 else set()
    chains = [tuple(j for j in chain if j not in shared) for chain in chains]
    groups = _disjoint(chains)
    if len(groups) != 2:
        raise ModelError(f"{zero.name} {_LEG_COUNT.get(len(groups), _MANY)}")
    picked = [min(group, key=lambda k: zero.centre(ends[k])[2]) for group in groups]
    legs, feet = [], []
    for k in picked:
        chain = chains[k][:6]
        if len(chain) < 4:
            raise ModelError(
                f"{zero.name}: the leg to {zero.model.body(ends[k]).name} has "
                f"{len(chain)} joints and so no foot to stand on; walking needs at "
                "least 4 (hip roll and pitch, knee, ankle), and does best with 6"
            )
        legs.append(chain)
        feet.append(int(zero.model.jnt_bodyid[chain[-1]]))
    return feet, legs


_LEG_COUNT = {
    0: "has no joints, so it cannot walk",
    1: "has one limb that reaches the ground; walking needs two legs, each a chain of "
    "its own from the base",
}
_MANY = (
    "has more than two limbs that reach the ground; comwalk walks on two legs (a file "
    'of --profile can name them: feet = ["left body", "right body"])'
)


def _ground_end(zero: _Zero, body: int) -> int:
    """Return the body itself; it must be moved by joints."""
    if not zero.chain(body):
        raise ModelError(f"{zero.name}: no joint moves {zero.model.body(body).name}")
    return body


def _lowest_ends(zero: _Zero) -> list[int]:
    """Return the last bodies of all limbs that reach down to the ground."""
    m = zero.model
    parents = {int(m.body_parentid[b]) for b in range(m.nbody) if m.body_jntnum[b]}
    moving = [b for b in range(1, m.nbody) if m.body_jntnum[b] and zero.chain(b)]
    inner = set()
    for body in parents:
        while body:
            inner.add(body)
            body = int(m.body_parentid[body])
    ends = [b for b in moving if b not in inner]
    if not ends:
        return []
    heights = np.array([zero.centre(b)[2] for b in ends])
    top = max(float(zero.data.xipos[1:, 2].max()), 0.0)
    reach = heights.min() + _GROUND * (top - heights.min())
    return [b for b, z in zip(ends, heights, strict=True) if z <= reach]


_GROUND = 0.25  # share of the height within which the end of a limb is a foot


def _disjoint(chains: Sequence[tuple[int, ...]]) -> list[list[int]]:
    """Return which chains share joints, as groups of their indices."""
    groups: list[tuple[set[int], list[int]]] = []
    for k, chain in enumerate(chains):
        if not chain:
            continue
        joined = [g for g in groups if g[0] & set(chain)]
        groups = [g for g in groups if not g[0] & set(chain)]
        groups.append(
            (
                set(chain).union(*(g[0] for g in joined)),
                [*(i for g in joined for i in g[1]), k],
            )
        )
    return [members for _, members in groups]


# ---- Soles and the forward axis ---------------------------------------------------


def _find_face(
    zero: _Zero, body: int, meshes: Sequence[LinkMesh]
) -> tuple[np.ndarray, str]:
    """Return the points of a foot's sole [m], world, and what they come from."""
    bodies = zero.welded(body)
    names = {zero.model.body(b).name for b in bodies}
    own = [mesh for mesh in meshes if mesh.body in names]
    primitive = [_geom_points(zero, b, collides=True) for b in bodies]
    tries = [
        ("collision geometry", np.vstack(primitive)),
        ("collision meshes", _mesh_points(zero, [x for x in own if x.collides])),
        ("meshes", _mesh_points(zero, [x for x in own if not x.collides])),
        ("visual geometry", np.vstack([_geom_points(zero, b, False) for b in bodies])),
    ]
    seen = False
    for origin, points in tries:
        seen = seen or len(points) > 0
        face = _lowest_face(points)
        if face is not None:
            return face, origin
    if seen:
        raise ModelError(
            f"{zero.name}: {zero.model.body(body).name} reaches the ground with no flat "
            f"of {1e4 * _LEAST_AREA:.0f} cm^2, so it is no foot; comwalk walks on flat "
            "soles (a file of --profile can give them)"
        )
    return _fitted_face(zero, body), "fitted"


_LEAST_AREA = 0.002  # smallest flat that a robot can stand on [m^2]
_DEPTH = 0.008  # how far above the lowest face a point still touches the ground [m]


def _lowest_face(points: np.ndarray) -> np.ndarray | None:
    """Return the points on the largest flat face that looks down, None if too small."""
    if len(points) < 4:
        return None
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    corners = points[hull.vertices]
    best, area = None, _LEAST_AREA
    for k in np.flatnonzero(normals[:, 2] < -0.85):
        depth = -(corners @ normals[k] + offsets[k])
        face = corners[depth < _DEPTH]
        flat = _flattened(face, normals[k])
        size = _area(flat)
        if size > 1.02 * area:
            best, area = face, size
    return best


def _flattened(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return points projected along a normal on the horizontal plane, hull only."""
    along = points[:, 2:] / normal[2]
    flat = (points - along * normal)[:, :2]
    return convex_hull(flat)


def _area(polygon: np.ndarray) -> float:
    """Return the area of a polygon [m^2]."""
    x, y = polygon.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _geom_points(zero: _Zero, body: int, collides: bool) -> np.ndarray:
    """Return points on the primitive geoms of a body [m], world, (n, 3)."""
    first = int(zero.model.body_geomadr[body])
    geoms = range(first, first + int(zero.model.body_geomnum[body]))
    found = [_points_of_geom(zero, geom, collides) for geom in geoms]
    return np.vstack([np.zeros((0, 3)), *found])


def _points_of_geom(zero: _Zero, geom: int, collides: bool) -> np.ndarray:
    """Return points on a primitive geom [m], world, if it is of the wanted kind."""
    m, d = zero.model, zero.data
    touches = bool(m.geom_contype[geom] or m.geom_conaffinity[geom])
    local = _primitive_points(int(m.geom_type[geom]), m.geom_size[geom])
    if touches != collides or local is None:
        return np.zeros((0, 3))
    R = d.geom_xmat[geom].reshape(3, 3)
    if isinstance(local, tuple):
        local = _ball_points(*local, R)
    return local @ R.T + d.geom_xpos[geom]


def _primitive_points(kind: int, size: np.ndarray):
    """Return corners of a geom, or centres and radius of its balls; None for others."""
    kinds = mujoco.mjtGeom
    a, b, c = size.tolist()
    if kind == kinds.mjGEOM_BOX:
        grid = np.meshgrid([-a, a], [-b, b], [-c, c])
        return np.array(grid).reshape(3, -1).T
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3)), a
    if kind == kinds.mjGEOM_CAPSULE:
        return np.array([[0, 0, -b], [0, 0, b]]), a
    if kind == kinds.mjGEOM_CYLINDER:
        turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.stack([a * np.cos(turn), a * np.sin(turn), np.full(16, b)], axis=1)
        return np.vstack([ring, ring * [1, 1, -1]])
    return None


def _ball_points(centres: np.ndarray, radius: float, R: np.ndarray) -> np.ndarray:
    """Return the highest and the lowest points of balls, in the geom's frame."""
    up = radius * R[2]
    return np.vstack([centres - up, centres + up])


def _mesh_points(zero: _Zero, meshes: Sequence[LinkMesh]) -> np.ndarray:
    """Return the vertices of meshes [m], world, (n, 3)."""
    found = [np.zeros((0, 3))]
    for mesh in meshes:
        body = zero.model.body(mesh.body).id
        R = zero.data.xmat[body].reshape(3, 3)
        found.append(mesh_vertices(mesh) @ R.T + zero.data.xpos[body])
    return np.vstack(found)


def _fitted_face(zero: _Zero, body: int) -> np.ndarray:
    """Return a sole of usual proportions under the ankle, for a foot without shape."""
    chain = zero.chain(body)
    hip, ankle = zero.anchor(chain[0]), zero.anchor(chain[-1])
    leg = float(hip[2] - ankle[2])
    length, width, height = 0.28 * leg, 0.13 * leg, 0.1 * leg
    x = np.array([-0.4, 0.6, 0.6, -0.4]) * length
    y = np.array([-0.5, -0.5, 0.5, 0.5]) * width
    return ankle + np.stack([x, y, np.full(4, -height)], axis=1)


def _find_forward(
    zero: _Zero,
    feet: Sequence[int],
    chains: Sequence[tuple[int, ...]],
    faces: Sequence[tuple[np.ndarray, str]],
) -> float:
    """Return the yaw of the forward axis: across the hips, to where the toes are.

    If the toes do not tell, the knees do: shanks fold backward.
    """
    ankles = [zero.anchor(chain[-1])[:2] for chain in chains]
    hips = [zero.anchor(chain[0])[:2] for chain in chains]
    apart = hips if np.hypot(*(hips[0] - hips[1])) > 0.02 else ankles
    x, y = (apart[0] - apart[1]).tolist()
    if math.hypot(x, y) < 0.01:
        raise ModelError(
            f"{zero.name}: {zero.model.body(feet[0]).name} and "
            f"{zero.model.body(feet[1]).name} are in one place, so left and right "
            "cannot be told; the legs must stand beside each other"
        )
    f = np.array([y, -x]) / math.hypot(x, y)
    way = sum(
        _toes(points[:, :2] - ankle, f)
        for (points, origin), ankle in zip(faces, ankles, strict=True)
        if origin != "fitted"
    )
    way = way or sum(_knee_way(zero, chain, f) for chain in chains) or float(f[0])
    yaw = math.atan2(*(math.copysign(1.0, way) * f)[::-1].tolist())
    square = round(yaw / (math.pi / 2)) * math.pi / 2
    return square if abs(yaw - square) < _SKEW else yaw


def _toes(points: np.ndarray, f: np.ndarray) -> float:
    """Return where the middle of a sole is along f, from the ankle; 0 if unclear."""
    along, across = points @ f, points @ [-f[1], f[0]]
    length, width = np.ptp(along), np.ptp(across)
    middle = float(_middle(along))
    return middle if length > width / _CROSSWISE and abs(middle) > 0.05 * length else 0.0


def _knee_way(zero: _Zero, chain: Sequence[int], f: np.ndarray) -> float:
    """Return whether f is forward (+1) or backward (-1), by how the knee folds."""
    anchors = zero.data.xanchor[list(chain)]
    knee = middle_joint(anchors, zero.data.xaxis[list(chain)], anchors[-1])
    low, high = zero.model.jnt_range[chain[knee]]
    axis = zero.data.xaxis[chain[knee]]
    left = np.array([-f[1], f[0]])
    if not zero.model.jnt_limited[chain[knee]]:
        return 0.0
    return float(np.sign((high + low) * (axis[:2] @ left)))


def middle_joint(anchors: np.ndarray, axes: np.ndarray, end: np.ndarray) -> int:
    """Return which joint of a limb bends it in the middle: its knee or elbow.

    Args:
        anchors: Places of the joints [m], of shape (n, 3).
        axes: Their axes, of shape (n, 3).
        end: Where the limb ends [m], (3,).

    Returns:
        The joint that is farthest from both ends and does not merely twist the limb.
    """
    before, after = anchors - anchors[0], end - anchors
    near = np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
    bends = [
        np.linalg.norm(np.cross(axes, way), axis=1)
        / np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        for way in (before, after)
    ]
    return int(np.argmax(near * np.minimum(*bends)))


_CROSSWISE = 1.3  # how much wider than long a foot must be to lie across
_SKEW = 0.05  # angle under which a forward axis is that of the file [rad]


def _middle(points: np.ndarray) -> np.ndarray:
    """Return the middle of the extent of points."""
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def _sides(zero: _Zero, feet: Sequence[int], forward: float) -> tuple[Side, Side]:
    """Return the side of each foot."""
    left = np.array([-math.sin(forward), math.cos(forward)])
    first, second = (float(zero.data.xpos[b][:2] @ left) for b in feet)
    pair = (Side.LEFT, Side.RIGHT)
    return pair if first > second else pair[::-1]


def _sole(
    zero: _Zero,
    body: int,
    chain: tuple[int, ...],
    points: np.ndarray,
    origin: str,
    forward: float,
) -> Sole:
    """Return a sole in the frame of its foot's body."""
    R = _face_axes(points, forward)
    local = (points - zero.anchor(chain[-1])) @ R
    ground = float(local[:, 2].min())
    corners, crosswise = _lengthwise(convex_hull(local[:, :2]))
    boxes = () if origin == _PRIMITIVE else _boxes_in(corners)
    (x, y), size = rectangle_in(corners)
    shape = [_box_corners(box) for box in boxes] or [corners]
    centre = zero.anchor(chain[-1]) + R @ [x, y, ground]
    R_body, r = zero.data.xmat[body].reshape(3, 3), zero.data.xpos[body]
    return Sole(
        body=zero.model.body(body).name,
        position=R_body.T @ (centre - r),
        rotation=R_body.T @ R,
        size=size,
        polygon=convex_hull(np.vstack(shape)) - [x, y],
        boxes=tuple((a - x, b - y, c, d) for a, b, c, d in boxes),
        origin=f"{origin}, turned lengthwise" if crosswise else origin,
        geoms=() if origin != _PRIMITIVE else _ground_geoms(zero, body, ground + _DEPTH),
    )


_PRIMITIVE = "collision geometry"

Box = tuple[float, float, float, float]
"""Centre x, y and length and width of a contact box [m], in the plane of the sole."""


def _boxes_in(corners: np.ndarray) -> tuple[Box, ...]:
    """Return one or two boxes that fill a sole: a long one, and a wide one."""
    boxes = []
    for weight in (3.0, 1.0 / 3.0):
        (x, y), (length, width) = rectangle_in(corners, weight)
        boxes.append((x, y, length, width))
    long, wide = boxes
    alike = long[2] - wide[2] < 0.05 * long[2] and wide[3] - long[3] < 0.05 * wide[3]
    return (long,) if alike else (long, wide)


def _box_corners(box: Box) -> np.ndarray:
    """Return the corners of a box, (4, 2)."""
    return rectangle(box[0], box[1], 0.0, box[2:])


def _lengthwise(corners: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the corners of a sole about the ankle, longer than wide.

    No foot is much wider than long: a mesh that is was turned by a right angle.
    """
    length, width = np.ptp(corners, axis=0)
    if width < _CROSSWISE * length:
        return corners, False
    x, y = corners.T
    toes = math.copysign(1.0, float(_middle(y)))
    return convex_hull(np.stack([toes * y, -toes * x], axis=1)), True


def _ground_geoms(zero: _Zero, body: int, height: float) -> tuple[str, ...]:
    """Return the geoms of a foot that reach down to the ground."""
    m, names = zero.model, []
    ankle = zero.anchor(zero.chain(body)[-1])[2]
    for b in zero.welded(body):
        first = int(m.body_geomadr[b])
        for geom in range(first, first + int(m.body_geomnum[b])):
            points = _points_of_geom(zero, geom, collides=True)
            if len(points) and points[:, 2].min() - ankle < height:
                names.append(m.geom(geom).name)
    return tuple(names)


def _face_axes(points: np.ndarray, forward: float) -> np.ndarray:
    """Return the axes of a sole: its normal, and the forward axis in its plane."""
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    normal = normal if normal[2] > 0 else -normal
    tilt = math.acos(min(1.0, float(normal[2])))
    if tilt < 0.07 or len(points) < 3:
        return rotation_yaw(forward)
    x = rotation_yaw(forward)[:, 0]
    x = x - (x @ normal) * normal
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _given_sole(sole: Sole, given: Mapping[str, float]) -> Sole:
    """Return a sole with what a profile gives of it, in the sole's own axes."""
    length, width = sole.size
    size = (float(given.get("length", length)), float(given.get("width", width)))
    shift = [float(given.get(k, 0.0)) for k in "xyz"]
    return Sole(
        body=sole.body,
        position=sole.position + sole.rotation @ shift,
        rotation=sole.rotation,
        size=size,
        polygon=rectangle(0.0, 0.0, 0.0, size),
        boxes=((0.0, 0.0, *size),),
        origin="profile",
    )


# ---- Upper body -------------------------------------------------------------------


def _find_upper_body(
    zero: _Zero,
    legs: Mapping[Side, tuple[int, ...]],
    forward: float,
    given: Mapping[str, object],
) -> tuple[dict[Side, tuple[int, ...]], tuple[int, ...], tuple[int, ...]]:
    """Return the joints of arms, torso and head."""
    below = {j for chain in legs.values() for j in chain}
    m = zero.model
    ends = [b for b in range(1, m.nbody) if m.body_jntnum[b] and zero.chain(b)]
    chains = {b: zero.chain(b) for b in ends if not below & set(zero.chain(b))}
    tips = _tips(chains)
    left = np.array([-math.sin(forward), math.cos(forward)])
    across = {b: float(zero.centre(b)[:2] @ left) for b in tips}
    span = max((abs(y) for y in across.values()), default=0.0)
    parts: dict[Side | None, list[int]] = {Side.LEFT: [], Side.RIGHT: [], None: []}
    for b, y in across.items():
        middle = abs(y) < max(0.3 * span, 0.03)
        parts[None if middle else Side.LEFT if y > 0 else Side.RIGHT].append(b)
    limbs = {part: _limb(zero, [chains[b] for b in tips]) for part, tips in parts.items()}
    limbs |= _given_limbs(zero, given)
    whole = [chain for chain in limbs.values() if chain]
    torso = tuple(
        sorted({j for c in whole for j in c if sum(j in other for other in whole) > 1})
    )
    own = {p: tuple(j for j in c if j not in torso) for p, c in limbs.items()}
    arms = {side: own[side][:_ARM] for side in Side if own[side]}
    return arms, torso, own[None]


def _tips(chains: Mapping[int, tuple[int, ...]]) -> list[int]:
    """Return the bodies whose chains are no part of a longer one."""
    longer = {j for c in chains.values() for j in c[:-1]}
    return [b for b, c in chains.items() if c[-1] not in longer]


def _limb(zero: _Zero, chains: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Return what the chains of one limb have in common: the limb without its hand.

    Of several limbs on one side the heaviest counts.
    """
    if not chains:
        return ()
    heaviest = max(chains, key=lambda c: _moved_mass(zero, c))
    own = [c for c in chains if c[: _SHARED] == heaviest[: _SHARED]] or [heaviest]
    common = heaviest
    for chain in own:
        k = 0
        while k < min(len(common), len(chain)) and common[k] == chain[k]:
            k += 1
        common = common[:k]
    return common


_ARM = 7  # joints of an arm; what comes after them is a gripper
_SHARED = 3  # joints that all fingers of one hand have in common, at least


def _moved_mass(zero: _Zero, chain: tuple[int, ...]) -> float:
    """Return the mass that the middle joint of a chain moves [kg]."""
    body = int(zero.model.jnt_bodyid[chain[len(chain) // 2]])
    return float(zero.model.body_subtreemass[body])


def _given_limbs(
    zero: _Zero, given: Mapping[str, object]
) -> dict[Side | None, tuple[int, ...]]:
    """Return the limbs that a profile names, with the joints that lead to them."""
    found: dict[Side | None, tuple[int, ...]] = {}
    for side, joints in given.get("arms", {}).items():
        found[side] = _path(zero, joints)
    if "head" in given:
        found[None] = _path(zero, given["head"])
    return found


def _path(zero: _Zero, joints: Sequence[str]) -> tuple[int, ...]:
    """Return all joints from the base to the last of some joints."""
    if not joints:
        return ()
    last = zero.model.joint(joints[-1]).id
    return zero.chain(int(zero.model.jnt_bodyid[last]))


def _notes(
    zero: _Zero,
    legs: Mapping[Side, tuple[int, ...]],
    arms: Mapping[Side, tuple[int, ...]],
    soles: Mapping[Side, Sole],
) -> list[str]:
    """Return what a user should know of an anatomy."""
    notes = []
    for side, chain in legs.items():
        if len(chain) < 6:
            notes.append(
                f"the {side} leg has {len(chain)} joints: what it cannot do of the "
                "foot's pose is left out"
            )
        if "turned" in soles[side].origin:
            notes.append(
                f"the {side} foot lies across the walking direction in the file: its "
                "sole is turned lengthwise"
            )
        if soles[side].origin == "fitted":
            notes.append(
                f"the {side} foot has no shape: a sole of usual proportions is assumed"
            )
    if len(arms) < 2:
        notes.append("no two arms were found: dances use what there is")
    return notes


# ---- Roles ------------------------------------------------------------------------

Role = tuple[str, float]
"""A joint, and the sign by which it turns as its role does."""

_AXES = {"roll": 0, "pitch": 1, "yaw": 2}


def find_roles(
    model: mujoco.MjModel, q: np.ndarray, anatomy: Anatomy
) -> dict[str, Role]:
    """Return which joint does what, as dances call it, at a standing posture.

    A pitch turns about y (left), a roll about x (forward), a yaw about z (up).

    Args:
        model: The compiled model, x forward.
        q: The posture, MuJoCo's qpos, arms hanging.
        anatomy: The model's parts.

    Returns:
        Joint and sign by role, such as "l_shoulder_pitch", "waist_yaw", "head_pitch".
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    zero = _Zero(model, data, "")
    roles: dict[str, Role] = {}
    for side, arm in anatomy.arms.items():
        letter, joints = side.value[0], [model.joint(n).id for n in arm]
        k = _elbow(zero, joints)
        roles |= _turning(zero, joints[:k], f"{letter}_shoulder")
        roles |= _turning(zero, joints[k : k + 1], f"{letter}_elbow", ("pitch",))
    for part, names in (("waist", anatomy.torso), ("head", anatomy.head)):
        roles |= _turning(zero, [model.joint(n).id for n in names], part)
    return roles


def _elbow(zero: _Zero, joints: Sequence[int]) -> int:
    """Return the place in an arm of the joint between upper arm and forearm."""
    tip = zero.centre(int(zero.model.jnt_bodyid[joints[-1]]))
    rows = list(joints)
    return middle_joint(zero.data.xanchor[rows], zero.data.xaxis[rows], tip)


def _turning(
    zero: _Zero,
    joints: Sequence[int],
    part: str,
    wanted: Sequence[str] = ("pitch", "roll", "yaw"),
) -> dict[str, Role]:
    """Return which of some joints turns about which axis, each for one at most."""
    if not joints:
        return {}
    columns = [_AXES[name] for name in wanted]
    shares = zero.data.xaxis[list(joints)][:, columns]
    rows, picked = linear_sum_assignment(-np.abs(shares))
    return {
        f"{part}_{wanted[c]}": (
            zero.model.joint(joints[r]).name,
            math.copysign(1.0, shares[r, c]),
        )
        for r, c in zip(rows, picked, strict=True)
        if abs(shares[r, c]) > 0.6
    }
