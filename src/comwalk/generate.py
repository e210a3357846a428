"""Reference motions by the thousand, for pipelines that learn from them.

A motion is a gait, or a dance on both feet, drawn at random within what the robot is
able to do, and followed by the kinematic resolution without physics. What the robot
cannot follow (a leg that is too short, a joint at a limit, soles that meet) is drawn
again, so that all that comes out is exact: the joints move as their limits allow, the
CoM and the feet as the pattern says.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .certificates import default_gait, default_pendulum
from .control import Actuation, BodySettings, ControlOutput
from .embedding import BUILTIN_MOTIONS, EmbeddedMotion, embed_in, fitted
from .errors import ParameterError, PlanError, checked_count
from .pattern import (
    Foothold,
    FootstepPlan,
    Pattern,
    Phase,
    Reference,
    make_pattern,
    plan_steps,
)
from .robot import Robot
from .runs import write_npz
from .settings import check_settings, setting
from .setup import robot_dance
from .walking import WholeBody

Kind = Literal["gaits", "dances"]
"""What is generated."""

Columns = dict[str, np.ndarray]
"""Arrays by name."""

TICK = 0.005
"""Longest time between two resolutions [s]; each motion is sampled from them."""

MOST_TRIALS = 20
"""Motions drawn per motion wanted, before the ranges are called too wide [-]."""

_REST = 0.5  # time at home before and after a dance [s]


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Ranges of the uniform distributions.

    Raises:
        ParameterError: If a number is out of its range.
    """

    speed: float | None = setting(
        None,
        "Fastest forward walk, half of it backward; the natural one if None",
        "m/s",
        "[0, 10]",
    )

    side: float | None = setting(
        None,
        "Fastest sideways walk, both ways; a fifth of `speed` if None",
        "m/s",
        "[0, 10]",
    )

    turn: float | None = setting(
        None, "Fastest turn, both ways; 0.15 if None", "rad/s", "[0, 10]"
    )

    steps: int = setting(6, "Steps of a gait", "", "[1, 1000]")

    duration: float = setting(8.0, "How long a dance lasts", "s", "[4, 600]")

    amplitude: float = setting(
        0.8, "Widest dance; the narrowest is 0.1", "rad", "[0.1, 2.5]"
    )

    frequency: float = setting(
        1.0, "Fastest dance; the slowest is 0.2", "Hz", "[0.2, 3]"
    )

    period: float = setting(0.02, "Time between two rows", "s", "[0.001, 1]")

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_settings(self)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Motions of one robot. Made by `generate`."""

    columns: Columns
    """Arrays by name, one row per sample, all motions one after the other:

    * `time` [s] since the start of its motion; `motion`, its number
    * `joint_positions`, `joint_velocities` [rad, rad/s], (rows, joints)
    * `base_position` [m], `base_orientation` (quaternion wxyz), `base_velocity`
      (linear [m/s], then angular [rad/s]); world axes
    * `com`, `com_velocity`, `com_acceleration` [m, m/s, m/s^2], (rows, 3); `zmp` [m],
      (rows, 2); world
    * `left_foot`, `right_foot`: x, y, z [m] and yaw [rad] of the sole's centre;
      `left_foot_velocity`, `right_foot_velocity`
    * `contacts`: whether the left and the right foot stand, (rows, 2); `phase`

    and of all: `starts`, the first row of each motion and the number of rows;
    `commands`, what each was drawn with, (motions, 3), named by `command_names`;
    `dances`, their names; `joint_names`, `phase_names`, `robot`, `period`, `seed`.
    """

    refused: int
    """How many motions were drawn that the robot cannot follow."""

    @property
    def motions(self) -> int:
        """Number of motions."""
        return len(self.columns["starts"]) - 1

    @property
    def rows(self) -> int:
        """Number of rows of all motions."""
        return int(self.columns["starts"][-1])

    def save(self, path: str | Path) -> Path:
        """Write all arrays to a compressed .npz file.

        Args:
            path: The file.

        Returns:
            Its path.

        Raises:
            RunError: If it cannot be written.
        """
        write_npz(Path(path), self.columns)
        return Path(path)


def generate(
    robot: Robot,
    kind: Kind,
    count: int,
    *,
    ranges: Ranges | None = None,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Dataset:
    """Return random motions that a robot can follow.

    Args:
        robot: The robot.
        kind: "gaits" or "dances".
        count: How many motions, in [1, 1000000].
        ranges: What is drawn; the robot's natural ones if None.
        seed: Of the random numbers; the same gives the same motions.
        progress: Called with the number of motions that are done.

    Returns:
        The motions.

    Raises:
        ParameterError: If a number is out of range, or a kind is unknown.
        PlanError: If hardly any motion of these ranges can be followed.
    """
    if kind not in ("gaits", "dances"):
        raise ParameterError(f'kind must be "gaits" or "dances", got {kind!r}')
    count = checked_count("count", count, 1, 1_000_000)
    ranges, rng = ranges or Ranges(), np.random.default_rng(seed)
    draw = _draw_gait if kind == "gaits" else _draw_dance
    found: list[Columns] = []
    commands, names = [], []
    trials = 0
    while len(found) < count:
        trials += 1
        if trials > MOST_TRIALS * (1 + len(found)):
            raise PlanError(
                f"of {trials - 1} {kind} that were drawn {robot.name} can follow "
                f"{len(found)}: make the ranges narrower"
            )
        command, name, make = draw(robot, ranges, rng)
        columns = _tried(robot, make, ranges.period)
        if columns is None:
            continue
        found.append(columns)
        commands.append(command)
        names.append(name)
        if progress is not None:
            progress(len(found))
    about = {
        "commands": np.array(commands),
        "command_names": np.array(_COMMANDS[kind]),
        "dances": np.array(names),
        "joint_names": np.array(robot.joints),
        "phase_names": np.array([phase.name.lower() for phase in Phase]),
        "robot": np.array(robot.name),
        "period": np.array(ranges.period),
        "seed": np.array(seed),
    }
    return Dataset(_joined(found) | about, trials - count)


_COMMANDS = {
    "gaits": ("speed_m_s", "side_m_s", "turn_rad_s"),
    "dances": ("amplitude_rad", "frequency_hz", "duration_s"),
}

_Motion = tuple[Pattern, EmbeddedMotion | None]
_Drawn = tuple[tuple[float, float, float], str, Callable[[], _Motion]]


def _draw_gait(robot: Robot, ranges: Ranges, rng: np.random.Generator) -> _Drawn:
    """Draw a walk; it is planned when it is called."""
    natural = default_gait(robot)
    fast = ranges.speed
    fast = natural.speed if fast is None else fast
    aside = 0.2 * fast if ranges.side is None else ranges.side
    around = 0.15 if ranges.turn is None else ranges.turn
    speed, side, turn = rng.uniform(
        (-0.5 * fast, -aside, -around), (fast, aside, around)
    )

    def make() -> _Motion:
        gait = default_gait(robot, speed=speed, side=side, turn=turn)
        plan = plan_steps(gait, ranges.steps, sole_size=robot.sole_size)
        return make_pattern(plan, default_pendulum(robot)), None

    return (speed, side, turn), "", make


def _draw_dance(robot: Robot, ranges: Ranges, rng: np.random.Generator) -> _Drawn:
    """Draw a dance; it is made when it is called."""
    name = str(rng.choice(sorted(BUILTIN_MOTIONS)))
    amplitude = rng.uniform(0.1, ranges.amplitude)
    frequency = rng.uniform(0.2, ranges.frequency)

    def make() -> _Motion:
        A = default_gait(robot).half_width
        plan = FootstepPlan(
            left=Foothold(0.0, A),
            right=Foothold(0.0, -A),
            stand_time=0.5 * ranges.duration,
            sole_size=robot.sole_size,
        )
        clip = robot_dance(
            robot, name, {"amplitude": amplitude, "frequency": frequency}
        )
        embedded = embed_in(
            clip, robot.home_angles, start=_REST, stop=ranges.duration - _REST
        )
        pattern = make_pattern(plan, default_pendulum(robot))
        return pattern, fitted(embedded, robot.joint_limits)[0]

    return (amplitude, frequency, ranges.duration), name, make


def _tried(robot: Robot, make: Callable[[], _Motion], period: float) -> Columns | None:
    """Return a motion's columns, or None if it cannot be planned or followed."""
    try:
        pattern, motion = make()
        return follow(robot, pattern, motion, period)
    except (PlanError, ParameterError):
        return None


def follow(
    robot: Robot, pattern: Pattern, motion: EmbeddedMotion | None, period: float
) -> Columns | None:
    """Follow a motion by the kinematic resolution, without physics.

    Args:
        robot: The robot.
        pattern: CoM and feet over time.
        motion: Motion of the upper body.
        period: Time between two rows [s].

    Returns:
        The columns of `Dataset.columns` that have rows, but for `motion`; None if a
        posture is singular or a joint reaches a limit.

    Raises:
        PlanError: If the robot cannot stand as the pattern begins.
    """
    each = math.ceil(period / TICK - 1e-9)
    body = WholeBody(
        dataclasses.replace(robot, actuation=Actuation.POSITION),
        period / each,
        motion,
        BodySettings(deflection_compensation=False, imu=False, landing=0.0),
    )
    body.start(pattern.at(0.0))
    rows = []
    for tick in range(each * (int(pattern.duration / period + 1e-9) + 1)):
        reference = pattern.at(tick * body.period)
        still = ControlOutput.still(reference)
        control = dataclasses.replace(still, u=reference.com_velocity[:2])
        q = body.configuration.copy()
        body.act(control, reference)
        found = body.resolution
        if found is not None and (found.damped or found.limited):
            return None
        if tick % each == 0:
            rows.append(_row(reference, q, body.velocity.copy()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _row(reference: Reference, q: np.ndarray, v: np.ndarray) -> dict[str, Any]:
    """Return one row of all columns."""
    feet = (("left_foot", reference.left), ("right_foot", reference.right))
    return {
        "time": reference.time,
        "phase": int(reference.phase),
        "contacts": (
            reference.phase is not Phase.SINGLE_RIGHT,
            reference.phase is not Phase.SINGLE_LEFT,
        ),
        "joint_positions": q[7:],
        "joint_velocities": v[6:],
        "base_position": q[:3],
        "base_orientation": q[3:7],
        "base_velocity": v[:6],
        "com": reference.com,
        "com_velocity": reference.com_velocity,
        "com_acceleration": reference.com_acceleration,
        "zmp": reference.zmp,
        **{name: (*foot.position, foot.yaw) for name, foot in feet},
        **{f"{name}_velocity": (*foot.velocity, foot.yaw_rate) for name, foot in feet},
    }


def _joined(found: list[Columns]) -> Columns:
    """Return motions one after the other, with where each starts."""
    lengths = [len(columns["time"]) for columns in found]
    joined = {name: np.concatenate([c[name] for c in found]) for name in found[0]}
    joined["motion"] = np.repeat(np.arange(len(found)), lengths)
    joined["starts"] = np.concatenate([[0], np.cumsum(lengths)])
    return joined
