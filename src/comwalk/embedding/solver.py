"""The fast resolution: Eqs. (14)-(27) as one stacked system, within joint limits.

It is tested equal to `elimination.resolve_by_elimination` wherever that applies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs

from .elimination import damped_inverse, resolve_by_elimination, sigma_min
from .task import (
    CartesianMotion,
    Damping,
    JointMotion,
    Limb,
    Posture,
    Resolution,
    Task,
    check_limbs,
    check_task,
    motion_of,
)

_gesv = get_lapack_funcs("gesv", dtype=np.float64)


@cache
def bounded_solver() -> Any:
    """Return scipy's bounded least squares, imported once.

    That takes tens of milliseconds, so call this before a loop that must keep time: it
    is needed where a limb is singular or a joint at its limit.

    Returns:
        `scipy.optimize.lsq_linear`.
    """
    from scipy.optimize import lsq_linear

    return lsq_linear


@dataclass(frozen=True, slots=True, eq=False)
class RateLimits:
    """Bounds of the joint rates at one posture."""

    lower: np.ndarray
    """Smallest rates [rad/s], <= 0, of shape (joints,)."""
    upper: np.ndarray
    """Largest rates [rad/s], >= 0, of shape (joints,)."""


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """Rows and columns of the stacked system, for one kind of task."""

    rows: np.ndarray
    """Rows of `Posture.jacobian`: the CoM's, then the Cartesian limbs'."""
    span: slice | None
    """The same rows as a slice, where they are neighbours."""
    free: np.ndarray
    """Unknown columns of v: r_o', then the Cartesian limbs' joints."""
    known: np.ndarray
    """Known columns of v: omega_o, then the joint-space limbs' joints."""
    cartesian: tuple[tuple[Limb, slice, slice], ...]
    """Each Cartesian limb, its rows in the stack and its columns among the free."""
    joint_space: tuple[tuple[Limb, slice], ...]
    """Each joint-space limb and its place among the known."""
    legs: tuple[tuple[slice, slice], ...]
    """Rows and columns of each square limb's own block of the unknowns."""
    square: bool
    """Whether every Cartesian limb has six joints and six rows."""
    solvable: bool
    """Whether the base limb has six joints, so that the system can be made square."""
    weights: np.ndarray
    """Weight of each row, then of the trunk's three, in the bounded problem."""

    def pick(self, J: np.ndarray) -> np.ndarray:
        """Return the rows that count of a posture's Jacobian."""
        return J[self.rows] if self.span is None else J[self.span]


class Resolver:
    """Resolves tasks for one set of limbs by one square stacked system. Final.

    The body's angular velocity and the joint-space limbs are known, so they move to
    the right side; what is left is [r_o'; qdot of the Cartesian limbs], with one row
    for each: the CoM's three, and each Cartesian limb's. Equal to
    `resolve_by_elimination` wherever no leg is near a singular posture.
    """

    def __init__(self, limbs: Sequence[Limb], damping: Damping | None = None) -> None:
        """Check the limbs.

        Args:
            limbs: The robot's limbs, parents before children, in the order of
                `Posture.ends`.
            damping: How singular limbs give way.

        Raises:
            ModelError: If the limbs do not form a tree.
        """
        check_limbs(limbs)
        self.limbs = tuple(limbs)
        self.damping = damping or Damping()
        self._seen: tuple[_Layout | None, np.ndarray, float] = None, np.zeros(0), 0.0
        self._layouts: dict[tuple, _Layout] = {}

    def resolve(self, posture: Posture, task: Task) -> Resolution:
        """Resolve a task, Eqs. (15), (21), without regard to joint limits.

        Args:
            posture: Kinematics at the present configuration.
            task: What is asked.

        Returns:
            The rates, with their residuals.

        Raises:
            ModelError: If the task names a limb that does not exist, or leaves one
                out.
        """
        layout = self._layout(task)
        if not layout.solvable:
            return resolve_by_elimination(self.limbs, posture, task, self.damping)
        S = layout.pick(posture.jacobian)
        A = S.take(layout.free, axis=1)
        lam2 = self._damping_of(A, layout)
        if lam2 > 0.0:
            return self._give_way(posture, task, self._unlimited(S), lam2)
        v = np.zeros(S.shape[1])
        v[layout.known] = self._known_rates(task, layout)
        b = self._wishes(task, layout) - S @ v
        if not layout.square:
            A, b = self._squared(task, layout, A, b)
        _, _, v[layout.free], singular = _gesv(A, b)
        if singular:
            lam2 = self.damping.squared(0.0)
            return self._give_way(posture, task, self._unlimited(S), lam2)
        return Resolution(v, posture, task, self.limbs)

    def _unlimited(self, S: np.ndarray) -> RateLimits:
        far = np.full(S.shape[1] - 6, np.inf)
        return RateLimits(-far, far)

    def resolve_within(
        self, posture: Posture, task: Task, limits: RateLimits
    ) -> Resolution:
        """Resolve a task within joint limits; residuals show the loss.

        When the exact rates would pass a limit, the bounded weighted least-squares
        rates are taken instead, in the order of `Damping`.

        Args:
            posture: Kinematics at the present configuration.
            task: What is asked.
            limits: Bounds of the joint rates.

        Returns:
            The rates, the joints held at a limit, and the residuals.
        """
        exact = self.resolve(posture, task)
        rates = exact.velocity[6:]
        over = np.count_nonzero(rates > limits.upper)
        if not over and not np.count_nonzero(rates < limits.lower):
            return exact
        layout = self._layout(task)
        A = layout.pick(posture.jacobian).take(layout.free, axis=1)
        lam2 = self._damping_of(A, layout)
        return self._give_way(posture, task, limits, lam2)

    def _give_way(
        self, posture: Posture, task: Task, limits: RateLimits, lam2: float
    ) -> Resolution:
        """Return the bounded, damped, weighted least-squares resolution."""
        layout = self._layout(task)
        S, w = layout.pick(posture.jacobian), self._wishes(task, layout)
        held, turning = layout.known[3:], layout.known[:3]
        free = np.concatenate([turning, layout.free])
        v = np.zeros(S.shape[1])
        low, high = np.minimum(limits.lower, limits.upper), limits.upper
        wanted = self._known_rates(task, layout)[3:]
        v[held] = np.clip(wanted, low[held - 6], high[held - 6])
        lower, upper = np.full(len(v), -np.inf), np.full(len(v), np.inf)
        lower[6:], upper[6:] = low - 1e-9, high + 1e-9
        W, k = layout.weights, len(free)
        lam = np.full(k, math.sqrt(lam2) + 1e-6)
        lam[:6] = 0.0  # joint rates are damped, the body's own are not
        rest = lam * self._wished_rates(task, layout, len(v))[free]
        v[free] = bounded_solver()(
            np.vstack(
                [np.vstack([S[:, free], np.eye(3, k)]) * W[:, None], np.diag(lam)]
            ),
            np.concatenate([np.concatenate([w - S @ v, task.trunk_rate]) * W, rest]),
            bounds=(lower[free], upper[free]),
            method="bvls",
        ).x
        at_limit = (v <= lower + 1e-6) | (v >= upper - 1e-6)
        limited = tuple((np.flatnonzero(at_limit) - 6).tolist())
        return Resolution(v, posture, task, self.limbs, lam2 > 0.0, limited)

    def _wished_rates(self, task: Task, layout: _Layout, size: int) -> np.ndarray:
        """Return the rates that redundant limbs fall back to, zero elsewhere."""
        v = np.zeros(size)
        for limb, _, _ in layout.cartesian:
            motion = motion_of(task, limb.name)
            if isinstance(motion, CartesianMotion) and motion.posture_rates is not None:
                v[limb.columns] = motion.posture_rates
        return v

    def _known_rates(self, task: Task, layout: _Layout) -> np.ndarray:
        """Return omega_o, then the rates of the joint-space limbs."""
        known = np.empty(len(layout.known))
        known[:3] = task.trunk_rate
        for limb, place in layout.joint_space:
            motion = task.motions[limb.name]
            if isinstance(motion, JointMotion):
                known[place] = motion.rates
        return known

    def _wishes(self, task: Task, layout: _Layout) -> np.ndarray:
        """Return the right side: the CoM's velocity, then the ends' twists."""
        w = np.empty(len(layout.rows))
        w[:3] = task.com_velocity
        for limb, rows, _ in layout.cartesian:
            motion = motion_of(task, limb.name)
            if isinstance(motion, CartesianMotion):
                every = len(motion.rows) == 6
                w[rows] = motion.twist if every else motion.twist[list(motion.rows)]
        return w

    def _damping_of(self, A: np.ndarray, layout: _Layout) -> float:
        """Return lambda^2 of the most singular square limb.

        A singular value moves by no more than the matrix does (Weyl), so it is found
        anew only when the matrix has moved by the room that was left.
        """
        seen, A_seen, room = self._seen
        if seen is layout:
            moved = (A - A_seen).ravel()
            if moved @ moved < room:
                return 0.0
        if not layout.legs:
            return 0.0
        sigma = min(sigma_min(A[leg]) for leg in layout.legs)
        room = max(0.0, sigma - self.damping.threshold) ** 2
        self._seen = layout, A.copy(), room
        return self.damping.squared(sigma)

    def _squared(
        self, task: Task, layout: _Layout, A: np.ndarray, b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Multiply the rows of the other limbs by their generalised inverse.

        G (J_i qdot_i + ...) + N_i qdot_i = G xdot_i + N_i z_i has as many rows as the
        limb has joints, whatever their number, and its solution is Eq. (19)'s.
        """
        blocks, sides = [A[:3]], [b[:3]]
        for limb, rows, columns in layout.cartesian:
            motion = motion_of(task, limb.name)
            J_i = A[rows, columns]
            if J_i.shape == (6, 6):
                blocks.append(A[rows])
                sides.append(b[rows])
                continue
            G = damped_inverse(J_i, self.damping)
            N = np.eye(G.shape[0]) - G @ J_i
            block, side = G @ A[rows], G @ b[rows]
            block[:, columns] += N
            if isinstance(motion, CartesianMotion) and motion.posture_rates is not None:
                side = side + N @ motion.posture_rates
            blocks.append(block)
            sides.append(side)
        return np.vstack(blocks), np.concatenate(sides)

    def _layout(self, task: Task) -> _Layout:
        """Return the layout for the task's base limb and kinds of motion, cached."""
        kinds = [getattr(m, "rows", None) for m in task.motions.values()]
        key = (task.base, *task.motions, *kinds)
        layout = self._layouts.get(key)
        if layout is None:
            check_task(self.limbs, task)
            layout = self._layouts[key] = self._make_layout(task)
        return layout

    def _make_layout(self, task: Task) -> _Layout:
        """Return a new layout."""
        d, joint_space = self.damping, []
        cartesian, legs, weights = [], [], [1.0, 1.0, d.height_weight]
        rows, free, known = [0, 1, 2], [0, 1, 2], [3, 4, 5]
        for i, limb in enumerate(self.limbs):
            motion = motion_of(task, limb.name)
            columns = limb.columns.tolist()
            if isinstance(motion, JointMotion):
                joint_space.append((limb, _extend(known, columns)))
                continue
            place = _extend(rows, [3 + 6 * i + r for r in motion.rows])
            cartesian.append((limb, place, _extend(free, columns)))
            if len(columns) == len(motion.rows) == 6:
                legs.append(cartesian[-1][1:])
            on_feet = limb.parent is None and len(motion.rows) == 6
            weights += [10.0 if on_feet else d.rotation_weight] * len(motion.rows)
        base = next(limb for limb in self.limbs if limb.name == task.base)
        return _Layout(
            rows=np.array(rows),
            span=_as_slice(rows),
            free=np.array(free),
            known=np.array(known),
            cartesian=tuple(cartesian),
            joint_space=tuple(joint_space),
            legs=tuple(legs),
            square=len(legs) == len(cartesian),
            solvable=len(base.joints) == 6,
            weights=np.array([*weights, *[d.rotation_weight] * 3]),
        )


def _as_slice(indices: list[int]) -> slice | None:
    if indices == list(range(indices[0], indices[-1] + 1)):
        return slice(indices[0], indices[-1] + 1)
    return None


def _extend(indices: list[int], more: list[int]) -> slice:
    """Append indices to a list and return the slice where they went."""
    start = len(indices)
    indices += more
    return slice(start, len(indices))
