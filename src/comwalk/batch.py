"""The compiled resolution of thousands of robots at once, on all cores.

Postures of one robot that have nothing to do with each other, such as those of many
walks or dances: what `fast.FastResolver` does for each of them.

Only where numba is installed; see `compiled`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .act_kernels import integrate
from .compiled import batch_kernel, kernel, parallel_range
from .errors import ParameterError
from .fast import FastResolver
from .handles import flat_at, wanted_at
from .kernels import SOLVED, find_levers, place_links, resolve
from .resolution import Damping
from .robot import Robot

_WORKERS = 16  # workspaces: more than there are cores, so that all have work to the end


class Tasks(NamedTuple):
    """What is asked of n robots; each as in `FastResolver`."""

    com_velocity: np.ndarray
    """Wanted CoM velocities [m/s], world, (n, 3)."""
    trunk_rate: np.ndarray
    """Wanted angular velocities of the body centers [rad/s], world, (n, 3)."""
    twists: np.ndarray
    """Wanted twists of the limbs' ends [m/s; rad/s], world, (n, limbs, 6)."""
    rates: np.ndarray
    """Joint rates that are given, or wished in a null space [rad/s], (n, joints)."""


class BatchResolver:
    """Resolves the tasks of many postures of one robot, Eqs. (14)-(27). Final."""

    def __init__(
        self,
        robot: Robot,
        ends: Mapping[str, Sequence[int]] | None = None,
        damping: Damping | None = None,
    ) -> None:
        """Prepare workspaces.

        Args:
            robot: The robot.
            ends: Limbs whose end's twist is given, and which rows of it; both legs
                and all rows if None.
            damping: How singular limbs give way.

        Raises:
            ModelError: If the robot has no such limb.
        """
        self.robot = robot
        self._workers = [FastResolver(robot, ends, damping) for _ in range(_WORKERS)]
        self._handles = np.array([worker.handle for worker in self._workers])

    def tasks(self, n: int) -> Tasks:
        """Return the tasks of n robots that stand still, to be filled.

        Args:
            n: Number of robots.
        """
        limbs, joints = len(self.robot.limbs), len(self.robot.joints)
        shapes = ((n, 3), (n, 3), (n, limbs, 6), (n, joints))
        return Tasks(*(np.zeros(shape) for shape in shapes))

    def resolve(self, q: np.ndarray, tasks: Tasks, dt: float = 0.0) -> np.ndarray:
        """Resolve all tasks, and move all robots by what comes out.

        Args:
            q: Configurations, contiguous floats of shape (n, 7 + joints); moved on in
                place if time passes.
            tasks: What is asked of each.
            dt: Time that passes [s].

        Returns:
            v = [xdot_o; qdot] of each [m/s, rad/s], world, of shape (n, 6 + joints).

        Raises:
            ParameterError: If shapes do not fit each other.
        """
        wanted = [x.shape for x in self.tasks(len(q))]
        if q.shape[1:] != self.robot.home.shape or [x.shape for x in tasks] != wanted:
            raise ParameterError(
                f"q must be of shape (n, {len(self.robot.home)}), and tasks of shapes "
                f"{wanted}, got {q.shape} and {[x.shape for x in tasks]}"
            )
        v, status = np.zeros((len(q), q.shape[1] - 1)), np.zeros(len(q), np.int64)
        if self._workers[0].solvable:
            _resolve_many(self._handles, q, tasks, v, status, dt)
        else:
            status[:] = SOLVED + 1
        for k in np.flatnonzero(status != SOLVED):
            self._by_one(k, q, tasks, v, dt)
        return v

    def _by_one(
        self, k: int, q: np.ndarray, tasks: Tasks, v: np.ndarray, dt: float
    ) -> None:
        """Resolve the task that the kernels did not, near a singular posture."""
        worker = self._workers[0]
        worker.com_velocity[:], worker.trunk_rate[:] = tasks[0][k], tasks[1][k]
        worker.twists[:], worker.rates[:] = tasks.twists[k], tasks.rates[k]
        v[k] = worker.resolve(q[k])
        if dt:
            q[k] = worker.kinematics.integrate(q[k], v[k], dt)


@kernel
def _resolve_share(
    handle: np.ndarray,
    first: int,
    end: int,
    q: np.ndarray,
    tasks: Tasks,
    v: np.ndarray,
    status: np.ndarray,
    dt: float,
) -> None:
    """Resolve the tasks from the first on to the end in one workspace."""
    flat, wanted = flat_at(handle), wanted_at(handle)[0]
    for k in range(first, end):
        for i in range(3):
            wanted.com[i] = tasks.com_velocity[k, i]
            wanted.trunk[i] = tasks.trunk_rate[k, i]
        for i in range(len(flat.limbs)):
            for row in range(6):
                flat.limbs[i].twist[row] = tasks.twists[k, i, row]
        for j in range(len(flat.links) - 1):
            flat.links[1 + j].wish = tasks.rates[k, j]
        place_links(flat.links, q[k])
        find_levers(flat)
        status[k] = resolve(flat, wanted, v[k])
        if status[k] == SOLVED and dt != 0.0:
            integrate(flat, q[k], v[k], dt)


@batch_kernel
def _resolve_many(
    handles: np.ndarray,
    q: np.ndarray,
    tasks: Tasks,
    v: np.ndarray,
    status: np.ndarray,
    dt: float,
) -> None:
    """Resolve tasks side by side, a share of them in each workspace."""
    n, workers = len(q), len(handles)
    for k in parallel_range(workers):
        first, end = k * n // workers, (k + 1) * n // workers
        _resolve_share(handles[k], first, end, q, tasks, v, status, dt)
