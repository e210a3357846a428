"""Whether a robot's legs can reach the footsteps of a pattern, before it moves."""

from __future__ import annotations

import numpy as np

from .errors import ModelError, PlanError
from .footsteps import Side
from .pattern import Pattern, Phase
from .robot import LEGS, Kinematics, Robot
from .spatial import rotation_yaw

_MARGIN = 0.99  # share of a leg's whole length that a plan may use


def check_reach(robot: Robot, pattern: Pattern) -> None:
    """Check that both legs reach their feet whenever they stand on the ground.

    The hips are taken where the CoM carries them in the walking posture, upright.

    Args:
        robot: The robot.
        pattern: The pattern.

    Raises:
        ModelError: If a leg has not six joints.
        PlanError: If a foot would be out of reach; it names the footstep.
    """
    for limb in robot.limbs:
        if limb.name in LEGS.values() and len(limb.joints) != 6:
            raise ModelError(
                f"the {limb.name.replace('_', ' ')} of {robot.name} has "
                f"{len(limb.joints)} joints; walking needs legs of six"
            )
    kinematics = Kinematics(robot)
    posture = kinematics.posture(robot.home)
    R = posture.rotation
    legs = {}
    for i, side in enumerate(Side):
        anchors = _joint_anchors(robot, kinematics, LEGS[side])
        hip = R.T @ (anchors[0] - posture.com)
        ankle = posture.end_rotations[i].T @ (anchors[-1] - posture.ends[i])
        length = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
        legs[side] = hip, ankle, length
    for span in pattern.phases:
        if span.phase is not Phase.STAND:
            _check_at(pattern, span.start, legs)
            _check_at(pattern, span.start + 0.5 * span.duration, legs)


def _joint_anchors(robot: Robot, kinematics: Kinematics, name: str) -> np.ndarray:
    """Return where the joints of a leg are [m], world, of shape (n, 3)."""
    limb = next(limb for limb in robot.limbs if limb.name == name)
    return kinematics.data.xanchor[np.array(limb.joints) + 1]


def _check_at(pattern: Pattern, time: float, legs: dict) -> None:
    """Check both legs at one time."""
    reference = pattern.at(time)
    R = rotation_yaw(reference.heading)
    for side, (hip, ankle, length) in legs.items():
        foot = reference.foot(side)
        on_ground = foot.position[2] == 0.0
        where = foot.position + rotation_yaw(foot.yaw) @ ankle
        needed = float(np.linalg.norm(reference.com + R @ hip - where))
        if on_ground and needed > _MARGIN * length:
            step = reference.step
            raise PlanError(
                f"footstep {step + 1} is out of reach: at {time:.2f} s the {side} leg "
                f"would have to be {needed:.3f} m long, and {_MARGIN * length:.3f} m "
                "are there; take shorter steps (gait.half_step) or lower the body "
                "(pendulum.height)"
            )
