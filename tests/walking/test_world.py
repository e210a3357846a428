"""Walks in the world of the robot's own file: what is kept is touched, and replays."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robots import toy_scene

import comwalk
from comwalk.certificates.defaults import walk_pattern
from comwalk.cli import main
from comwalk.control.settings import SimulatorSettings
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.replay import replay
from comwalk.robot.model import load_robot
from comwalk.run import simulate
from comwalk.runs.run_data import read_summary
from comwalk.runs.topics import streams_of
from comwalk.sides import Side
from comwalk.views.page_server import open_server
from comwalk.views.render import _height
from comwalk.views.scene import Stage
from comwalk.views.scene_data import highest_box, seen_of, whole_state
from comwalk.walking.mujoco_scene import build_scene

PAPER = (Path(comwalk.__file__).parent / "robots" / "paper.xml").read_text()
FLOOR = '<geom name="floor" type="plane" size="0 0 0.05"/>'
CRATE = (
    '<body name="crate" pos="{}"><freejoint/>'
    '<geom type="box" size="0.1 0.1 0.1"/></body>'
)
BALL = (
    '<body name="ball" pos="{}"><freejoint/><geom name="ball" size="0.1" density="100" '
    'friction="0.4 0.01 0.002"/></body>'
)
PATTERN = make_pattern(plan_steps(Gait(), 4), Pendulum())


def paper_in(folder, around, qpos=""):
    """Return the paper's robot in a world whose joints its keyframe begins with."""
    text = PAPER.replace("<worldbody>", f"<worldbody>{around}")
    keys = re.search("<keyframe>.*</keyframe>", text, re.DOTALL)[0]
    text = text.replace(keys, keys.replace('qpos="', f'qpos="{qpos} ', 1))
    file = folder / "paper_in_a_world.xml"
    file.write_text(text)
    return load_robot(file)


def walked(folder, around="", qpos="", **options):
    """Walk four steps of 0.2 m on the paper's robot, and return the run."""
    return simulate(paper_in(folder, FLOOR + around, qpos), PATTERN, **options)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Return the walk with nothing around."""
    return walked(tmp_path_factory.mktemp("plain"))


def same(run, other):
    """Return whether two runs have the same columns, as far as both are the robot's."""
    for name, column in other.log.columns.items():
        if name != "compute_s":
            own = run.log[name]
            own = own[:, : column.shape[1]] if name in ("qpos", "qvel") else own
            np.testing.assert_array_equal(own, column, err_msg=name)
    return True


def test_what_is_far_away_changes_nothing(tmp_path, plain):
    """Neither what stands nor what can move; not to the last bit."""
    post = '<geom type="cylinder" size="0.1 0.5" pos="0 4 0.5"/>'
    run = walked(tmp_path, post + CRATE.format("5 5 0.1"), "5 5 0.1 1 0 0 0")
    assert same(run, plain)
    assert run.log["qpos"].shape[1] == plain.log["qpos"].shape[1] + 7


def test_nothing_changes_by_torque_either(tmp_path):
    """A robot of another file, on soft joints, without ankle sensors."""
    runs = []
    for around in ("", CRATE.format("5 5 0.1")):
        robot = load_robot(toy_scene(tmp_path, FLOOR + around))
        run = simulate(robot, walk_pattern(robot, 2))
        assert run.outcome.ok
        runs.append(run)
    assert runs[1].settings["physics"]["scene"]
    assert same(runs[1], runs[0])
    result = replay(runs[1].save(tmp_path / "run"))
    assert result.position_difference == result.velocity_difference == 0.0


def test_a_ball_in_the_way_is_kicked_and_replays(tmp_path, plain):
    """It lies still until the foot comes, and ends farther than the foot goes."""
    physics = SimulatorSettings(noise=1.0, command_delay=0.004, terrain=0.003)
    run = walked(
        tmp_path, BALL.format("9 9 9"), "0.4 0.09 0.1 1 0 0 0", physics=physics
    )
    ball, start = run.log["qpos"][:, -7:], run.log["t"]
    place = [0.4 + 0.01043578863, 0.09, 0.1]  # the keyframe has the robot 1 cm behind
    assert ball[0, :3] == pytest.approx(place, abs=1e-9)
    moving = np.hypot(*(ball[:, :2] - ball[0, :2]).T) > 0.01
    assert 1.0 < start[np.argmax(moving)] < 3.5
    assert ball[-1, 0] > plain.log["qpos"][-1, 0] + 0.3
    assert run.scene.geom("world/ball").friction.tolist() == [0.4, 0.01, 0.002]
    result = replay(run.save(tmp_path / "run"))
    assert result.ticks == len(run.log)
    assert result.position_difference == result.velocity_difference == 0.0


def test_a_ball_that_was_thrown_flies(tmp_path):
    """Free fall from the first row on; it waits while the robot settles."""
    key = '<keyframe><key qpos="{}" qvel="0 1 4 0 0 0"/></keyframe>'
    zeros = " ".join(["0"] * 26)
    file = toy_scene(
        tmp_path,
        FLOOR + BALL.format("0 0 0"),
        more=key.format(f"0 2 1 1 0 0 0 0 0 0.9 1 0 0 0 {zeros}").replace(
            '0 0 0"/>', f'0 0 0 0 0 0 0 0 0 {zeros}"/>'
        ),
    )
    robot = load_robot(file)
    run = simulate(robot, walk_pattern(robot, 1))
    t, ball = run.log["t"][:200], run.log["qpos"][:200, -7:]
    expected = [0 * t, 2 + t, 1 + 4 * t - 0.5 * 9.81 * t**2]
    assert ball[:, :3] == pytest.approx(np.stack(expected, axis=1), abs=3e-3)


def heights_of(run, side):
    """Return the height of a sole's centre [m], by the simulator, at each row."""
    data, found = mujoco.MjData(run.scene), []
    site = run.scene.site(f"{side.value[0]}_sole_centre").id
    for q in run.log["qpos"]:
        data.qpos[:] = q
        mujoco.mj_kinematics(run.scene, data)
        found.append(float(data.site_xpos[site, 2]))
    return np.array(found)


def test_a_step_in_the_way_is_stepped_on(tmp_path, plain):
    """A platform of 5 mm from 0.3 m on: both soles end on it."""
    step = '<geom type="box" size="2 1 0.0025" pos="2.3 0 0.0025"/>'
    run = walked(tmp_path, step)
    assert run.outcome.ok
    for side in Side:
        assert heights_of(run, side)[-1] == pytest.approx(0.005, abs=2e-4)
        assert heights_of(plain, side)[-1] == pytest.approx(0.0, abs=2e-4)


def test_a_wall_stops_the_robot(tmp_path, plain):
    run = walked(tmp_path, '<geom type="box" size="0.1 1 1" pos="0.6 0 1"/>')
    assert run.log["qpos"][:, 0].max() < 0.6 < plain.log["qpos"][-1, 0]


def test_shanks_touch_what_feet_do_not(tmp_path):
    """A bar at the height of the shanks: the file's shape touches it."""
    bar = '<geom type="capsule" fromto="0.35 -1 0.4 0.35 1 0.4" size="0.02"/>'
    shank = '<geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.05" density="0"/>'
    knees = [f'<body name="link_{side}_knee_y"' for side in ("left", "right")]

    def with_shanks(text):
        for knee in knees:
            start = text.index(knee)
            end = text.index("<inertial", start)
            text = text[:end] + shank + text[end:]
        return text

    stopped = {}
    for name, change in (("soles", lambda t: t), ("shanks", with_shanks)):
        robot = load_robot(toy_scene(tmp_path, FLOOR + bar, change=change))
        run = simulate(robot, walk_pattern(robot, 4), force=True, adapt=False)
        stopped[name] = not run.outcome.ok
    assert stopped == {"soles": False, "shanks": True}


def test_the_world_can_be_left_out(tmp_path, plain):
    wall = '<geom type="box" size="0.1 1 1" pos="0.6 0 1"/>'
    run = walked(tmp_path, wall, physics=SimulatorSettings(scene=False))
    assert same(run, plain)


def test_the_friction_setting_is_for_floor_and_soles(tmp_path):
    """What is around has the file's; where it has priority, it has it over soles."""
    ice = '<geom name="ice" size="0.1" pos="3 0 0" friction="0.1" priority="1"/>'
    file = toy_scene(tmp_path, FLOOR + ice + BALL.format("3 3 0"))
    model = build_scene(load_robot(file), SimulatorSettings(friction=0.3))
    assert model.geom("world/ice").friction[0] == 0.1
    assert model.geom("comwalk_floor").friction[0] == 0.3
    soles = model.geom_priority == 1
    assert soles.sum() == 2
    assert set(model.geom_friction[soles, 0]) == {0.3}
    assert model.geom("world/ice").priority == 2


def test_a_run_in_a_world_is_seen_and_told(tmp_path):
    """Pictures keep the robot's size and the floor; links come from its own joints."""
    tower = '<body name="tower" pos="9 0 5"><freejoint/><geom size="5"/></body>'
    run = walked(
        tmp_path,
        tower + '<geom type="box" size="0.1 0.1 0.5" pos="3 0 0.5"/>',
        "9 0 5 1 0 0 0",
    )
    seen = seen_of(run)
    assert highest_box(seen.model) == 0.0
    tall = _height(seen.model, mujoco.MjData(seen.model), run.log["qpos"][0])
    assert 1.0 < tall < 2.0
    assert seen.model.stat.extent < 3.0
    (links,) = [s for s in streams_of(run.robot, run.log.columns) if s.topic == "/tf"]
    rows = {name: column[:2] for name, column in run.log.columns.items()}
    base = links.values(rows)["transforms.0.transform.translation"]
    assert np.array_equal(base, rows["qpos"][:, :3])
    figures = run.summary()
    assert 0.0 < figures["joint_speed_max_pct"] < 100.0


def test_a_page_opens_with_the_robots_own_configuration(tmp_path):
    """As a live page does before anything moves; the ground is a shape, not a grid."""
    more = (
        '<asset><hfield name="h" nrow="2" ncol="2" size="3 3 1 1" '
        'elevation="0 1 1 0"/></asset>'
    )
    around = '<geom type="hfield" hfield="h"/>' + BALL.format("1 2 3")
    robot = load_robot(toy_scene(tmp_path, around, more=more))
    model = build_scene(robot, SimulatorSettings())
    whole = whole_state(model, robot.home)
    n = len(robot.home)
    assert np.array_equal(whole[:n], robot.home)
    assert np.array_equal(whole[n:], robot.world.qpos)
    with open_server() as server:
        stage = Stage(server, model, robot.home)
        assert 0.5 < stage.height < 1.0


def test_a_scene_walks_from_the_command_line(tmp_path, capsys):
    """As robots are shared: the robot's file, included in a scene of its own."""
    text = PAPER.replace('<mujoco model="paper">', '<mujoco model="robot">')
    (tmp_path / "robot.xml").write_text(text)
    scene = (
        '<mujoco><include file="robot.xml"/><statistic center="0 0 1" extent="2"/>'
        '<visual><map znear="0.05"/></visual><option timestep="0.004"/><asset>'
        '<texture type="skybox" builtin="gradient" width="8" height="48"/>'
        '<texture name="grid" type="2d" builtin="checker" width="8" height="8"/>'
        '<material name="grid" texture="grid"/></asset><worldbody>'
        '<light pos="0 0 3"/><geom name="floor" type="plane" size="0 0 1" '
        'material="grid"/>{}</worldbody></mujoco>'
    )
    file = tmp_path / "scene.xml"
    notes = []
    for around in ("", '<geom type="box" size="0.1 0.1 0.1" pos="0 2 0.1"/>'):
        file.write_text(scene.format(around))
        for flag in ([], ["--simulator.no-scene"]):
            out = tmp_path / f"run{len(notes)}"
            words = ["walk", str(file), "--steps", "2", "--out", str(out), *flag]
            assert main(words) == 0
            notes.append(read_summary(out)["settings"]["notes"])
            assert replay(out).position_difference == 0.0
    kept = "the file's world is kept: 1 shape; its floor at 0 m"
    assert notes == [[], [], [kept], []]
    assert kept in re.sub(r"\s+", " ", capsys.readouterr().out)
    assert math.isfinite(read_summary(tmp_path / "run0")["distance_m"])
