"""One page per run, or per pair of runs: all of it in one file that needs no network.

The page holds the walk in 3D with its overlays, the figures, the summary, the settings
and the command that repeats the run. The script of the page moves the cursors of the
figures with the play bar of the 3D scene, and the scenes of two runs together.
"""

from __future__ import annotations

import base64
import json
import shlex
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from tempfile import NamedTemporaryFile

from ..errors import ParameterError, RunError
from ..runs import RunData, Source, data_of, outcome_text
from .charts import chart_style, page_script, page_style
from .run_charts import main_charts, run_charts
from .scene import scene_film
from .scene_data import seen_of
from .tables import (
    changed_settings,
    figure_table,
    headlines,
    settings_tables,
)

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
    "connect-src data: blob:; worker-src blob: data:; frame-src 'self'"
)
"""What a browser lets the page load: only what is in it."""


def page_html(
    records: Sequence[RunData], films: Sequence[bytes | None], player: str
) -> str:
    """Return the page of one run, or of two side by side.

    Args:
        records: One or two runs.
        films: For each, its replay in 3D in viser's format, or None without a robot.
        player: The page of viser that plays them.

    Returns:
        A whole HTML document.

    Raises:
        RunError: If a record lacks a column, or has no rows.
    """
    names = [record.name for record in records]
    title = " against ".join(names)
    parts = [
        _header(records),
        f'<section class="cards">{_cards(records[0])}</section>' * (len(records) == 1),
        _scenes(records, films),
        f'<section class="charts">{run_charts(records)}</section>',
        _section("Summary", figure_table([r.summary for r in records], _marked(names))),
        _changes(records),
        _section("Repeat it", "".join(_repeat(r, len(records) > 1) for r in records)),
        *(_settings(record, len(records) > 1) for record in records),
        _footer(records[0]),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f'<title>{escape(title)} | comwalk</title><link rel="icon" href="data:,">'
        f"<style>{page_style()}</style></head>"
        f'<body class="comwalk {"pair" if len(records) > 1 else "single"}"><main>'
        f"{''.join(parts)}</main>{_film_data(films, player)}"
        f"<script>{page_script()}</script></body></html>\n"
    )


def _section(title: str, body: str) -> str:
    return f'<section class="card half"><h2>{escape(title)}</h2>{body}</section>'


def _marked(names: Sequence[str]) -> list[str]:
    return [f"{'AB'[k]}: {name}" for k, name in enumerate(names)]


def _header(records: Sequence[RunData]) -> str:
    """Return the title of the page and how each run ended."""
    names = [record.name for record in records]
    shown = _marked(names) if len(records) > 1 else names
    lines = "".join(
        f'<p class="{_ended(record)}"><b>{escape(name)}</b> '
        f"{escape(_what(record))}: {escape(outcome_text(record.summary))}</p>"
        for name, record in zip(shown, records, strict=True)
    )
    title = escape(" / ".join(names))
    return (
        f'<header><div><h1>{title}</h1>{lines}</div><button id="theme" '
        'title="Dark or light" aria-label="Dark or light"></button></header>'
    )


def _ended(record: RunData) -> str:
    return "done" if record.summary["outcome"] == "completed" else "fell"


def _what(record: RunData) -> str:
    """Return the task in words."""
    robot = record.settings.get("robot")
    who = f"robot {robot}" if robot else "simplified model"
    steps = record.summary["steps_planned"]
    what = f"{steps} steps" if steps else "a dance"
    motion = record.settings.get("motion")
    return f"{who}, {what}" + (f" with the motion {motion}" if motion and steps else "")


def _scenes(records: Sequence[RunData], films: Sequence[bytes | None]) -> str:
    """Return the elements that hold the replays."""
    shown = []
    for k, (record, film) in enumerate(zip(records, films, strict=True)):
        name = f"{'AB'[k]}: {record.name}" if len(records) > 1 else record.name
        body = (
            f'<iframe data-scene="{k}" title="3D replay of {escape(name)}"></iframe>'
            if film
            else "<p>The simplified model has no body to show.</p>"
        )
        label = f"<h2>{escape(name)}</h2>" if len(records) > 1 else ""
        shown.append(f'<div class="scene">{label}{body}</div>')
    return f'<section class="scenes">{"".join(shown)}{_LEGEND}</section>'


_LEGEND = (
    '<p class="legend"><span class="cw-key cw-com"><i></i>CoM and its path</span>'
    '<span class="cw-key cw-zmp"><i></i>ZMP and its path</span>'
    '<span class="cw-key cw-hull"><i></i>support polygon</span>'
    '<span class="cw-key cw-force"><i></i>force on each foot</span>'
    "<span>Drag to turn, scroll to come closer, space to pause; click into a figure "
    "to go to its time.</span></p>"
)


def _cards(record: RunData) -> str:
    return "".join(
        f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>"
        for name, value in headlines(record.summary)
    )


def _changes(records: Sequence[RunData]) -> str:
    """Return the settings in which two runs differ."""
    if len(records) < 2:
        return ""
    a, b = records
    body = changed_settings(a.summary, b.summary, _marked([a.name, b.name]))
    return _section("What differs", body)


def _repeat(record: RunData, both: bool) -> str:
    """Return the means to repeat the run: its command, or this page alone."""
    label = f"<h3>{escape(record.name)}</h3>" if both else ""
    command = record.settings.get("command")
    if not command:
        return f"{label}<p>This run was made in Python; its settings are below.</p>"
    task = shlex.split(command)[1]
    file = f"{record.name}.json".replace(" ", "-")
    text = json.dumps(dict(record.summary), indent=1)
    data = base64.b64encode(text.encode()).decode()
    return (
        f"{label}{_command(command)}<p>Or with "
        f'<a download="{escape(file)}" href="data:application/json;base64,{data}">'
        f"{escape(file)}</a>, which this page holds, as its whole configuration:</p>"
        f"{_command(f'comwalk {task} --config {shlex.quote(file)}')}"
    )


def _command(words: str) -> str:
    return (
        f'<div class="command"><code>{escape(words)}</code>'
        '<button type="button">copy</button></div>'
    )


def _settings(record: RunData, both: bool) -> str:
    """Return all settings of a run, folded."""
    tail = f" of {record.name}" if both else ""
    notes = "; ".join(record.settings.get("notes", ()))
    note = f"<p>Note: {escape(notes)}.</p>" if notes else ""
    return (
        f'<details class="card"><summary>Settings{escape(tail)}</summary>{note}'
        f'<div class="settings">{settings_tables(record.summary)}</div></details>'
    )


def _footer(record: RunData) -> str:
    versions = record.summary.get("versions", {})
    text = ", ".join(f"{name} {number}" for name, number in versions.items())
    return f"<footer>{escape(text)}</footer>"


# ---- Notebooks --------------------------------------------------------------------


def notebook_html(record: RunData) -> str:
    """Return a run as a notebook shows it: outcome, figures over time, summary.

    Args:
        record: The run.

    Returns:
        HTML that brings its own style.

    Raises:
        RunError: If the record lacks a column, or has no rows.
    """
    return (
        f'<div class="comwalk cw-notebook"><style>{chart_style()}</style>'
        f"<p><b>{escape(_what(record))}</b>: {escape(outcome_text(record.summary))}</p>"
        f"{main_charts(record)}<details><summary>Summary</summary>"
        f"{figure_table([record.summary])}</details></div>"
    )


@dataclass(frozen=True)
class WebPage:
    """A page of its own: shown by a notebook, opened in a browser, or saved."""

    html: str
    """The whole document."""

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html, quote=True)}" width="100%" '
            'height="760" style="border:0"></iframe>'
        )

    def save(self, path: str | Path) -> Path:
        """Write the page.

        Args:
            path: The file.

        Returns:
            The file.

        Raises:
            RunError: If it cannot be written.
        """
        try:
            Path(path).write_text(self.html, "utf-8", "replace")
        except OSError as error:
            raise RunError(f"cannot write the page {path}: {error.strerror}") from None
        return Path(path)

    def open(self) -> Path:
        """Write the page to a temporary file, and open it in the browser.

        Returns:
            The file.
        """
        with NamedTemporaryFile(suffix=".html", delete=False) as file:
            path = self.save(file.name)
        webbrowser.open(path.as_uri())
        return path


# ---- Films ------------------------------------------------------------------------


def _film_data(films: Sequence[bytes | None], player: str) -> str:
    data = [base64.b64encode(film).decode() if film else "" for film in films]
    stored = {"player": player if any(data) else "", "films": data}
    text = json.dumps(stored).replace("</", "<\\/").replace("<!--", "\\u003c!--")
    return f'<script type="application/json" id="films">{text}</script>'


_FPS = 30.0  # pictures per second of a short run's replay
_MOST = 1800  # pictures, above which there are fewer per second


def report(
    *sources: Source,
    names: Sequence[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> WebPage:
    """Return the page of a run, or of two runs side by side.

    Args:
        sources: One or two runs, or folders of runs.
        names: What their reader calls them; those of the folders if None.
        progress: Called with the share that is done, from 0 to 1.

    Returns:
        The page; it needs no network.

    Raises:
        RunError: If a folder is no readable run.
        ParameterError: If there are more than two.
    """
    if len(sources) not in (1, 2):
        raise ParameterError(f"a report is of one or two runs, got {len(sources)}")
    given: Sequence[str | None] = names or [None] * len(sources)
    pairs = zip(sources, given, strict=True)
    records = [data_of(source, name) for source, name in pairs]
    films = []
    for k, record in enumerate(records):
        films.append(_film(record, _share(progress, k, len(sources))))
    return WebPage(page_html(records, films, _player() if any(films) else ""))


def _share(
    progress: Callable[[float], None] | None, k: int, count: int
) -> Callable[[float], None] | None:
    if progress is None:
        return None
    return lambda done: progress((k + done) / count)


def _film(
    record: RunData,
    progress: Callable[[float], None] | None,
) -> bytes | None:
    """Return a run in 3D; None for the simplified model, which has no body."""
    if record.settings.get("plant") == "pendulum":
        return None
    seen = seen_of(record, geometry=True)
    duration = float(seen.t[-1] - seen.t[0])
    fps = max(1.0, min(_FPS, _MOST / max(duration, 1e-3)))
    return scene_film(seen, fps=fps, progress=progress)


def _player() -> str:
    """Return viser's page, which plays films without a server."""
    spec = find_spec("viser")
    if spec is None or spec.origin is None:
        raise RunError("a report needs viser: pip install viser")
    path = Path(spec.origin).parent / "client" / "build" / "index.html"
    return path.read_text(encoding="utf-8")
