"""Test cases: walks, floors, pushes, loads and ablations."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Keys = Mapping[str, Any]
"""Values by dotted key of a configuration, such as {"gains.zmp": (0.0, 0.0)}."""


Way = Literal["forward", "back", "inward", "outward"]
"""Where a push goes: outward is over the outer edge of the supporting sole."""


@dataclass(frozen=True, kw_only=True)
class RelativePush:
    """A push on the trunk in single support, as a step in the CoM's velocity."""

    way: Way
    """Where it goes."""
    share: float
    """When it begins: share of the single support [-], in [0, 1)."""
    speed: float = 0.0
    """Impulse by mass [m/s]."""
    step: int = 4
    """In the single support of which step, from 1."""
    duration: float = 0.1
    """How long it lasts [s]."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One thing to do, in the measures of whatever robot does it."""

    name: str
    """Name; its first word is the group that it is chosen and shown with."""
    task: Literal["walk", "dance", "speed", "push", "about"] = "walk"
    """Walk or dance once; find the largest speed or push; or describe the robot."""
    steps: int = 20
    """Number of steps."""
    forward: float = 1.0
    """Length of the steps, in natural steps forward."""
    sideways: float = 0.0
    """Shift per step, in natural steps to the left."""
    turn: float = 0.0
    """Turn per step, left positive [rad]."""
    speed_ratio: float = 1.0
    """Speed, in natural speeds; beyond 1, steps get longer and quicker."""
    stops: bool = False
    """Whether the robot stops on the way, and starts again."""
    push: RelativePush | None = None
    """A push on the way."""
    tolerance: float = 0.02
    """How exactly a largest speed [natural speeds] or push [m/s] is found."""
    keys: Keys = field(default_factory=dict)
    """More keys of the configuration."""

    @property
    def group(self) -> str:
        """The first word of the name."""
        return self.name.split()[0]


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """A controller other than the default one, to compare."""

    name: str
    """Name, for tables."""
    changes: Keys
    """Keys of the configuration that differ."""

    def of(self, case: Case) -> Case:
        """Return a case as this controller does it; its own keys come first."""
        return dataclasses.replace(case, keys={**self.changes, **case.keys})


DEFAULT = Ablation(name="default", changes={})
"""The controller as it comes."""


OPEN_LOOP = Ablation(
    name="open loop", changes={"gains.zmp": (0.0, 0.0), "gains.com": (0.0, 0.0)}
)
"""The pattern alone, without feedback of CoM and ZMP."""


TORQUE = Ablation(
    name="torque",
    changes={
        "actuation": "pd",
        "pd": (100.0, 40.0, 2.0),
        "sensors": "torque",
        "simulator.noise": 1.0,
        "simulator.latency": 0.002,
        "simulator.command_delay": 0.002,
        "simulator.joint_friction": 0.5,
    },
)
"""Soft gains, torques as the only sense of the ground, and the flaws of real joints."""


ABLATIONS = (
    OPEN_LOOP,
    TORQUE,
    Ablation(name="no IMU", changes={"body.imu": False}),
    Ablation(name="no landing", changes={"body.landing": 0.0}),
    Ablation(name="no rolling", changes={"body.rolling": 0.0}),
    Ablation(name="no weighing", changes={"body.calibration": False}),
    Ablation(name="point mass", changes={"pendulum.inertia": 0.0}),
    Ablation(name="no deflection", changes={"body.deflection_compensation": False}),
    Ablation(
        name="paper",
        changes={
            "body.imu": False,
            "body.landing": 0.0,
            "body.rolling": 0.0,
            "body.calibration": False,
            "pendulum.inertia": 0.0,
            "body.deflection_compensation": False,
        },
    ),
)
"""Each drives the robot otherwise or takes something away, the last all but the law."""


WALKS = (
    Case(name="forward"),
    Case(name="back", forward=-1.0, steps=10),
    Case(name="sideways", forward=0.0, sideways=1.0, steps=10),
    Case(name="turn", forward=0.0, turn=math.tau / 20),
    Case(name="curve", turn=math.radians(15.0), steps=12),
    Case(name="stop-and-go", stops=True, steps=6),
    Case(name="dance", task="dance", keys={"frequency": 1.0}),
    Case(
        name="walk-and-dance",
        steps=10,
        keys={"motion": "disco", "motion_frequency": 1.0},
    ),
)
"""What every robot should be able to do on a flat floor."""


_MILD = {"simulator.noise": 1.0, "simulator.latency": 0.004, "simulator.friction": 0.5}


DISTURBED = (
    Case(name="payload 10 %", keys={"simulator.payload": 0.1}),
    Case(name="payload 20 %", keys={"simulator.payload": 0.2}),
    Case(name="slippery", keys={"simulator.friction": 0.2}),
    Case(name="latency", keys={"simulator.latency": 0.01}),
    Case(name="noise", keys={"simulator.noise": 1.0}),
    Case(
        name="everything",
        keys={**_MILD, "simulator.terrain": 0.003, "stiffness": 0.5},
    ),
)
"""The walk forward with something wrong that the controller does not know of."""


ABOUT = Case(name="about", task="about")
"""What a robot is like."""


SPEED = Case(name="speed", task="speed", tolerance=0.05)
"""The largest speed at which 20 steps stay inside speed and torque limits."""


FLOOR_HEIGHTS = (0.005, 0.010, 0.015)
"""Heights of rough floors [m]."""


PUSH_WAYS: tuple[Way, ...] = ("forward", "back", "inward", "outward")


PUSH_SHARES = (0.10, 0.35, 0.60, 0.85)
"""When pushes begin, as shares of the single support [-]."""


def floors(
    seeds: Iterable[int], heights: Iterable[float] = FLOOR_HEIGHTS
) -> tuple[Case, ...]:
    """Return the walk forward over rough floors.

    Args:
        seeds: One floor each, `TUNING_SEEDS` unless it is for a report.
        heights: Of the highest boxes [m].

    Returns:
        A case for each height and seed, named such as "floor 5 mm #3".
    """
    seeds = tuple(seeds)
    return tuple(
        Case(
            name=f"floor {1e3 * h:g} mm #{seed}",
            keys={"simulator.terrain": h, "simulator.terrain_seed": seed},
        )
        for h in heights
        for seed in seeds
    )


def pushes(
    shares: Iterable[float] = PUSH_SHARES, ways: Iterable[Way] = PUSH_WAYS
) -> tuple[Case, ...]:
    """Return searches for the largest push that a robot survives.

    Args:
        shares: When it begins, as shares of the single support of step 4 [-].
        ways: Where it goes.

    Returns:
        A case for each, named such as "push outward 35 %".
    """
    shares = tuple(shares)
    return tuple(
        Case(
            name=f"push {way} {100 * share:.0f} %",
            task="push",
            steps=10,
            push=RelativePush(way=way, share=share),
        )
        for way in ways
        for share in shares
    )


def all_cases(seeds: Iterable[int]) -> tuple[Case, ...]:
    """Return all that a robot is tried with.

    Args:
        seeds: Of the rough floors.

    Returns:
        The cases, in the order of a report.
    """
    return (ABOUT, *WALKS, *DISTURBED, SPEED, *pushes(), *floors(seeds))
