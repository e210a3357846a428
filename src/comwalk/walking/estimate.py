"""Compiled estimate of a robot's whole motion from its encoders and IMU.

A torque needs what a position does not: where the body is and how all of it moves. The
supporting sole stands where dead reckoning has it and is at rest, the IMU says how the
body is turned and turns, and joint rates are low-passed differences of the encoders.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..control import weigh_standing
from ..embedding import (
    SLIDE,
    Flat,
    find_levers,
    move_com,
    move_links,
    move_site,
    place_links,
    rotation,
    site_point,
    site_rotation,
    turned,
)
from ..pattern import STAND
from .foot_contact import IMU, SOLE, foothold, remainder
from .measurement import find_zmp
from .records import BY_TORQUES, NOT_FELT

DRAG_RATE = 4.0
"""How fast a drag on the CoM is learnt [1/s]."""
DOUBT = 0.008
"""Distance of the CoM from the model's that torques at rest cannot tell, in CoM heights
[-]."""
LEANING_TIME = 6.0
"""Time constant in which a lasting drag is taken for a load, while walking [s]."""
SETTLING_TIME = 0.2
"""Time constant in which the velocity by the accelerometer settles on that by the
supporting sole [s]."""
FALLING_TIME = 0.5
"""Time constant in which the ground under the supporting sole is taken as that of the
plan [s]."""


@kernel
def follow_rates(
    rules: Record,
    state: Record,
    sensed: np.ndarray,
    gyro: np.ndarray,
    last: np.ndarray,
    rates: np.ndarray,
) -> None:
    """Low-pass the differences of the encoders, and the gyro.

    Args:
        rules: Its `rate_share` is the filter's coefficient.
        state: Counts the readings; after the first one the robot is at rest.
        sensed: Seven numbers, then the encoders [rad].
        gyro: Angular velocity of the IMU [rad/s], its own frame, (3,).
        last: Last readings of the encoders [rad], (joints,).
        rates: Joint rates, then the gyro's [rad/s], (joints + 3,).
    """
    n, share = len(last), rules.rate_share
    for j in range(n):
        if state.readings:
            rate = (sensed[7 + j] - last[j]) / rules.period
            rates[j] += share * (rate - rates[j])
        last[j] = sensed[7 + j]
    for i in range(3):
        rates[n + i] += share * (gyro[i] - rates[n + i])
    state.readings += 1


@kernel
def follow_tilt(
    rules: Record, state: Record, imu: np.ndarray, gyro: np.ndarray
) -> None:
    """Follow the IMU's orientation: turned by the gyro, and slowly towards the IMU.

    Args:
        rules: Its `tilt_share` is the filter's coefficient.
        state: Its `turn` is the estimate, a quaternion wxyz.
        imu: The IMU's quaternion wxyz.
        gyro: Angular velocity of the IMU [rad/s], its own frame.
    """
    turn, h, share = state.turn, 0.5 * rules.period, rules.tilt_share
    if state.readings == 1:
        share = 1.0
    w, x, y, z = turn[0], turn[1], turn[2], turn[3]
    a, b, c = h * gyro[0], h * gyro[1], h * gyro[2]
    turn[0] = w - x * a - y * b - z * c
    turn[1] = x + w * a + y * c - z * b
    turn[2] = y + w * b + z * a - x * c
    turn[3] = z + w * c + x * b - y * a
    dot = 0.0
    for i in range(4):
        dot += turn[i] * imu[i]
    sign, square = (-1.0 if dot < 0.0 else 1.0), 0.0
    for i in range(4):
        turn[i] += share * (sign * imu[i] - turn[i])
        square += turn[i] * turn[i]
    for i in range(4):
        turn[i] /= math.sqrt(square)


@kernel
def _quaternion_of(R: Record, out: np.ndarray) -> None:
    """Write a rotation as a quaternion wxyz."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        w = 0.5 * math.sqrt(1.0 + trace)
        out[0], k = w, 0.25 / w
        out[1] = k * (R[2, 1] - R[1, 2])
        out[2] = k * (R[0, 2] - R[2, 0])
        out[3] = k * (R[1, 0] - R[0, 1])
        return
    i = 0
    for n in range(1, 3):
        if R[n, n] > R[i, i]:
            i = n
    j, m = (i + 1) % 3, (i + 2) % 3
    x = 0.5 * math.sqrt(max(1.0 + R[i, i] - R[j, j] - R[m, m], 1e-12))
    k = 0.25 / x
    out[0] = k * (R[m, j] - R[j, m])
    out[1 + i] = x
    out[1 + j] = k * (R[j, i] + R[i, j])
    out[1 + m] = k * (R[m, i] + R[i, m])


@kernel
def _turn_body(flat: Flat, state: Record, imu: np.ndarray) -> None:
    """Write the body's rotation into `state.level`; its yaw is the IMU's own."""
    R, S, out = state.other, state.sensor, state.level
    rotation(imu[0], imu[1], imu[2], imu[3], R)
    site_rotation(flat, IMU, S)
    for i in range(3):
        for j in range(3):
            out[i, j] = R[i, 0] * S[j, 0] + R[i, 1] * S[j, 1] + R[i, 2] * S[j, 2]


@kernel
def _stand_on(
    flat: Flat, state: Record, reference: Record, k: int, q: np.ndarray
) -> None:
    """Write the base pose that puts sole k where it stands.

    Args:
        flat: The robot, its body center at the origin, unturned.
        state: Its `level` is how the body is turned, but for its yaw.
        reference: The reference.
        k: Which sole.
        q: Where the base pose goes.
    """
    R, turn = state.level, state.other
    site_rotation(flat, SOLE + k, state.sensor)
    ahead = (state.sensor[0, 0], state.sensor[1, 0], state.sensor[2, 0])
    x, y, _ = turned(R, ahead)
    p_x, p_y, yaw = foothold(state, reference, k)
    away = yaw - math.atan2(y, x)
    c, s = math.cos(away), math.sin(away)
    for j in range(3):
        turn[0, j] = c * R[0, j] - s * R[1, j]
        turn[1, j] = s * R[0, j] + c * R[1, j]
        turn[2, j] = R[2, j]
    x, y, z = turned(turn, site_point(flat, SOLE + k))
    q[0], q[1], q[2] = p_x - x, p_y - y, state.heights[k] - z
    _quaternion_of(turn, q[3:7])


@kernel
def _step_over(flat: Flat, state: Record, reference: Record, new: int) -> None:
    """Find where the new supporting sole stands, the robot placed by the old one."""
    x, y, z = site_point(flat, SOLE + new)
    site_rotation(flat, SOLE + new, state.sensor)
    yaw = math.atan2(state.sensor[1, 0], state.sensor[0, 0])
    foot, away = reference.feet[new], state.offsets[new]
    away[0], away[1] = x - foot.position[0], y - foot.position[1]
    away[2] = remainder(yaw - foot.yaw)
    state.heights[new] = z
    state.support = new


@kernel
def estimate_posture(
    flat: Flat,
    rules: Record,
    state: Record,
    sensed: np.ndarray,
    imu: np.ndarray,
    reference: Record,
    q: np.ndarray,
) -> None:
    """Find the configuration, and place the links there.

    Args:
        flat: The robot.
        rules: Settings.
        state: Where the soles stand; `support` follows the reference.
        sensed: The body center at the origin, then the encoders [rad].
        imu: The IMU's orientation, a quaternion wxyz.
        reference: The reference.
        q: Where the configuration goes, (7 + joints,).
    """
    place_links(flat.links, sensed)
    _turn_body(flat, state, imu)
    _stand_on(flat, state, reference, state.support, q)
    for j in range(7, len(q)):
        q[j] = sensed[j]
    support = int(reference.support)
    state.heights[support] *= 1.0 - rules.period / FALLING_TIME
    if support != state.support:
        place_links(flat.links, q)
        _step_over(flat, state, reference, support)
        place_links(flat.links, sensed)
        _stand_on(flat, state, reference, support, q)
    place_links(flat.links, q)


@kernel
def estimate_velocity(
    flat: Flat,
    bodies: np.ndarray,
    state: Record,
    gyro: np.ndarray,
    rates: np.ndarray,
    v: np.ndarray,
) -> None:
    """Find the velocity, by the gyro and the supporting sole, which is at rest.

    Args:
        flat: The robot, placed.
        bodies: Its links, which get their velocities.
        state: Its `support` is the sole.
        gyro: Angular velocity of the IMU [rad/s], its own frame, (3,).
        rates: Joint rates [rad/s], (joints,).
        v: Where [xdot_o; qdot] goes [m/s, rad/s], world, (6 + joints,).
    """
    links = flat.links
    site_rotation(flat, IMU, state.sensor)
    w = turned(state.sensor, gyro)
    for i in range(3):
        v[i], v[3 + i] = 0.0, w[i]
    for j in range(len(v) - 6):
        v[6 + j] = rates[j]
    k = flat.sites[IMU].link
    while k > 0:
        if links[k].kind != SLIDE:
            for i in range(3):
                v[3 + i] -= links[k].a[i] * rates[k - 1]
        k = links[k].parent
    move_links(flat, bodies, v)
    move_site(flat, bodies, SOLE + state.support, state.twist, state.drift)
    for i in range(3):
        v[i] = -state.twist[i]
        for n in range(len(bodies)):
            bodies[n].velocity[i] += v[i]


@kernel
def _follow_com(rules: Record, state: Record) -> None:
    """Follow the CoM's velocity: by what was asked for, and slowly what joints say.

    Joints sense it with noise and late, so that what is foreseen passes their filter
    before both are compared. What lasts of their difference is a drag, such as that of
    friction that is not known, which the next acceleration makes up for.
    """
    for i in range(3):
        correction = rules.com_share * (state.seen_velocity[i] - state.slow_velocity[i])
        if i < 2:
            state.drag[i] += DRAG_RATE * correction
        asked = rules.period * (state.com_asked[i] + state.drag[i])
        state.com_velocity[i] += asked + correction
        slow = state.com_velocity[i] - state.slow_velocity[i]
        state.slow_velocity[i] += rules.rate_share * slow


@kernel
def _follow_imu(
    flat: Flat, bodies: np.ndarray, rules: Record, state: Record, acc: np.ndarray
) -> None:
    """Follow the CoM's velocity by the accelerometer, for what is sudden.

    How fast the CoM moves against the IMU is known of the joints and the gyro; how fast
    the IMU moves only as far as the supporting sole is at rest, which it is not while
    it rolls over its edge.
    """
    move_site(flat, bodies, IMU, state.twist, state.drift)
    site_rotation(flat, IMU, state.sensor)
    a = turned(state.sensor, acc)
    share = rules.period / SETTLING_TIME
    for i in range(3):
        rate = a[i] - (rules.gravity if i == 2 else 0.0)
        away = state.twist[i] - state.imu_velocity[i]
        state.imu_velocity[i] += rules.period * rate + share * away
        known = state.seen_velocity[i] - state.twist[i]
        state.swift_velocity[i] = known + state.imu_velocity[i]


@kernel
def stand_upright(
    flat: Flat, state: Record, sensed: np.ndarray, imu: np.ndarray, q: np.ndarray
) -> None:
    """Place the links as the IMU says the body is turned, its centre at the origin.

    Args:
        flat: The robot.
        state: Scratch.
        sensed: The body center at the origin, then the encoders [rad].
        imu: The IMU's orientation, a quaternion wxyz.
        q: Where the configuration goes, (7 + joints,).
    """
    place_links(flat.links, sensed)
    _turn_body(flat, state, imu)
    for j in range(len(q)):
        q[j] = sensed[j]
    _quaternion_of(state.level, q[3:7])
    place_links(flat.links, q)


@kernel
def _doubt(rules: Record, lean: Record) -> None:
    """Take from a lean what the friction of joints at rest may have feigned."""
    length, doubt = math.hypot(lean[0], lean[1]), DOUBT * rules.com_height
    share = max(length - doubt, 0.0) / max(length, 1e-9)
    lean[0], lean[1] = share * lean[0], share * lean[1]


@kernel
def _weigh_walking(rules: Record, state: Record, reference: Record) -> None:
    """Learn from the ZMP, over whole steps, how far the CoM is from the model's.

    The law would double what is left of a lean, as of one that it stands with.
    """
    c, s, lean = math.cos(reference.heading), math.sin(reference.heading), state.lean
    share, arm = rules.period / LEANING_TIME, rules.com_height / rules.gravity
    x = state.zmp[0] - state.com[0] + arm * (state.com_asked[0] + state.drag[0])
    y = state.zmp[1] - state.com[1] + arm * (state.com_asked[1] + state.drag[1])
    lean[0] += share * (c * x + s * y)
    lean[1] += share * (c * y - s * x)


@kernel
def estimate(
    flat: Flat,
    bodies: np.ndarray,
    rules: Record,
    state: Record,
    felt: np.ndarray,
    reference: Record,
) -> None:
    """Find CoM and ZMP as the robot senses them.

    Args:
        flat: The robot, placed; it gets its levers.
        bodies: Its links, with their velocities.
        rules: Settings.
        state: What is found goes here.
        felt: Both ankle wrenches (12) [N, N m], then the IMU's quaternion wxyz.
        reference: The reference.
    """
    move_com(flat, bodies, state.seen_velocity, state.com_bias)
    _follow_imu(flat, bodies, rules, state, felt[19:22])
    level, origin = state.level, state.origin
    for i in range(3):
        for j in range(3):
            level[i, j] = 1.0 if i == j else 0.0
    for i in range(7):
        origin[i] = 1.0 if i == 5 else 0.0
    find_zmp(flat, rules, state, felt, origin)
    find_levers(flat)
    com = flat.links[0].moment
    state.com[0], state.com[1] = com[0], com[1]
    state.com[2] = com[2] - state.heights[state.support]
    _follow_com(rules, state)
    state.feedback_scale = 1.0
    if rules.calibration:
        weigh_standing(rules, state, reference)
        if state.readings == 1 and rules.sensing == BY_TORQUES:
            _doubt(rules, state.lean)
        if reference.phase != STAND and rules.sensing != NOT_FELT:
            _weigh_walking(rules, state, reference)
    state.trunk_tilt = 2.0 * math.asin(min(1.0, math.hypot(felt[13], felt[14])))
