"""The paper's Figs. 3, 5, 6 and 7 (section VI), drawn from runs made for them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..config import DanceConfig, WalkConfig
from ..errors import RunError
from ..pattern import PAPER_GAIT, Pattern, Phase, transfer_zmp
from ..run import Run
from ..runs import prepare_folder, write_file
from ..setup import Setup, build_dance, build_walk
from ..views import Row, plot_arms, plot_dance, plot_pattern, plot_run

PAPER_OMEGA = 3.78
"""The natural frequency that the paper states, omega_n [rad/s]."""

Progress = Callable[[str], None]
"""Called with what is being done."""


class Quantity(NamedTuple):
    """A quantity that the paper states, or that measures how well a figure came out."""

    name: str
    """Its name in files."""
    label: str
    """Its name in pictures; may hold mathematics."""
    paper: float | None
    """The paper's figure; None where it states none."""
    ours: float
    """Our figure."""
    unit: str
    """Unit of both."""


def draw_figures(
    folder: str | Path, progress: Progress | None = None
) -> dict[str, dict[str, dict[str, Any]]]:
    """Draw Figs. 3, 5, 6 and 7 as the paper's, its stated figures beside ours.

    Writes fig3.png, fig5.png, fig6.png, fig7.png, figures.json and figures.md. The
    walk and the dances for them are simulated first, which takes some seconds.

    Args:
        folder: Where to write; made if it does not exist.
        progress: Called with what is being done, in words.

    Returns:
        For each figure and quantity: "paper" (None where the paper states nothing),
        "ours" and "unit".

    Raises:
        RunError: If the folder cannot be written.
    """
    path, say = prepare_folder(folder), progress or (lambda text: None)
    say("walking 20 steps")
    setup = build_walk(WalkConfig())
    walked = setup.run()
    say("dancing")
    dance = build_dance(DanceConfig())
    danced = dance.run()
    say("dancing, with a resolution that ignores the arms")
    ignored = _ignoring_arms(dance).run()
    say("drawing")
    tables = {
        "fig3": pattern_quantities(setup.pattern),
        "fig5": arm_quantities(danced),
        "fig6": dance_quantities(danced, ignored),
        "fig7": walk_quantities(walked),
    }
    rows = {name: _rows(quantities) for name, quantities in tables.items()}
    plot_pattern(setup.pattern, path / "fig3.png", table=rows["fig3"])
    plot_arms(danced, path / "fig5.png", table=rows["fig5"])
    plot_dance(danced, path / "fig6.png", without=ignored, table=rows["fig6"])
    plot_run(walked, path / "fig7.png", table=rows["fig7"])
    return _write_tables(path, tables)


def _ignoring_arms(setup: Setup) -> Setup:
    body = dataclasses.replace(setup.control.body, embed_motion=False)
    control = dataclasses.replace(setup.control, body=body)
    return dataclasses.replace(setup, control=control)


def pattern_quantities(pattern: Pattern) -> list[Quantity]:
    """Return the quantities of Fig. 3, measured on a pattern of regular steps.

    Args:
        pattern: A straight walk with the paper's double support, some steps long.

    Returns:
        omega_n, T, t_d, A, B, and K_x, K_y beside Eqs. (8) and (13) at the paper's
        omega_n.
    """
    gait = PAPER_GAIT
    K_x, K_y = transfer_zmp(gait, PAPER_OMEGA)
    spans = [s for s in pattern.phases if s.phase in _SINGLES]
    a, b = spans[len(spans) // 2 - 1 : len(spans) // 2 + 1]
    t_d = 0.5 * (b.start - a.start - a.duration)
    start, foot = pattern.at(b.start), pattern.at(b.start + 0.5 * b.duration).zmp
    middle = 0.5 * (pattern.at(a.start + 0.5 * a.duration).zmp + foot)
    p_x, p_y = np.abs(foot - middle).tolist()
    k_x, k_y = np.abs(start.com[:2] - middle).tolist()
    omega = pattern.pendulum.omega
    return [
        Quantity("omega_n", r"$\omega_n$", PAPER_OMEGA, omega, "rad/s"),
        Quantity("T", "$T$", 1.0, b.start - a.start, "s"),
        Quantity("t_d", "$t_d$", 0.1, t_d, "s"),
        Quantity("A", "$A$", 0.09, p_y, "m"),
        Quantity("B", "$B$", 0.1, p_x, "m"),
        Quantity("K_x", "$K_x$, Eq. (8)", K_x, k_x, "m"),
        Quantity("K_y", "$K_y$, Eq. (13)", K_y, k_y, "m"),
    ]


_SINGLES = (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)


def arm_quantities(run: Run) -> list[Quantity]:
    """Return the quantities of Fig. 5; the paper states none.

    Args:
        run: The dance of a robot.

    Returns:
        Number of joints that dance, their largest swing, and how well they follow.
    """
    if run.robot is None:
        raise RunError("the simplified model has no arms")
    index = [run.robot.joints.index(name) for name in run.robot.upper_body]
    targets = run.log["joint_set_points"][:, index]
    swing = np.ptp(targets, axis=0)
    error = np.abs(targets - run.log["joints"][:, index])
    return [
        Quantity("joints", "joints that dance", None, int((swing > 0.02).sum()), ""),
        Quantity("swing", "largest swing", None, float(swing.max()), "rad"),
        Quantity("error", "largest error to set-point", None, error.max(), "rad"),
    ]


def dance_quantities(run: Run, ignored: Run) -> list[Quantity]:
    """Return the quantities of Fig. 6.

    The paper's CoM starts at (0.034, 0, 0.687) m from an origin that it does not give;
    ours is midway between the soles, so the distance from the start is compared.

    Args:
        run: The dance.
        ignored: The same dance with a resolution that ignores the arms.

    Returns:
        CoM height, and largest distances of CoM and ZMP from where the CoM began.
    """
    start = float(run.log["com_ref"][0, 2])
    com, zmp = _largest_offsets(run)
    com_0, zmp_0 = _largest_offsets(ignored)
    return [
        Quantity("c_z", "$c_z$ at the start", 0.687, start, "m"),
        Quantity("zmp_max", "ZMP: largest $|p - c_0|$", 10.0, zmp, "mm"),
        Quantity("com_max", "CoM: largest $|c - c_0|$", None, com, "mm"),
        Quantity("zmp_max_ignoring", "ZMP, ignoring the arms", None, zmp_0, "mm"),
        Quantity("com_max_ignoring", "CoM, ignoring the arms", None, com_0, "mm"),
    ]


def _largest_offsets(run: Run) -> tuple[float, float]:
    """Return the largest horizontal offsets of CoM and ZMP from the start [mm]."""
    log, start = run.log, run.log["com_ref"][0, :2]
    com = log["com_true" if "com_true" in log else "com"][:, :2]
    offsets = (com - start, log["zmp_filtered"] - start)
    com_max, zmp_max = (1e3 * float(np.hypot(*o.T).max()) for o in offsets)
    return com_max, zmp_max


def walk_quantities(run: Run) -> list[Quantity]:
    """Return the quantities of Fig. 7.

    Args:
        run: A walk of a robot with the paper's gait and gains.

    Returns:
        What the paper states of robot, gait and gains; and the errors of our walk.
    """
    log, gains, pendulum = run.log, run.settings["control"]["gains"], run.pattern
    (k_px, k_py), (k_cx, k_cy) = gains["zmp"], gains["com"]
    mass = np.nan if run.robot is None else run.robot.mass
    true = "com_true" if "com_true" in log else "com"
    c_x, c_y = _rms_mm(log["com_ref"] - log[true])
    p_x, p_y = _rms_mm(log["zmp_ref_filtered"] - log["zmp_filtered"])
    return [
        Quantity("m", "$m$", 67.68, mass, "kg"),
        Quantity("c_z", "$c_z$", 0.687, pendulum.pendulum.height, "m"),
        *pattern_quantities(run.pattern)[:5],
        Quantity("k_px", "$k_{p,x}$", 3.0, k_px, "1/s"),
        Quantity("k_py", "$k_{p,y}$", 1.8, k_py, "1/s"),
        Quantity("k_cx", "$k_{c,x}$", 6.6, k_cx, "1/s"),
        Quantity("k_cy", "$k_{c,y}$", 3.8, k_cy, "1/s"),
        Quantity("com_rms_x", "CoM error rms, x", None, c_x, "mm"),
        Quantity("com_rms_y", "CoM error rms, y", None, c_y, "mm"),
        Quantity("zmp_rms_x", "ZMP error rms, x", None, p_x, "mm"),
        Quantity("zmp_rms_y", "ZMP error rms, y", None, p_y, "mm"),
    ]


def _rms_mm(error: np.ndarray) -> tuple[float, float]:
    """Return the rms of x and y [mm]."""
    x, y = (1e3 * np.sqrt(np.mean(error[:, :2] ** 2, axis=0))).tolist()
    return x, y


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _rows(quantities: Sequence[Quantity]) -> list[Row]:
    return [Row(q.label, _text(q.paper), _text(q.ours), q.unit) for q in quantities]


def _write_tables(
    folder: Path, tables: dict[str, list[Quantity]]
) -> dict[str, dict[str, dict[str, Any]]]:
    """Write figures.json and figures.md, and return the numbers."""
    numbers: dict[str, dict[str, dict[str, Any]]] = {
        figure: {
            q.name: {"paper": q.paper, "ours": float(q.ours), "unit": q.unit}
            for q in quantities
        }
        for figure, quantities in tables.items()
    }
    lines = ["| figure | quantity | paper | comwalk | unit |", "|---|---|---|---|---|"]
    for figure, quantities in tables.items():
        lines += [
            f"| {figure} | {q.name} | {_text(q.paper)} | {_text(q.ours)} | {q.unit} |"
            for q in quantities
        ]
    text = json.dumps(numbers, indent=2, allow_nan=False)
    write_file(folder / "figures.json", text + "\n")
    write_file(folder / "figures.md", "\n".join(lines) + "\n")
    return numbers
