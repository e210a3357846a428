r"""Gains and ZMP filter that suit a robot, its loop and its gait.

What the law can do about the ZMP error of each step, which comes from all that the
pendulum does not know of, is told by `stability_margins.zmp_sensitivity` at the
frequency of the steps. It falls as the gains grow, until the loop runs out of gain
margin, and as k_p comes near k_c, which makes constant errors grow by
:math:`k_c / (k_c - k_p)`. `design` takes the best that keeps both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from ..control import Gains
from ..errors import ParameterError
from ..pattern import PAPER_PENDULUM, Pendulum
from ..settings import check_settings, setting
from .bounds import sampled_weights, sampled_worst_case
from .pole_placement import damping, design_gains
from .sampled_loop import SampledLoop, highest_cutoff
from .stability_margins import gain_limit, zmp_sensitivity

Aim: TypeAlias = Literal["gait", "disturbance", "poles"]
"""What is made best: the ZMP of the gait, the disturbance that is guaranteed to be
survived, or nothing, since the poles are given."""


@dataclass(frozen=True, kw_only=True)
class DesignGoal:
    """Objective and constraints of a gain design.

    Raises:
        ParameterError: If a number is out of range, or poles are half given.
    """

    aim: Aim = setting("gait", "What is made best")
    step_time: float = setting(
        1.0,
        'Time of a step, whose ZMP error the aim "gait" holds down',
        "s",
        "[0.1, 10]",
    )
    frequency: float | None = setting(
        None,
        'Natural frequency of the ideal loop, for the aim "poles"',
        "rad/s",
        "(0, inf)",
    )
    damping: float | None = setting(
        None, 'Its damping, for the aim "poles"', "", "(0, inf)"
    )
    a: float = setting(
        0.05, 'Bound on |eps|, for the aim "disturbance"', "m/s", "[1e-6, 10]"
    )
    b: float = setting(
        0.5,
        'Bound on the rate of eps, for the aim "disturbance"',
        "m/s^2",
        "[1e-6, 1e3]",
    )
    gain_margin: float = setting(
        3.0, "Factor on both gains that the loop is to stand", "", "[1, 100]"
    )
    amplification: float = setting(
        2.0,
        "Largest k_c / (k_c - k_p), by which a constant ZMP error grows",
        "",
        "[1.01, 10]",
    )
    standing_damping: float = setting(
        1.0, "Damping of the ideal loop when standing", "", "[0.3, 10]"
    )
    standing_amplification: float = setting(
        1.5, "k_c / (k_c - k_p) when standing", "", "[1.01, 10]"
    )

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        check_settings(self)
        if self.aim == "poles":
            if self.frequency is None or self.damping is None:
                raise ParameterError('the aim "poles" needs a frequency and a damping')
            design_gains(Pendulum(), self.frequency, self.damping)


class Design(NamedTuple):
    """Gains with the filter that they are meant for."""

    gains: Gains
    """Walking and standing gains, the same in x and y."""
    zmp_cutoff: float
    """Cut-off of the ZMP filter [Hz]."""


class _Set(NamedTuple):
    """One choice for an axis."""

    k_p: float
    k_c: float
    zmp_cutoff: float


def design(
    pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal | None = None
) -> Design:
    """Return gains and filter for a loop.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: Period, servo lag, delays and contact; its own cut-off is ignored.
        goal: What to reach; the defaults if None.

    Returns:
        The design; the sampled loop has the gain margin that was asked for.

    Raises:
        ParameterError: If no gains reach the goal in this loop; tells why.

    Example:
        >>> gains, cutoff = design(Pendulum(), SampledLoop())
        >>> gains.zmp, gains.com, cutoff
        ((2.872, 2.872), (5.744, 5.744), 1.169)
    """
    goal = goal or DesignGoal()
    best = _AIMS[goal.aim](pendulum, loop, goal)
    if best is None:
        raise ParameterError(
            f"no gains have a gain margin of {goal.gain_margin:g} at a period of "
            f"{1e3 * loop.period:g} ms, servo lag {1e3 * loop.servo_lag:g} ms and "
            f"delay {loop.delay} ticks; shorten the delay, or lower the gain margin"
        )
    k_p, k_c, cutoff = (rounded(x) for x in best)
    still_p, still_c = _standing(pendulum, replace(loop, zmp_cutoff=cutoff), goal)
    gains = Gains(
        zmp=(k_p, k_p),
        com=(k_c, k_c),
        standing_zmp=(still_p, still_p),
        standing_com=(still_c, still_c),
    )
    return Design(gains, cutoff)


_CUTOFFS = np.geomspace(0.1, 1.2, 12)  # of the ZMP filter, times omega_n [Hz s/rad]
_SHARES = np.linspace(0.05, 1.0, 39)  # of the largest k_p that keeps the margin


def _for_gait(pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal) -> _Set | None:
    """Return the set that leaves least of the steps' ZMP error."""
    found = []
    ratio = goal.amplification / (goal.amplification - 1.0)  # k_c / k_p
    for sampled, k_max in _filtered(pendulum, loop, goal, ratio):
        k_p = k_max * _SHARES
        S = zmp_sensitivity(pendulum, k_p, ratio * k_p, sampled, 1.0 / goal.step_time)
        i = int(np.argmin(S))
        found.append((float(S[i]), _Set(k_p[i], ratio * k_p[i], _cutoff(sampled))))
    return min(found, default=(0.0, None), key=lambda pair: pair[0])[1]


def _for_disturbance(
    pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal
) -> _Set | None:
    """Return the set with the least worst case of the ZMP.

    Bounds that are a little too large choose a few, the exact ones among those.
    """
    found = []
    for s in np.linspace(1.2, goal.amplification, 4).tolist():
        ratio = s / (s - 1.0)
        for sampled, k_max in _filtered(pendulum, loop, goal, ratio):
            for k_p in (k_max * _SHARES[3::7]).tolist():
                if damping(pendulum, k_p, ratio * k_p) < _LEAST_DAMPING:
                    continue
                try:
                    _, w = sampled_weights(pendulum, k_p, ratio * k_p, sampled)
                except ParameterError:  # so slow that it has no bound
                    continue
                simple = goal.a * w.peak + goal.b * w.rate_peak
                found.append((simple, w, sampled, _Set(k_p, ratio * k_p, 0.0)))
    found.sort(key=lambda item: item[0])
    exact = (
        (sampled_worst_case(w, x, goal.a, goal.b).bound, gains, _cutoff(x))
        for _, w, x, gains in found[:_FINALISTS]
    )
    bound = min(exact, default=None, key=lambda item: item[0])
    return None if bound is None else bound[1]._replace(zmp_cutoff=bound[2])


_LEAST_DAMPING = 0.5  # of the ideal loop [-]
_FINALISTS = 5  # sets that the exact worst case is found for


def _for_poles(pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal) -> _Set | None:
    """Return the gains of the wanted poles, with the quickest filter that is safe."""
    k_p, k_c = design_gains(pendulum, goal.frequency or 0.0, goal.damping or 0.0)
    highest = highest_cutoff(pendulum, k_p, k_c, loop)
    slower = np.append(_CUTOFFS * pendulum.omega, highest)
    for cutoff in sorted(slower[(slower > 0.0) & (slower <= highest)], reverse=True):
        sampled = replace(loop, zmp_cutoff=float(cutoff))
        if gain_limit(pendulum, k_p, k_c, sampled) >= goal.gain_margin:
            return _Set(k_p, k_c, float(cutoff))
    return None


_AIMS = {
    "gait": _for_gait,
    "disturbance": _for_disturbance,
    "poles": _for_poles,
}


def _standing(
    pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal
) -> tuple[float, float]:
    r"""Return k_p and k_c for standing, from damping and amplification s.

    .. math:: k_p = \frac{\omega_n \sqrt{s - 1}}{2 \zeta}, \quad
        k_c = \frac{s}{s - 1} k_p

    or less, if that is what the gain margin leaves.
    """
    s = goal.standing_amplification
    k_p = pendulum.omega * math.sqrt(s - 1.0) / (2.0 * goal.standing_damping)
    ratio = s / (s - 1.0)
    limit = gain_limit(pendulum, k_p, ratio * k_p, loop) / goal.gain_margin
    k_p *= min(1.0, limit)
    return rounded(k_p), rounded(ratio * k_p)


def _filtered(
    pendulum: Pendulum, loop: SampledLoop, goal: DesignGoal, ratio: float
) -> Iterator[tuple[SampledLoop, float]]:
    """Yield loops by cut-off, and the largest k_p of each that keeps the margin.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: The loop.
        goal: Gives the gain margin.
        ratio: k_c / k_p.
    """
    for cutoff in (_CUTOFFS * pendulum.omega).tolist():
        sampled = replace(loop, zmp_cutoff=cutoff)
        k_max = gain_limit(pendulum, 1.0, ratio, sampled) / goal.gain_margin
        if 0.0 < k_max < math.inf:
            yield sampled, k_max


def _cutoff(loop: SampledLoop) -> float:
    """Return the cut-off of a loop that has one [Hz]."""
    return math.inf if loop.zmp_cutoff is None else loop.zmp_cutoff


def rounded(x: float) -> float:
    """Return a number as people read and repeat it.

    Args:
        x: Any number.

    Returns:
        The number to four digits.
    """
    return float(f"{x:.4g}")


# ---- Published gains ---------------------------------------------------------------

_WALKING_CONTROLLERS = "robotology/walking-controllers, app/robots"
_FRJOCO = "CheolMin-Yoon/FrJoCo, python/DCM_v2/config.py"


class PublishedGains(NamedTuple):
    """A published pair of gains of the paper's law.

    The robots of the iCub family run it as the last layer of
    robotology/walking-controllers: k_ZMP and k_CoM of the files
    `zmpControllerParams.ini` under `app/robots/<robot>/dcm_walking/`, the same for both
    axes, without a ZMP filter. On some of them an outer loop moves the ZMP reference,
    which is not counted here.
    """

    robot: str
    """Whose they are."""
    use: str
    """What for."""
    k_p: float
    """ZMP gain [1/s]."""
    k_c: float
    """CoM gain [1/s]."""
    height: float
    """CoM height [m]."""
    source: str
    """Where they are published."""

    @property
    def pendulum(self) -> Pendulum:
        """The simplified model of that robot."""
        return Pendulum(height=self.height)


_PAPER = PAPER_PENDULUM.height, "Choi, Kim, You 2006, Section VI"
_ERGOCUB = 0.70, _WALKING_CONTROLLERS
_ICUB = 0.53, _WALKING_CONTROLLERS
_GENOVA_09 = 0.565, _WALKING_CONTROLLERS

PUBLISHED = (
    PublishedGains("the paper", "x", 3.0, 6.6, *_PAPER),
    PublishedGains("the paper", "y", 1.8, 3.8, *_PAPER),
    PublishedGains("ergoCubSN000", "walking", 1.8, 5.0, *_ERGOCUB),
    PublishedGains("ergoCubSN000", "standing", 0.5, 4.0, *_ERGOCUB),
    PublishedGains("ergoCubSN001", "walking", 1.3, 5.0, *_ERGOCUB),
    PublishedGains("ergoCubSN001", "standing", 0.1, 4.0, *_ERGOCUB),
    PublishedGains("ergoCubGazeboV1", "walking", 1.0, 3.0, *_ERGOCUB),
    PublishedGains("iCubGazeboV2_5", "walking", 3.5, 10.0, *_ICUB),
    PublishedGains("iCubGazeboV2_5", "standing", 0.9, 6.0, *_ICUB),
    PublishedGains("iCubGenova04, joypad", "walking", 3.5, 4.0, *_ICUB),
    PublishedGains("iCubGenova04, joypad", "standing", 0.9, 4.0, *_ICUB),
    PublishedGains("iCubGenova04, iFeel", "walking", 2.0, 10.0, *_ICUB),
    PublishedGains("iCubGenova09", "walking", 1.8, 5.0, *_GENOVA_09),
    PublishedGains("iCubGenova09", "standing", 0.5, 4.0, *_GENOVA_09),
    PublishedGains("G1, FrJoCo", "walking", 10.0, 1.0, 0.6846, _FRJOCO),
)
"""Published gains; CoM heights of the iCub family are nominal ones."""
