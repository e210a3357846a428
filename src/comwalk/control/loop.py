"""The loop of Fig. 4: plan, measure, control, resolve, act."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..errors import ModelError
from ..pattern import REFERENCE, Reference, record_of
from .guard import (
    WALKS,
    Outcome,
    Watch,
    check_fall,
    check_sensors,
    completed,
    guard_of,
    interrupted,
    outcome_of,
    usual_watch,
)
from .law import Controller, ControlOutput
from .plant import Actuation, Command, Plant, Sensors
from .sensing import Contact, Measurement, zmp_from_wrenches

Progress = Callable[[float], None]
"""Called now and then with the time since the plan's start [s]."""

PROGRESS_ROWS = 50
"""Periods between two calls of it."""


class Tick(NamedTuple):
    """All that happened in one control period, for logs and views."""

    reference: Reference
    """What the plan asks."""
    sensors: Sensors
    """What the plant said."""
    measured: Measurement
    """CoM and ZMP made of it."""
    control: ControlOutput
    """The walking controller's answer."""
    command: Command
    """The set-points sent."""
    seconds: float
    """Time that all this took to compute [s]."""


class Walkable(Protocol):
    """A pattern to walk: a `Pattern`, or an `OnlinePattern` that is commanded."""

    @property
    def duration(self) -> float:
        """When the walk ends [s]."""
        ...

    def at(self, time: float) -> Reference:
        """Return the reference at a time [s], not before that of the last call."""
        ...


class Ticker(Protocol):
    """One control period after the other: measure, guard, control, act."""

    def step(self, time: float, sensors: Any) -> Outcome | None:
        """Go through the period that starts at a time [s].

        Returns:
            None, with `command` ready to be sent; or why the walk has to end.
        """
        ...

    @property
    def command(self) -> Command:
        """The set-points of the last period."""
        ...

    @property
    def reference(self) -> Reference:
        """The reference of the last period."""
        ...

    def seen(self, sensors: Sensors, seconds: float) -> Tick:
        """Return all that happened in the last period.

        Args:
            sensors: What `step` was given.
            seconds: How long it took [s].
        """
        ...


class Link(Protocol):
    """The exchange of commands and readings with a plant."""

    def write(self, k: int, sensors: Sensors | None, seconds: float) -> None:
        """Send the command of the k-th period, which took some seconds to compute."""
        ...

    def read(self) -> Sensors | None:
        """Return the sensor readings at the end of the period."""
        ...


class PlantLink:
    """Calls `Plant.write` and `Plant.read`. Final."""

    def __init__(
        self, plant: Plant, ticker: Ticker, on_tick: Callable[[Tick], None] | None
    ) -> None:
        """Link a plant to what computes its commands.

        Args:
            plant: The robot.
            ticker: What computes commands.
            on_tick: Called after each command was written.
        """
        self._plant, self._ticker, self._on_tick = plant, ticker, on_tick

    def write(self, k: int, sensors: Sensors | None, seconds: float) -> None:
        """Send the command and report the tick; see `Link.write`."""
        self._plant.write(self._ticker.command)
        if self._on_tick is not None and sensors is not None:
            self._on_tick(self._ticker.seen(sensors, seconds))

    def read(self) -> Sensors:
        """Return the sensor readings at the end of the period."""
        return self._plant.read()


def walk(
    pattern: Walkable,
    controller: Controller,
    body: Body,
    plant: Plant,
    *,
    on_tick: Callable[[Tick], None] | None = None,
    watch: Watch | None = None,
    link: Callable[[Any], Link] | None = None,
) -> Outcome:
    """Walk a pattern on a plant, Fig. 4.

    Args:
        pattern: CoM, ZMP and feet over time.
        controller: The walking controller, Eq. (31), or what stands in for it.
        body: What lies between CoM velocity and set-points: a `WholeBody`, or a
            `PointBody` for the simplified model.
        plant: The robot, simulated or real.
        on_tick: Called each period after the command was written.
        watch: When a walk counts as a fall; `usual_watch` if None.
        link: Makes, from the ticker, what exchanges commands and readings with the
            plant, where something faster than `Plant.write` and `read` does.

    Returns:
        The outcome. A fall, and an interruption by the user, are outcomes.
    """
    check_plant(body, plant)
    reference = pattern.at(0.0)
    controller.reset(reference.com, reference.zmp)
    command = body.start(reference)
    height = float(reference.com[2] - reference.left.position[2])
    ticker = body.ticker(pattern, controller, watch or usual_watch(height))
    way = PlantLink(plant, ticker, on_tick) if link is None else link(ticker)
    outcome, reason = None, "an error"
    try:
        sensors: Sensors | None = plant.start(command)
        for k in _periods(pattern, plant.period):
            begin = time.perf_counter()
            outcome = ticker.step(k * plant.period, sensors)
            if outcome is None or k == 0:  # a fall at once leaves a record, too
                way.write(k, sensors, time.perf_counter() - begin)
            if outcome is not None:
                break
            sensors = way.read()
        reason = "done" if outcome is None else outcome.cause
    except KeyboardInterrupt:
        outcome = interrupted(ticker.reference)
        reason = outcome.cause
    finally:
        plant.stop(reason)
    if outcome is None:
        return completed(ticker.reference, pattern.duration)
    return outcome


def _periods(pattern: Walkable, period: float) -> Iterator[int]:
    """Yield the numbers of control periods until the end, which may come later."""
    k, end = 0, math.ceil(pattern.duration / period)
    while k < end:
        yield from range(k, end)
        k, end = end, math.ceil(pattern.duration / period)


def check_plant(body: Body, plant: Plant) -> None:
    """Check that body and plant speak of the same joints, and of the same commands.

    Args:
        body: What makes set-points.
        plant: What gets them.

    Raises:
        ModelError: If they do not.
    """
    ours, theirs = tuple(body.joint_names), tuple(plant.joint_names)
    if ours != theirs:
        pairs = enumerate(itertools.zip_longest(ours, theirs))
        k, (mine, its) = next((k, pair) for k, pair in pairs if pair[0] != pair[1])
        raise ModelError(
            f"joint {k + 1} is {mine} for the robot's model and {its} for the plant: "
            "a driver must use the model's joints in the model's order"
        )
    # A driver that says nothing takes positions.
    sent, taken = (getattr(x, "actuation", Actuation.POSITION) for x in (body, plant))
    if sent is not taken:
        raise ModelError(
            f"the robot is loaded for joints that take {_TAKEN[sent]}, and those of "
            f'the plant take {_TAKEN[taken]}: load it with actuation="{taken}"'
        )


_TAKEN = {
    Actuation.POSITION: "positions",
    Actuation.PD: "torques with gains",
    Actuation.TORQUE: "torques alone",
}


class Body(Protocol):
    """The robot box of Fig. 4, as the loop sees it."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that its set-points are for, in order."""
        ...

    def start(self, reference: Reference) -> Command:
        """Return the set-points of the posture to start from."""
        ...

    def measure(self, sensors: Sensors, reference: Reference) -> Measurement:
        """Return CoM and ZMP from the sensors."""
        ...

    def act(self, control: ControlOutput, reference: Reference) -> Command:
        """Return the set-points for the next period."""
        ...

    def ticker(self, pattern: Walkable, controller: Controller, watch: Watch) -> Ticker:
        """Return the control tick, after `start`."""
        ...


class PointBody:
    """The body of the simplified model (30): the CoM itself is the joint. Final."""

    joint_names = ("com_x", "com_y")

    def start(self, reference: Reference) -> Command:
        """Return the CoM to start from."""
        return Command(reference.com[:2].copy(), np.zeros(2))

    def measure(self, sensors: Sensors, reference: Reference) -> Measurement:
        """Return CoM and ZMP; the one virtual sole is at the world's origin."""
        force, torque = sensors.wrenches[0, :3], sensors.wrenches[0, 3:]
        zmp = zmp_from_wrenches(
            [Contact((0.0, 0.0, 0.0), force.tolist(), torque.tolist())]
        )
        com = np.array([*sensors.positions, reference.com[2]])
        zmp = reference.zmp if zmp is None else zmp
        return Measurement(com, zmp, float(force[2]), 0.0)

    def act(self, control: ControlOutput, reference: Reference) -> Command:
        """Return u itself as the CoM's velocity."""
        return Command(control.com_command, control.u)

    def ticker(self, pattern: Walkable, controller: Controller, watch: Watch) -> Ticker:
        """Return the control tick of the point mass."""
        return BodyTicker(pattern, controller, self, watch)


class BodyTicker:
    """Ticks by `Body.measure`, `Controller.step` and `Body.act`. Final."""

    def __init__(
        self, pattern: Walkable, controller: Controller, body: Body, watch: Watch
    ) -> None:
        """Prepare the first tick.

        Args:
            pattern: CoM, ZMP and feet over time.
            controller: The law.
            body: The body, started.
            watch: When a walk counts as a fall.
        """
        self._pattern, self._controller, self._body = pattern, controller, body
        self._watch, self._guard = guard_of(watch)
        self._record = np.zeros(1, REFERENCE)
        self.reference = pattern.at(0.0)
        """The reference of the last period."""

    def step(self, time: float, sensors: Sensors) -> Outcome | None:
        """Go through the period that starts at a time [s]; see `Ticker.step`."""
        reference = self.reference = self._pattern.at(time)
        record_of(reference, self._record[0])
        status = check_sensors(
            sensors.positions, sensors.wrenches.ravel(), sensors.orientation
        )
        if status == WALKS:
            measured = self._measured = self._body.measure(sensors, reference)
            rules, guard, record = self._watch[0], self._guard[0], self._record[0]
            com, load, tilt = measured.com, float(measured.load), float(measured.tilt)
            status = check_fall(rules, guard, record, com, load, tilt)
        if status != WALKS:
            return outcome_of(status, reference, self._guard[0])
        self._control = self._controller.step(
            reference, measured.com, measured.zmp, measured.feedback_scale
        )
        self.command = self._body.act(self._control, reference)
        return None

    def seen(self, sensors: Sensors, seconds: float) -> Tick:
        """Return all that happened in the last period; see `Ticker.seen`."""
        parts = self._measured, self._control, self.command
        return Tick(self.reference, sensors, *parts, seconds)
