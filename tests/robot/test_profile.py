"""Profiles: read, refused, written, and what each of their keys changes."""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import LEG, write
from robots import paper

from comwalk.certificates.description import profile_of
from comwalk.errors import ComwalkError, ModelError, ParameterError, RunError
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import load_robot
from comwalk.robot.profile import (
    Limits,
    Profile,
    ServoGains,
    SoleNumbers,
    Stance,
    profile_text,
    read_profile,
    write_profile,
)
from comwalk.sides import Side

LEFT, RIGHT = Side.LEFT, Side.RIGHT


# ---- Reading ----------------------------------------------------------------------


def test_nothing_is_a_profile_that_says_nothing(tmp_path):
    """None, an empty table and an empty file."""
    file = tmp_path / "empty.toml"
    file.write_text("")
    for source in (None, {}, file, str(file)):
        assert read_profile(source) == Profile()
    assert Profile().given == ()


def test_every_key_is_read(tmp_path):
    """Sides, joints, tables; `both` stands for left and right; degrees become rad."""
    file = tmp_path / "all.toml"
    file.write_text("""
        forward = 90
        imu = "chest"
        torso = ["waist"]
        locked = []
        feet = { left = "l", right = "r" }
        [soles]
        both = { length = 0.2, width = 0.1 }
        [stance]
        half_width = 0.1
        [home]
        knee = 1
        [servo]
        knee = { stiffness = 100 }
        [limits]
        "odd name" = { lower = -1, torque = 5.0 }
    """)
    found = read_profile(file)
    assert found.forward == 90.0
    assert (found.imu, found.torso, found.head, found.locked) == (
        "chest", ("waist",), None, (),
    )  # fmt: skip
    assert found.feet == {LEFT: "l", RIGHT: "r"}
    assert found.soles == {s: SoleNumbers(length=0.2, width=0.1) for s in Side}
    assert found.stance == Stance(half_width=0.1)
    assert found.home == {"knee": 1.0}
    assert found.servo == {"knee": ServoGains(100.0)}
    assert found.limits == {"odd name": Limits(lower=-1.0, torque=5.0)}


BAD = {
    "an unknown key": ({"forwards": 1}, 'unknown key "forwards"; did you mean "forwar'),
    "an unknown side": (
        {"arms": {"lefty": []}},
        'unknown key "arms.lefty"; did you mean',
    ),
    "an unknown number": (
        {"servo": {"knee": {"stifness": 1}}},
        r'unknown key "servo.knee.stifness"; did you mean "stiffness"',
    ),
    "no number": ({"forward": "left"}, "forward must be a number in"),
    "too large": ({"forward": 400}, r"in \[-360, 360\] deg, got 400"),
    "not positive": (
        {"servo": {"knee": {"stiffness": 0}}},
        r"servo\.knee\.stiffness must be a number in .* N m/rad, got 0",
    ),
    "a number for a table": (
        {"home": 1},
        r"home must be a table, written \[home\], got 1",
    ),
    "a number for a list": ({"head": 3}, "head must be text in quotes"),
    "a number for a name": ({"imu": 3}, "imu must be text in quotes"),
    "a number in a list": ({"torso": [1]}, "torso must be text in quotes"),
    "one foot": ({"feet": {"left": "foot"}}, "feet needs both left and right"),
    "one leg": ({"legs": {"left": ["hip"]}}, "legs needs both left and right"),
    "limits the wrong way": (
        {"limits": {"knee": {"lower": 1, "upper": 0}}},
        r"limits\.knee\.lower must be below upper, 0 rad, got 1",
    ),
    "a bend and a height": (
        {"stance": {"bend": 0.2, "com_height": 0.8}},
        "stance.bend or com_height can be given, not both",
    ),
    "a joint in two parts": (
        {"head": ["neck"], "torso": ["neck"]},
        'joint "neck" is named twice',
    ),
    "a sole without size": ({"soles": {"left": {"width": 0}}}, r"soles\.left\.width"),
}


@pytest.mark.parametrize(("table", "message"), BAD.values(), ids=BAD)
def test_bad_profiles_give_one_clear_line(table, message):
    """Each names the key, the value, and what is allowed."""
    with pytest.raises(ParameterError, match=message) as caught:
        read_profile(table)
    assert str(caught.value).startswith("profile: ")
    assert "\n" not in str(caught.value)


def test_bad_files_are_named(tmp_path):
    """What is missing, no TOML, or wrong inside."""
    with pytest.raises(ParameterError, match=r"none\.toml: cannot be read: No such"):
        read_profile(tmp_path / "none.toml")
    file = tmp_path / "bad.toml"
    file.write_text("forward = ")
    with pytest.raises(ParameterError, match=r"bad\.toml: not valid TOML"):
        read_profile(file)
    file.write_text("forward = 1000")
    with pytest.raises(ParameterError, match=r"profile .*bad\.toml: forward must be"):
        read_profile(file)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"home": {"left_kneey": 0}},
            'home names a joint "left_kneey" .* "left_knee_y"',
        ),
        ({"locked": ["xyz"]}, r'locked names a joint "xyz" .*comwalk robot'),
        ({"imu": "chst"}, 'imu names a body "chst" .* "chest"'),
        ({"feet": {"left": "a", "right": "b"}}, 'feet names a body "a"'),
    ],
)
def test_what_the_robot_has_not_is_refused(tmp_path, table, message):
    """The nearest name is offered."""
    with pytest.raises(ParameterError, match=message) as caught:
        load_robot(write(tmp_path), profile=table)
    assert "\n" not in str(caught.value)


def test_the_profile_in_the_docs_is_one():
    """It names every key but the legs, and JVRC-1 stands with it."""
    text = (Path(__file__).parents[2] / "docs" / "files.md").read_text("utf-8")
    block = re.search(r"<!-- profile -->\n```toml\n(.*?)```", text, re.DOTALL)
    assert block is not None
    table = tomllib.loads(block[1])
    keys = {field.name for field in dataclasses.fields(Profile)}
    assert set(table) == keys - {"legs"}
    robot = load_robot("jvrc1", profile=table)
    assert robot.anatomy.soles[LEFT].size == (0.2, 0.09)
    assert "L_WRIST_Y" in robot.anatomy.locked
    com = Kinematics(robot).posture(robot.home).com
    assert com[2] == pytest.approx(0.83, abs=1e-3)


# ---- Writing ----------------------------------------------------------------------

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C"]), min_size=1)
NUMBERS = st.floats(-50.0, 50.0)
PROFILES = st.builds(
    Profile,
    forward=st.floats(-360.0, 360.0),
    imu=st.none() | NAMES,
    stance=st.builds(Stance, half_width=st.none() | st.floats(0.01, 1.0)),
    home=st.dictionaries(NAMES, NUMBERS, max_size=4),
    servo=st.dictionaries(
        NAMES, st.builds(ServoGains, st.floats(1e-5, 1e8), st.none()), max_size=4
    ),
    locked=st.lists(NAMES, unique=True, max_size=3).map(tuple),
)


@given(PROFILES)
def test_what_is_written_is_read(profile):
    """Any names, any numbers, to seven digits."""
    again = read_profile(tomllib.loads(profile_text(profile, "title")))
    assert again.forward == pytest.approx(profile.forward, rel=1e-6, abs=1e-9)
    assert (again.imu, again.locked) == (profile.imu, profile.locked)
    assert again.home == pytest.approx(profile.home, rel=1e-6)
    assert again.servo.keys() == profile.servo.keys()
    for joint, gains in profile.servo.items():
        assert again.servo[joint].stiffness == pytest.approx(gains.stiffness, rel=1e-6)


def test_a_folder_that_is_not_there(tmp_path):
    """It cannot be written into."""
    with pytest.raises(RunError, match=r"cannot write the profile .*: No such file"):
        write_profile(Profile(), tmp_path / "none" / "x.toml")


ROBOTS = ("paper", "jvrc1", "talos_full", "g1", "mjlab_g1", "romeo", "icub")


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_with_its_own_profile_is_the_same(tmp_path, name):
    """Parts, soles, posture, servos and limits."""
    try:
        robot = load_robot(name)
    except ModelError as error:
        pytest.skip(str(error))
    file = tmp_path / "own.toml"
    write_profile(profile_of(robot), file, name)
    check_same(robot, load_robot(name, profile=file))


def check_same(robot, other):
    """Check that two robots are the same."""
    assert other.joints == robot.joints
    assert other.limbs == robot.limbs
    assert other.roles == robot.roles
    assert other.anatomy.locked == robot.anatomy.locked
    assert other.home == pytest.approx(robot.home, abs=3e-6)
    for one, two in ((robot, other),):
        assert two.servo.stiffness == pytest.approx(one.servo.stiffness, rel=1e-6)
        assert two.servo.damping == pytest.approx(one.servo.damping, rel=1e-5)
        assert two.lower == pytest.approx(one.lower, rel=1e-6)
        assert two.upper == pytest.approx(one.upper, rel=1e-6)
        assert two.speed == pytest.approx(one.speed, rel=1e-6)
        assert two.torque == pytest.approx(one.torque, rel=1e-6)
    for side in Side:
        assert other.feet[side].sole == pytest.approx(robot.feet[side].sole)


@pytest.mark.parametrize(
    "options",
    [
        {"yaw": 1.0, "fingers": 2},
        {
            "leg": (*LEG[:4], "knee2_y", *LEG[4:]),
            "mimic": {"knee2_y": ("knee_y", 1, 0)},
        },
        {"mimic": {"ankle_x": ("hip_x", -1, 0)}},
        {"chest_first": True, "tail": True},
        {"foot": "none", "scale": 0.3},
    ],
)
def test_any_build_with_its_own_profile_is_the_same(tmp_path, options):
    """Turned, with joints that follow, with what is locked, small."""
    file = write(tmp_path, **options)
    robot = load_robot(file)
    write_profile(profile_of(robot), tmp_path / "own.toml")
    check_same(robot, load_robot(file, profile=tmp_path / "own.toml"))


# ---- What each key changes --------------------------------------------------------


def test_forward_and_feet(tmp_path):
    """A robot told to walk backward has its right foot where its left one was."""
    file = write(tmp_path)
    robot = load_robot(file, profile={"forward": 180.0})
    assert robot.anatomy.legs[LEFT][0] == "right_hip_z"
    feet = {"left": "link_left_ankle_x", "right": "link_right_ankle_x"}
    robot = load_robot(write(tmp_path, legs=4), profile={"feet": feet})
    assert robot.anatomy.legs[LEFT][-1] == "left_ankle_x"
    assert "left_hind_knee_y" in robot.anatomy.locked


def test_parts(tmp_path):
    """A joint that is locked, an arm that is shorter, a head that is a torso."""
    table = {
        "locked": ["left_wrist_z"],
        "arms": {"right": ["right_shoulder_y", "right_shoulder_x"]},
        "torso": ["waist_z"],
        "imu": "pelvis",
    }
    robot = load_robot(write(tmp_path), profile=table)
    found = robot.anatomy
    assert found.arms[RIGHT] == ("right_shoulder_y", "right_shoulder_x")
    assert found.arms[LEFT][-1] == "left_elbow_y"
    assert found.torso == ("waist_z",)
    assert {"left_wrist_z", "waist_y", "right_elbow_y"} <= set(found.locked)
    body = robot.model.site_bodyid[robot.imu_site]
    assert robot.model.body(body).name == "pelvis"


def test_a_locked_joint_stays_at_its_home_angle(tmp_path):
    """Locked where the profile has it, not at zero."""
    table = {"locked": ["left_elbow_y"], "home": {"left_elbow_y": -1.0}}
    one = load_robot(write(tmp_path), profile=table)
    other = load_robot(write(tmp_path), profile={"home": {"left_elbow_y": -1.0}})
    R = [r.model.body("link_left_elbow_y").quat for r in (one, other)]
    assert R[0] == pytest.approx([math.cos(0.5), 0.0, -math.sin(0.5), 0.0])
    assert "left_elbow_y" not in one.joints
    assert other.home_angles["left_elbow_y"] == -1.0


def test_soles(tmp_path):
    """What is not given stays; what is lies where the ankle says."""
    table = {"soles": {"both": {"length": 0.3, "height": 0.09}, "left": {"x": 0.05}}}
    with pytest.raises(ParameterError, match=r"soles has .*both|unknown"):
        load_robot(write(tmp_path), profile={"soles": {"all": {}}})
    robot = load_robot(write(tmp_path), profile=table)
    right, left = (robot.anatomy.soles[s] for s in (RIGHT, LEFT))
    assert right.size == pytest.approx((0.3, 0.11), abs=1e-6)
    assert right.ankle == pytest.approx((-0.03, 0.0, 0.09), abs=1e-6)
    assert left.ankle[0] == pytest.approx(-0.05)
    assert right.origin == "profile"
    assert np.ptp(robot.feet[RIGHT].sole, axis=0) == pytest.approx([0.3, 0.11])
    assert not robot.model.geom("geom_0").contype[0]


def test_servos_and_limits(tmp_path):
    """Of the joints that are named; damping follows the stiffness."""
    table = {
        "servo": {
            "left_knee_y": {"stiffness": 5000.0},
            "right_knee_y": {"stiffness": 4000.0, "damping": 7.0},
        },
        "limits": {
            "left_knee_y": {"lower": 0.1, "torque": 99.0, "speed": 3.0},
            "waist_z": {"upper": 1.0},
        },
    }
    usual = load_robot(write(tmp_path), actuation="position")
    robot = load_robot(write(tmp_path), profile=table, actuation="position")
    j, k, w = (
        robot.joints.index(n) for n in ("left_knee_y", "right_knee_y", "waist_z")
    )
    assert robot.servo.stiffness[[j, k]].tolist() == [5000.0, 4000.0]
    ratio = usual.servo.damping[j] / usual.servo.stiffness[j]
    assert robot.servo.damping[j] == pytest.approx(5000.0 * ratio, rel=0.05)
    assert robot.servo.damping[k] == pytest.approx(7.0)
    limits = (robot.lower[j], robot.upper[j], robot.speed[j], robot.torque[j])
    assert limits == (0.1, 2.5, 3.0, 99.0)
    assert (robot.lower[w], robot.upper[w]) == (-2.5, 1.0)
    assert robot.model.actuator_forcerange[robot.servo.actuators[j], 1] == 99.0


@pytest.mark.parametrize("name", ["humanoid", "paper"])
def test_rotors(name, tmp_path):
    """A stated rotor is what turns; what is designed stays, and is written again."""
    source = write(tmp_path) if name == "humanoid" else name
    usual = load_robot(source)
    joint = usual.joints[int(np.argmax(usual.servo.stiffness))]
    robot = load_robot(source, profile={"servo": {joint: {"armature": 0.0251}}})
    turns = usual.model.dof_armature.copy()
    turns[6 + usual.joints.index(joint)] = 0.0251
    assert np.array_equal(robot.model.dof_armature, turns)
    assert np.array_equal(robot.servo.stiffness, usual.servo.stiffness)
    assert robot.anatomy.designed == usual.anatomy.designed
    assert profile_of(robot).servo[joint].armature == 0.0251
    again = load_robot(source, profile=tomllib.loads(profile_text(profile_of(robot))))
    assert again.model.dof_armature == pytest.approx(turns, rel=1e-6)


def test_a_robot_that_marks_its_frames(tmp_path):
    """It takes home, servos and limits; the rest is in its file."""
    table = {
        "home": {"l_elbow_pitch": -1.0},
        "servo": {"l_elbow_pitch": {"stiffness": 900.0}},
        "limits": {"l_elbow_pitch": {"torque": 11.0, "upper": 0.5}},
    }
    robot = load_robot("paper", profile=table)
    j = robot.joints.index("l_elbow_pitch")
    assert robot.home_angles["l_elbow_pitch"] == -1.0
    assert robot.servo.stiffness[j] == 900.0
    assert (robot.torque[j], robot.upper[j]) == (11.0, 0.5)
    assert robot.home[2] == pytest.approx(paper().home[2], abs=1e-12)
    with pytest.raises(ParameterError, match=r"marks its frames itself.*not forward"):
        load_robot("paper", profile={"forward": 90.0})
    with pytest.raises(ModelError, match="outside its range"):
        load_robot("paper", profile={"home": {"l_knee_pitch": 9.0}})


def test_squatting_legs_of_a_marked_robot_stand_on_the_ground():
    """New angles of the legs move the base, so that the soles stay at their height."""
    legs = {"hip_pitch": -0.6, "knee_pitch": 1.2, "ankle_pitch": -0.6}
    home = {f"{s}_{joint}": q for s in "lr" for joint, q in legs.items()}
    robot = load_robot("paper", profile={"home": home})
    ends = Kinematics(robot).posture(robot.home).ends
    assert np.abs(ends[:2, 2]).max() < 1e-6


def test_a_home_out_of_the_limits_is_refused(tmp_path):
    """Angles that are given must be within the ranges of their joints."""
    with pytest.raises(ComwalkError, match=r"left_elbow_y.* outside"):
        load_robot(write(tmp_path), profile={"home": {"left_elbow_y": -3.0}})
