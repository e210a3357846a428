"""What is compared: how each of them is prepared, ticks, and is read.

A candidate sets a state, updates its kinematics, sets its targets and solves. What can
be prepared before, such as a target as the candidate's own type, is not timed.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from problem import Problem

from comwalk.embedding import Resolver, resolve_by_elimination
from comwalk.robot import Kinematics

Tick = Callable[[int], np.ndarray]
"""Solve a state; returns the candidate's own answer."""
Read = Callable[[int, np.ndarray], np.ndarray]
"""Turn an answer into v = [xdot_o; qdot] [m/s, rad/s], world axes."""
OURS = "comwalk"
"""Name of what all others are compared with."""


@dataclass(frozen=True)
class Candidate:
    """One way to solve the task."""

    name: str
    """As in the tables."""
    make: Callable[[Problem], tuple[Tick, Read | None]]
    """Prepares it; a floor has no answer to read."""
    needs: tuple[str, ...] = ()
    """Modules without which it is left out."""
    settle: float | None = None
    """Largest residual allowed of what is asked for exactly [m/s, rad/s]; None where
    limits may forbid it."""

    @property
    def missing(self) -> list[str]:
        """Modules that it needs and that are not installed here."""
        return [name for name in self.needs if importlib.util.find_spec(name) is None]


def as_it_is(k: int, v: np.ndarray) -> np.ndarray:
    """Return a velocity that is in our form already."""
    return v.copy()


# ---- Ours ------------------------------------------------------------------------


def compiled(problem: Problem) -> tuple[Tick, Read]:
    """Prepare the compiled kinematics and resolution."""
    from comwalk.robot import FastResolver

    robot, rows = problem.robot, tuple(range(6))
    fast = FastResolver(robot, dict.fromkeys(problem.ends, rows))
    names = [limb.name for limb in robot.limbs]
    twists = np.zeros((len(problem), len(names), 6))
    twists[:, [names.index(name) for name in problem.ends]] = problem.twists
    states = list(zip(problem.q, problem.com_velocity, problem.trunk_rate, twists,
                      problem.rates, strict=True))  # fmt: skip

    def tick(k: int) -> np.ndarray:
        q, com, trunk, ends, rates = states[k]
        fast.com_velocity[:] = com
        fast.trunk_rate[:] = trunk
        fast.twists[:] = ends
        fast.rates[:] = rates
        return fast.resolve(q)

    return tick, as_it_is


def stacked(problem: Problem) -> tuple[Tick, Read]:
    """Prepare the resolution in numpy: one square system."""
    kinematics, resolver = Kinematics(problem.robot), Resolver(problem.robot.limbs)
    tasks = [problem.task_at(k) for k in range(len(problem))]

    def tick(k: int) -> np.ndarray:
        return resolver.resolve(kinematics.posture(problem.q[k]), tasks[k]).velocity

    return tick, as_it_is


def eliminated(problem: Problem) -> tuple[Tick, Read]:
    """Prepare the paper's own elimination, as it is written to be read."""
    kinematics, limbs = Kinematics(problem.robot), problem.robot.limbs
    tasks = [problem.task_at(k) for k in range(len(problem))]

    def tick(k: int) -> np.ndarray:
        posture = kinematics.posture(problem.q[k])
        return resolve_by_elimination(limbs, posture, tasks[k]).velocity

    return tick, as_it_is


# ---- Floors: MuJoCo's own C code, called from Python ------------------------------


def positions_alone(problem: Problem) -> tuple[Tick, None]:
    """Prepare MuJoCo's kinematics and CoM, no Jacobian and no solution."""
    model, data = problem.robot.model, mujoco.MjData(problem.robot.model)
    qpos, com = data.qpos, data.subtree_com[problem.robot.base_body]

    def tick(k: int) -> np.ndarray:
        qpos[:] = problem.q[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return com

    return tick, None


def jacobians_alone(problem: Problem) -> tuple[Tick, None]:
    """Prepare MuJoCo's kinematics and the Jacobians of the task, no solution."""
    model, data = problem.robot.model, mujoco.MjData(problem.robot.model)
    qpos, base, sites = data.qpos, problem.robot.base_body, problem.sites
    J = np.zeros((3 + 6 * len(sites), model.nv))
    rows = [(J[k : k + 3], J[k + 3 : k + 6]) for k in range(3, len(J), 6)]
    ends, J_c = list(zip(rows, sites, strict=True)), J[:3]

    def tick(k: int) -> np.ndarray:
        qpos[:] = problem.q[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSubtreeCom(model, data, J_c, base)
        for (linear, angular), site in ends:
            mujoco.mj_jacSite(model, data, linear, angular, site)
        return J

    return tick, None


# ---- The same tasks, the whole body's Jacobian at once ----------------------------


def _whole_body(problem: Problem, solve: Callable) -> tuple[Tick, Read]:
    """Prepare one least-squares problem for all unknowns, from MuJoCo's Jacobians."""
    kinematics, n = Kinematics(problem.robot), len(problem.robot.joints)
    index = {limb.name: k for k, limb in enumerate(problem.robot.limbs)}
    rows = [0, 1, 2, *(3 + 6 * index[e] + r for e in problem.ends for r in range(6))]
    picked, first = np.array(rows), len(rows)
    held, wished = problem.given, problem.wished
    weight = np.concatenate([np.ones(len(held)), np.full(len(wished), 1e-3)])
    A = np.zeros((first + 3 + len(weight), 6 + n))
    A[first + np.arange(3), 3 + np.arange(3)] = 1.0
    joints = np.concatenate([held, wished])
    A[first + 3 + np.arange(len(joints)), 6 + joints] = weight
    b = np.zeros((len(problem), len(A)))
    b[:, :3], b[:, 3:first] = problem.com_velocity, problem.twists.reshape(len(b), -1)
    b[:, first : first + 3] = problem.trunk_rate
    b[:, first + 3 :] = weight * problem.rates[:, joints]

    def tick(k: int) -> np.ndarray:
        A[:first] = kinematics.posture(problem.q[k]).jacobian[picked]
        return solve(A, b[k])

    return tick, as_it_is


def least_squares(problem: Problem) -> tuple[Tick, Read]:
    """Prepare `numpy.linalg.lstsq` (SVD)."""
    return _whole_body(problem, lambda A, b: np.linalg.lstsq(A, b, rcond=None)[0])


def normal_equations(problem: Problem) -> tuple[Tick, Read]:
    """Prepare `numpy.linalg.solve` on the normal equations."""
    return _whole_body(problem, lambda A, b: np.linalg.solve(A.T @ A, A.T @ b))


OWN = (
    Candidate(OURS, compiled, ("numba",), 1e-9),
    Candidate("comwalk, without numba", stacked, (), 1e-9),
    Candidate("comwalk, the paper's elimination", eliminated, (), 1e-9),
)
FLOORS = (
    Candidate("MuJoCo's C kinematics alone", positions_alone),
    Candidate("the same, with Jacobians", jacobians_alone),
)
PLAIN = (
    Candidate("numpy lstsq, whole body", least_squares, (), 1e-4),
    Candidate("numpy normal equations, whole body", normal_equations, (), 1e-4),
)
