"""URDF: links and joints, read into a MuJoCo model with a floating base.

The model is built element by element instead of by MuJoCo's own reader, so that the
root link keeps its mass, `mimic` and `velocity` are not lost, and every fault is named.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError
from .mesh_files import find_mesh
from .meshes import style_geom
from .parts import LinkMesh, Mimic, ModelFile, first_of, quaternion_of, resolve_mimics
from .up_axis import stand_up
from .urdf_tree import Joint, Link, Pose, Tree, number, numbers, origin, read_tree

_SPECK, _SPECK_INERTIA = 1e-6, 1e-9
"""Mass [kg] and inertia [kg m^2] of a moving link that has none."""
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
    tree = read_tree(root, notes)
    base, pose, free_name = _find_base(tree, notes)
    kept = tree.subtree(base)
    moving = [j for name in kept for j in tree.below[name] if j.kind != "fixed"]
    if not moving:
        raise ModelError("it has no joints that move; a robot to walk needs two legs")
    links = _with_specks(tree, [base, *(j.child for j in moving)], notes)
    spec = _empty_spec(root.get("name") or path.stem)
    bodies = _add_bodies(spec, links, tree, base, pose, free_name, notes)
    meshes = _add_shapes(bodies, links, _colors(root), _mesh_folder(root, path), notes)
    meshes = stand_up(meshes, spec, notes)
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


def _find_base(tree: Tree, notes: list[str]) -> tuple[str, Pose, str]:
    """Return the floating base, its pose in the world, and its joint's name.

    Links above the base that stand for the world are dropped: one named `world`, and
    those without mass or shape whose only joint moves (a floating, planar or virtual
    joint). What is truly fixed to the world is set free.
    """
    base, free_name, dropped = tree.root, "", []
    pose = Pose(np.zeros(3), np.eye(3))
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


def _with_specks(tree: Tree, movers: list[str], notes: list[str]) -> dict[str, Link]:
    """Return all links, with a speck of mass where one without any moves."""
    links, bare = dict(tree.links), []
    for name in movers:
        if tree.mass(tree.subtree(name, welded=True)) < _SPECK:
            bare.append(name)
            links[name] = Link(
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
    links: dict[str, Link],
    tree: Tree,
    base: str,
    pose: Pose,
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


def _add_body(parent: mujoco.MjsBody, link: Link, pose: Pose) -> mujoco.MjsBody:
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


def _add_joint(body: mujoco.MjsBody, joint: Joint, notes: list[str]) -> None:
    """Add a joint that moves, with its limits and its friction."""
    owner = f'joint "{joint.name}"'
    axis = numbers(joint.element.find("axis"), "xyz", (1.0, 0.0, 0.0), owner)
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise ModelError(f"{owner} has an axis of length zero; give it a direction")
    added = body.add_joint(name=joint.name, type=_MOTIONS[joint.kind])
    added.axis = axis / length
    dynamics = joint.element.find("dynamics")
    damping = np.zeros_like(np.ravel(added.damping))
    damping[0] = number(dynamics, "damping", 0.0, owner)
    added.damping = damping
    added.frictionloss = number(dynamics, "friction", 0.0, owner)
    span = _range(joint, notes)
    added.limited = span is not None
    if span is not None:
        added.range = np.array(span)
    effort = _limit(joint, "effort")
    if effort > 0.0:
        added.actfrclimited = True
        added.actfrcrange = np.array([-effort, effort])


def _range(joint: Joint, notes: list[str]) -> tuple[float, float] | None:
    """Return the limits of a joint [rad or m], None if it has none."""
    limit = joint.element.find("limit")
    if joint.kind == "continuous" or limit is None:
        return None
    if limit.get("lower") is None and limit.get("upper") is None:
        return None
    owner = f'joint "{joint.name}"'
    low, high = (number(limit, key, 0.0, owner) for key in ("lower", "upper"))
    if low > high:
        raise ModelError(
            f"{owner} has lower limit {low:.6g} above its upper {high:.6g}; swap them"
        )
    if high - low < 1e-6:
        notes.append(f"{owner} cannot move: its limits are both {low:.6g}")
        return low - 1e-3, low + 1e-3
    return low, high


def _limit(joint: Joint, what: str) -> float:
    owner = f'joint "{joint.name}"'
    return abs(number(joint.element.find("limit"), what, 0.0, owner))


def _mimics(joints: list[Joint], notes: list[str]) -> list[Mimic]:
    """Return the joints that follow others, as written."""
    moving, found = {joint.name for joint in joints}, []
    for joint in joints:
        mimic, owner = joint.element.find("mimic"), f'joint "{joint.name}"'
        if mimic is None:
            continue
        primary = mimic.get("joint", "")
        if primary in moving:
            ratio = number(mimic, "multiplier", 1.0, owner)
            offset = number(mimic, "offset", 0.0, owner)
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
            rgba = numbers(color, "rgba", (0.0, 0.0, 0.0, 1.0), "a material")
            found.setdefault(material.get("name", ""), tuple(rgba.tolist()))
    return found


def _mesh_folder(root: ET.Element, path: Path) -> tuple[Path, ...]:
    compiler = root.find("mujoco/compiler")
    folder = "" if compiler is None else compiler.get("meshdir", "")
    here = path.resolve().parent
    return (here, here / folder) if folder else (here,)


@dataclass(frozen=True, eq=False)
class _Shape:
    """The geometry of a visual or collision element."""

    link: str
    element: ET.Element
    pose: Pose
    color: tuple[float, ...] | None
    collides: bool


def _shapes(link: Link, colors: dict[str, tuple[float, ...]]) -> Iterator[_Shape]:
    """Yield the shapes of a link: those for the eye, then those for contact."""
    owner = f'link "{link.name}"'
    for tag in ("visual", "collision"):
        for parent in link.element.findall(tag):
            for element in parent.findall("geometry/*"):
                yield _Shape(
                    link=link.name,
                    element=element,
                    pose=origin(parent, owner),
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
    return tuple(numbers(own, "rgba", (0.0, 0.0, 0.0, 1.0), owner).tolist())


def _add_shapes(
    bodies: dict[str, mujoco.MjsBody],
    links: dict[str, Link],
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
        scale=numbers(shape.element, "scale", (1.0, 1.0, 1.0), owner),
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
        size = 0.5 * numbers(element, "size", (0.0, 0.0, 0.0), owner)
    else:
        radius = number(element, "radius", 0.0, owner)
        size = np.array([radius, 0.5 * number(element, "length", 0.0, owner), 0.0])
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
