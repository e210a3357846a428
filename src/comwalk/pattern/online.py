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
system of `phases`, whose solution is the new plan. Nothing is known sooner by
planning later: as long as the footsteps stay, delta stays 0.

A foot in the air lands where it was sent, and so does a weight that moves. In double
support, or when less than `OnlinePattern.least_time` is left of a phase, delta acts in
the next single support, where it is small.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..compiled import load
from ..errors import ParameterError, PlanError, checked_count, checked_number
from ..handles import handle_of
from ..sides import Side
from . import records as r
from .adaptation import Agility, adaptation_record
from .footsteps import (
    PAPER_GAIT,
    PAPER_SOLE,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
)
from .pendulum import PAPER_PENDULUM, Pendulum
from .phases import MIN_MINJERK, fill_standing, step_records
from .reference import Reference, reference_of
from .replan import advance, given_is_walkable, replan
from .walk_pattern import Pattern

STEPS_AHEAD = 4
"""Steps that are planned beyond the one that is being made [-]. What is not yet known
after four moves the ZMP by less than 0.001 mm."""

RETURN = 0.08
"""How far each step comes back to where it was planned, if one before it was moved, in
CoM heights [-]."""

LEAST_TIME = 0.15
"""Shortest rest of a phase [s] that is changed; later the next single support is."""

Driver = Callable[["OnlinePattern", float], None]
"""Called with the pattern and the time [s] before each reference: the joystick."""


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
        agility: Agility | None = None,
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
            agility: What the legs can do to catch a fall by other steps than planned;
                None to step as planned.

        Raises:
            ParameterError: If a number is out of its range.
            PlanError: If the double support is too short for "minjerk".
        """
        name = "duration"
        if duration != math.inf:
            checked_number(name, duration, unit="s", low=0.0, open_low=True)
        self._duration = float(duration)
        self.spare = 0.0
        """How much later it may end, if steps that are moved take longer [s]."""
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
        omega, height = pendulum.omega, pendulum.height
        self.adaptation: np.ndarray = np.zeros(0, r.ADAPTATION)
        """How steps are moved with the measured CoM, one record; empty if they stay."""
        if agility is not None:
            self.adaptation = adaptation_record(agility, omega, height)
        ahead = checked_count("ahead", ahead, 2, 50)
        plan = FootstepPlan(
            left=Foothold(0.0, gait.half_width),
            right=Foothold(0.0, -gait.half_width),
            sole_size=sole_size,
        )
        self._feet = (plan.left, plan.right)
        self._table = np.zeros(2 * ahead + 8, r.PHASE)
        self._work = np.zeros(len(self._table), r.WORK)
        self._arrays = [np.zeros(1, k) for k in (r.ONLINE, r.COMMAND, r.REFERENCE)]
        self._state, self._command, self._row = (array[0] for array in self._arrays)
        self._follow(np.zeros(0, r.STEP))
        self._advance = load(advance, self._handle, 0.0)
        known = {"ahead": ahead, "least": self.least_time, "sole": plan.sole_size}
        known |= {"omega": omega, "height": height, "back": RETURN * height}
        for name, value in known.items():
            self._command[name] = value
        self._time = 0.0
        self._stand(gait)

    @classmethod
    def of(
        cls,
        pattern: Pattern,
        *,
        ahead: int = STEPS_AHEAD,
        agility: Agility | None = None,
    ) -> OnlinePattern:
        """Return the pattern of a plan that is walked step by step.

        Args:
            pattern: What to walk.
            ahead: Steps planned beyond the one being made, in [2, 50].
            agility: As for the class.

        Returns:
            A pattern with the same references, but for what is more than `ahead` steps
            away; new commands end the plan.

        Example:
            >>> from comwalk.pattern import make_pattern, plan_steps
            >>> whole = make_pattern(plan_steps(PAPER_GAIT, 8), PAPER_PENDULUM)
            >>> online = OnlinePattern.of(whole)
            >>> float(abs(online.at(4.3).com - whole.at(4.3).com).max()) < 1e-6
            True
        """
        plan = pattern.plan
        online = cls(
            _closing_gait(plan),
            pattern.pendulum,
            duration=pattern.duration,
            sole_size=plan.sole_size,
            ahead=ahead,
            agility=agility,
        )
        online._feet = (plan.left, plan.right)
        online._stand(online.gait)
        if plan.steps:
            online._follow(step_records(plan))
            online._command["stand"] = plan.stand_time
            if agility is not None:
                online.spare = 4.0 * online.gait.period + plan.stop_time
            online._replan()
        return online

    def _follow(self, steps: np.ndarray) -> None:
        """Follow some footsteps, records of `STEP`."""
        state, command, row = self._arrays
        self._steps, self._command["steps"] = steps, len(steps)
        self._handle = handle_of(self._table, state, command, self._work, row, steps)

    def _stand(self, gait: Gait) -> None:
        """Begin to stand."""
        feet = np.array([(foot.x, foot.y, foot.yaw) for foot in self._feet])
        self._state["rows"] = 1
        fill_standing(self._table, gait.stand_time, feet)
        self._gait = gait
        self._take(gait)

    @property
    def duration(self) -> float:
        """When `walk` ends [s]: when it stands again after the steps of a plan."""
        if not self.spare:
            return self._duration
        last = self.table[-1]
        end = float(last["start"] + last["duration"])
        return min(max(self._duration, end), self._duration + self.spare)

    @duration.setter
    def duration(self, duration: float) -> None:
        """End at another time [s], whatever is walked."""
        self._duration, self.spare = duration, 0.0

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
        """The phases from now to the stop, records of `PHASE`; a view."""
        return self._table[: self._state["rows"]]

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """The phases, `ONLINE`, `COMMAND`, scratch, the footsteps and `ADAPTATION`."""
        state, command, _ = self._arrays
        return self._table, state, command, self._work, self._steps, self.adaptation

    @property
    def moved(self) -> int:
        """Number of steps that were moved to catch a fall."""
        return int(self.adaptation["moves"].sum())

    @property
    def walks(self) -> bool:
        """Whether steps are commanded."""
        return bool(self._command["walk"])

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
        while self._advance(self._handle, time):
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
        self._command["steps"] = 0
        moves = self._state["rows"] > 1
        if moves and gait.double_support != self._gait.double_support:
            raise PlanError("double_support can only change while the robot stands")
        self._take(gait)
        self._gait = gait
        self._command["walk"] = True
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
        self._command["steps"] = 0
        self._command["given"], self._command["foothold"] = True, pose
        first = int(before["first"])
        for self._command["first"] in (first, 1 - first):
            if given_is_walkable(self._table, self._state, self._command):
                break
        else:
            self._arrays[1][0] = before
            raise PlanError(
                f"{foothold} cannot be stepped on from where the other foot stands: it "
                "is too far, turned too much, or on the other foot's side"
            )
        self._replan()

    def stop(self) -> None:
        """Come to rest: the foot in the air lands, the other one comes beside it."""
        self._command["steps"] = 0
        self._command["walk"] = self._command["given"] = False
        self._replan()

    def _take(self, gait: Gait) -> None:
        """Write a gait into the command of the kernels."""
        least, D = MIN_MINJERK / self.pendulum.omega, gait.double_support_time
        if gait.double_support == "minjerk" and least > D:
            raise PlanError(
                f'a double support of {D:g} s is too short for "minjerk": make '
                f"transfer_time at least {0.5 * least:.3g} s"
            )
        way = gait.lateral or gait.turn
        told = {
            "length": gait.step_length,
            "shift": gait.lateral,
            "turn": gait.turn,
            "width": gait.half_width,
            "single": gait.single_support_time,
            "double": gait.double_support_time,
            "clearance": gait.swing_height,
            "start": gait.start_time,
            "stop": gait.stop_time,
            "minjerk": gait.double_support == "minjerk",
            "first": 0 if way > 0.0 else 1,
        }
        for name, value in told.items():
            self._command[name] = value

    def _replan(self) -> None:
        """Make the plan anew from the last reference on."""
        table, work, steps = self._table, self._work, self._steps
        replan(table, self._state, self._command, work, steps, self._time)

    def _note_landing(self) -> None:
        """Remember where the last foot landed, and how long it took."""
        piece, state = self._table[0], self._state
        foot = 1 - int(piece["bases"][0])
        x, y, yaw = piece["resting"][foot].tolist()
        self.footsteps.append(
            Footstep(
                side=Side.LEFT if foot == 0 else Side.RIGHT,
                x=x,
                y=y,
                yaw=yaw,
                single_support=float(state["single"]),
                double_support=float(state["double"]),
                swing_height=float(state["clearance"]),
            )
        )


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _closing_gait(plan: FootstepPlan) -> Gait:
    """Return the gait of the steps that end a plan whose steps were moved."""
    apart = math.hypot(plan.left.x - plan.right.x, plan.left.y - plan.right.y)
    told: dict[str, Any] = {}
    if plan.steps:
        last = plan.steps[-1]
        half = min(max(0.5 * last.double_support, 0.002), 4.0)
        told["transfer_time"] = half
        told["period"] = min(max(last.single_support, 0.15), 1.9) + 2.0 * half
        told["swing_height"] = last.swing_height
    return Gait(
        half_width=0.5 * apart,
        start_time=plan.start_time,
        stop_time=plan.stop_time,
        stand_time=plan.stand_time,
        double_support=plan.double_support,
        **told,
    )
