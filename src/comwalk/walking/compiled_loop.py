"""The closed loop without objects: the compiled tick and MuJoCo on shared memory.

`walk.walk` is the loop to read, and `closed_loop` decides which of them runs. Here a
period is a call of the tick, of MuJoCo, and of what carries numbers between the two and
into the log; nothing is allocated.

Only where numba is installed; see `compiled`.
"""

from __future__ import annotations

import math
import time

import mujoco
import numpy as np

from ..compiled import load
from ..control import (
    PROGRESS_ROWS,
    Outcome,
    Progress,
    WalkingController,
    Watch,
    check_joints,
    completed,
    interrupted,
)
from ..handles import handle_of
from ..pattern import Pattern
from ..robot import links_in
from ..runs import Log
from .compiled_tick import CompiledTick
from .mujoco_exchange import (
    PLACES,
    SceneArrays,
    command,
    feel_step,
    sense,
)
from .mujoco_plant import SimulatedRobot
from .records import ROW
from .tick import (
    DONE,
    finish,
    look_up,
    tick,
)
from .whole_body import WholeBody


class CompiledLoop:
    """Walks one pattern with one robot in MuJoCo. Final."""

    def __init__(
        self,
        pattern: Pattern,
        controller: WalkingController,
        body: WholeBody,
        plant: SimulatedRobot,
        watch: Watch,
    ) -> None:
        """Prepare a walk.

        Args:
            pattern: What to walk.
            controller: The law.
            body: The body, standing as its `start` left it.
            plant: The robot, with sensors that are neither noisy nor late.
            watch: When a walk counts as a fall.
        """
        self._pattern, self._body, self._plant = pattern, body, plant
        self._tick = CompiledTick(pattern, controller, body, watch)
        self.solvable = self._tick.solvable
        """Whether the kernels can do it for this robot."""

    def load(self, log: Log) -> None:
        """Prepare the log, and load the kernels, or compile them.

        Args:
            log: Where the rows go.
        """
        ticks = math.ceil(self._pattern.duration / self._plant.period)
        self._scene = scene_arrays(self._plant, log.take(row_type(self._plant), ticks))
        there, here = handle_of(*self._scene), self._tick.handle
        for function, arguments in (
            (look_up, (here, 0.0)),
            (tick, (here, 0.0)),
            (finish, (here,)),
            (command, (there, here, 0, 0.0)),
            (feel_step, (there, 0)),
            (sense, (there, here, 1)),
        ):
            load(function, *arguments)

    def run(self, log: Log, progress: Progress | None) -> Outcome:
        """Walk, after `load`.

        Args:
            log: Where the rows go, the one that was prepared.
            progress: Called now and then with the simulated time [s].

        Returns:
            The outcome, as of `walk.walk`.
        """
        pattern, plant = self._pattern, self._plant
        check_joints(self._body, plant)
        outcome, reason = None, "an error"
        try:
            self._start()
            outcome = self._walk(log, progress)
            reason = "done" if outcome is None else outcome.cause
        except KeyboardInterrupt:
            outcome = interrupted(self._tick.reference())
            reason = outcome.cause
        finally:
            plant.stop(reason)
        if outcome is None:
            return completed(self._tick.reference(), pattern.duration)
        return outcome

    def _start(self) -> None:
        """Let the robot come to rest, and take over its first readings."""
        plant, first = self._plant, self._pattern.at(0.0)
        self._tick.look_up(0.0)
        self._tick.feel(plant.start(self._body.start(first)))
        self._tick.arrays.q[:] = self._body.configuration
        self._body.configuration = self._tick.arrays.q
        plant.data.sensordata[:] = plant.probe.sensordata

    def _walk(self, log: Log, progress: Progress | None) -> Outcome | None:
        """Go through all periods; return why the walk ends before, if it does."""
        plant, own, now = self._plant, self._tick, time.perf_counter
        model, data, steps = plant.model, plant.data, range(plant.substeps)
        there, here = handle_of(*self._scene), own.handle
        for k in range(len(log.table)):
            begin = now()
            status = own.step(k * plant.period)
            seconds = now() - begin
            if status != DONE:
                return own.outcome(status)
            if plant.pushable:
                plant.begin(k)
            command(there, here, k, seconds)
            if self._body.resolution is not None:
                self._note(log, k)
            log.grow(k + 1)
            for step in steps:
                mujoco.mj_step(model, data)
                feel_step(there, step)
            sense(there, here, plant.substeps)
            if progress is not None and (k + 1) % PROGRESS_ROWS == 0:
                progress(k * plant.period)
        return None

    def _note(self, log: Log, k: int) -> None:
        """Write what a resolution that was handed over had to give up."""
        row = log.table[k]
        for name, value in self._body.diagnostics().items():
            row[name] = value


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
        np.array(plant.feet, dtype=np.int64),
        plant.felt.reshape(-1),
        plant.ground.reshape(-1),
        table.view(np.uint8).reshape(-1),
        np.array([kind.itemsize, *offsets], dtype=np.int64),
    )
