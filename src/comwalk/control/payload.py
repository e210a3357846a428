"""Weighing the standing robot: what the model's mass and CoM miss.

At rest the CoM is over the ZMP, whatever the model says. A load unknown to the model
shows as a distance b between the two, and as a larger weight. Left alone, the law would
amplify it: at rest k_p (p - p_d) + k_c (c_m - c_d) = 0, and p = c_m + b gives an error
of the true CoM of b k_c / (k_c - k_p), nearly 2 b with the paper's gains.
"""

from __future__ import annotations

import math

import numpy as np

from ..pattern import (
    Phase,
    Reference,
    minimum_jerk,
)

WEIGHING_TIME = 0.25
"""Time over which the standing robot is weighed [s]."""

RISE_TIME = 0.25
"""Time over which the law's feedback rises from zero after that [s]."""


class Weighing:
    """What is learnt of the robot in its first moments. Final.

    The law must not act meanwhile: fed with a CoM that follows the ZMP, it would chase
    it.
    """

    def __init__(self, weight: float, period: float) -> None:
        """Take the model at its word until the robot stands.

        Args:
            weight: Weight of the model [N].
            period: Control period [s].
        """
        self.heaviness = 1.0
        """The robot's mass over the model's [-]."""
        self._weight = weight
        self._offset = (0.0, 0.0)  # the true CoM from the model's, heading's axes [m]
        self._seen, self._most = 0, max(round(WEIGHING_TIME / period), 1)

    def offset(self, heading: float) -> tuple[float, float]:
        """Return the true CoM from the model's [m], world.

        Args:
            heading: Yaw of the trunk [rad].

        Returns:
            x and y.
        """
        c, s, (x, y) = math.cos(heading), math.sin(heading), self._offset
        return c * x - s * y, s * x + c * y

    def weigh(self, reference: Reference, load: float, lean: np.ndarray) -> float:
        """Learn from one reading, if the robot stands and has not walked yet.

        Args:
            reference: The reference of this tick.
            load: Vertical ground force [N].
            lean: ZMP minus the model's CoM [m], world, (2,).

        Returns:
            How far the law may act on what is measured [-]: 0 while weighing, then
            smoothly up to 1.
        """
        if reference.phase is not Phase.STAND or reference.step:
            return 1.0
        heaviness = load / self._weight
        if self._seen < self._most and 0.5 < heaviness < 2.0:
            self._learn(reference.heading, heaviness, *lean.tolist())
        return minimum_jerk((reference.time - WEIGHING_TIME) / RISE_TIME)[0]

    def _learn(self, heading: float, heaviness: float, x: float, y: float) -> None:
        """Add a reading to the averages."""
        self._seen += 1
        a, (b_x, b_y) = 1.0 / self._seen, self._offset
        c, s = math.cos(heading), math.sin(heading)
        self.heaviness += a * (heaviness - self.heaviness)
        self._offset = b_x + a * (c * x + s * y - b_x), b_y + a * (c * y - s * x - b_y)
