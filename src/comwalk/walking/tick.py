"""The compiled control tick: from sensors to set-points in one call.

It puts `lookup`, `measure_kernels`, `act_kernels` and `kernels` in the order of
`walk.walk`. What a tick knows lies in the arrays of a handle, in the order of `Arrays`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import Record, kernel
from ..embedding import (
    SOLVED,
    Flat,
    find_levers,
    flat_at,
    integrate,
    place_links,
    resolve,
    wanted_at,
)
from ..handles import (
    floats_at,
    records_at,
)
from ..pattern import REFERENCE, fill_reference
from ..pattern import records as r
from .action import (
    control,
    dance_at,
    keeps_limits,
    plan_torques,
    set_points,
    want,
)
from .measurement import measure
from .records import (
    DANCE,
    JOINT,
    RULES,
    STATE,
)

DONE, HANDED_OVER, ENCODERS, WRENCHES, ORIENTATION, TILTED, ASTRAY, LIFTED = range(8)
"""What a tick ends with: done; to be resolved by `Resolver`; sensors that read no
numbers; falls."""

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
    past: np.ndarray
    """Reference CoM and ZMP of the last ticks, four numbers each."""
    table: np.ndarray
    """The pattern's phases, `rows.PHASE_SIZE` numbers each."""
    reference: np.ndarray
    """One record of `REFERENCE`."""
    q: np.ndarray
    """Commanded configuration."""
    v: np.ndarray
    """Its velocity [xdot_o; qdot]."""
    out: np.ndarray
    """Set-points of the joints [rad]."""
    sensed: np.ndarray
    """The body center at the origin, then what the encoders read [rad]."""
    felt: np.ndarray
    """What both ankle sensors feel (12), and the IMU's quaternion wxyz."""


# Places of `Arrays` in their handle.
AT_LINKS, AT_LIMBS, AT_SITES, AT_WANTED, AT_RULES = range(5)
AT_STATE, AT_JOINTS, AT_DANCE, AT_MOVED, AT_KNOTS = range(5, 10)
AT_CUBICS, AT_PAST, AT_TABLE, AT_REFERENCE, AT_Q = range(10, 15)
AT_V, AT_OUT, AT_SENSED, AT_FELT = range(15, 19)


@kernel
def _guard_sensors(sensed: np.ndarray, felt: np.ndarray) -> int:
    """Return what is wrong with the sensors; `walk._Guard.check_sensors`."""
    total = 0.0
    for k in range(7, len(sensed)):
        total += sensed[k] * sensed[k]
    if not math.isfinite(total):
        return ENCODERS
    total = 0.0
    for k in range(12):
        total += felt[k] * felt[k]
    if not math.isfinite(total):
        return WRENCHES
    for k in range(12, 16):
        total += felt[k] * felt[k]
    return DONE if math.isfinite(total) else ORIENTATION


@kernel
def _guard(rules: Record, state: Record, reference: Record) -> int:
    """Return whether the robot falls; `walk._Guard.check`."""
    if state.trunk_tilt > rules.tilt:
        return TILTED
    x, y = state.com[0] - reference.com[0], state.com[1] - reference.com[1]
    state.missed = math.hypot(x, y)
    if not state.missed < rules.com_error:
        return ASTRAY
    state.heaviest = max(state.heaviest, state.load)
    if state.load >= rules.least_load * state.heaviest:
        state.lightened = math.nan
    elif math.isnan(state.lightened):
        state.lightened = reference.time
    elif reference.time - state.lightened > rules.patience:
        return LIFTED
    return DONE


@kernel
def _sense(flat: Flat, handle: np.ndarray, rules: Record, state: Record) -> int:
    """Measure, and watch over what is measured."""
    reference, sensed, felt = (
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
        floats_at(handle, AT_SENSED),
        floats_at(handle, AT_FELT),
    )
    fault = _guard_sensors(sensed, felt)
    if fault != DONE:
        return fault
    measure(flat, rules, state, sensed, felt, reference, wanted_at(handle)[0].scratch)
    return _guard(rules, state, reference)


@kernel
def look_up(handle: np.ndarray, time: float) -> None:
    """Write the reference at a time into its record."""
    rules, table = records_at(handle, AT_RULES, RULES)[0], floats_at(handle, AT_TABLE)
    phases = table.reshape((len(table) // r.PHASE_SIZE, r.PHASE_SIZE))
    fill_reference(
        phases,
        rules.omega,
        rules.height,
        time,
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
    )


@kernel
def _place_commanded(flat: Flat, handle: np.ndarray, rules: Record) -> None:
    """Place the robot as commanded, and find where its motion is."""
    reference, joints = (
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
        records_at(handle, AT_JOINTS, JOINT),
    )
    place_links(flat.links, floats_at(handle, AT_Q))
    find_levers(flat)
    if rules.compensate:
        plan_torques(flat, rules, reference, joints)
    dance, moved = (
        records_at(handle, AT_DANCE, DANCE)[0],
        records_at(handle, AT_MOVED, _I8),
    )
    if len(moved):
        knots, cubics = floats_at(handle, AT_KNOTS), floats_at(handle, AT_CUBICS)
        dance_at(dance, moved, knots, cubics, joints, reference.time)


@kernel
def act(handle: np.ndarray) -> int:
    """Find the velocity of all joints, after `look_up` and a measurement.

    Returns:
        DONE, or HANDED_OVER where `Resolver` has to find it.
    """
    flat, wanted, v = flat_at(handle), wanted_at(handle)[0], floats_at(handle, AT_V)
    rules, state = (
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
    )
    joints, moved = (
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
    )
    past, reference, q = (
        floats_at(handle, AT_PAST),
        records_at(handle, AT_REFERENCE, REFERENCE)[0],
        floats_at(handle, AT_Q),
    )
    control(rules, state, past.reshape((len(past) // 4, 4)), reference)
    _place_commanded(flat, handle, rules)
    want(flat, rules, state, wanted, joints, moved, q, reference)
    if resolve(flat, wanted, v) != SOLVED or not keeps_limits(rules, joints, q, v):
        return HANDED_OVER
    return DONE


@kernel
def finish(handle: np.ndarray) -> None:
    """Move the commanded configuration by its velocity, and write the set-points."""
    flat, q, v = flat_at(handle), floats_at(handle, AT_Q), floats_at(handle, AT_V)
    rules, state = (
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
    )
    joints, moved = (
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
    )
    integrate(flat, q, v, rules.period)
    set_points(rules, state, joints, moved, q, v, floats_at(handle, AT_OUT))


@kernel
def tick(handle: np.ndarray, time: float) -> int:
    """Go through one control period.

    Args:
        handle: Of `Arrays`; encoders, wrenches and IMU are set.
        time: Time since the plan's start [s].

    Returns:
        DONE, with set-points written; HANDED_OVER, to be followed by a resolution and
        `finish`; or why the walk has to end.
    """
    look_up(handle, time)
    rules, state = (
        records_at(handle, AT_RULES, RULES)[0],
        records_at(handle, AT_STATE, STATE)[0],
    )
    status = _sense(flat_at(handle), handle, rules, state)
    if status == DONE:
        status = act(handle)
    if status == DONE:
        finish(handle)
    return status
