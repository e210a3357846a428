"""Write the table of designed gains in certificates.md: `python docs/make_design.py`.

Each robot walks, is pushed and is loaded with designed gains and with the paper's, made
to fit its natural frequency; nothing else differs.
"""

from __future__ import annotations

import dataclasses
import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from comwalk.certificates import sampled_loop_of

os.environ.setdefault("OMP_NUM_THREADS", "1")

from comwalk.bench import Case, perform, pushes
from comwalk.certificates import (
    DesignGoal,
    default_gait,
    default_pendulum,
    design,
    similar_gains,
)
from comwalk.control import Control, Gains
from comwalk.pattern import PAPER_PENDULUM
from comwalk.robot import load_robot

PAGE = Path(__file__).parent / "certificates.md"
ROBOTS = ("paper", "talos", "g1")
WALK = Case(name="forward")
LOADED = Case(name="payload 20 %", keys={"simulator.payload": 0.2})


class Gained(NamedTuple):
    """Keys of a configuration with one set of gains."""

    robot: str
    name: str
    keys: dict[str, Any]


def sets_of(robot: str) -> Iterator[Gained]:
    """Yield the paper's gains and designed ones, each with its filter."""
    model = load_robot(robot, actuation="position")
    pendulum, loop = default_pendulum(model), sampled_loop_of(Control())
    ours = design(pendulum, loop, DesignGoal(step_time=default_gait(model).period))
    cutoff = 4.0 * pendulum.omega / PAPER_PENDULUM.omega
    for name, gains, f_c in (
        ("the paper's", similar_gains(pendulum), cutoff),
        ("designed", *ours),
    ):
        yield Gained(robot, name, keys_of(gains, f_c))


def keys_of(gains: Gains, cutoff: float) -> dict[str, Any]:
    """Return gains and filter as keys of a configuration."""
    (p, c), (still_p, still_c) = gains.walking, gains.standing
    return {
        "gains.zmp": p,
        "gains.com": c,
        "gains.standing_zmp": still_p,
        "gains.standing_com": still_c,
        "control.zmp_cutoff": cutoff,
    }


def tried(job: tuple[Gained, Case]) -> dict[str, Any]:
    """Do a case with a set of gains."""
    gained, case = job
    keys = {**case.keys, **gained.keys}
    result = perform(gained.robot, dataclasses.replace(case, keys=keys))
    if result["outcome"] not in ("completed", "found"):
        sys.exit(f"{gained.robot}, {gained.name} gains, {case.name}: {result}")
    return result


def row_of(gained: Gained, results: dict[str, dict[str, Any]]) -> str:
    """Return a row of the table."""
    k_p, k_c = gained.keys["gains.zmp"], gained.keys["gains.com"]
    cells = [
        gained.robot,
        gained.name,
        f"{k_p[0]:.3g} / {k_p[1]:.3g}",
        f"{k_c[0]:.3g} / {k_c[1]:.3g}",
        f"{gained.keys['control.zmp_cutoff']:.2f}",
        *(errors(results[name]) for name in (WALK.name, LOADED.name)),
    ]
    for way in ("forward", "back", "inward", "outward"):
        found = [r["push_m_s"] for name, r in results.items() if f" {way} " in name]
        cells.append(f"{min(found):.2f}")
    return f"| {' | '.join(cells)} |"


def errors(result: dict[str, Any]) -> str:
    """Return the ZMP error of a walk."""
    error = result["zmp_error_rms_mm"]
    return f"{error['x']:.1f} / {error['y']:.1f}"


def main() -> None:
    """Try all, with a process for each core, and write the table."""
    gained = [g for robot in ROBOTS for g in sets_of(robot)]
    cases = [WALK, LOADED, *pushes()]
    jobs = [(g, case) for g in gained for case in cases]
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(tried, jobs))
    rows = []
    for i, g in enumerate(gained):
        own = results[i * len(cases) : (i + 1) * len(cases)]
        rows.append(row_of(g, {c.name: r for c, r in zip(cases, own, strict=True)}))
    head = (
        "| robot | gains | k_p, x / y [1/s] | k_c, x / y [1/s] | filter [Hz] "
        "| ZMP error rms, x / y [mm] | the same with 20 % more load "
        "| push forward [m/s] | back | inward | outward |"
    )
    table = "\n".join([head, "|---" * head.count(" |") + "|", *rows])
    text = PAGE.read_text(encoding="utf-8")
    marks = r"(<!-- designs -->\n).*?(<!-- /designs -->)"
    text = re.sub(marks, rf"\g<1>{table}\n\g<2>", text, flags=re.DOTALL)
    PAGE.write_text(text, encoding="utf-8")
    print(table)


if __name__ == "__main__":
    main()
