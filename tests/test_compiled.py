"""Kernels are compiled once, in folders that can be written, and it is said."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import numpy as np
from comwalk.pattern.reference import minimum_jerk
print(minimum_jerk(0.5), minimum_jerk.dispatcher.stats.cache_hits)
"""


def run_with(cache: Path, program: str = PROGRAM) -> subprocess.CompletedProcess:
    """Run a program that needs one kernel, with a folder for what is compiled."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", program],
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


def test_a_kernel_without_a_place_to_be_kept_still_runs(tmp_path):
    """As where neither the installation, the home nor any other folder is writable."""
    nowhere = (
        "from numba.core import caching\n"
        "for name in dir(caching):\n"
        "    if name.endswith('CacheImpl'):\n"
        "        getattr(caching, name)._locator_classes = []\n"
    )
    result = run_with(tmp_path, nowhere + PROGRAM)
    assert result.stdout.startswith("(0.5, 1.875)")
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.rglob("*.nbc"))


def test_a_kernel_that_cannot_be_kept_still_runs(tmp_path):
    """As on a full disk, which here is a limit on the size of files."""
    pytest.importorskip("resource")
    full = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
    result = run_with(tmp_path, full + PROGRAM)
    assert result.stdout.startswith("(0.5, 1.875)")
    assert "Traceback" not in result.stderr
