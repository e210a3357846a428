"""Tables of the measurements, for a terminal, for docs/speed.md and for the README.

They are the same Markdown; a document has `<!-- name -->` and `<!-- /name -->` around
each table that is written here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from candidates import OURS

Row = Mapping[str, Any]

_IN_README = (
    OURS,
    "comwalk, without numba",
    "placo (C++)",
    "TSID (C++), with forces",
    "mink, daqp",
    "pink, daqp",
    "numpy lstsq, whole body",
    "MuJoCo's C kinematics alone",
)
"""Candidates that the README shows."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


# ---- Kinematics and resolution ------------------------------------------------------


def resolution(section: Row, names: Sequence[str] | None = None) -> str:
    """Return medians of all candidates and problems, and ratios to ours."""
    rows, problems = section["rows"], _problems(section)
    cells = {(row["name"], row["problem"]): row for row in rows}
    known = list(dict.fromkeys(row["name"] for row in rows))
    lines = []
    for name in known if names is None else [n for n in names if n in known]:
        own = [cells[name, problem] for problem in problems]
        lines.append([_named(name), *(_time(r["median"]) for r in own), _times(own)])
    return table(["us per call, median", *problems, "times ours"], lines)


def tails(section: Row) -> str:
    """Return the 99th percentiles."""
    rows, problems = section["rows"], _problems(section)
    cells = {(row["name"], row["problem"]): row for row in rows}
    known = dict.fromkeys(row["name"] for row in rows)
    lines = [
        [_named(name), *(_time(cells[name, problem]["p99"]) for problem in problems)]
        for name in known
    ]
    return table(["us per call, 99th percentile", *problems], lines)


def answers(section: Row) -> str:
    """Return what each answer leaves undone, the worst of all robots and states."""
    lines = []
    for name in dict.fromkeys(row["name"] for row in section["rows"]):
        own = [r for r in section["rows"] if r["name"] == name and "residual" in r]
        if own:
            worst = {
                task: max(r["difference"] for r in own if task in r["problem"])
                for task in ("hands", "arms")
            }
            residual = max(row["residual"] for row in own)
            numbers = (residual, worst["arms"], worst["hands"])
            lines.append([name, *(f"{x:.1g}" for x in numbers)])
    head = ["", "largest task residual", "differs from ours, arms", "hands"]
    return table(head, lines)


def _problems(section: Row) -> list[str]:
    """Return the names of the problems."""
    return list(dict.fromkeys(row["problem"] for row in section["rows"]))


def _named(name: str) -> str:
    """Return a name as it stands in a table: ours is bold."""
    return f"**{name}**" if name == OURS else name


def _time(us: float) -> str:
    """Return microseconds with three digits."""
    return f"{us:.2f}" if us < 9.995 else f"{us:.1f}" if us < 99.95 else f"{us:.0f}"


def _times(rows: Sequence[Row]) -> str:
    """Return the range of ratios over the problems."""
    ratios = [row["ratio"] for row in rows]
    low, high = min(ratios), max(ratios)
    if rows[0]["name"] == OURS:
        return "1"
    form = "{:.1f}" if high < 9.95 else "{:.0f}"
    ends = (form.format(low), form.format(high))
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} - {ends[1]}"


# ---- The rest ---------------------------------------------------------------------


def start(section: Row) -> str:
    """Return seconds until something happens."""
    rows = section["rows"]
    lines = [
        [r["name"], *(f"{r[key]:.2f}" for key in ("cold", "warm", "computing"))]
        for r in rows
    ]
    return table(["seconds from the start of the process", "cold", "warm", "of which computing"], lines)  # fmt: skip  # noqa: E501


def first(section: Row) -> str:
    """Return seconds and memory to the first answer."""
    lines = [
        [
            _named(row["name"]),
            *(f"{row[k]:.2f}" for k in ("cold", "cold_computing")),
            *(f"{row[k]:.2f}" for k in ("seconds", "computing")),
            f"{row['memory']:.0f}",
        ]
        for row in section["first"]
    ]
    head = ["to the first answer", "cold [s]", "of which computing", "warm [s]"]
    return table([*head, "of which computing", "memory [MB]"], lines)


def joints(section: Row) -> str:
    """Return how times grow with a robot's joints."""
    lines = [
        [str(row["joints"]), _time(row["us"]), _time(row["C_us"])]
        for row in section["joints"]
    ]
    head = ["joints", "comwalk, arms [us]", "MuJoCo's C kinematics and Jacobians [us]"]
    return table(head, lines)


def robots(section: Row) -> str:
    """Return how many ticks are made per second, by the number of robots."""
    lines = [
        [
            f"{row['robots']:,}",
            f"{1e-6 * row['pendulums']:.0f}",
            f"{1e-3 * row['whole_bodies']:.0f}",
        ]
        for row in section["robots"]
    ]
    head = ["robots at once", "simplified model [million robot-ticks/s]"]
    return table([*head, "whole body [thousand robot-ticks/s]"], lines)


def ways(section: Row) -> str:
    """Return the pattern beside other ways to CoM trajectories."""
    lines = [
        [
            _named(row["name"]),
            f"{1e-3 * row['median']:.2f}",
            f"{row['ratio']:.0f}",
            "-" if row["away"] is None else f"{1e3 * row['away']:.1f}",
        ]
        for row in section["ways"]
    ]
    head = ["a walk of 20 steps, sampled each 5 ms", "ms", "times ours"]
    return table([*head, "largest distance from our CoM [mm]"], lines)


def plans(section: Row) -> str:
    """Return how planning grows with the steps."""
    lines = [
        [f"{row['steps']:,}", _time(row["compiled"]), _time(row["objects"])]
        for row in section["plans"]
    ]
    return table(["steps", "compiled, on arrays [us]", "`make_pattern` [us]"], lines)


def anew(section: Row) -> str:
    """Return the time to plan anew while walking."""
    lines = [[name, _time(us)] for name, us in section["anew"].items()]
    return table(["`OnlinePattern`, while it walks", "us"], lines)


def loop(section: Sequence[Row]) -> str:
    """Return real-time factors."""
    lines = [
        [
            row["robot"] + ("" if row["outcome"] else " (fell)"),
            f"{row['real_time_factor']:.1f}",
            f"{row['physics_alone']:.1f}",
            *(_time(row[key]) for key in ("tick_us_p50", "tick_us_p99", "physics_us")),
        ]
        for row in section
    ]
    head = ["robot", "real-time factor", "physics alone", "tick, median [us]"]
    return table([*head, "tick, 99th percentile", "physics step [us]"], lines)


def realtime(section: Row) -> str:
    """Return how well deadlines were kept."""
    kept = ("p50", "p99", "max")
    lines = [
        [
            row["how"],
            f"{row['late_ticks']} of {row['ticks']:,}",
            f"{100 * row['late_share']:.2g} %",
            _time(row["worst_lateness_us"]),
            " / ".join(_time(row[f"done_us_{k}"]) for k in kept),
        ]
        for row in section["rows"]
    ]
    head = ["how it ran", "late ticks", "share", "worst lateness [us]"]
    return table([*head, "a tick is done after [us]: median / 99 % / worst"], lines)


def document(result: Row) -> dict[str, str]:
    """Return the tables of docs/speed.md by their markers."""
    found, sections = {"machine": machine(result)}, result["sections"]
    if section := sections.get("resolution"):
        found |= {"resolution": resolution(section), "tails": tails(section)}
        found["answers"] = answers(section)
    if section := sections.get("pattern"):
        found |= {"ways": ways(section), "plans": plans(section)}
        found["anew"] = anew(section)
    if section := sections.get("start"):
        found |= {"start": start(section), "first": first(section)}
    if section := sections.get("growth"):
        found |= {"joints": joints(section), "robots": robots(section)}
    if section := sections.get("loop"):
        found["loop"] = loop(section)
    if section := sections.get("realtime"):
        found["realtime"] = realtime(section)
    return found


def readme(result: Row) -> dict[str, str]:
    """Return the table of the README by its marker."""
    section = result["sections"].get("resolution")
    return {"speed": resolution(section, _IN_README)} if section else {}


def machine(result: Row) -> str:
    """Return a line on what the numbers were taken on."""
    m = result["machine"]
    text = f"{m['when']}, {m['cpu']}, {m['cores']} cores, {m['system']}.\n"
    versions = result["sections"].get("resolution", {}).get("versions", {})
    for name in ("pink, daqp", "mink, daqp", "placo (C++)", "TSID (C++), with forces"):
        if name in versions:
            own = ("pin", name.partition(",")[0].partition(" ")[0].lower())
            own = tuple("pin-pink" if x == "pink" else x for x in own)
            words = [f"{x} {versions[name][x]}" for x in own if x in versions[name]]
            text += f"{', '.join(words)}.\n"
    return text


def print_tables(result: Row, before: Row | None) -> None:
    """Print all tables, and ratios to an earlier result."""
    for missing in result["sections"].get("resolution", {}).get("missing", ()):
        print(missing)
    for name, text in document(result).items():
        print(f"\n{name}\n{text}")
    if before is not None:
        print(f"\nmedians, times those before\n{compared(result, before)}")


def compared(result: Row, before: Row) -> str:
    """Return the ratio of each median to an earlier one, and of the paired ratios."""

    def medians(of: Row) -> dict[tuple[str, str], Row]:
        rows = of["sections"].get("resolution", {}).get("rows", ())
        return {(row["name"], row["problem"]): row for row in rows}

    now, then = medians(result), medians(before)
    lines = [
        [*key, *(f"{now[key][x] / then[key][x]:.2f}" for x in ("median", "ratio"))]
        for key in now
        if key in then
    ]
    return table(["", "problem", "median", "ratio to ours"], lines)


def replaced(path: Path, texts: Mapping[str, str]) -> None:
    """Replace what stands between the markers of a document."""
    document = path.read_text(encoding="utf-8")
    for name, text in texts.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
        if begin not in document:
            continue
        before, rest = document.split(begin)
        document = f"{before}{begin}{text}{end}{rest.split(end)[1]}"
    path.write_text(document, encoding="utf-8")
