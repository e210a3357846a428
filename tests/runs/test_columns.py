"""The columns of a run: what its file keeps, and what a killed run leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import comwalk as cw
from comwalk.cli.app import main
from comwalk.errors import RunError
from comwalk.runs.columns import load_columns, rows_left, save_columns
from comwalk.runs.recorder import recover


def loaded(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return load_columns(file)


def test_the_state_is_exact_and_the_rest_is_float32(tmp_path):
    rng = np.random.default_rng(1)
    columns = {"qpos": rng.normal(size=(50, 9)), "zmp": rng.normal(size=(50, 2))}
    save_columns(tmp_path / "a.npz", {**columns, "phase": np.arange(50)})
    found = loaded(tmp_path / "a.npz")
    assert np.array_equal(found["qpos"], columns["qpos"])
    assert np.array_equal(found["zmp"], columns["zmp"].astype(np.float32))
    assert np.array_equal(found["phase"], np.arange(50))


@pytest.mark.parametrize("noise", [0.0, 1e-12])
def test_repeated_columns_are_stored_once(noise, tmp_path):
    """In any order; a single number that differs makes it a column of its own."""
    qpos = np.random.default_rng(2).normal(size=(50, 9))
    joints = qpos[:, [8, 3, 5]].copy()
    joints[7, 1] += noise
    save_columns(tmp_path / "a.npz", {"qpos": qpos, "joints": joints})
    with np.load(tmp_path / "a.npz") as file:
        assert ("joints_in_qpos" in file) == (noise == 0.0)
    np.testing.assert_allclose(loaded(tmp_path / "a.npz")["joints"], joints, rtol=1e-6)


def test_a_file_without_rows_is_refused(tmp_path):
    (tmp_path / "run.npy").write_bytes(b"")
    with pytest.raises(RunError, match="no rows"):
        rows_left(tmp_path / "run.npy")
    np.save(tmp_path / "run.npy", np.zeros(5, [("t", float)]))
    with pytest.raises(RunError, match="before its first row"):
        rows_left(tmp_path / "run.npy")


def test_two_runs_do_not_share_rows(tmp_path):
    pytest.importorskip("fcntl")
    path = tmp_path / "run.npy"
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    refused = []

    def second(now: float) -> None:
        if not refused:
            with pytest.raises(RunError, match="written by another run"):
                cw.simulate_pendulum(pattern, record=path)
            with pytest.raises(RunError, match="still being written"):
                recover(tmp_path)
            refused.append(now)

    run = cw.simulate_pendulum(pattern, record=path, progress=second)
    assert refused
    assert np.array_equal(rows_left(path)["zmp"], run.log["zmp"][:-1])
    assert recover(tmp_path)
    assert np.array_equal(loaded(tmp_path / "run.npz")["t"], run.log["t"][:-1])


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal")
def start_walk(folder: Path) -> subprocess.Popen:
    """Return a process that walks 60 steps, after two seconds of them."""
    words = ["-m", "comwalk", "walk", "--steps", "60", "--out", str(folder)]
    path = os.pathsep.join(sys.path)
    process = subprocess.Popen(
        [sys.executable, *words], env={**os.environ, "PYTHONPATH": path}
    )
    deadline = time.monotonic() + 120

    def walked() -> float:
        try:
            return float(rows_left(folder / "run.npy")["t"][-1])
        except (RunError, IndexError):
            return 0.0

    while walked() < 2.0:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return process


def test_a_terminated_walk_is_saved_alone_in_its_folder(tmp_path, capsys):
    """SIGTERM is as Ctrl-C; of the run before, nothing is left but the user's notes."""
    folder = tmp_path / "run"
    assert main(["walk", "--steps", "1", "--out", str(folder)]) == 0
    assert main(["export", str(folder), "--csv"]) == 0
    (folder / "notes.txt").write_text("mine")
    (folder / "csv" / "mine.txt").write_text("mine")
    process = start_walk(folder)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=60) == 1
    told = json.loads((folder / "summary.json").read_text())
    assert told["outcome"] == "aborted"
    assert told["cause"] == "interrupted by the user"
    times = loaded(folder / "run.npz")["t"]
    assert times[-1] == pytest.approx(told["time_s"], abs=0.01)
    names = {file.name for file in folder.iterdir()}
    assert {"notes.txt", "walk.png", "run.npz", "csv"} <= names
    assert not names & {"run.npy", "run.json", "run.mcap"}
    assert [file.name for file in (folder / "csv").iterdir()] == ["mine.txt"]


def test_a_killed_walk_leaves_its_rows(tmp_path, capsys):
    """Its columns are saved by `log`, which makes the messages of them, too."""
    folder = tmp_path / "run"
    process = start_walk(folder)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert main(["log", str(folder), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["outcome"] is None
    assert told["settings"]["robot"] == "paper"
    columns = loaded(folder / "run.npz")
    np.testing.assert_allclose(np.diff(columns["t"]), 0.002, atol=1e-9)
    assert told["duration_s"] == pytest.approx(columns["t"][-1])
    assert columns["t"][-1] >= 2.0
    assert not (folder / "run.npy").exists()
