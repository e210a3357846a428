"""Kernels as plain Python, as a debugger and a coverage tool see them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

import comwalk as cw
from comwalk.control import WalkingController
from comwalk.pattern import Phase
from comwalk.walking import SimulatedRobot, WholeBody

PERIOD, TICKS = 0.002, 50
SINGLE = Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT


def walked(actuation: str) -> np.ndarray:
    """Return what the paper's robot measures, decides and commands for 0.1 s.

    A foot leaves the ground in the middle, and the law counts from the start.
    """
    robot = cw.load_robot("paper", actuation=actuation)
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 2), cw.Pendulum())
    settings = cw.BodySettings(calibration=False)
    body = WholeBody(robot, PERIOD, None, settings)
    controller = WalkingController(cw.Gains(), cw.ControlSettings(), PERIOD)
    plant = SimulatedRobot(robot, PERIOD)
    lift = next(x.start for x in pattern.phases if x.phase in SINGLE)
    begin = lift - 0.5 * TICKS * PERIOD
    reference = pattern.at(begin)
    controller.reset(reference.com, reference.zmp)
    command = body.start(reference)
    ticker = body.ticker(pattern, controller)
    plant.place(body.configuration)
    sensors, rows = plant.start(command), []
    for tick in range(TICKS):
        assert ticker.step(begin + tick * PERIOD, sensors) is None
        plant.write(ticker.command)
        sensors = plant.read()
        measured, law = body.measured, controller.output()
        command = ticker.command
        sent = [command.positions, command.velocities]
        if command.torques is not None:
            sent.append(command.torques)
        rows.append(np.hstack([measured.com, measured.zmp, law.u, *sent]))
    return np.array(rows)


@pytest.mark.parametrize("actuation", ["position", "pd"])
def test_uncompiled_kernels_do_the_same(tmp_path, actuation):
    """0.1 s in a process of its own without numba's compiler, to 1e-9."""
    assert not config.DISABLE_JIT
    folder, saved = Path(__file__).parent, tmp_path / "plain.npy"
    code = (
        "import sys, numpy as np; from numba import config; assert config.DISABLE_JIT\n"
        f"sys.path.insert(0, {str(folder)!r}); import test_uncompiled\n"
        f"np.save({str(saved)!r}, test_uncompiled.walked({actuation!r}))"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    plain, compiled = np.load(saved), walked(actuation)
    assert plain.shape == compiled.shape
    assert np.abs(np.diff(compiled, axis=0)).max() > 1e-2  # it moves
    assert plain == pytest.approx(compiled, abs=1e-9)
