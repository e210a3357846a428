"""The comparison with peers compares the same: robots, tasks, answers."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import comwalk as cw

SPEED = Path(__file__).parents[1] / "benchmarks" / "speed"


@pytest.fixture(scope="module")
def speed():
    """Modules of the benchmark, which is no package."""
    sys.path.insert(0, str(SPEED))
    try:
        names = (path.stem for path in SPEED.glob("*.py") if path.stem != "__main__")
        yield {name: importlib.import_module(name) for name in names}
    finally:
        sys.path.remove(str(SPEED))


@pytest.fixture(scope="module")
def problem(speed):
    return speed["problem"].make_problem("paper", "hands", 12)


def test_peers_read_the_same_robot(speed, problem, tmp_path):
    """Pinocchio finds CoM, ends and their velocities where MuJoCo has them."""
    file = tmp_path / "robot.urdf"
    file.write_text(speed["problem"].urdf_of(problem.robot.model), encoding="utf-8")
    model = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer())
    layout = speed["peers"]._Layout(problem, list(model.names)[2:])
    data = model.createData()
    for k in range(len(problem)):
        com = pin.centerOfMass(model, data, layout.q[k])
        np.testing.assert_allclose(com, problem.com[k], atol=1e-9)
        pin.framesForwardKinematics(model, data, layout.q[k])
        for i, site in enumerate(problem.sites):
            place = data.oMf[model.getFrameId(f"site{site}")]
            p, R = problem.points[k, i], problem.rotations[k, i]
            np.testing.assert_allclose(place.translation, p, atol=1e-9)
            np.testing.assert_allclose(place.rotation, R, atol=1e-9)
    assert pin.computeTotalMass(model) == pytest.approx(problem.robot.mass)


def test_targets_are_a_tick_ahead(speed, problem):
    """To first order, the pose that the wished twist leads to."""
    dt = speed["problem"].DT
    for R, p in [speed["peers"]._end_targets(problem, 5)[2]]:
        turn = pin.log3(R @ problem.rotations[5, 2].T) / dt
        moved = (p - problem.points[5, 2]) / dt
        twist = np.concatenate([moved, turn])
        np.testing.assert_allclose(twist, problem.twists[5, 2], atol=1e-9)


def test_our_candidates_do_what_is_asked(speed, problem):
    """And the whole body at once nearly, as it weighs wishes against it."""
    module, answers = speed["candidates"], {}
    for candidate in (*module.OWN, *module.PLAIN):
        tick, read = candidate.make(problem)
        v = np.array([read(k, tick(k)) for k in range(len(problem))])
        answers[candidate.name] = v
        assert problem.residual(v)[0] <= candidate.settle, candidate.name
    own = [answers[candidate.name] for candidate in module.OWN]
    np.testing.assert_allclose(own[0], own[1], atol=1e-10)
    np.testing.assert_allclose(own[0], own[2], atol=1e-10)


def test_a_wrong_answer_is_seen(speed, problem):
    """A rate off by 1e-3 in one state."""
    tick, read = speed["candidates"].OWN[0].make(problem)
    v = np.array([read(k, tick(k)) for k in range(len(problem))])
    v[7, 0] += 1e-3
    assert problem.residual(v)[0] == pytest.approx(1e-3, rel=1e-6)


def test_ratios_are_taken_within_a_round(speed):
    """The baseline's is 1, whatever the machine does."""
    calls = {"a": lambda k: sum(range(100)), "b": lambda k: sum(range(3000))}
    found = speed["measure"].interleaved(calls, "a", rounds=3, states=4)
    assert found["a"]["ratio"] == found["a"]["ratio_25"] == 1.0
    assert found["b"]["ratio"] > 1.0
    assert found["a"]["least"] <= found["a"]["median"] <= found["a"]["p99"]


def test_tables_replace_what_is_between_their_markers(speed, tmp_path):
    """And nothing else."""
    file = tmp_path / "page.md"
    file.write_text("one\n<!-- t -->\nold\n<!-- /t -->\ntwo\n", encoding="utf-8")
    text = speed["tables"].table(["a", "b"], [["1", "2"]])
    speed["tables"].replaced(file, {"t": text, "other": "nothing"})
    page = file.read_text(encoding="utf-8")
    lines = ["| a | b |", "| --- | --- |", "| 1 | 2 |"]
    body = "\n".join(lines)
    assert page == f"one\n<!-- t -->\n{body}\n<!-- /t -->\ntwo\n"


def test_plans_are_the_same_each_way(speed):
    """What is timed beside `make_pattern` makes its table, and samples its CoM."""
    plan, pendulum = cw.plan_steps(cw.Gait(), 3), cw.Pendulum()
    table = speed["pattern"]._compiled_plan(plan, pendulum.omega)(0)
    assert np.array_equal(table, cw.make_pattern(plan, pendulum).table)
    (ours, *_) = speed["pattern"].others(1)
    assert ours["name"] == "closed form, compiled"
    assert ours["away"] < 1e-12
