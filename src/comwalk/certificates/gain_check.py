"""Refusal of gains that cannot balance a robot, before anything moves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..control import Actuation, BodySettings, Control, Gains
from ..errors import ParameterError
from ..pattern import Pendulum
from .sampled_loop import SampledLoop, highest_cutoff, spectral_radius

if TYPE_CHECKING:
    from ..robot import Robot


def check_gains(gains: Gains, pendulum: Pendulum, loop: SampledLoop) -> None:
    """Refuse gains that cannot hold a robot, for walking and for standing.

    Open loop (both gains of an axis zero) is allowed. So is feedback of the CoM alone
    (k_p = 0 < k_c): the linear loop is stable, but nothing then reacts to the ZMP, and
    compliant robots tend to fall. All else needs 0 < k_p < k_c and a stable sampled
    loop.

    Args:
        gains: The gains.
        pendulum: Gives omega_n [rad/s].
        loop: Period, servo lag, ZMP filter and delay to check with.

    Raises:
        ParameterError: If an axis is unstable; says why and what to change.
    """
    for prefix, pairs in (("", gains.walking), ("standing_", gains.standing)):
        for axis, k_p, k_c in zip("xy", *pairs, strict=True):
            if k_p > 0.0 or k_c > 0.0:
                _check_axis(prefix, axis, k_p, k_c, pendulum, loop)


def _check_axis(
    prefix: str,
    axis: str,
    k_p: float,
    k_c: float,
    pendulum: Pendulum,
    loop: SampledLoop,
) -> None:
    """Refuse the gains of one axis if the ideal or the sampled loop is unstable."""
    zmp, com = f"gains.{prefix}zmp", f"gains.{prefix}com"
    if not k_p < k_c:
        raise ParameterError(
            f"{zmp} (k_p) = {k_p:g} must be below {com} (k_c) = {k_c:g} in {axis}: the "
            f"loop is stable only for 0 < k_p < k_c; lower {zmp} or raise {com}"
        )
    radius = spectral_radius(pendulum, k_p, k_c, loop)
    if radius < 1.0:
        return
    highest = highest_cutoff(pendulum, k_p, k_c, loop)
    given = math.inf if loop.zmp_cutoff is None else loop.zmp_cutoff
    remedy = f"lower {zmp}, {com}, the delay or the period"
    if 0.0 < highest < given:
        remedy = (
            f"set zmp_cutoff to {0.5 * highest:.2g} Hz (stable below {highest:.3g})"
        )
    more = f" and {1e3 * loop.dead_time:g} ms" if loop.dead_time else ""
    if loop.mode_frequency is not None:
        more += f", a ZMP that swings at {loop.mode_frequency:g} Hz"
    raise ParameterError(
        f"{zmp} = {k_p:g} and {com} = {k_c:g} 1/s are unstable in {axis} at a period "
        f"of {1e3 * loop.period:g} ms, servo lag {1e3 * loop.servo_lag:g} ms, delay "
        f"{loop.delay} ticks{more}, zmp_cutoff {given:g} Hz: errors grow {radius:.4g} "
        f"times a tick; {remedy}"
    )


def servo_lag_of(robot: Robot | None, body: BodySettings | None = None) -> float:
    """Return the time constant between u and the CoM's velocity [s].

    Args:
        robot: The robot; None for the simplified model.
        body: How it follows its commands; as by default if None.

    Returns:
        Of a robot that takes torques 1 / k_v, the lag of its CoM velocity servo.
    """
    if robot is None or robot.actuation is Actuation.POSITION:
        return 0.02
    servo = max((body or BodySettings()).com_servo, 1e-3)
    return 1.0 / (robot.omega * servo)


def sampled_loop_of(control: Control, servo_lag: float = 0.02) -> SampledLoop:
    """Return the loop that a controller closes on a robot.

    Args:
        control: Its period and filter are used.
        servo_lag: Time constant between u and the CoM's velocity [s].

    Returns:
        The loop; measurements are one tick older than what the reference is matched
        to.
    """
    return SampledLoop(
        period=control.period,
        servo_lag=servo_lag,
        zmp_cutoff=control.settings.zmp_cutoff,
        delay=control.settings.delay + 1,
    )


def check_control(
    control: Control, pendulum: Pendulum, servo_lag: float = 0.02
) -> None:
    """Refuse a controller whose gains are unstable.

    Args:
        control: The controller.
        pendulum: The model that it balances.
        servo_lag: Time constant between u and the CoM's velocity [s].

    Raises:
        ParameterError: If the ideal or the sampled loop is unstable.
    """
    check_gains(control.gains, pendulum, sampled_loop_of(control, servo_lag))
