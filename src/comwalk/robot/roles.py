"""Which joint does what in a dance: "l_shoulder_pitch", "waist_yaw", "head_pitch"."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from .anatomy import Anatomy
from .kinematic_tree import Skeleton

Role = tuple[str, float]
"""A joint, and the sign by which it turns as its role does."""

_AXES = {"pitch": 1, "roll": 0, "yaw": 2}
_LEAST_SHARE = 0.6  # of a joint's axis along that of its role


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
        Joint and sign by role.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    posture, roles = Skeleton(model, data, ""), dict[str, Role]()
    hinge = int(mujoco.mjtJoint.mjJNT_HINGE)

    def hinges(names: Sequence[str]) -> list[int]:
        joints = [model.joint(name).id for name in names]
        return [j for j in joints if model.jnt_type[j] == hinge]

    for side, names in anatomy.arms.items():
        arm, letter = hinges(names), side.value[0]
        if arm:
            k = posture.middle(arm, posture.centre(posture.body_of(arm[-1])))
            roles |= _turning(posture, arm[:k], f"{letter}_shoulder")
            roles |= _turning(posture, arm[k : k + 1], f"{letter}_elbow", ("pitch",))
    for part, names in (("waist", anatomy.torso), ("head", anatomy.head)):
        roles |= _turning(posture, hinges(names), part)
    return roles


def _turning(
    posture: Skeleton,
    joints: Sequence[int],
    part: str,
    wanted: Sequence[str] = tuple(_AXES),
) -> dict[str, Role]:
    """Return which of some joints turns about which axis, each for one at most."""
    if not joints:
        return {}
    shares = posture.axes(joints)[:, [_AXES[name] for name in wanted]]
    pairs = _best_pairs(np.abs(shares))
    return {
        f"{part}_{wanted[c]}": (
            posture.model.joint(joints[r]).name,
            math.copysign(1.0, shares[r, c]),
        )
        for r, c in pairs
        if abs(shares[r, c]) > _LEAST_SHARE
    }


def _best_pairs(shares: np.ndarray) -> list[tuple[int, int]]:
    """Return pairs of a row and a column, each in one at most, of the largest sum."""
    rows, columns = shares.shape
    if rows < columns:
        return [(r, c) for c, r in _best_pairs(shares.T)]
    every = itertools.permutations(range(rows), columns)
    best = max(every, key=lambda rows: sum(shares[rows, range(columns)]))
    return list(zip(best, range(columns), strict=True))
