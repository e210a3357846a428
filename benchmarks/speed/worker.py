"""Run in one interpreter whatever candidates are installed there.

python worker.py times FOLDER ROUNDS NAMES   each problem of the folder, as JSON
python worker.py first FILE NAME BEGAN       seconds and memory to the first answer
python worker.py has                         names of what is installed here, as JSON
"""

from __future__ import annotations

import json
import resource
import sys
import time
import warnings
from pathlib import Path
from typing import Any


def main(words: list[str]) -> None:
    """Do what the words say; the last line printed is JSON."""
    what, *rest = words
    answer = {"times": times, "first": first, "has": has}[what](*rest)
    print(json.dumps(answer))


def has() -> dict[str, Any]:
    """Return what is installed here."""
    from candidates import FLOORS, OWN, PLAIN
    from peers import PEERS

    every = (*OWN, *FLOORS, *PLAIN, *PEERS)
    missing = {c.name: c.missing for c in every}
    return {"missing": missing, "versions": versions()}


def versions() -> dict[str, str]:
    """Return the versions of what matters."""
    from importlib import metadata

    names = ("numpy", "numba", "mujoco", "pin", "pin-pink", "mink", "placo", "tsid")
    names = (*names, "daqp", "quadprog")
    found = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {"python": sys.version.split()[0], **found}


def times(folder: str, rounds: str, names: str) -> list[dict[str, Any]]:
    """Time the named candidates on each problem, ours with them."""
    import numpy as np
    from candidates import FLOORS, OURS, OWN, PLAIN
    from measure import interleaved
    from peers import PEERS
    from problem import load_problem

    wanted = [OURS, *json.loads(names)]
    every = [c for c in (*OWN, *FLOORS, *PLAIN, *PEERS) if c.name in wanted]
    rows = []
    for path in sorted(Path(folder).glob("*.pickle")):
        problem, calls, answers, readers = load_problem(path), {}, {}, {}
        for candidate in every:
            calls[candidate.name], readers[candidate.name] = candidate.make(problem)
        for name, read in readers.items():
            if read is not None:
                states = range(len(problem))
                answer = [read(k, calls[name](k)) for k in states]
                answers[name] = np.array(answer)
        found = interleaved(calls, OURS, rounds=int(rounds), states=len(problem))
        for candidate in every:
            row = {"problem": path.stem, "name": candidate.name}
            row |= found[candidate.name]
            if candidate.name in answers:
                v = answers[candidate.name]
                row["residual"], row["wished"] = problem.residual(v)
                row["difference"] = float(np.abs(v - answers[OURS]).max())
                if candidate.settle is not None:
                    row["agrees"] = row["residual"] <= candidate.settle
            rows.append(row)
    return rows


def first(file: str, name: str, began: str) -> dict[str, float]:
    """Return time from `began` [s] to the first answer, and memory then [MB]."""
    from candidates import OWN
    from problem import load_problem

    problem = load_problem(Path(file))
    candidate = next((c for c in OWN if c.name == name), None)
    if candidate is None:
        from peers import PEERS

        candidate = next(c for c in PEERS if c.name == name)
    tick, _ = candidate.make(problem)
    tick(0)
    seconds = time.time() - float(began)
    return {"seconds": seconds, "computing": time.process_time(), "memory": _peak()}


def _peak() -> float:
    """Return the most memory that this program had, its parent's left out [MB]."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines = status.read_text(encoding="utf-8").splitlines()
    return float(next(x for x in lines if x.startswith("VmHWM")).split()[1]) / 1024


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(sys.argv[1:])
