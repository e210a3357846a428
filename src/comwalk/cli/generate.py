"""The command `comwalk generate`: random motions of a robot in one .npz file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from ..errors import RunError
from ..generate import Dataset, Ranges
from ..generate import generate as generated
from ..robot import load_robot
from ..runs import prepare_folder
from .output import print_json
from .progress import counting_bar

_USUAL = Ranges()


def generate(
    what: Annotated[
        Literal["gaits", "dances"], Parameter(help="What is drawn at random.")
    ] = "gaits",
    robot: Annotated[
        str,
        Parameter(help="Robot of `comwalk robots`, or path of a URDF or MJCF file."),
    ] = "paper",
    /,
    *,
    count: Annotated[int, Parameter(help="How many motions.")] = 100,
    out: Annotated[Path, Parameter(help="The .npz file to write.")] = Path(
        "motions.npz"
    ),
    seed: Annotated[int, Parameter(help="Of the random numbers.")] = 0,
    speed: Annotated[
        float | None,
        Parameter(
            help="Fastest walk forward [m/s], half of it backward; else natural."
        ),
    ] = None,
    side: Annotated[
        float | None,
        Parameter(help="Fastest walk sideways [m/s]; a fifth of --speed if not given."),
    ] = None,
    turn: Annotated[
        float | None, Parameter(help="Fastest turn [deg/s]; 8.6 if not given.")
    ] = None,
    steps: Annotated[int, Parameter(help="Steps of a gait.")] = _USUAL.steps,
    duration: Annotated[
        float, Parameter(help="How long a dance lasts [s].")
    ] = _USUAL.duration,
    amplitude: Annotated[
        float, Parameter(help="Widest dance [rad].")
    ] = _USUAL.amplitude,
    frequency: Annotated[
        float, Parameter(help="Fastest dance [Hz].")
    ] = _USUAL.frequency,
    period: Annotated[
        float, Parameter(help="Time between two rows [s].")
    ] = _USUAL.period,
    profile: Annotated[
        Path | None,
        Parameter(help="TOML file that tells what cannot be seen in the robot's file."),
    ] = None,
    json: Annotated[
        bool, Parameter(help="Print one JSON object instead of a line.", negative=())
    ] = False,
) -> int:
    """Write random motions that a robot can follow, for pipelines that learn.

    They are followed by the kinematic resolution, without physics. docs/files.md tells
    what the file holds.
    """
    ranges = Ranges(
        speed=speed,
        side=side,
        turn=None if turn is None else math.radians(turn),
        steps=steps,
        duration=duration,
        amplitude=amplitude,
        frequency=frequency,
        period=period,
    )
    _check_file(out)
    loaded = load_robot(robot, profile=profile)
    with counting_bar("motions", count, json) as advance:
        dataset = generated(
            loaded, what, count, ranges=ranges, seed=seed, progress=advance
        )
    dataset.save(out)
    _tell(dataset, what, loaded.name, out, json)
    return 0


def _check_file(path: Path) -> None:
    """Refuse a file that cannot be written, before hours are spent on it."""
    if path.is_dir() or path.suffix != ".npz":
        raise RunError(f"{path}: give the name of a file that ends in .npz")
    prepare_folder(path.parent)


def _tell(dataset: Dataset, what: str, robot: str, path: Path, json: bool) -> None:
    """Print what was made."""
    size, rows = path.stat().st_size, dataset.rows
    if json:
        facts = {
            "file": str(path),
            "robot": robot,
            what: dataset.motions,
            "rows": rows,
            "refused": dataset.refused,
            "bytes": size,
        }
        print_json(facts)
        return
    print(
        f"{path}: {dataset.motions} {what} of {robot}, {rows} rows, {size / 1e6:.1f} "
        f"MB; {dataset.refused} more were drawn that it cannot follow"
    )
