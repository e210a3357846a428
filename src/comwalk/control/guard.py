"""Outcomes of a walk, and the guard that detects falls and sensor failures."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..compiled import Record, kernel, records
from ..pattern import PAPER_PENDULUM, Phase, Reference
from ..settings import check_settings, setting


class End(StrEnum):
    """How a run can end."""

    COMPLETED = "completed"
    ASTRAY = "astray"
    FELL = "fell"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How, when and why a run ended."""

    end: End
    """Completed, beside the plan, fell or aborted."""
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

    tilt: float = setting(0.5, "Tilt of the trunk", "rad", "(0, 3.15]")
    com_error: float = setting(
        0.3, "Horizontal distance of the CoM from its reference", "m", "(0, 10]"
    )
    least_load: float = setting(
        0.1,
        "Ground force, as a share of the largest so far, under which the robot is in "
        "the air or lies",
        "",
        "(0, 1]",
    )
    patience: float = setting(
        0.2, "How long the ground force may be missing", "s", "(0, 10]"
    )

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)


def usual_watch(height: float) -> Watch:
    """Return when a walk of a robot counts as a fall.

    Args:
        height: Height of the CoM above the soles [m].

    Returns:
        Defaults, the CoM's distance to scale: the paper's robot has them as they are.
    """
    usual = Watch()
    scale = height / PAPER_PENDULUM.height
    return dataclasses.replace(usual, com_error=usual.com_error * scale)


def _end(end: End, reference: Reference, cause: str) -> Outcome:
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


def sensor_failed(reference: Reference, sensors: str) -> Outcome:
    """Return the outcome of sensors that read no numbers."""
    return _end(End.ABORTED, reference, f"the {sensors} read no numbers")


def tilted(reference: Reference, tilt: float) -> Outcome:
    """Return the outcome of a trunk that tilted too far [rad]."""
    cause = f"the trunk tilted by {math.degrees(tilt):.0f} deg"
    return _end(End.FELL, reference, cause)


def com_diverged(reference: Reference, error: float) -> Outcome:
    """Return the outcome of a CoM too far from its reference [m]."""
    cause = f"the CoM is {error:.2f} m from its reference"
    return _end(End.FELL, reference, cause)


def contact_lost(reference: Reference) -> Outcome:
    """Return the outcome of feet that bear the robot no longer."""
    return _end(End.FELL, reference, "the feet lost the ground")


WATCH = np.dtype(
    [("tilt", "f8"), ("com_error", "f8"), ("least_load", "f8"), ("patience", "f8")],
    align=True,
)
"""A `Watch`, for kernels."""

GUARD = np.dtype(
    [
        ("tilt", "f8"),  # of the trunk [rad]
        ("com_error", "f8"),  # distance of the CoM from its reference [m]
        ("heaviest", "f8"),  # largest ground force so far [N]
        ("lightened", "f8"),  # since when the ground force is missing [s], or nan
    ],
    align=True,
)
"""What the guard remembers."""

WALKS, NO_ENCODERS, NO_WRENCHES, NO_IMU, TILTED, DIVERGED, CONTACT_LOST = range(7)
"""What the guard finds: nothing, a sensor that reads no numbers, or a fall."""

_SENSORS = {NO_ENCODERS: "encoders", NO_WRENCHES: "ankle sensors", NO_IMU: "IMU"}


def guard_of(watch: Watch) -> tuple[np.ndarray, np.ndarray]:
    """Return the records of a guard that has seen nothing yet.

    Args:
        watch: When a walk counts as a fall.

    Returns:
        One record of `WATCH` and one of `GUARD`.
    """
    rules, guard = records(WATCH), records(GUARD)
    for name in WATCH.names or ():
        rules[name] = getattr(watch, name)
    guard["lightened"] = math.nan
    return rules, guard


def outcome_of(status: int, reference: Reference, guard: np.void) -> Outcome:
    """Return the outcome that the guard's finding stands for.

    Args:
        status: What a kernel found, other than `WALKS`.
        reference: The reference of the tick.
        guard: The guard's record.
    """
    if status == TILTED:
        return tilted(reference, float(guard["tilt"]))
    if status == DIVERGED:
        return com_diverged(reference, float(guard["com_error"]))
    if status == CONTACT_LOST:
        return contact_lost(reference)
    return sensor_failed(reference, _SENSORS[status])


@kernel
def check_sensors(
    positions: np.ndarray, wrenches: np.ndarray, orientation: np.ndarray
) -> int:
    """Return `WALKS`, or the first sensor that reads no numbers.

    Args:
        positions: Joint positions [rad].
        wrenches: Ankle wrenches [N, N m], flat.
        orientation: The IMU's quaternion.
    """
    for status, readings in (
        (NO_ENCODERS, positions),
        (NO_WRENCHES, wrenches),
        (NO_IMU, orientation),
    ):
        total = 0.0
        for reading in readings:
            total += reading * reading
        if not math.isfinite(total):
            return status
    return WALKS


@kernel
def check_fall(
    watch: Record,
    guard: Record,
    reference: Record,
    com: np.ndarray,
    load: float,
    tilt: float,
) -> int:
    """Return `WALKS`, or how the robot falls.

    Args:
        watch: A record of `WATCH`.
        guard: A record of `GUARD`.
        reference: A record of `REFERENCE`.
        com: Measured CoM [m], world.
        load: Vertical ground force [N].
        tilt: Tilt of the trunk [rad].
    """
    guard.tilt = tilt
    guard.com_error = math.hypot(com[0] - reference.com[0], com[1] - reference.com[1])
    if tilt > watch.tilt:
        return TILTED
    if not guard.com_error < watch.com_error:
        return DIVERGED
    guard.heaviest = max(guard.heaviest, load)
    if load >= watch.least_load * guard.heaviest:
        guard.lightened = math.nan
    elif math.isnan(guard.lightened):
        guard.lightened = reference.time
    elif reference.time - guard.lightened > watch.patience:
        return CONTACT_LOST
    return WALKS
