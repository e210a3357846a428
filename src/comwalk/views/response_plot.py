"""The picture of an identification: measured responses and the model fitted to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..certificates.identification import Identified, ResponseFit, Responses
from .matplotlib_figures import DPI, write_figure

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
            f"{title}: what CoM and ZMP answer to the commanded CoM; dead time "
            f"{1e3 * dead.value:.1f} $\\pm$ {1e3 * dead.deviation:.1f} ms",
            fontsize=11,
        )
    return write_figure(figure, path)


def _words(fit: ResponseFit) -> str:
    """Return the lag and the mode of a fit."""
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
