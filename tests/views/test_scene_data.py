"""What there is to see of a run: rows, plan and model, from memory or from files."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest

from comwalk.errors import RunError
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.model import load_robot
from comwalk.run import simulate, simulate_pendulum
from comwalk.runs.columns import save_columns
from comwalk.runs.run_data import smoothed
from comwalk.views.scene_data import seen_of


@pytest.fixture(scope="module")
def walked():
    """A robot's single step."""
    gait = Gait(stand_time=0.1, start_time=0.4, stop_time=0.4)
    pattern = make_pattern(plan_steps(gait, 1), Pendulum())
    return simulate(load_robot("paper"), pattern)


@pytest.fixture(scope="module")
def folder(walked, tmp_path_factory):
    """The same run in a folder."""
    return walked.save(tmp_path_factory.mktemp("run"))


def test_smoothed_path_has_no_sway():
    """A sway of the window's period vanishes, the mean motion stays."""
    t = np.arange(0.0, 10.0, 0.01)
    path = np.column_stack([0.2 * t, 0.05 * np.sin(math.pi * t)])
    smooth = smoothed(path, t, window=2.0)
    assert smooth.shape == path.shape
    inner = slice(110, -110)
    assert np.abs(smooth[inner, 0] - path[inner, 0]).max() < 1e-9
    assert np.abs(smooth[inner, 1]).max() < 1e-3


def test_a_folder_shows_what_the_run_shows(walked, folder):
    """Columns, rows and plan survive the way through the files."""
    run, file = seen_of(walked), seen_of(folder)
    assert file.plan == walked.pattern.plan
    for a, b in zip(run.moment(700), file.moment(700), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)
    moment = file.moment(700)
    np.testing.assert_array_equal(moment.qpos, walked.log["qpos"][700])
    com = walked.log["com_true"][700]
    np.testing.assert_allclose(moment.com, com, rtol=1e-6)
    assert moment.phase is Phase(int(walked.log["phase"][700]))


def test_rows_are_equally_far_apart_in_time(walked):
    """Pictures at 25 Hz of a record at 500 Hz: every twentieth row."""
    recording = seen_of(walked)
    rows = recording.rows(25.0)
    assert set(np.diff(rows)) == {20}
    assert rows[0] == 0
    assert len(recording.t) - rows[-1] <= 20
    assert recording.row(recording.t[123]) == 123
    assert recording.row(1e9) == len(recording.t) - 1


def test_meshes_of_the_robot_come_back():
    """A run leaves meshes out; they are loaded anew, with the same bodies."""
    pytest.importorskip("jvrc_description")
    robot = load_robot("jvrc1")
    pattern = make_pattern(plan_steps(Gait(), 1), Pendulum())
    run = simulate(robot, pattern, force=True)
    bare, dressed = seen_of(run), seen_of(run, geometry=True)
    assert bare.model.nmesh == 0
    assert dressed.model.nmesh > 10
    assert dressed.model.nq == bare.model.nq
    places = []
    for model in (bare.model, dressed.model):
        data = mujoco.MjData(model)
        data.qpos[:] = bare.moment(50).qpos
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos.copy())
    np.testing.assert_allclose(places[0], places[1], atol=1e-9)


def test_a_robot_that_is_gone_is_shown_as_it_was_recorded(folder, tmp_path):
    """The run's own model stands in for a robot that is not found."""
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("run.npz", "scene.mjb"):
        (copy / name).write_bytes((folder / name).read_bytes())
    summary = json.loads((folder / "summary.json").read_text())
    summary["settings"]["robot"] = "/nowhere/robot.urdf"
    (copy / "summary.json").write_text(json.dumps(summary))
    recording = seen_of(copy, geometry=True)
    assert recording.model.nbody == seen_of(folder).model.nbody
    (copy / "summary.json").write_text("{")
    assert seen_of(copy, geometry=True).plan is None


def test_what_cannot_be_seen_is_refused(folder, tmp_path):
    """A pendulum, a missing folder, missing columns, configurations of no numbers."""
    pattern = make_pattern(plan_steps(Gait(), 1), Pendulum())
    with pytest.raises(RunError, match="simplified model"):
        seen_of(simulate_pendulum(pattern))
    with pytest.raises(RunError, match="has no run"):
        seen_of(tmp_path / "nowhere")
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "scene.mjb").write_bytes((folder / "scene.mjb").read_bytes())
    with np.load(folder / "run.npz") as file:
        columns = dict(file)
    reference = columns.pop("zmp_ref")
    save_columns(broken / "run.npz", columns)
    with pytest.raises(RunError, match="lacks zmp_ref"):
        seen_of(broken)
    columns |= {"zmp_ref": reference, "qpos": columns["qpos"].copy()}
    columns["qpos"][5, 3] = math.nan
    save_columns(broken / "run.npz", columns)
    with pytest.raises(RunError, match="no numbers"):
        seen_of(broken)
