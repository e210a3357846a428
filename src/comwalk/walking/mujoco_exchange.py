"""Compiled exchange with MuJoCo: sensors out of its memory, set-points and rows in.

`mujoco_plant.SimulatedRobot` and `columns.Log` document the quantities; a test ties
the two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import Record, kernel
from ..control import LAW_STATE
from ..embedding import LINK, place_links
from ..handles import floats_at, record_at, records_at
from ..pattern import REFERENCE
from .records import ROW, STATE
from .tick import (
    AT_FELT,
    AT_LAW_STATE,
    AT_MOTORS,
    AT_REFERENCE,
    AT_SENSED,
    AT_SET_POINTS,
    AT_SPEEDS,
    AT_STATE,
    AT_TORQUES,
)

_I8, _F8 = np.dtype(np.int64), np.dtype(np.float64)


class SceneArrays(NamedTuple):
    """All that is exchanged with MuJoCo in a run; views of its memory, by its names."""

    qpos: np.ndarray
    """Configuration."""
    qvel: np.ndarray
    """Velocity."""
    ctrl: np.ndarray
    """Set-points of the actuators."""
    act: np.ndarray
    """Activations, if there are any."""
    sensordata: np.ndarray
    """Readings of all sensors."""
    cfrc_ext: np.ndarray
    """Torque and force on each body about the robot's CoM, six numbers each."""
    actuator_force: np.ndarray
    """Forces of the actuators."""
    xfrc_applied: np.ndarray
    """Pushes on each body, six numbers each, if there are any."""
    com: np.ndarray
    """CoM as MuJoCo's last forward pass left it, which `cfrc_ext` is about."""
    links: np.ndarray
    """Records of `LINK`: the robot as it is in the scene, with its payload."""
    actuators: np.ndarray
    """Actuator of each joint."""
    ankles: np.ndarray
    """Where force and torque of both ankles stand in `sensordata`, (12,)."""
    imu: np.ndarray
    """Where the IMU's quaternion, gyro and accelerometer stand, (10,)."""
    feet: np.ndarray
    """Bodies of both feet."""
    felt: np.ndarray
    """Sums over a period of what the ankles read, (12,)."""
    ground: np.ndarray
    """The same of torque about the world's origin and force on both feet, (12,)."""
    table: np.ndarray
    """Rows of the log, as bytes."""
    places: np.ndarray
    """Length of a row, then where its arrays begin in it, by `PLACES`."""
    rates: np.ndarray
    """Joint rates as the robot senses them [rad/s]."""
    inertial: np.ndarray
    """Gyro [rad/s] and accelerometer [m/s^2] as it senses them, (6,)."""
    gains: np.ndarray
    """Position gains, then velocity gains, that torques are fed forward to; empty if
    the actuators take positions."""
    motors: np.ndarray
    """Sums over a period of what the motors exert [N m]."""


# Places of `SceneArrays` in their handle.
IN_QPOS, IN_QVEL, IN_CTRL = range(3)
IN_ACT, IN_SENSORDATA, IN_CFRC_EXT = range(3, 6)
IN_ACTUATOR_FORCE, IN_XFRC_APPLIED, IN_COM = range(6, 9)
IN_LINKS, IN_ACTUATORS, IN_ANKLES = range(9, 12)
IN_IMU, IN_FEET, IN_FELT = range(12, 15)
IN_GROUND, IN_TABLE, IN_PLACES, IN_RATES, IN_INERTIAL = range(15, 20)
IN_GAINS, IN_MOTORS = 20, 21

PLACES = (
    *("joints", "joint_rates", "joint_set_points", "qpos", "qvel", "ctrl"),
    *("torques_true", "act", "xfrc_applied"),
)
"""Columns whose length depends on the robot."""


@kernel
def feel_step(scene: np.ndarray, step: int) -> None:
    """Add up what ankles and ground feel after each physics step of a period.

    Args:
        scene: Handle of `SceneArrays`.
        step: Number of the step, from 0.
    """
    felt, ground, force = (
        floats_at(scene, IN_FELT),
        floats_at(scene, IN_GROUND),
        floats_at(scene, IN_CFRC_EXT),
    )
    readings, ankles, feet = (
        floats_at(scene, IN_SENSORDATA),
        records_at(scene, IN_ANKLES, _I8),
        records_at(scene, IN_FEET, _I8),
    )
    for k in range(12):
        if step == 0:
            felt[k] = ground[k] = 0.0
        felt[k] += readings[ankles[k]]
    exerted, actuators = (
        floats_at(scene, IN_MOTORS),
        records_at(scene, IN_ACTUATORS, _I8),
    )
    forces = floats_at(scene, IN_ACTUATOR_FORCE)
    for k in range(len(exerted)):
        if step == 0:
            exerted[k] = 0.0
        exerted[k] += forces[actuators[k]]
    com = floats_at(scene, IN_COM)
    x, y, z = com[0], com[1], com[2]
    for n in range(len(feet) // 2):
        body, k = feet[2 * n], feet[2 * n + 1]
        own, total = force[6 * body : 6 * body + 6], ground[6 * k : 6 * k + 6]
        total[0] += own[0] + y * own[5] - z * own[4]
        total[1] += own[1] + z * own[3] - x * own[5]
        total[2] += own[2] + x * own[4] - y * own[3]
        for i in range(3, 6):
            total[i] += own[i]


@kernel
def sense(scene: np.ndarray, tick: np.ndarray, steps: int) -> None:
    """Average over the period, and give the sensors' readings to the tick."""
    felt, ground = floats_at(scene, IN_FELT), floats_at(scene, IN_GROUND)
    qpos, readings, imu = (
        floats_at(scene, IN_QPOS),
        floats_at(scene, IN_SENSORDATA),
        records_at(scene, IN_IMU, _I8),
    )
    sensed, taken = floats_at(tick, AT_SENSED), floats_at(tick, AT_FELT)
    for k in range(12):
        felt[k], ground[k] = felt[k] / steps, ground[k] / steps
        taken[k] = -felt[k]  # MuJoCo gives what the shank exerts on the foot
    for k in range(4):
        taken[12 + k] = readings[imu[k]]
    for k in range(7, len(sensed)):
        sensed[k] = qpos[k]
    motors, exerted = floats_at(tick, AT_MOTORS), floats_at(scene, IN_MOTORS)
    for k in range(len(motors)):
        exerted[k] /= steps
        motors[k] = exerted[k]
    rates, inertial = floats_at(scene, IN_RATES), floats_at(scene, IN_INERTIAL)
    qvel = floats_at(scene, IN_QVEL)
    for k in range(len(rates)):
        rates[k] = qvel[6 + k]
    for k in range(6):
        inertial[k] = taken[16 + k] = readings[imu[4 + k]]


@kernel
def _keep_state(kept: Record, state: Record, law: Record, reference: Record) -> None:
    """Write what the plan, the sensors and the law say into a row of the log."""
    kept.t, kept.phase, kept.step = (
        reference.time,
        int(reference.phase),
        int(reference.step),
    )
    for i in range(3):
        kept.com[i], kept.com_ref[i] = state.com[i], reference.com[i]
        kept.feet_ref[0, i] = reference.feet[0].position[i]
        kept.feet_ref[1, i] = reference.feet[1].position[i]
    for i in range(2):
        kept.zmp[i], kept.zmp_ref[i] = state.zmp[i], reference.zmp[i]
        kept.zmp_filtered[i] = law.zmp_filtered[i]
        kept.zmp_ref_filtered[i] = law.zmp_reference[i]
        kept.com_command[i], kept.u[i] = law.com_command[i], law.u[i]
    kept.bounded = law.bounded != 0
    kept.left_load, kept.heading_ref = reference.left_load, reference.heading
    kept.load, kept.tilt = state.load, state.trunk_tilt


@kernel
def _keep_truth(scene: np.ndarray, kept: Record) -> None:
    """Write what only the simulator knows into a row; `SimulatedRobot.truth`."""
    felt, ground, links = (
        floats_at(scene, IN_FELT),
        floats_at(scene, IN_GROUND),
        records_at(scene, IN_LINKS, LINK),
    )
    place_links(links, floats_at(scene, IN_QPOS))
    for i in range(3):
        kept.com_true[i] = 0.0
    for k in range(len(links)):
        for i in range(3):
            kept.com_true[i] += links[k].moment[i]
    load = ground[5] + ground[11]
    kept.loads_true[0], kept.loads_true[1] = ground[5], ground[11]
    kept.zmp_true[0] = kept.zmp_true[1] = math.nan
    if load > 1.0:
        kept.zmp_true[0] = -(ground[1] + ground[7]) / load
        kept.zmp_true[1] = (ground[0] + ground[6]) / load
    for k in range(12):
        kept.wrenches_true[k // 6, k % 6] = -felt[k]


@kernel
def _keep_sensors(scene: np.ndarray, taken: np.ndarray, kept: Record) -> None:
    """Write what the sensors read into a row."""
    inertial = floats_at(scene, IN_INERTIAL)
    for k in range(12):
        kept.wrenches[k // 6, k % 6] = taken[k]
    for k in range(4):
        kept.imu_quat[k] = taken[12 + k]
    for k in range(3):
        kept.imu_gyro[k], kept.imu_acc[k] = inertial[k], inertial[3 + k]


@kernel
def _copy(source: np.ndarray, address: int) -> None:
    """Copy numbers into the column at an address."""
    for k in range(len(source)):
        record_at(address + 8 * k, _F8)[0] = source[k]


@kernel
def _keep(scene: np.ndarray, tick: np.ndarray, k: int, seconds: float) -> None:
    """Write the k-th row of the log, before the physics of its period."""
    places = records_at(scene, IN_PLACES, _I8)
    start = scene[2 * IN_TABLE] + k * places[0]
    kept, state = record_at(start, ROW)[0], records_at(tick, AT_STATE, STATE)[0]
    law = records_at(tick, AT_LAW_STATE, LAW_STATE)[0]
    _keep_state(kept, state, law, records_at(tick, AT_REFERENCE, REFERENCE)[0])
    _keep_truth(scene, kept)
    _keep_sensors(scene, floats_at(tick, AT_FELT), kept)
    kept.compute_s = seconds
    qvel, force = floats_at(scene, IN_QVEL), floats_at(scene, IN_ACTUATOR_FORCE)
    _copy(floats_at(tick, AT_SENSED)[7:], start + places[1])
    _copy(floats_at(scene, IN_RATES), start + places[2])
    _copy(floats_at(tick, AT_SET_POINTS), start + places[3])
    _copy(floats_at(scene, IN_QPOS), start + places[4])
    _copy(qvel, start + places[5])
    _copy(floats_at(scene, IN_CTRL), start + places[6])
    actuators = records_at(scene, IN_ACTUATORS, _I8)
    for j in range(len(actuators)):
        record_at(start + places[7] + 8 * j, _F8)[0] = force[actuators[j]]
    _copy(floats_at(scene, IN_ACT), start + places[8])
    _copy(floats_at(scene, IN_XFRC_APPLIED), start + places[9])


@kernel
def command(scene: np.ndarray, tick: np.ndarray, k: int, seconds: float) -> None:
    """Give the next period its command, and write the k-th row of the log.

    Args:
        scene: Handle of `SceneArrays`.
        tick: Handle of `tick.Arrays`.
        k: Which row.
        seconds: How long the tick took [s].
    """
    ctrl, actuators = floats_at(scene, IN_CTRL), records_at(scene, IN_ACTUATORS, _I8)
    out, speeds = floats_at(tick, AT_SET_POINTS), floats_at(tick, AT_SPEEDS)
    torques, gains = floats_at(tick, AT_TORQUES), floats_at(scene, IN_GAINS)
    n = len(out)
    for j in range(n):
        ctrl[actuators[j]] = out[j]
        if len(gains):
            ctrl[actuators[j]] = (
                torques[j] + gains[j] * out[j] + gains[n + j] * speeds[j]
            )
    _keep(scene, tick, k, seconds)
