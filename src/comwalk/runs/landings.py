"""Footsteps that landed elsewhere than planned, to catch a fall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..pattern import Foothold, FootstepPlan
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
    step, feet = columns["step"], columns["feet_ref"]
    rows = np.flatnonzero(np.diff(step) > 0) + 1
    landings = []
    for row in rows.tolist():
        k = int(step[row]) - 1
        if k < len(plan.steps):
            side, yaw = plan.steps[k].side, plan.steps[k].yaw
        else:
            way = np.linalg.norm(feet[row, :, :2] - feet[row - 100, :, :2], axis=1)
            last = plan.steps[-1] if plan.steps else plan.left
            side, yaw = tuple(Side)[int(np.argmax(way))], last.yaw
        x, y = feet[row, tuple(Side).index(side), :2].tolist()
        landings.append((side, Foothold(x, y, yaw)))
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
