"""Summary of a run: its figures, with units in their names."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib import metadata
from typing import Any

import numpy as np

from ..control import End, Outcome
from ..embedding import yaw_of_quaternion
from ..pattern import Pattern, Phase
from ..robot import Kinematics, Robot
from ..sides import Side
from .columns import Log
from .landings import moved_steps


def summarize(
    log: Log,
    pattern: Pattern,
    outcome: Outcome,
    seconds: float,
    robot: Robot | None = None,
) -> dict[str, Any]:
    """Return the figures of a run, with units in their names.

    Args:
        log: The record.
        pattern: What was to be walked.
        outcome: How it ended.
        seconds: Wall-clock time it took [s].
        robot: The robot, for figures of its soles and joints; None for the
            simplified model.

    Returns:
        Numbers and names, ready for JSON. Errors are reference minus actual.
    """
    ticks = 1e6 * log["compute_s"]
    actual = "com_true" if "com_true" in log else "com"
    travelled = log[actual][-1, :2] - log[actual][0, :2]
    position_error = log[actual][-1, :2] - log["com_ref"][-1, :2]
    com_errors = {"measured": _rms_mm(log["com_ref"] - log["com"])}
    if "com_true" in log:
        com_errors["true"] = _rms_mm(log["com_ref"] - log["com_true"])
    zmp_error = log["zmp_ref_filtered"] - log["zmp_filtered"]
    zmp_true = log["zmp_ref"] - log["zmp_true"] if "zmp_true" in log else zmp_error
    zmp_true = zmp_true[np.isfinite(zmp_true).all(axis=1)]
    if np.isnan(log["zmp"]).all():  # not measured
        zmp_error = zmp_true
    figures: dict[str, Any] = {
        "outcome": str(outcome.end),
        "time_s": round(outcome.time, 6),
        "phase": outcome.phase.name.lower(),
        "cause": outcome.cause,
        "steps_planned": pattern.plan.count,
        "steps_completed": min(outcome.step, pattern.plan.count),
        "steps_moved": len(moved_steps(log.columns, pattern.plan)),
        "distance_m": float(np.hypot(*travelled)),
        "position_error_m": float(np.hypot(*position_error)),
        "com_error_rms_mm": com_errors,
        "zmp_error_rms_mm": _rms_mm(zmp_error),
        "zmp_error_true_rms_mm": _rms_mm(zmp_true),
        "zmp_error_max_mm": float(1e3 * np.hypot(*zmp_error.T).max()),
        "command_bounded_pct": 100.0 * float(log["bounded"].mean()),
        "real_time_factor": float(log["t"][-1] / seconds),
        "tick_us_p50": float(np.percentile(ticks, 50)),
        "tick_us_p99": float(np.percentile(ticks, 99)),
    }
    if not pattern.plan.steps:
        figures |= dance_figures(log)
    return figures if robot is None else figures | _robot_figures(log, robot)


def judged(outcome: Outcome, log: Log, pattern: Pattern, robot: Robot) -> Outcome:
    """Return the outcome of a walk by where it ended, and on what.

    Args:
        outcome: How the loop ended.
        log: The record, with what is true.
        pattern: What was to be walked.
        robot: The robot.

    Returns:
        `End.ASTRAY` in place of a completed walk that ended farther from its plan than
        a sole is long, or turned by more than 0.3 rad, or whose centre of pressure was
        outside the sole, by more than a twentieth of its width, for more than a
        twentieth of the time: it walks on something else. Any other outcome is as it
        was.
    """
    if not outcome.ok or not pattern.plan.steps:
        return outcome
    away = math.dist(log["com_true"][-1, :2], log["com_ref"][-1, :2])
    turn = _turn_error(log)
    cause = ""
    if away > robot.sole_size[0] or abs(turn) > _MOST_TURN:
        degrees = math.degrees(abs(turn))
        cause = f"it ended {away:.2f} m and {degrees:.0f} deg beside its plan"
    margins = sole_margins(log, robot)
    most = _OUTSIDE * robot.sole_size[1]
    if len(margins) and (least := float(np.percentile(margins, 5))) < -most:
        outside = f"{-1e3 * least:.0f} mm or more outside the sole"
        cause = f"the centre of pressure was {outside} in 5 % of the time"
    return replace(outcome, end=End.ASTRAY, cause=cause) if cause else outcome


_OUTSIDE = 0.05  # of a sole's width; a foot that rolls over its edge feels as much
_MOST_TURN = 0.3  # between plan and robot at the end [rad]


def _turn_error(log: Log) -> float:
    """Return by how much the base is turned against its reference at the end [rad]."""
    turn = yaw_of_quaternion(log["qpos"][-1, 3:7]) - log["heading_ref"][-1]
    return math.remainder(turn, math.tau)


def outcome_text(summary: Mapping[str, Any]) -> str:
    """Return the outcome of a run as text, as `Outcome` has it.

    Args:
        summary: The summary of the run.

    Returns:
        One line, such as "completed in 8.20 s".
    """
    return str(
        Outcome(
            End(summary["outcome"]),
            summary["time_s"],
            Phase[summary["phase"].upper()],
            summary["steps_completed"],
            summary["cause"],
        )
    )


def dance_figures(log: Log) -> dict[str, Any]:
    """Return the largest offsets of CoM and ZMP in a dance, as in Fig. 6.

    Args:
        log: The record of a run whose feet stay where they are.

    Returns:
        Largest distances [mm] in x and y from where the CoM is to stay: of the
        measured ZMP, and of the commanded, measured and true CoM.
    """
    place = log["com_ref"][:, :2]
    names = {"commanded": "com_command", "measured": "com", "true": "com_true"}
    unfelt = np.isnan(log["zmp"]).all()
    return {
        "zmp_deviation_max_mm": _largest_mm(
            log["zmp_true" if unfelt else "zmp"] - place
        ),
        "com_deviation_max_mm": {
            name: _largest_mm(log[column][:, :2] - place)
            for name, column in names.items()
            if column in log
        },
    }


def _robot_figures(log: Log, robot: Robot) -> dict[str, Any]:
    """Return the figures that only a robot with soles and joints has."""
    margins = 1e3 * sole_margins(log, robot)
    margins = margins if len(margins) else np.array([np.nan])
    speed = np.abs(log["qvel"][:, 6 : robot.model.nv]) / robot.speed
    torque = np.abs(log["torques_true"]) / robot.torque
    saturated = (torque >= 0.999).any(axis=1)
    return {
        "heading_error_deg": math.degrees(_turn_error(log)),
        "sole_margin_min_mm": _finite(margins.min()),
        "sole_margin_p5_mm": _finite(np.percentile(margins, 5)),
        "trunk_tilt_max_deg": float(np.degrees(log["tilt"].max())),
        "torque_saturation_pct": 100.0 * float(saturated.mean()),
        "joint_limits_met_pct": 100.0 * float((log["limited"] > 0).mean()),
        "near_singular_pct": 100.0 * float((log["damped"] > 0).mean()),
        "resolution_loss_max": float(log["loss"].max()),
        **_largest_use("joint_speed", speed, robot),
        **_largest_use("torque", torque, robot),
    }


def _largest_use(name: str, shares: np.ndarray, robot: Robot) -> dict[str, Any]:
    """Return the largest share of a limit [%] and its joint; shares of (rows, n)."""
    largest = shares.max(axis=0)
    j = int(np.argmax(largest))
    return {
        f"{name}_max_pct": float(100.0 * largest[j]),
        f"{name}_max_joint": robot.joints[j],
    }


def sole_margins(log: Log, robot: Robot) -> np.ndarray:
    """Return the margins of the centre of pressure in the stance sole.

    It is the one that the stance foot's own ankle sensor feels, without noise and
    delay, in single support, while that foot alone bears the robot: until the other
    foot has let go, and from when it lands, the robot stands on both.

    Args:
        log: The record.
        robot: Uses its soles and sensors.

    Returns:
        Distances to the sole's edge [m], positive inside, one per tick.
    """
    margins = []
    for k, (side, phase) in enumerate(
        ((Side.LEFT, Phase.SINGLE_LEFT), (Side.RIGHT, Phase.SINGLE_RIGHT))
    ):
        foot = robot.feet[side]
        rows, weight = log["phase"] == phase, robot.mass * robot.gravity
        wrenches = log["wrenches_true"][rows, k]
        points = _sole_pressure(robot, side, wrenches)
        alone = log["loads_true"][rows, 1 - k] < _UNLOADED * weight
        alone &= wrenches[:, 2] > _LOADED * weight
        margins.append(_margins(foot.sole, points[alone]))
    return np.concatenate(margins)


_LOADED = 0.2  # share of the weight above which a foot has a centre of pressure
_UNLOADED = 0.005  # share of the weight under which a foot does not bear the robot


def _sole_pressure(robot: Robot, side: Side, wrenches: np.ndarray) -> np.ndarray:
    """Return centres of pressure in the frame of a sole's centre, of shape (n, 2)."""
    kinematics, foot = Kinematics(robot), robot.feet[side]
    kinematics.update(robot.home)
    (sole, sensor), (R_sole, R_sensor) = kinematics.sites(
        np.array([foot.site, foot.sensor_site])
    )
    arm, R = (sensor - sole) @ R_sole, R_sole.T @ R_sensor
    f, m = wrenches[:, :3] @ R.T, wrenches[:, 3:] @ R.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x = arm[0] - (m[:, 1] + arm[2] * f[:, 0]) / f[:, 2]
        y = arm[1] + (m[:, 0] - arm[2] * f[:, 1]) / f[:, 2]
    return np.stack([x, y], axis=1)


def _margins(sole: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return signed distances of points to a convex polygon's edges, inside > 0."""
    edges = np.roll(sole, -1, axis=0) - sole
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    offsets = points[:, None, :] - sole[None]
    return np.einsum("nkd,kd->nk", offsets, inward).min(axis=1)


def _largest_mm(error: np.ndarray) -> dict[str, float]:
    """Return the largest magnitudes of x and y [mm]."""
    x, y = (1e3 * np.abs(error).max(axis=0)).tolist()
    return {"x": x, "y": y}


def _rms_mm(error: np.ndarray) -> dict[str, float]:
    """Return the rms of x and y [mm], 0 without any error."""
    if not len(error):
        return {"x": 0.0, "y": 0.0}
    x, y = (1e3 * np.sqrt(np.mean(error[:, :2] ** 2, axis=0))).tolist()
    return {"x": x, "y": y}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def versions() -> dict[str, str]:
    """Return the versions that a run depends on."""
    names = ("comwalk", "mujoco", "numpy", "scipy")
    return {n: metadata.version(n) for n in names} | {
        "python": platform.python_version()
    }
