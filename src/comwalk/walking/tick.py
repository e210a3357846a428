"""One control period as kernels: look up, measure, guard, apply the law, act.

All that a period reads and writes lies in the arrays of one handle, in the order of
`Arrays`, so that a call from Python costs one argument.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import Record, kernel
from ..control import (
    GUARD,
    LAW,
    LAW_STATE,
    WALKS,
    WATCH,
    apply_law,
    check_fall,
    check_sensors,
)
from ..embedding import (
    BODY,
    DANCE,
    SOLVED,
    Flat,
    accelerate_links,
    find_levers,
    flat_at,
    integrate,
    load_links,
    place_links,
    resolve,
    wanted_at,
)
from ..handles import floats_at, inlined, records_at
from ..pattern import PHASE, REFERENCE, fill_reference
from .action import dance_at, keeps_limits, plan_torques, set_points, want
from .estimate import (
    estimate,
    estimate_posture,
    estimate_velocity,
    follow_rates,
    follow_tilt,
    stand_upright,
)
from .measurement import measure
from .records import BY_TORQUES, JOINT, NOT_FELT, RULES, STATE
from .torques import (
    aim_joints,
    bear_on_soles,
    feel_landing,
    limit_torques,
    want_accelerations,
)
from .wrench_estimate import (
    Observer,
    fit_wrenches,
    follow_forces,
)

HANDED_OVER = -1
"""What `act` and `tick` return where the robust solver has to resolve the task."""

_I8 = np.dtype(np.int64)


class Arrays(NamedTuple):
    """All that a tick reads and writes."""

    links: np.ndarray
    """Records of `LINK`: the robot, and workspace."""
    limbs: np.ndarray
    """Records of `LIMB`."""
    sites: np.ndarray
    """Records of `SITE`: soles, ankle sensors, IMU, limbs' ends."""
    wanted: np.ndarray
    """One record of `WANTED`."""
    rules: np.ndarray
    """One record of `RULES`."""
    state: np.ndarray
    """One record of `STATE`."""
    joints: np.ndarray
    """Records of `JOINT`."""
    dance: np.ndarray
    """One record of `DANCE`."""
    moved: np.ndarray
    """Joints that the embedded motion moves."""
    knots: np.ndarray
    """Its knots [s]."""
    cubics: np.ndarray
    """Its cubics, one after the other."""
    reference: np.ndarray
    """One record of `REFERENCE`."""
    q: np.ndarray
    """Commanded configuration."""
    v: np.ndarray
    """Its velocity [xdot_o; qdot]."""
    set_points: np.ndarray
    """Set-points of the joints [rad]."""
    sensed: np.ndarray
    """The body center at the origin, then what the encoders read [rad]."""
    felt: np.ndarray
    """What both ankle sensors feel (12), and the IMU's quaternion wxyz, gyro [rad/s]
    and accelerometer [m/s^2]."""
    law: np.ndarray
    """One record of `LAW`."""
    law_state: np.ndarray
    """One record of `LAW_STATE`."""
    past: np.ndarray
    """Reference CoM and ZMP of the last ticks, four numbers each, flat."""
    watch: np.ndarray
    """One record of `WATCH`."""
    guard: np.ndarray
    """One record of `GUARD`."""
    table: np.ndarray
    """The pattern's phases, `PHASE`; empty if references come from elsewhere."""
    pendulum: np.ndarray
    """omega_n [rad/s] and height [m] of the pattern's pendulum."""
    bodies: np.ndarray
    """Records of `BODY`: inertias of the links, and workspace."""
    acceleration: np.ndarray
    """Rate of v [m/s^2, rad/s^2], then the generalised forces [N, N m]."""
    speeds: np.ndarray
    """Set-points of the joints' rates [rad/s]."""
    torques: np.ndarray
    """Torques of the joints [N m], fed forward."""
    encoders: np.ndarray
    """What the encoders read last [rad]."""
    rates: np.ndarray
    """Joint rates, low-passed differences of that, then the gyro's [rad/s]."""
    seen: np.ndarray
    """Configuration that the ground is felt in, where positions are commanded, then
    its velocity."""
    observer: np.ndarray
    """Records of `BODY`; the arrays from here on are those of `Observer`."""
    motors: np.ndarray
    """Torques that the motors report [N m]."""
    slow: np.ndarray
    """The same after the filter of the joint rates [N m]."""
    filtered: np.ndarray
    """The same after the observer's filter [N m]."""
    last: np.ndarray
    """The last velocity."""
    change: np.ndarray
    """Its rate, filtered."""
    forces: np.ndarray
    """Generalised forces of the motion [N, N m]."""
    fit: np.ndarray
    """Normal equations of the soles' wrenches, with their right side."""


# Places of `Arrays` in their handle.
AT_RULES, AT_STATE, AT_JOINTS, AT_DANCE, AT_MOVED = range(4, 9)
AT_KNOTS, AT_CUBICS, AT_REFERENCE, AT_Q, AT_V = range(9, 14)
AT_SET_POINTS, AT_SENSED, AT_FELT, AT_LAW, AT_LAW_STATE = range(14, 19)
AT_PAST, AT_WATCH, AT_GUARD, AT_TABLE, AT_PENDULUM = range(19, 24)
AT_BODIES, AT_ACCELERATION, AT_SPEEDS, AT_TORQUES = range(24, 28)
AT_ENCODERS, AT_RATES, AT_SEEN, AT_OBSERVER, AT_MOTORS = range(28, 33)


@kernel
def look_up(handle: np.ndarray, time: float) -> None:
    """Write the reference at a time [s], if the pattern's phases are known here."""
    table, pendulum = (
        records_at(handle, AT_TABLE, PHASE),
        floats_at(handle, AT_PENDULUM),
    )
    if len(table):
        reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
        fill_reference(table, pendulum[0], pendulum[1], time, reference)


@inlined
def _observer_at(handle: np.ndarray) -> Observer:
    """Return the observer of a tick."""
    k = AT_MOTORS
    return Observer(
        records_at(handle, AT_OBSERVER, BODY),
        floats_at(handle, k),
        floats_at(handle, k + 1),
        floats_at(handle, k + 2),
        floats_at(handle, k + 3),
        floats_at(handle, k + 4),
        floats_at(handle, k + 5),
        floats_at(handle, k + 6).reshape((6, 7)),
    )


@kernel
def _observe(handle: np.ndarray, v: np.ndarray, moved: bool) -> None:
    """Find what ankle sensors would read, the robot placed."""
    rules, state = (
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
    )
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    flat, observer = flat_at(handle), _observer_at(handle)
    joints, felt = records_at(handle, AT_JOINTS, JOINT), floats_at(handle, AT_FELT)
    follow_forces(rules, state, joints, v, observer, moved)
    fit_wrenches(flat, rules, state, reference, v, observer, felt)


@kernel
def take_measurement(handle: np.ndarray) -> None:
    """Find CoM, ZMP and load from the readings of encoders, ankles and IMU."""
    rules = records_at(handle, AT_RULES, RULES)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    sensed, felt = floats_at(handle, AT_SENSED), floats_at(handle, AT_FELT)
    flat, before = flat_at(handle), state.support
    bodies = records_at(handle, AT_BODIES, BODY)
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    if rules.by_torque or rules.sensing == BY_TORQUES:
        rates, last = floats_at(handle, AT_RATES), floats_at(handle, AT_ENCODERS)
        follow_rates(rules, state, sensed, felt[16:19], last, rates)
        follow_tilt(rules, state, felt[12:16], felt[16:19])
        if rules.by_torque:
            estimate_posture(flat, rules, state, sensed, state.turn, reference, q)
        else:
            seen = floats_at(handle, AT_SEEN)
            q, v = seen[: len(q)], seen[len(q) :]
            stand_upright(flat, state, sensed, state.turn, q)
        estimate_velocity(flat, bodies, state, rates[len(last) :], rates, v)
    if rules.sensing == BY_TORQUES:
        _observe(handle, v, before != state.support)
    if rules.by_torque:
        estimate(flat, bodies, rules, state, felt, reference)
    else:
        scratch = wanted_at(handle)[0].scratch
        measure(flat, rules, state, sensed, felt, reference, scratch)
    if rules.sensing == NOT_FELT:
        state.load = rules.weight
        state.zmp[0] = state.zmp[1] = math.nan


@kernel
def sense(handle: np.ndarray) -> int:
    """Measure, unless a sensor is dead, and return what the guard finds."""
    felt = floats_at(handle, AT_FELT)
    status = check_sensors(floats_at(handle, AT_SENSED)[7:], felt[:12], felt[12:16])
    if status != WALKS:
        return status
    take_measurement(handle)
    state = records_at(handle, AT_STATE, STATE)[0]
    watch = records_at(handle, AT_WATCH, WATCH)[0]
    guard = records_at(handle, AT_GUARD, GUARD)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    return check_fall(watch, guard, reference, state.com, state.load, state.trunk_tilt)


@kernel
def control(handle: np.ndarray) -> None:
    """Apply the walking law, Eq. (31), to what was measured."""
    law = records_at(handle, AT_LAW, LAW)[0]
    law_state = records_at(handle, AT_LAW_STATE, LAW_STATE)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    reference, past = (
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
        floats_at(handle, AT_PAST),
    )
    ring = past.reshape((len(past) // 4, 4))
    zmp = state.zmp
    if records_at(handle, AT_RULES, RULES)[0].sensing == NOT_FELT:
        zmp = reference.zmp  # no error: the law with k_p = 0
    apply_law(law, law_state, ring, reference, state.com, zmp, state.feedback_scale)


@kernel
def _place_commanded(flat: Flat, handle: np.ndarray, rules: Record) -> None:
    """Place the robot as commanded."""
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    place_links(flat.links, floats_at(handle, AT_Q))
    find_levers(flat)
    if rules.compensate or rules.by_torque:
        plan_torques(flat, rules, reference, records_at(handle, AT_JOINTS, JOINT))


@kernel
def _find_dance(handle: np.ndarray) -> None:
    """Find where the embedded motion is."""
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    joints = records_at(handle, AT_JOINTS, JOINT)
    dance = records_at(handle, AT_DANCE, DANCE)[0]
    moved = records_at(handle, AT_MOVED, _I8)
    if len(moved):
        knots, cubics = floats_at(handle, AT_KNOTS), floats_at(handle, AT_CUBICS)
        dance_at(dance, moved, knots, cubics, joints, reference.time)


@kernel
def pose_task(handle: np.ndarray) -> None:
    """Write the task of the tick: CoM, trunk, feet and the embedded motion."""
    flat, rules = flat_at(handle), records_at(handle, AT_RULES, RULES)[0]
    _place_commanded(flat, handle, rules)
    _find_dance(handle)
    want(
        flat,
        rules,
        records_at(handle, AT_STATE, STATE)[0],
        records_at(handle, AT_LAW_STATE, LAW_STATE)[0],
        wanted_at(handle)[0],
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
        floats_at(handle, AT_Q),
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
    )


@kernel
def finish(handle: np.ndarray, dt: float) -> None:
    """Move the commanded configuration by its velocity, and write the set-points.

    Args:
        handle: Of `Arrays`.
        dt: For how long to move [s].
    """
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    integrate(flat_at(handle), q, v, dt)
    set_points(
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
        q,
        v,
        floats_at(handle, AT_SET_POINTS),
    )
    torques, speeds = floats_at(handle, AT_TORQUES), floats_at(handle, AT_SPEEDS)
    joints = records_at(handle, AT_JOINTS, JOINT)
    for j in range(len(joints)):
        speeds[j], torques[j] = v[6 + j], joints[j].torque


@kernel
def want_motion(handle: np.ndarray) -> None:
    """Write the task of the tick in accelerations."""
    _find_dance(handle)
    feel_landing(
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
    )
    want_accelerations(
        flat_at(handle),
        records_at(handle, AT_BODIES, BODY),
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
        records_at(handle, AT_LAW_STATE, LAW_STATE)[0],
        wanted_at(handle)[0],
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
        floats_at(handle, AT_Q),
        floats_at(handle, AT_V),
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
    )


@kernel
def exert(handle: np.ndarray) -> None:
    """Write the torques of the accelerations that were resolved, and set-points."""
    flat, bodies = flat_at(handle), records_at(handle, AT_BODIES, BODY)
    rules = records_at(handle, AT_RULES, RULES)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    joints = records_at(handle, AT_JOINTS, JOINT)
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    both = floats_at(handle, AT_ACCELERATION)
    a, t = both[: len(v)], both[len(v) :]
    accelerate_links(flat, bodies, a)
    load_links(flat, bodies, a, rules.gravity, t)
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    bear_on_soles(flat, rules, state, reference, t, joints)
    aim_joints(
        flat,
        bodies,
        rules,
        state,
        wanted_at(handle)[0],
        joints,
        records_at(handle, AT_MOVED, _I8),
        q,
        v,
        a,
        reference,
        floats_at(handle, AT_SET_POINTS),
        floats_at(handle, AT_SPEEDS),
    )
    speeds, torques = floats_at(handle, AT_SPEEDS), floats_at(handle, AT_TORQUES)
    limit_torques(state, joints, speeds, torques)


@kernel
def act_by_torque(handle: np.ndarray) -> int:
    """Resolve the task into accelerations, and write torques and set-points."""
    want_motion(handle)
    rules = records_at(handle, AT_RULES, RULES)[0]
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    a = floats_at(handle, AT_ACCELERATION)[: len(v)]
    joints = records_at(handle, AT_JOINTS, JOINT)
    if not rules.solvable:
        return HANDED_OVER
    if resolve(flat_at(handle), wanted_at(handle)[0], a) != SOLVED:
        return HANDED_OVER
    if not keeps_limits(rules, joints, q, v, a):
        return HANDED_OVER
    exert(handle)
    return WALKS


@kernel
def act(handle: np.ndarray) -> int:
    """Resolve the task into joint rates, integrate them, and write the set-points.

    Returns:
        `WALKS`; or `HANDED_OVER` near singular postures and at joint limits, where the
        robust solver has to find `v`, and `finish` to be called.
    """
    rules = records_at(handle, AT_RULES, RULES)[0]
    if rules.by_torque:
        return act_by_torque(handle)
    pose_task(handle)
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    joints = records_at(handle, AT_JOINTS, JOINT)
    if not rules.solvable:
        return HANDED_OVER
    if resolve(flat_at(handle), wanted_at(handle)[0], v) != SOLVED:
        return HANDED_OVER
    if not keeps_limits(rules, joints, q, v, v):
        return HANDED_OVER
    finish(handle, rules.period)
    return WALKS


@kernel
def tick(handle: np.ndarray, time: float) -> int:
    """Go through one control period.

    Args:
        handle: Of `Arrays`; encoders, wrenches and IMU are set.
        time: Time since the plan's start [s].

    Returns:
        `WALKS`, with set-points written; `HANDED_OVER`, as `act`; or what the guard
        found, for which the walk has to end.
    """
    look_up(handle, time)
    status = sense(handle)
    if status != WALKS:
        return status
    control(handle)
    return act(handle)
