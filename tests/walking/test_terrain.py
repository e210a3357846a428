"""The rough floor: where its boxes are, how high, and that they depend on the seed."""

from __future__ import annotations

import numpy as np
import pytest

from comwalk.errors import PlanError
from comwalk.pattern.footsteps import Gait, foot_poses
from comwalk.pattern.plans import plan_steps
from comwalk.walking.terrain import CELL, LEAST_SHARE, random_terrain

WALK = plan_steps(Gait(), 20)
TURN = plan_steps(Gait(half_step=0.0, turn=0.3), 20)


def corners_of(poses, size):
    """Return the corners of soles, (n, 4, 2)."""
    half = 0.5 * np.array(size) * [[1, 1], [-1, 1], [-1, -1], [1, -1]]
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    R = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=1)
    return poses[:, None, :2] + half @ R.transpose(0, 2, 1)


def cells_of(terrain):
    """Return the cells that have a box, by index."""
    return {tuple(cell) for cell in np.floor(terrain.centers / CELL).astype(int)}


def test_heights_are_uniform_within_their_bounds():
    heights = np.concatenate(
        [random_terrain(WALK, 0.01, seed).heights for seed in range(10)]
    )
    assert heights.min() >= LEAST_SHARE * 0.01
    assert heights.max() <= 0.01
    low, middle, high = np.quantile(heights, (0.05, 0.5, 0.95)) / 0.01
    assert (low, middle, high) == pytest.approx((0.24, 0.6, 0.96), abs=0.02)


def test_heights_come_from_the_seed():
    one, same, other = (random_terrain(WALK, 0.01, seed) for seed in (3, 3, 4))
    assert np.array_equal(one.heights, same.heights)
    assert np.array_equal(one.centers, other.centers)
    assert np.abs(one.heights - other.heights).max() > 1e-3


def test_boxes_are_on_one_grid_without_overlap():
    terrain = random_terrain(TURN, 0.01, 0)
    steps = terrain.centers / CELL - 0.5
    assert np.abs(steps - steps.round()).max() < 1e-9
    assert len(cells_of(terrain)) == len(terrain.heights) == len(terrain.centers)


def test_two_plans_walk_over_the_same_ground():
    """A cell's height depends on seed and place alone."""
    grounds = []
    for plan in (WALK, TURN):
        terrain = random_terrain(plan, 0.01, 5)
        cells = np.floor(terrain.centers / CELL).astype(int).tolist()
        heights = terrain.heights.tolist()
        grounds.append({tuple(c): h for c, h in zip(cells, heights, strict=True)})
    shared = grounds[0].keys() & grounds[1].keys()
    assert len(shared) > 10
    assert all(grounds[0][cell] == grounds[1][cell] for cell in shared)


@pytest.mark.parametrize("plan", [WALK, TURN], ids=["straight", "turn"])
def test_soles_start_on_the_plane_and_land_on_boxes(plan):
    """Even 0.3 m beside its place, a sole lands on boxes or on the flat start."""
    terrain, poses = random_terrain(plan, 0.01, 0), foot_poses(plan)
    boxes = cells_of(terrain)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(4), size=200)
    inside = (weights @ corners_of(poses[0], plan.sole_size)).reshape(-1, 2)
    start = {tuple(cell) for cell in np.floor(inside / CELL).astype(int)}
    assert not start & boxes
    angles = rng.uniform(-np.pi, np.pi, (len(poses), 1))
    away = 0.3 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    for foot in range(2):
        corners = corners_of(poses[:, foot], plan.sole_size) + away
        landed = np.floor(corners.reshape(-1, 2) / CELL).astype(int)
        around = corners_of(poses[0], np.array(plan.sole_size) + 4 * CELL)
        low, high = around.min(axis=(0, 1)), around.max(axis=(0, 1))
        for cell, point in zip(landed, corners.reshape(-1, 2), strict=True):
            assert tuple(cell) in boxes or ((low < point) & (point < high)).all()


def test_endless_walks_are_refused():
    with pytest.raises(PlanError, match="walk fewer steps"):
        random_terrain(plan_steps(Gait(), 20_000), 0.01, 0)
