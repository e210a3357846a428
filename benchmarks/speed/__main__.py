"""How fast comwalk is, beside what else there is: `python benchmarks/speed`.

    python benchmarks/speed                                   all that is quick
    python benchmarks/speed resolution --peer-python placo=/venv/bin/python
    python benchmarks/speed realtime --seconds 60
    python benchmarks/speed --save now.json --compare before.json --write

Peers that are not installed are named and left out. One that needs other versions of
pinocchio than the rest runs in an interpreter of its own, ours beside it in the same
process; docs/speed.md says how to make one.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before anything loads numpy

from candidates import FLOORS, OWN, PLAIN
from growth import closed_loop, robots_at_once, with_joints
from pattern import others, planning, replanning
from peers import PEERS
from problem import ROBOTS, TASKS, make_problem, save_problem
from realtime import realtime
from startup import environment, startup
from tables import document, print_tables, readme, replaced

SECTIONS = ("resolution", "pattern", "start", "growth", "loop", "realtime")
HOW = {
    "real-time priority": {},
    "usual priority": {"priority": False},
}
"""How the loop of `realtime` runs."""
WORKER = Path(__file__).parent / "worker.py"
ROOT = Path(__file__).parents[2]


def main() -> int:
    """Measure, print, save, compare, write; 1 if an answer is wrong."""
    options = _options()
    peers = dict(pair.partition("=")[::2] for pair in options.peer_python)
    before = json.loads(options.compare.read_text()) if options.compare else None
    result: dict[str, Any] = {"machine": machine(), "sections": {}}
    if options.add:
        result = json.loads(options.add.read_text())
    for section in options.sections or SECTIONS:
        result["sections"][section] = _section(section, options, peers)
        if options.save:
            options.save.write_text(json.dumps(result, indent=1) + "\n")
    print_tables(result, before)
    if options.write:
        replaced(ROOT / "docs" / "speed.md", document(result))
        replaced(ROOT / "README.md", readme(result))
    rows = result["sections"].get("resolution", {}).get("rows", [])
    wrong = [row for row in rows if row.get("agrees") is False]
    for row in wrong:
        print(f"WRONG: {row['problem']}, {row['name']}: {row['residual']:.2g}")
    return int(bool(wrong))


def _options() -> argparse.Namespace:
    """Return the options given."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("sections", nargs="*", metavar="section", help=str(SECTIONS))
    parser.add_argument(
        "--peer-python",
        action="append",
        default=[],
        metavar="PEER=PYTHON",
        help="interpreter of the peers whose name begins so, such as placo",
    )
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=60.0, help="of realtime")
    parser.add_argument("--save", type=Path, help="write all numbers, as JSON")
    parser.add_argument("--add", type=Path, help="begin with the numbers of a file")
    parser.add_argument("--compare", type=Path, help="show ratios to a file of --save")
    parser.add_argument("--write", action="store_true", help="docs and README")
    options = parser.parse_args()
    if unknown := set(options.sections) - set(SECTIONS):
        parser.error(
            f"unknown section {unknown.pop()}; there are {', '.join(SECTIONS)}"
        )
    return options


def _section(name: str, options: argparse.Namespace, peers: dict[str, str]) -> Any:
    """Return the numbers of a section."""
    robots, rounds = tuple(options.robots.split(",")), options.rounds
    if name == "resolution":
        return resolution(robots, rounds, peers)
    if name == "start":
        return {"rows": startup(5), "first": first_answers(robots[-1], peers)}
    if name == "pattern":
        ways, plans = others(max(3, rounds // 8)), planning(max(5, rounds // 4))
        return {"ways": ways, "plans": plans, "anew": replanning(rounds)}
    if name == "growth":
        joints = with_joints(max(5, rounds // 4))
        return {"joints": joints, "robots": robots_at_once(robots[-1])}
    if name == "loop":
        return closed_loop((*robots[1:], "paper"), 8)
    return {
        "rows": [
            {"how": how, **realtime(robots[-1], seconds=options.seconds, **k)}
            for how, k in HOW.items()
        ]
    }


def machine() -> dict[str, Any]:
    """Return what the numbers were taken on."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        models = (x.partition(":")[2].strip() for x in lines if "model name" in x)
        cpu = next(models, cpu)
    when = time.strftime("%Y-%m-%d")
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "when": when,
    }


# ---- Interpreters ------------------------------------------------------------------


def run(python: str, *words: str, kernels: str | None = None) -> Any:
    """Return what a worker answers."""
    variables = environment(Path(kernels)) if kernels else dict(os.environ)
    program = [python, str(WORKER), *words]
    source = str(ROOT / "src")
    variables["PYTHONPATH"] = source
    done = subprocess.run(
        program, capture_output=True, text=True, check=False, env=variables
    )
    if done.returncode:
        raise SystemExit(f"{python}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def placed(peers: dict[str, str]) -> tuple[dict[str, list[str]], list[str]]:
    """Return which peers run in which interpreter, and a line for each that is none.

    Args:
        peers: Interpreters by the first letters of the peers' names.
    """
    found: dict[str, list[str]] = {sys.executable: []}
    installed = {p: run(p, "has")["missing"] for p in {sys.executable, *peers.values()}}
    missing: dict[str, list[str]] = {}
    for candidate in PEERS:
        own = (p for name, p in peers.items() if _begins(candidate.name, name))
        python = next(own, sys.executable)
        if lacking := installed[python][candidate.name]:
            missing[candidate.name.partition(",")[0]] = lacking
        else:
            found.setdefault(python, []).append(candidate.name)
    lines = [f"{n} is left out: no module {', '.join(m)}" for n, m in missing.items()]
    return found, lines


def _begins(name: str, start: str) -> bool:
    """Return whether a name begins with some letters, in any case."""
    return name.lower().startswith(start.lower())


def resolution(
    robots: tuple[str, ...], rounds: int, peers: dict[str, str]
) -> dict[str, Any]:
    """Return times and answers of all candidates on all robots and tasks."""
    plan, missing = placed(peers)
    rows: list[dict[str, Any]] = []
    versions = {}
    with tempfile.TemporaryDirectory() as folder:
        for robot in robots:
            for task in TASKS:
                problem = make_problem(robot, task)
                save_problem(problem, Path(folder) / f"{robot} {task}.pickle")
        for python, names in plan.items():
            own = [c.name for c in (*OWN, *FLOORS, *PLAIN)] if not rows else []
            more = run(python, "times", folder, str(rounds), json.dumps([*own, *names]))
            seen = {(row["problem"], row["name"]) for row in rows}
            rows += [r for r in more if (r["problem"], r["name"]) not in seen]
            versions |= {n: run(python, "has")["versions"] for n in names}
    return {"rows": rows, "missing": missing, "versions": versions}


def first_answers(robot: str, peers: dict[str, str]) -> list[dict[str, Any]]:
    """Return time and memory to the first answer, in processes of their own."""
    plan, _ = placed(peers)
    chosen = ("pink, daqp", "mink, daqp", "placo (C++)", "TSID (C++), with forces")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.pickle"
        save_problem(make_problem(robot, "hands", 2), file)

        def begin(python: str, name: str, kernels: str) -> dict[str, float]:
            words = ("first", str(file), name, str(time.time()))
            return run(python, *words, kernels=str(Path(folder) / kernels))

        for python, names in plan.items():
            own = [c.name for c in OWN[:2]] if not rows else []
            for name in [*own, *(n for n in names if n in chosen)]:
                cold = begin(python, name, "kept")
                warm = min((begin(python, name, "kept") for _ in range(3)),
                           key=lambda row: row["seconds"])  # fmt: skip
                row = {"name": name, "cold": cold["seconds"], **warm}
                rows.append({**row, "cold_computing": cold["computing"]})
    return rows


if __name__ == "__main__":
    sys.exit(main())
