r"""Compiled estimate of the ground's wrenches, for robots without ankle sensors.

What moves the robot and is not its motors' is the ground,

.. math:: M \dot v + h - S^T \tau = \sum_i J_i^T w_i

Its left side is known from encoders, gyro and the torques that the motors report, all
through the same filters, so that none is ahead of another: this is what an observer of
the generalised momentum finds. The wrench of each sole is fitted to the six rows of the
base and the joints of its leg, weighted by how far each is to be trusted, and is
handed on as what an ankle sensor would read.
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
from ..pattern import Phase
from .foot_contact import ANKLE, turned_back

_LEFT, _RIGHT = int(Phase.SINGLE_LEFT), int(Phase.SINGLE_RIGHT)

# How far rows are to be trusted, in weights and in weights times CoM height [-].
_BASE_FORCE, _BASE_MOMENT, _JOINT = 0.06, 0.03, 0.005
_SWING_FORCE, _SWING_MOMENT, _STANCE = 0.045, 0.005, 5.0


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
    """Normal equations of the fit, with their right side, flat (12 x 13)."""


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
def _add_row(
    H: np.ndarray, row: Record, first: int, value: float, scale: float
) -> None:
    """Add an equation for six of the twelve unknowns to the normal equations."""
    w = 1.0 / (scale * scale)
    for r in range(6):
        x = w * row[r]
        for c in range(6):
            H[13 * (first + r) + first + c] += x * row[c]
        H[13 * (first + r) + 12] += x * value


@kernel
def _add_base(
    H: np.ndarray, r: tuple, s: tuple, i: int, k: int, force: float, moment: float
) -> None:
    """Add B_i^T W B_k for feet at r and s from the body center; B w is w about it."""
    f, m = 1.0 / (force * force), 1.0 / (moment * moment)
    a, b = 13 * 6 * i + 6 * k, 13
    dot = r[0] * s[0] + r[1] * s[1] + r[2] * s[2]
    for p in range(3):
        for q in range(3):  # [r]^T [s] = r.s I - s r^T
            H[a + b * p + q] -= m * s[p] * r[q]
        H[a + b * p + p] += f + m * dot
        H[a + b * (3 + p) + 3 + p] += m
        j, k_ = (p + 1) % 3, (p + 2) % 3
        H[a + b * k_ + 3 + j] -= m * r[p]  # [r]^T
        H[a + b * j + 3 + k_] += m * r[p]
        H[a + b * (3 + j) + k_] -= m * s[p]  # [s]
        H[a + b * (3 + k_) + j] += m * s[p]


@kernel
def _add_base_side(
    H: np.ndarray, t: np.ndarray, r: tuple, i: int, force: float, moment: float
) -> None:
    """Add B_i^T W e of the base rows."""
    f, m, a = 1.0 / (force * force), 1.0 / (moment * moment), 13 * 6 * i + 12
    H[a] += f * t[0] - m * (r[1] * t[5] - r[2] * t[4])
    H[a + 13] += f * t[1] - m * (r[2] * t[3] - r[0] * t[5])
    H[a + 26] += f * t[2] - m * (r[0] * t[4] - r[1] * t[3])
    for p in range(3):
        H[a + 13 * (3 + p)] += m * t[3 + p]


@kernel
def _solve_twelve(H: np.ndarray) -> None:
    """Solve the normal equations by Cholesky; the solution is left in column 12."""
    for r in range(12):
        for c in range(r + 1):
            x = H[13 * r + c]
            for k in range(c):
                x -= H[13 * r + k] * H[13 * c + k]
            H[13 * r + c] = math.sqrt(x) if r == c else x / H[13 * c + c]
    for r in range(12):
        x = H[13 * r + 12]
        for k in range(r):
            x -= H[13 * r + k] * H[13 * k + 12]
        H[13 * r + 12] = x / H[13 * r + r]
    for r in range(11, -1, -1):
        x = H[13 * r + 12]
        for k in range(r + 1, 12):
            x -= H[13 * k + r] * H[13 * k + 12]
        H[13 * r + 12] = x / H[13 * r + r]


@kernel
def fit_wrenches(
    flat: Flat,
    rules: Record,
    reference: Record,
    v: np.ndarray,
    observer: Observer,
) -> None:
    """Fit the wrenches of both soles, each about its centre, into `observer.H`.

    Args:
        flat: The robot, placed; both legs get the columns of their ends.
        rules: Settings.
        reference: Which foot swings.
        v: The velocity.
        observer: After `follow_forces`.
    """
    bodies, t, H = observer.bodies, observer.t, observer.H
    move_links(flat, bodies, v)
    accelerate_links(flat, bodies, observer.a)
    load_links(flat, bodies, observer.a, rules.gravity, t)
    weight, moment = rules.weight, rules.weight * rules.com_height
    for k in range(len(H)):
        H[k] = 0.0
    p = flat.links[0].p
    x, y, z = site_point(flat, flat.limbs[0].site)
    left = (x - p[0], y - p[1], z - p[2])
    x, y, z = site_point(flat, flat.limbs[1].site)
    right = (x - p[0], y - p[1], z - p[2])
    f, m = _BASE_FORCE * weight, _BASE_MOMENT * moment
    _add_base(H, left, left, 0, 0, f, m)
    _add_base(H, left, right, 0, 1, f, m)
    _add_base(H, right, left, 1, 0, f, m)
    _add_base(H, right, right, 1, 1, f, m)
    _add_base_side(H, t, left, 0, f, m)
    _add_base_side(H, t, right, 1, f, m)
    for i in range(2):
        limb = flat.limbs[i]
        end_columns(flat, limb)
        for n in range(limb.own):
            j = limb.chain[n] - 1
            value = t[6 + j] - observer.torques[j]
            _add_row(H, flat.links[1 + j].end, 6 * i, value, _JOINT * moment)
        swings = reference.phase == (_RIGHT if i == 0 else _LEFT)
        s = _SWING_FORCE * weight if swings else _STANCE * weight
        n = _SWING_MOMENT * moment if swings else _STANCE * moment
        for p_ in range(3):
            k = 6 * i + p_
            H[13 * k + k] += 1.0 / (s * s)
            H[13 * (k + 3) + k + 3] += 1.0 / (n * n)
    _solve_twelve(H)


@kernel
def read_ankle(
    flat: Flat, rules: Record, state: Record, k: int, H: np.ndarray, felt: np.ndarray
) -> None:
    """Write what the sensor of ankle k would read of a fitted wrench.

    The ground only pushes, and from within the sole.
    """
    w, limb = H[13 * 6 * k + 12 :: 13], flat.limbs[k]
    f = (w[0], w[1], max(w[2], 0.0))
    R, half = state.sensor, rules.sole_half[k]
    site_rotation(flat, limb.site, R)
    a, b, _ = turned_back(R, w[3], w[4], w[5])
    a = min(max(a, -f[2] * half[1]), f[2] * half[1])
    b = min(max(b, -f[2] * half[0]), f[2] * half[0])
    _, _, c = turned_back(R, w[3], w[4], w[5])
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
