"""The compiled resolution: `Resolver` and `Kinematics` in a few microseconds.

`embedding.elimination` and `embedding.solver` say what is computed and why. This is the
same on flat records, tested equal to them; it hands to them what it does not solve:
postures near a leg's singular ones, and limbs of unusual build.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import batch_kernel, kernel, parallel_range, records
from ..embedding import (
    ALL_ROWS,
    SOLVED,
    WANTED,
    CartesianMotion,
    Damping,
    Flat,
    JointMotion,
    Limb,
    Resolver,
    Task,
    check_task,
    find_levers,
    flat_at,
    integrate,
    place_links,
    resolve,
    resolve_at,
    wanted_at,
)
from ..errors import ParameterError
from ..handles import handle_of
from .compiled_robot import flatten
from .kinematics import Kinematics
from .model import LEGS, Robot


class FastResolver:
    """Resolves tasks of one robot, Eqs. (14)-(27), without making objects. Final.

    The arrays are the task: change what changes, then call `resolve`.

    Example:
        >>> from comwalk.robot import load_robot
        >>> robot = load_robot("paper")
        >>> fast = FastResolver(robot)
        >>> fast.com_velocity[:] = 0.1, 0.0, 0.0
        >>> fast.resolve(robot.home).shape
        (36,)
    """

    def __init__(
        self,
        robot: Robot,
        ends: Mapping[str, Sequence[int]] | None = None,
        damping: Damping | None = None,
    ) -> None:
        """Prepare a task of standing still.

        Args:
            robot: The robot.
            ends: Limbs whose end's twist is given, and which rows of it; both legs
                and all rows if None. The others' joint rates are given.
            damping: How singular limbs give way.

        Raises:
            ModelError: If the robot has no such limb.
        """
        self.robot = robot
        self._damping = damping or robot.damping
        self._flat, self._wanted = flatten(robot), records(WANTED)
        self._wanted["threshold"] = self._damping.threshold
        self._wanted["factor"] = self._damping.factor
        self.com_velocity = self._wanted["com"][0]
        """Wanted CoM velocity [m/s], world, (3,)."""
        self.trunk_rate = self._wanted["trunk"][0]
        """Wanted angular velocity of the body center [rad/s], world, (3,)."""
        self.twists = self._flat.limbs["twist"]
        """Wanted twists of the limbs' ends [m/s; rad/s], world, (limbs, 6)."""
        self.rates = self._flat.links["desired_rate"][1:]
        """Joint rates [rad/s], (joints,): given in joint space, and wished in the null
        space of limbs whose end is given."""
        given = ends or dict.fromkeys(LEGS.values(), ALL_ROWS)
        for i, limb in enumerate(robot.limbs):
            bits = sum(1 << row for row in given.get(limb.name, ()))
            self._flat.limbs["rows"][i] = bits
        check_task(robot.limbs, self.task)
        self.handle = handle_of(*self._flat, self._wanted)
        """The task and the robot, for kernels."""
        self._v = np.zeros(6 + len(robot.joints))
        self.solvable = can_resolve(robot, self._flat)
        """Whether the kernels can do it."""
        self.kinematics = Kinematics(robot)
        """The readable kinematics."""
        self._resolver = Resolver(robot.limbs, self._damping)

    def resolve(self, q: np.ndarray) -> np.ndarray:
        """Resolve the task at a configuration.

        Args:
            q: Configuration: base position [m], quaternion wxyz, joint angles [rad],
                contiguous floats of shape (7 + joints,).

        Returns:
            v = [xdot_o; qdot] [m/s, rad/s], world, of shape (6 + joints,); the same
            array at every call.
        """
        if not self.solvable or resolve_at(self.handle, q, self._v) != SOLVED:
            posture = self.kinematics.posture(q)
            self._v[:] = self._resolver.resolve(posture, self.task).velocity
        return self._v

    @property
    def task(self) -> Task:
        """The task that the arrays stand for, whose base limb is the left leg."""
        motions: dict[str, CartesianMotion | JointMotion] = {}
        for i, limb in enumerate(self.robot.limbs):
            bits, joints = int(self._flat.limbs["rows"][i]), list(limb.joints)
            rates = self.rates[joints].copy()
            if not bits:
                motions[limb.name] = JointMotion(rates)
                continue
            rows = tuple(row for row in ALL_ROWS if bits >> row & 1)
            wished = None if len(joints) == len(rows) == 6 else rates
            motions[limb.name] = CartesianMotion(self.twists[i].copy(), rows, wished)
        base = next(iter(LEGS.values()))
        own = motions.pop(base)
        twist = own.twist if isinstance(own, CartesianMotion) else np.zeros(6)
        com, trunk = self.com_velocity.copy(), self.trunk_rate.copy()
        return Task(com, base, twist, trunk, motions)


def can_resolve(robot: Robot, flat: Flat) -> bool:
    """Return whether the kernels can resolve a robot's tasks.

    Args:
        robot: The robot.
        flat: Its records, with the rows of all limbs set.

    Returns:
        Whether both legs have six joints, and each limb with a given end has as many
        joints as rows or more, hangs on joints whose rates are given, and has none that
        leads or follows another.
    """
    solved = [
        (limb, record)
        for limb, record in zip(robot.limbs, flat.limbs, strict=True)
        if record["rows"]
    ]
    own = {j for limb, _ in solved for j in limb.joints}
    links = flat.links
    follows = np.flatnonzero(links["leader"])
    tied = {*(follows - 1).tolist(), *(links["leader"][follows] - 1).tolist()}
    legs = [limb for limb, _ in solved if limb.name in LEGS.values()]
    return (
        len(legs) == 2
        and all(len(leg.joints) == 6 and leg.parent is None for leg in legs)
        and not own & tied
        and all(_hangs_free(limb, record, own) for limb, record in solved)
    )


def _hangs_free(limb: Limb, record: np.void, own: set[int]) -> bool:
    """Return whether a limb's end can be solved once all given rates are known."""
    carriers = record["chain"][record["own"] : record["chain_length"]] - 1
    enough = len(limb.joints) >= int(record["rows"]).bit_count()
    return bool(record["site"] >= 0 and enough and not own & {*carriers.tolist()})


_WORKERS = 16  # workspaces: more than there are cores, so that all have work to the end


class Tasks(NamedTuple):
    """Tasks of n robots; each as in `FastResolver`."""

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
            flat.links[1 + j].desired_rate = tasks.rates[k, j]
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
