"""Certificate of the walking controller's gains, before the robot moves.

`certify` puts all answers together, for each axis, walking and standing: the paper's
theory on the ideal model beside the exact facts, and the loop as it is sampled,
filtered and delayed. Each answer stands by itself; `Certificate.verdict` is one line
that a human can act on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ..control import Gains, Pair
from ..errors import ParameterError, checked_number
from ..pattern import Pendulum
from .bounds import (
    PaperBound,
    SampledWorstCase,
    ellipsoid_bound,
    invariant_set,
    paper_bound,
    sampled_weights,
    sampled_worst_case,
)
from .gain_check import check_gains
from .ideal_loop import Output, is_hurwitz, proof_condition, remark_1
from .largest_errors import WorstCase, com_peak_gain, worst_case, zmp_peak_gain
from .pole_placement import damping, natural_frequency, poles
from .reach import LEAST_STANCE
from .sampled_loop import SampledLoop, highest_cutoff, spectral_radius
from .stability_margins import Margins, decay_rate, largest_zmp_gain, margins


class SoleRoom(NamedTuple):
    """Admissible ZMP error before a sole tips."""

    walking: Pair
    """On one foot, forward and sideways [m]."""
    standing: Pair
    """On both feet, forward and sideways [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IdealBounds:
    """Ultimate bounds on one error of the ideal loop, from loose to tight [m]."""

    paper: float | None
    """By the paper's Lyapunov function; None where it proves nothing."""
    ellipsoid: float
    """By the best ellipsoid, eps and its rate taken as independent."""
    invariant: float
    """By the best ellipsoid for a bounded eps of any rate."""
    peak_gain: float
    """Exact for a bounded eps of any rate: |e| per |eps| [s]."""
    peak: float
    """The same times a."""
    worst: WorstCase | None
    """Exact for a bounded eps of bounded rate, with that eps; None if not asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IdealCertificate:
    """Guarantees of the ideal loop, that of the paper's proof."""

    theorem_1: bool
    """Whether Eq. (32) holds as printed, for some beta and gamma: it is `remark_1`."""
    remark_1: bool
    """Whether k_c > omega_n > k_p > 0."""
    proof: PaperBound | None
    """Best alpha, beta and gamma of Eq. (38), and what they prove; None if Eq. (38)
    proves nothing: k_p k_c < omega_n^2 < k_c^2 is needed."""
    stable: bool
    """The exact condition, 0 < k_p < k_c."""
    poles: tuple[complex, complex]
    """Poles [1/s]."""
    natural_frequency: float | None
    """[rad/s]; None if unstable."""
    damping: float | None
    """Damping ratio [-]; None if unstable."""
    com: IdealBounds | None
    """Of the CoM error; None if unstable."""
    zmp: IdealBounds | None
    """Of the ZMP error; None if unstable."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledBound:
    """Bound on one error of the sampled loop, at the ticks [m]."""

    bound: float
    """What is guaranteed: the exact one if it was asked for, else a simple one."""
    worst: SampledWorstCase | None
    """The exact one, with the eps that attains it; None if not asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopCertificate:
    """Guarantees of the loop as it runs: sampled, filtered, delayed."""

    radius: float
    """Spectral radius of a tick [-]; stable below 1."""
    decay: float
    """Decay rate of the slowest error [1/s]."""
    margins: Margins | None
    """Of gain, phase, delay; None if unstable."""
    highest_cutoff: float
    """ZMP cut-off up to which the loop is stable [Hz]."""
    largest_zmp_gain: float
    """k_p up to which the loop is stable at this k_c [1/s]."""
    com: SampledBound | None
    """Of the CoM error; None if unstable, or next to it."""
    zmp: SampledBound | None
    """Of the ZMP error, before the filter; None if unstable, or next to it."""
    survives: float | None
    """Largest bound a [m/s] of eps for which the ZMP stays inside the sole, b growing
    with a; None if there is none, or the sole is not known."""

    @property
    def stable(self) -> bool:
        """Whether errors decay."""
        return self.radius < 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisCertificate:
    """All answers for one axis, walking or standing."""

    axis: str
    """x or y."""
    standing: bool
    """Whether the gains are those of standing."""
    k_p: float
    """ZMP gain [1/s]."""
    k_c: float
    """CoM gain [1/s]."""
    ideal: IdealCertificate | None
    """The paper's model; None without feedback of the ZMP, or if not asked for."""
    loop: LoopCertificate | None
    """The loop as it runs; None in open loop."""

    @property
    def name(self) -> str:
        """Such as "walking x"."""
        return f"{'standing' if self.standing else 'walking'} {self.axis}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """The certificate of gains on a robot. Made by `certify`."""

    pendulum: Pendulum
    """The simplified model."""
    gains: Gains
    """The gains."""
    loop: SampledLoop
    """The loop."""
    a: float
    """Bound on |eps| [m/s]."""
    b: float
    """Bound on the rate of eps [m/s^2]."""
    room: SoleRoom | None
    """The soles, if they are known."""
    stance: float | None
    """Least stiffness of a stance leg over m g / h [-]; None if it is not known."""
    friction: str | None
    """Why the joints' friction is too large, `friction_fault`; None if it is not."""
    exact: bool
    """Whether the worst cases are exact; else they are bounds that are simpler to find.
    """
    axes: tuple[AxisCertificate, ...]
    """Walking x and y, standing x and y."""

    @property
    def stable(self) -> bool:
        """Whether every axis that is fed back is stable, in the sampled loop too."""
        return self.fault is None

    @property
    def fault(self) -> str | None:
        """Why the gains are refused, and what to change; None if they are not."""
        try:
            check_gains(self.gains, self.pendulum, self.loop)
        except ParameterError as error:
            return str(error)
        if self.stance is not None and self.stance < 1.0:
            return (
                f"the servos of a stance leg hold the CoM with {self.stance:.2f} of "
                "m g / h, so that the robot tips over by itself; make them "
                f"{LEAST_STANCE / self.stance:.2f} times as stiff"
            )
        return self.friction

    @property
    def survives(self) -> tuple[float, str] | None:
        """The least of all axes' `LoopCertificate.survives` [m/s], and which it is."""
        found = ((x.loop.survives, x.name) for x in self.axes if x.loop)
        return min(((v, name) for v, name in found if v is not None), default=None)

    @property
    def delay_margin(self) -> tuple[float, str] | None:
        """The least delay margin of all axes [s], and which it is."""
        loops = ((x.loop.margins, x.name) for x in self.axes if x.loop)
        return min(((m.delay, name) for m, name in loops if m), default=None)

    @property
    def verdict(self) -> str:
        """One line that a human can act on."""
        if (fault := self.fault) is not None:
            return f"UNSTABLE: {fault}"
        if self.gains.is_open_loop:
            return "open loop: nothing is fed back, so nothing is guaranteed"
        return "stable; " + "; ".join(self._phrases())

    def _phrases(self) -> Iterator[str]:
        """Yield what stable gains survive."""
        if self.stance is not None and self.stance < LEAST_STANCE:
            yield (
                f"but the stance leg holds {self.stance:.2f} of m g / h, at least "
                f"{LEAST_STANCE:g} is needed to walk"
            )
        if self.survives is not None:
            speed, name = self.survives
            least = "" if self.exact else "at least "
            error = f"{least}{speed:.3f} m/s of CoM velocity error"
            yield f"survives {error} inside the sole ({name})"
        if self.delay_margin is not None:
            delay, name = self.delay_margin
            if math.isinf(delay):
                yield "the loop tolerates any delay"
            else:
                yield f"the loop tolerates {1e3 * delay:.1f} ms more delay ({name})"


def certify(
    pendulum: Pendulum,
    gains: Gains,
    loop: SampledLoop,
    *,
    a: float = 0.05,
    b: float = 0.5,
    room: SoleRoom | None = None,
    stance: float | None = None,
    friction: str | None = None,
    exact: bool = True,
    theory: bool = True,
) -> Certificate:
    r"""Certify gains, for walking and standing, by axis.

    The disturbance is that of Eq. (30), an error of the CoM's velocity, with
    :math:`|\epsilon| \le a` and :math:`|\dot\epsilon| \le b`.

    Args:
        pendulum: Gives omega_n [rad/s].
        gains: The gains, stable or not.
        loop: The loop as it runs.
        a: Bound on |eps| [m/s], above 0.
        b: Bound on the rate of eps [m/s^2], above 0.
        room: How far the ZMP may be from its plan; None if it is not known.
        stance: Least stiffness of a stance leg over m g / h [-], as `stance_ratio`
            finds it; None if it is not known.
        friction: What `friction_fault` says.
        exact: Whether to solve the linear programs for the exact worst cases; without
            them it takes a tenth of the time.
        theory: Whether to answer for the ideal loop too, of which the verdict tells
            nothing.

    Returns:
        The certificate.

    Raises:
        ParameterError: If a number is out of range.

    Example:
        >>> room = SoleRoom(walking=(0.1, 0.06), standing=(0.1, 0.15))
        >>> certify(Pendulum(), Gains(), SampledLoop(), room=room).verdict[:26]
        'stable; survives 0.033 m/s'
    """
    a = checked_number("a", a, unit="m/s", low=0.0, open_low=True)
    b = checked_number("b", b, unit="m/s^2", low=0.0, open_low=True)
    axes = []
    for standing, pairs in ((False, gains.walking), (True, gains.standing)):
        spans = (None, None) if room is None else room[standing]
        for axis, k_p, k_c, span in zip("xy", *pairs, spans, strict=True):
            model = _Axis(pendulum, k_p, k_c, a, b, exact)
            axes.append(
                AxisCertificate(
                    axis=axis,
                    standing=standing,
                    k_p=k_p,
                    k_c=k_c,
                    ideal=_ideal(model) if theory and k_p > 0.0 else None,
                    loop=_sampled(model, loop, span) if k_p + k_c > 0.0 else None,
                )
            )
    return Certificate(
        pendulum=pendulum,
        gains=gains,
        loop=loop,
        a=a,
        b=b,
        room=room,
        stance=stance,
        friction=friction,
        exact=exact,
        axes=tuple(axes),
    )


class _Axis(NamedTuple):
    """The certificate of one axis."""

    pendulum: Pendulum
    k_p: float
    k_c: float
    a: float
    b: float
    exact: bool


def _ideal(x: _Axis) -> IdealCertificate:
    """Return the answers of the paper's model."""
    gains = x.pendulum, x.k_p, x.k_c
    stable = is_hurwitz(x.k_p, x.k_c)
    proved = proof_condition(*gains)
    proof = paper_bound(*gains, x.a, x.b) if proved else None
    first, second = poles(*gains).tolist()
    remark = remark_1(*gains)
    return IdealCertificate(
        theorem_1=remark,
        remark_1=remark,
        proof=proof,
        stable=stable,
        poles=(first, second),
        natural_frequency=natural_frequency(*gains) if stable else None,
        damping=damping(*gains) if stable else None,
        com=_ideal_bounds(x, "com", proof and proof.com) if stable else None,
        zmp=_ideal_bounds(x, "zmp", proof and proof.zmp) if stable else None,
    )


def _ideal_bounds(x: _Axis, output: Output, paper: float | None) -> IdealBounds:
    """Return the bounds on one error of the ideal loop."""
    gains = x.pendulum, x.k_p, x.k_c
    gain = (com_peak_gain if output == "com" else zmp_peak_gain)(*gains)
    return IdealBounds(
        paper=paper,
        ellipsoid=ellipsoid_bound(*gains, x.a, x.b, output).bound,
        invariant=invariant_set(*gains, x.a, output).bound,
        peak_gain=gain,
        peak=gain * x.a,
        worst=worst_case(*gains, x.a, x.b, output) if x.exact else None,
    )


def _sampled(x: _Axis, loop: SampledLoop, span: float | None) -> LoopCertificate:
    """Return the answers of the loop as it runs."""
    gains = x.pendulum, x.k_p, x.k_c
    radius = spectral_radius(*gains, loop)
    bounds = _sampled_bounds(x, loop)
    com, zmp = bounds or (None, None)
    return LoopCertificate(
        radius=radius,
        decay=decay_rate(*gains, loop),
        margins=margins(*gains, loop) if radius < 1.0 else None,
        highest_cutoff=highest_cutoff(*gains, loop),
        largest_zmp_gain=largest_zmp_gain(x.pendulum, x.k_c, loop),
        com=com,
        zmp=zmp,
        survives=span / zmp.bound * x.a if zmp and span is not None else None,
    )


def _sampled_bounds(
    x: _Axis, loop: SampledLoop
) -> tuple[SampledBound, SampledBound] | None:
    """Return the bounds on both errors; None if the loop has none."""
    try:
        weights = sampled_weights(x.pendulum, x.k_p, x.k_c, loop)
    except ParameterError:
        return None
    found = []
    for w in weights:
        if x.exact:
            worst = sampled_worst_case(w, loop, x.a, x.b)
            found.append(SampledBound(bound=worst.bound, worst=worst))
        else:
            simple = x.a * w.peak + x.b * w.rate_peak
            found.append(SampledBound(bound=simple, worst=None))
    return found[0], found[1]
