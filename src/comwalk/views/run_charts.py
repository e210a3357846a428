"""Figures of one run, or of two runs overlaid, as HTML: Figs. 6 and 7 and more."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..errors import RunError
from ..pattern import Phase, rectangle
from ..runs import RunData, moved_steps
from .charts import (
    Chart,
    Curve,
    TopView,
    Trace,
    chart_html,
    chart_times,
    on_times,
    top_view_html,
)

_AXES = ("x, forward", "y, to the left")
_NEEDED = ("t", "phase", "com", "com_ref", "zmp_filtered", "zmp_ref")
_BANDS = {Phase.SINGLE_LEFT: "left", Phase.SINGLE_RIGHT: "right"}
Column = Callable[[RunData], np.ndarray | None]
"""Returns a value per row of a record; None if the run has none."""


def run_charts(records: Sequence[RunData]) -> str:
    """Return the figures of a run, or of two in the same axes.

    Args:
        records: One or two.

    Returns:
        HTML.

    Raises:
        RunError: If a record lacks a column, or has no rows.
    """
    for record in records:
        missing = [name for name in _NEEDED if name not in record.columns]
        if missing or not len(record.columns["t"]):
            lack = ", ".join(missing) or "rows"
            raise RunError(f"{record.name} lacks {lack}; run it anew")
    parts = [chart_html(chart) for chart in _charts(records)]
    if any(record.walked for record in records):
        parts.insert(0, top_view_html(_top_view(records)))
    return "".join(parts)


def main_charts(record: RunData) -> str:
    """Return the two most telling figures of a run: CoM and ZMP over time.

    Args:
        record: The run.

    Returns:
        HTML.
    """
    times = _times([record])
    return "".join(chart_html(motion_chart([record], times, i)) for i in range(2))


def _charts(records: Sequence[RunData]) -> Iterator[Chart]:
    """Yield all charts over time."""
    times = _times(records)
    for i in range(2):
        yield motion_chart(records, times, i)
    for i in range(2):
        yield error_chart(records, times, i)
    if all("loads_true" in record.columns for record in records):
        loads = [("left foot", "left", _load(0)), ("right foot", "right", _load(1))]
        yield _chart("Vertical force on each foot", "N", records, times, loads)
    law = [("forward", "com", _law(0)), ("left", "zmp", _law(1))]
    yield _chart("The law's CoM velocity u, Eq. (31)", "m/s", records, times, law)


def _times(records: Sequence[RunData]) -> np.ndarray:
    ends = [float(record.columns["t"][-1]) for record in records]
    return chart_times(float(records[0].columns["t"][0]), max(ends))


def _chart(
    title: str,
    unit: str,
    records: Sequence[RunData],
    times: np.ndarray,
    lines: Sequence[tuple[str, str, Column]],
    span: tuple[float, float] | None = None,
) -> Chart:
    """Return a chart of columns by label and kind; all runs have the same axes."""
    curves = []
    for k, record in enumerate(records):
        for label, kind, column in lines:
            values = column(record)
            if values is not None and not (k and kind.startswith("ref")):
                where = f"{label}, {'AB'[k]}" if len(records) > 1 else label
                seen = on_times(times, record.columns["t"], values)
                curves.append(Curve(where, kind, seen, other=k > 0))
    bands = _bands(records[0])
    return Chart(title=title, unit=unit, t=times, curves=curves, span=span, bands=bands)


def motion_chart(records: Sequence[RunData], times: np.ndarray, i: int) -> Chart:
    """Return CoM and ZMP of one axis, desired and actual.

    Args:
        records: One or two runs.
        times: Where they are wanted [s].
        i: The axis, 0 forward or 1 to the left.

    Returns:
        The chart.
    """
    lines = [
        ("ZMP", "zmp", _column("zmp_filtered", i)),
        ("CoM", "com", lambda record: record.com[:, i]),
        ("ZMP, plan", "ref-zmp", _column("zmp_ref", i)),
        ("CoM, plan", "ref-com", _column("com_ref", i)),
    ]
    known = [record.columns[c][:, i] for record in records for c in _PLANNED]
    title = f"CoM and ZMP, {_AXES[i]}"
    return _chart(title, "m", records, times, lines, padded_span(known))


_PLANNED = ("zmp_ref", "com_ref")


def padded_span(known: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the range of some curves [m] with room for what is near them.

    Args:
        known: Their values, at least one.

    Returns:
        Lowest and highest value to show.
    """
    low, high = min(x.min() for x in known), max(x.max() for x in known)
    pad = 0.05 * (high - low) + 0.012
    return float(low - pad), float(high + pad)


def error_chart(records: Sequence[RunData], times: np.ndarray, i: int) -> Chart:
    """Return the errors of CoM and ZMP of one axis.

    Args:
        records: One or two runs.
        times: Where they are wanted [s].
        i: The axis, 0 forward or 1 to the left.

    Returns:
        The chart.
    """
    lines = [("ZMP", "zmp", _zmp_error(i)), ("CoM", "com", _com_error(i))]
    title = f"Desired minus actual, {_AXES[i]}"
    chart = _chart(title, "mm", records, times, lines)
    values = np.concatenate([curve.values for curve in chart.curves])
    values = values[np.isfinite(values)]
    if all(record.ok for record in records) or not len(values):
        return chart
    # A fall leaves every range: show what came before.
    low, high = np.percentile(values, (2.0, 98.0)).tolist()
    span = (min(low, -1.0), max(high, 1.0))
    return replace(chart, span=span)


def _column(name: str, i: int) -> Column:
    return lambda record: record.columns[name][:, i]


def _zmp_error(i: int) -> Column:
    """Return the column of the ZMP error, both filtered alike [mm]."""
    return lambda record: (
        1e3
        * (
            record.columns.get("zmp_ref_filtered", record.columns["zmp_ref"])
            - record.columns["zmp_filtered"]
        )[:, i]
    )


def _com_error(i: int) -> Column:
    """Return the column of the CoM error [mm]."""
    return lambda record: 1e3 * (record.columns["com_ref"] - record.com)[:, i]


def _load(k: int) -> Column:
    """Return the column of the force on a foot [N]."""
    return lambda record: record.columns["loads_true"][:, k]


def _law(i: int) -> Column:
    """Return the column of the law's output [m/s]."""
    return lambda record: record.columns["u"][:, i] if "u" in record.columns else None


def _bands(record: RunData) -> list[tuple[float, float, str]]:
    """Return the times of single support."""
    t, phase = record.columns["t"], record.columns["phase"]
    edges = np.flatnonzero(np.diff(phase)) + 1
    starts = np.concatenate([[0], edges])
    ends = np.concatenate([edges, [len(t) - 1]])
    return [
        (float(t[a]), float(t[b]), _BANDS[Phase(int(phase[a]))])
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
        if int(phase[a]) in _BANDS
    ]


def _top_view(records: Sequence[RunData]) -> TopView:
    """Return the paths of CoM and ZMP among planned and moved footprints."""
    plan = records[0].settings.get("plan", {})
    length, width = plan.get("sole_size", (0.24, 0.13))
    feet = [(plan[side], side) for side in ("left", "right") if side in plan]
    feet += [(step, step["side"]) for step in plan.get("steps", ())]
    soles = [
        (rectangle(foot["x"], foot["y"], foot["yaw"], (length, width)), side)
        for foot, side in feet
    ]
    for record in records:
        if record.plan is not None:
            soles += [
                (rectangle(foot.x, foot.y, foot.yaw, (length, width)), "moved")
                for _, foot in moved_steps(record.columns, record.plan)
            ]
    paths = []
    for k, record in enumerate(records):
        tail = f", {'AB'[k]}" if len(records) > 1 else ""
        for label, kind, path in (
            ("ZMP", "zmp", record.columns["zmp_filtered"]),
            ("CoM", "com", record.com),
        ):
            points = path[:, :2]
            paths.append(
                Trace(label + tail, kind, record.columns["t"], points, other=k > 0)
            )
    return TopView(soles=soles, paths=paths)
