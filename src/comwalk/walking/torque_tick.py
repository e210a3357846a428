"""The second half of a control period by torque: what robot and soles can bear.

The task is resolved for accelerations. Where the soles cannot bear the ZMP that these
ask for, the trunk turns instead; where the swing leg cannot do what is asked, its foot
gives way, not the CoM.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from ..control import LAW_STATE, WALKS
from ..embedding import (
    BODY,
    DANCE,
    SOLVED,
    Flat,
    accelerate_links,
    flat_at,
    load_links,
    resolve,
    site_point,
    wanted_at,
)
from ..handles import floats_at, records_at
from ..pattern import REFERENCE
from .action import dance_at, keeps_limits, room_of
from .records import (
    AT_ACCELERATION,
    AT_BODIES,
    AT_CUBICS,
    AT_DANCE,
    AT_JOINTS,
    AT_KNOTS,
    AT_LAW_STATE,
    AT_MOVED,
    AT_Q,
    AT_REFERENCE,
    AT_RULES,
    AT_SET_POINTS,
    AT_SPEEDS,
    AT_STATE,
    AT_TORQUES,
    AT_V,
    HANDED_OVER,
    JOINT,
    RULES,
    STATE,
)
from .torques import (
    aim_joints,
    bear_on_soles,
    feel_landing,
    hold_in_soles,
    limit_torques,
    want_accelerations,
    zmp_of_motion,
)

BEARABLE = 0.001
"""Distance of the ZMP from the soles that the trunk does not give way for [m]."""
SHARPEST = 60.0
"""Greatest angular acceleration of a trunk that gives way [rad/s^2]."""

_I8 = np.dtype(np.int64)


@kernel
def find_dance(handle: np.ndarray) -> None:
    """Find where the embedded motion is."""
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    joints = records_at(handle, AT_JOINTS, JOINT)
    dance = records_at(handle, AT_DANCE, DANCE)[0]
    moved = records_at(handle, AT_MOVED, _I8)
    if len(moved):
        knots, cubics = floats_at(handle, AT_KNOTS), floats_at(handle, AT_CUBICS)
        dance_at(dance, moved, knots, cubics, joints, reference.time)


@kernel
def act_by_torque(handle: np.ndarray) -> int:
    """Resolve the task into accelerations, and write torques and set-points.

    Returns:
        `WALKS`; or `HANDED_OVER`, where the robust solver has to find accelerations,
        and `exert` to be called.
    """
    _want_motion(handle)
    state = records_at(handle, AT_STATE, STATE)[0]
    state.spared = state.limited = 0
    state.lost = 0.0
    rules = records_at(handle, AT_RULES, RULES)[0]
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    a = floats_at(handle, AT_ACCELERATION)[: len(v)]
    if not rules.solvable:
        return HANDED_OVER
    joints = records_at(handle, AT_JOINTS, JOINT)
    solved = resolve(flat_at(handle), wanted_at(handle)[0], a) == SOLVED
    loaded = solved and _give_way(handle, a)
    if not (solved and keeps_limits(rules, joints, q, v, a)):
        if loaded:
            _unload(handle, a)
        loaded = False
        if not _spare_a_foot(handle, a, solved):
            return HANDED_OVER
    if not loaded:
        _load(handle, a)
    _bear(handle)
    return WALKS


@kernel
def _want_motion(handle: np.ndarray) -> None:
    """Write the task of the tick in accelerations."""
    find_dance(handle)
    rules = records_at(handle, AT_RULES, RULES)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    feel_landing(rules, state, reference)
    want_accelerations(
        flat_at(handle),
        records_at(handle, AT_BODIES, BODY),
        rules,
        state,
        records_at(handle, AT_LAW_STATE, LAW_STATE)[0],
        wanted_at(handle)[0],
        records_at(handle, AT_JOINTS, JOINT),
        records_at(handle, AT_MOVED, _I8),
        floats_at(handle, AT_Q),
        floats_at(handle, AT_V),
        reference,
    )


@kernel
def exert(handle: np.ndarray) -> None:
    """Write the torques of the accelerations that were resolved, and set-points."""
    v = floats_at(handle, AT_V)
    _load(handle, floats_at(handle, AT_ACCELERATION)[: len(v)])
    _bear(handle)


@kernel
def _load(handle: np.ndarray, a: np.ndarray) -> None:
    """Accelerate the links, and find the generalised forces of that."""
    flat, bodies = flat_at(handle), records_at(handle, AT_BODIES, BODY)
    t = floats_at(handle, AT_ACCELERATION)[len(a) :]
    accelerate_links(flat, bodies, a)
    load_links(flat, bodies, a, records_at(handle, AT_RULES, RULES)[0].gravity, t)


@kernel
def _unload(handle: np.ndarray, a: np.ndarray) -> None:
    """Take the accelerations from the links again."""
    for j in range(len(a)):
        a[j] = -a[j]
    accelerate_links(flat_at(handle), records_at(handle, AT_BODIES, BODY), a)
    for j in range(len(a)):
        a[j] = -a[j]


@kernel
def _bear(handle: np.ndarray) -> None:
    """Write torques and set-points of accelerations whose forces are found."""
    flat, bodies = flat_at(handle), records_at(handle, AT_BODIES, BODY)
    rules = records_at(handle, AT_RULES, RULES)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    joints = records_at(handle, AT_JOINTS, JOINT)
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    both = floats_at(handle, AT_ACCELERATION)
    a, t = both[: len(v)], both[len(v) :]
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


# ---- The trunk gives way -------------------------------------------------------------


@kernel
def _loaded_zmp(handle: np.ndarray, a: np.ndarray) -> tuple[float, float]:
    """Return the ZMP that accelerations ask for, x and y [m], world; they stay."""
    _load(handle, a)
    state = records_at(handle, AT_STATE, STATE)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    t = floats_at(handle, AT_ACCELERATION)[len(a) :]
    return zmp_of_motion(flat_at(handle), state, reference, t)


@kernel
def _zmp_of(handle: np.ndarray, a: np.ndarray) -> tuple[float, float]:
    """Return the ZMP that accelerations ask for; the links are as they were."""
    zmp = _loaded_zmp(handle, a)
    _unload(handle, a)
    return zmp


@kernel
def _give_way(handle: np.ndarray, a: np.ndarray) -> bool:
    """Let the trunk turn as the soles make it, where they cannot bear what is asked.

    Its pitch and its roll move the ZMP linearly: both are tried, and what brings it to
    the sole's edge is added. The CoM so keeps its acceleration, at the cost of the
    trunk's posture, as long as that of the trunk is in bounds.

    Args:
        handle: Of `Arrays`.
        a: What was resolved, and is then.

    Returns:
        Whether the links have these accelerations already: if nothing had to change.
    """
    rules = records_at(handle, AT_RULES, RULES)[0]
    reference = records_at(handle, AT_REFERENCE, REFERENCE)[0]
    flat, wanted = flat_at(handle), wanted_at(handle)[0]
    x, y = _loaded_zmp(handle, a)
    p_x, p_y, _, _, _ = hold_in_soles(flat, rules, reference, x, y)
    p_x, p_y = p_x - x, p_y - y
    if math.hypot(p_x, p_y) < BEARABLE:
        return True
    _unload(handle, a)
    roll, pitch = wanted.trunk[0], wanted.trunk[1]
    wanted.trunk[0] = roll + 1.0
    resolve(flat, wanted, a)
    a_x, a_y = _zmp_of(handle, a)
    wanted.trunk[0], wanted.trunk[1] = roll, pitch + 1.0
    resolve(flat, wanted, a)
    b_x, b_y = _zmp_of(handle, a)
    a_x, a_y, b_x, b_y = a_x - x, a_y - y, b_x - x, b_y - y
    det = a_x * b_y - a_y * b_x
    u = v = 0.0
    if abs(det) > 1e-12:
        u, v = (p_x * b_y - p_y * b_x) / det, (a_x * p_y - a_y * p_x) / det
    wanted.trunk[0] = roll + min(max(u, -SHARPEST), SHARPEST)
    wanted.trunk[1] = pitch + min(max(v, -SHARPEST), SHARPEST)
    resolve(flat, wanted, a)
    return False


# ---- A foot gives way ----------------------------------------------------------------


@kernel
def _stretched(flat: Flat, rules: Record, k: int) -> float:
    """Return how far a sole is from its hip, over the reach of the leg [-]."""
    hip = flat.links[rules.hip[k]].p
    x, y, z = site_point(flat, flat.limbs[k].site)
    x, y, z = x - hip[0], y - hip[1], z - hip[2]
    return math.sqrt(x * x + y * y + z * z) / rules.reach[k]


@kernel
def _spare_a_foot(handle: np.ndarray, a: np.ndarray, solved: bool) -> bool:
    """Resolve again with as much of one foot's motion as its leg allows.

    It is the foot that swings, or in double support that of the more stretched leg.
    Its joints are given, each within its limits, and all others do the rest: what
    cannot be is lost by the foot, not by the CoM.

    Args:
        handle: Of `Arrays`.
        a: What was resolved, if it was; what is then goes here.
        solved: Whether it was. If not, the foot's turning is given up first.

    Returns:
        Whether it is resolved, all joints within their limits.
    """
    rules = records_at(handle, AT_RULES, RULES)[0]
    state = records_at(handle, AT_STATE, STATE)[0]
    joints = records_at(handle, AT_JOINTS, JOINT)
    flat, wanted = flat_at(handle), wanted_at(handle)[0]
    q, v = floats_at(handle, AT_Q), floats_at(handle, AT_V)
    k = 1 if state.landed[0] else 0
    if state.landed[0] == state.landed[1]:
        k = 0 if _stretched(flat, rules, 0) > _stretched(flat, rules, 1) else 1
    limb = flat.limbs[k]
    rows, state.spared = limb.rows, 1 if solved else 2
    if not solved:
        limb.rows = 7
        solved = resolve(flat, wanted, a) == SOLVED
    if solved:
        for n in range(limb.own):
            j = limb.chain[n] - 1
            low, high = room_of(rules, joints[j], q[7 + j], v[6 + j])
            rate = min(max(a[6 + j], low), high)
            flat.links[1 + j].desired_rate, lost = rate, abs(a[6 + j] - rate)
            state.limited += lost > 0.0
            state.lost = max(state.lost, lost)
        limb.rows = 0
        solved = resolve(flat, wanted, a) == SOLVED
    limb.rows = rows
    return solved and keeps_limits(rules, joints, q, v, a)
