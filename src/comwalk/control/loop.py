"""The loop of Fig. 4: plan, measure, control, resolve, act."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

import numpy as np

from ..embedding import bounded_solver
from ..errors import (
    ModelError,
    checked_number,
)
from ..pattern import (
    Phase,
    Reference,
)
from .law import (
    Controller,
    ControlOutput,
)
from .plant import (
    Command,
    Plant,
    Sensors,
)
from .sensing import (
    Contact,
    Measurement,
    zmp_from_wrenches,
)


class End(StrEnum):
    """How a run can end."""

    COMPLETED = "completed"
    FELL = "fell"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How, when and why a run ended."""

    end: End
    """Completed, fell or aborted."""
    time: float
    """When [s]."""
    phase: Phase
    """The supporting phase it ended in."""
    step: int
    """Footsteps completed by then."""
    cause: str
    """Why, for people; empty when completed."""

    @property
    def ok(self) -> bool:
        """Whether the plan was walked to its end."""
        return self.end is End.COMPLETED

    def __str__(self) -> str:
        """Return one line, such as "fell at 3.21 s in single left, step 2: ..."."""
        if self.ok:
            return f"completed in {self.time:.2f} s"
        phase = self.phase.name.lower().replace("_", " ")
        return (
            f"{self.end} at {self.time:.2f} s in {phase} support phase, "
            f"after {self.step} steps: {self.cause}"
        )


@dataclass(frozen=True, kw_only=True)
class Watch:
    """When a walk counts as a fall."""

    tilt: float = 0.5
    """Tilt of the trunk [rad], in (0, pi]."""
    com_error: float = 0.3
    """Horizontal distance of the CoM from its reference [m], > 0."""
    least_load: float = 0.1
    """Ground force, as a share of the largest so far, under which the robot is in the
    air or lies, in (0, 1)."""
    patience: float = 0.2
    """How long the ground force may be missing [s], > 0."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        for name, high in (("tilt", math.pi), ("com_error", 10), ("least_load", 1)):
            value = getattr(self, name)
            checked_number(f"watch.{name}", value, low=0, high=high, open_low=True)
        checked_number("watch.patience", self.patience, low=0, high=10, open_low=True)


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
    """What can be walked: a `Pattern`, or an `OnlinePattern` that is commanded."""

    @property
    def duration(self) -> float:
        """When the walk ends [s]."""
        ...

    def at(self, time: float) -> Reference:
        """Return the reference at a time [s], not before that of the last call."""
        ...


def walk(
    pattern: Walkable,
    controller: Controller,
    body: Body,
    plant: Plant,
    *,
    on_tick: Callable[[Tick], None] | None = None,
    watch: Watch | None = None,
) -> Outcome:
    """Walk a pattern on a plant, Fig. 4.

    Args:
        pattern: CoM, ZMP and feet over time.
        controller: The walking controller, Eq. (31), or what stands in for it.
        body: What lies between CoM velocity and set-points: a `WholeBody`, or a
            `PointBody` for the simplified model.
        plant: The robot, simulated or real.
        on_tick: Called each period after the command was written.
        watch: When a walk counts as a fall.

    Returns:
        The outcome. A fall, and an interruption by the user, are outcomes.
    """
    guard = _Guard(watch or Watch())
    check_joints(body, plant)
    bounded_solver()  # not to be imported in mid-walk
    reference = pattern.at(0.0)
    controller.reset(reference.com, reference.zmp)
    outcome, reason = None, "an error"
    try:
        sensors = plant.start(body.start(reference))
        for tick in range(math.ceil(pattern.duration / plant.period)):
            begin = time.perf_counter()
            reference = pattern.at(tick * plant.period)
            if (outcome := guard.check_sensors(reference, sensors)) is not None:
                break
            measured = body.measure(sensors, reference)
            if (outcome := guard.check(reference, measured)) is not None:
                break
            control = controller.step(
                reference, measured.com, measured.zmp, measured.trust
            )
            command = body.act(control, reference)
            seconds = time.perf_counter() - begin
            plant.write(command)
            if on_tick is not None:
                on_tick(Tick(reference, sensors, measured, control, command, seconds))
            sensors = plant.read()
        reason = "done" if outcome is None else outcome.cause
    except KeyboardInterrupt:
        outcome = interrupted(reference)
        reason = outcome.cause
    finally:
        plant.stop(reason)
    return completed(reference, pattern.duration) if outcome is None else outcome


def check_joints(body: Body, plant: Plant) -> None:
    """Check that body and plant speak of the same joints in the same order.

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


def _end(end: End, reference: Reference, cause: str) -> Outcome:
    """Return an outcome at a reference's time."""
    return Outcome(end, reference.time, reference.phase, reference.step, cause)


def completed(reference: Reference, duration: float) -> Outcome:
    """Return the outcome of a plan that was walked to its end.

    Args:
        reference: The last one.
        duration: How long the plan lasts [s].
    """
    return Outcome(End.COMPLETED, duration, reference.phase, reference.step, "")


def interrupted(reference: Reference) -> Outcome:
    """Return the outcome of a walk that the user stopped."""
    return _end(End.ABORTED, reference, "interrupted by the user")


def blind(reference: Reference, sensors: str) -> Outcome:
    """Return the outcome of sensors that read no numbers."""
    return _end(End.ABORTED, reference, f"the {sensors} read no numbers")


def tilted(reference: Reference, tilt: float) -> Outcome:
    """Return the outcome of a trunk that tilted too far [rad]."""
    cause = f"the trunk tilted by {math.degrees(tilt):.0f} deg"
    return _end(End.FELL, reference, cause)


def astray(reference: Reference, error: float) -> Outcome:
    """Return the outcome of a CoM too far from its reference [m]."""
    cause = f"the CoM is {error:.2f} m from its reference"
    return _end(End.FELL, reference, cause)


def lifted(reference: Reference) -> Outcome:
    """Return the outcome of feet that bear the robot no longer."""
    return _end(End.FELL, reference, "the feet lost the ground")


class _Guard:
    """Watches over a run: the only part of the loop that knows of falls."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self._heaviest = 0.0
        self._lightened: float | None = None

    def check_sensors(self, reference: Reference, sensors: Sensors) -> Outcome | None:
        """Return the outcome of sensors that read no numbers."""
        for name, value in (
            ("encoders", sensors.positions),
            ("ankle sensors", sensors.wrenches),
            ("IMU", sensors.orientation),
        ):
            if not math.isfinite(np.vdot(value, value)):
                return blind(reference, name)
        return None

    def check(self, reference: Reference, measured: Measurement) -> Outcome | None:
        """Return the outcome that ends the run now, if any: a fall."""
        watch, t = self.watch, reference.time
        if measured.tilt > watch.tilt:
            return tilted(reference, measured.tilt)
        (x, y, _), (x_d, y_d, _) = measured.com.tolist(), reference.com.tolist()
        error = math.hypot(x - x_d, y - y_d)
        if not error < watch.com_error:
            return astray(reference, error)
        self._heaviest = max(self._heaviest, measured.load)
        if measured.load >= watch.least_load * self._heaviest:
            self._lightened = None
        elif self._lightened is None:
            self._lightened = t
        elif t - self._lightened > watch.patience:
            return lifted(reference)
        return None


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
