"""Many robots at once are each robot by itself."""

from __future__ import annotations

import numpy as np
import pytest
from robots import paper, random_configuration
from test_fast import HANDS

from comwalk.errors import ParameterError
from comwalk.robot.compiled_solver import BatchResolver, FastResolver
from comwalk.robot.kinematics import Kinematics


def test_each_is_resolved_as_by_itself():
    """Also with fewer robots than workers, and with straight legs among them."""
    robot, rng = paper(), np.random.default_rng(0)
    batch, fast = BatchResolver(robot, HANDS), FastResolver(robot, HANDS)
    kinematics = Kinematics(robot)
    for n in (1, 5, 200):
        q = np.array([random_configuration(robot, rng) for _ in range(n)])
        q[n // 2, 7:] = 0.0
        tasks = batch.tasks(n)
        for wishes in tasks:
            wishes[:] = 0.3 * rng.normal(size=wishes.shape)
        before = q.copy()
        v = batch.resolve(q, tasks, dt=0.01)
        for k in range(n):
            fast.com_velocity[:], fast.trunk_rate[:] = tasks[0][k], tasks[1][k]
            fast.twists[:], fast.rates[:] = tasks.twists[k], tasks.rates[k]
            assert v[k] == pytest.approx(fast.resolve(before[k]), abs=1e-12, rel=1e-12)
            moved = kinematics.integrate(before[k], v[k], 0.01)
            assert q[k] == pytest.approx(moved, abs=1e-12)


def test_without_time_nothing_moves():
    robot = paper()
    batch, q = BatchResolver(robot), np.tile(robot.home, (4, 1))
    tasks = batch.tasks(4)
    tasks.com_velocity[:] = 0.1
    assert batch.resolve(q, tasks).any()
    assert np.array_equal(q, np.tile(robot.home, (4, 1)))


def test_shapes_must_fit():
    batch = BatchResolver(paper())
    with pytest.raises(ParameterError, match="q must be of shape"):
        batch.resolve(np.tile(paper().home, (3, 1)), batch.tasks(2))
