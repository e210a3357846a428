"""Fit recorded motions to the limits of a robot's joints, or refuse them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import MotionError, nearest
from .motion import (
    _TOLERANCE,
    EmbeddedMotion,
    JointLimit,
    Motion,
    _blend_rates,
    _entry,
    _rounded_down,
)
from .motion_edits import scaled, select

LEAST_REPAIR = 0.97
"""How much less a joint may move for a clip to fit, without being asked [-]."""


def prepare_motion(
    motion: Motion,
    *,
    allowed: Sequence[str],
    ignored: Sequence[str] = (),
    limits: Mapping[str, JointLimit],
    home: Mapping[str, float],
) -> Motion:
    """Return the part of a motion that a robot plays, checked against the robot.

    Position and speed limits are checked on the spline, between the samples too. A
    joint that passes a position limit by little moves less, which the result's
    `repairs` say: clips are often cut off at the limits, and splines overshoot there.

    Args:
        motion: The motion, from `builtin_motion` or `load_motion`.
        allowed: Names of the joints which may be moved by a motion (upper body).
        ignored: Names of the joints that walking needs (legs). They are dropped from
            a whole-body clip, and listed in the result's `dropped`; any other motion
            must not contain them.
        limits: Limits of every joint of `allowed`; with inf for none.
        home: Home angle of every joint of `allowed` [rad].

    Returns:
        The motion with joints of `allowed` only.

    Raises:
        MotionError: If a joint is unknown or is a leg joint, or the motion exceeds a
            position or speed limit; the message says by how much to scale it.
    """
    playable = _playable(motion, allowed, ignored)
    center, lower, upper, speed = _room(playable, limits, home)
    _check_home(playable, center, lower, upper)
    playable = _repaired(playable, center, lower, upper)
    _check_range(playable, center, lower, upper)
    _check_speed(playable, speed)
    return playable


def fitted(
    embedded: EmbeddedMotion, limits: Mapping[str, JointLimit]
) -> tuple[EmbeddedMotion, tuple[str, ...]]:
    """Return a motion made smaller and slower until a robot can play it.

    A joint that would pass a position limit moves less; if one would be too fast, all
    are slower; if one would be too fast in a blend, all move less.

    Args:
        embedded: The motion, whose home angles are within their limits.
        limits: Limits of its joints.

    Returns:
        The motion within its limits, and what was changed, a phrase each.
    """
    motion = embedded.motion
    home = dict(zip(motion.joints, embedded.home.tolist(), strict=True))
    center, lower, upper, speed = _room(motion, limits, home)
    shares = _position_shares(motion, center, lower, upper)
    motion, notes = _moved_less(motion, center, shares)
    slower = _share_of(speed, np.abs(_rate_extremes(motion)[1]))
    if slower < 1.0:
        notes.append(f"{slower:.3g} times as fast")
        motion = scaled(motion, speed=max(slower, 1e-3))
    _, rates, allowed = _blend_rates(replace(embedded, motion=motion), limits)
    smaller = _share_of(allowed, rates)
    if smaller < 1.0:
        notes.append(f"all joints move {smaller:.3g} times as far")
        motion = scaled(motion, smaller, about=home)
    return replace(embedded, motion=motion), tuple(notes)


def _room(
    motion: Motion, limits: Mapping[str, JointLimit], home: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return home angles, lower, upper and speed limits of a motion's joints."""
    limited = [_entry(motion, limits, "limit", j) for j in motion.joints]
    center = [_entry(motion, home, "home angle", j) for j in motion.joints]
    rows = [(x.lower, x.upper, x.speed) for x in limited]
    lower, upper, speed = np.array(rows, dtype=float).T
    return np.array(center), lower, upper, speed


def _position_shares(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    away = _position_extremes(motion)[1] - home
    room = np.where(away > 0.0, upper - home, home - lower)
    columns = range(len(motion.joints))
    return np.array([_share_of(room[:, j], np.abs(away[:, j])) for j in columns])


def _repaired(
    motion: Motion, center: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> Motion:
    """Return a motion whose joints move less where they pass a limit by little."""
    shares = _position_shares(motion, center, lower, upper)
    if shares.min() < LEAST_REPAIR or (shares == 1.0).all():
        return motion
    smaller, told = _moved_less(motion, center, shares)
    return replace(smaller, repairs=(*motion.repairs, *told))


def _moved_less(
    motion: Motion, center: np.ndarray, shares: np.ndarray
) -> tuple[Motion, list[str]]:
    """Return a motion each of whose joints moves a share as far, and what was done."""
    told = [
        f"{joint} moves {share:.3g} times as far"
        for joint, share in zip(motion.joints, shares.tolist(), strict=True)
        if share < 1.0
    ]
    positions = center + shares * (motion.positions - center)
    return replace(motion, positions=positions), told


def _share_of(allowed: np.ndarray, needed: np.ndarray) -> float:
    over = needed > allowed * (1.0 + _TOLERANCE)
    shares = np.divide(allowed, needed, where=over, out=np.ones(over.shape))
    least = float(shares.min())
    return 1.0 if least >= 1.0 else 0.999 * max(least, 0.0)


def _playable(motion: Motion, allowed: Sequence[str], ignored: Sequence[str]) -> Motion:
    """Return the motion without the legs of a whole-body clip."""
    for joint in motion.joints:
        if joint in allowed or (motion.whole_body and joint in ignored):
            continue
        if joint in ignored:
            raise MotionError(
                f'motion "{motion.name}" moves joint "{joint}", which the walking '
                "moves; remove it from the motion"
            )
        raise MotionError(
            f'motion "{motion.name}" moves joint "{joint}", which this robot does not '
            f"let dance; {nearest(joint, allowed)}"
        )
    return select(motion, [j for j in motion.joints if j in allowed])


def _check_home(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> None:
    """Raise if a home angle is not inside its limits."""
    for joint, q, low, high in zip(motion.joints, home, lower, upper, strict=True):
        name = f'home angle of joint "{joint}"'
        if not low - _TOLERANCE <= q <= high + _TOLERANCE:
            raise MotionError(
                f"{name} must be in [{low:.6g}, {high:.6g}] rad, got {q:.6g} rad; "
                "correct the home posture"
            )


def _check_range(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> None:
    """Raise if the spline leaves the position limits, naming the worst joint."""
    t, q = _position_extremes(motion)
    over = np.maximum(q - upper, lower - q)
    if over.max() <= _TOLERANCE:
        return
    k, j = np.unravel_index(np.argmax(over), over.shape)
    limit = upper[j] if q[k, j] > upper[j] else lower[j]
    raise MotionError(
        f'motion "{motion.name}": joint "{motion.joints[j]}" reaches '
        f"{q[k, j]:.4g} rad at {t[k, j]:.3f} s, its limit is {limit:.4g} rad; "
        f"{_range_advice(q, home, lower, upper)}"
    )


def _range_advice(
    q: np.ndarray, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> str:
    """Return advice on a motion that leaves the position limits."""
    if np.abs(q).max() > 3.0 * math.pi:
        return "angles must be in radians, these look like degrees"
    away = q - home
    room = np.where(away > 0.0, upper - home, home - lower)
    moved = np.abs(away) > _TOLERANCE
    factor = float(np.min(np.divide(room, np.abs(away), where=moved, out=room + 1.0)))
    if factor < 0.01:
        return "the home posture is at this limit, so move the home posture off it"
    return f"make it smaller: scale {_rounded_down(factor)} or less"


def _check_speed(motion: Motion, speed: np.ndarray) -> None:
    """Raise if the spline is faster than a speed limit, naming the worst joint."""
    t, rates = _rate_extremes(motion)
    ratio = np.abs(rates) / speed
    if ratio.max() <= 1.0 + _TOLERANCE:
        return
    k, j = np.unravel_index(np.argmax(ratio), ratio.shape)
    raise MotionError(
        f'motion "{motion.name}" needs {abs(rates[k, j]):.4g} rad/s of joint '
        f'"{motion.joints[j]}" at {t[k, j]:.3f} s, its limit is {speed[j]:.4g} rad/s; '
        f"play it at {_rounded_down(float(1.0 / ratio[k, j]))} times its speed or less"
    )


def _position_extremes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return times and angles among which are all extremes of the spline."""
    a, b, c, _ = np.moveaxis(motion._segments, 1, 0)
    root = np.sqrt(np.maximum(b * b - 3.0 * a * c, 0.0))
    lean = -(b + np.copysign(root, b))
    candidates = [np.zeros_like(a), _ratio(lean, 3.0 * a), _ratio(c, lean)]
    return _sampled(motion, candidates, rates=False)


def _rate_extremes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    a, b, _, _ = np.moveaxis(motion._segments, 1, 0)
    return _sampled(motion, [np.zeros_like(a), _ratio(-b, 3.0 * a)], rates=True)


def _ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    usable = np.abs(below) > 1e-12 * np.abs(above)
    return np.divide(above, below, where=usable, out=np.zeros_like(above))


def _sampled(
    motion: Motion, candidates: list[np.ndarray], *, rates: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of all segments at the candidate local times."""
    a, b, c, d = np.moveaxis(motion._segments, 1, 0)
    length = np.diff(motion.times)[:, None]
    local = [np.clip(s, 0.0, length) for s in (*candidates, length + 0.0 * a)]
    if rates:
        values = [(3.0 * a * s + 2.0 * b) * s + c for s in local]
    else:
        values = [((a * s + b) * s + c) * s + d for s in local]
    begins = motion.times[:-1, None]
    return np.concatenate([begins + s for s in local]), np.concatenate(values)
