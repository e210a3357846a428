"""The humanoid between the walking controller and the plant, Fig. 4.

It measures CoM and ZMP from what a robot senses, and turns the controller's CoM
velocity u into joint set-points by the kinematic resolution, Eqs. (14)-(27), with the
swing foot and the embedded motion as given limb motions.
"""

from __future__ import annotations

import numpy as np

from ..compiled import load, records
from ..control import (
    LAW,
    LAW_STATE,
    WALKS,
    BodySettings,
    Command,
    Controller,
    ControlOutput,
    Measurement,
    Outcome,
    Sensors,
    Tick,
    Walkable,
    WalkingController,
    Watch,
    guard_of,
    outcome_of,
)
from ..embedding import (
    ALL_ROWS,
    WANTED,
    CartesianMotion,
    EmbeddedMotion,
    Flat,
    JointMotion,
    RateLimits,
    Resolution,
    Resolver,
    Task,
    bounded_solver,
)
from ..errors import PlanError
from ..handles import handle_of
from ..pattern import (
    ONLINE_ARRAYS,
    REFERENCE,
    OnlinePattern,
    Pattern,
    Reference,
    record_of,
    reference_of,
)
from ..robot import LEGS, Kinematics, Robot, bodies_of, can_resolve, carried, flatten
from ..sides import Side
from .records import HANDED_OVER, STATE, Arrays, dance_of, joints_of, rules_of
from .tick import act, finish, look_up, pose_task, sense, take_measurement, tick
from .torque_tick import exert


class WholeBody:
    """A humanoid that walks by the kinematic resolution. Final.

    Its state is the commanded configuration, integrated from the resolution, and what
    differs from the plan: where the soles stand and how they lie.
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
        self.robot, self.period, self.servos = robot, period, robot.servos
        self.joint_names, self.actuation = robot.joints, robot.actuation
        self.settings = settings or BodySettings()
        self.motion = motion
        """Motion of arms, waist or head; None if there is none."""
        self.resolution: Resolution | None = None
        """The last resolution by the robust solver; None if the kernels solved it."""
        self._commanded = Kinematics(robot, LEGS.values())
        self._resolver = Resolver(robot.limbs, robot.damping)
        bounded_solver()  # not to be imported in mid-walk
        self.arrays = self._arrays()
        """All that a tick reads and writes."""
        self.handle = handle_of(*self.arrays)
        """The same, for kernels."""
        self._positions = self.arrays.sensed[7:]
        self._wrenches = self.arrays.felt[:12].reshape(2, 6)
        self._orientation, self._gyro, self._acceleration = np.split(
            self.arrays.felt[12:], (4, 7)
        )

    def _arrays(self) -> Arrays:
        """Return the arrays of a body in the robot's home posture."""
        robot, n = self.robot, len(self.robot.joints)
        wanted, damping = records(WANTED), self._resolver.damping
        wanted["threshold"], wanted["factor"] = damping.threshold, damping.factor
        flat, rules = walk_records(robot), rules_of(robot, self.period, self.settings)
        rules["solvable"] = can_resolve(robot, flat)
        if self.servos is not None:  # weighed as it is taken over, at rest
            rules["by_torque"], rules["most"] = True, 1
        state = records(STATE)
        state["left_share"], state["mass_ratio"], state["feedback_scale"] = 0.5, 1, 1
        sensed = np.zeros(7 + n)
        sensed[3] = 1.0
        return Arrays(
            *flat,
            wanted,
            rules,
            state,
            joints_of(robot, self.settings),
            *dance_of(self.motion, robot.joints),
            records(REFERENCE),
            robot.home.copy(),
            np.zeros(6 + n),
            np.zeros(n),
            sensed,
            np.zeros(22),
            records(LAW),
            records(LAW_STATE),
            np.zeros(4),
            *guard_of(Watch()),
            np.zeros(0),
            np.zeros(2),
            bodies_of(robot),
            *map(np.zeros, (12 + 2 * n, n, n, n, 3 + n, 13 + 2 * n)),
            bodies_of(robot),
            *map(np.zeros, (n, n, n, 6 + n, 6 + n, 6 + n, 6 * 7)),
            *(np.zeros(0, kind) for kind in ONLINE_ARRAYS),
        )

    @property
    def configuration(self) -> np.ndarray:
        """Commanded configuration: base position [m], quaternion wxyz, joints [rad]."""
        return self.arrays.q

    @configuration.setter
    def configuration(self, q: np.ndarray) -> None:
        """Command another configuration."""
        self.arrays.q[:] = q

    @property
    def velocity(self) -> np.ndarray:
        """Its last velocity v = [xdot_o; qdot] [m/s, rad/s], world, (6 + joints,)."""
        return self.arrays.v

    def start(self, reference: Reference) -> Command:
        """Find the posture of the reference and return its set-points.

        Args:
            reference: The reference at the start, both feet on the ground.

        Returns:
            Set-points of the standing robot.

        Raises:
            PlanError: If the legs cannot reach the feet at that CoM height.
        """
        self.follow(ControlOutput.still(reference), reference)
        rules, state = self.arrays.rules[0], self.arrays.state[0]
        place = np.mean([reference.left.position, reference.right.position], axis=0)
        if (self.configuration == self.robot.home).all():
            self.configuration = carried(self.robot.home, place, reference.heading)
        rules["feedback"] = 50.0
        for _ in range(300):
            pose_task(self.handle)
            posture = self._commanded.posture(self.configuration)
            resolution = self._resolver.resolve(posture, self.task)
            self.arrays.v[:] = resolution.velocity
            finish(self.handle, 0.01)
            if np.abs(resolution.velocity).max() < 1e-9:
                break
        rules["feedback"] = self.settings.feedback
        posture = self._commanded.posture(self.configuration)
        miss = float(np.abs(posture.com - reference.com).max())
        if miss > 1e-4:
            raise PlanError(
                f"the legs cannot reach the feet with the CoM {reference.com[2]:.3g} m "
                f"above the ground ({1e3 * miss:.0f} mm are missing): change "
                "pendulum.height"
            )
        self._check_limits()
        state["zmp"] = reference.zmp
        state["support"] = tuple(Side).index(reference.support)
        return self.command

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
        place. How it lies is measured by the IMU.

        Args:
            sensors: Encoders, ankle wrenches and IMU.
            reference: The reference of this tick.

        Returns:
            The measurement; without ground contact the last ZMP is kept.
        """
        record_of(reference, self.arrays.reference[0])
        self.feel(sensors)
        take_measurement(self.handle)
        return self.measured

    def feel(self, sensors: Sensors) -> None:
        """Take over what the sensors read, for `measured` of the next tick.

        Args:
            sensors: Encoders, ankle wrenches and IMU.
        """
        self._positions[:] = sensors.positions
        self._wrenches[:] = sensors.wrenches
        self._orientation[:] = sensors.orientation
        self._gyro[:], self._acceleration[:] = sensors.gyro, sensors.acceleration
        if sensors.torques is not None:
            self.arrays.motors[:] = sensors.torques

    @property
    def measured(self) -> Measurement:
        """The last measurement."""
        s = self.arrays.state[0]
        com, zmp, tilt = s["com"].copy(), s["zmp"].copy(), float(s["trunk_tilt"])
        return Measurement(com, zmp, float(s["load"]), tilt, float(s["feedback_scale"]))

    def act(self, control: ControlOutput, reference: Reference) -> Command:
        """Return the joint set-points for the next period.

        Args:
            control: The walking controller's output.
            reference: The reference of this tick.

        Returns:
            Set-points of all joints.
        """
        self.follow(control, reference)
        self.conclude(act(self.handle), self.handle)
        return self.command

    def follow(self, control: ControlOutput, reference: Reference) -> None:
        """Take over what the plan and the law ask for."""
        record_of(reference, self.arrays.reference[0])
        law = self.arrays.law_state[0]
        law["u"], law["com_command"] = control.u, control.com_command
        law["e_c"] = control.com_error

    def conclude(self, status: int, handle: np.ndarray) -> None:
        """Solve robustly what `tick.act` handed over.

        Args:
            status: What it returned.
            handle: What it was called with.
        """
        self.resolution = None
        if status == HANDED_OVER and self.servos is not None:
            self._accelerate(handle)
        elif status == HANDED_OVER:
            posture = self._commanded.posture(self.configuration)
            resolution = self._resolver.resolve_within(
                posture, self.task, self._limits()
            )
            if self.robot.coupling is not None:
                self.robot.coupling.unfold(resolution.velocity)
            self.resolution = resolution
            self.arrays.v[:] = resolution.velocity
            finish(handle, self.period)

    def _accelerate(self, handle: np.ndarray) -> None:
        """Resolve accelerations robustly."""
        posture = self._commanded.posture(self.configuration)
        resolution = self._resolver.resolve_within(posture, self.task, self._limits())
        if self.robot.coupling is not None:
            self.robot.coupling.unfold(resolution.velocity)
        self.resolution = resolution
        self.arrays.acceleration[: len(self.arrays.v)] = resolution.velocity
        exert(handle)

    @property
    def command(self) -> Command:
        """The last set-points."""
        arrays = self.arrays
        positions, speeds = arrays.set_points.copy(), arrays.speeds.copy()
        if self.servos is None:
            return Command(positions, speeds)
        return Command(positions, speeds, arrays.torques.copy(), *self.servos)

    @property
    def task(self) -> Task:
        """The task of the last tick."""
        arrays = self.arrays
        support = LEGS[tuple(Side)[int(arrays.reference[0]["support"])]]
        motions: dict[str, CartesianMotion | JointMotion] = {}
        base = np.zeros(6)
        for i, limb in enumerate(self.robot.limbs):
            if limb.name == support:
                base = arrays.limbs["twist"][i].copy()
            elif limb.name in LEGS.values():
                motions[limb.name] = CartesianMotion(arrays.limbs["twist"][i].copy())
            else:
                wishes = arrays.links["desired_rate"][1:][list(limb.joints)]
                motions[limb.name] = JointMotion(wishes)
        com, trunk = arrays.wanted["com"][0].copy(), arrays.wanted["trunk"][0].copy()
        return Task(com, support, base, trunk, motions)

    def _limits(self) -> RateLimits:
        """Return the rates that respect speed limits and approach position limits.

        By torque they are the accelerations that bring rates within those limits.
        """
        robot, q, K = self.robot, self.configuration[7:], 0.2 / self.period
        lower, upper = K * (robot.lower - q), K * (robot.upper - q)
        np.maximum(lower, -robot.speed, out=lower)
        np.minimum(upper, robot.speed, out=upper)
        if self.servos is not None:
            rates, K = self.velocity[6:], 2.0 * K
            lower, upper = K * (lower - rates), K * (upper - rates)
        return RateLimits(lower, upper)

    def diagnostics(self) -> dict[str, float]:
        """Return the losses of the last resolution, to log.

        Returns:
            `damped`: 1 near a singular posture; `limited`: number of joints held at
            a speed or position limit; `loss`: the largest residual [m/s, rad/s],
            by torque of accelerations [m/s^2, rad/s^2].
        """
        resolution, state = self.resolution, self.arrays.state[0]
        if resolution is None and state["spared"]:
            limited, lost = float(state["limited"]), float(state["lost"])
            damped = float(state["spared"] == 2)
            return {"damped": damped, "limited": limited, "loss": lost}
        if resolution is None or not (resolution.damped or resolution.limited):
            return {"damped": 0.0, "limited": 0.0, "loss": 0.0}
        return {
            "damped": float(resolution.damped),
            "limited": float(len(resolution.limited)),
            "loss": resolution.loss(),
        }

    def ticker(
        self, pattern: Walkable, controller: Controller, watch: Watch | None = None
    ) -> WholeBodyTicker:
        """Return the compiled control tick, after `start`.

        Args:
            pattern: CoM, ZMP and feet over time.
            controller: The law; a `WalkingController` is applied without leaving the
                kernels.
            watch: When a walk counts as a fall.
        """
        return WholeBodyTicker(pattern, controller, self, watch or Watch())


def walk_records(robot: Robot) -> Flat:
    """Return a robot's records for walking: both legs Cartesian, all else given.

    Args:
        robot: The robot.

    Returns:
        The records; first of the sites are soles, ankle sensors and the IMU.
    """
    feet = [robot.feet[side] for side in Side]
    soles, sensors = [foot.site for foot in feet], [foot.sensor_site for foot in feet]
    flat = flatten(robot, [*soles, *sensors, robot.imu_site])
    legs = [limb.name in LEGS.values() for limb in robot.limbs]
    flat.limbs["rows"] = np.where(legs, (1 << len(ALL_ROWS)) - 1, 0)
    return flat


class WholeBodyTicker:
    """The control periods of one walk, each a call of a kernel. Final."""

    def __init__(
        self, pattern: Walkable, controller: Controller, body: WholeBody, watch: Watch
    ) -> None:
        """Take over a body that was started, and a controller that was reset.

        Args:
            pattern: CoM, ZMP and feet over time.
            controller: The law.
            body: The body.
            watch: When a walk counts as a fall.
        """
        self.body = body
        self._pattern, self._controller = pattern, controller
        watched, guard = guard_of(watch)
        arrays = body.arrays._replace(watch=watched, guard=guard)
        if isinstance(controller, WalkingController):
            controller.law["integrates"] = body.servos is None
            arrays = arrays._replace(
                law=controller.law,
                law_state=controller.state,
                past=controller.past.ravel(),
            )
        if isinstance(pattern, Pattern):
            pendulum = np.array([pattern.pendulum.omega, pattern.pendulum.height])
            table = np.ascontiguousarray(pattern.table)
            arrays = arrays._replace(table=table, pendulum=pendulum)
        if isinstance(pattern, OnlinePattern) and len(pattern.adaptation):
            arrays = Arrays(*arrays[: -len(pattern.arrays)], *pattern.arrays)
        self.arrays = arrays
        """All that a tick reads and writes."""
        self.handle = handle_of(*arrays)
        """The same, for kernels."""
        self._fused = isinstance(controller, WalkingController)
        self._looks_up = isinstance(pattern, Pattern)
        self._tick = load(tick, self.handle, 0.0)
        self.look_up(0.0)

    def look_up(self, time: float) -> None:
        """Find the reference at a time, which `step` does by itself.

        Args:
            time: Time since the plan's start [s].
        """
        if self._looks_up:
            look_up(self.handle, time)
        elif isinstance(self._pattern, OnlinePattern):
            self.arrays.reference[0] = self._pattern.fill(time)
        else:
            record_of(self._pattern.at(time), self.arrays.reference[0])

    def step(self, time: float, sensors: Sensors | None) -> Outcome | None:
        """Go through the period that starts at a time; see `Ticker.step`.

        Args:
            time: Time since the plan's start [s].
            sensors: Encoders, ankle wrenches and IMU; None if they are in the arrays
                already.

        Returns:
            None, with set-points ready to be sent; or why the walk has to end.
        """
        if sensors is not None:
            self.body.feel(sensors)
        if not self._looks_up:
            self.look_up(time)
        status = self._tick(self.handle, time) if self._fused else self._by_law(time)
        if status > WALKS:
            return outcome_of(status, self.reference, self.arrays.guard[0])
        self.body.conclude(status, self.handle)
        return None

    def _by_law(self, time: float) -> int:
        """Go through a period with a controller that is no kernel."""
        self.look_up(time)
        status = sense(self.handle)
        if status != WALKS:
            return status
        reference, measured = self.reference, self.body.measured
        self._control = self._controller.step(
            reference, measured.com, measured.zmp, measured.feedback_scale
        )
        self.body.follow(self._control, reference)
        return act(self.handle)

    @property
    def reference(self) -> Reference:
        """The reference of the last period."""
        return reference_of(self.arrays.reference[0])

    @property
    def command(self) -> Command:
        """The set-points of the last period."""
        return self.body.command

    def seen(self, sensors: Sensors, seconds: float) -> Tick:
        """Return all that happened in the last period; see `Ticker.seen`."""
        law, body = self._controller, self.body
        control = law.output() if isinstance(law, WalkingController) else self._control
        parts = body.measured, control, body.command
        return Tick(self.reference, sensors, *parts, seconds)
