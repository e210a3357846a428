"""What joints take: which robots walk by torque, with which gains, on which plants."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from models import write
from robots import paper

import comwalk
from comwalk.certificates import sampled_loop_of, servo_lag_of, stance_ratio
from comwalk.certificates.reach import LEAST_STANCE
from comwalk.config import WalkConfig
from comwalk.control import (
    Actuation,
    BodySettings,
    Control,
    SimulatorSettings,
    WalkingController,
    walk,
)
from comwalk.errors import ModelError, ParameterError, PlanError
from comwalk.replay import replay
from comwalk.robot.model import load_robot
from comwalk.robot.servos import MOST_FRICTION, PD_STIFFNESS, SOFTEST
from comwalk.run import prepare
from comwalk.setup import build_walk
from comwalk.walking import SimulatedRobot, WholeBody

PAPER = Path(comwalk.__file__).parent / "robots" / "paper.xml"
REAL = SimulatorSettings(
    noise=1.0, latency=0.002, command_delay=0.002, joint_friction=0.5
)


@pytest.fixture
def file_with(tmp_path):
    """Return what writes the paper's robot with other position gains."""

    def write(gain: float) -> Path:
        text = PAPER.read_text(encoding="utf-8")
        path = tmp_path / "robot.xml"
        path.write_text(re.sub(r'kp="[\d.]+"', f'kp="{gain}"', text), encoding="utf-8")
        return path

    return write


def test_stiff_servos_of_a_file_take_positions(file_with):
    assert load_robot(file_with(9e3)).actuation is Actuation.POSITION
    assert load_robot(file_with(9e3)).servos is None


def test_soft_servos_of_a_file_are_kept_under_torque(file_with):
    """A soft servo is walked as a soft servo."""
    robot = load_robot(file_with(75.0))
    assert robot.actuation is Actuation.PD
    assert robot.servos is not None
    assert np.allclose(robot.servos.stiffness, 75.0)


def test_a_robot_without_servos_walks_by_torque():
    """Legs get at most 0.4 m g c_z; positions remain to be had."""
    robot = load_robot("jvrc1")
    assert robot.actuation is Actuation.PD
    assert robot.servos is not None
    weight = robot.mass * robot.gravity * robot.com_height
    legs = [j for limb in robot.limbs[:2] for j in limb.joints]
    assert robot.servos.stiffness[legs].max() < 1.05 * PD_STIFFNESS * weight
    assert (robot.servos.stiffness > 0.0).all()
    stiff = load_robot("jvrc1", actuation="position")
    assert stiff.servo.stiffness[legs].min() > 20.0 * weight


def test_gains_can_be_given():
    robot = load_robot("paper", pd=(100.0, 40.0, 2.0))
    assert robot.actuation is Actuation.PD
    assert robot.servos is not None
    places = {name: j for j, name in enumerate(robot.joints)}
    assert robot.servos.stiffness[places["l_knee_pitch"]] == 100.0
    assert robot.servos.stiffness[places["l_ankle_roll"]] == 40.0
    assert robot.servos.damping == pytest.approx(np.full(len(places), 2.0))


def test_torques_alone_have_no_gains():
    robot = load_robot("paper", actuation="torque")
    assert robot.servos is not None
    assert not np.any(robot.servos)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pd": (-1.0, 40.0, 2.0)}, "pd .*must be a number in"),
        ({"pd": (1.0, 4.0)}, "pd must be one number or 3"),
        ({"pd": (1.0, 4.0, 2.0), "actuation": "torque"}, "leave one of them out"),
        ({"actuation": "force"}, 'must be "position" or "pd" or "torque"'),
        ({"plant": "pendulum", "actuation": "pd"}, 'for plant "robot"'),
        ({"sensors": "eyes"}, "sensors must be"),
    ],
)
def test_wrong_words_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        WalkConfig(**options)
    with pytest.raises(ParameterError, match="sensors must be"):
        BodySettings(sensors="eyes")


def test_a_plant_that_takes_something_else_is_refused():
    robot = load_robot("paper", actuation="torque")
    pattern = build_walk(WalkConfig(steps=1)).pattern
    body, plant = WholeBody(robot, 0.002), SimulatedRobot(paper(), 0.002)
    with pytest.raises(ModelError, match=r'take positions: .*actuation="position"'):
        walk(pattern, WalkingController(), body, plant)


def test_the_loop_without_the_fast_link_is_the_same():
    """`Plant.write` and `read`, as a driver has them, against the compiled exchange."""
    setup = build_walk(WalkConfig(steps=2, actuation="pd", simulator=REAL))
    robot, control = setup.robot, setup.control
    assert robot is not None
    parts = prepare(robot, setup.pattern, control=control, physics=setup.physics)
    law = WalkingController(control.gains, control.settings, control.period)
    ticks = []
    assert walk(setup.pattern, law, parts.body, parts.plant, on_tick=ticks.append).ok
    log = setup.run().log
    com = np.array([tick.measured.com for tick in ticks])
    torques = np.array([tick.command.torques for tick in ticks])
    assert com == pytest.approx(log["com"], abs=1e-9)
    assert np.abs(torques).max() > 10.0


def test_the_certificate_knows_the_servo_of_the_com():
    """Its lag is 1 / k_v, and how stiff the joints are no longer matters."""
    robot = load_robot("paper", actuation="pd")
    omega = math.sqrt(robot.gravity / robot.com_height)
    lag = servo_lag_of(robot, BodySettings(com_servo=4.0))
    assert lag == pytest.approx(1.0 / (4.0 * omega))
    assert servo_lag_of(paper()) == servo_lag_of(None) == 0.02
    assert sampled_loop_of(Control(), lag).servo_lag == lag
    assert stance_ratio(robot) is None


def test_sensors_that_are_not_there_leave_the_law_without_zmp():
    """The law has no ZMP error, the log no ZMP, the summary the true one's error."""
    setup = build_walk(WalkConfig(steps=2, actuation="pd", sensors="none"))
    run = setup.run()
    assert run.outcome.ok
    assert np.isnan(run.log["zmp"]).all()
    assert np.array_equal(run.log["zmp_filtered"], run.log["zmp_ref_filtered"])
    figures = run.summary()
    assert figures["zmp_error_rms_mm"] == figures["zmp_error_true_rms_mm"]
    assert 1.0 < figures["zmp_error_rms_mm"]["x"] < 20.0


def test_rough_floors_are_walked_with_the_flaws_of_real_joints():
    """Boxes of 15 mm, of which a swinging foot meets many early."""
    setup = build_walk(WalkConfig(steps=6, actuation="pd"))
    for seed in range(3):
        physics = dataclasses.replace(REAL, terrain=0.015, terrain_seed=seed)
        run = dataclasses.replace(setup, physics=physics).run()
        assert run.outcome.ok
        assert run.summary()["position_error_m"] < 0.03


def test_lag_and_play_are_in_the_physics(tmp_path):
    """Motors that lag have a state that a replay needs; encoders see play of gears."""
    setup = build_walk(WalkConfig(steps=1, actuation="pd"))
    physics = SimulatorSettings(torque_lag=0.001, backlash=0.001)
    run = dataclasses.replace(setup, physics=physics).run()
    assert run.outcome.ok
    away = np.abs(run.log["joints"][1:] - run.log["qpos"][1:, 7:])
    assert 0.3e-3 < away.max() < 0.51e-3
    assert replay(run.save(tmp_path)).position_difference < 1e-9


def rubbing(friction: float) -> SimulatorSettings:
    """Return physics with dry friction in every joint [N m]."""
    return SimulatorSettings(joint_friction=friction)


def test_friction_that_tips_the_robot_is_refused_before_it_moves():
    """And a walk with just as much as is allowed does not fall."""
    words = {"robot": "paper", "steps": 4, "actuation": "pd", "sensors": "torque"}
    robot = paper()
    most = MOST_FRICTION * robot.mass * robot.gravity * 0.5 * robot.sole_size[1]
    allowed = build_walk(WalkConfig(**words, simulator=rubbing(0.99 * most)))
    assert allowed.certificate().stable
    assert allowed.run().outcome.ok
    beyond = build_walk(WalkConfig(**words, simulator=rubbing(1.01 * most)))
    assert "unknown friction" in beyond.certificate().verdict
    with pytest.raises(PlanError, match=r"which bear 5\.2 N m by torque; state"):
        beyond.run()
    told = BodySettings(sensors="torque", known_friction=1.0)
    known = dataclasses.replace(beyond.control, body=told)
    assert dataclasses.replace(beyond, control=known).certificate().stable
    stiff = build_walk(WalkConfig(robot="paper", simulator=rubbing(8.0)))
    assert stiff.certificate().stable


def test_soft_servos_that_rub_are_replaced_by_stiff_ones(file_with):
    """Their friction stops torques, and they do not hold the body by position."""
    file = file_with(75.0)
    text = file.read_text(encoding="utf-8")
    file.write_text(re.sub("<joint ", '<joint frictionloss="60" ', text))
    robot = load_robot(file)
    assert robot.actuation is Actuation.POSITION
    legs = [j for limb in robot.limbs[:2] for j in limb.joints]
    weight = robot.mass * robot.gravity * robot.com_height
    assert robot.servo.stiffness[legs].min() > SOFTEST * weight
    assert stance_ratio(robot) > LEAST_STANCE
    same = load_robot(file, actuation="position").servo.stiffness
    assert same == pytest.approx(robot.servo.stiffness)
    elbow = next(j for j in robot.joints if "elbow" in j)
    profile = {
        "servo": {
            elbow: {"stiffness": 7.0},
            robot.joints[legs[3]]: {"stiffness": 300.0},
        }
    }
    told = load_robot(file, profile=profile).servo.stiffness
    assert told[robot.joints.index(elbow)] == pytest.approx(7.0)
    assert told[legs[3]] == pytest.approx(300.0)


def test_a_file_with_much_friction_takes_positions(tmp_path):
    """A fifth of what it tells is not known; what stiff servos overcome anyhow."""
    text = write(tmp_path).read_text()
    for friction, takes in ((1.0, Actuation.PD), (40.0, Actuation.POSITION)):
        more = f'<dynamics friction="{friction}"/></joint>'
        file = tmp_path / "rubs.urdf"
        file.write_text(text.replace("</joint>", more))
        assert load_robot(file).actuation is takes
    setup = build_walk(WalkConfig(robot=str(file), steps=1, actuation="pd"))
    with pytest.raises(PlanError, match="8 N m of unknown friction, a fifth of what"):
        setup.run()
