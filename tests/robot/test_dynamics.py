"""Inverse dynamics: Newton and Euler, MuJoCo's inverse, Pinocchio, and statics."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import paper, random_configuration

from comwalk.robot.dynamics import InverseDynamics
from comwalk.robot.kinematics import Kinematics
from comwalk.sides import Side

seeds = st.integers(0, 2**32 - 1)


def random_motion(seed):
    """Return a configuration, a velocity and an acceleration, in world axes."""
    rng = np.random.default_rng(seed)
    q = random_configuration(paper(), rng)
    n = 6 + len(paper().joints)
    return q, rng.normal(size=n), rng.normal(size=n)


def soles(q):
    return Kinematics(paper()).posture(q).ends[:2]


@given(seed=seeds, left=st.floats(0, 1))
def test_mujocos_inverse_needs_no_force_at_the_base(seed, left):
    """With the ground's forces applied, what remains are the joint torques."""
    robot, (q, v, a) = paper(), random_motion(seed)
    load = InverseDynamics(robot).load(q, v, a, left)
    model = robot.spec.copy().compile()
    model.opt.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    data = mujoco.MjData(model)
    R = Kinematics(robot).posture(q).rotation
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    data.qvel[3:6], data.qacc[3:6] = v[3:6] @ R, a[3:6] @ R
    mujoco.mj_forward(model, data)
    data.qacc[:] = np.concatenate([a[:3], a[3:6] @ R, a[6:]])
    total = newton_euler(q, v, a)
    points = soles(q)
    between = left * points[0] + (1 - left) * points[1]
    moment = total[3:] - np.cross(between, total[:3])
    for k, share in ((0, left), (1, 1.0 - left)):
        body = model.site_bodyid[robot.feet[tuple(Side)[k]].site]
        arm = points[k] - data.xipos[body]
        force = share * total[:3]
        data.xfrc_applied[body, :3] += force
        data.xfrc_applied[body, 3:] += share * moment + np.cross(arm, force)
    mujoco.mj_inverse(model, data)
    applied = np.zeros(model.nv)
    for body in range(model.nbody):
        w = data.xfrc_applied[body]
        mujoco.mj_applyFT(model, data, w[:3], w[3:], data.xipos[body], body, applied)
    rest = data.qfrc_inverse - applied
    scale = np.abs(data.qfrc_inverse).max()
    assert np.abs(rest[:6]).max() < 1e-8 * scale
    assert rest[6:] == pytest.approx(load.torques, abs=1e-8 * scale)


def newton_euler(q, v, a, eps=1e-5):
    """Return force and moment about the origin, from momenta by finite differences."""
    robot = paper()
    kinematics, model = Kinematics(robot), robot.model

    def momenta(s):
        moved = kinematics.integrate(q, v * s + 0.5 * a * s * s, 1.0)
        data = mujoco.MjData(model)
        data.qpos[:] = moved
        mujoco.mj_kinematics(model, data)
        R = data.xmat[robot.base_body].reshape(3, 3)
        w = v + a * s
        data.qvel[:] = np.concatenate([w[:3], w[3:6] @ R, w[6:]])
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        m, c = robot.mass, data.subtree_com[robot.base_body]
        P = m * data.subtree_linvel[robot.base_body]
        return P, data.subtree_angmom[robot.base_body] + np.cross(c, P), c

    (P_1, L_1, _), (P_0, L_0, _) = momenta(eps), momenta(-eps)
    weight = np.array([0.0, 0.0, robot.mass * robot.gravity])
    com = momenta(0.0)[2]
    force = (P_1 - P_0) / (2 * eps) + weight
    return np.concatenate([force, (L_1 - L_0) / (2 * eps) + np.cross(com, weight)])


@given(seed=seeds)
def test_force_and_zmp_are_those_of_newton_and_euler(seed):
    """The moment about the ZMP has no horizontal part."""
    q, v, a = random_motion(seed)
    q[3:7] = (1.0, 0.0, 0.0, 0.0)
    v, a = 0.3 * v, 0.3 * a
    load = InverseDynamics(paper()).load(q, v, a)
    total = newton_euler(q, v, a)
    assert load.force == pytest.approx(total[:3], abs=1e-4 * np.abs(total).max())
    p = np.array([*load.zmp, soles(q)[:, 2].min()])
    moment = total[3:] - np.cross(p, total[:3])
    assert moment[:2] == pytest.approx([0, 0], abs=1e-4 * np.abs(total).max())


def test_a_standing_robot_needs_its_weight_and_its_com():
    robot = paper()
    still = np.zeros(6 + len(robot.joints))
    load = InverseDynamics(robot).load(robot.home, still, still)
    posture = Kinematics(robot).posture(robot.home)
    assert load.force == pytest.approx([0, 0, robot.mass * robot.gravity])
    assert load.zmp == pytest.approx(posture.com[:2], abs=1e-9)
    names = dict(zip(robot.joints, load.torques, strict=True))
    assert names["l_knee_pitch"] == pytest.approx(names["r_knee_pitch"])
    assert abs(names["l_ankle_roll"]) < 1.0


@pytest.mark.parametrize("left", [0.0, 0.3, 1.0])
def test_the_load_is_divided_where_the_zmp_is(left):
    """Shifted over one foot, that foot carries all."""
    robot = paper()
    dynamics = InverseDynamics(robot)
    still = np.zeros(6 + len(robot.joints))
    q = robot.home.copy()
    model_com = Kinematics(robot).posture(q).com[1]
    push = (left - 0.5) * 0.18 - model_com
    a = still.copy()
    a[1] = -robot.gravity * push / 0.687  # all bodies alike: the CoM's Eq. (2)
    free = dynamics.load(q, still, a)
    assert free.zmp[1] == pytest.approx(push, abs=1e-9)
    given_share = dynamics.load(q, still, a, left)
    assert free.torques == pytest.approx(given_share.torques, abs=1e-6)


def test_pinocchio_agrees(tmp_path):
    """Without ground, the torques are those of its recursive Newton-Euler algorithm."""
    pin = pytest.importorskip("pinocchio")
    from robots import bare_urdf, jvrc_path

    path = tmp_path / "bare.urdf"
    path.write_text(bare_urdf(jvrc_path()))
    other = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    spec = mujoco.MjSpec.from_string(path.read_text())
    spec.compiler.fusestatic = False
    spec.worldbody.first_body().add_freejoint()
    spec.worldbody.first_body().add_site(name="in_the_air")
    model = spec.compile()
    rng = np.random.default_rng(1)
    angles, v, a = rng.normal(size=(3, model.nv - 6))
    names = [model.joint(i).name for i in range(1, model.njnt)]
    order = [other.joints[other.getJointId(n)].idx_v - 6 for n in names]
    q_pin = pin.neutral(other)
    v_pin, a_pin = np.zeros((2, other.nv))
    q_pin[7 + np.array(order)] = angles
    v_pin[6 + np.array(order)], a_pin[6 + np.array(order)] = v, a
    torques = pin.rnea(other, other.createData(), q_pin, v_pin, a_pin)
    expected = torques[6 + np.array(order)]
    data = mujoco.MjData(model)
    robot = _Bare(model, len(names))
    dynamics = InverseDynamics(robot)  # type: ignore[arg-type]
    q = np.concatenate([data.qpos[:3], [1.0, 0, 0, 0], angles])
    ground = np.zeros(6)
    load = dynamics.load(q, np.concatenate([ground, v]), np.concatenate([ground, a]), 0)
    resisting = model.dof_damping[6:] * v + model.dof_frictionloss[6:] * np.sign(v)
    assert load.torques - resisting == pytest.approx(expected, abs=1e-8)


class _Bare:
    """A robot whose soles are at the base, where the ground moves no joint."""

    def __init__(self, model, joints):
        from types import SimpleNamespace

        self.model, self.base_body = model, 1
        self.joints = range(joints)
        site = model.site("in_the_air").id
        self.feet = {side: SimpleNamespace(site=site) for side in Side}
