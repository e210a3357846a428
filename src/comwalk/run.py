"""A run: a pattern walked on a plant, with its record, figures and files."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from .certificates import (
    adaptive,
    check_control,
    check_feasible,
    check_friction,
    default_control,
    servo_lag_of,
)
from .control import (
    PROGRESS_ROWS,
    Body,
    Control,
    ControlSettings,
    Disturbance,
    Link,
    Outcome,
    PendulumPlant,
    Plant,
    PointBody,
    Progress,
    SimulatorSettings,
    Tick,
    Walkable,
    WalkingController,
    Watch,
    no_disturbance,
    walk,
)
from .embedding import EmbeddedMotion
from .errors import ParameterError, PlanError
from .pattern import Pattern
from .robot import Robot
from .runs import (
    ROWS_NAME,
    Log,
    Recorder,
    RunData,
    clear_folder,
    judged,
    prepare_folder,
    save_columns,
    summarize,
    versions,
    write_file,
)
from .walking import (
    MujocoLink,
    SimulatedRobot,
    WholeBody,
    take_log,
)

if TYPE_CHECKING:
    from .views import WebPage


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run. Made by `simulate`."""

    outcome: Outcome
    """How, when and why it ended."""
    log: Log
    """One row per control period."""
    pattern: Pattern
    """What was to be walked."""
    seconds: float
    """Wall-clock time of the whole run [s]."""
    settings: dict[str, Any]
    """Everything that the run was made with, as plain numbers and names."""
    robot: Robot | None = None
    """The robot; None for the simplified model."""
    scene: mujoco.MjModel | None = None
    """The compiled model of the simulation; None for the simplified model."""
    substeps: int = 1
    """Physics steps per control period."""
    recording: Path | None = None
    """File of rows or of ROS 2 messages that was asked for."""

    def summary(self) -> dict[str, Any]:
        """Return the figures of the run, with units in their names."""
        figures = summarize(
            self.log, self.pattern, self.outcome, self.seconds, self.robot
        )
        return {**figures, "versions": versions(), "settings": self.settings}

    @cached_property
    def data(self) -> RunData:
        """The run as views take it."""
        name = self.settings["robot"] or "simplified model"
        columns, plan = self.log.columns, self.pattern.plan
        return RunData(name, self.summary(), columns, self.scene, plan)

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw CoM and ZMP over time, as in Fig. 7, or as in Fig. 6 for a dance.

        Args:
            path: Where to write a picture; not written if None.

        Returns:
            The matplotlib figure.

        Raises:
            RunError: If the picture cannot be written.
        """
        from .views import plot_dance, plot_run

        return (
            plot_run(self, path) if self.pattern.plan.steps else plot_dance(self, path)
        )

    def view(self) -> WebPage:
        """Return the run as a page: in 3D, with its figures and settings.

        Returns:
            The page, which a notebook shows by itself; elsewhere `open()` it in a
            browser, or `save(path)` it.

        Raises:
            RunError: If the run has no rows.
        """
        from .views import report

        return report(self)

    def _repr_html_(self) -> str:
        from .views import notebook_html

        return notebook_html(self.data)

    def save(self, folder: str | Path) -> Path:
        """Write summary.json, run.npz, scene.mjb and the figure.

        Args:
            folder: Made if it does not exist; an earlier run in it is replaced.

        Returns:
            The folder.

        Raises:
            RunError: If it cannot be written.
        """
        folder = prepare_folder(folder)
        clear_folder(folder, keep=self.recording)
        columns = {**self.log.columns, "substeps": np.array(self.substeps)}
        with ThreadPoolExecutor(1) as other:  # zlib works while the figure is drawn
            written = other.submit(save_columns, folder / "run.npz", columns)
            if self.scene is not None:
                scene = np.zeros(mujoco.mj_sizeModel(self.scene), np.uint8)
                mujoco.mj_saveModel(self.scene, None, scene)
                write_file(folder / "scene.mjb", scene.tobytes())
            text = json.dumps(self.summary(), indent=2, allow_nan=False)
            write_file(folder / "summary.json", text + "\n")
            self.plot(folder / ("walk.png" if self.pattern.plan.steps else "dance.png"))
            written.result()
        for name in (ROWS_NAME, "run.json"):
            (folder / name).unlink(missing_ok=True)
        return folder


def simulate(
    robot: Robot,
    pattern: Pattern,
    *,
    control: Control | None = None,
    motion: EmbeddedMotion | None = None,
    physics: SimulatorSettings | None = None,
    watch: Watch | None = None,
    seed: int = 0,
    force: bool = False,
    adapt: bool = True,
    progress: Progress | None = None,
    record: str | Path | None = None,
    about: Mapping[str, Any] | None = None,
) -> Run:
    """Walk a pattern with a robot in MuJoCo.

    Args:
        robot: The robot.
        pattern: What to walk.
        control: The walking controller; the robot's defaults if None.
        motion: Motion of arms, waist or head, embedded in the CoM Jacobian.
        physics: Physics step, floor, payload, sensors and pushes.
        watch: When a walk counts as a fall; `control.usual_watch` if None.
        seed: Seed of the sensor noise.
        force: Whether to walk even what the robot is not able to.
        adapt: Whether to catch a fall by other steps than planned, where joints take
            torques.
        progress: Called now and then with the simulated time.
        record: File of the rows, run.npy, which outlive a killed process; or of ROS 2
            messages, run.mcap, which are made of the rows at the end.
        about: More to say about the run in its settings.

    Returns:
        The run. A fall is an outcome, not an error.

    Raises:
        ParameterError: If the gains are unstable.
        PlanError: If the plan cannot be walked by this robot.
    """
    parts = prepare(
        robot,
        pattern,
        control=control,
        motion=motion,
        physics=physics,
        seed=seed,
        force=force,
        about={"adapt": adapt, **(about or {})},
    )
    recorder = Recorder(record, parts.log, robot, parts.settings)
    walked = adaptive(robot, pattern) if adapt else pattern
    made = parts.control, parts.body, parts.plant, recorder, watch, progress
    run = _walked(pattern, walked, *made)
    return dataclasses.replace(
        run, robot=robot, scene=parts.plant.model, substeps=parts.plant.substeps
    )


@dataclass(frozen=True, eq=False)
class Prepared:
    """The parts of a simulated walk, ready to start. Made by `prepare`."""

    control: Control
    """The walking controller's settings."""
    plant: SimulatedRobot
    """The robot in MuJoCo, placed at the start."""
    body: WholeBody
    """The whole body, in the posture of the start."""
    log: Log
    """A record with a row for each period of the pattern."""
    settings: dict[str, Any]
    """Everything that the run is made with, as plain numbers and names."""


def prepare(
    robot: Robot,
    pattern: Pattern,
    *,
    control: Control | None = None,
    motion: EmbeddedMotion | None = None,
    physics: SimulatorSettings | None = None,
    seed: int = 0,
    force: bool = False,
    about: Mapping[str, Any] | None = None,
    pushable: bool = False,
) -> Prepared:
    """Check a walk in MuJoCo and put its parts together.

    Args:
        robot: The robot.
        pattern: What to walk.
        control: The walking controller; the robot's defaults if None.
        motion: Motion of arms, waist or head, embedded in the CoM Jacobian.
        physics: Physics step, floor, payload, sensors and pushes.
        seed: Seed of the sensor noise.
        force: Whether to walk even what the robot is not able to.
        about: More to say about the run in its settings.
        pushable: Whether it will be pushed while it walks, `SimulatedRobot.push`.

    Returns:
        The parts.

    Raises:
        ParameterError: If the gains are unstable.
        PlanError: If the plan cannot be walked by this robot.
    """
    _check_kinds(robot, pattern, motion)
    control = control or default_control(robot)
    _check_pushes(pattern, physics)
    _check_gravity(robot, pattern)
    lag = servo_lag_of(robot, control.body)
    check_control(control, pattern.pendulum, lag)
    if not force:
        check_feasible(robot, pattern, motion)
        check_friction(robot, pattern, physics, control.body)
    plant = SimulatedRobot(
        robot, control.period, physics, seed, pattern.plan, pushable=pushable
    )
    body = WholeBody(robot, control.period, motion, control.body)
    body.start(pattern.at(0.0))
    plant.place(body.configuration)
    log = Log(
        _rows(pattern, control.period),
        lambda: {**plant.snapshot(), **body.diagnostics()},
    )
    notes = {
        "robot": robot.name,
        "plant": "robot",
        "seed": seed,
        "motion": None if motion is None else motion.motion.name,
        "physics": plain(plant.settings),
        **(about or {}),
    }
    return Prepared(control, plant, body, log, _settings(notes, control, pattern))


def simulate_pendulum(
    pattern: Pattern,
    *,
    control: Control | None = None,
    disturbance: Disturbance = no_disturbance,
    servo_lag: float = 0.02,
    watch: Watch | None = None,
    progress: Progress | None = None,
    record: str | Path | None = None,
    about: Mapping[str, Any] | None = None,
) -> Run:
    """Walk a pattern with the simplified model, Eq. (30).

    Args:
        pattern: What to walk.
        control: The walking controller; the paper's if None.
        disturbance: eps and its rate over time.
        servo_lag: Time constant between u and the CoM's velocity [s].
        watch: When a walk counts as a fall; `control.usual_watch` if None.
        progress: Called now and then with the simulated time.
        record: File of the rows, run.npy, or of ROS 2 messages, run.mcap.
        about: More to say about the run in its settings.

    Returns:
        The run.

    Raises:
        ParameterError: If the gains are unstable.
    """
    control = control or Control()
    check_control(control, pattern.pendulum, servo_lag)
    plant = PendulumPlant(
        pattern.pendulum,
        period=control.period,
        servo_lag=servo_lag,
        disturbance=disturbance,
    )
    if control.settings.max_offset == ControlSettings().max_offset:
        # A disturbance that lasts takes the integral of u anywhere: no bound.
        settings = dataclasses.replace(control.settings, max_offset=1e6)
        control = dataclasses.replace(control, settings=settings)
    log = Log(_rows(pattern, control.period))
    notes = {"robot": None, "plant": "pendulum", **(about or {})}
    settings = _settings(notes, control, pattern)
    recorder = Recorder(record, log, None, settings)
    parts = control, PointBody(), plant, recorder, watch, progress
    return _walked(pattern, pattern, *parts)


def _settings(
    notes: Mapping[str, Any], control: Control, pattern: Pattern
) -> dict[str, Any]:
    """Return all that a run is made with."""
    return {
        **notes,
        "control": plain(control),
        "pendulum": plain(pattern.pendulum),
        "plan": plain(pattern.plan),
    }


def _walked(
    pattern: Pattern,
    walked: Walkable,
    control: Control,
    body: Body,
    plant: Plant,
    recorder: Recorder,
    watch: Watch | None,
    progress: Progress | None,
) -> Run:
    """Walk, and return the run with what it was made with."""
    controller = WalkingController(control.gains, control.settings, control.period)
    log = recorder.log
    link: Callable[[Any], Link] | None = None
    with recorder:
        if isinstance(plant, SimulatedRobot):
            take_log(log, plant, pattern.duration + getattr(walked, "spare", 0.0))
            link = partial(MujocoLink, plant, log=log, progress=progress)

        begin = time.perf_counter()
        outcome = walk(
            walked,
            controller,
            body,
            plant,
            on_tick=_recording(log, progress),
            watch=watch,
            link=link,
        )
        if isinstance(plant, SimulatedRobot):
            outcome = judged(outcome, log, pattern, plant.robot)
        recorder.outcome = str(outcome)
    return Run(
        outcome=outcome,
        log=log,
        pattern=pattern,
        seconds=time.perf_counter() - begin,
        settings=recorder.settings,
        recording=recorder.path,
    )


def _recording(log: Log, progress: Progress | None) -> Callable[[Tick], None]:
    """Return the callback that logs a tick where the plant keeps no log itself."""

    def record(tick: Tick) -> None:
        """Log a tick, and tell the time now and then."""
        log.record(tick)
        if progress is not None and len(log) % PROGRESS_ROWS == 0:
            progress(tick.reference.time)

    return record


def _check_kinds(robot: object, pattern: object, motion: object) -> None:
    """Refuse arguments of the wrong kind."""
    for value, kind, advice in (
        (robot, Robot, "load_robot(name) makes one"),
        (pattern, Pattern, "make_pattern(plan, Pendulum()) makes one of a plan"),
        (motion, (EmbeddedMotion, type(None)), "embed_in(motion, home) makes one"),
    ):
        if not isinstance(value, kind):
            wanted = kind if isinstance(kind, type) else kind[0]
            raise ParameterError(
                f"simulate needs a {wanted.__name__}, got a {type(value).__name__}; "
                + advice
            )


def _check_gravity(robot: Robot, pattern: Pattern) -> None:
    """Refuse a pattern made for another gravity than the model's."""
    planned = pattern.pendulum.gravity
    if not math.isclose(planned, robot.gravity, rel_tol=1e-3):
        raise ParameterError(
            f"pendulum.gravity is {planned:g} m/s^2, and that of the robot's model "
            f"{robot.gravity:g}; make them equal"
        )


def _check_pushes(pattern: Pattern, physics: SimulatorSettings | None) -> None:
    """Refuse pushes that would never happen."""
    for push in physics.pushes if physics else ():
        if push.start >= pattern.duration:
            raise ParameterError(
                f"the push at {push.start:g} s comes after the end of the run at "
                f"{pattern.duration:g} s; let it start earlier"
            )


def _rows(pattern: Pattern, period: float) -> int:
    """Return how many rows a log of the whole pattern has."""
    if pattern.duration < period:
        raise PlanError(
            f"the plan lasts {pattern.duration:g} s; give it steps, or a stand_time"
        )
    return int(pattern.duration / period) + 2


def plain(value: Any) -> Any:
    """Return settings as plain dictionaries, lists, numbers and names.

    Args:
        value: A dataclass, or anything in one.

    Returns:
        The same, ready for JSON.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in dataclasses.fields(value)]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (np.floating, np.integer)):
        return value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value
