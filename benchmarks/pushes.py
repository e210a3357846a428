"""Pushes and rough floors, on the planned footholds and on moved ones.

    python benchmarks/pushes.py [--write] [table ...]

The tables of docs/replanning.md. Robots whose packages are not installed are left out.
`--write` puts the tables into the page; without it they are printed.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import statistics
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from page_tables import Rows, tell

from comwalk.certificates import agility_of, stepping_of
from comwalk.config import DanceConfig, WalkConfig
from comwalk.control import End, Push, SimulatorSettings
from comwalk.errors import ComwalkError
from comwalk.pattern import Phase, largest_push, make_pattern
from comwalk.run import Run
from comwalk.setup import Setup, build_dance, build_walk

PAGE = Path(__file__).parent.parent / "docs" / "replanning.md"
ROBOTS = ("paper", "talos", "g1")
PD = (100.0, 40.0, 2.0)
REAL = {"noise": 1.0, "latency": 0.002, "command_delay": 0.002, "joint_friction": 0.5}
SHARES = (0.1, 0.35, 0.6, 0.85)
WAYS = {"forward": (1, 0), "back": (-1, 0), "inward": (0, -1), "outward": (0, 1)}


@cache
def setup_of(robot: str, steps: int = 10, **config: Any) -> Setup | None:
    """Return the setup of a walk by torque; None if the robot is not installed."""
    try:
        return build_walk(WalkConfig(robot=robot, steps=steps, pd=PD, **config))
    except ComwalkError as error:
        if "pip install" in str(error):
            return None
        raise


def walk(setup: Setup, pushes: tuple[Push, ...] = (), **physics: Any) -> Run:
    """Return a walk with pushes, in other physics."""
    settings = SimulatorSettings(pushes=pushes, **physics)
    return dataclasses.replace(setup, physics=settings).run()


def stays(setup: Setup, pushes: tuple[Push, ...] = (), **physics: Any) -> bool:
    """Return whether the robot does not fall; where it ends is not asked."""
    return walk(setup, pushes, **physics).outcome.end is not End.FELL


def push_of(
    setup: Setup, way: tuple[float, float], speed: float, start: float, time: float
) -> Push:
    """Return the push that makes a velocity step [m/s] in a time [s]."""
    mass = setup.robot.mass if setup.robot else 0.0
    x, y = (mass * speed / time * part for part in way)
    return Push(start=start, force=(x, y, 0.0), duration=time)


def _starts(setup: Setup) -> list[tuple[float, float]]:
    """Return when pushes begin in the second swing of the right foot, and its time."""
    singles = [s for s in setup.pattern.phases if s.phase is Phase.SINGLE_LEFT]
    span = singles[1]
    return [(span.start + share * span.duration, span.duration) for share in SHARES]


def largest(setup: Setup, way: tuple[int, int], share: float = 0.0) -> float:
    """Return the largest velocity step that is withstood, the least of its phases.

    Every smaller one of a grid of 0.05 m/s is withstood, too.

    Args:
        setup: The walk.
        way: Where to, forward and left.
        share: How long the push lasts, as a share of a swing, from when on it swings;
            0.1 s, from four phases on, if 0.
    """
    starts = _starts(setup)
    if share:
        start, swing = starts[0]
        starts = [(start - 0.1 * swing, share * swing)]
    else:
        starts = [(start, 0.1) for start, _ in starts]
    for k in itertools.count(1):
        speed = 0.05 * k
        for start, time in starts:
            push = push_of(setup, way, speed, start, time)
            if not stays(setup, (push,)):
                return speed - 0.05
    return math.inf


def pushes() -> Rows:
    """Yield the largest pushes of 0.1 s on the trunk, and what any controller could."""
    yield ("robot", "steps", *(f"{way} [m/s]" for way in WAYS))
    for name in ROBOTS:
        setup = setup_of(name)
        if setup is None or setup.robot is None:
            continue
        for title, adapt in (("as planned", False), ("moved", True)):
            one = dataclasses.replace(setup, adapt=adapt)
            found = [largest(one, way) for way in WAYS.values()]
            yield name, title, *(f"{speed:.2f}" for speed in found)
        bound = largest_push(setup.pattern, stepping_of(setup.robot))
        limits = dataclasses.asdict(bound).values()
        yield name, "no pendulum could more", *(f"{v:.2f}" for v in limits)
        shares = [100.0 * v / b for v, b in zip(found, limits, strict=True)]
        yield name, "moved, of that", *(f"{share:.0f} %" for share in shares)


def long_pushes() -> Rows:
    """Yield the largest pushes that last 80 % of a swing, outward 40 %."""
    yield ("robot", *(f"{way} [m/s]" for way in WAYS))
    for name in ROBOTS:
        setup = setup_of(name)
        if setup is not None:
            shares = {way: 0.4 if way == "outward" else 0.8 for way in WAYS}
            found = [largest(setup, WAYS[way], shares[way]) for way in WAYS]
            yield name, *(f"{speed:.2f}" for speed in found)


def _random(setup: Setup, seed: int) -> tuple[Push, ...]:
    """Return pushes of up to 0.4 m/s anywhere, every 2 to 4 s."""
    rng, time, found = np.random.default_rng(seed), 3.0, []
    while time < setup.pattern.duration - 3.0:
        angle, speed = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, 0.4)
        way = math.cos(angle), math.sin(angle)
        found.append(push_of(setup, way, speed, time, 0.1))
        time += rng.uniform(2.0, 4.0)
    return tuple(found)


def minutes(seeds: int = 20) -> Rows:
    """Yield how many of 20 walks of 60 s with random pushes are completed."""
    speeds = {"in place": 0.001, "0.2 m/s": 0.2, "as by default": None}
    yield ("robot", "steps", *speeds)
    for name in ROBOTS:
        for title, adapt in (("as planned", False), ("moved", True)):
            counts = []
            for speed in speeds.values():
                setup = setup_of(name, 1, speed=speed)
                if setup is None:
                    break
                step = setup.pattern.plan.steps[0]
                period = step.single_support + step.double_support
                setup = setup_of(name, round(57.0 / period), speed=speed)
                one = dataclasses.replace(setup, adapt=adapt)
                ends = [stays(one, _random(one, k), **REAL) for k in range(seeds)]
                counts.append(f"{sum(ends)} of {seeds}")
            else:
                yield name, title, *counts


def _from_rest(robot: str, dances: bool) -> Setup | None:
    """Return the setup of standing, or of dancing, for 10 s."""
    if dances:
        config = DanceConfig(robot=robot, pd=PD, duration=10.0, frequency=0.5)
        return build_dance(dataclasses.replace(config, force=True))
    setup = setup_of(robot, 1)
    if setup is None or setup.robot is None:
        return None
    plan = dataclasses.replace(setup.pattern.plan, steps=(), closing=0, stand_time=5.0)
    pattern = make_pattern(plan, setup.pattern.pendulum)
    return dataclasses.replace(setup, pattern=pattern)


def rest() -> Rows:
    """Yield in how many of 16 directions pushes from rest are withstood."""
    speeds = (0.2, 0.3, 0.4, 0.5)
    yield ("robot", "doing", "steps", *(f"{speed} m/s" for speed in speeds))
    for name, dances in itertools.product(ROBOTS, (False, True)):
        if setup_of(name, 1) is None:
            continue
        setup = _from_rest(name, dances)
        if setup is None:
            continue
        for title, adapt in (("as planned", False), ("moved", True)):
            one, counts = dataclasses.replace(setup, adapt=adapt), []
            for speed in speeds:
                angles = [2.0 * math.pi * k / 16 for k in range(16)]
                ways = [(math.cos(angle), math.sin(angle)) for angle in angles]
                pushes = [push_of(one, way, speed, 4.0, 0.1) for way in ways]
                counts.append(f"{sum(stays(one, (push,)) for push in pushes)} of 16")
            yield name, "dancing" if dances else "standing", title, *counts


def floors() -> Rows:
    """Yield how many of 20 rough floors are walked."""
    heights = (0.01, 0.015, 0.02, 0.03)
    yield ("robot", "steps", *(f"{1e3 * h:.0f} mm" for h in heights))
    for name in ROBOTS:
        setup = setup_of(name, 12)
        if setup is None:
            continue
        for title, adapt in (("as planned", False), ("moved", True)):
            one, counts = dataclasses.replace(setup, adapt=adapt), []
            for h in heights:
                runs = [
                    walk(one, terrain=h, terrain_seed=100 + k, **REAL)
                    for k in range(20)
                ]
                counts.append(f"{sum(run.outcome.ok for run in runs)} of 20")
            yield name, title, *counts


FLAWS = {
    "none": {},
    "noise, delay, friction": REAL,
    "and 20 % of load on the back": {**REAL, "payload": 0.2},
    "and a floor of friction 0.2": {**REAL, "friction": 0.2},
    "and a floor of 10 mm": {**REAL, "terrain": 0.01},
}


def quiet() -> Rows:
    """Yield how many steps are moved in 12 where nobody pushes."""
    names = (*ROBOTS, "jvrc1", "icub", "romeo")
    found = {name: setup_of(name, 12) for name in names}
    known = {name: setup for name, setup in found.items() if setup is not None}
    yield ("flaws", *known)
    for title, physics in FLAWS.items():
        cells = []
        for setup in known.values():
            moved = walk(setup, **physics).summary()["steps_moved"]
            fixed = walk(dataclasses.replace(setup, adapt=False), **physics)
            cells.append(f"{moved}" if fixed.outcome.ok else f"{moved}, else it falls")
        yield title, *cells


def ablation() -> Rows:
    """Yield the largest pushes of the paper's robot without what helps."""
    setup = setup_of("paper")
    if setup is None or setup.robot is None:
        return
    from comwalk.certificates import reach

    usual = reach.agility_of
    whole = agility_of(setup.robot)
    parts = {
        "everything": whole,
        "hips at their height": dataclasses.replace(whole, lowest=0.0),
        "feet half as quick": dataclasses.replace(
            whole, rush=0.25 * whole.rush, speed=0.5 * whole.speed
        ),
        "the middle half of the sole": dataclasses.replace(
            whole, half=(0.5 * whole.half[0], 0.5 * whole.half[1])
        ),
    }
    yield ("with", *(f"{way} [m/s]" for way in WAYS))
    for title, agility in parts.items():
        reach.agility_of = lambda robot, found=agility: found
        found = [largest(setup, way) for way in WAYS.values()]
        yield title, *(f"{speed:.2f}" for speed in found)
    reach.agility_of = usual


def latency() -> Rows:
    """Yield the time of a tick while steps are moved, beside that of all others."""
    yield ("robot", "ticks, median [us]", "ticks of moved steps, median [us]")
    for name in ROBOTS:
        setup = setup_of(name)
        if setup is None:
            continue
        start = _starts(setup)[1][0]
        push = push_of(setup, (1, 0), 0.35, start, 0.1)
        log = walk(setup, (push,)).log
        after = (log["t"] > start + 0.05) & (log["t"] < start + 0.3)
        ticks = 1e6 * log["compute_s"]
        usual, moved = ticks[log["t"] < start], ticks[after]
        cells = (statistics.median(usual.tolist()), statistics.median(moved.tolist()))
        yield name, *(f"{cell:.1f}" for cell in cells)


TABLES: dict[str, Callable[[], Rows]] = {
    "pushes": pushes,
    "long_pushes": long_pushes,
    "rest": rest,
    "minutes": minutes,
    "floors": floors,
    "quiet": quiet,
    "ablation": ablation,
    "latency": latency,
}


if __name__ == "__main__":
    tell(sys.argv[1:], TABLES, PAGE)
