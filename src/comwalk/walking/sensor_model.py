"""Sensor readings of a simulated robot: noise, and the flaws that a machine keeps.

Errors of encoder zeros, of the IMU's mounting and of the gyro's bias are drawn once for
a run. Noise is white, from one reading to the next.
"""

from __future__ import annotations

import mujoco
import numpy as np

from ..control import Sensors, SimulatorSettings

# Standard deviations at noise 1.
_ANKLE_NOISE = np.array([5.0, 5.0, 5.0, 0.2, 0.2, 0.2])  # [N, N m]
_ENCODER_NOISE = 1e-4  # [rad]
_TURN_NOISE = 2e-3  # [rad]
_GYRO_NOISE = 1e-2  # [rad/s]
_ACCELERATION_NOISE = 5e-2  # [m/s^2]
_TORQUE_NOISE = 0.2  # [N m]
_PRESSING = 0.3  # torque that presses a gear's teeth to one side [N m]
_CROSSING = 0.008  # time constant of a motor that crosses the play [s]


class SensorModel:
    """What the sensors of one robot make of the truth. Final."""

    def __init__(
        self, settings: SimulatorSettings, joints: int, seed: int, period: float
    ) -> None:
        """Draw the flaws that stay.

        Args:
            settings: How large they are.
            joints: Number of joints.
            seed: Seed of flaws and noise.
            period: Time between two readings [s].
        """
        self._period, self._play = period, np.zeros(joints)
        self._settings, self._rng = settings, np.random.default_rng(seed)
        self._torque_rng = np.random.default_rng((seed, 2))
        once = np.random.default_rng((seed, 1)).standard_normal  # noise stays as it was
        self.zeros = settings.encoder_zero * once(joints)
        """Errors of the encoders' zeros [rad], of shape (joints,)."""
        way = once(2) if settings.imu_tilt else np.ones(2)
        turn = np.array([*way / np.hypot(*way), 0.0])
        self.mounting = np.array([1.0, 0.0, 0.0, 0.0])
        """Orientation of the IMU as mounted in the IMU as assumed, wxyz, (4,)."""
        mujoco.mju_quatIntegrate(self.mounting, settings.imu_tilt * turn, 1.0)
        self.bias = settings.gyro_bias * once(3)
        """Bias of the gyro [rad/s], in its own frame, (3,)."""
        self.torque_gains = 1.0 + settings.torque_error * once(joints)
        """Torques that are reported over the true ones [-], (joints,)."""

    @property
    def is_perfect(self) -> bool:
        """Whether readings are the truth, at once."""
        s = self._settings
        flaws = (s.noise, s.encoder_zero, s.encoder_step, s.imu_tilt, s.gyro_bias)
        return not any((*flaws, s.latency, s.torque_error, s.backlash))

    def read(self, true: Sensors) -> Sensors:
        """Return what the sensors read.

        Args:
            true: The truth; its arrays may be changed.

        Returns:
            The readings.
        """
        s, normal = self._settings, self._rng.standard_normal
        q, wrenches, quat = true.positions + self.zeros, true.wrenches, true.orientation
        gyro, acc = true.gyro, true.acceleration
        if s.backlash and true.torques is not None:
            side = 0.5 * s.backlash * np.tanh(true.torques / _PRESSING)
            self._play += min(self._period / _CROSSING, 1.0) * (side - self._play)
            q += self._play
        torques = None if true.torques is None else true.torques * self.torque_gains
        if s.imu_tilt:
            R, whole = np.empty(9), np.empty(4)
            mujoco.mju_quat2Mat(R, self.mounting)
            mujoco.mju_mulQuat(whole, quat, self.mounting)
            quat, gyro, acc = whole, gyro @ R.reshape(3, 3), acc @ R.reshape(3, 3)
        if s.noise:
            wrenches += s.noise * _ANKLE_NOISE * normal((2, 6))
            q += s.noise * _ENCODER_NOISE * normal(len(q))
            mujoco.mju_quatIntegrate(quat, s.noise * _TURN_NOISE * normal(3), 1.0)
            gyro = gyro + s.noise * _GYRO_NOISE * normal(3)
            acc = acc + s.noise * _ACCELERATION_NOISE * normal(3)
            if torques is not None:
                torques += (
                    s.noise
                    * _TORQUE_NOISE
                    * self._torque_rng.standard_normal(len(torques))
                )
        if s.encoder_step:
            q = s.encoder_step * np.round(q / s.encoder_step)
        inertial = quat, gyro + self.bias, acc
        return Sensors(true.time, q, true.velocities, wrenches, *inertial, torques)
