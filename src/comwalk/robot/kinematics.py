"""Kinematics of a robot by MuJoCo: frames, CoM and Jacobians at a configuration."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from ..embedding import Posture
from .loaders import rotation_of
from .model import Robot


class Kinematics:
    """Turns configurations of one robot into postures. Final.

    It owns the workspace (MuJoCo's `mjData`) that it computes in.
    """

    def __init__(self, robot: Robot, limbs: Iterable[str] | None = None) -> None:
        """Allocate the workspace.

        Args:
            robot: The robot.
            limbs: Names of the limbs whose Jacobians are wanted, which saves time;
                all if None. The others' stay zero.
        """
        self.robot = robot
        self.data = mujoco.MjData(robot.model)
        self._jacobian = np.zeros((3 + 6 * len(robot.ends), robot.model.nv))
        self._ends = np.maximum(robot.ends, 0)
        wanted = {x.name for x in robot.limbs} if limbs is None else set(limbs)
        sites = [
            (3 + 6 * i, site)
            for i, (limb, site) in enumerate(zip(robot.limbs, robot.ends, strict=True))
            if site >= 0 and limb.name in wanted
        ]
        # Views into MuJoCo's memory, made once: each access through mjData copies.
        J, d, root = self._jacobian, self.data, robot.base_body
        self._root = root
        self._end_rows = [(J[k : k + 3], J[k + 3 : k + 6], site) for k, site in sites]
        self._com_rows, self._turn_columns = J[:3], J[:, 3:6]
        self._qpos = d.qpos
        self._xpos, self._xmat = d.xpos[root], d.xmat[root].reshape(3, 3)
        self._com, self._site_xpos = d.subtree_com[root], d.site_xpos
        self._site_xmat = d.site_xmat

    def update(self, q: np.ndarray) -> None:
        """Compute positions of all bodies and the CoM, no Jacobians.

        Args:
            q: Configuration: base position [m], quaternion wxyz, joint angles [rad],
                of shape (7 + joints,).
        """
        self._qpos[:] = q
        mujoco.mj_kinematics(self.robot.model, self.data)
        mujoco.mj_comPos(self.robot.model, self.data)

    @property
    def com(self) -> np.ndarray:
        """CoM after the last `update` [m], world; a view, of shape (3,)."""
        return self._com

    def sites(self, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the poses of frames after the last `update`.

        Args:
            indices: Indices of k sites.

        Returns:
            Positions [m], world, of shape (k, 3), and rotations to world, (k, 3, 3).
        """
        rotations = self._site_xmat.take(indices, axis=0).reshape(-1, 3, 3)
        return self._site_xpos.take(indices, axis=0), rotations

    def posture(self, q: np.ndarray) -> Posture:
        """Return the posture at a configuration, with all Jacobians, Eq. (14), (21).

        Args:
            q: Configuration: base position [m], quaternion wxyz, joint angles [rad],
                of shape (7 + joints,).

        Returns:
            The posture. Ends that no site marks have a zero Jacobian.
        """
        self.update(q)
        m, d = self.robot.model, self.data
        mujoco.mj_jacSubtreeCom(m, d, self._com_rows, self._root)
        for linear, angular, site in self._end_rows:
            mujoco.mj_jacSite(m, d, linear, angular, site)
        J, R_o = self._jacobian.copy(), self._xmat.copy()
        # MuJoCo's base rates are in body axes.
        J[:, 3:6] = self._turn_columns @ R_o.T
        if self.robot.coupling is not None:
            self.robot.coupling.fold(J)
        ends, rotations = self.sites(self._ends)
        return Posture(self._xpos.copy(), R_o, self._com.copy(), ends, rotations, J)

    def integrate(
        self,
        q: np.ndarray,
        velocity: np.ndarray,
        dt: float,
        rotation: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the configuration after a velocity for a time.

        Args:
            q: Configuration, of shape (7 + joints,).
            velocity: v = [xdot_o; qdot] [m/s, rad/s], world axes.
            dt: Duration [s].
            rotation: R_o of the configuration, if it is known already, (3, 3).

        Returns:
            The new configuration, of shape (7 + joints,).
        """
        local, result = velocity.copy(), q.copy()
        if rotation is None:
            rotation = rotation_of(q[3:7])
        if self.robot.coupling is not None:
            self.robot.coupling.unfold(local)
        local[3:6] = velocity[3:6] @ rotation
        mujoco.mj_integratePos(self.robot.model, result, local, dt)
        return result

    def angular_momentum(self, velocity: np.ndarray) -> np.ndarray:
        """Return the angular momentum about the CoM.

        It belongs to the configuration of the last `update` or `posture`.

        Args:
            velocity: v = [xdot_o; qdot] [m/s, rad/s], world axes.

        Returns:
            Angular momentum [N m s], world, of shape (3,).
        """
        m, d = self.robot.model, self.data
        d.qvel[:] = velocity
        if self.robot.coupling is not None:
            self.robot.coupling.unfold(d.qvel)
        d.qvel[3:6] = velocity[3:6] @ self._xmat
        mujoco.mj_comVel(m, d)
        mujoco.mj_subtreeVel(m, d)
        return d.subtree_angmom[self._root].copy()


def carried(q: np.ndarray, place: np.ndarray, yaw: float) -> np.ndarray:
    """Return a configuration that stands at another place on the ground.

    Args:
        q: MuJoCo's qpos of a robot with a free joint.
        place: Where what was at the origin is to be [m], x and y first.
        yaw: How it is turned about the vertical [rad].
    """
    q = q.copy()
    if yaw:
        turn = np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([0.0, 0.0, 1.0]), yaw)
        mujoco.mju_rotVecQuat(q[:3], q[:3].copy(), turn)
        mujoco.mju_mulQuat(q[3:7], turn, q[3:7].copy())
    q[:2] += place[:2]
    return q
