"""The paper's figures: pattern (Fig. 3), arms (5), dance (6) and walk (7).

All are drawn with matplotlib's objects, without its global state.
"""

from __future__ import annotations

import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from ..embedding import EmbeddedMotion
from ..errors import RunError, utf8
from ..runs import RunData, Source, data_of, outcome_text
from .charts import Band, Chart
from .run_charts import error_chart, motion_chart, padded_span
from .scene_data import scene_of

DPI = 150
"""Resolution of pictures [dots/inch]."""

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#B0609A"
_SKY, _YELLOW, _BROWN, _INK, _GREY = "#56B4E9", "#E69F00", "#7A4A21", "#222222", "#777"
_CYCLE = (_BLUE, _ORANGE, _GREEN, _PURPLE, _YELLOW, _SKY, _BROWN, _INK, _GREY)
STYLE: dict[Any, Any] = {
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "mathtext.fontset": "stix",
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.edgecolor": "#999999",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DADADA",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
    "legend.fontsize": 10.0,
    "legend.handlelength": 2.2,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "savefig.dpi": DPI,
}
"""Style of all figures, for `matplotlib.rc_context`."""
_DASHED = (0, (4, 2))
_XY = (0, 1)
_SIDE_COLORS = {"left": "#E3EEF8", "right": "#FBEBDD"}
_LINES: dict[str, dict[str, Any]] = {
    "zmp": {"color": _ORANGE, "lw": 1.2},
    "com": {"color": _BLUE, "lw": 1.8},
    "ref-zmp": {"color": "#7A3300", "lw": 1.0, "ls": _DASHED},
    "ref-com": {"color": "#00304D", "lw": 1.0, "ls": _DASHED},
}
"""How a curve of a chart is drawn, by its kind."""


class Row(NamedTuple):
    """One quantity of a figure, as the paper states it and as it came out."""

    quantity: str
    """What it is; may hold mathematics such as `$K_x$`."""
    paper: str
    """The paper's figure, or "-"."""
    ours: str
    """Our figure."""
    unit: str = ""
    """Unit of both."""


@contextmanager
def _page(
    width: float,
    height: float,
    table: Sequence[Row] = (),
    layout: Any = "constrained",
) -> Generator[tuple[Figure, Figure | SubFigure]]:
    """Make a figure in the style of all figures.

    Args:
        width: Width [inch].
        height: Height without the table [inch].
        table: Rows of a table below, if any.
        layout: Engine of the layout; None to place all by hand.

    Yields:
        The figure, and the part of it above the table to draw on.
    """
    with matplotlib.rc_context(STYLE):
        columns = max(1, round(width / 4.5)) if len(table) > 5 else 1
        low = 0.23 * (_table_lines(table, columns) + 1.5) if table else 0.0
        figure = Figure(figsize=(width, height + low), layout=layout)
        if not table:
            yield figure, figure
            return
        parts: Any = figure.subfigures(2, 1, height_ratios=[height, low])
        page, foot = parts
        _add_table(foot, table, columns)
        yield figure, page


def write_figure(figure: Figure, path: str | Path | None) -> Figure:
    """Write a figure to a file.

    Args:
        figure: The figure.
        path: The file; its ending gives the format, .png, .pdf or .svg. None writes
            nothing.

    Returns:
        The same figure.

    Raises:
        RunError: If the file cannot be written.
    """
    if path is None:
        return figure
    try:
        with matplotlib.rc_context(STYLE), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing")  # drawn as a box
            parts = [figure, *figure.subfigs]
            title = "".join(part.get_suptitle() for part in parts)
            figure.savefig(path, dpi=DPI, metadata={"Title": title})
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"cannot write the figure {path}: {reason}") from None
    except ValueError:
        raise RunError(
            f"cannot write the figure {path}: its name must end in .png, .pdf or .svg"
        ) from None
    return figure


def _add_table(panel: SubFigure, rows: Sequence[Row], columns: int) -> None:
    """Write what the paper states, and ours, as a small table in columns."""
    style: dict[str, Any] = {"fontsize": 9.5, "math_fontfamily": "stix"}
    count = _table_lines(rows, columns)
    for c in range(columns):
        part = rows[c * count : (c + 1) * count]
        for k, row in enumerate([Row("", "paper", "comwalk"), *part]):
            y = 1.0 - (k + 0.5) / (count + 1.5)
            color = _GREY if k == 0 else _INK
            cells = (row.quantity, row.paper, f"{row.ours} {row.unit}".strip())
            for x, text in zip((0.04, 0.60, 0.76), cells, strict=True):
                place = (c + x) / columns
                panel.text(place, y, text, va="center", color=color, **style)


def _table_lines(rows: Sequence[Row], columns: int) -> int:
    return -(-len(rows) // columns)


# ---- Fig. 7: a walk ---------------------------------------------------------------


def plot_run(
    run: Source, path: str | Path | None = None, *, table: Sequence[Row] = ()
) -> Figure:
    """Draw CoM and ZMP of a run, desired and actual, as in Fig. 7.

    Above, x and y over time with the supporting foot shaded; below, the errors in mm.
    A long run has its middle, or its fall, enlarged on the right.

    Args:
        run: What `simulate` returned, or its folder.
        path: Where to write a picture; not written if None.
        table: Rows of a small table to write below.

    Returns:
        The figure.

    Raises:
        RunError: If the run cannot be read, or the picture cannot be written.
    """
    data = data_of(run)
    charts = [
        kind([data], data.t, i) for kind in (motion_chart, error_chart) for i in _XY
    ]
    detail = _detail(data, charts[0].bands)
    layout = "constrained" if table else None
    with _page(12.0 if detail else 9.0, 9.2, table, layout) as (figure, page):
        axes = page.subplots(
            4,
            2 if detail else 1,
            sharex="col",
            squeeze=False,
            height_ratios=(1.25, 1.25, 0.8, 0.8),
            width_ratios=(1.7, 1.0) if detail else None,
        )
        for column, span in zip(axes.T, [None, detail], strict=False):
            _run_column(column, data, charts, span)
        page.suptitle(_run_title(data), x=0.01, ha="left", fontsize=11.5)
        _run_legend(page, axes[0, 0])
        page.align_ylabels(axes)
        if not table:  # places that fit, since to search them takes a second
            sides = {"left": 0.09, "right": 0.99, "bottom": 0.1, "top": 0.92}
            figure.subplots_adjust(**sides, hspace=0.16, wspace=0.24)
    return write_figure(figure, path)


def _detail(data: RunData, bands: Sequence[Band]) -> tuple[float, float] | None:
    """Return the time span to enlarge [s]: two steps in the middle, or the end."""
    end = float(data.t[-1])
    if end < 8.0 or len(bands) < 4:
        return None
    if not data.ok:
        return end - 3.0, end
    (first, lifted, _), (last, landed, _) = bands[len(bands) // 2 - 1 :][:2]
    pad = 0.5 * (last - lifted)
    return first - 2.0 * pad, landed + 2.0 * pad


def _run_column(
    axes: Sequence[Axes],
    data: RunData,
    charts: Sequence[Chart],
    span: tuple[float, float] | None,
) -> None:
    """Draw x, y and both errors into four axes."""
    t, rows = data.t, slice(None)
    if span is not None:
        rows = slice(*np.searchsorted(t, span).tolist())
    begin, end = span or (float(t[0]), float(t[-1]))
    for i, (ax, chart) in enumerate(zip(axes, charts, strict=True)):
        _draw(ax, chart, rows, begin, end)
        unit = f"{'xy'[i % 2]} [{chart.unit}]"
        ax.set_ylabel(unit if i < 2 else f"desired - actual\n{unit}")
        if not data.ok:
            ax.axvline(data.summary["time_s"], color=_INK, lw=1.5, ls=":")
    for ax in axes[2:]:
        ax.axhline(0.0, color=_GREY, lw=0.8)
    axes[-1].set_xlabel("t [s]" if span is None else "t [s], enlarged")
    margin = 1e-3 if data.ok else 0.02 * (end - begin) + 1e-3
    axes[0].set_xlim(begin, end + margin)


def _draw(ax: Axes, chart: Chart, rows: slice, begin: float, end: float) -> None:
    """Draw the curves of a chart, and its bands from one time to another [s]."""
    for start, stop, side in chart.bands:
        low, high = max(start, begin), min(stop, end)
        if low < high:
            ax.axvspan(low, high, color=_SIDE_COLORS[side], lw=0, zorder=0)
    for curve in chart.curves:
        style = _LINES[curve.kind]
        ax.plot(chart.t[rows], curve.values[rows], label=curve.label, **style)
    planned = [c.values[rows] for c in chart.curves if c.kind.startswith("ref")]
    span = padded_span(planned) if planned else chart.span
    if span is not None and np.isfinite(span).all():
        ax.set_ylim(*span)


def literal(name: str) -> str:
    """Return a name that matplotlib draws as it is, not as a formula."""
    return utf8(name).replace("$", r"\$")


def _run_title(data: RunData) -> str:
    """Return the outcome and the main figures in two lines."""
    figures, robot = data.summary, data.settings.get("robot")
    name = "simplified model" if robot is None else f'robot "{literal(robot)}"'
    com = figures["com_error_rms_mm"]
    kind = "true" if "true" in com else "measured"
    com, zmp = com[kind], figures["zmp_error_rms_mm"]
    steps = f"{figures['steps_completed']}/{figures['steps_planned']} steps"
    gap = " " if data.ok else "\n"
    return (
        f"{name}, {steps}, {figures['distance_m']:.2f} m:{gap}{outcome_text(figures)}\n"
        f"rms errors x, y: CoM ({kind}) {com['x']:.1f}, {com['y']:.1f} mm;  "
        f"ZMP {zmp['x']:.1f}, {zmp['y']:.1f} mm"
    )


def _run_legend(page: Figure | SubFigure, ax: Axes) -> None:
    """Put one legend for both axes below the panels."""
    handles, labels = ax.get_legend_handles_labels()
    handles += [Patch(color=color) for color in _SIDE_COLORS.values()]
    labels += ["left foot", "right foot supports"]
    place = "outside lower center" if page.get_layout_engine() else "lower center"
    page.legend(handles, labels, loc=place, ncols=len(labels))


# ---- Figs. 5 and 6: a dance -------------------------------------------------------


def plot_arms(
    source: EmbeddedMotion | Source,
    path: str | Path | None = None,
    *,
    table: Sequence[Row] = (),
) -> Figure:
    """Draw the joints of the arms over time, as in Fig. 5.

    Args:
        source: A motion as it will be played; or a run, whose set-points are dashed.
        path: Where to write a picture; not written if None.
        table: Rows of a small table to write below.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written, or no arm, waist or head moved.
    """
    embedded = isinstance(source, EmbeddedMotion)
    t, curves = _motion_joints(source) if embedded else _run_joints(data_of(source))
    groups: dict[str, list[str]] = {}
    for joint in curves:
        side = _SIDES.get(joint.lower()[:2], "waist and head")
        groups.setdefault(side, []).append(joint)
    with _page(9.0, 0.6 + 2.2 * len(groups), table) as (figure, page):
        axes = page.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for ax, side in zip(axes, sorted(groups), strict=True):
            for color, joint in zip(_CYCLE * 9, groups[side], strict=False):
                actual, desired = curves[joint]
                ax.plot(t, actual, color=color, label=literal(joint))
                if desired is not None:
                    ax.plot(t, desired, color=_INK, lw=0.9, ls=_DASHED)
            ax.set_title(side)
            ax.set_ylabel("angle [rad]")
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9)
        dashed = "" if embedded else "; dashed: set-points"
        axes[-1].set_xlabel(f"t [s]{dashed}")
        axes[-1].set_xlim(float(t[0]), float(t[-1]))
    return write_figure(figure, path)


_SIDES = {"l_": "left arm", "r_": "right arm"}
_Curves = dict[str, tuple[np.ndarray, np.ndarray | None]]


def _motion_joints(motion: EmbeddedMotion) -> tuple[np.ndarray, _Curves]:
    """Return times and the angles of a motion's joints."""
    end = motion.stop
    if not np.isfinite(end):
        end = motion.start + motion.blend + 3.0 * motion.motion.duration
    t = np.linspace(motion.start, end, 1000)
    angles = np.array([motion.at(s)[0] for s in t.tolist()])
    return t, {name: (angles[:, j], None) for j, name in enumerate(motion.joints)}


def _run_joints(data: RunData) -> tuple[np.ndarray, _Curves]:
    """Return times and the moving joints outside the legs: actual and set-points."""
    model, columns = scene_of(data), data.columns
    angles, targets, legs = columns["joints"], columns["joint_set_points"], set()
    for side in ("l_sole", "r_sole"):
        body = int(model.site(side).bodyid[0])
        while body:
            legs |= {
                model.joint(j).name
                for j in range(model.njnt)
                if model.jnt_bodyid[j] == body
            }
            body = int(model.body_parentid[body])
    names = [model.joint(j + 1).name for j in range(angles.shape[1])]
    curves: _Curves = {
        name: (angles[:, j], targets[:, j])
        for j, name in enumerate(names)
        if name not in legs and np.ptp(targets[:, j]) > 0.02
    }
    if not curves:
        raise RunError("no joint of the upper body moved; choose a motion by --motion")
    return data.t, curves


def plot_dance(
    run: Source,
    path: str | Path | None = None,
    *,
    without: Source | None = None,
    table: Sequence[Row] = (),
) -> Figure:
    """Draw how far CoM and ZMP leave their place in a dance, as in Fig. 6.

    Args:
        run: The dance, or its folder.
        path: Where to write a picture; not written if None.
        without: The same dance with a resolution that ignores the arms, to compare.
        table: Rows of a small table to write below.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    data = data_of(run)
    with _page(9.0, 7.0, table) as (figure, page):
        x, y, z = page.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 0.5))
        y.sharey(x)
        for i, ax in enumerate((x, y, z)):
            if without is not None:
                _offsets(
                    ax, data_of(without), i, (_YELLOW, _PURPLE), ", ignoring the arms"
                )
            _offsets(ax, data, i, (_ORANGE, _BLUE), "")
            ax.set_ylabel(f"{'xyz'[i]} - start [mm]")
        for ax in (x, y):
            _paper_band(ax)
        z.set_xlabel("t [s]")
        z.set_xlim(0.0, float(data.t[-1]))
        low, high = z.get_ylim()
        z.set_ylim(min(low, -1.0), max(high, 1.0))
        page.suptitle(
            f"Dance: {outcome_text(data.summary)}", x=0.01, ha="left", fontsize=11.5
        )
        page.legend(*x.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        page.align_ylabels((x, y, z))
    return write_figure(figure, path)


def _paper_band(ax: Axes) -> None:
    """Shade the bounds that the paper states for the ZMP of its dance."""
    ax.axhspan(-10.0, 10.0, color="#EEF3EE", lw=0, zorder=0)
    place = ax.get_yaxis_transform()
    text = "paper: ZMP within about $\\pm$10 mm"
    ax.text(0.004, 10.2, text, va="bottom", color=_GREY, fontsize=9, transform=place)


def _offsets(
    ax: Axes, data: RunData, i: int, colors: tuple[str, str], label: str
) -> None:
    """Draw CoM and ZMP of one axis from where the CoM began [mm]."""
    start = data.columns["com_ref"][0, i]
    if i < 2:
        zmp = 1e3 * (data.columns["zmp_filtered"][:, i] - start)
        ax.plot(data.t, zmp, color=colors[0], lw=1.2, label=f"ZMP{label}")
    offset = 1e3 * (data.com[:, i] - start)
    ax.plot(data.t, offset, color=colors[1], lw=1.8, label=f"CoM{label}")
