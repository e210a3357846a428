"""A rough floor: boxes of random height under a plan, flat where the robot starts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import PlanError
from ..pattern import FootstepPlan, foot_poses

CELL = 0.16
"""Side of each box [m]."""

LEAST_SHARE = 0.2
"""Height of the lowest box, as a share of that of the highest allowed."""

MAX_BOXES = 20_000
"""Largest number of boxes."""

_REACH = 0.35  # how far the boxes go on beyond a planned sole [m]
_START_MARGIN = 0.02  # how far the flat start goes on beyond the first soles [m]
_FAR = 1 << 20  # makes the index of a cell positive


@dataclass(frozen=True, eq=False)
class Terrain:
    """Boxes on the plane z = 0, on a grid along the world's axes."""

    centers: np.ndarray
    """Centres of the boxes [m], world, of shape (n, 2)."""
    heights: np.ndarray
    """Heights of their tops above the plane [m], of shape (n,)."""


def random_terrain(plan: FootstepPlan, height: float, seed: int) -> Terrain:
    """Return boxes of random height wherever a plan may put the feet.

    A cell's height depends on the seed and on its place alone: two plans walk over the
    same ground where they meet.

    Args:
        plan: Uses the footholds and the size of the soles.
        height: Height of the highest box allowed [m], above 0.
        seed: Of the random heights, 0 or above.

    Returns:
        The boxes; heights are uniform in [`LEAST_SHARE`, 1] times `height`.

    Raises:
        PlanError: If more boxes would be needed than `MAX_BOXES`.
    """
    poses = foot_poses(plan)
    cells = _cells_near(np.unique(poses.reshape(-1, 3)[:, :2], axis=0), plan.sole_size)
    centers = CELL * (cells + 0.5)
    rough = ~_touched(centers, poses[0], plan.sole_size)
    shares = [_share(seed, i, j) for i, j in cells[rough].tolist()]
    return Terrain(centers[rough], height * np.array(shares))


def _cells_near(points: np.ndarray, sole: tuple[float, float]) -> np.ndarray:
    """Return the cells around footholds, sorted, of shape (n, 2)."""
    reach = 0.5 * math.hypot(*sole) + _REACH
    k = np.arange(-math.ceil(reach / CELL), math.ceil(reach / CELL) + 1)
    disc = np.stack(np.meshgrid(k, k, indexing="ij"), axis=-1).reshape(-1, 2)
    disc = disc[CELL * np.hypot(*disc.T) <= reach]
    own = np.unique(np.floor(points / CELL).astype(int), axis=0)
    if len(own) > MAX_BOXES:
        raise _too_many(len(own))
    cells = np.unique((own[:, None] + disc).reshape(-1, 2), axis=0)
    if len(cells) > MAX_BOXES:
        raise _too_many(len(cells))
    return cells


def _too_many(count: int) -> PlanError:
    return PlanError(
        f"the plan goes over {count} boxes of rough floor, more than {MAX_BOXES}; "
        "walk fewer steps, or set simulator.terrain to 0"
    )


def _touched(
    centers: np.ndarray, feet: np.ndarray, sole: tuple[float, float]
) -> np.ndarray:
    """Return the cells under the soles at the start, of shape (n,).

    A cell counts as touched if its circumscribed circle meets the sole.
    """
    half = 0.5 * np.array(sole) + _START_MARGIN + CELL / math.sqrt(2.0)
    touched = np.zeros(len(centers), bool)
    for x, y, yaw in feet.tolist():
        away, c, s = centers - (x, y), math.cos(yaw), math.sin(yaw)
        local = np.abs(away @ np.array([[c, -s], [s, c]]))
        touched |= (local <= half).all(axis=1)
    return touched


def _share(seed: int, i: int, j: int) -> float:
    rng = np.random.default_rng((seed, i + _FAR, j + _FAR))
    return float(rng.uniform(LEAST_SHARE, 1.0))
