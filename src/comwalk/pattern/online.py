r"""Replanning while walking: new footsteps, speeds and turns at any time.

The pattern of `pattern` needs all footsteps beforehand. Here only a few steps ahead are
known; behind them the plan always ends in a stop, which the robot walks safely if
nothing more comes. What has been walked cannot change: from the CoM c and its velocity
now, the rest of a phase keeps its ZMP but for a constant

.. math:: p(t) = p^{old}(t) + \delta, \quad
    \delta = \frac{u - c^{old}(\tau)}{1 - \cosh \omega_n \tau}

over the time tau that is left of it, with u the CoM at its end. u and its velocity then
obey :math:`v = v^{old} + \kappa (u - c^{old})` with
:math:`\kappa = \omega_n \coth(\omega_n \tau / 2) > 0`, one more row of the tridiagonal
system of `planning`, whose solution is the new plan. Nothing is known sooner by
planning later: as long as the footsteps stay, delta stays 0.

A foot in the air lands where it was sent, and so does a weight that moves. In double
support, or when less than `OnlinePattern.least_time` is left of a phase, delta acts in
the next single support, where it is small.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from ..compiled import Record, kernel
from ..errors import ParameterError, PlanError, checked_number
from ..sides import Side
from . import phases as p
from . import records as r
from .footsteps import (
    PAPER_GAIT,
    PAPER_SOLE,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
    checked_count,
)
from .pendulum import PAPER_PENDULUM, Pendulum
from .placement import MAX_STRIDE, MAX_TOE
from .reference import fill_reference, reference_of
from .walk_pattern import MIN_MINJERK, Reference

STEPS_AHEAD = 4
"""Steps that are planned beyond the one that is being made [-]. What is not yet known
after four moves the ZMP by less than 0.001 mm."""

LEAST_TIME = 0.15
"""Shortest rest of a phase [s] that is changed; later the next single support is."""

Driver = Callable[["OnlinePattern", float], None]
"""Called with the pattern and the time [s] before each reference: the joystick."""

# What the kernels know. The command:

_LENGTH, _SHIFT, _TURN, _WIDTH = 0, 1, 2, 3  # of a step: 2 B, sideways, turn, A
_SINGLE, _DOUBLE, _CLEARANCE, _START, _STOP = 4, 5, 6, 7, 8  # times and height
_WALK, _GIVEN, _GIVEN_POSE = 9, 10, 11  # whether to walk, one foothold of one's own
_AHEAD, _LEAST, _MINJERK, _OMEGA, _SOLE, _FIRST = 14, 15, 16, 17, 18, 20
_COMMAND_SIZE = 21

# The state:

_ROWS, _KNOT, _KNOT_YAW = 0, 1, 2  # rows of the table in use, last knot of the heading
_LAST_SINGLE, _LAST_DOUBLE, _LAST_CLEARANCE = 3, 4, 5  # of the last step that landed
_STATE_SIZE = 6


class OnlinePattern:
    """A pattern that is commanded while it is walked. Final.

    It stands until it is told to walk. `walk` takes it for a `Pattern`. Its numbers are
    kept in arrays that are allocated once: a tick is one call of compiled code.

    Example:
        >>> online = OnlinePattern(duration=20.0)
        >>> online.set_velocity(forward=0.2)
        >>> round(float(online.at(3.0).com_velocity[0]), 3)
        0.129
        >>> online.stop()
        >>> round(float(online.at(12.0).com_velocity[0]), 3)
        0.0
    """

    def __init__(
        self,
        gait: Gait = PAPER_GAIT,
        pendulum: Pendulum = PAPER_PENDULUM,
        *,
        duration: float = math.inf,
        driver: Driver | None = None,
        sole_size: tuple[float, float] = PAPER_SOLE,
        ahead: int = STEPS_AHEAD,
        least_time: float = LEAST_TIME,
    ) -> None:
        """Stand with the feet at (0, +-A).

        Args:
            gait: Times, width and clearance of the steps; its length, shift and turn
                count when `walk_on` is called.
            pendulum: Gives omega_n and c_z.
            duration: When `walk` ends [s], above 0.
            driver: Called before each reference: it gives the commands.
            sole_size: Length and width of each sole [m].
            ahead: Steps planned beyond the one being made, in [2, 50].
            least_time: Shortest rest of a phase that is changed [s], in [0.02, 1].

        Raises:
            ParameterError: If a number is out of its range.
            PlanError: If the double support is too short for "minjerk".
        """
        name = "duration"
        if duration != math.inf:
            checked_number(name, duration, unit="s", low=0.0, open_low=True)
        self.duration = float(duration)
        """When `walk` ends [s]."""
        self.driver = driver
        """Called before each reference."""
        self.pendulum = pendulum
        """The simplified model that links CoM and ZMP."""
        self.footsteps: list[Footstep] = []
        """The footsteps that have landed."""
        self.least_time = checked_number(
            "least_time", least_time, unit="s", low=0.02, high=1.0
        )
        """Shortest rest of a phase that is changed [s]."""
        ahead = checked_count("ahead", ahead, 2, 50)
        plan = FootstepPlan(
            left=Foothold(0.0, gait.half_width),
            right=Foothold(0.0, -gait.half_width),
            sole_size=sole_size,
        )
        self._feet = (plan.left, plan.right)
        self._row = np.zeros(1, r.REFERENCE)[0]
        self._table = np.zeros((2 * ahead + 8, r.PHASE_SIZE))
        self._work = np.zeros((len(self._table) + 2, p.WORK_COLUMNS))
        self._state = np.zeros(_STATE_SIZE)
        self._command = np.zeros(_COMMAND_SIZE)
        self._command[_AHEAD], self._command[_LEAST] = ahead, self.least_time
        self._command[_OMEGA] = pendulum.omega
        self._command[_SOLE : _SOLE + 2] = plan.sole_size
        self._time = 0.0
        self._stand(gait)

    def _stand(self, gait: Gait) -> None:
        """Begin to stand."""
        poses = [(foot.x, foot.y, foot.yaw) for foot in self._feet]
        self._state[_ROWS] = 1.0
        feet = np.ravel(poses)
        p.still(
            *(self._table[0], 0.0, gait.stand_time, p.STAND, 0.0, 0.0, 0.0, 0.0, feet)
        )
        self._gait = gait
        self._take(gait)

    @property
    def gait(self) -> Gait:
        """The steps that are commanded."""
        return self._gait

    @property
    def time(self) -> float:
        """Time of the last reference [s]."""
        return self._time

    @property
    def table(self) -> np.ndarray:
        """The phases from now to the stop, (k, `rows.PHASE_SIZE`); a view."""
        return self._table[: int(self._state[_ROWS])]

    @property
    def walks(self) -> bool:
        """Whether steps are commanded."""
        return bool(self._command[_WALK])

    def at(self, time: float) -> Reference:
        """Return the reference at a time.

        Args:
            time: Time [s], not before that of the last call. Before it, the driver is
                asked; its commands count from the last reference on.

        Returns:
            CoM, ZMP, feet, heading and support, world.

        Raises:
            ParameterError: If the time is not finite, or goes back.
        """
        return reference_of(self.fill(time))

    def fill(self, time: float) -> np.void:
        """Return the reference at a time as a record, without allocation.

        Args:
            time: Time [s], as for `at`.

        Returns:
            A record of `REFERENCE`; the same one each time.

        Raises:
            ParameterError: If the time is not finite, or goes back.
        """
        if not self._time <= time < math.inf:
            checked_number("time", time, unit="s")
            raise ParameterError(
                f"time cannot go back from {self._time:g} s to {time:g} s: what was "
                "walked stays; make a new OnlinePattern"
            )
        if self.driver is not None:
            self.driver(self, time)
        args = self._table, self._state, self._command, self._work
        while advance(*args, time, self.pendulum.height, self._row):
            self._note_landing()
        self._time = time
        return self._row

    def set_velocity(
        self, forward: float = 0.0, side: float = 0.0, turn: float = 0.0
    ) -> None:
        """Walk with a velocity of the body from the next step on that has not begun.

        All zero stops, as `stop` does. A step that would put a sole on the other, or is
        too long for the legs, is made as long as it may be.

        Args:
            forward: Speed forward [m/s], negative backward.
            side: Speed sideways [m/s], left positive.
            turn: Turning speed [rad/s], left positive.

        Raises:
            ParameterError: If a step would be out of the range of `Gait`.
        """
        T = self._gait.period
        values = {"forward": forward, "side": side, "turn": turn}
        limits = {"forward": 0.4 / T, "side": 0.2 / T, "turn": 0.8 / T}
        for name, value in values.items():
            unit, high = "rad/s" if name == "turn" else "m/s", limits[name]
            hint = f"with a period of {T:g} s"
            checked_number(name, value, unit=unit, low=-high, high=high, hint=hint)
        if not any(values.values()):
            self.stop()
            return
        self.walk_on(
            dataclasses.replace(
                self._gait,
                half_step=_within(forward * T / 2, 0.2),
                lateral=_within(side * T, 0.2),
                turn=_within(turn * T, 0.8),
            )
        )

    def walk_on(self, gait: Gait) -> None:
        """Walk with a gait from the next phase on that has not begun.

        Args:
            gait: Lengths and times; its start and stop count for the next ones.

        Raises:
            PlanError: If the style of double support differs while walking, or it is
                too short for "minjerk".
        """
        moves = int(self._state[_ROWS]) > 1
        if moves and gait.double_support != self._gait.double_support:
            raise PlanError("double_support can only change while the robot stands")
        self._take(gait)
        self._gait = gait
        self._command[_WALK] = 1.0
        self._replan()

    def set_next_step(self, foothold: Foothold) -> None:
        """Put the next foot that has not left the ground on a foothold of one's own.

        Without a velocity the robot makes this step, brings the other foot beside it
        and stops; with one it walks on from there.

        Args:
            foothold: Where the centre of its sole lands, world.

        Raises:
            PlanError: If the step is too long, turns too far, crosses the legs or puts
                one sole on the other.
        """
        pose = np.array([foothold.x, foothold.y, foothold.yaw])
        if not np.isfinite(pose).all():
            raise PlanError(f"a foothold must have finite numbers, got {foothold}")
        before = self._command.copy()
        self._command[_GIVEN] = 1.0
        self._command[_GIVEN_POSE : _GIVEN_POSE + 3] = pose
        first = before[_FIRST]
        for self._command[_FIRST] in (first, 1.0 - first):
            if given_is_walkable(self._table, self._command, self._work):
                break
        else:
            self._command[:] = before
            raise PlanError(
                f"{foothold} cannot be stepped on from where the other foot stands: it "
                "is too far, turned too much, or on the other foot's side"
            )
        self._replan()

    def stop(self) -> None:
        """Come to rest: the foot in the air lands, the other one comes beside it."""
        self._command[_WALK] = self._command[_GIVEN] = 0.0
        self._replan()

    def _take(self, gait: Gait) -> None:
        """Tell the kernels of a gait."""
        least, D = MIN_MINJERK / self.pendulum.omega, gait.double_support_time
        if gait.double_support == "minjerk" and least > D:
            raise PlanError(
                f'a double support of {D:g} s is too short for "minjerk": make '
                f"transfer_time at least {0.5 * least:.3g} s"
            )
        way = gait.lateral or gait.turn
        self._command[_LENGTH : _STOP + 1] = (
            *(2.0 * gait.half_step, gait.lateral, gait.turn, gait.half_width),
            *(gait.single_support_time, gait.double_support_time, gait.swing_height),
            *(gait.start_time, gait.stop_time),
        )
        self._command[_MINJERK] = float(gait.double_support == "minjerk")
        self._command[_FIRST] = 0.0 if way > 0.0 else 1.0

    def _replan(self) -> None:
        """Make the plan anew from the last reference on."""
        replan(self._table, self._state, self._command, self._work, self._time)

    def _note_landing(self) -> None:
        """Remember where the last foot landed, and how long it took."""
        piece = self._table[0]
        foot = 1 - int(piece[r.BASES])
        x, y, yaw = piece[r.RESTING + 3 * foot : r.RESTING + 3 * foot + 3].tolist()
        S, D, height = self._state[_LAST_SINGLE : _LAST_CLEARANCE + 1].tolist()
        self.footsteps.append(
            Footstep(
                side=Side.LEFT if foot == 0 else Side.RIGHT,
                x=x,
                y=y,
                yaw=yaw,
                single_support=S,
                double_support=D,
                swing_height=height,
            )
        )


def _within(value: float, limit: float) -> float:
    """Return a number that rounding may have put outside its limits."""
    return min(max(value, -limit), limit)


# A tick.


@kernel
def advance(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    work: np.ndarray,
    time: float,
    height: float,
    reference: Record,
) -> bool:
    """Go on to a time and write its reference into a record, or to a landing before it.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, two rows more than the table.
        time: Time [s], not before the last one.
        height: Height of the CoM [m].
        reference: Where to write, a record of `REFERENCE`.

    Returns:
        Whether a foot has just landed: then the record is not written yet.
    """
    while state[_ROWS] > 1.0 and time >= table[1, r.START]:
        landed = leave(table, state)
        kind, begin = int(table[0, r.KIND]), table[0, r.START]
        if kind == p.DOUBLE:
            state[_KNOT_YAW] = p.mean_yaw(table[0], state[_KNOT_YAW])
            state[_KNOT] = begin
        elif kind != p.STOP and kind != p.START:
            if kind != p.STAND:
                command[_GIVEN] = 0.0
            replan(table, state, command, work, begin)
        if landed:
            return True
    fill_reference(table[:1], command[_OMEGA], height, time, reference)
    return False


@kernel
def leave(table: np.ndarray, state: np.ndarray) -> bool:
    """Forget the phase that is over; return whether a foot landed at its end."""
    landed = table[0, r.SWINGING] >= 0.0
    if landed:
        state[_LAST_SINGLE] = table[0, r.DURATION]
        state[_LAST_CLEARANCE] = table[0, r.CLEARANCE]
    elif int(table[0, r.KIND]) == p.DOUBLE:
        state[_LAST_DOUBLE] = table[0, r.DURATION]
    count = int(state[_ROWS])
    for i in range(count - 1):
        table[i] = table[i + 1]
    state[_ROWS] = count - 1
    return landed


@kernel
def replan(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    work: np.ndarray,
    time: float,
) -> bool:
    """Make all phases anew that have not begun, and the rest of this one.

    Args:
        table: The phases from now on.
        state: How many they are, and the last knot of the heading.
        command: What is to be walked.
        work: Scratch, two rows more than the table.
        time: Time of now [s].

    Returns:
        Whether there is a new plan: a robot that stops first comes to rest.
    """
    kept = kept_rows(table, state, command, time)
    if kept == 0:
        if int(table[0, r.KIND]) == p.STAND:
            state[_ROWS] = 1.0
        return False
    omega, minjerk = command[_OMEGA], command[_MINJERK] != 0.0
    if int(table[0, r.KIND]) == p.STAND:
        begin_walk(table, state, command, time)
    double = int(table[kept - 1, r.KIND]) == p.DOUBLE
    pivot = kept if double else kept - 1
    since = max(time - table[pivot, r.START], 0.0)
    stop = add_steps(table, kept, command, work)
    state[_ROWS] = stop + 2
    if int(table[0, r.KIND]) == p.STAND:
        kappa = p.fill_start(table[1], omega, minjerk)
        x, y = p.weight_point(table[1], 0)
        p.link(table, 2, stop, omega, minjerk, kappa, kappa * x, kappa * y, work)
        p.place_start(table[1], work[0, 2], work[0, 3])
    else:
        if pivot > 0:
            fill_from_state(table[pivot - 1], table[pivot], omega)
        shift(table, pivot, stop, since, omega, minjerk, work)
    turn(table, state, command, stop + 1, time, work)
    return True


@kernel
def kept_rows(
    table: np.ndarray, state: np.ndarray, command: np.ndarray, time: float
) -> int:
    """Return how many phases stay as they are, or 0 if nothing can change."""
    kind, count = int(table[0, r.KIND]), int(state[_ROWS])
    if kind == p.STAND:
        return 2 if command[_WALK] + command[_GIVEN] > 0.0 else 0
    if kind == p.STOP:
        return 0
    late = table[0, r.START] + table[0, r.DURATION] - time < command[_LEAST]
    kept = 1 if kind == p.DOUBLE or not late else 2
    last = table[kept - 1]
    ends = int(last[r.KIND]) == p.DOUBLE and last[r.LOADS + 1] == 0.5
    return 0 if ends or kept >= count else kept


@kernel
def begin_walk(
    table: np.ndarray, state: np.ndarray, command: np.ndarray, time: float
) -> None:
    """Write the start from rest after the row of standing."""
    stand = table[0]
    begin = max(time, stand[r.START] + stand[r.DURATION])
    stand[r.DURATION] = begin - stand[r.START]
    base = 1.0 - command[_FIRST]
    feet = stand[r.RESTING : r.RESTING + 6]
    landed, yaw = stand[r.LANDED], stand[r.TURN + 3]
    p.still(table[1], begin, command[_START], p.START, landed, base, 0.0, 1.0, feet)
    stand[r.BASES] = stand[r.BASES + 1] = base
    state[_KNOT], state[_KNOT_YAW] = begin, p.mean_yaw(stand, yaw)
    for row in range(2):
        piece, yaw = table[row], state[_KNOT_YAW]
        p.set_turn(piece, begin, 1.0, yaw, 0.0, yaw, 0.0, begin)


# The footsteps.


@kernel
def add_steps(
    table: np.ndarray, kept: int, command: np.ndarray, work: np.ndarray
) -> int:
    """Write the steps after the phases that are kept; return the row of the stop."""
    last = table[kept - 1]
    kind = int(last[r.KIND])
    feet, step, i = work[-1, :6], work[-2], kept
    foot = feet_after(last, feet)
    swinging = last[r.SWINGING]
    step[4], step[5], step[6] = command[_SINGLE], command[_DOUBLE], command[_CLEARANCE]
    ahead = int(command[_AHEAD]) + (0 if swinging >= 0.0 else 1)
    walking = ahead - 1 if command[_WALK] != 0.0 else 0
    body = body_beside(feet[3 - 3 * foot : 6 - 3 * foot], 1 - foot, command[_WIDTH])
    n = 0
    while True:
        closing = n >= walking and not (n == 0 and command[_GIVEN] != 0.0)
        body = next_foothold(feet, foot, body, n, closing, command, step)
        if closing and n + (swinging >= 0.0) > 0 and is_there(feet, foot, step):
            break
        if i > kept or kind != p.DOUBLE:
            p.add_double(table, i, feet, float(1 - foot), command[_DOUBLE])
            i += 1
        p.add_single(table, i, feet, step)
        i, n, foot = i + 1, n + 1, 1 - foot
        if closing:
            break
    p.add_end(table, i, feet, command[_DOUBLE], command[_STOP], 0.0)
    return i + 1


@kernel
def feet_after(piece: np.ndarray, feet: np.ndarray) -> int:
    """Write where the feet are when a phase ends; return which one swings next."""
    feet[:] = piece[r.RESTING : r.RESTING + 6]
    swinging = int(piece[r.SWINGING])
    if swinging < 0:
        return 1 - int(piece[r.BASES + 1])
    for k in range(3):
        feet[3 * swinging + k] += piece[r.TRAVEL + k]
    return 1 - swinging


@kernel
def body_beside(
    pose: np.ndarray, foot: int, half_width: float
) -> tuple[float, float, float]:
    """Return the pose of the body that has a foot of a pose at its side."""
    x, y, yaw = pose[0], pose[1], pose[2]
    across = -half_width if foot == 0 else half_width
    return x - math.sin(yaw) * across, y + math.cos(yaw) * across, yaw


@kernel
def next_foothold(
    feet: np.ndarray,
    foot: int,
    body: tuple[float, float, float],
    n: int,
    closing: bool,
    command: np.ndarray,
    step: np.ndarray,
) -> tuple[float, float, float]:
    """Write where a foot goes next into a step; return where the body is then."""
    step[0] = foot
    if n == 0 and command[_GIVEN] != 0.0:
        step[1:4] = command[_GIVEN_POSE : _GIVEN_POSE + 3]
        return body_beside(step[1:4], foot, command[_WIDTH])
    x, y, yaw = body
    if not closing:
        leading = 0 if command[_SHIFT] > 0.0 else 1
        shift = 2.0 * command[_SHIFT] if foot == leading else 0.0
        half = yaw + 0.5 * command[_TURN]
        cos, sin, ahead = math.cos(half), math.sin(half), command[_LENGTH]
        x, y = x + cos * ahead - sin * shift, y + sin * ahead + cos * shift
        yaw += command[_TURN]
    across = command[_WIDTH] if foot == 0 else -command[_WIDTH]
    step[1], step[2] = x - math.sin(yaw) * across, y + math.cos(yaw) * across
    step[3] = yaw
    if shorten(feet, foot, step, command):
        return body_beside(step[1:4], foot, command[_WIDTH])
    return x, y, yaw


@kernel
def is_there(feet: np.ndarray, foot: int, step: np.ndarray) -> bool:
    """Return whether a foot already stands where a step would put it."""
    at = 3 * foot
    far = max(abs(feet[at] - step[1]), abs(feet[at + 1] - step[2]))
    return max(far, abs(p.wrapped(feet[at + 2] - step[3]))) < 1e-9


@kernel
def shorten(feet: np.ndarray, foot: int, step: np.ndarray, command: np.ndarray) -> bool:
    """Move a foothold toward the place beside the other foot until it is walkable.

    Returns:
        Whether it had to be moved.
    """
    if is_walkable(feet, foot, step, command):
        return False
    at = 3 * (1 - foot)
    x, y, yaw = feet[at], feet[at + 1], feet[at + 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = step[1] - x, step[2] - y
    ahead, across = cos * dx + sin * dy, cos * dy - sin * dx
    turn = p.wrapped(step[3] - yaw)
    beside = 2.0 * command[_WIDTH] * (1.0 if foot == 0 else -1.0)
    for k in range(1, 9):
        factor = 1.0 - 0.125 * k
        a, b = factor * ahead, beside + factor * (across - beside)
        step[1], step[2] = x + cos * a - sin * b, y + sin * a + cos * b
        step[3] = yaw + factor * turn
        if is_walkable(feet, foot, step, command):
            break
    return True


@kernel
def is_walkable(
    feet: np.ndarray, foot: int, step: np.ndarray, command: np.ndarray
) -> bool:
    """Return whether a step keeps the rules of `footsteps.FootstepPlan`."""
    at, other = 3 * foot, 3 * (1 - foot)
    dx, dy = step[1] - feet[at], step[2] - feet[at + 1]
    turn = p.wrapped(step[3] - feet[at + 2])
    x, y, yaw = feet[other], feet[other + 1], feet[other + 2]
    ax, ay = step[1] - x, step[2] - y
    across = math.cos(yaw) * ay - math.sin(yaw) * ax
    sign = 1.0 if foot == 0 else -1.0
    if math.hypot(dx, dy) > MAX_STRIDE or math.hypot(ax, ay) > MAX_STRIDE:
        return False
    if abs(p.wrapped(step[3] - yaw)) > MAX_TOE or sign * across <= 0.0:
        return False
    for k in range(11):
        s = 0.1 * k
        gap = sole_gap(
            feet[at] + s * dx - x,
            feet[at + 1] + s * dy - y,
            yaw,
            feet[at + 2] + s * turn,
            0.5 * command[_SOLE],
            0.5 * command[_SOLE + 1],
        )
        if gap <= 0.0:
            return False
    return True


@kernel
def sole_gap(
    dx: float, dy: float, yaw_0: float, yaw_1: float, length: float, width: float
) -> float:
    """Return how far two soles are apart along their best separating axis [m].

    Args:
        dx: From the one to the other, world [m].
        dy: From the one to the other, world [m].
        yaw_0: Heading of the one [rad].
        yaw_1: Heading of the other [rad].
        length: Half the length of both [m].
        width: Half their width [m].
    """
    turn = yaw_1 - yaw_0
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    reach_x = length + length * along + width * across
    reach_y = width + length * across + width * along
    best = -math.inf
    for yaw in (yaw_0, yaw_1):
        cos, sin = math.cos(yaw), math.sin(yaw)
        best = max(best, abs(cos * dx + sin * dy) - reach_x)
        best = max(best, abs(cos * dy - sin * dx) - reach_y)
    return best


@kernel
def given_is_walkable(table: np.ndarray, command: np.ndarray, work: np.ndarray) -> bool:
    """Return whether the foothold of one's own can be stepped on."""
    last, feet, step = table[0], work[-1, :6], work[-2]
    kind = int(last[r.KIND])
    foot = feet_after(last, feet)
    rests = kind == p.STAND or kind == p.STOP
    if rests or (kind == p.DOUBLE and last[r.LOADS + 1] == 0.5):
        foot = int(command[_FIRST])
    step[1:4] = command[_GIVEN_POSE : _GIVEN_POSE + 3]
    return is_walkable(feet, foot, step, command)


# The CoM and the heading.


@kernel
def end_state(piece: np.ndarray, axis: int, omega: float) -> tuple[float, float]:
    """Return CoM [m] and velocity [m/s] of one axis at the end of a phase."""
    q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
    S, csch = piece[r.DURATION], piece[r.INVERSE_SINH]
    c, slope = p.polynomial_end(q)
    v = slope / S
    if csch != 0.0:
        c += q[7]
        v += omega * (q[7] / math.tanh(omega * S) - q[6] * csch)
    return c, v


@kernel
def fill_from_state(before: np.ndarray, piece: np.ndarray, omega: float) -> None:
    """Fill the curves of a single support from the end of the phase before it."""
    angle = omega * piece[r.DURATION]
    sinh, cosh = math.sinh(angle), math.cosh(angle)
    piece[r.INVERSE_SINH] = 1.0 / sinh
    foot = p.weight_point(piece, 0)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        c, v = end_state(before, axis, omega)
        q[:] = 0.0
        q[0] = foot[axis]
        q[6] = c - foot[axis]
        q[7] = cosh * q[6] + sinh * v / omega


@kernel
def shift(
    table: np.ndarray,
    pivot: int,
    stop: int,
    since: float,
    omega: float,
    minjerk: bool,
    work: np.ndarray,
) -> None:
    """Shift the ZMP of the rest of a phase by delta, and plan what comes after it.

    Args:
        table: The phases.
        pivot: Row of the phase that is shifted.
        stop: Row of the stop.
        since: Time since its start [s].
        omega: Natural frequency omega_n [rad/s].
        minjerk: Whether the ZMP crosses by minimum jerk.
        work: Scratch.
    """
    piece = table[pivot]
    S = piece[r.DURATION]
    tau = S - since
    kappa = omega / math.tanh(0.5 * omega * tau)
    c_x, v_x = end_state(piece, 0, omega)
    c_y, v_y = end_state(piece, 1, omega)
    load_x, load_y = kappa * c_x - v_x, kappa * c_y - v_y
    p.link(table, pivot + 1, stop, omega, minjerk, kappa, load_x, load_y, work)
    rest, gone = math.cosh(omega * tau), math.cosh(omega * since)
    piece[r.INVERSE_SINH] = 1.0 / math.sinh(omega * S)
    for axis in range(2):
        q = piece[r.CURVE_X + 8 * axis : r.CURVE_X + 8 * axis + 8]
        free = c_x if axis == 0 else c_y
        delta = (work[0, 2 + axis] - free) / (1.0 - rest)
        q[0] += delta
        q[6] -= delta * gone
        q[7] -= delta * rest


@kernel
def turn(
    table: np.ndarray,
    state: np.ndarray,
    command: np.ndarray,
    last: int,
    time: float,
    work: np.ndarray,
) -> None:
    """Fill the headings anew, from the heading and its rate now on."""
    piece = table[0]
    stands = int(piece[r.KIND]) == p.STAND
    work[0, 4], work[0, 5] = state[_KNOT], state[_KNOT_YAW]
    n = p.collect_knots(table, 2 if stands else 1, last, work)
    if stands:
        work[0, 6] = 0.0
        p.set_turns(table, 2, last, n, work)
        table[0, r.TURN_END] = table[1, r.TURN_END] = work[n - 1, 4]
        return
    left = work[1, 4] - time
    if left < command[_LEAST]:
        work[1, 6] = heading_at(piece, work[1, 4])[1]
    work[0, 4] = time
    work[0, 5], work[0, 6] = heading_at(piece, time)
    p.set_turns(table, 0 if left > 1e-6 else 1, last, n, work)
    piece[r.TURN_END] = work[n - 1, 4]


@kernel
def heading_at(piece: np.ndarray, time: float) -> tuple[float, float]:
    """Return the heading [rad] of a phase at a time [s], and its rate [rad/s]."""
    s = max(time - piece[r.TURN_START], 0.0)
    a, b = piece[r.TURN], piece[r.TURN + 1]
    c, d = piece[r.TURN + 2], piece[r.TURN + 3]
    return ((a * s + b) * s + c) * s + d, (3.0 * a * s + 2.0 * b) * s + c
