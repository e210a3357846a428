"""The whole body and the law in plain objects: an oracle for the kernels.

Written independently of them, with MuJoCo's kinematics, scipy's solver and the law as
the paper writes it; slow, and used by tests alone.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Sequence
from types import SimpleNamespace
from typing import NamedTuple

import mujoco
import numpy as np

from comwalk.certificates.ideal_loop import zmp_error_from_com
from comwalk.certificates.largest_errors import ramp_step
from comwalk.control.filters import low_pass_coefficient
from comwalk.control.gains import PAPER_GAINS, Gains, Pair
from comwalk.control.guard import Watch
from comwalk.control.law import (
    Controller,
    ControlOutput,
    ControlReference,
    ControlSettings,
    heading_correction,
)
from comwalk.control.loop import BodyTicker, Walkable, walk
from comwalk.control.payload import RISE_TIME, WEIGHING_TIME
from comwalk.control.plant import Command, Sensors
from comwalk.control.sensing import Contact, Measurement, zmp_from_wrenches
from comwalk.control.settings import BodySettings, Control, SimulatorSettings
from comwalk.embedding.motion import EmbeddedMotion
from comwalk.embedding.rotations import level_error
from comwalk.embedding.solver import RateLimits, Resolver
from comwalk.embedding.task import (
    CartesianMotion,
    Damping,
    JointMotion,
    Posture,
    Resolution,
    Task,
)
from comwalk.errors import ParameterError, PlanError, checked_number
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.polygon import share_between
from comwalk.pattern.reference import Phase, Reference, minimum_jerk
from comwalk.pattern.walk_pattern import Pattern
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import LEGS, Robot
from comwalk.run import prepare
from comwalk.runs.columns import Log
from comwalk.sides import Side
from comwalk.walking.action import RECKONING
from comwalk.walking.foot_contact import (
    CAUTION,
    EDGE,
    LEAN_TIME,
    REACH,
    RECOVERING,
    RETURN_TIME,
    SETTLE_TIME,
    TOLERANCE,
)
from comwalk.walking.records import sole_sensor

FOOT_INDEX = {side: k for k, side in enumerate(Side)}
"""Row of each foot in arrays of both."""


class Place(NamedTuple):
    """Where a level frame stands."""

    x: float
    """Forward, world [m]."""
    y: float
    """To the left, world [m]."""
    c: float
    """Cosine of its yaw [-]."""
    s: float
    """Sine of its yaw [-]."""

    def turn(self, v: Sequence[float]) -> tuple[float, float, float]:
        """Return a vector in world axes, given in the frame's."""
        x, y, z = v
        return self.c * x - self.s * y, self.s * x + self.c * y, z

    def of(self, point: Sequence[float]) -> tuple[float, float, float]:
        """Return a point in the world, given in the frame."""
        x, y, z = self.turn(point)
        return self.x + x, self.y + y, z


def tilt_matrix(up: Sequence[float]) -> np.ndarray:
    r"""Return the smallest rotation that takes a direction to the vertical.

    Args:
        up: The x and y of the unit vector that points up, in the tilted frame.

    Returns:
        Rotation from the tilted to the level frame of the same heading, (3, 3).
    """
    x, y = up
    z = math.sqrt(max(1.0 - x * x - y * y, 0.0))
    k = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - k * x * x, -k * x * y, -x],
            [-k * x * y, 1.0 - k * y * y, -y],
            [x, y, z],
        ]
    )


def planned_share(reference: Reference) -> float:
    """Return the share of the weight that the plan puts on the left foot.

    On two feet it is where the reference ZMP lies between the soles.

    Args:
        reference: The reference.

    Returns:
        Share [-], in [0, 1].
    """
    if reference.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
        return 1.0 if reference.phase is Phase.SINGLE_LEFT else 0.0
    return share_between(
        reference.zmp, reference.left.position[:2], reference.right.position[:2]
    )


class Footing:
    """How the feet differ from the plan. Final."""

    def __init__(self, settings: BodySettings, period: float) -> None:
        """Start with both soles as planned.

        Args:
            settings: Which of the sensors are heeded, and how fast a foot yields.
            period: Control period [s].
        """
        self._settings, self._period = settings, period
        self._offsets = {side: (0.0, 0.0, 0.0) for side in Side}
        self._recovers = False
        self._up = np.zeros((2, 2))  # measured: what is up, in each sole's frame
        self.heights = {side: 0.0 for side in Side}
        """How far each foot is commanded above its plan [m]."""
        self.leans = np.zeros((2, 2))
        """How each foot is commanded to lie: what is up, in its frame, (2, 2)."""
        cutoff = settings.imu_cutoff
        self._share = 1.0 - math.exp(-2.0 * math.pi * cutoff * period)

    def foothold(self, side: Side, reference: Reference) -> tuple[float, float, float]:
        """Return where a sole stands: x [m], y [m], yaw [rad]."""
        foot = reference.foot(side)
        x, y, _ = foot.position.tolist()
        dx, dy, dyaw = self._offsets[side]
        return x + dx, y + dy, foot.yaw + dyaw

    def place(self, side: Side, reference: Reference) -> Place:
        """Return where a sole stands as a level frame."""
        x, y, yaw = self.foothold(side, reference)
        return Place(x, y, math.cos(yaw), math.sin(yaw))

    def feel(self, soles: np.ndarray, imu: np.ndarray, orientation: np.ndarray) -> None:
        """Find how both soles lie, by the IMU.

        Args:
            soles: Rotations of the soles, by the encoders, (2, 3, 3).
            imu: Rotation of the IMU, by the encoders, in the same axes, (3, 3).
            orientation: What the IMU reads, quaternion wxyz.
        """
        if not self._settings.imu:
            return
        w, x, y, z = orientation.tolist()
        up = (
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        )  # the world's vertical, in the IMU's frame
        seen = (imu @ up) @ soles  # (2, 3), in each sole's frame
        share = self._share * (CAUTION if self._recovers else 1.0)
        self._up += share * (seen[:, :2] - self._up)

    def level(self, soles: np.ndarray, side: Side) -> np.ndarray:
        """Return the level frame over a sole.

        Args:
            soles: Rotations of the soles, (2, 3, 3).
            side: Which sole.

        Returns:
            Rotation of a frame with the sole's heading and z up, (3, 3).
        """
        k = FOOT_INDEX[side]
        if not self._settings.imu:
            return soles[k]
        return soles[k] @ tilt_matrix(self._up[k].tolist()).T

    def change_support(
        self, old: Side, reference: Reference, seen: Sequence[float], turn: float
    ) -> None:
        """Find where the new supporting sole stands, seen from the old one.

        Args:
            old: The side that supported until now.
            reference: The reference of this tick.
            seen: The new sole's centre in the old one's level frame [m].
            turn: The new sole's heading in that frame [rad].
        """
        new = old.other
        x, y, _ = self.place(old, reference).of(seen)
        yaw = self.foothold(old, reference)[2] + turn
        self._offsets[new] = (0.0, 0.0, 0.0)
        x_d, y_d, yaw_d = self.foothold(new, reference)
        dyaw = math.remainder(yaw - yaw_d, math.tau)
        self._offsets[new] = (x - x_d, y - y_d, dyaw)

    def follow(
        self,
        reference: Reference,
        left_share: float,
        edges: np.ndarray,
        com_error: np.ndarray,
    ) -> None:
        """Move the commanded feet towards what was felt.

        Args:
            reference: The reference of this tick.
            left_share: Share of the weight that the left foot bears [-].
            edges: Where each foot's centre of pressure is, x and y as shares of the
                sole's half length and half width, (2, 2); zero for a foot in the air.
            com_error: CoM ahead of its reference [m], world, (2,).
        """
        self._recovers = math.hypot(*com_error.tolist()) > RECOVERING
        single = reference.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
        swing, planned = reference.support.other, planned_share(reference)
        surplus = left_share - planned
        surplus -= min(max(surplus, -TOLERANCE), TOLERANCE)
        for side in Side:
            swings = single and side is swing
            self._land(side, reference, swings, surplus * side.sign)
            self._lie(side, swings, edges)
        if single:
            keep = 1.0 - self._period / RETURN_TIME
            dx, dy, dyaw = self._offsets[swing]
            self._offsets[swing] = (keep * dx, keep * dy, keep * dyaw)

    def _land(
        self, side: Side, reference: Reference, swings: bool, surplus: float
    ) -> None:
        """Let a foot yield by the share of the weight that it bears too much."""
        dt, h = self._period, self.heights[side]
        if not self._settings.landing:
            return
        if swings and (surplus <= 0.0 or reference.foot(side).velocity[2] > 0.0):
            self.heights[side] = h - dt / RETURN_TIME * h
            return
        if reference.phase is Phase.DOUBLE or swings:
            rate = 0.5 if reference.phase is Phase.DOUBLE else 1.0
            h += rate * dt * self._settings.landing * surplus
        self.heights[side] = min(max(h - dt / SETTLE_TIME * h, -REACH), REACH)

    def _lie(self, side: Side, swings: bool, edges: np.ndarray) -> None:
        """Let a sole lie as the IMU says it does, and a swinging one be level.

        A sole that stands on an edge is turned the other way until it lies flat. While
        the robot recovers from a push, soles stay as they are: an ankle that yields
        cannot hold the body.
        """
        if not self._settings.imu:
            return
        k, dt = FOOT_INDEX[side], self._period
        if swings:
            self.leans[k] -= dt / RETURN_TIME * self.leans[k]
            return
        if self._recovers:
            return
        self.leans[k] += dt / LEAN_TIME * (self._up[k] - self.leans[k])
        edge = np.clip(edges[k], -1.0, 1.0)
        past = np.sign(edge) * np.maximum(np.abs(edge) - EDGE, 0.0) / (1.0 - EDGE)
        self.leans[k] += dt * self._settings.rolling * past


class Weighing:
    """What is learnt of the robot in its first moments. Final.

    The law must not act meanwhile: fed with a CoM that follows the ZMP, it would chase
    it.
    """

    def __init__(self, weight: float, period: float) -> None:
        """Take the model at its word until the robot stands.

        Args:
            weight: Weight of the model [N].
            period: Control period [s].
        """
        self.mass_ratio = 1.0
        """The robot's mass over the model's [-]."""
        self._weight = weight
        self._offset = (0.0, 0.0)  # the true CoM from the model's, heading's axes [m]
        self._seen, self._most = 0, max(round(WEIGHING_TIME / period), 1)

    def offset(self, heading: float) -> tuple[float, float]:
        """Return the true CoM from the model's [m], world.

        Args:
            heading: Yaw of the trunk [rad].

        Returns:
            x and y.
        """
        c, s, (x, y) = math.cos(heading), math.sin(heading), self._offset
        return c * x - s * y, s * x + c * y

    def weigh(self, reference: Reference, load: float, lean: np.ndarray) -> float:
        """Learn from one reading, if the robot stands and has not walked yet.

        Args:
            reference: The reference of this tick.
            load: Vertical ground force [N].
            lean: ZMP minus the model's CoM [m], world, (2,).

        Returns:
            How far the law may act on what is measured [-]: 0 while weighing, then
            smoothly up to 1.
        """
        if reference.phase is not Phase.STAND or reference.step:
            return 1.0
        mass_ratio = load / self._weight
        if self._seen < self._most and 0.5 < mass_ratio < 2.0:
            self._learn(reference.heading, mass_ratio, *lean.tolist())
        return minimum_jerk((reference.time - WEIGHING_TIME) / RISE_TIME)[0]

    def _learn(self, heading: float, mass_ratio: float, x: float, y: float) -> None:
        """Add a reading to the averages."""
        self._seen += 1
        a, (b_x, b_y) = 1.0 / self._seen, self._offset
        c, s = math.cos(heading), math.sin(heading)
        self.mass_ratio += a * (mass_ratio - self.mass_ratio)
        self._offset = b_x + a * (c * x + s * y - b_x), b_y + a * (c * y - s * x - b_y)


def _limited(x: float, y: float, limit: float) -> tuple[float, float, bool]:
    """Return the vector shortened to the limit, and whether it was longer."""
    length = math.hypot(x, y)
    if length <= limit:
        return x, y, False
    return x * limit / length, y * limit / length, True


def _xy(name: str, value: np.ndarray | Sequence[float]) -> Pair:
    """Return x and y as floats; refuse what is not finite."""
    try:
        x, y = float(value[0]), float(value[1])
    except (TypeError, ValueError, IndexError) as error:
        raise ParameterError(f"{name} must be two numbers, got {value!r}") from error
    if not math.isfinite(x + y):
        raise ParameterError(
            f"{name} must be finite, got ({x:g}, {y:g}) m; as long as it cannot "
            "be measured, pass the last value"
        )
    return x, y


class ReadableController:
    """The walking controller of Fig. 4: Eq. (31) with filter, delay and bounds. Final.

    The feedback part of u is integrated to an offset of the CoM command from the
    reference; at the bound of the offset the integral stops, and u with it, so that u
    always is the rate of the CoM command and nothing winds up. With zero gains u is
    the reference velocity and the CoM command the reference CoM, exactly.

    Example:
        >>> from types import SimpleNamespace
        >>> stand = SimpleNamespace(
        ...     com=np.zeros(2), com_velocity=np.zeros(2), zmp=np.zeros(2),
        ...     heading=0.0, walking=1.0)
        >>> controller = WalkingController(PAPER_GAINS, period=0.002)
        >>> controller.reset(stand.com, stand.zmp)
        >>> controller.step(stand, com=(-0.01, 0.0), zmp=(0.0, 0.0)).u.round(4).tolist()
        [0.066, 0.0]
    """

    def __init__(
        self,
        gains: Gains = PAPER_GAINS,
        settings: ControlSettings | None = None,
        period: float = 0.002,
    ) -> None:
        """Prepare a controller at rest in the world's origin.

        Args:
            gains: Gains of Eq. (31).
            settings: Filter, delay and bounds; the defaults if None.
            period: Control period [s], above 0.

        Raises:
            ParameterError: If the period is out of range.
        """
        self.gains = gains
        self.settings = settings or ControlSettings()
        self.period = checked_number("period", period, unit="s", low=0, open_low=True)
        self._alpha = low_pass_coefficient(self.settings.zmp_cutoff, self.period)
        self.reset((0.0, 0.0), (0.0, 0.0))

    def reset(
        self,
        reference_com: np.ndarray | Sequence[float],
        reference_zmp: np.ndarray | Sequence[float],
    ) -> None:
        """Set the filters on the reference ZMP and the CoM command on the reference.

        Args:
            reference_com: Reference CoM at the start [m], world, (2,) or (3,).
            reference_zmp: Reference ZMP at the start [m], world, (2,).

        Raises:
            ParameterError: If they are not finite numbers.
        """
        c_d, p_d = (
            _xy("reference_com", reference_com),
            _xy("reference_zmp", reference_zmp),
        )
        n = int(self.settings.delay) + 1
        self._past: deque[tuple[Pair, Pair]] = deque([(c_d, p_d)] * n, maxlen=n)
        self._zmp = self._zmp_reference = p_d
        self._offset = (0.0, 0.0)

    def step(
        self,
        reference: ControlReference,
        com: np.ndarray | Sequence[float],
        zmp: np.ndarray | Sequence[float],
        feedback_scale: float = 1.0,
    ) -> ControlOutput:
        """Return the command of one tick.

        Args:
            reference: The reference at this tick.
            com: Measured CoM [m], world, (2,) or (3,).
            zmp: Measured ZMP [m], world, (2,); the last one known if there is none.
            feedback_scale: Factor on the feedback [-], in [0, 1].

        Returns:
            The bounded CoM velocity u, the CoM command, the errors.

        Raises:
            ParameterError: If a measurement is not finite.
        """
        c, p = _xy("com", com), _xy("zmp", zmp)
        c_d, p_d = self._matched_reference(reference)
        p_d = self._zmp_reference = self._filtered(self._zmp_reference, p_d)
        p = self._zmp = self._filtered(self._zmp, p)
        e_c = c_d[0] - c[0], c_d[1] - c[1]
        e_p = p_d[0] - p[0], p_d[1] - p[1]
        gains = self.gains.blend(reference.walking)
        w_x, w_y = heading_correction(reference.heading, e_p, e_c, *gains)
        limit = self.settings.max_correction
        w_x, w_y, fast = _limited(feedback_scale * w_x, feedback_scale * w_y, limit)
        o_x, o_y = self._offset
        w_x, w_y, far = self._integrate(w_x, w_y)
        cdot_d, c_d = reference.com_velocity, self._past[-1][0]
        return ControlOutput(
            np.array((float(cdot_d[0]) + w_x, float(cdot_d[1]) + w_y)),
            np.array((c_d[0] + o_x, c_d[1] + o_y)),
            np.array(e_c),
            np.array(e_p),
            np.array(p_d),
            np.array(p),
            fast or far,
        )

    def _matched_reference(self, reference: ControlReference) -> tuple[Pair, Pair]:
        """Return the reference CoM and ZMP as late as the measurements are."""
        c_d, p_d = reference.com, reference.zmp
        now = (float(c_d[0]), float(c_d[1])), (float(p_d[0]), float(p_d[1]))
        self._past.append(now)
        return self._past[0]

    def _filtered(self, old: Pair, new: Pair) -> Pair:
        """Return one step of the low-pass filter."""
        a, (x, y) = self._alpha, old
        return x + a * (new[0] - x), y + a * (new[1] - y)

    def _integrate(self, w_x: float, w_y: float) -> tuple[float, float, bool]:
        """Integrate the correction to the offset; return the rate it really has."""
        (o_x, o_y), dt = self._offset, self.period
        x, y, far = _limited(o_x + w_x * dt, o_y + w_y * dt, self.settings.max_offset)
        self._offset = x, y
        if far:
            return (x - o_x) / dt, (y - o_y) / dt, True
        return w_x, w_y, False


class ReadableBody:
    """A humanoid that walks by the kinematic resolution. Final.

    Its state is the commanded configuration, integrated from the resolution, and the
    dead reckoning of the supporting foot.
    """

    def __init__(
        self,
        robot: Robot,
        period: float,
        motion: EmbeddedMotion | None = None,
        settings: BodySettings | None = None,
    ) -> None:
        """Prepare the workspaces.

        Args:
            robot: The robot.
            period: Control period [s].
            motion: Motion of arms, waist or head, in absolute joint angles.
            settings: How it follows its commands.
        """
        self.robot = robot
        self.joint_names = robot.joints
        self.period = period
        self.settings = settings or BodySettings()
        self.configuration = robot.home.copy()
        self.resolution: Resolution | None = None
        self.motion = motion
        """Motion of arms, waist or head; None if there is none."""
        self._commanded = Kinematics(robot, LEGS.values())
        self._sensed = Kinematics(robot, LEGS.values())
        self._resolver = Resolver(robot.limbs, robot.damping)
        self._home = robot.home[7:].copy()
        self._zmp = np.zeros(2)
        self._support = Side.LEFT
        self.footing = Footing(self.settings, period)
        self._left_share = 0.5
        self._edges = np.zeros((2, 2))
        self._free = [
            (limb.name, np.array(limb.joints, dtype=np.intp))
            for limb in robot.limbs
            if limb.name not in LEGS.values()
        ]
        names = {n: j for j, n in enumerate(robot.joints)}
        self._dancing = np.array(
            [names[n] for n in motion.joints] if motion else [], dtype=np.intp
        )
        self._stiffness = robot.servo.stiffness
        self._gravity = robot.gravity
        self._weight = robot.mass * self._gravity
        self._weighing = Weighing(self._weight, period)
        self._prepare_sensors()

    def _prepare_sensors(self) -> None:
        """Prepare what turns sensor readings into CoM and ZMP."""
        robot = self.robot
        feet = [robot.feet[side] for side in Side]
        self._sites = np.array(
            [foot.site for foot in feet]
            + [foot.sensor_site for foot in feet]
            + [robot.imu_site]
        )  # in the last place, the CoM's position takes the place of the IMU's
        self._sensed_q = np.zeros(len(robot.home))
        self._sensed_q[3] = 1.0
        self._foot_weights = [foot.mass * self._gravity for foot in feet]
        # Columns: force, torque, CoM of the foot, in the frame of its sensor.
        self._ankle_vectors = np.zeros((2, 3, 3))
        self._ankle_vectors[:, :, 2] = [foot.com for foot in feet]
        self._soles = [sole_sensor(robot, foot) for foot in feet]

    def start(self, reference: Reference) -> Command:
        """Find the posture of the reference and return its set-points.

        Args:
            reference: The reference at the start, both feet on the ground.

        Returns:
            Set-points of the standing robot.

        Raises:
            PlanError: If the legs cannot reach the feet at that CoM height.
        """
        still = ControlOutput.still(reference)
        for _ in range(300):
            resolution = self._resolve(still, reference, feedback=50.0, limited=False)
            self.configuration = self._commanded.integrate(
                self.configuration, resolution.velocity, 0.01
            )
            if np.abs(resolution.velocity).max() < 1e-9:
                break
        posture = self._commanded.posture(self.configuration)
        miss = float(np.abs(posture.com - reference.com).max())
        if miss > 1e-4:
            raise PlanError(
                f"the legs cannot reach the feet with the CoM {reference.com[2]:.3g} m "
                f"above the ground ({1e3 * miss:.0f} mm are missing): change "
                "pendulum.height"
            )
        self._check_limits()
        self._zmp = reference.zmp.copy()
        self._support = reference.support
        self.resolution = resolution
        return self._set_points(resolution, reference)

    def _check_limits(self) -> None:
        """Check that the posture to start from is within the joint limits."""
        robot, q = self.robot, self.configuration[7:]
        past = np.flatnonzero((q < robot.lower) | (q > robot.upper))
        if len(past):
            j = past[0]
            raise PlanError(
                f"to stand like this, joint {robot.joints[j]} would be at "
                f"{q[j]:.3g} rad, outside [{robot.lower[j]:.3g}, "
                f"{robot.upper[j]:.3g}]; "
                "change pendulum.height"
            )

    def measure(self, sensors: Sensors, reference: Reference) -> Measurement:
        """Return CoM and ZMP as the robot senses them, over the supporting sole.

        Where the supporting sole stands is dead reckoning: when the support changes
        sides, the encoders tell where the new sole stands from the old one, so that a
        foot set down beside its planned place is not mistaken for a body out of
        place. How it lies tells the IMU.

        Args:
            sensors: Encoders, ankle wrenches and IMU.
            reference: The reference of this tick.

        Returns:
            The measurement; without ground contact the last ZMP is kept.
        """
        self._sensed_q[7:] = sensors.positions
        self._sensed.update(self._sensed_q)
        points, rotations = self._sensed.sites(self._sites)
        points[4] = self._sensed.com
        soles = rotations[:2]
        self.footing.feel(soles, rotations[4], sensors.orientation)
        if reference.support is not self._support:
            self._change_support(reference, points, soles)
        k = FOOT_INDEX[self._support]
        level = self.footing.level(soles, self._support)
        place = self.footing.place(self._support, reference)
        seen = ((points - points[k]) @ level).tolist()
        contacts = self._contacts(
            sensors.wrenches, seen, level.T @ rotations[2:4], place
        )
        left, right = (contact.force[2] for contact in contacts)
        load = left + right
        if load > 0.05 * self._weight:
            self._left_share = min(max(left / load, 0.0), 1.0)
        self._feel_edges(sensors.wrenches)
        zmp = zmp_from_wrenches(contacts, least_load=0.05 * self._weight)
        self._zmp = self._zmp if zmp is None else zmp
        com = np.array(place.of(seen[4]))
        feedback_scale = 1.0
        if self.settings.calibration:
            feedback_scale = self._weighing.weigh(reference, load, self._zmp - com[:2])
            com[:2] += self._weighing.offset(reference.heading)
        tilt = tilt_of(sensors.orientation)
        return Measurement(com, self._zmp, load, tilt, feedback_scale)

    def _feel_edges(self, wrenches: np.ndarray) -> None:
        """Find where on the soles the ground presses, as shares of their half size."""
        for k, foot in enumerate(self._soles):
            f_x, f_y, f_z, m_x, m_y, _ = (foot.turn @ wrenches[k]).tolist()
            f_z += self._foot_weights[k]
            if f_z < 0.1 * self._weight:
                self._edges[k] = 0.0
                continue
            x, y, z = foot.arm
            self._edges[k, 0] = (x - (m_y + z * f_x) / f_z) / foot.half_length
            self._edges[k, 1] = (y + (m_x - z * f_y) / f_z) / foot.half_width

    def _change_support(
        self, reference: Reference, points: np.ndarray, soles: np.ndarray
    ) -> None:
        """Find where the new supporting sole stands, seen from the old one."""
        old, new = self._support, reference.support
        level = self.footing.level(soles, old)
        seen = (points[FOOT_INDEX[new]] - points[FOOT_INDEX[old]]) @ level
        turn = yaw_of(level.T @ self.footing.level(soles, new))
        self.footing.change_support(old, reference, seen.tolist(), turn)
        self._support = new

    def _contacts(
        self,
        wrenches: np.ndarray,
        seen: list[list[float]],
        R: np.ndarray,
        place: Place,
    ) -> list[Contact]:
        """Return each foot's ground force: what its sensor feels, and its weight.

        The sensors' points and rotations R are those seen from the supporting sole.
        """
        local = self._ankle_vectors
        local[:, :, 0], local[:, :, 1] = wrenches[:, :3], wrenches[:, 3:]
        contacts = []
        for point, vectors, weight in zip(
            seen[2:4], (R @ local).tolist(), self._foot_weights, strict=True
        ):
            (f_x, m_x, x), (f_y, m_y, y), (f_z, m_z, _) = vectors
            force = place.turn((f_x, f_y, f_z + weight))
            moment = place.turn((m_x + y * weight, m_y - x * weight, m_z))
            contacts.append(Contact(place.of(point), force, moment))
        return contacts

    def act(self, control: ControlOutput, reference: Reference) -> Command:
        """Return the joint set-points for the next period.

        Args:
            control: The walking controller's output.
            reference: The reference of this tick.

        Returns:
            Set-points of all joints.
        """
        resolution = self._resolve(control, reference, self.settings.feedback)
        if self.robot.coupling is not None:
            self.robot.coupling.unfold(resolution.velocity)
        self.resolution = resolution
        self.configuration = self._commanded.integrate(
            self.configuration,
            resolution.velocity,
            self.period,
            resolution.posture.rotation,
        )
        return self._set_points(resolution, reference)

    def resolve(self, task: Task) -> np.ndarray:
        """Resolve a task at the commanded configuration, within joint limits.

        Args:
            task: What is asked.

        Returns:
            v = [xdot_o; qdot] [m/s, rad/s], world, of shape (6 + joints,).
        """
        posture = self._commanded.posture(self.configuration)
        resolution = self._resolver.resolve_within(posture, task, self._rate_limits())
        if self.robot.coupling is not None:
            self.robot.coupling.unfold(resolution.velocity)
        self.resolution = resolution
        return resolution.velocity

    @property
    def damping(self) -> Damping:
        """How singular limbs give way."""
        return self._resolver.damping

    def _resolve(
        self,
        control: ControlOutput,
        reference: Reference,
        feedback: float,
        limited: bool = True,
    ) -> Resolution:
        """Resolve the tick's task at the commanded configuration."""
        posture = self._commanded.posture(self.configuration)
        K = feedback
        target = reference.com.copy()
        target[:2] = control.com_command
        com_velocity = K * (target - posture.com)
        com_velocity[:2] += control.u
        twists = {s: self._foot_twist(s, reference, posture, K) for s in Side}
        trunk = K * level_error(reference.heading, posture.rotation)
        trunk[2] += reference.heading_rate
        swing = reference.support.other
        self.footing.follow(
            reference, self._left_share, self._edges, -control.com_error
        )
        motions: dict[str, CartesianMotion | JointMotion] = dict(
            self._joint_motions(reference.time, K)
        )
        motions[LEGS[swing]] = CartesianMotion(twists[swing])
        support = reference.support
        task = Task(com_velocity, LEGS[support], twists[support], trunk, motions)
        if not limited:
            return self._resolver.resolve(posture, task)
        return self._resolver.resolve_within(posture, task, self._rate_limits())

    def _foot_twist(
        self, side: Side, reference: Reference, posture: Posture, K: float
    ) -> np.ndarray:
        """Return the twist of a foot: its plan's, and feedback to where it should be.

        The supporting foot follows its dead reckoning slowly, since each correction
        moves the whole body.
        """
        k, footing = FOOT_INDEX[side], self.footing
        foot = reference.foot(side)
        x_d, y_d, yaw_d = footing.foothold(side, reference)
        z_d = float(foot.position[2]) + footing.heights[side]
        x, y, z = posture.ends[k].tolist()
        R = posture.end_rotations[k]
        if self.settings.imu:
            R = R @ tilt_matrix(footing.leans[k].tolist()).T
        e_x, e_y, e_z = level_error(yaw_d, R).tolist()
        v_x, v_y, v_z = foot.velocity.tolist()
        K_p = min(K, RECKONING) if side is reference.support else K
        return np.array(
            [
                v_x + K_p * (x_d - x),
                v_y + K_p * (y_d - y),
                v_z + K * (z_d - z),
                K * e_x,
                K * e_y,
                foot.yaw_rate + K_p * e_z,
            ]
        )

    def _joint_motions(self, t: float, K: float) -> dict[str, JointMotion]:
        """Return the rates of all limbs but the legs: the dance, or back to home."""
        rates = K * (self._home - self.configuration[7:])
        if self.motion is not None and self.settings.embed_motion:
            dancing = self._dancing
            positions, forward = self.motion.at(t)
            rates[dancing] += K * (positions - self._home[dancing]) + forward
        return {n: JointMotion(rates[joints]) for n, joints in self._free}

    def _rate_limits(self) -> RateLimits:
        """Return the rates that respect speed limits and approach position limits."""
        robot, q, K = self.robot, self.configuration[7:], 0.2 / self.period
        lower, upper = K * (robot.lower - q), K * (robot.upper - q)
        np.maximum(lower, -robot.speed, out=lower)
        np.minimum(upper, robot.speed, out=upper)
        return RateLimits(lower, upper)

    def diagnostics(self) -> dict[str, float]:
        """Return what the last resolution had to give up, to log.

        Returns:
            `damped`: 1 near a singular posture; `limited`: number of joints held at
            a speed or position limit; `loss`: the largest residual [m/s, rad/s].
        """
        resolution = self.resolution
        if resolution is None or not (resolution.damped or resolution.limited):
            return {"damped": 0.0, "limited": 0.0, "loss": 0.0}
        return {
            "damped": float(resolution.damped),
            "limited": float(len(resolution.limited)),
            "loss": resolution.loss(),
        }

    def _set_points(self, resolution: Resolution, reference: Reference) -> Command:
        """Return set-points that lead by the deflection the plan implies.

        A position servo yields by torque / stiffness, and lags its moving set-point by
        damping / stiffness. Both are known in advance: the torques are those that
        carry the body, accelerated with the reference CoM, by ground forces at the
        reference ZMP.
        """
        q, rates = self.configuration[7:].copy(), resolution.rates
        if self.settings.deflection_compensation:
            torques = self._planned_torques(resolution, reference)
            torques *= self._weighing.mass_ratio
            q += (torques + self.robot.servo.damping * rates) / self._stiffness
        if self.motion is not None and not self.settings.embed_motion:
            q[self._dancing], _ = self.motion.at(reference.time)
        return Command(q, rates)

    def _planned_torques(
        self, resolution: Resolution, reference: Reference
    ) -> np.ndarray:
        """Return the joint torques of the plan [N m], of shape (joints,)."""
        posture, load = resolution.posture, planned_share(reference)
        a_x, a_y, a_z = reference.com_acceleration.tolist()
        m, g = self.robot.mass, self._gravity
        f_x, f_y, f_z = m * a_x, m * a_y, m * (a_z + g)
        (x_l, y_l, _), (x_r, y_r, _) = posture.ends[:2].tolist()
        p_x, p_y = reference.zmp.tolist()
        x = p_x - load * x_l - (1.0 - load) * x_r
        y = p_y - load * y_l - (1.0 - load) * y_r
        wrench = (f_x, f_y, f_z, y * f_z, -x * f_z, x * f_y - y * f_x)
        shares = [load * w for w in wrench] + [(1.0 - load) * w for w in wrench]
        carried = holding_forces(self._commanded, reference.com_acceleration)
        return carried[6:] - np.array(shares) @ posture.jacobian[3:15, 6:]

    def ticker(
        self, pattern: Walkable, controller: Controller, watch: Watch
    ) -> BodyTicker:
        """Return what ticks by `measure`, `step` and `act`."""
        return BodyTicker(pattern, controller, self, watch)


def readable_run(
    robot: Robot,
    pattern: Pattern,
    *,
    control: Control | None = None,
    physics: SimulatorSettings | None = None,
    watch: Watch | None = None,
) -> SimpleNamespace:
    """Return outcome and log of a walk by this body and law."""
    parts = prepare(robot, pattern, control=control, physics=physics, force=True)
    control, plant = parts.control, parts.plant
    body = ReadableBody(robot, control.period, None, control.body)
    law = ReadableController(control.gains, control.settings, control.period)
    log = Log(100_000, lambda: {**plant.snapshot(), **body.diagnostics()})
    outcome = walk(pattern, law, body, plant, on_tick=log.record, watch=watch)
    return SimpleNamespace(outcome=outcome, log=log)


def tilt_of(orientation: np.ndarray) -> float:
    """Return the angle between a frame's z axis and the vertical.

    Args:
        orientation: Quaternion wxyz, of shape (4,).

    Returns:
        Angle [rad] in [0, pi].
    """
    _, x, y, _ = orientation.tolist()
    return 2.0 * math.asin(min(1.0, math.hypot(x, y)))


def yaw_of(R: np.ndarray) -> float:
    """Return the yaw of a rotation: the heading of its x axis on the ground.

    Args:
        R: Rotation matrix, of shape (3, 3).

    Returns:
        Angle [rad] in (-pi, pi].
    """
    return math.atan2(R[1, 0], R[0, 0])


def rotation_log(R: np.ndarray) -> np.ndarray:
    """Return the rotation vector of a rotation matrix, exact up to 180 degrees.

    Args:
        R: Rotation matrix, of shape (3, 3).

    Returns:
        Rotation vector [rad], angle in [0, pi], of shape (3,).
    """
    return level_error(0.0, R.T)


def simulate_error_dynamics(
    pendulum: Pendulum,
    k_p: float,
    k_c: float,
    disturbance: np.ndarray,
    dt: float,
    initial: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray]:
    r"""Return the errors under a piecewise linear disturbance, Eqs. (33) and (34).

    .. math:: \frac{k_p}{\omega_n^2} \ddot e_c + \dot e_c + (k_c - k_p) e_c = -\epsilon

    integrated exactly (matrix exponential) on the state (e_c, e_c'), which avoids the
    algebraic loop between u and p.

    Args:
        pendulum: Gives omega_n [rad/s].
        k_p: ZMP gain [1/s], above 0.
        k_c: CoM gain [1/s]; the loop need not be stable.
        disturbance: eps at the sample times [m/s], linear between, of shape (n,).
        dt: Sample time [s], above 0.
        initial: e_c [m] and its rate [m/s] at the start.

    Returns:
        e_c and e_p [m] at the sample times, each of shape (n,).

    """
    h, eps = dt, np.asarray(disturbance, dtype=float)
    F, G_0, G_1 = ramp_step(pendulum, k_p, k_c, h)
    x = np.empty((len(eps), 2))
    x[:1] = initial
    for i in range(len(eps) - 1):
        x[i + 1] = F @ x[i] + G_0 * eps[i] + G_1 * eps[i + 1]
    return x[:, 0], zmp_error_from_com(k_p, k_c, x[:, 0], x[:, 1], eps)


def holding_forces(kinematics: Kinematics, com_acceleration: np.ndarray) -> np.ndarray:
    """Return the generalised forces that carry the body, ground forces excluded.

    They belong to the configuration of the last `update` or `posture`. The whole body
    is taken to accelerate like its CoM, as the simplified model (1)-(3) does.
    """
    model, forces = (
        copy.copy(kinematics.robot.model),
        np.empty(kinematics.data.qvel.size),
    )
    model.opt.gravity[:] -= com_acceleration
    data = mujoco.MjData(model)
    data.qpos[:] = kinematics.data.qpos
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_rne(model, data, 0, forces)
    if kinematics.robot.coupling is not None:
        kinematics.robot.coupling.fold(forces)
    return forces
