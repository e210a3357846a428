r"""The interface of a robot, and the paper's simplified robot, Eq. (30).

`Plant` is the robot box of Fig. 4 seen from the loop: set-points go in, sensor readings
come out, once a period. A driver of a real robot implements it, as a simulator does.
`PendulumPlant` is the simplified model with a disturbance of one's choice:

.. math:: \dot c = v + \epsilon, \quad \tau \dot v = u - v, \quad
    p = c - \ddot c / \omega_n^2

Note:
    Differs from Eq. (30): u passes through a servo of time constant tau. With v = u the
    ZMP would contain the derivative of u, of which the law makes u: an algebraic loop,
    and an infinite ZMP at every jump of a sampled u.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from ..errors import ComwalkError, ParameterError, checked_number
from ..pattern import Pendulum, zmp_of_motion
from .filters import servo_response

Disturbance: TypeAlias = Callable[[float], tuple[np.ndarray, np.ndarray]]
"""From the time [s] to eps (2,) [m/s] and its rate (2,) [m/s^2]; x and y, world."""

PAPER_MASS = 67.68
"""Mass of the robot of Section VI [kg]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensors:
    """Sensor readings at one time."""

    time: float
    """Time since the start [s]."""
    positions: np.ndarray
    """Joint encoders [rad] (or [m]), of shape (n,), in the order of `joint_names`."""
    velocities: np.ndarray
    """Joint velocities [rad/s] (or [m/s]), of shape (n,)."""
    wrenches: np.ndarray
    """Left and right ankle sensor: force [N] and torque [N m] that the ground side
    exerts on the robot, in the sensor's own frame and about its origin, (2, 6)."""
    orientation: np.ndarray
    """Orientation of the trunk's IMU, quaternion wxyz, to world, of shape (4,)."""
    gyro: np.ndarray
    """Angular velocity of the IMU [rad/s], in its own frame, of shape (3,)."""
    acceleration: np.ndarray
    """What the accelerometer reads [m/s^2], in its own frame (at rest: g up), (3,)."""
    torques: np.ndarray | None = None
    """Torques that the motors report [N m] (or [N]), of shape (n,); None if they do not
    report any."""


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    r"""Set-points of all joints for the next period.

    With gains, each joint exerts
    :math:`\tau = \tau_{ff} + k_p (q^* - q) + k_d (\dot q^* - \dot q)`; without, it goes
    to its position by servos of its own.
    """

    positions: np.ndarray
    """Joint positions [rad] (or [m]), of shape (n,), in the order of `joint_names`."""
    velocities: np.ndarray
    """Their rates [rad/s] (or [m/s]), of shape (n,)."""
    torques: np.ndarray | None = None
    """Torques fed forward [N m] (or [N]), of shape (n,)."""
    stiffness: np.ndarray | None = None
    """Position gains k_p [N m/rad] (or [N/m]), of shape (n,)."""
    damping: np.ndarray | None = None
    """Velocity gains k_d [N m s/rad] (or [N s/m]), of shape (n,)."""


class Actuation(StrEnum):
    """What the joints of a robot take."""

    POSITION = "position"
    """Positions, which servos of their own go to."""
    PD = "pd"
    """Torques, and positions and rates with gains about them."""
    TORQUE = "torque"
    """Torques alone."""


class JointServos(NamedTuple):
    """Gains of joints that torques are fed forward to."""

    stiffness: np.ndarray
    """Position gains k_p [N m/rad] (or [N/m]), of shape (n,)."""
    damping: np.ndarray
    """Velocity gains k_d [N m s/rad] (or [N s/m]), of shape (n,)."""


class Plant(Protocol):
    """A robot, real or simulated.

    The loop calls `start` once, then `write` and `read` in turn, and `stop` at the end
    whatever happened. A plant whose joints take torques has an attribute `actuation`,
    which says so.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all joint arrays."""
        ...

    @property
    def period(self) -> float:
        """Control period [s]: the time from one `read` to the next."""
        ...

    def start(self, command: Command) -> Sensors:
        """Make the motors hold the command and return the first reading (time 0)."""
        ...

    def write(self, command: Command) -> None:
        """Set the set-points for the next period."""
        ...

    def read(self) -> Sensors:
        """Wait until the period is over and return the reading."""
        ...

    def stop(self, reason: str) -> None:
        """Bring the robot to a safe state; may be called more than once."""
        ...


def _two(name: str, value: object, unit: str = "m/s") -> np.ndarray:
    """Return one number or two as an array (x, y)."""
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (1,), (2,)) or not np.isfinite(array).all():
        raise ParameterError(
            f"{name} must be one finite number or two (x, y) in {unit}, got {value!r}"
        )
    return np.broadcast_to(array, 2).copy()


def no_disturbance(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return no disturbance: eps = 0.

    Args:
        time: Time [s].

    Returns:
        eps and its rate: zeros, of shape (2,).
    """
    return np.zeros(2), np.zeros(2)


def constant_disturbance(value: float | tuple[float, float]) -> Disturbance:
    """Return a constant disturbance.

    Args:
        value: eps [m/s], for both axes or (x, y).

    Returns:
        The disturbance.

    Raises:
        ParameterError: If the value is not finite.

    Example:
        >>> constant_disturbance(0.05)(1.0)[0].tolist()
        [0.05, 0.05]
    """
    eps = _two("value", value)
    return lambda time: (eps, np.zeros(2))


def sine_disturbance(
    amplitude: float | tuple[float, float], frequency: float
) -> Disturbance:
    r"""Return a sine, :math:`\epsilon = a \sin(2 \pi f t)`.

    Args:
        amplitude: a [m/s], for both axes or (x, y).
        frequency: f [Hz], 0 or above.

    Returns:
        The disturbance.

    Raises:
        ParameterError: If a number is out of range.

    Example:
        >>> sine_disturbance(0.05, 0.5)(0.5)[0].round(6).tolist()
        [0.05, 0.05]
    """
    a = _two("amplitude", amplitude)
    f = checked_number("frequency", frequency, unit="Hz", low=0.0)
    w = 2.0 * math.pi * f
    return lambda time: (a * math.sin(w * time), a * w * math.cos(w * time))


def sampled_disturbance(samples: np.ndarray, dt: float) -> Disturbance:
    """Return a disturbance that is linear between samples and constant outside them.

    With the samples of `largest_errors.worst_case` it is the worst there is.

    Args:
        samples: eps at times 0, dt, 2 dt, ... [m/s], of shape (n,) for both axes or
            (n, 2).
        dt: Time between samples [s], above 0.

    Returns:
        The disturbance; its rate is that to the right of a sample.

    Raises:
        ParameterError: If the samples are not finite or dt is out of range.

    Example:
        >>> eps, eps_dot = sampled_disturbance(np.array([0.0, 0.1]), 2.0)(1.0)
        >>> eps.tolist(), eps_dot.tolist()
        ([0.05, 0.05], [0.05, 0.05])
    """
    h = checked_number("dt", dt, unit="s", low=0.0, open_low=True)
    table = np.asarray(samples, dtype=float)
    if table.ndim == 1:
        table = np.stack([table, table], axis=1)
    if table.shape[1:] != (2,) or len(table) < 1 or not np.isfinite(table).all():
        raise ParameterError(
            f"samples must be finite, of shape (n,) or (n, 2), got {table.shape}"
        )
    slopes = np.diff(table, axis=0) / h

    def disturbance(time: float) -> tuple[np.ndarray, np.ndarray]:
        i = math.floor(time / h + 1e-9)  # a sample time is not just before itself
        if not 0 <= i < len(slopes):
            return table[0 if i < 0 else -1], np.zeros(2)
        return table[i] + slopes[i] * (time - i * h), slopes[i]

    return disturbance


def random_bounded(
    a: float, b: float, seed: int, duration: float = 60.0, knot: float = 0.02
) -> Disturbance:
    """Return a random disturbance with |eps| <= a and a rate of at most b.

    It is linear between knots, rises or falls at the full rate b for random times and
    rests at its bounds: closer to the worst case than noise is.

    Args:
        a: Bound on |eps| [m/s], 0 or above.
        b: Bound on the rate of eps [m/s^2], 0 or above.
        seed: Of the random numbers; x and y differ.
        duration: Time after which eps stays constant [s], above 0.
        knot: Time between knots [s], above 0.

    Returns:
        The disturbance; the same for the same arguments.

    Raises:
        ParameterError: If a number is out of range.
    """
    a = checked_number("a", a, unit="m/s", low=0.0)
    b = checked_number("b", b, unit="m/s^2", low=0.0)
    knot = checked_number("knot", knot, unit="s", low=0.0, open_low=True)
    duration = checked_number("duration", duration, unit="s", low=0.0, open_low=True)
    rng = np.random.default_rng(seed)
    n = math.ceil(duration / knot)
    turns = rng.random((n, 2)) < 0.1
    signs = np.where(np.cumsum(turns, axis=0) % 2, 1.0, -1.0)
    table = np.zeros((n + 1, 2))
    for i in range(n):
        table[i + 1] = np.clip(table[i] + b * knot * signs[i], -a, a)
    return sampled_disturbance(table, knot)


_NODES = (0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


class PendulumPlant:
    """The simplified model of a walking robot, Eq. (30), behind a servo. Final.

    Its two joints are the CoM's x and y. The rates of the command are u, held over the
    period; the positions of the command count at the start only. Its one sole, seen by
    the left sensor, is the whole ground: its sensor is at the world's origin, in world
    axes. The response to u is exact; the integral of the disturbance is Gaussian with
    three nodes a period (exact for one that is linear within each period).

    Example:
        >>> plant = PendulumPlant(Pendulum(), servo_lag=0.02)
        >>> _ = plant.start(Command(np.zeros(2), np.zeros(2)))
        >>> plant.write(Command(np.zeros(2), np.array([0.1, 0.0])))
        >>> sensors = plant.read()
        >>> sensors.velocities.round(6).tolist()
        [0.009516, 0.0]
    """

    joint_names: tuple[str, ...] = ("com_x", "com_y")
    """The CoM's coordinates in the world."""

    def __init__(
        self,
        pendulum: Pendulum,
        *,
        period: float = 0.002,
        servo_lag: float = 0.02,
        disturbance: Disturbance = no_disturbance,
        mass: float = PAPER_MASS,
    ) -> None:
        """Prepare a pendulum that `start` will put to rest.

        Args:
            pendulum: Gives omega_n and g.
            period: Control period [s], above 0.
            servo_lag: Time constant tau of the velocity servo [s], above 0.
            disturbance: eps and its rate over time.
            mass: For the forces [kg], above 0.

        Raises:
            ParameterError: If a number is out of range.
        """
        self.pendulum, self.disturbance = pendulum, disturbance
        self.period = checked_number("period", period, unit="s", low=0, open_low=True)
        name = "servo_lag"
        self.servo_lag = checked_number(name, servo_lag, unit="s", low=0, open_low=True)
        self.mass = checked_number("mass", mass, unit="kg", low=0.0, open_low=True)
        self._ticks = -1

    def start(self, command: Command) -> Sensors:
        """Put the CoM at rest at the command's positions and return the reading.

        Args:
            command: CoM (2,) [m]; its rates are not used.

        Returns:
            The reading at time 0.

        Raises:
            ParameterError: If the command is not two finite numbers each.
        """
        self._c, _ = self._checked(command)
        self._v, self._u = np.zeros(2), np.zeros(2)
        self._ticks = 0
        return self._sense()

    def write(self, command: Command) -> None:
        """Set u for the next period.

        Args:
            command: Its rates are u (2,) [m/s].

        Raises:
            ParameterError: If the command is not two finite numbers each.
            ComwalkError: Before `start` or after `stop`.
        """
        self._require_running("write")
        self._u = self._checked(command)[1]

    def read(self) -> Sensors:
        """Advance by a period and return the reading.

        Returns:
            The reading at the end of the period.

        Raises:
            ComwalkError: Before `start` or after `stop`.
        """
        self._require_running("read")
        dt, t = self.period, self._ticks * self.period
        decay, area = servo_response(self.servo_lag, dt)
        gap = self._v - self._u
        drift = sum(
            w * self.disturbance(t + x * dt)[0]
            for w, x in zip(_WEIGHTS, _NODES, strict=True)
        )
        self._c = self._c + self._u * dt + gap * area + drift * dt
        self._v = self._u + gap * decay
        self._ticks += 1
        return self._sense()

    def stop(self, reason: str) -> None:
        """Stop; a pendulum needs nothing else.

        Args:
            reason: Why; not used.
        """
        self._ticks = -1

    def _sense(self) -> Sensors:
        """Return the reading of now."""
        t = self._ticks * self.period
        eps, eps_dot = self.disturbance(t)
        cddot = (self._u - self._v) / self.servo_lag + eps_dot
        p_x, p_y = zmp_of_motion(self.pendulum, self._c, cddot).tolist()
        f_z = self.mass * self.pendulum.gravity
        wrenches = np.zeros((2, 6))
        wrenches[0, 2:5] = f_z, p_y * f_z, -p_x * f_z
        return Sensors(
            time=t,
            positions=self._c.copy(),
            velocities=self._v + eps,
            wrenches=wrenches,
            orientation=np.array([1.0, 0.0, 0.0, 0.0]),
            gyro=np.zeros(3),
            acceleration=np.array([cddot[0], cddot[1], self.pendulum.gravity]),
        )

    def _checked(self, command: Command) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of the command's arrays; refuse wrong ones."""
        q, dq = (np.array(x, float) for x in (command.positions, command.velocities))
        if q.shape != (2,) or dq.shape != (2,) or not np.isfinite([q, dq]).all():
            raise ParameterError(
                "a command of PendulumPlant must have 2 finite positions [m] and 2 "
                f"finite velocities [m/s], got {q.tolist()} and {dq.tolist()}"
            )
        return q, dq

    def _require_running(self, what: str) -> None:
        """Refuse to go on before the start or after the stop."""
        if self._ticks < 0:
            raise ComwalkError(f"PendulumPlant.{what} needs PendulumPlant.start first")
