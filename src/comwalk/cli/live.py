"""A live walk: simulated in real time, watched and steered from a browser.

The control loop never waits for who looks on. What there is to see is put where only
the latest value stays (`LiveWalk.latest`); commands come through a queue that the loop
empties between two ticks. Neither end knows how many look, or whether anyone does.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from ..certificates import adaptive, check_control, check_feasible
from ..control import (
    End,
    Gains,
    Outcome,
    Tick,
    Walkable,
    WalkingController,
    completed,
    walk,
)
from ..errors import ParameterError
from ..pattern import OnlinePattern, Pattern, Reference
from ..robot import Robot
from ..run import Prepared, Run, prepare
from ..runs import Landing, Moment, judged, moved_from
from ..setup import Setup

PUSH_TIME = 0.1
"""How long a push lasts [s]."""

_LOOKS = 60.0  # moments per second that can be seen
_GIVE_UP = 0.25  # lag that is not caught up any more [s]
_NAP = 0.01  # time between two looks at the commands in a pause [s]
_STANDING = 100_000.0  # how long the robot goes on standing after its walk [s]


@dataclass(frozen=True, eq=False)
class LiveView:
    """The latest state of a live walk, for its page."""

    moment: Moment
    """The robot and what its controller sees."""
    step: int
    """Footsteps that have landed."""
    heading: float
    """Yaw of the walking direction [rad]."""
    gains: Gains
    """The gains that the controller has."""
    walk: int
    """Number of the walk, 1 for the first; a restart counts on."""
    outcome: Outcome | None
    """How the walk ended; None while it goes on."""
    moved: tuple[Landing, ...] = ()
    """The footsteps that landed elsewhere than planned."""


class Pacer:
    """Keeps real time by absolute deadlines. Final."""

    def __init__(self, period: float, speed: float = 1.0) -> None:
        """Start now.

        Args:
            period: Time between deadlines [s].
            speed: Simulated time per real time [-].
        """
        self.period, self.speed = period, speed
        self.ticks = self.late = 0
        self._begin = self._due = time.perf_counter()

    @property
    def real_time_factor(self) -> float:
        """Simulated time per real time since the start, over the speed asked for."""
        spent = time.perf_counter() - self._begin
        return self.ticks * self.period / (self.speed * max(spent, 1e-9))

    def wait(self) -> None:
        """Sleep until the next deadline; count it as late if it is a period past."""
        self._due += self.period / self.speed
        self.ticks += 1
        ahead = self._due - time.perf_counter()
        if ahead > 0.0:
            time.sleep(ahead)
        elif -ahead > self.period / self.speed:
            self.late += 1
            if -ahead > _GIVE_UP:
                self._due -= ahead


class LiveWalk:
    """A walk in real time, in the thread that calls `run`. Final.

    All else may be called from any thread, at any time, and returns at once.
    """

    def __init__(self, setup: Setup, about: Mapping[str, Any] | None = None) -> None:
        """Check the walk; do not start it.

        Args:
            setup: What walks.
            about: More to say about the run in its settings.

        Raises:
            ParameterError: If it is the simplified model, or the gains are unstable.
            PlanError: If the robot is not able to walk the plan.
        """
        self.robot = _robot_of(setup)
        """The robot."""
        self.setup = _checked(setup)
        """What walks, or will walk after a restart."""
        self.latest: LiveView | None = None
        """What there is to see; the loop replaces it."""
        self.paused = False
        """Whether the robot holds still."""
        self.pacer = Pacer(setup.control.period)
        """How well real time is kept."""
        self._about = dict(about or {})
        self._commands: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._walks, self._steps_left, self._speed = 0, 0, 1.0

    # ---- Commands, from any thread ------------------------------------------------

    def set_gains(self, gains: Gains) -> None:
        """Change the gains of the running controller, from its next tick on.

        Its integral and its filters keep what they hold.

        Args:
            gains: The gains.

        Raises:
            ParameterError: If they are unstable; then nothing changes.
        """
        control = dataclasses.replace(self.setup.control, gains=gains)
        check_control(control, self.setup.pattern.pendulum)
        self.setup = dataclasses.replace(self.setup, control=control)
        self._commands.put(lambda: setattr(self._controller, "gains", gains))

    def push(self, angle: float, impulse: float) -> None:
        """Push the trunk for 0.1 s, from the next tick on.

        Args:
            angle: Where to, from the walking direction, left positive [rad].
            impulse: Force times time [N s].
        """
        self._commands.put(lambda: self._push(angle, impulse))

    def pause(self, on: bool) -> None:
        """Hold still, or go on.

        Args:
            on: Whether to hold still.
        """
        self._commands.put(lambda: self._pause(on))

    def advance(self, duration: float = 0.02) -> None:
        """Go on for a moment in a pause.

        Args:
            duration: How long [s].
        """
        ticks = max(1, round(duration / self.pacer.period))
        self._commands.put(lambda: setattr(self, "_steps_left", ticks))

    def go_at(self, speed: float) -> None:
        """Go on faster or slower than real time.

        Args:
            speed: Simulated time per real time [-], above 0.
        """
        self._commands.put(lambda: self._go_at(speed))

    def restart(self, setup: Setup | None = None) -> None:
        """Walk again from the start.

        Args:
            setup: Another walk; the same with the gains of now if None.

        Raises:
            ParameterError: If its gains are unstable.
            PlanError: If the robot is not able to walk its plan.
        """
        if setup is not None:
            self.setup = _checked(setup)
        self._commands.put(_again)

    def quit(self) -> None:
        """End the walk."""
        self._commands.put(_quit)

    # ---- The loop, in one thread --------------------------------------------------

    def run(self) -> Run:
        """Walk until `quit` or an interruption by the user.

        Returns:
            The last walk.

        Raises:
            KeyboardInterrupt: If it is interrupted before its first tick.
        """
        with _lively_threads():
            while True:
                try:
                    return self._walk()
                except _RestartError:
                    continue

    def _walk(self) -> Run:
        """Walk once, then stand, until all is over."""
        setup = self.setup
        self._walks += 1
        self._parts = parts = _prepared(setup, self._about)
        control, self._outcome = parts.control, None
        self._controller = WalkingController(
            control.gains, control.settings, control.period
        )
        self._next_look, self._begin, self._seconds = 0.0, time.perf_counter(), 0.0
        self._pace()
        pattern = self._walked = _lasting(setup)
        outcome = walk(
            pattern, self._controller, parts.body, parts.plant, on_tick=self._on_tick
        )
        if not len(parts.log):
            raise KeyboardInterrupt  # before its first tick
        end = setup.pattern.duration
        if outcome.end is End.ABORTED and outcome.time >= end:
            outcome = dataclasses.replace(
                outcome, end=End.COMPLETED, time=end, cause=""
            )
        outcome = judged(outcome, parts.log, setup.pattern, self.robot)
        if outcome.end is End.FELL and self.latest is not None:
            self._lie(outcome)
        return Run(
            outcome=outcome,
            log=parts.log,
            pattern=setup.pattern,
            seconds=self._seconds,
            settings=parts.settings,
            robot=self.robot,
            scene=parts.plant.model,
            substeps=parts.plant.substeps,
        )

    def _on_tick(self, tick: Tick) -> None:
        """Record, show, obey, and wait for the next tick's time."""
        reference, duration = tick.reference, self.setup.pattern.duration
        if reference.time < duration:
            self._parts.log.record(tick)
            self._seconds = time.perf_counter() - self._begin
        if (now := time.perf_counter()) >= self._next_look:
            self._next_look = now + 1.0 / _LOOKS
            done = reference.time >= duration
            self._show(tick, completed(reference, duration) if done else None)
        self._obey()
        while self.paused:
            if self._steps_left:
                self._steps_left -= 1
                self._next_look = 0.0
                break
            time.sleep(_NAP)
            self._obey()
            if not self.paused:
                self._pace()
        self.pacer.wait()

    def _lie(self, outcome: Outcome) -> None:
        """Continue the physics after a fall, until a restart or the end."""
        if outcome.end is not End.FELL:
            return
        plant, seen = self._parts.plant, self.latest
        try:
            while seen is not None:
                self._obey()
                if not self.paused:
                    plant.read()
                moment = seen.moment._replace(qpos=plant.data.qpos.copy())
                self.latest = dataclasses.replace(seen, moment=moment, outcome=outcome)
                self.pacer.wait()
        except KeyboardInterrupt:
            return

    def _show(self, tick: Tick, outcome: Outcome | None) -> None:
        """Replace what there is to see."""
        reference, plant = tick.reference, self._parts.plant
        moment = Moment(
            reference.time,
            plant.data.qpos.copy(),
            plant.truth().com,
            reference.com,
            tick.control.zmp_filtered,
            reference.zmp,
            reference.phase,
            tick.sensors.wrenches,
        )
        self.latest = LiveView(
            moment,
            reference.step,
            reference.heading,
            self._controller.gains,
            self._walks,
            outcome,
            self._moved(),
        )

    def _moved(self) -> tuple[Landing, ...]:
        """Return the footsteps that landed elsewhere than planned."""
        if not isinstance(self._walked, OnlinePattern):
            return ()
        landings = [(step.side, step.foothold) for step in self._walked.footsteps]
        return tuple(moved_from(self.setup.pattern.plan, landings))

    def _obey(self) -> None:
        """Do what was commanded since the last tick."""
        try:
            while True:
                self._commands.get_nowait()()
        except Empty:
            return

    def _pace(self) -> None:
        """Keep real time from now on."""
        self.pacer = Pacer(self._parts.control.period, self._speed)

    def _push(self, angle: float, impulse: float) -> None:
        """Push the trunk."""
        seen = self.latest
        yaw = angle + (0.0 if seen is None else seen.heading)
        force = impulse / PUSH_TIME
        along = force * math.cos(yaw), force * math.sin(yaw), 0.0
        self._parts.plant.push(along, PUSH_TIME)

    def _pause(self, on: bool) -> None:
        """Hold still, or go on."""
        self.paused, self._steps_left = on, 0
        if not on:
            self._pace()

    def _go_at(self, speed: float) -> None:
        """Set the speed."""
        self._speed = speed
        self._pace()


class _RestartError(Exception):
    """The walk starts anew."""


def _again() -> None:
    """Leave the walk to start anew."""
    raise _RestartError


def _quit() -> None:
    """Leave the walk, as an interruption by the user does."""
    raise KeyboardInterrupt


class _Lasting:
    """A pattern that goes on standing after its end. Final."""

    duration = _STANDING

    def __init__(self, pattern: Pattern) -> None:
        self._pattern = pattern

    def at(self, time: float) -> Reference:
        """Return the reference at a time [s]."""
        return self._pattern.at(time)


def _lasting(setup: Setup) -> Walkable:
    """Return the pattern of a setup, which goes on standing."""
    walked = setup.pattern
    if setup.adapt:
        walked = adaptive(_robot_of(setup), setup.pattern)
    if isinstance(walked, OnlinePattern):
        walked.duration = _STANDING
        return walked
    return _Lasting(setup.pattern)


def _checked(setup: Setup) -> Setup:
    check_control(setup.control, setup.pattern.pendulum)
    if not setup.force:
        check_feasible(_robot_of(setup), setup.pattern, setup.motion)
    return dataclasses.replace(setup, force=True)


def _robot_of(setup: Setup) -> Robot:
    if setup.robot is None:
        raise ParameterError('a live walk needs a robot; leave out plant "pendulum"')
    return setup.robot


def _prepared(setup: Setup, about: Mapping[str, Any]) -> Prepared:
    """Return the parts that walk a setup."""
    return prepare(
        _robot_of(setup),
        setup.pattern,
        control=setup.control,
        motion=setup.motion,
        physics=setup.physics,
        seed=setup.seed,
        force=True,
        about=about,
        pushable=True,
    )


@contextmanager
def _lively_threads() -> Generator[None]:
    """Let threads take turns more often than every 5 ms, so that ticks come in time."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(2e-4)
    try:
        yield
    finally:
        sys.setswitchinterval(usual)
