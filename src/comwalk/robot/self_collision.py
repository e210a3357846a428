"""Self-collision: distances between geoms of links that are not adjacent.

Links near each other in the tree overlap in most models, and so do links that touch in
the home posture; such pairs are left out. Where most links have geoms that collide,
only these count, else all.
"""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from .kinematic_tree import Skeleton
from .loaders import VISUAL_GROUP, compile_without_bad_meshes
from .model import Robot

CLEARANCE = 0.01
"""Distance below which links are reported [m]."""

_NEAR = 3  # links that are at most as many joints apart may overlap, as at a hip
_MOST = 0.4  # share of links with geoms that collide, for only these to count


def _arm_links(robot: Robot) -> frozenset[str]:
    """Return the names of the bodies of both arms.

    Where arms just hang, their shapes are convex hulls of meshes or rough boxes, and
    the posture is one that was found: that they meet legs says little.
    """
    look = Skeleton(robot.model, mujoco.MjData(robot.model), robot.name)
    return frozenset(
        robot.model.body(body).name
        for limb in robot.limbs
        if limb.name.endswith("_arm") and limb.joints
        for body in look.beyond(look.body_of(1 + limb.joints[0]))
    )


class SelfCollision:
    """Finds links that meet. Final.

    It owns a copy of the model in which the geoms of all links collide.
    """

    def __init__(self, robot: Robot, geometry: mujoco.MjSpec | None = None) -> None:
        """Compile the model with its geoms.

        Args:
            robot: The robot.
            geometry: The same robot with more geoms, and perhaps more joints; the
                robot's own if None.
        """
        self.model = _colliding(geometry or robot.spec)
        self._data = mujoco.MjData(self.model)
        names = {self.model.joint(i).name: i for i in range(self.model.njnt)}
        pairs = [(j, names[n]) for j, n in enumerate(robot.joints) if n in names]
        self._ours = np.array([7 + j for j, _ in pairs])
        self._theirs = self.model.jnt_qposadr[[i for _, i in pairs]]
        self._links = _link_names(self.model)
        self._touching: set[tuple[int, int]] = set()
        self._touching = {pair for pair, _ in self._pairs(robot.home)}
        self._touching |= _neighbours(self.model)
        self.arms = _arm_links(robot)
        """Names of the bodies of both arms."""

    def distances(self, q: np.ndarray) -> dict[str, float]:
        """Return the distances of links that are near each other.

        Args:
            q: Configuration, of shape (7 + joints,).

        Returns:
            Smallest distance of each pair of links that is below `CLEARANCE` [m],
            negative if they overlap, by the names of both.
        """
        found: dict[str, float] = {}
        for (a, b), distance in self._pairs(q):
            name = f"{self._links[a]} and {self._links[b]}"
            found[name] = min(distance, found.get(name, np.inf))
        return found

    def _pairs(self, q: np.ndarray) -> Iterator[tuple[tuple[int, int], float]]:
        """Yield links that are near each other, and their distances."""
        m, d = self.model, self._data
        d.qpos[self._theirs] = q[self._ours]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_collision(m, d)
        if not d.ncon:
            return
        links = m.body_weldid[m.geom_bodyid[d.contact.geom]]
        links.sort(axis=1)
        for pair, distance in zip(links.tolist(), d.contact.dist.tolist(), strict=True):
            if pair[0] != pair[1] and tuple(pair) not in self._touching:
                yield (pair[0], pair[1]), distance


def _colliding(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return a model all of whose links collide, with a margin."""
    spec = spec.copy()
    solid = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    if len({geom.parent.name for geom in solid}) < _MOST * len(spec.bodies):
        shapes = [geom for geom in spec.geoms if geom.group != VISUAL_GROUP]
        solid = shapes if len(shapes) > len(solid) else list(spec.geoms)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for geom in solid:
        geom.contype = geom.conaffinity = 1
        geom.margin, geom.gap = 0.5 * CLEARANCE, 0.0
    return compile_without_bad_meshes(spec, [])


def _link_names(model: mujoco.MjModel) -> list[str]:
    return [model.body(b).name or f"body {b}" for b in range(model.nbody)]


def _neighbours(model: mujoco.MjModel) -> set[tuple[int, int]]:
    """Return pairs of links that few joints join, and all pairs with the world."""
    parents = [int(model.body_weldid[p]) for p in model.body_parentid]
    links = sorted(set(model.body_weldid.tolist()))
    found = {(0, link) for link in links}
    for link in links:
        above = link
        for _ in range(_NEAR):
            above = parents[above]
            found.add((min(above, link), max(above, link)))
    brothers = [(a, b) for a in links for b in links if a < b]
    found |= {(a, b) for a, b in brothers if parents[a] == parents[b]}
    return found
