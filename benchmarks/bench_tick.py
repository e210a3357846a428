"""Time of one control tick, beside the time of one physics step in the same run.

    python benchmarks/bench_tick.py [--steps 6] [--save FILE.json] [--compare FILE.json]

The physics step is the yardstick: it is C code that this project did not write, so the
ratio says more than microseconds do on a machine that others use too.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

import comwalk as cw
from comwalk.control import WalkingController
from comwalk.simulator import SimulatedRobot
from comwalk.whole_body import WholeBody

PARTS = ("plan", "measure", "law", "act")


def measure(steps: int) -> dict[str, float]:
    """Return medians [us] of the tick's parts, of the tick, and of a physics step."""
    control = cw.Control()
    robot = cw.load_robot("paper")
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), steps), cw.Pendulum())
    plant = SimulatedRobot(robot, control.period)
    body = WholeBody(robot, control.period)
    controller = WalkingController(control.gains, control.settings, control.period)
    reference = pattern.at(0.0)
    command = body.start(reference)
    plant.place(body.configuration)
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


def main() -> None:
    """Run the benchmark and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--compare", type=Path)
    arguments = parser.parse_args()
    measure(1)  # warm up
    result = measure(arguments.steps)
    before = json.loads(arguments.compare.read_text()) if arguments.compare else {}
    for name, value in result.items():
        ratio = f"{value / before[name]:8.2f} x before" if name in before else ""
        print(f"{name:20s}{value:10.1f}{'' if '/' in name else ' us'}{ratio}")
    if arguments.save:
        arguments.save.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
