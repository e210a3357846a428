"""Run trials on all processors, each one once: a ledger stores the results.

The key of a result is a digest of robot, case and comwalk's own source: what has been
found by the same code is read, not done again, after a kill as well.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import ParameterError, RunError
from ..run import plain
from ..runs import versions
from .cases import DEFAULT, OPEN_LOOP, TORQUE, Ablation, Case
from .trials import perform

_SHOWN = ("bench", "cli", "views")  # packages that change no result

_SOURCES = (".py", ".toml", ".urdf", ".xml")

Result = dict[str, Any]
"""Plain numbers and names, as `perform` returns them."""

Perform = Callable[[str, Case], Result]
"""Does a case with a robot; must be found by name in another process."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A case for one robot under one controller."""

    robot: str
    """Name or file of the robot."""
    case: Case
    """What to do."""
    ablation: Ablation = DEFAULT
    """The controller."""

    @property
    def key(self) -> str:
        """Digest of all that the result depends on."""
        case = plain(self.ablation.of(self.case))
        what = [self.robot, case, source_digest(), _versions()]
        if Path(self.robot).is_file():
            what.append(_digest(Path(self.robot).read_bytes()))
        return _digest(json.dumps(what, sort_keys=True).encode())


@cache
def source_digest() -> str:
    """Return a digest of the source that results depend on, robots included."""
    root = Path(__file__).parents[1]
    files = [p for p in sorted(root.rglob("*")) if p.suffix in _SOURCES]
    parts = [
        f"{p.relative_to(root)} {_digest(p.read_bytes())}"
        for p in files
        if p.relative_to(root).parts[0] not in _SHOWN
    ]
    return _digest("\n".join(parts).encode())


@cache
def _versions() -> dict[str, str]:
    return versions()


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:20]


def jobs_of(
    robots: Iterable[str],
    cases: Iterable[Case],
    ablations: Iterable[Ablation] = (OPEN_LOOP, TORQUE),
) -> list[Job]:
    """Return the jobs of a bench: the walk forward and floors with ablations too.

    Torques also do all other walks and dances.

    Args:
        robots: Names or files.
        cases: What each does with the default controller.
        ablations: Other controllers, to compare.

    Returns:
        The jobs, robot by robot.
    """
    cases, others = tuple(cases), tuple(ablations)
    return [
        Job(robot=robot, case=case, ablation=ablation)
        for robot in robots
        for case in cases
        for ablation in (DEFAULT, *(x for x in others if _compares(x, case)))
    ]


_COMPARED = ("forward", "floor", "payload")  # groups that ablations do too


def _compares(ablation: Ablation, case: Case) -> bool:
    moves = case.task in ("walk", "dance")
    return case.group in _COMPARED or (ablation == TORQUE and moves)


def chosen(cases: Sequence[Case], names: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases whose names begin with some words.

    Args:
        cases: All cases.
        names: First words, such as "floor" or "floor 10 mm"; all if empty.

    Returns:
        Those chosen, in the order of all.

    Raises:
        ParameterError: If a name is unknown.
    """
    wanted = [name.split() for name in names]
    for words in wanted:
        if not any(case.name.split()[: len(words)] == words for case in cases):
            groups = ", ".join(dict.fromkeys(case.group for case in cases))
            raise ParameterError(
                f'unknown case "{" ".join(words)}"; there are {groups}'
            )
    return tuple(
        case
        for case in cases
        if not wanted or any(case.name.split()[: len(w)] == w for w in wanted)
    )


# ---- The ledger -------------------------------------------------------------------


def read_ledger(path: Path) -> dict[str, Result]:
    """Return the results so far.

    Args:
        path: A file of one JSON object a line; need not exist.

    Returns:
        Results by the key of their job. A line that was cut short is left out.

    Raises:
        RunError: If the file cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"cannot read the ledger {path}: {error}") from None
    found: dict[str, Result] = {}
    for line in lines:
        try:
            entry = json.loads(line)
            found[entry["key"]] = entry["result"]
        except (ValueError, KeyError, TypeError):
            continue
    return found


def write_entry(path: Path, job: Job, result: Mapping[str, Any]) -> None:
    """Add a result to a ledger, so that it survives a kill right after.

    Args:
        path: The ledger.
        job: What was done.
        result: What was found.

    Raises:
        RunError: If it cannot be written.
    """
    names = {
        "robot": job.robot,
        "case": job.case.name,
        "ablation": job.ablation.name,
    }
    line = json.dumps({"key": job.key, **names, "result": result}, allow_nan=False)
    try:
        with path.open("a+b") as file:
            file.seek(0, os.SEEK_END)
            if file.tell():
                file.seek(-1, os.SEEK_END)
                if file.read(1) != b"\n":  # the line before was cut short
                    file.write(b"\n")
            file.write(line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise RunError(f"cannot write the ledger {path}: {error.strerror}") from None


# ---- Doing it ---------------------------------------------------------------------


def run_jobs(
    jobs: Sequence[Job],
    ledger: Path,
    *,
    workers: int = 1,
    perform: Perform = perform,
    progress: Callable[[int], None] | None = None,
) -> list[Result]:
    """Do what the ledger does not have yet, and return all results.

    Args:
        jobs: What to do.
        ledger: File of results; its folder must exist.
        workers: Number of processes; 1 works in this one.
        perform: What does a case.
        progress: Called with the number of jobs that are done, known ones included.

    Returns:
        The result of each job.

    Raises:
        RunError: If the ledger cannot be read or written, or a process was killed.
    """
    keys, known = [job.key for job in jobs], read_ledger(ledger)
    missing = {k: j for k, j in zip(keys, jobs, strict=True) if k not in known}

    def say() -> None:
        if progress is not None:
            progress(sum(key in known for key in keys))

    def keep(job: Job, result: Result) -> None:
        write_entry(ledger, job, result)
        known[job.key] = result
        say()

    say()
    if workers == 1:
        for job in missing.values():
            keep(job, perform(job.robot, job.ablation.of(job.case)))
    elif missing:
        _share_out(list(missing.values()), workers, perform, keep)
    return [known[key] for key in keys]


def known_jobs(jobs: Sequence[Job], ledger: Path) -> tuple[list[Job], list[Result]]:
    """Return those of some jobs that a ledger has the results of.

    Args:
        jobs: What could have been done.
        ledger: File of results.

    Returns:
        The jobs that were done with this very code, and their results.

    Raises:
        RunError: If the ledger cannot be read.
    """
    known = read_ledger(ledger)
    done = [(job, known[key]) for job in jobs if (key := job.key) in known]
    return [job for job, _ in done], [result for _, result in done]


def _share_out(
    jobs: Sequence[Job],
    workers: int,
    perform: Perform,
    keep: Callable[[Job, Result], None],
) -> None:
    """Do jobs in several processes, and keep each result as soon as it is there."""
    # Fresh processes: a copy of one that runs MuJoCo's or BLAS's threads may hang.
    context = multiprocessing.get_context("spawn")
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # each process is one thread
    count = min(workers, len(jobs))
    with ProcessPoolExecutor(count, context, initializer=_end_with_parent) as pool:
        pending: dict[Future[Result], Job] = {
            pool.submit(perform, job.robot, job.ablation.of(job.case)): job
            for job in jobs
        }
        try:
            for future in as_completed(pending):
                keep(pending[future], future.result())
        except BrokenProcessPool:
            raise RunError(
                "a process of the bench was killed, for lack of memory perhaps; take "
                "fewer --workers and start again: what was found is kept"
            ) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """Make this process end when the one that started it is killed."""
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
