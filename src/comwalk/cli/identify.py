"""The command `comwalk identify`: excite the standing robot, identify its loop."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ..certificates import default_control
from ..certificates.identification import Identified
from ..certificates.identification import identify as run_experiment
from ..config import IdentifyConfig
from ..config_files import make_config
from ..runs import prepare_folder
from ..setup import build_identify
from .certificate_table import facts_of, loop_table
from .options import flags_of, given_flags, with_flags
from .output import print_json, print_table, print_text
from .progress import share_bar

_Flags = flags_of(IdentifyConfig, ("robot", "gains", "control", "push"))


@with_flags(_Flags)
def identify(
    robot: Annotated[
        str | None,
        Parameter(help="Robot of `comwalk robots`, or path of a URDF or MJCF file."),
    ] = None,
    /,
    *,
    flags: Any = None,
    config: Annotated[
        Path | None, Parameter(help="TOML file with the same keys; flags win.")
    ] = None,
) -> int:
    """Shake the standing robot a little; tell lag, dead time, compliance and noise.

    With --out it writes the picture of the responses, all numbers, and loop.toml, which
    `comwalk certify --config` reads.
    """
    given = given_flags(flags) | ({} if robot is None else {"robot": robot})
    settings = make_config(IdentifyConfig, given, config)
    folder = None if settings.out is None else prepare_folder(settings.out)
    setup = build_identify(settings)
    with share_bar("shaking the robot", settings.json) as progress:
        found = run_experiment(
            setup.plant,
            setup.body,
            setup.standing,
            settings.experiment,
            progress=progress,
        )
    control = default_control(setup.robot, period=found.period)
    facts = facts_of(found, setup.robot.name, setup.pendulum, control)
    if folder is not None:
        _write(folder, found, settings.robot, facts)
    if settings.json:
        print_json(facts)
    else:
        _print(facts, folder)
    return 0


def _write(folder: Path, found: Identified, robot: str, facts: dict[str, Any]) -> None:
    """Write all that was found into a folder."""
    from ..runs import write_file
    from ..views import plot_identified

    plot_identified(found, facts["robot"], folder / "identify.png")
    text = json_format.dumps(facts, indent=2, allow_nan=False)
    write_file(folder / "identify.json", text + "\n")
    write_file(folder / "loop.toml", loop_table(robot, facts))


def _print(facts: dict[str, Any], folder: Path | None) -> None:
    """Print a table for people."""
    parts = [facts["axes"][axis] for axis in "xy"]
    rows = [
        (name, *(_cell(part[key], scale, digits, unit) for part in parts))
        for name, key, scale, digits, unit in _ROWS
    ]
    rows += [
        (f"more delay borne {use}", *(_margin(p["more_delay_ms"][use]) for p in parts))
        for use in ("walking", "standing")
    ]
    dead, noise = facts["dead_time_ms"], facts["noise"]
    print_text(f"{facts['robot']}, shaken for {facts['duration_s']:.0f} s")
    print_text(
        f"dead time {_cell(dead, 1.0, 1, 'ms')}: --control.delay {facts['delay_ticks']}"
    )
    print_table(rows, ("", "x", "y"))
    print_text(
        f"noise: encoders {noise['encoders_rad']:.1e} rad, ankles "
        f"{noise['force_N']:.2g} N and {noise['torque_Nm']:.2g} N m, tilt "
        f"{noise['tilt_rad']:.1e} rad; CoM {noise['com_mm']['x']:.2g} / "
        f"{noise['com_mm']['y']:.2g} mm, ZMP {noise['zmp_mm']['x']:.2g} / "
        f"{noise['zmp_mm']['y']:.2g} mm"
    )
    if folder is not None:
        print_text(f"written to {folder}")


_ROWS = (
    ("lag", "lag_ms", 1.0, 1, "ms"),
    ("how far the CoM goes", "gain", 100.0, 1, "%"),
    ("compliance mode", "mode_Hz", 1.0, 2, "Hz"),
    ("its damping ratio", "mode_damping", 1.0, 3, ""),
    ("pendulum seen", "omega_rad_s", 1.0, 2, "rad/s"),
)


def _cell(value: dict[str, float] | None, scale: float, digits: int, unit: str) -> str:
    if value is None:
        return "none"
    number, deviation = scale * value["value"], scale * value["deviation"]
    return f"{number:.{digits}f} +- {deviation:.{digits}f} {unit}".rstrip()


def _margin(value: float | None) -> str:
    return "any" if value is None else f"{value:.1f} ms"
