"""A robot that is pushed steps elsewhere than planned, and says so."""

from __future__ import annotations

import dataclasses
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from robots import robot_of

from comwalk.certificates.defaults import walk_pattern
from comwalk.certificates.reach import adaptive, agility_of
from comwalk.config import DanceConfig, WalkConfig
from comwalk.control import End, Push, SimulatorSettings, WalkingController, walk
from comwalk.embedding import (
    SOLVED,
    accelerate_links,
    flat_at,
    resolve,
    wanted_at,
)
from comwalk.pattern import OnlinePattern, Phase, make_pattern
from comwalk.robot.dynamics import InverseDynamics
from comwalk.robot.kinematics import Kinematics
from comwalk.run import Run, prepare
from comwalk.runs import load_run, moved_steps
from comwalk.setup import build_dance, build_walk
from comwalk.sides import Side
from comwalk.walking import MujocoLink, take_log
from comwalk.walking.records import RULES
from comwalk.walking.torque_tick import _give_way, _spare_a_foot, _zmp_of
from comwalk.walking.torques import hold_in_soles

FLAWS = {"noise": 1.0, "latency": 0.002, "command_delay": 0.002}


def swing_of(pattern) -> tuple[float, float]:
    """Return start and duration of the second swing of the right foot [s]."""
    spans = [s for s in pattern.phases if s.phase is Phase.SINGLE_LEFT]
    return spans[1].start, spans[1].duration


@cache
def pushed(
    speed: float, side: float = 0.0, *, adapt: bool = True, share: float = 0.35
) -> Run:
    """Return a walk of the paper's robot by torque, pushed on the trunk [m/s]."""
    setup = build_walk(WalkConfig(robot="paper", steps=8, pd=(100.0, 40.0, 2.0)))
    assert setup.robot is not None
    start, swing = swing_of(setup.pattern)
    force = 10.0 * setup.robot.mass * np.array([speed, side, 0.0])
    push = Push(start=start + share * swing, force=tuple(force.tolist()))
    physics = SimulatorSettings(pushes=(push,), **FLAWS)
    return dataclasses.replace(setup, physics=physics, adapt=adapt).run()


PUSHES = [(0.5, 0.0), (-0.6, 0.0), (0.0, -0.45), (0.0, 0.27)]


@pytest.mark.parametrize("push", PUSHES)
def test_a_push_is_caught_by_other_steps(push):
    """On the planned footholds it falls; with moved ones it walks to the end."""
    assert not pushed(*push, adapt=False).outcome.ok
    run = pushed(*push)
    assert run.outcome.ok, run.outcome
    summary = run.summary()
    assert summary["steps_moved"] >= 1
    assert summary["steps_completed"] == 8


def test_a_small_push_moves_no_step():
    """Ankles catch what they can."""
    run = pushed(0.1)
    assert run.outcome.ok
    assert run.summary()["steps_moved"] == 0


def test_where_steps_were_moved_is_seen(tmp_path):
    """A saved run tells, and its page draws the soles beside the planned ones."""
    run = pushed(0.0, -0.45)
    moved = moved_steps(run.log.columns, run.pattern.plan)
    side, place = moved[0]
    assert side is Side.RIGHT
    assert place.y < -0.15
    data = load_run(run.save(tmp_path / "run"))
    assert data.plan is not None
    for (foot, there), (known, here) in zip(
        moved_steps(data.columns, data.plan), moved, strict=True
    ):
        assert foot is known
        assert (there.x, there.y) == pytest.approx((here.x, here.y), abs=1e-6)
    page = tmp_path / "page.html"
    run.view().save(page)
    assert page.read_text(encoding="utf-8").count("cw-sole-moved") == len(moved) + 1


def test_only_robots_with_torques_move_steps():
    """By position the pattern stays what it is."""
    stiff, soft = robot_of("paper"), robot_of("paper", actuation="pd")
    pattern = walk_pattern(soft, 2)
    assert adaptive(stiff, pattern) is pattern
    moving = adaptive(soft, pattern)
    assert isinstance(moving, OnlinePattern)
    assert len(moving.adaptation) == 1


@pytest.mark.parametrize("name", ["paper", "talos", "g1"])
def test_legs_reach_as_far_as_they_are_taken_to(name):
    """A stretched leg is as long as the distance of hip and ankle at its longest."""
    robot = robot_of(name, actuation="pd")
    agility = agility_of(robot)
    kinematics, longest = Kinematics(robot), 0.0
    leg = next(limb.joints for limb in robot.limbs if limb.name == "left_leg")
    rng = np.random.default_rng(0)
    for _ in range(300):
        q = robot.home.copy()
        for j in leg:
            q[7 + j] = rng.uniform(robot.lower[j], robot.upper[j])
        kinematics.update(q)
        anchors = kinematics.data.xanchor[np.array(leg) + 1]
        longest = max(longest, float(np.linalg.norm(anchors[-1] - anchors[0])))
    assert agility.leg <= longest * 1.01
    assert agility.leg > 0.9 * longest
    assert agility.tall < agility.leg
    assert agility.beside < agility.aside


# ---- What is measured ------------------------------------------------------------


class Watching(MujocoLink):
    """Keeps the estimated velocities."""

    def write(self, k, sensors, seconds):
        super().write(k, sensors, seconds)
        state = self._ticker.body.arrays.state[0]
        names = ("com_velocity", "seen_velocity", "swift_velocity")
        self.seen.append([state[name][:2].copy() for name in names])


@pytest.mark.parametrize("flaws", [{}, {**FLAWS, "joint_friction": 0.5}])
def test_the_velocity_of_the_com_is_known_in_a_push(flaws):
    """By accelerometer and joints it is within 2 cm/s at once, noise and all."""
    robot = robot_of("paper", actuation="pd")
    pattern = walk_pattern(robot, 4)
    start, swing = swing_of(pattern)
    force = (2.0 * robot.mass, 0.0, 0.0)
    push = Push(start=start + 0.3 * swing, force=force, duration=0.1)
    physics = SimulatorSettings(pushes=(push,), **flaws)
    parts = prepare(robot, pattern, physics=physics, force=True)
    control = parts.control
    law = WalkingController(control.gains, control.settings, control.period)
    take_log(parts.log, parts.plant, pattern.duration)
    links = []

    def link(ticker):
        links.append(Watching(parts.plant, ticker, parts.log))
        links[0].seen = []
        return links[0]

    assert walk(pattern, law, parts.body, parts.plant, link=link).ok
    t, com = parts.log["t"], parts.log["com_true"][:, :2]
    true = np.gradient(com, t, axis=0)
    seen = np.array(links[0].seen)[: len(t)]
    rows = (t > start) & (t < start + swing)
    error = np.abs(seen - true[:, None])[rows].max(axis=(0, 2))
    assert error[2] < 0.02
    assert error[0] > 2.0 * error[2]  # what the law's servo follows is later


# ---- What soles and legs bear ----------------------------------------------------


@cache
def asked(name: str) -> SimpleNamespace:
    """Return a robot on one foot, before accelerations are resolved."""
    robot = robot_of(name, actuation="pd")
    pattern = walk_pattern(robot, 2)
    parts = prepare(robot, pattern, force=True)
    control = parts.control
    law = WalkingController(control.gains, control.settings, control.period)
    law.reset(pattern.at(0.0).com, pattern.at(0.0).zmp)
    ticker = parts.body.ticker(pattern, law)
    sensors = parts.plant.start(parts.body.command)
    spans = [s for s in pattern.phases if s.phase is Phase.SINGLE_LEFT]
    end = spans[0].start + 0.5 * spans[0].duration
    for k in range(round(end / control.period)):
        assert ticker.step(k * control.period, sensors) is None
        parts.plant.write(ticker.command)
        sensors = parts.plant.read()
    arrays = ticker.arrays
    resolved = arrays.acceleration[: len(arrays.v)]
    accelerate_links(flat_at(ticker.handle), arrays.bodies, -resolved)
    return SimpleNamespace(robot=robot, ticker=ticker, arrays=ticker.arrays)


@pytest.mark.parametrize("name", ["paper", "g1", "talos"])
def test_the_zmp_asked_for_is_that_of_inverse_dynamics(name):
    """MuJoCo's, with the CoM where the robot was weighed to have it."""
    seen = asked(name)
    arrays, handle = seen.arrays, seen.ticker.handle
    rng = np.random.default_rng(1)
    motions = InverseDynamics(seen.robot)
    for _ in range(5):
        a = arrays.acceleration[: len(arrays.v)]
        a[:] = rng.normal(scale=2.0, size=len(a))
        state = arrays.state[0]
        c, s = (f(arrays.reference[0]["heading"]) for f in (np.cos, np.sin))
        lean = np.array([[c, -s], [s, c]]) @ state["lean"]
        load = motions.load(arrays.q, arrays.v, a, 1.0)
        np.testing.assert_allclose(_zmp_of(handle, a), load.zmp + lean, atol=1e-3)


@pytest.mark.parametrize("name", ["paper", "g1"])
@pytest.mark.parametrize("way", [(0.8, 0.0), (-0.8, 0.3), (0.0, 0.6)])
def test_the_trunk_gives_way_until_the_soles_bear_it(name, way):
    """The ZMP is brought to the sole's edge, and the CoM is accelerated as asked."""
    seen = asked(name)
    arrays, handle = seen.arrays, seen.ticker.handle
    n = len(arrays.v)
    a, flat, wanted = arrays.acceleration[:n], flat_at(handle), wanted_at(handle)[0]
    before = wanted.copy()
    wanted["com"][:2] += 9.0 * np.array(way)
    com = wanted["com"].copy()
    assert resolve(flat, wanted, a) == SOLVED
    rules, reference = arrays.rules[0], arrays.reference[0]
    x, y = _zmp_of(handle, a)
    p_x, p_y, *_ = hold_in_soles(flat, rules, reference, x, y)
    outside = np.hypot(p_x - x, p_y - y)
    assert outside > 0.01
    _give_way(handle, a)
    u, v = _zmp_of(handle, a)
    q_x, q_y, *_ = hold_in_soles(flat, rules, reference, u, v)
    assert np.hypot(q_x - u, q_y - v) < 0.7 * outside
    np.testing.assert_allclose(wanted["com"], com)
    for name_ in before.dtype.names:
        wanted[name_] = before[name_]


def test_a_foot_out_of_reach_is_lost_not_the_com():
    """What the swing leg cannot do is given up by its foot, within its limits."""
    seen = asked("paper")
    arrays, handle = seen.arrays, seen.ticker.handle
    a = arrays.acceleration[: len(arrays.v)]
    flat, wanted = flat_at(handle), wanted_at(handle)[0]
    before = flat.limbs["twist"].copy()
    flat.limbs["twist"][1, :3] += (0.0, 0.0, 3000.0)
    assert resolve(flat, wanted, a) == SOLVED
    free = a.copy()
    assert _spare_a_foot(handle, a, True)
    assert arrays.state["spared"][0] == 1
    assert arrays.state["limited"][0] > 0
    assert np.abs(a).max() < np.abs(free).max()
    flat.limbs["twist"][:] = before


def test_reach_is_known_to_the_rules():
    """Both legs have a hip, an ankle over the sole and a length."""
    rules = asked("paper").arrays.rules[0]
    assert "reach" in (RULES.names or ())
    assert rules["reach"] == pytest.approx([0.563, 0.563], abs=0.01)
    assert rules["ankle"][:, 2] == pytest.approx([0.08, 0.08], abs=1e-9)


def test_a_walk_that_was_pushed_at_its_end_stands_before_it_ends():
    """Steps that bring the feet together take time that no plan had."""
    setup = build_walk(WalkConfig(robot="paper", steps=3, pd=(100.0, 40.0, 2.0)))
    assert setup.robot is not None
    last = [s for s in setup.pattern.phases if s.phase is Phase.SINGLE_RIGHT][-1]
    force = (0.0, 4.0 * setup.robot.mass, 0.0)
    push = Push(start=last.start + 0.2, force=force, duration=0.1)
    physics = SimulatorSettings(pushes=(push,))
    run = dataclasses.replace(setup, physics=physics).run()
    assert run.outcome.ok, run.outcome
    assert run.summary()["steps_moved"] > 0
    assert run.log["phase"][-1] == Phase.STAND
    feet = run.log["feet_ref"][-1]
    assert np.abs(feet[0] - feet[1])[:2] == pytest.approx([0.0, 0.18], abs=1e-3)
    assert run.outcome.time > setup.pattern.duration - 1e-9


@pytest.mark.parametrize("angle", [0.0, 2.4, 3.5])
def test_a_robot_that_stands_steps_out_and_stands_again(angle):
    """A push in any direction that ankles cannot hold."""
    setup = build_walk(WalkConfig(robot="paper", steps=1, pd=(100.0, 40.0, 2.0)))
    assert setup.robot is not None
    plan = dataclasses.replace(setup.pattern.plan, steps=(), closing=0, stand_time=4.0)
    pattern = make_pattern(plan, setup.pattern.pendulum)
    way = 5.0 * setup.robot.mass * np.array([np.cos(angle), np.sin(angle), 0.0])
    push = Push(start=2.0, force=tuple(way.tolist()), duration=0.1)
    physics = SimulatorSettings(pushes=(push,))
    standing = dataclasses.replace(setup, pattern=pattern, physics=physics)
    assert dataclasses.replace(standing, adapt=False).run().outcome.end is End.FELL
    run = standing.run()
    assert run.outcome.end is not End.FELL, run.outcome
    assert run.summary()["steps_moved"] > 0
    assert run.log["phase"][-1] == Phase.STAND
    feet = run.log["feet_ref"][-1]
    assert np.hypot(*(feet[0] - feet[1])[:2]) == pytest.approx(0.18, abs=0.02)


def test_a_robot_that_nobody_pushes_stands():
    """With noise and a dance, no step is made."""
    config = DanceConfig(robot="paper", pd=(100.0, 40.0, 2.0), duration=6.0)
    setup = build_dance(config)
    run = dataclasses.replace(setup, physics=SimulatorSettings(**FLAWS)).run()
    assert run.outcome.ok
    assert run.summary()["steps_moved"] == 0
