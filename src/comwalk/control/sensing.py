"""Feedback signals of Fig. 4: CoM from encoders, ZMP from ankle wrenches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """The only feedback of the walking controller, and what watches over it."""

    com: np.ndarray
    """CoM [m], world, of shape (3,)."""
    zmp: np.ndarray
    """ZMP [m], world, on the ground, of shape (2,)."""
    load: float
    """Vertical ground force [N]."""
    tilt: float
    """Tilt of the trunk against the vertical [rad]."""
    feedback_scale: float = 1.0
    """How much of the law's feedback may act on it [-]: 0 while the standing robot is
    weighed, then smoothly up to 1."""


Vector = Sequence[float]
"""Three numbers: a list, a tuple or an array."""


class Contact(NamedTuple):
    """Ground force of one foot; plain numbers, since it is made at every tick."""

    point: Vector
    """Point that the moment is taken about [m], world."""
    force: Vector
    """Force on the robot [N], world."""
    moment: Vector
    """Moment on the robot about the point [N m], world."""


def ground_load(contacts: Iterable[Contact]) -> tuple[float, float, float]:
    """Return the vertical force and the moments about the world's x and y axes.

    Args:
        contacts: Ground force of each foot.

    Returns:
        F_z [N], M_x and M_y [N m] about the world's origin.
    """
    F_z = M_x = M_y = 0.0
    for (x, y, z), (f_x, f_y, f_z), (m_x, m_y, _) in contacts:
        F_z += f_z
        M_x += m_x + y * f_z - z * f_y
        M_y += m_y + z * f_x - x * f_z
    return F_z, M_x, M_y


def zmp_from_wrenches(
    contacts: Iterable[Contact], least_load: float = 1.0
) -> np.ndarray | None:
    r"""Return the ZMP of the ground forces, on the plane z = 0.

    .. math:: p_x = -M_y / F_z, \qquad p_y = M_x / F_z

    Args:
        contacts: Ground force of each foot.
        least_load: Vertical force [N] below which there is no ZMP.

    Returns:
        ZMP [m], world, of shape (2,); None with too little load.
    """
    F_z, M_x, M_y = ground_load(contacts)
    if not F_z > least_load:
        return None
    return np.array([-M_y / F_z, M_x / F_z])
