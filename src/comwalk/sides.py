"""The two sides of a body."""

from __future__ import annotations

from enum import StrEnum


class Side(StrEnum):
    """A foot, or all that is on its side of the body."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> Side:
        """The opposite side."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT

    @property
    def sign(self) -> float:
        """Sign of y on this side: +1 left, -1 right."""
        return 1.0 if self is Side.LEFT else -1.0
