"""Joints that follow others: q_follower = ratio q_leader + offset.

A follower has no column of its own in Eq. (14): what it does is added to the column of
its leader, and its rate is the leader's times the ratio.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .loaders import Mimic


@dataclass(frozen=True, eq=False)
class Coupling:
    """The followers among a robot's joints. Made by `couple`."""

    followers: np.ndarray
    """Joints that follow, as places in the robot's joints, of shape (k,)."""
    leaders: np.ndarray
    """The joint that each follows; it follows none itself, of shape (k,)."""
    ratios: np.ndarray
    """Factors on the leaders' angles, of shape (k,)."""
    offsets: np.ndarray
    """Angles [rad] at zero of the leaders, of shape (k,)."""

    def follow(self, angles: np.ndarray) -> None:
        """Put the followers where their leaders have them.

        Args:
            angles: Angles of all joints [rad], of shape (joints,), changed in place.
        """
        angles[self.followers] = self.ratios * angles[self.leaders] + self.offsets

    def fold(self, rows: np.ndarray) -> None:
        """Add the followers' columns to their leaders', and clear them.

        Args:
            rows: Jacobian, or generalised forces, whose last axis is that of
                v = [xdot_o; qdot], changed in place.
        """
        for f, l, ratio in zip(  # noqa: E741
            self.followers + 6, self.leaders + 6, self.ratios, strict=True
        ):
            rows[..., l] += ratio * rows[..., f]
            rows[..., f] = 0.0

    def unfold(self, velocity: np.ndarray) -> None:
        """Give the followers the rates that their leaders imply.

        Args:
            velocity: v = [xdot_o; qdot] [m/s, rad/s], changed in place.
        """
        velocity[self.followers + 6] = self.ratios * velocity[self.leaders + 6]

    def limits(
        self, lower: np.ndarray, upper: np.ndarray, speed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return limits by which the followers, too, stay within theirs.

        Args:
            lower: Lower limits of all joints [rad], of shape (joints,).
            upper: Upper limits [rad], of shape (joints,).
            speed: Speed limits [rad/s], of shape (joints,).

        Returns:
            The three for the leaders; followers have none left of their own.
        """
        lower, upper, speed = lower.copy(), upper.copy(), speed.copy()
        rows = (self.followers, self.leaders, self.ratios, self.offsets)
        for f, l, ratio, offset in zip(*rows, strict=True):  # noqa: E741
            if ratio:
                ends = np.sort((np.array([lower[f], upper[f]]) - offset) / ratio)
                lower[l], upper[l] = max(lower[l], ends[0]), min(upper[l], ends[1])
                speed[l] = min(speed[l], speed[f] / abs(ratio))
            lower[f], upper[f], speed[f] = -np.inf, np.inf, np.inf
        return lower, upper, speed


def couple(mimics: Iterable[Mimic], joints: Sequence[str]) -> Coupling | None:
    """Return the coupling of a robot's joints.

    Args:
        mimics: Which joint follows which.
        joints: Names of the robot's joints, in the order of qdot.

    Returns:
        The coupling of those that the robot has; None if nothing follows.
    """
    place = {name: j for j, name in enumerate(joints)}
    found = [m for m in mimics if m.joint in place and m.primary in place]
    if not found:
        return None
    return Coupling(
        followers=np.array([place[m.joint] for m in found]),
        leaders=np.array([place[m.primary] for m in found]),
        ratios=np.array([m.ratio for m in found]),
        offsets=np.array([m.offset for m in found]),
    )
