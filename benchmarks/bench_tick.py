"""Time of one control tick wherever it runs, beside a physics step in the same run.

    python benchmarks/bench_tick.py [ROBOT ...] [--steps 6] [--save FILE.json]
                                    [--compare FILE.json]

The tick measures, guards, applies the law and resolves. It is timed on MuJoCo's memory
(plain), with noisy and with late sensors, with `Sensors` and `Command` objects as a
driver of one's own passes them, and under an `OnlinePattern`; the last row is how many
times real time a whole walk takes, and what physics alone would.

The physics step is the yardstick: it is C code that this project did not write, so the
ratio says more than microseconds do on a machine that others use too.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import mujoco
import numpy as np

import comwalk as cw
from comwalk.certificates import default_control
from comwalk.control import Sensors, Tick, WalkingController, walk
from comwalk.pattern import OnlinePattern
from comwalk.run import prepare
from comwalk.walking import WholeBodyTicker


def fused(robot: cw.Robot, steps: int, **physics: float) -> np.ndarray:
    """Return the times of the ticks of a simulated walk [us]."""
    settings = cw.SimulatorSettings(**physics)
    pattern = cw.walk_pattern(robot, steps)
    run = cw.simulate(robot, pattern, physics=settings, force=True)
    return 1e6 * run.log["compute_s"]


def by_objects(robot: cw.Robot, pattern: cw.Pattern | OnlinePattern) -> np.ndarray:
    """Return the times of ticks that are fed with objects [us], set-points included."""
    walked = cw.walk_pattern(robot, 1)
    parts, control = prepare(robot, walked, force=True), default_control(robot)
    law = WalkingController(control.gains, control.settings, control.period)
    times = []

    class Timed(WholeBodyTicker):
        def step(self, when: float, sensors: Sensors) -> None:
            begin = time.perf_counter()
            outcome = super().step(when, sensors)
            _ = self.command
            times.append(1e6 * (time.perf_counter() - begin))
            return outcome

    parts.body.ticker = lambda p, c, w: Timed(p, c, parts.body, w)
    walk(pattern, law, parts.body, parts.plant, on_tick=_ignore)
    return np.array(times)


def _ignore(tick: Tick) -> None:
    """Do nothing with a tick."""


def commanded(robot: cw.Robot, duration: float) -> OnlinePattern:
    """Return a walk that is commanded to go forward."""
    gait = cw.default_gait(robot)
    online = OnlinePattern(
        gait,
        cw.default_pendulum(robot),
        duration=duration,
        sole_size=robot.sole_size,
    )
    online.set_velocity(2 * gait.half_step / gait.period)
    return online


def physics_step(robot: cw.Robot) -> float:
    """Return the median time of a physics step while the robot stands [us]."""
    plant = prepare(robot, cw.walk_pattern(robot, 1), force=True).plant
    times = []
    for _ in range(2000):
        begin = time.perf_counter()
        mujoco.mj_step(plant.model, plant.data)
        times.append(1e6 * (time.perf_counter() - begin))
    return float(np.median(times))


def physics_alone(run: cw.Run) -> float:
    """Return how long the physics of a run take without control [s]."""
    model, log = run.scene, run.log
    data, controls = mujoco.MjData(model), log["ctrl"]
    data.qpos[:], data.qvel[:] = log["qpos"][0], log["qvel"][0]
    begin = time.perf_counter()
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data, run.substeps)
    return time.perf_counter() - begin


def measure(name: str, steps: int) -> dict[str, float]:
    """Return medians and 99th percentiles of the tick [us], and their ratios."""
    robot = cw.load_robot(name)
    pattern = cw.walk_pattern(robot, steps)
    fused(robot, 1)  # compiles, or loads from disk
    found = {
        "plain": fused(robot, steps),
        "noise": fused(robot, steps, noise=1.0),
        "latency": fused(robot, steps, latency=0.01),
        "own plant": by_objects(robot, pattern),
        "commanded": by_objects(robot, commanded(robot, pattern.duration)),
    }
    plain = float(np.median(found["plain"]))
    rows = {"physics step": physics_step(robot)}
    for title, times in found.items():
        rows[title] = float(np.median(times))
        rows[f"{title}, p99"] = float(np.percentile(times, 99))
        rows[f"{title} / plain"] = rows[title] / plain
    run = cw.simulate(robot, pattern, force=True)
    rows["x real time"] = pattern.duration / run.seconds
    rows["physics alone / loop"] = physics_alone(run) / run.seconds
    return rows


def main() -> None:
    """Run the benchmark and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=["paper"])
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--compare", type=Path)
    options = parser.parse_args()
    found = {name: measure(name, options.steps) for name in options.robots}
    before = json.loads(options.compare.read_text()) if options.compare else {}
    for name, result in found.items():
        print(name)
        for title, value in result.items():
            old = before.get(name, {}).get(title)
            change = f"  {value / old:6.2f} x before" if old else ""
            print(f"  {title:22}{value:9.2f}{change}")
    if options.save:
        options.save.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
