"""The tick does what the readable body and law do, whatever happens."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from models import write
from readable import ReadableBody, ReadableController
from robots import jvrc, paper, robot_of
from scipy.spatial.transform import Rotation

from comwalk.certificates.defaults import default_control, walk_pattern
from comwalk.control.gains import Gains
from comwalk.control.guard import End, Watch
from comwalk.control.law import ControlSettings, WalkingController
from comwalk.control.plant import Sensors
from comwalk.control.settings import BodySettings, Control, Push, SimulatorSettings
from comwalk.embedding.dances import builtin_motion
from comwalk.embedding.motion import EmbeddedMotion, embed_in
from comwalk.embedding.motion_edits import placed, renamed
from comwalk.embedding.rotations import level_error, rotation_yaw
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import Pattern, make_pattern
from comwalk.robot.model import Robot, load_robot
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.whole_body import WholeBody


def both(
    robot: Robot,
    pattern: Pattern,
    control: Control,
    motion: EmbeddedMotion | None = None,
) -> SimpleNamespace:
    """Return both loops, started, and the first command."""
    given = robot, control.period, motion, control.body
    readable, body = ReadableBody(*given), WholeBody(*given)
    reference = pattern.at(0.0)
    command = readable.start(reference)
    started = body.start(reference)
    assert np.abs(command.positions - started.positions).max() < 1e-10
    laws = [
        law(control.gains, control.settings, control.period)
        for law in (ReadableController, WalkingController)
    ]
    for law in laws:
        law.reset(reference.com, reference.zmp)
    ticker = body.ticker(pattern, laws[1], Watch(tilt=3.0, com_error=9.0))
    return SimpleNamespace(body=readable, law=laws[0], ticker=ticker, command=command)


def compare(
    robot: Robot,
    pattern: Pattern,
    control: Control,
    motion: EmbeddedMotion | None = None,
    physics: SimulatorSettings | None = None,
    until: float = math.inf,
) -> tuple[float, int]:
    """Walk by the readable objects, and feed the ticker with the same sensors.

    Returns:
        The largest difference of all that both say, and how often a posture was handed
        over.
    """
    loops = both(robot, pattern, control, motion)
    plant = SimulatedRobot(robot, control.period, physics, 0, pattern.plan)
    plant.place(loops.body.configuration)
    sensors, worst, handed = plant.start(loops.command), 0.0, 0
    for k in range(int(min(pattern.duration, until) / control.period)):
        reference = pattern.at(k * control.period)
        measured = loops.body.measure(sensors, reference)
        output = loops.law.step(
            reference, measured.com, measured.zmp, measured.feedback_scale
        )
        command = loops.body.act(output, reference)
        assert loops.ticker.step(k * control.period, sensors) is None
        handed += loops.ticker.body.resolution is not None
        ours = numbers_of(measured, output, command)
        seen = loops.ticker.seen(sensors, 0.0)
        theirs = numbers_of(seen.measured, seen.control, seen.command)
        worst = max(worst, float(np.abs(ours - theirs).max()))
        plant.write(command)
        sensors = plant.read()
    assert loops.ticker.body.diagnostics() == pytest.approx(
        loops.body.diagnostics(), abs=1e-6
    )
    return worst, handed


def numbers_of(measured, output, command) -> np.ndarray:
    """Return all that a loop says at one tick, in one array; forces in kN."""
    return np.concatenate(
        [
            measured.com,
            measured.zmp,
            [measured.load / 1e3, measured.tilt, measured.feedback_scale],
            output.u,
            output.com_command,
            output.com_error,
            output.zmp_error,
            output.zmp_reference,
            [output.saturated],
            command.positions,
            command.velocities / 10.0,
        ]
    )


def dancing(robot: Robot, start: float = 0.2) -> EmbeddedMotion:
    """Return a dance of the arms that the robot has."""
    motion = builtin_motion("disco")
    roles = {name: joint for name, (joint, _) in robot.roles.items()}
    signs = dict(robot.roles.values())
    motion = placed(renamed(motion, roles), robot.home_angles, signs)
    return embed_in(motion, robot.home_angles, start=start, stop=start + 2.5, blend=0.6)


CURVE = make_pattern(plan_steps(Gait(turn=0.2, half_step=0.05), 3), PAPER_PENDULUM)


@pytest.mark.parametrize("name", ["paper", "jvrc1", "talos", "g1", "icub"])
def test_a_walk_is_the_same(name):
    """From the first moment to the last."""
    robot = robot_of(name)
    pattern = walk_pattern(robot, 1)
    worst, _ = compare(robot, pattern, default_control(robot))
    assert worst < 1e-10


@pytest.mark.parametrize(
    "body",
    [
        BodySettings(imu=False, landing=0.0),
        BodySettings(calibration=False, deflection_compensation=False),
        BodySettings(rolling=3.0, landing=1.0, imu_cutoff=50.0),
        BodySettings(feedback=0.0),
    ],
)
def test_settings_do_the_same(body):
    """On a rough floor, where they matter, in a curve."""
    physics = SimulatorSettings(terrain=0.01, noise=1.0, latency=0.004)
    control = Control(body=body)
    loops = compare(paper(), CURVE, control, physics=physics, until=2.5)
    assert loops[0] < 1e-10


def test_delay_bounds_and_open_loop_are_the_same():
    """With a push that the bounds of the law feel."""
    physics = SimulatorSettings(pushes=(Push(start=0.8, force=(0.0, 150.0, 0.0)),))
    for control in (
        Control(settings=ControlSettings(delay=3, max_offset=0.01, zmp_cutoff=None)),
        Control(settings=ControlSettings(max_correction=0.02)),
        Control(gains=Gains(zmp=(0.0, 0.0), com=(0.0, 0.0))),
    ):
        worst, _ = compare(paper(), CURVE, control, physics=physics, until=2.0)
        assert worst < 1e-10


@pytest.mark.parametrize("embed", [True, False])
def test_a_dance_is_the_same(embed):
    """Blended in and out, embedded or not."""
    robot = jvrc()
    control = Control(body=BodySettings(embed_motion=embed))
    pattern = walk_pattern(robot, 1)
    worst, _ = compare(robot, pattern, control, dancing(robot), until=3.0)
    assert worst < 1e-10


def test_what_the_kernels_do_not_solve_is_handed_over():
    """Steps so long that legs are straight and joints at their limits."""
    robot = paper()
    gait = Gait(half_step=0.17, period=0.9)
    pattern = make_pattern(plan_steps(gait, 3), PAPER_PENDULUM)
    worst, handed = compare(robot, pattern, Control(), until=3.5)
    assert handed > 20
    assert worst < 1e-8


def test_joints_that_follow_walk_too(tmp_path):
    """Wrists that follow their elbows."""
    path = write(tmp_path, mimic={"wrist_z": ("elbow_y", -0.7, 0.1)})
    robot = load_robot(path, actuation="position")
    assert robot.coupling is not None
    pattern = walk_pattern(robot, 1)
    worst, _ = compare(robot, pattern, default_control(robot), until=2.5)
    assert worst < 1e-10


@pytest.mark.parametrize(
    ("field", "sensor"),
    [("positions", "encoders"), ("wrenches", "ankle sensors"), ("orientation", "IMU")],
)
def test_sensors_that_read_no_numbers(field, sensor):
    loops = both(paper(), CURVE, Control())
    n = len(paper().joints)
    readings = {
        "positions": paper().home[7:].copy(),
        "wrenches": np.zeros((2, 6)),
        "orientation": np.array([1.0, 0.0, 0.0, 0.0]),
    }
    readings[field].flat[1] = math.nan
    sensors = Sensors(
        time=0.0,
        velocities=np.zeros(n),
        gyro=np.zeros(3),
        acceleration=np.zeros(3),
        **readings,
    )
    outcome = loops.ticker.step(0.0, sensors)
    assert outcome.end is End.ABORTED
    assert outcome.cause == f"the {sensor} read no numbers"


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, math.pi - 1e-8, math.pi])
def test_level_error_is_the_logarithm(angle):
    """Half turns too, where the vector comes from the symmetric part."""
    rng = np.random.default_rng(0)
    for axis in (*np.eye(3), *rng.normal(size=(4, 3))):
        a = axis / np.linalg.norm(axis)
        R = Rotation.from_rotvec(angle * a).as_matrix()
        for yaw in (0.0, 0.7):
            found = level_error(yaw, rotation_yaw(yaw) @ R)
            expected = -rotation_yaw(yaw) @ (angle * a)
            assert min(
                np.abs(found - expected).max(), np.abs(found + expected).max()
            ) < (1e-7 if angle > 3.1 else 1e-12)
