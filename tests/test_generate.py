"""Generated motions are what their columns say, and what the robot can do."""

import itertools
import json

import numpy as np
import pytest

from comwalk.cli.app import main
from comwalk.errors import ParameterError, PlanError
from comwalk.generate import Ranges, generate
from comwalk.pattern.reference import Phase
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import load_robot

ROBOT = load_robot("paper")
QUICK = Ranges(steps=2, duration=4.0, period=0.04)


@pytest.fixture(scope="module", params=["gaits", "dances"])
def dataset(request):
    return generate(ROBOT, request.param, 3, ranges=QUICK, seed=5)


def rows_of(dataset):
    """Return each motion's rows."""
    starts = dataset.columns["starts"]
    return [slice(a, b) for a, b in itertools.pairwise(starts)]


def test_joints_put_com_and_feet_where_the_columns_say(dataset):
    """Forward kinematics of the configurations, by MuJoCo."""
    c, kinematics = dataset.columns, Kinematics(ROBOT)
    parts = c["base_position"], c["base_orientation"], c["joint_positions"]
    for k, q in enumerate(np.concatenate(parts, axis=1)):
        posture = kinematics.posture(q)
        np.testing.assert_allclose(posture.com, c["com"][k], atol=1e-3)
        for i, foot in enumerate(("left_foot", "right_foot")):
            np.testing.assert_allclose(posture.ends[i], c[foot][k, :3], atol=2e-3)


def test_velocities_are_those_of_the_positions(dataset):
    """Central differences, but where a foot lifts or lands."""
    c = dataset.columns
    for rows in rows_of(dataset):
        t = c["time"][rows]
        for name in ("joint_positions", "base_position", "com"):
            values = c[name][rows]
            rate = {"base_position": "base_velocity"}.get(
                name, name.replace("positions", "velocities")
            )
            rate = "com_velocity" if name == "com" else rate
            measured = (values[2:] - values[:-2]) / (t[2:] - t[:-2])[:, None]
            stated = c[rate][rows][1:-1, : values.shape[1]]
            assert np.median(np.abs(measured - stated)) < 5e-3
            assert np.percentile(np.abs(measured - stated), 90) < 0.06


def test_limits_contacts_and_shapes(dataset):
    c = dataset.columns
    q, v = c["joint_positions"], c["joint_velocities"]
    assert ((q >= ROBOT.lower) & (q <= ROBOT.upper)).all()
    assert (np.abs(v) <= ROBOT.speed).all()
    assert (c["left_foot"][c["contacts"][:, 0], 2] < 1e-9).all()
    assert (c["right_foot"][c["contacts"][:, 1], 2] < 1e-9).all()
    swings = c["phase"] >= Phase.SINGLE_LEFT
    swings &= c["phase"] <= Phase.SINGLE_RIGHT
    assert (c["contacts"].sum(axis=1) == np.where(swings, 1, 2)).all()
    assert tuple(c["joint_names"]) == ROBOT.joints
    assert dataset.rows == len(c["time"]) == len(c["motion"])
    for number, rows in enumerate(rows_of(dataset)):
        assert (c["motion"][rows] == number).all()
        np.testing.assert_allclose(np.diff(c["time"][rows]), QUICK.period)
        assert c["time"][rows][0] == 0.0


def test_commands_are_walked():
    wide = Ranges(steps=4, period=0.1, speed=0.2, side=0.0, turn=0.0)
    found = generate(ROBOT, "gaits", 4, ranges=wide, seed=1)
    c, speeds = found.columns, found.columns["commands"][:, 0]
    assert len(np.unique(speeds)) == 4
    for rows, speed in zip(rows_of(found), speeds, strict=True):
        gone = c["com"][rows][-1, 0] - c["com"][rows][0, 0]
        assert gone == pytest.approx(4 * speed, rel=0.02, abs=1e-3)  # T = 1 s


def test_the_same_seed_gives_the_same_motions():
    one, same, other = (
        generate(ROBOT, "gaits", 1, ranges=QUICK, seed=seed) for seed in (3, 3, 4)
    )
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, same.columns[name])
    assert not np.array_equal(one.columns["commands"], other.columns["commands"])


def test_what_cannot_be_followed_is_drawn_again_or_refused():
    """Walks that are faster than any rule serves."""
    with pytest.raises(PlanError, match="narrower"):
        generate(ROBOT, "gaits", 2, ranges=Ranges(speed=9.0, side=9.0, turn=9.0))


def test_bad_numbers_are_refused():
    with pytest.raises(ParameterError, match="count"):
        generate(ROBOT, "gaits", 0)
    with pytest.raises(ParameterError, match="kind"):
        generate(ROBOT, "jumps", 1)
    with pytest.raises(ParameterError, match="period"):
        Ranges(period=0.0)


def test_command_writes_the_file(tmp_path, capsys):
    path = tmp_path / "new" / "walks.npz"
    line = ["generate", "gaits", "paper", "--count", "2", "--steps", "1", "--seed", "7"]
    assert main([*line, "--out", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    with np.load(path, allow_pickle=False) as file:
        assert facts["rows"] == len(file["time"])
        assert facts["gaits"] == len(file["starts"]) - 1 == 2
        assert file["seed"] == 7
    assert main([*line, "--out", str(path)]) == 0
    assert "2 gaits of paper" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--count", "0"], "count"),
        (["--out", "walks.csv"], ".npz"),
        (["--duration", "1"], "duration"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["generate", "gaits", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
