"""Kinematics, resolution and sensing against Pinocchio and finite differences.

Pinocchio's base velocity is in body axes, linear and angular; its quaternions are
xyzw; joints are matched by name. Its MJCF reader does not know the masses of geoms,
so the inertias of the robot "paper" are those that MuJoCo compiled, on the tree that
Pinocchio read itself. JVRC-1 is read from its URDF by both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
import pinocchio as pin
import pytest
from readable import holding_forces, rotation_log
from robots import bare_urdf, jvrc, jvrc_path, paper, random_configuration, random_task

from comwalk.control.sensing import Contact, zmp_from_wrenches
from comwalk.embedding.rotations import rotate_twist, shift
from comwalk.embedding.solver import Resolver
from comwalk.embedding.task import CartesianMotion, Damping, JointMotion
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import Robot
from comwalk.run import Run, simulate

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False)
class Oracle:
    """A robot as Pinocchio has it, with the way from our coordinates to its own."""

    robot: Robot
    model: pin.Model
    q_index: np.ndarray
    v_index: np.ndarray
    frames: tuple[int, ...]

    def configuration(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration of MuJoCo's qpos."""
        result = pin.neutral(self.model)
        result[:3], result[3:7] = q[:3], q[[4, 5, 6, 3]]
        result[self.q_index] = q[7:]
        return result

    def velocity_map(self, q: np.ndarray) -> np.ndarray:
        """Return T with v_pinocchio = T v, v in world axes."""
        R_o = self.rotation(q)
        T = np.zeros((self.model.nv, self.model.nv))
        T[:3, :3] = T[3:6, 3:6] = R_o.T
        T[self.v_index, 6 + np.arange(len(self.v_index))] = 1.0
        return T

    def rotation(self, q: np.ndarray) -> np.ndarray:
        """Return the rotation of the base."""
        return pin.Quaternion(q[[4, 5, 6, 3]]).toRotationMatrix()

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the CoM Jacobian and those of all marked ends, like a `Posture`."""
        data, x = self.model.createData(), self.configuration(q)
        rows = [pin.jacobianCenterOfMass(self.model, data, x)]
        pin.computeJointJacobians(self.model, data, x)
        pin.updateFramePlacements(self.model, data)
        for frame in self.frames:
            if frame < 0:
                rows.append(np.zeros((6, self.model.nv)))
            else:
                rows.append(pin.getFrameJacobian(self.model, data, frame, ALIGNED))
        return np.vstack(rows) @ self.velocity_map(q)


def _oracle(robot: Robot, model: pin.Model) -> Oracle:
    """Match joints by name and put a frame where each limb's end site is."""
    joints = [model.getJointId(name) for name in robot.joints]
    assert all(j < model.njoints for j in joints)
    frames = []
    for site in robot.ends:
        if site < 0:
            frames.append(-1)
            continue
        body = robot.model.body(robot.model.site_bodyid[site])
        quat = robot.model.site_quat[site][[1, 2, 3, 0]]
        pose = pin.SE3(pin.Quaternion(quat), robot.model.site_pos[site])
        parent = model.getFrameId(body.name, pin.FrameType.BODY)
        assert parent < model.nframes
        joint = model.frames[parent].parentJoint
        placement = model.frames[parent].placement * pose
        name = f"end of {robot.model.site(site).name}"
        frame = pin.Frame(name, joint, parent, placement, pin.FrameType.OP_FRAME)
        frames.append(model.addFrame(frame, False))
    return Oracle(
        robot=robot,
        model=model,
        q_index=np.array([model.joints[j].idx_q for j in joints]),
        v_index=np.array([model.joints[j].idx_v for j in joints]),
        frames=tuple(frames),
    )


@cache
def paper_oracle() -> Oracle:
    """Return the robot "paper" in Pinocchio."""
    robot = paper()
    file = resources.files("comwalk") / "robots/paper.xml"
    model = pin.buildModelFromMJCF(str(file))
    model.jointPlacements[1] = pin.SE3.Identity()
    for body in range(1, robot.model.nbody):
        joint = robot.model.joint(int(robot.model.body_jntadr[body])).name
        j = 1 if body == robot.base_body else model.getJointId(joint)
        quat = robot.model.body_iquat[body][[1, 2, 3, 0]]
        R = pin.Quaternion(quat).toRotationMatrix()
        model.inertias[j] = pin.Inertia(
            float(robot.model.body_mass[body]),
            robot.model.body_ipos[body],
            R @ np.diag(robot.model.body_inertia[body]) @ R.T,
        )
    return _oracle(robot, model)


@cache
def jvrc_oracle() -> Oracle:
    """Return JVRC-1 in Pinocchio, the fingers locked at zero."""
    urdf, robot = bare_urdf(jvrc_path()), jvrc()
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    locked = [model.getJointId(name) for name in robot.anatomy.locked]
    return _oracle(robot, pin.buildReducedModel(model, locked, pin.neutral(model)))


ORACLES = {"paper": paper_oracle, "jvrc1": jvrc_oracle}


@pytest.fixture(params=ORACLES)
def oracle(request) -> Oracle:
    return ORACLES[request.param]()


def configurations(robot: Robot, count: int, seed: int) -> list[np.ndarray]:
    """Return random configurations, then one with straight legs and arms."""
    rng = np.random.default_rng(seed)
    result = [random_configuration(robot, rng) for _ in range(count)]
    straight = result[0].copy()
    straight[7:] = 0.0
    return [*result, straight]


def test_mass(oracle):
    """Both engines hold the same robot."""
    assert pin.computeTotalMass(oracle.model) == pytest.approx(
        oracle.robot.mass, abs=1e-9
    )
    assert oracle.model.nv == 6 + len(oracle.robot.joints)


def test_positions(oracle):
    """Eq. (21): the CoM and the end of every limb."""
    kinematics, data = Kinematics(oracle.robot), oracle.model.createData()
    for q in configurations(oracle.robot, 20, seed=1):
        posture = kinematics.posture(q)
        x = oracle.configuration(q)
        com = pin.centerOfMass(oracle.model, data, x)
        pin.framesForwardKinematics(oracle.model, data, x)
        assert np.abs(com - posture.com).max() < 1e-9
        assert np.abs(posture.rotation - oracle.rotation(q)).max() < 1e-12
        for i, frame in enumerate(oracle.frames):
            if frame >= 0:
                end = data.oMf[frame]
                assert np.abs(end.translation - posture.ends[i]).max() < 1e-9
                assert np.abs(end.rotation - posture.end_rotations[i]).max() < 1e-9


def test_jacobians(oracle):
    """Eqs. (14), (15), (21): CoM and end Jacobians, straight legs included."""
    kinematics = Kinematics(oracle.robot)
    for q in configurations(oracle.robot, 20, seed=2):
        J = kinematics.posture(q).jacobian
        assert np.abs(J - oracle.jacobian(q)).max() < 1e-9


def test_joint_columns_turn_with_the_body(oracle):
    """Eqs. (14), (17): J_i = X_o oJ_i, with oJ_i that of a body that is not turned."""
    kinematics = Kinematics(oracle.robot)
    for q in configurations(oracle.robot, 5, seed=10):
        level = q.copy()
        level[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        turned, o = kinematics.posture(q), kinematics.posture(level)
        R_o = turned.rotation
        X_o = rotate_twist(R_o)
        for i in range(len(oracle.robot.limbs)):
            o_J = o.end_jacobian(i)[:, 6:]
            assert np.abs(turned.end_jacobian(i)[:, 6:] - X_o @ o_J).max() < 1e-12
        o_J_c = o.com_jacobian[:, 6:]
        assert np.abs(turned.com_jacobian[:, 6:] - R_o @ o_J_c).max() < 1e-12


def test_a_posture_outlives_the_next_one(oracle):
    """A posture is a value: computing another one does not change it."""
    kinematics = Kinematics(oracle.robot)
    q_1, q_2 = configurations(oracle.robot, 2, seed=3)[:2]
    first = kinematics.posture(q_1)
    kept = [first.com, first.rotation, first.ends, first.end_rotations, first.jacobian]
    copies = [array.copy() for array in kept]
    kinematics.posture(q_2)
    assert all(np.array_equal(a, b) for a, b in zip(kept, copies, strict=True))


def test_base_columns_are_the_twist_transport(oracle):
    """Eqs. (15), (16), (21): X_i^-1 for an end, [I, -[c - r_o]x] for the CoM."""
    kinematics = Kinematics(oracle.robot)
    for q in configurations(oracle.robot, 5, seed=3):
        posture = kinematics.posture(q)
        for i, end in enumerate(oracle.robot.ends):
            if end >= 0:
                X_inv = np.linalg.inv(shift(posture.ends[i] - posture.position))
                J = posture.end_jacobian(i)
                assert np.abs(J[:, :6] - X_inv).max() < 1e-12
        X_inv = shift(posture.position - posture.com)
        assert np.abs(posture.com_jacobian[:, :6] - X_inv[:3]).max() < 1e-12


def test_jacobians_by_finite_differences(oracle):
    """Eqs. (15), (21): along random velocities in world axes."""
    kinematics, h = Kinematics(oracle.robot), 1e-5
    rng = np.random.default_rng(4)
    for q in configurations(oracle.robot, 10, seed=4):
        v = rng.normal(size=oracle.model.nv)
        moved = kinematics.posture(q).jacobian @ v
        ahead = kinematics.posture(kinematics.integrate(q, v, h))
        behind = kinematics.posture(kinematics.integrate(q, v, -h))
        com = (ahead.com - behind.com) / (2 * h)
        assert np.abs(com - moved[:3]).max() < 1e-6
        for i, end in enumerate(oracle.robot.ends):
            if end < 0:
                continue
            turn = rotation_log(ahead.end_rotations[i] @ behind.end_rotations[i].T)
            travel = ahead.ends[i] - behind.ends[i]
            twist = np.concatenate([travel, turn]) / (2 * h)
            assert np.abs(twist - moved[3 + 6 * i : 9 + 6 * i]).max() < 1e-6


def stacked(oracle: Oracle, q: np.ndarray, task) -> tuple[np.ndarray, np.ndarray]:
    """Return all rows of a task, with Pinocchio's Jacobians, for v in world axes."""
    J, nv = oracle.jacobian(q), oracle.model.nv
    rows, wishes = [J[:3], np.eye(nv)[3:6]], [task.com_velocity, task.trunk_rate]
    for i, limb in enumerate(oracle.robot.limbs):
        base = limb.name == task.base
        motion = CartesianMotion(task.base_twist) if base else task.motions[limb.name]
        if isinstance(motion, JointMotion):
            rows.append(np.eye(nv)[limb.columns])
            wishes.append(motion.rates)
        else:
            rows.append(J[3 + 6 * i : 9 + 6 * i])
            wishes.append(motion.twist)
    return np.vstack(rows), np.concatenate(wishes)


@pytest.mark.parametrize("base", ["left_leg", "right_leg"])
def test_resolution(oracle, base):
    """Eqs. (18)-(27): equal to one square system of Pinocchio's whole Jacobians."""
    rng, kinematics = np.random.default_rng(5), Kinematics(oracle.robot)
    resolver = Resolver(oracle.robot.limbs)
    for q in configurations(oracle.robot, 20, seed=5)[:-1]:
        twist = 0.3 * rng.normal(size=6)
        task = random_task(oracle.robot, rng, base=base, base_twist=twist)
        result = resolver.resolve(kinematics.posture(q), task)
        assert not result.damped
        rows, wishes = stacked(oracle, q, task)
        assert rows.shape == (oracle.model.nv, oracle.model.nv)
        assert np.abs(np.linalg.solve(rows, wishes) - result.velocity).max() < 1e-9


def test_resolution_of_redundant_limbs(oracle):
    """Eq. (19): seven-joint hands move as asked, by Pinocchio's Jacobians."""
    rng, kinematics = np.random.default_rng(6), Kinematics(oracle.robot)
    resolver = Resolver(oracle.robot.limbs, Damping(threshold=1e-3))
    hands = ("left_arm", "right_arm")
    exact = 0
    for q in configurations(oracle.robot, 20, seed=6)[:-1]:
        task = random_task(oracle.robot, rng, cartesian=hands)
        result = resolver.resolve(kinematics.posture(q), task)
        rows, wishes = stacked(oracle, q, task)
        miss = np.abs(rows @ result.velocity - wishes).max()
        assert result.loss() == pytest.approx(miss, abs=1e-9)
        exact += miss < 1e-9
    assert exact >= 5


def test_resolution_at_singular_postures(oracle):
    """Straight legs: rates stay bounded, and the reported residuals are the true."""
    rng, kinematics = np.random.default_rng(7), Kinematics(oracle.robot)
    q = configurations(oracle.robot, 1, seed=7)[-1]
    resolver = Resolver(oracle.robot.limbs)
    for _ in range(5):
        task = random_task(oracle.robot, rng)
        result = resolver.resolve(kinematics.posture(q), task)
        rows, wishes = stacked(oracle, q, task)
        reported = [result.com_residual(), result.trunk_residual()]
        reported += list(result.limb_residuals().values())
        true = wishes - rows @ result.velocity
        assert result.damped
        assert np.abs(np.concatenate(reported) - true).max() < 1e-9
        assert np.abs(result.rates).max() < 30.0


def test_holding_forces_are_the_generalised_gravity(oracle):
    """Eqs. (1)-(3): the body that accelerates as one feels gravity g - cddot."""
    rng, kinematics = np.random.default_rng(8), Kinematics(oracle.robot)
    model, data = pin.Model(oracle.model), oracle.model.createData()
    for q in configurations(oracle.robot, 10, seed=8):
        cddot = rng.normal(size=3)
        kinematics.update(q)
        forces = holding_forces(kinematics, cddot)
        gravity = oracle.robot.model.opt.gravity
        model.gravity.linear = gravity - cddot
        theirs = pin.computeGeneralizedGravity(model, data, oracle.configuration(q))
        assert np.abs(forces[6:] - theirs[oracle.v_index]).max() < 1e-9
        assert np.abs(forces[:3] - oracle.rotation(q) @ theirs[:3]).max() < 1e-9
        assert np.abs(forces[3:6] - theirs[3:6]).max() < 1e-9


def test_zmp_is_that_of_inverse_dynamics(oracle):
    """The ZMP of foot wrenches that cause a motion, and of the momentum they make."""
    rng, kinematics = np.random.default_rng(9), Kinematics(oracle.robot)
    data = oracle.model.createData()
    for q in configurations(oracle.robot, 20, seed=9):
        posture, x = kinematics.posture(q), oracle.configuration(q)
        v, a = rng.normal(size=(2, oracle.model.nv))
        base = pin.rnea(oracle.model, data, x, v, a)[:6]
        force, moment = posture.rotation @ base[:3], posture.rotation @ base[3:]
        f_left, m_left = 100.0 * rng.normal(size=(2, 3))
        f_right, lever = force - f_left, posture.ends[:2] - posture.position
        m_right = moment - m_left - np.cross(lever[0], f_left)
        m_right -= np.cross(lever[1], f_right)
        zmp = zmp_from_wrenches(
            [
                Contact(posture.ends[0].tolist(), f_left.tolist(), m_left.tolist()),
                Contact(posture.ends[1].tolist(), f_right.tolist(), m_right.tolist()),
            ]
        )
        rate = pin.computeCentroidalMomentumTimeVariation(oracle.model, data, x, v, a)
        c, weight = data.com[0], oracle.robot.mass * 9.81
        (f_x, f_y, f_z), (L_x, L_y, _) = rate.linear, rate.angular
        f_z += weight
        p = c[:2] + np.array([-c[2] * f_x - L_y, -c[2] * f_y + L_x]) / f_z
        assert zmp is not None
        assert np.abs(zmp - p).max() < 1e-9


@cache
def short_walk() -> Run:
    """Return two steps of the paper's walk on the robot "paper"."""
    return simulate(paper(), make_pattern(plan_steps(Gait(), 2), Pendulum()))


def test_sensed_zmp_is_the_centre_of_pressure():
    """Fig. 4: the ZMP of the ankle sensors against the contact forces."""
    log = short_walk().log
    error = np.hypot(*(log["zmp"] - log["zmp_true"])[1:].T)
    standing = np.isin(log["phase"][1:], [Phase.STAND, Phase.START, Phase.STOP])
    assert np.percentile(error, 50) < 0.001
    assert np.percentile(error, 99) < 0.006
    assert error[standing].max() < 0.001


def test_sensed_com_is_the_true_com():
    """Fig. 4: the CoM of the encoders over the supporting sole."""
    log = short_walk().log
    error = np.abs(log["com"] - log["com_true"])
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 0.0015
    assert error.max() < 0.006


def test_sensed_load_is_the_weight():
    """Fig. 4: both ankle sensors, with the feet below them, carry the whole robot."""
    run = short_walk()
    rows = run.log["phase"] == Phase.STAND
    weight = paper().mass * 9.81
    still = run.log["load"][rows][-50:]
    assert np.abs(still - weight).max() < 0.01 * weight
