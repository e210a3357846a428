r"""Inverse dynamics of a humanoid on its soles: joint torques and ZMP of any motion.

.. math:: \tau = M \ddot q + h(q, \dot q) - \sum_i J_i^T w_i

with the ground's wrenches w_i on the soles. Newton and Euler give their sum. On two
feet it is divided so that the pressure stays nearest the middle of both soles.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from ..embedding import CartesianMotion, JointMotion, Posture, Resolver, Task
from ..pattern import share_between
from ..sides import Side
from .kinematics import Kinematics
from .model import LEGS, Robot


class Load(NamedTuple):
    """Joint torques and ZMP of a motion at one time."""

    torques: np.ndarray
    """Torques of the servos [N m], of shape (joints,)."""
    zmp: np.ndarray
    """ZMP of the whole body at the height of the soles [m], world, of shape (2,)."""
    force: np.ndarray
    """Force of the ground on the robot [N], world, of shape (3,)."""


class InverseDynamics:
    """Computes the load of motions of one robot. Final.

    It owns the workspace (MuJoCo's `mjData`) that it computes in.
    """

    def __init__(self, robot: Robot) -> None:
        """Allocate the workspace.

        Args:
            robot: The robot.
        """
        self.robot = robot
        self._data = mujoco.MjData(robot.model)
        feet = [robot.feet[side] for side in Side]
        self._sites = np.array([foot.site for foot in feet])
        self._bodies = robot.model.site_bodyid[self._sites].tolist()
        self._forces, self._ground = np.zeros((2, robot.model.nv))

    def load(
        self,
        q: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        left_share: float | None = None,
    ) -> Load:
        """Return torques and ZMP of a motion at one time.

        Args:
            q: Configuration: base position [m], quaternion wxyz, joint angles [rad],
                of shape (7 + joints,).
            velocity: v = [xdot_o; qdot] [m/s, rad/s], world axes, (6 + joints,).
            acceleration: Its time derivative [m/s^2, rad/s^2], world axes.
            left_share: Share of the ground's force on the left foot, in [0, 1]; where
                the ZMP is between the soles if None.

        Returns:
            The load. Friction and armature of the joints are in the torques.
        """
        m, d = self.robot.model, self._data
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        R = d.xmat[self.robot.base_body].reshape(3, 3)
        v, a = velocity.copy(), acceleration.copy()
        v[3:6], a[3:6] = v[3:6] @ R, a[3:6] @ R
        d.qvel[:], d.qacc[:] = v, a
        mujoco.mj_comVel(m, d)
        mujoco.mj_rne(m, d, 1, self._forces)
        force, moment = self._forces[:3].copy(), R @ self._forces[3:6]
        zmp = self._zmp(q[:3], force, moment)
        left = self._left_share(zmp) if left_share is None else left_share
        self._stand_on(q[:3], force, moment, left)
        resisting = m.dof_damping * v + m.dof_frictionloss * np.sign(v)
        forces = self._forces + m.dof_armature * a + resisting - self._ground
        return Load(forces[6:], zmp, force)

    def _zmp(
        self, base: np.ndarray, force: np.ndarray, moment: np.ndarray
    ) -> np.ndarray:
        height = self._soles[:, 2].min()
        arm = np.array([-moment[1], moment[0]]) - (base[2] - height) * force[:2]
        return base[:2] + arm / force[2]

    def _left_share(self, zmp: np.ndarray) -> float:
        return share_between(zmp, *self._soles[:, :2])

    def _stand_on(
        self, base: np.ndarray, force: np.ndarray, moment: np.ndarray, left: float
    ) -> None:
        """Put the ground's wrench on the soles.

        Both feet get moments in the ratio of their loads, about the point between them
        that divides the load.
        """
        shares = np.array([left, 1.0 - left])
        moment = moment + np.cross(base - shares @ self._soles, force)
        self._ground[:] = 0.0
        rows = zip(self._soles, shares.tolist(), self._bodies, strict=True)
        for point, share, body in rows:
            if share > 0.0:
                m, d, w = self.robot.model, self._data, (share * force, share * moment)
                mujoco.mj_applyFT(m, d, *w, point, body, self._ground)

    @property
    def _soles(self) -> np.ndarray:
        """Middles of the soles [m], world, of shape (2, 3)."""
        return self._data.site_xpos[self._sites]


@lru_cache(maxsize=32)
def sway_inertia(robot: Robot) -> float:
    r"""Return the angular momentum that comes with a sway of the body, as a share.

    On two feet, the trunk upright, the legs turn as the CoM moves. The ZMP of such a
    motion is

    .. math:: p = c - \frac{c_z}{g} (1 + \kappa) \ddot c, \quad
        \kappa = \frac{|L|}{m c_z |\dot c|}

    so that the robot is a longer pendulum than its CoM alone, Eqs. (1), (2).

    Args:
        robot: The robot.

    Returns:
        kappa [-], the mean of a forward and a sideways sway.
    """
    kinematics = Kinematics(robot)
    posture = kinematics.posture(robot.home)
    shares = []
    for velocity, axis, sign in (((1.0, 0.0, 0.0), 1, 1.0), ((0.0, 1.0, 0.0), 0, -1.0)):
        sway = _sway(robot, posture, np.array(velocity))
        L = kinematics.angular_momentum(sway)
        shares.append(sign * L[axis] / (robot.mass * robot.com_height))
    return float(np.mean(shares))


def _sway(robot: Robot, posture: Posture, com_velocity: np.ndarray) -> np.ndarray:
    """Return v = [xdot_o; qdot] that moves the CoM over standing feet."""
    still: dict[str, CartesianMotion | JointMotion] = {
        limb.name: JointMotion(np.zeros(len(limb.joints))) for limb in robot.limbs
    }
    base = LEGS[Side.LEFT]
    del still[base]
    still[LEGS[Side.RIGHT]] = CartesianMotion(np.zeros(6))
    task = Task(com_velocity, base, np.zeros(6), np.zeros(3), still)
    return Resolver(robot.limbs, robot.damping).resolve(posture, task).velocity
