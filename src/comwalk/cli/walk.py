"""The commands that walk and dance: read the configuration, run, print a table."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from ..config import DanceConfig, PatternConfig, RobotConfig, WalkConfig
from ..config_files import command_line, make_config
from ..embedding import (
    BUILTIN_MOTIONS,
    Motion,
    builtin_motion,
    is_motion_file,
    load_motion,
)
from ..errors import ModelError, ParameterError, RunError
from ..pattern import coefficients, make_pattern, plan_steps, transfer_zmp
from ..settings import table_of
from ..setup import Setup, build_dance, build_walk
from ..views import HOST, PORT, Address
from .options import HostFlag, OpenFlag, PortFlag, flags_of, given_flags, with_flags
from .output import print_json, print_rows, print_table, short_number
from .progress import time_bar

if TYPE_CHECKING:
    from ..run import Run

LARGEST_REPLAY_ERROR = 1e-6
"""Largest difference of a replay from its record [m, rad]."""


# ---- Flags ----------------------------------------------------------------------

_WalkFlags = flags_of(WalkConfig, ("robot",))
_CheckFlags = flags_of(WalkConfig, ("robot", "out", "force", "report", "video"))
_DanceFlags = flags_of(DanceConfig, ("robot",))
_PatternFlags = flags_of(PatternConfig)

_Robot = Annotated[
    str | None,
    Parameter(help="Robot of `comwalk robots`, or path of a URDF or MJCF file."),
]
_File = Annotated[
    Path | None,
    Parameter(help="TOML file with the same keys, or summary.json of an earlier run."),
]
_MotionName = Annotated[
    str | None,
    Parameter(help="Built-in dance, or CSV or NPZ file of joint angles, to describe."),
]
_Json = Annotated[
    bool, Parameter(help="Print one JSON object instead of a table.", negative=())
]


# ---- Commands ---------------------------------------------------------------------


@with_flags(_WalkFlags)
def walk(
    robot: _Robot = None,
    /,
    *,
    flags: Any = None,
    config: _File = None,
    view: Annotated[
        bool,
        Parameter(
            help="Walk in real time, watched and steered in the browser.", negative=()
        ),
    ] = False,
    host: HostFlag = HOST,
    port: PortFlag = PORT,
    open: OpenFlag = False,
) -> int:
    """Walk in physics: with no arguments the paper's gait, 20 steps.

    Exit code 0 if the walk was completed, 1 if the robot fell, ended beside its plan,
    or was stopped.
    """
    page = Address(host, port, open)
    if not (view or page == Address()):
        raise ParameterError("--host, --port and --open are for a page; add --view")
    given = given_flags(flags) | ({} if robot is None else {"robot": robot})
    settings = make_config(WalkConfig, given, config)
    setup = build_walk(settings)
    words = command_line("walk", given, config)
    return _perform(settings, setup, "walk", words, page if view else None)


@with_flags(_CheckFlags)
def check(robot: _Robot = None, /, *, flags: Any = None, config: _File = None) -> int:
    """Tell whether a robot is able to walk so, and what is nearest to a limit.

    It takes what `comwalk walk` takes, and moves nothing. It also looks whether meshes
    of the robot's links meet, which a walk does not. Exit code 0 if the walk fits, 1 if
    it does not; then it tells what would.
    """
    from ..certificates import advice, feasibility, nearest_plans
    from ..robot.loaders import read_model

    given = given_flags(flags) | ({} if robot is None else {"robot": robot})
    settings = make_config(WalkConfig, given, config)
    setup = build_walk(settings)
    if setup.robot is None:
        raise ParameterError('check needs a robot; leave out plant "pendulum"')
    parts = setup.robot, setup.pattern, setup.motion
    geometry = read_model(settings.robot, geometry=True).spec
    result = feasibility(*parts, geometry=geometry)
    changes = () if result.ok else nearest_plans(*parts, result.worst)
    rows = [dataclasses.asdict(demand) for demand in result.demands]
    if settings.json:
        nearest = [{"change": c.text, "amount": c.amount} for c in changes]
        from ..run import plain

        told = {"ok": result.ok, "nearest": nearest, "demands": plain(rows)}
        print_json(told | {"largest_push_m_s": _pushes(setup)})
    else:
        cells = [_demand_cells(row) for row in rows[:_DEMANDS_SHOWN]]
        print_table(cells, ("used", "what", "of", "asked", "limit", "unit", "at"))
        print(
            "it fits"
            if result.ok
            else f"it does not fit; {advice(changes, result.worst)}"
        )
        if pushes := _pushes(setup):
            most = ", ".join(f"{v:.2f} m/s {way}" for way, v in pushes.items())
            print(f"at worst, no controller catches a push of 0.1 s above {most}")
    return 0 if result.ok else 1


def _pushes(setup: Setup) -> dict[str, float]:
    """Return the largest pushes that any stepping controller could catch [m/s]."""
    from ..certificates import stepping_of
    from ..pattern import largest_push

    if setup.robot is None or not setup.pattern.plan.steps:
        return {}
    bound = largest_push(setup.pattern, stepping_of(setup.robot))
    return dataclasses.asdict(bound)


_DEMANDS_SHOWN = 12


def _demand_cells(row: dict[str, Any]) -> tuple[str, ...]:
    used = f"{100 * row['share']:.1f} %"
    numbers = (f"{row['demanded']:.3g}", f"{row['limit']:.3g}", row["unit"])
    return used, row["what"], row["joint"], *numbers, f"{row['time']:.2f} s"


@with_flags(_DanceFlags)
def dance(robot: _Robot = None, /, *, flags: Any = None, config: _File = None) -> int:
    """Dance with both feet on the ground (Fig. 6).

    Exit code 0 if the dance was completed, 1 if the robot fell or was stopped.
    """
    given = given_flags(flags) | ({} if robot is None else {"robot": robot})
    settings = make_config(DanceConfig, given, config)
    words = command_line("dance", given, config)
    return _perform(settings, build_dance(settings), "dance", words)


@with_flags(_PatternFlags)
def pattern(*, flags: Any = None, config: _File = None) -> int:
    """Print the numbers of the walking pattern, Eqs. (4)-(13); Fig. 3 with --out."""
    settings = make_config(PatternConfig, given_flags(flags), config)
    numbers = _pattern_numbers(settings)
    if settings.out is not None:
        from ..runs import prepare_folder
        from ..views import plot_pattern

        walked = make_pattern(
            plan_steps(settings.gait, settings.steps), settings.pendulum
        )
        picture = prepare_folder(settings.out) / "pattern.png"
        plot_pattern(walked, picture)
        numbers["picture"] = str(picture)
    if settings.json:
        print_json(numbers)
    else:
        rows = [(_PATTERN_ROWS.get(k, k), short_number(v)) for k, v in numbers.items()]
        print_table(rows)
    return 0


_PATTERN_ROWS = {
    "omega_rad_s": "omega_n, Eq. (3) [rad/s]",
    "K_x_m": "K_x, Eq. (8) [m]",
    "K_y_m": "K_y, Eq. (13) [m]",
    "C_x1_m": "C_x1, Eq. (6) [m]",
    "C_x2_m": "C_x2, Eq. (7) [m]",
    "C_y1_m": "C_y1, Eq. (11) [m]",
    "C_y2_m": "C_y2, Eq. (12) [m]",
    "zmp_jump_x_m": "ZMP jump at lift and landing, x [m]",
    "zmp_jump_y_m": "ZMP jump at lift and landing, y [m]",
    "speed_m_s": "walking speed, 2 B / T [m/s]",
    "picture": "picture",
}


def _pattern_numbers(settings: PatternConfig) -> dict[str, Any]:
    """Return the numbers of a regular walk."""
    gait, omega = settings.gait, settings.pendulum.omega
    K_x, K_y = transfer_zmp(gait, omega)
    factors = coefficients(gait, omega)._asdict()
    return {
        "omega_rad_s": omega,
        "K_x_m": K_x,
        "K_y_m": K_y,
        **{f"{name}_m": value for name, value in factors.items()},
        "zmp_jump_x_m": gait.half_step - K_x,
        "zmp_jump_y_m": gait.half_width - K_y,
        "speed_m_s": gait.speed,
    }


def figures(
    *,
    out: Annotated[Path, Parameter(help="Folder for the pictures.")] = Path("figures"),
    json: _Json = False,
) -> int:
    """Draw the paper's Figs. 3, 5, 6 and 7, its stated figures beside ours."""
    from ..runs import prepare_folder
    from .figures import draw_figures

    folder = prepare_folder(out)
    with _status(quiet=json) as say:
        numbers = draw_figures(folder, progress=say)
    if json:
        from ..run import plain

        print_json(plain(numbers))
        return 0
    rows = [
        (figure, name, *(short_number(row[k]) for k in ("paper", "ours", "unit")))
        for figure, quantities in numbers.items()
        for name, row in quantities.items()
    ]
    print_table(rows, ("figure", "quantity", "paper", "ours", "unit"))
    print(f"written to {folder}")
    return 0


def motions(
    motion: _MotionName = None,
    /,
    *,
    robot: Annotated[str, Parameter(help="Whose joints a clip without names has.")] = (
        "paper"
    ),
    json: _Json = False,
) -> int:
    """List the built-in dances, or describe one or a motion file."""
    if motion is None:
        rows = [
            {"name": name, "what": text, "joints": list(builtin_motion(name).joints)}
            for name, text in BUILTIN_MOTIONS.items()
        ]
    elif is_motion_file(motion):
        from ..robot import load_robot

        joints = load_robot(robot).joints
        rows = _motion_rows(load_motion(motion, robot_joints=joints))
    else:
        rows = _motion_rows(builtin_motion(motion))
    print_rows(rows, json)
    return 0


def _motion_rows(motion: Motion) -> list[dict[str, Any]]:
    """Return a motion's ranges, joint by joint."""
    low, high = motion.positions.min(axis=0), motion.positions.max(axis=0)
    return [
        {
            "joint": joint,
            "lowest_rad": round(float(low[j]), 4),
            "highest_rad": round(float(high[j]), 4),
            "duration_s": round(motion.duration, 4),
            "loops": motion.loops,
        }
        for j, joint in enumerate(motion.joints)
    ]


def robots(*, json: _Json = False) -> int:
    """List the robots that are known by name, and how to get those that are missing."""
    from ..robot.loaders import ROBOTS, read_model

    rows = []
    for name, text in ROBOTS.items():
        what, _, remedy = text.partition("; ")
        try:
            read_model(name)
            remedy = "yes"
        except ModelError:
            pass
        rows.append({"name": name, "installed": remedy, "what": what})
    print_rows(rows, json)
    return 0


def replay(
    run: Annotated[Path, Parameter(help="Folder of a run.")],
    /,
    *,
    verify: Annotated[
        bool,
        Parameter(help="Replay the set-points with MuJoCo alone.", negative=()),
    ] = False,
    json: _Json = False,
) -> int:
    """Summarise a run, or verify it with MuJoCo alone.

    With --verify the exit code is 1 if the replay leaves the record by more than 1e-6.
    """
    if not verify:
        from ..runs import read_summary

        summary = read_summary(run)
        print_json(summary) if json else _print_summary(summary)
        if not json:
            print(f"written to {run}")
        return 0
    from ..replay import replay as play

    result = dataclasses.asdict(play(run))
    differences = (result["position_difference"], result["velocity_difference"])
    same = max(differences) <= LARGEST_REPLAY_ERROR
    if json:
        print_json({**result, "verified": same})
    else:
        q, v = differences
        print(f"{result['ticks']} ticks replayed; largest difference of qpos: {q:.3g}")
        print(f"largest difference of qvel: {v:.3g}")
        print("verified" if same else "NOT the recorded run")
    return 0 if same else 1


# ---- Running ----------------------------------------------------------------------


def _perform(
    settings: RobotConfig,
    setup: Setup,
    command: str,
    words: str,
    where: Address | None = None,
) -> int:
    """Simulate, save and print; return the exit code."""
    from ..runs import ROWS_NAME, prepare_folder
    from .runs import check_wishes, fulfil_wishes

    check_wishes(settings)
    folder = _run_folder(settings.out, command)
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    prepare_folder(folder)
    kept = dataclasses.replace(settings, out=None, report=False, video=(), json=False)
    table = table_of(kept)
    about = {"command": words, "config": table, "notes": list(setup.notes)}
    about["certificate"] = verdict = setup.certificate().verdict
    line = None if settings.json else f"certificate: {verdict}"
    try:
        if where is None:
            with time_bar(setup.pattern.duration, settings.json) as progress:
                told = _telling(line, progress)
                run = setup.run(told, record=folder / ROWS_NAME, about=about)
        else:
            run = _walk_in_page(settings, setup, about, where)
    except BaseException:
        if not any(folder.iterdir()):  # else it tells what happened
            for path in missing:
                path.rmdir()
        raise
    run = dataclasses.replace(run, settings={**run.settings, "out": str(folder)})
    summary = run.summary()
    print_json(summary) if settings.json else _print_summary(summary)
    _save(run, folder)
    if not settings.json:
        print(f"written to {folder}")
    if not fulfil_wishes(run, folder, settings):
        return 2
    return 0 if run.outcome.ok else 1


def _save(run: Run, folder: Path) -> None:
    """Save a run, or tell that it is not and what is left of it."""
    from ..runs import ROWS_NAME

    try:
        run.save(folder)
    except RunError as error:
        left = (folder / ROWS_NAME).is_file()
        hint = f"; once there is space, comwalk log {folder} saves its rows"
        raise RunError(f"{error}; the run is not saved{hint * left}") from None


def _walk_in_page(
    settings: RobotConfig, setup: Setup, about: dict[str, Any], where: Address
) -> Run:
    """Walk in real time, steered from a page; viewing is imported when it is wanted."""
    from .view import walk_in_page

    return walk_in_page(settings, setup, about, where)


def _run_folder(out: str | None, command: str) -> Path:
    """Return the folder of a run: as asked, or a new one under runs/."""
    if out is not None:
        return Path(out)
    begin = datetime.now().strftime("%Y-%m-%d-%H%M%S")
    folder, k = Path("runs") / f"{begin}-{command}", 2
    while folder.exists():
        folder, k = Path("runs") / f"{begin}-{k}-{command}", k + 1
    return folder


# ---- Printing ---------------------------------------------------------------------


def _telling(
    line: str | None, progress: Callable[[float], None] | None
) -> Callable[[float], None]:
    """Return a callback that prints a line once the robot moves, then progress."""
    left = [] if line is None else [line]

    def show(time: float) -> None:
        if left:
            print(left.pop())
        if progress is not None:
            progress(time)

    return show


@contextmanager
def _status(quiet: bool) -> Generator[Callable[[str], None] | None]:
    """Show on a terminal what is being done; yield what changes it."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    console = Console(stderr=True)
    with console.status("drawing") as status:
        yield status.update


def _print_summary(summary: dict[str, Any]) -> None:
    """Print the short table of a run."""
    print_table([(name, text) for name, text in _summary_rows(summary) if text])


def _summary_rows(s: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield names and texts of the figures of a run; empty texts for missing ones."""
    from ..runs import outcome_text

    yield "outcome", outcome_text(s)
    if s["steps_planned"]:
        moved = f", {n} moved" if (n := s.get("steps_moved")) else ""
        yield "steps", f"{s['steps_completed']} of {s['steps_planned']}{moved}"
        yield "distance", f"{s['distance_m']:.3f} m"
        error = _text(s, "heading_error_deg", ", {:.2f} deg")
        yield "end position error", f"{1e3 * s['position_error_m']:.1f} mm{error}"
    com = s["com_error_rms_mm"]
    yield "CoM error rms, true", _xy(com.get("true"))
    yield "CoM error rms, measured", _xy(com["measured"])
    yield "ZMP error rms", _xy(s["zmp_error_rms_mm"])
    yield "ZMP error rms, true", _xy(s["zmp_error_true_rms_mm"])
    yield "largest ZMP deviation", _xy(s.get("zmp_deviation_max_mm"))
    for name, value in s.get("com_deviation_max_mm", {}).items():
        yield f"largest CoM deviation, {name}", _xy(value)
    least = _text(s, "sole_margin_min_mm", ", at least {:.0f} mm")
    yield "sole margin", _text(s, "sole_margin_p5_mm", "{:.0f} mm in 95 %") + least
    yield "torque saturation", _text(s, "torque_saturation_pct", "{:.1f} % of the time")
    yield "speed", f"{s['real_time_factor']:.1f} x real time"
    yield "note", "; ".join(s["settings"].get("notes", ()))
    p50, p99 = s["tick_us_p50"], s["tick_us_p99"]
    yield "tick", f"{p50:.0f} us median, {p99:.0f} us 99th percentile"


def _text(s: dict[str, Any], key: str, form: str) -> str:
    value = s.get(key)
    return "" if value is None else form.format(value)


def _xy(value: dict[str, float] | None) -> str:
    """Return x and y [mm] as text, empty if missing."""
    return "" if value is None else f"x {value['x']:.2f} mm, y {value['y']:.2f} mm"
