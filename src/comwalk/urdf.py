"""URDF: links and joints, read into a MuJoCo model with a floating base.

The model is built element by element instead of by MuJoCo's own reader, so that the
root link keeps its mass, `mimic` and `velocity` are not lost, and every fault is named.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from .errors import ModelError
from .meshes import find_mesh, first_of, quaternion_of, style_geom
from .model_parts import LinkMesh, Mimic, ModelFile, resolve_mimics

_SPECK, _SPECK_INERTIA = 1e-6, 1e-9
"""Mass [kg] and inertia [kg m^2] of a moving link that has none."""
_LEAST_GYRATION = 1e-3
"""Least radius of gyration [m] of a link with mass."""
_MOTIONS = {
    "revolute": mujoco.mjtJoint.mjJNT_HINGE,
    "continuous": mujoco.mjtJoint.mjJNT_HINGE,
    "prismatic": mujoco.mjtJoint.mjJNT_SLIDE,
}
_PRIMITIVES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}
_DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}


@dataclass(frozen=True, eq=False)
class _Pose:
    """A frame in another one."""

    p: np.ndarray
    R: np.ndarray

    def __matmul__(self, other: _Pose) -> _Pose:
        return _Pose(self.p + self.R @ other.p, self.R @ other.R)


@dataclass(frozen=True, eq=False)
class _Link:
    """A link: mass, CoM, principal moments of inertia and axes, in the link's frame."""

    name: str
    element: ET.Element
    mass: float
    com: np.ndarray
    moments: np.ndarray
    axes: np.ndarray

    @property
    def is_bare(self) -> bool:
        """Whether it has neither mass nor shape."""
        return self.mass == 0.0 and all(
            self.element.find(tag) is None for tag in ("visual", "collision")
        )


@dataclass(frozen=True, eq=False)
class _Joint:
    """A joint: child frame in the parent at zero, and its element."""

    name: str
    element: ET.Element
    kind: str
    parent: str
    child: str
    pose: _Pose


@dataclass(frozen=True, eq=False)
class _Tree:
    """Links by name, and the joints below each of them."""

    links: dict[str, _Link]
    joints: dict[str, _Joint]
    below: dict[str, list[_Joint]]

    def subtree(self, link: str, *, welded: bool = False) -> list[str]:
        """Return a link and all below it, or only those fixed to it."""
        found = [link]
        for name in found:
            found += [
                j.child for j in self.below[name] if not welded or j.kind == "fixed"
            ]
        return found

    def mass(self, links: Iterable[str]) -> float:
        """Return the mass [kg] of some links."""
        return sum(self.links[name].mass for name in links)


def read_urdf(root: ET.Element, path: Path) -> ModelFile:
    """Read the links and joints of a URDF; its meshes are listed, not loaded.

    Args:
        root: The element `robot`.
        path: The file, from which its meshes are searched.

    Returns:
        The model, not compiled yet.

    Raises:
        ModelError: If the description is broken; the text does not name the file.
    """
    notes: list[str] = []
    tree = _read_tree(root, notes)
    base, pose, free_name = _find_base(tree, notes)
    kept = tree.subtree(base)
    moving = [j for name in kept for j in tree.below[name] if j.kind != "fixed"]
    if not moving:
        raise ModelError("it has no joints that move; a robot to walk needs two legs")
    links = _with_specks(tree, [base, *(j.child for j in moving)], notes)
    spec = _empty_spec(root.get("name") or path.stem)
    bodies = _add_bodies(spec, links, tree, base, pose, free_name, notes)
    meshes = _add_shapes(bodies, links, _colors(root), _mesh_folder(root, path), notes)
    limits = {
        what: {j.name: x for j in moving if (x := _limit(j, what)) > 0.0}
        for what in ("velocity", "effort")
    }
    return ModelFile(
        name=path.stem,
        path=path,
        spec=spec,
        mimics=resolve_mimics(_mimics(moving, notes)),
        speed=limits["velocity"],
        torque=limits["effort"],
        meshes=meshes,
        notes=tuple(notes),
        is_urdf=True,
    )


def _numbers(
    element: ET.Element | None, key: str, default: tuple[float, ...], owner: str
) -> np.ndarray:
    """Return the finite numbers of an attribute, as many as its default has."""
    text = None if element is None else element.get(key)
    if element is None or text is None:
        return np.array(default, dtype=float)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if len(values) != len(default) or not np.isfinite(values).all():
        count = "a finite number" if len(default) == 1 else f"{len(default)} numbers"
        hint = "; leave it out for no limit" if element.tag == "limit" else ""
        raise ModelError(
            f'{owner}: <{element.tag} {key}="{text.strip()}"> must be {count}{hint}'
        )
    return values


def _number(element: ET.Element | None, key: str, default: float, owner: str) -> float:
    """Return one finite number of an attribute."""
    return float(_numbers(element, key, (default,), owner)[0])


def _rotation(rpy: np.ndarray) -> np.ndarray:
    """Return the rotation of roll, pitch, yaw [rad] about fixed axes."""
    (a, b, c), (x, y, z) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [c * b, c * y * x - z * a, c * y * a + z * x],
            [z * b, z * y * x + c * a, z * y * a - c * x],
            [-y, b * x, b * a],
        ]
    )


def _origin(element: ET.Element, owner: str) -> _Pose:
    """Return the pose that an element's origin gives."""
    origin, zeros = element.find("origin"), (0.0, 0.0, 0.0)
    return _Pose(
        _numbers(origin, "xyz", zeros, owner),
        _rotation(_numbers(origin, "rpy", zeros, owner)),
    )


def _names_once(elements: list[ET.Element], what: str) -> list[str]:
    """Return the names of links or joints, each of which must be there once."""
    names = [element.get("name") or "" for element in elements]
    if "" in names:
        raise ModelError(f"a {what} has no name; give every {what} its own")
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise ModelError(f'{count} {what}s are named "{name}"; rename all but one')
    return names


def _read_tree(root: ET.Element, notes: list[str]) -> _Tree:
    """Return all links and joints, which must form one tree."""
    link_elements, joint_elements = root.findall("link"), root.findall("joint")
    balanced: list[str] = []
    links = {
        name: _read_link(name, element, balanced)
        for name, element in zip(
            _names_once(link_elements, "link"), link_elements, strict=True
        )
    }
    joints = {
        name: _read_joint(name, element, links)
        for name, element in zip(
            _names_once(joint_elements, "joint"), joint_elements, strict=True
        )
    }
    if not links:
        raise ModelError("it has no links; is this a whole robot?")
    if balanced:
        notes.append(f"impossible inertia repaired: {', '.join(balanced)}")
    below: dict[str, list[_Joint]] = {name: [] for name in links}
    for joint in joints.values():
        below[joint.parent].append(joint)
    _check_parents(links, joints)
    return _Tree(links, joints, below)


def _check_parents(links: Iterable[str], joints: dict[str, _Joint]) -> None:
    """Check that every link but one is the child of exactly one joint."""
    parents: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in parents:
            raise ModelError(
                f'joints "{parents[joint.child]}" and "{joint.name}" both carry link '
                f'"{joint.child}": loops cannot be walked, cut one'
            )
        parents[joint.child] = joint.name
    roots = [name for name in links if name not in parents]
    if not roots:
        raise ModelError("every link is the child of a joint: cut the loop")
    if len(roots) > 1:
        raise ModelError(
            f"it has {len(roots)} root links ({first_of(roots)}); join them by joints"
        )
    for name in parents:
        above, link = {name}, name
        while link in parents:
            link = joints[parents[link]].parent
            if link in above:
                raise ModelError(f'link "{link}" is its own ancestor: cut the loop')
            above.add(link)


def _read_link(name: str, element: ET.Element, balanced: list[str]) -> _Link:
    """Return a link; `balanced` collects those whose inertia no body can have."""
    owner, inertial = f'link "{name}"', element.find("inertial")
    if inertial is None:
        return _Link(name, element, 0.0, np.zeros(3), np.zeros(3), np.eye(3))
    mass = _number(inertial.find("mass"), "value", 0.0, owner)
    if mass < 0.0:
        raise ModelError(f"{owner} has mass {mass:.6g} kg; it must not be negative")
    pose, tensor = _origin(inertial, owner), inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (
        _number(tensor, key, 0.0, owner)
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, changed = _possible_moments(mass, moments)
    if changed:
        balanced.append(name)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return _Link(name, element, mass, pose.p, moments, pose.R @ axes)


def _possible_moments(mass: float, moments: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return principal moments [kg m^2] that a body can have, and whether changed.

    They must be positive, and none larger than the sum of the two others; as in
    MuJoCo's `balanceinertia`, all three become their mean if they are not.
    """
    if mass == 0.0:
        return np.zeros(3), False
    least = mass * _LEAST_GYRATION**2
    largest, rest = moments.max(), moments.sum() - moments.max()
    balanced = moments
    if moments.min() < 0.0 or largest > rest * (1.0 + 1e-6):
        balanced = np.full(3, moments.mean())
    possible = np.maximum(balanced, least)
    return possible, bool(np.abs(possible - moments).max() > least)


def _read_joint(name: str, element: ET.Element, links: dict[str, _Link]) -> _Joint:
    """Return a joint between two links that exist."""
    owner, kind, ends = f'joint "{name}"', element.get("type", ""), []
    if kind not in _MOTIONS and kind not in ("fixed", "floating", "planar"):
        raise ModelError(
            f'{owner} has type "{kind}"; walking needs revolute, continuous, '
            "prismatic or fixed joints"
        )
    for tag in ("parent", "child"):
        found = element.find(tag)
        link = "" if found is None else found.get("link", "")
        if link not in links:
            raise ModelError(f'{owner} has {tag} link "{link}", which does not exist')
        ends.append(link)
    return _Joint(name, element, kind, *ends, pose=_origin(element, owner))


def _find_base(tree: _Tree, notes: list[str]) -> tuple[str, _Pose, str]:
    """Return the floating base, its pose in the world, and its joint's name.

    Links above the base that stand for the world are dropped: one named `world`, and
    those without mass or shape whose only joint moves (a floating, planar or virtual
    joint). What is truly fixed to the world is set free.
    """
    children = {joint.child for joint in tree.joints.values()}
    base = next(name for name in tree.links if name not in children)
    pose, free_name, dropped = _Pose(np.zeros(3), np.eye(3)), "", []
    while True:
        joints, is_world = tree.below[base], base.lower() in ("world", "map", "odom")
        alone = len(joints) == 1 and tree.links[base].is_bare
        if not joints or not (is_world or (alone and joints[0].kind != "fixed")):
            break
        joint = max(joints, key=lambda j: tree.mass(tree.subtree(j.child)))
        others = [j.child for j in joints if j is not joint]
        if others:
            notes.append(f"beside the robot in the world, dropped: {first_of(others)}")
        if joint.kind == "floating":
            free_name = joint.name
        else:
            dropped.append(joint.name)
        pose, base = pose @ joint.pose, joint.child
    if dropped:
        notes.append(
            f'"{base}" floats: it was tied to the world by {first_of(dropped)}'
        )
    for name in tree.subtree(base):
        for joint in tree.below[name]:
            if joint.kind in ("floating", "planar"):
                raise ModelError(
                    f'joint "{joint.name}" is {joint.kind} inside the robot; only the '
                    "base may float, make it fixed or revolute"
                )
    return base, pose, free_name


def _with_specks(tree: _Tree, movers: list[str], notes: list[str]) -> dict[str, _Link]:
    """Return all links, with a speck of mass where one without any moves."""
    links, bare = dict(tree.links), []
    for name in movers:
        if tree.mass(tree.subtree(name, welded=True)) < _SPECK:
            bare.append(name)
            links[name] = _Link(
                name,
                links[name].element,
                _SPECK,
                np.zeros(3),
                np.full(3, _SPECK_INERTIA),
                np.eye(3),
            )
    if tree.mass(tree.subtree(movers[0])) == 0.0:
        raise ModelError("its links have no mass; give each an <inertial>")
    if bare:
        notes.append(f"moving links without mass given 1 mg: {first_of(bare)}")
    return links


def _empty_spec(name: str) -> mujoco.MjSpec:
    """Return a model without bodies, in radians."""
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True
    return spec


def _add_bodies(
    spec: mujoco.MjSpec,
    links: dict[str, _Link],
    tree: _Tree,
    base: str,
    pose: _Pose,
    free_name: str,
    notes: list[str],
) -> dict[str, mujoco.MjsBody]:
    """Add all bodies and joints below the base, and return the bodies by link."""
    bodies = {base: _add_body(spec.worldbody, links[base], pose)}
    taken = set(tree.joints) - {free_name}
    name = free_name or "floating_base"
    while name in taken:
        name += "_"
    bodies[base].add_freejoint(name=name)
    stack = [*reversed(tree.below[base])]
    while stack:
        joint = stack.pop()
        body = _add_body(bodies[joint.parent], links[joint.child], joint.pose)
        bodies[joint.child] = body
        if joint.kind != "fixed":
            _add_joint(body, joint, notes)
        stack += reversed(tree.below[joint.child])
    return bodies


def _add_body(parent: mujoco.MjsBody, link: _Link, pose: _Pose) -> mujoco.MjsBody:
    """Add the body of a link."""
    return parent.add_body(
        name=link.name,
        pos=pose.p.tolist(),
        quat=quaternion_of(pose.R).tolist(),
        explicitinertial=True,
        mass=link.mass,
        ipos=link.com.tolist(),
        iquat=quaternion_of(link.axes).tolist(),
        inertia=link.moments.tolist(),
    )


def _add_joint(body: mujoco.MjsBody, joint: _Joint, notes: list[str]) -> None:
    """Add a joint that moves, with its limits and its friction."""
    owner = f'joint "{joint.name}"'
    axis = _numbers(joint.element.find("axis"), "xyz", (1.0, 0.0, 0.0), owner)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise ModelError(f"{owner} has an axis of length zero; give it a direction")
    added = body.add_joint(name=joint.name, type=_MOTIONS[joint.kind])
    added.axis = axis / length
    dynamics = joint.element.find("dynamics")
    damping = np.zeros_like(np.ravel(added.damping))
    damping[0] = _number(dynamics, "damping", 0.0, owner)
    added.damping = damping
    added.frictionloss = _number(dynamics, "friction", 0.0, owner)
    span = _range(joint, notes)
    added.limited = span is not None
    if span is not None:
        added.range = np.array(span)
    effort = _limit(joint, "effort")
    if effort > 0.0:
        added.actfrclimited = True
        added.actfrcrange = np.array([-effort, effort])


def _range(joint: _Joint, notes: list[str]) -> tuple[float, float] | None:
    """Return the limits of a joint [rad or m], None if it has none."""
    limit = joint.element.find("limit")
    if joint.kind == "continuous" or limit is None:
        return None
    if limit.get("lower") is None and limit.get("upper") is None:
        return None
    owner = f'joint "{joint.name}"'
    low, high = (_number(limit, key, 0.0, owner) for key in ("lower", "upper"))
    if low > high:
        raise ModelError(
            f"{owner} has lower limit {low:.6g} above its upper {high:.6g}; swap them"
        )
    if high - low < 1e-6:
        notes.append(f"{owner} cannot move: its limits are both {low:.6g}")
        return low - 1e-3, low + 1e-3
    return low, high


def _limit(joint: _Joint, what: str) -> float:
    """Return the `velocity` or `effort` limit of a joint, 0 if it has none."""
    owner = f'joint "{joint.name}"'
    return abs(_number(joint.element.find("limit"), what, 0.0, owner))


def _mimics(joints: list[_Joint], notes: list[str]) -> list[Mimic]:
    """Return the joints that follow others, as written."""
    moving, found = {joint.name for joint in joints}, []
    for joint in joints:
        mimic, owner = joint.element.find("mimic"), f'joint "{joint.name}"'
        if mimic is None:
            continue
        primary = mimic.get("joint", "")
        if primary in moving:
            ratio = _number(mimic, "multiplier", 1.0, owner)
            offset = _number(mimic, "offset", 0.0, owner)
            found.append(Mimic(joint.name, primary, ratio, offset))
        else:
            notes.append(f'{owner} mimics "{primary}", which does not move: ignored')
    return found


def _colors(root: ET.Element) -> dict[str, tuple[float, ...]]:
    """Return the colors of the materials that are defined for all links."""
    found = {}
    for material in root.iter("material"):
        color = material.find("color")
        if color is not None and material.get("name"):
            rgba = _numbers(color, "rgba", (0.0, 0.0, 0.0, 1.0), "a material")
            found.setdefault(material.get("name", ""), tuple(rgba.tolist()))
    return found


def _mesh_folder(root: ET.Element, path: Path) -> tuple[Path, ...]:
    """Return the folders that relative mesh names count from."""
    compiler = root.find("mujoco/compiler")
    folder = "" if compiler is None else compiler.get("meshdir", "")
    here = path.resolve().parent
    return (here, here / folder) if folder else (here,)


@dataclass(frozen=True, eq=False)
class _Shape:
    """The geometry of a visual or collision element."""

    link: str
    element: ET.Element
    pose: _Pose
    color: tuple[float, ...] | None
    collides: bool


def _shapes(link: _Link, colors: dict[str, tuple[float, ...]]) -> Iterator[_Shape]:
    """Yield the shapes of a link: those for the eye, then those for contact."""
    owner = f'link "{link.name}"'
    for tag in ("visual", "collision"):
        for parent in link.element.findall(tag):
            for element in parent.findall("geometry/*"):
                yield _Shape(
                    link=link.name,
                    element=element,
                    pose=_origin(parent, owner),
                    color=_color(parent.find("material"), colors, owner),
                    collides=tag == "collision",
                )


def _color(
    material: ET.Element | None, colors: dict[str, tuple[float, ...]], owner: str
) -> tuple[float, ...] | None:
    """Return the color of a material, defined here or for all links."""
    if material is None:
        return None
    own = material.find("color")
    if own is None:
        return colors.get(material.get("name", ""))
    return tuple(_numbers(own, "rgba", (0.0, 0.0, 0.0, 1.0), owner).tolist())


def _add_shapes(
    bodies: dict[str, mujoco.MjsBody],
    links: dict[str, _Link],
    colors: dict[str, tuple[float, ...]],
    folders: tuple[Path, ...],
    notes: list[str],
) -> tuple[LinkMesh, ...]:
    """Add the primitive shapes of all links, and return their meshes."""
    meshes: list[LinkMesh] = []
    missing: list[str] = []
    for name, body in bodies.items():
        for shape in _shapes(links[name], colors):
            if shape.element.tag != "mesh":
                _add_primitive(body, shape, notes)
                continue
            filename = shape.element.get("filename", "")
            file = find_mesh(filename, folders)
            if file is None:
                missing.append(filename)
            else:
                meshes.append(_link_mesh(shape, file))
    if missing:
        names = list(dict.fromkeys(missing))
        notes.append(f"{len(names)} mesh files not found: {first_of(names)}")
    return tuple(meshes)


def _link_mesh(shape: _Shape, file: Path) -> LinkMesh:
    """Return the mesh of a link."""
    owner = f'link "{shape.link}"'
    return LinkMesh(
        body=shape.link,
        file=file,
        position=shape.pose.p,
        rotation=shape.pose.R,
        scale=_numbers(shape.element, "scale", (1.0, 1.0, 1.0), owner),
        collides=shape.collides,
        color=shape.color,
    )


def _add_primitive(body: mujoco.MjsBody, shape: _Shape, notes: list[str]) -> None:
    """Add a box, sphere, cylinder or capsule to a body."""
    owner, element = f'link "{shape.link}"', shape.element
    if element.tag not in _PRIMITIVES:
        notes.append(f"{owner}: shape <{element.tag}> is not known: dropped")
        return
    if element.tag == "box":
        size = 0.5 * _numbers(element, "size", (0.0, 0.0, 0.0), owner)
    else:
        radius = _number(element, "radius", 0.0, owner)
        size = np.array([radius, 0.5 * _number(element, "length", 0.0, owner), 0.0])
    if min(size[: _DIMENSIONS[element.tag]]) <= 0.0:
        notes.append(f"{owner}: a {element.tag} without size is dropped")
        return
    geom = body.add_geom(
        type=_PRIMITIVES[element.tag],
        size=size,
        pos=shape.pose.p.tolist(),
        quat=quaternion_of(shape.pose.R).tolist(),
        density=0.0,
    )
    style_geom(geom, shape.collides, shape.color)
