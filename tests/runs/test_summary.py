"""How a run is judged by where it ended, and on what."""

from __future__ import annotations

import pytest
from robots import robot_of

from comwalk.certificates.defaults import walk_pattern
from comwalk.control.guard import End, Watch
from comwalk.run import simulate
from comwalk.runs.summary import judged


@pytest.fixture
def run():
    """Return a walk of two steps, whose log may be changed."""
    robot = robot_of("paper")
    return simulate(robot, walk_pattern(robot, 2))


def judge(run):
    return judged(run.outcome, run.log, run.pattern, run.robot)


def test_a_walk_that_ends_where_it_should_is_completed(run):
    assert run.outcome.end is End.COMPLETED
    assert judge(run) == run.outcome
    run.log["com_true"][-1, 0] += 0.23  # the sole is 0.24 m long
    assert judge(run).ok


def test_a_walk_that_ends_beside_its_plan_is_not_completed(run):
    run.log["com_true"][-1, 0] += 0.3
    told = judge(run)
    assert told.end is End.ASTRAY
    assert not told.ok
    assert told.time == run.outcome.time
    assert "it ended 0.30 m and 0 deg beside its plan" in str(told)


def test_a_walk_that_ends_turned_is_not_completed(run):
    run.log["heading_ref"][-1] -= 0.5
    assert "29 deg beside its plan" in judge(run).cause


def test_pressure_outside_the_sole_is_no_walk(run):
    """As if the soles were a third of what they are: feet pressed beyond them."""
    wrenches = run.log["wrenches_true"]
    wrenches[:, :, 4] += 0.2 * wrenches[:, :, 2]
    told = judge(run)
    assert told.end is End.ASTRAY
    assert "outside the sole in 5 % of the time" in told.cause


def test_a_fall_stays_a_fall():
    robot = robot_of("paper")
    fallen = simulate(robot, walk_pattern(robot, 2), watch=Watch(com_error=1e-4))
    assert fallen.outcome.end is End.FELL
    assert judge(fallen) == fallen.outcome
