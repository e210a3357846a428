r"""Capturability: the largest push that a pendulum could catch by stepping.

What no controller can do: the divergent component of motion (DCM) of the pendulum,
:math:`\xi = c + \dot c / \omega_n`, leaves the ZMP p by

.. math:: \xi(t) = p + (\xi_0 - p) e^{\omega_n t}

and p is at best at the sole's edge towards which the DCM goes, h from its centre. A
step of the length l after the time T catches it if the new foot can catch the rest:

.. math:: \xi_0 \le h + (l + C_{N-1} - h) e^{-\omega_n T}, \quad C_0 = h

Forward and back a step is as long as the foot can go in its time, from as far behind as
the step before was long. Aside, the foot lands on the inner side: far away from the
supporting foot against a push inward, and as near as may be against one outward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ParameterError
from ..settings import check_settings, setting
from .pendulum import Pendulum
from .reference import Phase, PhaseSpan
from .walk_pattern import Pattern

PHASES = 0.1, 0.35, 0.6, 0.85
"""When in a single support a push begins, as shares of it [-]."""
_LENGTHS = 101  # of steps that are tried
_TIMES = 400  # that are tried for a touchdown
_LATEST = 2.0  # how long a touchdown may be put off [s], in single supports


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """What feet can do, of which the bound is made."""

    forward: float = setting(0.7, "Longest step, from sole to sole", "m", "[0, 5]")
    aside: float = setting(0.5, "Largest distance of the feet aside", "m", "(0, 5]")
    beside: float = setting(0.15, "Least distance of the feet aside", "m", "(0, 5]")
    foot_speed: float = setting(2.0, "Speed of a swinging foot", "m/s", "(0, 50]")
    least_time: float = setting(0.3, "Shortest swing", "s", "(0, 5]")

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ParameterError: If a value is out of range, or the feet cannot pass.
        """
        check_settings(self)
        if self.beside > self.aside:
            raise ParameterError(
                f"beside must be at most aside, {self.aside:g} m, got {self.beside:g} m"
            )


@dataclass(frozen=True, slots=True)
class Capturability:
    """Largest velocity steps that a push may make, by way of the push [m/s]."""

    forward: float
    """Ahead."""
    back: float
    """Backward."""
    inward: float
    """Towards the foot in the air."""
    outward: float
    """Away from it."""


def capture_limits(
    pendulum: Pendulum, sole: tuple[float, float], stepping: Stepping, steps: int
) -> tuple[np.ndarray, float, float]:
    """Return how far from a sole the DCM may be as it lands, for N more steps.

    Args:
        pendulum: Gives omega_n.
        sole: Length and width of the sole [m].
        stepping: What feet can do.
        steps: How many more steps there are, N, at least 0.

    Returns:
        Forward or back, as many numbers as `lengths` of the step that was just made,
        since the other foot is so far behind; inward; and outward, of the sole's
        centre [m].
    """
    omega, least = pendulum.omega, stepping.least_time
    h_x, h_y = 0.5 * sole[0], 0.5 * sole[1]
    step = lengths(stepping)
    ahead, inward, outward = np.full(len(step), h_x), h_y, h_y
    times = np.maximum((step[:, None] + step) / stepping.foot_speed, least)
    fades, fade = np.exp(-omega * times), math.exp(-omega * least)
    for _ in range(steps):
        caught = ((step + ahead - h_x) * fades).max(axis=1)
        ahead = h_x + np.maximum(caught, 0.0)
        inward, outward = (
            h_y + max((stepping.aside + outward - h_y) * fade, 0.0),
            h_y + max((inward - stepping.beside - h_y) * fade, 0.0),
        )
    return ahead, inward, outward


def lengths(stepping: Stepping) -> np.ndarray:
    """Return lengths of steps [m], from none to the longest."""
    return np.linspace(0.0, stepping.forward, _LENGTHS)


def largest_push(
    pattern: Pattern,
    stepping: Stepping,
    *,
    steps: int = 8,
    duration: float = 0.1,
) -> Capturability:
    """Return the largest pushes of a walk that any controller could catch.

    Each begins at one of `PHASES` of a single support amid the walk, of which the least
    counts, and lasts a while. The pendulum's state is known at once, the ZMP may be
    anywhere in the sole, double support takes no time, and both axes are alone: what a
    robot takes is less.

    Args:
        pattern: The walk; one of its steps is pushed.
        stepping: What feet can do.
        steps: Steps after the push that may catch it, N, at least 1.
        duration: How long a push lasts [s], above 0.

    Returns:
        Velocity steps [m/s], the impulse over the mass; at least 0.

    Raises:
        ParameterError: If the walk has no step.
    """
    spans = [
        span
        for span in pattern.phases
        if span.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
    ]
    if not spans:
        raise ParameterError("the pattern has no step that could be pushed")
    span = spans[(len(spans) - 1) // 2]
    limits = capture_limits(
        pattern.pendulum, pattern.plan.sole_size, stepping, steps - 1
    )
    found = [
        _largest(pattern, stepping, limits, duration, span, share) for share in PHASES
    ]
    return Capturability(*(max(float(v), 0.0) for v in np.min(found, axis=0)))


def _largest(
    pattern: Pattern,
    stepping: Stepping,
    limits: tuple[np.ndarray, float, float],
    duration: float,
    span: PhaseSpan,
    share: float,
) -> list[float]:
    """Return the largest pushes that begin at one moment, as in `Capturability`."""
    omega, whole = pattern.pendulum.omega, span.duration
    now = pattern.at(span.start + share * whole)
    k = 0 if now.phase is Phase.SINGLE_LEFT else 1
    stands, swings = (now.left, now.right)[:: -1 if k else 1]
    c, s = math.cos(stands.yaw), math.sin(stands.yaw)
    axes = np.array([[c, s], [-s, c]]) * np.array([[1.0], [1.0 if k else -1.0]])
    place = stands.position[:2]
    dcm = axes @ (now.com[:2] + now.com_velocity[:2] / omega - place)
    foot = axes @ (swings.position[:2] - place)  # inward positive
    (ahead, inward, outward), step = limits, lengths(stepping)
    h_x, h_y = 0.5 * np.array(pattern.plan.sole_size)
    soonest = max(stepping.least_time - share * whole, 0.05 * duration)
    T = np.linspace(soonest, max(_LATEST * whole, 2.0 * soonest), _TIMES)
    way = stepping.foot_speed * T
    best = np.maximum.accumulate(step + ahead)
    far = np.minimum(stepping.aside, foot[1] + way) + outward
    near = inward - np.maximum(stepping.beside, foot[1] - way)
    grown = np.exp(omega * T)
    over = np.maximum(T - duration, 0.0)
    pushed = (grown - np.exp(omega * over)) / (duration * omega**2)
    reached = [
        (sign * dcm[0], h_x, np.interp(way + sign * foot[0], step, best, left=-np.inf))
        for sign in (1.0, -1.0)
    ]
    reached += [(dcm[1], h_y, far), (-dcm[1], h_y, near)]
    return [
        float(np.max((most - h - (xi - h) * grown) / pushed)) for xi, h, most in reached
    ]
