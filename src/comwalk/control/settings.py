"""The settings of a run: what a user may change, checked where it enters."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import ParameterError, checked_number
from ..pattern import checked_count
from .gains import Gains
from .law import ControlSettings


@dataclass(frozen=True, kw_only=True)
class Push:
    """A force on the trunk for a while."""

    start: float
    """When it begins [s]."""
    force: tuple[float, float, float]
    """Force [N], world."""
    duration: float = 0.1
    """How long it lasts [s]."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is not finite or a time is negative.
        """
        checked_number("push start", self.start, unit="s", low=0)
        checked_number("push duration", self.duration, unit="s", low=0, open_low=True)
        if not isinstance(self.force, (tuple, list)) or len(self.force) != 3:
            raise ParameterError(f"push force needs x,y,z in N, got {self.force!r}")
        for value in self.force:
            checked_number("push force", value, unit="N", low=-1e5, high=1e5)


@dataclass(frozen=True, kw_only=True)
class SimulatorSettings:
    """Physics of the simulated robot."""

    timestep: float = 0.001
    """Physics step [s], in [1e-4, 0.005]."""
    friction: float = 1.0
    """Sliding friction of the floor [-], in [0, 10]."""
    terrain: float = 0.0
    """Height of the highest of the random boxes that make the floor rough [m], in
    [0, 0.2]; 0 is a flat floor."""
    terrain_seed: int = 0
    """Seed of the boxes' heights, in [0, 4294967295]."""
    payload: float = 0.0
    """Load on the robot's back that the controller does not know of, as a share of the
    robot's mass, in [0, 1]."""
    latency: float = 0.0
    """Age of what the controller gets from the sensors [s], in [0, 0.2], rounded to
    control periods."""
    noise: float = 0.0
    """Sensor noise, as a factor on 1e-4 rad (encoders), 5 N and 0.2 N m (ankle
    sensors), 0.002 rad, 0.01 rad/s and 0.05 m/s^2 (IMU), in [0, 100]."""
    pushes: tuple[Push, ...] = field(default=())
    """Forces on the trunk."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        checked_number(
            "simulator.timestep", self.timestep, unit="s", low=1e-4, high=0.005
        )
        for name, (unit, high) in _SIMULATOR_LIMITS.items():
            value = getattr(self, name)
            checked_number(f"simulator.{name}", value, unit=unit, low=0, high=high)
        checked_count("simulator.terrain_seed", self.terrain_seed, 0, 2**32 - 1)
        if not all(isinstance(push, Push) for push in _listed(self.pushes)):
            raise ParameterError(
                f"simulator.pushes must be Push's, got {self.pushes!r}"
            )


_SIMULATOR_LIMITS = {
    "friction": ("", 10.0),
    "terrain": ("m", 0.2),
    "payload": ("", 1.0),
    "latency": ("s", 0.2),
    "noise": ("", 100.0),
}


@dataclass(frozen=True, kw_only=True)
class BodySettings:
    """How the whole body follows its commands."""

    feedback: float = 20.0
    """Feedback on every Cartesian row against drift (CLIK) [1/s], in [0, 100]."""
    deflection_compensation: bool = True
    """Whether set-points lead by the servo deflection that the plan implies."""
    imu: bool = True
    """Whether the IMU tells how the soles lie; without it they are taken as level."""
    imu_cutoff: float = 5.0
    """Cut-off of the low-pass filter on how the soles lie [Hz], in [0.1, 100]."""
    landing: float = 0.2
    """How fast a landing foot yields or reaches down, per share of the weight that it
    bears too much or too little [m/s], in [0, 2]; 0 to land as planned."""
    calibration: bool = True
    """Whether the standing robot is weighed: a load that the model does not know of
    shifts the CoM from where the encoders see it."""
    rolling: float = 0.5
    """How fast a sole that stands on its edge is turned to lie flat [rad/s], in
    [0, 5]; 0 to leave it."""
    embed_motion: bool = True
    """Whether the resolution knows of the embedded motion; False is for comparison:
    the arms dance, and the legs do not know."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If the feedback is out of range.
        """
        checked_number("body.feedback", self.feedback, unit="1/s", low=0, high=100)
        name, cutoff = "body.imu_cutoff", self.imu_cutoff
        checked_number(name, cutoff, unit="Hz", low=0.1, high=100)
        checked_number("body.landing", self.landing, unit="m/s", low=0, high=2)
        checked_number("body.rolling", self.rolling, unit="rad/s", low=0, high=5)
        for name in ("deflection_compensation", "imu", "calibration", "embed_motion"):
            if not isinstance(getattr(self, name), bool):
                raise ParameterError(f"body.{name} must be true or false")


@dataclass(frozen=True, kw_only=True)
class Control:
    """The walking controller: gains, filter and bounds, and how the body follows."""

    gains: Gains = field(default_factory=Gains)
    """Gains of Eq. (31)."""
    settings: ControlSettings = field(default_factory=ControlSettings)
    """ZMP filter, delay and bounds."""
    body: BodySettings = field(default_factory=BodySettings)
    """Feedback and compensation of the whole body."""
    period: float = 0.002
    """Control period [s]."""

    def __post_init__(self) -> None:
        """Check kinds and ranges.

        Raises:
            ParameterError: If a part is of another kind, or the period out of range.
        """
        kinds = {"gains": Gains, "settings": ControlSettings, "body": BodySettings}
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                raise ParameterError(f"control.{name} must be a {kind.__name__}")
        checked_number("period", self.period, unit="s", low=1e-4, high=0.1)


def _listed(value: object) -> list[object]:
    return list(value) if isinstance(value, (tuple, list)) else [value]
