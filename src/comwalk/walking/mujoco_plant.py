"""The robot in MuJoCo, as a plant: sensors out, joint set-points in.

The controller gets what a robot has: encoders, ankle wrenches, an IMU. What only a
simulator knows (`truth`) goes to the log alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from ..control import Command, Push, Sensors, SimulatorSettings
from ..errors import ParameterError
from ..pattern import FootstepPlan
from ..robot import Robot, Skeleton
from ..sides import Side
from .mujoco_scene import BEGIN, ankle_readings, build_scene, imu_readings, trunk_body
from .sensor_model import SensorModel


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Ground truth of the simulator; for the log, never for the controller."""

    com: np.ndarray
    """CoM [m], world, of shape (3,)."""
    zmp: np.ndarray
    """Centre of pressure of the ground contacts [m], nan in the air, of shape (2,)."""
    loads: np.ndarray
    """Vertical ground force on the left and the right foot [N], of shape (2,)."""
    torques: np.ndarray
    """Torques of the servos [N m], of shape (joints,)."""
    wrenches: np.ndarray
    """What the ankle sensors feel, without noise and delay [N, N m], (2, 6)."""


class SimulatedRobot:
    """A robot in MuJoCo, implementing `Plant`. Final."""

    def __init__(
        self,
        robot: Robot,
        period: float,
        settings: SimulatorSettings | None = None,
        seed: int = 0,
        plan: FootstepPlan | None = None,
        *,
        pushable: bool = False,
    ) -> None:
        """Build the scene.

        Args:
            robot: The robot.
            period: Control period [s], a multiple of the physics step.
            settings: Physics.
            seed: Seed of the sensor noise.
            plan: Where a rough floor is needed.
            pushable: Whether pushes come while it runs, by `push`.

        Raises:
            ParameterError: If the period is no multiple of the physics step, or a
                rough floor is wanted without a plan.
            ModelError: If the model lacks a sensor.
        """
        self.settings = settings or SimulatorSettings()
        self.robot = robot
        self.joint_names, self.actuation = robot.joints, robot.actuation
        self.period = period
        self.substeps = round(period / self.settings.timestep)
        if not math.isclose(self.substeps * self.settings.timestep, period):
            raise ParameterError(
                f"the control period {period} s must be a multiple of the physics "
                f"step {self.settings.timestep} s"
            )
        self.model = build_scene(robot, self.settings, plan)
        self.data = mujoco.MjData(self.model)
        self.probe = mujoco.MjData(self.model)
        """Workspace for what must leave no trace in the run."""
        self.sensors = SensorModel(self.settings, len(robot.joints), seed, period)
        """What makes readings of the truth."""
        self._actuators = robot.servo.actuators
        self.imu = imu_readings(self.model)
        """Where the IMU's readings stand in sensordata."""
        self.ankles = np.array([ankle_readings(self.model, side) for side in Side])
        """Where the ankles' forces and torques do, (2, 6)."""
        self.feet = _bodies_of_feet(robot, self.model)
        """Bodies of the feet and what is fixed to them, and of which foot, (n, 2)."""
        self._trunk = trunk_body(self.model)
        ages = self.settings.command_delay, self.settings.latency
        late, old = (round(age / period) + 1 for age in ages)
        self._sent: deque[np.ndarray] = deque(maxlen=late)
        self._readings: deque[Sensors] = deque(maxlen=old)
        self.felt, self.ground = np.zeros((2, 6)), np.zeros((2, 6))
        """Averages over the last period: what the ankle sensors read; torque about the
        world's origin and force on each foot."""
        self.motors = np.zeros(len(robot.joints))
        """The same of what the motors exert [N m], (joints,)."""
        self._tick = 0
        self.gains = np.zeros((0 if robot.servos is None else 2, len(robot.joints)))
        """Position and velocity gains that torques are fed forward to, (2, joints);
        none if joints take positions alone."""
        self._pushes = list(self.settings.pushes)
        self.pushable = pushable or bool(self._pushes)
        """Whether it may be pushed."""

    def place(self, configuration: np.ndarray) -> None:
        """Put the robot where the simulation starts.

        Args:
            configuration: MuJoCo's qpos: base pose, then joint angles.
        """
        self._reset(configuration)
        self._tick = 0

    def _reset(self, configuration: np.ndarray) -> None:
        key = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_KEY, BEGIN)
        mujoco.mj_resetDataKeyframe(self.model, self.data, key)  # -1 is none
        self.data.qpos[: len(configuration)] = configuration

    def start(self, command: Command) -> Sensors:
        """Settle the robot under a first command; return the first reading.

        What the settling leaves is the configuration alone, so that a replay from the
        first recorded state has nothing to guess. What is around the robot waits.
        """
        self._sent.clear()
        self.data.ctrl[self._actuators] = command.positions
        if len(self.gains):
            self._hold_still()
        steps = round(_SETTLING / self.settings.timestep)
        for _ in self._held(steps - steps // 2):
            pass
        self._average(self._held(steps // 2))
        self._reset(self.data.qpos[: self.robot.model.nq].copy())
        if len(self.gains):
            self._take_torques(command)
        self.write(command)
        if self.settings.torque_lag and len(self.gains):
            places = self.model.actuator_actadr[self._actuators]
            self.data.act[places] = self.data.ctrl[self._actuators]
        # Sensors need a forward pass; on a copy, it leaves no trace in the run.
        mujoco.mj_copyData(self.probe, self.model, self.data)
        mujoco.mj_forward(self.model, self.probe)
        self.data.sensordata[:] = self.probe.sensordata
        if not len(self.gains):
            self._average([self.probe])
        self._readings.clear()
        return self._delayed(self._sense_at_rest())

    def _sense_at_rest(self) -> Sensors:
        """Return the first reading.

        What takes torques was standing before it is taken over: an average.
        """
        if not len(self.gains):
            return self._sense(self.probe)
        readings = [self._sense(self.probe) for _ in range(_RESTING)]
        columns = zip(*map(dataclasses.astuple, readings), strict=True)
        return Sensors(*(np.mean(column, axis=0) for column in columns))

    def write(self, command: Command) -> None:
        """Give the motors a command, and set the pushes that act in the period."""
        self.data.ctrl[self._actuators] = command.positions
        if len(self.gains):
            k_p, k_d = self.gains
            self.data.ctrl[self._actuators] *= k_p
            self.data.ctrl[self._actuators] += (
                command.torques + k_d * command.velocities
            )
        self.delay()
        self.begin(self._tick)

    def _hold_still(self) -> None:
        """Hold joints that take torques where they are, as on a stand, by stiff gains.

        Soft joints need the controller to stand, which runs from the first period on.
        """
        m, driving, robot = self.model, self._actuators, self.robot
        stiff = _HOLDING * robot.mass * robot.gravity * robot.com_height
        m.actuator_gainprm[driving, 0] = stiff
        m.actuator_biasprm[driving, 1] = -stiff
        m.actuator_biasprm[driving, 2] = -_HOLDING_LAG * stiff

    def _take_torques(self, command: Command) -> None:
        """Make joints exert what is fed forward and what their gains add."""
        self.gains[:] = command.stiffness, command.damping
        m, driving = self.model, self._actuators
        m.actuator_ctrllimited[driving] = 0
        m.actuator_gainprm[driving, 0] = 1.0
        m.actuator_biasprm[driving, 1:3] = -self.gains.T

    def delay(self) -> None:
        """Put the set-points that arrive now in place of those just set."""
        if self.settings.command_delay:
            self._sent.append(self.data.ctrl.copy())
            self.data.ctrl[:] = self._sent[0]

    def begin(self, tick: int) -> None:
        """Set the pushes that act in a period.

        Args:
            tick: Number of the period, from 0.
        """
        self._tick, now = tick, tick * self.period
        self.data.xfrc_applied[self._trunk] = 0.0
        for push in self._pushes:
            if push.start - 1e-9 <= now < push.start + push.duration - 1e-9:
                self.data.xfrc_applied[self._trunk, :3] += push.force

    def push(self, force: tuple[float, float, float], duration: float = 0.1) -> None:
        """Push the trunk from the next control period on.

        Args:
            force: Force [N], world.
            duration: How long it lasts [s].

        Raises:
            ParameterError: If the robot was not made pushable, or a number is out of
                range.
        """
        if not self.pushable:
            raise ParameterError("to be pushed while it runs, it needs pushable=True")
        start = (self._tick + 1) * self.period
        self._pushes.append(Push(start=start, force=force, duration=duration))

    def read(self) -> Sensors:
        """Simulate one period and return what the robot senses.

        Forces are averages over the period, as an ankle sensor with an anti-aliasing
        filter gives: each new set-point makes them ring within it.
        """
        self._average(self._substeps(self.substeps))
        return self.advance()

    def advance(self) -> Sensors:
        """Count a period that was simulated, and return the readings that arrive."""
        self._tick += 1
        return self._delayed(self._sense(self.data))

    def _delayed(self, sensors: Sensors) -> Sensors:
        """Keep a reading, and return the one that arrives now: at first, the first."""
        self._readings.append(sensors)
        return self._readings[0]

    def _substeps(self, count: int) -> Iterator[mujoco.MjData]:
        """Simulate, and offer the state after each physics step."""
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            yield self.data

    def _held(self, count: int) -> Iterator[mujoco.MjData]:
        """Simulate the robot alone: what else can move stays where it begins."""
        nq, nv = self.robot.model.nq, self.robot.model.nv
        around = self.data.qpos[nq:].copy(), self.data.qvel[nv:].copy()
        for data in self._substeps(count):
            data.qpos[nq:], data.qvel[nv:] = around
            yield data

    def _average(self, states: Iterable[mujoco.MjData]) -> None:
        """Average ankle sensors, motors and ground forces over some states."""
        self.felt[:], self.ground[:], self.motors[:], count = 0.0, 0.0, 0.0, 0
        for data in states:
            self.motors += data.actuator_force[self._actuators]
            self.felt += data.sensordata.take(self.ankles)
            self.ground += self._ground_forces(data)
            count += 1
        self.felt /= count
        self.motors /= count
        self.ground /= count

    def _ground_forces(self, data: mujoco.MjData) -> np.ndarray:
        forces, bodies = np.zeros((2, 6)), self.feet
        np.add.at(forces, bodies[:, 1], data.cfrc_ext[bodies[:, 0]])
        forces[:, :3] += _cross(data.subtree_com[self.robot.base_body], forces[:, 3:])
        return forces

    def stop(self, reason: str) -> None:
        """Do nothing: the motors of a simulated robot need no rest."""

    def _sense(self, data: mujoco.MjData) -> Sensors:
        """Return the sensors' readings, with their noise and flaws."""
        s = data.sensordata
        # MuJoCo gives what the shank exerts on the foot; the robot feels the opposite.
        return self.sensors.read(
            Sensors(
                self._tick * self.period,
                data.qpos[7 : self.robot.model.nq].copy(),
                data.qvel[6 : self.robot.model.nv].copy(),
                -self.felt,
                *(s[part].copy() for part in self.imu),
                self.motors.copy(),
            )
        )

    def snapshot(self) -> dict[str, np.ndarray]:
        """Return the state before the next period's physics, and the truth, to log."""
        data, truth = self.data, self.truth()
        row = {
            "qpos": data.qpos.copy(),
            "qvel": data.qvel.copy(),
            "ctrl": data.ctrl.copy(),
            "com_true": truth.com,
            "zmp_true": truth.zmp,
            "loads_true": truth.loads,
            "torques_true": truth.torques,
            "wrenches_true": truth.wrenches,
        }
        if self.model.na:
            row["act"] = data.act.copy()
        if self.pushable:
            row["xfrc_applied"] = data.xfrc_applied.copy()
        return row

    def truth(self) -> Truth:
        """Return the ground truth, with the contact forces of the last period."""
        data = self.data
        # mj_step leaves positions one step behind qpos: compute the CoM anew.
        self.probe.qpos[:] = data.qpos
        mujoco.mj_kinematics(self.model, self.probe)
        mujoco.mj_comPos(self.model, self.probe)
        left, right = self.ground
        m_x, m_y, _, _, _, f_z = (left + right).tolist()
        zmp = np.full(2, np.nan)
        if f_z > 1.0:
            zmp[:] = -m_y / f_z, m_x / f_z
        return Truth(
            com=self.probe.subtree_com[self.robot.base_body].copy(),
            zmp=zmp,
            loads=np.array([left[5], right[5]]),
            torques=data.actuator_force[self._actuators],
            wrenches=-self.felt,
        )


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x, y, z = a.tolist()
    return b @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


_SETTLING = 0.5  # time to come to rest before a run [s]
_RESTING = 100  # readings of a robot at rest before it is taken over
_HOLDING, _HOLDING_LAG = 200.0, 0.1  # stiffness in m g h [1/rad], and its damping [s]


def _bodies_of_feet(robot: Robot, model: mujoco.MjModel) -> np.ndarray:
    """Return the bodies of both feet, and which foot each is of, (n, 2)."""
    look, found = Skeleton(model, mujoco.MjData(model), robot.name), []
    for k, side in enumerate(Side):
        foot = int(model.site_bodyid[model.site(f"{side.value[0]}_sole_centre").id])
        found += [(int(body), k) for body in look.welded(foot)]
    return np.array(found)
