"""What a file holds around its robot: what is kept of it, where, on which floor."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from robots import toy_scene

from comwalk.control.settings import SimulatorSettings
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import load_robot
from comwalk.walking.mujoco_scene import BEGIN, build_scene

FLOOR = '<geom name="floor" type="plane" size="0 0 0.05"/>'
CRATE = '<geom name="crate" type="box" size="0.1 0.2 0.05" pos="{}" euler="0 0 {}"/>'
BALL = '<body name="ball" pos="{}"><freejoint/><geom size="0.1"/></body>'


def seen(robot):
    """Return the scene of a robot, and its state as it begins."""
    model = build_scene(robot, SimulatorSettings())
    data = mujoco.MjData(model)
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, BEGIN)
    mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_kinematics(model, data)
    return model, data


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -2.0])
def test_the_world_is_seen_from_where_the_robot_stands(tmp_path, yaw):
    """At (2, 1) on a floor at 0.3 m, looking along y, whatever way the file has it."""
    around = FLOOR.replace("plane", 'plane" pos="0 0 0.3').replace("0 0 0.05", "0 0 1")
    around += CRATE.format("2 1.5 0.35", math.pi / 2) + BALL.format("1 1 0.8")
    base = f'pos="2 1 1.2" euler="0 0 {math.pi / 2 - yaw}"'
    robot = load_robot(toy_scene(tmp_path, around, base, yaw=yaw))
    model, data = seen(robot)
    assert data.geom("world/crate").xpos == pytest.approx([0.5, 0, 0.05], abs=1e-6)
    turn = data.geom("world/crate").xmat.reshape(3, 3)
    assert turn == pytest.approx(np.eye(3), abs=1e-6)
    assert data.body("world/ball").xpos == pytest.approx([0, 1, 0.5], abs=1e-6)
    assert model.geom("comwalk_floor").pos.tolist() == [0, 0, 0]
    assert "world/floor" not in [model.geom(i).name for i in range(model.ngeom)]
    assert robot.notes[-1] == (
        "the file's world is kept: 1 shape, 1 movable body; its floor at 0.3 m"
    )


BOX = '<geom name="b" type="box" size="2 2 0.1" pos="{}"/>'
FIELD = '<geom name="h" type="hfield" hfield="h"/>'
GROUNDS = {
    "a plane": (FLOOR, 0.0, "comwalk_floor"),
    "a box": (BOX.format("0 0 0.1"), 0.2, "world/b"),
    "a box on a plane": (FLOOR + BOX.format("0 0 -0.05"), 0.05, "world/b"),
    "a box that ends before the robot": (FLOOR + BOX.format("2.5 0 0.1"), 0.0, None),
    "a box that moves": (
        f"{FLOOR}<body><freejoint/>{BOX.format('0 0 0.1')}</body>",
        *(0.0, None),
    ),
    "a box that is only seen": (
        FLOOR + BOX.format("0 0 0").replace("/>", ' contype="0" conaffinity="0"/>'),
        *(0.0, None),
    ),
    "two planes": (FLOOR + FLOOR.replace('floor"', 'low" pos="0 0 -1"'), 0.0, None),
    "a height field": (FIELD, 0.5, "world/h"),
    "nothing": ("", 0.0, "comwalk_floor"),
}


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("base", ['pos="0 0 1.2"', 'pos="0 0 0.95"', 'pos="0 0 0.3"'])
def test_the_ground_is_under_the_feet(tmp_path, ground, base):
    """Even if the robot hovers above it, or stands in it up to the hips."""
    around, height, name = GROUNDS[ground]
    more = (
        '<asset><hfield name="h" nrow="2" ncol="2" size="3 3 1 1" '
        'elevation="0 0 1 1"/></asset>'
    )
    around += CRATE.format("0 5 0.05", 0)
    robot = load_robot(toy_scene(tmp_path, around, base, more=more))
    _, data = seen(robot)
    assert data.geom("world/crate").xpos == pytest.approx(
        [0, 5, 0.05 - height], abs=0.03 if ground == "a height field" else 1e-6
    )
    if name is not None:
        below = [p for p in ("comwalk_floor", "world/b", "world/h") if p == name]
        down, hit = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
        model, data = seen(robot)
        data.qpos[2] = 50.0
        mujoco.mj_forward(model, data)
        start = np.array([0.0, 0.01, 0.5])
        away = mujoco.mj_ray(model, data, start, down, None, True, -1, hit)
        assert [model.geom(int(hit[0])).name] == below
        assert away == pytest.approx(0.5, abs=0.02)
    assert (robot.world.floor is None) == (name in ("world/b", "world/h"))


def test_a_file_with_a_level_floor_alone_is_as_without(tmp_path):
    """Sky, lights, bodies without shapes: nothing that collides or is seen."""
    more = (
        '<asset><texture type="skybox" builtin="flat" width="8" height="8"/></asset>'
        '<keyframe><key name="stand" qpos="{}"/></keyframe>'
    ).format(" ".join(["0"] * 3 + ["1"] + ["0"] * 29))
    around = f'{FLOOR}<light pos="0 0 3"/><body name="frame"/>'
    robot = load_robot(toy_scene(tmp_path, around, more=more))
    assert robot.world is None
    assert robot.notes[0] == "beside the robot in the world, dropped: frame"
    bare = load_robot(toy_scene(tmp_path, ""))
    assert np.array_equal(robot.home, bare.home)


KEYS = (
    '<keyframe><key name="one" qpos="0 0 9 1 0 0 0 0 {robot} {joints}"/>'
    '<key name="two" qpos="1 2 0.4 1 0 0 0 0.7 0 0 0.9 0 0 0 1 {joints}" '
    'qvel="3 0 0 0 0 5 0.2 {rates}" ctrl="0.6"/></keyframe>'
)
DOOR = (
    '<body name="door" pos="3 0 0"><joint name="hinge" ref="0.1"/><geom type="box" '
    'size="0.1 0.1 0.1"/></body>'
)


@pytest.mark.parametrize(("name", "first"), [("two", "one"), ("walk", "walk")])
def test_things_begin_as_the_keyframe_has_them(tmp_path, name, first):
    """In "walk", else in the first one; the robot looks the other way in the second."""
    around, zeros = FLOOR + BALL.format("1 0 0.3") + DOOR, " ".join(["0"] * 26)
    keys = KEYS.format(
        robot="0 0 0.9 1 0 0 0", joints=zeros, rates=f"0 0 0 0 0 0 {zeros}"
    )
    more = (
        keys.replace("two", name)
        + '<actuator><position name="p" joint="hinge" kp="7"/></actuator>'
    )
    robot = load_robot(toy_scene(tmp_path, around, more=more))
    model, data = seen(robot)
    ball, hinge = data.joint(model.njnt - 2), data.joint("world/hinge")
    assert data.ctrl.tolist() == [0.0] * 26 + [0.6 if first == "walk" else 0.0]
    assert model.actuator("world/p").gainprm[0] == 7
    if first == "walk":  # half a turn: what is ahead comes to be behind
        assert ball.qpos == pytest.approx([-1, -2, 0.4, 0, 0, 0, -1], abs=1e-9)
        assert ball.qvel == pytest.approx([-3, 0, 0, 0, 0, 5], abs=1e-9)
        assert (hinge.qpos, hinge.qvel) == (0.7, 0.2)
        assert data.body("world/door").xpos == pytest.approx([-3, 0, 0], abs=1e-9)
    else:
        assert ball.qpos.tolist() == [0, 0, 9, 1, 0, 0, 0]
        assert hinge.qpos == 0.0


KINDS = [(1, 1), (2, 0), (0, 2), (4, 8), (0, 0)]


def meet(model, a, b):
    """Return which geoms of two lists collide by contype and conaffinity."""
    types, affine = model.geom_contype, model.geom_conaffinity
    return (types[a][:, None] & affine[b]) | (types[b] & affine[a][:, None]) != 0


def test_shapes_touch_as_their_contype_in_the_file_says(tmp_path):
    """The robot's with those around it; its own, but soles, with nothing else."""
    typed = [f'size="0.05" contype="{a}" conaffinity="{b}"' for a, b in KINDS]
    around = "".join(f'<geom name="o{k}" {t}/>' for k, t in enumerate(typed))
    more = "".join(f'<geom name="r{k}" {t} mass="0"/>' for k, t in enumerate(typed))
    file = toy_scene(
        tmp_path,
        FLOOR + around,
        change=lambda t: t.replace('<body name="waist0"', f'{more}<body name="waist0"'),
    )
    model = build_scene(load_robot(file), SimulatorSettings())
    ours = np.array([model.geom(f"r{k}").id for k in range(len(KINDS))])
    theirs = np.array([model.geom(f"world/o{k}").id for k in range(len(KINDS))])
    wanted = [[a & d or c & b for c, d in KINDS] for a, b in KINDS]
    assert np.array_equal(meet(model, ours, theirs), np.array(wanted) != 0)
    assert np.array_equal(meet(model, theirs, theirs), np.array(wanted) != 0)
    floor = np.array([model.geom("comwalk_floor").id])
    robot = np.flatnonzero(model.geom_bodyid > 0)
    feet = [model.site_bodyid[model.site(f"{s}_sole").id] for s in "lr"]
    soles = robot[np.isin(model.geom_bodyid[robot], feet)]
    touching = robot[meet(model, floor, robot)[0]]
    assert touching.tolist() == soles.tolist()
    assert not meet(model, robot, robot).any()
    assert meet(model, floor, theirs)[0].tolist() == [True, False, False, False, False]
    # Soles are like the shapes of their feet, (1, 1).
    assert meet(model, soles, theirs)[0].tolist() == [True] + [False] * 4


def test_pairs_that_the_file_excludes_do_not_touch(tmp_path):
    more = (
        '<contact><exclude body1="ball" body2="link_left_ankle_x"/>'
        '<exclude body1="pelvis" body2="chest"/></contact>'
    )
    robot = load_robot(toy_scene(tmp_path, BALL.format("1 0 1"), more=more))
    model = build_scene(robot, SimulatorSettings())
    pairs = [divmod(int(sign), 1 << 16) for sign in model.exclude_signature]
    names = [{model.body(b).name for b in pair} for pair in pairs]
    assert {"world/ball", "link_left_ankle_x"} in names
    assert {"pelvis", "chest"} in names


def test_names_of_the_world_do_not_clash(tmp_path):
    """Not with comwalk's, nor with frames that it marks."""
    around = FLOOR + (
        '<geom name="comwalk_floor" size="0.1" material="comwalk_floor"/>'
        '<site name="gaze" pos="1 0 0"/><body name="comwalk_payload">'
        '<freejoint name="comwalk_begin"/><geom name="l_sole_contact_0" size="0.1"/>'
        '<site name="imu"/><site name="l_sole_centre"/></body>'
    )
    more = (
        '<asset><texture name="comwalk_tiles" type="2d" builtin="flat" width="4" '
        'height="4"/><material name="comwalk_floor" texture="comwalk_tiles"/></asset>'
        '<sensor><framequat name="imu_quat" objtype="site" objname="imu"/></sensor>'
        '<actuator><motor name="left_knee_y" joint="left_knee_y"/></actuator>'
    )
    robot = load_robot(toy_scene(tmp_path, around, more=more))
    model = build_scene(robot, SimulatorSettings(payload=0.1))
    assert model.body("world/comwalk_payload").dofnum == 6
    assert model.geom("world/comwalk_floor").type == int(mujoco.mjtGeom.mjGEOM_SPHERE)
    assert model.site("world/gaze").pos == pytest.approx([1, 0, 0])
    assert model.sensor("imu_quat").objid == model.site("imu").id
    assert [model.joint(i).name for i in range(1, 27)] == list(robot.joints)
    assert (model.nu, model.nq) == (26, robot.model.nq + 7)


TETRAHEDRON = (
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0.2 0.2 0.2\n"
    "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 5 4\nf 2 3 5\nf 3 4 5\n"
)
FILES = (
    '<asset><mesh name="t" file="t.obj"/><mesh name="gone" file="gone.stl"/>'
    '<texture name="lost" type="2d" file="lost.png"/><material name="m" texture="lost" '
    'rgba="0 1 0 1"/><hfield name="hills" file="hills.png" size="1 1 1 1"/></asset>'
)


def test_what_has_no_file_is_left_out_with_a_note(tmp_path):
    around = FLOOR + (
        '<geom name="green" size="0.1" material="m"/>'
        '<geom name="hill" type="hfield" hfield="hills"/>'
        '<body name="lamp"><freejoint/><geom type="mesh" mesh="gone"/></body>'
        '<body name="cup"><freejoint/><geom size="0.1"/>'
        '<geom type="mesh" mesh="gone"/></body>'
    )
    robot = load_robot(toy_scene(tmp_path, around, more=FILES), geometry=True)
    model = build_scene(robot, SimulatorSettings())
    names = [model.geom(i).name for i in range(model.ngeom)]
    assert "world/green" in names
    assert "world/hill" not in names
    assert model.mat("world/m").rgba == pytest.approx([0, 1, 0, 1])
    assert [model.body(i).name for i in range(model.nbody)][-1] == "world/cup"
    assert model.nq == robot.model.nq + 7
    assert {
        "height fields not found: hills.png",
        "textures not found: lost.png",
        "meshes of the file's world not found: gone.stl",
    } <= set(robot.notes)


@pytest.mark.parametrize("geometry", [False, True])
def test_meshes_that_touch_stay_as_their_hulls(tmp_path, geometry):
    """Of the robot and of its world; the dent in the tetrahedron is not in the hull."""
    (tmp_path / "t.obj").write_text(TETRAHEDRON)
    shape = '<geom name="{}" type="mesh" mesh="t" contype="{}" conaffinity="{}"/>'
    around = FLOOR + shape.format("wall", 1, 1).replace("/>", ' pos="3 0 0"/>')
    around += f'<body name="rock" pos="0 3 0"><freejoint/>{shape.format("s", 1, 1)}'
    around += f"{shape.format('moss', 0, 0)}</body>"
    own = shape.format("belly", 1, 1) + shape.format("skin", 0, 0)
    own = own.replace("/>", ' density="0"/>')
    file = toy_scene(
        tmp_path,
        around,
        more='<default><mesh scale="0.1 0.1 0.1"/></default><asset><mesh name="t" '
        'file="t.obj" refpos="0.01 0 0" refquat="1 0 0 1"/></asset>',
        change=lambda t: t.replace('<body name="waist0"', f'{own}<body name="waist0"'),
    )
    robot = load_robot(file, geometry=geometry)
    model, data = seen(robot)
    for name in ("world/wall", "world/s", "belly"):
        geom = model.geom(name)
        start = int(model.mesh_vertadr[geom.dataid[0]])
        count = int(model.mesh_vertnum[geom.dataid[0]])
        R, place = data.geom(name).xmat.reshape(3, 3), data.geom(name).xpos
        points = model.mesh_vert[start : start + count] @ R.T + place
        frame = data.body(geom.bodyid[0])
        local = (points - frame.xpos) @ frame.xmat.reshape(3, 3)
        local = points - [3, 0, 0] if name == "world/wall" else local
        assert len(points) == (5 if geometry else 4)
        low, high = np.array([0, -0.099, 0]), np.array([0.1, 0.001, 0.1])
        assert local.min(axis=0) == pytest.approx(low, abs=1e-6)
        assert local.max(axis=0) == pytest.approx(high, abs=1e-6)
    seen_only = {"skin", "world/moss"} & {
        model.geom(i).name for i in range(model.ngeom)
    }
    assert seen_only == ({"skin", "world/moss"} if geometry else set())
    whole = mujoco.MjModel.from_xml_path(str(file)).body("rock")
    assert model.body("world/rock").mass == pytest.approx(whole.mass)
    assert model.body("world/rock").inertia == pytest.approx(whole.inertia)


def test_what_is_heavier_than_the_robot_is_no_robot(tmp_path):
    """A car of a ton with a wheel; of two trees with legs, the heavier is the robot."""
    car = (
        '<body name="car" pos="3 0 1"><freejoint/><geom type="box" size="1 1 1"/>'
        '<body><joint/><geom size="0.3"/></body></body>'
    )
    file = read_model(toy_scene(tmp_path, FLOOR + car))
    assert file.spec.worldbody.first_body().name == "base"
    around = file.around.spec.compile()
    assert around.body("car").mass == pytest.approx(8000)
