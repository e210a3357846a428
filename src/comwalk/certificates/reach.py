"""How long a robot's legs must be to reach the footsteps of a pattern."""

from __future__ import annotations

import numpy as np

from ..embedding import rotation_yaw
from ..errors import ModelError
from ..pattern import Pattern, Phase
from ..robot import LEGS, Kinematics, Robot
from ..sides import Side

REACH_SHARE = 0.99
"""Share of a leg's whole length that a plan may use [-]."""


def leg_reaches(
    robot: Robot, pattern: Pattern
) -> dict[Side, tuple[float, float, float]]:
    """Return how long each leg must be whenever its foot is on the ground.

    The hips are taken where the CoM carries them in the walking posture, upright.

    Args:
        robot: The robot.
        pattern: The pattern.

    Returns:
        For each side the largest length needed [m], the length there is [m], and when
        it is needed [s].

    Raises:
        ModelError: If a leg has not six joints.
    """
    kinematics = Kinematics(robot)
    posture = kinematics.posture(robot.home)
    times = [
        time
        for span in pattern.phases
        if span.phase is not Phase.STAND or len(pattern.phases) == 1
        for time in (span.start, span.start + 0.5 * span.duration)
    ]
    reaches = {}
    for i, side in enumerate(Side):
        anchors = _joint_anchors(robot, kinematics, LEGS[side])
        hip = posture.rotation.T @ (anchors[0] - posture.com)
        ankle = posture.end_rotations[i].T @ (anchors[-1] - posture.ends[i])
        length = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
        needed = [(_needed(pattern, side, hip, ankle, t), t) for t in times]
        most, when = max(needed, key=lambda pair: pair[0])
        reaches[side] = most, REACH_SHARE * length, when
    return reaches


def _joint_anchors(robot: Robot, kinematics: Kinematics, name: str) -> np.ndarray:
    """Return where the joints of a leg are [m], world, of shape (n, 3)."""
    limb = next(limb for limb in robot.limbs if limb.name == name)
    if len(limb.joints) != 6:
        raise ModelError(
            f"the {name.replace('_', ' ')} of {robot.name} has {len(limb.joints)} "
            "joints; walking needs legs of six"
        )
    return kinematics.data.xanchor[np.array(limb.joints) + 1]


def _needed(
    pattern: Pattern, side: Side, hip: np.ndarray, ankle: np.ndarray, time: float
) -> float:
    """Return the distance of hip and ankle at a time [m]; 0 for a foot in the air."""
    reference = pattern.at(time)
    foot = reference.foot(side)
    if foot.position[2] != 0.0:
        return 0.0
    where = foot.position + rotation_yaw(foot.yaw) @ ankle
    R = rotation_yaw(reference.heading)
    return float(np.linalg.norm(reference.com + R @ hip - where))
