"""Velocities, accelerations and torques on records: MuJoCo, Pinocchio, differences."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import write
from robots import random_configuration, robot_of

from comwalk.compiled import records
from comwalk.embedding.dynamics import (
    accelerate_links,
    fold_torques,
    load_links,
    move_com,
    move_links,
    move_site,
)
from comwalk.embedding.kinematic_records import ANY_AXIS, SLIDE, WANTED, Flat
from comwalk.embedding.kinematics import (
    SINGULAR,
    SOLVED,
    end_columns,
    place_links,
    resolve_limb,
)
from comwalk.embedding.task import Damping
from comwalk.robot.compiled_robot import bodies_of, flatten
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders import rotation_of
from comwalk.robot.model import LEGS, Robot, load_robot
from comwalk.robot.urdf_export import robot_urdf

ODD = """
<mujoco><worldbody><body name="base"><freejoint/>
  <geom type="ellipsoid" size=".1 .2 .3" pos=".02 .05 -.03" euler="30 20 10"/>
  <body name="arm" pos=".1 .2 .3" euler="10 20 30">
    <joint name="a" axis="0 1 0" pos=".1 0 .05" armature=".3"/>
    <joint name="b" axis="1 0 .5" pos="0 .2 0" armature=".02"/>
    <joint name="s" type="slide" axis=".3 -.2 1" armature=".7"/>
    <geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".03"/>
    <body pos="0 0 .4" euler="0 50 0">
      <geom type="ellipsoid" size=".1 .2 .3" pos="0 .1 0"/>
      <body name="tool" pos=".2 0 0">
        <joint name="c" axis="-.4 .7 .2"/><geom size=".1"/>
        <body name="tip" pos="0 .1 0">
          <joint name="d" type="slide" axis="1 0 0"/>
          <geom type="box" size=".1 .03 .05" pos=".05 .02 .01"/>
          <site name="end" pos=".1 .2 .3"/>
        </body>
      </body>
    </body>
  </body>
  <body name="tail" pos="-.3 0 0"><joint name="e" axis="0 0 -1"/>
    <geom type="box" size=".2 .05 .02" pos="-.2 0 0"/></body>
</body></worldbody></mujoco>
"""

NAMES = ("odd", "paper", "jvrc1", "talos", "g1", "romeo", "icub")
HUMANOIDS = NAMES[1:]
seeds = st.integers(0, 2**32 - 1)


@cache
def odd() -> SimpleNamespace:
    """Return no humanoid: slides, oblique axes, three joints on one body."""
    model = mujoco.MjModel.from_xml_string(ODD)
    joints = tuple(model.joint(i).name for i in range(1, model.njnt))
    return SimpleNamespace(
        name="odd",
        model=model,
        joints=joints,
        base_body=1,
        home=model.qpos0.copy(),
        mass=float(model.body_subtreemass[1]),
        gravity=9.81,
        coupling=None,
        limbs=(SimpleNamespace(name="arm", joints=range(5)),),
        ends=(model.site("end").id,),
    )


@cache
def some_robot(name: str) -> Robot:
    """Return a robot by name, or the odd one."""
    return odd() if name == "odd" else robot_of(name)  # type: ignore[return-value]


def random_motion(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a configuration, a velocity and an acceleration, followers following."""
    rng = np.random.default_rng(seed)
    q = random_configuration(robot, rng)
    v, a = rng.normal(size=(2, 6 + len(robot.joints)))
    a *= 5.0
    if robot.coupling is not None:
        robot.coupling.follow(q[7:])
        robot.coupling.unfold(v)
        robot.coupling.unfold(a)
    return q, v, a


def moved(robot: Robot, q: np.ndarray, v: np.ndarray) -> tuple[Flat, np.ndarray]:
    """Return a robot's records after `move_links`."""
    flat, bodies = flatten(robot), bodies_of(robot)
    place_links(flat.links, q)
    move_links(flat, bodies, v)
    return flat, bodies


def forces_of(
    robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: float = 9.81
) -> np.ndarray:
    """Return the generalised forces of a motion, by the kernels."""
    flat, bodies = moved(robot, q, v)
    t = np.full(len(v), np.nan)
    accelerate_links(flat, bodies, a)
    load_links(flat, bodies, a, gravity, t)
    return t


def forces_of_mujoco(
    robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> np.ndarray:
    """Return the same by MuJoCo, world axes, no torque of a follower folded."""
    m, d, t = robot.model, mujoco.MjData(robot.model), np.zeros(robot.model.nv)
    R = rotation_of(q[3:7])
    d.qpos[:], d.qvel[:], d.qacc[:] = q, v, a
    d.qvel[3:6], d.qacc[3:6] = v[3:6] @ R, a[3:6] @ R
    mujoco.mj_kinematics(m, d)
    mujoco.mj_comPos(m, d)
    mujoco.mj_comVel(m, d)
    mujoco.mj_rne(m, d, 1, t)
    t[3:6] = R @ t[3:6]
    return t + m.dof_armature * a


def difference(at, h: float = 1e-5) -> np.ndarray:
    """Return the central difference of a function of time at 0."""
    return (at(h) - at(-h)) / (2.0 * h)


# ---- Newton and Euler -------------------------------------------------------------


def test_the_robots_have_joints_of_all_kinds():
    """Otherwise tests would say nothing about some of them."""
    kinds = flatten(odd()).links["kind"][1:].tolist()  # type: ignore[arg-type]
    assert kinds.count(SLIDE) == 2
    assert kinds.count(ANY_AXIS) == 2 + 1  # "a" is turned with its body
    assert kinds.count(2) == 1


def check_forces(robot: Robot, seed: int) -> None:
    """Check forces of a random motion against MuJoCo's."""
    q, v, a = random_motion(robot, seed)
    expected = forces_of_mujoco(robot, q, v, a)
    found = forces_of(robot, q, v, a)
    assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20)
@given(seed=seeds)
def test_forces_are_those_of_mujoco(name, seed):
    """Of the base in world axes, and of all joints with their rotors."""
    check_forces(some_robot(name), seed)


@pytest.mark.parametrize("build", ["a lift", "oblique"])
def test_forces_of_other_humanoids_are_those_of_mujoco(build, tmp_path):
    """A slide in the spine; a neck that turns about an oblique axis."""
    slides = {"slide": ("waist_z",), "limits": {"waist_z": (-0.1, 0.1)}}
    path = write(tmp_path, **(slides if build == "a lift" else {}))
    text = path.read_text()
    if build == "oblique":
        head, tail = text.split('<joint name="neck_z"')
        tail = tail.replace('axis xyz="0 0 1"', 'axis xyz="0.3 -0.5 0.8"', 1)
        path.write_text(f'{head}<joint name="neck_z"{tail}')
    robot = load_robot(path)
    kind = SLIDE if build == "a lift" else ANY_AXIS
    assert (flatten(robot).links["kind"][1:] == kind).sum() == 1
    for seed in range(5):
        check_forces(robot, seed)


@pytest.mark.parametrize("name", ["paper", "jvrc1"])
def test_forces_are_those_of_pinocchio(name):
    """By its recursive Newton-Euler algorithm, base included, without rotors."""
    pin = pytest.importorskip("pinocchio")
    robot = some_robot(name)
    other = pin.buildModelFromXML(robot_urdf(robot), pin.JointModelFreeFlyer())
    there = [other.joints[other.getJointId(joint)] for joint in robot.joints]
    assert all(joint.nq == 1 for joint in there)
    places = np.array([joint.idx_v for joint in there])
    for seed in range(5):
        q, v, a = random_motion(robot, seed)
        R, x = rotation_of(q[3:7]), pin.neutral(other)
        x[:3], x[3:7], x[places + 1] = q[:3], q[[4, 5, 6, 3]], q[7:]
        w, b = np.zeros((2, other.nv))
        w[:3], w[3:6], w[places] = v[:3] @ R, v[3:6] @ R, v[6:]
        b[:3], b[3:6], b[places] = a[:3] @ R, a[3:6] @ R, a[6:]
        b[:3] -= np.cross(w[3:6], w[:3])  # the rate of what is seen from the body
        torques = pin.rnea(other, other.createData(), x, w, b)
        expected = np.concatenate([R @ torques[:3], R @ torques[3:6], torques[places]])
        found = forces_of(robot, q, v, a) - robot.model.dof_armature * a
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=10)
@given(seed=seeds)
def test_the_force_is_what_accelerates_the_com(name, seed):
    """Newton's law of the whole, with the bias of `move_com`."""
    robot = some_robot(name)
    q, v, a = random_motion(robot, seed)
    velocity, bias = np.zeros((2, 3))
    flat, bodies = moved(robot, q, v)
    move_com(flat, bodies, velocity, bias)
    acceleration = Kinematics(robot).posture(q).com_jacobian @ a + bias
    acceleration[2] += 9.81
    expected = robot.mass * acceleration
    force = forces_of(robot, q, v, a)[:3]
    assert force == pytest.approx(expected, rel=1e-9, abs=1e-9 * robot.mass)


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_that_falls_freely_needs_no_force(name):
    robot = some_robot(name)
    q, v, a = random_motion(robot, 3)
    v[:], a[:], a[2] = 0.0, 0.0, -9.81
    assert np.abs(forces_of(robot, q, v, a)).max() < 1e-11 * robot.mass


# ---- Joints that follow others ----------------------------------------------------


@cache
def following(folder) -> Robot:
    """Return a humanoid whose elbows and wrists follow its shoulders."""
    mimic = {"elbow_y": ("shoulder_y", 0.5, -0.1), "wrist_z": ("shoulder_x", -0.7, 0.1)}
    robot = load_robot(write(folder, mimic=mimic))
    assert robot.coupling is not None
    return robot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("following")


@settings(max_examples=20)
@given(seed=seeds)
def test_leaders_bear_the_torques_of_their_followers(folder, seed):
    """No power is lost: t v is the same before and after."""
    robot = following(folder)
    coupling = robot.coupling
    q, v, a = random_motion(robot, seed)
    expected, found = forces_of_mujoco(robot, q, v, a), forces_of(robot, q, v, a)
    scale = np.abs(expected).max()
    assert not found[6 + coupling.followers].any()
    assert np.abs(expected[6 + coupling.followers]).max() > 1e-4 * scale
    assert found @ v == pytest.approx(expected @ v, abs=1e-11 * scale)
    coupling.fold(expected)
    assert np.abs(found - expected).max() < 1e-11 * scale


def test_folding_torques_keeps_their_power(folder):
    """Of any torques, with rates that followers have from their leaders."""
    robot, rng = following(folder), np.random.default_rng(5)
    before, rates = rng.normal(size=(2, 6 + len(robot.joints)))
    robot.coupling.unfold(rates)
    after = before.copy()
    fold_torques(flatten(robot).links, after)
    assert after @ rates == pytest.approx(before @ rates, rel=1e-12)
    assert not after[6 + robot.coupling.followers].any()
    others = np.ones(len(before), dtype=bool)
    others[6 + robot.coupling.followers] = others[6 + robot.coupling.leaders] = False
    assert np.array_equal(after[others], before[others])


# ---- Velocities and accelerations -------------------------------------------------


def com_motion(
    robot: Robot, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and bias acceleration of the CoM, by the kernels."""
    velocity, bias = np.full((2, 3), np.nan)
    move_com(*moved(robot, q, v), velocity, bias)
    return velocity, bias


def site_motion(
    robot: Robot, q: np.ndarray, v: np.ndarray, limb: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return twist and bias acceleration of a limb's end, by the kernels."""
    twist, bias = np.full((2, 6), np.nan)
    flat, bodies = moved(robot, q, v)
    site = int(np.flatnonzero(np.array(robot.ends) >= 0).tolist().index(limb))
    move_site(flat, bodies, site, twist, bias)
    return twist, bias


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=10)
@given(seed=seeds)
def test_velocities_are_those_of_the_jacobians(name, seed):
    robot = some_robot(name)
    q, v, _ = random_motion(robot, seed)
    posture = Kinematics(robot).posture(q)
    velocity, _ = com_motion(robot, q, v)
    assert np.abs(velocity - posture.com_jacobian @ v).max() < 1e-11
    for i in [i for i, end in enumerate(robot.ends) if end >= 0]:
        twist, _ = site_motion(robot, q, v, i)
        assert np.abs(twist - posture.end_jacobian(i) @ v).max() < 1e-11


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=5)
@given(seed=seeds)
def test_biases_are_what_happens_while_velocities_are_constant(name, seed):
    """The velocities' rates as MuJoCo's Jacobians change along the motion."""
    robot = some_robot(name)
    q, v, _ = random_motion(robot, seed)
    kinematics = Kinematics(robot)

    def at(t: float) -> np.ndarray:
        posture = kinematics.posture(kinematics.integrate(q, v, t))
        ends = [posture.end_jacobian(i) @ v for i in range(len(robot.ends))]
        return np.array([*(posture.com_jacobian @ v), *np.concatenate(ends)])

    rates = difference(at)
    assert com_motion(robot, q, v)[1] == pytest.approx(rates[:3], abs=1e-6)
    for i in [i for i, end in enumerate(robot.ends) if end >= 0]:
        expected = rates[3 + 6 * i : 9 + 6 * i]
        assert np.abs(expected).max() > 1e-3
        assert site_motion(robot, q, v, i)[1] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", ["odd", "paper"])
def test_accelerations_are_the_rates_of_velocities(name):
    """Of every link, along a motion whose velocity changes."""
    robot = some_robot(name)
    q, v, a = random_motion(robot, 7)
    kinematics, fields = Kinematics(robot), ("velocity", "spin")

    def at(t: float) -> np.ndarray:
        placed = kinematics.integrate(q, v + 0.5 * t * a, t)  # to the second order
        _, bodies = moved(robot, placed, v + t * a)
        return np.hstack([bodies[field] for field in fields])

    flat, bodies = moved(robot, q, v)
    accelerate_links(flat, bodies, a)
    found = np.hstack([bodies["acceleration"], bodies["turning"]])
    assert found == pytest.approx(difference(at), abs=1e-6)


# ---- One limb alone ---------------------------------------------------------------


@pytest.mark.parametrize("name", HUMANOIDS)
@settings(max_examples=10)
@given(seed=seeds)
def test_the_rates_of_a_leg_give_its_foot_the_twist(name, seed):
    """By the readable Jacobian, whatever the body does and other joints were to do."""
    robot, rng = some_robot(name), np.random.default_rng(seed)
    q, flat, wanted = random_configuration(robot, rng), flatten(robot), records(WANTED)
    q[7:] = robot.home[7:] + 0.25 * (q[7:] - robot.home[7:])  # no straight legs
    wanted["threshold"], wanted["factor"] = Damping().threshold, Damping().factor
    flat.limbs["rows"] = 63
    flat.links["desired_rate"] = rng.normal(size=len(flat.links))
    place_links(flat.links, q)
    posture = Kinematics(robot).posture(q)
    for i, limb in enumerate(robot.limbs):
        if limb.name not in LEGS.values():
            continue
        twist, velocity, spin = rng.normal(size=6), *rng.normal(size=(2, 3))
        flat.limbs["twist"][i] = twist
        assert resolve_limb(flat, flat.limbs[i], wanted[0], velocity, spin) == SOLVED
        own = list(limb.joints)
        v = np.concatenate([velocity, spin, np.zeros(len(robot.joints))])
        v[6 + np.array(own)] = flat.links["rate"][1:][own]
        scale = max(1.0, np.abs(v).max())
        assert np.abs(posture.end_jacobian(i) @ v - twist).max() < 1e-10 * scale


def test_a_straight_leg_is_singular():
    """It says so, and no rates are made up."""
    robot, wanted = some_robot("paper"), records(WANTED)
    flat, q = flatten(robot), robot.home.copy()
    wanted["threshold"], wanted["factor"] = Damping().threshold, Damping().factor
    flat.limbs["rows"], flat.limbs["twist"] = 63, 0.1
    q[7 + robot.joints.index("l_knee_pitch")] = 0.0
    place_links(flat.links, q)
    still = np.zeros(3)
    found = [resolve_limb(flat, flat.limbs[i], wanted[0], still, still) for i in (0, 1)]
    assert found == [SINGULAR, SOLVED]


@pytest.mark.parametrize("name", HUMANOIDS)
def test_columns_of_a_limbs_end_are_its_jacobian(name):
    """Also those of joints that carry it."""
    robot = some_robot(name)
    q, _, _ = random_motion(robot, 11)
    flat, posture = flatten(robot), Kinematics(robot).posture(q)
    place_links(flat.links, q)
    for i, limb in enumerate(flat.limbs):
        end_columns(flat, limb)
        chain = limb["chain"][: limb["chain_length"]]
        expected = posture.end_jacobian(i)[:, 5 + chain]
        assert flat.links["end"][chain].T == pytest.approx(expected, abs=1e-11)
        assert limb["chain_length"] >= len(robot.limbs[i].joints)
