"""The figures of a run: what a log amounts to."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .footsteps import Side
from .log import Log
from .pattern import Pattern, Phase
from .robot import Robot
from .walk import Outcome


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
    missed = log[actual][-1, :2] - log["com_ref"][-1, :2]
    com_errors = {"measured": _rms_mm(log["com_ref"] - log["com"])}
    if "com_true" in log:
        com_errors["true"] = _rms_mm(log["com_ref"] - log["com_true"])
    zmp_error = log["zmp_ref_filtered"] - log["zmp_filtered"]
    figures: dict[str, Any] = {
        "outcome": str(outcome.end),
        "time_s": round(outcome.time, 6),
        "phase": outcome.phase.name.lower(),
        "cause": outcome.cause,
        "steps_planned": pattern.plan.count,
        "steps_completed": min(outcome.step, pattern.plan.count),
        "distance_m": float(np.hypot(*travelled)),
        "position_error_m": float(np.hypot(*missed)),
        "com_error_rms_mm": com_errors,
        "zmp_error_rms_mm": _rms_mm(zmp_error),
        "zmp_error_max_mm": float(1e3 * np.hypot(*zmp_error.T).max()),
        "real_time_factor": float(log["t"][-1] / seconds),
        "tick_us_p50": float(np.percentile(ticks, 50)),
        "tick_us_p99": float(np.percentile(ticks, 99)),
    }
    return figures if robot is None else figures | _robot_figures(log, robot)


def _robot_figures(log: Log, robot: Robot) -> dict[str, Any]:
    """Return the figures that only a robot with soles and joints has."""
    margins = 1e3 * sole_margins(log, robot)
    margins = margins if len(margins) else np.array([np.nan])
    turn = _yaw_of_quat(log["qpos"][-1, 3:7]) - log["heading_ref"][-1]
    speed = np.abs(log["qvel"][:, 6:]) / robot.speed
    fastest = int(np.argmax(speed.max(axis=0)))
    return {
        "heading_error_deg": math.degrees(math.remainder(turn, math.tau)),
        "sole_margin_min_mm": _finite(margins.min()),
        "sole_margin_p5_mm": _finite(np.percentile(margins, 5)),
        "trunk_tilt_max_deg": float(np.degrees(log["tilt"].max())),
        "torque_saturation_pct": float(100.0 * log["saturated"].mean()),
        "joint_speed_max_pct": float(100.0 * speed.max()),
        "joint_speed_max_joint": robot.joints[fastest],
    }


def sole_margins(log: Log, robot: Robot) -> np.ndarray:
    """Return how far inside the stance sole the centre of pressure stays.

    It is the one that the stance foot's own ankle sensor feels, in single support,
    while the foot bears weight.

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
        wrenches = log["wrenches"][log["phase"] == phase, k]
        points = _sole_pressure(robot, side, wrenches)
        loaded = wrenches[:, 2] > foot.mass * robot.gravity
        margins.append(_margins(foot.sole, points[loaded]))
    return np.concatenate(margins)


def _sole_pressure(robot: Robot, side: Side, wrenches: np.ndarray) -> np.ndarray:
    """Return centres of pressure in the frame of a sole's centre, of shape (n, 2)."""
    model, foot = robot.model, robot.feet[side]
    arm = model.site_pos[foot.sensor_site] - model.site_pos[foot.site]
    f, m = wrenches[:, :3], wrenches[:, 3:]
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


def _rms_mm(error: np.ndarray) -> dict[str, float]:
    """Return the rms of x and y [mm]."""
    x, y = (1e3 * np.sqrt(np.mean(error[:, :2] ** 2, axis=0))).tolist()
    return {"x": x, "y": y}


def _yaw_of_quat(quaternion: np.ndarray) -> float:
    """Return the yaw of a quaternion wxyz."""
    w, x, y, z = quaternion.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _finite(value: float) -> float | None:
    """Return a number, or None for what JSON cannot say."""
    return float(value) if math.isfinite(value) else None
