"""The fused link with MuJoCo walks and logs as the readable objects do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from readable import readable_run
from robots import paper

from comwalk.control.guard import End, Watch
from comwalk.control.settings import Push, SimulatorSettings
from comwalk.pattern import ONLINE_ARRAYS
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.run import Run, simulate
from comwalk.runs.columns import Log
from comwalk.walking import mujoco_exchange as plant_kernels
from comwalk.walking import records as tick_records
from comwalk.walking.mujoco_exchange import SceneArrays
from comwalk.walking.mujoco_link import row_type
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.records import Arrays
from comwalk.walking.wrench_estimate import Observer

SHORT = make_pattern(plan_steps(Gait(half_step=0.05), 1), PAPER_PENDULUM)


def pair(**options) -> tuple[Run, SimpleNamespace]:
    """Return the same run by the fused link and by readable objects."""
    fast = simulate(paper(), SHORT, force=True, **options)
    return fast, readable_run(paper(), SHORT, **options)


def largest_difference(fast: Run, slow: Run, columns) -> float:
    """Return the largest difference of columns, of those in forces in kN."""
    worst = 0.0
    for name in columns:
        ours, theirs = (run.log[name].astype(float) for run in (fast, slow))
        assert ours.shape == theirs.shape
        assert np.array_equal(np.isnan(ours), np.isnan(theirs))
        scale = 1.0 + np.nanmax(np.abs(theirs))
        worst = max(worst, float(np.nanmax(np.abs(ours - theirs))) / scale)
    return worst


@pytest.mark.parametrize(
    "physics",
    [
        SimulatorSettings(),
        SimulatorSettings(payload=0.2, pushes=(Push(start=0.5, force=(9.0, 30, 0)),)),
        SimulatorSettings(terrain=0.004, timestep=0.002),
        SimulatorSettings(noise=1.0, latency=0.006),
    ],
    ids=["plain", "payload and push", "rough floor", "noise and latency"],
)
def test_the_log_is_the_same(physics):
    """Every column, in shape, kind and number; noise has the same draws."""
    fast, slow = pair(physics=physics)
    assert str(fast.outcome) == str(slow.outcome)
    columns = slow.log.columns
    assert set(columns) <= set(fast.log.columns)
    for name, column in columns.items():
        assert fast.log[name].dtype == column.dtype
    assert largest_difference(fast, slow, set(columns) - {"compute_s"}) < 1e-6


def test_what_the_imu_reads_is_in_the_log():
    """At rest, gravity up; and the joints' rates are those of the state."""
    fast, _ = pair()
    log = fast.log
    assert log["imu_acc"][0, 2] == pytest.approx(paper().gravity, abs=0.05)
    assert np.linalg.norm(log["imu_quat"], axis=1) == pytest.approx(1.0)
    assert np.array_equal(log["joint_rates"], log["qvel"][:, 6:])
    assert np.abs(log["imu_gyro"]).max() < 1.0


def test_joints_at_their_limits_are_noted():
    """What a resolution that was handed over gave up."""
    pattern = make_pattern(
        plan_steps(Gait(half_step=0.17, period=0.9), 1), PAPER_PENDULUM
    )
    fast = simulate(paper(), pattern, force=True)
    slow = readable_run(paper(), pattern)
    assert (slow.log["limited"] + slow.log["damped"]).any()
    names = ("damped", "limited", "loss")
    assert largest_difference(fast, slow, names) < 1e-3


@pytest.mark.parametrize(
    ("watch", "force", "cause"),
    [
        (Watch(tilt=0.3), (0.0, 900.0, 0.0), "tilted"),
        (Watch(com_error=0.05, tilt=3.0), (0.0, 900.0, 0.0), "from its reference"),
        (Watch(tilt=3.0, com_error=9.0), (0.0, 0.0, 4000.0), "lost the ground"),
    ],
)
def test_a_fall_is_the_same_fall(watch, force, cause):
    physics = SimulatorSettings(pushes=(Push(start=0.5, force=force, duration=0.5),))
    fast, slow = pair(physics=physics, watch=watch)
    assert fast.outcome.end is End.FELL
    assert cause in fast.outcome.cause
    assert str(fast.outcome) == str(slow.outcome)
    assert len(fast.log) == len(slow.log)


def test_progress_and_interrupts():
    """The user hears of it now and then, and can stop it."""
    times = []

    def progress(time: float) -> None:
        times.append(time)
        if len(times) == 3:
            raise KeyboardInterrupt

    run = simulate(paper(), SHORT, progress=progress)
    assert times == pytest.approx([0.098, 0.198, 0.298])
    assert run.outcome.end is End.ABORTED
    assert "interrupted" in run.outcome.cause
    assert len(run.log) == 150


def test_a_taken_log_has_as_many_rows_as_it_is_told():
    plant = SimulatedRobot(paper(), 0.002)
    log = Log(3)
    table = log.take(row_type(plant), 5)
    table["t"] = np.arange(5.0)
    log.grow(2)
    assert len(log) == 2
    assert log["t"].tolist() == [0.0, 1.0]
    assert "act" not in log


def test_places_in_handles_are_those_of_the_arrays():
    """The numbers that kernels know arrays by; those of the observer follow on."""
    first, last = tick_records.AT_OBSERVER, tick_records.AT_PHASES
    assert Arrays._fields[first + 1 : last] == (
        *("motors", "slow", "filtered", "last", "change", "forces", "fit"),
    )
    assert last - first == len(Observer._fields)
    assert len(Arrays._fields) - last == len(ONLINE_ARRAYS)
    for arrays, prefix, module in (
        (Arrays, "AT_", tick_records),
        (SceneArrays, "IN_", plant_kernels),
    ):
        for place, name in enumerate(arrays._fields):
            known = place > 3 if prefix == "AT_" else True
            observed = first + 1 < place < last if prefix == "AT_" else False
            if known and not observed:
                assert getattr(module, prefix + name.upper()) == place
