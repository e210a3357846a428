"""From the law's CoM velocity to the set-points of all joints.

`want` writes the task that the resolution solves: CoM, trunk, both feet and the
embedded motion. `set_points` turns what it found into set-points, which ask of each
servo the torque that `plan_torques` foresees: so a loaded joint stands where it should.
"""

from __future__ import annotations

import numpy as np

from ..compiled import Record, kernel
from ..embedding import (
    SLIDE,
    Flat,
    blended,
    find_segment,
    find_weight,
    site_point,
    site_rotation,
    turn_to_level,
)
from .foot_contact import follow_ground, foothold, planned_share, untilt

RECKONING = 5.0
"""Feedback of the supporting foot to its dead reckoning [1/s]: slow, since each
correction moves the whole body."""


# ---- The feet ---------------------------------------------------------------------


@kernel
def _foot_twist(
    flat: Flat, rules: Record, state: Record, reference: Record, k: int
) -> None:
    """Write the wanted twist of foot k: its reference's, and feedback to its pose."""
    limb, foot, K = flat.limbs[k], reference.feet[k], rules.feedback
    x_d, y_d, yaw_d = foothold(state, reference, k)
    z_d = foot.position[2] + state.heights[k]
    x, y, z = site_point(flat, limb.site)
    R = state.sensor
    site_rotation(flat, limb.site, R)
    if rules.imu:
        untilt(R, state.leans[k, 0], state.leans[k, 1], state.other)
        R = state.other
    e_x, e_y, e_z = turn_to_level(yaw_d, R, state.level)
    K_p = min(K, RECKONING) if k == int(reference.support) else K
    twist = limb.twist
    twist[0] = foot.velocity[0] + K_p * (x_d - x)
    twist[1] = foot.velocity[1] + K_p * (y_d - y)
    twist[2] = foot.velocity[2] + K * (z_d - z)
    twist[3], twist[4] = K * e_x, K * e_y
    twist[5] = foot.yaw_rate + K_p * e_z


# ---- The dance --------------------------------------------------------------------


@kernel
def dance_at(
    dance: Record,
    moved: np.ndarray,
    knots: np.ndarray,
    cubics: np.ndarray,
    joints: np.ndarray,
    t: float,
) -> None:
    """Write how the embedded motion moves its joints at a time [s]."""
    k, s, moves = find_segment(knots, dance.loops, t - dance.start)
    weight = find_weight(dance, t)
    m = len(moved)
    for i in range(m):
        joint, c = joints[moved[i]], cubics[4 * m * k + i : 4 * m * (k + 1) : m]
        q, dq, ddq = blended(c, s, moves, joint.home, weight)
        joint.dance, joint.dance_rate, joint.dance_acceleration = q, dq, ddq


# ---- What is wanted ---------------------------------------------------------------


@kernel
def want(
    flat: Flat,
    rules: Record,
    state: Record,
    law: Record,
    wanted: Record,
    joints: np.ndarray,
    moved: np.ndarray,
    q: np.ndarray,
    reference: Record,
) -> None:
    """Write the task of a tick: CoM velocity, trunk rate, twists of the feet, rates.

    Args:
        flat: The robot at the commanded configuration, with its levers.
        rules: Settings.
        state: What was measured; the feet then follow it.
        law: What the law says, a record of `LAW_STATE`.
        wanted: CoM velocity and trunk rate go here, twists and rates to the robot.
        joints: Servos and limits, with the angles of the embedded motion.
        moved: The joints that it moves.
        q: The commanded configuration.
        reference: The reference.
    """
    K, com = rules.feedback, flat.links[0].moment
    for i in range(2):
        wanted.com[i] = K * (law.com_command[i] - com[i]) + law.u[i]
    wanted.com[2] = K * (reference.com[2] - com[2])
    x, y, z = turn_to_level(reference.heading, flat.links[0].R, state.level)
    wanted.trunk[0], wanted.trunk[1] = K * x, K * y
    wanted.trunk[2] = K * z + reference.heading_rate
    for k in range(2):
        _foot_twist(flat, rules, state, reference, k)
    follow_ground(rules, state, law, reference)
    for j in range(len(joints)):
        flat.links[1 + j].desired_rate = K * (joints[j].home - q[7 + j])
    if rules.embed:
        for i in range(len(moved)):
            j = moved[i]
            joint = joints[j]
            flat.links[1 + j].desired_rate = (
                K * (joint.dance - q[7 + j]) + joint.dance_rate
            )
    for k in range(2):
        for n in range(flat.limbs[k].own):
            flat.links[flat.limbs[k].chain[n]].desired_rate = 0.0


@kernel
def keeps_limits(
    rules: Record,
    joints: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    resolved: np.ndarray,
) -> bool:
    """Return whether what was resolved is within limits; `WholeBody._limits`.

    Args:
        rules: Settings.
        joints: Limits.
        q: The configuration.
        v: The velocity, which accelerations bring within the limits of rates.
        resolved: Rates [rad/s], or accelerations [rad/s^2] of torques.
    """
    for j in range(len(joints)):
        low, high = room_of(rules, joints[j], q[7 + j], v[6 + j])
        if resolved[6 + j] < low or resolved[6 + j] > high:
            return False
    return True


@kernel
def room_of(
    rules: Record, joint: Record, angle: float, rate: float
) -> tuple[float, float]:
    """Return the least and greatest rate [rad/s], or acceleration, of a joint."""
    K = 0.2 / rules.period
    low = max(K * (joint.lower - angle), -joint.speed)
    high = min(K * (joint.upper - angle), joint.speed)
    if rules.by_torque:
        return 2.0 * K * (low - rate), 2.0 * K * (high - rate)
    return low, high


# ---- The set-points ---------------------------------------------------------------


@kernel
def push_on(
    flat: Flat, k: int, wrench: tuple, share: float, joints: np.ndarray
) -> None:
    """Take away the torques of a share of the ground's wrench at the end of limb k."""
    f_x, f_y, f_z, m_x, m_y, m_z = wrench
    limb = flat.limbs[k]
    x, y, z = site_point(flat, limb.site)
    for n in range(limb.chain_length):
        link = flat.links[limb.chain[n]]
        a, p = link.a, link.p
        if link.kind == SLIDE:
            torque = a[0] * f_x + a[1] * f_y + a[2] * f_z
        else:
            u, v, w = x - p[0], y - p[1], z - p[2]
            torque = (
                a[0] * (m_x + v * f_z - w * f_y)
                + a[1] * (m_y + w * f_x - u * f_z)
                + a[2] * (m_z + u * f_y - v * f_x)
            )
        joints[limb.chain[n] - 1].torque -= share * torque


@kernel
def plan_torques(
    flat: Flat, rules: Record, reference: Record, joints: np.ndarray
) -> None:
    """Write the planned torque of each joint [N m].

    As the whole body is taken to accelerate like its CoM, what carries it is the lever
    of each joint times the force on the CoM.
    """
    links, m = flat.links, rules.mass
    f_x, f_y = m * reference.com_acceleration[0], m * reference.com_acceleration[1]
    f_z = m * (reference.com_acceleration[2] + rules.gravity)
    for j in range(len(joints)):
        lever = links[1 + j].lever
        joints[j].torque = lever[0] * f_x + lever[1] * f_y + lever[2] * f_z
    load = planned_share(reference)
    x_l, y_l, _ = site_point(flat, flat.limbs[0].site)
    x_r, y_r, _ = site_point(flat, flat.limbs[1].site)
    x = reference.zmp[0] - load * x_l - (1.0 - load) * x_r
    y = reference.zmp[1] - load * y_l - (1.0 - load) * y_r
    wrench = (f_x, f_y, f_z, y * f_z, -x * f_z, x * f_y - y * f_x)
    push_on(flat, 0, wrench, load, joints)
    push_on(flat, 1, wrench, 1.0 - load, joints)
    for j in range(len(joints) - 1, -1, -1):
        leader = links[1 + j].leader
        if leader:
            joints[leader - 1].torque += links[1 + j].ratio * joints[j].torque
            joints[j].torque = 0.0


@kernel
def set_points(
    rules: Record,
    state: Record,
    joints: np.ndarray,
    moved: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the set-points of all joints [rad]; rules, state and joints are read."""
    for j in range(len(joints)):
        out[j] = q[7 + j]
        if rules.compensate and not rules.by_torque:
            joint = joints[j]
            load = joint.torque * state.mass_ratio + joint.damping * v[6 + j]
            out[j] += load / joint.stiffness
    if not rules.embed:
        for i in range(len(moved)):
            out[moved[i]] = joints[moved[i]].dance
