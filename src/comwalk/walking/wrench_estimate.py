r"""Compiled estimate of the ground's wrenches, for robots without ankle sensors.

What moves a leg and is not its motors' is the ground,

.. math:: J^T w = [M \dot v + h - S^T \tau]_{leg}

Its right side is known from encoders, gyro and the torques that the motors report, all
through the same filters, so that none is ahead of another: this is what an observer of
the generalised momentum finds. The wrench of each sole is fitted to the joints of its
leg, where a swinging foot is expected to bear nothing, and is handed on as what an
ankle sensor would read. The six rows of the base would tell the sum of both wrenches,
but accelerations of the whole body are too noisy to add anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import Record, kernel
from ..embedding import (
    Flat,
    accelerate_links,
    end_columns,
    load_links,
    move_links,
    site_point,
    site_rotation,
    turned,
)
from ..pattern import LEFT_ALONE, RIGHT_ALONE
from .foot_contact import ANKLE, turned_back

# What joints err by, and wrenches of feet may be, in weights and times CoM height [-].
_JOINT, _STANCE = 0.005, 5.0
_SWING_FORCE, _SWING_MOMENT = 0.045, 0.005


class Observer(NamedTuple):
    """Workspace of the estimate."""

    bodies: np.ndarray
    """Records of `BODY`."""
    motors: np.ndarray
    """Torques that the motors report [N m], (joints,)."""
    slow: np.ndarray
    """The same after the filter of the joint rates, (joints,)."""
    torques: np.ndarray
    """The same after the observer's filter, (joints,)."""
    last: np.ndarray
    """The last velocity, (6 + joints,)."""
    a: np.ndarray
    """Its rate, filtered, (6 + joints,)."""
    t: np.ndarray
    """Generalised forces of the motion, (6 + joints,)."""
    H: np.ndarray
    """Normal equations of the fit, with their right side, (6, 7)."""


STILL = 0.05
"""Joint rate within which dry friction is taken to grow [rad/s]."""


@kernel
def friction_of(joint: Record, rate: float) -> float:
    """Return the friction that is known of a joint at a rate [N m]."""
    return joint.viscous * rate + joint.dry * math.tanh(rate / STILL)


@kernel
def follow_forces(
    rules: Record,
    state: Record,
    joints: np.ndarray,
    v: np.ndarray,
    observer: Observer,
    moved: bool,
) -> None:
    """Pass torques and velocities through the observer's filters.

    Args:
        rules: Settings.
        state: Counts the readings.
        joints: Their friction, as far as it is known, is taken from the torques.
        v: The velocity.
        observer: Workspace.
        moved: Whether the base's velocity is now told by the other sole.
    """
    share, n = rules.observer_share, len(joints)
    for j in range(n):
        torque = observer.motors[j] - friction_of(joints[j], v[6 + j])
        if state.readings == 1:
            observer.slow[j] = observer.torques[j] = torque
        observer.slow[j] += rules.rate_share * (torque - observer.slow[j])
        observer.torques[j] += share * (observer.slow[j] - observer.torques[j])
    for i in range(6 + n):
        if state.readings == 1 or (moved and i < 3):
            observer.last[i] = v[i]
        rate = (v[i] - observer.last[i]) / rules.period
        observer.a[i] += share * (rate - observer.a[i])
        observer.last[i] = v[i]


@kernel
def _fit(H: np.ndarray) -> None:
    """Solve six normal equations by Cholesky; the solution is left in column 6."""
    for r in range(6):
        for c in range(r + 1):
            x = H[r, c]
            for k in range(c):
                x -= H[r, k] * H[c, k]
            H[r, c] = math.sqrt(x) if r == c else x / H[c, c]
    for r in range(6):
        for k in range(r):
            H[r, 6] -= H[r, k] * H[k, 6]
        H[r, 6] /= H[r, r]
    for r in range(5, -1, -1):
        for k in range(r + 1, 6):
            H[r, 6] -= H[k, r] * H[k, 6]
        H[r, 6] /= H[r, r]


@kernel
def _weigh_leg(
    flat: Flat, rules: Record, limb: Record, observer: Observer, swings: bool
) -> None:
    """Write the normal equations of the wrench at a leg's end."""
    moment, H = rules.weight * rules.com_height, observer.H
    force = (_SWING_FORCE if swings else _STANCE) * rules.weight
    torque = (_SWING_MOMENT if swings else _STANCE) * moment
    for r in range(6):
        for c in range(7):
            H[r, c] = 0.0
        H[r, r] = 1.0 / (force * force if r < 3 else torque * torque)
    w = 1.0 / (_JOINT * moment) ** 2
    end_columns(flat, limb)
    for n in range(limb.own):
        j = limb.chain[n] - 1
        J, value = flat.links[1 + j].end, observer.t[6 + j] - observer.torques[j]
        for r in range(6):
            for c in range(r + 1):
                H[r, c] += w * J[r] * J[c]
            H[r, 6] += w * J[r] * value


@kernel
def fit_wrenches(
    flat: Flat,
    rules: Record,
    state: Record,
    reference: Record,
    v: np.ndarray,
    observer: Observer,
    felt: np.ndarray,
) -> None:
    """Fit the wrenches of both soles, and write what ankle sensors would read.

    Args:
        flat: The robot, placed; both legs get the columns of their ends.
        rules: Settings.
        state: Scratch.
        reference: Which foot swings.
        v: The velocity.
        observer: After `follow_forces`.
        felt: Where the readings go (12) [N, N m].
    """
    move_links(flat, observer.bodies, v)
    accelerate_links(flat, observer.bodies, observer.a)
    load_links(flat, observer.bodies, observer.a, rules.gravity, observer.t)
    for k in range(2):
        swings = reference.phase == (RIGHT_ALONE if k == 0 else LEFT_ALONE)
        _weigh_leg(flat, rules, flat.limbs[k], observer, swings)
        _fit(observer.H)
        read_ankle(flat, rules, state, k, observer.H[:, 6], felt)


@kernel
def read_ankle(
    flat: Flat, rules: Record, state: Record, k: int, w: np.ndarray, felt: np.ndarray
) -> None:
    """Write what the sensor of ankle k would read of a wrench about its sole's centre.

    The ground only pushes, and from within the sole.
    """
    limb = flat.limbs[k]
    f = (w[0], w[1], max(w[2], 0.0))
    R, half = state.sensor, rules.sole_half[k]
    site_rotation(flat, limb.site, R)
    a, b, c = turned_back(R, w[3], w[4], w[5])
    a = min(max(a, -f[2] * half[1]), f[2] * half[1])
    b = min(max(b, -f[2] * half[0]), f[2] * half[0])
    m_x, m_y, m_z = turned(R, (a, b, c))
    site_rotation(flat, ANKLE + k, R)
    x, y, z = site_point(flat, limb.site)
    u, v, s = site_point(flat, ANKLE + k)
    x, y, z = x - u, y - v, z - s
    m_x, m_y, m_z = (
        m_x + y * f[2] - z * f[1],
        m_y + z * f[0] - x * f[2],
        m_z + x * f[1] - y * f[0],
    )
    x, y, _ = turned(R, rules.foot_com[k])
    weight = rules.foot_weight[k]
    force = turned_back(R, f[0], f[1], f[2] - weight)
    moment = turned_back(R, m_x - y * weight, m_y + x * weight, m_z)
    for i in range(3):
        felt[6 * k + i], felt[6 * k + 3 + i] = force[i], moment[i]
