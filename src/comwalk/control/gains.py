"""Gains of the walking law, Eq. (31), while walking and while standing."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import check_settings, setting

Pair = tuple[float, float]


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

    zmp: Pair = setting(
        (3.0, 1.8), "ZMP gains k_p (x, y); stable if 0 < k_p < k_c", "1/s", "[0, inf)"
    )

    com: Pair = setting((6.6, 3.8), "CoM gains k_c (x, y)", "1/s", "[0, inf)")

    standing_zmp: Pair | None = setting(
        None,
        "k_p when standing; None: the walking gain, but at most 1",
        "1/s",
        "[0, inf)",
    )

    standing_com: Pair | None = setting(
        None,
        "k_c when standing; None: the walking gain, but at most 3",
        "1/s",
        "[0, inf)",
    )

    def __post_init__(self) -> None:
        """Store pairs; refuse anything but one or two gains."""
        check_settings(self)

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
            k_p (x, y) and k_c (x, y).

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
