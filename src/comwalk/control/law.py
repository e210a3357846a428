"""The walking controller of Fig. 4, Eq. (31), as it runs on a robot.

The law itself is `walking_control`, one line. `WalkingController` adds what the paper
leaves to the reader: gains in the frame of the walking direction, a low-pass filter on
the measured ZMP with the *identical* filter and delay on the reference, separate gains
for standing, and bounds.

Note:
    Fed with the raw ZMP the law is unstable at any control rate unless the servo lag
    exceeds k_p / omega^2 (0.21 s with the paper's x gains), for the ZMP contains the
    acceleration that u itself causes. Hence the filter; `check_gains` tells whether
    gains, filter, delay and servo go together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np

from ..compiled import Record, kernel, records
from ..errors import ParameterError, checked_number
from ..pattern import REFERENCE
from ..settings import check_settings, setting
from .filters import low_pass_coefficient
from .gains import PAPER_GAINS, Gains, Pair

Value: TypeAlias = Any
"""A float, or an array of them (np.ndarray) that the formula is applied to at once."""


@kernel
def walking_control(
    com_velocity: Value, e_p: Value, e_c: Value, k_p: Value, k_c: Value
) -> Value:
    r"""Return the walking control input, Eq. (31).

    .. math:: u = \dot c^d - k_p e_p + k_c e_c

    Args:
        com_velocity: Reference CoM velocity [m/s].
        e_p: ZMP error, desired minus actual [m].
        e_c: CoM error, desired minus actual [m].
        k_p: ZMP gain [1/s].
        k_c: CoM gain [1/s].

    Returns:
        CoM velocity u [m/s], of the shape of the arguments.

    Note:
        The ZMP enters with a minus: a ZMP ahead of its reference pushes the CoM
        forward, which brings the ZMP back.

    Example:
        >>> round(walking_control(0.2, 0.01, 0.02, 3.0, 6.6), 6)
        0.302
    """
    cdot_d = com_velocity
    return cdot_d - k_p * e_p + k_c * e_c


@kernel
def heading_correction(
    heading: float, e_p: Pair, e_c: Pair, k_p: Pair, k_c: Pair
) -> Pair:
    """Return the feedback part of Eq. (31) with gains along the heading.

    The errors are turned into the frame of the heading, the law is applied to each of
    its axes, and the result is turned back.

    Args:
        heading: Yaw of the heading [rad], world.
        e_p: ZMP error (x, y) [m], world.
        e_c: CoM error (x, y) [m], world.
        k_p: ZMP gains (forward, left) [1/s].
        k_c: CoM gains (forward, left) [1/s].

    Returns:
        u minus the reference CoM velocity (x, y) [m/s], world.

    Example:
        >>> e_p, e_c = (0.0, 0.01), (0.01, 0.0)
        >>> w = heading_correction(0.0, e_p, e_c, *PAPER_GAINS.walking)
        >>> [round(x, 6) for x in w]
        [0.066, -0.018]
    """
    c, s = math.cos(heading), math.sin(heading)
    p_x, p_y = c * e_p[0] + s * e_p[1], c * e_p[1] - s * e_p[0]
    c_x, c_y = c * e_c[0] + s * e_c[1], c * e_c[1] - s * e_c[0]
    w_x = walking_control(0.0, p_x, c_x, k_p[0], k_c[0])
    w_y = walking_control(0.0, p_y, c_y, k_p[1], k_c[1])
    return c * w_x - s * w_y, s * w_x + c * w_y


@dataclass(frozen=True, kw_only=True)
class ControlSettings:
    """Filter, delay and bounds of the walking controller.

    Raises:
        ParameterError: If a number is out of range.
    """

    zmp_cutoff: float | None = setting(
        4.0, "Cut-off of the ZMP low-pass filter; None for no filter", "Hz", "(0, inf]"
    )

    delay: int = setting(
        0,
        "Delay of the measurements, which the reference is matched to",
        "ticks",
        "[0, 1000]",
    )

    max_correction: float = setting(
        0.5,
        "Bound on the length of u minus the reference CoM velocity",
        "m/s",
        "(0, inf)",
    )

    max_offset: float = setting(
        0.10,
        "Bound on the distance of the CoM command from the reference CoM",
        "m",
        "(0, inf)",
    )

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        check_settings(self)


class ControlReference(Protocol):
    """The part of a `Reference` that the controller uses: x and y of each array."""

    @property
    def com(self) -> np.ndarray:
        """Reference CoM [m], world, of shape (2,) or (3,)."""
        ...

    @property
    def com_velocity(self) -> np.ndarray:
        """Its velocity [m/s], world, of shape (2,) or (3,)."""
        ...

    @property
    def zmp(self) -> np.ndarray:
        """Reference ZMP [m], world, of shape (2,)."""
        ...

    @property
    def heading(self) -> float:
        """Yaw of the walking direction [rad], world."""
        ...

    @property
    def walking(self) -> float:
        """How much of walking [1], 0 standing to 1 walking."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ControlOutput:
    """Output of the walking controller at one tick, world."""

    u: np.ndarray
    """CoM velocity from now to the next tick, Eq. (31), bounded [m/s], (2,)."""
    com_command: np.ndarray
    """Where the CoM should be now: the integral of u up to this tick [m], (2,)."""
    com_error: np.ndarray
    """e_c, the reference matched in delay minus the measured CoM [m], (2,)."""
    zmp_error: np.ndarray
    """e_p = zmp_reference - zmp_filtered [m], (2,)."""
    zmp_reference: np.ndarray
    """Reference ZMP after the delay and filter that the measured one has [m], (2,)."""
    zmp_filtered: np.ndarray
    """Measured ZMP after the filter [m], (2,)."""
    saturated: bool
    """Whether a bound of `ControlSettings` was active."""

    @classmethod
    def still(cls, reference: ControlReference) -> ControlOutput:
        """Return the output of a controller at rest on its reference.

        Args:
            reference: Uses com and zmp.

        Returns:
            No velocity, no errors, the CoM command on the reference.
        """
        zmp = np.array(reference.zmp[:2], dtype=float)
        com = np.array(reference.com[:2], dtype=float)
        rest = np.zeros(2)
        return cls(rest, com, rest, rest, zmp, zmp, False)


class Controller(Protocol):
    """A CoM controller in the loop of Fig. 4."""

    def reset(
        self,
        reference_com: np.ndarray | Sequence[float],
        reference_zmp: np.ndarray | Sequence[float],
    ) -> None:
        """Be at rest on the reference."""
        ...

    def step(
        self,
        reference: Any,
        com: np.ndarray,
        zmp: np.ndarray,
        feedback_scale: float = 1.0,
    ) -> ControlOutput:
        """Return the command of one tick."""
        ...


@kernel
def _limited(x: float, y: float, limit: float) -> tuple[float, float, bool]:
    length = math.hypot(x, y)
    if length <= limit:
        return x, y, False
    return x * limit / length, y * limit / length, True


LAW = np.dtype(
    [
        ("period", "f8"),  # [s]
        ("walking", "f8", (2, 2)),  # k_p and k_c, forward and left [1/s]
        ("standing", "f8", (2, 2)),
        ("alpha", "f8"),  # coefficient of the ZMP filter [-]
        ("max_correction", "f8"),  # [m/s]
        ("max_offset", "f8"),  # [m]
        ("integrates", "i8"),  # whether a position is made of u
    ],
    align=True,
)
"""Gains and settings of the law, for kernels."""

LAW_STATE = np.dtype(
    [
        ("past", "i8"),  # place of the newest in the ring of references
        ("zmp_filtered", "f8", 2),  # [m]
        ("zmp_reference", "f8", 2),  # matched in delay and filter [m]
        ("offset", "f8", 2),  # CoM command minus reference [m]
        ("u", "f8", 2),  # [m/s]
        ("com_command", "f8", 2),  # [m]
        ("e_c", "f8", 2),  # [m]
        ("bounded", "i8"),
    ],
    align=True,
)
"""What the law remembers from tick to tick, and its last output."""


@kernel
def _correction(
    law: Record, state: Record, heading: float, walking: float
) -> tuple[float, float]:
    """Return u minus the reference CoM velocity, with gains blended for standing."""
    e_p = (
        state.zmp_reference[0] - state.zmp_filtered[0],
        state.zmp_reference[1] - state.zmp_filtered[1],
    )
    s = min(max(walking, 0.0), 1.0)
    a, b = law.standing, law.walking
    k_p = a[0, 0] + s * (b[0, 0] - a[0, 0]), a[0, 1] + s * (b[0, 1] - a[0, 1])
    k_c = a[1, 0] + s * (b[1, 0] - a[1, 0]), a[1, 1] + s * (b[1, 1] - a[1, 1])
    return heading_correction(heading, e_p, (state.e_c[0], state.e_c[1]), k_p, k_c)


@kernel
def apply_law(
    law: Record,
    state: Record,
    past: np.ndarray,
    reference: Record,
    com: np.ndarray,
    zmp: np.ndarray,
    feedback_scale: float,
) -> None:
    """Find u by Eq. (31), bounded, and the CoM command, its integral.

    The ZMP passes a low-pass filter, and its reference the identical one, so that an
    error without noise stays zero. Bounds keep what is integrated in step with u.

    Args:
        law: A record of `LAW`.
        state: A record of `LAW_STATE`, where the output goes.
        past: Reference CoM and ZMP [m] of the last delay + 1 ticks: a ring, (n, 4).
        reference: A record of `REFERENCE`.
        com: Measured CoM [m], world.
        zmp: Measured ZMP [m], world.
        feedback_scale: Factor on the feedback [-], in [0, 1].
    """
    state.past = (state.past + 1) % len(past)
    newest, oldest = past[state.past], past[(state.past + 1) % len(past)]
    dt, a = law.period, law.alpha
    for i in range(2):
        newest[i], newest[2 + i] = reference.com[i], reference.zmp[i]
    for i in range(2):
        state.zmp_reference[i] += a * (oldest[2 + i] - state.zmp_reference[i])
        state.zmp_filtered[i] += a * (zmp[i] - state.zmp_filtered[i])
        state.e_c[i] = oldest[i] - com[i]
        state.com_command[i] = newest[i] + state.offset[i]
    x, y = _correction(law, state, reference.heading, reference.walking)
    x, y, fast = _limited(feedback_scale * x, feedback_scale * y, law.max_correction)
    o_x, o_y, far = state.offset[0], state.offset[1], False
    if law.integrates:
        p_x, p_y, far = _limited(o_x + x * dt, o_y + y * dt, law.max_offset)
        state.offset[0], state.offset[1] = p_x, p_y
    if far:
        x, y = (p_x - o_x) / dt, (p_y - o_y) / dt
    state.u[0] = reference.com_velocity[0] + x
    state.u[1] = reference.com_velocity[1] + y
    state.bounded = fast or far


def _xy(name: str, value: np.ndarray | Sequence[float]) -> Pair:
    """Return x and y as floats; refuse numbers that are not finite."""
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


class WalkingController:
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
        self.settings = settings or ControlSettings()
        self.period = checked_number("period", period, unit="s", low=0, open_low=True)
        self.law, self.state = records(LAW), records(LAW_STATE)
        """Its records, which a whole body's tick shares."""
        self.past = np.zeros((int(self.settings.delay) + 1, 4))
        """Reference CoM and ZMP of the last delay + 1 ticks [m]."""
        self._reference = records(REFERENCE)
        law = self.law[0]
        law["period"] = self.period
        law["alpha"] = low_pass_coefficient(self.settings.zmp_cutoff, self.period)
        law["max_correction"] = self.settings.max_correction
        law["max_offset"] = self.settings.max_offset
        law["integrates"] = True
        self.gains = gains
        self.reset((0.0, 0.0), (0.0, 0.0))

    @property
    def gains(self) -> Gains:
        """Gains of Eq. (31); new ones count from the next tick on."""
        return self._gains

    @gains.setter
    def gains(self, gains: Gains) -> None:
        """Take over new gains."""
        self._gains = gains
        self.law["walking"], self.law["standing"] = gains.walking, gains.standing

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
        self.past[:] = *c_d, *p_d
        self.state[:] = 0
        self.state["zmp_filtered"] = self.state["zmp_reference"] = p_d

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
        c, p = np.array(_xy("com", com)), np.array(_xy("zmp", zmp))
        now = self._reference[0]
        for name in ("com", "com_velocity", "zmp"):
            now[name][:2] = getattr(reference, name)[:2]
        now["heading"], now["walking"] = reference.heading, reference.walking
        apply_law(
            self.law[0], self.state[0], self.past, now, c, p, float(feedback_scale)
        )
        return self.output()

    def output(self) -> ControlOutput:
        """Return the output of the last tick."""
        s = self.state[0]
        p_d, p = s["zmp_reference"].copy(), s["zmp_filtered"].copy()
        u, c, e_c = s["u"].copy(), s["com_command"].copy(), s["e_c"].copy()
        return ControlOutput(u, c, e_c, p_d - p, p_d, p, bool(s["bounded"]))
