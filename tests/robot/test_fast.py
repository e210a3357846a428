"""Compiled kinematics and resolution are the readable ones, to rounding."""

from __future__ import annotations

import numpy as np
import pytest
from models import write
from robots import jvrc, paper, random_configuration, robot_of

from comwalk.embedding.kinematics import SINGULAR, SOLVED, resolve_at
from comwalk.embedding.solver import Resolver
from comwalk.embedding.task import ALL_ROWS, CartesianMotion, Damping, motion_of
from comwalk.handles import handle_of
from comwalk.robot.compiled_robot import flatten
from comwalk.robot.compiled_solver import FastResolver, can_resolve
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders.sources import ROBOTS
from comwalk.robot.model import load_robot

LEGS = {"left_leg": ALL_ROWS, "right_leg": ALL_ROWS}
HANDS = LEGS | {"left_arm": ALL_ROWS, "right_arm": ALL_ROWS}
SOME_ROWS = LEGS | {"left_arm": (0, 1, 2), "right_arm": (0, 2, 3, 5)}


def any_task(fast: FastResolver, rng: np.random.Generator) -> None:
    """Wish for something at random."""
    fast.com_velocity[:], fast.trunk_rate[:] = 0.3 * rng.normal(size=(2, 3))
    fast.twists[:] = 0.3 * rng.normal(size=fast.twists.shape)
    fast.rates[:] = rng.normal(size=len(fast.rates))


@pytest.mark.parametrize("ends", [LEGS, HANDS, SOME_ROWS], ids=["legs", "arms", "rows"])
@pytest.mark.parametrize("name", [n for n in ROBOTS if n != "mjlab_g1"])
def test_resolution_is_the_readable_one(name, ends):
    """At random postures, and with arms that are damped near singular ones."""
    robot = robot_of(name)
    rng = np.random.default_rng(1)
    fast, kinematics = FastResolver(robot, ends), Kinematics(robot)
    resolver, compiled = Resolver(robot.limbs, robot.damping), 0
    for k in range(12):
        q = random_configuration(robot, rng)
        if k % 3 == 0:
            q[7:] = robot.home[7:]
        any_task(fast, rng)
        expected = resolver.resolve(kinematics.posture(q), fast.task).velocity
        v = np.zeros_like(expected)
        if resolve_at(fast.handle, q, v) == SOLVED:
            compiled += 1
            assert np.abs(v - expected).max() < 1e-10 * max(1.0, np.abs(v).max())
    assert compiled >= 10 or not can_resolve(robot, fast._flat)


def test_followers_move_with_their_leaders(tmp_path):
    """What wrists that follow do to the CoM; the task knows of their leaders alone."""
    path = write(tmp_path, mimic={"wrist_z": ("elbow_y", -0.7, 0.1)})
    robot, rng = load_robot(path), np.random.default_rng(6)
    coupling = robot.coupling
    assert coupling is not None
    fast = FastResolver(robot)
    for _ in range(5):
        q = random_configuration(robot, rng)
        coupling.follow(q[7:])
        any_task(fast, rng)
        expected = Resolver(robot.limbs, robot.damping).resolve(
            Kinematics(robot).posture(q), fast.task
        )
        coupling.unfold(expected.velocity)
        v = np.zeros_like(expected.velocity)
        assert resolve_at(fast.handle, q, v) == SOLVED
        assert v == pytest.approx(expected.velocity, abs=1e-10, rel=1e-10)


@pytest.mark.parametrize("bend", [0.0, 1e-6, 1e-3, 0.03])
def test_straight_legs_are_handed_over(bend):
    """Where the readable resolution gives way, the compiled one says so."""
    robot, rng = paper(), np.random.default_rng(2)
    fast, q = FastResolver(robot), robot.home.copy()
    for j, name in enumerate(robot.joints):
        if "knee" in name:
            q[7 + j] = bend
    any_task(fast, rng)
    v = np.zeros(6 + len(robot.joints))
    assert resolve_at(fast.handle, q, v) == SINGULAR
    expected = Resolver(robot.limbs, robot.damping).resolve(
        Kinematics(robot).posture(q), fast.task
    )
    assert expected.damped
    assert np.array_equal(fast.resolve(q), expected.velocity)


@pytest.mark.parametrize("bend", [0.0, 1e-8, 1e-4, 0.01, 0.05, 0.1, 0.2])
def test_straight_arms_are_damped_alike(bend):
    """From exactly singular arms to those that no longer are."""
    robot, rng = paper(), np.random.default_rng(3)
    fast, q = FastResolver(robot, HANDS), robot.home.copy()
    for j, name in enumerate(robot.joints):
        if "elbow" in name or "wrist" in name:
            q[7 + j] = bend
    for _ in range(5):
        any_task(fast, rng)
        expected = Resolver(robot.limbs, robot.damping).resolve(
            Kinematics(robot).posture(q), fast.task
        )
        v = np.zeros_like(expected.velocity)
        assert resolve_at(fast.handle, q, v) == SOLVED
        assert v == pytest.approx(expected.velocity, abs=1e-10, rel=1e-10)


def test_what_is_not_solved_here_is_the_readable_ones():
    """An arm on a torso that is solved for too."""
    robot, rng = paper(), np.random.default_rng(4)
    ends = LEGS | {"left_arm": ALL_ROWS, "torso": (3, 5)}
    if robot.ends[2] < 0:
        pytest.skip("the torso has no end")
    fast = FastResolver(robot, ends)
    assert not can_resolve(robot, fast._flat)
    any_task(fast, rng)
    q = random_configuration(robot, rng)
    expected = Resolver(robot.limbs, robot.damping).resolve(
        Kinematics(robot).posture(q), fast.task
    )
    assert np.array_equal(fast.resolve(q), expected.velocity)


def test_the_task_is_what_the_arrays_say():
    """Residuals of what is resolved, by the readable kinematics alone."""
    robot, rng = jvrc(), np.random.default_rng(5)
    fast = FastResolver(robot, HANDS, Damping(threshold=1e-4))
    any_task(fast, rng)
    q = random_configuration(robot, rng)
    v, posture, task = fast.resolve(q), Kinematics(robot).posture(q), fast.task
    assert posture.com_jacobian @ v == pytest.approx(fast.com_velocity, abs=1e-10)
    assert v[3:6] == pytest.approx(fast.trunk_rate)
    for i, limb in enumerate(robot.limbs):
        if limb.name in HANDS:
            motion = motion_of(task, limb.name)
            assert isinstance(motion, CartesianMotion)
            twist = posture.end_jacobian(i) @ v
            assert twist == pytest.approx(motion.twist, abs=1e-9)


def test_a_handle_is_addresses_and_lengths():
    arrays = tuple(flatten(paper()))
    handle = handle_of(*arrays)
    assert handle.tolist()[::2] == [array.ctypes.data for array in arrays]
    assert handle.tolist()[1::2] == [len(array) for array in arrays]
