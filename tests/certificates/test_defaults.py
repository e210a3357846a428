"""What a robot walks with by default: the paper's numbers, and dynamic similarity."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import write
from robots import paper

import comwalk
from comwalk.certificates.defaults import (
    MAX_SPEED_RATIO,
    SIDE_STEP,
    STEP_EXPONENT,
    TURN_STEP,
    default_control,
    default_control_settings,
    default_gains,
    default_gait,
    default_pendulum,
    similar_gains,
    walk_pattern,
)
from comwalk.certificates.description import describe, rows_of
from comwalk.certificates.gain_check import check_control
from comwalk.certificates.plan_check import check_feasible
from comwalk.certificates.sampled_loop import SampledLoop, highest_cutoff
from comwalk.control.gains import Gains
from comwalk.control.law import ControlSettings
from comwalk.control.settings import Control
from comwalk.errors import ModelError, ParameterError, PlanError
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.robot.model import Robot, load_robot
from comwalk.run import simulate
from comwalk.sides import Side


def scaled_file(folder: Path, scale: float) -> Path:
    """Write the paper's robot with all lengths scaled."""
    text = (Path(comwalk.__file__).parent / "robots" / "paper.xml").read_text()

    def scaled(match: re.Match) -> str:
        numbers = [scale * float(x) for x in match[2].split()]
        return f'{match[1]}="{" ".join(map(str, numbers))}"'

    text = re.sub(r'\b(pos|fromto|size)="([^"]+)"', scaled, text)
    base = re.compile(r'(qpos=")(\S+) (\S+) (\S+)')
    text = base.sub(lambda m: f"{m[1]}{m[2]} {m[3]} {scale * float(m[4])}", text)
    path = folder / f"scaled{scale:g}.xml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Robot:
    """The paper's robot at a quarter of its size."""
    path = scaled_file(tmp_path_factory.mktemp("robots"), 0.25)
    return load_robot(path, profile={"pendulum": {"inertia": 0.0}})  # a point mass


def test_the_papers_robot_gets_the_papers_numbers():
    robot = paper()
    assert default_gait(robot) == default_gait(None) == Gait()
    assert default_pendulum(robot) == Pendulum()
    assert default_gains(robot) == Gains()
    assert default_control_settings(robot) == ControlSettings()
    assert default_control(robot) == Control()
    assert robot.sole_size == (0.24, 0.13)


def test_a_small_robot_walks_alike(small):
    """Lengths by r, times by sqrt(r), rates by 1 / sqrt(r): omega_n T stays."""
    r = 0.25
    gait, usual = default_gait(small), Gait()
    pendulum = default_pendulum(small)
    assert pendulum.height == pytest.approx(r * 0.687, abs=5e-4)
    for name in ("half_step", "half_width", "swing_height"):
        ours, theirs = getattr(gait, name), getattr(usual, name)
        assert ours == pytest.approx(r * theirs, rel=5e-3), name
    for name in ("period", "transfer_time", "start_time", "stop_time"):
        ours, theirs = getattr(gait, name), getattr(usual, name)
        assert ours == pytest.approx(math.sqrt(r) * theirs, rel=5e-3), name
    assert gait.period * pendulum.omega == pytest.approx(Pendulum().omega, rel=5e-3)
    assert np.array(similar_gains(pendulum).walking) == pytest.approx(
        2.0 * np.array(Gains().walking), rel=5e-3
    )
    assert small.sole_size == pytest.approx((0.06, 0.0325))


def test_the_pattern_of_a_small_robot_is_the_papers_made_smaller(small):
    ours, theirs = walk_pattern(small, 4), walk_pattern(paper(), 4)
    for t in (1.3, 2.1, 4.6):
        com, papers = ours.at(0.5 + 0.5 * t).com, theirs.at(0.5 + t).com
        assert com == pytest.approx(0.25 * papers, abs=5e-4)


def test_turning_feet_that_would_meet_are_set_apart():
    """The quicker they turn, the wider they stand; no more than soles need."""
    slow, fast = (default_gait(paper(), turn=v) for v in (0.3, 1.1))
    assert slow.half_width == 0.09
    assert 0.09 < fast.half_width < 0.11
    walk_pattern(paper(), 4, turn=1.1)
    with pytest.raises(PlanError, match="soles meet"):
        walk_pattern(paper(), 4, turn=1.1, half_width=0.98 * fast.half_width)


def test_feet_that_would_meet_are_set_apart(small):
    """Half the distance of the soles at home, unless soles are wider than that."""
    feet = {s: replace(f, sole=f.sole * [1, 2]) for s, f in small.feet.items()}
    wide = replace(small, feet=feet)
    gait = default_gait(wide)
    assert 2 * gait.half_width > wide.sole_size[1]
    walk_pattern(wide, 2)


speeds = st.floats(-0.8, 0.8)


@given(speeds)
def test_the_gait_has_the_speed_asked_for(v):
    gait = default_gait(None, speed=v)
    assert 2 * gait.half_step / gait.period == pytest.approx(v, rel=2e-3, abs=1e-9)
    assert gait.transfer_time == pytest.approx(0.1 * gait.period, rel=1e-3)
    assert (gait.lateral, gait.turn) == (0.0, 0.0)


@given(speeds, speeds)
def test_faster_walks_have_longer_and_quicker_steps(a, b):
    slow, fast = (default_gait(None, speed=v) for v in sorted((abs(a), abs(b))))
    assert slow.half_step <= fast.half_step
    assert slow.period >= fast.period


@pytest.mark.parametrize("v", [0.0, 0.05, -0.2, 0.2])
def test_up_to_the_natural_step_the_period_stays(v):
    gait = default_gait(None, speed=v)
    assert gait.period == 1.0
    assert gait.half_step == pytest.approx(v / 2)


def test_sideways_and_turning_speeds():
    gait = default_gait(None, side=-0.04, turn=0.2)
    assert (gait.half_step, gait.lateral, gait.turn) == (0.0, -0.04, 0.2)
    assert gait.period == 1.0
    longer, shorter = 4**STEP_EXPONENT, 4 ** (STEP_EXPONENT - 1.0)
    fast = default_gait(None, turn=4 * TURN_STEP)
    assert fast.turn == pytest.approx(longer * TURN_STEP, rel=1e-3)
    assert fast.period == pytest.approx(shorter, rel=1e-3)
    fast = default_gait(None, speed=0.1, side=4 * SIDE_STEP)
    assert fast.lateral == pytest.approx(longer * SIDE_STEP, rel=1e-3)
    assert fast.half_step == pytest.approx(0.05 * shorter, rel=1e-3)


def test_fast_walks_lift_their_feet_less_and_cross_smoothly():
    """Up to the natural speed nothing changes."""
    slow, fast, faster = (default_gait(None, speed=v) for v in (0.2, 0.3, 0.6))
    assert (slow.swing_height, slow.double_support) == (0.04, "paper")
    assert 0.01 < faster.swing_height < fast.swing_height < 0.04
    assert fast.double_support == faster.double_support == "minjerk"
    asked = default_gait(None, speed=0.6, double_support="paper", swing_height=0.05)
    assert (asked.swing_height, asked.double_support) == (0.05, "paper")


def test_the_fastest_of_three_speeds_sets_the_period():
    alone = default_gait(None, speed=0.4)
    together = default_gait(None, speed=0.4, side=0.02, turn=0.1)
    assert together.period == alone.period
    assert together.lateral == pytest.approx(0.02 * alone.period, rel=1e-3)


def test_given_fields_stay():
    gait = default_gait(None, speed=0.3, period=0.8, swing_height=0.06)
    assert (gait.period, gait.half_step, gait.swing_height) == (0.8, 0.12, 0.06)
    assert gait.transfer_time == 0.08
    assert default_gait(None, period=0.8, transfer_time=0.1).transfer_time == 0.1
    assert default_gait(None, side=0.02, half_step=0.05).half_step == 0.05


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"speed": 0.81}, r"speed must be a number in \[-0.8, 0.8\] m/s, got 0.81"),
        ({"speed": math.nan}, "speed"),
        ({"side": -1.0}, r"side must be a number in \[-0.2, 0.2\] m/s"),
        ({"turn": 9.0}, r"\[-1.2, 1.2\] rad/s, got 9; that is \+-68.8 deg/s"),
        ({"speed": 0.1, "half_step": 0.1}, "give speed or gait.half_step, not both"),
        ({"side": 0.1, "lateral": 0.1}, "give side or gait.lateral"),
        ({"period": "x"}, "period must be a number"),
        ({"speed": 0.1, "period": math.inf}, "period must be a number"),
        ({"period": 0.1}, "period must be a number"),
    ],
)
def test_impossible_numbers_are_refused(values, text):
    with pytest.raises(ParameterError, match=text):
        default_gait(None, **values)


def test_the_rule_ends_where_the_fields_of_a_gait_do():
    fastest = default_gait(None, speed=MAX_SPEED_RATIO * 0.2)
    assert fastest.half_step <= 0.2
    assert fastest.period >= 0.3


def test_the_cutoff_has_a_gain_margin_of_two(small):
    for robot, gains in ((paper(), Gains(zmp=4.0, com=6.6)), (small, None)):
        settings = default_control_settings(robot, gains)
        gains = gains or default_gains(robot)
        loop = SampledLoop(delay=1)
        for k_p, k_c in zip(*gains.walking, strict=True):
            highest = highest_cutoff(default_pendulum(robot), k_p, k_c, loop)
            assert settings.zmp_cutoff is not None
            assert settings.zmp_cutoff <= 0.5001 * highest
        check_control(default_control(robot), walk_pattern(robot, 1).pendulum)


def test_a_slow_controller_filters_more():
    quick, slow = (
        default_control_settings(paper(), period=dt).zmp_cutoff for dt in (0.002, 0.02)
    )
    assert quick is not None
    assert slow is not None
    assert slow < 0.8 * quick


def test_open_loop_needs_no_margin():
    gains = Gains(zmp=0.0, com=0.0)
    assert default_control_settings(paper(), gains) == ControlSettings()


def test_the_default_gait_fits_what_the_robot_has(tmp_path):
    """Ankles that are weaker and weaker: shorter, then slower, then told why not."""
    file, speeds = write(tmp_path), []

    def weak(torque: float) -> Robot:
        ankles = {f"{side}_ankle_y": {"torque": torque} for side in Side}
        return load_robot(file, profile={"limits": ankles})

    for torque in (200.0, 27.0, 22.0):
        robot = weak(torque)
        gait = describe(robot)["gait"]
        assert gait["fault"] is None
        check_feasible(robot, walk_pattern(robot, 8))
        speeds.append(gait["speed_m_s"])
    assert speeds[0] > 2.0 * speeds[1] > 4.0 * speeds[2] > 0.0
    told = describe(weak(2.0))
    assert "_ankle_y needs a torque of" in told["gait"]["fault"]
    assert "not even in place" in dict(rows_of(told))["walks by default"]


@pytest.mark.parametrize("scale", [0.2, 0.4, 2.5])
def test_robots_of_any_size_walk_by_default(tmp_path, scale):
    """Limits, and what is near a singular posture, are in the robot's measures."""
    robot = load_robot(write(tmp_path, scale=scale))
    assert describe(robot)["gait"]["fault"] is None
    pattern = walk_pattern(robot, 4)
    check_feasible(robot, pattern)
    assert simulate(robot, pattern).outcome.ok


def test_inertias_in_other_units_are_named(tmp_path):
    text = write(tmp_path).read_text()
    file = tmp_path / "heavy.urdf"
    file.write_text(re.sub(r'i(xx|yy|zz)="', r'i\1="5', text))
    with pytest.raises(ModelError, match=r"has an inertia of .* correct the units"):
        default_pendulum(load_robot(file))
