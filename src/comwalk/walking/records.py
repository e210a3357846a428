"""Records of the compiled control tick: parameters, state and log rows.

`RULES` holds what is constant in a run, `STATE` what measuring, standing and weighing
remember from tick to tick, `JOINT` a robot's servos and limits, `ROW` what a log
keeps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import records
from ..control import (
    GROUND_SENSORS,
    WEIGHING_TIME,
    BodySettings,
    low_pass_coefficient,
)
from ..embedding import DANCE, EmbeddedMotion, rotate_twist
from ..robot import LEGS, Foot, Kinematics, Robot, Skeleton, sway_inertia
from ..sides import Side

BY_TORQUES, NOT_FELT = (GROUND_SENSORS.index(word) for word in ("torque", "none"))
"""Numbers of `GROUND_SENSORS` in `RULES`."""

STRETCH = 0.97
"""Share of a leg's whole length that a foot may be away from its hip [-]."""

RULES = np.dtype(
    [
        ("period", "f8"),  # [s]
        # The robot.
        ("mass", "f8"),
        ("gravity", "f8"),
        ("weight", "f8"),  # of the model [N]
        ("foot_weight", "f8", 2),  # below the ankle sensors [N]
        ("foot_com", "f8", (2, 3)),  # of that, in the sensor's frame [m]
        ("sole_turn", "f8", (2, 3, 3)),  # sensor axes to the sole's
        ("sole_arm", "f8", (2, 3)),  # sensor from the sole's centre [m], sole's axes
        ("sole_half", "f8", (2, 2)),  # half length and half width [m]
        ("hip", "i8", 2),  # link of the hip
        ("ankle", "f8", (2, 3)),  # of the sole's centre [m], the sole's axes
        ("reach", "f8", 2),  # of the leg, hip to ankle [m]
        # `BodySettings`.
        ("feedback", "f8"),
        ("imu", "i8"),
        ("imu_share", "f8"),
        ("landing", "f8"),
        ("rolling", "f8"),
        ("calibration", "i8"),
        ("most", "i8"),  # readings that the standing robot is weighed by
        ("embed", "i8"),
        ("compensate", "i8"),
        ("solvable", "i8"),  # whether the kernels resolve this robot's tasks
        ("sensing", "i8"),  # how the ground is felt, one of `GROUND_SENSORS`
        ("observer_share", "f8"),  # coefficient of the observer's filter [-]
        ("com_height", "f8"),  # of the standing robot [m]
        # Control by torque.
        ("by_torque", "i8"),
        ("com_share", "f8"),  # of that on the CoM's velocity [-]
        ("tilt_share", "f8"),  # coefficient of the filter on the IMU's tilt [-]
        ("rate_share", "f8"),  # coefficient of the filter on joint rates [-]
        ("com_servo", "f8"),  # k_v [1/s]
        ("bandwidth", "f8"),  # of accelerations that hold postures [rad/s]
        ("sway", "f8"),  # how much longer the legs make the pendulum [-]
        ("grip", "f8"),  # friction of the soles that is counted on [-]
    ],
    align=True,
)
"""Settings, constant in a run."""

STATE = np.dtype(
    [
        # What was measured.
        ("com", "f8", 3),
        ("zmp", "f8", 2),
        ("load", "f8"),
        ("trunk_tilt", "f8"),
        ("feedback_scale", "f8"),
        ("support", "i8"),
        ("left_share", "f8"),
        ("edges", "f8", (2, 2)),
        ("soles", "f8", (2, 3, 3)),  # rotations seen from the body center
        ("sensor", "f8", (3, 3)),
        ("level", "f8", (3, 3)),
        ("other", "f8", (3, 3)),
        # Where the feet stand, `foot_contact`.
        ("offsets", "f8", (2, 3)),
        ("recovers", "i8"),
        ("up", "f8", (2, 2)),
        ("heights", "f8", 2),
        ("leans", "f8", (2, 2)),
        # What the standing robot weighs, `control.weigh_standing`.
        ("mass_ratio", "f8"),
        ("lean", "f8", 2),
        ("seen", "i8"),
        # What control by torque estimates and gives up.
        ("readings", "i8"),
        ("turn", "f8", 4),  # orientation of the IMU, quaternion wxyz
        ("origin", "f8", 7),
        ("com_velocity", "f8", 3),  # [m/s]
        ("seen_velocity", "f8", 3),  # of the CoM, by the joints [m/s]
        ("imu_velocity", "f8", 3),  # of the IMU, by its accelerometer [m/s]
        ("swift_velocity", "f8", 3),  # of the CoM, by that and the joints [m/s]
        ("slow_velocity", "f8", 3),  # of the CoM, after the joints' filter [m/s]
        ("drag", "f8", 3),  # acceleration that the CoM misses of what is asked [m/s^2]
        ("com_bias", "f8", 3),  # [m/s^2]
        ("com_asked", "f8", 3),  # the CoM's acceleration of the last tick [m/s^2]
        ("twist", "f8", 6),
        ("drift", "f8", 6),
        ("goal", "f8", 6),  # where it is to be, and its velocity [m; m/s]
        ("away", "f8", 6),  # error of the swing foot [m; rad]
        ("pressed", "f8", 2),  # loads of the feet, low-passed, over the weight [-]
        ("landed", "i8", 2),  # which feet are on the ground
        ("share", "f8"),  # of the left foot, as asked [-]
        ("stray", "f8", 2),  # ZMP of all links less that of the CoM and the legs [m]
        ("shifted", "f8"),  # by how much the ZMP asked for was moved into the sole [m]
        ("slid", "f8"),  # force beyond the friction [N]
        ("weak", "i8"),  # joints at their torque limits
        ("spared", "i8"),  # 1 if a foot gave way; 2 if its leg was singular
        ("limited", "i8"),  # joints of its leg that are held at their limits
        ("lost", "f8"),  # largest acceleration that they miss [rad/s^2]
    ],
    align=True,
)
"""What a tick leaves for the next one."""

JOINT = np.dtype(
    [
        ("lower", "f8"),
        ("upper", "f8"),
        ("speed", "f8"),
        ("most", "f8"),  # torque limit [N m]
        ("dry", "f8"),  # friction that is known of [N m]
        ("viscous", "f8"),  # the same per rate [N m s/rad]
        ("stiffness", "f8"),
        ("damping", "f8"),
        ("home", "f8"),
        ("torque", "f8"),  # planned [N m]
        ("dance", "f8"),  # angle of the embedded motion [rad]
        ("dance_rate", "f8"),  # its rate [rad/s]
        ("dance_acceleration", "f8"),  # its acceleration [rad/s^2]
    ],
    align=True,
)
"""A joint's servo and limits, and what is planned for it."""

ROW = np.dtype(
    [
        ("t", "f8"),
        ("phase", "i8"),
        ("step", "i8"),
        ("com", "f8", 3),
        ("com_ref", "f8", 3),
        ("zmp", "f8", 2),
        ("zmp_ref", "f8", 2),
        ("zmp_filtered", "f8", 2),
        ("zmp_ref_filtered", "f8", 2),
        ("com_command", "f8", 2),
        ("u", "f8", 2),
        ("bounded", "?"),
        ("left_load", "f8"),
        ("feet_ref", "f8", (2, 3)),
        ("heading_ref", "f8"),
        ("wrenches", "f8", (2, 6)),
        ("imu_quat", "f8", 4),
        ("imu_gyro", "f8", 3),
        ("imu_acc", "f8", 3),
        ("load", "f8"),
        ("tilt", "f8"),
        ("compute_s", "f8"),
        ("damped", "f8"),
        ("limited", "f8"),
        ("loss", "f8"),
        ("com_true", "f8", 3),
        ("zmp_true", "f8", 2),
        ("loads_true", "f8", 2),
        ("wrenches_true", "f8", (2, 6)),
    ],
    align=True,
)
"""Columns of a log that every robot has."""


def rules_of(robot: Robot, period: float, settings: BodySettings) -> np.ndarray:
    """Return the parameters of a body as one record of `RULES`.

    Args:
        robot: The robot.
        period: Control period [s].
        settings: How the body follows its commands.
    """
    rules = records(RULES)
    r = rules[0]
    r["period"] = period
    _describe(r, robot)
    for name in ("feedback", "imu", "landing", "rolling", "calibration"):
        r[name] = getattr(settings, name)
    r["imu_share"] = low_pass_coefficient(settings.imu_cutoff, period)
    r["most"] = max(round(WEIGHING_TIME / period), 1)
    r["embed"] = settings.embed_motion
    r["compensate"] = settings.deflection_compensation
    r["com_share"] = low_pass_coefficient(settings.com_cutoff, period)
    r["tilt_share"] = low_pass_coefficient(settings.tilt_cutoff, period)
    r["rate_share"] = low_pass_coefficient(settings.rate_cutoff, period)
    r["grip"], r["com_height"] = settings.grip, robot.com_height
    r["sway"] = sway_inertia(robot)
    r["observer_share"] = low_pass_coefficient(settings.observer_cutoff, period)
    sensors = settings.sensors
    if sensors == "auto":
        sensors = "ft" if robot.servos is None else "torque"
    r["sensing"] = GROUND_SENSORS.index(sensors)
    if sensors == "none":
        r["calibration"] = False
    r["com_servo"] = robot.omega * settings.com_servo
    r["bandwidth"] = robot.omega * settings.bandwidth
    return rules


def _describe(r: np.void, robot: Robot) -> None:
    """Fill in what the robot is like."""
    r["mass"], r["gravity"] = robot.mass, robot.gravity
    r["weight"] = robot.mass * robot.gravity
    for k, side in enumerate(Side):
        foot = robot.feet[side]
        sensor = sole_sensor(robot, foot)
        r["foot_weight"][k], r["foot_com"][k] = foot.mass * robot.gravity, foot.com
        r["sole_turn"][k], r["sole_arm"][k] = sensor.turn[:3, :3], sensor.arm
        r["sole_half"][k] = sensor.half_length, sensor.half_width
        r["hip"][k], r["ankle"][k], r["reach"][k] = _leg_of(robot, side)


def _leg_of(robot: Robot, side: Side) -> tuple[int, np.ndarray, float]:
    """Return link of a hip, ankle in the sole's axes [m], and reach of the leg [m]."""
    kinematics = Kinematics(robot)
    kinematics.update(robot.home)
    leg = next(limb.joints for limb in robot.limbs if limb.name == LEGS[side])
    joints = [j + 1 for j in leg]
    skeleton = Skeleton(robot.model, kinematics.data, robot.name)
    (sole,), (R,) = kinematics.sites(np.array([robot.feet[side].site]))
    ankle = (skeleton.anchors(joints)[-1] - sole) @ R
    return skeleton.hip(joints), ankle, STRETCH * skeleton.leg_length(joints)


def joints_of(robot: Robot, settings: BodySettings) -> np.ndarray:
    """Return the servos and limits of a robot as records of `JOINT`.

    Args:
        robot: The robot.
        settings: Tells what friction is known besides the model's.
    """
    joints = records(JOINT, len(robot.joints))
    for name in ("lower", "upper", "speed"):
        joints[name] = getattr(robot, name)
    joints["stiffness"], joints["damping"] = robot.servo.stiffness, robot.servo.damping
    joints["home"], joints["most"] = robot.home[7:], robot.torque
    joints["dry"] = robot.model.dof_frictionloss[6:] + settings.known_friction
    joints["viscous"] = robot.model.dof_damping[6:] + settings.known_damping
    return joints


def dance_of(
    motion: EmbeddedMotion | None, joints: tuple[str, ...]
) -> tuple[np.ndarray, ...]:
    """Return an embedded motion as arrays.

    Args:
        motion: The motion, or None.
        joints: Names of the robot's joints.

    Returns:
        A record of `DANCE`, the places of its joints, its knots [s], and its cubics
        between them, highest power first, one after the other.
    """
    if motion is None:
        return records(DANCE), np.zeros(0, np.int64), np.zeros(2), np.zeros(0)
    places = {name: j for j, name in enumerate(joints)}
    moved = np.array([places[name] for name in motion.joints], dtype=np.int64)
    knots, cubics = motion.motion.spline
    return motion.record.copy(), moved, knots.copy(), cubics.ravel()


class SoleSensor(NamedTuple):
    """Pose of an ankle sensor over its sole."""

    turn: np.ndarray
    """Sensor axes to the sole's, for force and torque, (6, 6)."""
    arm: tuple[float, float, float]
    """Sensor from the sole's centre [m], sole's axes."""
    half_length: float
    """Half the length of the sole [m]."""
    half_width: float
    """Half the width of the sole [m]."""


def sole_sensor(robot: Robot, foot: Foot) -> SoleSensor:
    """Return the pose of a foot's sensor over its sole.

    Args:
        robot: The robot.
        foot: One of its feet.
    """
    kinematics = Kinematics(robot, ())
    kinematics.update(robot.home)
    (sole, sensor), (R_sole, R_sensor) = kinematics.sites(
        np.array([foot.site, foot.sensor_site])
    )
    x, y, z = ((sensor - sole) @ R_sole).tolist()
    length, width = np.abs(foot.sole).max(axis=0).tolist()
    return SoleSensor(rotate_twist(R_sole.T @ R_sensor), (x, y, z), length, width)


# ---- The arrays of a tick -----------------------------------------------------------


class Arrays(NamedTuple):
    """All that a tick reads and writes."""

    links: np.ndarray
    """Records of `LINK`: the robot, and workspace."""
    limbs: np.ndarray
    """Records of `LIMB`."""
    sites: np.ndarray
    """Records of `SITE`: soles, ankle sensors, IMU, limbs' ends."""
    wanted: np.ndarray
    """One record of `WANTED`."""
    rules: np.ndarray
    """One record of `RULES`."""
    state: np.ndarray
    """One record of `STATE`."""
    joints: np.ndarray
    """Records of `JOINT`."""
    dance: np.ndarray
    """One record of `DANCE`."""
    moved: np.ndarray
    """Joints that the embedded motion moves."""
    knots: np.ndarray
    """Its knots [s]."""
    cubics: np.ndarray
    """Its cubics, one after the other."""
    reference: np.ndarray
    """One record of `REFERENCE`."""
    q: np.ndarray
    """Commanded configuration."""
    v: np.ndarray
    """Its velocity [xdot_o; qdot]."""
    set_points: np.ndarray
    """Set-points of the joints [rad]."""
    sensed: np.ndarray
    """The body center at the origin, then what the encoders read [rad]."""
    felt: np.ndarray
    """What both ankle sensors feel (12), and the IMU's quaternion wxyz, gyro [rad/s]
    and accelerometer [m/s^2]."""
    law: np.ndarray
    """One record of `LAW`."""
    law_state: np.ndarray
    """One record of `LAW_STATE`."""
    past: np.ndarray
    """Reference CoM and ZMP of the last ticks, four numbers each, flat."""
    watch: np.ndarray
    """One record of `WATCH`."""
    guard: np.ndarray
    """One record of `GUARD`."""
    table: np.ndarray
    """The pattern's phases, `PHASE`; empty if references come from elsewhere."""
    pendulum: np.ndarray
    """omega_n [rad/s] and height [m] of the pattern's pendulum."""
    bodies: np.ndarray
    """Records of `BODY`: inertias of the links, and workspace."""
    acceleration: np.ndarray
    """Rate of v [m/s^2, rad/s^2], then the generalised forces [N, N m]."""
    speeds: np.ndarray
    """Set-points of the joints' rates [rad/s]."""
    torques: np.ndarray
    """Torques of the joints [N m], fed forward."""
    encoders: np.ndarray
    """What the encoders read last [rad]."""
    rates: np.ndarray
    """Joint rates, low-passed differences of that, then the gyro's [rad/s]."""
    seen: np.ndarray
    """Configuration that the ground is felt in, where positions are commanded, then
    its velocity."""
    observer: np.ndarray
    """Records of `BODY`; the arrays from here on are those of `Observer`."""
    motors: np.ndarray
    """Torques that the motors report [N m]."""
    slow: np.ndarray
    """The same after the filter of the joint rates [N m]."""
    filtered: np.ndarray
    """The same after the observer's filter [N m]."""
    last: np.ndarray
    """The last velocity."""
    change: np.ndarray
    """Its rate, filtered."""
    forces: np.ndarray
    """Generalised forces of the motion [N, N m]."""
    fit: np.ndarray
    """Normal equations of the soles' wrenches, with their right side."""
    phases: np.ndarray
    """The phases of an `OnlinePattern` whose steps may be moved, `PHASE`; the arrays
    from here on are its own, and empty for any other pattern."""
    online: np.ndarray
    """One record of `ONLINE`."""
    command: np.ndarray
    """One record of `COMMAND`."""
    work: np.ndarray
    """Scratch, records of `WORK`."""
    steps: np.ndarray
    """The footsteps that it follows, records of `STEP`."""
    adaptation: np.ndarray
    """One record of `ADAPTATION`."""


HANDED_OVER = -1
"""What a tick returns where the robust solver has to resolve the task."""

# Places of `Arrays` in their handle.
AT_RULES, AT_STATE, AT_JOINTS, AT_DANCE, AT_MOVED = range(4, 9)
AT_KNOTS, AT_CUBICS, AT_REFERENCE, AT_Q, AT_V = range(9, 14)
AT_SET_POINTS, AT_SENSED, AT_FELT, AT_LAW, AT_LAW_STATE = range(14, 19)
AT_PAST, AT_WATCH, AT_GUARD, AT_TABLE, AT_PENDULUM = range(19, 24)
AT_BODIES, AT_ACCELERATION, AT_SPEEDS, AT_TORQUES = range(24, 28)
AT_ENCODERS, AT_RATES, AT_SEEN, AT_OBSERVER, AT_MOTORS = range(28, 33)
AT_PHASES, AT_ONLINE, AT_COMMAND, AT_WORK, AT_STEPS, AT_ADAPTATION = range(39, 45)
