"""The log of a run: read by strangers, cut anywhere, written beside the loop."""

from __future__ import annotations

import errno
import itertools
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

import comwalk as cw
from comwalk.errors import RunError
from comwalk.robot.urdf_export import robot_urdf
from comwalk.run import Run
from comwalk.runs.mcap_file import Block, End, McapWriter, read_mcap
from comwalk.runs.mcap_log import CHUNK_TIME, MCAP_NAME, save_mcap
from comwalk.runs.run_log import inspect, repair, tables

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
    found = tables(run.recording)
    assert set(found) == TOPICS - {"/robot_description"}
    joints = [f"position.{n}" for n in run.robot.joints]
    values = np.stack([found["/joint_states"][n] for n in joints], axis=1)
    assert np.array_equal(values, run.log["joints"])
    assert np.array_equal(found["/zmp"]["point.y"], run.log["zmp"][:, 1])
    assert np.array_equal(found["/com"]["time"], run.log["t"].round(9))
    base = found["/tf"]["base_link.translation.x"]
    assert base == pytest.approx(run.log["qpos"][::10, 0], abs=1e-15)


# ---- Writing ----------------------------------------------------------------------


def test_written_later_it_has_the_same_bytes(run, tmp_path):
    again = tmp_path / MCAP_NAME
    period = run.settings["control"]["period"]
    save_mcap(again, run.log, run.robot, period, run.settings, str(run.outcome))
    assert again.read_bytes() == run.recording.read_bytes()


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


def test_a_stalled_disk_does_not_stop_the_walk(tmp_path, monkeypatch):
    """While the first chunk cannot be written, the robot walks past its end."""
    gone_on, write = threading.Event(), McapWriter.add_chunk

    def stalled(self, *args):
        assert gone_on.wait(60.0)
        write(self, *args)

    monkeypatch.setattr(McapWriter, "add_chunk", stalled)
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    last = pattern.duration - 0.2
    run = cw.simulate_pendulum(
        pattern,
        record=tmp_path / "a.mcap",
        progress=lambda t: gone_on.set() if t > last else None,
    )
    assert gone_on.is_set()
    assert inspect(tmp_path / "a.mcap").messages == 4 * len(run.log)


def test_a_full_disk_is_said_on_one_line(tmp_path, monkeypatch):
    def full(self, *args):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(McapWriter, "add_chunk", full)
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    with pytest.raises(RunError, match=r"a\.mcap: No space left"):
        cw.simulate_pendulum(pattern, record=tmp_path / "a.mcap")


def test_two_runs_do_not_share_a_log(run, tmp_path):
    pytest.importorskip("fcntl")
    path = tmp_path / "a.mcap"
    pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 1), cw.Pendulum())
    refused = []

    def second(time: float) -> None:
        if not refused:
            with pytest.raises(RunError, match="written by another run"):
                cw.simulate_pendulum(pattern, record=path)
            with pytest.raises(RunError, match="still being written"):
                repair(path)
            refused.append(time)

    assert cw.simulate_pendulum(pattern, record=path, progress=second).outcome.ok
    assert refused
    assert inspect(path).end.whole


# ---- Cut off ----------------------------------------------------------------------


def messages_of(path: Path) -> tuple[list[bytes], End]:
    """Return all messages that our reader finds, with all that is said of them."""
    found: list[bytes] = []
    end = End(False, 0, 0)
    for item in read_mcap(path):
        if isinstance(item, Block):
            edges = [*item.starts.tolist(), len(item.messages)]
            pairs = itertools.pairwise(edges)
            found += [item.messages[a:b] for a, b in pairs]
        elif isinstance(item, End):
            end = item
    return found, end


def cuts(size: int) -> list[int]:
    return sorted(random.Random(7).sample(range(size), 100))


def test_all_before_a_cut_is_recovered(run, tmp_path):
    """A hundred cuts: whole chunks by their places as the mcap package reads them."""
    whole = run.recording.read_bytes()
    everything, end = messages_of(run.recording)
    assert end.whole
    with run.recording.open("rb") as file:
        summary = make_reader(file).get_summary()
        total = summary.statistics.message_count
    chunks = [
        (c.chunk_start_offset + c.chunk_length, messages_in(c))
        for c in summary.chunk_indexes
    ]
    assert len(everything) == total == sum(many for _, many in chunks)
    path, further = tmp_path / MCAP_NAME, 0
    for cut in cuts(len(whole)):
        path.write_bytes(whole[:cut])
        found, end = messages_of(path)
        least = sum(many for last, many in chunks if last <= cut)
        assert not end.whole
        assert len(found) >= least
        assert found == everything[: len(found)]
        further += len(found) > least
        if found:
            repair(path)
            again, end = messages_of(path)
            assert end.whole
            assert again == found
            with path.open("rb") as file:
                reader = make_reader(file, validate_crcs=True)
                assert reader.get_summary().statistics.message_count == len(found)
        else:
            with pytest.raises(RunError, match="before its first message"):
                repair(path)
    assert further > 50  # most cuts are in a chunk, and give some of it too


def messages_in(chunk: ChunkIndex) -> int:
    """Return how many messages a chunk has, by the size of its indices."""
    heads = 15 * len(chunk.message_index_offsets)
    return (chunk.message_index_length - heads) // 16


def test_a_repaired_log_opens_elsewhere(run, tmp_path):
    path, whole = tmp_path / MCAP_NAME, run.recording.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    facts = repair(path)
    assert not facts.end.whole
    assert facts.outcome is None
    assert facts.settings["robot"] == "paper"
    for found in (by_rosbags(path), by_mcap(path)):
        assert {t: len(m) for t, m in found.items()} == {
            t.topic: t.messages for t in facts.topics
        }
    assert inspect(path).end.whole


def test_cut_in_the_summary_it_gets_its_bytes_back(run, tmp_path):
    path, whole = tmp_path / MCAP_NAME, run.recording.read_bytes()
    path.write_bytes(whole[:-20])
    assert repair(path).outcome == str(run.outcome)
    assert path.read_bytes() == whole


def test_a_whole_log_is_left_alone(run):
    before = run.recording.stat().st_mtime_ns
    assert repair(run.recording).end.whole
    assert run.recording.stat().st_mtime_ns == before


def test_what_stands_before_a_wrong_byte_is_read(run, tmp_path):
    path, data = tmp_path / MCAP_NAME, bytearray(run.recording.read_bytes())
    everything, _ = messages_of(run.recording)
    rng = random.Random(3)
    for _ in range(20):
        place = rng.randrange(100_000, len(data) - 20_000)
        broken = bytearray(data)
        broken[place] ^= 0xFF
        path.write_bytes(broken)
        found, _ = messages_of(path)
        assert found == everything[: len(found)]
    assert len(found) > 0


WALK = """
import sys, comwalk as cw
pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 40), cw.Pendulum())
cw.simulate(cw.load_robot("paper"), pattern, record=sys.argv[1])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal")
def test_a_killed_walk_leaves_its_log(tmp_path):
    """At most a chunk, and what was simulated since the last look, is lost."""
    path = tmp_path / MCAP_NAME
    process = subprocess.Popen([sys.executable, "-c", WALK, str(path)])
    deadline = time.monotonic() + 120
    while not (path.exists() and path.stat().st_size > 1_500_000):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    facts = repair(path)
    assert not facts.end.whole
    assert facts.duration > 2 * CHUNK_TIME
    found = by_rosbags(path)
    assert set(found) == TOPICS
    assert len(found["/com"]) == pytest.approx(500 * facts.duration, abs=1.5)
