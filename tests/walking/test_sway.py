"""Legs that sway make the pendulum longer: kappa, by the momenta of all links.

The poses come from Newton's method on MuJoCo's Jacobians, the momenta from differences
of the links' places; neither the resolution nor an analytic momentum takes part.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from robots import jvrc, paper

from comwalk.certificates.defaults import default_pendulum
from comwalk.pattern.pendulum import PAPER_PENDULUM, Pendulum, zmp_of_motion
from comwalk.robot.dynamics import sway_inertia
from comwalk.robot.model import Robot
from comwalk.sides import Side

ROBOTS = [paper, jvrc]


class Stander:
    """Poses of a robot on two feet where they are at home, its trunk upright."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.data = mujoco.MjData(robot.model)
        self.soles = [robot.feet[side].site for side in Side]
        self.look(robot.home)
        self.com = self.data.subtree_com[robot.base_body].copy()
        self.places = self.data.site_xpos[self.soles].copy()
        self.turns = self.data.site_xmat[self.soles].reshape(2, 3, 3).copy()
        self.height = self.com[2] - self.places[:, 2].mean()
        legs = np.concatenate([limb.joints for limb in robot.limbs[:2]])
        self.columns = np.concatenate([[0, 1, 2], 6 + legs])

    def look(self, q: np.ndarray) -> None:
        """Compute the places of all links."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def at(self, com: np.ndarray) -> np.ndarray:
        """Return the configuration with the CoM in a place, by Newton's method."""
        q, m, d = self.robot.home.copy(), self.model, self.data
        root = self.robot.base_body
        for _ in range(50):
            self.look(q)
            J, e = np.zeros((15, m.nv)), np.zeros(15)
            mujoco.mj_jacSubtreeCom(m, d, J[:3], root)
            e[:3] = com - d.subtree_com[root]
            for k, site in enumerate(self.soles):
                row = 3 + 6 * k
                mujoco.mj_jacSite(m, d, J[row : row + 3], J[row + 3 : row + 6], site)
                e[row : row + 3] = self.places[k] - d.site_xpos[site]
                e[row + 3 : row + 6] = turn(d.site_xmat[site], self.turns[k])
            if np.abs(e).max() < 1e-12:
                return q
            step = np.linalg.lstsq(J[:, self.columns], e, rcond=None)[0]
            q[:3] += step[:3]
            q[1 + self.columns[3:]] += step[3:]
        raise AssertionError(f"no pose: {np.abs(e).max()}")

    def momentum(self, before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
        """Return the angular momentum about the CoM between two poses [N m s]."""
        poses = []
        for q in (before, after):
            self.look(q)
            poses.append((self.data.xipos[1:].copy(), self.data.ximat[1:].copy()))
        (x_0, R_0), (x_1, R_1) = poses
        m, x, v = self.model.body_mass[1:, None], 0.5 * (x_0 + x_1), (x_1 - x_0) / dt
        arms, ways = (u - (m * u).sum(axis=0) / m.sum() for u in (x, v))
        L = np.cross(arms, m * ways).sum(axis=0)
        for a, b, inertia in zip(R_0, R_1, self.model.body_inertia[1:], strict=True):
            R = a.reshape(3, 3)
            L += R @ (inertia * (R.T @ turn(a, b))) / dt
        return L


def turn(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return the small rotation vector from one rotation to another."""
    E = new.reshape(3, 3) @ old.reshape(3, 3).T
    return 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])


@pytest.mark.parametrize("robot", ROBOTS)
def test_kappa_is_the_momentum_of_all_links(robot):
    stander, h = Stander(robot()), 1e-5
    shares = []
    for axis, about, sign in ((0, 1, 1.0), (1, 0, -1.0)):
        way = h * np.eye(3)[axis]
        poses = (stander.at(stander.com + s * way) for s in (-1.0, 1.0))
        L = stander.momentum(*poses, 2.0 * h)
        shares.append(sign * L[about] / (robot().mass * stander.height))
    kappa = sway_inertia(robot())
    assert kappa == pytest.approx(np.mean(shares), rel=1e-6)
    assert np.abs(np.subtract(shares, kappa)).max() < 0.1 * kappa
    assert 0.05 < kappa < 0.3


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("axis", [0, 1])
def test_the_zmp_of_a_sway_is_that_of_the_longer_pendulum(robot, axis):
    """Newton and Euler for all links, while the CoM sways by 10 mm at 0.7 Hz."""
    stander, m, g = Stander(robot()), robot().mass, robot().gravity
    omega, dt, sign = 2.0 * np.pi * 0.7, 1e-3, 1.0 - 2.0 * axis

    def sway(t: float) -> np.ndarray:
        return stander.com + 0.01 * np.sin(omega * t) * np.eye(3)[axis]

    missed = []
    for t in np.linspace(0.1, 1.3, 5):
        poses = [stander.at(sway(t + k * dt)) for k in (-1, 0, 1)]
        old, new = (stander.momentum(*poses[k : k + 2], dt) for k in (0, 1))
        twist = sign * ((new - old) / dt)[1 - axis]
        c, a = sway(t)[axis], -(omega**2) * (sway(t) - stander.com)[axis]
        p = c - (stander.height * m * a + twist) / (m * g)
        pendulums = [
            Pendulum(height=stander.height, gravity=g, inertia=kappa)
            for kappa in (sway_inertia(robot()), 0.0)
        ]
        missed.append(
            [
                abs(zmp_of_motion(x, np.array([c]), np.array([a]))[0] - p)
                for x in pendulums
            ]
        )
    long, short = np.max(missed, axis=0)
    assert long < 0.2e-3
    assert short > 1e-3
    assert short > 10.0 * long


def test_the_papers_robot_keeps_the_papers_pendulum():
    assert default_pendulum(paper()) == PAPER_PENDULUM
    assert default_pendulum(jvrc()).inertia == round(sway_inertia(jvrc()), 3)
