"""A robot as flat records: what compiled kernels run on.

A *link* is all that moves with one joint; link 0 is the body center. In the model's
zero posture all link frames have the axes of the body center, and each has its origin
at its joint's anchor, so that kinematics are one rotation about one axis a joint.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..compiled import records
from ..embedding import ANY_AXIS, BODY, LIMB, LINK, LONGEST, SITE, SLIDE, Flat
from ..errors import ModelError
from .kinematics import Kinematics
from .model import Robot


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
        model: Compiled model of the scene, whose first joints are the robot's.

    Returns:
        New records of `LINK`.
    """
    there = dataclasses.replace(robot, model=model)
    return _links(there, _at_zero(there))[0]


def _at_zero(robot: Robot) -> Kinematics:
    zero, q = Kinematics(robot, ()), robot.model.qpos0.copy()
    q[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    zero.update(q)
    return zero


def _links(robot: Robot, zero: Kinematics) -> tuple[np.ndarray, np.ndarray]:
    """Return the records of all links, and the link of each body."""
    m, n = robot.model, 1 + len(robot.joints)
    links, link_of = records(LINK, n), np.zeros(m.nbody, dtype=np.int64)
    for body in np.flatnonzero(m.body_rootid == robot.base_body).tolist():
        link, first = int(link_of[m.body_parentid[body]]), int(m.body_jntadr[body])
        for joint in range(max(first, 1), first + int(m.body_jntnum[body])):
            links["parent"][joint], link = link, joint
        link_of[body] = link
    anchors, axes = zero.data.xanchor[:n], zero.data.xaxis[:n]
    links["offset"] = anchors - anchors[links["parent"]]
    links["axis"][1:], links["zero"][1:] = axes[1:], m.qpos0[7 : 6 + n]
    links["kind"][1:] = [_kind(robot, zero, j) for j in range(1, n)]
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
            limbs["own"][i], limbs["chain_length"][i] = len(own), len(chain)
            limbs["chain"][i, : len(chain)] = chain
            limbs["site"][i] = site
        site += 1
    return limbs


def bodies_of(robot: Robot) -> np.ndarray:
    """Return the inertias of a robot's links as records of `BODY`, at rest.

    Args:
        robot: The robot.

    Returns:
        New records, one for the body center and one for each joint's link.
    """
    zero, m = _at_zero(robot), robot.model
    link_of = _links(robot, zero)[1]
    bodies, anchors = records(BODY, m.njnt), zero.data.xanchor
    for b in np.flatnonzero(m.body_rootid == robot.base_body):
        body, mass = bodies[link_of[b]], float(m.body_mass[b])
        axes = zero.data.ximat[b].reshape(3, 3)
        arm = zero.data.xipos[b] - anchors[link_of[b]]
        body["mass"] += mass
        body["first"] += mass * arm
        body["inertia"] += axes @ np.diag(m.body_inertia[b]) @ axes.T
        body["inertia"] += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    bodies["armature"][1:] = m.dof_armature[6:]
    return bodies
