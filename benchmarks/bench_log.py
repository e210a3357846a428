"""What a log costs the loop, beside the control tick in the same runs.

    python benchmarks/bench_log.py [--steps 6] [--rounds 3]

Walks without and with run.mcap take turns, so that a busy machine is as unkind to both.
The log has a thread of its own; what the loop itself does for it is `Log.record`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import comwalk as cw
from comwalk.control import Tick
from comwalk.runs import Log, McapLog


def timed(function: Callable, spent: list[float], clock: Callable) -> Callable:
    """Return a function that notes how long each call took [us]."""

    def call(*args: object, **named: object) -> object:
        begin = clock()
        result = function(*args, **named)
        spent.append(1e6 * (clock() - begin))
        return result

    return call


def of_record(ticks: list[Tick]) -> float:
    """Return the median time to hand a row to a log [us]."""
    log, spent = Log(len(ticks)), []
    record = timed(log.record, spent, time.perf_counter)
    for tick in ticks:
        record(tick)
    return float(np.median(spent))


def measure(steps: int, rounds: int) -> dict[str, float]:
    """Return times of ticks and walks, without and with a log."""
    robot = cw.load_robot("paper")
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), steps), cw.Pendulum())
    ticks: list[Tick] = []
    thread: list[float] = []
    own, McapLog.write = McapLog.write, timed(McapLog.write, thread, time.thread_time)
    keep, Log.record = (
        Log.record,
        lambda log, tick: (ticks.append(tick), keep(log, tick)),
    )
    cw.simulate(robot, pattern)  # warm up, and rows to record
    Log.record = keep
    runs: dict[bool, list[cw.Run]] = {False: [], True: []}
    processor: dict[bool, list[float]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        for k in range(2 * rounds):
            file = Path(folder) / "run.mcap" if k % 2 else None
            begin = time.process_time()
            runs[k % 2 > 0].append(cw.simulate(robot, pattern, record=file))
            processor[k % 2 > 0].append(1e6 * (time.process_time() - begin))
        size = file.stat().st_size / pattern.duration
    McapLog.write = own
    rows = rounds * len(ticks)
    found = {"record": of_record(ticks), "writer thread": sum(thread) / rows}
    for logged, text in ((False, "without"), (True, "with")):
        seconds = np.concatenate([1e6 * run.log["compute_s"] for run in runs[logged]])
        found[f"tick p50 {text}"] = float(np.median(seconds))
        found[f"tick p99 {text}"] = float(np.percentile(seconds, 99))
        found[f"walk {text}"] = 1e6 * min(run.seconds for run in runs[logged])
        found[f"CPU of a walk {text}"] = min(processor[logged])
    found["record / tick"] = found["record"] / found["tick p50 without"]
    for name in ("walk", "CPU of a walk"):
        found[f"{name}, with / without"] = (
            found[f"{name} with"] / found[f"{name} without"]
        )
    found["size a second / MB"] = 1e-6 * size
    return found


def main() -> None:
    """Run the benchmark and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    for name, value in measure(arguments.steps, arguments.rounds).items():
        text = f"{value:12.4f}" if "/" in name else f"{value:12.1f} us"
        print(f"{name:30s}{text}")


if __name__ == "__main__":
    main()
