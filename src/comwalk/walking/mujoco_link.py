"""A simulated robot and a whole body on shared memory: physics, sensors, log.

`control.walk` exchanges commands and readings with a plant through a link. This one
writes set-points into MuJoCo's memory, reads sensors out of it, and keeps the log, by
kernels and without allocation.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from ..compiled import load
from ..control import PROGRESS_ROWS, Progress, Sensors
from ..errors import RunError
from ..handles import handle_of
from ..robot import links_in
from ..runs import Log
from .mujoco_exchange import PLACES, SceneArrays, command, feel_step, sense
from .mujoco_plant import SimulatedRobot
from .records import ROW
from .whole_body import WholeBodyTicker


class MujocoLink:
    """Exchanges set-points and readings with MuJoCo, and logs both. Final."""

    def __init__(
        self,
        plant: SimulatedRobot,
        ticker: WholeBodyTicker,
        log: Log,
        progress: Progress | None = None,
    ) -> None:
        """Load the kernels, or compile them.

        Args:
            plant: The robot.
            ticker: What computes set-points from readings.
            log: Where the rows go; its table was taken by `take_log`.
            progress: Called now and then with the simulated time [s].
        """
        self._plant, self._ticker, self._log = plant, ticker, log
        self._progress = progress
        self._arrays = scene_arrays(plant, log.table)
        there, here = handle_of(*self._arrays), ticker.handle
        self._there, self._here = there, here
        self._command = load(command, there, here, 0, 0.0)
        self._feel_step = load(feel_step, there, 0)
        self._sense = load(sense, there, here, 1)
        self._ideal = plant.sensors.is_perfect

    def write(self, k: int, sensors: Sensors | None, seconds: float) -> None:
        """Send the set-points of a period, and log its row.

        Args:
            k: Number of the period.
            sensors: What the tick was given, if not by the arrays.
            seconds: How long the tick took [s].

        Raises:
            RunError: If the log has no row for it.
        """
        plant, log = self._plant, self._log
        if k >= len(log.table):
            most = len(log.table) * plant.period
            raise RunError(f"the walk lasts longer than its log of {most:g} s")
        if plant.pushable:
            plant.begin(k)
        if sensors is not None:
            self._take(sensors)
        self._command(self._there, self._here, k, seconds)
        if plant.settings.command_delay:
            plant.delay()
            log.table[k]["ctrl"] = plant.data.ctrl
        body = self._ticker.body
        if body.resolution is not None or body.arrays.state["spared"][0]:
            for name, value in body.diagnostics().items():
                log.table[k][name] = value
        log.grow(k + 1)
        if self._progress is not None and (k + 1) % PROGRESS_ROWS == 0:
            self._progress(k * plant.period)

    def _take(self, sensors: Sensors) -> None:
        """Keep for the log what the tick does not use."""
        arrays = self._arrays
        arrays.rates[:] = sensors.velocities
        arrays.inertial[:3], arrays.inertial[3:] = sensors.gyro, sensors.acceleration

    def read(self) -> Sensors | None:
        """Simulate a period.

        Returns:
            What the robot senses; None if the readings are in the tick's arrays.
        """
        plant, there, feel = self._plant, self._there, self._feel_step
        for step in range(plant.substeps):
            mujoco.mj_step(plant.model, plant.data)
            feel(there, step)
        self._sense(there, self._here, plant.substeps)
        return None if self._ideal else plant.advance()


def take_log(log: Log, plant: SimulatedRobot, duration: float) -> None:
    """Give a log its table, before anyone reads it.

    Args:
        log: The log.
        plant: The robot.
        duration: How long the plan lasts [s].
    """
    log.take(row_type(plant), math.ceil(duration / plant.period))


def row_type(plant: SimulatedRobot) -> np.dtype:
    """Return the record that a row of the log is: `ROW`, then the robot's own columns.

    Args:
        plant: The robot.
    """
    m, n = plant.model, len(plant.joint_names)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(PLACES[:3], (n,))
    shapes |= {"qpos": (m.nq,), "qvel": (m.nv,), "ctrl": (m.nu,), "torques_true": (n,)}
    if m.na:
        shapes["act"] = (m.na,)
    if plant.pushable:
        shapes["xfrc_applied"] = (m.nbody, 6)
    own = np.dtype([(name, "f8", shape) for name, shape in shapes.items()])
    parts = [(name, *place[:2]) for name, place in (ROW.fields or {}).items()]
    for name, place in (own.fields or {}).items():
        parts.append((name, place[0], ROW.itemsize + place[1]))
    names, formats, offsets = (list(column) for column in zip(*parts, strict=True))
    size = ROW.itemsize + own.itemsize
    table = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
    return np.dtype(table)


def scene_arrays(plant: SimulatedRobot, table: np.ndarray) -> SceneArrays:
    """Return the arrays that a loop exchanges with MuJoCo.

    Args:
        plant: The robot.
        table: Rows of its log, of `row_type`.
    """
    d, robot = plant.data, plant.robot
    fields, kind = table.dtype.fields or {}, table.dtype
    offsets = [fields[name][1] if name in fields else 0 for name in PLACES]
    imu = [i for part in plant.imu for i in range(part.start, part.stop)]
    pushes = d.xfrc_applied.ravel() if plant.pushable else np.zeros(0)
    return SceneArrays(
        *(d.qpos, d.qvel, d.ctrl, d.act, d.sensordata, d.cfrc_ext.ravel()),
        *(d.actuator_force, pushes, d.subtree_com[robot.base_body]),
        links_in(robot, plant.model),
        np.array(robot.servo.actuators, dtype=np.int64),
        plant.ankles.ravel().astype(np.int64),
        np.array(imu, dtype=np.int64),
        np.array(plant.feet, dtype=np.int64).ravel(),
        plant.felt.reshape(-1),
        plant.ground.reshape(-1),
        table.view(np.uint8).reshape(-1),
        np.array([kind.itemsize, *offsets], dtype=np.int64),
        np.zeros(len(plant.joint_names)),
        np.zeros(6),
        plant.gains.ravel(),
        plant.motors,
    )
