"""Robots out of any URDF or MJCF, against Pinocchio; and every way to be broken."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comwalk.errors import ModelError
from comwalk.robot.loaders.sources import ROBOTS, ModelFile, read_model

URDFS = [name for name in ROBOTS if name not in ("paper", "mjlab_g1")]

LINK = """<link name="{name}"><inertial><origin xyz="0.01 0 -0.1"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01"/></inertial>{shape}</link>"""
JOINT = """<joint name="{name}" type="{kind}"><origin xyz="0 {y} -0.2"/>
<parent link="{parent}"/><child link="{child}"/><axis xyz="0 2 0"/>
<limit lower="-1" upper="2" effort="30" velocity="4"/>{more}</joint>"""


def link(name: str, shape: str = "") -> str:
    """Return a link of 2 kg."""
    return LINK.format(name=name, shape=shape)


def joint(
    name: str, parent: str, child: str, *, kind: str = "revolute", more: str = ""
) -> str:
    """Return a joint about y, to the left if its name starts with l."""
    y = 0.1 if name[0] == "l" else -0.1
    return JOINT.format(
        name=name, kind=kind, parent=parent, child=child, y=y, more=more
    )


def biped(*more: str, left: str = "") -> str:
    """Return a URDF of a trunk with two legs."""
    parts = [link("trunk"), link("l_leg"), link("r_leg")]
    parts += [joint("l_hip", "trunk", "l_leg", more=left)]
    parts += [joint("r_hip", "trunk", "r_leg")]
    return f'<robot name="biped">{"".join(parts)}{"".join(more)}</robot>'


MJCF = """<mujoco model="toy"><compiler angle="degree"/><size nuser_jnt="1"/>
<asset><texture name="sky" type="skybox" builtin="flat" width="8" height="8"/></asset>
<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="1 1 1"/>
<body name="ball" pos="1 0 0"><freejoint name="b"/><geom size="0.1"/></body>
<body name="trunk" pos="0 0 1">{free}<geom name="shell" type="box" size=".1 .1 .1"/>
<body name="l_leg" pos="0 .1 0"><joint name="l_hip" axis="0 1 0" range="-90 90"
 limited="true" user="7" ref="10"/><geom size="0.1" contype="0"/></body>
<body name="r_leg" pos="0 -.1 0"><joint name="r_hip" axis="0 1 0"
 actuatorfrcrange="-8 8" actuatorfrclimited="true"/><geom name="r_foot" size="0.1"/>
 <site name="s"/></body>
</body></worldbody>
<contact><pair geom1="floor" geom2="r_foot"/><exclude body1="l_leg" body2="r_leg"/>
</contact>
<actuator><motor joint="l_hip" gear="20" ctrlrange="-1.5 1.5" ctrllimited="true"/>
<position name="p" joint="r_hip" kp="100" forcerange="-5 5"/></actuator>
<sensor><jointpos joint="l_hip"/><framepos objtype="body" objname="ball"/>
<touch site="s"/></sensor>{more}</mujoco>"""
FREE = '<freejoint name="root"/>'


def written(tmp_path: Path, text: str, name: str = "robot.urdf") -> Path:
    """Return the path of a file with that text."""
    path = tmp_path / name
    path.write_text(text)
    return path


def read(tmp_path: Path, text: str, name: str = "robot.urdf", **options) -> ModelFile:
    """Return the robot that a text describes."""
    return read_model(written(tmp_path, text, name), **options)


@cache
def installed(name: str) -> ModelFile | None:
    """Return a robot of the registry, None if its package is not installed."""
    try:
        return read_model(name)
    except ModelError as error:
        if "not installed" not in str(error):
            raise
        return None


def robot_or_skip(name: str) -> ModelFile:
    """Return a robot of the registry, or skip the test."""
    file = installed(name)
    if file is None:
        pytest.skip(f"the package of {name} is not installed")
    return file


@pytest.fixture(autouse=True)
def quiet(tmp_path, monkeypatch):
    """Fail if something is logged into the working folder; use a cache of our own."""
    folder = tmp_path / "cwd"
    folder.mkdir()
    monkeypatch.chdir(folder)
    yield
    assert not list(folder.iterdir())


@pytest.mark.parametrize("name", URDFS)
def test_mass_and_com_equal_those_of_pinocchio(name):
    """In a random configuration, with joints set by name."""
    file = robot_or_skip(name)
    model = file.spec.compile()
    oracle = pin.buildModelFromUrdf(str(file.path), pin.JointModelFreeFlyer())
    assert (model.nq, model.nv) == (oracle.nq, oracle.nv)
    total = pin.computeTotalMass(oracle)
    assert model.body_subtreemass[1] == pytest.approx(total, abs=5e-5)

    rng, data, q = np.random.default_rng(1), mujoco.MjData(model), pin.neutral(oracle)
    for i in range(1, model.njnt):
        angle = rng.uniform(-0.5, 0.5)
        data.qpos[model.jnt_qposadr[i]] = angle
        q[oracle.joints[oracle.getJointId(model.joint(i).name)].idx_q] = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    com = pin.centerOfMass(oracle, oracle.createData(), q)
    assert data.subtree_com[1] == pytest.approx(com, abs=2e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_floats_alone_in_the_world(name):
    file = robot_or_skip(name)
    model = file.spec.compile()
    assert file.name == name
    assert model.jnt_type[0] == 0
    assert set(model.jnt_type[1:]) <= {2, 3}
    assert (model.body_parentid[1:] == 0).sum() == 1
    joints = {model.joint(i).name for i in range(1, model.njnt)}
    assert set(file.speed) | set(file.torque) <= joints
    assert {m.joint for m in file.mimics} <= joints
    assert not {m.primary for m in file.mimics} & {m.joint for m in file.mimics}
    assert all(mesh.file.is_file() for mesh in file.meshes)
    assert model.neq == model.nmesh == 0


@pytest.mark.parametrize("name", ["paper", "jvrc1", "mjlab_g1", "icub"])
def test_meshes_change_nothing_but_shapes(name, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bare = robot_or_skip(name).spec.compile()
    file = read_model(name, geometry=True)
    full = file.spec.compile()
    assert full.ngeom >= bare.ngeom + len(file.meshes)
    for field in ("body_mass", "body_inertia", "body_ipos", "body_pos", "jnt_range"):
        assert getattr(full, field) == pytest.approx(getattr(bare, field), abs=1e-12)
    assert file.notes == robot_or_skip(name).notes


def test_limits_and_mimics_are_read():
    jvrc = robot_or_skip("jvrc1")
    assert len(jvrc.mimics) == 10
    thumb = next(m for m in jvrc.mimics if m.joint == "R_LTHUMB")
    assert (thumb.primary, thumb.ratio, thumb.offset) == ("R_UTHUMB", 2.0, 0.0)
    assert jvrc.speed["R_KNEE"] > 0.0
    assert jvrc.torque["R_KNEE"] > 0.0
    paper = robot_or_skip("paper")
    assert paper.speed["l_knee_pitch"] == 9.5
    assert paper.torque["l_knee_pitch"] == 200.0


# URDF.


def test_a_urdf_is_read_in_full(tmp_path):
    shapes = "".join(
        f'<{tag}><origin xyz="0 0 0.3"/><geometry>{shape}</geometry></{tag}>'
        for tag in ("visual", "collision")
        for shape in (
            '<box size="0.2 0.4 0.6"/>',
            '<sphere radius="0.1"/>',
            '<cylinder radius="0.1" length="0.4"/>',
            '<mesh filename="package://none/x.stl"/>',
        )
    )
    text = biped(
        link("foot", shapes),
        joint("ankle", "l_leg", "foot", kind="continuous"),
        link("tool"),
        joint("slide", "foot", "tool", kind="prismatic"),
        link("tip"),
        joint("tip", "tool", "tip", kind="fixed"),
        left='<dynamics damping="0.5" friction="0.2"/>',
    )
    file = read(tmp_path, text)
    model = file.spec.compile()
    assert [model.joint(i).name for i in range(model.njnt)] == [
        *("floating_base", "l_hip", "ankle", "slide", "r_hip")
    ]
    assert model.body_subtreemass[1] == pytest.approx(12.0)
    assert model.joint("l_hip").axis == pytest.approx([0, 1, 0])
    assert model.joint("l_hip").range == pytest.approx([-1, 2])
    assert not model.joint("ankle").id or not model.jnt_limited[2]
    assert model.dof_damping[6] == 0.5
    assert model.dof_frictionloss[6] == 0.2
    assert file.torque == dict.fromkeys(("l_hip", "ankle", "slide", "r_hip"), 30.0)
    assert file.speed["slide"] == 4.0
    assert model.geom_group.tolist() == [2, 2, 2, 3, 3, 3]
    assert model.geom_contype.tolist() == [0, 0, 0, 1, 1, 1]
    assert model.geom_size[0] == pytest.approx([0.1, 0.2, 0.3])
    assert model.geom_size[2, :2] == pytest.approx([0.1, 0.2])
    assert file.notes == ("1 mesh files not found: package://none/x.stl",)


WORLD = {
    "fixed": ("fixed", True),
    "floating": ("floating", False),
    "planar": ("planar", True),
    "revolute": ("revolute", True),
}


@pytest.mark.parametrize("kind", WORLD)
def test_what_ties_a_robot_to_the_world_is_dropped(tmp_path, kind):
    tie = joint("tie", "world", "trunk", kind=kind)
    file = read(tmp_path, biped('<link name="world"/>', tie))
    model = file.spec.compile()
    assert model.body(1).name == "trunk"
    assert model.joint(0).name == ("tie" if kind == "floating" else "floating_base")
    assert model.body_pos[1] == pytest.approx([0, -0.1, -0.2])
    assert [bool(file.notes), model.nq] == [kind != "floating", 9]


def test_a_chain_of_virtual_joints_is_a_floating_base(tmp_path):
    chain = [f'<link name="v{i}"/>' for i in range(6)]
    for i in range(6):
        kind = "prismatic" if i < 3 else "continuous"
        child = f"v{i + 1}" if i < 5 else "trunk"
        chain.append(joint(f"virtual{i}", f"v{i}", child, kind=kind))
    file = read(tmp_path, biped(*chain))
    assert file.spec.compile().nq == 9
    assert '"trunk" floats' in file.notes[0]


def test_a_massless_base_link_stays(tmp_path):
    more = ['<link name="base_link"/>', joint("b", "base_link", "trunk", kind="fixed")]
    model = read(tmp_path, biped(*more)).spec.compile()
    assert [model.body(1).name, model.body(2).name] == ["base_link", "trunk"]
    assert model.body_subtreemass[1] == pytest.approx(6.0)


def test_the_heaviest_robot_in_the_world_is_read(tmp_path):
    more = ['<link name="world"/>', joint("w", "world", "trunk", kind="floating")]
    more += [link("table"), joint("t", "world", "table", kind="fixed")]
    file = read(tmp_path, biped(*more))
    assert file.spec.compile().nbody == 4
    assert "table" in file.notes[0]


def test_impossible_inertias_are_repaired_with_a_note(tmp_path):
    for broken in ('ixx="1" iyy="0.1" izz="0.1"', 'ixx="-1" iyy="1" izz="1"', ""):
        good = 'ixx="0.02" iyy="0.02" izz="0.01"'
        file = read(tmp_path, biped().replace(good, broken, 1))
        inertia = file.spec.compile().body_inertia[1]
        assert inertia.min() > 0.0
        assert inertia.sum() >= 2.0 * inertia.max() - 1e-12
        assert file.notes == ("no or impossible inertia, repaired: trunk",)


def test_a_moving_link_without_mass_gets_a_speck(tmp_path):
    more = ['<link name="m"/>', joint("j", "l_leg", "m")]
    more += ['<link name="n"/>', joint("k", "m", "n", kind="fixed")]
    file = read(tmp_path, biped(*more))
    assert file.spec.compile().body_subtreemass[1] == pytest.approx(6.0, abs=2e-6)
    assert file.notes == ("moving links without mass given 1 mg: m",)


def test_mimics_are_direct_and_their_joints_move(tmp_path):
    more = [
        link("a"),
        joint("ja", "l_leg", "a", more='<mimic joint="l_hip" offset="1"/>'),
    ]
    more += [link("b")]
    more += [
        joint("jb", "a", "b", more='<mimic joint="ja" multiplier="-2" offset="0.5"/>')
    ]
    more += [link("c"), joint("jc", "a", "c", more='<mimic joint="none"/>')]
    file = read(tmp_path, biped(*more))
    assert [(m.joint, m.primary, m.ratio, m.offset) for m in file.mimics] == [
        ("ja", "l_hip", 1.0, 1.0),
        ("jb", "l_hip", -2.0, -1.5),
    ]
    assert file.spec.compile().nv == 11
    assert "jc" in file.notes[0]


@given(st.lists(st.tuples(*[st.floats(-3, 3)] * 2), min_size=1, max_size=5))
@settings(max_examples=20)
def test_chains_of_mimics_compose(tmp_path_factory, rules):
    more, parent = [], "l_hip"
    for i, (ratio, offset) in enumerate(rules):
        text = f'<mimic joint="{parent}" multiplier="{ratio!r}" offset="{offset!r}"/>'
        more += [link(f"m{i}"), joint(f"j{i}", "l_leg", f"m{i}", more=text)]
        parent = f"j{i}"
    file = read(tmp_path_factory.mktemp("chain"), biped(*more))
    q = 0.7
    for mimic, (ratio, offset) in zip(file.mimics, rules, strict=True):
        q = ratio * q + offset
        assert mimic.ratio * 0.7 + mimic.offset == pytest.approx(q, abs=1e-9)


def test_a_locked_joint_keeps_its_angle(tmp_path):
    text = biped().replace('lower="-1" upper="2"', 'lower="0.3" upper="0.3"', 1)
    file = read(tmp_path, text)
    assert file.spec.compile().jnt_range[1] == pytest.approx([0.299, 0.301])
    assert "cannot move" in file.notes[0]


def test_a_robot_far_away_is_brought_back(tmp_path):
    tie = joint("tie", "world", "trunk", kind="floating").replace("0 -0.1", "1e6 0")
    file = read(tmp_path, biped('<link name="world"/>', tie))
    assert file.spec.compile().body_pos[1] == pytest.approx(np.zeros(3))
    assert "moved to the origin" in file.notes[0]


BROKEN_URDF = {
    "": "is empty",
    "  \n": "is empty",
    "<robot><link": "not well-formed XML: .*line 1",
    "<sdf/>": "its root is <sdf>",
    "<robot/>": "no links",
    f"<robot>{link('a')}</robot>": "no joints",
    f"<robot>{link('a')}{link('b')}</robot>": r"2 root links \(a, b\)",
    biped(link("trunk")): '2 links are named "trunk"',
    biped(link("x"), joint("l_hip", "trunk", "x")): '2 joints are named "l_hip"',
    biped(link("")): "a link has no name",
    biped(joint("j", "trunk", "gone")): 'joint "j" has child link "gone"',
    biped('<joint name="j" type="fixed"/>'): 'joint "j" has parent link ""',
    biped(
        joint("loop", "r_leg", "l_leg")
    ): '"l_hip" and "loop" both carry link "l_leg"',
    biped(joint("loop", "r_leg", "trunk")): "cut the loop",
    biped(link("a"), link("b"), joint("i", "a", "b"), joint("j", "b", "a")): "ancestor",
    biped(link("a"), joint("j", "l_leg", "a", kind="floating")): "inside the robot",
    biped(link("a"), joint("j", "l_leg", "a", kind="ball")): 'type "ball"',
    biped().replace('value="2"', 'value="-2"', 1): 'link "trunk" has mass -2 kg',
    biped().replace('value="2"', 'value="nan"', 1): 'link "trunk": <mass value="nan">',
    biped().replace('value="2"', 'value="two"', 1): "must be a finite number",
    biped().replace('value="2"', 'value="0"'): "no mass",
    biped().replace('value="2"', 'value="20000"'): "mass is 60000 kg.*grams",
    biped().replace('effort="30"', 'effort="inf"', 1): "leave it out for no limit",
    biped().replace('lower="-1"', 'lower="9"', 1): "above its upper",
    biped().replace('"0 2 0"', '"0 0 0"', 1): "axis of length zero",
    biped().replace('"0 2 0"', '"0 1"', 1): "must be 3 numbers",
    biped().replace("0 0.1 -0.2", "0 900 -0.2", 1): "m apart.*mm",
    biped(left='<mimic joint="l_hip"/>'): "in a circle",
}


@pytest.mark.parametrize("text", BROKEN_URDF)
def test_a_broken_urdf_is_named_in_one_line(tmp_path, text):
    with pytest.raises(ModelError, match=BROKEN_URDF[text]) as fault:
        read(tmp_path, text)
    assert "\n" not in str(fault.value)
    assert "robot.urdf" in str(fault.value)


@given(st.data())
@settings(max_examples=60)
def test_garbled_files_raise_nothing_but_model_errors(tmp_path_factory, data):
    good = data.draw(st.sampled_from([biped(), MJCF.format(free=FREE, more="")]))
    start = data.draw(st.integers(0, len(good)))
    length = data.draw(st.integers(0, 40))
    middle = data.draw(st.sampled_from(["", "-", "1e9", "x", '"', "<a/>", "\0"]))
    text = good[:start] + middle + good[start + length :]
    with contextlib.suppress(ModelError):
        read(tmp_path_factory.mktemp("garbled"), text, "r.xml").spec.compile()


# MJCF.


def test_a_scene_is_stripped_to_its_robot(tmp_path):
    keys = (
        '<keyframe><key name="k" qpos="9 9 9 1 0 0 0  1 2 3 1 0 0 0  4 5"/></keyframe>'
    )
    file = read(tmp_path, MJCF.format(free=FREE, more=keys), "scene.xml")
    model = file.spec.compile()
    assert [model.body(i).name for i in range(1, model.nbody)] == [
        *("trunk", "l_leg", "r_leg")
    ]
    assert (model.nlight, model.npair, model.nexclude) == (0, 0, 1)
    assert (model.nu, model.nsensor) == (2, 2)
    assert model.key_qpos.tolist() == [[1, 2, 3, 1, 0, 0, 0, 4, 5]]
    assert file.speed == {"l_hip": 7.0}
    assert file.torque == {"l_hip": 30.0, "r_hip": 5.0}
    assert model.geom_contype.tolist() == [1, 0, 1]
    assert file.notes == ()
    around = file.around.spec.compile()
    assert [around.body(i).name for i in range(around.nbody)] == ["world", "ball"]


def test_a_fixed_robot_is_set_free_with_its_keyframes(tmp_path):
    keys = (
        '<keyframe><key name="k" qpos="9 9 9 1 0 0 0 4 5" qvel="1 1 1 1 1 1 2 3" '
        'ctrl="0.1 0.2"/></keyframe>'
    )
    file = read(tmp_path, MJCF.format(free="", more=keys), "scene.xml")
    model = file.spec.compile()
    assert model.key_qpos.tolist() == [[0, 0, 1, 1, 0, 0, 0, 4, 5]]
    assert model.key_qvel.tolist() == [[0, 0, 0, 0, 0, 0, 2, 3]]
    assert model.key_ctrl.tolist() == [[0.1, 0.2]]
    assert 'free joint added to "trunk"' in file.notes[-1]


def test_sliding_bases_float(tmp_path):
    slides = '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" axis="0 1 0"/>'
    more = (
        '<actuator><motor joint="x"/></actuator><sensor><jointpos joint="y"/></sensor>'
        '<keyframe><key qpos="9 9 9 1 0 0 0  0.5 0.6  4 5"/></keyframe>'
    )
    file = read(tmp_path, MJCF.format(free=slides, more=more), "scene.xml")
    model = file.spec.compile()
    assert model.key_qpos[0].tolist() == [0, 0, 1, 1, 0, 0, 0, 4, 5]
    assert (model.nu, model.nsensor) == (2, 2)
    assert "x, y" in file.notes[-1]


def test_couplings_become_mimics(tmp_path):
    more = (
        '<equality><joint joint1="l_hip" joint2="r_hip" polycoef="0.1 2 0 0 0"/>'
        '<joint name="lock" joint1="r_hip"/></equality>'
    )
    file = read(tmp_path, MJCF.format(free=FREE, more=more), "scene.xml")
    (mimic,) = file.mimics
    assert (mimic.joint, mimic.primary, mimic.ratio) == ("l_hip", "r_hip", 2.0)
    assert mimic.offset == pytest.approx(0.1 + np.deg2rad(10.0))
    assert file.spec.compile().neq == 1
    assert "lock" in file.notes[-1]


def test_an_mjcf_far_away_is_brought_back_with_its_keyframes(tmp_path):
    keys = '<keyframe><key qpos="0 0 0 1 0 0 0  1e6 0 0 1 0 0 0  4 5"/></keyframe>'
    text = MJCF.format(free=FREE, more=keys).replace('"0 0 1"', '"1e6 0 1"')
    file = read(tmp_path, text, "scene.xml")
    model = file.spec.compile()
    assert model.key_qpos.tolist() == [[0, 0, 0, 1, 0, 0, 0, 4, 5]]
    assert model.qpos0[:3].tolist() == [0, 0, 0]


ALONE = re.sub(r'<body name="ball".*?</body>', "", MJCF.split("<sensor>")[0])
"""The robot on a floor, with nothing else around it."""
ALONE += "{more}</mujoco>"
TETRAHEDRON = (
    '<asset><mesh name="t" file="t.obj" scale="2 2 2" refpos="0.1 0 0"/>'
    '<mesh file="gone.stl"/></asset>'
)


@pytest.mark.parametrize("geometry", [False, True])
@pytest.mark.parametrize(
    "inertial", ['<inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>', ""]
)
def test_meshes_of_an_mjcf(tmp_path, geometry, inertial):
    """Without meshes a body keeps the inertia that it had from them."""
    written(
        tmp_path,
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "t.obj",
    )
    geom = (
        f'{FREE}{inertial}<geom type="mesh" mesh="t" pos="1 2 3" euler="0 0 90"/>'
        '<geom type="mesh" mesh="gone" mass="0"/>'
    )
    text = ALONE.format(free=geom, more=TETRAHEDRON)
    file = read(tmp_path, text, "scene.xml", geometry=geometry)
    model = file.spec.compile()
    assert model.nmesh == int(geometry)
    (mesh,) = file.meshes
    assert (mesh.body, mesh.collides) == ("trunk", True)
    assert mesh.rotation == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    assert mesh.position == pytest.approx([1, 2 - 0.2, 3])
    expected = 3.0 if inertial else 1000.0 * (8.0 / 6.0 + 0.008)
    assert model.body_mass[1] == pytest.approx(expected)
    assert any("gone.stl" in note for note in file.notes)


def test_meshes_that_mujoco_cannot_read_are_dropped(tmp_path):
    """They are not even opened without geometry, if they give no inertia."""
    written(tmp_path, "solid text", "t.obj")
    geom = f'{FREE}<geom type="mesh" mesh="t" mass="0"/>'
    text = ALONE.format(free=geom, more=TETRAHEDRON)
    assert not any('"t"' in note for note in read(tmp_path, text, "r.xml").notes)
    file = read(tmp_path, text, "r.xml", geometry=True)
    assert file.spec.compile().nmesh == 0
    assert any('mesh "t" dropped' in note for note in file.notes)


BROKEN_MJCF = {
    "<mujoco/>": "no bodies",
    '<mujoco><worldbody><body><freejoint/><geom size="1"/></body>'
    "</worldbody></mujoco>": "no joints",
    MJCF.format(free='<joint type="ball"/>', more="").replace(
        'name="l_hip" axis="0 1 0" range="-90 90"\n limited="true"', 'type="ball"'
    ): "unknown transmission|is a ball",
    MJCF.format(free=FREE, more="<what/>"): "not a readable MJCF",
    MJCF.format(free=FREE, more='<include file="gone.xml"/>'): "gone.xml",
    MJCF.format(free=FREE, more="").replace('size="0.1"', 'size="nan"'): (
        '<geom size="nan"> must hold finite numbers'
    ),
    MJCF.format(free=FREE, more="").replace('"0 .1 0"', '"0 inf 0"'): "finite",
    MJCF.format(free=FREE, more="").replace("r_leg", "l_leg"): "repeated name",
    MJCF.format(free=FREE, more="").replace('".1 .1 .1"', '"9 9 9"'): "grams",
    MJCF.format(free=FREE, more="").replace('"0 .1 0"', '"0 900 0"'): "mm",
    MJCF.format(free='<geom type="mesh" mesh="gone"/>', more=TETRAHEDRON): (
        "no <inertial>, and its mesh"
    ),
}


@pytest.mark.parametrize("text", BROKEN_MJCF)
def test_a_broken_mjcf_is_named_in_one_line(tmp_path, text):
    with pytest.raises(ModelError, match=BROKEN_MJCF[text]) as fault:
        read(tmp_path, text, "robot.xml")
    assert "\n" not in str(fault.value)
    assert "robot.xml" in str(fault.value)


def test_included_files_are_read_and_checked(tmp_path):
    written(
        tmp_path, "<mujocoinclude><option timestep='nan'/></mujocoinclude>", "i.xml"
    )
    text = MJCF.format(free=FREE, more='<include file="i.xml"/>')
    with pytest.raises(ModelError, match="timestep"):
        read(tmp_path, text, "robot.xml")
    written(
        tmp_path, "<mujocoinclude><option timestep='0.007'/></mujocoinclude>", "i.xml"
    )
    assert read(tmp_path, text, "robot.xml").spec.option.timestep == 0.007
    loop = '<mujocoinclude><include file="i.xml"/></mujocoinclude>'
    written(tmp_path, loop, "i.xml")
    with pytest.raises(ModelError, match="includes itself"):
        read(tmp_path, text, "robot.xml")


def test_a_model_that_attaches_itself_is_refused(tmp_path):
    """MuJoCo would follow it until it crashes."""
    more = '<asset><model name="m" file="robot.xml"/></asset>'
    with pytest.raises(ModelError, match=r"robot\.xml attaches itself"):
        read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")


SECRET = "kept for the user alone"
_TENFOLD = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 10))
HOSTILE = {
    "a bomb": (f'<!DOCTYPE r [<!ENTITY e0 "ha">{_TENFOLD}]>', "&e9;"),
    "a file in an attribute": ('<!DOCTYPE r [<!ENTITY e SYSTEM "{file}">]>', "&e;"),
    "deep elements": ("", f'"/>{"<a>" * 9999}{"</a>" * 9999}<a b="'),
}


@pytest.mark.parametrize(("head", "value"), HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("suffix", ["urdf", "xml"])
def test_hostile_files_are_refused_at_once(tmp_path, head, value, suffix):
    """In one line that shows nothing of other files."""
    secret = tmp_path / "secret"
    secret.write_text(SECRET)
    text = biped() if suffix == "urdf" else MJCF.format(free=FREE, more="")
    root = "<robot " if suffix == "urdf" else "<mujoco"
    start = text.index(">", text.index(root)) + 1
    text = f'{text[:start]}<a b="{value}"/>{text[start:]}'
    head = head.replace("{file}", secret.as_uri())
    with pytest.raises(ModelError) as caught:
        read(tmp_path, head + text, f"robot.{suffix}")
    assert "\n" not in str(caught.value)
    assert SECRET not in str(caught.value)


def test_a_chain_of_10000_links_is_refused_at_once(tmp_path):
    links = "".join(link(f"l{k}") for k in range(10001))
    joints = "".join(joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(10000))
    with pytest.raises(ModelError, match="more than 200 links hang on each other"):
        read(tmp_path, f'<robot name="chain">{links}{joints}</robot>')


# Names and paths.


def test_the_root_element_tells_the_format(tmp_path):
    assert read(tmp_path, biped(), "robot.xml").is_urdf
    assert not read(tmp_path, MJCF.format(free=FREE, more=""), "robot.urdf").is_urdf


def test_paths_that_are_no_files(tmp_path):
    with pytest.raises(ModelError, match=r"is a folder"):
        read_model(tmp_path)
    with pytest.raises(ModelError, match=r"gone\.urdf does not exist"):
        read_model("gone.urdf")
    text = "<?xml version='1.0' encoding='nothing'?><robot/>"
    with pytest.raises(ModelError, match="not readable"):
        read(tmp_path, text)


def test_an_unknown_name_is_answered_by_the_nearest(monkeypatch):
    with pytest.raises(ModelError, match='did you mean "jvrc1"'):
        read_model("jvrc")
    with pytest.raises(ModelError, match=r"known: g1, .*, talos_full; a model of your"):
        read_model("qqqqqqqqqq")


def test_a_package_that_is_missing_is_named(monkeypatch):
    monkeypatch.setattr(
        "comwalk.robot.loaders.sources.package_folders", lambda name: ()
    )
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(sys, "prefix", "/nowhere")
    for name in ("jvrc1", "talos", "mjlab_g1"):
        with pytest.raises(ModelError, match=f'"{name}".*: pip install'):
            read_model(name)


def test_collections_are_asked_and_their_failures_are_one_line(tmp_path, monkeypatch):
    path = written(tmp_path, biped())

    def fetch(name: str) -> Path:
        if name == "offline":
            raise RuntimeError("no\nnetwork")
        return path

    zoo = (("zoo", lambda: {"robot_in_zoo", "offline"}, fetch),)
    monkeypatch.setattr("comwalk.robot.loaders.sources._COLLECTIONS", zoo)
    assert read_model("robot_in_zoo").name == "robot_in_zoo"
    with pytest.raises(
        ModelError, match=r"offline.*could not be downloaded: no network"
    ):
        read_model("offline")
    with pytest.raises(ModelError, match='did you mean "robot_in_zoo"'):
        read_model("robot_in_zo")


def test_xacro_is_expanded_or_asks_for_its_package(tmp_path, monkeypatch):
    text = biped().replace(
        "<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1
    )
    text = text.replace('value="2"', 'value="${1 + 1}"')
    path = written(tmp_path, text, "robot.xacro")
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(ModelError, match=re.escape("pip install comwalk[urdf]")):
        read_model(path)
    monkeypatch.undo()
    pytest.importorskip("xacrodoc")
    assert read_model(path).spec.compile().body_subtreemass[1] == pytest.approx(6.0)


# What a file holds besides the robot.


def test_an_mjcf_may_have_any_suffix_and_come_from_a_pipe(tmp_path):
    text = MJCF.format(free=FREE, more="")
    for name in ("robot.mjcf", "ROBOT.XML", "robot.txt", "robot"):
        assert not read(tmp_path, text, name).is_urdf
    pipe, fill = os.pipe()
    os.write(fill, text.encode())
    os.close(fill)
    for _ in range(2):  # it can be read once only, and is needed more often
        assert read_model(f"/dev/fd/{pipe}").spec.compile().njnt == 3
    os.close(pipe)


def test_a_file_in_this_folder_needs_no_suffix(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, biped(), "my_biped")
    assert read_model("my_biped").is_urdf


def test_includes_resolve_as_in_mujoco(tmp_path):
    """Beside the main file first, then beside the file that includes."""
    (tmp_path / "parts").mkdir()
    written(tmp_path, '<mujoco><include file="b.xml"/></mujoco>', "parts/a.xml")
    step = "<mujoco><option timestep='{}'/></mujoco>"
    main = MJCF.format(free=FREE, more='<include file="parts/a.xml"/>')
    for place, timestep in (("parts/b.xml", 0.003), ("b.xml", 0.004)):
        written(tmp_path, step.format(timestep), place)
        file = read(tmp_path, main, "robot.xml")
        expected = mujoco.MjSpec.from_file(str(file.path)).option.timestep
        assert file.spec.option.timestep == expected == timestep


def test_what_names_parts_of_a_scene_is_dropped(tmp_path):
    more = (
        '<contact><pair geom1="ground" geom2="shell"/><exclude body1="trunk" '
        'body2="table"/><exclude body1="trunk" body2="l_leg"/></contact>'
        '<sensor><framepos objtype="site" objname="goal"/>'
        '<framepos objtype="body" objname="trunk"/></sensor>'
    )
    file = read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")
    model = file.spec.compile()
    assert (model.npair, model.nexclude, model.nsensor) == (0, 2, 3)
    told = "\n".join(file.notes)
    assert "<contact> names what another file holds, dropped: ground, table" in told
    assert "<sensor> names what another file holds, dropped: goal" in told


def test_nothing_but_the_ground_holds_the_robot(tmp_path):
    """Defaults of joints land on the base; gravcomp and a weld bear its weight."""
    more = (
        '<default><joint damping="5" armature="0.1" frictionloss="2"/></default>'
        '<equality><weld name="crane" body1="trunk"/></equality>'
    )
    text = MJCF.format(free='<joint type="free"/>', more=more)
    text = text.replace('name="trunk"', 'name="trunk" gravcomp="0.8"')
    file = read(tmp_path, text, "robot.xml")
    model = file.spec.compile()
    base = model.dof_damping[:6], model.dof_armature[:6], model.dof_frictionloss[:6]
    assert not np.any(base)
    assert model.dof_damping[6:].tolist() == [5.0, 5.0]
    assert model.body_gravcomp.max() == model.neq == 0
    told = "\n".join(file.notes)
    assert "of the floating base dropped" in told
    assert "which bears a part of the weight: trunk" in told
    assert 'constraint "crane" dropped: it ties trunk to the world' in told


def test_flags_that_disable_physics_are_dropped(tmp_path):
    """Without gravity or contacts a walk would be none."""
    off = '<flag gravity="disable" contact="disable" warmstart="disable"/>'
    more = f"<option>{off}</option>"
    file = read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")
    assert file.spec.compile().opt.disableflags == 0
    (told,) = [note for note in file.notes if "comwalk sets its own" in note]
    assert "gravity disabled" in told
    assert told.count("disabled") == 3


@pytest.mark.parametrize(
    "gravity", ["0 0 9.81", "-9.81 0 0", "0 0 0", "0.1 0 -9.81", "0 -0.1 -9.81"]
)
def test_gravity_that_is_not_straight_down_is_refused(tmp_path, gravity):
    """Nothing else in comwalk looks at its direction."""
    more = f'<option gravity="{gravity}"/>'
    with pytest.raises(ModelError, match=r"gravity is .* must be straight down"):
        read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")


def test_closed_loops_are_opened_with_a_note(tmp_path):
    loop = '<equality><connect name="rod" body1="l_leg" body2="r_leg" anchor="0 0 0"/>'
    idle = '<weld body1="l_leg" body2="r_leg" active="false"/></equality>'
    file = read(tmp_path, MJCF.format(free=FREE, more=loop + idle), "robot.xml")
    assert file.spec.compile().neq == 0
    assert 'closed loop "rod" opened' in file.notes[-1]


def test_files_that_git_did_not_fetch_are_named(tmp_path):
    with pytest.raises(ModelError, match=r"Git LFS pointer.*git lfs pull"):
        read(tmp_path, "version https://git-lfs.github.com/spec/v1\noid sha256:0\n")


def test_a_text_in_another_encoding_than_it_states_is_read(tmp_path):
    path = tmp_path / "robot.urdf"
    text = '<?xml version="1.0" encoding="utf-8"?><!-- für Füße -->' + biped()
    path.write_bytes(text.encode("cp1252"))
    assert "not UTF-8 (it has the byte fc)" in read_model(path).notes[-1]
    path.write_bytes(text.replace('"utf-8"', '"utf-16"').encode("utf-16"))
    assert not any("UTF-8" in note for note in read_model(path).notes)


def test_attributes_of_an_older_mujoco_are_left_out(tmp_path):
    more = '<option><flag sensornoise="enable" gravity="enable"/></option>'
    file = read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")
    assert file.spec.compile().njnt == 3
    assert any("<flag sensornoise> is unknown to this MuJoCo" in x for x in file.notes)
    with pytest.raises(ModelError, match="not a readable MJCF"):
        read(tmp_path, MJCF.format(free=FREE, more="<nothing/>"), "robot.xml")


def test_options_of_the_simulation_are_left_out(tmp_path):
    """Files for a GPU have a coarse solver, on which the robot would not even stand."""
    more = (
        '<option iterations="5" ls_iterations="8" cone="pyramidal" timestep="0.004" '
        'gravity="0 0 -1.62" density="1000"><flag contact="disable"/></option>'
    )
    file = read(tmp_path, MJCF.format(free=FREE, more=more), "robot.xml")
    option, usual = file.spec.option, mujoco.MjSpec().option
    assert option.iterations == usual.iterations
    assert option.ls_iterations == usual.ls_iterations
    assert option.disableflags == usual.disableflags
    assert option.density == 0.0
    assert option.gravity[2] == -1.62
    assert any("density" in x and "left out" in x for x in file.notes)


def test_limbs_that_hang_on_the_world_are_refused(tmp_path):
    """A trunk that is part of the world has no mass: the legs alone are no robot."""
    text = MJCF.format(free="", more="")
    link = '<body name="{0}_{1}"><joint name="{0}_{1}"/><geom size="0.1" mass="1"/>'
    limbs = "".join(
        "".join(link.format(name, k) for k in range(4)) + 4 * "</body>"
        for name in ("left", "right")
    )
    start, end = text.index("<worldbody>"), text.index("</worldbody>")
    text = text[:start] + f"<worldbody>{limbs}" + text[end:]
    text = re.sub(r"<(keyframe|actuator|sensor|contact)>.*?</\1>", "", text, flags=re.S)
    with pytest.raises(ModelError, match="left_0, right_0 hang on the world by hinges"):
        read(tmp_path, text, "robot.xml")
