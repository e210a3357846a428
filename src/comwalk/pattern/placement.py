"""Refusal of footsteps that legs cannot reach or that put one sole on the other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..compiled import Record, kernel
from ..errors import PlanError
from .turns import wrapped

MAX_STRIDE = 0.8
"""Longest travel of a swing foot, and widest distance of the feet [m]."""


MAX_TOE = 1.2
"""Largest angle between the two feet [rad]."""

_ROUNDING = 1e-9


_Fault = tuple[np.ndarray, np.ndarray, str]


_STRIDE_RULE = f"more than {MAX_STRIDE:g} m; shorten the stride"


def _placement_faults(foot: np.ndarray, stance: np.ndarray, sign: np.ndarray) -> list:
    """Return values, faults and messages of feet placed beside stance feet."""
    d = foot[:, :2] - stance[:, :2]
    across = sign * (np.cos(stance[:, 2]) * d[:, 1] - np.sin(stance[:, 2]) * d[:, 0])
    spread = np.hypot(d[:, 0], d[:, 1])
    toe = np.abs(np.remainder(foot[:, 2] - stance[:, 2] + np.pi, 2 * np.pi) - np.pi)
    return [
        (
            spread,
            spread > MAX_STRIDE + _ROUNDING,
            f"feet are {{:.3f}} m apart, {_STRIDE_RULE}",
        ),
        (
            toe,
            toe > MAX_TOE + _ROUNDING,
            f"feet point {{:.3f}} rad apart, more than {MAX_TOE:g} rad; turn less",
        ),
        (
            across,
            across <= 0.0,
            "foot lands {:.3f} m to its own side of the other foot, must be above 0 m; "
            "the legs would cross",
        ),
    ]


def _overlap_fault(gap: np.ndarray) -> _Fault:
    """Return values, faults and message of soles that meet."""
    return (
        gap,
        gap <= 0.0,
        "soles meet: their gap is {:.3f} m and must stay above 0 m; step wider",
    )


def _refuse(faults: Iterable[_Fault], names: Sequence[str]) -> None:
    """Raise an error about the first step with a fault."""
    found = [
        (int(np.argmax(bad)), i, values, text)
        for i, (values, bad, text) in enumerate(faults)
        if bad.any()
    ]
    if found:
        k, _, values, text = min(found, key=lambda fault: fault[:2])
        raise PlanError(f"{names[k]}: {text.format(float(values[k]))}")


def _sole_gap(a: np.ndarray, b: np.ndarray, size: tuple[float, float]) -> np.ndarray:
    """Return the gaps of pairs of soles along their best separating axis.

    Args:
        a: Poses, shape (n, 3).
        b: Poses, shape (n, 3).
        size: Length and width of both soles [m].

    Returns:
        Gap [m], shape (n,): positive if they are apart, negative if they overlap.
    """
    half = np.array(size) / 2
    d, turn = b[:, :2] - a[:, :2], np.abs(np.cos(b[:, 2] - a[:, 2]))
    side = np.abs(np.sin(b[:, 2] - a[:, 2]))
    reach = half + np.stack(
        [half[0] * turn + half[1] * side, half[0] * side + half[1] * turn], axis=1
    )
    gaps = [np.abs(_turned(d, yaw)) - reach for yaw in (a[:, 2], b[:, 2])]
    return np.max(np.concatenate(gaps, axis=1), axis=1)


def _turned(d: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * d[:, 0] + sin * d[:, 1], cos * d[:, 1] - sin * d[:, 0]], 1)


# The same rules of one step, as kernels.


@kernel
def shorten(feet: np.ndarray, foot: int, at: np.ndarray, command: Record) -> bool:
    """Move a foothold toward the place beside the other foot until it is walkable.

    Returns:
        Whether it had to be moved.
    """
    if is_walkable(feet, foot, at, command):
        return False
    x, y, yaw = feet[1 - foot, 0], feet[1 - foot, 1], feet[1 - foot, 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = at[0] - x, at[1] - y
    ahead, across = cos * dx + sin * dy, cos * dy - sin * dx
    turn = wrapped(at[2] - yaw)
    beside = 2.0 * command.width * (1.0 if foot == 0 else -1.0)
    for k in range(1, 9):
        factor = 1.0 - 0.125 * k
        a, b = factor * ahead, beside + factor * (across - beside)
        at[0], at[1] = x + cos * a - sin * b, y + sin * a + cos * b
        at[2] = yaw + factor * turn
        if is_walkable(feet, foot, at, command):
            break
    return True


@kernel
def is_walkable(feet: np.ndarray, foot: int, at: np.ndarray, command: Record) -> bool:
    """Return whether a step keeps the rules of `footsteps.FootstepPlan`."""
    own, other = feet[foot], feet[1 - foot]
    dx, dy = at[0] - own[0], at[1] - own[1]
    turn = wrapped(at[2] - own[2])
    x, y, yaw = other[0], other[1], other[2]
    ax, ay = at[0] - x, at[1] - y
    across = math.cos(yaw) * ay - math.sin(yaw) * ax
    sign = 1.0 if foot == 0 else -1.0
    if math.hypot(dx, dy) > MAX_STRIDE or math.hypot(ax, ay) > MAX_STRIDE:
        return False
    if abs(wrapped(at[2] - yaw)) > MAX_TOE or sign * across <= 0.0:
        return False
    for k in range(11):
        s = 0.1 * k
        gap = sole_gap(
            own[0] + s * dx - x,
            own[1] + s * dy - y,
            yaw,
            own[2] + s * turn,
            0.5 * command.sole[0],
            0.5 * command.sole[1],
        )
        if gap <= 0.0:
            return False
    return True


@kernel
def sole_gap(
    dx: float, dy: float, yaw_0: float, yaw_1: float, length: float, width: float
) -> float:
    """Return the gap of two soles along their best separating axis [m].

    Args:
        dx: From the one to the other, world [m].
        dy: From the one to the other, world [m].
        yaw_0: Heading of the one [rad].
        yaw_1: Heading of the other [rad].
        length: Half the length of both [m].
        width: Half their width [m].
    """
    turn = yaw_1 - yaw_0
    along, across = abs(math.cos(turn)), abs(math.sin(turn))
    reach_x = length + length * along + width * across
    reach_y = width + length * across + width * along
    best = -math.inf
    for yaw in (yaw_0, yaw_1):
        cos, sin = math.cos(yaw), math.sin(yaw)
        best = max(best, abs(cos * dx + sin * dy) - reach_x)
        best = max(best, abs(cos * dy - sin * dx) - reach_y)
    return best
