"""One control period as kernels: look up, measure, guard, apply the law, act.

All that a period reads and writes lies in the arrays of one handle, in the order of
`Arrays`, so that a call from Python costs one argument.
"""

from __future__ import annotations

import math

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
    SOLVED,
    Flat,
    find_levers,
    flat_at,
    integrate,
    place_links,
    resolve,
    wanted_at,
)
from ..handles import floats_at, inlined, records_at
from ..pattern import (
    ADAPTATION,
    COMMAND,
    ONLINE,
    PHASE,
    REFERENCE,
    STEP,
    WORK,
    adapt,
    fill_reference,
    lower,
)
from .action import keeps_limits, plan_torques, set_points, want
from .estimate import (
    estimate,
    estimate_posture,
    estimate_velocity,
    follow_rates,
    follow_tilt,
    stand_upright,
)
from .measurement import measure
from .records import (
    AT_ADAPTATION,
    AT_BODIES,
    AT_COMMAND,
    AT_ENCODERS,
    AT_FELT,
    AT_GUARD,
    AT_JOINTS,
    AT_LAW,
    AT_LAW_STATE,
    AT_MOTORS,
    AT_MOVED,
    AT_OBSERVER,
    AT_ONLINE,
    AT_PAST,
    AT_PENDULUM,
    AT_PHASES,
    AT_Q,
    AT_RATES,
    AT_REFERENCE,
    AT_RULES,
    AT_SEEN,
    AT_SENSED,
    AT_SET_POINTS,
    AT_SPEEDS,
    AT_STATE,
    AT_STEPS,
    AT_TABLE,
    AT_TORQUES,
    AT_V,
    AT_WATCH,
    AT_WORK,
    BY_TORQUES,
    HANDED_OVER,
    JOINT,
    NOT_FELT,
    RULES,
    STATE,
)
from .torque_tick import act_by_torque, find_dance
from .wrench_estimate import Observer, fit_wrenches, follow_forces

_I8 = np.dtype(np.int64)


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
def move_steps(handle: np.ndarray) -> None:
    """Move the step that is made, if the ankles cannot hold the measured CoM."""
    adaptation = records_at(handle, AT_ADAPTATION, ADAPTATION)
    if not len(adaptation):
        return
    how = adaptation[0]
    table, command = (
        records_at(handle, AT_PHASES, PHASE),
        records_at(handle, AT_COMMAND, COMMAND)[0],
    )
    state = records_at(handle, AT_STATE, STATE)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    c, s, lean = math.cos(reference.heading), math.sin(reference.heading), state.lean
    offset, away = state.offsets[state.support], how.away
    away[0] = offset[0] - (c * lean[0] - s * lean[1])
    away[1] = offset[1] - (s * lean[0] + c * lean[1])
    moved = adapt(
        table,
        records_at(handle, AT_ONLINE, ONLINE)[0],
        command,
        records_at(handle, AT_WORK, WORK),
        records_at(handle, AT_STEPS, STEP),
        how,
        reference,
        state.com,
        state.swift_velocity,
        away,
    )
    if moved:
        time = reference.time
        fill_reference(table[:1], command.omega, command.height, time, reference)
    period = records_at(handle, AT_RULES, RULES)[0].period
    lower(how, reference, state.com, state.swift_velocity, period)


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
def pose_task(handle: np.ndarray) -> None:
    """Write the task of the tick: CoM, trunk, feet and the embedded motion."""
    flat, rules = flat_at(handle), records_at(handle, AT_RULES, RULES)[0]
    _place_commanded(flat, handle, rules)
    find_dance(handle)
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
    move_steps(handle)
    control(handle)
    return act(handle)
