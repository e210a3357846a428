"""The humanoid between the walking controller and the plant, Fig. 4.

It measures CoM and ZMP from what a robot senses, and turns the controller's CoM
velocity u into joint set-points by the kinematic resolution, Eqs. (14)-(27), with the
swing foot and the embedded motion as given limb motions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..control import (
    BodySettings,
    Command,
    Contact,
    ControlOutput,
    Measurement,
    Sensors,
    Weighing,
    tilt_of,
    zmp_from_wrenches,
)
from ..embedding import (
    CartesianMotion,
    Damping,
    EmbeddedMotion,
    JointMotion,
    Posture,
    RateLimits,
    Resolution,
    Resolver,
    Task,
    level_error,
    rotate_twist,
    yaw_of,
)
from ..errors import PlanError
from ..pattern import Reference
from ..robot import (
    LEGS,
    Foot,
    Kinematics,
    Robot,
)
from ..sides import Side
from .foot_contact import (
    FOOT_INDEX,
    Footing,
    Place,
    planned_share,
    tilt_matrix,
)

RECKONING = 5.0
"""Feedback of the supporting foot to its dead reckoning [1/s]."""


class WholeBody:
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
        self._resolver = Resolver(robot.limbs)
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
        trust = 1.0
        if self.settings.calibration:
            trust = self._weighing.weigh(reference, load, self._zmp - com[:2])
            com[:2] += self._weighing.offset(reference.heading)
        tilt = tilt_of(sensors.orientation)
        return Measurement(com, self._zmp, load, tilt, trust)

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
            torques *= self._weighing.heaviness
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
        carried = self._commanded.holding_forces(reference.com_acceleration)
        return carried[6:] - np.array(shares) @ posture.jacobian[3:15, 6:]


class SoleSensor(NamedTuple):
    """How an ankle sensor is over its sole."""

    turn: np.ndarray
    """Sensor axes to the sole's, for force and torque, (6, 6)."""
    arm: tuple[float, float, float]
    """Sensor from the sole's centre [m], sole's axes."""
    half_length: float
    """Half the length of the sole [m]."""
    half_width: float
    """Half the width of the sole [m]."""


def sole_sensor(robot: Robot, foot: Foot) -> SoleSensor:
    """Return how a foot's sensor is over its sole.

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
