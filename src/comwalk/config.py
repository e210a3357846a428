"""What a command is asked to do: from flags and TOML files to what `simulate` takes.

A configuration is a frozen dataclass; its fields are the flags of the command line and
the keys of a TOML file alike (`--gait.half-step 0.08`, or `half_step = 0.08` under
`[gait]`). Flags win over the file, and over what suits the robot, which is what all
numbers are that nobody gave. The `build` functions turn a configuration into a robot, a
pattern, a motion and settings, and check them together.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shlex
import tomllib
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    Generic,
    Literal,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from .certificates import SampledLoop
from .certificates.identification import Experiment
from .control import BodySettings, ControlSettings, Gains, Push, SimulatorSettings
from .errors import ComwalkError, ParameterError, checked_number, nearest
from .pattern import Gait, Pendulum, checked_count

if TYPE_CHECKING:
    pass

MAX_SEED = 2**32 - 1
"""Largest seed of random numbers [-]."""

_UNSEEN = {(SimulatorSettings, "pushes")}  # given by `push` instead


# ---- Configurations ---------------------------------------------------------------

Part = TypeVar("Part", Gait, Pendulum, Gains, ControlSettings, SampledLoop)
"""What a robot has defaults for."""


@dataclass(frozen=True)
class Given(Generic[Part]):
    """The numbers of a part that a user gave; the robot's defaults are the others."""

    kind: type[Part]
    """The part."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values by the name of the part's field."""

    def __post_init__(self) -> None:
        """Check the values; store them as the part does.

        Raises:
            ParameterError: If a value is out of range.
        """
        part = self.kind(**{**_UNBOUND.get(self.kind, {}), **self.values})
        values = {name: getattr(part, name) for name in self.values}
        object.__setattr__(self, "values", values)

    def over(self, defaults: Part) -> Part:
        """Return the defaults with the given values in their place.

        Args:
            defaults: The part as it suits the robot.

        Returns:
            The whole part.
        """
        return dataclasses.replace(defaults, **self.values)


# Bounds of one another, so that each can be checked alone.
_UNBOUND: dict[Any, Mapping[str, Any]] = {
    Gait: {"period": 10.0, "transfer_time": 0.005}
}


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """What all commands that move a robot share. Abstract."""

    robot: str = "paper"
    """Robot of `comwalk robots`, or path of a URDF or MJCF file."""
    profile: str | None = None
    """TOML file that tells what cannot be seen in the robot's file."""
    gains: Given[Gains] = Given(Gains)
    """Gains of the walking control law."""
    control: Given[ControlSettings] = Given(ControlSettings)
    """Filter, delay and bounds of the controller."""
    body: BodySettings = field(default_factory=BodySettings)
    """How the whole body follows its commands."""
    simulator: SimulatorSettings = field(default_factory=SimulatorSettings)
    """Physics."""
    pendulum: Given[Pendulum] = Given(Pendulum)
    """The simplified model."""
    stiffness: float = 1.0
    """Factor on the stiffness of all servos, in (0, 100]."""
    push: tuple[str, ...] = ()
    """Push on the trunk, START:FX,FY,FZ[:DURATION] in s and N, for 0.1 s by default;
    may be given several times."""
    period: float = 0.002
    """Control period [s], in [1e-4, 0.05], a multiple of simulator.timestep."""
    seed: int = 0
    """Seed of all random numbers, in [0, 4294967295]."""
    out: str | None = None
    """Folder for the results; a new one under runs/ if not given."""
    report: bool = False
    """Write report.html: the run in 3D, its figures and settings as one page."""
    video: tuple[str, ...] = ()
    """Film of the run, .mp4 (needs the extra `video`), .webp or .gif; .png and .jpg are
    stills side by side; may be given several times."""
    json: bool = False
    """Print one JSON object instead of tables."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        for text in self.push:
            parse_push(text)
        name, factor, dt = "stiffness", self.stiffness, self.period
        checked_number(name, factor, low=0, high=100, open_low=True)
        checked_number("period", dt, unit="s", low=1e-4, high=0.05)
        checked_count("seed", self.seed, 0, MAX_SEED)

    @property
    def physics(self) -> SimulatorSettings:
        """The simulator's settings, with the pushes."""
        pushes = tuple(parse_push(text) for text in self.push)
        return dataclasses.replace(self.simulator, pushes=pushes)


@dataclass(frozen=True, kw_only=True)
class WalkConfig(RobotConfig):
    """A walk."""

    steps: int = 20
    """Number of steps, in [1, 100000]; a plan has its own."""
    plan: str | None = None
    """TOML file of footsteps to walk instead of a regular gait."""
    speed: float | None = None
    """Forward speed [m/s], negative backward; chooses step and time of the gait."""
    side: float | None = None
    """Sideways speed [m/s], left positive; chooses step and time of the gait."""
    turn: float | None = None
    """Turning speed [deg/s], left positive; chooses step and time of the gait."""
    gait: Given[Gait] = Given(Gait)
    """The regular walk."""
    force: bool = False
    """Walk even what the robot is not able to, as `comwalk check` tells."""
    plant: Literal["robot", "pendulum"] = "robot"
    """What walks: the robot in full physics, or the simplified model of Eq. (30)."""
    disturbance: tuple[float, float] | None = None
    """Bounds a [m/s] and b [m/s^2] of a random disturbance of the pendulum and of its
    rate."""
    motion: str | None = None
    """Dance of the upper body while walking: a name of `comwalk motions`, or a CSV or
    NPZ file."""
    motion_amplitude: float | None = None
    """Largest angle of a built-in dance [rad], in (0, 2.5]; 0.5 if not given."""
    motion_frequency: float | None = None
    """Cycles of a built-in dance per second [Hz], in (0, 3]; 0.5 if not given."""
    motion_scale: float = 1.0
    """Factor on all angles of the dance about the home posture, in [0, 100]."""
    motion_speed: float = 1.0
    """Factor on the speed of the dance, in [0.001, 1000]."""
    motion_blend: float = 1.0
    """Time to blend the dance in, and to blend it out [s], above 0."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range, or goes with another plant.
        """
        super().__post_init__()
        checked_count("steps", self.steps, 1, 100_000)
        for name, unit in (("speed", "m/s"), ("side", "m/s"), ("turn", "deg/s")):
            value = getattr(self, name)
            if value is not None:
                checked_number(name, value, unit=unit, low=-360, high=360)
        _check_dance(self, "motion_")
        if self.disturbance is not None:
            for name, value, unit in zip("ab", self.disturbance, _RATES, strict=True):
                checked_number(f"disturbance ({name})", value, unit=unit, low=0)
        wrong = ("motion", "push") if self.plant == "pendulum" else ("disturbance",)
        for name in wrong:
            if getattr(self, name):
                other = "robot" if self.plant == "pendulum" else "pendulum"
                raise ParameterError(
                    f'{name} is for plant "{other}", not for the {self.plant}'
                )


_RATES = ("m/s", "m/s^2")


def _check_dance(config: RobotConfig, prefix: str) -> None:
    """Check the numbers of a dance, which a walk calls motion_..."""
    for name, (unit, low, high, open_low) in _DANCE_LIMITS.items():
        value = getattr(config, prefix + name)
        if value is not None:
            checked_number(
                prefix + name, value, unit=unit, low=low, high=high, open_low=open_low
            )


_DANCE_LIMITS = {
    "amplitude": ("rad", 0.0, 2.5, True),
    "frequency": ("Hz", 0.0, 3.0, True),
    "scale": ("", 0.0, 100.0, False),
    "speed": ("", 1e-3, 1e3, False),
    "blend": ("s", 0.0, 3600.0, True),
}


@dataclass(frozen=True, kw_only=True)
class DanceConfig(RobotConfig):
    """A dance with both feet on the ground."""

    motion: str = "paper"
    """Dance of the upper body: a name of `comwalk motions`, or a CSV or NPZ file."""
    duration: float | None = None
    """Time of the whole dance, from and back to the home posture [s], in [1, 3600]; if
    not given, 10 s, or once through a file that does not loop."""
    amplitude: float | None = None
    """Largest angle of a built-in dance [rad], in (0, 2.5]; 0.5 if not given."""
    frequency: float | None = None
    """Cycles of a built-in dance per second [Hz], in (0, 3]; 0.5 if not given."""
    scale: float = 1.0
    """Factor on all angles of the dance about the home posture, in [0, 100]."""
    speed: float = 1.0
    """Factor on the speed of the dance, in [0.001, 1000]."""
    blend: float = 1.0
    """Time to blend the dance in, and to blend it out [s], above 0."""
    half_width: float | None = None
    """Half of the distance between both feet [m], in [0.02, 0.4]; as in the robot's
    home posture if not given."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        super().__post_init__()
        if self.duration is not None:
            checked_number("duration", self.duration, unit="s", low=1, high=3600)
        _check_dance(self, "")
        if self.half_width is not None:
            width = self.half_width
            checked_number("half_width", width, unit="m", low=0.02, high=0.4)


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig(RobotConfig):
    """An experiment on the standing robot."""

    experiment: Experiment = field(default_factory=Experiment)
    """How the robot is shaken."""


@dataclass(frozen=True, kw_only=True)
class PatternConfig:
    """A regular walk on paper."""

    gait: Gait = field(default_factory=Gait)
    """The regular walk."""
    pendulum: Pendulum = field(default_factory=Pendulum)
    """The simplified model."""
    steps: int = 4
    """Number of steps drawn, in [1, 1000]."""
    out: str | None = None
    """Folder for the plot of Fig. 3; nothing is written if not given."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        checked_count("steps", self.steps, 1, 1000)


@dataclass(frozen=True, kw_only=True)
class CertifyConfig:
    """What gains guarantee on a robot."""

    robot: str = "paper"
    """Robot of `comwalk robots`, or path of a URDF or MJCF file."""
    profile: str | None = None
    """TOML file that tells what cannot be seen in the robot's file."""
    gains: Given[Gains] = Given(Gains)
    """Gains of the walking control law."""
    loop: Given[SampledLoop] = Given(SampledLoop)
    """The loop as it runs; `comwalk identify` measures it."""
    pendulum: Given[Pendulum] = Given(Pendulum)
    """The simplified model."""
    disturbance: tuple[float, float] = (0.05, 0.5)
    """Bounds a [m/s] and b [m/s^2] of the error of the CoM's velocity and of its
    rate."""
    exact: bool = True
    """Whether to find the exact worst cases, by linear programs."""
    design: str | None = None
    """Design gains and ZMP filter: gait (least ZMP error of the robot's steps),
    disturbance (the largest that is guaranteed to be survived), or a natural frequency
    in rad/s and a damping, such as 4.1,0.7."""
    out: str | None = None
    """Folder for certificate.json and the picture; nothing is written if not given."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def __post_init__(self) -> None:
        """Check what no other dataclass checks.

        Raises:
            ParameterError: If a value is out of range.
        """
        for name, value, unit in zip("ab", self.disturbance, _RATES, strict=True):
            checked_number(
                f"disturbance ({name})", value, unit=unit, low=0, open_low=True
            )
        if self.design is not None and self.gains.values:
            raise ParameterError("give a design or gains, not both")


def parse_push(text: str) -> Push:
    """Return a push from its text.

    Args:
        text: START:FX,FY,FZ or START:FX,FY,FZ:DURATION, in s and N.

    Returns:
        The push.

    Raises:
        ParameterError: If the text is of another form, or a number is out of range.

    Example:
        >>> parse_push("3.5:40,0,0:0.2").force
        (40.0, 0.0, 0.0)
    """
    parts = text.split(":")
    try:
        start, force = float(parts[0]), [float(x) for x in parts[1].split(",")]
        duration = [float(x) for x in parts[2:]]
        x, y, z = force
        if len(duration) > 1:
            raise ValueError
    except (ValueError, IndexError):
        raise ParameterError(
            "push must be START:FX,FY,FZ or START:FX,FY,FZ:DURATION in s and N, such "
            f'as 3.5:40,0,0:0.1, got "{text}"'
        ) from None
    return Push(start=start, force=(x, y, z), duration=(*duration, 0.1)[0])


# ---- Reading ----------------------------------------------------------------------

Config = TypeVar(
    "Config",
    RobotConfig,
    WalkConfig,
    DanceConfig,
    PatternConfig,
    CertifyConfig,
    IdentifyConfig,
)
"""One of the configurations."""

Table = Mapping[str, Any]
"""Values and tables of values by key."""


def make_config(
    kind: type[Config], given: Table | None = None, file: str | Path | None = None
) -> Config:
    """Return a configuration from flags and a file.

    Args:
        kind: Which configuration.
        given: Values by field name, with tables for fields that are dataclasses. They
            win over those of the file.
        file: TOML file with the same keys, or summary.json of an earlier run.

    Returns:
        The configuration; fields that neither gives have their defaults.

    Raises:
        ParameterError: If the file cannot be read, a key is unknown, or a value is of
            the wrong type or out of range; the message names file and key.

    Example:
        >>> make_config(WalkConfig, {"gait": {"half_step": 0.05}}).gait.values
        {'half_step': 0.05}
    """
    written = {} if file is None else read_table(file)
    return _construct(kind, written, given or {}, str(file), "")


def read_table(file: str | Path) -> dict[str, Any]:
    """Return the table in a file.

    Args:
        file: TOML file, or summary.json of an earlier run.

    Returns:
        Its keys, hyphens made underscores, and values.

    Raises:
        ParameterError: If the file is missing or broken.
    """
    path = Path(file)
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".json":
            document = json.loads(text)["settings"]["config"]
        else:
            document = tomllib.loads(text)
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror}") from None
    except (KeyError, TypeError):
        raise ParameterError(f"{path} is not the summary.json of a run") from None
    except (ValueError, RecursionError) as error:
        kind = "JSON" if path.suffix.lower() == ".json" else "TOML"
        raise ParameterError(f"{path} is not valid {kind}: {error}") from None
    return _underscored(document)


def _underscored(value: Any) -> Any:
    """Return a table with underscores instead of hyphens in its keys."""
    if not isinstance(value, dict):
        return value
    return {str(k).replace("-", "_"): _underscored(v) for k, v in value.items()}


def fields_of(kind: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that a user may give.

    Args:
        kind: The dataclass.

    Returns:
        Type hints by name.
    """
    hints = get_type_hints(kind)
    names = [f.name for f in dataclasses.fields(kind) if f.init]
    return {n: hints[n] for n in names if (kind, n) not in _UNSEEN}


def part_of(hint: Any) -> Any:
    """Return the part of which a field holds given values.

    Args:
        hint: Type of the field.

    Returns:
        The dataclass of the part; None if the field is no `Given`.
    """
    return get_args(hint)[0] if get_origin(hint) is Given else None


def _construct(kind: Any, written: Any, given: Table, file: str, prefix: str) -> Any:
    """Return a dataclass from the table of a file and from flags."""
    part = part_of(kind)
    hints = fields_of(part or kind)
    _check_keys(written, hints, file, prefix)
    values: dict[str, Any] = {}
    for name, hint in hints.items():
        if part_of(hint) or dataclasses.is_dataclass(hint):
            tables = written.get(name, {}), given.get(name, {})
            values[name] = _construct(hint, *tables, file, f"{prefix}{name}.")
        elif name in given:
            none = given[name] == "none" and _is_optional(hint)
            values[name] = None if none else given[name]
        elif name in written:
            where = f"{file}: {prefix}{name}"
            values[name] = _typed(written[name], hint, where)
    try:
        return kind(**values) if part is None else Given(part, values)
    except ComwalkError as error:
        text = _located(str(error), hints, set(written) - set(given), file, prefix)
        raise type(error)(text) from None


def _check_keys(table: Any, known: Mapping[str, Any], file: str, prefix: str) -> None:
    """Refuse what is not a table, and unknown keys."""
    if not isinstance(table, Mapping):
        key = prefix.rstrip(".")
        raise ParameterError(
            f"{file}: {key} must be a table, written [{key}], got {table!r}"
        )
    for key in table:
        if key not in known:
            raise ParameterError(
                f'{file}: unknown key "{prefix}{key}"; {nearest(key, known)}'
            )


def _located(
    text: str, names: Mapping[str, Any], written: set[str], file: str, prefix: str
) -> str:
    """Return a message that starts with the whole key, and with the file it is in."""
    found = re.match(r"(?:\w+\.)?(\w+)", text)
    name = found.group(1) if found else ""
    if name not in names:
        return text
    if not text.startswith(prefix):
        text = prefix + text
    return f"{file}: {text}" if name in written else text


def _is_optional(hint: Any) -> bool:
    """Return whether a field may be None, which users write "none"."""
    return isinstance(hint, types.UnionType) and types.NoneType in get_args(hint)


def _typed(value: Any, hint: Any, where: str) -> Any:
    """Return a value of a file if it is of the type that a field has."""
    if _is_optional(hint):
        if value == "none":
            return None
        (hint,) = (h for h in get_args(hint) if h is not types.NoneType)
    if get_origin(hint) is tuple:
        return _typed_items(value, get_args(hint), where)
    if get_origin(hint) is Literal:
        known = get_args(hint)
        if value not in known:
            words = " or ".join(f'"{k}"' for k in known)
            hint_text = nearest(str(value), known)
            raise ParameterError(f"{where} must be {words}, got {value!r}; {hint_text}")
        return value
    accepted = (int, float) if hint is float else (hint,)
    if not isinstance(value, accepted) or (
        isinstance(value, bool) and hint is not bool
    ):
        raise ParameterError(f"{where} must be {_WORDS[hint]}, got {value!r}")
    if isinstance(value, str) and not value.isprintable():
        raise ParameterError(f"{where} must be printable text, got {value!r}")
    return value


_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "text in quotes",
}


def _typed_items(value: Any, hints: Sequence[Any], where: str) -> Any:
    """Return an array of a file as a tuple; one number may stand for two."""
    many = hints[-1] is Ellipsis
    items = list(value) if isinstance(value, list) else [value]
    if not many and len(items) not in (1, len(hints)):
        raise ParameterError(
            f"{where} must be one number or {len(hints)}, got {len(items)}"
        )
    typed = tuple(_typed(item, hints[0], where) for item in items)
    return typed * len(hints) if len(typed) == 1 and not many else typed


def table_of(config: Any) -> dict[str, Any]:
    """Return a configuration as a table that `make_config` takes.

    Args:
        config: A configuration.

    Returns:
        All values that are not None, ready for TOML or JSON.

    Example:
        >>> table_of(PatternConfig(steps=3))["steps"]
        3
    """
    names = fields_of(type(config))
    values = {name: getattr(config, name) for name in names}
    return {
        name: _tabled(value)
        for name, value in values.items()
        if value is not None or getattr(type(config), name, None) is not None
    }


def _tabled(value: Any) -> Any:
    """Return a value as TOML and JSON can hold it; what is not finite means none."""
    if isinstance(value, Given):
        return {name: _tabled(v) for name, v in value.values.items()}
    if dataclasses.is_dataclass(value):
        return table_of(value)
    if isinstance(value, tuple):
        return list(value)
    infinite = isinstance(value, float) and not math.isfinite(value)
    return "none" if value is None or infinite else value


def command_line(command: str, given: Table, file: str | Path | None = None) -> str:
    """Return the command line that gives the same configuration.

    Args:
        command: Its first word, such as "walk".
        given: Values of the flags.
        file: The file of `--config`, if any.

    Returns:
        Words quoted for a shell.

    Example:
        >>> given = {"robot": "paper", "steps": 4, "gains": {"zmp": (3.0, 1.8)}}
        >>> command_line("walk", given)
        'comwalk walk paper --steps 4 --gains.zmp 3.0,1.8'
    """
    flags = dict(given)
    words = ["comwalk", command, *filter(None, [flags.pop("robot", None)])]
    if file is not None:
        words += ["--config", str(file)]
    return shlex.join([*words, *_flags(flags, "")])


def _flags(table: Table, prefix: str) -> list[str]:
    """Return flags and their values."""
    words: list[str] = []
    for name, value in table.items():
        flag = f"--{prefix}{name.replace('_', '-')}"
        if isinstance(value, Mapping):
            words += _flags(value, f"{prefix}{name}.")
        elif isinstance(value, bool):
            dotted, _, last = flag.removeprefix("--").rpartition(".")
            words.append(flag if value else f"--{dotted}{dotted and '.'}no-{last}")
        elif isinstance(value, tuple) and value and isinstance(value[0], str):
            words += [word for item in value for word in (flag, item)]
        elif isinstance(value, tuple):
            words += [flag, ",".join(str(x) for x in value)]
        else:
            words += [flag, str(value)]
    return words


# ---- Building ---------------------------------------------------------------------
