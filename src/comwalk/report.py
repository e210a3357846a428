"""The page of a run from its source: a run in memory, or its folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import ParameterError, RunError
from .page import WebPage, page_html
from .record import Record, record_of
from .recording import recording_of
from .scene import scene_film

if TYPE_CHECKING:
    from .run import Run

_FPS = 30.0  # pictures per second of a short run's replay
_MOST = 1800  # pictures, above which there are fewer per second


def report(
    *sources: Run | str | Path,
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
    records = [record_of(source, name) for source, name in pairs]
    films = []
    for k, (source, record) in enumerate(zip(sources, records, strict=True)):
        share = _share(progress, k, len(sources))
        films.append(_film(source, record, share))
    return WebPage(page_html(records, films, _player() if any(films) else ""))


def _share(
    progress: Callable[[float], None] | None, k: int, count: int
) -> Callable[[float], None] | None:
    """Return what tells the progress of one of several films."""
    if progress is None:
        return None
    return lambda done: progress((k + done) / count)


def _film(
    source: Run | str | Path,
    record: Record,
    progress: Callable[[float], None] | None,
) -> bytes | None:
    """Return a run in 3D; None for the simplified model, which has no body."""
    if record.settings.get("plant") == "pendulum":
        return None
    recording = recording_of(source, geometry=True)
    duration = float(recording.t[-1] - recording.t[0])
    fps = max(1.0, min(_FPS, _MOST / max(duration, 1e-3)))
    return scene_film(recording, fps=fps, progress=progress)


def _player() -> str:
    """Return viser's page, which plays films without a server."""
    spec = find_spec("viser")
    if spec is None or spec.origin is None:
        raise RunError("a report needs viser: pip install viser")
    path = Path(spec.origin).parent / "client" / "build" / "index.html"
    return path.read_text(encoding="utf-8")
