"""Limbs, postures and tasks of the kinematic resolution, Eqs. (14)-(27).

Every limb but the base limb has a given motion, *Cartesian* (its end point's twist,
or some rows of it) or *in joint space*. Their effect is embedded in the CoM Jacobian
of the base limb, which then keeps the balance by itself. Three rooms resolve a task:
`elimination` as the paper writes it, `solver` as one stacked system within joint
limits, and `kinematics` compiled, which is what walks.

Velocities are v = [xdot_o; qdot]: the twist of the body center in world axes, then
the rates of all joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ModelError, checked_number, nearest


@dataclass(frozen=True, kw_only=True)
class Limb:
    """A chain of joints from the body center, or from a parent limb, to an end."""

    name: str
    """What the limb is called, such as "left_leg"."""
    joints: tuple[int, ...]
    """The limb's own joints, as indices into the robot's joints."""
    parent: str | None = None
    """The limb that carries this one (a torso), None for the body center."""

    @property
    def columns(self) -> np.ndarray:
        """The limb's own columns in v = [xdot_o; qdot], of shape (n_i,)."""
        return np.array(self.joints, dtype=np.intp) + 6


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Kinematics of a robot at one configuration; to hold one proves that it ran."""

    position: np.ndarray
    """Body center r_o [m], world, of shape (3,)."""
    rotation: np.ndarray
    """Rotation R_o, body to world, of shape (3, 3)."""
    com: np.ndarray
    """CoM c [m], world, of shape (3,)."""
    ends: np.ndarray
    """End points r_i of the limbs [m], world, of shape (n, 3)."""
    end_rotations: np.ndarray
    """Rotations of the end frames, end to world, of shape (n, 3, 3)."""
    jacobian: np.ndarray
    """CoM Jacobian (3 rows), then each end's Jacobian (6 rows), for v in world axes,
    of shape (3 + 6 n, 6 + joints)."""

    @property
    def com_jacobian(self) -> np.ndarray:
        """CoM Jacobian, Eq. (21): columns [I, -[c - r_o]x, R_o oJ_c1, ...]."""
        return self.jacobian[:3]

    def end_jacobian(self, i: int) -> np.ndarray:
        """Jacobian of the end of limb i, Eq. (15), of shape (6, 6 + joints)."""
        return self.jacobian[3 + 6 * i : 9 + 6 * i]


ALL_ROWS = (0, 1, 2, 3, 4, 5)


@dataclass(frozen=True, slots=True, eq=False)
class CartesianMotion:
    """A limb's motion given at its end point."""

    twist: np.ndarray
    """Desired twist of the end point [m/s; rad/s], world, of shape (6,)."""
    rows: tuple[int, ...] = ALL_ROWS
    """The rows of the twist that matter; the others are left free."""
    posture_rates: np.ndarray | None = None
    """Joint rates wished in the null space [rad/s], of shape (n_i,); None is zero."""


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """A limb's motion given in joint space."""

    rates: np.ndarray
    """Joint rates [rad/s], of shape (n_i,)."""


Motions = Mapping[str, CartesianMotion | JointMotion]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """The task of the whole body at one tick."""

    com_velocity: np.ndarray
    """CoM velocity cdot [m/s], world, of shape (3,): u of Eq. (31) in x and y."""
    base: str
    """Name of the base (support) limb."""
    base_twist: np.ndarray
    """Twist xdot_1 of the base limb's end [m/s; rad/s], zero when stuck to the
    ground, of shape (6,)."""
    trunk_rate: np.ndarray
    """Angular velocity omega_o of the body center [rad/s], world, of shape (3,)."""
    motions: Motions
    """The embedded motion of every other limb, by name."""


@dataclass(frozen=True, kw_only=True)
class Damping:
    """Damping of the resolution near singular postures and at joint limits.

    Feet give way least, then the horizontal CoM, the trunk's orientation and other
    ends, and the CoM height most. The weights do not depend on which leg is the base
    limb, so that the support side can change without a jump there too.
    """

    threshold: float = 0.05
    """Smallest singular value of a limb's Jacobian [m/rad] below which it damps."""
    factor: float = 0.02
    """Damping lambda_0 of joint rates at an exactly singular posture, in (0, 1]."""
    height_weight: float = 0.1
    """Weight of the CoM height against its horizontal position, in (0, 1]."""
    rotation_weight: float = 0.3
    """Weight of the trunk's orientation and of ends other than feet, in (0, 1]."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        for name in ("threshold", "factor", "height_weight", "rotation_weight"):
            value = getattr(self, name)
            checked_number(f"damping.{name}", value, low=0, high=1, open_low=True)

    def squared(self, sigma_min: float) -> float:
        """Return lambda^2: zero above the threshold, growing smoothly below it."""
        ratio = sigma_min / self.threshold
        return self.factor**2 * max(0.0, 1.0 - ratio * ratio)


@dataclass(frozen=True, slots=True, eq=False)
class Resolution:
    """Joint rates that fulfil a task, and the proof of it."""

    velocity: np.ndarray
    """v = [xdot_o; qdot] [m/s, rad/s], world, of shape (6 + joints,)."""
    posture: Posture
    """The posture it was resolved at."""
    task: Task
    """What was asked."""
    limbs: tuple[Limb, ...]
    """The limbs, in the order of the posture's ends."""
    damped: bool = False
    """Whether a limb was near a singular posture, so that residuals are not zero."""
    limited: tuple[int, ...] = ()
    """Joints held at a speed or position limit, as indices."""

    @property
    def body_twist(self) -> np.ndarray:
        """Twist xdot_o of the body center [m/s; rad/s], world, of shape (6,)."""
        return self.velocity[:6]

    @property
    def rates(self) -> np.ndarray:
        """Joint rates qdot [rad/s], of shape (joints,)."""
        return self.velocity[6:]

    def com_residual(self) -> np.ndarray:
        """Return asked minus resolved CoM velocity [m/s], of shape (3,)."""
        return self.task.com_velocity - self.posture.com_jacobian @ self.velocity

    def trunk_residual(self) -> np.ndarray:
        """Return asked minus resolved trunk rate [rad/s], of shape (3,)."""
        return self.task.trunk_rate - self.velocity[3:6]

    def limb_residuals(self) -> dict[str, np.ndarray]:
        """Return asked minus resolved motion of each limb, in the rows it was given."""
        return {
            limb.name: self._limb_residual(i, limb) for i, limb in enumerate(self.limbs)
        }

    def _limb_residual(self, i: int, limb: Limb) -> np.ndarray:
        motion = motion_of(self.task, limb.name)
        if isinstance(motion, JointMotion):
            return motion.rates - self.velocity[limb.columns]
        rows = list(motion.rows)
        return (motion.twist - self.posture.end_jacobian(i) @ self.velocity)[rows]

    def loss(self) -> float:
        """Return the largest residual of all: 0 when the task is met exactly."""
        parts = [self.com_residual(), self.trunk_residual()]
        parts += list(self.limb_residuals().values())
        return float(max(np.abs(part).max(initial=0.0) for part in parts))


def motion_of(task: Task, name: str) -> CartesianMotion | JointMotion:
    """Return the motion of a limb; the base limb's is its own twist.

    Args:
        task: What is asked.
        name: Name of the limb.

    Returns:
        The motion that the task gives it.
    """
    if name == task.base:
        return CartesianMotion(task.base_twist)
    return task.motions[name]


def ancestors(limbs: Sequence[Limb], limb: Limb) -> list[Limb]:
    """Return the limbs that carry a limb, nearest first."""
    by_name = {other.name: other for other in limbs}
    chain = []
    while limb.parent is not None:
        limb = by_name[limb.parent]
        chain.append(limb)
    return chain


def check_limbs(limbs: Sequence[Limb]) -> None:
    """Check that limbs form a tree, parents first, each joint in at most one.

    Args:
        limbs: The robot's limbs.

    Raises:
        ModelError: If a name or joint repeats or a parent does not come first.
    """
    names: set[str] = set()
    joints: set[int] = set()
    for limb in limbs:
        if limb.name in names or joints & set(limb.joints):
            raise ModelError(f'limb "{limb.name}": its name or a joint of it repeats')
        if limb.parent is not None and limb.parent not in names:
            raise ModelError(
                f'limb "{limb.name}": its parent "{limb.parent}" must come before it; '
                + nearest(limb.parent, names)
            )
        names.add(limb.name)
        joints |= set(limb.joints)


def check_task(limbs: Sequence[Limb], task: Task) -> None:
    """Check that a task names every limb once.

    Args:
        limbs: The robot's limbs.
        task: What is asked.

    Raises:
        ModelError: If a limb is unknown, left out, or the base limb has a parent.
    """
    by_name = {limb.name: limb for limb in limbs}
    for name in (task.base, *task.motions):
        if name not in by_name:
            raise ModelError(f'no limb "{name}"; {nearest(name, by_name)}')
    missing = set(by_name) - {task.base} - set(task.motions)
    if missing:
        raise ModelError(f"no motion is given for limb {', '.join(sorted(missing))}")
    if by_name[task.base].parent is not None:
        raise ModelError(f'limb "{task.base}" has a parent and cannot be the base limb')
