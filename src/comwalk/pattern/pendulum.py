r"""The simplified model of walking, Eqs. (1)-(3) and (29).

A point mass at the CoM rolls on the plane :math:`z = c_z` (Fig. 1); the ZMP is the
point on the ground where the contact force must act to make it move so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import ParameterError
from ..settings import check_settings, setting


@dataclass(frozen=True, kw_only=True)
class Pendulum:
    """The rolling sphere model: a point mass on a plane of constant height.

    Raises:
        ParameterError: If a number is not finite or out of its range.

    Example:
        >>> round(Pendulum(height=0.687).omega, 6)
        3.778819
    """

    height: float = setting(
        0.687, "Height of the CoM above the ground, c_z", "m", "[0.05, 10]"
    )

    gravity: float = setting(
        9.81, "Gravitational acceleration, g", "m/s^2", "[0.1, 100]"
    )

    inertia: float = setting(
        0.0,
        "Angular momentum about the CoM that comes with the CoM's motion, as a share "
        "of m c_z times its velocity; 0 for the paper's point mass, more for legs "
        "that sway under an upright trunk, which make the pendulum longer by this "
        "share",
        "",
        "[-0.5, 2]",
    )

    def __post_init__(self) -> None:
        """Check the ranges; store floats."""
        check_settings(self)

    @property
    def omega(self) -> float:
        """Natural frequency omega_n = sqrt(g / (c_z (1 + inertia))) [rad/s]."""
        return math.sqrt(self.gravity / (self.height * (1.0 + self.inertia)))


PAPER_PENDULUM = Pendulum()
"""The pendulum of the paper's experiment: omega_n = 3.78 rad/s."""


class StateMatrices(NamedTuple):
    """The matrices of the state space form, Eq. (3), for one axis."""

    A: np.ndarray
    """State matrix, shape (2, 2); the state is (c_i [m], cdot_i [m/s])."""

    B: np.ndarray
    """Input matrix, shape (2, 1); the input is the ZMP p_i [m]."""


def zmp_of_motion(
    pendulum: Pendulum, com: np.ndarray, com_acceleration: np.ndarray
) -> np.ndarray:
    r"""Return the ZMP that belongs to a CoM motion, Eqs. (1), (2) and (29).

    .. math:: p = c - \ddot c / \omega_n^2

    Args:
        pendulum: Gives omega_n.
        com: Position c [m], shape (..., k), world.
        com_acceleration: Acceleration of c [m/s^2], the same shape, world.

    Returns:
        The ZMP p [m], the same shape, world, on the ground.

    Raises:
        ParameterError: If the two shapes differ.

    Example:
        >>> p = zmp_of_motion(PAPER_PENDULUM, np.array([0.1]), np.array([1.0]))
        >>> print(round(float(p[0]), 6))
        0.029969
    """
    c = np.asarray(com, dtype=float)
    cddot = np.asarray(com_acceleration, dtype=float)
    if c.shape != cddot.shape:
        raise ParameterError(
            f"com_acceleration must have the shape of com, {c.shape}, got {cddot.shape}"
        )
    return c - cddot / pendulum.omega**2


def state_matrices(pendulum: Pendulum) -> StateMatrices:
    r"""Return the state space form of the ZMP equations, Eq. (3).

    .. math:: \frac{d}{dt} [c_i, \dot c_i]^T = A [c_i, \dot c_i]^T + B p_i

    Args:
        pendulum: Gives omega_n.

    Returns:
        A = [[0, 1], [omega_n^2, 0]] and B = [[0], [-omega_n^2]], for i = x and i = y.

    Example:
        >>> print(round(float(state_matrices(PAPER_PENDULUM).A[1, 0]), 6))
        14.279476
    """
    omega = pendulum.omega
    A = np.array([[0.0, 1.0], [omega**2, 0.0]])
    B = np.array([[0.0], [-(omega**2)]])
    return StateMatrices(A, B)
