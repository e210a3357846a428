"""From a configuration to what `simulate` takes: robot, pattern, motion, settings.

What a configuration leaves open is chosen to suit the robot.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .certificates import check_control, sampled_loop_of, servo_lag_of
from .certificates.identification import standing_pattern
from .config import (
    CertifyConfig,
    DanceConfig,
    IdentifyConfig,
    RobotConfig,
    WalkConfig,
)
from .control import (
    Control,
    Disturbance,
    Plant,
    SimulatorSettings,
    no_disturbance,
    random_bounded,
)
from .embedding import (
    EmbeddedMotion,
    Motion,
    builtin_motion,
    embed_in,
    fitted,
    is_motion_file,
    load_motion,
    placed,
    prepare_motion,
    renamed,
    scaled,
)
from .errors import MotionError, ParameterError
from .pattern import (
    Foothold,
    FootstepPlan,
    Gait,
    Pattern,
    Pendulum,
    load_plan,
    make_pattern,
    plan_steps,
)

if TYPE_CHECKING:
    from .certificates import Aim, Certificate, DesignGoal
    from .robot import Robot
    from .run import Run
    from .walking import WholeBody


_REST = 0.2  # time [s] in the home posture before and after an embedded motion
_DANCE_TIME = 10.0  # [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Setup:
    """Arguments of `simulate`, checked. Made by the `build` functions."""

    robot: Robot | None
    """The robot; None for the simplified model."""
    pattern: Pattern
    """What to walk."""
    motion: EmbeddedMotion | None
    """Motion of the upper body."""
    control: Control
    """The walking controller."""
    physics: SimulatorSettings
    """Physics and pushes."""
    disturbance: Disturbance = no_disturbance
    """Disturbance of the simplified model."""
    seed: int = 0
    """Seed of the sensor noise."""
    force: bool = False
    """Whether to walk what the robot is not able to."""
    adapt: bool = True
    """Whether to catch a fall by other steps than planned."""
    notes: tuple[str, ...] = ()
    """What was changed so that the parts go together."""

    def run(
        self,
        progress: Callable[[float], None] | None = None,
        *,
        record: Path | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> Run:
        """Simulate it, with the robot or with the simplified model.

        Args:
            progress: Called now and then with the simulated time [s].
            record: File of ROS 2 messages to write while it runs.
            about: More to say about the run in its settings.

        Returns:
            The run.

        Raises:
            ComwalkError: If gains or plan cannot be walked.
        """
        from .run import simulate, simulate_pendulum

        told: dict[str, Any] = {"progress": progress, "record": record, "about": about}
        told["control"] = self.control
        if self.robot is None:
            eps = self.disturbance
            return simulate_pendulum(self.pattern, disturbance=eps, **told)
        return simulate(
            self.robot,
            self.pattern,
            motion=self.motion,
            physics=self.physics,
            seed=self.seed,
            force=self.force,
            adapt=self.adapt,
            **told,
        )

    def certificate(self) -> Certificate:
        """Return the certificate of its gains, as far as the verdict needs it.

        Returns:
            The certificate.
        """
        from .certificates import certify, friction_fault, sole_room, stance_ratio

        robot, body = self.robot, self.control.body
        room = None if robot is None else sole_room(robot)
        stance = None if robot is None else stance_ratio(robot)
        return certify(
            self.pattern.pendulum,
            self.control.gains,
            sampled_loop_of(self.control, servo_lag_of(robot, body)),
            room=room,
            stance=stance,
            friction=friction_fault(robot, self.pattern, self.physics, body),
            exact=False,
            theory=False,
        )


def build_walk(config: WalkConfig) -> Setup:
    """Build the setup of a walk.

    Args:
        config: The walk.

    Returns:
        Robot, pattern, motion and settings.

    Raises:
        ComwalkError: If they do not exist, or do not go together.
    """
    _refuse_idle(config)
    robot = _load(config)
    pendulum = _pendulum(config, robot)
    pattern = make_pattern(_plan(config, robot), pendulum)
    setup = _setup(config, robot, pattern)
    if config.plant == "pendulum":
        setup = dataclasses.replace(setup, robot=None)
    if config.motion is not None:
        setup = _dancing(setup, config, "motion_")
    if config.disturbance is not None:
        a, b = config.disturbance
        eps = random_bounded(a, b, config.seed, duration=pattern.duration)
        setup = dataclasses.replace(setup, disturbance=eps)
    return dataclasses.replace(setup, force=config.force, adapt=config.adapt)


def build_certificate(config: CertifyConfig) -> Certificate:
    """Build the certificate of a robot's gains.

    Args:
        config: Robot, gains, loop.

    Returns:
        The certificate; what is not given is as `comwalk walk` has it.

    Raises:
        ComwalkError: If the robot does not exist or a number is out of range.
    """
    from .certificates import (
        certify,
        default_control_settings,
        default_gains,
        default_pendulum,
        design,
        sole_room,
        stance_ratio,
        stated_gains,
    )
    from .robot import load_robot

    robot = load_robot(
        config.robot, profile=config.profile, actuation=config.actuation, pd=config.pd
    )
    pendulum = config.pendulum.over(default_pendulum(robot))
    period = float(config.loop.values.get("period", Control().period))
    gains = stated_gains(config.gains, default_gains(robot, period=period))
    settings = default_control_settings(robot, gains, pendulum=pendulum, period=period)
    control = Control(gains=gains, settings=settings, period=period)
    loop = config.loop.over(sampled_loop_of(control, servo_lag_of(robot)))
    a, b = config.disturbance
    if config.design is not None:
        goal = _goal(config.design, robot, a, b)
        gains, cutoff = design(pendulum, loop, goal)
        loop = dataclasses.replace(loop, zmp_cutoff=cutoff)
    room, stance = sole_room(robot), stance_ratio(robot)
    return certify(
        pendulum, gains, loop, a=a, b=b, room=room, stance=stance, exact=config.exact
    )


def _goal(text: str, robot: Robot, a: float, b: float) -> DesignGoal:
    """Return the goal of a design from its text."""
    from .certificates import DesignGoal, default_gait

    if text in ("gait", "disturbance"):
        aim: Aim = "gait" if text == "gait" else "disturbance"
        return DesignGoal(aim=aim, step_time=default_gait(robot).period, a=a, b=b)
    try:
        frequency, damping = (float(word) for word in text.split(","))
    except ValueError:
        raise ParameterError(
            f"design must be gait, disturbance, or a natural frequency in rad/s and a "
            f'damping such as 4.1,0.7, got "{text}"'
        ) from None
    return DesignGoal(aim="poles", frequency=frequency, damping=damping)


def _refuse_idle(config: WalkConfig) -> None:
    """Refuse settings that would do nothing, since a user expects them to."""
    default, idle = WalkConfig(), {}
    if config.plan is not None:
        own = ("steps", "gait", "speed", "side", "turn")
        idle |= dict.fromkeys(own, "with a plan, which holds its own")
    if config.motion is None:
        numbers = ("amplitude", "frequency", "scale", "speed")
        idle |= dict.fromkeys([f"motion_{n}" for n in numbers], "without a motion")
    for name, why in idle.items():
        if getattr(config, name) != getattr(default, name):
            raise ParameterError(f"{name} does nothing {why}; leave it out")


def build_dance(config: DanceConfig) -> Setup:
    """Build the setup of a dance.

    Args:
        config: The dance.

    Returns:
        Robot, pattern, motion and settings; the pattern only stands.

    Raises:
        ComwalkError: If they do not exist, or do not go together.
    """
    from .certificates import default_gait

    robot = _load(config)
    duration = config.duration
    if duration is None:
        clip = _clip(robot, config, "")
        once = clip.duration + 2 * _REST
        duration = _DANCE_TIME if clip.loops else min(max(once, 1.0), 3600.0)
    A = config.half_width or default_gait(robot).half_width
    plan = FootstepPlan(
        left=Foothold(0.0, A),
        right=Foothold(0.0, -A),
        stand_time=duration / 2,
        sole_size=robot.sole_size,
    )
    pattern = make_pattern(plan, _pendulum(config, robot))
    told = {"force": config.force, "adapt": config.adapt}
    setup = dataclasses.replace(_setup(config, robot, pattern), **told)
    return _dancing(setup, config, "")


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentifySetup:
    """Arguments of `identify`. Made by `build_identify`."""

    robot: Robot
    """The robot."""
    plant: Plant
    """The simulated robot, where it starts."""
    body: WholeBody
    """What makes set-points."""
    pendulum: Pendulum
    """The simplified model."""
    standing: Callable[[float], Pattern]
    """From the time [s] to the pattern of standing that long."""


def build_identify(config: IdentifyConfig) -> IdentifySetup:
    """Build the setup of an experiment on the standing robot.

    Args:
        config: The experiment.

    Returns:
        Robot, plant, body and pattern.

    Raises:
        ComwalkError: If they do not exist, or do not go together.
    """
    from .certificates import default_gait
    from .walking import SimulatedRobot, WholeBody

    robot = _load(config)
    pendulum, period = _pendulum(config, robot), float(config.period)
    size, half_width = robot.sole_size, default_gait(robot).half_width

    def standing(duration: float) -> Pattern:
        """Return the pattern of standing for a while [s]."""
        return standing_pattern(pendulum, half_width, size, duration)

    plant = SimulatedRobot(robot, period, config.physics, config.seed)
    body = WholeBody(robot, period, None, config.body)
    body.start(standing(1.0).at(0.0))
    plant.place(body.configuration)
    return IdentifySetup(
        robot=robot, plant=plant, body=body, pendulum=pendulum, standing=standing
    )


def _load(config: RobotConfig) -> Robot:
    from .robot import load_robot

    return load_robot(
        config.robot,
        stiffness=config.stiffness,
        profile=config.profile,
        actuation=config.actuation,
        pd=config.pd,
    )


def _pendulum(config: RobotConfig, robot: Robot) -> Pendulum:
    from .certificates import default_pendulum

    return config.pendulum.over(default_pendulum(robot))


def _setup(config: RobotConfig, robot: Robot, pattern: Pattern) -> Setup:
    """Return a setup without motion."""
    from .certificates import default_control_settings, default_gains, stated_gains

    period = float(config.period)
    gains = stated_gains(config.gains, default_gains(robot, period=period))
    settings = default_control_settings(
        robot, gains, pendulum=pattern.pendulum, period=period
    )
    notes = []
    if robot.world is not None and config.simulator.scene:
        notes.append(robot.world.note)
    if config.sensors == "none":
        notes.append("nothing feels the ground: the law has k_p = 0")
        gains = dataclasses.replace(gains, zmp=(0.0, 0.0), standing_zmp=(0.0, 0.0))
    control = Control(
        gains=gains,
        settings=config.control.over(settings),
        body=dataclasses.replace(config.body, sensors=config.sensors),
        period=period,
    )
    check_control(control, pattern.pendulum, servo_lag_of(robot, control.body))
    return Setup(
        robot=robot,
        pattern=pattern,
        motion=None,
        control=control,
        physics=config.physics,
        seed=config.seed,
        notes=tuple(notes),
    )


def _plan(config: WalkConfig, robot: Robot) -> FootstepPlan:
    """Return the footsteps, from the file or regular ones."""
    from .certificates import default_gait

    size = robot.sole_size
    if config.plan is not None:
        return load_plan(config.plan, gait=default_gait(robot), sole_size=size)
    return plan_steps(regular_gait(config, robot), config.steps, sole_size=size)


def regular_gait(config: WalkConfig, robot: Robot) -> Gait:
    """Return the regular gait of a robot, with what was given of it.

    Args:
        config: Gives speeds, or numbers of the gait.
        robot: The robot.

    Returns:
        The gait.

    Raises:
        ParameterError: If a number is out of range, or given twice.
    """
    from .certificates import default_gait

    given, turn = dict(config.gait.values), config.turn
    step = {name: given.pop(name) for name in ("turn",) if name in given}
    if step and turn is not None:
        raise ParameterError("give turn or gait.turn, not both")
    try:
        gait = default_gait(
            robot,
            speed=config.speed,
            side=config.side,
            turn=None if turn is None else math.radians(turn),
            **given,
        )
        return dataclasses.replace(gait, **step)
    except ParameterError as error:
        about_gait = str(error).partition(" ")[0] in given
        raise ParameterError(f"gait.{error}" if about_gait else str(error)) from None


def _dancing(setup: Setup, config: Any, prefix: str) -> Setup:
    """Return a setup with the motion of the upper body, within the robot's limits.

    The blends of a file are checked; a built-in dance is made to fit.
    """
    robot = setup.robot
    if robot is None:
        return setup
    clip = _clip(robot, config, prefix)
    limits, end = robot.joint_limits, setup.pattern.duration - _REST
    known = is_motion_file(config.motion)
    embedded = embed_in(
        clip,
        robot.home_angles,
        start=_REST,
        stop=end if clip.loops else min(end, _REST + clip.duration),
        blend=getattr(config, prefix + "blend"),
        limits=limits if known else None,
    )
    embedded, notes = (embedded, clip.repairs) if known else fitted(embedded, limits)
    if notes:
        notes = (f"the dance is made to fit the robot: {', '.join(notes)}",)
    return dataclasses.replace(setup, motion=embedded, notes=(*setup.notes, *notes))


def _clip(robot: Robot, config: Any, prefix: str) -> Motion:
    """Return the motion that a robot can play; that of a file is within its limits."""
    source = config.motion
    factors = [getattr(config, prefix + name) for name in ("scale", "speed")]
    given = {n: getattr(config, prefix + n) for n in ("amplitude", "frequency")}
    given = {name: value for name, value in given.items() if value is not None}
    home, dancing = robot.home_angles, robot.upper_body
    if not is_motion_file(source):
        return scaled(robot_dance(robot, source, given), *factors, about=home)
    for name, other in (("amplitude", "scale"), ("frequency", "speed")):
        if name in given:
            raise MotionError(
                f"{prefix}{name} is for built-in dances; a file is changed by "
                f"{prefix}{other}"
            )
    return prepare_motion(
        scaled(load_motion(source, robot_joints=robot.joints), *factors, about=home),
        allowed=dancing,
        ignored=[j for j in robot.joints if j not in dancing],
        limits=robot.joint_limits,
        home=home,
    )


def robot_dance(robot: Robot, name: str, options: Mapping[str, Any]) -> Motion:
    """Return a built-in dance of the joints that a robot has.

    Args:
        robot: The robot.
        name: The dance, one of `dances.BUILTIN_MOTIONS`.
        options: Amplitude [rad] and frequency [Hz], as `builtin_motion` takes them.

    Returns:
        The motion, about the robot's home posture.

    Raises:
        MotionError: If there is no such dance, or the robot has none of its joints.
    """
    joints = {role: joint for role, (joint, _) in robot.roles.items()}
    motion = renamed(builtin_motion(name, **options), joints)
    return placed(motion, robot.home_angles, dict(robot.roles.values()))
