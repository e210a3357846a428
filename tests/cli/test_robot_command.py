"""`comwalk robot`, and one clear line for every model that is broken."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from models import urdf, write
from pictures import inked

from comwalk.certificates.description import describe, rows_of
from comwalk.cli.app import main
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import load_robot
from comwalk.views.gl import RenderError
from comwalk.views.portrait import draw_portrait
from comwalk.views.render import View


def test_the_table_tells_the_parts(capsys):
    """Joints, soles, servos and the gait of the paper's robot."""
    assert main(["robot"]) == 0
    text = capsys.readouterr().out
    for words in ("67.68 kg", "0.687 m", "l_hip_yaw", "240 x 130 mm", "0.200 m/s"):
        assert words in " ".join(text.split())


def test_one_object_with_json(capsys, tmp_path):
    """All that was found, as numbers."""
    file = write(tmp_path, fingers=2, foot="none")
    assert main(["robot", str(file), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["name"] == "toy"
    assert found["parts"]["left_leg"][0] == "left_hip_z"
    assert len(found["locked"]) == 8
    assert found["soles"]["left"]["from"] == "fitted"
    assert found["servos"]["left_knee_y"]["designed"]
    assert found["missing_limits"] == {"range": [], "speed": [], "torque": []}
    assert any("no shape" in note for note in found["notes"])


def test_the_profile_it_writes_can_be_given_back(capsys, tmp_path):
    """And the robot is the same."""
    file, own = write(tmp_path, yaw=1.0), tmp_path / "own.toml"
    assert main(["robot", str(file), "--write-profile", str(own), "--json"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert first.pop("profile") == str(own)
    assert main(["robot", str(file), "--profile", str(own), "--json"]) == 0
    second = json.loads(capsys.readouterr().out)
    for key in ("mass_kg", "parts", "locked", "roles", "gait", "forward_deg"):
        assert first[key] == second[key]
    assert second["home_rad"] == pytest.approx(first["home_rad"], abs=2e-4)


def test_texts_of_unusual_robots(tmp_path):
    """No arm, joints without limits, joints that follow: each has its row."""
    text = urdf(arms=(), mimic={"neck_y": ("neck_z", 1.0, 0.0)})
    file = tmp_path / "odd.urdf"
    file.write_text(re.sub(r'<limit lower="-2.5"[^>]*/>', "", text, count=3))
    rows = dict(rows_of(describe(load_robot(file))))
    assert "left arm" not in rows
    assert "no torque limit" in rows
    assert rows["servos of the legs"].endswith("designed")


def test_a_picture(tmp_path):
    """Soles, frames and the CoM are seen on the robot."""
    robot = load_robot(write(tmp_path, foot="none"))
    file = tmp_path / "robot.png"
    try:
        picture = draw_portrait(robot, file, View(width=160, height=200))
    except RenderError as error:
        pytest.skip(str(error))
    assert picture.shape == (200, 160, 3)
    assert inked(file) > 0.1
    r, g, b = picture.astype(int).reshape(-1, 3).T
    assert np.count_nonzero((r > 120) & (g < 80) & (b < 80)) > 5  # axes
    assert np.count_nonzero((b > 130) & (r < 60)) > 5  # soles


def test_a_picture_by_the_command(tmp_path, capsys):
    """It is written where asked, and said to be."""
    file = tmp_path / "paper.png"
    code = main(["robot", "paper", "--picture", str(file), "--json"])
    if code == 2:
        pytest.skip(capsys.readouterr().err)
    assert json.loads(capsys.readouterr().out)["picture"] == str(file)
    assert file.is_file()


# ---- Broken models ----------------------------------------------------------------

ARM = (
    '<robot name="arm"><link name="table"/>'
    + "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"'
        f' ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{k}" '
        f'type="revolute"><parent link="{f"l{k - 1}" if k else "table"}"/>'
        f'<child link="l{k}"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        for k in range(6)
    )
    + "</robot>"
)
USUAL = urdf()
BROKEN = {
    "bad XML": (USUAL.replace("</robot>", ""), "not well-formed XML"),
    "nothing": ("", "it is empty"),
    "one leg": (urdf(legs=1), "one limb that reaches the ground"),
    "round feet": (urdf(foot="ball"), "no flat of"),
    "no mass": (re.sub(r"<inertial>.*?</inertial>", "", USUAL), "have no mass"),
    "an inertia that is no number": (
        re.sub(r'ixx="[^"]*"', 'ixx="nan"', USUAL, count=2),
        'ixx="nan"',
    ),
    "a quadruped": (urdf(legs=4), "more than two limbs"),
    "an arm on a table": (ARM, "one limb that reaches the ground"),
    "millimetres": (urdf(scale=1000.0), "must be in .* kg"),
    "two links of one name": (
        USUAL.replace("</robot>", '<link name="pelvis"/></robot>'),
        'links are named "pelvis"',
    ),
    "two joints of one name": (
        USUAL.replace('name="right_knee_y" type', 'name="left_knee_y" type'),
        'joints are named "left_knee_y"',
    ),
}


@pytest.mark.parametrize(("text", "message"), BROKEN.values(), ids=BROKEN)
def test_broken_models_give_one_clear_line(tmp_path, capsys, text, message):
    """It names the file and the fault; the exit code is that of bad input."""
    file = tmp_path / "broken.urdf"
    file.write_text(text)
    assert main(["walk", str(file), "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert "broken.urdf" in error
    assert error.count("\n") == 1
    assert "Traceback" not in error
    assert not (tmp_path / "run").exists()


def test_a_robot_far_from_the_origin_is_brought_back(tmp_path, capsys):
    """It is not in the way of anything."""
    text, near = read_model(write(tmp_path)).spec.to_xml(), '<body name="base">'
    assert near in text
    file = tmp_path / "far.xml"
    file.write_text(text.replace(near, near.replace(">", ' pos="1e6 0 0">')))
    assert main(["robot", str(file), "--json"]) == 0
    assert any("origin" in n for n in json.loads(capsys.readouterr().out)["notes"])


def test_a_missing_mesh_is_a_note(tmp_path, capsys):
    """Even if it is all that a foot has: its sole is assumed, and both are said."""
    assert main(["robot", str(write(tmp_path, foot="mesh")), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any("mesh files not found" in note for note in found["notes"])
    assert any("sole of usual proportions" in note for note in found["notes"])
    assert found["soles"]["right"]["from"] == "fitted"
