"""The kinematic tree of a model: chains of joints, their anchors, axes and masses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from .loaders import Mimic
from .mimic import couple

_KINDS = "roll", "pitch", "yaw"
"""What a joint about x, y or z does."""
_PITCH = 0.7  # least share of an axis to the left that makes a joint bend the leg
_KNEE, _HIP = 0.7, -0.35  # from where a leg is sought; ankles as hips [rad]


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A compiled model in one posture. Made by `zero_posture`."""

    model: mujoco.MjModel
    """The model; its first joint is the free joint of the base."""
    data: mujoco.MjData
    """Its kinematics."""
    name: str
    """What messages call it."""

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

    def body_of(self, joint: int) -> int:
        """Return the body that a joint moves."""
        return int(self.model.jnt_bodyid[joint])

    def welded(self, body: int) -> np.ndarray:
        """Return all bodies that no joint separates from one."""
        weld = self.model.body_weldid
        return np.flatnonzero(weld == weld[body])

    def beyond(self, body: int) -> list[int]:
        """Return a body and all that hang on it, by joints or not."""
        found = {body}
        for b in range(body + 1, self.model.nbody):
            if int(self.model.body_parentid[b]) in found:
                found.add(b)
        return sorted(found)

    def centre(self, body: int) -> np.ndarray:
        """Return the CoM of a body and all that is fixed to it [m], (3,)."""
        bodies = self.welded(body)
        mass = self.model.body_mass[bodies] + 1e-12
        return mass @ self.data.xipos[bodies] / mass.sum()

    def rotation(self, body: int) -> np.ndarray:
        """Return the rotation of a body to the world, (3, 3)."""
        return self.data.xmat[body].reshape(3, 3)

    def anchors(self, joints: Sequence[int]) -> np.ndarray:
        """Return the anchors of joints [m], world, (n, 3)."""
        return self.data.xanchor[list(joints)]

    def axes(self, joints: Sequence[int]) -> np.ndarray:
        """Return the axes of joints, world, (n, 3)."""
        return self.data.xaxis[list(joints)]

    def moved_mass(self, joint: int) -> float:
        """Return the mass that a joint moves [kg]."""
        return float(self.model.body_subtreemass[self.body_of(joint)])

    def middle(self, joints: Sequence[int], end: np.ndarray) -> int:
        """Return the place in a limb, which ends there, of its knee or elbow."""
        return middle_joint(self.anchors(joints), self.axes(joints), end)

    def hip(self, leg: Sequence[int]) -> int:
        """Return the joint of a leg that swings it: that before the knee, like it."""
        knee = self.middle(leg, self.anchors(leg)[-1])
        axis = self.axes(leg)[knee]
        alike = [j for j in leg[:knee] if abs(self.axes([j])[0] @ axis) > 0.7]
        return alike[-1] if alike else leg[0]

    def root_height(self, limbs: Sequence[Sequence[int]]) -> float:
        """Return how high limbs begin over the CoM of what bears them [m]."""
        beyond = {b for limb in limbs for b in self.beyond(self.body_of(limb[0]))}
        rest = [b for b in range(1, self.model.nbody) if b not in beyond]
        mass = self.model.body_mass[rest]
        middle = float(mass @ self.data.xipos[rest, 2] / (mass.sum() + 1e-12))
        roots = [float(self.anchors(limb)[0, 2]) for limb in limbs]
        return min(roots) - middle

    def lacks(self, leg: Sequence[int]) -> str:
        """Return what a leg lacks of the six joints that walking needs.

        They are three of the hip, one of the knee and two of the ankle.

        Args:
            leg: Its joints, base first.

        Returns:
            Such as "5 joints; the roll of the ankle is missing"; empty if none is.
        """
        slides = [
            j for j in leg if self.model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
        ]
        if slides:
            return f"{self.names(slides)[0]}, which slides instead of turning"
        if len(leg) == 6:
            return ""
        knee = self.middle(leg, self.anchors(leg)[-1])
        kinds = [_KINDS[k] for k in np.argmax(np.abs(self.axes(leg)), axis=1).tolist()]
        parts = ("hip", _KINDS, kinds[:knee]), ("ankle", _KINDS[:2], kinds[knee + 1 :])
        missing = [
            f"the {kind} of the {part}"
            for part, needed, there in parts
            for kind in needed
            if kind not in there
        ]
        count, be = f"{len(leg)} joints", "is" if len(missing) == 1 else "are"
        if not missing or len(leg) > 6:
            return f"{count}; walking needs legs of six"
        return f"{count}; {' and '.join(missing)} {be} missing"

    def bent(self, leg: Sequence[int]) -> list[tuple[int, float]]:
        """Return joints and angles [rad] of knee, hip and ankle that bend a leg."""
        sides = self.axes(leg)[:, 1].tolist()
        knee = self.middle(leg, self.anchors(leg)[-1])
        pitch = [i for i, y in enumerate(sides) if abs(y) > _PITCH]
        hip, ankle = [i for i in pitch if i < knee][-1:], [i for i in pitch if i > knee]
        turned = (knee, _KNEE), *((i, _HIP) for i in (*hip, *ankle[:1]))
        return [(leg[i], math.copysign(1.0, sides[i]) * x) for i, x in turned]

    def leg_length(self, leg: Sequence[int]) -> float:
        """Return the length of a stretched leg, hip to knee to ankle [m]."""
        anchors = self.anchors(leg)
        knee = anchors[self.middle(leg, anchors[-1])]
        thigh, shank = knee - self.anchors([self.hip(leg)])[0], anchors[-1] - knee
        return float(np.linalg.norm(thigh) + np.linalg.norm(shank))


def zero_posture(
    model: mujoco.MjModel, name: str, mimics: Iterable[Mimic] = ()
) -> Skeleton:
    """Return a model with all joints at zero, or as near as their ranges allow.

    Args:
        model: The compiled model; its first joint is the free joint of the base.
        name: What messages call it.
        mimics: Joints that follow others.

    Returns:
        The posture: the base in the world's origin, turned as the file has it.
    """
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7] = 0.0, model.qpos0[3:7]
    low, high = model.jnt_range[1:].T
    angles = np.where(model.jnt_limited[1:] > 0, np.clip(0.0, low, high), 0.0)
    joints = [model.joint(k).name for k in range(1, model.njnt)]
    coupling = couple(mimics, joints)
    if coupling is not None:
        coupling.follow(angles)
    data.qpos[7:] = angles
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return Skeleton(model, data, name)


def middle_joint(anchors: np.ndarray, axes: np.ndarray, end: np.ndarray) -> int:
    """Return the joint that bends a limb in the middle: its knee or elbow.

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
