r"""The reference at one time: `Reference`, and the kernels that evaluate it.

In each phase of duration S both axes of the CoM are

.. math:: c(t) = \sum_{j=0}^5 a_j (t/S)^j
   + \frac{\sinh(\omega_n (S - t)) \, r_0 + \sinh(\omega_n t) \, r_1}{\sinh(\omega_n S)}

which is Eqs. (5) and (10) in single support, the straight lines of Eqs. (4) and (9) in
double support, and whatever joins them at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ..compiled import Record, kernel
from ..sides import Side
from .records import FOOT

VERTICAL_SHARE = 0.02
"""Share of the swing at each end in which the foot moves vertically only [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class FootMotion:
    """Pose, velocity and acceleration of the centre of a sole, which stays level."""

    position: np.ndarray
    """Centre of the sole [m], shape (3,), world; z = 0 on the ground."""

    yaw: float
    """Heading of the foot [rad], world."""

    velocity: np.ndarray
    """Velocity of the centre of the sole [m/s], shape (3,), world."""

    yaw_rate: float
    """Rate of the heading [rad/s]."""

    acceleration: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Acceleration of the centre of the sole [m/s^2], shape (3,), world."""

    yaw_acceleration: float = 0.0
    """Rate of the rate of the heading [rad/s^2]."""


class Phase(IntEnum):
    """The support phase."""

    STAND = 0
    """Both feet carry the body at rest."""

    START = 1
    """Both feet stay; the CoM starts to move."""

    DOUBLE = 2
    """Both feet stay; the weight moves to the next foot."""

    SINGLE_LEFT = 3
    """The left foot carries the body, the right foot swings."""

    SINGLE_RIGHT = 4
    """The right foot carries the body, the left foot swings."""

    STOP = 5
    """Both feet stay; the CoM comes to rest."""


STAND, DOUBLE = int(Phase.STAND), int(Phase.DOUBLE)
LEFT_ALONE, RIGHT_ALONE = int(Phase.SINGLE_LEFT), int(Phase.SINGLE_RIGHT)
"""Phases as the numbers of records, for kernels."""


class PhaseSpan(NamedTuple):
    """One phase of a plan."""

    start: float
    """When it starts [s]."""

    duration: float
    """How long it lasts [s]."""

    phase: Phase
    """The support phase."""

    stance: Side
    """The foot that carries the base limb at its end."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """All that the pattern asks for at one time."""

    time: float
    """Time [s]."""

    com: np.ndarray
    """CoM [m], shape (3,), world."""

    com_velocity: np.ndarray
    """Velocity of the CoM [m/s], shape (3,), world."""

    com_acceleration: np.ndarray
    """Acceleration of the CoM [m/s^2], shape (3,), world."""

    zmp: np.ndarray
    """ZMP [m], shape (2,), world, on the ground."""

    phase: Phase
    """The support phase."""

    support: Side
    """Foot of the base limb: the stance foot; it changes in mid double support."""

    left_load: float
    """Planned share of the weight on the left foot [-], in [0, 1]."""

    heading: float
    """Yaw of the trunk [rad], continuous with its rate; may leave [-pi, pi]."""

    heading_rate: float
    """Rate of the yaw of the trunk [rad/s]."""

    left: FootMotion
    """Left foot, world."""

    right: FootMotion
    """Right foot, world."""

    walking: float
    """0 standing, 1 walking, smooth in between during the start and the stop [-]."""

    step: int
    """Number of footsteps that have landed."""

    def foot(self, side: Side) -> FootMotion:
        """Return the motion of one foot.

        Args:
            side: Which foot.

        Returns:
            Its pose and velocity, world.
        """
        return self.left if side is Side.LEFT else self.right


class Samples(NamedTuple):
    """The pattern at many times, for plots."""

    time: np.ndarray
    """Times [s], shape (k,)."""

    com: np.ndarray
    """CoM [m], shape (k, 3)."""

    com_velocity: np.ndarray
    """Velocity of the CoM [m/s], shape (k, 3)."""

    com_acceleration: np.ndarray
    """Acceleration of the CoM [m/s^2], shape (k, 3)."""

    zmp: np.ndarray
    """ZMP [m], shape (k, 2)."""

    left: np.ndarray
    """Left sole centre [m], shape (k, 3)."""

    right: np.ndarray
    """Right sole centre [m], shape (k, 3)."""

    heading: np.ndarray
    """Yaw of the trunk [rad], shape (k,)."""

    phase: np.ndarray
    """`Phase` as int, shape (k,)."""


_MIDDLE = 1.0 - 2.0 * VERTICAL_SHARE


def reference_of(record: np.void) -> Reference:
    """Return a record as the reference that it stands for.

    Args:
        record: A record of `REFERENCE`, as `fill_reference` leaves it.

    Returns:
        The reference; it shares no memory with the record.
    """
    return Reference(
        float(record["time"]),
        record["com"].copy(),
        record["com_velocity"].copy(),
        record["com_acceleration"].copy(),
        record["zmp"].copy(),
        Phase(int(record["phase"])),
        (Side.LEFT, Side.RIGHT)[int(record["support"])],
        float(record["left_load"]),
        float(record["heading"]),
        float(record["heading_rate"]),
        *(_foot_of(foot) for foot in record["feet"]),
        float(record["walking"]),
        int(record["step"]),
    )


def _foot_of(record: np.void) -> FootMotion:
    return FootMotion(
        record["position"].copy(),
        float(record["yaw"]),
        record["velocity"].copy(),
        float(record["yaw_rate"]),
        record["acceleration"].copy(),
        float(record["yaw_acceleration"]),
    )


def record_of(reference: Reference, record: np.void) -> None:
    """Write a reference into a record of `REFERENCE`, for kernels.

    Args:
        reference: The reference.
        record: Where to write.
    """
    for name in ("time", "com", "com_velocity", "com_acceleration", "zmp", "left_load"):
        record[name] = getattr(reference, name)
    for name in ("heading", "heading_rate", "walking", "step"):
        record[name] = getattr(reference, name)
    record["phase"] = int(reference.phase)
    record["support"] = 0 if reference.support is Side.LEFT else 1
    for foot, motion in zip(
        record["feet"], (reference.left, reference.right), strict=True
    ):
        for name in FOOT.names or ():
            foot[name] = getattr(motion, name)


@kernel
def fill_reference(
    table: np.ndarray, omega: float, height: float, time: float, reference: Record
) -> None:
    """Write the reference at one time into a record.

    Args:
        table: The phases in order, records of `PHASE`, as `Pattern.table` is.
        omega: Natural frequency omega_n [rad/s].
        height: Height of the CoM [m].
        time: Time [s], finite. Before the first phase and after the last one the robot
            rests; at a junction the later phase counts.
        reference: Where to write, a record of `REFERENCE`.
    """
    piece = table[phase_at(table, time)]
    S = piece.duration
    s = min(max(time - piece.start, 0.0), S)
    tau = s / S if S > 0.0 else 0.0
    blend = minimum_jerk(tau)[0]
    reference.time = time
    reference.com[2] = height
    reference.com_velocity[2] = reference.com_acceleration[2] = 0.0
    fill_com(piece, s, omega, reference)
    reference.phase, reference.step = piece.kind, piece.landed
    reference.support = piece.bases[1] if tau >= 0.5 else piece.bases[0]
    load, walking = piece.loads[0], piece.blends[0]
    reference.left_load = load + (piece.loads[1] - load) * blend
    reference.walking = walking + (piece.blends[1] - walking) * blend
    fill_heading(piece, piece.start + s, reference)
    fill_feet(piece, s, reference)


@kernel
def fill_references(
    table: np.ndarray,
    omega: float,
    height: float,
    times: np.ndarray,
    references: np.ndarray,
) -> None:
    """Write the references at many times [s]; see `fill_reference`."""
    for k in range(len(times)):
        fill_reference(table, omega, height, times[k], references[k])


@kernel
def phase_at(table: np.ndarray, time: float) -> int:
    """Return the number of the last phase that starts at a time or before."""
    low, high = 0, len(table)
    while low < high:
        middle = (low + high) // 2
        if time < table[middle].start:
            high = middle
        else:
            low = middle + 1
    return max(low - 1, 0)


@kernel
def minimum_jerk(s: float) -> tuple[float, float]:
    r"""Return the minimum-jerk blend and its slope.

    .. math:: h(s) = 10 s^3 - 15 s^4 + 6 s^5

    Args:
        s: Progress [-]; held at 0 and 1 outside [0, 1].

    Returns:
        h in [0, 1] and dh/ds; the first and second slopes are 0 at both ends.

    Example:
        >>> minimum_jerk(0.5)
        (0.5, 1.875)
    """
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    s_2, rest = s * s, 1.0 - s
    return s_2 * s * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s_2 * rest * rest


@kernel
def bend_of_minimum_jerk(s: float) -> float:
    """Return the second slope of `minimum_jerk`.

    Args:
        s: Progress [-].

    Example:
        >>> bend_of_minimum_jerk(0.25)
        5.625
    """
    if s <= 0.0 or s >= 1.0:
        return 0.0
    return 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)


@kernel
def fill_com(piece: Record, s: float, omega: float, reference: Record) -> None:
    """Write CoM and ZMP of a phase, Eqs. (4), (5), (9), (10), s [s] after its start."""
    S, scale = piece.duration, piece.inverse_sinh
    u, v = omega * (S - s), omega * s
    su = sv = cu = cv = 0.0
    if scale != 0.0:
        su, sv, cu, cv = math.sinh(u), math.sinh(v), math.cosh(u), math.cosh(v)
    for axis in range(2):
        a = piece.curve[axis]
        q, dq, ddq = a[0], 0.0, 0.0
        if S > 0.0:
            x = s / S
            q += x * (a[1] + x * (a[2] + x * (a[3] + x * (a[4] + x * a[5]))))
            dq = a[1] + x * (2 * a[2] + x * (3 * a[3] + x * (4 * a[4] + x * 5 * a[5])))
            ddq = 2 * a[2] + x * (6 * a[3] + x * (12 * a[4] + x * 20 * a[5]))
            dq, ddq = dq / S, ddq / (S * S)
        hyperbolic = (su * a[6] + sv * a[7]) * scale
        reference.com[axis] = q + hyperbolic
        reference.com_velocity[axis] = dq + (cv * a[7] - cu * a[6]) * scale * omega
        reference.com_acceleration[axis] = ddq + omega * omega * hyperbolic
        reference.zmp[axis] = q - ddq / (omega * omega)


@kernel
def fill_heading(piece: Record, time: float, reference: Record) -> None:
    """Write the heading of a phase at a time [s] into a record."""
    begin, end = piece.turn_start, piece.turn_end
    s = min(max(time, begin), end) - begin
    a, b, c, d = piece.turn[0], piece.turn[1], piece.turn[2], piece.turn[3]
    reference.heading = ((a * s + b) * s + c) * s + d
    reference.heading_rate = (3.0 * a * s + 2.0 * b) * s + c


@kernel
def fill_feet(piece: Record, s: float, reference: Record) -> None:
    r"""Write both feet of a phase at the time s after its start [s] into a record.

    The paper only says that the shifting leg makes a step. Here the swing foot rises
    and lands with zero velocity and acceleration,

    .. math:: z = 64\, h_{max} x^3 (1-x)^3, \quad x = s / S

    and travels by `minimum_jerk` in the middle 96 % of the swing, so that it leaves
    and meets the ground vertically.
    """
    for k in range(2):
        foot, pose = reference.feet[k], piece.resting[k]
        foot.position[0], foot.position[1] = pose[0], pose[1]
        foot.position[2], foot.yaw = 0.0, pose[2]
        for i in range(3):
            foot.velocity[i] = foot.acceleration[i] = 0.0
        foot.yaw_rate = foot.yaw_acceleration = 0.0
    swinging = piece.swinging
    if swinging < 0:
        return
    S, height = piece.duration, piece.clearance
    if piece.path_time > 0.0:
        _fill_path(piece, s, reference.feet[swinging])
        return
    x = s / S
    middle = (x - VERTICAL_SHARE) / _MIDDLE
    h, dh = minimum_jerk(middle)
    dh /= _MIDDLE * S
    ddh = bend_of_minimum_jerk(middle) / (_MIDDLE * S) ** 2
    bow, slope = x * (1.0 - x), 1.0 - 2.0 * x
    foot = reference.feet[swinging]
    for i in range(2):
        foot.position[i] += h * piece.travel[i]
        foot.velocity[i] = dh * piece.travel[i]
        foot.acceleration[i] = ddh * piece.travel[i]
    foot.yaw += h * piece.travel[2]
    foot.yaw_rate = dh * piece.travel[2]
    foot.yaw_acceleration = ddh * piece.travel[2]
    foot.position[2] = height * (64.0 * bow**3)
    foot.velocity[2] = height * (192.0 * bow * bow * slope / S)
    foot.acceleration[2] = height * (384.0 * bow * (slope * slope - bow) / (S * S))


@kernel
def _cubic_at(c: np.ndarray, s: float, T: float) -> tuple[float, float, float]:
    """Return value, rate and acceleration of a cubic of s = t / T."""
    x = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
    v = c[1] + s * (2.0 * c[2] + s * 3.0 * c[3])
    return x, v / T, (2.0 * c[2] + s * 6.0 * c[3]) / (T * T)


@kernel
def _fill_path(piece: Record, s: float, foot: Record) -> None:
    """Write a swing foot that was sent elsewhere on its way."""
    T, lift = piece.path_time, 16.0 * piece.path_lift
    t = min(max(piece.start + s - piece.path_start, 0.0), T) / T
    for i in range(3):
        x, v, a = _cubic_at(piece.path[i], t, T)
        foot.position[i], foot.velocity[i], foot.acceleration[i] = x, v, a
    foot.yaw, foot.yaw_rate, foot.yaw_acceleration = _cubic_at(piece.path[3], t, T)
    bow, slope = t * (1.0 - t), 1.0 - 2.0 * t
    foot.position[2] += lift * bow * bow
    foot.velocity[2] += lift * 2.0 * bow * slope / T
    foot.acceleration[2] += lift * 2.0 * (slope * slope - 2.0 * bow) / (T * T)


# Not of Python's int, of which a kernel would be compiled for each value.
STAND, START, DOUBLE = (
    np.int64(Phase.STAND),
    np.int64(Phase.START),
    np.int64(Phase.DOUBLE),
)
SINGLE_LEFT, SINGLE_RIGHT = np.int64(Phase.SINGLE_LEFT), np.int64(Phase.SINGLE_RIGHT)
STOP = np.int64(Phase.STOP)
