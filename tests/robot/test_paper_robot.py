"""The paper's robot: mass, walking posture, names, limits, sensors and standing."""

import math
from importlib.resources import files

import mujoco
import numpy as np
import pytest
from scipy.optimize import least_squares

PATH = str(files("comwalk") / "robots" / "paper.xml")
GRAVITY = 9.81
LEG = ("hip_yaw", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
ARM = (
    "shoulder_pitch",
    "shoulder_roll",
    "shoulder_yaw",
    "elbow_pitch",
    "wrist_yaw",
    "wrist_pitch",
    "wrist_roll",
)
TRUNK = ("waist_yaw", "waist_pitch", "head_yaw", "head_pitch")
JOINTS = (
    *(f"{side}_{joint}" for side in "lr" for joint in LEG),
    *TRUNK,
    *(f"{side}_{joint}" for side in "lr" for joint in ARM),
)
PAIRED_FRAMES = ("wrist", "gripper", "ankle", "sole", "ankle_ft")
MIRROR = np.diag([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(PATH)


@pytest.fixture
def walk(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the robot in its walking posture."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("walk").id)
    mujoco.mj_forward(model, data)
    return data


def on_floor(cone: mujoco.mjtCone, impratio: float) -> mujoco.MjModel:
    """Return the robot on a floor."""
    spec = mujoco.MjSpec.from_file(PATH)
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        contype=1,
        conaffinity=1,
    )
    spec.option.timestep = 0.001
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = cone
    spec.option.impratio = impratio
    return spec.compile()


def stand(model: mujoco.MjModel, seconds: float) -> mujoco.MjData:
    """Return the robot after standing in its walking posture."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("walk").id)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return data


def test_it_has_the_mass_of_the_paper(model: mujoco.MjModel) -> None:
    assert model.body_mass.sum() == pytest.approx(67.68, rel=1e-9)


@pytest.mark.parametrize(
    ("body", "low", "high"),
    [
        ("l_shoulder_pitch", 4.5, 5.5),
        ("l_hip_yaw", 9.0, 12.0),
        ("l_shank", 2.8, 3.8),
        ("l_foot", 0.9, 1.1),
        ("neck", 3.2, 3.8),
    ],
)
def test_limbs_have_a_plausible_mass(model, body, low, high) -> None:
    assert low <= model.body_subtreemass[model.body(body).id] <= high


def test_every_inertia_is_physical(model: mujoco.MjModel) -> None:
    for inertia in model.body_inertia[1:]:
        assert inertia.min() > 1e-6
        assert 2 * inertia.max() <= inertia.sum()


def test_in_the_walking_posture_the_com_is_where_the_paper_has_it(walk) -> None:
    soles = [walk.geom(f"{side}_sole_contact").xpos for side in "lr"]
    middle = (soles[0] + soles[1]) / 2
    com = walk.subtree_com[1]
    assert com[2] == pytest.approx(0.687, abs=1e-6)
    assert com[:2] == pytest.approx(middle[:2], abs=1e-6)
    assert com[:2] == pytest.approx([0, 0], abs=1e-6)


def test_in_the_walking_posture_the_soles_are_on_the_ground(walk) -> None:
    left, right = (walk.site(f"{side}_sole") for side in "lr")
    assert left.xpos[1] - right.xpos[1] == pytest.approx(0.18, abs=1e-12)
    assert left.xpos[0] == pytest.approx(right.xpos[0], abs=1e-12)
    for sole in (left, right):
        assert sole.xpos[2] == pytest.approx(0, abs=1e-11)
        assert sole.xmat.reshape(3, 3) == pytest.approx(np.eye(3), abs=1e-11)


def test_in_the_walking_posture_the_trunk_is_upright(model, walk) -> None:
    assert walk.body("torso").xmat.reshape(3, 3) == pytest.approx(np.eye(3), abs=1e-12)
    for side in "lr":
        assert 0.85 <= walk.joint(f"{side}_knee_pitch").qpos[0] <= 0.95
        assert walk.joint(f"{side}_elbow_pitch").qpos[0] == -0.35
    angles = walk.qpos[7:]
    assert model.key("walk").ctrl == pytest.approx(angles, abs=0)


def test_the_zero_pose_stands_on_the_ground_and_is_as_tall_as_a_person(model) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    head = model.geom_bodyid == model.body("head").id
    half_height = model.geom_aabb[head, 5] + model.geom_aabb[head, 2]
    top = (data.geom_xpos[head, 2] + half_height)[model.geom_type[head] == 4].max()
    assert 1.44 <= top <= 1.51
    for side in "lr":
        assert data.site(f"{side}_sole").xpos[2] == pytest.approx(0, abs=1e-12)
        hip, ankle = data.body(f"{side}_thigh").xpos, data.site(f"{side}_ankle").xpos
        assert hip[:2] == pytest.approx(ankle[:2], abs=1e-12)


def test_joints_and_servos_have_the_same_names_and_order(model) -> None:
    assert [model.joint(i).name for i in range(model.njnt)] == ["root", *JOINTS]
    assert [model.actuator(i).name for i in range(model.nu)] == list(JOINTS)
    assert list(model.actuator_trnid[:, 0]) == list(range(1, model.njnt))
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert model.body("base_link").id == model.jnt_bodyid[0] == 1


def test_frames_have_the_names_of_rep_120(model: mujoco.MjModel) -> None:
    names = {model.site(i).name for i in range(model.nsite)}
    paired = {f"{side}_{frame}" for side in "lr" for frame in PAIRED_FRAMES}
    assert names == {"base_link", "torso", "gaze", "imu"} | paired


@pytest.mark.parametrize("name", JOINTS)
def test_pitch_roll_and_yaw_turn_about_y_x_and_z_on_both_sides(model, name) -> None:
    expected = {"pitch": [0, 1, 0], "roll": [1, 0, 0], "yaw": [0, 0, 1]}
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert list(data.joint(name).xaxis) == expected[name.rsplit("_", 1)[1]]


@pytest.mark.parametrize("side", ["l", "r"])
@pytest.mark.parametrize("group", [LEG[:3], LEG[4:], ARM[:3], ARM[4:]])
def test_axes_of_a_hip_ankle_shoulder_or_wrist_meet(model, side, group) -> None:
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[7:] += 0.1 * np.arange(model.nu)
    mujoco.mj_forward(model, data)
    anchors = [data.joint(f"{side}_{joint}").xanchor for joint in group]
    for anchor in anchors[1:]:
        assert anchor == pytest.approx(anchors[0], abs=1e-12)


@pytest.mark.parametrize(
    ("joint", "frame", "axis", "sign"),
    [
        ("knee_pitch", "ankle", 0, -1),
        ("hip_pitch", "ankle", 0, -1),
        ("elbow_pitch", "wrist", 0, -1),
        ("shoulder_roll", "wrist", 1, 1),
        ("hip_roll", "ankle", 1, 1),
    ],
)
@pytest.mark.parametrize("side", ["l", "r"])
def test_a_positive_angle_moves_the_limb_as_documented(
    model, side, joint, frame, axis, sign
) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.site(f"{side}_{frame}").xpos.copy()
    data.joint(f"{side}_{joint}").qpos[0] = 0.1
    mujoco.mj_forward(model, data)
    moved = data.site(f"{side}_{frame}").xpos - before
    assert sign * moved[axis] > 0.015


@pytest.mark.parametrize("name", JOINTS)
def test_limits_are_complete_and_leave_room_around_the_walking_posture(
    model, walk, name
) -> None:
    joint, servo = model.joint(name), model.actuator(name)
    low, high = joint.range
    angle = walk.joint(name).qpos[0]
    assert joint.limited[0]
    assert low + 0.3 < angle < high - 0.3
    assert low < 0 < high
    assert servo.ctrlrange == pytest.approx([low, high], abs=1e-12)
    assert servo.forcerange[0] == -servo.forcerange[1] < 0
    assert 5 < joint.user[0] <= 10
    assert joint.armature[0] > 0
    assert joint.damping[0] > 0


@pytest.mark.parametrize(
    ("joint", "stiffness", "torque", "speed"),
    [
        ("l_hip_yaw", 10000, 100, 9.5),
        ("r_hip_roll", 10000, 180, 9.5),
        ("l_hip_pitch", 10000, 200, 9.5),
        ("r_knee_pitch", 10000, 200, 9.5),
        ("l_ankle_pitch", 10000, 150, 9.5),
        ("r_ankle_roll", 10000, 100, 9.5),
        ("waist_pitch", 10000, 150, 6),
        ("l_shoulder_roll", 1200, 60, 8),
        ("r_elbow_pitch", 1200, 50, 8),
        ("l_wrist_roll", 250, 15, 10),
        ("head_yaw", 250, 15, 6),
    ],
)
def test_servos_have_their_stiffness_torque_and_speed(
    model, joint, stiffness, torque, speed
) -> None:
    servo = model.actuator(joint)
    assert servo.gainprm[0] == -servo.biasprm[1] == stiffness
    assert servo.biasprm[2] < 0
    assert servo.forcerange[1] == torque
    assert model.joint(joint).user[0] == speed


@pytest.mark.parametrize("joint", [*LEG, *ARM])
def test_ranges_mirror(model: mujoco.MjModel, joint: str) -> None:
    left, right = (model.joint(f"{side}_{joint}").range for side in "lr")
    mirrored = left if joint.endswith("pitch") else -left[::-1]
    assert list(right) == list(mirrored)


def test_mass_and_inertia_mirror(model: mujoco.MjModel, walk) -> None:
    names = [model.body(i).name for i in range(1, model.nbody)]
    pairs = [(n, "r" + n[1:] if n.startswith("l_") else n) for n in names]
    for left, right in (pair for pair in pairs if not pair[0].startswith("r_")):
        a, b = model.body(left).id, model.body(right).id
        assert model.body_mass[a] == model.body_mass[b]
        assert walk.xipos[b] == pytest.approx(MIRROR @ walk.xipos[a], abs=1e-12)
        A, B = (
            R @ np.diag(model.body_inertia[i]) @ R.T
            for i, R in ((i, walk.ximat[i].reshape(3, 3)) for i in (a, b))
        )
        assert pytest.approx(MIRROR @ A @ MIRROR, abs=1e-12) == B


def test_only_the_soles_collide_and_only_with_a_floor(model: mujoco.MjModel) -> None:
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    names = {model.geom(int(i)).name for i in np.flatnonzero(collides)}
    assert names == {"l_sole_contact", "r_sole_contact"}
    assert not model.geom_conaffinity.any()


@pytest.mark.parametrize("side", ["l", "r"])
def test_the_sole_is_a_box_below_the_ankle(model: mujoco.MjModel, side: str) -> None:
    sole, contact = model.site(f"{side}_sole"), model.geom(f"{side}_sole_contact")
    assert contact.type[0] == mujoco.mjtGeom.mjGEOM_BOX
    assert contact.bodyid[0] == sole.bodyid[0]
    low, high = contact.pos - contact.size, contact.pos + contact.size
    assert low - sole.pos == pytest.approx([-0.10, -0.065, 0], abs=1e-12)
    assert high - sole.pos == pytest.approx([0.14, 0.065, 0.02], abs=1e-12)
    assert sole.pos - model.site(f"{side}_ankle").pos == pytest.approx([0, 0, -0.08])


@pytest.mark.parametrize("side", ["l", "r"])
def test_nothing_of_a_foot_is_below_its_sole(side: str) -> None:
    model = on_floor(mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    floor, foot = model.geom("floor").id, model.body(f"{side}_foot").id
    for geom in np.flatnonzero(model.geom_bodyid == foot):
        assert mujoco.mj_geomDistance(model, data, floor, geom, 1.0, None) > -1e-12


def test_sensors_are_complete(model: mujoco.MjModel) -> None:
    names = [model.sensor(i).name for i in range(model.nsensor)]
    joints = [f"{joint}_{kind}" for joint in JOINTS for kind in ("pos", "vel")]
    assert names[: len(joints)] == joints
    assert names[len(joints) :] == [
        *("imu_quat", "imu_gyro", "imu_acc"),
        *("l_force", "l_torque", "r_force", "r_torque"),
    ]


def test_encoders_and_imu_read_the_state(model: mujoco.MjModel, walk) -> None:
    walk.qvel[6:] = np.arange(model.nu)
    mujoco.mj_forward(model, walk)
    readings = walk.sensordata[: 2 * model.nu].reshape(-1, 2)
    assert readings[:, 0] == pytest.approx(walk.qpos[7:], abs=0)
    assert readings[:, 1] == pytest.approx(walk.qvel[6:], abs=0)
    assert model.site_bodyid[model.site("imu").id] == model.body("torso").id
    assert walk.sensor("imu_quat").data == pytest.approx([1, 0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("stride", [-0.2, 0.2])
@pytest.mark.parametrize("side", ["l", "r"])
def test_a_leg_reaches_half_a_step_of_0_4_m_forward_and_back(
    model, walk, side, stride
) -> None:
    names = [f"{side}_{joint}" for joint in ("hip_pitch", "knee_pitch", "ankle_pitch")]
    rest = walk.site(f"{side}_sole").xpos.copy()

    def error(angles: np.ndarray) -> list[float]:
        for name, angle in zip(names, angles, strict=True):
            walk.joint(name).qpos[0] = angle
        mujoco.mj_kinematics(model, walk)
        sole = walk.site(f"{side}_sole")
        moved = sole.xpos - rest - [stride, 0, 0]
        return [moved[0], moved[2], sole.xmat[2]]

    limits = np.array([model.joint(name).range for name in names]).T
    start = [walk.joint(name).qpos[0] for name in names]
    found = least_squares(error, start, bounds=tuple(limits))
    assert math.sqrt(2 * found.cost) < 1e-6
    assert found.x[1] > 0.4
    assert (found.x - limits[0]).min() > 0.2
    assert (limits[1] - found.x).min() > 0.2


def test_stretching_the_arms_forward_moves_the_com_by_centimetres(model, walk) -> None:
    before = walk.subtree_com[1].copy()
    for side in "lr":
        walk.joint(f"{side}_shoulder_pitch").qpos[0] = -math.pi / 2
        walk.joint(f"{side}_elbow_pitch").qpos[0] = 0.0
    mujoco.mj_forward(model, walk)
    assert walk.subtree_com[1][0] - before[0] > 0.02


@pytest.mark.parametrize(
    ("cone", "impratio"),
    [(mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0), (mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0)],
)
def test_it_stands_still(cone: mujoco.mjtCone, impratio: float) -> None:
    model = on_floor(cone, impratio)
    data = stand(model, 5.0)
    assert abs(data.qvel).max() < 1e-4
    assert abs(data.subtree_com[1] - [0, 0, 0.687]).max() < 0.002
    assert data.body("torso").xmat[8] > math.cos(math.radians(0.5))
    assert abs(data.qpos[7:] - data.ctrl).max() < 0.01


def test_ankle_sensors_read_minus_the_weight_above_the_ankles() -> None:
    """The sensed force is that of the leg on the foot; the torque likewise."""
    model = on_floor(mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0)
    data = stand(model, 2.0)
    above = model.body_mass.sum() - 2 * model.body("l_foot").mass[0]
    total = data.sensor("l_force").data[2] + data.sensor("r_force").data[2]
    assert total == pytest.approx(-above * GRAVITY, rel=1e-4)


@pytest.mark.parametrize("side", ["l", "r"])
def test_ankle_sensor_and_ground_hold_the_foot_in_balance(side: str) -> None:
    model = on_floor(mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0)
    data = stand(model, 2.0)
    site, foot = data.site(f"{side}_ankle_ft"), model.body(f"{side}_foot").id
    R = site.xmat.reshape(3, 3)
    weight = np.array([0, 0, -model.body_mass[foot] * GRAVITY])
    force = R @ data.sensor(f"{side}_force").data + weight
    torque = R @ data.sensor(f"{side}_torque").data
    torque += np.cross(data.xipos[foot] - site.xpos, weight)
    wrench = np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        if model.geom_bodyid[contact.geom].max() == foot:
            mujoco.mj_contactForce(model, data, i, wrench)
            ground = contact.frame.reshape(3, 3).T @ wrench[:3]
            force += ground
            torque += np.cross(contact.pos - site.xpos, ground)
    assert force == pytest.approx([0, 0, 0], abs=0.01)
    assert torque == pytest.approx([0, 0, 0], abs=0.01)
