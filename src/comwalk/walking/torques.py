r"""From the law's CoM velocity to the torques of all joints.

The inner loop of Fig. 4 for a robot that is commanded by torque. A velocity servo makes
the CoM follow the law,

.. math::
    \ddot c^* = \ddot c_d + k_v (u - \dot c), \quad
    p^* = c - (1 + \kappa) \frac{c_z}{g + \ddot c_z^*} \ddot c^* + p_L

with p^* held inside the soles. kappa is that of `robot.dynamics.sway_inertia`; p_L is
what the links' turning adds beside it, mostly the swing leg's, low-passed. Trunk, feet
and all else get the accelerations that hold them on their references. They are resolved
by the equations of the velocities, (14) to (27), one derivative higher; Newton and
Euler give the torques.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..embedding import (
    SOLVED,
    Flat,
    move_site,
    resolve_limb,
    site_point,
    site_rotation,
    turn_to_level,
)
from ..pattern import LEFT_ALONE, RIGHT_ALONE
from .action import push_on
from .foot_contact import foothold
from .records import NOT_FELT
from .wrench_estimate import friction_of

TRUNK_SHARE = 0.5
"""How fast the trunk is brought back, as a share of all else: noise of its gyro shakes
the heaviest link [-]."""
LANDING_LOAD, LETTING_GO = 0.12, 0.04
"""Shares of the weight by which a sinking foot is felt to land, and to have lifted
again [-]."""
FEELING_TIME = 0.015
"""Time constant of the low-pass on the feet's loads for that [s]."""
SOLE_SHARE = 0.9
"""Share of the soles that the ZMP asked for may use [-]."""
STRAYING_TIME = 0.02
"""Time constant in which the ZMP of the links' turning is followed [s]."""


@kernel
def _support(reference: Record) -> tuple[bool, bool]:
    """Return whether the left and the right foot are to bear the robot."""
    phase = reference.phase
    return phase != RIGHT_ALONE, phase != LEFT_ALONE


@kernel
def feel_landing(rules: Record, state: Record, reference: Record) -> None:
    """Find which feet are on the ground: a sinking one from when it is felt to bear.

    Args:
        rules: Settings.
        state: Its load, low-passed, tells; `landed` is written.
        reference: The reference.
    """
    left, right = _support(reference)
    for k in range(2):
        share = state.left_share if k == 0 else 1.0 - state.left_share
        load = share * state.load / rules.weight
        state.pressed[k] += rules.period / FEELING_TIME * (load - state.pressed[k])
        least = LETTING_GO if state.landed[k] else LANDING_LOAD
        sinks = reference.feet[k].velocity[2] < 0.0 and rules.sensing != NOT_FELT
        bears = left if k == 0 else right
        state.landed[k] = bears or (sinks and state.pressed[k] > least)


@kernel
def _sole_box(
    rules: Record, reference: Record, share: float
) -> tuple[float, float, float, float]:
    """Return cosine and sine of the yaw, half length and width of the nearer sole."""
    k = 0 if share >= 0.5 else 1
    yaw, half = reference.feet[k].yaw, rules.sole_half[k]
    return math.cos(yaw), math.sin(yaw), SOLE_SHARE * half[0], SOLE_SHARE * half[1]


@kernel
def _within(
    x: float, way: float, half: float, low: float, high: float
) -> tuple[float, float]:
    """Return between which shares s, low and high, x - s way is in [-half, half]."""
    if abs(way) < 1e-9:
        return low, high
    one, other = (x - half) / way, (x + half) / way
    return max(low, min(one, other)), min(high, max(one, other))


@kernel
def hold_in_soles(
    flat: Flat, rules: Record, reference: Record, x: float, y: float
) -> tuple[float, float, float, float, float]:
    """Return a point of the support near a point, and how both soles make it.

    The support is taken as the boxes of both soles and all between them, with the axes
    of the foot that is nearer. Inside it, a point stays where it is.

    Returns:
        The point, x and y [m], world; the share of the left foot [-]; and where each
        sole presses from its centre, x and y [m], world.
    """
    left, right = _support(reference)
    a, b, _ = site_point(flat, flat.limbs[0].site)
    c, d, _ = site_point(flat, flat.limbs[1].site)
    share, e, f = 1.0 if left else 0.0, a - c, b - d
    if left and right:
        share = min(max(((x - c) * e + (y - d) * f) / (e * e + f * f), 0.0), 1.0)
        C, S, h, w = _sole_box(rules, reference, share)
        u, v = C * (x - c) + S * (y - d), C * (y - d) - S * (x - c)
        low, high = _within(u, C * e + S * f, h, 0.0, 1.0)
        low, high = _within(v, C * f - S * e, w, low, high)
        share = min(max(share, low), high) if low <= high else 0.5 * (low + high)
        share = min(max(share, 0.0), 1.0)
    C, S, h, w = _sole_box(rules, reference, share)
    o_x, o_y = share * a + (1.0 - share) * c, share * b + (1.0 - share) * d
    u, v = C * (x - o_x) + S * (y - o_y), C * (y - o_y) - S * (x - o_x)
    u, v = min(max(u, -h), h), min(max(v, -w), w)
    r_x, r_y = C * u - S * v, S * u + C * v
    return o_x + r_x, o_y + r_y, share, r_x, r_y


@kernel
def _arm(rules: Record, com: np.ndarray, lift: float) -> float:
    """Return by how much an acceleration of the CoM moves the ZMP back [s^2]."""
    return (1.0 + rules.sway) * com[2] / (rules.gravity + lift)


@kernel
def _want_com(
    flat: Flat, rules: Record, state: Record, law: Record, wanted: Record, ref: Record
) -> None:
    """Write the CoM's acceleration, its ZMP held inside the soles."""
    W, k_v, c = rules.bandwidth, rules.com_servo, state.com
    lift = W * W * (ref.com[2] - c[2]) + ref.com_acceleration[2]
    lift += 2.0 * W * (ref.com_velocity[2] - state.com_velocity[2])
    lift = min(max(lift, -0.5 * rules.gravity), 0.5 * rules.gravity)
    arm, stray = _arm(rules, c, lift), state.stray
    a_x = ref.com_acceleration[0] + k_v * (law.u[0] - state.com_velocity[0])
    a_y = ref.com_acceleration[1] + k_v * (law.u[1] - state.com_velocity[1])
    a_x, a_y = a_x - state.drag[0], a_y - state.drag[1]
    p_x, p_y = c[0] - arm * a_x + stray[0], c[1] - arm * a_y + stray[1]
    x, y, state.share, _, _ = hold_in_soles(flat, rules, ref, p_x, p_y)
    state.shifted = math.hypot(x - p_x, y - p_y)
    asked = state.com_asked
    asked[0], asked[1] = (c[0] + stray[0] - x) / arm, (c[1] + stray[1] - y) / arm
    asked[2] = lift
    for i in range(3):
        wanted.com[i] = asked[i] - state.com_bias[i]


@kernel
def _keep_within_reach(
    flat: Flat, bodies: np.ndarray, rules: Record, k: int, yaw: float, goal: np.ndarray
) -> bool:
    """Bring the goal of foot k nearer to its hip, if the leg is too short for it.

    Args:
        flat: The robot, placed.
        bodies: Its links, with their velocities.
        rules: Settings.
        k: The foot.
        yaw: Its heading [rad].
        goal: Position of its sole [m] and velocity [m/s], world, which change.

    Returns:
        Whether the leg reaches it.
    """
    n, arm = rules.hip[k], rules.ankle[k]
    hip, speed = flat.links[n].p, bodies[n].velocity
    c, s = math.cos(yaw), math.sin(yaw)
    x = goal[0] + c * arm[0] - s * arm[1] - hip[0]
    y = goal[1] + s * arm[0] + c * arm[1] - hip[1]
    z = goal[2] + arm[2] - hip[2]
    far = math.sqrt(x * x + y * y + z * z)
    if far <= rules.reach[k]:
        return True
    x, y, z, over = x / far, y / far, z / far, far - rules.reach[k]
    u, v, w = goal[3] - speed[0], goal[4] - speed[1], goal[5] - speed[2]
    out = max(u * x + v * y + w * z, 0.0)
    goal[0], goal[3] = goal[0] - over * x, goal[3] - out * x
    goal[1], goal[4] = goal[1] - over * y, goal[4] - out * y
    goal[2], goal[5] = goal[2] - over * z, goal[5] - out * z
    return False


@kernel
def _want_foot(
    flat: Flat,
    bodies: np.ndarray,
    rules: Record,
    state: Record,
    ref: Record,
    k: int,
) -> None:
    """Write the acceleration of foot k: to rest, or along its path."""
    limb, foot, W = flat.limbs[k], ref.feet[k], rules.bandwidth
    twist, drift, out, away = state.twist, state.drift, limb.twist, state.away
    move_site(flat, bodies, limb.site, twist, drift)
    if state.landed[k]:
        for i in range(6):
            out[i] = -W * twist[i] - drift[i]
        return
    goal = state.goal
    goal[0], goal[1], yaw_d = foothold(state, ref, k)
    goal[2] = foot.position[2] + state.heights[1 - k]
    for i in range(3):
        goal[3 + i] = foot.velocity[i]
    within = _keep_within_reach(flat, bodies, rules, k, yaw_d, goal)
    x, y, z = site_point(flat, limb.site)
    site_rotation(flat, limb.site, state.sensor)
    away[0], away[1], away[2] = goal[0] - x, goal[1] - y, goal[2] - z
    away[3], away[4], away[5] = turn_to_level(yaw_d, state.sensor, state.other)
    for i in range(6):
        out[i] = W * W * away[i] - 2.0 * W * twist[i] - drift[i]
    for i in range(3):
        out[i] += 2.0 * W * goal[3 + i] + (foot.acceleration[i] if within else 0.0)
    out[5] += foot.yaw_acceleration + 2.0 * W * foot.yaw_rate


@kernel
def want_accelerations(
    flat: Flat,
    bodies: np.ndarray,
    rules: Record,
    state: Record,
    law: Record,
    wanted: Record,
    joints: np.ndarray,
    moved: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    reference: Record,
) -> None:
    """Write the task of a tick, less what happens while velocities are constant.

    Args:
        flat: The robot as it is estimated to be, with its levers.
        bodies: Its links, with their velocities.
        rules: Settings.
        state: What was estimated.
        law: What the law says, a record of `LAW_STATE`.
        wanted: CoM's and trunk's accelerations go here, all else to the robot.
        joints: Servos and limits, with the embedded motion.
        moved: The joints that it moves.
        q: The configuration.
        v: The velocity.
        reference: The reference.
    """
    W, W_o = rules.bandwidth, TRUNK_SHARE * rules.bandwidth
    _want_com(flat, rules, state, law, wanted, reference)
    x, y, z = turn_to_level(reference.heading, flat.links[0].R, state.other)
    wanted.trunk[0] = W_o * W_o * x - 2.0 * W_o * v[3]
    wanted.trunk[1] = W_o * W_o * y - 2.0 * W_o * v[4]
    wanted.trunk[2] = W_o * W_o * z + 2.0 * W_o * (reference.heading_rate - v[5])
    for k in range(2):
        _want_foot(flat, bodies, rules, state, reference, k)
    for j in range(len(joints)):
        flat.links[1 + j].desired_rate = (
            W * W * (joints[j].home - q[7 + j]) - 2.0 * W * v[6 + j]
        )
    for i in range(len(moved)):
        j = moved[i]
        joint = joints[j]
        flat.links[1 + j].desired_rate = (
            joint.dance_acceleration
            + W * W * (joint.dance - q[7 + j])
            + 2.0 * W * (joint.dance_rate - v[6 + j])
        )
    for k in range(2):
        for n in range(flat.limbs[k].own):
            flat.links[flat.limbs[k].chain[n]].desired_rate = 0.0


@kernel
def aim_joints(
    flat: Flat,
    bodies: np.ndarray,
    rules: Record,
    state: Record,
    wanted: Record,
    joints: np.ndarray,
    moved: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    reference: Record,
    out: np.ndarray,
    speeds: np.ndarray,
) -> None:
    """Write where each joint is to be, and how fast, for its own gains to hold it.

    The legs that bear the robot are left where they are, so that torque alone moves it.
    The swing leg goes to where its foot is to be while the body stays where it is:
    against friction, the gains of light joints do more than their inertia times an
    acceleration.

    Args:
        flat: The robot, placed.
        bodies: Its links, with their velocities.
        rules: Settings.
        state: What was estimated; its `away` is the error of the swing foot.
        wanted: Scratch.
        joints: The robot's joints, with the embedded motion.
        moved: The joints that it moves.
        q: The configuration.
        v: The velocity.
        a: Its rate.
        reference: The reference.
        out: Set-points of the joints [rad].
        speeds: Set-points of their rates [rad/s].
    """
    for j in range(len(joints)):
        out[j], speeds[j] = joints[j].home, 0.0
        if flat.links[1 + j].leader:
            out[j], speeds[j] = q[7 + j], v[6 + j]
    for i in range(len(moved)):
        j = moved[i]
        out[j], speeds[j] = joints[j].dance, joints[j].dance_rate
    for k in range(2):
        limb = flat.limbs[k]
        for n in range(limb.own):
            j = limb.chain[n] - 1
            out[j], speeds[j] = q[7 + j], v[6 + j] + rules.period * a[6 + j]
        if not state.landed[k]:
            _aim_foot(flat, bodies, state, wanted, limb, reference.feet[k], out, speeds)
            for n in range(limb.own):
                j = limb.chain[n] - 1
                _keep_to_limits(joints[j], out, speeds, j)


@kernel
def _keep_to_limits(joint: Record, out: np.ndarray, speeds: np.ndarray, j: int) -> None:
    """Keep a set-point within the joint's limits, and its rate from leaving them."""
    if out[j] > joint.upper:
        out[j], speeds[j] = joint.upper, min(speeds[j], 0.0)
    if out[j] < joint.lower:
        out[j], speeds[j] = joint.lower, max(speeds[j], 0.0)


@kernel
def _aim_foot(
    flat: Flat,
    bodies: np.ndarray,
    state: Record,
    wanted: Record,
    limb: Record,
    foot: Record,
    out: np.ndarray,
    speeds: np.ndarray,
) -> None:
    """Write where the joints of a swinging leg are to be, unless it is singular."""
    asked, twist, rest = state.twist, limb.twist, state.drift
    for i in range(6):
        asked[i], twist[i], rest[i] = twist[i], state.away[i], 0.0
    trunk = (wanted.trunk[0], wanted.trunk[1], wanted.trunk[2])
    if resolve_limb(flat, limb, wanted, rest[:3], rest[3:]) == SOLVED:
        for n in range(limb.own):
            out[limb.chain[n] - 1] += flat.links[limb.chain[n]].rate
        for i in range(3):
            twist[i], twist[3 + i] = foot.velocity[i], 0.0
        twist[5] = foot.yaw_rate
        resolve_limb(flat, limb, wanted, bodies[0].velocity, bodies[0].spin)
        for n in range(limb.own):
            speeds[limb.chain[n] - 1] = flat.links[limb.chain[n]].rate
    for i in range(6):  # the task of the tick is left as it was
        twist[i] = asked[i]
    for i in range(3):
        wanted.trunk[i] = trunk[i]


@kernel
def zmp_of_motion(
    flat: Flat, state: Record, reference: Record, t: np.ndarray
) -> tuple[float, float]:
    """Return the ZMP that a motion asks for, with the load, x and y [m], world.

    Args:
        flat: The robot, placed.
        state: The share of its feet, and the load that it was weighed with.
        reference: The reference.
        t: Generalised forces of the motion, `dynamics.load_links`.
    """
    p, share = flat.links[0].p, state.share
    ground = share * site_point(flat, flat.limbs[0].site)[2]
    ground += (1.0 - share) * site_point(flat, flat.limbs[1].site)[2]
    lift, lean, f_z = p[2] - ground, state.lean, max(t[2], 1.0)
    c, s = math.cos(reference.heading), math.sin(reference.heading)
    x = p[0] - (t[4] + lift * t[0]) / f_z + c * lean[0] - s * lean[1]
    return x, p[1] + (t[3] - lift * t[1]) / f_z + s * lean[0] + c * lean[1]


@kernel
def bear_on_soles(
    flat: Flat,
    rules: Record,
    state: Record,
    reference: Record,
    t: np.ndarray,
    joints: np.ndarray,
) -> None:
    """Write the torques of a motion whose wrench the ground bears, within limits.

    Args:
        flat: The robot, placed.
        rules: Settings.
        state: The load that it was weighed with; what is given up goes here.
        reference: The reference.
        t: Generalised forces of the motion, `dynamics.load_links`.
        joints: Where the torques go.
    """
    p, ratio = flat.links[0].p, state.mass_ratio
    f_x, f_y, f_z = ratio * t[0], ratio * t[1], max(ratio * t[2], 1.0)
    zmp_x, zmp_y = zmp_of_motion(flat, state, reference, t)
    _follow_stray(rules, state, zmp_x, zmp_y)
    x, y, share, r_x, r_y = hold_in_soles(flat, rules, reference, zmp_x, zmp_y)
    state.shifted = max(state.shifted, math.hypot(x - zmp_x, y - zmp_y))
    m_z = ratio * t[5] - (x - p[0]) * f_y + (y - p[1]) * f_x
    slip, most = math.hypot(f_x, f_y), rules.grip * f_z
    state.slid = max(slip - most, 0.0)
    if slip > most:
        f_x, f_y = f_x * most / slip, f_y * most / slip
    for j in range(len(joints)):
        joints[j].torque = t[6 + j]
    wrench = (f_x, f_y, f_z, r_y * f_z, -r_x * f_z, m_z + r_x * f_y - r_y * f_x)
    push_on(flat, 0, wrench, share, joints)
    push_on(flat, 1, wrench, 1.0 - share, joints)


@kernel
def _follow_stray(rules: Record, state: Record, x: float, y: float) -> None:
    """Low-pass what the links' turning adds to the ZMP besides the legs' swaying."""
    asked, c, stray = state.com_asked, state.com, state.stray
    arm = _arm(rules, c, asked[2])
    share = rules.period / (rules.period + STRAYING_TIME)
    stray[0] += share * (x - c[0] + arm * asked[0] - stray[0])
    stray[1] += share * (y - c[1] + arm * asked[1] - stray[1])


@kernel
def limit_torques(
    state: Record, joints: np.ndarray, speeds: np.ndarray, torques: np.ndarray
) -> None:
    """Write the torques of the motors: with the friction that is known, within limits.

    Args:
        state: Its `weak` counts the joints at their limits.
        joints: Torques, friction and limits.
        speeds: Set-points of the joints' rates [rad/s].
        torques: Where they go [N m].
    """
    state.weak = 0
    for j in range(len(joints)):
        joint = joints[j]
        torque = joint.torque + friction_of(joint, speeds[j])
        torques[j] = min(max(torque, -joint.most), joint.most)
        state.weak += torques[j] != torque
