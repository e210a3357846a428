r"""Default gait and gains of a robot: the paper's numbers, made to fit.

Two robots whose lengths have the ratio r walk alike if all times have the ratio
:math:`\sqrt r` (dynamic similarity: :math:`\omega_n t` is the same). The length is the
CoM height c_z in the home posture, and the paper's robot, with c_z = 0.687 m, gets the
paper's own numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ..control import PAPER_GAINS, Control, ControlSettings, Gains
from ..errors import ComwalkError, ModelError, ParameterError, PlanError, checked_number
from ..pattern import (
    PAPER_GAIT,
    PAPER_PENDULUM,
    Gait,
    Pattern,
    Pendulum,
    make_pattern,
    plan_steps,
)
from ..robot import Robot, sway_inertia
from ..settings import Given
from .certificate import SoleRoom
from .gain_check import sampled_loop_of, servo_lag_of
from .gain_design import Design, DesignGoal, design, rounded
from .plan_check import Feasibility, feasibility
from .reach import least_width
from .sampled_loop import SampledLoop, highest_cutoff

SIDE_STEP = 0.05
"""Natural shift of the body per step sideways, for the paper's robot [m]."""

TURN_STEP = 0.3
"""Natural turn of the body per step [rad]."""

STEP_EXPONENT = 0.35
"""How steps grow with the speed beyond the natural one [-]: by speed ratio to this
power, while their time falls by the rest; 0 only hastens, 1 only lengthens."""

SWING_EXPONENT = -0.8
"""How the clearance of the foot changes with the speed beyond the natural one [-]."""

MAX_SPEED_RATIO = 4.0
"""Fastest walk that the rule serves, in natural speeds [-]."""

TRANSFER_SHARE = 0.1
"""t_d as a share of T [-]."""


def default_pendulum(robot: Robot) -> Pendulum:
    """Return the simplified model of a robot in its home posture.

    Args:
        robot: The robot.

    Returns:
        Its CoM height above the soles, to 1 mm, the gravity of its model, and how
        much longer its legs make the pendulum; the paper's robot keeps the paper's
        point mass.

    Raises:
        ModelError: If its links resist turning more than any robot's do.
    """
    inertia = sway_inertia(robot)
    if inertia > _MOST_INERTIA:
        m, k = robot.model, int(robot.model.body_inertia.max(axis=1).argmax())
        size, mass = f"{m.body_inertia[k].max():.3g} kg m^2", f"{m.body_mass[k]:.3g} kg"
        fault = f"{robot.name}: {m.body(k).name} has an inertia of {size} and {mass}"
        raise ModelError(
            f"{fault}, too large for a robot of its size; correct the units"
        )
    natural = Pendulum(
        height=round(robot.com_height, 3),
        gravity=robot.gravity,
        inertia=round(inertia, 3),
    )
    return robot.profile.pendulum.over(natural)


def default_gait(
    robot: Robot | None,
    *,
    speed: float | None = None,
    side: float | None = None,
    turn: float | None = None,
    **changes: Any,
) -> Gait:
    r"""Return the gait of a robot, at its natural speed or at a wanted one.

    Naturally a step of the length 2 B = 0.2 r takes the time :math:`T = \sqrt r`. A
    slower walk shortens the step and keeps T. A walk that is q times faster takes
    steps :math:`q^{0.35}` times as long in a time :math:`q^{0.65}` times as short,
    lifts the feet less, and crosses the double support by minimum jerk. The fastest of
    the three speeds counts. If T is given, it stays.

    Args:
        robot: The robot; None for the paper's.
        speed: Forward speed [m/s], negative backward; natural if None and neither
            sideways speed nor turning speed is given.
        side: Sideways speed [m/s], left positive.
        turn: Turning speed [rad/s], left positive.
        changes: Fields of `Gait` that are given.

    Returns:
        The gait; numbers have four digits, t_d is a tenth of T, start and stop last
        :math:`\sqrt r` seconds.

    Raises:
        ParameterError: If a speed is out of the reach of the rule, is given together
            with its step, or a field of the gait is out of range.

    Example:
        >>> gait = default_gait(None, speed=0.8)
        >>> gait.half_step, gait.period
        (0.1624, 0.4061)
    """
    natural = PAPER_GAIT if robot is None else largest_gait(robot)
    wanted = {"half_step": speed, "lateral": side, "turn": turn}
    wanted = {name: v for name, v in wanted.items() if v is not None}
    steps = _steps_at(wanted, natural, changes) if wanted else {}
    given = {**steps, **changes}
    T = checked_number("period", given.get("period", natural.period), unit="s")
    given.setdefault("transfer_time", rounded(TRANSFER_SHARE * T))
    gait = replace(natural, **given)
    if robot is None or not gait.turn or "half_width" in changes:
        return gait
    return _widened(gait, robot.sole_size)


def _widened(gait: Gait, size: tuple[float, float]) -> Gait:
    """Return a gait that turns, with feet so far apart that the soles do not meet."""
    for share in _WIDTHS:
        wider = replace(gait, half_width=rounded(share * gait.half_width))
        try:
            plan_steps(wider, 8, sole_size=size)
        except PlanError:
            continue
        return wider
    return gait


_WIDTHS = np.linspace(1.0, 2.0, 21).tolist()  # of the usual distance of the feet


def default_gains(robot: Robot, *, period: float = 0.002) -> Gains:
    """Return gains designed for a robot and its natural gait.

    Args:
        robot: The robot.
        period: Control period [s].

    Returns:
        Those of `design`; the paper's robot keeps the paper's.

    Raises:
        ParameterError: If the period is out of range, or too long for any gains.
    """
    stated = robot.profile.gains
    if {"zmp", "com"} <= set(stated.values):
        return Gains(**stated.values)
    return stated_gains(stated, _designed(robot, period).gains)


def stated_gains(stated: Given[Gains], own: Gains) -> Gains:
    """Return the gains that somebody stated, over those that suit a robot.

    Args:
        stated: Some or all gains.
        own: The robot's. Standing gains that were designed beside other walking gains
            go with those.

    Returns:
        All gains.
    """
    if {"zmp", "com"} & set(stated.values):
        own = replace(own, standing_zmp=None, standing_com=None)
    return stated.over(own)


def similar_gains(pendulum: Pendulum) -> Gains:
    """Return the paper's gains for another natural frequency.

    Args:
        pendulum: Gives omega_n [rad/s].

    Returns:
        Gains as many times the paper's as omega_n is.
    """
    f = pendulum.omega / PAPER_PENDULUM.omega
    k_p, k_c = PAPER_GAINS.walking
    return Gains(
        zmp=(rounded(f * k_p[0]), rounded(f * k_p[1])),
        com=(rounded(f * k_c[0]), rounded(f * k_c[1])),
    )


@lru_cache(maxsize=32)
def _designed(robot: Robot, period: float) -> Design:
    goal = DesignGoal(step_time=default_gait(robot).period)
    loop = sampled_loop_of(Control(period=period), servo_lag_of(robot))
    return design(default_pendulum(robot), loop, goal)


def default_control_settings(
    robot: Robot,
    gains: Gains | None = None,
    *,
    pendulum: Pendulum | None = None,
    period: float = 0.002,
) -> ControlSettings:
    """Return filter and bounds of the controller for a robot.

    Args:
        robot: The robot.
        gains: The gains to walk with; the robot's defaults if None.
        pendulum: The pendulum to walk with; the robot's default if None.
        period: Control period [s].

    Returns:
        Settings with the ZMP cut-off that designed gains are meant for; with others
        as many times the paper's as omega_n is, but at most half of the highest that
        is stable.
    """
    pendulum = pendulum or default_pendulum(robot)
    usual, own = ControlSettings(), default_gains(robot, period=period)
    gains = gains or own
    stated = robot.profile.control
    usual = stated.over(usual)
    cutoff = (usual.zmp_cutoff or 0.0) * pendulum.omega / PAPER_PENDULUM.omega
    if gains == own and "zmp_cutoff" in stated.values:
        cutoff = usual.zmp_cutoff or math.inf
    elif gains == own and not robot.profile.gains.values:
        cutoff = _designed(robot, period).zmp_cutoff
    delay, lag = usual.delay + 1, servo_lag_of(robot)
    loop = SampledLoop(period=period, servo_lag=lag, delay=delay)
    highest = [
        highest_cutoff(pendulum, k_p, k_c, loop)
        for k_p, k_c in _axes(gains)
        if 0.0 < k_p < k_c
    ]
    stable = [0.5 * f_c for f_c in highest if f_c > 0.0]
    return replace(usual, zmp_cutoff=rounded(min([cutoff, *stable])))


def default_control(robot: Robot, *, period: float = 0.002) -> Control:
    """Return the walking controller of a robot.

    Args:
        robot: The robot.
        period: Control period [s].

    Returns:
        Its default gains, filter and bounds.
    """
    gains = default_gains(robot, period=period)
    settings = default_control_settings(robot, gains, period=period)
    return Control(gains=gains, settings=settings, period=period)


def sole_room(robot: Robot) -> SoleRoom:
    """Return the admissible ZMP error of a robot before a sole tips.

    Args:
        robot: The robot.

    Returns:
        On one foot half of the sole's length and width; on both feet, as far apart as
        in the home posture, half of the width of both.
    """
    (length, width), apart = robot.sole_size, robot.stance_width
    return SoleRoom(
        walking=(0.5 * length, 0.5 * width),
        standing=(0.5 * length, 0.5 * (width + apart)),
    )


def walk_pattern(
    robot: Robot,
    steps: int = 20,
    *,
    speed: float | None = None,
    side: float | None = None,
    turn: float | None = None,
    **changes: Any,
) -> Pattern:
    """Return the pattern of a regular walk of a robot, ready for `simulate`.

    Args:
        robot: The robot.
        steps: Number of steps, in [1, 100000].
        speed: Forward speed [m/s], as in `default_gait`.
        side: Sideways speed [m/s], left positive.
        turn: Turning speed [rad/s], left positive.
        changes: Fields of `Gait` that are given.

    Returns:
        CoM, ZMP and feet over time.

    Raises:
        ParameterError: If a number is out of range.
        PlanError: If the feet would meet or the steps are too long.
    """
    gait = default_gait(robot, speed=speed, side=side, turn=turn, **changes)
    plan = plan_steps(gait, steps, sole_size=robot.sole_size)
    return make_pattern(plan, default_pendulum(robot))


@lru_cache(maxsize=32)
def largest_gait(robot: Robot) -> Gait:
    """Return the fastest gait, up to the similar one, that keeps the limits.

    Steps are made shorter, then quicker, narrower, wider or slower too, down to
    stepping in place.

    Args:
        robot: The robot; what its profile says of the gait stays as it is.

    Returns:
        The gait; the similar one if not even stepping in place fits.
    """
    stated = robot.profile.gait
    gait = stated.over(similar_gait(robot))
    if "half_step" in stated.values:
        return gait
    least = 0.5 * least_width(robot)
    for share, time, width in _TRIALS:
        lower = max(share, _LEAST_SWING)
        shorter = replace(
            gait,
            half_step=rounded(share * gait.half_step),
            swing_height=rounded(lower * gait.swing_height),
        )
        if width != 1.0 and gait.half_width > least:
            apart = rounded(max(width * gait.half_width, least))
            shorter = replace(shorter, half_width=apart)
        if time != 1.0:
            times = {k: rounded(time * getattr(gait, k)) for k in _STEP_TIMES}
            shorter = replace(shorter, **times)
        if _fits(robot, shorter):
            return shorter
    return gait


_TRIALS = (
    *((share, 1.0, 1.0) for share in (1.0, 0.85, 0.7, 0.6, 0.5)),
    *((share, 0.7, 1.0) for share in (0.6, 0.45)),
    *((share, 1.0, 1.0) for share in (0.4, 0.25)),
    *((share, 1.0, width) for width in (0.85, 0.7) for share in (1.0, 0.7, 0.4)),
    *((share, 0.5, width) for share in (0.35, 0.2) for width in (1.0, 1.2)),
    *((0.4, 1.4, 1.0), (0.4, 1.4, 0.8), (0.2, 1.4, 1.0), (0.2, 2.0, 1.0)),
    *((0.0, time, 1.0) for time in (1.0, 0.7, 0.5, 1.4, 2.0)),
    (0.0, 2.0, 0.8),
)
"""Lengths and times of steps, and distances of the feet, that are tried, as shares of
the similar ones [-]."""
_STEP_TIMES = "period", "transfer_time"
_MOST_INERTIA = 2.0  # how much longer turning links may make the pendulum [-]
_LEAST_SWING = 0.5  # share of the similar clearance that is kept at least
_NOT_OF_STEPS = ("self-collision", "stiffness")  # shorter steps do not help
_USE = 0.98  # share of a limit that the natural gait may use


def _fits(robot: Robot, gait: Gait) -> bool:
    """Return whether a few steps keep the limits of joints and legs."""
    try:
        demands = demands_of_gait(robot, gait).demands
    except ComwalkError:
        return False
    return all(d.share <= _USE for d in demands if d.what not in _NOT_OF_STEPS)


@lru_cache(maxsize=32)
def demands_of_gait(robot: Robot, gait: Gait) -> Feasibility:
    """Return what a few steps of a gait ask of a robot.

    Args:
        robot: The robot.
        gait: The gait.

    Returns:
        The demands, of four steps.

    Raises:
        ModelError: If a leg has not six joints, or inertias are not a robot's.
        PlanError: If there are no such steps.
    """
    plan = plan_steps(gait, 4, sole_size=robot.sole_size)
    return feasibility(robot, make_pattern(plan, default_pendulum(robot)))


def similar_gait(robot: Robot) -> Gait:
    """Return the paper's gait, to the scale of a robot.

    Args:
        robot: The robot.

    Returns:
        The gait; nothing is checked.
    """
    r = round(robot.com_height, 3) / PAPER_PENDULUM.height
    times = ("period", "transfer_time", "start_time", "stop_time")
    lengths = ("half_step", "swing_height")
    return replace(
        PAPER_GAIT,
        half_width=rounded(0.5 * max(robot.stance_width, least_width(robot))),
        **{k: rounded(math.sqrt(r) * getattr(PAPER_GAIT, k)) for k in times},
        **{k: rounded(r * getattr(PAPER_GAIT, k)) for k in lengths},
    )


_SPEEDS = {
    "half_step": ("speed", "m/s", 2.0),
    "lateral": ("side", "m/s", 1.0),
    "turn": ("turn", "rad/s", 1.0),
}
"""Name and unit of each speed, and how many fields of the gait make one step."""


def _steps_at(
    wanted: dict[str, float], natural: Gait, changes: dict[str, Any]
) -> dict[str, Any]:
    """Return the fields of a gait that walks at the wanted speeds.

    Args:
        wanted: Speeds [m/s, rad/s], by the field of the gait that each decides.
        natural: The gait at the natural speed.
        changes: Fields that are given.
    """
    r = natural.half_step / PAPER_GAIT.half_step
    usual = {"half_step": natural.half_step, "lateral": SIDE_STEP * r}
    usual["turn"] = TURN_STEP
    speed_ratio = 1.0
    for name, value in wanted.items():
        label, unit, count = _SPEEDS[name]
        if name in changes:
            raise ParameterError(f"give {label} or gait.{name}, not both")
        slowest = count * usual[name] / natural.period
        high = _floored(MAX_SPEED_RATIO * slowest)
        hint = f"that is +-{math.degrees(high):.3g} deg/s" if name == "turn" else ""
        v = checked_number(label, value, unit=unit, low=-high, high=high, hint=hint)
        speed_ratio = max(speed_ratio, abs(v) / slowest)
    T = rounded(natural.period * speed_ratio ** (STEP_EXPONENT - 1.0))
    T = checked_number("period", changes.get("period", T), unit="s")
    steps = {name: rounded(v * T / _SPEEDS[name][2]) for name, v in wanted.items()}
    return {"half_step": 0.0, "period": T, **steps, **_hastened(speed_ratio, natural)}


def _hastened(speed_ratio: float, natural: Gait) -> dict[str, Any]:
    if speed_ratio <= 1.0:
        return {}
    swing = rounded(natural.swing_height * speed_ratio**SWING_EXPONENT)
    return {"swing_height": swing, "double_support": "minjerk"}


def _axes(gains: Gains) -> Iterator[tuple[float, float]]:
    """Yield k_p and k_c [1/s] of both axes, walking and standing."""
    for k_p, k_c in (gains.walking, gains.standing):
        yield from zip(k_p, k_c, strict=True)


def _floored(x: float) -> float:
    scale = 10.0 ** (2 - math.floor(math.log10(x)))
    return math.floor(x * scale + 1e-6) / scale
