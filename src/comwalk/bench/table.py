"""Results of a bench as Markdown tables, with a picture of each robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import ComwalkError, RunError
from ..robot import load_robot
from ..walking import build_scene
from .cases import DEFAULT, DISTURBED, PUSH_WAYS, TORQUE, WALKS, Case
from .ledger import Job, Result
from .trials import prepare


@dataclass(frozen=True, eq=False)
class Findings:
    """The results of one bench, to look up."""

    jobs: Sequence[Job]
    """What was done."""
    results: Sequence[Result]
    """What each job found."""

    @property
    def robots(self) -> list[str]:
        """The robots, in order."""
        return list(dict.fromkeys(job.robot for job in self.jobs))

    @property
    def ablations(self) -> list[str]:
        """Names of the controllers, in order."""
        return list(dict.fromkeys(job.ablation.name for job in self.jobs))

    def of(
        self, robot: str, name: str, ablation: str = DEFAULT.name
    ) -> list[tuple[Case, Result]]:
        """Return the cases of a robot whose names begin with some words.

        Args:
            robot: The robot.
            name: First words of the case's name.
            ablation: Name of the controller.

        Returns:
            Cases and results.
        """
        words = name.split()
        pairs = zip(self.jobs, self.results, strict=True)
        return [
            (job.case, result)
            for job, result in pairs
            if (job.robot, job.ablation.name) == (robot, ablation)
            and job.case.name.split()[: len(words)] == words
        ]

    def one(self, robot: str, name: str, ablation: str = DEFAULT.name) -> Result | None:
        """Return the result of a robot in one case, None if it was not done."""
        found = self.of(robot, name, ablation)
        return found[0][1] if found else None


# ---- Cells ------------------------------------------------------------------------


def outcome_cell(result: Result | None) -> str:
    """Return the end of a run in a few words.

    Args:
        result: What `perform` returned; None for what was not done.

    Returns:
        Where it ended, when it fell, or that it was refused.
    """
    if result is None:
        return ""
    if result["outcome"] == "completed":
        if not result["steps_planned"]:
            return f"ok, ZMP {max(result['zmp_deviation_max_mm'].values()):.0f} mm"
        place, turn = 1e3 * result["position_error_m"], result["heading_error_deg"]
        each = result.get("turn_deg")
        way = f", {each:.3g} deg a step" if each else ""
        return f"ok, {place:.0f} mm {abs(turn):.1f} deg{way}"
    if result["outcome"] == "refused":
        return "refused"
    return f"{result['outcome']} at {result['time_s']:.1f} s"


def zmp_cell(result: Result | None) -> str:
    """Return the ZMP error of a walk.

    Args:
        result: What `perform` returned; None for what was not done.

    Returns:
        Root mean square in x and y [mm], or how the walk ended.
    """
    if result is None or result["outcome"] != "completed":
        return outcome_cell(result)
    zmp = result["zmp_error_rms_mm"]
    return f"{zmp['x']:.1f} / {zmp['y']:.1f}"


def speed_cell(result: Result | None) -> str:
    """Return the largest speed and what ends it.

    Args:
        result: What `perform` returned; None for what was not done.

    Returns:
        Speed and cause.
    """
    if result is None:
        return ""
    if result["outcome"] != "found":
        return f"{result['outcome']}: {_short(result['cause'])}"
    return f"{result['speed_m_s']:.2f} m/s, then {_short(result['cause'])}"


def floor_cell(results: Sequence[Result]) -> str:
    """Return on how many floors a robot arrived.

    Args:
        results: Of one height.

    Returns:
        Such as 17/20.
    """
    if not results:
        return ""
    if all(r["outcome"] == "refused" for r in results):
        return "refused"
    arrived = sum(r["outcome"] == "completed" for r in results)
    return f"{arrived}/{len(results)}"


def push_cell(results: Sequence[tuple[Case, Result]]) -> str:
    """Return the largest push that is survived whenever it comes, and each time's.

    Args:
        results: Of one direction, at several times of the single support.

    Returns:
        The least [m/s], then all in the order of time.
    """
    found = [r["push_m_s"] for _, r in results if "push_m_s" in r]
    if len(found) < len(results):
        return "refused"
    if not found:
        return ""
    every = " ".join(f"{v:.2f}" for v in found)
    return f"{min(found):.2f} ({every})"


def _short(cause: str, length: int = 60) -> str:
    text = cause.split(";")[0].replace("|", "/") or "nothing"
    return text if len(text) <= length else text[: length - 3] + "..."


# ---- Tables -----------------------------------------------------------------------

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, head and rows."""


def tables_of_findings(findings: Findings) -> list[Table]:
    """Return the results of a bench as tables, without empty ones.

    Args:
        findings: The results.

    Returns:
        Titles, heads and rows of text.
    """
    makers: tuple[Callable[[Findings], Table], ...] = (
        _robot_table,
        _outcome_table,
        _figure_table,
        _ablation_table,
        _disturbed_table,
        _speed_table,
        _floor_table,
        _push_table,
    )
    tables = (make(findings) for make in makers)
    return [t for t in tables if any(any(cell for cell in row[1:]) for row in t[2])]


def _rows(
    findings: Findings, cells: Callable[[str], Iterable[str]]
) -> list[tuple[str, ...]]:
    return [(robot, *cells(robot)) for robot in findings.robots]


def _rows_by_drive(
    findings: Findings, cells: Callable[[str, str], Iterable[str]]
) -> list[tuple[str, ...]]:
    """Return a row for each robot by position, and by torque if that was done."""
    drives = {DEFAULT.name: "", TORQUE.name: ", by torque"}
    return [
        (f"{robot}{drives[drive]}", *cells(robot, drive))
        for robot in findings.robots
        for drive in drives
        if drive in findings.ablations
    ]


def _outcome_rows(findings: Findings, names: list[str]) -> list[tuple[str, ...]]:
    """Return how each robot ended some cases, by position and by torque."""
    return _rows_by_drive(
        findings,
        lambda robot, drive: [
            outcome_cell(findings.one(robot, name, drive)) for name in names
        ],
    )


def _done(findings: Findings, cases: Iterable[Case]) -> list[str]:
    names = {job.case.name for job in findings.jobs}
    return [case.name for case in cases if case.name in names]


def _robot_table(findings: Findings) -> Table:
    """Masses, sizes and gaits of the robots."""

    def cells(robot: str) -> Iterator[str]:
        r = findings.one(robot, "about")
        if r is None or r["outcome"] != "completed":
            yield from [""] * 6 if r is None else [_short(r["cause"]), *[""] * 5]
            return
        yield f"{r['mass_kg']:.1f}"
        yield str(r["joints"])
        yield f"{r['com_height_m']:.3f}"
        yield " x ".join(f"{x:.0f}" for x in r["sole_mm"])
        yield f"{r['step_m']:.3f}"
        yield f"{r['period_s']:.2f}"

    head = ("robot", "mass [kg]", "joints", "CoM height [m]", "sole [mm]")
    head += ("step [m]", "step time [s]")
    return "The robots and their natural gait", head, _rows(findings, cells)


def _outcome_table(findings: Findings) -> Table:
    """Outcomes of walks and dances."""
    names = _done(findings, WALKS)
    rows = _outcome_rows(findings, names)
    title = "Walks and dances on a flat floor: how far from the planned end"
    return title, ("robot", *names), rows


def _figure_table(findings: Findings) -> Table:
    """The figures of the walk forward."""

    def cells(robot: str, drive: str) -> Iterator[str]:
        r = findings.one(robot, "forward", drive)
        if r is None or r["outcome"] != "completed":
            yield from [outcome_cell(r), *[""] * 6]
            return
        com = r["com_error_rms_mm"]["true"]
        yield f"{r['end_error_pct']:.2f} %"
        yield f"{com['x']:.1f} / {com['y']:.1f}"
        yield zmp_cell(r)
        yield f"{r['sole_margin_p5_mm']:.0f} / {r['sole_margin_min_mm']:.0f}"
        for name in ("joint_speed", "torque"):
            share, joint = r[f"{name}_max_pct"], r[f"{name}_max_joint"]
            yield f"{share:.0f} % {joint}" if share else "no limits"
        yield f"{r['real_time_factor']:.1f}"

    head = ("robot", "end error / path", "CoM rms x / y [mm]", "ZMP rms x / y [mm]")
    head += ("sole margin 5 % / least [mm]", "joint speed", "torque", "x real time")
    return "The walk forward, 20 steps", head, _rows_by_drive(findings, cells)


def _ablation_table(findings: Findings) -> Table:
    """The walk forward by controller."""

    def cells(robot: str) -> Iterator[str]:
        for name in findings.ablations:
            for _, r in findings.of(robot, "forward", name) or [(None, None)]:
                yield zmp_cell(r)

    title = "The walk forward by controller: ZMP rms x / y [mm]"
    return title, ("robot", *findings.ablations), _rows(findings, cells)


def _disturbed_table(findings: Findings) -> Table:
    """Outcomes of the forward walk under disturbances."""
    names = _done(findings, DISTURBED)
    rows = _outcome_rows(findings, names)
    title = "The walk forward, with what the controller does not know of"
    return title, ("robot", *names), rows


def _speed_table(findings: Findings) -> Table:
    """The largest speeds."""
    rows = _rows(findings, lambda robot: [speed_cell(findings.one(robot, "speed"))])
    title = "The largest speed inside joint speeds and torques, 20 steps"
    return title, ("robot", "speed, and what ends it"), rows


def _floor_table(findings: Findings) -> Table:
    """On how many rough floors the robots arrive, by controller."""
    names = {j.case.name for j in findings.jobs if j.case.group == "floor"}
    heights = sorted({" ".join(n.split()[:3]) for n in names}, key=_millimetres)
    columns = [(height, name) for height in heights for name in findings.ablations]

    def cells(robot: str) -> Iterator[str]:
        for height, ablation in columns:
            yield floor_cell([r for _, r in findings.of(robot, height, ablation)])

    head = ("robot", *(f"{h.removeprefix('floor ')}, {name}" for h, name in columns))
    return "Rough floors: walks of 20 steps that arrived", head, _rows(findings, cells)


def _millimetres(name: str) -> float:
    return float(name.split()[1])


def _push_table(findings: Findings) -> Table:
    """The largest pushes."""
    found = [(j, r) for j, r in zip(findings.jobs, findings.results, strict=True)]
    pushed = [(j.case, r) for j, r in found if j.case.push is not None]
    shares = dict.fromkeys(c.push.share for c, _ in pushed if c.push)
    feet = dict.fromkeys(str(r["foot"]) for _, r in pushed if "foot" in r)
    rows = _rows(
        findings,
        lambda robot: [
            push_cell(findings.of(robot, f"push {way}")) for way in PUSH_WAYS
        ],
    )
    times = ", ".join(f"{100 * s:.0f}" for s in shares)
    title = (
        "The largest push on the trunk for 0.1 s [m/s = N s/kg] that is survived, "
        f"begun at {times} % of the single support of step 4 "
        f"({', '.join(feet) or 'no'} foot): the least, and each"
    )
    return title, ("robot", *PUSH_WAYS), rows


# ---- The document -----------------------------------------------------------------

INTRODUCTION = """\
# Robots

Written by `comwalk bench robots --write`; do not edit. Every robot walks with the
defaults that comwalk derives from its model: by position on servos that hold it, with
ankle sensors; and by torque on gains of 100 N m/rad (ankles 40) and 2 N m s/rad,
without sensors at the feet, with sensor noise, 2 ms of delay each way and 0.5 N m of
unknown friction besides all else. More of that: [torque.md](torque.md).

- **ok, 12 mm 0.3 deg**: the walk was completed, and ended that far from the plan.
- A rough floor is made of boxes of 16 cm with random tops from a fifth of its height to
  all of it. The floors reported here are used for nothing else, nor was any setting
  chosen by them.
- The largest speed and push are found by bisection: what fails once is taken to fail
  beyond.
"""
"""What stands above the tables."""


def write_report(
    findings: Findings,
    path: Path,
    *,
    pictures: bool = True,
    progress: Callable[[str], None] | None = None,
) -> list[str]:
    """Write the document of a bench, with a picture of each robot that walks.

    Args:
        findings: The results.
        path: The document; pictures go to `images/` beside it.
        pictures: Whether pictures are made; those that exist are shown anyway.
        progress: Called with the name of each robot before its picture.

    Returns:
        What could not be drawn, a line each.

    Raises:
        RunError: If a file cannot be written.
    """
    faults = []
    for robot in findings.robots if pictures else ():
        if progress is not None:
            progress(robot)
        try:
            path.parent.joinpath("images").mkdir(parents=True, exist_ok=True)
            draw_robot(robot, _picture(path, robot))
        except ComwalkError as error:
            faults.append(f"{robot}: {error}")
    shown = [robot for robot in findings.robots if _picture(path, robot).is_file()]
    try:
        path.write_text(document(findings, path, shown), encoding="utf-8")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None
    return faults


def document(findings: Findings, path: Path, shown: Sequence[str] = ()) -> str:
    """Return the document as text.

    Args:
        findings: The results.
        path: Where it will be.
        shown: Robots that have a picture.

    Returns:
        Markdown.
    """
    parts = [INTRODUCTION]
    if shown:
        images = [f"images/{_picture(path, robot).name}" for robot in shown]
        cells = [f"![{r} walks]({i})" for r, i in zip(shown, images, strict=True)]
        parts.append(_grid(shown, cells))
    for title, head, rows in tables_of_findings(findings):
        parts.append(f"## {title.split(':')[0].split(' [')[0]}\n")
        parts += [f"{title}.\n"] * (":" in title or "[" in title)
        parts.append(_markdown(head, rows))
    return "\n".join(parts)


def _grid(names: Sequence[str], cells: Sequence[str], width: int = 4) -> str:
    """Return pictures under their names, some in a row."""
    lines = []
    for k in range(0, len(names), width):
        row = [*names[k : k + width], *[""] * width][:width]
        under = [*cells[k : k + width], *[""] * width][:width]
        lines.append(_markdown(tuple(row), [tuple(under)]))
    return "\n".join(lines)


def _markdown(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _picture(path: Path, robot: str) -> Path:
    return path.parent / "images" / f"robot-{Path(robot).stem}.webp"


def draw_robot(robot: str, path: Path) -> None:
    """Draw a robot in the middle of a walk of six steps.

    Args:
        robot: Name or file of the robot.
        path: The picture, 480 pixels wide.

    Raises:
        ComwalkError: If it does not load, the file cannot be written, or this machine
            cannot draw.
    """
    from ..views import View, render_still

    setup = prepare(robot, dataclasses.replace(WALKS[0], steps=6))
    seen = build_scene(load_robot(robot, geometry=True), setup.physics)
    run = dataclasses.replace(setup.run(), scene=seen)
    singles = [s for s in run.pattern.phases if s.phase.name.startswith("SINGLE")]
    time = singles[3].start + 0.7 * singles[3].duration
    view = View(width=480, height=480, shadows=True, smooth=2, distance=1.55)
    render_still(run, path, time, view=view)
