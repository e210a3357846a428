"""Footsteps that landed elsewhere than planned, to catch a fall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..pattern import Foothold, FootstepPlan, Phase
from ..sides import Side

_ROUNDING = 1e-3  # of a saved reference, far away [m]

Landing = tuple[Side, Foothold]
"""A foot, and where it landed, world."""


def moved_steps(
    columns: Mapping[str, np.ndarray], plan: FootstepPlan
) -> list[tuple[Side, Foothold]]:
    """Return the footsteps of a run that landed elsewhere than planned.

    Args:
        columns: One row per control period: "step", "feet_ref", "phase".
        plan: What was to be walked.

    Returns:
        The feet and where they landed, world, in order; with those that no plan had.
    """
    step, feet, phase = (columns[name] for name in ("step", "feet_ref", "phase"))
    rows = np.flatnonzero(np.diff(step) > 0) + 1
    landings = []
    for row in rows.tolist():
        known = (plan.left, *plan.steps)
        yaw = known[min(int(step[row]), len(plan.steps))].yaw
        swung = 1 if phase[row - 1] == Phase.SINGLE_LEFT else 0
        x, y = feet[row, swung, :2].tolist()
        landings.append((tuple(Side)[swung], Foothold(x, y, yaw)))
    return moved_from(plan, landings)


def moved_from(plan: FootstepPlan, landings: Sequence[Landing]) -> list[Landing]:
    """Return the landings that differ from a plan, or that it has not.

    Args:
        plan: What was to be walked.
        landings: The feet and where they landed, world, in order from the first step.
    """
    moved = []
    for k, (side, place) in enumerate(landings):
        if k < len(plan.steps):
            step = plan.steps[k]
            away = np.hypot(place.x - step.x, place.y - step.y)
            if side is step.side and away < _ROUNDING:
                continue
        moved.append((side, place))
    return moved
