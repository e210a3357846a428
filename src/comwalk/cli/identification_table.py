"""What was identified, as plain numbers and as a file that other commands read."""

from __future__ import annotations

import math
from typing import Any

from ..certificates import SampledLoop
from ..certificates.identification import (
    Estimate,
    Identified,
    ResponseFit,
    equivalent_loop,
    measured_margin,
)
from ..control import Control
from ..pattern import Pendulum


def facts_of(
    found: Identified, robot: str, pendulum: Pendulum, control: Control
) -> dict[str, Any]:
    """Return what was identified as plain numbers, units in their names.

    Args:
        found: What was identified.
        robot: Name of the robot.
        pendulum: The simplified model.
        control: The walking controller, whose delay margins are told.

    Returns:
        Numbers and names, ready for JSON.
    """
    noise, dead = found.noise, found.dead_time
    cutoff = control.settings.zmp_cutoff
    loops = [equivalent_loop(fit, pendulum, cutoff) for fit in found.axes]
    return {
        "robot": robot,
        "period_ms": 1e3 * found.period,
        "duration_s": found.duration,
        "dead_time_ms": _estimate(dead, 1e3),
        "delay_ticks": found.delay,
        "axes": {
            axis: _axis(fit, k, control) | {"loop": _loop(loop)}
            for k, (axis, fit, loop) in enumerate(
                zip("xy", found.axes, loops, strict=True)
            )
        },
        "noise": {
            "encoders_rad": noise.encoders,
            "force_N": noise.force,
            "torque_Nm": noise.torque,
            "tilt_rad": noise.tilt,
            "com_mm": {"x": 1e3 * noise.com[0], "y": 1e3 * noise.com[1]},
            "zmp_mm": {"x": 1e3 * noise.zmp[0], "y": 1e3 * noise.zmp[1]},
        },
    }


def _estimate(x: Estimate | None, scale: float = 1.0) -> dict[str, float] | None:
    """Return a number and its deviation."""
    if x is None:
        return None
    return {"value": scale * x.value, "deviation": scale * x.deviation}


def _axis(fit: ResponseFit, k: int, control: Control) -> dict[str, Any]:
    """Return what was found of one axis."""
    cutoff = control.settings.zmp_cutoff
    pairs = {"walking": control.gains.walking, "standing": control.gains.standing}
    more = {}
    for name, (k_p, k_c) in pairs.items():
        delay = measured_margin(fit, k_p[k], k_c[k], cutoff).delay
        more[name] = 1e3 * delay if math.isfinite(delay) else None
    return {
        "lag_ms": _estimate(fit.lag, 1e3),
        "gain": _estimate(fit.gain),
        "mode_Hz": _estimate(fit.frequency),
        "mode_damping": _estimate(fit.damping),
        "omega_rad_s": _estimate(fit.omega),
        "misfit": fit.misfit,
        "more_delay_ms": more,
    }


def _loop(loop: SampledLoop) -> dict[str, Any]:
    """Return the fields of a loop that were identified."""
    names = ["period", "delay", "servo_lag", "dead_time"]
    if loop.mode_frequency is not None:
        names += ["mode_frequency", "mode_damping"]
    return {name: getattr(loop, name) for name in names}


def loop_table(robot: str, facts: dict[str, Any]) -> str:
    """Return loop.toml, the loop of the axis that bears less delay.

    Args:
        robot: The robot as the user named it.
        facts: What `facts_of` returned.

    Returns:
        TOML.
    """
    axes = facts["axes"]

    def borne(axis: str) -> float:
        delay = axes[axis]["more_delay_ms"]["walking"]
        return math.inf if delay is None else delay

    axis = min("xy", key=borne)
    lines = [
        f"# what comwalk identify measured of {facts['robot']}, in {axis}",
        f'robot = "{robot}"',
        "",
        "[loop]",
    ]
    lines += [f"{name} = {value:.6g}" for name, value in axes[axis]["loop"].items()]
    return "\n".join(lines) + "\n"
