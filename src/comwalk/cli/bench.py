"""The command `comwalk bench`: try robots, print tables, write the document."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from ..bench import (
    ABLATIONS,
    DEFAULT,
    OPEN_LOOP,
    PUSH_SHARES,
    REPORT_SEEDS,
    TORQUE,
    TUNING_SEEDS,
    Ablation,
    Case,
    Findings,
    Job,
    all_cases,
    chosen,
    jobs_of,
    known_jobs,
    run_jobs,
    tables_of_findings,
    write_report,
)
from ..errors import ParameterError, RunError, checked_count, nearest
from ..robot.loaders import ROBOTS
from ..runs import prepare_folder
from .output import print_json, print_table, print_text
from .progress import counting_bar

DOCUMENT = Path("docs/robots.md")
"""Where --write writes, from the root of the repository."""

_MAX_WORKERS = 256


def bench(
    what: Annotated[
        Literal["robots"], Parameter(help="What to try: all that robots should do.")
    ] = "robots",
    /,
    *,
    robots: Annotated[
        str | None, Parameter(help="Names or files, comma-separated; all if not given.")
    ] = None,
    cases: Annotated[
        str | None,
        Parameter(help="Groups of cases, comma-separated, such as forward,push,floor."),
    ] = None,
    ablations: Annotated[
        str | None,
        Parameter(
            help="Other controllers for the walk forward and the floors, "
            f"comma-separated: {', '.join(a.name for a in ABLATIONS)}; or all "
            "(default open loop, torque)."
        ),
    ] = None,
    quick: Annotated[
        bool,
        Parameter(help="Three floors a height, one time of pushes.", negative=()),
    ] = False,
    workers: Annotated[
        int | None, Parameter(help="Processes; one per processor if not given.")
    ] = None,
    out: Annotated[Path, Parameter(help="Folder of the ledger of results.")] = Path(
        "runs/bench"
    ),
    write: Annotated[
        bool,
        Parameter(
            help="Use the floors kept for reports, and write docs/robots.md of all "
            "that the ledger holds from this code.",
            negative=(),
        ),
    ] = False,
    json: Annotated[
        bool, Parameter(help="Print one JSON object instead of tables.", negative=())
    ] = False,
) -> int:
    """Try robots on walks, dances, rough floors, pushes and loads; see how far they go.

    What the ledger holds from the same code is not done again. Exit code 1 if a robot
    did not complete one of the walks and dances.
    """
    if write and not DOCUMENT.parent.is_dir():
        raise RunError("--write needs the folder docs; start at the root of the source")
    cases_done = _cases(_listed(cases), quick, write)
    others = _ablations(_listed(ablations))
    jobs = jobs_of(_listed(robots) or ROBOTS, cases_done, others)
    processes = (os.cpu_count() or 1) if workers is None else workers
    checked_count("workers", processes, 1, _MAX_WORKERS)
    folder = prepare_folder(out)
    with counting_bar("trials", len(jobs), quiet=json) as progress:
        ledger = folder / "results.jsonl"
        results = run_jobs(jobs, ledger, workers=processes, progress=progress)
    findings = Findings(jobs, results)
    if write:
        every = jobs_of(ROBOTS, all_cases(REPORT_SEEDS), ABLATIONS)
        known, found = known_jobs(every, ledger)
        keys = {job.key for job in known}
        new = [k for k, job in enumerate(jobs) if job.key not in keys]
        gathered = Findings(
            [*known, *(jobs[k] for k in new)], [*found, *(results[k] for k in new)]
        )
        for fault in write_report(gathered, DOCUMENT):
            print(f"comwalk: {fault}", file=sys.stderr)
    _print_results(findings) if json else _print_tables(findings)
    return int(any(_failed(*pair) for pair in zip(jobs, results, strict=True)))


def _cases(names: list[str], quick: bool, write: bool) -> tuple[Case, ...]:
    """Return the cases of each robot."""
    seeds = REPORT_SEEDS if write else TUNING_SEEDS
    every = all_cases(seeds[:3] if quick else seeds)
    if quick:
        every = tuple(case for case in every if _is_quick(case))
    return chosen(every, names)


def _ablations(names: list[str]) -> list[Ablation]:
    """Return controllers by name."""
    known = {ablation.name: ablation for ablation in ABLATIONS}
    for name in names:
        if name not in known and name != "all":
            raise ParameterError(f'unknown ablation "{name}"; {nearest(name, known)}')
    if "all" in names:
        return list(ABLATIONS)
    return [known[name] for name in names] or [OPEN_LOOP, TORQUE]


def _listed(text: str | None) -> list[str]:
    return [word for part in (text or "").split(",") if (word := part.strip())]


def _is_quick(case: Case) -> bool:
    return case.push is None or case.push.share == PUSH_SHARES[1]


def _failed(job: Job, result: dict[str, Any]) -> bool:
    """Return whether a walk or dance on a flat floor was not completed."""
    plain = job.case.task in ("walk", "dance") and not any(
        key.startswith("simulator.") for key in job.case.keys
    )
    default = job.ablation.name == DEFAULT.name
    return plain and default and result["outcome"] != "completed"


def _print_results(findings: Findings) -> None:
    """Print all results."""
    rows = [
        {
            "robot": job.robot,
            "case": job.case.name,
            "ablation": job.ablation.name,
            **result,
        }
        for job, result in zip(findings.jobs, findings.results, strict=True)
    ]
    print_json(rows)


def _print_tables(findings: Findings) -> None:
    """Print all tables, and why anything was refused."""
    for title, head, rows in tables_of_findings(findings):
        print_table(rows, head, title)
        print()
    causes: dict[tuple[str, str], list[str]] = {}
    for job, result in zip(findings.jobs, findings.results, strict=True):
        if result["outcome"] == "refused":
            causes.setdefault((job.robot, result["cause"]), []).append(job.case.name)
    for (robot, cause), names in causes.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        print_text(f"{robot}, {names[0]}{more}, refused: {cause}")
