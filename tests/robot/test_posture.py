"""The posture to walk from: soles flat, CoM over them, trunk upright, legs bent."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from models import LEG, write

from comwalk.certificates.description import describe
from comwalk.errors import ModelError
from comwalk.robot.kinematic_tree import Skeleton
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import load_robot
from comwalk.robot.posture import BEND, LEAST_BEND
from comwalk.sides import Side

ROBOTS = ("jvrc1", "talos", "talos_full", "g1", "mjlab_g1", "romeo", "icub")
BUILDS = {
    "usual": {},
    "tiny": {"scale": 0.15},
    "giant": {"scale": 3.0},
    "turned": {"yaw": 2.0},
    "arms aside": {"pose": "tee"},
    "arms forward": {"pose": "forward"},
    "uneven": {"uneven": 0.02},
    "knees bent": {"limits": {"knee_y": (0.3, 2.0)}},
    "double knee": {
        "leg": (*LEG[:4], "knee2_y", *LEG[4:]),
        "mimic": {"knee2_y": ("knee_y", 1.0, 0.0)},
    },
    "a lift": {"slide": ("waist_z",), "limits": {"waist_z": (-0.1, 0.1)}},
}


def check_standing(robot):
    """Check what holds of every posture to walk from."""
    posture = Kinematics(robot).posture(robot.home)
    height = posture.com[2]
    left, right = posture.ends[:2]
    assert np.abs(posture.ends[:2, 2]).max() < 2e-4 * height
    assert np.abs(0.5 * (left + right)[:2] - posture.com[:2]).max() < 2e-4 * height
    assert np.abs(posture.end_rotations[:2] - np.eye(3)).max() < 2e-4
    assert np.abs(posture.rotation - np.eye(3)).max() < 2e-4
    assert left[0] == pytest.approx(right[0], abs=2e-4 * height)
    assert np.all(robot.home[7:] >= robot.lower - 1e-9)
    assert np.all(robot.home[7:] <= robot.upper + 1e-9)
    inner = left[1] + robot.feet[Side.LEFT].sole[:, 1].min()
    assert inner > right[1] + robot.feet[Side.RIGHT].sole[:, 1].max()


def check_arms(robot):
    """Check that hands hang beside the body, below the shoulders, and in front."""
    posture, kinematics = Kinematics(robot).posture(robot.home), Kinematics(robot)
    kinematics.update(robot.home)
    for i, limb in enumerate(robot.limbs):
        if limb.name.endswith("arm"):
            shoulder = kinematics.data.xanchor[limb.joints[0] + 1]
            hand = posture.ends[i]
            assert hand[2] < shoulder[2] - 0.2 * posture.com[2]
            sign = 1.0 if limb.name.startswith("left") else -1.0
            assert sign * hand[1] > 0.0
            assert hand[0] > shoulder[0]


@pytest.mark.parametrize("name", ROBOTS)
def test_known_robots_stand(name):
    """Flat, upright, within their limits; as bent as wanted, or as they are able to."""
    try:
        robot = load_robot(name)
    except ModelError as error:
        pytest.skip(str(error))
    check_standing(robot)
    check_arms(robot)


@pytest.mark.parametrize("options", BUILDS.values(), ids=BUILDS)
def test_any_humanoid_stands(tmp_path, options):
    """At any size, turned, with arms anywhere at zero."""
    robot = load_robot(write(tmp_path, **options))
    check_standing(robot)
    check_arms(robot)


def bend(robot) -> float:
    """Return the smallest singular value of the legs [rad], by finite differences."""
    values = []
    for side in Side:
        site, names = robot.feet[side].site, robot.anatomy.legs[side]
        data, columns = mujoco.MjData(robot.model), []
        for name in names:
            ends = []
            for step in (-1e-6, 1e-6):
                data.qpos[:] = robot.home
                data.qpos[robot.model.joint(name).qposadr[0]] += step
                mujoco.mj_kinematics(robot.model, data)
                ends.append((data.site_xpos[site].copy(), data.site_xmat[site].copy()))
            (p_0, R_0), (p_1, R_1) = ends
            S = (R_1 - R_0).reshape(3, 3) @ R_0.reshape(3, 3).T
            columns.append([*(p_1 - p_0), S[2, 1], S[0, 2], S[1, 0]])
        J = np.array(columns).T / 2e-6
        J[:3] /= 0.8
        values.append(np.linalg.svd(J, compute_uv=False)[-1])
    return min(values)


def test_legs_are_as_bent_as_those_of_the_paper(tmp_path):
    """Where the torques allow it, the singular value is that of the paper's robot."""
    robot = load_robot(write(tmp_path, effort=1000.0))
    assert bend(robot) == pytest.approx(BEND, rel=1e-3)
    assert describe(robot)["bend_rad"] == pytest.approx(BEND, rel=1e-3)


def test_weak_legs_are_stretched(tmp_path):
    """A knee that cannot bear so much bends less, but never less than the least."""
    strong, weak, weakest = (
        load_robot(write(tmp_path, effort=effort)) for effort in (1000.0, 90.0, 20.0)
    )
    assert bend(strong) > bend(weak) >= LEAST_BEND - 1e-3
    assert bend(weakest) == pytest.approx(LEAST_BEND, rel=1e-2)


def limited(tmp_path, joint: str, **limits: float):
    """Return a robot of which one joint of each leg has other limits."""
    joints = {f"{side}_{joint}": limits for side in ("left", "right")}
    return load_robot(write(tmp_path), profile={"limits": joints})


@pytest.mark.parametrize(
    ("ankle", "least", "most"),
    [(1.0, BEND, BEND), (0.6, 0.13, 0.15), (0.45, LEAST_BEND, 0.14)],
)
def test_ankles_of_little_range_stretch_the_legs(tmp_path, ankle, least, most):
    """So that a step is free: -0.45 rad at rest, and a step takes some 0.25 more."""
    robot = limited(tmp_path, "ankle_y", lower=-ankle, upper=ankle)
    assert least - 1e-3 <= bend(robot) <= most + 1e-3
    check_standing(robot)
    assert describe(robot)["gait"]["speed_m_s"] > 0.05


def test_weak_hips_lower_the_body(tmp_path):
    """The force leans from the foot to the CoM, nearer past a low hip."""
    strong, weak = (limited(tmp_path, "hip_x", torque=x) for x in (70.0, 60.0))
    assert bend(strong) == pytest.approx(BEND, rel=1e-3)
    assert bend(weak) > 0.2
    gait = describe(weak)["gait"]
    assert gait["fault"] is None
    assert gait["speed_m_s"] > 0.1


def test_hips_of_little_range_take_quick_steps(tmp_path):
    """A quick step sways less: at 0.09 rad half of the usual time is left."""
    wide, narrow = (
        describe(limited(tmp_path, "hip_x", lower=-x, upper=x))["gait"]
        for x in (0.3, 0.09)
    )
    assert narrow["fault"] is None
    assert narrow["step_time_s"] == pytest.approx(0.5 * wide["step_time_s"], rel=1e-3)
    assert narrow["speed_m_s"] > 0.5 * wide["speed_m_s"]


def test_a_stance_may_be_given(tmp_path):
    """A bend, a CoM height, or the distance of the feet."""
    file = write(tmp_path, effort=1000.0)
    robot = load_robot(file, profile={"stance": {"bend": 0.25, "half_width": 0.12}})
    assert bend(robot) == pytest.approx(0.25, rel=1e-3)
    check_standing(robot)
    ends = Kinematics(robot).posture(robot.home).ends
    assert ends[:2, 1].tolist() == pytest.approx([0.12, -0.12], abs=1e-5)
    robot = load_robot(file, profile={"stance": {"com_height": 0.8}})
    assert Kinematics(robot).posture(robot.home).com[2] == pytest.approx(0.8, abs=1e-4)
    with pytest.raises(ModelError, match=r"nearest is .* change com_height"):
        load_robot(file, profile={"stance": {"com_height": 2.0}})


def test_angles_may_be_given(tmp_path):
    """Given angles stay; legs that are given whole are put on the ground."""
    file = write(tmp_path)
    legs = {"hip_z": 0.0, "hip_x": 0.0, "hip_y": -0.3, "knee_y": 0.6, "ankle_y": -0.3}
    home = {f"{side}_{joint}": q for side in Side for joint, q in legs.items()}
    home |= {"left_ankle_x": 0.0, "right_ankle_x": 0.0, "left_elbow_y": -1.2}
    robot = load_robot(file, profile={"home": home})
    found = robot.home_angles
    assert all(found[joint] == angle for joint, angle in home.items())
    ends = Kinematics(robot).posture(robot.home).ends
    assert np.abs(ends[:2, 2]).max() < 1e-9


def test_legs_that_cannot_stand_are_refused(tmp_path):
    """Ankles that point the toes: one line, which joints end, and what to do."""
    limits = {"hip_y": (0.2, 0.3), "knee_y": (0.0, 0.1), "ankle_y": (0.2, 0.3)}
    file = write(tmp_path, limits=limits)
    match = r"stand on bent legs: .* ranges: .*left_ankle_y at 0.22 rad.* --profile"
    with pytest.raises(ModelError, match=match) as caught:
        load_robot(file)
    assert "toy.urdf" in str(caught.value)


def test_shorter_legs_stand_level(tmp_path):
    """Four joints: the soles are level, though not free in every direction."""
    for leg in (LEG[1:], ("hip_x", "hip_y", "knee_y", "ankle_y")):
        robot = load_robot(write(tmp_path, leg=leg))
        check_standing(robot)
        assert math.isfinite(bend(robot))


def test_legs_that_lack_a_joint_are_told_which(tmp_path):
    """Whether or not they can stand."""
    found = {}
    for leg in (LEG[:-1], LEG[1:]):
        robot = load_robot(write(tmp_path, leg=leg))
        limb = next(limb for limb in robot.limbs if limb.name == "left_leg")
        kinematics = Kinematics(robot)
        kinematics.posture(robot.home)
        look = Skeleton(robot.model, kinematics.data, "")
        found[leg] = look.lacks([j + 1 for j in limb.joints])
    assert "5 joints; the roll of the ankle is missing" in found.values()
    assert "5 joints; the yaw of the hip is missing" in found.values()


def test_knees_that_bend_back(tmp_path):
    """As those of a bird, if the ranges are theirs."""
    limits = {"hip_y": (-0.1, 1.6), "knee_y": (-2.1, 0.1), "ankle_y": (-0.1, 1.6)}
    robot = load_robot(write(tmp_path, limits=limits))
    check_standing(robot)
    assert robot.home_angles["left_knee_y"] < -0.3
    assert bend(robot) == pytest.approx(BEND, abs=0.02)
