"""A robot in a browser's scene: what a page plays is what MuJoCo simulated."""

from __future__ import annotations

import msgspec
import mujoco
import numpy as np
import pytest
import zstandard

from comwalk.errors import ParameterError
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.model import load_robot
from comwalk.run import simulate
from comwalk.sides import Side
from comwalk.views.scene import scene_film, scene_page
from comwalk.views.scene_data import seen_of, sole_box


@pytest.fixture(scope="module")
def recording():
    """A robot's single step."""
    gait = Gait(stand_time=0.1, start_time=0.4, stop_time=0.4)
    pattern = make_pattern(plan_steps(gait, 1), Pendulum())
    return seen_of(simulate(load_robot("paper"), pattern))


@pytest.fixture(scope="module")
def film(recording):
    """The messages of its page: times and what to do."""
    data = zstandard.ZstdDecompressor().decompress(
        scene_film(recording, fps=5.0)[8:], max_output_size=1 << 28
    )
    size = int.from_bytes(data[:8], "little")
    return msgspec.msgpack.decode(data[8 : 8 + size])


def state_at(film, time):
    """Return poses by node, as a page has them at a time."""
    poses = {}
    for at, message in film["messages"]:
        if at > time:
            break
        if "name" in message:
            pose = poses.setdefault(message["name"], {})
            pose |= {k: message[k] for k in ("position", "wxyz") if k in message}
    return poses


def placed(poses, name):
    """Return place and rotation of a node in the scene, through all above it."""
    position, rotation = np.zeros(3), np.eye(3)
    parts = name.split("/")[1:]
    for k in range(len(parts)):
        pose = poses.get("/" + "/".join(parts[: k + 1]), {})
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, np.array(pose.get("wxyz", (1.0, 0.0, 0.0, 0.0))))
        position = position + rotation @ np.array(pose.get("position", np.zeros(3)))
        rotation = rotation @ R.reshape(3, 3)
    return position, rotation


@pytest.mark.parametrize("picture", [0, 6, 11])
def test_bodies_are_where_mujoco_has_them(recording, film, picture):
    """Every body, within the rounding, relative to what the camera looks at."""
    row = recording.rows(5.0)[picture]
    poses = state_at(film, picture / 5.0 + 1e-6)
    model, data = recording.model, mujoco.MjData(recording.model)
    data.qpos[:] = recording.moment(row).qpos
    mujoco.mj_kinematics(model, data)
    center = np.array([*recording.center[row], 0.0])
    names = [n for n in poses if n.startswith("/walk/robot/") and "/m" not in n]
    bodies = {int(n.rpartition("/")[2]): n for n in names}
    assert len(bodies) > 20
    for body, name in bodies.items():
        place, R = placed(poses, name)
        np.testing.assert_allclose(place, data.xpos[body] - center, atol=1e-3)
        np.testing.assert_allclose(R, data.xmat[body].reshape(3, 3), atol=1e-3)


def test_marks_are_where_they_were_recorded(recording, film):
    """CoM and ZMP and their references, through the same node as the robot."""
    row = recording.rows(5.0)[8]
    moment, poses = recording.moment(row), state_at(film, 8 / 5.0 + 1e-6)
    center = np.array([*recording.center[row], 0.0])
    for name, true in (
        ("com/actual", moment.com),
        ("com/reference", moment.com_ref),
        ("zmp/actual", [*moment.zmp, 0.003]),
        ("zmp/reference", [*moment.zmp_ref, 0.003]),
    ):
        place, _ = placed(poses, f"/walk/{name}")
        np.testing.assert_allclose(place, true - center, atol=1e-3)


def test_forces_stand_on_the_soles(recording, film):
    """In single support one arrow, on the sole; standing two."""
    for picture, count in ((0, 2), (5, 1)):
        row, time = recording.rows(5.0)[picture], picture / 5.0 + 1e-6
        poses = state_at(film, time)
        shown = {}
        for at, message in film["messages"]:
            if at <= time and "visible" in message:
                shown[message["name"]] = message["visible"]
        sides = [s for s in Side if shown.get(f"/walk/wrenches/{s}")]
        assert len(sides) == count
        data = mujoco.MjData(recording.model)
        data.qpos[:] = recording.moment(row).qpos
        mujoco.mj_kinematics(recording.model, data)
        for side in sides:
            place, _ = placed(poses, f"/walk/wrenches/{side}")
            box = sole_box(recording.model, data, side)
            spot = place[:2] + recording.center[row] - box.center[:2]
            assert (np.abs(spot @ box.rotation[:2, :2]) < box.size[:2] + 2e-3).all()


def test_a_film_lasts_as_long_as_the_run(recording, film):
    """The play bar of a page shows the time of the walk."""
    assert film["durationSeconds"] == pytest.approx(recording.t[-1], abs=0.21)


def test_a_page_needs_no_network_and_is_small(recording):
    """One file of scripts and data, of about a megabyte, half of it the player."""
    page = scene_page(recording, fps=10.0)
    assert "__VISER_EMBED_DATA__" in page
    assert len(page) < 1.3e6


def test_nonsense_is_refused(recording):
    """No picture a second, or a robot that is not there."""
    with pytest.raises(ParameterError, match="fps"):
        scene_page(recording, fps=0.0)
    with pytest.raises(ParameterError, match="opacity"):
        scene_page(recording, opacity=0.0)
