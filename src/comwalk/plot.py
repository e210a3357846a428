"""The paper's figures: pattern (Fig. 3), arms (5), dance (6) and walk (7).

All are drawn with matplotlib's objects, without its global state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from .errors import RunError
from .footsteps import foot_poses
from .motion import EmbeddedMotion
from .pattern import Pattern, Phase
from .polygon import rectangle
from .summary import summarize

if TYPE_CHECKING:
    from .run import Run

DPI = 150
"""Resolution of pictures [dots/inch]."""

_BLUE, _ORANGE, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#B0609A"
_SKY, _YELLOW, _BROWN, _INK, _GREY = "#56B4E9", "#E69F00", "#7A4A21", "#222222", "#777"
_CYCLE = (_BLUE, _ORANGE, _GREEN, _PURPLE, _YELLOW, _SKY, _BROWN, _INK, _GREY)
_SINGLES = {Phase.SINGLE_LEFT: "#E3EEF8", Phase.SINGLE_RIGHT: "#FBEBDD"}
_STYLE = {
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
_AXES = ("x", "y")
_DASHED = (0, (4, 2))
_LINES: dict[str, dict[str, Any]] = {
    "zmp_filtered": {"color": _ORANGE, "lw": 1.2, "label": "ZMP $p_i$"},
    "com": {"color": _BLUE, "lw": 1.8, "label": "CoM $c_i$"},
    "com_true": {"color": _SKY, "lw": 1.3, "label": "CoM, true"},
    "zmp_ref": {"color": "#7A3300", "lw": 1.0, "ls": _DASHED, "label": "$p_i^d$"},
    "com_ref": {"color": "#00304D", "lw": 1.0, "ls": _DASHED, "label": "$c_i^d$"},
}


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
def _figure(width: float, height: float) -> Iterator[Figure]:
    """Make a figure of a size [inch], in the style of all figures."""
    with matplotlib.rc_context(_STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


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
        with matplotlib.rc_context(_STYLE):
            figure.savefig(path, dpi=DPI)
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"cannot write the figure {path}: {reason}") from None
    except ValueError:
        raise RunError(
            f"cannot write the figure {path}: its name must end in .png, .pdf or .svg"
        ) from None
    return figure


def add_table(figure: Figure, rows: Sequence[Row]) -> Figure:
    """Add a small table below a figure: what the paper states, and ours.

    Args:
        figure: A figure of this module; it grows by the table's height.
        rows: The quantities.

    Returns:
        The same figure.
    """
    width, height = figure.get_size_inches()
    extra = 0.24 * (len(rows) + 1) + 0.2
    total = height + extra
    figure.set_size_inches(width, total)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0.0, extra / total, 1.0, height / total))  # type: ignore
    lines = [Row("", "paper", "comwalk"), *rows]
    for k, row in enumerate(lines):
        y = (extra - 0.1 - 0.24 * (k + 0.5)) / total
        style: dict[str, Any] = {"fontsize": 9.5, "va": "center", "in_layout": False}
        style |= {"color": _GREY if k == 0 else _INK, "math_fontfamily": "stix"}
        cells = (row.quantity, row.paper, f"{row.ours} {row.unit}".strip())
        for x, text in zip((0.07, 0.55, 0.72), cells, strict=True):
            figure.text(x, y, text, **style)
    return figure


# ---- Fig. 7: a walk ---------------------------------------------------------------


def plot_run(run: Run, path: str | Path | None = None) -> Figure:
    """Draw CoM and ZMP of a run, desired and actual, as in Fig. 7.

    Above, x and y over time with the supporting foot shaded; below, the errors in mm.
    A long run has its middle, or its fall, enlarged on the right.

    Args:
        run: What `simulate` returned.
        path: Where to write a picture; not written if None.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    detail = _detail(run)
    with _figure(12.0 if detail else 9.0, 9.2) as figure:
        axes = figure.subplots(
            4,
            2 if detail else 1,
            sharex="col",
            squeeze=False,
            height_ratios=(1.25, 1.25, 0.8, 0.8),
            width_ratios=(1.7, 1.0) if detail else None,
        )
        for column, span in zip(axes.T, [None, detail], strict=False):
            _run_column(column, run, span)
        figure.suptitle(_run_title(run), x=0.01, ha="left", fontsize=11.5)
        _run_legend(figure, axes[0, 0])
        figure.align_ylabels(axes)
    return write_figure(figure, path)


def _detail(run: Run) -> tuple[float, float] | None:
    """Return the time span to enlarge [s]: two steps in the middle, or the end."""
    end = float(run.log["t"][-1])
    spans = run.pattern.phases
    singles = [s for s in spans if s.phase in _SINGLES and s.start < end]
    if end < 8.0 or len(singles) < 4:
        return None
    if not run.outcome.ok:
        return end - 3.0, end
    middle = singles[len(singles) // 2 - 1 : len(singles) // 2 + 1]
    first, last = middle[0], middle[-1]
    pad = 0.5 * (last.start - first.start - first.duration)
    return first.start - 2.0 * pad, last.start + last.duration + 2.0 * pad


def _run_column(
    axes: Sequence[Axes], run: Run, span: tuple[float, float] | None
) -> None:
    """Draw x, y and both errors into four axes."""
    t, rows = run.log["t"], slice(None)
    if span is not None:
        rows = slice(*np.searchsorted(t, span).tolist())
    for i in range(2):
        _com_and_zmp(axes[i], run, i, rows)
    for ax in axes:
        _shade(ax, run.pattern, *(span or (float(t[0]), float(t[-1]))))
        if not run.outcome.ok:
            ax.axvline(run.outcome.time, color=_INK, lw=1.2, ls=":")
    for i, ax in enumerate(axes[2:]):
        _errors(ax, run, i, rows)
    axes[-1].set_xlabel("t [s]" if span is None else "t [s], enlarged")
    axes[0].set_xlim(span or (float(t[0]), max(float(t[-1]), float(t[0]) + 1e-3)))


def _com_and_zmp(ax: Axes, run: Run, i: int, rows: slice) -> None:
    """Draw CoM and ZMP of one axis."""
    log, n, t = run.log, _AXES[i], run.log["t"][rows]
    ax.plot(t, log["zmp_filtered"][rows, i], color=_ORANGE, label=f"$p_{n}$", lw=1.3)
    ax.plot(t, log["com"][rows, i], color=_BLUE, label=f"$c_{n}$", lw=1.8)
    if "com_true" in log:
        true = log["com_true"][rows, i]
        ax.plot(t, true, color=_SKY, label=f"$c_{n}$ true", lw=1.3)
    dashed: dict[str, Any] = {"ls": (0, (4, 2)), "lw": 1.0}
    ax.plot(t, log["zmp_ref"][rows, i], color="#7A3300", label=f"$p_{n}^d$", **dashed)
    ax.plot(t, log["com_ref"][rows, i], color="#00304D", label=f"$c_{n}^d$", **dashed)
    ax.set_ylabel(f"{n} [m]")
    ends = [
        log[c][rows, i] for c in ("zmp_ref", "com_ref", "com", "com_true") if c in log
    ]
    low, high = min(a.min() for a in ends), max(a.max() for a in ends)
    pad = 0.25 * (high - low) + 0.01
    if np.isfinite([low, high]).all():
        ax.set_ylim(low - pad, high + pad)


def _errors(ax: Axes, run: Run, i: int, rows: slice) -> None:
    """Draw the errors of CoM and ZMP of one axis in mm."""
    log, t = run.log, run.log["t"][rows]
    references = {"zmp_filtered": "zmp_ref_filtered"}
    for column in ("zmp_filtered", "com", "com_true"):
        if column in log:
            desired = log[references.get(column, "com_ref")][rows, i]
            error = 1e3 * (desired - log[column][rows, i])
            ax.plot(t, error, **_LINES[column])
    ax.axhline(0.0, color=_GREY, lw=0.8)
    ax.set_ylabel(f"desired - actual\n{_AXES[i]} [mm]")


def _shade(ax: Axes, pattern: Pattern, begin: float, end: float) -> None:
    """Shade the single supports."""
    for span in pattern.phases:
        start, stop = max(span.start, begin), min(span.start + span.duration, end)
        if span.phase in _SINGLES and start < stop:
            ax.axvspan(start, stop, color=_SINGLES[span.phase], lw=0, zorder=0)


def _run_title(run: Run) -> str:
    """Return the outcome and the main figures in two lines."""
    figures = summarize(run.log, run.pattern, run.outcome, run.seconds)
    name = "simplified model" if run.robot is None else f'robot "{run.robot.name}"'
    com = figures["com_error_rms_mm"]
    kind = "true" if "true" in com else "measured"
    com, zmp = com[kind], figures["zmp_error_rms_mm"]
    steps = f"{figures['steps_completed']}/{figures['steps_planned']} steps"
    return (
        f"{name}, {steps}, {figures['distance_m']:.2f} m: {run.outcome}\n"
        f"rms errors x, y: CoM ({kind}) {com['x']:.1f}, {com['y']:.1f} mm;  "
        f"ZMP {zmp['x']:.1f}, {zmp['y']:.1f} mm"
    )


def _run_legend(figure: Figure, ax: Axes) -> None:
    """Put one legend for both axes below the panels."""
    handles, labels = ax.get_legend_handles_labels()
    handles += [Patch(color=_SINGLES[phase]) for phase in _SINGLES]
    labels += ["left foot", "right foot supports"]
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


# ---- Fig. 3: the pattern ----------------------------------------------------------


class _Steps(NamedTuple):
    """Two steps of a pattern, seen from the middle of the feet before them."""

    t: np.ndarray  # [s] from the middle of the double support
    com: np.ndarray  # [m], (k, 2)
    zmp: np.ndarray  # [m], (k, 2)
    T: float  # [s]
    t_d: float  # [s]
    side: float  # +1 if the left foot supports first


def plot_pattern(pattern: Pattern, path: str | Path | None = None) -> Figure:
    """Draw a pattern: two steps in the middle as in Fig. 3, and the footprints.

    Args:
        pattern: What to draw.
        path: Where to write a picture; not written if None.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    samples = pattern.sample(np.linspace(0.0, pattern.duration, 2000))
    steps = _middle_steps(pattern)
    with _figure(10.5, 6.4 if steps is not None else 3.4) as figure:
        rows = [["x", "y"], ["top", "top"]] if steps is not None else [["top"]]
        axes = figure.subplot_mosaic(rows, height_ratios=[1.2, 1.0][: len(rows)])
        _top_view(axes["top"], pattern, samples.com, samples.zmp)
        if steps is not None:
            _step_x(axes["x"], steps)
            _step_y(axes["y"], steps)
    return write_figure(figure, path)


def _middle_steps(pattern: Pattern) -> _Steps | None:
    """Return up to two steps from the middle of a pattern; None if it only stands."""
    spans = pattern.phases
    swings = [k for k, span in enumerate(spans) if span.phase in _SINGLES]
    if not swings:
        return None
    k = swings[max(len(swings) // 2 - 1, 0)]
    before, single = spans[k - 1], spans[k]
    t_d = before.duration / 2
    T = single.duration + 2 * t_d
    start = single.start - t_d
    count = 2 if len(swings) > 1 else 1
    t = np.linspace(0.0, count * T, 400 * count + 1)
    samples = pattern.sample(start + t)
    origin, yaw = samples.com[0, :2], samples.heading[0]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    side = 1.0 if single.phase is Phase.SINGLE_LEFT else -1.0
    com = (samples.com[:, :2] - origin) @ turn.T
    return _Steps(t, com, (samples.zmp - origin) @ turn.T, T, t_d, side)


def _step_x(ax: Axes, steps: _Steps) -> None:
    """Draw x over one step, with T, t_d, B and K_x as in Fig. 3."""
    t, T, t_d = steps.t, steps.T, steps.t_d
    one = t <= T + 1e-9
    _step_lines(ax, steps, 0, one)
    B, K_x = (float(np.interp(s, t, steps.zmp[:, 0])) for s in (T / 2, 0.999 * t_d))
    _level(ax, B, f"$B$ = {B:.3g} m")
    _level(ax, K_x, f"$K_x$ = {1e3 * K_x:.2f} mm")
    _times(ax, {"$t_d$": t_d, "$T-t_d$": T - t_d, "$T$": T})
    ax.set_title("x over one step")
    ax.set_ylabel("x [m]")
    ax.legend(loc="upper left")


def _step_y(ax: Axes, steps: _Steps) -> None:
    """Draw y over two steps, with A and K_y as in Fig. 3."""
    t, T, t_d = steps.t, steps.T, steps.t_d
    _step_lines(ax, steps, 1, slice(None))
    A, K_y = (float(np.interp(s, t, steps.zmp[:, 1])) for s in (T / 2, 0.999 * t_d))
    _level(ax, A, f"$A$ = {abs(A):.3g} m")
    _level(ax, K_y, f"$K_y$ = {1e3 * abs(K_y):.2f} mm")
    _times(ax, {"$t_d$": t_d, "$T$": T} | ({"$2T$": 2 * T} if t[-1] > 1.5 * T else {}))
    ax.set_title("y over two steps")
    ax.set_ylabel("y [m]")


def _step_lines(ax: Axes, steps: _Steps, i: int, rows: Any) -> None:
    """Draw the ZMP as a broken line, the CoM as a smooth one."""
    for k in range(round(float(steps.t[rows][-1]) / steps.T)):
        sign = steps.side * (-1.0) ** k
        phase = Phase.SINGLE_LEFT if sign > 0 else Phase.SINGLE_RIGHT
        begin = k * steps.T
        ax.axvspan(
            begin + steps.t_d,
            begin + steps.T - steps.t_d,
            color=_SINGLES[phase],
            lw=0,
            zorder=0,
        )
    t = steps.t[rows]
    ax.plot(t, steps.zmp[rows, i], color=_ORANGE, ls=_DASHED, label="ZMP $p^d$")
    ax.plot(t, steps.com[rows, i], color=_BLUE, lw=2.0, label="CoM $c^d$")
    ax.set_xlim(0.0, float(t[-1]))


def _level(ax: Axes, value: float, text: str) -> None:
    """Mark a height with its name at the right."""
    ax.axhline(value, color=_GREY, lw=0.8, ls=":")
    ax.annotate(
        text,
        (1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(-3, 3),
        textcoords="offset points",
        ha="right",
        color=_INK,
    )


def _times(ax: Axes, marks: dict[str, float]) -> None:
    """Mark times by name on the axis."""
    names = {"0": 0.0, **marks}
    ax.set_xticks(list(names.values()), [f"{n}\n{v:g}" for n, v in names.items()])
    ax.get_xticklabels()[0].set_text("0")
    ax.set_xlabel("t [s]")


def _top_view(ax: Axes, pattern: Pattern, com: np.ndarray, zmp: np.ndarray) -> None:
    """Draw CoM and ZMP among the footprints, seen from above."""
    feet = foot_poses(pattern.plan).reshape(-1, 2, 3)
    for k, phase in enumerate(_SINGLES):
        for x, y, yaw in np.unique(feet[:, k], axis=0).tolist():
            sole = rectangle(x, y, yaw, pattern.plan.sole_size)
            style = {"fc": _SINGLES[phase], "ec": "#999999", "lw": 0.7}
            ax.add_patch(Polygon(sole, closed=True, **style))
    ax.plot(*zmp.T, color=_ORANGE, ls=_DASHED, lw=1.0, label="ZMP $p^d$")
    ax.plot(*com[:, :2].T, color=_BLUE, lw=1.6, label="CoM $c^d$")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(
        f"Seen from above: {pattern.plan.count} steps, {pattern.duration:.4g} s"
    )
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")


# ---- Figs. 5 and 6: a dance -------------------------------------------------------


def plot_arms(source: EmbeddedMotion | Run, path: str | Path | None = None) -> Figure:
    """Draw the joints of the arms over time, as in Fig. 5.

    Args:
        source: A motion as it will be played; or a run, whose set-points are dashed.
        path: Where to write a picture; not written if None.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written, or no arm, waist or head moved.
    """
    embedded = isinstance(source, EmbeddedMotion)
    t, curves = _motion_joints(source) if embedded else _run_joints(source)
    groups: dict[str, list[str]] = {}
    for joint in curves:
        side = _SIDES.get(joint.lower()[:2], "waist and head")
        groups.setdefault(side, []).append(joint)
    with _figure(9.0, 0.6 + 2.2 * len(groups)) as figure:
        axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for ax, side in zip(axes, sorted(groups), strict=True):
            for color, joint in zip(_CYCLE * 9, groups[side], strict=False):
                actual, desired = curves[joint]
                ax.plot(t, actual, color=color, label=joint)
                if desired is not None:
                    ax.plot(t, desired, color=_INK, lw=0.9, ls=_DASHED)
            ax.set_title(side)
            ax.set_ylabel("angle [rad]")
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9)
        axes[-1].set_xlabel("t [s]")
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


def _run_joints(run: Run) -> tuple[np.ndarray, _Curves]:
    """Return times and the moving joints outside the legs: actual and set-points."""
    if run.robot is None:
        raise RunError("the simplified model has no arms; plot a run of a robot")
    angles, targets = run.log["joints"], run.log["joint_set_points"]
    index = {name: j for j, name in enumerate(run.robot.joints)}
    curves: _Curves = {
        name: (angles[:, index[name]], targets[:, index[name]])
        for name in run.robot.upper_body
        if np.ptp(targets[:, index[name]]) > 0.02
    }
    if not curves:
        raise RunError("no joint of the upper body moved; choose a motion by --motion")
    return run.log["t"], curves


def plot_dance(
    run: Run, path: str | Path | None = None, *, without: Run | None = None
) -> Figure:
    """Draw how far CoM and ZMP leave their place in a dance, as in Fig. 6.

    Args:
        run: The dance.
        path: Where to write a picture; not written if None.
        without: The same dance with a resolution that ignores the arms, to compare.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    with _figure(9.0, 6.6) as figure:
        axes = figure.subplots(2, 1, sharex=True)
        for i, ax in enumerate(axes):
            ax.axhspan(-10.0, 10.0, color="#EEF3EE", lw=0, zorder=0)
            ax.text(
                0.004,
                10.0,
                "paper: $\\pm$10 mm",
                va="bottom",
                color=_GREY,
                fontsize=9,
                transform=ax.get_yaxis_transform(),
            )
            if without is not None:
                _offsets(ax, without, i, (_YELLOW, _PURPLE), " ignoring the arms")
            _offsets(ax, run, i, (_ORANGE, _BLUE), "")
            ax.set_ylabel(f"{_AXES[i]} from the start [mm]")
        axes[-1].set_xlabel("t [s]")
        axes[-1].set_xlim(0.0, float(run.log["t"][-1]))
        figure.suptitle(f"Dance: {run.outcome}", x=0.01, ha="left", fontsize=11.5)
        handles, labels = axes[0].get_legend_handles_labels()
        order = sorted(range(len(labels)), key=lambda k: "ignoring" in labels[k])
        figure.legend(
            [handles[k] for k in order],
            [labels[k] for k in order],
            loc="outside lower center",
            ncols=4,
        )
    return write_figure(figure, path)


def _offsets(ax: Axes, run: Run, i: int, colors: tuple[str, str], label: str) -> None:
    """Draw CoM and ZMP of one axis from where the CoM began [mm]."""
    log = run.log
    com = "com_true" if "com_true" in log else "com"
    style: dict[str, Any] = {"lw": 1.1, "ls": "-"}
    for column, color, name in (
        ("zmp_filtered", colors[0], "ZMP"),
        (com, colors[1], "CoM"),
    ):
        offset = 1e3 * (log[column][:, i] - log["com_ref"][0, i])
        ax.plot(log["t"], offset, color=color, label=name + label, **style)
        style["lw"] = 1.8
