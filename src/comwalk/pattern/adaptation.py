r"""Step adaptation: footholds and touchdowns that move with the measured CoM.

What a push changes shows in the divergent component of motion (DCM) of the pendulum,
:math:`\xi = c + \dot c / \omega_n`, which leaves a constant ZMP p by

.. math:: \xi(t) = p + (\xi_0 - p) \, e^{\omega_n t}

From the measured DCM, the ankles reach the planned one, :math:`\xi_\tau` at touchdown
after the time tau, if they hold the ZMP at

.. math:: p = \frac{\xi_0 e^{\omega_n \tau} - \xi_\tau}{e^{\omega_n \tau} - 1}

As long as that is inside the sole, nothing is done: the walking law holds the CoM. If
it is not, p is held at the sole's edge and the foothold u follows: in the double
support of the time D the CoM keeps its velocity, and after it the DCM is to be b ahead
of u, as planned, so that

.. math:: u = \xi(T) + \omega_n D \, (\xi(T) - c(T)) - b

It is clipped to what the legs reach and the swing foot can travel in T, which is the
best of a few times: the one that misses u least, and then moves foot and touchdown
least. From there the plan goes on with the measured CoM, and later steps come back to
where they were headed, a bit each.

Footholds are chosen in the frame of the stance foot: ahead, and towards the swing foot.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ..compiled import Record, kernel, records
from .records import ADAPTATION
from .reference import SINGLE_LEFT, SINGLE_RIGHT, STAND, STOP
from .replan import pass_through, plan_ahead, shift, step_out
from .turns import turn

CANDIDATES = 24
"""Touchdowns that are tried [-]."""
MISSING, MOVING, HURRYING = 1200.0, 2.4, 0.07
"""Costs of missing the DCM, of moving a foothold, both in CoM heights, and of moving
its touchdown, in 1 / omega_n [-]."""
SPARED = 0.6
"""Share of the sole by which the DCM may be missed at no cost [-]."""
TOLERATED = 0.03
"""Miss of the DCM at touchdown that moves no step, in CoM heights [-]."""
FROZEN, SHORTEST, WAITING, TRANSFER = 0.19, 0.4, 0.08, 0.06
"""Times in 1 / omega_n: before touchdown, in which a foot goes where it was sent; the
shortest that a foot is sent anywhere; after lift-off, in which nothing is decided; of
the double support after a step that was moved [-]."""
FORESIGHT = 0.4
"""How long before a leg has to reach far the CoM is low enough, in 1 / omega_n [-]."""
LOWERING, RISING = 3.0, 1.5
"""How fast the CoM is lowered and lifted again, over omega_n [-]."""
LIFTING = 15.0
"""Acceleration with which a foot that is sent elsewhere is lifted [m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class Agility:
    """What legs can do to catch a fall; see `certificates.agility_of`."""

    half: tuple[float, float]
    """Half length and half width of the sole that the ZMP may use [m]."""
    leg: float
    """Longest distance of hip and ankle [m]."""
    tall: float
    """Height of the hips over the ankles, standing [m]."""
    hip: tuple[float, float]
    """Point below the CoM that the left sole has its hip over, ahead and left [m]."""
    lowest: float
    """Most that the CoM is lowered [m]."""
    aside: float
    """Farthest foothold aside of the stance foot [m]."""
    beside: float
    """Nearest foothold aside of the stance foot [m]."""
    speed: float
    """Mean speed of a swing foot [m/s]."""
    rush: float
    """Greatest acceleration of a swing foot [m/s^2]."""

    @property
    def swings(self) -> float:
        """Farthest foothold ahead of the CoM, or behind it, on lowered hips [m]."""
        low = self.tall - self.lowest
        return math.sqrt(max(self.leg**2 - low**2, 0.0))


def adaptation_record(agility: Agility, omega: float, height: float) -> np.ndarray:
    """Return a record of `ADAPTATION` for a walk.

    Args:
        agility: What the legs can do.
        omega: Natural frequency omega_n of the pendulum [rad/s].
        height: Its height [m].
    """
    found = records(ADAPTATION)
    how = found[0]
    for field in dataclasses.fields(agility):
        how[field.name] = getattr(agility, field.name)
    how["swings"], how["omega"], how["height"] = agility.swings, omega, height
    how["start"] = -math.inf
    return found


# ---- Deciding ------------------------------------------------------------------------


@kernel
def adapt(
    table: np.ndarray,
    state: Record,
    command: Record,
    work: np.ndarray,
    steps: np.ndarray,
    how: Record,
    reference: Record,
    com: np.ndarray,
    velocity: np.ndarray,
    away: np.ndarray,
) -> bool:
    """Move the step that is being made, if the ankles cannot hold the CoM.

    Args:
        table: The phases from now on.
        state: Where the pattern is, a record of `ONLINE`.
        command: What is walked, a record of `COMMAND`.
        work: Scratch, records of `WORK`.
        steps: The footsteps that are followed, records of `STEP`.
        how: A record of `ADAPTATION`.
        reference: The reference of now.
        com: Measured CoM [m], world.
        velocity: Its velocity [m/s], world.
        away: Where the stance foot is from its reference [m; rad]; less where the
            robot's CoM is from the model's, so that it tells what the sole can bear.

    Returns:
        Whether the plan changed: the reference then has to be looked up again.
    """
    piece, time, omega = table[0], reference.time, how.omega
    if _rests(piece, command):
        stance = _falls(how, piece, reference, com, velocity)
        if stance < 0:
            return False
        step_out(table, state, command, work, steps, reference, stance)
        how.moved = 1  # so that it is sent elsewhere at once
    if piece.kind != SINGLE_LEFT and piece.kind != SINGLE_RIGHT:
        return False
    if how.start != piece.start:
        _begin_step(how, piece, table[2])
    left, since = piece.start + piece.duration - time, time - piece.start
    if omega * left < FROZEN or (omega * since < WAITING and not how.active):
        return False
    _see(how, piece, reference, com, velocity, away)
    if _is_held(how, table[1], omega * left):
        return False
    T = _choose(how, time, left)
    how.moves += how.moved == 0
    how.moved = how.active = 1
    _send(how, piece, reference, time, T)
    _go_on(table, state, command, work, steps, how, time, com, velocity)
    return True


@kernel
def _rests(piece: Record, command: Record) -> bool:
    """Return whether the robot stands, or comes to rest, and no step is planned."""
    ends = piece.kind == STAND or piece.kind == STOP
    return ends and piece.landed >= command.steps and not command.walk


@kernel
def _falls(
    how: Record, piece: Record, reference: Record, com: np.ndarray, velocity: np.ndarray
) -> int:
    """Return on which foot to step out where the DCM leaves the soles, or -1."""
    c, s, feet = math.cos(reference.heading), math.sin(reference.heading), piece.resting
    x, y = com[0] + velocity[0] / how.omega, com[1] + velocity[1] / how.omega
    x, y = x - 0.5 * (feet[0, 0] + feet[1, 0]), y - 0.5 * (feet[0, 1] + feet[1, 1])
    u, v = 0.5 * (feet[0, 0] - feet[1, 0]), 0.5 * (feet[0, 1] - feet[1, 1])
    x, y, u, v = c * x + s * y, c * y - s * x, c * u + s * v, c * v - s * u
    held = abs(x) <= abs(u) + how.half[0] and abs(y) <= abs(v) + how.half[1]
    return -1 if held else (0 if y >= 0.0 else 1)


@kernel
def start_state(piece: Record, axis: int, omega: float) -> tuple[float, float]:
    """Return CoM [m] and velocity [m/s] of one axis at the start of a phase."""
    q, S, csch = piece.curve[axis], piece.duration, piece.inverse_sinh
    c, v = q[0], q[1] / S
    if csch != 0.0:
        c += q[6]
        v += omega * (q[7] * csch - q[6] / math.tanh(omega * S))
    return c, v


@kernel
def _begin_step(how: Record, piece: Record, after: Record) -> None:
    """Remember what a step was planned to be."""
    how.active, how.moved, how.start = how.moved, 0, piece.start
    how.until = piece.start + piece.duration
    for i in range(2):
        c, v = start_state(after, i, how.omega)
        how.foothold[i] = piece.resting[piece.swinging, i] + piece.travel[i]
        how.lead[i] = c + v / how.omega - how.foothold[i]


@kernel
def _turned(how: Record, x: float, y: float) -> tuple[float, float]:
    """Return a way in the frame of the stance foot."""
    return how.cos * x + how.sin * y, how.sign * (how.cos * y - how.sin * x)


@kernel
def _placed(how: Record, x: float, y: float) -> tuple[float, float]:
    """Return a point of the frame of the stance foot, world."""
    y *= how.sign
    x, y = how.cos * x - how.sin * y, how.sin * x + how.cos * y
    return how.origin[0] + x, how.origin[1] + y


@kernel
def _see(
    how: Record,
    piece: Record,
    reference: Record,
    com: np.ndarray,
    velocity: np.ndarray,
    away: np.ndarray,
) -> None:
    """Find the frame of the stance foot, and what matters in it."""
    swing, stance = reference.feet[piece.swinging], piece.resting[1 - piece.swinging]
    how.origin[0], how.origin[1] = stance[0] + away[0], stance[1] + away[1]
    how.cos, how.sin = math.cos(stance[2]), math.sin(stance[2])
    how.sign = 1.0 if piece.swinging == 0 else -1.0
    x, y, o = com[0], com[1], how.origin
    how.com[0], how.com[1] = _turned(how, x - o[0], y - o[1])
    how.rate[0], how.rate[1] = _turned(how, velocity[0], velocity[1])
    x, y = how.foothold[0], how.foothold[1]
    how.planned[0], how.planned[1] = _turned(how, x - o[0], y - o[1])
    how.ahead[0], how.ahead[1] = _turned(how, how.lead[0], how.lead[1])
    x, y = swing.position[0], swing.position[1]
    how.foot[0], how.foot[1] = _turned(how, x - o[0], y - o[1])
    x, y = swing.velocity[0], swing.velocity[1]
    how.foot_rate[0], how.foot_rate[1] = _turned(how, x, y)


@kernel
def _is_held(how: Record, after: Record, angle: float) -> bool:
    """Return whether a ZMP in the sole brings the DCM to its plan at touchdown.

    What is missed little before a step is moved, the next one takes.
    """
    grown, least = math.exp(angle), 0.0 if how.moved else TOLERATED * how.height
    x, v = start_state(after, 0, how.omega)
    y, w = start_state(after, 1, how.omega)
    x, y = x + v / how.omega - how.origin[0], y + w / how.omega - how.origin[1]
    x, y = _turned(how, x, y)
    x = ((how.com[0] + how.rate[0] / how.omega) * grown - x) / (grown - 1.0)
    y = ((how.com[1] + how.rate[1] / how.omega) * grown - y) / (grown - 1.0)
    missed = max(abs(x) - how.half[0], abs(y) - how.half[1])
    return missed * (grown - 1.0) <= least


# ---- Choosing ------------------------------------------------------------------------


@kernel
def clamp(x: float, low: float, high: float) -> float:
    """Return the nearest number that is not below low, and not above high."""
    return max(min(x, high), low)


@kernel
def _choose(how: Record, time: float, left: float) -> float:
    """Write the best foothold into `goal`, and return the time until touchdown [s]."""
    latest = max(how.until - time, FROZEN / how.omega)
    soonest = min(SHORTEST / how.omega, left)
    best, chosen = math.inf, latest
    for n in range(CANDIDATES):
        T = soonest + (latest - soonest) * n / (CANDIDATES - 1)
        cost, x, y, drop = _try(how, T)
        cost += HURRYING * (how.omega * (T - latest)) ** 2
        if cost < best:
            best, chosen = cost, T
            how.goal[0], how.goal[1], how.drop = x, y, drop
    return chosen


@kernel
def _try(how: Record, T: float) -> tuple[float, float, float, float]:
    """Return what a touchdown after T costs, its foothold and the CoM's drop [m]."""
    hip, k = how.hip, TRANSFER
    l_x, m_x, w_x = _land(how, 0, T)
    l_y, m_y, w_y = _land(how, 1, T)
    low, high = _way(how, how.foot_rate[0], T)
    x = clamp(l_x, m_x - how.swings, m_x + how.swings)
    x = clamp(x, how.foot[0] + low, how.foot[0] + high)
    low, high = _way(how, how.foot_rate[1], T)
    y = clamp(l_y, how.beside, how.aside)
    y = clamp(y, how.foot[1] + low, how.foot[1] + high)
    # How far from below their hips both feet are, one lifted after double support.
    ahead = math.hypot(x - m_x - hip[0], y - m_y - hip[1])
    w_x, w_y = m_x + k * w_x / how.omega, m_y + k * w_y / how.omega
    behind = math.hypot(w_x + hip[0], w_y - hip[1])
    missed = max(abs(l_x - x) - SPARED * how.half[0], 0.0)
    missed += max(behind - how.swings, 0.0)
    aside = max(abs(l_y - y) - SPARED * how.half[1], 0.0)
    moved = (x - how.planned[0]) ** 2 + (y - how.planned[1]) ** 2
    cost = MISSING * (missed * missed + aside * aside) + MOVING * moved
    far = max(ahead, behind)
    tall = math.sqrt(max(how.leg * how.leg - far * far, 0.0))
    return cost / (how.height * how.height), x, y, how.tall - tall


@kernel
def _land(how: Record, axis: int, T: float) -> tuple[float, float, float]:
    """Return how a swing of the time T would end along one axis.

    Returns:
        The foothold that the DCM asks for, with the ZMP held in the sole; the CoM at
        touchdown [m]; and its velocity [m/s].
    """
    omega, h, k = how.omega, how.half[axis], TRANSFER
    e, c, v = math.exp(omega * T), how.com[axis], how.rate[axis]
    grows, fades = c + v / omega, c - v / omega
    # The foothold is linear in the ZMP.
    free = (1.0 + 0.5 * k) * grows * e - 0.5 * k * fades / e - how.ahead[axis]
    slope = (1.0 + 0.5 * k) * (1.0 - e) - 0.5 * k * (1.0 - 1.0 / e)
    p = clamp((how.planned[axis] - free) / slope, -h, h)
    grows, fades = (grows - p) * e, (fades - p) / e
    return free + slope * p, p + 0.5 * (grows + fades), 0.5 * omega * (grows - fades)


@kernel
def _way(how: Record, v: float, T: float) -> tuple[float, float]:
    """Return how far back and ahead a foot of some velocity can come to rest in T [m].

    On a cubic, whose acceleration is greatest at its ends.
    """
    most, far = how.rush * T * T / 6.0, how.speed * T
    low = max(v * T / 3.0, v * T / 1.5) - most
    high = min(v * T / 3.0, v * T / 1.5) + most
    if low > high:
        low = high = 0.5 * (low + high)
    return max(low, -far), min(high, far)


# ---- Going on ------------------------------------------------------------------------


@kernel
def _cubic(out: np.ndarray, T: float, x: float, v: float, y: float) -> None:
    """Write the cubic from x, v to rest at y in T; its argument is 0 to 1."""
    d, v = y - x, v * T
    out[0], out[1], out[2], out[3] = x, v, 3.0 * d - 2.0 * v, v - 2.0 * d


@kernel
def _send(how: Record, piece: Record, reference: Record, time: float, T: float) -> None:
    """Send the swing foot from where it is to the goal, to land after T."""
    k, path = piece.swinging, piece.path
    foot, rest = reference.feet[k], piece.resting[k]
    x, y = _placed(how, how.goal[0], how.goal[1])
    piece.travel[0], piece.travel[1] = x - rest[0], y - rest[1]
    piece.duration = time - piece.start + T
    piece.path_start, piece.path_time = time, T
    _cubic(path[0], T, foot.position[0], foot.velocity[0], x)
    _cubic(path[1], T, foot.position[1], foot.velocity[1], y)
    _cubic(path[2], T, foot.position[2], foot.velocity[2], 0.0)
    _cubic(path[3], T, foot.yaw, foot.yaw_rate, rest[2] + piece.travel[2])
    middle = 0.5 * foot.position[2] + 0.125 * T * foot.velocity[2]
    piece.path_lift = clamp(piece.clearance - middle, 0.0, LIFTING * T * T / 32.0)


@kernel
def _go_on(
    table: np.ndarray,
    state: Record,
    command: Record,
    work: np.ndarray,
    steps: np.ndarray,
    how: Record,
    time: float,
    com: np.ndarray,
    velocity: np.ndarray,
) -> None:
    """Plan on from the measured CoM, with the ZMP inside the sole until touchdown."""
    piece, omega, since = table[0], command.omega, time - table[0].start
    stop = plan_ahead(table, 1, state, command, steps)
    state.rows = stop + 2
    haste = table[1].duration - TRANSFER / omega
    if haste > 0.0:
        table[1].duration -= haste
        for j in range(2, stop + 2):
            table[j].start -= haste
    for i in range(2):
        pass_through(piece, since, i, com[i], velocity[i], how.origin[i], omega)
    shift(table, 0, stop, since, omega, command.minjerk, work)
    x, y = piece.curve[0, 0] - how.origin[0], piece.curve[1, 0] - how.origin[1]
    x, y = _turned(how, x, y)
    x, y = clamp(x, -how.half[0], how.half[0]), clamp(y, -how.half[1], how.half[1])
    x, y = _placed(how, x, y)
    pass_through(piece, since, 0, com[0], velocity[0], x, omega)
    pass_through(piece, since, 1, com[1], velocity[1], y, omega)
    turn(table, state, command, stop + 1, time, work)


# ---- The height of the CoM -----------------------------------------------------------


@kernel
def lower(
    how: Record,
    reference: Record,
    com: np.ndarray,
    velocity: np.ndarray,
    period: float,
) -> None:
    """Lower the CoM as far as both legs reach their feet, after a step was moved.

    Args:
        how: A record of `ADAPTATION`.
        reference: The reference, whose CoM is lowered.
        com: Measured CoM [m], world.
        velocity: Its velocity [m/s], world.
        period: Control period [s].
    """
    drop = how.drop if how.moved else 0.0
    if how.active:
        for k in range(2):
            for n in range(2):
                t = n * FORESIGHT / how.omega
                far = _reach(how, reference, k, com, velocity, t)
                tall = math.sqrt(max(how.leg * how.leg - far * far, 0.0))
                drop = max(drop, how.tall - tall)
        drop = clamp(drop, 0.0, how.lowest)
    k_s = how.omega * (LOWERING if drop > how.sink else RISING)
    bend = k_s * (k_s * (drop - how.sink) - 2.0 * how.sink_rate)
    how.sink_rate += period * bend
    how.sink += period * how.sink_rate
    reference.com[2] -= how.sink
    reference.com_velocity[2] -= how.sink_rate
    reference.com_acceleration[2] -= bend


@kernel
def _reach(
    how: Record,
    reference: Record,
    k: int,
    com: np.ndarray,
    velocity: np.ndarray,
    t: float,
) -> float:
    """Return how far foot k is from below its hip, some time ahead [m]."""
    foot = reference.feet[k]
    x = foot.position[0] - com[0] + t * (foot.velocity[0] - velocity[0])
    y = foot.position[1] - com[1] + t * (foot.velocity[1] - velocity[1])
    c, s = math.cos(reference.heading), math.sin(reference.heading)
    side = how.hip[1] if k == 0 else -how.hip[1]
    return math.hypot(c * x + s * y - how.hip[0], c * y - s * x - side)
