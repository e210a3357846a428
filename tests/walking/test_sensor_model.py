"""Flaws of sensors, joints and the way of commands, each against what it should do."""

import mujoco
import numpy as np
import pytest
from robots import paper
from scipy.spatial.transform import Rotation

from comwalk.certificates.defaults import walk_pattern
from comwalk.control.settings import SimulatorSettings
from comwalk.errors import ParameterError
from comwalk.replay import replay
from comwalk.run import Run, simulate
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.mujoco_scene import build_scene
from comwalk.walking.whole_body import WholeBody


def walked(**flaws) -> Run:
    return simulate(
        paper(), walk_pattern(paper(), 2), physics=SimulatorSettings(**flaws), seed=3
    )


def rotations(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions[..., [1, 2, 3, 0]])


def test_no_flaw_is_the_truth():
    run = walked()
    assert np.array_equal(run.log["joints"], run.log["qpos"][:, 7:])


def test_encoder_zeros_stay_and_have_the_spread_asked_for():
    """One error a joint for the whole run; the same seed, the same errors."""
    run, again = walked(encoder_zero=0.003), walked(encoder_zero=0.003)
    errors = run.log["joints"] - run.log["qpos"][:, 7:]
    assert np.ptp(errors, axis=0).max() < 1e-12
    assert np.array_equal(errors, again.log["joints"] - again.log["qpos"][:, 7:])
    drawn = np.concatenate(
        [
            SimulatedRobot(
                paper(), 0.002, SimulatorSettings(encoder_zero=0.003), seed
            ).sensors.zeros
            for seed in range(60)
        ]
    )
    assert drawn.std() == pytest.approx(0.003, rel=0.06)
    assert abs(drawn.mean()) < 3e-4


def test_encoders_have_a_resolution():
    run = walked(encoder_step=0.001)
    counts = run.log["joints"] / 0.001
    assert np.abs(counts - np.round(counts)).max() < 1e-9
    error = run.log["joints"] - run.log["qpos"][:, 7:]
    assert np.abs(error).max() <= 0.0005 + 1e-12


def test_an_imu_that_is_mounted_askew_reads_so_all_along():
    """Its axes are turned by the angle asked for; what it reads fits to them."""
    tilt = 0.02
    run, straight = walked(imu_tilt=tilt), walked()
    true = rotations(run.log["qpos"][:, 3:7])
    site = paper().model.site("imu").id
    fixed = rotations(paper().model.site_quat[site])
    askew = (true * fixed).inv() * rotations(run.log["imu_quat"])
    assert askew.magnitude() == pytest.approx(tilt, abs=2e-3)  # a step behind qpos
    vectors = askew.as_rotvec()
    assert vectors[0] == pytest.approx(vectors.mean(axis=0), abs=5e-4)
    assert np.abs(vectors[:, 2]).max() < 2e-3  # about a horizontal axis
    # At rest the accelerometer still feels g along the vertical of its quaternion.
    up = rotations(run.log["imu_quat"][:1]).apply(run.log["imu_acc"][:1])[0]
    expected = rotations(straight.log["imu_quat"][:1]).apply(
        straight.log["imu_acc"][:1]
    )[0]
    assert up == pytest.approx(expected, abs=0.02)


def test_a_gyro_has_one_bias():
    run = walked(gyro_bias=0.02)
    plant = SimulatedRobot(paper(), 0.002, SimulatorSettings(gyro_bias=0.02), 3)
    straight = walked()
    difference = run.log["imu_gyro"] - straight.log["imu_gyro"]
    assert difference == pytest.approx(
        np.broadcast_to(plant.sensors.bias, difference.shape), abs=1e-9
    )


@pytest.mark.parametrize("ticks", [1, 3])
def test_commands_arrive_late(ticks, tmp_path):
    """The servos get what was sent so many periods ago; replays know it."""
    run = walked(command_delay=ticks * 0.002)
    sent = run.log["joint_set_points"]
    arrived = run.log["ctrl"][:, paper().servo.actuators]
    assert np.array_equal(arrived[ticks:], sent[:-ticks])
    again = replay(run.save(tmp_path))
    assert again.position_difference == 0.0


def test_dry_friction_holds_a_joint_that_is_pulled_by_less():
    """A servo that pulls with 4 N m moves nothing against 5, and does against 3."""
    for friction, moves in ((5.0, False), (3.0, True)):
        model = build_scene(paper(), SimulatorSettings(joint_friction=friction))
        model.opt.gravity[:] = 0.0
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        data = mujoco.MjData(model)
        data.qpos[:] = paper().home
        data.qpos[2] += 1.0
        data.ctrl[paper().servo.actuators] = paper().home[7:]
        j = paper().joints.index("l_elbow_pitch")
        k = paper().servo.actuators[j]
        data.ctrl[k] += 4.0 / paper().servo.stiffness[j]
        before = data.qpos[7 + j]
        mujoco.mj_step(model, data, 300)
        moved = abs(data.qpos[7 + j] - before) * paper().servo.stiffness[j]
        assert (moved > 0.5) == moves


def test_viscous_friction_is_added_to_each_joint():
    plain = build_scene(paper(), SimulatorSettings())
    thick = build_scene(paper(), SimulatorSettings(joint_damping=2.5))
    added = thick.dof_damping - plain.dof_damping
    assert added[:6] == pytest.approx(0.0)
    assert added[6:] == pytest.approx(2.5)
    data = mujoco.MjData(thick)
    data.qvel[6] = 1.0
    mujoco.mj_forward(thick, data)
    assert data.qfrc_damper[6] == pytest.approx(-thick.dof_damping[6])


def test_a_walk_with_a_driver_has_the_same_flaws():
    """Readings by objects and by shared memory are the same."""
    settings = SimulatorSettings(
        noise=1.0, encoder_zero=0.002, imu_tilt=0.01, gyro_bias=0.01, encoder_step=1e-3
    )
    pattern = walk_pattern(paper(), 1)
    run = simulate(paper(), pattern, physics=settings, seed=5)
    plant, body = SimulatedRobot(paper(), 0.002, settings, 5), WholeBody(paper(), 0.002)
    body.start(pattern.at(0.0))
    plant.place(body.configuration)
    sensors = plant.start(body.command)
    assert np.array_equal(sensors.positions, run.log["joints"][0])
    assert sensors.orientation == pytest.approx(run.log["imu_quat"][0], abs=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("encoder_zero", -0.001),
        ("encoder_step", 1.0),
        ("imu_tilt", np.nan),
        ("gyro_bias", 1.0),
        ("command_delay", 0.3),
        ("joint_friction", -1.0),
        ("joint_damping", 51.0),
    ],
)
def test_flaws_out_of_range_are_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} must be a number in"):
        SimulatorSettings(**{name: value})
