"""Read footstep plans from TOML files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import ParameterError, PlanError, checked_count, checked_number
from ..settings import check_keys, read_toml, settings_of
from ..sides import Side
from .footsteps import (
    MAX_STEPS,
    PAPER_GAIT,
    PAPER_SOLE,
    Foothold,
    Footstep,
    FootstepPlan,
    Gait,
)
from .plans import _Walk, plan_segments


def load_plan(
    path: str | Path,
    *,
    gait: Gait = PAPER_GAIT,
    sole_size: tuple[float, float] = PAPER_SOLE,
) -> FootstepPlan:
    """Read a plan from a TOML file.

    Either regular pieces, each with any field of `Gait` (`turn_deg` [deg] may replace
    `turn` [rad]); `[gait]` gives the values for all of them::

        first = "left"          # optional: the foot that swings first
        sole_size = [0.24, 0.13]  # optional [m]

        [gait]                  # optional
        period = 1.0
        half_step = 0.1

        [[segment]]
        steps = 10

        [[segment]]
        stand = 2.0             # a pause: the feet come together, the robot rests [s]

        [[segment]]
        steps = 6
        turn_deg = 10.0

    or single footsteps, with times and heights from `[gait]` unless given::

        left = { x = 0.0, y = 0.09 }      # optional: the feet at the start
        right = { x = 0.0, y = -0.09, yaw_deg = 0.0 }

        [[footstep]]
        side = "right"
        x = 0.2
        y = -0.09
        yaw_deg = 0.0           # or yaw [rad]; 0 if left out
        single_support = 0.8
        double_support = 0.2
        swing_height = 0.04
        stand = 1.0             # rest after this step [s]; walk on if left out

    Args:
        path: The file.
        gait: What `[gait]` and the segments leave out.
        sole_size: Length and width of each sole [m], if the file does not say.

    Returns:
        The plan.

    Raises:
        PlanError: If the file cannot be read, has an unknown or wrong key, or its steps
            cannot be walked; the message is one line that begins with the path.
    """
    try:
        document = read_toml(path)
    except ParameterError as error:
        raise PlanError(str(error)) from None
    try:
        return _plan_of({"sole_size": sole_size, **document}, gait)
    except (ParameterError, PlanError) as error:
        raise PlanError(f"{path}: {error}") from None


_TOP_KEYS = ("first", "sole_size", "gait", "segment", "footstep", "left", "right")


_GAIT_KEYS = (*settings_of(Gait), "turn_deg")


_STEP_KEYS = (*settings_of(Footstep), "yaw_deg")


_POSE_KEYS = ("x", "y", "yaw", "yaw_deg")


def _plan_of(document: Mapping[str, Any], usual: Gait) -> FootstepPlan:
    """Return the plan that a TOML document describes."""
    _table(document, "the file", _TOP_KEYS)
    base = _table(document.get("gait", {}), "[gait]", _GAIT_KEYS)
    pieces, steps = (_tables(document, name) for name in ("segment", "footstep"))
    if bool(pieces) == bool(steps):
        raise PlanError("give either [[segment]] or [[footstep]] tables")
    size = document["sole_size"]
    if steps:
        if "first" in document:
            raise PlanError(
                '"first" is for [[segment]]; each [[footstep]] has its side'
            )
        return _explicit_plan(document, _gait_of(usual, base, "[gait]"), steps)
    for name in ("left", "right"):
        if name in document:
            raise PlanError(f'"{name}" is for [[footstep]]; use half_width in [gait]')
    segments = [_segment_of(usual, base, piece, i) for i, piece in enumerate(pieces, 1)]
    return plan_segments(segments, first=document.get("first"), sole_size=size)


def _segment_of(
    usual: Gait, base: Mapping[str, Any], piece: object, i: int
) -> _Walk | float:
    """Return the gait and the number of steps of one [[segment]], or its pause."""
    where = f"[[segment]] {i}"
    table = dict(_table(piece, where, ("steps", "stand", *_GAIT_KEYS)))
    if "stand" in table:
        if len(table) > 1:
            raise PlanError(f'{where}: "stand" goes alone; steps go before and after')
        return _named(where, checked_number, "stand", table["stand"], unit="s")
    if "steps" not in table:
        raise PlanError(f'{where}: "steps" or "stand" is missing')
    count = _named(where, checked_count, "steps", table.pop("steps"), 1, MAX_STEPS)
    defaults = {k: v for k, v in base.items() if not _overridden(k, table)}
    return _gait_of(usual, {**defaults, **table}, where), count


def _overridden(key: str, table: Mapping[str, Any]) -> bool:
    """Tell whether a table gives the turn in either unit, as the key does."""
    return key in ("turn", "turn_deg") and bool({"turn", "turn_deg"} & set(table))


def _gait_of(usual: Gait, table: Mapping[str, Any], where: str) -> Gait:
    given = _radians(table, "turn", where)
    return _named(where, dataclasses.replace, usual, **given)


def _explicit_plan(
    document: Mapping[str, Any],
    gait: Gait,
    tables: Sequence[object],
) -> FootstepPlan:
    """Return a plan of single footsteps."""
    times = {
        "single_support": gait.single_support_time,
        "double_support": gait.double_support_time,
        "swing_height": gait.swing_height,
    }
    steps = []
    for i, table in enumerate(tables, 1):
        where = f"[[footstep]] {i}"
        given = _radians(_table(table, where, _STEP_KEYS), "yaw", where)
        for key in ("side", "x", "y"):
            if key not in given:
                raise PlanError(f'{where}: "{key}" is missing')
        steps.append(_named(where, Footstep, **{**times, **given}))
    return FootstepPlan(
        left=_stand_of(document, Side.LEFT, gait),
        right=_stand_of(document, Side.RIGHT, gait),
        steps=tuple(steps),
        start_time=gait.start_time,
        stop_time=gait.stop_time,
        stand_time=gait.stand_time,
        double_support=gait.double_support,
        sole_size=document["sole_size"],
    )


def _stand_of(document: Mapping[str, Any], side: Side, gait: Gait) -> Foothold:
    table = _table(document.get(side.value, {}), f'"{side}"', _POSE_KEYS)
    pose = {"x": 0.0, "y": side.sign * gait.half_width}
    return Foothold(**{**pose, **_radians(table, "yaw", f'"{side}"')})


def _radians(table: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
    """Return a copy of a table in which an angle in degrees became radians."""
    table, degrees = dict(table), f"{key}_deg"
    if degrees in table:
        if key in table:
            raise PlanError(f'{where}: give "{key}" or "{degrees}", not both')
        angle = _named(where, checked_number, degrees, table.pop(degrees), unit="deg")
        table[key] = math.radians(angle)
    return table


def _named(where: str, function: Any, *args: Any, **kwargs: Any) -> Any:
    """Call a function, and put the place in the file before its error."""
    try:
        return function(*args, **kwargs)
    except ParameterError as error:
        raise PlanError(f"{where}: {error}") from None


def _table(value: object, where: str, known: Sequence[str]) -> Mapping[str, Any]:
    """Return a table of TOML whose keys are all known."""
    if not isinstance(value, Mapping):
        raise PlanError(f"{where}: must be a table, got {value!r}")
    _named(where, check_keys, value, known)
    return value


def _tables(document: Mapping[str, Any], name: str) -> list[object]:
    value = document.get(name, [])
    if not isinstance(value, list):
        raise PlanError(f"{name}: write it as [[{name}]] tables")
    return value
