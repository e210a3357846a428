"""What the simulator adds to a flat floor and perfect sensors, each against an oracle.

The plant is driven open loop by one fixed command, so that two plants with different
sensors go through the same states.
"""

from __future__ import annotations

import dataclasses
from functools import cache

import mujoco
import numpy as np
import pytest
from robots import paper

from comwalk.control.plant import Command
from comwalk.control.settings import Push, SimulatorSettings
from comwalk.errors import ParameterError
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.replay import replay
from comwalk.run import simulate
from comwalk.sides import Side
from comwalk.walking.mujoco_plant import SimulatedRobot
from comwalk.walking.mujoco_scene import build_scene, trunk_body
from comwalk.walking.terrain import random_terrain

PLAN = plan_steps(Gait(), 4)
FIELDS = ("positions", "velocities", "wrenches", "orientation", "gyro", "acceleration")


def scene_of(**settings):
    return build_scene(paper(), SimulatorSettings(**settings), PLAN)


@cache
def readings(count=60, **settings):
    """Return what a standing robot senses while its knees wobble."""
    robot = paper()
    plant = SimulatedRobot(robot, 0.002, SimulatorSettings(**settings), 1, PLAN)
    plant.place(robot.home)
    still, rates = robot.home[7:], np.zeros(len(robot.joints))
    found = [plant.start(Command(still, rates))]
    knees = [robot.joints.index(f"{side}_knee_pitch") for side in "lr"]
    for k in range(count - 1):
        wobble = still.copy()
        wobble[knees] += 0.005 * np.sin(0.2 * k)
        plant.write(Command(wobble, rates))
        found.append(plant.read())
    return found


def stacked(found, field):
    return np.array([getattr(sensors, field) for sensors in found])


@pytest.mark.parametrize("share", [0.1, 0.25])
def test_payload_has_its_mass_and_its_place(share):
    """Its share of the mass, 12 cm behind the trunk's CoM: so the CoM moves by it."""
    robot, model = paper(), scene_of(payload=share)
    assert model.body_mass.sum() == pytest.approx((1 + share) * robot.mass, rel=1e-12)
    assert robot.model.body_mass.sum() == pytest.approx(robot.mass, rel=1e-12)
    data, bare = mujoco.MjData(model), mujoco.MjData(robot.model)
    for m, d in ((model, data), (robot.model, bare)):
        d.qpos[:] = robot.home
        mujoco.mj_forward(m, d)
    place = bare.xipos[trunk_body(robot.model)] - [0.12, 0.0, 0.0]
    expected = (bare.subtree_com[1] + share * place) / (1 + share)
    assert np.abs(data.subtree_com[1] - expected).max() < 1e-9


def test_payload_is_behind_whatever_way_the_robot_looks():
    """Turned by a quarter about the vertical, at home, it is at y instead of -x."""
    robot = paper()
    home = robot.home.copy()
    home[3:7] = np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)
    turned = dataclasses.replace(robot, home=home)
    models = [
        build_scene(robot_, SimulatorSettings(payload=0.1))
        for robot_ in (robot, turned)
    ]
    places = [m.body_pos[m.body("comwalk_payload").id] for m in models]
    assert np.abs(places[0] - places[1]).max() < 1e-9


def test_payload_touches_nothing():
    model = scene_of(payload=0.1)
    geoms = model.geom_bodyid == model.body("comwalk_payload").id
    assert geoms.sum() == 1
    assert not (model.geom_contype[geoms] | model.geom_conaffinity[geoms]).any()


def test_only_soles_touch_the_boxes_of_a_rough_floor():
    model, flat = scene_of(terrain=0.01), scene_of()
    boxes = np.arange(model.ngeom) < 0
    boxes[1 : len(random_terrain(PLAN, 0.01, 0).heights) + 1] = True
    assert (model.geom_bodyid[boxes] == 0).all()
    assert (model.geom_type[boxes] == int(mujoco.mjtGeom.mjGEOM_BOX)).all()
    bodies = [paper().model.site_bodyid[paper().feet[s].site] for s in Side]
    meets = (model.geom_contype[:, None] & model.geom_conaffinity) > 0
    meets |= meets.T
    touching = meets[:, boxes].any(axis=1)
    assert touching.sum() == 2
    assert set(model.geom_bodyid[touching]) == set(bodies)
    # Nothing else changed: the robot meets itself and the floor as before.
    before = (flat.geom_contype[:, None] & flat.geom_conaffinity) > 0
    assert np.array_equal(meets[~boxes][:, ~boxes], before | before.T)


def test_boxes_are_where_and_as_high_as_the_terrain_says():
    """Rays from above meet the tops."""
    model = scene_of(terrain=0.02, terrain_seed=3)
    terrain = random_terrain(PLAN, 0.02, 3)
    data = mujoco.MjData(model)
    data.qpos[2] = 50.0  # the robot is out of the way
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    spots = [*terrain.centers.tolist(), *(terrain.centers + 0.079).tolist()]
    for (x, y), height in zip(spots, [*terrain.heights] * 2, strict=True):
        down = np.array([0.0, 0.0, -1.0])
        distance = mujoco.mj_ray(
            model, data, np.array([x, y, 5.0]), down, None, 1, -1, hit
        )
        assert 5.0 - distance == pytest.approx(height, abs=1e-9)


def test_robot_starts_level_on_a_rough_floor():
    """The start is flat: it comes to rest as on the plane."""
    flat, rough = readings(2), readings(2, terrain=0.03)
    for field in ("positions", "orientation", "wrenches"):
        assert np.allclose(stacked(flat, field), stacked(rough, field), atol=1e-6)


def test_rough_floor_needs_a_plan():
    with pytest.raises(ParameterError, match="needs a plan"):
        build_scene(paper(), SimulatorSettings(terrain=0.01))


@pytest.mark.parametrize(("latency", "ticks"), [(0.002, 1), (0.01, 5), (0.0071, 4)])
def test_latency_returns_the_older_reading_exactly(latency, ticks):
    prompt, late = readings(), readings(latency=latency)
    for field in ("time", *FIELDS):
        expected = stacked(prompt, field)[np.maximum(np.arange(60) - ticks, 0)]
        assert np.array_equal(stacked(late, field), expected)


def test_noise_has_the_stated_size_and_no_bias():
    """Differences from a clean plant in the same states are the noise alone."""
    clean, noisy = (readings(600, noise=noise) for noise in (0.0, 2.0))
    error = {f: stacked(noisy, f) - stacked(clean, f) for f in FIELDS}
    turns = np.empty((600, 3))
    for turn, a, b in zip(turns, clean, noisy, strict=True):
        mujoco.mju_subQuat(turn, b.orientation, a.orientation)
    deviations = {
        "positions": (error["positions"], 1e-4),
        "force": (error["wrenches"][..., :3], 5.0),
        "torque": (error["wrenches"][..., 3:], 0.2),
        "orientation": (turns, 2e-3),
        "gyro": (error["gyro"], 1e-2),
        "acceleration": (error["acceleration"], 5e-2),
    }
    for name, (values, deviation) in deviations.items():
        spread = 2.0 * deviation
        assert values.std() == pytest.approx(spread, rel=0.06), name
        assert abs(values.mean()) < 4.0 * spread / np.sqrt(values.size), name
        flat = values.reshape(600, -1)
        white = (flat[1:] * flat[:-1]).mean() / spread**2
        assert abs(white) < 4.0 / np.sqrt(values.size), name
    norms = np.linalg.norm(stacked(noisy, "orientation"), axis=1)
    assert np.abs(norms - 1.0).max() < 1e-9
    assert not error["velocities"].any()


def test_everything_at_once_replays_exactly(tmp_path):
    push = Push(start=2.0, force=(0.0, 40.0, 0.0))
    physics = SimulatorSettings(
        terrain=0.004,
        terrain_seed=2,
        payload=0.03,
        latency=0.004,
        noise=1.0,
        friction=0.5,
        pushes=(push,),
    )
    pattern = make_pattern(plan_steps(Gait(), 2), Pendulum())
    run = simulate(paper(), pattern, physics=physics)
    assert run.outcome.ok
    # The ankles do feel boxes: no sole stands on the plane once it has left the start.
    heights = run.log["qpos"][:, 2]
    assert np.ptp(heights) > 1e-3
    result = replay(run.save(tmp_path / "run"))
    assert result.ticks == len(run.log)
    assert result.position_difference == result.velocity_difference == 0.0


def test_truth_is_free_of_noise_and_latency():
    """Wrenches for the figures are those of the ankles, now."""
    pattern = make_pattern(plan_steps(Gait(), 1), Pendulum())
    clean = simulate(paper(), pattern)
    assert np.array_equal(clean.log["wrenches"], clean.log["wrenches_true"])
    late = simulate(paper(), pattern, physics=SimulatorSettings(latency=0.01))
    log = late.log
    assert np.array_equal(log["wrenches"][5:], log["wrenches_true"][:-5])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("terrain", 0.3),
        ("terrain", -0.01),
        ("terrain_seed", -1),
        ("terrain_seed", 0.5),
        ("payload", 1.5),
        ("latency", 0.3),
        ("latency", float("nan")),
        ("noise", -1.0),
    ],
)
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=f"^{name} must be"):
        SimulatorSettings(**{name: value})
