"""What a command is asked to do: from flags and TOML files to what `simulate` takes.

A configuration is a frozen dataclass; its fields are the flags of the command line and
the keys of a TOML file alike (`--gait.half-step 0.08`, or `half_step = 0.08` under
`[gait]`). Flags win over the file, and over what suits the robot, which is what all
numbers are that nobody gave. The `build` functions turn a configuration into a robot, a
pattern, a motion and settings, and check them together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    Any,
    Generic,
    Literal,
    TypeVar,
)

from .certificates import SampledLoop
from .certificates.identification import Experiment
from .control import BodySettings, ControlSettings, Gains, Push, SimulatorSettings
from .errors import ParameterError, checked_number
from .pattern import Gait, Pendulum, checked_count

if TYPE_CHECKING:
    pass

MAX_SEED = 2**32 - 1
"""Largest seed of random numbers [-]."""

_UNSEEN = {(SimulatorSettings, "pushes")}  # given by `push` instead


# ---- Configurations ---------------------------------------------------------------

Part = TypeVar("Part", Gait, Pendulum, Gains, ControlSettings, SampledLoop)
"""What a robot has defaults for."""


@dataclass(frozen=True)
class Given(Generic[Part]):
    """The numbers of a part that a user gave; the robot's defaults are the others."""

    kind: type[Part]
    """The part."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values by the name of the part's field."""

    def __post_init__(self) -> None:
        """Check the values; store them as the part does.

        Raises:
            ParameterError: If a value is out of range.
        """
        part = self.kind(**{**_UNBOUND.get(self.kind, {}), **self.values})
        values = {name: getattr(part, name) for name in self.values}
        object.__setattr__(self, "values", values)

    def over(self, defaults: Part) -> Part:
        """Return the defaults with the given values in their place.

        Args:
            defaults: The part as it suits the robot.

        Returns:
            The whole part.
        """
        return dataclasses.replace(defaults, **self.values)


# Bounds of one another, so that each can be checked alone.
_UNBOUND: dict[Any, Mapping[str, Any]] = {
    Gait: {"period": 10.0, "transfer_time": 0.005}
}


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """What all commands that move a robot share. Abstract."""

    robot: str = "paper"
    """Robot of `comwalk robots`, or path of a URDF or MJCF file."""
    profile: str | None = None
    """TOML file that tells what cannot be seen in the robot's file."""
    gains: Given[Gains] = Given(Gains)
    """Gains of the walking control law."""
    control: Given[ControlSettings] = Given(ControlSettings)
    """Filter, delay and bounds of the controller."""
    body: BodySettings = field(default_factory=BodySettings)
    """How the whole body follows its commands."""
    simulator: SimulatorSettings = field(default_factory=SimulatorSettings)
    """Physics."""
    pendulum: Given[Pendulum] = Given(Pendulum)
    """The simplified model."""
    stiffness: float = 1.0
    """Factor on the stiffness of all servos, in (0, 100]."""
    push: tuple[str, ...] = ()
    """Push on the trunk, START:FX,FY,FZ[:DURATION] in s and N, for 0.1 s by default;
    may be given several times."""
    period: float = 0.002
    """Control period [s], in [1e-4, 0.05], a multiple of simulator.timestep."""
    seed: int = 0
    """Seed of all random numbers, in [0, 4294967295]."""
    out: str | None = None
    """Folder for the results; a new one under runs/ if not given."""
    report: bool = False
    """Write report.html: the run in 3D, its figures and settings as one page."""
    video: tuple[str, ...] = ()
    """Film of the run, .mp4 (needs the extra `video`), .webp or .gif; .png and .jpg are
    stills side by side; may be given several times."""
    json: bool = False
    """Print one JSON object instead of tables."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        for text in self.push:
            parse_push(text)
        name, factor, dt = "stiffness", self.stiffness, self.period
        checked_number(name, factor, low=0, high=100, open_low=True)
        checked_number("period", dt, unit="s", low=1e-4, high=0.05)
        checked_count("seed", self.seed, 0, MAX_SEED)

    @property
    def physics(self) -> SimulatorSettings:
        """The simulator's settings, with the pushes."""
        pushes = tuple(parse_push(text) for text in self.push)
        return dataclasses.replace(self.simulator, pushes=pushes)


@dataclass(frozen=True, kw_only=True)
class WalkConfig(RobotConfig):
    """A walk."""

    steps: int = 20
    """Number of steps, in [1, 100000]; a plan has its own."""
    plan: str | None = None
    """TOML file of footsteps to walk instead of a regular gait."""
    speed: float | None = None
    """Forward speed [m/s], negative backward; chooses step and time of the gait."""
    side: float | None = None
    """Sideways speed [m/s], left positive; chooses step and time of the gait."""
    turn: float | None = None
    """Turning speed [deg/s], left positive; chooses step and time of the gait."""
    gait: Given[Gait] = Given(Gait)
    """The regular walk."""
    force: bool = False
    """Walk even what the robot is not able to, as `comwalk check` tells."""
    plant: Literal["robot", "pendulum"] = "robot"
    """What walks: the robot in full physics, or the simplified model of Eq. (30)."""
    disturbance: tuple[float, float] | None = None
    """Bounds a [m/s] and b [m/s^2] of a random disturbance of the pendulum and of its
    rate."""
    motion: str | None = None
    """Dance of the upper body while walking: a name of `comwalk motions`, or a CSV or
    NPZ file."""
    motion_amplitude: float | None = None
    """Largest angle of a built-in dance [rad], in (0, 2.5]; 0.5 if not given."""
    motion_frequency: float | None = None
    """Cycles of a built-in dance per second [Hz], in (0, 3]; 0.5 if not given."""
    motion_scale: float = 1.0
    """Factor on all angles of the dance about the home posture, in [0, 100]."""
    motion_speed: float = 1.0
    """Factor on the speed of the dance, in [0.001, 1000]."""
    motion_blend: float = 1.0
    """Time to blend the dance in, and to blend it out [s], above 0."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range, or goes with another plant.
        """
        super().__post_init__()
        checked_count("steps", self.steps, 1, 100_000)
        for name, unit in (("speed", "m/s"), ("side", "m/s"), ("turn", "deg/s")):
            value = getattr(self, name)
            if value is not None:
                checked_number(name, value, unit=unit, low=-360, high=360)
        _check_dance(self, "motion_")
        if self.disturbance is not None:
            for name, value, unit in zip("ab", self.disturbance, _RATES, strict=True):
                checked_number(f"disturbance ({name})", value, unit=unit, low=0)
        wrong = ("motion", "push") if self.plant == "pendulum" else ("disturbance",)
        for name in wrong:
            if getattr(self, name):
                other = "robot" if self.plant == "pendulum" else "pendulum"
                raise ParameterError(
                    f'{name} is for plant "{other}", not for the {self.plant}'
                )


_RATES = ("m/s", "m/s^2")


def _check_dance(config: RobotConfig, prefix: str) -> None:
    """Check the numbers of a dance, which a walk calls motion_..."""
    for name, (unit, low, high, open_low) in _DANCE_LIMITS.items():
        value = getattr(config, prefix + name)
        if value is not None:
            checked_number(
                prefix + name, value, unit=unit, low=low, high=high, open_low=open_low
            )


_DANCE_LIMITS = {
    "amplitude": ("rad", 0.0, 2.5, True),
    "frequency": ("Hz", 0.0, 3.0, True),
    "scale": ("", 0.0, 100.0, False),
    "speed": ("", 1e-3, 1e3, False),
    "blend": ("s", 0.0, 3600.0, True),
}


@dataclass(frozen=True, kw_only=True)
class DanceConfig(RobotConfig):
    """A dance with both feet on the ground."""

    motion: str = "paper"
    """Dance of the upper body: a name of `comwalk motions`, or a CSV or NPZ file."""
    duration: float | None = None
    """Time of the whole dance, from and back to the home posture [s], in [1, 3600]; if
    not given, 10 s, or once through a file that does not loop."""
    amplitude: float | None = None
    """Largest angle of a built-in dance [rad], in (0, 2.5]; 0.5 if not given."""
    frequency: float | None = None
    """Cycles of a built-in dance per second [Hz], in (0, 3]; 0.5 if not given."""
    scale: float = 1.0
    """Factor on all angles of the dance about the home posture, in [0, 100]."""
    speed: float = 1.0
    """Factor on the speed of the dance, in [0.001, 1000]."""
    blend: float = 1.0
    """Time to blend the dance in, and to blend it out [s], above 0."""
    half_width: float | None = None
    """Half of the distance between both feet [m], in [0.02, 0.4]; as in the robot's
    home posture if not given."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        super().__post_init__()
        if self.duration is not None:
            checked_number("duration", self.duration, unit="s", low=1, high=3600)
        _check_dance(self, "")
        if self.half_width is not None:
            width = self.half_width
            checked_number("half_width", width, unit="m", low=0.02, high=0.4)


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig(RobotConfig):
    """An experiment on the standing robot."""

    experiment: Experiment = field(default_factory=Experiment)
    """How the robot is shaken."""


@dataclass(frozen=True, kw_only=True)
class PatternConfig:
    """A regular walk on paper."""

    gait: Gait = field(default_factory=Gait)
    """The regular walk."""
    pendulum: Pendulum = field(default_factory=Pendulum)
    """The simplified model."""
    steps: int = 4
    """Number of steps drawn, in [1, 1000]."""
    out: str | None = None
    """Folder for the plot of Fig. 3; nothing is written if not given."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        checked_count("steps", self.steps, 1, 1000)


@dataclass(frozen=True, kw_only=True)
class CertifyConfig:
    """What gains guarantee on a robot."""

    robot: str = "paper"
    """Robot of `comwalk robots`, or path of a URDF or MJCF file."""
    profile: str | None = None
    """TOML file that tells what cannot be seen in the robot's file."""
    gains: Given[Gains] = Given(Gains)
    """Gains of the walking control law."""
    loop: Given[SampledLoop] = Given(SampledLoop)
    """The loop as it runs; `comwalk identify` measures it."""
    pendulum: Given[Pendulum] = Given(Pendulum)
    """The simplified model."""
    disturbance: tuple[float, float] = (0.05, 0.5)
    """Bounds a [m/s] and b [m/s^2] of the error of the CoM's velocity and of its
    rate."""
    exact: bool = True
    """Whether to find the exact worst cases, by linear programs."""
    design: str | None = None
    """Design gains and ZMP filter: gait (least ZMP error of the robot's steps),
    disturbance (the largest that is guaranteed to be survived), or a natural frequency
    in rad/s and a damping, such as 4.1,0.7."""
    out: str | None = None
    """Folder for certificate.json and the picture; nothing is written if not given."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        for name, value, unit in zip("ab", self.disturbance, _RATES, strict=True):
            checked_number(
                f"disturbance ({name})", value, unit=unit, low=0, open_low=True
            )
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


# ---- Reading ----------------------------------------------------------------------


# ---- Building ---------------------------------------------------------------------
