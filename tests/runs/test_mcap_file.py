"""A run as ROS 2 messages: read by strangers, written at the end."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

import comwalk as cw
from comwalk.errors import RunError
from comwalk.robot.urdf_export import robot_urdf
from comwalk.run import Run
from comwalk.runs.columns import rows_left
from comwalk.runs.export import tables
from comwalk.runs.mcap_file import MCAP_NAME, inspect

TOPICS = {
    *("/joint_states", "/joint_commands", "/tf", "/tf_static", "/robot_description"),
    *("/com", "/com_ref", "/zmp", "/zmp_ref"),
    *("/l_sole/wrench", "/r_sole/wrench", "/imu"),
}


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    """A step, pushed and noisy, with its log."""
    robot = cw.load_robot("paper")
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    physics = cw.SimulatorSettings(noise=1.0)
    path = tmp_path_factory.mktemp("run") / MCAP_NAME
    return cw.simulate(robot, pattern, physics=physics, record=path)


def by_rosbags(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, stamp, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    return found


def by_mcap(path: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with path.open("rb") as file:
        reader = make_reader(
            file, validate_crcs=True, decoder_factories=[DecoderFactory()]
        )
        for _, channel, record, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((record.log_time, message))
    return found


@pytest.fixture(scope="module", params=[by_rosbags, by_mcap])
def read(request, run) -> dict[str, list]:
    return request.param(run.recording)


def xyz(value) -> list[float]:
    return [value.x, value.y, value.z]


def xyzw(value) -> list[float]:
    return [*xyz(value), value.w]


# ---- Two strangers read it --------------------------------------------------------


def test_every_topic_is_there(read, run):
    rows = len(run.log)
    assert set(read) == TOPICS
    once = {"/robot_description", "/tf_static"}
    assert {len(read[t]) for t in once} == {1}
    assert {len(read[t]) for t in TOPICS - once - {"/tf"}} == {rows}
    assert len(read["/tf"]) == -(-rows // 10)


def test_times_are_those_of_the_run(read, run):
    stamps = np.rint(1e9 * run.log["t"]).astype(int).tolist()
    for topic in TOPICS - {"/robot_description", "/tf_static", "/tf"}:
        assert [stamp for stamp, _ in read[topic]] == stamps
        inner = [m.header.stamp for _, m in read[topic]]
        assert [s.sec * 10**9 + s.nanosec for s in inner] == stamps
    assert [stamp for stamp, _ in read["/tf"]] == stamps[::10]


def test_joints_are_equal(read, run):
    for topic, fields in {
        "/joint_states": {
            "position": "joints",
            "velocity": "joint_rates",
            "effort": "torques_true",
        },
        "/joint_commands": {"position": "joint_set_points"},
    }.items():
        assert all(tuple(m.name) == run.robot.joints for _, m in read[topic])
        for field, column in fields.items():
            values = np.array([getattr(m, field) for _, m in read[topic]])
            assert np.array_equal(values, run.log[column])


@pytest.mark.parametrize("name", ["com", "com_ref", "zmp", "zmp_ref"])
def test_points_are_equal(name, read, run):
    points = np.array([xyz(m.point) for _, m in read[f"/{name}"]])
    expected = np.zeros_like(points)
    expected[:, : run.log[name].shape[1]] = run.log[name]
    assert np.array_equal(points, expected)
    assert {m.header.frame_id for _, m in read[f"/{name}"]} == {"odom"}


def test_imu_is_equal(read, run):
    messages = [m for _, m in read["/imu"]]
    turns = np.array([xyzw(m.orientation) for m in messages])
    assert np.array_equal(turns[:, [3, 0, 1, 2]], run.log["imu_quat"])
    rates = np.array([xyz(m.angular_velocity) for m in messages])
    assert np.array_equal(rates, run.log["imu_gyro"])
    rates = np.array([xyz(m.linear_acceleration) for m in messages])
    assert np.array_equal(rates, run.log["imu_acc"])


@pytest.mark.parametrize(("side", "k"), [("l", 0), ("r", 1)])
def test_wrenches_are_the_same_ones_about_the_sole(side, k, read, run):
    """Force and moment about the world's origin do not depend on the frame."""
    model, data = run.robot.model, mujoco.MjData(run.robot.model)
    messages = [m for _, m in read[f"/{side}_sole/wrench"]]
    assert {m.header.frame_id for m in messages} == {f"{side}_sole"}

    def in_world(site: int, force, torque) -> np.ndarray:
        R, p = data.site_xmat[site].reshape(3, 3), data.site_xpos[site]
        f = R @ force
        return np.array([f, R @ torque + np.cross(p, f)])

    sensor = run.robot.feet[list(run.robot.feet)[k]].sensor_site
    for row in range(0, len(messages), 97):
        data.qpos[:] = run.log["qpos"][row]
        mujoco.mj_kinematics(model, data)
        felt, wrench = run.log["wrenches"][row, k], messages[row].wrench
        told = xyz(wrench.force), xyz(wrench.torque)
        ours = in_world(model.site(f"{side}_sole").id, *told)
        theirs = in_world(sensor, felt[:3], felt[3:])
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_frames_are_a_tree_that_leads_to_every_link(read, run):
    """Followed from odom, it gives MuJoCo's poses of links and marked frames."""
    model, data = run.robot.model, mujoco.MjData(run.robot.model)
    fixed = read["/tf_static"][0][1].transforms
    for k in range(0, len(read["/tf"]), 40):
        data.qpos[:] = run.log["qpos"][10 * k]
        mujoco.mj_kinematics(model, data)
        poses = {"odom": (np.zeros(3), Rotation.identity())}
        for t in [*read["/tf"][k][1].transforms, *fixed]:
            p, R = poses[t.header.frame_id]
            arm = xyz(t.transform.translation)
            turn = Rotation.from_quat(xyzw(t.transform.rotation))
            poses[t.child_frame_id] = p + R.apply(arm), R * turn
        for i in range(1, model.nbody):
            p, R = poses[model.body(i).name]
            np.testing.assert_allclose(p, data.xpos[i], atol=1e-12)
            np.testing.assert_allclose(R.as_matrix().ravel(), data.xmat[i], atol=1e-12)
        for frame in ("l_sole", "r_sole", "imu"):
            p, R = poses[frame]
            np.testing.assert_allclose(p, data.site(frame).xpos, atol=1e-12)
            np.testing.assert_allclose(
                R.as_matrix().ravel(), data.site(frame).xmat, atol=1e-12
            )


def test_the_robot_is_described(read, run):
    assert read["/robot_description"][0][1].data == robot_urdf(run.robot)


def test_tables_hold_the_same_numbers(run):
    found = tables(run.log.columns, run.robot)
    assert set(found) == TOPICS - {"/robot_description", "/tf_static"}
    joints = [f"position.{n}" for n in run.robot.joints]
    values = np.stack([found["/joint_states"][n] for n in joints], axis=1)
    assert np.array_equal(values, run.log["joints"])
    assert np.array_equal(found["/zmp"]["point.y"], run.log["zmp"][:, 1])
    assert np.array_equal(found["/com"]["time"], run.log["t"].round(9))
    base = found["/tf"]["base_link.translation.x"]
    assert base == pytest.approx(run.log["qpos"][:, 0], abs=1e-15)


# ---- Writing ----------------------------------------------------------------------


def test_the_rows_are_gone_once_the_messages_are_there(run):
    assert [x.name for x in run.recording.parent.iterdir()] == [MCAP_NAME]
    facts = inspect(run.recording)
    assert facts.outcome == str(run.outcome)
    assert facts.settings == json.loads(json.dumps(run.settings))
    assert facts.duration == pytest.approx(run.log["t"][-1])


def test_nothing_is_written_unless_asked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    assert cw.simulate_pendulum(pattern).recording is None
    assert not list(tmp_path.iterdir())


def test_the_simplified_model_has_points_alone(tmp_path):
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    run = cw.simulate_pendulum(pattern, record=tmp_path / "a.mcap")
    found = by_rosbags(tmp_path / "a.mcap")
    assert set(found) == {"/com", "/com_ref", "/zmp", "/zmp_ref"}
    zmp = np.array([xyz(m.point) for _, m in found["/zmp"]])
    assert np.array_equal(zmp[:, :2], run.log["zmp"])


def test_a_full_disk_is_said_on_one_line(tmp_path, monkeypatch):
    """Neither a part of the file is left, nor are the rows lost."""

    def full(self, *args, **named):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Writer, "add_message", full)
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    with pytest.raises(RunError, match=r"a\.mcap: No space left"):
        cw.simulate_pendulum(pattern, record=tmp_path / "a.mcap")
    assert sorted(x.name for x in tmp_path.iterdir()) == ["a.json", "a.npy"]
    assert rows_left(tmp_path / "a.npy")["t"][-1] > pattern.duration - 0.01


def test_an_interrupted_walk_leaves_its_messages(tmp_path):
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())

    def interrupt(time: float) -> None:
        if time > 2.0:
            raise RuntimeError

    with pytest.raises(RuntimeError):
        cw.simulate_pendulum(pattern, record=tmp_path / "a.mcap", progress=interrupt)
    facts = inspect(tmp_path / "a.mcap")
    assert facts.outcome is None
    assert facts.duration > 1.9


def test_a_cut_file_is_refused_with_the_way_out(run, tmp_path):
    whole = run.recording.read_bytes()
    for size in (len(whole) // 2, len(whole) - 20, 30):
        (tmp_path / MCAP_NAME).write_bytes(whole[:size])
        with pytest.raises(RunError, match="cut off or no MCAP file") as caught:
            inspect(tmp_path / MCAP_NAME)
        assert "run.npz" in str(caught.value)
