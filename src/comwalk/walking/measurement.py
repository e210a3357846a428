"""Compiled measurement: from encoders, ankle wrenches and IMU to CoM and ZMP.

`whole_body.WholeBody.measure`, `footing`, `weighing` and `sensing` say what is computed
and why; a test ties the two.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..control import (
    RISE_TIME,
    WEIGHING_TIME,
)
from ..embedding import Flat, place_links, site_point, site_rotation, turned
from ..pattern import Phase, minimum_jerk
from .foot_contact import CAUTION

_STAND, _LEFT, _RIGHT = (
    int(Phase.STAND),
    int(Phase.SINGLE_LEFT),
    int(Phase.SINGLE_RIGHT),
)
SOLE, ANKLE, IMU = 0, 2, 4
"""First sites of a robot's records: both soles, both ankle sensors, the IMU."""
_LEAST, _EDGE_LEAST = 0.05, 0.1  # shares of the weight that a ZMP, an edge needs


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
    """Write R T^T, with T the smallest rotation that takes (x, y, .) to the vertical.

    See `footing.tilt_matrix`.
    """
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
    """Return where sole k stands: x [m], y [m], yaw [rad]; `Footing.foothold`."""
    foot, away = reference.feet[k], state.offsets[k]
    x, y = foot.position[0], foot.position[1]
    return x + away[0], y + away[1], foot.yaw + away[2]


@kernel
def _level(rules: Record, state: Record, k: int, out: Record) -> None:
    """Write the level frame over sole k; `Footing.level`."""
    if rules.imu:
        untilt(state.soles[k], state.up[k, 0], state.up[k, 1], out)
        return
    for i in range(3):
        for j in range(3):
            out[i, j] = state.soles[k, i, j]


@kernel
def _feel(flat: Flat, rules: Record, state: Record, imu: np.ndarray) -> None:
    """Find how both soles lie, by the IMU; `Footing.feel`."""
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
def _remainder(angle: float) -> float:
    """Return an angle in [-pi, pi], as `math.remainder` does of a whole turn."""
    return angle - math.tau * np.rint(angle / math.tau)


@kernel
def _change_support(
    flat: Flat, rules: Record, state: Record, reference: Record, new: int
) -> None:
    """Find where the new supporting sole stands, seen from the old one."""
    old, level = state.support, state.level
    _level(rules, state, old, level)
    _level(rules, state, new, state.other)
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
    away[2] = _remainder(yaw + math.atan2(b, a) - foot.yaw)
    state.support = new


@kernel
def _ground_force(
    flat: Flat, rules: Record, state: Record, k: int, wrench: Record, origin: Record
) -> tuple[float, float, float]:
    """Return F_z, M_x and M_y of foot k about the world's origin.

    Args:
        flat: The robot, placed as its encoders say.
        rules: Settings.
        state: Its `level` is the frame over the supporting sole.
        k: Which foot.
        wrench: What its ankle sensor feels, (6,).
        origin: The supporting sole in the robot's frame [m], then its x, y, cosine and
            sine in the world.
    """
    site_rotation(flat, ANKLE + k, state.sensor)
    a, b, c = turned(state.sensor, wrench)
    f_x, f_y, f_z = turned_back(state.level, a, b, c)
    a, b, c = turned(state.sensor, wrench[3:])
    m_x, m_y, _ = turned_back(state.level, a, b, c)
    a, b, c = turned(state.sensor, rules.foot_com[k])
    x, y, _ = turned_back(state.level, a, b, c)
    weight = rules.foot_weight[k]
    f_z, m_x, m_y = f_z + weight, m_x + y * weight, m_y - x * weight
    x, y, z = site_point(flat, ANKLE + k)
    x, y, z = turned_back(state.level, x - origin[0], y - origin[1], z - origin[2])
    c, s = origin[5], origin[6]
    f_x, f_y, m_x, m_y = (
        c * f_x - s * f_y,
        s * f_x + c * f_y,
        c * m_x - s * m_y,
        s * m_x + c * m_y,
    )
    x, y = origin[3] + c * x - s * y, origin[4] + s * x + c * y
    return f_z, m_x + y * f_z - z * f_y, m_y + z * f_x - x * f_z


@kernel
def _feel_edges(rules: Record, state: Record, k: int, wrench: Record) -> None:
    """Find where on sole k the ground presses; `WholeBody._feel_edges`."""
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
def _weigh(rules: Record, state: Record, reference: Record) -> None:
    """Learn what the standing robot weighs, and correct the CoM; `Weighing`."""
    heading = reference.heading
    c, s, lean = math.cos(heading), math.sin(heading), state.lean
    state.trust = 1.0
    if reference.phase == _STAND and reference.step == 0:
        heaviness = state.load / rules.weight
        if state.seen < rules.most and 0.5 < heaviness < 2.0:
            state.seen += 1
            a = 1.0 / state.seen
            x, y = state.zmp[0] - state.com[0], state.zmp[1] - state.com[1]
            state.heaviness += a * (heaviness - state.heaviness)
            lean[0] += a * (c * x + s * y - lean[0])
            lean[1] += a * (c * y - s * x - lean[1])
        state.trust = minimum_jerk((reference.time - WEIGHING_TIME) / RISE_TIME)[0]
    state.com[0] += c * lean[0] - s * lean[1]
    state.com[1] += s * lean[0] + c * lean[1]


@kernel
def _find_com(flat: Flat, state: Record, origin: Record) -> None:
    """Find the CoM that the encoders tell, over the supporting sole."""
    x = y = z = 0.0
    for k in range(len(flat.links)):
        m = flat.links[k].moment
        x, y, z = x + m[0], y + m[1], z + m[2]
    x, y, z = turned_back(state.level, x - origin[0], y - origin[1], z - origin[2])
    c, s = origin[5], origin[6]
    state.com[0], state.com[1] = origin[3] + c * x - s * y, origin[4] + s * x + c * y
    state.com[2] = z


@kernel
def _find_zmp(
    flat: Flat, rules: Record, state: Record, wrenches: Record, origin: Record
) -> None:
    """Find load and ZMP; without load, the last ZMP is kept."""
    left, a, b = _ground_force(flat, rules, state, 0, wrenches[:6], origin)
    right, c, d = _ground_force(flat, rules, state, 1, wrenches[6:], origin)
    load = state.load = left + right
    if load > _LEAST * rules.weight:
        state.left_share = min(max(left / load, 0.0), 1.0)
        state.zmp[0], state.zmp[1] = -(b + d) / load, (a + c) / load


@kernel
def measure(
    flat: Flat,
    rules: Record,
    state: Record,
    q: np.ndarray,
    felt: np.ndarray,
    reference: Record,
    b: Record,
) -> None:
    """Find CoM and ZMP as the robot senses them; `WholeBody.measure`.

    Args:
        flat: The robot.
        rules: Settings.
        state: What is found goes here.
        q: The body center at the origin, then the encoders [rad].
        felt: Both ankle wrenches (12) [N, N m], then the IMU's quaternion wxyz.
        reference: The reference.
        b: Scratch space, (7,).
    """
    place_links(flat.links, q)
    for k in range(2):
        site_rotation(flat, SOLE + k, state.soles[k])
    _feel(flat, rules, state, felt[12:])
    support = int(reference.support)
    if support != state.support:
        _change_support(flat, rules, state, reference, support)
    _level(rules, state, support, state.level)
    b[0], b[1], b[2] = site_point(flat, SOLE + support)
    b[3], b[4], yaw = foothold(state, reference, support)
    b[5], b[6] = math.cos(yaw), math.sin(yaw)
    _find_zmp(flat, rules, state, felt, b)
    for k in range(2):
        _feel_edges(rules, state, k, felt[6 * k : 6 * k + 6])
    _find_com(flat, state, b)
    state.trust = 1.0
    if rules.calibration:
        _weigh(rules, state, reference)
    state.trunk_tilt = 2.0 * math.asin(min(1.0, math.hypot(felt[13], felt[14])))
