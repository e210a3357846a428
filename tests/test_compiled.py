"""Kernels are compiled once, in folders that can be written, and it is said."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import numpy as np
from comwalk.lookup import minimum_jerk
print(minimum_jerk(0.5), minimum_jerk.stats.cache_hits)
"""


def run_with(cache: Path) -> subprocess.CompletedProcess:
    """Run a program that needs one kernel, with a folder for what is compiled."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )


def test_compiling_is_said_once_and_loading_is_quiet(tmp_path):
    """On standard error, so that what is for programs stays so."""
    first, second = run_with(tmp_path), run_with(tmp_path)
    assert first.stdout.startswith("(0.5, 1.875) Counter()")
    assert first.stderr.count("compiling for this machine, once") == 1
    assert second.stdout.startswith("(0.5, 1.875)")
    assert "Counter()" not in second.stdout
    assert second.stderr == ""


WITHOUT = """
import sys
sys.modules["numba"] = None
import comwalk as cw
feet = {"left": cw.Foothold(0, 0.09), "right": cw.Foothold(0, -0.09)}
plan = cw.FootstepPlan(**feet, stand_time=0.05)
robot = cw.load_robot("paper")
run = cw.simulate(robot, cw.make_pattern(plan, cw.default_pendulum(robot)))
from comwalk.compiled import COMPILES
print(run.outcome, COMPILES, len(run.log))
"""


def test_without_numba_the_readable_loop_walks():
    """An installation that lacks it is slower, and that is all."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=True
    )
    assert done.stdout.split("\n")[0] == "completed in 0.10 s False 50"
    assert done.stderr == ""
