"""The compiled tick is the readable loop, to rounding, whatever happens."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from models import write
from robots import jvrc, paper
from test_fast import robot_of

from comwalk.certificates.defaults import default_control, walk_pattern
from comwalk.control.guard import Watch
from comwalk.control.law import ControlSettings, Gains, WalkingController
from comwalk.control.plant import Sensors
from comwalk.control.settings import BodySettings, Control, Push, SimulatorSettings
from comwalk.embedding.dances import builtin_motion
from comwalk.embedding.motion import EmbeddedMotion, embed_in, placed, renamed
from comwalk.embedding.rotations import level_error as readable_level_error
from comwalk.embedding.rotations import rotation_yaw
from comwalk.pattern.footsteps import Gait, plan_steps
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.walk_pattern import Pattern, make_pattern
from comwalk.robot.model import Robot, load_robot
from comwalk.walking.action import level_error
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.tick import DONE, ENCODERS, ORIENTATION, WRENCHES
from comwalk.walking.whole_body import CompiledTick, WholeBody


def both(
    robot: Robot,
    pattern: Pattern,
    control: Control,
    motion: EmbeddedMotion | None = None,
) -> SimpleNamespace:
    """Return both loops, started, and the first command."""
    bodies = [WholeBody(robot, control.period, motion, control.body) for _ in range(2)]
    reference = pattern.at(0.0)
    commands = [body.start(reference) for body in bodies]
    law = WalkingController(control.gains, control.settings, control.period)
    law.reset(reference.com, reference.zmp)
    compiled = CompiledTick(pattern, law, bodies[1], Watch(tilt=3.0, com_error=9.0))
    return SimpleNamespace(
        body=bodies[0], law=law, compiled=compiled, command=commands[0]
    )


def compare(
    robot: Robot,
    pattern: Pattern,
    control: Control,
    motion: EmbeddedMotion | None = None,
    physics: SimulatorSettings | None = None,
    until: float = math.inf,
) -> tuple[float, int]:
    """Walk by the readable loop, and feed the compiled one with the same sensors.

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
        output = loops.law.step(reference, measured.com, measured.zmp, measured.trust)
        command = loops.body.act(output, reference)
        loops.compiled.feel(sensors)
        assert loops.compiled.step(k * control.period) == DONE
        handed += loops.compiled.body.resolution is not None
        ours = numbers_of(measured, output, command)
        theirs = numbers_of(
            loops.compiled.measured(),
            loops.compiled.control(),
            loops.compiled.command(),
        )
        worst = max(worst, float(np.abs(ours - theirs).max()))
        plant.write(command)
        sensors = plant.read()
    assert loops.compiled.body.diagnostics() == loops.body.diagnostics()
    return worst, handed


def numbers_of(measured, output, command) -> np.ndarray:
    """Return all that a loop says at one tick, in one array; forces in kN."""
    return np.concatenate(
        [
            measured.com,
            measured.zmp,
            [measured.load / 1e3, measured.tilt, measured.trust],
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
    robot = load_robot(path)
    assert robot.coupling is not None
    pattern = walk_pattern(robot, 1)
    worst, _ = compare(robot, pattern, default_control(robot), until=2.5)
    assert worst < 1e-10


@pytest.mark.parametrize(
    ("field", "status"),
    [("positions", ENCODERS), ("wrenches", WRENCHES), ("orientation", ORIENTATION)],
)
def test_sensors_that_read_no_numbers(field, status):
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
    loops.compiled.feel(sensors)
    assert loops.compiled.step(0.0) == status


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, math.pi - 1e-8, math.pi])
def test_level_error_is_the_readable_one(angle):
    """Half turns too, where the vector comes from the symmetric part."""
    rng = np.random.default_rng(0)
    for axis in (*np.eye(3), *rng.normal(size=(4, 3))):
        a = axis / np.linalg.norm(axis)
        S = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        R = np.eye(3) + math.sin(angle) * S + (1 - math.cos(angle)) * S @ S
        for yaw in (0.0, 0.7):
            turned = rotation_yaw(yaw) @ R
            expected = readable_level_error(yaw, turned)
            found = np.array(level_error(yaw, turned, np.zeros((3, 3))))
            assert min(
                np.abs(found - expected).max(), np.abs(found + expected).max()
            ) < (1e-7 if angle > 3.1 else 1e-12)
