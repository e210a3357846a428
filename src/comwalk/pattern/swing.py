r"""The path of the swing foot between two footholds.

It is not in the paper, which only says that the shifting leg makes a step. Here the
foot rises and lands with zero velocity and acceleration, and travels by a minimum-jerk
curve in the middle of the swing, so that it leaves and meets the ground vertically.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import checked_number
from .footsteps import Foothold, shortest_turn

VERTICAL_SHARE = 0.02
"""Share of the swing at each end in which the foot moves vertically only [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class FootMotion:
    """Pose and velocity of the centre of a sole, which stays level."""

    position: np.ndarray
    """Centre of the sole [m], shape (3,), world; z = 0 on the ground."""

    yaw: float
    """Heading of the foot [rad], world."""

    velocity: np.ndarray
    """Velocity of the centre of the sole [m/s], shape (3,), world."""

    yaw_rate: float
    """Rate of the heading [rad/s]."""


def minimum_jerk(s: float) -> tuple[float, float]:
    r"""Return the minimum-jerk blend and its slope.

    .. math:: h(s) = 10 s^3 - 15 s^4 + 6 s^5

    Args:
        s: Progress [-]; held at 0 and 1 outside [0, 1].

    Returns:
        h in [0, 1] and dh/ds; the first and second slopes are 0 at both ends.

    Example:
        >>> minimum_jerk(0.5)
        (0.5, 1.875)
    """
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    s_2, r = s * s, 1.0 - s
    return s_2 * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s_2 * r * r


def resting_foot(foothold: Foothold) -> FootMotion:
    """Return a foot that stands still on the ground.

    Args:
        foothold: Where it stands.

    Returns:
        Its pose and zero velocity, as read-only arrays that may be shared.
    """
    position, velocity = np.array([foothold.x, foothold.y, 0.0]), np.zeros(3)
    position.setflags(write=False)
    velocity.setflags(write=False)
    return FootMotion(position, foothold.yaw, velocity, 0.0)


def swing_foot(
    start: Foothold, end: Foothold, height: float, duration: float, time: float
) -> FootMotion:
    r"""Return where the swing foot is and how it moves.

    .. math:: z = 64\, h_{max} s^3 (1-s)^3, \quad s = t / S

    and x, y, yaw by `minimum_jerk` over the middle 96 % of the swing; the yaw turns
    the short way. The path is twice continuously differentiable.

    Args:
        start: Foothold at lift-off.
        end: Foothold at landing.
        height: Clearance in the middle of the swing [m].
        duration: Duration of the swing S [s], > 0.
        time: Time since lift-off t [s]; held at 0 and S outside.

    Returns:
        Pose and velocity of the centre of the sole, world.

    Raises:
        ParameterError: If the time or the height is not finite, or the duration is
            not positive.

    Example:
        >>> foot = swing_foot(Foothold(0, 0), Foothold(0.4, 0), 0.04, 0.8, 0.4)
        >>> foot.position.round(6).tolist()
        [0.2, 0.0, 0.04]
    """
    if not (0.0 < duration < math.inf and math.isfinite(time + height)):
        checked_number("duration", duration, unit="s", low=0.0, open_low=True)
        checked_number("height", height, unit="m")
        checked_number("time", time, unit="s")
    s = min(max(time / duration, 0.0), 1.0)
    middle = 1.0 - 2.0 * VERTICAL_SHARE
    h, dh = minimum_jerk((s - VERTICAL_SHARE) / middle)
    dh /= middle * duration
    bow = s * (1.0 - s)
    z, dz = 64.0 * bow**3, 192.0 * bow * bow * (1.0 - 2.0 * s) / duration
    dx, dy = end.x - start.x, end.y - start.y
    turn = shortest_turn(start.yaw, end.yaw)
    position = np.array([start.x + h * dx, start.y + h * dy, height * z])
    velocity = np.array([dh * dx, dh * dy, height * dz])
    return FootMotion(position, start.yaw + h * turn, velocity, dh * turn)
