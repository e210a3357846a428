"""Fig. 3: ZMP and CoM of a pattern over one and two steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ..pattern import Pattern, Phase, foot_poses, rectangle
from .matplotlib_figures import (
    _BLUE,
    _DASHED,
    _GREY,
    _INK,
    _ORANGE,
    _SIDE_COLORS,
    Row,
    _page,
    write_figure,
)

_SINGLES = {
    Phase.SINGLE_LEFT: _SIDE_COLORS["left"],
    Phase.SINGLE_RIGHT: _SIDE_COLORS["right"],
}


class _Steps(NamedTuple):
    """Two steps of a pattern, seen from the middle of the feet before them."""

    t: np.ndarray  # [s] from the middle of the double support
    com: np.ndarray  # [m], (k, 2)
    zmp: np.ndarray  # [m], (k, 2)
    T: float  # [s]
    t_d: float  # [s]
    side: float  # +1 if the left foot supports first
    K: np.ndarray | None  # (K_x, K_y) [m], if the ZMP of double support has them


def plot_pattern(
    pattern: Pattern, path: str | Path | None = None, *, table: Sequence[Row] = ()
) -> Figure:
    """Draw a pattern: two steps in the middle as in Fig. 3, and the footprints.

    K_x and K_y are those of the drawn steps: near the start of a short plan they differ
    from Eqs. (8) and (13), which hold for a walk without end.

    Args:
        pattern: What to draw.
        path: Where to write a picture; not written if None.
        table: Rows of a small table to write below.

    Returns:
        The figure.

    Raises:
        RunError: If the picture cannot be written.
    """
    samples = pattern.sample(np.linspace(0.0, pattern.duration, 2000))
    extent = np.ptp(np.concatenate([samples.left, samples.right])[:, :2], axis=0) + 0.3
    above = float(np.clip(9.5 * extent[1] / extent[0], 1.0, 6.5)) + 0.8
    steps = _middle_steps(pattern)
    rows = ["t"] if steps is None else ["xy", "tt"]
    heights = [3.4, above][-len(rows) :]
    with _page(10.5, sum(heights), table) as (figure, page):
        axes = page.subplot_mosaic(";".join(rows), height_ratios=heights)
        _top_view(axes["t"], pattern, samples.com, samples.zmp)
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
    k = (len(swings) - 1) // 2
    if spans[swings[k]].phase is not Phase.SINGLE_LEFT and k + 2 < len(swings):
        k += 1  # as in the paper, the left foot first
    count = min(2, len(swings) - k)
    before, single = spans[swings[k] - 1], spans[swings[k]]
    t_d = before.duration / 2
    T = single.duration + 2 * t_d
    start = single.start - t_d
    t = np.linspace(0.0, count * T, 400 * count + 1)
    samples = pattern.sample(start + t)
    origin = 0.5 * (samples.left[0, :2] + samples.right[0, :2])
    yaw = samples.heading[0]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    side = 1.0 if single.phase is Phase.SINGLE_LEFT else -1.0
    com = (samples.com[:, :2] - origin) @ turn.T
    K = None
    if pattern.plan.double_support == "paper":
        K = turn @ (pattern.at(single.start).com[:2] - origin)
    return _Steps(t, com, (samples.zmp - origin) @ turn.T, T, t_d, side, K)


def _step_x(ax: Axes, steps: _Steps) -> None:
    """Draw x over one step, with T, t_d, B and K_x as in Fig. 3."""
    t, T, t_d = steps.t, steps.T, steps.t_d
    one = t <= T + 1e-9
    _step_lines(ax, steps, 0, one)
    B = float(np.interp(T / 2, t, steps.zmp[:, 0]))
    _level(ax, B, f"$B$ = {1e3 * B:.4g} mm", 0.87)
    if steps.K is not None:
        _level(ax, steps.K[0], f"$K_x$ = {1e3 * steps.K[0]:.2f} mm", 0.87)
    _times(ax, {"$t_d$": t_d, "$T-t_d$": T - t_d, "$T$": T})
    ax.set_title("x over one step")
    ax.set_ylabel("x [m]")
    ax.legend(loc="upper left")


def _step_y(ax: Axes, steps: _Steps) -> None:
    """Draw y over two steps, with A and K_y as in Fig. 3."""
    t, T, t_d = steps.t, steps.T, steps.t_d
    _step_lines(ax, steps, 1, slice(None))
    A = float(np.interp(T / 2, t, steps.zmp[:, 1]))
    _level(ax, A, f"$A$ = {1e3 * abs(A):.4g} mm", 1.0)
    if steps.K is not None:
        _level(ax, steps.K[1], f"$K_y$ = {1e3 * abs(steps.K[1]):.2f} mm", 1.0)
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


def _level(ax: Axes, value: float, text: str, place: float) -> None:
    """Mark a height with its name, which ends at a part of the width."""
    ax.axhline(value, color=_GREY, lw=0.8, ls=":")
    ax.annotate(
        text,
        (place, value),
        xycoords=("axes fraction", "data"),
        xytext=(-3, 3),
        textcoords="offset points",
        ha="right",
        color=_INK,
    )


def _times(ax: Axes, marks: dict[str, float]) -> None:
    """Mark times by name on the axis."""
    labels = ["0", *(f"{name}\n{time:g}" for name, time in marks.items())]
    ax.set_xticks([0.0, *marks.values()], labels, math_fontfamily="stix")
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
    ax.set_aspect("equal", adjustable="box")
    ax.set_title(
        f"Seen from above: {pattern.plan.count} steps, {pattern.duration:.4g} s"
    )
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
