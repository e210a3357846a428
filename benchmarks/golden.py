"""Record the logs of reference walks, or compare two recordings column by column.

    python benchmarks/golden.py record before     # with one version installed
    python benchmarks/golden.py record after      # with another
    python benchmarks/golden.py compare before after

Walks, dances and commanded walks of six robots, with noise, latency and pushes. Two
recordings on one machine must agree to 1e-10 in every column that is not a time.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import comwalk as cw

ROBOTS = ("paper", "jvrc1", "talos", "g1", "romeo", "icub")
STEPS = 8
POSITION = ("--actuation", "position")  # as earlier versions walked
TOLERANCE = 1e-10
CLOCKS = {"compute_s"}  # columns that hold wall-clock times
Columns = dict[str, np.ndarray]


def _command_line(*words: str) -> Columns:
    """Run one command in this process and return the columns that it saved."""
    from comwalk.cli import main

    with tempfile.TemporaryDirectory() as folder:
        with contextlib.redirect_stdout(io.StringIO()):
            code = main([*words, "--out", folder, "--json"])
        if code:
            print(f"  exit code {code}: {' '.join(words)}")
        with np.load(Path(folder) / "run.npz") as archive:
            return {name: archive[name] for name in archive.files}


def _commanded(robot: str) -> Columns:
    """Walk an `OnlinePattern` that is given three commands."""
    parts = _parts()
    model = cw.load_robot(robot, actuation="position")
    gait, control = cw.default_gait(model), parts["default_control"](model)
    speed = 2 * gait.half_step / gait.period
    orders = [(0.0, (speed, 0, 0)), (3.3, (0.6 * speed, 0, 0.1)), (5.6, (0, 0, 0))]

    def drive(online: object, time: float) -> None:
        while orders and time >= orders[0][0]:
            online.set_velocity(*orders.pop(0)[1])

    online = parts["OnlinePattern"](
        gait,
        cw.default_pendulum(model),
        duration=8.0,
        driver=drive,
        sole_size=getattr(model, "sole_size", None) or parts["sole_size"](model),
    )
    period = control.period
    body = parts["WholeBody"](model, period, None, control.body)
    law = parts["WalkingController"](control.gains, control.settings, period)
    plant = parts["SimulatedRobot"](model, period)
    body.start(online.at(0.0))
    plant.place(body.configuration)
    rows: list[np.ndarray] = []

    def keep(tick: object) -> None:
        rows.append(
            np.concatenate(
                [
                    *(tick.measured.com, tick.measured.zmp, tick.control.u),
                    *(tick.command.positions, tick.command.velocities),
                    plant.data.qpos,
                ]
            )
        )

    parts["walk"](online, law, body, plant, on_tick=keep)
    return {"rows": np.array(rows)}


def _parts() -> dict[str, object]:
    """Return the classes of a loop of one's own, wherever this version keeps them."""
    from importlib import import_module

    homes = {
        "default_control": ("certificates", "defaults"),
        "sole_size": ("certificates", "defaults"),
        "OnlinePattern": ("pattern", "replanning"),
        "WalkingController": ("control", "control"),
        "SimulatedRobot": ("walking", "simulator"),
        "WholeBody": ("walking", "whole_body"),
        "walk": ("control", "walk"),
    }
    found = {}
    for name, modules in homes.items():
        for module in modules:
            try:
                found[name] = getattr(import_module(f"comwalk.{module}"), name)
            except (ImportError, AttributeError):
                continue
            break
    return found


def cases(robot: str) -> Iterator[tuple[str, Callable[[], Columns]]]:
    """Yield the name and the run of each case of a robot."""
    steps = ("--steps", str(STEPS))
    force = ("0", "40", "0") if robot != "icub" else ("0", "10", "0")
    commands = {
        "walk": ("walk", robot, *POSITION, *steps),
        "dance": ("dance", robot, *POSITION, "--duration", "6"),
        "walk_dance": ("walk", robot, *POSITION, *steps, "--motion", "disco"),
        "noise": ("walk", robot, *POSITION, *steps, "--simulator.noise", "1"),
        "latency": ("walk", robot, *POSITION, *steps, "--simulator.latency", "0.01"),
        "push": ("walk", robot, *POSITION, *steps, "--push", "3.1:" + ",".join(force)),
    }
    for name, words in commands.items():
        yield name, lambda words=words: _command_line(*words)
    yield "commanded", lambda: _commanded(robot)


def _round_starts() -> None:
    """Round the postures that simulations start from to 1e-12 m and rad.

    A sole that begins exactly on the floor touches it or not by the last bit of its
    height, which moves the settled robot by 40 um.
    """
    plant = _parts()["SimulatedRobot"]
    place = plant.place
    plant.place = lambda self, q: place(self, np.round(q, 12))


def record(folder: Path) -> None:
    """Run all cases and save their columns."""
    folder.mkdir(parents=True, exist_ok=True)
    _round_starts()
    for robot in ROBOTS:
        for name, run in cases(robot):
            if (folder / f"{robot}_{name}.npz").exists():
                continue
            columns = run()
            np.savez(folder / f"{robot}_{name}.npz", **columns)
            rows = max(len(np.atleast_1d(c)) for c in columns.values())
            print(f"{robot} {name}: {rows} rows, {len(columns)} columns", flush=True)


def _difference(one: np.ndarray, two: np.ndarray) -> float:
    """Return the largest difference of two columns; infinite if shapes differ.

    Columns that only one version rounds to 32 bits agree if that is all. The difference
    is absolute up to a magnitude of 1, and relative to the largest value beyond:
    forces are in newtons, of which a robot weighs hundreds.
    """
    if one.shape != two.shape:
        return np.inf
    if one.dtype.kind in "US":
        return 0.0 if np.array_equal(one, two) else np.inf
    if one.dtype != two.dtype and np.dtype(np.float32) in (one.dtype, two.dtype):
        two = np.where(np.isclose(one, two, rtol=1.2e-7, atol=1e-30), one, two)
    one, two = one.astype(float), two.astype(float)
    same = (one == two) | (np.isnan(one) & np.isnan(two))
    scale = max(1.0, float(np.nanmax(np.abs(one), initial=0.0)))
    return float(np.abs(np.where(same, 0.0, one - two)).max(initial=0.0)) / scale


def compare(before: Path, after: Path) -> int:
    """Print the largest difference of each case; return how many exceed the bound."""
    worse = 0
    for path in sorted(before.glob("*.npz")):
        if not (after / path.name).exists():
            print(f"{path.stem}: missing")
            worse += 1
            continue
        with np.load(path) as one, np.load(after / path.name) as two:
            gone = sorted(set(one.files) ^ set(two.files))
            shared = sorted((set(one.files) & set(two.files)) - CLOCKS)
            found = {name: _difference(one[name], two[name]) for name in shared}
        name = max(found, key=lambda key: found[key])
        worse += found[name] > TOLERANCE
        verdict = "equal" if found[name] <= TOLERANCE else "DIFFERENT"
        print(f"{path.stem}: {verdict}, {found[name]:.1e} in {name}", *gone)
    return worse


if __name__ == "__main__":
    if sys.argv[1] == "record":
        record(Path(sys.argv[2]))
    else:
        sys.exit(compare(Path(sys.argv[2]), Path(sys.argv[3])) > 0)
