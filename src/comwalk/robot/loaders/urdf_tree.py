"""The links and joints of a URDF: one tree, in numbers that a robot can have."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...errors import ModelError
from .parts import DEEPEST, first_of

MOVING = ("revolute", "continuous", "prismatic")
"""Kinds of joints that move along one coordinate."""

_LEAST_GYRATION = 1e-3
"""Least radius of gyration [m] of a link with mass."""
_WATER = 1000.0
"""Density [kg/m^3] of a link without inertia."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame in another one."""

    p: np.ndarray
    """Its origin [m], of shape (3,)."""
    R: np.ndarray
    """Its rotation, of shape (3, 3)."""

    def __matmul__(self, other: Pose) -> Pose:
        """Return the pose of a frame that is given in this one."""
        return Pose(self.p + self.R @ other.p, self.R @ other.R)


@dataclass(frozen=True, eq=False)
class Link:
    """A link."""

    name: str
    """Its name."""
    element: ET.Element
    """Its element."""
    mass: float
    """Its mass [kg]."""
    com: np.ndarray
    """Its CoM [m] in its own frame, of shape (3,)."""
    moments: np.ndarray
    """Its principal moments of inertia [kg m^2], of shape (3,)."""
    axes: np.ndarray
    """Their axes as columns, in its own frame, of shape (3, 3)."""

    @property
    def is_bare(self) -> bool:
        """Whether it has neither mass nor shape."""
        return self.mass == 0.0 and all(
            self.element.find(tag) is None for tag in ("visual", "collision")
        )


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint."""

    name: str
    """Its name."""
    element: ET.Element
    """Its element."""
    kind: str
    """One of `MOVING`, or `fixed`, `floating`, `planar`."""
    parent: str
    """Name of the link above."""
    child: str
    """Name of the link below."""
    pose: Pose
    """Frame of the child in that of the parent, at zero."""

    def number(self, tag: str, key: str, default: float) -> float:
        """Return a number of an element inside the joint.

        Args:
            tag: Name of the element, such as `limit`.
            key: Name of its attribute.
            default: What it is if element or attribute is missing.

        Returns:
            The finite number.

        Raises:
            ModelError: If it is something else.
        """
        return number(self.element.find(tag), key, default, f'joint "{self.name}"')


@dataclass(frozen=True, eq=False)
class Tree:
    """All links and joints."""

    links: dict[str, Link]
    """Links by name."""
    joints: dict[str, Joint]
    """Joints by name."""
    below: dict[str, list[Joint]]
    """Joints below each link."""

    @property
    def root(self) -> str:
        """Name of the link that no joint carries."""
        children = {joint.child for joint in self.joints.values()}
        return next(name for name in self.links if name not in children)

    def subtree(self, link: str, *, welded: bool = False) -> list[str]:
        """Return a link and all below it.

        Args:
            link: Name of the link.
            welded: Whether to follow fixed joints only.

        Returns:
            Names of links, parents first.
        """
        found = [link]
        for name in found:
            found += [
                j.child for j in self.below[name] if not welded or j.kind == "fixed"
            ]
        return found

    def mass(self, links: Iterable[str]) -> float:
        """Return the mass [kg] of some links.

        Args:
            links: Names of the links.

        Returns:
            The sum of their masses.
        """
        return sum(self.links[name].mass for name in links)


def numbers(
    element: ET.Element | None, key: str, default: tuple[float, ...], owner: str
) -> np.ndarray:
    """Return the finite numbers of an attribute.

    Args:
        element: The element, None if there is none.
        key: Name of the attribute.
        default: The numbers if element or attribute is missing.
        owner: What the element belongs to, for the message.

    Returns:
        As many numbers as the default has.

    Raises:
        ModelError: If the text is something else.
    """
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


def number(element: ET.Element | None, key: str, default: float, owner: str) -> float:
    """Return the finite number of an attribute; see `numbers`."""
    return float(numbers(element, key, (default,), owner)[0])


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


def origin(element: ET.Element, owner: str) -> Pose:
    """Return the pose that an element's `origin` gives, else identity.

    Args:
        element: A joint, an inertial, a visual or a collision.
        owner: What the element belongs to, for the message.

    Returns:
        The pose.

    Raises:
        ModelError: If its numbers are something else.
    """
    origin, zeros = element.find("origin"), (0.0, 0.0, 0.0)
    return Pose(
        numbers(origin, "xyz", zeros, owner),
        _rotation(numbers(origin, "rpy", zeros, owner)),
    )


def _by_name(elements: list[ET.Element], what: str) -> dict[str, ET.Element]:
    """Return links or joints by their names, each of which must be there once."""
    names = [element.get("name") or "" for element in elements]
    if "" in names:
        raise ModelError(f"a {what} has no name; give every {what} its own")
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise ModelError(f'{count} {what}s are named "{name}"; rename all but one')
    return dict(zip(names, elements, strict=True))


def read_tree(root: ET.Element, notes: list[str]) -> Tree:
    """Read all links and joints, which must form one tree.

    Args:
        root: The element `robot`.
        notes: Gets a line if inertias are repaired.

    Returns:
        The tree.

    Raises:
        ModelError: If names, numbers or connections are wrong.
    """
    repaired: list[str] = []
    links = {
        name: _read_link(name, element, repaired)
        for name, element in _by_name(root.findall("link"), "link").items()
    }
    joints = {
        name: _read_joint(name, element, links)
        for name, element in _by_name(root.findall("joint"), "joint").items()
    }
    if not links:
        raise ModelError("it has no links; is this a whole robot?")
    if repaired:
        notes.append(f"no or impossible inertia, repaired: {first_of(repaired)}")
    below: dict[str, list[Joint]] = {name: [] for name in links}
    for joint in joints.values():
        below[joint.parent].append(joint)
    _check_parents(links, joints)
    return Tree(links, joints, below)


def _check_parents(links: Iterable[str], joints: dict[str, Joint]) -> None:
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
            if len(above) > DEEPEST:
                raise ModelError(f"more than {DEEPEST} links hang on each other")


def _read_link(name: str, element: ET.Element, repaired: list[str]) -> Link:
    """Return a link; `repaired` collects those whose inertia no body can have."""
    owner, inertial = f'link "{name}"', element.find("inertial")
    if inertial is None:
        return Link(name, element, 0.0, np.zeros(3), np.zeros(3), np.eye(3))
    mass = number(inertial.find("mass"), "value", 0.0, owner)
    if mass < 0.0:
        raise ModelError(f"{owner} has mass {mass:.6g} kg; it must not be negative")
    pose, tensor = origin(inertial, owner), inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (
        number(tensor, key, 0.0, owner)
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    possible = _possible_moments(mass, moments)
    if np.abs(possible - moments).max() > mass * _LEAST_GYRATION**2:
        repaired.append(name)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return Link(name, element, mass, pose.p, possible, pose.R @ axes)


def _possible_moments(mass: float, moments: np.ndarray) -> np.ndarray:
    """Return principal moments [kg m^2] that a body of that mass [kg] can have.

    Without any, they are those of a ball of water. None may be negative or larger than
    the two others together: else all become their mean, as MuJoCo's `balanceinertia`.
    """
    least = mass * _LEAST_GYRATION**2
    largest = moments.max()
    if largest <= least:
        radius = (mass / (4.0 / 3.0 * math.pi * _WATER)) ** (1.0 / 3.0)
        return np.full(3, 0.4 * mass * radius**2)
    if moments.min() < 0.0 or largest > (moments.sum() - largest) * (1.0 + 1e-6):
        moments = np.full(3, moments.mean())
    return np.maximum(moments, least)


def _read_joint(name: str, element: ET.Element, links: dict[str, Link]) -> Joint:
    """Return a joint between two links that exist."""
    owner, kind, ends = f'joint "{name}"', element.get("type", ""), []
    if kind not in (*MOVING, "fixed", "floating", "planar"):
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
    return Joint(name, element, kind, *ends, pose=origin(element, owner))
