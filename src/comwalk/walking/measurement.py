"""Compiled measurement: from encoders, ankle wrenches and IMU to CoM and ZMP.

Fig. 4's feedback: the CoM by kinematics over the supporting sole, the ZMP by
`control.sensing`, the tilt of the soles by `foot_contact`.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..control import weigh_standing
from ..embedding import Flat, place_links, site_point, site_rotation, turned
from .foot_contact import (
    ANKLE,
    LEAST_LOAD,
    SOLE,
    change_support,
    feel_edges,
    feel_tilt,
    foothold,
    level_frame,
    turned_back,
)


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
def _find_com(flat: Flat, state: Record, origin: Record) -> None:
    """Find the CoM from the encoders, over the supporting sole."""
    x = y = z = 0.0
    for k in range(len(flat.links)):
        m = flat.links[k].moment
        x, y, z = x + m[0], y + m[1], z + m[2]
    x, y, z = turned_back(state.level, x - origin[0], y - origin[1], z - origin[2])
    c, s = origin[5], origin[6]
    state.com[0], state.com[1] = origin[3] + c * x - s * y, origin[4] + s * x + c * y
    state.com[2] = z


@kernel
def find_zmp(
    flat: Flat, rules: Record, state: Record, wrenches: Record, origin: Record
) -> None:
    """Find load and ZMP; without load, the last ZMP is kept."""
    left, a, b = _ground_force(flat, rules, state, 0, wrenches[:6], origin)
    right, c, d = _ground_force(flat, rules, state, 1, wrenches[6:], origin)
    load = state.load = left + right
    if load > LEAST_LOAD * rules.weight:
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
    feel_tilt(flat, rules, state, felt[12:])
    support = int(reference.support)
    if support != state.support:
        change_support(flat, rules, state, reference, support)
    level_frame(rules, state, support, state.level)
    b[0], b[1], b[2] = site_point(flat, SOLE + support)
    b[3], b[4], yaw = foothold(state, reference, support)
    b[5], b[6] = math.cos(yaw), math.sin(yaw)
    find_zmp(flat, rules, state, felt, b)
    for k in range(2):
        feel_edges(rules, state, k, felt[6 * k : 6 * k + 6])
    _find_com(flat, state, b)
    state.feedback_scale = 1.0
    if rules.calibration:
        weigh_standing(rules, state, reference)
    state.trunk_tilt = 2.0 * math.asin(min(1.0, math.hypot(felt[13], felt[14])))
