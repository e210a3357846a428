"""The commands `comwalk report` and `comwalk film`: pages, films and stills of runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from ..config import RobotConfig
from ..errors import ComwalkError, ParameterError, RunError, one_line, printable
from ..run import Run
from ..runs import (
    LogFacts,
    export_csv,
    export_parquet,
    export_rosbag2,
    inspect,
    log_path,
)
from ..views import STILLS, check_film
from .output import print_json, print_table, short_number
from .progress import share_bar


def report(
    run: Annotated[Path, Parameter(help="Folder of a run.")],
    other: Annotated[
        Path | None, Parameter(help="Folder of another run, shown beside the first.")
    ] = None,
    /,
    *,
    out: Annotated[
        Path | None,
        Parameter(
            help="The file; report.html in the run's folder if not given, "
            "against-OTHER.html for two."
        ),
    ] = None,
    open: Annotated[
        bool, Parameter(help="Open it in the browser.", negative=())
    ] = False,
) -> int:
    """Write a run, or two side by side, as one page that works without a network.

    It holds the walk in 3D, the figures, the summary, the settings and the command that
    repeats the run.
    """
    from ..views import report as report_of

    sources = (run,) if other is None else (run, other)
    default = "report" if other is None else f"against-{other.resolve().name}"
    path = out or run / f"{default}.html"
    with share_bar("report") as progress:
        page = report_of(*sources, progress=progress)
    page.save(path)
    print(f"written to {path} ({path.stat().st_size / 1e6:.1f} MB)")
    if open:
        import webbrowser

        webbrowser.open(path.resolve().as_uri())
    return 0


def film(
    run: Annotated[Path, Parameter(help="Folder of a run.")],
    out: Annotated[
        Path,
        Parameter(
            help="The file: .mp4 (pip install 'comwalk[video]'), .webp and .gif are "
            "films, .png and .jpg stills."
        ),
    ],
    /,
    *,
    time: Annotated[
        float | None, Parameter(help="When a single still is taken [s].")
    ] = None,
    count: Annotated[int, Parameter(help="Stills side by side, without --time.")] = 5,
    start: Annotated[float, Parameter(help="When it starts [s].")] = 0.0,
    stop: Annotated[
        float | None, Parameter(help="When it ends [s]; the end if not given.")
    ] = None,
    fps: Annotated[float, Parameter(help="Pictures per second of a film.")] = 25.0,
    width: Annotated[int, Parameter(help="Width of a picture [pixel].")] = 640,
    height: Annotated[int, Parameter(help="Height of a picture [pixel].")] = 480,
) -> int:
    """Film a run, or take stills of it, without a window."""
    check_film(out)
    from ..views import View, render_run, render_still

    view = View(width=width, height=height, shadows=True, smooth=2)
    if time is not None:
        if out.suffix.lower() not in (*STILLS, ".webp"):
            raise ParameterError(f"--time takes a still, such as .png, not {out.name}")
        render_still(run, out, time, view=view)
    else:
        with share_bar("film") as progress:
            render_run(
                run,
                out,
                view=view,
                start=start,
                stop=stop,
                fps=fps,
                count=count,
                progress=progress,
            )
    print(f"written to {out} ({out.stat().st_size / 1e6:.2f} MB)")
    return 0


def check_wishes(settings: RobotConfig) -> None:
    """Refuse films that could not be written, before hours are spent on a run.

    Args:
        settings: What was asked for.

    Raises:
        RunError: If an ending is unknown, or a package is missing.
    """
    for path in settings.video:
        check_film(path)


def fulfil_wishes(run: Run, folder: Path, settings: RobotConfig) -> bool:
    """Write the page and the films of a run that were asked for.

    What cannot be written is told in one line each, and hinders nothing else.

    Args:
        run: The run, which is saved.
        folder: Its folder.
        settings: What was asked for.

    Returns:
        Whether all of it was written.
    """
    wishes = [(Path(path), _write_film) for path in settings.video]
    if settings.report:
        wishes.insert(0, (folder / "report.html", _write_report))
    failed = 0
    for path, write in wishes:
        try:
            write(run, path, settings.json)
        except ComwalkError as error:
            failed += 1
            print(f"comwalk: {printable(one_line(error))}", file=sys.stderr)
            continue
        if not settings.json:
            print(f"written to {path} ({path.stat().st_size / 1e6:.2f} MB)")
    return not failed


def _write_report(run: Run, path: Path, quiet: bool) -> None:
    """Write the page of a run, named after its folder."""
    from ..views import report as report_of

    with share_bar("report", quiet) as progress:
        report_of(run, names=[path.resolve().parent.name], progress=progress).save(path)


def _write_film(run: Run, path: Path, quiet: bool) -> None:
    """Write a film or stills of a run."""
    from ..views import View, render_run

    view = View(shadows=True, smooth=2)
    with share_bar("film", quiet) as progress:
        render_run(run, path, view=view, fps=25.0, progress=progress)


_Run = Annotated[Path, Parameter(help="Folder of a run, or its run.mcap.")]
_Json = Annotated[
    bool, Parameter(help="Print one JSON object instead of a table.", negative=())
]


def log(run: _Run, /, *, json: _Json = False) -> int:
    """Tell what a run holds as ROS 2 messages; a killed run is saved first."""
    path = log_path(run)
    with Console(stderr=True).status("reading"):
        facts = inspect(path)
    if json:
        print_json(_table_of(facts, path))
        return 0
    print_table(_about(facts))
    rows = []
    for topic in facts.topics:
        times = f"{topic.first_s:.3f} s", f"{topic.last_s:.3f} s"
        rate = short_number(topic.rate)
        rows.append((topic.topic, str(topic.messages), rate, *times, topic.kind))
    print_table(rows, ("topic", "messages", "Hz", "from", "to", "type"))
    print(f"in {path}")
    return 0


def _about(facts: LogFacts) -> list[tuple[str, str]]:
    """Return the rows of a table about the whole log."""
    robot, command = facts.settings.get("robot"), facts.settings.get("command")
    rows = [("outcome", facts.outcome or "not known: the run was killed before")]
    rows += [("robot", robot)] if robot else []
    rows += [("command", command)] if command else []
    return rows


def _table_of(facts: LogFacts, path: Path) -> dict[str, Any]:
    """Return the contents of a log, ready for JSON."""
    topics = [
        {"topic": t.topic, "type": t.kind, "messages": t.messages, "rate_hz": t.rate}
        | {"first_s": t.first_s, "last_s": t.last_s}
        for t in facts.topics
    ]
    return {
        "log": str(path),
        "outcome": facts.outcome,
        "duration_s": facts.duration,
        "messages": facts.messages,
        "topics": topics,
        "settings": facts.settings,
    }


def export(
    run: _Run,
    /,
    *,
    csv: Annotated[bool, Parameter(help="A CSV file a topic.", negative=())] = False,
    parquet: Annotated[
        bool,
        Parameter(
            help="A Parquet file a topic (pip install 'comwalk[parquet]').", negative=()
        ),
    ] = False,
    rosbag2: Annotated[
        bool, Parameter(help="A folder for `ros2 bag play`.", negative=())
    ] = False,
    out: Annotated[
        Path | None,
        Parameter(help="Where the folders csv, parquet, rosbag2 go; RUN if not given."),
    ] = None,
    json: _Json = False,
) -> int:
    """Write a run for other programs; one that was killed, as far as it came."""
    folder = run if run.is_dir() else run.parent
    if not run.exists():
        raise RunError(f"{run} is not a run: there is no such folder")
    asked = {"csv": csv, "parquet": parquet, "rosbag2": rosbag2}
    if not any(asked.values()):
        raise ParameterError("say what to export: --csv, --parquet or --rosbag2")
    base, written = folder if out is None else out, {}
    with Console(stderr=True).status("exporting"):
        for name, write in _WRITERS.items():
            if asked[name]:
                written[name] = [str(file) for file in write(folder, base / name)]
    if json:
        print_json({"files": written})
        return 0
    for name, files in written.items():
        print(f"{len(files)} files in {base / name}")
    return 0


_WRITERS = {"csv": export_csv, "parquet": export_parquet, "rosbag2": export_rosbag2}
