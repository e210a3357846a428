"""Torques do what is asked of them: on rigid ground exactly, in physics nearly."""

from __future__ import annotations

import copy
import dataclasses
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import random_configuration, robot_of

from comwalk.certificates.defaults import default_control, walk_pattern
from comwalk.config import WalkConfig
from comwalk.control.guard import WALKS, End
from comwalk.control.law import WalkingController
from comwalk.control.settings import BodySettings, SimulatorSettings
from comwalk.embedding.kinematic_records import Flat
from comwalk.embedding.kinematics import place_links
from comwalk.embedding.rotations import level_error
from comwalk.handles import handle_of
from comwalk.pattern.polygon import convex_hull, polygon_margin, rectangle
from comwalk.pattern.records import REFERENCE
from comwalk.pattern.reference import Phase, Reference, record_of
from comwalk.robot.dynamics import InverseDynamics
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders import rotation_of
from comwalk.robot.model import LEGS, Robot
from comwalk.run import prepare
from comwalk.setup import build_walk
from comwalk.sides import Side
from comwalk.walking.estimate import estimate_posture, estimate_velocity
from comwalk.walking.foot_contact import foothold
from comwalk.walking.records import Arrays
from comwalk.walking.tick import act, control, look_up, sense
from comwalk.walking.torques import (
    SOLE_SHARE,
    TRUNK_SHARE,
    bear_on_soles,
    feel_landing,
    hold_in_soles,
    limit_torques,
)
from comwalk.walking.whole_body import WholeBody
from comwalk.walking.wrench_estimate import STILL

ROBOTS = ("paper", "jvrc1", "talos", "g1", "romeo", "icub")
MOMENTS = ("stand", "shift", "left", "double", "right")
BEARS = {Phase.SINGLE_LEFT: (True, False), Phase.SINGLE_RIGHT: (False, True)}


@cache
def torque_robot(name: str, actuation: str = "pd") -> Robot:
    """Return a robot whose joints take torques; skip where it is not installed."""
    return robot_of(name, actuation=actuation)


def moments_of(pattern) -> dict[str, float]:
    """Return times of a walk's start, when little or much is asked [s]."""
    spans = [span for span in pattern.phases if span.phase is not Phase.START]
    kinds = [span.phase for span in spans[:5]]
    assert kinds[2:] == [Phase.SINGLE_LEFT, Phase.DOUBLE, Phase.SINGLE_RIGHT]
    shares = (0.5, 0.5, 0.75, 0.5, 0.75)
    times = [s.start + x * s.duration for s, x in zip(spans[:5], shares, strict=True)]
    return dict(zip(MOMENTS, times, strict=True))


@cache
def walked(
    name: str, actuation: str = "pd", turn: float | None = None
) -> dict[str, SimpleNamespace]:
    """Return what a robot with perfect sensors asks for, and its state, at moments.

    It takes itself for what it is: no weighing, whose small errors would be in the way.
    """
    robot = torque_robot(name, actuation)
    pattern = walk_pattern(robot, 2, turn=turn)
    body = BodySettings(sensors="ft", calibration=False)
    settings = dataclasses.replace(default_control(robot), body=body)
    parts = prepare(robot, pattern, control=settings)
    plant, period = parts.plant, settings.period
    law = WalkingController(settings.gains, settings.settings, period)
    reference = pattern.at(0.0)
    law.reset(reference.com, reference.zmp)
    ticker = parts.body.ticker(pattern, law)
    sensors, found = plant.start(parts.body.command), {}
    times = {round(t / period): name for name, t in moments_of(pattern).items()}
    for k in range(max(times) + 1):
        assert ticker.step(k * period, sensors) is None
        if k in times:
            assert parts.body.resolution is None
            found[times[k]] = SimpleNamespace(
                robot=robot,
                body=parts.body,
                plant=plant,
                arrays=Arrays(*(array.copy() for array in ticker.arrays)),
                qpos=plant.data.qpos.copy(),
                qvel=plant.data.qvel.copy(),
                phase=Phase(int(ticker.arrays.reference[0]["phase"])),
            )
        plant.write(ticker.command)
        sensors = plant.read()
    return found


def without_friction(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model whose joints have no friction."""
    other = copy.copy(model)
    other.dof_damping[:] = other.dof_frictionloss[:] = 0.0
    return other


def bearing(seen: SimpleNamespace) -> list[int]:
    """Return which feet bear the robot."""
    return [k for k, bears in enumerate(BEARS.get(seen.phase, (True, True))) if bears]


def asked(seen: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerations of CoM and trunk that a tick asks for."""
    trunk = seen.arrays.acceleration[3:6]
    return seen.arrays.state["com_asked"][0], trunk


def on_rigid_ground(seen: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerations of CoM and trunk if soles move as asked, exactly.

    MuJoCo's dynamics where the robot takes itself to be, and Lagrange's multipliers for
    the bearing soles: no wrench is taken from what is tested.
    """
    robot, arrays = seen.robot, seen.arrays
    m, q, v = without_friction(robot.model), arrays.q, arrays.v
    d, R = mujoco.MjData(m), rotation_of(q[3:7])
    d.qpos[:], d.qvel[:] = q, v
    d.qvel[3:6] = v[3:6] @ R
    mujoco.mj_forward(m, d)
    J = np.zeros((6 * len(bearing(seen)), m.nv))
    for rows, k in zip(np.split(J, len(J) // 6), bearing(seen), strict=True):
        site = robot.feet[tuple(Side)[k]].site
        mujoco.mj_jacSite(m, d, rows[:3], rows[3:], site)
    twists = arrays.limbs["twist"][bearing(seen)].ravel()
    M, forces = np.zeros((m.nv, m.nv)), -d.qfrc_bias
    mujoco.mj_fullM(m, d, M)
    forces[6:] += arrays.joints["torque"]
    zero = np.zeros((len(J), len(J)))
    system = np.block([[M, -J.T], [J, zero]])
    a = np.linalg.solve(system, np.concatenate([forces, twists]))[: m.nv]
    com = np.zeros((3, m.nv))
    mujoco.mj_jacSubtreeCom(m, d, com, robot.base_body)
    return com @ a + arrays.state["com_bias"][0], R @ a[3:6]


def in_physics(
    seen: SimpleNamespace, torques: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the accelerations of CoM and trunk in the scene, where the robot is."""
    robot, m = seen.robot, copy.copy(seen.plant.model)
    d, driving = mujoco.MjData(m), robot.servo.actuators
    d.qpos[:], d.qvel[:] = seen.qpos, seen.qvel
    k_p, k_d = robot.servos
    m.actuator_gainprm[driving, 0] = 1.0
    m.actuator_biasprm[driving, 1:3] = -np.transpose([k_p, k_d])
    m.actuator_ctrllimited[driving] = 0
    d.ctrl[driving] = torques + k_p * d.qpos[7:] + k_d * d.qvel[6:]
    mujoco.mj_forward(m, d)
    assert d.actuator_force[driving] == pytest.approx(torques, abs=1e-9)
    mujoco.mj_rnePostConstraint(m, d)
    force = d.cfrc_ext[:, 3:].sum(axis=0)
    turning = d.xmat[robot.base_body].reshape(3, 3) @ d.qacc[3:6]
    return force / robot.mass - [0.0, 0.0, robot.gravity], turning


# ---- What the torques do ----------------------------------------------------------


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("name", ROBOTS)
def test_on_rigid_ground_torques_move_the_robot_as_asked(name, moment):
    """CoM and trunk, by torques without friction, in joints without; on two feet but
    for the moment of the soles' uneven heights."""
    seen = walked(name)[moment]
    state = seen.arrays.state[0]
    assert state["shifted"] < 1e-12
    assert state["slid"] == state["weak"] == 0
    com, trunk = on_rigid_ground(seen)
    com_asked, trunk_asked = asked(seen)
    exact = len(bearing(seen)) == 1
    assert com == pytest.approx(com_asked, abs=1e-10 if exact else 5e-6)
    assert trunk == pytest.approx(trunk_asked, abs=1e-10 if exact else 5e-4)


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("name", ROBOTS)
def test_in_physics_torques_move_the_robot_nearly_as_asked(name, moment):
    """Within 0.2 % of g, and the trunk 0.1 rad/s^2, with the friction of the model."""
    seen = walked(name)[moment]
    com, trunk = in_physics(seen, seen.arrays.torques)
    com_asked, trunk_asked = asked(seen)
    assert com == pytest.approx(com_asked, abs=0.02)
    assert trunk == pytest.approx(trunk_asked, abs=0.1)


def test_what_is_asked_is_not_rest():
    """Otherwise standing still would pass: tolerances are small against it."""
    seen = walked("paper")
    for moment in ("left", "right"):
        assert np.abs(asked(seen[moment])[0][:2]).max() > 0.3
    wrong = -seen["left"].arrays.torques
    assert np.abs(in_physics(seen["left"], wrong)[0] - asked(seen["left"])[0])[2] > 3.0


@pytest.mark.parametrize("moment", ["left", "double"])
def test_without_gains_torques_do_the_same(moment):
    seen = walked("paper", "torque")[moment]
    for found, wanted in zip(on_rigid_ground(seen), asked(seen), strict=True):
        assert found == pytest.approx(wanted, abs=1e-3)
    assert not any(gain.any() for gain in seen.body.servos)


@pytest.mark.parametrize("moment", MOMENTS)
def test_friction_that_is_known_is_fed_forward(moment):
    """At the rate that is asked of each joint."""
    arrays = walked("paper")[moment].arrays
    model, rates = torque_robot("paper").model, arrays.speeds
    dry = model.dof_frictionloss[6:] * np.tanh(rates / STILL)
    friction = model.dof_damping[6:] * rates + dry
    assert arrays.torques - arrays.joints["torque"] == pytest.approx(friction)
    assert np.abs(friction).max() > 0.1 or moment in ("stand", "shift")


# ---- What is asked ----------------------------------------------------------------


@pytest.mark.parametrize("moment", MOMENTS)
def test_the_com_is_asked_to_follow_the_law(moment):
    """A velocity servo, whose ZMP is inside the soles, and a spring upwards."""
    arrays = walked("paper")[moment].arrays
    state, reference = arrays.state[0], arrays.reference[0]
    robot, defaults = torque_robot("paper"), BodySettings()
    omega, speed = np.sqrt(robot.gravity / robot.com_height), state["com_velocity"]
    k_v, W = omega * defaults.com_servo, omega * defaults.bandwidth
    error = arrays.law_state["u"][0] - speed[:2]
    expected = reference["com_acceleration"][:2] + k_v * error - state["drag"][:2]
    lift = W**2 * (reference["com"][2] - state["com"][2]) - 2.0 * W * speed[2]
    assert state["com_asked"] == pytest.approx([*expected, lift], abs=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_trunk_is_asked_back_to_its_heading(name):
    """Critically damped, at a share of the bandwidth."""
    for moment in MOMENTS:
        arrays = walked(name)[moment].arrays
        reference = arrays.reference[0]
        W = TRUNK_SHARE * arrays.rules["bandwidth"][0]
        away = level_error(reference["heading"], rotation_of(arrays.q[3:7]))
        rate = np.array([0.0, 0.0, reference["heading_rate"]]) - arrays.v[3:6]
        expected = W**2 * away + 2.0 * W * rate
        assert asked(walked(name)[moment])[1] == pytest.approx(expected, abs=1e-9)


def foot_motion(
    seen: SimpleNamespace, k: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pose error, twist and asked acceleration of foot k, (6,) each.

    The acceleration is that of all joints by MuJoCo's Jacobian, and what that does as
    it changes along the motion.
    """
    arrays, kinematics, h = seen.arrays, Kinematics(seen.robot), 1e-5
    q, v, foot = arrays.q, arrays.v, arrays.reference[0]["feet"][k]
    x, y, yaw = foothold(arrays.state[0], arrays.reference[0], k)
    height = foot["position"][2] + arrays.state[0]["heights"][1 - k]
    posture = kinematics.posture(q)
    J, R = posture.end_jacobian(k), posture.end_rotations[k]
    around = [
        kinematics.posture(kinematics.integrate(q, v, t)).end_jacobian(k)
        for t in (-h, h)
    ]
    bias = (around[1] - around[0]) @ v / (2.0 * h)
    away = [x, y, height] - posture.ends[k]
    error = np.concatenate([away, level_error(yaw, R)])
    return error, J @ v, J @ arrays.acceleration[: len(v)] + bias


@pytest.mark.parametrize("turn", [None, -0.3])
@pytest.mark.parametrize("moment", ["left", "double", "right"])
def test_feet_are_asked_to_rest_or_to_follow_their_paths(moment, turn):
    """Critically damped, with the path's own acceleration."""
    seen = walked("paper", "pd", turn)[moment]
    W = seen.arrays.rules["bandwidth"][0]
    for k in range(2):
        error, twist, found = foot_motion(seen, k)
        if k in bearing(seen):
            assert found == pytest.approx(-W * twist, abs=1e-6)
            continue
        foot = seen.arrays.reference[0]["feet"][k]
        rates = np.array([*foot["velocity"], 0.0, 0.0, foot["yaw_rate"]])
        bends = np.array([*foot["acceleration"], 0.0, 0.0, foot["yaw_acceleration"]])
        expected = bends + W**2 * error + 2.0 * W * (rates - twist)
        assert found == pytest.approx(expected, abs=1e-6)
        assert np.abs(bends[:3]).max() > 0.1
        assert (abs(bends[5]) > 0.1) == (turn is not None)


def pushed(seen: SimpleNamespace, push: tuple[float, float], ticks: int = 1) -> Arrays:
    """Return the arrays after more ticks, whose law says more by a push [m/s].

    What is estimated stays as it was, but for the ZMP of the links' turning.
    """
    arrays = Arrays(*(array.copy() for array in seen.arrays))
    handle, state = handle_of(*arrays), arrays.state.copy()
    for _ in range(ticks):
        stray = arrays.state["stray"].copy()
        arrays.state[:] = state
        arrays.state["stray"] = stray
        look_up(handle, float(arrays.reference["time"][0]))
        assert sense(handle) == WALKS
        control(handle)
        arrays.law_state["u"][0] += push
        assert act(handle) == WALKS
    return arrays


@pytest.mark.parametrize("name", ["paper", "talos"])
@pytest.mark.parametrize("moment", ["left", "double", "right"])
@pytest.mark.parametrize("push", [(9.0, 0.0), (-9.0, 2.0), (0.0, 9.0), (3.0, -9.0)])
def test_the_zmp_asked_for_stays_in_the_soles(name, moment, push):
    """Whatever the law says: that of all links, by another inverse dynamics."""
    seen, zmps = walked(name)[moment], []
    for u in ((0.0, 0.0), push):
        arrays = pushed(seen, u, ticks=100)
        zmps.append((zmp_of(seen.robot, arrays), arrays.state[0]["shifted"]))
    (before, still), (after, shifted) = zmps
    hull = hull_of(seen, SOLE_SHARE)
    assert polygon_margin(hull, before) > 0.004
    assert abs(polygon_margin(hull, after)) < 1e-3  # at an edge
    assert (after - before) @ push < -0.01  # the ZMP goes back to push the CoM ahead
    assert still < 1e-12
    assert shifted > 0.5


def zmp_of(robot: Robot, arrays: Arrays) -> np.ndarray:
    """Return the ZMP of all links [m] that go with the accelerations."""
    a = arrays.acceleration[: len(arrays.v)]
    return InverseDynamics(robot).load(arrays.q, arrays.v, a).zmp


def hull_of(seen: SimpleNamespace, share: float = 1.0) -> np.ndarray:
    """Return the hull of the bearing soles, a share of their size, where they are."""
    robot, kinematics = seen.robot, Kinematics(seen.robot)
    kinematics.update(seen.arrays.q)
    sites = np.array([robot.feet[side].site for side in Side])
    points, _ = kinematics.sites(sites)
    yaws = seen.arrays.reference[0]["feet"]["yaw"]
    sizes = 2.0 * share * seen.arrays.rules[0]["sole_half"]
    corners = [rectangle(*points[k][:2], yaws[k], tuple(sizes[k])) for k in (0, 1)]
    return convex_hull(np.vstack([corners[k] for k in bearing(seen)]))


# ---- The wrench and the limits ----------------------------------------------------


def borne(seen: SimpleNamespace, **changes) -> SimpleNamespace:
    """Return what `bear_on_soles` says of a tick's motion, with changed records.

    Args:
        seen: The tick.
        changes: Fields of rules and state, `most` of the joints, and `t`.
    """
    arrays = Arrays(*(array.copy() for array in seen.arrays))
    t = changes.pop("t", arrays.acceleration[len(arrays.v) :]).copy()
    most = changes.pop("most", arrays.joints["most"])
    arrays.joints["most"], arrays.joints["torque"] = most, np.nan
    for name, value in changes.items():
        (arrays.rules if name in arrays.rules.dtype.names else arrays.state)[name] = (
            value
        )
    flat = Flat(arrays.links, arrays.limbs, arrays.sites)
    records = arrays.rules[0], arrays.state[0], arrays.reference[0]
    bear_on_soles(flat, *records, t, arrays.joints)
    return SimpleNamespace(t=t, arrays=arrays, torques=arrays.joints["torque"].copy())


def wrenches_of(seen: SimpleNamespace, found: SimpleNamespace) -> np.ndarray:
    """Return the wrenches that torques put on both soles, about their centres, (2, 6).

    A leg's six joints tell its sole's wrench by the inverse of its Jacobian.
    """
    posture = Kinematics(seen.robot).posture(seen.arrays.q)
    wrenches, rest = np.zeros((2, 6)), found.t[6:] - found.torques
    for k, limb in enumerate(seen.robot.limbs[:2]):
        assert limb.name in LEGS.values()
        own = list(limb.joints)
        J = posture.end_jacobian(k)[:, 6 + np.array(own)]
        wrenches[k] = np.linalg.solve(J.T, rest[own])
    return wrenches


def total(seen: SimpleNamespace, wrenches: np.ndarray) -> np.ndarray:
    """Return the sum of both wrenches about the body center."""
    posture = Kinematics(seen.robot).posture(seen.arrays.q)
    arms = posture.ends[:2] - seen.arrays.q[:3]
    moments = wrenches[:, 3:] + np.cross(arms, wrenches[:, :3])
    return np.concatenate([wrenches[:, :3].sum(axis=0), moments.sum(axis=0)])


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_soles_bear_what_moves_the_body(name, moment):
    """Their wrenches' sum; a foot in the air bears nothing; no sole tips."""
    seen = walked(name)[moment]
    found = borne(seen)
    assert np.array_equal(found.torques, seen.arrays.joints["torque"])
    wrenches = wrenches_of(seen, found)
    scale, whole = seen.robot.mass * seen.robot.gravity, total(seen, wrenches)
    exact = len(bearing(seen)) == 1
    assert whole[:3] == pytest.approx(found.t[:3], abs=1e-12 * scale)
    assert whole[3:] == pytest.approx(found.t[3:6], abs=1e-9 if exact else 5e-4)
    half = seen.arrays.rules[0]["sole_half"]
    for k in range(2):
        if k not in bearing(seen):
            assert np.abs(wrenches[k]).max() < 1e-9 * scale
            continue
        f, n = wrenches[k, :3], wrenches[k, 3:]
        assert f[2] > 0.05 * scale
        assert abs(n[1]) <= SOLE_SHARE * half[k][0] * f[2]
        assert abs(n[0]) <= SOLE_SHARE * half[k][1] * f[2]


def test_on_two_feet_the_load_is_where_the_zmp_is():
    """Both soles press alike from their centres, by shares of the load."""
    seen = walked("paper")["double"]
    wrenches = wrenches_of(seen, borne(seen))
    loads = wrenches[:, 2]
    pressed = np.column_stack([-wrenches[:, 4], wrenches[:, 3]]) / loads[:, None]
    assert pressed[0] == pytest.approx(pressed[1], abs=1e-9)
    points = Kinematics(seen.robot).posture(seen.arrays.q).ends[:2, :2]
    zmp = loads @ (points + pressed) / loads.sum()
    assert zmp == pytest.approx(zmp_of(seen.robot, seen.arrays), abs=1e-4)
    assert 0.05 < loads[0] / loads.sum() < 0.95


@pytest.mark.parametrize("moment", ["left", "double"])
@pytest.mark.parametrize("grip", [0.5, 0.05, 0.0])
def test_the_force_is_limited_to_friction(moment, grip):
    """The direction stays; what was given up is reported."""
    seen = walked("paper")[moment]
    weight = seen.robot.mass * seen.robot.gravity
    t = seen.arrays.acceleration[len(seen.arrays.v) :].copy()
    t[:2] = 0.12 * weight, -0.05 * weight
    t[3:5] += (seen.arrays.q[2] * t[1], -seen.arrays.q[2] * t[0])  # the same ZMP
    found = borne(seen, t=t, grip=grip)
    force = total(seen, wrenches_of(seen, found))[:3]
    slip, most = np.hypot(*t[:2]), grip * t[2]
    assert force[2] == pytest.approx(t[2])
    assert np.hypot(*force[:2]) == pytest.approx(min(slip, most), abs=1e-9 * weight)
    assert force[:2] == pytest.approx(t[:2] * min(1.0, most / slip), abs=1e-9 * weight)
    slid = found.arrays.state["slid"][0]
    assert slid == pytest.approx(max(slip - most, 0.0), abs=1e-9 * weight)
    assert (slid > 0.0) == (grip < 0.1)


def test_the_ground_does_not_pull():
    """A motion that would need it, as a fall does, gets a newton."""
    seen = walked("paper")["left"]
    t = seen.arrays.acceleration[len(seen.arrays.v) :].copy()
    t[:3] = 0.0, 0.0, -50.0
    force = total(seen, wrenches_of(seen, borne(seen, t=t)))[:3]
    assert force == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize("moment", ["left", "double"])
@pytest.mark.parametrize("heading", [0.0, 0.6, -2.0])
def test_the_load_that_was_weighed_is_borne(moment, heading):
    """So much more weight, and its shift in the axes of the heading."""
    seen = walked("paper")[moment]
    arrays = seen.arrays
    reference = arrays.reference.copy()
    arrays = arrays._replace(reference=reference)
    reference["heading"] = heading
    turned = SimpleNamespace(**{**vars(seen), "arrays": arrays})
    plain = total(turned, wrenches_of(turned, borne(turned)))
    lean, ratio = np.array([0.004, -0.006]), 1.1
    loaded = borne(turned, mass_ratio=ratio, lean=lean)
    assert loaded.arrays.state["shifted"][0] < 1e-12
    found = total(turned, wrenches_of(turned, loaded))
    c, s = np.cos(heading), np.sin(heading)
    shift = np.array([[c, -s], [s, c]]) @ lean
    expected, load = ratio * plain, ratio * plain[2]
    expected[3:5] += load * np.array([shift[1], -shift[0]])
    assert found[:5] == pytest.approx(expected[:5], abs=0.02)


def test_torques_stay_within_their_limits():
    """With the friction that is known; those at their limits are counted."""
    seen = walked("paper")["left"]
    joints, speeds = (
        seen.arrays.joints.copy(),
        np.linspace(-1.0, 1.0, len(seen.robot.joints)),
    )
    joints["viscous"], joints["dry"] = 2.0, 0.5
    free = joints["torque"] + 2.0 * speeds + 0.5 * np.tanh(speeds / STILL)
    weak = np.argsort(np.abs(free))[-3:]
    joints["most"] = np.inf
    joints["most"][weak] = 0.6 * np.abs(free[weak])
    state, found = seen.arrays.state.copy(), np.zeros(len(free))
    limit_torques(state[0], joints, speeds, found)
    assert state["weak"][0] == 3
    assert found[weak] == pytest.approx(0.6 * free[weak])
    others = np.setdiff1d(np.arange(len(free)), weak)
    assert found[others] == pytest.approx(free[others])
    assert np.abs(seen.arrays.torques).max() < seen.robot.torque.max()


@pytest.mark.parametrize("moment", ["left", "right", "double"])
def test_gains_leave_the_legs_that_bear_alone(moment):
    """Their set-points are where they are; a swinging foot's lead to its foothold."""
    seen = walked("paper")[moment]
    arrays, robot = seen.arrays, seen.robot
    q, kinematics = arrays.q.copy(), Kinematics(seen.robot)
    for k, limb in enumerate(robot.limbs[:2]):
        own = list(limb.joints)
        if k in bearing(seen):
            assert np.array_equal(arrays.set_points[own], q[7:][own])
            a = arrays.acceleration[6 : len(arrays.v)]
            ahead = arrays.v[6:] + seen.body.period * a
            assert arrays.speeds[own] == pytest.approx(ahead[own], abs=1e-12)
            continue
        q[7:][own] = arrays.set_points[own]
        foot = arrays.reference[0]["feet"][k]
        place = foot["position"] + [*arrays.state[0]["offsets"][k][:2], 0.0]
        place[2] += arrays.state[0]["heights"][1 - k]
        before = kinematics.posture(arrays.q).ends[k] - place
        after = kinematics.posture(q).ends[k] - place
        assert np.linalg.norm(after) < 0.02 * np.linalg.norm(before) + 1e-6
        posture = kinematics.posture(arrays.q)
        v = np.concatenate([arrays.v[:6], np.zeros(len(robot.joints))])
        v[6:][own] = arrays.speeds[own]
        twist = [*foot["velocity"], 0.0, 0.0, foot["yaw_rate"]]
        assert posture.end_jacobian(k) @ v == pytest.approx(twist, abs=1e-9)


# ---- The support ------------------------------------------------------------------


@cache
def standing() -> WholeBody:
    return WholeBody(torque_robot("paper"), 0.002)


def held(reference: Reference, point: np.ndarray) -> tuple[float, ...]:
    """Return what `hold_in_soles` makes of a point, both feet at their places."""
    arrays, record = standing().arrays, np.zeros(1, REFERENCE)[0]
    flat = Flat(arrays.links, arrays.limbs, arrays.sites)
    record_of(reference, record)
    for k, foot in enumerate((reference.left, reference.right)):
        site = arrays.sites[arrays.limbs[k]["site"]]
        link = arrays.links[site["link"]]
        link["R"], link["p"] = np.eye(3), foot.position - site["point"]
    return hold_in_soles(flat, arrays.rules[0], record, *point.tolist())


@cache
def references() -> tuple[Reference, ...]:
    """Return the middle of each phase of a walk ahead, and of one in a curve."""
    robot = torque_robot("paper")
    patterns = walk_pattern(robot, 3), walk_pattern(robot, 3, turn=0.3, speed=0.1)
    return tuple(
        pattern.at(span.start + 0.5 * span.duration)
        for pattern in patterns
        for span in pattern.phases
    )


def bearing_soles(reference: Reference, share: float) -> np.ndarray:
    """Return the hull of the bearing soles, a share of their size."""
    left, right = BEARS.get(reference.phase, (True, True))
    length, width = torque_robot("paper").sole_size
    feet = [reference.left] * left + [reference.right] * right
    size = share * length, share * width
    soles = [rectangle(*foot.position[:2], foot.yaw, size) for foot in feet]
    return convex_hull(np.vstack(soles))


places = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).map(np.array)
moments = st.integers(0, 1000)


@settings(max_examples=300)
@given(place=places, moment=moments)
def test_a_point_is_held_inside_the_soles(place, moment):
    """Both soles make it: the left one's share, and the same way from both centres."""
    reference = references()[moment % len(references())]
    middle = bearing_soles(reference, 1.0).mean(axis=0)
    x, y, share, r_x, r_y = held(reference, middle + place)
    assert polygon_margin(bearing_soles(reference, 1.0), (x, y)) > 0.0
    left, right = reference.left.position[:2], reference.right.position[:2]
    made = share * left + (1.0 - share) * right + [r_x, r_y]
    assert [x, y] == pytest.approx(made, abs=1e-12)
    assert 0.0 <= share <= 1.0
    if reference.phase in BEARS:
        assert share == (1.0 if reference.phase is Phase.SINGLE_LEFT else 0.0)
    foot = reference.left if share >= 0.5 else reference.right
    c, s = np.cos(foot.yaw), np.sin(foot.yaw)
    half = 0.5 * SOLE_SHARE * np.array(torque_robot("paper").sole_size)
    along = np.array([[c, s], [-s, c]]) @ [r_x, r_y]
    assert (np.abs(along) <= half + 1e-12).all()


@settings(max_examples=200)
@given(place=places, moment=moments)
def test_on_one_foot_it_is_the_nearest_point_of_the_sole(place, moment):
    """The point itself, if it is inside."""
    single = [r for r in references() if r.phase in BEARS]
    reference = single[moment % len(single)]
    hull = bearing_soles(reference, SOLE_SHARE)
    point = hull.mean(axis=0) + place
    x, y, *_ = held(reference, point)
    outside = max(0.0, -polygon_margin(hull, point))
    assert np.hypot(x - point[0], y - point[1]) == pytest.approx(outside, abs=1e-12)
    assert polygon_margin(hull, (x, y)) > -1e-12


@given(along=st.floats(0.0, 1.0), across=st.floats(-1.0, 1.0), moment=moments)
def test_on_two_feet_points_beside_the_line_between_them_stay(along, across, moment):
    """Where the ZMP of a walk is: on the line, or across it within a sole."""
    double = [r for r in references() if r.phase not in BEARS]
    reference = double[moment % len(double)]
    left, right = reference.left.position[:2], reference.right.position[:2]
    way = left - right
    normal = np.array([-way[1], way[0]]) / np.hypot(*way)
    half = 0.5 * SOLE_SHARE * min(torque_robot("paper").sole_size)
    point = right + along * way + 0.99 * across * half * normal
    x, y, share, *_ = held(reference, point)
    assert [x, y] == pytest.approx(point, abs=1e-12)
    assert share == pytest.approx(along, abs=1e-9)


@settings(max_examples=300)
@given(place=places, moment=moments)
def test_a_point_inside_two_soles_that_are_parallel_stays(place, moment):
    """Between feet of which one is ahead, too."""
    references_ = [
        r
        for r in references()
        if r.phase not in BEARS and abs(r.left.yaw - r.right.yaw) < 1e-9
    ]
    reference = references_[moment % len(references_)]
    hull = bearing_soles(reference, SOLE_SHARE)
    point = hull.mean(axis=0) + 0.5 * place
    if polygon_margin(hull, point) > 0.0:
        x, y, *_ = held(reference, point)
        assert [x, y] == pytest.approx(point, abs=1e-9)


@given(place=places)
def test_on_feet_abreast_it_is_the_nearest_point(place):
    reference = references()[0]
    assert reference.phase is Phase.STAND
    hull = bearing_soles(reference, SOLE_SHARE)
    x, y, *_ = held(reference, place)
    outside = max(0.0, -polygon_margin(hull, place))
    assert np.hypot(x - place[0], y - place[1]) == pytest.approx(outside, abs=1e-12)


# ---- Landings ---------------------------------------------------------------------


def landings(
    shares: list[float], *, speed: float = -0.1, sensors: str = "ft"
) -> list[bool]:
    """Return when the right foot is felt to land, that swings with a load in each tick.

    Args:
        shares: Of the weight on it, tick by tick.
        speed: How fast it rises [m/s].
        sensors: How the ground is felt.
    """
    settings = BodySettings(sensors=sensors)
    body = WholeBody(torque_robot("paper"), 0.002, settings=settings)
    rules, state, reference = (
        x[0] for x in (body.arrays.rules, body.arrays.state, body.arrays.reference)
    )
    reference["phase"] = int(Phase.SINGLE_LEFT)
    reference["feet"]["velocity"][1, 2] = speed
    state["load"], found = rules["weight"], []
    for share in shares:
        state["left_share"] = 1.0 - share
        feel_landing(rules, state, reference)
        assert state["landed"][0]
        found.append(bool(state["landed"][1]))
    return found


def test_a_sinking_foot_lands_when_it_bears():
    """Within hundredths of a second, and for as long as it does."""
    found = landings([0.3] * 20 + [0.08] * 60 + [0.0] * 60)
    first = found.index(True)
    assert 1 < first < 10
    assert all(found[first:80])
    assert not any(found[120:])


@pytest.mark.parametrize(
    ("shares", "given"),
    [
        ([0.0, 0.8] + [0.0] * 20, {}),
        ([0.08] * 60, {}),
        ([0.5] * 60, {"speed": 0.1}),
        ([0.5] * 60, {"sensors": "none"}),
    ],
    ids=["a spike", "its own weight", "it rises", "nothing is felt"],
)
def test_a_foot_does_not_land_for(shares, given):
    assert not any(landings(shares, **given))


# ---- The state that torques need --------------------------------------------------


def standing_on(
    robot: Robot, k: int, place: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return a random configuration whose sole k is at x, y, z and yaw, tilted."""
    q = random_configuration(robot, rng)
    q[3:7] = [1.0, *(0.05 * rng.normal(size=3))]
    kinematics = Kinematics(robot)
    R = kinematics.posture(q).end_rotations[k]
    away = place[3] - np.arctan2(R[1, 0], R[0, 0])
    turn, turned = np.array([np.cos(away / 2), 0.0, 0.0, np.sin(away / 2)]), np.empty(4)
    mujoco.mju_mulQuat(turned, turn, q[3:7] / np.linalg.norm(q[3:7]))
    q[3:7] = turned
    q[:3] += place[:3] - kinematics.posture(q).ends[k]
    return q


def readings(robot: Robot, q: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return encoders, at the origin, and the IMU's quaternion, its yaw off by some."""
    kinematics, quat, turned = Kinematics(robot), np.empty(4), np.empty(4)
    kinematics.update(q)
    mujoco.mju_mat2Quat(quat, kinematics.data.site_xmat[robot.imu_site])
    turn = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    mujoco.mju_mulQuat(turned, turn, quat)
    return np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], q[7:]]), turned


def assert_same_pose(found: np.ndarray, expected: np.ndarray) -> None:
    """Check two configurations; a quaternion's sign does not matter."""
    sign = np.sign(found[3:7] @ expected[3:7])
    assert found[:3] == pytest.approx(expected[:3], abs=1e-10)
    assert sign * found[3:7] == pytest.approx(expected[3:7], abs=1e-10)
    assert np.array_equal(found[7:], expected[7:])


@pytest.mark.parametrize("name", ["paper", "jvrc1", "talos", "g1"])
@pytest.mark.parametrize("k", [0, 1], ids=["left", "right"])
def test_the_posture_is_known_from_the_sole_that_stands(name, k):
    """And from the IMU's tilt, whatever its yaw; then from the other sole alike."""
    body, rng = WholeBody(torque_robot(name), 0.002), np.random.default_rng(k)
    arrays, flat = body.arrays, Flat(*body.arrays[:3])
    state, reference = arrays.state[0], arrays.reference[0]
    reference["support"] = state["support"] = k
    foot = reference["feet"][k]
    foot["position"], foot["yaw"] = (*rng.normal(size=2), 0.0), rng.normal()
    away = state["offsets"][k] = 0.05 * rng.normal(size=3)
    place = np.array([*(foot["position"][:2] + away[:2]), 0.0, foot["yaw"] + away[2]])
    q = standing_on(body.robot, k, place, rng)
    found = np.zeros_like(q)
    given = flat, arrays.rules[0], state
    sensed, imu = readings(body.robot, q, 0.7)
    estimate_posture(*given, sensed, imu, reference, found)
    assert_same_pose(found, q)
    reference["support"] = 1 - k
    found[:] = 0.0
    estimate_posture(*given, sensed, imu, reference, found)
    assert_same_pose(found, q)
    assert state["support"] == 1 - k
    other = Kinematics(body.robot).posture(q).ends[1 - k]
    assert state["heights"][1 - k] == pytest.approx(other[2])
    x, y, _ = foothold(state, reference, 1 - k)
    assert [x, y] == pytest.approx(other[:2], abs=1e-10)


@pytest.mark.parametrize("name", ["paper", "jvrc1", "talos", "g1"])
@pytest.mark.parametrize("k", [0, 1], ids=["left", "right"])
def test_the_velocity_is_known_from_the_sole_that_rests(name, k):
    """The gyro may be beyond joints of the torso, which turn too."""
    robot, rng = torque_robot(name), np.random.default_rng(10 + k)
    body = WholeBody(robot, 0.002)
    arrays, flat = body.arrays, Flat(*body.arrays[:3])
    arrays.state["support"] = k
    q, v = random_configuration(robot, rng), rng.normal(size=6 + len(robot.joints))
    kinematics = Kinematics(robot)
    J = kinematics.posture(q).end_jacobian(k)[:3]
    v[:3] -= J @ v
    turns = np.zeros((3, robot.model.nv))
    mujoco.mj_jacSite(robot.model, kinematics.data, None, turns, robot.imu_site)
    turns[:, 3:6] = turns[:, 3:6] @ rotation_of(q[3:7]).T
    axes = kinematics.data.site_xmat[robot.imu_site].reshape(3, 3)
    gyro = axes.T @ turns @ v
    place_links(flat.links, q)
    found = np.zeros_like(v)
    estimate_velocity(flat, arrays.bodies, arrays.state[0], gyro, v[6:], found)
    assert found == pytest.approx(v, abs=1e-10)
    spin = arrays.bodies["spin"][flat.sites["link"][flat.limbs["site"][k]]]
    expected = kinematics.posture(q).end_jacobian(k)[3:] @ v
    assert spin == pytest.approx(expected, abs=1e-10)


def test_a_gyro_is_beyond_joints_of_the_torso():
    """In one robot at least, so that the test above says something about them."""
    links = [WholeBody(torque_robot(n), 0.002).arrays.sites["link"][4] for n in ROBOTS]
    assert max(links) > 0


# ---- Walks ------------------------------------------------------------------------


@pytest.mark.parametrize("actuation", ["pd", "torque"])
@pytest.mark.parametrize("sensors", ["ft", "torque"])
def test_a_robot_with_flaws_walks_by_torques(actuation, sensors):
    """With noise, late readings and commands, and friction that nobody knows of."""
    physics = SimulatorSettings(
        noise=1.0, latency=0.002, command_delay=0.002, joint_friction=0.5
    )
    config = WalkConfig(
        robot="paper", steps=6, actuation=actuation, sensors=sensors, simulator=physics
    )
    run = build_walk(config).run()
    assert run.outcome.end is End.COMPLETED
    figures = run.summary()
    assert figures["steps_completed"] == 6
    assert max(figures["com_error_rms_mm"]["true"].values()) < 8.0
    limit = torque_robot("paper").torque
    assert (np.abs(run.log["torques_true"]) <= limit + 1e-9).all()


def test_a_load_is_learnt_from_the_ground_while_walking():
    """Torques at rest leave doubt, which the law alone would double, to 12 mm."""
    torque_robot("talos")
    physics = SimulatorSettings(noise=1.0, joint_friction=0.5, payload=0.1)
    config = WalkConfig(robot="talos", steps=12, actuation="pd", simulator=physics)
    run = build_walk(config).run()
    assert run.outcome.end is End.COMPLETED
    error = run.log["com_true"][:, :2] - run.log["com_ref"][:, :2]
    late = np.nanmean(error[len(error) // 2 :], axis=0)
    assert np.abs(late) == pytest.approx([0.0, 0.0], abs=4e-3)


def test_a_joint_at_its_limit_stops_there():
    """The foot is lifted less, which is logged, and the robot walks on."""
    torque_robot("talos")
    setup = build_walk(WalkConfig(robot="talos", steps=3, actuation="pd", force=True))
    assert setup.robot is not None
    knee = setup.robot.joints.index("leg_left_4_joint")
    free = setup.run()
    upper = setup.robot.upper.copy()
    upper[knee] = free.log["qpos"][:, 7 + knee].max() - 0.05
    robot = dataclasses.replace(setup.robot, upper=upper)
    held = dataclasses.replace(setup, robot=robot).run()
    assert held.outcome.end is End.COMPLETED
    assert held.log["qpos"][:, 7 + knee].max() < upper[knee] + 1e-3
    assert not np.any(free.log["limited"])
    assert np.any(held.log["limited"])
    assert np.nanmax(held.log["loss"]) > 0.1
