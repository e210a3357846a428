"""What `comwalk robot` finds: true of robots that were made so, silent on good ones."""

from __future__ import annotations

import json
import re

import pytest
from models import write
from robots import robot_of

from comwalk.certificates.description import describe, rows_of
from comwalk.certificates.doctor import DOUBT, NOTE, STOPS, Finding, findings
from comwalk.cli.app import main
from comwalk.robot.model import load_robot


def found(robot, level: str) -> list[Finding]:
    """Return the findings of one level."""
    return [finding for finding in findings(robot) if finding.level == level]


def changed(tmp_path, pattern: str, new: str, count: int = 0):
    """Return a robot in whose file a pattern was replaced."""
    file = write(tmp_path, effort=200.0)
    text, hits = re.subn(pattern, new, file.read_text(), count=count)
    assert hits
    file.write_text(text)
    return load_robot(file)


@pytest.mark.parametrize("name", ["paper", "jvrc1", "g1", "talos"])
def test_of_good_robots_nothing_is_doubtful(name):
    assert not [f for f in findings(robot_of(name)) if f.level != NOTE]


def test_the_worst_comes_first(tmp_path):
    """A robot that cannot walk and has no speed limits: what stops it leads."""
    ankles = {f"{side}_ankle_y": {"torque": 2.0} for side in ("left", "right")}
    robot = load_robot(write(tmp_path), profile={"limits": ankles})
    levels = [finding.level for finding in findings(robot)]
    assert levels == sorted(levels, key=(STOPS, DOUBT, NOTE).index)
    worst = findings(robot)[0]
    assert worst.level == STOPS
    assert worst.where.endswith("_ankle_y")
    assert "2 N m are there" in worst.what
    weak = [f for f in found(robot, DOUBT) if "mm from the ankle" in f.what]
    assert [f.where for f in weak] == ["left_ankle_y", "right_ankle_y"]
    rows = rows_of(describe(robot))
    assert (STOPS, str(worst)) in rows


def test_what_makes_the_gait_smaller_is_told(tmp_path):
    limits = {
        f"{side}_ankle_y": {"lower": -0.6, "upper": 0.6} for side in ("left", "right")
    }
    robot = load_robot(write(tmp_path, effort=200.0), profile={"limits": limits})
    (told,) = [f for f in found(robot, DOUBT) if "of the usual speed" in f.what]
    gait = describe(robot)["gait"]
    usual = 0.2 * (robot.com_height / 0.687) ** 0.5
    assert f"{gait['speed_m_s'] / usual:.0%} of the usual speed" in told.what


@pytest.mark.parametrize(
    ("profile", "what"),
    [
        ({"left_knee_y": {"torque": 90.0}}, "torque limit [N m] 90 and 200"),
        ({"left_hip_y": {"upper": 3.0}}, "joint range [rad]"),
    ],
)
def test_limits_that_differ_from_left_to_right(tmp_path, profile, what):
    file = write(tmp_path, effort=200.0)
    assert not [f for f in found(load_robot(file), DOUBT) if "left and" in f.where]
    robot = load_robot(file, profile={"limits": profile})
    (told,) = [f for f in found(robot, DOUBT) if "left and" in f.where]
    assert what in told.what


def test_a_heavier_leg_is_told(tmp_path):
    """The left shank has 1.3 times its mass: 5 % are allowed of what a joint moves."""
    file = write(tmp_path, effort=200.0)
    robot = load_robot(file)
    body = robot.model.body(robot.model.joint("left_knee_y").bodyid[0])
    mass = f'value="{body.mass[0]:.6g}"'
    text = file.read_text()
    place = text.index(f'<link name="{body.name}"')
    head, tail = text[:place], text[place:]
    value = re.search(r'<mass value="([^"]*)"', tail)
    assert value is not None, mass
    heavier = f'<mass value="{1.3 * float(value[1])}"'
    file.write_text(head + tail.replace(value[0], heavier, 1))
    (told,) = [f for f in found(load_robot(file), DOUBT) if "left and" in f.where]
    assert told.what.startswith("mass of the leg [kg]")


@pytest.mark.parametrize(
    ("pattern", "new", "what"),
    [
        (r'effort="[^"]*"', 'effort="200000"', "a torque that no leg has"),
        (r'velocity="[^"]*"', 'velocity="1000"', "a speed that no leg has"),
        (r'lower="[^"]*" upper="[^"]*"', 'lower="-90" upper="90"', "a range that no"),
    ],
)
def test_limits_in_other_units_are_told(tmp_path, pattern, new, what):
    robot = changed(tmp_path, pattern, new)
    assert [f for f in found(robot, DOUBT) if f.what.startswith(what)]


def test_masses_out_of_proportion_are_told(tmp_path):
    file = write(tmp_path, effort=1e7)
    text = re.sub(
        r'(<mass value=")([^"]*)"',
        lambda m: f'{m[1]}{100.0 * float(m[2])}"',
        file.read_text(),
    )
    names = "ixx", "iyy", "izz", "ixy", "ixz", "iyz"
    for name in names:
        text = re.sub(
            rf'{name}="([^"]*)"',
            lambda m, name=name: f'{name}="{100.0 * float(m[1])}"',
            text,
        )
    file.write_text(text)
    robot = load_robot(file)
    assert [f for f in found(robot, DOUBT) if "are masses in kg" in f.why]


def test_soles_that_are_assumed_and_limits_that_miss_are_told(tmp_path):
    robot = load_robot(write(tmp_path, foot="none"))
    told = [f for f in found(robot, DOUBT) if "sole of usual proportions" in f.what]
    assert len(told) == 2
    assert all("[soles]" in f.change for f in told)


def test_findings_are_in_the_json(tmp_path, capsys):
    assert main(["robot", str(write(tmp_path, foot="none")), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {"level", "where", "what", "why", "change"} == set(facts["findings"][0])
