"""Time of one control tick, beside the time of one physics step in the same run.

    python benchmarks/bench_tick.py [ROBOT ...] [--steps 6] [--save FILE.json]
                                    [--compare FILE.json]

First the readable tick and its parts, then the compiled one and what the compiled loop
adds to it, and the real-time factors of a median period: of the loop, and of physics
alone.

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
from comwalk.certificates import walk_pattern
from comwalk.control import WalkingController
from comwalk.handles import handle_of
from comwalk.run import prepare
from comwalk.walking import CompiledTick, feel_step, row_type, scene_arrays, sense
from comwalk.walking import command as command_plant

PARTS = ("plan", "measure", "law", "act")
LOOP = ("compiled tick", "set-points and log", "physics", "sensors")


def measure(name: str, steps: int) -> dict[str, float]:
    """Return medians [us] of the tick's parts, of the tick, and of a physics step."""
    robot = cw.load_robot(name)
    pattern = walk_pattern(robot, steps)
    parts = prepare(robot, pattern)
    control, plant, body = parts.control, parts.plant, parts.body
    controller = WalkingController(control.gains, control.settings, control.period)
    reference = pattern.at(0.0)
    command = body.start(reference)
    controller.reset(reference.com, reference.zmp)
    sensors, rows, now = plant.start(command), [], time.perf_counter
    for k in range(int(pattern.duration / control.period)):
        times = [now()]
        reference = pattern.at(k * control.period)
        times.append(now())
        measured = body.measure(sensors, reference)
        times.append(now())
        output = controller.step(reference, measured.com, measured.zmp)
        times.append(now())
        command = body.act(output, reference)
        times.append(now())
        plant.write(command)
        sensors = plant.read()
        times.append(now())
        rows.append(1e6 * np.diff(times))
    table = np.array(rows)
    tick = table[:, :4].sum(axis=1)
    physics = table[:, 4] / plant.substeps
    result = {name: float(np.median(table[:, i])) for i, name in enumerate(PARTS)}
    result |= {
        "tick p50": float(np.median(tick)),
        "tick p95": float(np.percentile(tick, 95)),
        "tick p99": float(np.percentile(tick, 99)),
        "physics step": float(np.median(physics)),
    }
    return result | {"tick / physics step": result["tick p50"] / result["physics step"]}


def measure_compiled(name: str, steps: int) -> dict[str, float]:
    """Return medians [us] of the compiled tick and of the loop around it."""
    robot = cw.load_robot(name)
    pattern = walk_pattern(robot, steps)
    parts = prepare(robot, pattern)
    control, plant, body = parts.control, parts.plant, parts.body
    law = WalkingController(control.gains, control.settings, control.period)
    tick, dt, now = CompiledTick(pattern, law, body), control.period, time.perf_counter
    ticks, rows = int(pattern.duration / dt), []
    scene = scene_arrays(plant, parts.log.take(row_type(plant), ticks))
    there, here = handle_of(*scene), tick.handle
    tick.feel(plant.start(body.start(pattern.at(0.0))))
    for k in range(ticks):
        times = [now()]
        tick.step(k * dt)
        times.append(now())
        command_plant(there, here, k, 0.0)
        times.append(now())
        for step in range(plant.substeps):
            mujoco.mj_step(plant.model, plant.data)
            feel_step(there, step)
        times.append(now())
        sense(there, here, plant.substeps)
        times.append(now())
        rows.append(1e6 * np.diff(times))
    table = np.array(rows)
    result = {part: float(np.median(table[:, i])) for i, part in enumerate(LOOP)}
    period = float(np.median(table.sum(axis=1)))
    return result | {
        "compiled tick p99": float(np.percentile(table[:, 0], 99)),
        "/ real time, loop": 1e6 * dt / period,
        "/ real time, physics": 1e6 * dt / result["physics"],
    }


def main() -> None:
    """Run the benchmark and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=["paper"])
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--compare", type=Path)
    arguments = parser.parse_args()
    result = {}
    for robot in arguments.robots:
        for function in (measure, measure_compiled):
            function(robot, 1)  # warm up
            found = function(robot, arguments.steps)
            result |= {f"{robot}: {part}": value for part, value in found.items()}
    before = json.loads(arguments.compare.read_text()) if arguments.compare else {}
    for name, value in result.items():
        ratio = f"{value / before[name]:8.2f} x before" if name in before else ""
        print(f"{name:32s}{value:10.1f}{'' if '/' in name else ' us'}{ratio}")
    if arguments.save:
        arguments.save.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
