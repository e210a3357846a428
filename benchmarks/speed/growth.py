"""How times grow: with the joints of a robot; and the closed loop.

The closed loop is what `comwalk walk` runs, physics included, at 500 Hz.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from candidates import compiled, jacobians_alone
from measure import interleaved
from problem import Problem, make_problem

import comwalk as cw
from comwalk.certificates import monte_carlo
from comwalk.robot import BatchResolver
from comwalk.robot.loaders import read_model

FINGERS = (0, 10, 30, 90)
"""Joints that a robot is given more."""
ROBOTS_AT_ONCE = (16, 256, 4096, 65536)
"""Robots, each with its own state and disturbance."""
TICKS = 20_000_000
"""About how many ticks of the simplified model they make in all."""


def with_joints(rounds: int) -> list[dict[str, Any]]:
    """Return the time of a resolution for a robot with more and more fingers."""
    rows, calls = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for more in FINGERS:
            path = with_fingers(read_model("paper").spec, more, Path(folder))
            problem = make_problem(str(path), "arms", 64)
            rows.append({"joints": len(problem.robot.joints)})
            calls[str(more)], _ = compiled(problem)
            calls[f"C {more}"], _ = jacobians_alone(problem)
    found = interleaved(calls, str(FINGERS[0]), rounds=rounds, states=64)
    for more, row in zip(FINGERS, rows, strict=True):
        row["us"] = found[str(more)]["median"]
        row["C_us"] = found[f"C {more}"]["median"]
    return rows


def with_fingers(spec: mujoco.MjSpec, count: int, folder: Path) -> Path:
    """Write a robot with some more joints below its last body."""
    body, path = spec.bodies[-1], folder / f"{count}.xml"
    for k in range(count):
        body = body.add_body(name=f"finger{k}", pos=[0.0, 0.0, -0.005])
        body.add_geom(size=[0.01] * 3, mass=0.01, contype=0, conaffinity=0)
        body.add_joint(name=f"finger{k}", axis=[0.0, 1.0, 0.0], range=[-1.0, 1.0])
        servo = spec.add_actuator(name=f"finger{k}", target=f"finger{k}")
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=10.0, kv=0.1)
    for key in spec.keys:
        key.qpos = [*key.qpos, *[0.0] * count]
    spec.compile()
    path.write_text(spec.to_xml(), encoding="utf-8")
    return path


def closed_loop(names: tuple[str, ...], steps: int) -> list[dict[str, Any]]:
    """Return the real-time factor of the fastest of some walks, and of physics."""
    rows = []
    for name in names:
        robot = cw.load_robot(name)
        pattern = cw.walk_pattern(robot, steps)
        runs = [cw.simulate(robot, pattern) for _ in range(4)]  # the first compiles
        run = min(runs, key=lambda run: run.seconds)
        summary = run.summary()
        step = _physics_step(run.scene)
        row = {"robot": name, "outcome": run.outcome.ok}
        row["real_time_factor"] = summary["real_time_factor"]
        row["tick_us_p50"] = summary["tick_us_p50"]
        row["tick_us_p99"] = summary["tick_us_p99"]
        row["physics_us"] = 1e6 * step
        row["physics_alone"] = run.scene.opt.timestep / step
        rows.append(row)
    return rows


def _physics_step(model: mujoco.MjModel) -> float:
    """Return the median time of a step of the standing robot [s]."""
    data, times = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0) if model.nkey else None
    for _ in range(200):
        begin = time.perf_counter()
        mujoco.mj_step(model, data, 10)
        times.append((time.perf_counter() - begin) / 10)
    return statistics.median(times)


def robots_at_once(name: str) -> list[dict[str, Any]]:
    """Return ticks per second on all cores, by the number of robots.

    Args:
        name: The robot whose whole body is resolved, `arms`.
    """
    problem = make_problem(name, "arms")
    rows = []
    for n in ROBOTS_AT_ONCE:
        ticks = max(100, min(10_000, TICKS // n))
        bounds = {"a": 0.05, "b": 0.5, "duration": 0.002 * ticks}
        pendulums = _least_time(
            lambda n=n, bounds=bounds: monte_carlo(
                cw.Pendulum(), 3.0, 6.6, robots=n, **bounds
            )
        )
        bodies = _least_time(_batch(problem, n))
        row = {"robots": n, "pendulums": n * ticks / pendulums}
        rows.append(row | {"whole_bodies": n / bodies})
    return rows


def _batch(problem: Problem, n: int) -> Callable[[], Any]:
    """Return what resolves the tasks of n robots at once."""
    batch = BatchResolver(problem.robot, dict.fromkeys(problem.ends, range(6)))
    tasks, ks = batch.tasks(n), np.arange(n) % len(problem)
    tasks.com_velocity[:] = problem.com_velocity[ks]
    tasks.trunk_rate[:] = problem.trunk_rate[ks]
    index = [limb.name for limb in problem.robot.limbs]
    ends = [index.index(name) for name in problem.ends]
    tasks.twists[:, ends] = problem.twists[ks]
    tasks.rates[:] = problem.rates[ks]
    q = np.ascontiguousarray(problem.q[ks])
    return lambda: batch.resolve(q, tasks)


def _least_time(call: Callable[[], Any]) -> float:
    """Return the least time of some calls [s]; the first compiles."""
    best = math.inf
    for _ in range(6):
        begin = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begin)
    return best
