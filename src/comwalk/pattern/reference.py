"""The pattern at one time without objects: `Pattern.at` as a compiled kernel.

`Pattern.at` says what is computed and why. This is the same on the rows of `rows`, for
loops that must not allocate; a test ties the two.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import kernel
from ..sides import Side
from . import records as r
from .swing import (
    VERTICAL_SHARE,
    FootMotion,
)
from .walk_pattern import (
    Phase,
    Reference,
)

_MIDDLE = 1.0 - 2.0 * VERTICAL_SHARE


def reference_of(row: np.ndarray) -> Reference:
    """Return a row as the reference that it stands for.

    Args:
        row: `rows.ROW_SIZE` numbers, as `fill_reference` leaves them.

    Returns:
        The reference; it shares no memory with the row.
    """
    n = row.tolist()
    sides = (Side.LEFT, Side.RIGHT)
    left, right = (_foot_of(row[k : k + 8]) for k in (r.LEFT_FOOT, r.RIGHT_FOOT))
    return Reference(
        n[r.TIME],
        row[r.COM : r.COM + 3].copy(),
        row[r.COM_VELOCITY : r.COM_VELOCITY + 3].copy(),
        row[r.COM_ACCELERATION : r.COM_ACCELERATION + 3].copy(),
        row[r.ZMP : r.ZMP + 2].copy(),
        Phase(int(n[r.PHASE])),
        sides[int(n[r.SUPPORT])],
        n[r.LEFT_LOAD],
        n[r.HEADING],
        n[r.HEADING_RATE],
        left,
        right,
        n[r.WALKING],
        int(n[r.STEP]),
    )


def _foot_of(numbers: np.ndarray) -> FootMotion:
    """Return the motion of a foot from its eight numbers."""
    yaw, rate = float(numbers[3]), float(numbers[7])
    return FootMotion(numbers[:3].copy(), yaw, numbers[4:7].copy(), rate)


@kernel
def fill_reference(
    table: np.ndarray, omega: float, height: float, time: float, row: np.ndarray
) -> None:
    """Write the reference at one time into a row.

    Args:
        table: The phases in order, (k, `rows.PHASE_SIZE`), as `Pattern.table` is.
        omega: Natural frequency omega_n [rad/s].
        height: Height of the CoM [m].
        time: Time [s], finite. Before the first phase and after the last one the robot
            rests; at a junction the later phase counts.
        row: Where to write, (`rows.ROW_SIZE`,).
    """
    piece = table[phase_at(table, time)]
    S = piece[r.DURATION]
    s = min(max(time - piece[r.START], 0.0), S)
    tau = s / S if S > 0.0 else 0.0
    blend = minimum_jerk(tau)[0]
    row[r.TIME] = time
    row[r.COM + 2] = height
    row[r.COM_VELOCITY + 2] = row[r.COM_ACCELERATION + 2] = 0.0
    fill_com(piece, s, omega, row)
    row[r.PHASE], row[r.STEP] = piece[r.KIND], piece[r.LANDED]
    row[r.SUPPORT] = piece[r.BASES + 1] if tau >= 0.5 else piece[r.BASES]
    load, walking = piece[r.LOADS], piece[r.BLENDS]
    row[r.LEFT_LOAD] = load + (piece[r.LOADS + 1] - load) * blend
    row[r.WALKING] = walking + (piece[r.BLENDS + 1] - walking) * blend
    fill_heading(piece, piece[r.START] + s, row)
    fill_feet(piece, s, row)


@kernel
def phase_at(table: np.ndarray, time: float) -> int:
    """Return the number of the last phase that starts at a time or before."""
    low, high = 0, len(table)
    while low < high:
        middle = (low + high) // 2
        if time < table[middle, r.START]:
            high = middle
        else:
            low = middle + 1
    return max(low - 1, 0)


@kernel
def minimum_jerk(s: float) -> tuple[float, float]:
    """Return the blend and its slope, as `swing.minimum_jerk` does."""
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    s_2, rest = s * s, 1.0 - s
    return s_2 * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s_2 * rest * rest


@kernel
def fill_com(piece: np.ndarray, s: float, omega: float, row: np.ndarray) -> None:
    """Write CoM and ZMP of a phase at the time s after its start [s] into a row."""
    S, scale = piece[r.DURATION], piece[r.INVERSE_SINH]
    u, v = omega * (S - s), omega * s
    su = sv = cu = cv = 0.0
    if scale != 0.0:
        su, sv, cu, cv = math.sinh(u), math.sinh(v), math.cosh(u), math.cosh(v)
    for axis in range(2):
        a = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        q, dq, ddq = a[0], 0.0, 0.0
        if S > 0.0:
            x = s / S
            q += x * (a[1] + x * (a[2] + x * (a[3] + x * (a[4] + x * a[5]))))
            dq = a[1] + x * (2 * a[2] + x * (3 * a[3] + x * (4 * a[4] + x * 5 * a[5])))
            ddq = 2 * a[2] + x * (6 * a[3] + x * (12 * a[4] + x * 20 * a[5]))
            dq, ddq = dq / S, ddq / (S * S)
        hyperbolic = (su * a[6] + sv * a[7]) * scale
        row[r.COM + axis] = q + hyperbolic
        row[r.COM_VELOCITY + axis] = dq + (cv * a[7] - cu * a[6]) * scale * omega
        row[r.COM_ACCELERATION + axis] = ddq + omega * omega * hyperbolic
        row[r.ZMP + axis] = q - ddq / (omega * omega)


@kernel
def fill_heading(piece: np.ndarray, time: float, row: np.ndarray) -> None:
    """Write the heading of a phase at a time [s] into a row."""
    begin, end = piece[r.TURN_START], piece[r.TURN_END]
    s = min(max(time, begin), end) - begin
    a, b, c, d = piece[r.TURN], piece[r.TURN + 1], piece[r.TURN + 2], piece[r.TURN + 3]
    row[r.HEADING] = ((a * s + b) * s + c) * s + d
    row[r.HEADING_RATE] = (3.0 * a * s + 2.0 * b) * s + c


@kernel
def fill_feet(piece: np.ndarray, s: float, row: np.ndarray) -> None:
    """Write both feet of a phase at the time s after its start [s] into a row."""
    for foot in range(2):
        out, pose = r.LEFT_FOOT + 8 * foot, r.RESTING + 3 * foot
        row[out], row[out + 1] = piece[pose], piece[pose + 1]
        row[out + 2], row[out + 3] = 0.0, piece[pose + 2]
        row[out + 4 : out + 8] = 0.0
    swinging = int(piece[r.SWINGING])
    if swinging < 0:
        return
    S, height = piece[r.DURATION], piece[r.CLEARANCE]
    x = s / S
    h, dh = minimum_jerk((x - VERTICAL_SHARE) / _MIDDLE)
    dh /= _MIDDLE * S
    bow = x * (1.0 - x)
    out = r.LEFT_FOOT + 8 * swinging
    for k in range(3):
        way, at = piece[r.TRAVEL + k], out + (3 if k == 2 else k)
        row[at] += h * way
        row[at + 4] = dh * way
    row[out + 2] = height * (64.0 * bow**3)
    row[out + 6] = height * (192.0 * bow * bow * (1.0 - 2.0 * x) / S)
