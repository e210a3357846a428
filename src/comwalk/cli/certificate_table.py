"""A certificate as a table for people, and as plain numbers for programs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeAlias

from ..certificates import (
    AxisCertificate,
    Certificate,
    IdealBounds,
    IdealCertificate,
    LoopCertificate,
    SampledBound,
    SampledLoop,
    text_of_loop,
)
from ..certificates.identification import (
    Estimate,
    Identified,
    ResponseFit,
    equivalent_loop,
    measured_margin,
)
from ..control import Control
from ..pattern import Pendulum

Row: TypeAlias = tuple[str, ...]
"""A quantity, and what it is for each axis."""


class Section(NamedTuple):
    """Some rows of the table, with a title."""

    title: str
    """What they are about."""
    rows: list[Row]
    """Name, and one cell for each axis."""


def sections_of_certificate(certificate: Certificate) -> list[Section]:
    """Return a certificate as text, in sections, one column for each axis.

    Args:
        certificate: What `certify` returned.

    Returns:
        The sections; what does not exist is "-".
    """
    axes, omega = certificate.axes, certificate.pendulum.omega
    bound = f"for |eps| <= {certificate.a:g} m/s, |eps'| <= {certificate.b:g} m/s^2"
    gains = ("k_p, k_c [1/s]", *(f"{x.k_p:.4g}, {x.k_c:.4g}" for x in axes))
    parts = {
        f"ideal loop, omega_n = {omega:.3f} rad/s": (_ideal_rows(), "ideal"),
        f"its ZMP error [mm] {bound}": (_bound_rows("zmp"), "ideal"),
        f"its CoM error [mm] {bound}": (_bound_rows("com"), "ideal"),
        f"as it runs: {text_of_loop(certificate.loop)}": (_loop_rows(), "loop"),
    }
    sections = [
        Section(title, [*_read(axes, readers, part)])
        for title, (readers, part) in parts.items()
    ]
    return [Section("", [gains]), *sections]


def flags_to_walk_with(certificate: Certificate) -> str:
    """Return the flags of `comwalk walk` that have these gains and this filter.

    Args:
        certificate: What `certify` returned.

    Returns:
        The flags.
    """
    (p, c), (still_p, still_c) = certificate.gains.walking, certificate.gains.standing
    pairs = {"zmp": p, "com": c, "standing-zmp": still_p, "standing-com": still_c}
    flags = [f"--gains.{name} {x:g},{y:g}" for name, (x, y) in pairs.items()]
    cutoff = certificate.loop.zmp_cutoff
    return " ".join([*flags, f"--control.zmp-cutoff {cutoff or math.inf:g}"])


Reader: TypeAlias = tuple[str, Callable[[Any], str]]
"""The name of a row, and what gives the text of an axis; None has no text."""


def _read(
    axes: tuple[AxisCertificate, ...], readers: Iterator[Reader], part: str
) -> Iterator[Row]:
    """Yield rows of one part of each axis."""
    for name, read in readers:
        parts = [getattr(x, part) for x in axes]
        yield (name, *("-" if x is None else read(x) for x in parts))


def _ideal_rows() -> Iterator[Reader]:
    """Yield rows of the ideal loop, without its bounds."""

    def poles(x: IdealCertificate) -> str:
        first, second = x.poles
        if first.imag:
            return f"{first.real:.3g}+-{abs(first.imag):.3g}i"
        return f"{first.real:.3g}, {second.real:.3g}"

    yield "stable: 0 < k_p < k_c", lambda x: _yes(x.stable)
    yield "Theorem 1, Remark 1", lambda x: _yes(x.remark_1)
    yield "proved by the paper's V", lambda x: _yes(x.proof is not None)
    yield "poles [1/s]", poles
    yield "frequency [rad/s]", lambda x: _number(x.natural_frequency)
    yield "damping ratio", lambda x: _number(x.damping)


def _bound_rows(name: str) -> Iterator[Reader]:
    """Yield the bounds on one error, from loose to tight."""

    def reader(read: Callable[[IdealBounds], float | None]) -> Callable[[Any], str]:
        def text(x: IdealCertificate) -> str:
            bounds = getattr(x, name)
            return "-" if bounds is None else _millimetres(read(bounds))

        return text

    yield "paper's V", reader(lambda x: x.paper)
    yield "best ellipsoid", reader(lambda x: x.ellipsoid)
    yield "the same, any eps'", reader(lambda x: x.invariant)
    yield "L1 gain, any eps'", reader(lambda x: x.peak)
    yield "exact", reader(lambda x: x.worst and x.worst.bound)


def _loop_rows() -> Iterator[Reader]:
    """Yield rows of the loop as it runs."""

    def margin(name: str, factor: float = 1.0) -> Callable[[LoopCertificate], str]:
        def text(x: LoopCertificate) -> str:
            value = None if x.margins is None else getattr(x.margins, name)
            return _number(None if value is None else factor * value)

        return text

    def bound(x: SampledBound | None) -> str:
        return _millimetres(None if x is None else x.bound)

    yield "stable", lambda x: _yes(x.stable)
    yield "decay rate [1/s]", lambda x: _number(x.decay)
    yield "gain margin", margin("gain_up")
    yield "phase margin [deg]", margin("phase", math.degrees(1.0))
    yield "delay margin [ms]", margin("delay", 1e3)
    yield "filter stable up to [Hz]", lambda x: _number(x.highest_cutoff)
    yield "k_p stable up to [1/s]", lambda x: _number(x.largest_zmp_gain)
    yield "ZMP error [mm]", lambda x: bound(x.zmp)
    yield "CoM error [mm]", lambda x: bound(x.com)
    yield "eps inside sole [m/s]", lambda x: _number(x.survives)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return "any" if math.isinf(value) else f"{value:.3g}"


def _millimetres(value: float | None) -> str:
    """Return a length [m] in mm."""
    return "-" if value is None else f"{1e3 * value:.1f}"


def numbers_of_certificate(certificate: Certificate) -> dict[str, Any]:
    """Return a certificate as plain numbers, texts, lists and tables.

    Args:
        certificate: What `certify` returned.

    Returns:
        What JSON can hold; what is infinite or does not exist is None. Bounds are in m,
        for disturbances of `a_m_s` and `b_m_s2`; the worst disturbances themselves
        are left out.
    """
    axes = [
        {"name": x.name, "k_p": x.k_p, "k_c": x.k_c}
        | {"ideal": _plain(x.ideal), "loop": _plain(x.loop)}
        for x in certificate.axes
    ]
    survived, delay = certificate.survives, certificate.delay_margin
    return {
        "stable": certificate.stable,
        "verdict": certificate.verdict,
        "fault": certificate.fault,
        "stance_stiffness_ratio": certificate.stance,
        "survives_m_s": survived and survived[0],
        "delay_margin_s": _plain(delay and delay[0]),
        "omega_rad_s": certificate.pendulum.omega,
        "loop": _plain(certificate.loop),
        "room_m": certificate.room and _plain(certificate.room._asdict()),
        "a_m_s": certificate.a,
        "b_m_s2": certificate.b,
        "axes": axes,
    }


def _plain(value: Any) -> Any:
    """Return a value ready for JSON."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if hasattr(value, "disturbance"):
        return value.bound
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [value.real, value.imag]
    return None if isinstance(value, float) and math.isinf(value) else value


def facts_of(
    found: Identified, robot: str, pendulum: Pendulum, control: Control
) -> dict[str, Any]:
    """Return an identified loop as plain numbers, units in their names.

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
    if x is None:
        return None
    return {"value": scale * x.value, "deviation": scale * x.deviation}


def _axis(fit: ResponseFit, k: int, control: Control) -> dict[str, Any]:
    """Return the numbers of one axis."""
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
