"""What a model gets to walk: frames, sensors, servos, soles; what it keeps."""

from __future__ import annotations

import itertools
import math
import re

import mujoco
import numpy as np
import pytest
from models import LEG, urdf, with_shape, write
from readable import holding_forces

from comwalk.certificates.defaults import walk_pattern
from comwalk.control.settings import SimulatorSettings
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import load_robot
from comwalk.robot.servos import LEG_STIFFNESS
from comwalk.run import simulate
from comwalk.sides import Side
from comwalk.views.scene_data import sole_box
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.mujoco_scene import build_scene
from comwalk.walking.whole_body import WholeBody


def mjcf(folder, change=lambda text: text, **options):
    """Write a humanoid as MJCF, its text changed, and return the file."""
    text = read_model(write(folder, **options)).spec.to_xml()
    file = folder / "toy.xml"
    file.write_text(change(text))
    return file


def locked_inertia(robot):
    """Return mass, CoM and inertia about it, in the base's axes, joints as at home."""
    kinematics, q = Kinematics(robot), robot.home.copy()
    q[:7] = 0, 0, 0, 1, 0, 0, 0
    com = kinematics.posture(q).com
    inertia = np.zeros((3, 3))
    for k, axis in enumerate(np.eye(3)):
        turning = np.zeros(robot.model.nv)
        turning[3:6] = axis
        inertia[:, k] = kinematics.angular_momentum(turning)
    return robot.mass, com, inertia


BASES = {
    "as it is": lambda t: t,
    "by moments and a quaternion": lambda t: re.sub(
        r'(<body name="base">\s*)<inertial[^>]*/>',
        r'\1<inertial pos="0.01 0.02 0.03" quat="0.8 0.2 0.4 0.4" mass="1" '
        r'diaginertia="0.02 0.03 0.04"/>',
        t,
    ),
    "by a full matrix": lambda t: re.sub(
        r'(<body name="base">\s*)<inertial[^>]*/>',
        r'\1<inertial pos="0.01 0.02 0.03" mass="1" '
        r'fullinertia="0.02 0.03 0.04 0.002 -0.003 0.004"/>',
        t,
    ),
    "by angles": lambda t: re.sub(
        r'(<body name="base">\s*)<inertial[^>]*/>',
        r'\1<inertial pos="0.01 0.02 0.03" euler="0.3 0.2 0.1" mass="1" '
        r'diaginertia="0.02 0.03 0.04"/>',
        t,
    ),
    "in frames": lambda t: t.replace(
        '<body name="pelvis"', '<frame pos="0 0.1 0" euler="30 10 50"><frame pos="0 0 '
        '0.1"><body name="extra" pos="0.1 0 0"><inertial pos="0 0 0" mass="3" '
        'diaginertia="0.1 0.2 0.25"/></body><body name="more" pos="0.1 0 0.2"><inertial'
        ' pos="0 0 0" mass="3" diaginertia="0.1 0.2 0.25"/></body></frame></frame>'
        '<body name="pelvis"'
    ),
    "by geoms": lambda t: re.sub(
        r'(<body name="base">\s*)<inertial[^>]*/>',
        r'\1<geom type="capsule" fromto="0 0 0 0.1 0.2 0.1" size="0.05" mass="1" '
        r'contype="0" conaffinity="0"/>',
        t,
    ),
}  # fmt: skip


@pytest.mark.parametrize("change", BASES.values(), ids=BASES)
@pytest.mark.parametrize("forward", [90.0, 180.0, -120.0])
def test_a_turned_base_is_the_same_robot(tmp_path, change, forward):
    """Told to walk another way, the body turns under the frame; nothing else does.

    A body turned about the vertical has its CoM and inertia turned with it; the model
    is the same humanoid, whose sideways is now its forward.
    """
    file = mjcf(tmp_path, change)
    one = load_robot(file)
    profile = {"forward": forward, "home": one.home_angles, "legs": one.anatomy.legs}
    profile["legs"] = {str(k): v for k, v in one.anatomy.legs.items()}
    other = load_robot(file, profile=profile)
    mass, com, inertia = locked_inertia(one)
    mass_2, com_2, inertia_2 = locked_inertia(other)
    c, s = math.cos(math.radians(forward)), math.sin(math.radians(forward))
    R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    assert mass == pytest.approx(mass_2, rel=1e-12)
    assert R @ com == pytest.approx(com_2, abs=1e-6)
    assert np.abs(R @ inertia @ R.T - inertia_2).max() < 1e-6 * inertia.max()


def test_a_base_that_is_upside_down_in_its_file(tmp_path):
    """The base lies as its file has it; its frame for walking is x forward, z up."""
    text = urdf().replace('rpy="0 0 0"', 'rpy="3.141592653589793 0 0"', 1)
    assert 'name="root"' in text.split("3.14159")[0]
    file = tmp_path / "down.urdf"
    file.write_text(text)
    spec = read_model(file).spec
    spec.worldbody.first_body().quat = np.array([0.0, 1.0, 0.0, 0.0])
    turned = tmp_path / "turned.xml"
    turned.write_text(spec.to_xml())
    one, other = load_robot(write(tmp_path)), load_robot(turned)
    assert one.home == pytest.approx(other.home, abs=1e-6)
    for a, b in zip(locked_inertia(one), locked_inertia(other), strict=True):
        assert a == pytest.approx(b, abs=1e-6)


def test_the_soles_are_all_that_collides(tmp_path):
    """No part but the file's own soles touches the ground or another part."""
    robot = load_robot(write(tmp_path))
    m = robot.model
    touching = [g for g in range(m.ngeom) if m.geom_contype[g] or m.geom_conaffinity[g]]
    bodies = {m.body(m.geom_bodyid[g]).name for g in touching}
    assert bodies == {"link_left_ankle_x", "link_right_ankle_x"}
    assert len(touching) == 2


@pytest.mark.parametrize("foot", ["box", "none"])
def test_a_standing_robot_weighs_what_it_weighs(tmp_path, foot):
    """In the simulator, ankle sensors and weight of the feet make the body's weight."""
    robot = load_robot(write(tmp_path, foot=foot))
    plant = SimulatedRobot(robot, 0.002)
    body = WholeBody(robot, 0.002)
    command = body.start(walk_pattern(robot, 1).at(0.0))
    plant.place(body.configuration)
    sensors = plant.start(command)
    felt = sensors.wrenches[:, 2].sum()
    feet = sum(foot.mass for foot in robot.feet.values())
    assert felt + feet * 9.81 == pytest.approx(robot.mass * 9.81, rel=0.02)
    load = plant.truth().loads
    assert load.sum() == pytest.approx(robot.mass * 9.81, rel=0.02)


@pytest.mark.parametrize("euler", ["", ' euler="0.4 0.5 0.6"'])
def test_locked_joints_stay_where_they_are(tmp_path, euler):
    """Fingers that cannot be at zero are locked as near to it as they can."""
    finger = '<body name="left_finger0_1"'
    options = {"fingers": 2, "limits": {"f": (0.5, 1.0)}}
    file = mjcf(tmp_path, lambda t: t.replace(finger, finger + euler), **options)
    assert finger in file.read_text()
    robot, whole = load_robot(file), read_model(file).spec.compile()
    data, own = mujoco.MjData(whole), mujoco.MjData(robot.model)
    for k in range(1, whole.njnt):
        joint = whole.joint(k)
        named = robot.home_angles.get(joint.name, 0.5)
        data.qpos[joint.qposadr[0]] = named
    data.qpos[:7], own.qpos[:] = robot.home[:7], robot.home
    mujoco.mj_kinematics(whole, data)
    mujoco.mj_kinematics(robot.model, own)
    for k in range(1, whole.nbody):
        body = robot.model.body(whole.body(k).name)
        assert own.xipos[body.id] == pytest.approx(data.xipos[k], abs=1e-9)
        assert float(body.mass[0]) == pytest.approx(float(whole.body_mass[k]))


# ---- Servos -----------------------------------------------------------------------


def test_designed_servos(tmp_path):
    """Legs and torso by m g c_z, and what hangs by its inertia: no note, all marked."""
    robot = load_robot(write(tmp_path), actuation="position")
    height = Kinematics(robot).posture(robot.home).com[2]
    stiff = LEG_STIFFNESS * robot.mass * 9.81 * height
    gains = dict(zip(robot.joints, robot.servo.stiffness.tolist(), strict=True))
    legs = [gains[j] for leg in robot.anatomy.legs.values() for j in leg]
    assert legs == pytest.approx([stiff] * 12, rel=1e-2)
    assert gains["waist_y"] == pytest.approx(stiff, rel=1e-2)
    assert gains["left_shoulder_y"] < 0.5 * stiff
    assert robot.anatomy.designed == robot.joints
    assert robot.notes == ()


@pytest.mark.parametrize("actuation", ["position", "pd"])
def test_servos_scale_with_the_robot(tmp_path, actuation):
    """Stiffness as length^4, damping as length^4.5, armature as length^5."""
    one = load_robot(write(tmp_path, scale=1.0), actuation=actuation)
    small = load_robot(write(tmp_path, scale=0.25), actuation=actuation)
    ratio = small.servo.stiffness / one.servo.stiffness
    assert ratio == pytest.approx(0.25**4, rel=2e-2)
    assert small.servo.damping / one.servo.damping == pytest.approx(0.25**4.5, rel=2e-2)
    armature = small.model.dof_armature[6:] / one.model.dof_armature[6:]
    assert armature == pytest.approx(0.25**5, rel=2e-2)


def with_actuators(lines):
    """Return what puts actuators into an MJCF."""
    block = f"<actuator>{''.join(lines)}</actuator></mujoco>"
    return lambda text: text.replace("</mujoco>", block)


def test_position_servos_of_the_file_are_kept(tmp_path):
    """Their gains at the joint, gears included, and their torque limits."""
    lines = [
        '<position joint="left_knee_y" kp="5e4" kv="300"/>',
        '<position joint="right_knee_y" kp="500" kv="3" gear="10"/>',
        '<position joint="left_elbow_y" kp="70" kv="2" forcerange="-9 9"/>',
        '<motor joint="waist_z" gear="2"/>',
        '<velocity joint="neck_z" kv="3"/>',
    ]
    robot = load_robot(mjcf(tmp_path, with_actuators(lines)))
    rows = zip(robot.servo.stiffness, robot.servo.damping, robot.torque, strict=True)
    found = dict(zip(robot.joints, rows, strict=True))
    assert found["left_knee_y"][:2] == pytest.approx((5e4, 300.0))
    assert found["right_knee_y"][:2] == pytest.approx((5e4, 300.0))
    assert found["left_elbow_y"] == pytest.approx((70.0, 2.0, 9.0))
    assert "waist_z" in robot.anatomy.designed
    assert "left_knee_y" not in robot.anatomy.designed
    assert any(note.startswith("2 motors get gains") for note in robot.notes)


def test_soft_servos_are_said_to_be(tmp_path):
    """A leg that sinks under the body, and one on which it sways."""
    soft = '<position joint="left_knee_y" kp="{}" kv="10"/>'
    for kp, message in (("100", "the body sinks"), ("1500", "the body sways at 0.")):
        robot = load_robot(mjcf(tmp_path, with_actuators([soft.format(kp)])))
        assert any("left_knee_y" in n and message in n for n in robot.notes)


def test_damping_of_joints_is_kept(tmp_path):
    """It adds to the velocity gain that the servo is said to have."""
    text = urdf().replace("<axis", '<dynamics damping="3" friction="0.1"/><axis')
    file = tmp_path / "damped.urdf"
    file.write_text(text)
    one, other = load_robot(write(tmp_path)), load_robot(file)
    assert np.allclose(other.model.dof_damping[6:], 3.0)
    assert other.servo.damping - one.servo.damping == pytest.approx(3.0, abs=1e-9)
    assert np.allclose(other.model.dof_frictionloss[6:], 0.1)


def test_geometry_changes_nothing_but_the_look():
    """Meshes are for pictures: masses, soles and posture are the same."""
    one, other = load_robot("jvrc1"), load_robot("jvrc1", geometry=True)
    assert other.model.nmesh > one.model.nmesh
    assert np.array_equal(one.home, other.home)
    assert np.array_equal(one.model.body_mass, other.model.body_mass)
    assert np.array_equal(one.servo.stiffness, other.servo.stiffness)
    assert other.joints == one.joints


# ---- Joints that follow others ----------------------------------------------------

KNEES = {
    "leg": (*LEG[:4], "knee2_y", *LEG[4:]),
    "mimic": {"knee2_y": ("knee_y", 0.8, 0.1), "wrist_z": ("elbow_y", -0.5, 0.0)},
}


@pytest.fixture
def coupled(tmp_path):
    return load_robot(write(tmp_path, **KNEES))


def test_followers_have_no_columns_of_their_own(coupled):
    """Legs and arms list their leaders; the followers may not dance either."""
    followers = {m.joint for m in coupled.anatomy.coupled}
    assert len(followers) == 4
    named = {coupled.joints[j] for x in coupled.limbs[:-1] for j in x.joints}
    assert not followers & named
    assert not followers & set(coupled.upper_body)
    angles = coupled.home_angles
    for s in Side:
        knee = angles[f"{s}_knee_y"]
        assert angles[f"{s}_knee2_y"] == pytest.approx(0.8 * knee + 0.1)


def test_jacobians_with_followers_are_derivatives(coupled):
    """Of CoM and ends, by finite differences of configurations that keep the rules."""
    kinematics, rng = Kinematics(coupled), np.random.default_rng(3)
    posture = kinematics.posture(coupled.home)
    velocity = rng.normal(size=coupled.model.nv)
    ends = []
    for dt in (-1e-6, 1e-6):
        q = kinematics.integrate(coupled.home, velocity, dt)
        coupling = coupled.coupling
        angles = q[7:].copy()
        coupling.follow(angles)
        assert angles == pytest.approx(q[7:], abs=1e-9)
        moved = kinematics.posture(q)
        ends.append(np.concatenate([moved.com, moved.ends[:2].ravel()]))
    rows = [0, 1, 2, 3, 4, 5, 9, 10, 11]
    rates = (posture.jacobian @ velocity)[rows]
    assert (ends[1] - ends[0]) / 2e-6 == pytest.approx(rates, abs=1e-6)


def test_forces_with_followers_do_the_same_work(coupled):
    """What carries the body does the power that lifting its CoM takes."""
    kinematics, rng = Kinematics(coupled), np.random.default_rng(4)
    posture = kinematics.posture(coupled.home)
    forces = holding_forces(kinematics, np.zeros(3))
    velocity = rng.normal(size=coupled.model.nv)
    velocity[3:6] = 0.0
    lift = (posture.jacobian[:3] @ velocity)[2]
    assert forces @ velocity == pytest.approx(coupled.mass * 9.81 * lift, rel=1e-9)


def test_limits_of_followers_are_the_leaders(tmp_path):
    """A leader moves no farther and no faster than what follows it may."""
    limits = {"knee_y": (-0.5, 2.0), "knee2_y": (0.0, 0.9)}
    robot = load_robot(write(tmp_path, limits=limits, **KNEES))
    j = robot.joints.index("left_knee_y")
    assert robot.lower[j] == pytest.approx(-0.125)
    assert robot.upper[j] == pytest.approx(1.0)
    k = robot.joints.index("left_knee2_y")
    assert math.isinf(robot.upper[k])


def test_followers_follow_in_physics(coupled):
    """A walk of a step, by leaders that alone are driven; rules hold within 1 deg."""
    run = simulate(coupled, walk_pattern(coupled, 1))
    assert run.outcome.ok
    qpos = run.log.columns["qpos"]
    place = {name: 7 + j for j, name in enumerate(coupled.joints)}
    for mimic in coupled.anatomy.coupled:
        wanted = mimic.ratio * qpos[:, place[mimic.primary]] + mimic.offset
        assert np.abs(qpos[:, place[mimic.joint]] - wanted).max() < 0.02


# ---- Walking ----------------------------------------------------------------------


def test_jvrc_walks():
    """From a URDF as it is to four steps in physics."""
    robot = load_robot("jvrc1")
    run = simulate(robot, walk_pattern(robot, 4))
    assert run.outcome.ok
    summary = run.summary()
    assert summary["steps_completed"] == 4
    assert summary["sole_margin_min_mm"] > 0.0


def test_legs_of_five_joints_walk_straight(tmp_path):
    """Without hip yaw the resolution still goes where it is sent."""
    robot = load_robot(write(tmp_path, leg=LEG[1:], arms=(), neck=()))
    run = simulate(robot, walk_pattern(robot, 2), force=True)
    assert run.outcome.ok
    figures = run.summary()
    assert figures["distance_m"] == pytest.approx(run.log["com_ref"][-1, 0], abs=1e-3)
    assert figures["position_error_m"] < 1e-3
    assert abs(run.log["com_true"][-1, 1]) < 1e-3
    assert figures["zmp_error_rms_mm"]["x"] < 10.0


def test_a_scene_has_the_robot_and_a_floor(tmp_path):
    """Marked models compile with what the simulator adds."""
    robot = load_robot(write(tmp_path, foot="none"))
    scene = build_scene(robot, SimulatorSettings())
    assert scene.nq == len(robot.home)
    assert scene.ngeom > robot.model.ngeom


@pytest.mark.parametrize("tilt", [0.02, 0.05, 0.2, -0.06])
def test_feet_that_lie_tilted_in_the_zero_posture(tmp_path, tilt):
    """As CAD exports have them: all studs of a foot touch the ground, and stay."""
    c, s = math.cos(tilt), math.sin(tilt)

    def stud(x: float, y: float, z: float = -0.065) -> str:
        place = f"{c * x + s * z:.9f} {y} {c * z - s * x:.9f}"
        return (
            f'<collision><origin xyz="{place}" rpy="0 {tilt} 0"/>'
            '<geometry><box size="0.02 0.02 0.03"/></geometry></collision>'
        )

    studs = "".join(stud(x, y) for x in (-0.07, 0.15) for y in (-0.04, 0.04))
    text = urdf(foot="none")
    for side in Side:
        text = with_shape(text, f"link_{side}_ankle_x", studs)
    file = tmp_path / "studs.urdf"
    file.write_text(text)
    robot = load_robot(file)
    m, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robot.home
    mujoco.mj_forward(m, data)
    touching = [g for g in range(m.ngeom) if m.geom_contype[g] or m.geom_conaffinity[g]]
    assert len(touching) == 8
    run = simulate(robot, walk_pattern(robot, 1))
    assert run.outcome.ok
    load = run.log["loads_true"].sum(axis=1)
    weight = robot.mass * robot.gravity
    assert load.mean() == pytest.approx(weight, rel=0.01)
    for g in touching:
        corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
        R = data.geom_xmat[g].reshape(3, 3)
        low = data.geom_xpos[g] + (corners * m.geom_size[g]) @ R.T
        assert low[:, 2].min() == pytest.approx(0.0, abs=1e-4)
        assert abs(R[2, 2]) == pytest.approx(1.0, abs=1e-6)


def test_what_is_fixed_to_a_foot_is_part_of_it(tmp_path):
    """Cleats that are links of their own: the ground bears the foot by them."""
    text = urdf(foot="none")
    for side in Side:
        for n, (x, y) in enumerate(itertools.product((-0.07, 0.15), (-0.04, 0.04))):
            name = f"cleat_{side}_{n}"
            text = text.replace(
                "</robot>",
                f'<link name="{name}"><collision><geometry><box size="0.02 0.02 0.03"/>'
                f'</geometry></collision></link><joint name="at_{name}" type="fixed">'
                f'<origin xyz="{x} {y} -0.065"/><parent link="link_{side}_ankle_x"/>'
                f'<child link="{name}"/></joint></robot>',
            )
    file = tmp_path / "cleats.urdf"
    file.write_text(text)
    robot = load_robot(file)
    run = simulate(robot, walk_pattern(robot, 1))
    assert run.outcome.ok
    weight = robot.mass * robot.gravity
    assert run.log["loads_true"].sum(axis=1).mean() == pytest.approx(weight, rel=0.01)
    assert np.isfinite(run.log["zmp_true"]).mean() > 0.99
    data = mujoco.MjData(run.scene)
    data.qpos[:] = run.log["qpos"][0]
    mujoco.mj_kinematics(run.scene, data)
    for side in Side:
        box = sole_box(run.scene, data, side)
        assert 2.0 * box.size[:2] == pytest.approx([0.24, 0.1], abs=1e-3)


def test_what_a_file_says_of_motors_in_general_is_not_for_our_servos(tmp_path):
    """A gear of 50 in its defaults would make each servo 50 times as stiff."""
    text = read_model(write(tmp_path)).spec.to_xml()
    motors = '<default><motor gear="50" ctrllimited="true" ctrlrange="-1 1"/></default>'
    found = []
    for more in ("", motors):
        file = tmp_path / "robot.xml"
        file.write_text(text.replace("<worldbody>", f"{more}<worldbody>", 1))
        m = load_robot(file, actuation="position").model
        assert not m.actuator_ctrllimited.any()
        found.append((m.actuator_gear, m.actuator_gainprm, m.actuator_forcerange))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (found[0][0][:, 0] == 1.0).all()
