"""Where the soles stand, how they lie, and how they meet uneven ground.

The plan thinks of level soles at planned places. A `Footing` keeps what is different:
*dead reckoning* by the encoders tells where a foot came down, the IMU tells how a sole
lies, and the shares of the weight that the feet bear tell a foot that lands to yield
when it meets the ground early, and to reach down when the ground comes late.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..control import BodySettings
from ..pattern import (
    Phase,
    Reference,
    share_between,
)
from ..sides import Side

FOOT_INDEX = {side: k for k, side in enumerate(Side)}
"""Row of each foot in arrays of both."""

RETURN_TIME = 0.1
"""Time constant of a swinging foot's return to its path [s]."""
SETTLE_TIME = 2.0
"""Time constant of the body's return to its height over the feet [s]."""
LEAN_TIME = 0.2
"""Time constant in which a sole is taken to lie as the IMU says [s]."""
RECOVERING = 0.015
"""CoM error above which the soles are kept as they are [m]."""
CAUTION = 0.1
"""How much slower the IMU is believed while the robot recovers [-]."""
EDGE = 0.7
"""Share of the sole's half size beyond which it stands on its edge [-]."""
TOLERANCE = 0.25
"""Share of the weight by which a landing may differ from its plan [-]."""
REACH = 0.05
"""Farthest that a foot leaves its plan up or down [m]."""


class Place(NamedTuple):
    """Where a level frame stands."""

    x: float
    """Forward, world [m]."""
    y: float
    """To the left, world [m]."""
    c: float
    """Cosine of its yaw [-]."""
    s: float
    """Sine of its yaw [-]."""

    def turn(self, v: Sequence[float]) -> tuple[float, float, float]:
        """Return a vector in world axes, given in the frame's."""
        x, y, z = v
        return self.c * x - self.s * y, self.s * x + self.c * y, z

    def of(self, point: Sequence[float]) -> tuple[float, float, float]:
        """Return a point in the world, given in the frame."""
        x, y, z = self.turn(point)
        return self.x + x, self.y + y, z


def tilt_matrix(up: Sequence[float]) -> np.ndarray:
    r"""Return the smallest rotation that takes a direction to the vertical.

    Args:
        up: The x and y of the unit vector that points up, in the tilted frame.

    Returns:
        Rotation from the tilted to the level frame of the same heading, (3, 3).
    """
    x, y = up
    z = math.sqrt(max(1.0 - x * x - y * y, 0.0))
    k = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - k * x * x, -k * x * y, -x],
            [-k * x * y, 1.0 - k * y * y, -y],
            [x, y, z],
        ]
    )


def planned_share(reference: Reference) -> float:
    """Return the share of the weight that the plan puts on the left foot.

    On two feet it is where the reference ZMP lies between the soles.

    Args:
        reference: The reference.

    Returns:
        Share [-], in [0, 1].
    """
    if reference.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
        return 1.0 if reference.phase is Phase.SINGLE_LEFT else 0.0
    return share_between(
        reference.zmp, reference.left.position[:2], reference.right.position[:2]
    )


class Footing:
    """How the feet differ from the plan. Final."""

    def __init__(self, settings: BodySettings, period: float) -> None:
        """Start with both soles as planned.

        Args:
            settings: Which of the sensors are heeded, and how fast a foot yields.
            period: Control period [s].
        """
        self._settings, self._period = settings, period
        self._offsets = {side: (0.0, 0.0, 0.0) for side in Side}
        self._recovers = False
        self._up = np.zeros((2, 2))  # measured: what is up, in each sole's frame
        self.heights = {side: 0.0 for side in Side}
        """How far each foot is commanded above its plan [m]."""
        self.leans = np.zeros((2, 2))
        """How each foot is commanded to lie: what is up, in its frame, (2, 2)."""
        cutoff = settings.imu_cutoff
        self._share = 1.0 - math.exp(-2.0 * math.pi * cutoff * period)

    def foothold(self, side: Side, reference: Reference) -> tuple[float, float, float]:
        """Return where a sole stands: x [m], y [m], yaw [rad]."""
        foot = reference.foot(side)
        x, y, _ = foot.position.tolist()
        dx, dy, dyaw = self._offsets[side]
        return x + dx, y + dy, foot.yaw + dyaw

    def place(self, side: Side, reference: Reference) -> Place:
        """Return where a sole stands as a level frame."""
        x, y, yaw = self.foothold(side, reference)
        return Place(x, y, math.cos(yaw), math.sin(yaw))

    def feel(self, soles: np.ndarray, imu: np.ndarray, orientation: np.ndarray) -> None:
        """Find how both soles lie, by the IMU.

        Args:
            soles: Rotations of the soles, by the encoders, (2, 3, 3).
            imu: Rotation of the IMU, by the encoders, in the same axes, (3, 3).
            orientation: What the IMU reads, quaternion wxyz.
        """
        if not self._settings.imu:
            return
        w, x, y, z = orientation.tolist()
        up = (
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        )  # the world's vertical, in the IMU's frame
        seen = (imu @ up) @ soles  # (2, 3), in each sole's frame
        share = self._share * (CAUTION if self._recovers else 1.0)
        self._up += share * (seen[:, :2] - self._up)

    def level(self, soles: np.ndarray, side: Side) -> np.ndarray:
        """Return the level frame over a sole.

        Args:
            soles: Rotations of the soles, (2, 3, 3).
            side: Which sole.

        Returns:
            Rotation of a frame with the sole's heading and z up, (3, 3).
        """
        k = FOOT_INDEX[side]
        if not self._settings.imu:
            return soles[k]
        return soles[k] @ tilt_matrix(self._up[k].tolist()).T

    def change_support(
        self, old: Side, reference: Reference, seen: Sequence[float], turn: float
    ) -> None:
        """Find where the new supporting sole stands, seen from the old one.

        Args:
            old: The side that supported until now.
            reference: The reference of this tick.
            seen: The new sole's centre in the old one's level frame [m].
            turn: The new sole's heading in that frame [rad].
        """
        new = old.other
        x, y, _ = self.place(old, reference).of(seen)
        yaw = self.foothold(old, reference)[2] + turn
        self._offsets[new] = (0.0, 0.0, 0.0)
        x_d, y_d, yaw_d = self.foothold(new, reference)
        dyaw = math.remainder(yaw - yaw_d, math.tau)
        self._offsets[new] = (x - x_d, y - y_d, dyaw)

    def follow(
        self,
        reference: Reference,
        left_share: float,
        edges: np.ndarray,
        com_error: np.ndarray,
    ) -> None:
        """Move the commanded feet towards what was felt.

        Args:
            reference: The reference of this tick.
            left_share: Share of the weight that the left foot bears [-].
            edges: Where each foot's centre of pressure is, x and y as shares of the
                sole's half length and half width, (2, 2); zero for a foot in the air.
            com_error: CoM ahead of its reference [m], world, (2,).
        """
        self._recovers = math.hypot(*com_error.tolist()) > RECOVERING
        single = reference.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
        swing, planned = reference.support.other, planned_share(reference)
        surplus = left_share - planned
        surplus -= min(max(surplus, -TOLERANCE), TOLERANCE)
        for side in Side:
            swings = single and side is swing
            self._land(side, reference, swings, surplus * side.sign)
            self._lie(side, swings, edges)
        if single:
            keep = 1.0 - self._period / RETURN_TIME
            dx, dy, dyaw = self._offsets[swing]
            self._offsets[swing] = (keep * dx, keep * dy, keep * dyaw)

    def _land(
        self, side: Side, reference: Reference, swings: bool, surplus: float
    ) -> None:
        """Let a foot yield by the share of the weight that it bears too much."""
        dt, h = self._period, self.heights[side]
        if not self._settings.landing:
            return
        if swings and (surplus <= 0.0 or reference.foot(side).velocity[2] > 0.0):
            self.heights[side] = h - dt / RETURN_TIME * h
            return
        if reference.phase is Phase.DOUBLE or swings:
            rate = 0.5 if reference.phase is Phase.DOUBLE else 1.0
            h += rate * dt * self._settings.landing * surplus
        self.heights[side] = min(max(h - dt / SETTLE_TIME * h, -REACH), REACH)

    def _lie(self, side: Side, swings: bool, edges: np.ndarray) -> None:
        """Let a sole lie as the IMU says it does, and a swinging one be level.

        A sole that stands on an edge is turned the other way until it lies flat. While
        the robot recovers from a push, soles stay as they are: an ankle that yields
        cannot hold the body.
        """
        if not self._settings.imu:
            return
        k, dt = FOOT_INDEX[side], self._period
        if swings:
            self.leans[k] -= dt / RETURN_TIME * self.leans[k]
            return
        if self._recovers:
            return
        self.leans[k] += dt / LEAN_TIME * (self._up[k] - self.leans[k])
        edge = np.clip(edges[k], -1.0, 1.0)
        past = np.sign(edge) * np.maximum(np.abs(edge) - EDGE, 0.0) / (1.0 - EDGE)
        self.leans[k] += dt * self._settings.rolling * past
