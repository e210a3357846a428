"""The picture of a certificate: stability region in the plane of both gains.

Both gains are divided by omega_n, so that all conditions of the ideal loop look the
same for every robot. The region of the sampled loop is this robot's own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..certificates import (
    PUBLISHED,
    Certificate,
    SampledLoop,
    largest_zmp_gain,
    text_of_loop,
)
from ..certificates.identification import Identified, ResponseFit, Responses
from ..pattern import Pendulum
from .matplotlib_figures import DPI, STYLE, literal, write_figure

_LIMITS = (2.0, 2.6)  # of k_p and k_c over omega_n
_EXACT, _REMARK, _PROOF, _LOOP = "#EDEDED", "#56B4E9", "#009E73", "#D55E00"
_OWN, _OTHERS = "#0072B2", "#222222"
_HALO: dict[str, Any] = {
    "facecolor": "white",
    "edgecolor": "none",
    "pad": 0.6,
    "alpha": 0.75,
}


def plot_gain_plane(
    certificate: Certificate, path: str | Path | None = None, *, title: str = ""
) -> Figure:
    """Draw where gains are stable, by each condition, with this robot's and others'.

    Args:
        certificate: Gains, pendulum and loop.
        path: Where to write a picture; not written if None.
        title: Name of the robot.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 6.4), layout="constrained")
        plane, list_ = figure.subplots(1, 2, width_ratios=(1.75, 1.0))
        _draw_conditions(plane)
        _draw_loop(plane, certificate.pendulum, certificate.loop)
        _draw_own(plane, certificate)
        names = _draw_published(plane)
        plane.set(xlim=(0.0, _LIMITS[0]), ylim=(0.0, _LIMITS[1]))
        plane.set_xlabel(r"$k_p\, /\, \omega_n$")
        plane.set_ylabel(r"$k_c\, /\, \omega_n$")
        plane.grid(visible=False)
        _draw_list(list_, names)
        figure.suptitle(_title(certificate, title), x=0.01, ha="left", fontsize=10.5)
    return write_figure(figure, path)


def loop_region(
    pendulum: Pendulum, loop: SampledLoop, k_c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge of the sampled loop's stable region in the plane of the gains.

    Args:
        pendulum: Gives omega_n [rad/s].
        loop: The loop.
        k_c: CoM gains [1/s], of shape (n,).

    Returns:
        The largest stable k_p at each k_c [1/s], and the one that leaves a gain margin
        of 2 on both gains, each of shape (n,).
    """
    edge = np.array([largest_zmp_gain(pendulum, k, loop) for k in k_c.tolist()])
    half = [0.5 * largest_zmp_gain(pendulum, 2.0 * k, loop) for k in k_c.tolist()]
    return edge, np.minimum(np.array(half), edge)


def _draw_conditions(ax: Axes) -> None:
    """Shade the exact region, Remark 1, and where the paper's V proves it."""
    high_p, high_c = _LIMITS
    ax.fill([0.0, 0.0, high_p, high_p], [0.0, high_c, high_c, high_p], fc=_EXACT)
    ax.plot([0.0, high_p], [0.0, high_p], color="#999999", lw=1.0)
    ax.fill([0.0, 0.0, 1.0, 1.0], [1.0, high_c, high_c, 1.0], fc=_REMARK, alpha=0.25)
    ax.plot([0.0, 1.0, 1.0], [1.0, 1.0, high_c], color=_REMARK, lw=1.2)
    k_c = np.linspace(1.0, high_c, 200)
    ax.fill_betweenx(k_c, 0.0, 1.0 / k_c, color=_PROOF, alpha=0.25, lw=0.0)
    ax.plot(1.0 / k_c, k_c, color=_PROOF, lw=1.2)


def _draw_loop(ax: Axes, pendulum: Pendulum, loop: SampledLoop) -> None:
    """Outline the region of the sampled loop, and where its gain margin is 2."""
    omega = pendulum.omega
    k_c = np.linspace(1e-3, _LIMITS[1], 120)
    edge, half = loop_region(pendulum, loop, k_c * omega)
    ax.plot(edge / omega, k_c, color=_LOOP, lw=2.2)
    ax.plot(half / omega, k_c, color=_LOOP, lw=1.4, ls=(0, (4, 2)))


def _draw_own(ax: Axes, certificate: Certificate) -> None:
    """Mark the gains of this robot."""
    omega = certificate.pendulum.omega
    seen: dict[tuple[float, float], list[str]] = {}
    for x in certificate.axes:
        if x.loop is not None:
            at = x.k_p / omega, x.k_c / omega
            seen.setdefault(at, []).append(f"{'s' if x.standing else 'w'}{x.axis}")
    for (p, c), names in seen.items():
        ax.plot(p, c, "*", ms=13, mfc=_OWN, mec="white", mew=0.8, zorder=5)
        standing = names[0].startswith("s")
        ax.annotate(
            ", ".join(_OWN_NAMES[name] for name in names),
            (p, c),
            xytext=(8, -12) if standing else (-8, 7),
            textcoords="offset points",
            ha="left" if standing else "right",
            color=_OWN,
            fontsize=8.5,
            bbox=_HALO,
            zorder=4,
        )


_OWN_NAMES = {"wx": "walk x", "wy": "walk y", "sx": "stand x", "sy": "stand y"}


def _draw_published(ax: Axes) -> list[str]:
    """Mark published gains by numbers; return what the numbers mean."""
    names = []
    for number, gains in enumerate(PUBLISHED, start=1):
        omega = gains.pendulum.omega
        p, c = gains.k_p / omega, gains.k_c / omega
        names.append(
            f"{number}  {gains.robot}, {gains.use}: {gains.k_p:g}, {gains.k_c:g}"
        )
        inside = p < _LIMITS[0]
        place: dict[str, Any] = {"color": _OTHERS, "fontsize": 8.0, "clip_on": False}
        if not inside:
            p = 0.985 * _LIMITS[0]
            names[-1] += "  (far right)"
        marker = "o" if inside else ">"
        ax.plot(p, c, marker, ms=4.5, mfc=_OTHERS, mec="white", mew=0.6, zorder=4)
        offset = (5, 3) if inside else (-4, 6)
        ax.annotate(
            str(number), (p, c), xytext=offset, textcoords="offset points", **place
        )
    return names


def _draw_list(ax: Axes, names: list[str]) -> None:
    """Write the legend, and what the numbers mean."""
    ax.axis("off")
    patch: dict[str, Any] = {"alpha": 0.4, "lw": 1.2}
    own: dict[str, Any] = {
        "color": _OWN,
        "marker": "*",
        "ms": 11,
        "mec": "white",
        "ls": "none",
    }
    handles = [
        Patch(
            fc=_EXACT, ec="#999999", label="stable in the ideal loop: $0 < k_p < k_c$"
        ),
        Patch(fc=_REMARK, ec=_REMARK, label="Theorem 1 and Remark 1", **patch),
        Patch(fc=_PROOF, ec=_PROOF, label="proved by the paper's $V$", **patch),
        Line2D(
            [], [], color=_LOOP, lw=2.2, label="this sampled loop: stable left of it"
        ),
        Line2D([], [], color=_LOOP, lw=1.4, ls="--", label="the same, gain margin 2"),
        Line2D([], [], label="these gains", **own),
    ]
    ax.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(-0.08, 1.02), fontsize=9
    )
    text = "Published gains, robot: $k_p$, $k_c$ [1/s]\n" + "\n".join(names)
    ax.text(-0.05, 0.72, text, va="top", fontsize=8.0, linespacing=1.5)


def _title(certificate: Certificate, name: str) -> str:
    words = [literal(name)] if name else []
    words.append(rf"$\omega_n$ = {certificate.pendulum.omega:.2f} rad/s")
    return ", ".join([*words, text_of_loop(certificate.loop)])


_COLORS = ("#0072B2", "#D55E00")
_NAMES = ("CoM", "ZMP")
_UNCLEAR = 0.3  # deviation over size beyond which there is no phase to draw [-]
_STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DADADA",
    "legend.frameon": False,
    "savefig.dpi": DPI,
}


def plot_identified(found: Identified, title: str, path: str | Path | None) -> Figure:
    """Draw the measured and the fitted responses of both axes.

    Args:
        found: What was identified.
        title: Title of the picture.
        path: Where to write it; not written if None.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(9.0, 6.2), layout="constrained")
        panels: Any = figure.subplots(2, 2, sharex=True, sharey="row")
        for k, (data, fit) in enumerate(zip(found.measured, found.axes, strict=True)):
            _size(panels[0, k], data, fit)
            _phase(panels[1, k], data, fit)
            panels[0, k].set_title(f"{'xy'[k]}: {_words(fit)}")
            panels[1, k].set_xlabel("frequency [Hz]")
        panels[0, 0].set_ylabel("size [-]")
        panels[1, 0].set_ylabel("phase [deg]")
        panels[0, 1].legend(loc="lower left", fontsize=9)
        dead = found.dead_time
        figure.suptitle(
            f"{literal(title)}: what CoM and ZMP answer to the commanded CoM; "
            f"dead time {1e3 * dead.value:.1f} $\\pm$ {1e3 * dead.deviation:.1f} ms",
            fontsize=11,
        )
    return write_figure(figure, path)


def _words(fit: ResponseFit) -> str:
    text = f"lag {1e3 * fit.lag.value:.1f} $\\pm$ {1e3 * fit.lag.deviation:.1f} ms"
    if fit.frequency is None or fit.damping is None:
        return text
    return f"{text}, mode {fit.frequency.value:.2f} Hz, damping {fit.damping.value:.2f}"


def _curve(data: Responses) -> np.ndarray:
    """Return the frequencies to draw a fit at [Hz]."""
    return np.geomspace(data.frequencies.min(), data.frequencies.max(), 300)


def _size(ax: Axes, data: Responses, fit: ResponseFit) -> None:
    """Draw sizes: dots as measured, with two deviations, and the fit as a line."""
    f = _curve(data)
    for k, (color, name) in enumerate(zip(_COLORS, _NAMES, strict=True)):
        ax.errorbar(
            data.frequencies,
            np.abs(data.values[k]),
            2.0 * data.deviations[k],
            fmt="o",
            ms=3.5,
            color=color,
            elinewidth=1.0,
            label=f"{name}, measured",
        )
        ax.plot(f, np.abs(fit.at(f)[k]), color=color, lw=1.3, label=f"{name}, fitted")
    if fit.frequency is not None:
        ax.axvline(fit.frequency.value, color="#999999", lw=0.9, ls=":")
    ax.set_xscale("log")
    ax.set_yscale("log")


def _phase(ax: Axes, data: Responses, fit: ResponseFit) -> None:
    """Draw phases, continuous along the fit, where noise leaves one."""
    f = _curve(data)
    for k, color in enumerate(_COLORS):
        line = np.degrees(np.unwrap(np.angle(fit.at(f)[k])))
        near = np.interp(data.frequencies, f, line)
        dots = np.degrees(np.angle(data.values[k]))
        dots += 360.0 * np.round((near - dots) / 360.0)
        clear = data.deviations[k] < _UNCLEAR * np.abs(data.values[k])
        ax.plot(data.frequencies[clear], dots[clear], "o", ms=3.5, color=color)
        ax.plot(f, line, color=color, lw=1.3)
    ax.set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
    ax.minorticks_off()
