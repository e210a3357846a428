"""Walks by torque on soft gains, beside those by position: docs/torque.md's tables.

    python benchmarks/torque.py [--write] [table ...]

Robots whose packages are not installed are left out. `--write` puts the tables into the
page; without it they are printed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from page_tables import Rows, tell

from comwalk.config import DanceConfig, WalkConfig
from comwalk.control import BodySettings, Push, SimulatorSettings
from comwalk.errors import ComwalkError
from comwalk.pattern import Phase
from comwalk.robot import load_robot
from comwalk.run import Run
from comwalk.setup import Setup, build_dance, build_walk

PAGE = Path(__file__).parent.parent / "docs" / "torque.md"
ROBOTS = ("g1", "mjlab_g1", "talos", "jvrc1", "paper", "icub", "romeo")
PD = {"pd": (100.0, 40.0, 2.0)}
REAL = {"noise": 1.0, "latency": 0.002, "command_delay": 0.002, "joint_friction": 0.5}


def walk(setup: Setup, **physics: Any) -> Run:
    """Return a walk of a setup in other physics, on the planned footholds."""
    settings = SimulatorSettings(**physics)
    return dataclasses.replace(setup, physics=settings, adapt=False).run()


def setup_of(robot: str, steps: int = 20, **config: Any) -> Setup | None:
    """Return the setup of a walk; None if the robot is not installed."""
    try:
        return build_walk(WalkConfig(robot=robot, steps=steps, **config))
    except ComwalkError as error:
        if "pip install" in str(error):
            return None
        raise


def rms(run: Run, one: str, other: str) -> np.ndarray:
    """Return the rms of a difference of two columns, x and y [mm]."""
    error = run.log[one][:, :2] - run.log[other][:, :2]
    return 1e3 * np.sqrt(np.nanmean(error**2, axis=0))


def pair(values: np.ndarray) -> str:
    """Return x and y as text."""
    return " / ".join(f"{value:.1f}" for value in values)


def cells(run: Run) -> tuple[str, str, str, str]:
    """Return outcome, errors of CoM and ZMP, and where the walk ended."""
    if not run.outcome.ok:
        return f"fell at {run.outcome.time:.1f} s", "-", "-", "-"
    s = run.summary()
    share = 100.0 * s["position_error_m"] / max(s["distance_m"], 1e-9)
    end = f"{share:.2f} %, {abs(s['heading_error_deg']):.1f} deg"
    com, zmp = rms(run, "com_true", "com_ref"), rms(run, "zmp_true", "zmp_ref")
    return "completed", pair(com), pair(zmp), end


WALKS = ("robot", "outcome", "CoM rms, true [mm]", "ZMP rms, true [mm]", "end, heading")


def walks() -> Rows:
    """Yield 20 steps of each robot with the flaws of `REAL`."""
    yield WALKS
    for name in ROBOTS:
        setup = setup_of(name, **PD)
        if setup is not None:
            yield name, *cells(walk(setup, **REAL))


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "a load of 20 % on the back": ({}, {"payload": 0.2}),
    "a floor of friction 0.2": ({}, {"friction": 0.2}),
    "boxes of up to 15 mm": ({}, {"terrain": 0.015}),
    "encoder zeros 3 mrad, IMU 5 mrad, gyro 0.01 rad/s off": (
        {},
        {"encoder_zero": 0.003, "imu_tilt": 0.005, "gyro_bias": 0.01},
    ),
    "friction of 1.5 N m, of which 1.2 known": (
        {"body": BodySettings(known_friction=1.2)},
        {"joint_friction": 1.5},
    ),
    "torques alone": ({"actuation": "torque", "pd": None}, {}),
    "its own gains": ({"actuation": "pd", "pd": None}, {}),
    "ankle sensors": ({"sensors": "ft"}, {}),
    "no sensors at the feet at all": ({"sensors": "none"}, {}),
}


def cases() -> Rows:
    """Yield walks of G1 in other conditions, with the flaws of `REAL` besides."""
    yield ("g1 with", *WALKS[1:])
    for title, (config, physics) in CASES.items():
        setup = setup_of("g1", **{**PD, **config})
        if setup is not None:
            yield title, *cells(walk(setup, **{**REAL, **physics}))


SERVOS = {
    "position servos, kp 75 kv 5": (75.0, 5.0, {}),
    "position servos, kp 200 kv 5": (200.0, 5.0, {}),
    "position servos, kp 4600 kv 92": (4600.0, 92.0, {}),
    "motors": (None, 0.0, {}),
    "motors, by torques alone": (None, 0.0, {"actuation": "torque"}),
}


def file_with(folder: Path, stiffness: float | None, damping: float) -> Path:
    """Return an MJCF of G1 with position servos, or with motors."""
    spec = load_robot("g1").spec.copy()
    for found in (*spec.sensors, *spec.sites):  # by loading
        spec.delete(found)
    for actuator in spec.actuators:
        actuator.set_to_motor()
        if stiffness is not None:
            actuator.set_to_position(kp=stiffness, kv=damping)
    path = folder / "robot.xml"
    path.write_text(spec.to_xml(), encoding="utf-8")
    return path


def files() -> Rows:
    """Yield walks of files of G1 with servos of their own, with the flaws of `REAL`."""
    yield ("G1's file with", "by", "certificate", *WALKS[1:])
    for title, (stiffness, damping, config) in SERVOS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = file_with(Path(folder), stiffness, damping)
            setup = build_walk(WalkConfig(robot=str(path), steps=20, **config))
        by = "" if setup.robot is None else setup.robot.actuation.value
        word = setup.certificate().verdict.split(";")[0]
        yield title, by, word, *cells(walk(setup, **REAL))


def dances() -> Rows:
    """Yield dances of 10 s on both feet, by position and by torque."""
    yield ("robot", "by", "ZMP - CoM ref, rms / most [mm]", "CoM rms, true [mm]")
    for name in ROBOTS:
        drives = ("position", {"actuation": "position"}, {}), ("torque", PD, {})
        flawed = "torque, with the flaws above", PD, REAL
        for title, config, physics in (*drives, flawed):
            words = {"robot": name, "frequency": 1.0, "duration": 10.0, **config}
            try:
                setup = build_dance(DanceConfig(**words))
            except ComwalkError:
                continue
            run = walk(setup, **physics)
            away = run.log["zmp_true"][:, :2] - run.log["com_ref"][:, :2]
            away = 1e3 * np.linalg.norm(away[len(away) // 10 :], axis=1)
            error = np.linalg.norm(rms(run, "com_true", "com_ref"))
            spread = f"{math.sqrt(np.nanmean(away**2)):.1f} / {np.nanmax(away):.0f}"
            fell = () if run.outcome.ok else ("fell", "-")
            yield name, title, *(fell or (spread, f"{error:.1f}"))


def wrenches() -> Rows:
    """Yield what the ZMP from torques is worth, walking and pushed."""
    head = ("friction 0", "0.5 N m", "1 N m", "0.5 N m, pushed")
    yield ("robot", *(f"{x}: rms, worst [mm]" for x in head), "CoM rms")
    for name in ROBOTS:
        setup = setup_of(name, 12, force=True, **PD)
        if setup is None:
            continue
        row, mass = [], setup.robot.mass if setup.robot else 0.0
        push = Push(start=5.0, force=(0.1 * mass / 0.1, 0.0, 0.0))
        for friction, pushes in ((0.0, ()), (0.5, ()), (1.0, ()), (0.5, (push,))):
            physics = {**REAL, "joint_friction": friction, "pushes": pushes}
            run = walk(setup, **physics)
            away = run.log["zmp"][1:] - run.log["zmp_true"][:-1]  # late by a period
            away = 1e3 * np.linalg.norm(away, axis=1)
            error = f"{math.sqrt(np.nanmean(away**2)):.1f}, {np.nanmax(away):.0f}"
            row.append(error if run.outcome.ok else "fell")
        ankle = setup_of(name, 12, **PD, sensors="ft")
        lost = [
            np.linalg.norm(rms(walk(x, **REAL), "com_true", "com_ref"))
            for x in (setup, ankle)
            if x is not None
        ]
        yield name, *row, f"{lost[0]:.1f} mm, with ankle sensors {lost[1]:.1f}"


def floors() -> Rows:
    """Yield how many of 20 rough floors are walked, by position and by torque."""
    heights = (0.01, 0.015, 0.02, 0.03)
    yield ("robot", "by", *(f"{1e3 * h:.0f} mm" for h in heights))
    for name in ("g1", "talos"):
        for title, config, flaws in (
            ("position", {"actuation": "position"}, {}),
            ("torque", PD, {}),
            ("torque, with the flaws above", PD, REAL),
        ):
            setup = setup_of(name, 12, force=True, **config)
            if setup is None:
                continue
            counts = [
                sum(
                    walk(setup, terrain=h, terrain_seed=100 + k, **flaws).outcome.ok
                    for k in range(20)
                )
                for h in heights
            ]
            yield name, title, *(f"{n} of 20" for n in counts)


WAYS = {"forward": (1, 0), "back": (-1, 0), "inward": (0, -1), "outward": (0, 1)}


def _survives(setup: Setup, way: tuple[int, int], speed: float, start: float) -> bool:
    mass = setup.robot.mass if setup.robot else 0.0
    x, y = (10.0 * mass * speed * part for part in way)
    return walk(setup, pushes=(Push(start=start, force=(x, y, 0.0)),)).outcome.ok


def _largest(setup: Setup, way: tuple[int, int]) -> float:
    """Return the largest push, the least of four phases of a single support [m/s]."""
    singles = [s for s in setup.pattern.phases if s.phase is Phase.SINGLE_LEFT]
    span, least = singles[1], 0.6
    for share in (0.1, 0.35, 0.6, 0.85):
        start, low, high = span.start + share * span.duration, 0.0, least
        if _survives(setup, way, least, start):
            continue
        while high - low > 0.01:
            middle = 0.5 * (low + high)
            if _survives(setup, way, middle, start):
                low = middle
            else:
                high = middle
        least = low
    return least


def pushes() -> Rows:
    """Yield the largest pushes of 0.1 s on the trunk that are withstood."""
    yield ("robot", "by", *(f"{way} [m/s]" for way in WAYS))
    for name in ("g1", "talos", "paper"):
        for title, config in (("position", {"actuation": "position"}), ("torque", PD)):
            setup = setup_of(name, 8, force=True, **config)
            if setup is not None:
                found = [_largest(setup, way) for way in WAYS.values()]
                yield name, title, *(f"{speed:.2f}" for speed in found)


def verdicts(count: int = 200) -> Rows:
    """Yield the certificate's word and the physics of random robots and gains."""
    rng, seen = np.random.default_rng(0), {}
    names = [name for name in ROBOTS if setup_of(name, 1) is not None]
    for k in range(count):
        by_torque = bool(rng.integers(2))
        gain, damping = np.exp(rng.uniform(np.log([10.0, 0.3]), np.log([400.0, 10.0])))
        factor, friction = np.exp(rng.uniform(math.log(0.02), 0.0)), rng.uniform()
        late = 0.002 * rng.integers(0, 4, 2)
        config: dict[str, Any] = {"actuation": "position", "stiffness": float(factor)}
        if by_torque:
            config = {"pd": (float(gain), 0.4 * float(gain), float(damping))}
        physics = {"latency": float(late[0]), "command_delay": float(late[1])}
        physics |= {"joint_friction": float(friction), "noise": 1.0}
        try:
            setup = setup_of(names[k % len(names)], 8, force=True, **config)
            if setup is None:
                continue
            word = "stable" if setup.certificate().stable else "unstable"
            able = dataclasses.replace(setup, force=False)
            try:
                run = walk(able, **physics)
            except ComwalkError:
                word, run = "refused", walk(setup, **physics)
        except ComwalkError:
            continue
        end = "walks" if run.outcome.ok else "falls"
        key = "torque" if by_torque else "position", word, end
        seen[key] = seen.get(key, 0) + 1
    yield "by", "the certificate's word", "it walks", "it falls"
    for by in ("position", "torque"):
        for word in ("stable", "unstable", "refused"):
            walked, fell = (seen.get((by, word, x), 0) for x in ("walks", "falls"))
            if walked or fell:
                yield by, word, str(walked), str(fell)


TABLES: dict[str, Callable[[], Rows]] = {
    "walks": walks,
    "cases": cases,
    "files": files,
    "dances": dances,
    "wrenches": wrenches,
    "floors": floors,
    "pushes": pushes,
    "verdicts": verdicts,
}


if __name__ == "__main__":
    tell(sys.argv[1:], TABLES, PAGE)
