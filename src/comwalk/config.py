"""Configurations of the commands, as declared settings.

A configuration is a frozen dataclass; its fields are the flags of the command line and
the keys of a TOML file alike (`--gait.half-step 0.08`, or `half_step = 0.08` under
`[gait]`). Flags win over the file, and over what suits the robot, which is what all
numbers are that nobody gave. The `build` functions turn a configuration into a robot, a
pattern, a motion and settings, and check them together.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

from .certificates import SampledLoop
from .certificates.identification import Experiment
from .control import (
    Actuation,
    BodySettings,
    ControlSettings,
    Gains,
    Push,
    SimulatorSettings,
)
from .errors import ParameterError
from .pattern import Gait, Pendulum
from .settings import Given, check_settings, same_setting, setting

MAX_SEED = 2**32 - 1
"""Largest seed of random numbers [-]."""


# ---- Configurations ---------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """The robot, and how its joints are driven. Abstract."""

    robot: str = setting(
        "paper", "Robot of `comwalk robots`, or path of a URDF or MJCF file"
    )
    profile: str | None = setting(
        None, "TOML file that tells what cannot be seen in the robot's file"
    )
    actuation: Actuation | None = setting(
        None,
        "What the joints take: positions, torques with gains about positions, or "
        "torques alone; as the robot's data suggest if not given",
    )
    pd: tuple[float, float, float] | None = setting(
        None,
        "Gains of joints that take torques, instead of the robot's own: position gain "
        "of all but ankles, of ankles [N m/rad], and velocity gain [N m s/rad]",
        "",
        "[0, 1e6]",
        items=("joints", "ankles", "damping"),
    )


@dataclass(frozen=True, kw_only=True)
class RobotConfig(ModelConfig):
    """Settings shared by all commands that move a robot. Abstract."""

    gains: Given[Gains] = setting(Given(Gains), "Gains of the walking control law")
    control: Given[ControlSettings] = setting(
        Given(ControlSettings), "Filter, delay and bounds of the controller"
    )
    body: BodySettings = setting(
        BodySettings(), "How the whole body follows its commands"
    )
    simulator: SimulatorSettings = setting(SimulatorSettings(), "Physics")
    pendulum: Given[Pendulum] = setting(Given(Pendulum), "The simplified model")
    stiffness: float = setting(
        1.0, "Factor on the stiffness of all servos", "", "(0, 100]"
    )
    sensors: Literal["auto", "ft", "torque", "none"] = setting(
        "auto",
        "How the ground is felt: by sensors at the ankles, by the joints' torques, or "
        "not at all, which is the law with k_p = 0; auto is ft where joints take "
        "positions, else torque",
    )
    push: tuple[str, ...] = setting(
        (),
        "Push on the trunk, START:FX,FY,FZ[:DURATION] in s and N, for 0.1 s by "
        "default; may be given several times",
    )
    period: float = setting(
        0.002, "Control period, a multiple of simulator.timestep", "s", "[1e-4, 0.05]"
    )
    seed: int = setting(0, "Seed of all random numbers", "", "[0, 4294967295]")
    out: str | None = setting(
        None, "Folder for the results; a new one under runs/ if not given"
    )
    report: bool = setting(
        False, "Write report.html: the run in 3D, its figures and settings as one page"
    )
    video: tuple[str, ...] = setting(
        (),
        "Film of the run, .mp4 (needs the extra `video`), .webp or .gif; .png and "
        ".jpg are stills side by side; may be given several times",
    )
    json: bool = setting(False, "Print one JSON object instead of tables")

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)
        for text in self.push:
            parse_push(text)
        if self.pd is not None and self.actuation not in (None, Actuation.PD):
            raise ParameterError(
                f"pd gives gains under torque, which actuation {self.actuation} has "
                "not; leave one of them out"
            )

    @property
    def physics(self) -> SimulatorSettings:
        """The simulator's settings, with the pushes."""
        pushes = tuple(parse_push(text) for text in self.push)
        return dataclasses.replace(self.simulator, pushes=pushes)


@dataclass(frozen=True, kw_only=True)
class WalkConfig(RobotConfig):
    """A walk."""

    steps: int = setting(20, "Number of steps; a plan has its own", "", "[1, 100000]")
    plan: str | None = setting(
        None, "TOML file of footsteps to walk instead of a regular gait"
    )
    speed: float | None = setting(
        None,
        "Forward speed, negative backward; chooses step and time of the gait",
        "m/s",
        "[-360, 360]",
    )
    side: float | None = setting(
        None,
        "Sideways speed, left positive; chooses step and time of the gait",
        "m/s",
        "[-360, 360]",
    )
    turn: float | None = setting(
        None,
        "Turning speed, left positive; chooses step and time of the gait",
        "deg/s",
        "[-360, 360]",
    )
    gait: Given[Gait] = setting(Given(Gait), "The regular walk")
    force: bool = setting(
        False, "Walk even what the robot is not able to, as `comwalk check` tells"
    )
    adapt: bool = setting(
        True,
        "Catch a fall by other steps than planned, where joints take torques; without "
        "it the robot steps on the planned footholds alone",
    )
    plant: Literal["robot", "pendulum"] = setting(
        "robot",
        "What walks: the robot in full physics, or the simplified model of Eq. (30)",
    )
    disturbance: tuple[float, float] | None = setting(
        None,
        "Bounds a and b of a random disturbance of the pendulum and of its rate",
        "m/s, m/s^2",
        "[0, inf)",
        items=("a", "b"),
    )
    motion: str | None = setting(
        None,
        "Dance of the upper body while walking: a name of `comwalk motions`, or a CSV "
        "or NPZ file",
    )
    motion_amplitude: float | None = setting(
        None, "Largest angle of a built-in dance; 0.5 if not given", "rad", "(0, 2.5]"
    )
    motion_frequency: float | None = setting(
        None, "Cycles of a built-in dance per second; 0.5 if not given", "Hz", "(0, 3]"
    )
    motion_scale: float = setting(
        1.0, "Factor on all angles of the dance about the home posture", "", "[0, 100]"
    )
    motion_speed: float = setting(
        1.0, "Factor on the speed of the dance", "", "[0.001, 1000]"
    )
    motion_blend: float = setting(
        1.0, "Time to blend the dance in, and to blend it out", "s", "(0, 3600]"
    )

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range, or goes with another plant.
        """
        super().__post_init__()
        wrong = ("disturbance",)
        if self.plant == "pendulum":
            wrong = ("motion", "push", "actuation", "pd")
        for name in wrong:
            if getattr(self, name):
                other = "robot" if self.plant == "pendulum" else "pendulum"
                raise ParameterError(
                    f'{name} is for plant "{other}", not for the {self.plant}'
                )


@dataclass(frozen=True, kw_only=True)
class DanceConfig(RobotConfig):
    """A dance with both feet on the ground."""

    motion: str = setting(
        "paper",
        "Dance of the upper body: a name of `comwalk motions`, or a CSV or NPZ file",
    )
    duration: float | None = setting(
        None,
        "Time of the whole dance, from and back to the home posture; 10 s, or once "
        "through a file that does not loop, if not given",
        "s",
        "[1, 3600]",
    )
    amplitude: float | None = same_setting(WalkConfig, "motion_amplitude")
    """As `WalkConfig.motion_amplitude` [rad]."""
    frequency: float | None = same_setting(WalkConfig, "motion_frequency")
    """As `WalkConfig.motion_frequency` [Hz]."""
    scale: float = same_setting(WalkConfig, "motion_scale")
    """As `WalkConfig.motion_scale`."""
    speed: float = same_setting(WalkConfig, "motion_speed")
    """As `WalkConfig.motion_speed`."""
    blend: float = same_setting(WalkConfig, "motion_blend")
    """As `WalkConfig.motion_blend` [s]."""
    force: bool = same_setting(WalkConfig, "force")
    """As `WalkConfig.force`."""
    adapt: bool = same_setting(WalkConfig, "adapt")
    """As `WalkConfig.adapt`."""
    half_width: float | None = setting(
        None,
        "Half of the distance between both feet; as in the robot's home posture if "
        "not given",
        "m",
        "[0.002, 4]",
    )


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig(RobotConfig):
    """An experiment on the standing robot."""

    experiment: Experiment = setting(Experiment(), "How the robot is shaken")


@dataclass(frozen=True, kw_only=True)
class PatternConfig:
    """A regular walk on paper."""

    gait: Gait = setting(Gait(), "The regular walk")
    pendulum: Pendulum = setting(Pendulum(), "The simplified model")
    steps: int = setting(4, "Number of steps drawn", "", "[1, 1000]")
    out: str | None = setting(
        None, "Folder for the plot of Fig. 3; nothing is written if not given"
    )
    json: bool = setting(False, "Print one JSON object instead of a table")

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)


@dataclass(frozen=True, kw_only=True)
class CertifyConfig(ModelConfig):
    """A certificate of gains."""

    gains: Given[Gains] = setting(Given(Gains), "Gains of the walking control law")
    loop: Given[SampledLoop] = setting(
        Given(SampledLoop), "The loop as it runs; `comwalk identify` measures it"
    )
    pendulum: Given[Pendulum] = setting(Given(Pendulum), "The simplified model")
    disturbance: tuple[float, float] = setting(
        (0.05, 0.5),
        "Bounds a and b of the error of the CoM's velocity and of its rate",
        "m/s, m/s^2",
        "(0, inf)",
        items=("a", "b"),
    )
    exact: bool = setting(
        True, "Whether to find the exact worst cases, by linear programs"
    )
    design: str | None = setting(
        None,
        "Design gains and ZMP filter: gait (least ZMP error of the robot's steps), "
        "disturbance (the largest that is guaranteed to be survived), or a natural "
        "frequency in rad/s and a damping, such as 4.1,0.7",
    )
    out: str | None = setting(
        None,
        "Folder for certificate.json and the picture; nothing is written if not given",
    )
    json: bool = setting(False, "Print one JSON object instead of a table")

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)
        if self.design is not None and self.gains.values:
            raise ParameterError("give a design or gains, not both")


def parse_push(text: str) -> Push:
    """Return a push from its text.

    Args:
        text: START:FX,FY,FZ or START:FX,FY,FZ:DURATION, in s and N.

    Returns:
        The push.

    Raises:
        ParameterError: If the text is of another form, or a number is out of range.

    Example:
        >>> parse_push("3.5:40,0,0:0.2").force
        (40.0, 0.0, 0.0)
    """
    parts = text.split(":")
    try:
        start, force = float(parts[0]), [float(x) for x in parts[1].split(",")]
        duration = [float(x) for x in parts[2:]]
        x, y, z = force
        if len(duration) > 1:
            raise ValueError
    except (ValueError, IndexError):
        raise ParameterError(
            "push must be START:FX,FY,FZ or START:FX,FY,FZ:DURATION in s and N, such "
            f'as 3.5:40,0,0:0.1, got "{text}"'
        ) from None
    return Push(start=start, force=(x, y, z), duration=(*duration, 0.1)[0])
