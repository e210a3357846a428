"""Curves over time as HTML: sharp at any width, without scripts, small enough to mail.

A chart is an SVG that stretches with the page and ticks that do not. Its curves are
stored as whole numbers relative to each other, from which the script of a page can
read any value back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

import numpy as np

_STEPS = 4000  # vertical resolution of a chart
_POINTS_PER_SECOND, _FEWEST, _MOST = 60.0, 300, 4000
_SHORTEST = 0.1  # what a chart covers at least, for a run of one row [s]


Band = tuple[float, float, str]
"""A shaded time: start [s], end [s], style sheet class (left, right)."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a chart."""

    label: str
    """What it is."""
    kind: str
    """Its style sheet class: com, zmp, ref-com, ref-zmp, left, right, line."""
    values: np.ndarray
    """One value per time; not a number where there is none, of shape (n,)."""
    other: bool = False
    """Whether it is of the second of two runs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Chart:
    """Curves over the same times."""

    title: str
    """What is shown."""
    unit: str
    """Unit of the values."""
    t: np.ndarray
    """Evenly spaced times [s], of shape (n,)."""
    curves: Sequence[Curve]
    """What is drawn, the last one on top."""
    span: tuple[float, float] | None = None
    """Range of values to show; that of all curves if None."""
    bands: Sequence[Band] = ()
    """Shaded times."""


def chart_style() -> str:
    """Return the style sheet of charts."""
    return _web("charts.css")


def page_style() -> str:
    """Return the style sheet of pages, that of charts included."""
    return chart_style() + _web("page.css")


def page_script() -> str:
    """Return the script of pages."""
    return _web("page.js")


def _web(name: str) -> str:
    return files("comwalk").joinpath("views", "web", name).read_text(encoding="utf-8")


def chart_times(first: float, last: float) -> np.ndarray:
    """Return evenly spaced times for a chart, as many as can be told apart.

    Args:
        first: First time [s].
        last: Last time [s].

    Returns:
        Times [s].
    """
    last = max(last, first + _SHORTEST)
    count = np.clip((last - first) * _POINTS_PER_SECOND, _FEWEST, _MOST)
    return np.linspace(first, last, int(count))


def on_times(times: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at other times, by straight lines.

    Args:
        times: Where they are wanted [s].
        t: Times of the values [s], rising.
        values: Of shape (n,).

    Returns:
        Values; not a number before the first and after the last.
    """
    outside = (times < t[0] - 1e-9) | (times > t[-1] + 1e-9)
    found = np.interp(times, t, values.astype(float))
    found[outside] = math.nan
    return found


def chart_html(chart: Chart) -> str:
    """Return a chart as HTML.

    Args:
        chart: What to draw.

    Returns:
        A `figure` element.
    """
    low, high, ticks = _axis(chart)
    first, last, width = float(chart.t[0]), float(chart.t[-1]), len(chart.t) - 1
    keys = "".join(
        f'<span class="cw-key {_kind(c)}"><i></i>{escape(c.label)}<output></output>'
        "</span>"
        for c in chart.curves
    )
    parts = [
        *(_band(b, first, last, width) for b in chart.bands),
        *(_level(tick, low, high, width) for tick in ticks),
        *(_curve(c, low, high) for c in chart.curves),
    ]
    return (
        f'<figure class="cw-chart" data-t0="{first:.6g}" data-t1="{last:.6g}" '
        f'data-low="{low:.9g}" data-high="{high:.9g}" data-unit="{escape(chart.unit)}">'
        f"<figcaption><b>{escape(chart.title)}</b>"
        f" <small>[{escape(chart.unit)}]</small> {keys}</figcaption>"
        f'<div class="cw-plot"><svg viewBox="0 0 {width} {_STEPS}" '
        f'preserveAspectRatio="none" role="img" aria-label="{escape(chart.title)}">'
        f"{''.join(parts)}</svg>{_labels(ticks, low, high, first, last)}</div></figure>"
    )


def nice_ticks(low: float, high: float, count: int) -> list[float]:
    """Return round numbers in a range.

    Args:
        low: Smallest.
        high: Largest.
        count: About how many.

    Returns:
        Multiples of 1, 2 or 5 times a power of ten.

    Example:
        >>> nice_ticks(-0.3, 1.2, 4)
        [0.0, 0.5, 1.0]
    """
    raw = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= 0.7 * raw)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(k * step, 12) for k in range(first, last + 1)]


def _axis(chart: Chart) -> tuple[float, float, list[float]]:
    """Return the range of values, a little wider than needed, and its ticks."""
    if chart.span is not None:
        low, high = chart.span
    else:
        values = np.concatenate([c.values for c in chart.curves])
        values = values[np.isfinite(values)]
        low, high = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    low, high = float(low), float(high)
    pad = 0.06 * (high - low) or max(1e-3, 0.1 * abs(high))
    low, high = low - pad, high + pad
    return low, high, nice_ticks(low, high, 4)


def _kind(curve: Curve | Trace) -> str:
    return f"cw-{curve.kind}{' cw-other' if curve.other else ''}"


def _curve(curve: Curve, low: float, high: float) -> str:
    """Return a curve as a path of whole numbers, each point seen from the last."""
    seen = np.flatnonzero(np.isfinite(curve.values))
    values = np.clip(curve.values[seen], 2 * low - high, 2 * high - low)
    y = np.round(_STEPS * (high - values) / (high - low)).astype(int)
    words, last, height = [], -2, 0
    for k, v in zip(seen.tolist(), y.tolist(), strict=True):
        words.append(f"l1 {v - height}" if k == last + 1 else f"M{k} {v}")
        last, height = k, v
    return f'<path class="{_kind(curve)}" d="{"".join(words)}"/>'


def _band(band: Band, first: float, last: float, width: int) -> str:
    """Return shaded times."""
    scale = width / (last - first)
    a, b = ((min(max(x, first), last) - first) * scale for x in band[:2])
    return (
        f'<rect class="cw-band-{band[2]}" x="{a:.1f}" y="0" width="{b - a:.1f}" '
        f'height="{_STEPS}"/>'
    )


def _level(value: float, low: float, high: float, width: int) -> str:
    y = round(_STEPS * (high - value) / (high - low))
    kind = "cw-zero" if value == 0.0 else "cw-grid"
    return f'<path class="{kind}" d="M0 {y}h{width}"/>'


def _labels(
    ticks: Sequence[float], low: float, high: float, first: float, last: float
) -> str:
    """Return the numbers at both axes."""
    spots = [
        f'<span class="cw-y" style="top:{100 * (high - v) / (high - low):.2f}%">'
        f"{v:g}</span>"
        for v in ticks
    ]
    spots += [
        f'<span class="cw-x" style="left:{100 * (v - first) / (last - first):.2f}%">'
        f"{v:g}</span>"
        for v in nice_ticks(first, last, 8)
    ]
    return "".join(spots)


# ---- Seen from above --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Trace:
    """A path on the ground."""

    label: str
    """What it is."""
    kind: str
    """Its style sheet class, as that of a `Curve`."""
    t: np.ndarray
    """Evenly spaced times [s], of shape (n,)."""
    points: np.ndarray
    """Where it was [m], of shape (n, 2)."""
    other: bool = False
    """Whether it is of the second of two runs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TopView:
    """Paths on the ground among footprints."""

    soles: Sequence[tuple[np.ndarray, str]]
    """Corners [m], of shape (k, 2), and style sheet class (left, right)."""
    paths: Sequence[Trace]
    """What is drawn, the last one on top."""


def top_view_html(view: TopView) -> str:
    """Return a view from above as HTML, x to the right and y up, to scale.

    Args:
        view: What to draw.

    Returns:
        A `figure` element.
    """
    known = [corners for corners, _ in view.soles] or [p.points for p in view.paths]
    low = np.min([np.nanmin(p, axis=0) for p in known], axis=0) - 0.05
    high = np.max([np.nanmax(p, axis=0) for p in known], axis=0) + 0.05
    width, height = np.round(1000.0 * (high - low)).astype(int).tolist()

    def place(points: np.ndarray) -> str:
        """Return points [m] as those of an SVG, in mm from the upper left corner."""
        spots = 1000.0 * np.abs(points - (low[0], high[1]))
        return " ".join(f"{x:.0f},{y:.0f}" for x, y in np.clip(spots, 0, 1e6))

    parts = [
        f'<polygon class="cw-sole-{kind}" points="{place(sole)}"/>'
        for sole, kind in view.soles
    ]
    parts += [_trace(trace, place) for trace in view.paths]
    keys = [
        f'<span class="cw-key {_kind(p)}"><i></i>{escape(p.label)}</span>'
        for p in view.paths
    ]
    title = "<b>Seen from above</b> <small>[m], x to the right</small>"
    return (
        f'<figure class="cw-top"><figcaption>{title} {"".join(keys)}</figcaption>'
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="Footprints, CoM '
        f'and ZMP from above">{"".join(parts)}</svg></figure>'
    )


def _trace(trace: Trace, place: Callable[[np.ndarray], str]) -> str:
    """Return a path on the ground."""
    points = trace.points[np.isfinite(trace.points).all(axis=1)]
    rows = np.unique(np.linspace(0, len(points) - 1, 1500).astype(int))
    return (
        f'<polyline class="{_kind(trace)}" data-t0="{trace.t[0]:.6g}" '
        f'data-t1="{trace.t[-1]:.6g}" points="{place(points[rows])}"/>'
    )
