"""Settings of a run: physics, body and controller."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import ParameterError, checked_number
from ..settings import check_settings, setting
from .gains import Gains
from .law import ControlSettings

GROUND_SENSORS = ("ft", "torque", "none")
"""How the ground is felt: by force and torque sensors at the ankles, by the torques of
the joints, or not at all, which is the law with k_p = 0."""


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

    timestep: float = setting(0.001, "Physics step", "s", "[1e-4, 0.005]")
    friction: float = setting(1.0, "Sliding friction of the floor", "", "[0, 10]")
    scene: bool = setting(
        True,
        "Whether what the robot's file holds around it is there; else a level floor",
    )
    terrain: float = setting(
        0.0,
        "Height of the highest of the random boxes that make the floor rough; 0 is a "
        "flat floor",
        "m",
        "[0, 0.2]",
    )
    terrain_seed: int = setting(0, "Seed of the boxes' heights", "", "[0, 4294967295]")
    payload: float = setting(
        0.0,
        "Load on the robot's back that the controller does not know of, as a share of "
        "the robot's mass",
        "",
        "[0, 1]",
    )
    latency: float = setting(
        0.0,
        "Age of what the controller gets from the sensors, rounded to control periods",
        "s",
        "[0, 0.2]",
    )
    noise: float = setting(
        0.0,
        "Sensor noise, as a factor on 1e-4 rad (encoders), 5 N and 0.2 N m (ankle "
        "sensors), 0.002 rad, 0.01 rad/s and 0.05 m/s^2 (IMU), 0.2 N m (torques)",
        "",
        "[0, 100]",
    )
    encoder_zero: float = setting(
        0.0,
        "Standard deviation of the errors of the encoders' zeros, drawn once for a run",
        "rad",
        "[0, 0.05]",
    )
    encoder_step: float = setting(
        0.0, "Resolution of the encoders; 0 is infinite", "rad", "[0, 0.05]"
    )
    backlash: float = setting(
        0.0,
        "Play of every gear: encoders sit on the motors, whose teeth lie on the side "
        "that they press on",
        "rad",
        "[0, 0.05]",
    )
    imu_tilt: float = setting(
        0.0,
        "Angle by which the IMU is mounted askew, about a horizontal axis drawn once",
        "rad",
        "[0, 0.1]",
    )
    gyro_bias: float = setting(
        0.0, "Standard deviation of the gyro's bias, drawn once", "rad/s", "[0, 0.2]"
    )
    command_delay: float = setting(
        0.0,
        "Age of set-points when the servos get them, rounded to control periods",
        "s",
        "[0, 0.2]",
    )
    torque_lag: float = setting(
        0.0,
        "Time constant in which motors follow a torque that is fed forward; 0 is at "
        "once",
        "s",
        "[0, 0.05]",
    )
    torque_error: float = setting(
        0.0,
        "Standard deviation of the errors of the gains of torques that joints report, "
        "drawn once",
        "",
        "[0, 0.5]",
    )
    joint_friction: float = setting(
        0.0,
        "Dry friction added to every joint, in N of a slide; the controller does not "
        "know of it",
        "N m",
        "[0, 50]",
    )
    joint_damping: float = setting(
        0.0,
        "Viscous friction added to every joint, in N s/m of a slide; the controller "
        "does not know of it",
        "N m s/rad",
        "[0, 50]",
    )
    pushes: tuple[Push, ...] = field(default=())
    """Forces on the trunk."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range.
        """
        check_settings(self)
        if not all(isinstance(push, Push) for push in _listed(self.pushes)):
            raise ParameterError(
                f"simulator.pushes must be Push's, got {self.pushes!r}"
            )


@dataclass(frozen=True, kw_only=True)
class BodySettings:
    """Settings of the whole body: feedback, compensation, foot contact."""

    feedback: float = setting(
        20.0, "Feedback on every Cartesian row against drift (CLIK)", "1/s", "[0, 100]"
    )
    deflection_compensation: bool = setting(
        True, "Whether set-points lead by the servo deflection that the plan implies"
    )
    imu: bool = setting(
        True,
        "Whether the IMU tells how the soles lie; without it they are taken as level",
    )
    imu_cutoff: float = setting(
        5.0, "Cut-off of the low-pass filter on how the soles lie", "Hz", "[0.1, 100]"
    )
    landing: float = setting(
        0.2,
        "How fast a landing foot yields or reaches down, per share of the weight that "
        "it bears too much or too little; 0 to land as planned",
        "m/s",
        "[0, 2]",
    )
    calibration: bool = setting(
        True,
        "Whether the standing robot is weighed: a load that the model does not know "
        "of shifts the CoM from where the encoders see it",
    )
    rolling: float = setting(
        0.5,
        "How fast a sole that stands on its edge is turned to lie flat; 0 to leave it",
        "rad/s",
        "[0, 5]",
    )
    sensors: str = "auto"
    """How the ground is felt, one of `GROUND_SENSORS`; "auto": by ankle sensors where
    joints take positions, else by torques."""
    observer_cutoff: float = setting(
        60.0,
        "Cut-off of the observer that finds the ground's wrenches from torques",
        "Hz",
        "[1, 1000]",
    )
    known_friction: float = setting(
        0.0,
        "Dry friction of every joint that is known, besides the model's; it is taken "
        "from the torques that are felt",
        "N m",
        "[0, 50]",
    )
    known_damping: float = setting(
        0.0,
        "Viscous friction of every joint that is known, besides the model's",
        "N m s/rad",
        "[0, 50]",
    )
    com_servo: float = setting(
        5.0,
        "Gain k_v with which torques make the CoM's velocity follow the law, over "
        "omega_n",
        "",
        "[0, 100]",
    )
    bandwidth: float = setting(
        8.0,
        "How fast torques bring trunk, feet and joints back to their references, over "
        "omega_n",
        "",
        "(0, 100]",
    )
    rate_cutoff: float = setting(
        30.0,
        "Cut-off of the low-pass filter on differences of the encoders, from which "
        "torques are computed",
        "Hz",
        "[1, 1000]",
    )
    com_cutoff: float = setting(
        7.0,
        "Cut-off below which the CoM's velocity is what the joints say, and above "
        "which what was asked for, by torque",
        "Hz",
        "[0.1, 1000]",
    )
    tilt_cutoff: float = setting(
        1.0,
        "Cut-off below which the IMU's orientation is believed, and above which the "
        "gyro's, by torque",
        "Hz",
        "[0.01, 1000]",
    )
    grip: float = setting(
        0.7,
        "Friction of the soles that torques count on",
        "",
        "(0, 10]",
    )
    embed_motion: bool = setting(
        True,
        "Whether the resolution knows of the embedded motion; False is for "
        "comparison: the arms dance, and the legs do not know",
    )

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a number is out of range, or a word unknown.
        """
        check_settings(self)
        if self.sensors not in ("auto", *GROUND_SENSORS):
            known = ", ".join(GROUND_SENSORS)
            raise ParameterError(f"sensors must be {known}, got {self.sensors!r}")


@dataclass(frozen=True, kw_only=True)
class Control:
    """The walking controller: gains, filter and bounds, and how the body follows."""

    gains: Gains = setting(Gains(), "Gains of Eq. (31)")
    settings: ControlSettings = setting(
        ControlSettings(), "ZMP filter, delay and bounds"
    )
    body: BodySettings = setting(
        BodySettings(), "Feedback and compensation of the whole body"
    )
    period: float = setting(0.002, "Control period", "s", "[1e-4, 0.1]")

    def __post_init__(self) -> None:
        """Check kinds and ranges.

        Raises:
            ParameterError: If a part is of another kind, or the period out of range.
        """
        check_settings(self)


def _listed(value: object) -> list[object]:
    return list(value) if isinstance(value, (tuple, list)) else [value]
