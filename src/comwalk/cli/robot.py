"""The command `comwalk robot`: description and picture of a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..certificates import describe, profile_of, rows_of
from ..robot import load_robot
from ..robot import write_profile as write_file
from .output import print_json, print_table


def robot(
    robot: Annotated[
        str,
        Parameter(help="Robot of `comwalk robots`, or path of a URDF or MJCF file."),
    ] = "paper",
    /,
    *,
    profile: Annotated[
        Path | None,
        Parameter(help="TOML file that tells what cannot be seen in the robot's file."),
    ] = None,
    write_profile: Annotated[
        Path | None,
        Parameter(help="Write all that was found as a profile, to be changed."),
    ] = None,
    picture: Annotated[
        Path | None,
        Parameter(help="Draw the robot in its walking posture, as PNG, WebP or JPEG."),
    ] = None,
    json: Annotated[
        bool, Parameter(help="Print one JSON object instead of a table.", negative=())
    ] = False,
) -> int:
    """Tell what was found out about a robot: limbs, soles, servos, gait."""
    loaded = load_robot(robot, profile=profile, geometry=picture is not None)
    facts = describe(loaded)
    if write_profile is not None:
        title = f"what comwalk found out about {loaded.name}"
        write_file(profile_of(loaded), write_profile, title)
        facts["profile"] = str(write_profile)
    if picture is not None:
        from ..views import draw_portrait

        draw_portrait(loaded, picture)
        facts["picture"] = str(picture)
    if json:
        print_json(facts)
        return 0
    written = [(k, facts[k]) for k in ("profile", "picture") if k in facts]
    print_table([*rows_of(facts), *written])
    return 0
