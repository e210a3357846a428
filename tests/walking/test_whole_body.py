"""The standing robot is weighed: a load that its model does not know of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from robots import paper

from comwalk.certificates.defaults import walk_pattern
from comwalk.control.gains import Gains
from comwalk.control.law import WalkingController
from comwalk.control.plant import Sensors
from comwalk.control.settings import BodySettings, Control, SimulatorSettings
from comwalk.pattern.footsteps import Foothold, FootstepPlan
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import Pattern, make_pattern
from comwalk.robot.kinematics import Kinematics
from comwalk.run import simulate
from comwalk.walking.whole_body import WholeBody

PERIOD = 0.002


def turned(yaw: float) -> Pattern:
    """Return a pattern of standing with both feet turned."""
    x, y = -0.09 * math.sin(yaw), 0.09 * math.cos(yaw)
    plan = FootstepPlan(
        left=Foothold(x, y, yaw), right=Foothold(-x, -y, yaw), stand_time=2.0
    )
    return make_pattern(plan, PAPER_PENDULUM)


def sensed(body: WholeBody, shift: tuple[float, float], mass_ratio: float) -> Sensors:
    """Return what the sensors read while the pressure is shifted in both soles.

    Args:
        body: Stands as commanded.
        shift: Forward and to the left, from under the model's CoM [m].
        mass_ratio: Weight over the model's.
    """
    robot = paper()
    g, weights = robot.gravity, [foot.mass for foot in robot.feet.values()]
    f_z = 0.5 * mass_ratio * robot.mass * g - np.array(weights) * g
    kinematics = Kinematics(robot)
    q = np.array([0, 0, 0, 1, 0, 0, 0, *body.configuration[7:]], dtype=float)
    kinematics.update(q)
    sites = np.array([foot.sensor_site for foot in robot.feet.values()])
    points, _ = kinematics.sites(sites)
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = f_z
    # The sum of both feet's moments about the point under the CoM, shared.
    p = kinematics.com[:2] + shift
    for k, foot in enumerate(robot.feet.values()):
        x, y = p - points[k][:2]
        total = 0.5 * mass_ratio * robot.mass * g
        c_x, c_y, _ = foot.com
        wrenches[k, 3] = y * total - c_y * foot.mass * g
        wrenches[k, 4] = -x * total + c_x * foot.mass * g
    still, upright = np.zeros(len(q) - 7), np.array([1.0, 0, 0, 0])
    return Sensors(0.0, q[7:], still, wrenches, upright, np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_a_shift_of_the_pressure_is_the_coms_error(yaw):
    """Standing, the CoM is over the ZMP, whichever way the robot looks."""
    pattern, (x, y) = turned(yaw), (0.02, -0.01)
    cos, sin = math.cos(yaw), math.sin(yaw)
    away = [cos * x - sin * y, sin * x + cos * y]
    usual = WholeBody(paper(), PERIOD, settings=BodySettings(calibration=False))
    body = WholeBody(paper(), PERIOD)
    for one in (usual, body):
        one.start(pattern.at(0.0))
    seen = sensed(body, (x, y), 1.1)
    for k in range(round(0.3 / PERIOD)):
        reference = pattern.at(k * PERIOD)
        measured, plain = (one.measure(seen, reference) for one in (body, usual))
    assert plain.zmp - plain.com[:2] == pytest.approx(away, abs=1e-6)
    assert measured.com[:2] == pytest.approx(measured.zmp, abs=1e-6)
    assert measured.com[2] == plain.com[2]
    assert measured.load == pytest.approx(1.1 * paper().mass * paper().gravity)


def test_the_robot_is_weighed_once_and_the_law_waits():
    """A quarter of a second; then the law's feedback rises from zero to all of it."""
    pattern = turned(0.0)
    body = WholeBody(paper(), PERIOD)
    body.start(pattern.at(0.0))
    first, later = sensed(body, (0.02, 0.0), 1.0), sensed(body, (-0.03, 0.0), 1.0)
    scales = []
    for k in range(400):
        reference = pattern.at(k * PERIOD)
        measured = body.measure(first if k < 125 else later, reference)
        scales.append(measured.feedback_scale)
    assert measured.com[0] == pytest.approx(0.02, abs=1e-4)
    assert measured.zmp[0] == pytest.approx(-0.03, abs=1e-4)
    assert not any(scales[:125])
    assert np.all(np.diff(scales) >= 0.0)
    assert 0.4 < scales[187] < 0.6
    assert scales[260:] == [1.0] * 140


def test_nobody_is_weighed_in_the_air_or_while_walking():
    pattern = walk_pattern(paper(), 1)
    weighed = WholeBody(paper(), PERIOD)
    plain = WholeBody(paper(), PERIOD, settings=BodySettings(calibration=False))
    for body in (weighed, plain):
        body.start(pattern.at(0.0))
    walking = next(s for s in pattern.phases if s.phase is Phase.DOUBLE)
    for mass_ratio, t in ((0.3, 0.0), (1.0, walking.start)):
        seen = sensed(weighed, (0.02, 0.0), mass_ratio)
        for _ in range(10):
            ours, theirs = (x.measure(seen, pattern.at(t)) for x in (weighed, plain))
        assert np.array_equal(ours.com, theirs.com)
    assert ours.feedback_scale == 1.0


def test_what_is_not_trusted_does_not_act():
    """Scaled by 0 the law is the feedforward alone; by a half, half the feedback."""
    reference = turned(0.0).at(0.5)
    corrections = []
    for scale in (0.0, 0.5, 1.0):
        controller = WalkingController(Gains(), Control().settings, PERIOD)
        controller.reset(reference.com, reference.zmp)
        com = reference.com + np.array([0.01, 0.005, 0.0])
        output = controller.step(reference, com, reference.zmp, scale)
        corrections.append(output.u - reference.com_velocity[:2])
    assert not corrections[0].any()
    assert corrections[2].any()
    assert corrections[1] == pytest.approx(0.5 * corrections[2])


def test_a_load_on_the_back_is_found():
    """A fifth of the mass: the CoM 24 mm from where the encoders see it."""
    physics = SimulatorSettings(payload=0.2)
    pattern = walk_pattern(paper(), 3)
    runs = [
        simulate(
            paper(),
            pattern,
            control=Control(body=BodySettings(calibration=weighed)),
            physics=physics,
        )
        for weighed in (True, False)
    ]
    away, blind = (
        np.abs(run.log["com"] - run.log["com_true"])[250:, :2].mean(axis=0).max()
        for run in runs
    )
    assert away < 2e-3
    assert blind > 0.015
    errors = [run.summary()["com_error_rms_mm"]["true"]["x"] for run in runs]
    assert runs[0].outcome.ok
    assert errors[0] < 0.5 * errors[1]
