"""Gains of the walking law, Eq. (31), while walking and while standing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError, checked_number

Pair = tuple[float, float]


def _pair(name: str, value: object) -> Pair:
    """Return one number or two as a pair (x, y) of gains."""
    several = isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, str)
    values = list(value) if several and np.ndim(value) == 1 else [value]  # type: ignore[call-overload]
    if len(values) not in (1, 2):
        raise ParameterError(
            f"{name} must be one number or two (x, y) in 1/s, got {len(values)}"
        )
    numbers = [checked_number(name, v, unit="1/s", low=0.0) for v in values]
    return numbers[0], numbers[-1]


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of the walking control law, Eq. (31), in the frame of the heading.

    x is the walking direction, y is to the left of it. A single number serves both.

    Raises:
        ParameterError: If a gain is negative, or not one or two finite numbers.

    Example:
        >>> Gains(zmp=(3.0, 1.8), com=(6.6, 3.8)).walking
        ((3.0, 1.8), (6.6, 3.8))
        >>> Gains(zmp=(0.0, 0.0), com=(0.0, 0.0)).is_open_loop
        True
    """

    zmp: Pair = (3.0, 1.8)
    """ZMP gains k_p (x, y) [1/s], 0 or above; stable if 0 < k_p < k_c."""

    com: Pair = (6.6, 3.8)
    """CoM gains k_c (x, y) [1/s], 0 or above."""

    standing_zmp: Pair | None = None
    """k_p when standing [1/s]; None: the walking gain, but at most 1."""

    standing_com: Pair | None = None
    """k_c when standing [1/s]; None: the walking gain, but at most 3."""

    def __post_init__(self) -> None:
        """Store pairs; refuse what is not one or two gains."""
        for name in ("zmp", "com", "standing_zmp", "standing_com"):
            value = getattr(self, name)
            if value is not None or not name.startswith("standing"):
                object.__setattr__(self, name, _pair(f"gains.{name}", value))

    @property
    def walking(self) -> tuple[Pair, Pair]:
        """k_p (x, y) and k_c (x, y) while walking [1/s]."""
        return self.zmp, self.com

    @property
    def standing(self) -> tuple[Pair, Pair]:
        """k_p (x, y) and k_c (x, y) while standing [1/s].

        On two feet nothing has to be caught within a step, while foot-force noise and
        the stiff closed chain of the legs limit k_p: robots that run this law stand
        with k_p of 0.1 to 1 and k_c of 3 to 6. Among those, 1 and 3 held the ZMP of a
        dance best. The defaults never exceed the walking gains, so that they are stable
        (and open loop) whenever those are.
        """
        (p_x, p_y), (c_x, c_y) = self.zmp, self.com
        k_p = self.standing_zmp or (min(p_x, 1.0), min(p_y, 1.0))
        k_c = self.standing_com or (min(c_x, 3.0), min(c_y, 3.0))
        return k_p, k_c

    @property
    def is_open_loop(self) -> bool:
        """Whether all gains are zero: the reference is played without feedback."""
        pairs = (*self.walking, *self.standing)
        return not any(k for pair in pairs for k in pair)

    def blend(self, walking: float) -> tuple[Pair, Pair]:
        """Return the gains between standing and walking.

        Both ends being stable in the ideal model (0 < k_p < k_c), so is every blend.

        Args:
            walking: How much of walking [1]: 0 standing, 1 walking; clipped to [0, 1].
                `Reference.walking` changes smoothly, and so do the gains.

        Returns:
            k_p (x, y) and k_c (x, y) [1/s].

        Example:
            >>> Gains(standing_zmp=(1.0, 1.0)).blend(0.5)[0]
            (2.0, 1.4)
        """
        if walking >= 1.0:
            return self.walking
        if walking <= 0.0:
            return self.standing
        s, (p_0, c_0), (p_1, c_1) = walking, self.standing, self.walking
        k_p = p_0[0] + s * (p_1[0] - p_0[0]), p_0[1] + s * (p_1[1] - p_0[1])
        k_c = c_0[0] + s * (c_1[0] - c_0[0]), c_0[1] + s * (c_1[1] - c_0[1])
        return k_p, k_c


PAPER_GAINS = Gains()
"""The gains of Section VI; the paper does not tell what it stands with."""
