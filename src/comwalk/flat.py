"""A robot as flat records: what compiled kernels run on.

A *link* is all that moves with one joint; link 0 is the body center. In the model's
zero posture all link frames have the axes of the body center, and each has its origin
at its joint's anchor, so that kinematics are one rotation about one axis a joint.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from .errors import ModelError
from .robot import Kinematics, Robot

ANY_AXIS, SLIDE = 3, 4
"""Kinds of joints; 0, 1 and 2 turn about x, y and z."""
LONGEST = 32
"""Most links that a limb's end may hang on."""

_LINK = (
    # What the robot is like.
    ("parent", "i8"),
    ("kind", "i8"),
    ("leader", "i8"),  # link that it follows, 0 if none
    ("ratio", "f8"),  # its rate over the leader's
    ("offset", "f8", 3),  # origin, in the parent [m]
    ("axis", "f8", 3),
    ("zero", "f8"),  # angle in the zero posture [rad]
    ("mass", "f8"),  # share of the robot's mass [-]
    ("first", "f8", 3),  # that times its CoM [m]
    ("below", "f8"),  # share of the mass of all that it carries [-]
    # Where it is, in the world.
    ("R", "f8", (3, 3)),
    ("p", "f8", 3),  # origin [m]
    ("a", "f8", 3),  # axis
    ("moment", "f8", 3),  # share of the mass below times its CoM [m]
    ("lever", "f8", 3),  # CoM's velocity per rate, Eq. (21) [m/rad]
    ("end", "f8", 6),  # twist of its limb's end per rate, Eq. (15)
    # How it moves.
    ("wish", "f8"),  # rate that is given, or wished in the null space [rad/s]
    ("rate", "f8"),  # a_i: rate that does not depend on the body center [rad/s]
    ("gain", "f8", 3),  # B_i: rate per velocity of the body center [rad/m]
)
_LIMB = (
    ("own", "i8"),  # number of its own links, first in its chain
    ("all", "i8"),  # number of links in its chain
    ("chain", "i8", LONGEST),  # its links, then those of others that carry its end
    ("site", "i8"),  # site of its end, -1 if none is marked
    ("rows", "i8"),  # bits of the end's twist that are given; 0 in joint space
    ("twist", "f8", 6),  # the end's twist [m/s; rad/s]
)
_SITE = (("link", "i8"), ("point", "f8", 3), ("turn", "f8", (3, 3)))
LINK, LIMB, SITE = (np.dtype(list(x), align=True) for x in (_LINK, _LIMB, _SITE))
"""Records of a link, a limb and a site."""
WANTED = np.dtype(
    [
        ("com", "f8", 3),  # CoM velocity [m/s]
        ("trunk", "f8", 3),  # angular velocity of the body center [rad/s]
        ("threshold", "f8"),  # `Damping.threshold` [m/rad]
        ("factor", "f8"),  # `Damping.factor` [-]
        ("K", "f8", (6, 6)),
        ("L", "f8", (6, 6)),
        ("Y", "f8", (6, 6)),
        ("s", "f8", 6),
        ("b", "f8", 3),
        ("scratch", "f8", 7),
    ],
    align=True,
)
"""What is wanted of the whole body, and scratch space."""


def records(dtype: np.dtype, count: int = 1) -> np.ndarray:
    """Return records, all zero.

    Args:
        dtype: What they are.
        count: How many.
    """
    return np.zeros(count, dtype)


class Flat(NamedTuple):
    """A robot's records, and the workspace of kernels; not shared by two users."""

    links: np.ndarray
    """The body center, then the link of each joint."""
    limbs: np.ndarray
    """The limbs, in the robot's order."""
    sites: np.ndarray
    """Sites that were asked for, then the limbs' ends."""


def flatten(robot: Robot, sites: Iterable[int] = ()) -> Flat:
    """Return a robot's records.

    Args:
        robot: The robot.
        sites: Sites to be known besides the limbs' ends; they come first.

    Returns:
        New records.

    Raises:
        ModelError: If a joint is no hinge and no slide.
    """
    zero = _at_zero(robot)
    links, link_of = _links(robot, zero)
    known = np.array([*sites, *(x for x in robot.ends if x >= 0)], dtype=np.intp)
    places = records(SITE, len(known))
    places["link"] = link_of[robot.model.site_bodyid[known]]
    points, places["turn"] = zero.sites(known)
    places["point"] = points - zero.data.xanchor[places["link"]]
    return Flat(links, _limbs(robot, links["parent"], places["link"]), places)


def links_in(robot: Robot, model: Any) -> np.ndarray:
    """Return the records of a robot's links as they are in a scene, with what it bears.

    Args:
        robot: The robot.
        model: Compiled model of the scene, whose joints are the robot's.

    Returns:
        New records of `LINK`.
    """
    there = dataclasses.replace(robot, model=model)
    return _links(there, _at_zero(there))[0]


def _at_zero(robot: Robot) -> Kinematics:
    """Return kinematics in the zero posture, the body center at the origin."""
    zero, q = Kinematics(robot, ()), robot.model.qpos0.copy()
    q[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    zero.update(q)
    return zero


def _links(robot: Robot, zero: Kinematics) -> tuple[np.ndarray, np.ndarray]:
    """Return the records of all links, and the link of each body."""
    m, links = robot.model, records(LINK, robot.model.njnt)
    link_of = np.zeros(m.nbody, dtype=np.int64)
    for body in range(1, m.nbody):
        link, first = int(link_of[m.body_parentid[body]]), int(m.body_jntadr[body])
        for joint in range(max(first, 1), first + int(m.body_jntnum[body])):
            links["parent"][joint], link = link, joint
        link_of[body] = link
    anchors = zero.data.xanchor
    links["offset"] = anchors - anchors[links["parent"]]
    links["axis"][1:], links["zero"][1:] = zero.data.xaxis[1:], m.qpos0[7:]
    links["kind"][1:] = [_kind(robot, zero, j) for j in range(1, m.njnt)]
    for body in np.flatnonzero(m.body_rootid == robot.base_body):
        k, share = link_of[body], m.body_mass[body] / robot.mass
        links["mass"][k] += share
        links["first"][k] += share * (zero.data.xipos[body] - anchors[k])
    links["below"] = links["mass"]
    for k in range(len(links) - 1, 0, -1):
        links["below"][links["parent"][k]] += links["below"][k]
    if robot.coupling is not None:
        followers = robot.coupling.followers + 1
        links["leader"][followers] = robot.coupling.leaders + 1
        links["ratio"][followers] = robot.coupling.ratios
    return links, link_of


_SLIDE, _HINGE = 2, 3  # MuJoCo's numbers for these kinds of joints


def _kind(robot: Robot, zero: Kinematics, joint: int) -> int:
    """Return the kind of a joint: its axis, if that is one of the body's."""
    kind = int(robot.model.jnt_type[joint])
    if kind not in (_HINGE, _SLIDE):
        raise ModelError(f"joint {robot.joints[joint - 1]} is no hinge and no slide")
    axis = np.abs(zero.data.xaxis[joint])
    i = int(np.argmax(axis))
    along = np.delete(axis, i).max() < 1e-14
    return SLIDE if kind == _SLIDE else (i if along else ANY_AXIS)


def _limbs(robot: Robot, parents: np.ndarray, links_of_sites: np.ndarray) -> np.ndarray:
    """Return the records of all limbs; one that cannot be solved has no site."""
    limbs = records(LIMB, len(robot.limbs))
    site = len(links_of_sites) - sum(end >= 0 for end in robot.ends)
    for i, (limb, end) in enumerate(zip(robot.limbs, robot.ends, strict=True)):
        limbs["site"][i] = -1
        if end < 0:
            continue
        own, path = [j + 1 for j in limb.joints], []
        link = int(links_of_sites[site])
        while link:
            path.append(link)
            link = int(parents[link])
        chain = [*own, *(k for k in path if k not in own)]
        if set(own) <= set(path) and len(chain) <= LONGEST:
            limbs["own"][i], limbs["all"][i] = len(own), len(chain)
            limbs["chain"][i, : len(chain)] = chain
            limbs["site"][i] = site
        site += 1
    return limbs
