"""Loading a robot: its limbs, feet, servos and limits, and every way to fail."""

from __future__ import annotations

import contextlib
import math
from importlib import resources

import mujoco
import numpy as np
import pytest
from robots import paper

from comwalk.control.settings import SimulatorSettings
from comwalk.errors import ModelError, ParameterError
from comwalk.pattern.footsteps import Foothold, FootstepPlan
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders.sources import ROBOTS
from comwalk.robot.model import LEGS, load_robot
from comwalk.sides import Side
from comwalk.walking.mujoco_scene import build_scene
from comwalk.walking.whole_body import WholeBody

LEFT, RIGHT = Foothold(0.0, 0.09), Foothold(0.0, -0.09)

TOY = """
<mujoco model="toy">
  <compiler angle="radian"/>
  <size nuser_jnt="1"/>
  <worldbody>
    <body name="base" pos="0 0 0.5">
      <freejoint/>
      <geom type="sphere" size="0.1" mass="10"/>
      <body name="l_leg" pos="0 0.1 0">
        <joint name="l_hip" axis="0 1 0" range="-1 1" limited="true" user="7"/>
        <geom type="box" size="0.1 0.05 0.01" pos="0.03 0 -0.49" mass="1"/>
        <site name="l_sole" pos="0 0 -0.5"/>
      </body>
      <body name="r_leg" pos="0 -0.1 0">
        <joint name="r_hip" axis="0 1 0"/>
        <geom type="box" size="0.1 0.05 0.01" pos="0.03 0 -0.49" mass="1"/>
        <site name="r_sole" pos="0 0 -0.5"/>
      </body>
      <body name="tail" pos="-0.1 0 0">
        <joint name="tail" axis="0 1 0" damping="0.5"/>
        <geom type="sphere" size="0.02" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="r_hip" kp="300" kv="3"/>
    <position joint="l_hip" kp="200" kv="2" forcerange="-40 40" forcelimited="true"/>
    <position joint="tail" kp="100" kv="1"/>
  </actuator>
  <keyframe>
    <key name="other" qpos="0 0 0.6 1 0 0 0  0 0 0"/>
    <key name="walk" qpos="0 0 0.5 1 0 0 0  0.1 0.2 0.3"/>
  </keyframe>
</mujoco>
"""


def load(tmp_path, text: str, **options):
    """Return the robot of an MJCF text."""
    file = tmp_path / "toy.xml"
    file.write_text(text, encoding="utf-8")
    return load_robot(file, **options)


def without(*lines: str) -> str:
    """Return the toy without the lines that hold these words."""
    kept = [x for x in TOY.splitlines() if not any(word in x for word in lines)]
    return "\n".join(kept)


def test_the_toy_is_a_robot(tmp_path):
    """Joints, limbs, limits and servos are those of the file, matched by name."""
    robot = load(tmp_path, TOY)
    assert robot.name == "toy"
    assert robot.joints == ("l_hip", "r_hip", "tail")
    assert [(x.name, x.joints, x.parent) for x in robot.limbs] == [
        ("left_leg", (0,), None),
        ("right_leg", (1,), None),
        ("rest", (2,), None),
    ]
    assert robot.ends[2] == -1
    assert robot.upper_body == ("tail",)
    assert robot.mass == pytest.approx(12.1)
    assert robot.servo.stiffness.tolist() == [200.0, 300.0, 100.0]
    assert robot.servo.damping.tolist() == [2.0, 3.0, 1.5]
    assert robot.servo.actuators.tolist() == [1, 0, 2]
    assert robot.lower.tolist() == [-1.0, -math.inf, -math.inf]
    assert robot.upper.tolist() == [1.0, math.inf, math.inf]
    assert robot.speed.tolist() == [7.0, math.inf, math.inf]
    assert robot.torque.tolist() == [40.0, math.inf, math.inf]
    assert robot.home[7:].tolist() == [0.1, 0.2, 0.3]


def test_a_foots_pose_is_the_centre_of_its_sole(tmp_path):
    """The contact box is 0.03 m ahead of the sole site: so is the centre."""
    robot = load(tmp_path, TOY)
    for side in Side:
        foot = robot.feet[side]
        site = robot.model.site(f"{side.value[0]}_sole").id
        offset = robot.model.site_pos[foot.site] - robot.model.site_pos[site]
        assert offset.tolist() == pytest.approx([0.03, 0.0, 0.0], abs=1e-12)
        corners = {tuple(x) for x in foot.sole.round(9).tolist()}
        assert corners == {(a, b) for a in (-0.1, 0.1) for b in (-0.05, 0.05)}


def test_a_turned_sole_site_gives_the_same_sole(tmp_path):
    """A sole is seen from its site: x forward there is y in the body."""
    turned = TOY.replace(
        '<site name="l_sole" pos="0 0 -0.5"/>',
        '<site name="l_sole" pos="0 0 -0.5" euler="0 0 1.5707963267948966"/>',
    )
    foot = load(tmp_path, turned).feet[Side.LEFT]
    corners = {tuple(x) for x in foot.sole.round(9).tolist()}
    assert corners == {(a, b) for a in (-0.05, 0.05) for b in (-0.1, 0.1)}


def test_two_boxes_make_one_sole(tmp_path):
    """Toe and heel boxes: the hull of both, about its own centre."""
    box = '<geom type="box" size="0.1 0.05 0.01" pos="0.03 0 -0.49" mass="1"/>'
    heel = box.replace("0.03 0 -0.49", "-0.13 0 -0.49")
    foot = load(tmp_path, TOY.replace(box, box + heel)).feet[Side.RIGHT]
    assert foot.sole.min(axis=0).tolist() == pytest.approx([-0.18, -0.05])
    assert foot.sole.max(axis=0).tolist() == pytest.approx([0.18, 0.05])


def test_without_a_key_named_walk_the_first_counts(tmp_path):
    """The keyframe may have any name."""
    robot = load(tmp_path, without('name="walk"'))
    assert robot.home[2] == 0.6


BAD = {
    "broken XML": (TOY.replace("</body>", "", 1), "not well-formed XML"),
    "an empty file": ("", "it is empty"),
    "no XML at all": ("qpos = 1", "not well-formed XML"),
    "an unknown element": (TOY.replace("<freejoint/>", "<wings/>"), "wings"),
    "no sole site": (without("l_sole"), "has 1 joints and so no foot"),
    "no other sole site": (without("r_sole"), "has 1 joints and so no foot"),
    "no contact box": (
        TOY.replace('<geom type="box"', '<geom contype="0" conaffinity="0" type="box"'),
        "no box that touches the ground",
    ),
    "a round foot": (
        TOY.replace('type="box" size="0.1 0.05 0.01"', 'type="sphere" size="0.1"'),
        "no box that touches the ground",
    ),
    "no actuator": (without('joint="tail"'), 'joint "tail" has 0 position actuators'),
    "two actuators": (
        TOY.replace("</actuator>", '<position joint="tail" kp="1"/></actuator>'),
        'joint "tail" has 2 position actuators',
    ),
    "a torque motor": (
        TOY.replace('position joint="tail" kp="100" kv="1"', 'motor joint="tail"'),
        'joint "tail" has 0 position actuators',
    ),
    "no keyframe": (without("<key "), "no keyframe"),
    "a ball joint": (
        TOY.replace('name="tail" axis="0 1 0" damping="0.5"', 'name="tail" type="ball"')
        .replace('<position joint="tail" kp="100" kv="1"/>', "")
        .replace("0 0 0\"", "0 0 1 0 0 0\"")
        .replace("0.1 0.2 0.3", "0.1 0.2 1 0 0 0"),
        'joint "tail" is a ball',
    ),
    "a leg without joints": (
        without('name="l_hip"', 'joint="l_hip"').replace("0 0 0\"", "0 0\"")
        .replace("0.1 0.2 0.3", "0.1 0.2"),
        "no joint between the base and l_sole",
    ),
    "a keyframe of another size": (
        TOY.replace("0.1 0.2 0.3", "0.1 0.2 0.3 0.4"),
        "does not compile",
    ),
    "a world without bodies": ("<mujoco/>", "no bodies"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_bad_models_give_one_clear_line(tmp_path, text, message):
    """Each names the file and what is wrong with it."""
    with pytest.raises(ModelError, match=message) as caught:
        load(tmp_path, text)
    line = str(caught.value)
    assert "\n" not in line
    assert "toy.xml" in line


@pytest.mark.parametrize(("angle", "message"), [("nan", "finite"), ("1.5", "keyframe")])
def test_a_home_that_is_no_posture_is_refused(tmp_path, monkeypatch, angle, message):
    """The walking posture must be finite and within the joint limits (-1 to 1)."""
    monkeypatch.chdir(tmp_path)  # where MuJoCo leaves its log of warnings
    with pytest.raises(ModelError, match=message):
        load(tmp_path, TOY.replace("0.1 0.2 0.3", f"{angle} 0.2 0.3"))


def paper_text() -> str:
    """Return the MJCF of the robot "paper"."""
    return (resources.files("comwalk") / "robots/paper.xml").read_text("utf-8")


def test_a_model_may_have_a_geom_named_floor(tmp_path):
    """What the scene adds is not in the way of what the model has, or it says so."""
    geom = '<geom name="floor" type="sphere" size="0.01" pos="0 0 9" contype="0"/>'
    text = paper_text().replace("<worldbody>", f"<worldbody>{geom}", 1)
    robot = load(tmp_path, text)
    with contextlib.suppress(ModelError):
        build_scene(robot, SimulatorSettings())


def test_a_head_without_joints_is_no_obstacle(tmp_path):
    """A gaze frame on the torso: the head has no joints of its own."""
    text = paper_text().replace('<site name="gaze"', '<site name="eyes"')
    text = text.replace(
        '<site name="torso"/>', '<site name="torso"/><site name="gaze"/>'
    )
    robot = load(tmp_path, text)
    pattern = make_pattern(FootstepPlan(left=LEFT, right=RIGHT), Pendulum())
    WholeBody(robot, 0.002).start(pattern.at(0.0))


def test_files_that_are_not_there(tmp_path):
    """A path is a path, whether it has a suffix or not."""
    for missing in (tmp_path / "none.xml", tmp_path / "none", "./none", "none.mjcf"):
        with pytest.raises(ModelError, match="does not exist") as caught:
            load_robot(missing)
        assert "\n" not in str(caught.value)
    with pytest.raises(ModelError):
        load_robot(tmp_path)


def test_a_file_that_is_no_text(tmp_path):
    """Bytes that are not UTF-8 give the same error as a broken file."""
    file = tmp_path / "toy.xml"
    file.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe\x00")
    with pytest.raises(ModelError, match="not well-formed XML") as caught:
        load_robot(file)
    assert "\n" not in str(caught.value)


def test_unknown_names():
    """A mistyped name is answered with the nearest one."""
    with pytest.raises(ModelError, match='unknown robot "papper"; did you mean "pape'):
        load_robot("papper")
    with pytest.raises(ModelError, match=r"known: .*paper"):
        load_robot("zzz")
    with pytest.raises(ModelError, match="unknown robot"):
        load_robot("")


def test_the_built_in_robot_loads():
    """It has its name, and two legs of six joints."""
    robot = load_robot("paper")
    legs = [limb for limb in robot.limbs if limb.name in LEGS.values()]
    assert robot.name == "paper"
    assert [len(leg.joints) for leg in legs] == [6, 6]


def test_the_table_tells_the_truth_about_the_paper_robot():
    """Mass, CoM height and number of joints."""
    robot = paper()
    text = ROBOTS["paper"]
    assert f"{robot.mass:.2f} kg" in text
    assert f"{Kinematics(robot).posture(robot.home).com[2]:.3f} m" in text
    assert f"{len(robot.joints)} joints" in text


def test_limbs_of_the_paper_robot():
    """Section IV: legs, a torso that carries both arms and the head, nothing left."""
    robot = paper()
    limbs = {limb.name: limb for limb in robot.limbs}
    assert list(limbs) == [
        "left_leg", "right_leg", "torso", "left_arm", "right_arm", "head",
    ]  # fmt: skip
    assert [len(limb.joints) for limb in robot.limbs] == [6, 6, 2, 7, 7, 2]
    for name in ("left_arm", "right_arm", "head"):
        assert limbs[name].parent == "torso"
    for name in ("left_leg", "right_leg", "torso"):
        assert limbs[name].parent is None
    for name, limb in limbs.items():
        joints = [robot.joints[j] for j in limb.joints]
        prefix = {"left": "l_", "right": "r_", "torso": "waist_", "head": "head_"}
        assert all(j.startswith(prefix[name.split("_")[0]]) for j in joints)
    assert robot.joints[limbs["left_leg"].joints[0]] == "l_hip_yaw"
    assert robot.joints[limbs["left_leg"].joints[-1]] == "l_ankle_roll"


def test_upper_body_of_the_paper_robot():
    """All that may dance: every joint outside the legs, none inside."""
    robot = paper()
    assert len(robot.upper_body) == 18
    assert not any("hip" in j or "knee" in j or "ankle" in j for j in robot.upper_body)
    assert set(robot.upper_body) < set(robot.joints)


@pytest.mark.parametrize("side", Side)
def test_feet_of_the_paper_robot(side):
    """The sole's size and centre, and what hangs below the ankle sensor."""
    robot = paper()
    foot, letter = robot.feet[side], side.value[0]
    assert np.ptp(foot.sole, axis=0).tolist() == pytest.approx([0.24, 0.13])
    assert (foot.sole.min(axis=0) + foot.sole.max(axis=0)).tolist() == [0.0, 0.0]
    assert robot.model.site(foot.sensor_site).name == f"{letter}_ankle_ft"
    body = robot.model.body(f"{letter}_foot")
    assert foot.mass == pytest.approx(float(body.mass[0]), abs=1e-12)
    posture = Kinematics(robot).posture(robot.home)
    i = [limb.name for limb in robot.limbs].index(LEGS[side])
    x, y, z = posture.ends[i]
    assert (y, z) == pytest.approx((side.sign * 0.09, 0.0), abs=1e-6)
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.home
    mujoco.mj_kinematics(robot.model, data)
    sensor = data.site_xpos[foot.sensor_site]
    R = data.site_xmat[foot.sensor_site].reshape(3, 3)
    com = data.xipos[body.id]
    assert np.abs(sensor + R @ foot.com - com).max() < 1e-12
    assert abs(x - posture.com[0]) < 0.005


@pytest.mark.parametrize("factor", [0.25, 1, 2.0, np.float64(0.5)])
def test_stiffness_scales_every_servo(factor):
    """Both gains of all servos; the joints' own damping and the limits stay."""
    one, other = paper(), load_robot("paper", stiffness=factor)
    own = one.model.dof_damping[6:]
    assert np.allclose(other.servo.stiffness, factor * one.servo.stiffness, rtol=1e-12)
    assert np.allclose(
        other.servo.damping - own, factor * (one.servo.damping - own), rtol=1e-12
    )
    assert np.array_equal(other.torque, one.torque)
    index = one.servo.actuators
    gains = other.model.actuator_gainprm[index, 0]
    assert np.allclose(gains, -other.model.actuator_biasprm[index, 1], rtol=1e-12)
    assert np.allclose(gains, other.servo.stiffness, rtol=1e-12)
    assert other.mass == one.mass


@pytest.mark.parametrize("bad", [0, -1.0, 101, math.nan, math.inf, "1", None, True])
def test_bad_stiffness_is_refused(bad):
    """It must be a number in (0, 100]."""
    with pytest.raises(ParameterError, match="stiffness must be a number in") as caught:
        load_robot("paper", stiffness=bad)
    assert "\n" not in str(caught.value)


def test_robots_do_not_share_a_model():
    """Two loads are two robots: changing one leaves the other alone."""
    one, other = load_robot("paper"), load_robot("paper")
    one.model.opt.gravity[2] = -1.0
    assert other.model.opt.gravity[2] == -9.81


def test_only_the_asked_limbs_have_jacobians():
    """What a tick does not need it does not pay for; the CoM is always there."""
    robot = paper()
    every = Kinematics(robot).posture(robot.home)
    legs = Kinematics(robot, ["left_leg", "right_leg"]).posture(robot.home)
    assert np.array_equal(legs.jacobian[:15], every.jacobian[:15])
    assert not legs.jacobian[15:].any()
    assert every.jacobian[21:].any()
