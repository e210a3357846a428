"""Variations of a recorded motion: other joints, names, posture, size and speed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import MotionError, checked_number
from .motion import Motion, _entry


def select(motion: Motion, joints: Iterable[str]) -> Motion:
    """Return a motion with some of its joints; the others go into `dropped`.

    Args:
        motion: The motion.
        joints: Names of the joints to keep; names it does not move are ignored.

    Returns:
        The motion of the joints kept, in their order in `motion`.

    Raises:
        MotionError: If none of the joints is in the motion.
    """
    wanted = set(joints)
    kept = [i for i, joint in enumerate(motion.joints) if joint in wanted]
    if not kept:
        raise MotionError(
            f'motion "{motion.name}" moves none of the joints asked for: '
            f"{', '.join(sorted(wanted)) or 'none'}; it moves "
            f"{', '.join(motion.joints)}"
        )
    out = tuple(joint for joint in motion.joints if joint not in wanted)
    return replace(
        motion,
        joints=tuple(motion.joints[i] for i in kept),
        positions=motion.positions[:, kept],
        dropped=motion.dropped + out,
    )


def renamed(motion: Motion, names: Mapping[str, str]) -> Motion:
    """Return a motion whose roles are the joint names of a robot.

    Args:
        motion: The motion, such as a built-in dance.
        names: The robot's joint for each role, `{"l_elbow_pitch": "L_ELBOW_P"}`;
            roles without an entry go into `dropped`.

    Returns:
        The motion of the roles that the robot has.

    Raises:
        MotionError: If the robot has none of the roles, or two roles share a joint.
    """
    kept = select(motion, names)
    return replace(kept, joints=tuple(names[joint] for joint in kept.joints))


def placed(
    motion: Motion,
    home: Mapping[str, float],
    signs: Mapping[str, float] | None = None,
) -> Motion:
    """Return a motion whose angles are counted from a home posture.

    Args:
        motion: The motion, such as a built-in dance with no home of its own.
        home: Home angle of every joint [rad], where angle 0 of the motion goes.
        signs: -1 for joints that turn the other way, by joint; +1 where none is given.

    Returns:
        The motion in absolute joint angles.

    Raises:
        MotionError: If a home angle is missing.
    """
    center = [_entry(motion, home, "home angle", j) for j in motion.joints]
    turned = [(signs or {}).get(j, 1.0) for j in motion.joints]
    positions = np.array(center) + np.array(turned) * motion.positions
    return replace(motion, positions=positions)


def scaled(
    motion: Motion,
    amplitude: float = 1.0,
    speed: float = 1.0,
    *,
    about: Mapping[str, float] | None = None,
) -> Motion:
    """Return a motion made larger or smaller, faster or slower.

    Args:
        motion: The motion.
        amplitude: Factor of the angles measured from `about`, in [0, 100].
        speed: Factor of the speed, in [0.001, 1000].
        about: Posture that stays where it is [rad], the robot's home as a rule;
            joints without an entry, and all without it, are scaled about 0.

    Returns:
        The scaled motion; its rates are `amplitude * speed` times as large.

    Raises:
        ParameterError: If a factor is out of range.
    """
    amplitude = checked_number("amplitude", amplitude, low=0.0, high=100.0)
    speed = checked_number("speed", speed, low=1e-3, high=1e3)
    center = posture_angles(motion.joints, about)
    positions = center + amplitude * (motion.positions - center)
    return replace(motion, times=motion.times / speed, positions=positions)


def posture_angles(
    joints: Sequence[str], angles: Mapping[str, float] | None
) -> np.ndarray:
    """Return the angles of the joints, zero where none is given.

    Args:
        joints: Names of m joints.
        angles: Angles [rad] by joint; None for all zero.

    Returns:
        Angles [rad], of shape (m,).
    """
    table = angles or {}
    named = [(joint, table.get(joint, 0.0)) for joint in joints]
    return np.array(
        [checked_number(f'angle of "{j}"', q, unit="rad") for j, q in named]
    )
