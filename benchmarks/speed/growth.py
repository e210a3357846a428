"""How times grow: with the joints of a robot; and the closed loop.

The closed loop is what `comwalk walk` runs, physics included, at 500 Hz.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
from candidates import compiled, jacobians_alone
from measure import interleaved
from problem import make_problem

import comwalk as cw
from comwalk.model_files import read_model
from comwalk.monte_carlo import monte_carlo

FINGERS = (0, 10, 30, 90)
"""Joints that a robot is given more."""
ROBOTS_AT_ONCE = (16, 256, 4096, 65536)
"""Robots of the simplified model, each with its own disturbance."""
TICKS = 20_000_000
"""About how many ticks they make in all."""


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
    """Return the real-time factor of walks, and that of their physics alone."""
    rows = []
    for name in names:
        robot = cw.load_robot(name)
        pattern = cw.walk_pattern(robot, steps)
        for _ in range(2):  # the first compiles
            run = cw.simulate(robot, pattern)
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


def robots_at_once() -> list[dict[str, Any]]:
    """Return ticks of the simplified model per second, on all cores, by robots."""
    rows = []
    for n in ROBOTS_AT_ONCE:
        ticks, best = max(100, min(10_000, TICKS // n)), math.inf
        bounds = {"a": 0.05, "b": 0.5, "duration": 0.002 * ticks}
        for _ in range(4):  # the first compiles
            begin = time.perf_counter()
            monte_carlo(cw.Pendulum(), 3.0, 6.6, robots=n, **bounds)
            best = min(best, time.perf_counter() - begin)
        rows.append({"robots": n, "rate": n * ticks / best})
    return rows
