"""A walk in real time: a plant that keeps absolute deadlines, under the usual loop.

Physics stands for the robot, in the same process, so that a period holds a
controller's tick, a physics step and what the operating system does. A tick is late if
it is not done by its deadline.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import comwalk as cw
from comwalk.certificates import default_control
from comwalk.control import (
    Command,
    Sensors,
    WalkingController,
    walk,
)
from comwalk.pattern import Pattern
from comwalk.walking import SimulatedRobot, WholeBody

SPIN = 2e-4
"""How long before a deadline it stops sleeping and looks at the clock [s]."""


class Paced:
    """A simulated robot whose `read` returns at absolute deadlines. Final."""

    def __init__(self, plant: SimulatedRobot, ticks: int, spin: float) -> None:
        """Wrap a plant."""
        self.plant, self._spin = plant, spin
        self.joint_names, self.period = plant.joint_names, plant.period
        self.done = np.zeros(ticks)
        """When each tick was done, after its own beginning [s]."""
        self.woken = np.zeros(ticks)
        """How late each deadline was noticed [s]; nothing where it was missed."""
        self._k, self._begin = 0, 0.0

    def start(self, command: Command) -> Sensors:
        """Start the plant and the clock."""
        sensors = self.plant.start(command)
        self._begin = time.perf_counter()
        return sensors

    def write(self, command: Command) -> None:
        """Pass on a command."""
        self.plant.write(command)

    def read(self) -> Sensors:
        """Simulate a period, then wait for its end."""
        sensors = self.plant.read()
        deadline = self._begin + (self._k + 1) * self.period
        now = time.perf_counter()
        self.done[self._k] = now - (deadline - self.period)
        if now < deadline:
            if deadline - now > self._spin:
                time.sleep(deadline - now - self._spin)
            while time.perf_counter() < deadline:
                pass
            self.woken[self._k] = time.perf_counter() - deadline
        self._k += 1
        return sensors

    def stop(self, reason: str) -> None:
        """Stop the plant."""
        self.plant.stop(reason)

    def measured(self) -> tuple[np.ndarray, np.ndarray]:
        """Return `done` and `woken` of the ticks that were."""
        return self.done[: self._k], self.woken[: self._k]


def realtime(
    name: str = "g1",
    *,
    seconds: float = 60.0,
    rate: float = 1000.0,
    tamed: bool = True,
    priority: bool = True,
    spin: float = SPIN,
) -> dict[str, Any]:
    """Walk in real time and return how well the deadlines were kept.

    Args:
        name: The robot.
        seconds: About how long [s].
        rate: Ticks per second [1/s].
        tamed: Whether the garbage collector is frozen and off.
        priority: Whether to ask for real-time priority and locked memory.
        spin: How long before a deadline to stop sleeping [s].
    """
    robot = cw.load_robot(name)
    _, short, *parts = _set_up(robot, 1, rate)
    walk(short, *parts)  # so that all kernels are loaded
    steps = max(1, round((seconds - 3.0) / cw.default_gait(robot).period))
    period, pattern, controller, body, plant = _set_up(robot, steps, rate)
    paced = Paced(plant, math.ceil(pattern.duration / period) + 1, spin)
    with _tame(tamed), _prioritised(priority) as granted:
        outcome = walk(pattern, controller, body, paced)
    done, woken = (1e6 * times for times in paced.measured())
    late = done - 1e6 * period
    return {
        "robot": name,
        "rate": rate,
        "tamed": tamed,
        "priority": granted,
        "outcome": str(outcome),
        "ticks": len(done),
        "late_ticks": int(np.sum(late > 0.0)),
        "late_share": float(np.mean(late > 0.0)),
        "worst_lateness_us": float(max(0.0, late.max())),
        **_percentiles("done_us", done),
        **_percentiles("woken_us", woken),
    }


def _set_up(
    robot: cw.Robot, steps: int, rate: float
) -> tuple[float, Pattern, WalkingController, WholeBody, SimulatedRobot]:
    """Return the period, and what a loop takes."""
    control = default_control(robot, period=1.0 / rate)
    pattern = cw.walk_pattern(robot, steps)
    body = WholeBody(robot, control.period, settings=control.body)
    controller = WalkingController(control.gains, control.settings, control.period)
    settings = cw.SimulatorSettings(timestep=min(0.001, control.period))
    plant = SimulatedRobot(robot, control.period, settings, plan=pattern.plan)
    body.start(pattern.at(0.0))
    plant.place(body.configuration)
    return control.period, pattern, controller, body, plant


def _percentiles(name: str, times: np.ndarray) -> dict[str, float]:
    """Return the median, the 99th percentile and the largest."""
    found = np.percentile(times, [50, 99, 100]).tolist()
    return dict(zip((f"{name}_p50", f"{name}_p99", f"{name}_max"), found, strict=True))


@contextmanager
def _tame(wanted: bool) -> Iterator[None]:
    """Keep the garbage collector from running; what lives already is left alone."""
    if not wanted:
        yield
        return
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@contextmanager
def _prioritised(wanted: bool) -> Iterator[bool]:
    """Ask for real-time priority and memory that stays; yield whether it was given."""
    if not wanted or not hasattr(os, "sched_setscheduler"):
        yield False
        return
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except PermissionError:
        yield False
        return
    ctypes.CDLL(None).mlockall(1)  # what is mapped now
    try:
        yield True
    finally:
        ctypes.CDLL(None).munlockall()
        os.sched_setscheduler(0, policy, before)
