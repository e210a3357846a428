"""Foot contact: sole poses, tilt, touchdown compliance and edge recovery.

The plan assumes level soles at planned places. The records of the body keep what
differs: dead reckoning by the encoders says where a foot came down, the IMU how a sole
lies, and from the load shares of the feet a landing foot yields when it meets the
ground early, and reaches down when the ground comes late.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..embedding import Flat, site_point, site_rotation, turned
from ..pattern import DOUBLE, LEFT_ALONE, RIGHT_ALONE

RETURN_TIME = 0.1
"""Time constant of a swinging foot's return to its path [s]."""
SETTLE_TIME = 2.0
"""Time constant of the body's return to its height over the feet [s]."""
LEAN_TIME = 0.2
"""Time constant in which a sole is taken to lie as the IMU says [s]."""
RECOVERING = 0.015
"""CoM error above which the soles are kept as they are [m]."""
CAUTION = 0.1
"""How much slower the IMU is believed while the robot recovers [-]."""
EDGE = 0.7
"""Share of the sole's half size beyond which it stands on its edge [-]."""
TOLERANCE = 0.25
"""Share of the weight by which a landing may differ from its plan [-]."""
REACH = 0.05
"""Farthest that a foot leaves its plan up or down [m]."""

SOLE, ANKLE, IMU = 0, 2, 4
"""First sites of a robot's records: both soles, both ankle sensors, the IMU."""


LEAST_LOAD, _EDGE_LEAST = 0.05, 0.1
"""Shares of the weight that a ZMP, and an edge, need [-]."""


@kernel
def turned_back(R: Record, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R^T v."""
    return (
        R[0, 0] * x + R[1, 0] * y + R[2, 0] * z,
        R[0, 1] * x + R[1, 1] * y + R[2, 1] * z,
        R[0, 2] * x + R[1, 2] * y + R[2, 2] * z,
    )


@kernel
def untilt(R: Record, x: float, y: float, out: Record) -> None:
    """Write R T^T: T is the smallest rotation that turns (x, y, .) to the vertical."""
    z = math.sqrt(max(1.0 - x * x - y * y, 0.0))
    k = 1.0 / (1.0 + z)
    a, b, d = 1.0 - k * x * x, -k * x * y, 1.0 - k * y * y
    for i in range(3):
        u, v, w = R[i, 0], R[i, 1], R[i, 2]
        out[i, 0] = u * a + v * b - w * x
        out[i, 1] = u * b + v * d - w * y
        out[i, 2] = u * x + v * y + w * z


@kernel
def foothold(state: Record, reference: Record, k: int) -> tuple[float, float, float]:
    """Return the foothold of sole k: x [m], y [m], yaw [rad]."""
    foot, away = reference.feet[k], state.offsets[k]
    x, y = foot.position[0], foot.position[1]
    return x + away[0], y + away[1], foot.yaw + away[2]


@kernel
def level_frame(rules: Record, state: Record, k: int, out: Record) -> None:
    """Write the level frame over sole k."""
    if rules.imu:
        untilt(state.soles[k], state.up[k, 0], state.up[k, 1], out)
        return
    for i in range(3):
        for j in range(3):
            out[i, j] = state.soles[k, i, j]


@kernel
def feel_tilt(flat: Flat, rules: Record, state: Record, imu: np.ndarray) -> None:
    """Find how both soles lie, by the IMU."""
    if not rules.imu:
        return
    w, x, y, z = imu[0], imu[1], imu[2], imu[3]
    site_rotation(flat, IMU, state.sensor)
    up = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    a, b, c = turned(state.sensor, up)
    share = rules.imu_share * (CAUTION if state.recovers else 1.0)
    for k in range(2):
        seen = turned_back(state.soles[k], a, b, c)
        state.up[k, 0] += share * (seen[0] - state.up[k, 0])
        state.up[k, 1] += share * (seen[1] - state.up[k, 1])


@kernel
def remainder(angle: float) -> float:
    """Return an angle in [-pi, pi], as `math.remainder` does of a whole turn."""
    return angle - math.tau * np.rint(angle / math.tau)


@kernel
def change_support(
    flat: Flat, rules: Record, state: Record, reference: Record, new: int
) -> None:
    """Find where the new supporting sole stands, seen from the old one."""
    old, level = state.support, state.level
    level_frame(rules, state, old, level)
    level_frame(rules, state, new, state.other)
    x, y, z = site_point(flat, SOLE + new)
    u, v, w = site_point(flat, SOLE + old)
    x, y, z = turned_back(level, x - u, y - v, z - w)
    a, b, _ = turned_back(
        level, state.other[0, 0], state.other[1, 0], state.other[2, 0]
    )
    p, q, yaw = foothold(state, reference, old)
    c, s = math.cos(yaw), math.sin(yaw)
    foot, away = reference.feet[new], state.offsets[new]
    away[0] = p + c * x - s * y - foot.position[0]
    away[1] = q + s * x + c * y - foot.position[1]
    away[2] = remainder(yaw + math.atan2(b, a) - foot.yaw)
    state.support = new


@kernel
def feel_edges(rules: Record, state: Record, k: int, wrench: Record) -> None:
    """Find where on sole k the ground presses."""
    f_x, f_y, f_z = turned(rules.sole_turn[k], wrench)
    m_x, m_y, _ = turned(rules.sole_turn[k], wrench[3:])
    f_z += rules.foot_weight[k]
    edge, arm, half = state.edges[k], rules.sole_arm[k], rules.sole_half[k]
    if f_z < _EDGE_LEAST * rules.weight:
        edge[0] = edge[1] = 0.0
        return
    edge[0] = (arm[0] - (m_y + arm[2] * f_x) / f_z) / half[0]
    edge[1] = (arm[1] + (m_x - arm[2] * f_y) / f_z) / half[1]


@kernel
def planned_share(reference: Record) -> float:
    """Return the planned share of the weight on the left foot [-].

    On two feet it is where the reference ZMP lies between the soles.
    """
    phase = reference.phase
    left, right = reference.feet[0].position, reference.feet[1].position
    if phase == LEFT_ALONE or phase == RIGHT_ALONE:
        return 1.0 if phase == LEFT_ALONE else 0.0
    x, y = right[0], right[1]
    d_x, d_y = left[0] - x, left[1] - y
    share = (reference.zmp[0] - x) * d_x + (reference.zmp[1] - y) * d_y
    return min(max(share / (d_x * d_x + d_y * d_y), 0.0), 1.0)


@kernel
def _comply(
    rules: Record,
    state: Record,
    reference: Record,
    k: int,
    swings: bool,
    surplus: float,
) -> None:
    """Apply the touchdown compliance: foot k yields to its excess load."""
    dt, h = rules.period, state.heights[k]
    rising = reference.feet[k].velocity[2] > 0.0
    if rules.landing == 0.0:
        return
    if swings and (surplus <= 0.0 or rising):
        state.heights[k] = h - dt / RETURN_TIME * h
        return
    double = reference.phase == DOUBLE
    if double or swings:
        h += (0.5 if double else 1.0) * dt * rules.landing * surplus
    state.heights[k] = min(max(h - dt / SETTLE_TIME * h, -REACH), REACH)


@kernel
def _align(rules: Record, state: Record, k: int, swings: bool) -> None:
    """Align sole k with the ground tilt that the IMU measures, a swinging one level.

    A sole that stands on its edge is turned the other way until it lies flat. While the
    robot recovers from a push, soles stay as they are: an ankle that yields cannot hold
    the body.
    """
    dt = rules.period
    if not rules.imu or (state.recovers and not swings):
        return
    for i in range(2):
        lean = state.leans[k, i]
        if swings:
            state.leans[k, i] = lean - dt / RETURN_TIME * lean
            continue
        lean += dt / LEAN_TIME * (state.up[k, i] - lean)
        edge = min(max(state.edges[k, i], -1.0), 1.0)
        past = math.copysign(max(abs(edge) - EDGE, 0.0) / (1.0 - EDGE), edge)
        state.leans[k, i] = lean + dt * rules.rolling * past


@kernel
def follow_ground(rules: Record, state: Record, law: Record, reference: Record) -> None:
    """Move the commanded feet towards what was felt."""
    state.recovers = math.hypot(law.e_c[0], law.e_c[1]) > RECOVERING
    phase, swing = reference.phase, 1 - int(reference.support)
    single = phase == LEFT_ALONE or phase == RIGHT_ALONE
    surplus = state.left_share - planned_share(reference)
    surplus -= min(max(surplus, -TOLERANCE), TOLERANCE)
    for k in range(2):
        swings = single and k == swing
        _comply(rules, state, reference, k, swings, surplus if k == 0 else -surplus)
        _align(rules, state, k, swings)
    if single:
        for i in range(3):
            state.offsets[swing, i] *= 1.0 - rules.period / RETURN_TIME
