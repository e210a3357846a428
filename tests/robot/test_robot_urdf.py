"""The URDF of a robot moves as its model does: Pinocchio reads it and says so."""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import pinocchio
import pytest

from comwalk.robot.model import load_robot
from comwalk.robot.urdf_export import link_names, robot_urdf

ANCHORED = """
<mujoco><worldbody><body name="base"><freejoint/><geom size=".1"/>
  <body name="arm" pos=".1 .2 .3" euler="10 20 30">
    <joint name="a" axis="0 1 0" pos=".1 0 .05" range="-90 90"/>
    <joint name="b" axis="1 0 .5" pos="0 .2 0"/>
    <joint name="s" type="slide" axis="0 0 1" range="-1 1"/>
    <geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".03"/>
    <body pos="0 0 .4"><geom type="ellipsoid" size=".1 .2 .3"/></body>
  </body></body></worldbody></mujoco>
"""


def anchored() -> SimpleNamespace:
    """Return a robot whose joints are away from the origins of their links."""
    model = mujoco.MjModel.from_xml_string(ANCHORED)
    joints = tuple(model.joint(i).name for i in range(1, model.njnt))
    lower = np.where(model.jnt_limited[1:] > 0, model.jnt_range[1:, 0], -np.inf)
    infinite = np.full(len(joints), np.inf)
    return SimpleNamespace(
        name="anchored",
        model=model,
        joints=joints,
        base_body=1,
        lower=lower,
        upper=-lower,
        speed=infinite,
        torque=infinite,
    )


def robots() -> dict[str, object]:
    return {
        "paper": load_robot("paper"),
        "jvrc1": load_robot("jvrc1"),
        "anchored": anchored(),
    }


@pytest.mark.parametrize(("name", "robot"), robots().items(), ids=robots())
def test_links_are_where_the_model_has_them(name, robot):
    urdf = robot_urdf(robot)
    theirs = pinocchio.buildModelFromXML(urdf, pinocchio.JointModelFreeFlyer())
    data, ours = theirs.createData(), mujoco.MjData(robot.model)
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = pinocchio.neutral(theirs)
        ours.qpos[7:] = rng.uniform(-0.5, 0.5, robot.model.nq - 7)
        ours.qpos[3:7] = rng.normal(size=4)
        ours.qpos[:3] = q[:3] = rng.normal(size=3)
        mujoco.mj_normalizeQuat(robot.model, ours.qpos)
        mujoco.mj_kinematics(robot.model, ours)
        q[3:7] = ours.qpos[[4, 5, 6, 3]]
        for joint, angle in zip(robot.joints, ours.qpos[7:], strict=True):
            there = theirs.joints[theirs.getJointId(joint)]
            values = [angle] if there.nq == 1 else [np.cos(angle), np.sin(angle)]
            q[there.idx_q : there.idx_q + there.nq] = values
        pinocchio.framesForwardKinematics(theirs, data, q)
        for body, link in enumerate(link_names(robot.model)[1:], start=1):
            frame = theirs.getFrameId(link, pinocchio.FrameType.BODY)
            pose = data.oMf[frame]
            assert pose.translation == pytest.approx(ours.xpos[body], abs=1e-7)
            turn = ours.xmat[body].reshape(3, 3)
            np.testing.assert_allclose(pose.rotation, turn, atol=1e-7)
    mass = robot.model.body_subtreemass[robot.base_body]
    assert pinocchio.computeTotalMass(theirs) == pytest.approx(mass)


@pytest.mark.parametrize(("name", "robot"), robots().items(), ids=robots())
def test_there_is_something_to_see(name, robot):
    """Robots whose meshes are not loaded get rods."""
    urdf = robot_urdf(robot)
    assert urdf.count("<visual>") >= robot.model.nbody / 2
    assert "mesh" not in urdf
    assert "nan" not in urdf
    assert "inf" not in urdf


def test_limits_are_said():
    robot = load_robot("paper")
    k = robot.joints.index("l_knee_pitch")
    theirs = pinocchio.buildModelFromXML(robot_urdf(robot))
    j = theirs.idx_qs[theirs.getJointId(robot.joints[k])]
    assert theirs.lowerPositionLimit[j] == pytest.approx(robot.lower[k])
    assert theirs.upperPositionLimit[j] == pytest.approx(robot.upper[k])
