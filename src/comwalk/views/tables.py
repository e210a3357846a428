"""The figures and settings of runs as tables in HTML, one run or two side by side."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

Summary = Mapping[str, Any]
"""What `Run.summary` returns, or a summary.json holds."""


class Figure(NamedTuple):
    """One figure of a run that can be compared."""

    name: str
    """What it is."""
    key: str
    """Where a summary holds it; dots lead into tables."""
    unit: str
    """Unit."""
    digits: int = 1
    """Digits after the point."""
    better: int = 0
    """-1 if less is better, 1 if more is better, 0 if neither."""
    factor: float = 1.0
    """From the unit of the summary to the one shown."""


FIGURES = (
    Figure("end", "time_s", "s", 2),
    Figure("steps completed", "steps_completed", "", 0, 1),
    Figure("steps moved", "steps_moved", "", 0),
    Figure("distance", "distance_m", "m", 3),
    Figure("end position error", "position_error_m", "mm", 1, -1, 1e3),
    Figure("end heading error", "heading_error_deg", "deg", 2),
    Figure("CoM error rms, true, x", "com_error_rms_mm.true.x", "mm", 2, -1),
    Figure("CoM error rms, true, y", "com_error_rms_mm.true.y", "mm", 2, -1),
    Figure("CoM error rms, measured, x", "com_error_rms_mm.measured.x", "mm", 2, -1),
    Figure("CoM error rms, measured, y", "com_error_rms_mm.measured.y", "mm", 2, -1),
    Figure("ZMP error rms, x", "zmp_error_rms_mm.x", "mm", 2, -1),
    Figure("ZMP error rms, y", "zmp_error_rms_mm.y", "mm", 2, -1),
    Figure("largest ZMP error", "zmp_error_max_mm", "mm", 1, -1),
    Figure("largest ZMP deviation, x", "zmp_deviation_max_mm.x", "mm", 2, -1),
    Figure("largest ZMP deviation, y", "zmp_deviation_max_mm.y", "mm", 2, -1),
    Figure("sole margin, 5th percentile", "sole_margin_p5_mm", "mm", 1, 1),
    Figure("sole margin, least", "sole_margin_min_mm", "mm", 1, 1),
    Figure("largest tilt of the trunk", "trunk_tilt_max_deg", "deg", 2, -1),
    Figure("largest torque, of its limit", "torque_max_pct", "%", 1, -1),
    Figure("largest joint speed, of its limit", "joint_speed_max_pct", "%", 1, -1),
    Figure("torque saturated", "torque_saturation_pct", "% of time", 1, -1),
    Figure("joint limits met", "joint_limits_met_pct", "% of time", 1, -1),
    Figure("near a singular posture", "near_singular_pct", "% of time", 1, -1),
    Figure("command bounded", "command_bounded_pct", "% of time", 1, -1),
    Figure("speed of the simulation", "real_time_factor", "x real time", 1),
    Figure("tick, median", "tick_us_p50", "us", 0),
    Figure("tick, 99th percentile", "tick_us_p99", "us", 0),
)
"""The figures of a run, in the order of tables."""


def figure_of(summary: Summary, figure: Figure) -> float | None:
    """Return a figure in the unit that is shown.

    Args:
        summary: The summary of a run.
        figure: Which figure.

    Returns:
        The number; None if the run has none.
    """
    value: Any = summary
    for key in figure.key.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return None if value is None else figure.factor * float(value)


def figure_table(summaries: Sequence[Summary], names: Sequence[str] = ()) -> str:
    """Return the figures of a run as a table, or of two runs with their differences.

    Args:
        summaries: One or two.
        names: Their names; shown above the columns of two.

    Returns:
        HTML.
    """
    both = len(summaries) == 2
    rows = []
    for figure in FIGURES:
        values = [figure_of(summary, figure) for summary in summaries]
        if any(value is not None for value in values):
            cells = [_number(value, figure) for value in values]
            last = _difference(values, figure) if both else ""
            rows.append(f"<tr><th>{figure.name}</th>{''.join(cells)}{last}</tr>")
    if not both:
        half = -(-len(rows) // 2)
        tables = (f"<table>{''.join(r)}</table>" for r in (rows[:half], rows[half:]))
        return f'<div class="cw-figures">{"".join(tables)}</div>'
    head = "".join(f'<th class="num">{escape(name)}</th>' for name in names)
    head = f'<tr><th></th>{head}<th class="num">difference</th></tr>'
    return f"<table>{head}{''.join(rows)}</table>"


def _number(value: float | None, figure: Figure) -> str:
    rounded = 0.0 if value is None else round(value, figure.digits) + 0.0
    text = "" if value is None else f"{rounded:.{figure.digits}f} {figure.unit}"
    return f'<td class="num">{text.strip()}</td>'


def _difference(values: Sequence[float | None], figure: Figure) -> str:
    """Return the cell of the second minus the first, and which one is better."""
    first, second = values
    if first is None or second is None:
        return "<td></td>"
    change = round(second - first, figure.digits)
    kind = ("", " cw-better", " cw-worse")[_sign(change * figure.better)]
    text = f"{change:+.{figure.digits}f} {figure.unit}" if change else "same"
    return f'<td class="num{kind}">{text.strip()}</td>'


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)


def headlines(summary: Summary) -> list[tuple[str, str]]:
    """Return the main figures of a run.

    Args:
        summary: The summary of a run.

    Returns:
        Names and values with their units.
    """
    shown = [("", str(summary["outcome"]))]
    if summary["steps_planned"]:
        shown[0] = ("steps", f"{summary['steps_completed']}/{summary['steps_planned']}")
        shown.append(("distance", f"{summary['distance_m']:.2f} m"))
    pairs = [
        ("CoM error rms x / y", summary["com_error_rms_mm"]),
        ("ZMP error rms x / y", summary["zmp_error_rms_mm"]),
        ("largest ZMP deviation x / y", summary.get("zmp_deviation_max_mm")),
    ]
    for name, pair in pairs:
        pair = pair and pair.get("true", pair.get("measured", pair))
        if pair:
            shown.append((name, f"{pair['x']:.1f} / {pair['y']:.1f} mm"))
    for name, key, unit in _HEADLINES:
        if summary.get(key):  # a robot without limits of torque uses 0 % of them
            shown.append((name, f"{summary[key]:.0f} {unit}"))
    return shown


_HEADLINES = (
    ("sole margin, 95 % of the time", "sole_margin_p5_mm", "mm"),
    ("largest torque, of its limit", "torque_max_pct", "%"),
    ("tick, median", "tick_us_p50", "us"),
)


# ---- Settings ---------------------------------------------------------------------

_TOLD = ("config", "command", "out", "notes", "robot", "plant")  # elsewhere on a page
_EFFECTIVE = ("gains", "control", "body", "simulator", "pendulum", "period", "seed")
_EFFECTIVE += ("robot", "out", "json", "report", "video")


def flat_settings(summary: Summary) -> dict[str, str]:
    """Return all settings of a run as text by dotted names.

    Args:
        summary: The summary of a run.

    Returns:
        What the run was made with, defaults included, and what its command line gave
        besides. Of footsteps only the number is told.
    """
    settings = summary["settings"]
    flat = {"robot": str(settings.get("robot") or "none: the simplified model")}
    given = settings.get("config", {})
    _flatten({k: v for k, v in given.items() if k not in _EFFECTIVE}, "", flat)
    _flatten({k: v for k, v in settings.items() if k not in _TOLD}, "", flat)
    return {key: text for key, text in flat.items() if text}


def _flatten(value: Any, prefix: str, flat: dict[str, str]) -> None:
    """Add a value, or those of a table, to a flat table."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _flatten(item, f"{prefix}{key}.", flat)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        flat[prefix.rstrip(".")] = f"{len(value)}"
    else:
        flat[prefix.rstrip(".")] = _word(value)


def _word(value: Any) -> str:
    """Return a setting as text."""
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ", ".join(_word(item) for item in value)
    return value if isinstance(value, str) else json.dumps(value)


def settings_tables(summary: Summary) -> str:
    """Return all settings of a run as one table a group.

    Args:
        summary: The summary of a run.

    Returns:
        `section` elements.
    """
    groups: dict[str, list[str]] = {}
    for name, text in flat_settings(summary).items():
        group, _, key = name.rpartition(".")
        row = f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>"
        groups.setdefault(group, []).append(row)
    return "".join(
        f"<section><h4>{escape(group or 'run')}</h4><table>{''.join(rows)}</table>"
        "</section>"
        for group, rows in groups.items()
    )


def changed_settings(first: Summary, second: Summary, names: Sequence[str]) -> str:
    """Return the settings in which two runs differ, as a table.

    Args:
        first: The summary of a run.
        second: That of the other.
        names: Their names.

    Returns:
        A `table` element, or a paragraph if nothing differs.
    """
    a, b = flat_settings(first), flat_settings(second)
    rows = "".join(
        f"<tr><th>{escape(key)}</th><td>{escape(a.get(key, ''))}</td>"
        f"<td>{escape(b.get(key, ''))}</td></tr>"
        for key in dict.fromkeys([*a, *b])
        if a.get(key) != b.get(key)
    )
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    if not rows:
        return "<p>Both runs were made with the same settings.</p>"
    return f"<table><tr><th></th>{head}</tr>{rows}</table>"
