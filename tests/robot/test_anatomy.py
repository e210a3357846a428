"""What is what in a model: by any names, in any order, at any size, facing anywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import ARM, LEG, Build, renaming, urdf, with_shape, write
from scipy.optimize import linear_sum_assignment

from comwalk.errors import ModelError
from comwalk.robot.anatomy import find_anatomy
from comwalk.robot.annotated import _best_pairs
from comwalk.robot.annotation import compile_model
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import load_robot
from comwalk.sides import Side

LEFT, RIGHT = Side.LEFT, Side.RIGHT


def anatomy_of(path):
    """Return the anatomy of a file."""
    file = read_model(path)
    model = compile_model(file.spec, str(path))
    return find_anatomy(model, file.meshes, str(path), file.mimics)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("models")


def side(name, joints):
    """Return joints of one side."""
    return tuple(f"{name}_{joint}" for joint in joints)


def test_a_usual_humanoid(folder):
    """Two legs, two arms, a torso and a head; nothing left."""
    found = anatomy_of(write(folder))
    assert found.forward == 0.0
    assert found.legs == {s: side(s, LEG) for s in Side}
    assert found.arms == {s: side(s, ARM) for s in Side}
    assert found.torso == ("waist_z", "waist_y")
    assert found.head == ("neck_z", "neck_y")
    assert (found.locked, found.coupled, found.notes) == ((), (), ())
    assert found.imu == "chest"
    for s in Side:
        assert found.soles[s].size == pytest.approx((0.22, 0.11), abs=1e-6)
        assert found.soles[s].ankle == pytest.approx((-0.03, 0.0, 0.08), abs=1e-6)


BUILDS = {
    "with fingers": {"fingers": 5},
    "arms aside": {"pose": "tee"},
    "arms forward": {"pose": "forward"},
    "an arm": {"arms": ("right",)},
    "no arms": {"arms": ()},
    "no head": {"neck": ()},
    "no arms, no head": {"arms": (), "neck": ()},
    "a tail and a backpack": {"tail": True, "backpack": True},
    "a tail, no head": {"tail": True, "neck": ()},
    "a stiff back": {"waist": ()},
    "five joints": {"leg": LEG[1:]},
    "four joints": {"leg": ("hip_x", "hip_y", "knee_y", "ankle_y")},
    "toes": {"leg": (*LEG, "toe_y")},
    "pitch first": {"leg": ("hip_y", "hip_x", "hip_z", *LEG[3:])},
    "ankle roll first": {"leg": (*LEG[:4], "ankle_x", "ankle_y")},
    "no shape of the feet": {"foot": "none"},
    "uneven legs": {"uneven": 0.02},
    "knees that do not stretch": {"limits": {"knee_y": (0.3, 2.0)}},
    "a lift": {"slide": ("waist_z",), "limits": {"waist_z": (-0.1, 0.1)}},
}


@pytest.mark.parametrize("options", BUILDS.values(), ids=BUILDS)
def test_other_humanoids(folder, options):
    """Whatever is there is found, whatever is not is missing."""
    build = Build(**options)
    found = anatomy_of(write(folder, build))
    leg = tuple(joint for joint in build.leg if "toe" not in joint)
    assert found.legs == {s: side(s, leg) for s in Side}
    assert found.arms == {s: side(s, ARM) for s in Side if s.value in build.arms}
    assert found.torso == tuple(f"waist_{axis}" for axis in build.waist)
    assert found.head == tuple(f"neck_{axis}" for axis in build.neck)
    words = ("f0", "f1", "f2", "f3", "f4", "tail", "strap", "toe")
    assert all(any(word in joint for word in words) for joint in found.locked)
    assert bool(found.locked) == any(
        [build.fingers, build.tail, build.backpack, "toe_y" in build.leg]
    )
    assert any("of 5" in n or "5 joints" in n for n in found.notes) == (len(leg) == 5)


def test_a_chest_as_the_base(folder):
    """Joints between the base and both legs are in no limb, and said to be locked."""
    found = anatomy_of(write(folder, chest_first=True))
    assert found.legs == {s: side(s, LEG) for s in Side}
    assert found.locked == ("waist_z",)
    assert any("waist_z" in note for note in found.notes)


def test_of_seven_joints_one_is_locked(folder):
    """A second knee: one of the two is not needed, and no other joint is."""
    leg = (*LEG[:4], "knee2_y", *LEG[4:])
    found = anatomy_of(write(folder, leg=leg))
    assert len(found.locked) == 2
    assert all("knee" in joint for joint in found.locked)
    assert [len(found.legs[s]) for s in Side] == [6, 6]
    assert sum("is locked" in note for note in found.notes) == 2


def test_joints_that_follow_within_a_limb_are_coupled(folder):
    """A knee of two joints that turn together is one; the limb has its leader alone."""
    leg = (*LEG[:4], "knee2_y", *LEG[4:])
    mimic = {"knee2_y": ("knee_y", 1.0, 0.0), "wrist_z": ("elbow_y", 0.5, 0.1)}
    found = anatomy_of(write(folder, leg=leg, mimic=mimic))
    assert found.legs == {s: side(s, LEG) for s in Side}
    assert {m.joint for m in found.coupled} == {
        f"{s}_{joint}" for s in Side for joint in mimic
    }
    assert not found.locked


def test_fingers_that_follow_are_locked(folder):
    """What follows a joint that is in no limb does not move either."""
    text = urdf(fingers=2).replace(
        '<joint name="left_f1_1" type="revolute">',
        '<joint name="left_f1_1" type="revolute"><mimic joint="left_f0_1"/>',
    )
    file = folder / "mimic.urdf"
    file.write_text(text)
    found = anatomy_of(file)
    assert not found.coupled
    assert len(found.locked) == 8


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0), turn=st.integers(-35, 36), size=st.floats(0.1, 4.0))
def test_names_order_heading_and_size_do_not_matter(tmp_path_factory, seed, turn, size):
    """The same parts under random names, in another order, turned, and scaled."""
    folder = tmp_path_factory.mktemp("any")
    yaw = math.radians(5.0 * turn)
    build = Build(seed=seed, yaw=yaw, scale=size, fingers=3, tail=True)
    names = renaming(build)
    usual = anatomy_of(write(folder, fingers=3, tail=True))
    found = anatomy_of(write(folder, build))
    for s in Side:
        assert found.legs[s] == tuple(names[j] for j in usual.legs[s])
        assert found.arms[s] == tuple(names[j] for j in usual.arms[s])
        ratio = np.divide(found.soles[s].size, usual.soles[s].size)
        assert ratio == pytest.approx([size, size], rel=1e-4)
    assert found.torso == tuple(names[j] for j in usual.torso)
    assert found.head == tuple(names[j] for j in usual.head)
    assert {*found.locked} == {names[j] for j in usual.locked}
    turned = math.remainder(found.forward - yaw, 2.0 * math.pi)
    assert turned == pytest.approx(0.0, abs=1e-6)


BAD = {
    "one leg": ({"legs": 1}, "toy.urdf: it has one limb that reaches the ground"),
    "four legs": ({"legs": 4}, "toy.urdf: it has more than two limbs .* --profile"),
    "arms": ({"legs": 0}, "toy.urdf: it has no legs: .* as arms do"),
    "arms aside": ({"legs": 0, "pose": "tee"}, "it has no legs"),
    "arms ahead": ({"legs": 0, "pose": "forward", "fingers": 3}, "it has no legs"),
    "arms of six joints": (
        {"legs": 0, "arm": (*ARM, "wrist_x"), "waist": ()},
        "it has no legs",
    ),
    "round feet": ({"foot": "ball"}, "no flat of 19 cm"),
    "short legs": ({"leg": ("hip_y", "knee_y", "ankle_y")}, "has 3 joints"),
}


@pytest.mark.parametrize(("options", "message"), BAD.values(), ids=BAD)
def test_what_cannot_walk_is_refused(folder, options, message):
    """One line that names the file and what is missing."""
    with pytest.raises(ModelError, match=message) as caught:
        load_robot(write(folder, **options))
    assert "\n" not in str(caught.value)
    assert "toy.urdf" in str(caught.value)


def test_hips_that_share_a_motor_are_told(folder):
    """As those of NAO: one joint less can be moved by itself."""
    file = write(folder)
    joint = '<joint name="right_hip_z" type="revolute">'
    text = file.read_text()
    assert joint in text
    file.write_text(text.replace(joint, f'{joint}<mimic joint="left_hip_z"/>'))
    robot = load_robot(file)
    assert "right_hip_z" in robot.anatomy.locked
    told = "right_hip_z shares a motor with left_hip_z of another limb: it is locked"
    assert told in robot.notes


def test_a_motor_beside_the_limb_follows_the_joint_that_it_drives(folder):
    """The hip's yaw by a gear of -1:2: half the motor's speed, twice its torque."""
    text = urdf()
    for side in ("left", "right"):
        joint = f'<joint name="{side}_hip_z" type="revolute">'
        assert joint in text
        mimic = f'<mimic joint="{side}_motor" multiplier="-0.5" offset="0.1"/>'
        text = text.replace(joint, joint + mimic)
        motor = (
            f'<link name="{side}_gear"><inertial><mass value="0.1"/><inertia '
            'ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
            "</link>"
            f'<joint name="{side}_motor" type="revolute"><parent link="pelvis"/>'
            f'<child link="{side}_gear"/><axis xyz="0 0 1"/>'
            '<limit lower="-2" upper="2" effort="50" velocity="6"/></joint></robot>'
        )
        text = text.replace("</robot>", motor)
    file = folder / "geared.urdf"
    file.write_text(text)
    robot = load_robot(file)
    assert [len(leg) for leg in robot.anatomy.legs.values()] == [6, 6]
    j = robot.joints.index("left_hip_z")
    assert robot.torque[j] == pytest.approx(100.0)
    assert robot.speed[j] == pytest.approx(3.0)
    assert robot.upper[j] == pytest.approx(1.1)  # -0.5 * -2 + 0.1, of 2.5 in the file
    assert robot.lower[j] == pytest.approx(-0.9)
    assert "left_motor" not in robot.anatomy.legs[Side.LEFT]


def test_feet_nearly_as_long_as_the_legs_are_feet(folder):
    """Small soccer robots have them: not an edge of theirs is the sole."""
    file = write(folder)
    text = file.read_text()
    assert '<box size="0.22 0.11 0.04"/>' in text
    file.write_text(text.replace('size="0.22 0.11', 'size="0.75 0.15'))
    for sole in load_robot(file).anatomy.soles.values():
        assert sole.size == pytest.approx((0.75, 0.15))


def turned_base(text, *, root):
    """Return a URDF whose base is z-down, below a root that is z-up if asked for."""
    flip = 'rpy="3.14159265358979 0 0"'
    text = text.replace('rpy="0 0 0"', flip, 1)
    if not root:
        return text
    more = f"""<link name="top"/><joint name="turned" type="fixed">
        <parent link="top"/><child link="base"/><origin {flip}/></joint></robot>"""
    return text.replace("</robot>", more)


def test_a_base_that_is_z_down_below_its_root_does_not_matter(folder):
    """Up is z of the root link; forward, left and soles are as without the turn."""
    file = folder / "toy.urdf"
    file.write_text(turned_base(urdf(), root=True))
    found, usual = anatomy_of(file), anatomy_of(write(folder))
    assert found.forward == pytest.approx(usual.forward, abs=1e-9)
    assert (found.legs, found.arms) == (usual.legs, usual.arms)
    for s in Side:
        assert found.soles[s].size == pytest.approx(usual.soles[s].size)


def test_a_root_that_is_z_down_is_told(folder):
    file = folder / "toy.urdf"
    file.write_text(turned_base(urdf(), root=False))
    with pytest.raises(ModelError, match="z up in the root link"):
        load_robot(file)


def test_the_lowest_shape_is_the_sole(folder):
    """A box at the ankle is not taken for the sole if a mesh lies below it."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.box(extents=(0.24, 0.12, 0.03))
    mesh.apply_translation((0.02, 0.0, -0.085))
    mesh.export(folder / "foot.stl")
    at_ankle = (
        '<collision><geometry><box size="0.1 0.08 0.06"/></geometry></collision>'
        '<collision><geometry><mesh filename="foot.stl"/></geometry></collision>'
    )
    text = urdf(foot="none")
    for s in Side:
        text = with_shape(text, f"link_{s}_ankle_x", at_ankle)
    file = folder / "mixed.urdf"
    file.write_text(text)
    for sole in anatomy_of(file).soles.values():
        assert sole.origin == "collision meshes"
        assert sole.size == pytest.approx((0.24, 0.12), abs=1e-4)
        assert sole.ankle == pytest.approx((-0.02, 0.0, 0.1), abs=1e-4)


KNOWN = {
    "jvrc1": ("L_HIP_P", "L_ANKLE_P", "WAIST_Y", "NECK_Y", "R_SHOULDER_P", 12),
    "talos": ("leg_left_1_joint", "leg_left_6_joint", "torso_1_joint", "head_1_joint",
              "arm_right_1_joint", 2),
    "talos_full": ("leg_left_1_joint", "leg_left_6_joint", "torso_1_joint",
                   "head_1_joint", "arm_right_1_joint", 14),
    "g1": ("left_hip_pitch_joint", "left_ankle_roll_joint", "waist_yaw_joint", None,
           "right_shoulder_pitch_joint", 0),
    "mjlab_g1": ("left_hip_pitch_joint", "left_ankle_roll_joint", "waist_yaw_joint",
                 None, "right_shoulder_pitch_joint", 0),
    "romeo": ("LHipYaw", "LAnkleRoll", "TrunkYaw", "NeckYaw", "RShoulderPitch", 24),
    "icub": ("l_hip_pitch", "l_ankle_roll", "torso_pitch", "neck_pitch",
             "r_shoulder_pitch", 0),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_known_robots(name):
    """First and last joint of the left leg, first of torso, head and right arm."""
    try:
        robot = load_robot(name)
    except ModelError as error:
        pytest.skip(str(error))
    hip, ankle, waist, neck, shoulder, locked = KNOWN[name]
    found = robot.anatomy
    assert (found.legs[LEFT][0], found.legs[LEFT][-1]) == (hip, ankle)
    assert found.torso[0] == waist
    assert found.head[:1] == (() if neck is None else (neck,))
    assert found.arms[RIGHT][0] == shoulder
    assert len(found.locked) == locked
    assert [len(found.legs[s]) for s in Side] == [6, 6]
    assert {len(arm) for arm in found.arms.values()} == {7}
    assert abs(found.forward) == pytest.approx(math.pi if name == "icub" else 0.0)
    left, right = (found.soles[s].size for s in Side)
    assert left == pytest.approx(right, rel=0.02)
    assert {"l_elbow_pitch", "r_elbow_pitch", "waist_yaw"} <= set(robot.roles)


def test_joints_and_roles_are_paired_for_the_largest_sum():
    """More joints than roles, or fewer: as scipy's assignment has it."""
    rng = np.random.default_rng(5)
    for shape in ((1, 3), (2, 3), (3, 3), (6, 3), (4, 1)):
        shares = rng.random(shape)
        rows, columns = linear_sum_assignment(-shares)
        pairs = {(int(r), int(c)) for r, c in zip(rows, columns, strict=True)}
        assert set(_best_pairs(shares)) == pairs


def test_roles_turn_as_they_are_called(folder):
    """A role's sign makes it turn left, forward or up, whatever the axis in it."""
    text = urdf()
    flipped = text.replace(
        '<child link="link_left_elbow_y"/>', '<child link="link_left_elbow_y"/><!-- -->'
    )
    start = flipped.index("<!-- -->")
    axis = flipped.index('<axis xyz="0 1 0"/>', start)
    flipped = flipped[:axis] + '<axis xyz="0 -1 0"/>' + flipped[axis + 19 :]
    for content, sign in ((text, 1.0), (flipped, -1.0)):
        file = folder / "roles.urdf"
        file.write_text(content)
        roles = load_robot(file).roles
        assert roles["l_elbow_pitch"] == ("left_elbow_y", sign)
        assert roles["waist_yaw"] == ("waist_z", 1.0)
        assert roles["head_pitch"] == ("neck_y", 1.0)
