"""Profiles: TOML files that tell what cannot be seen in a robot's own file.

Whatever comwalk finds out about a robot, a profile may say otherwise, and a profile can
be written that says all of it. Angles are in rad, but `forward` is in degrees.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from ..errors import ParameterError, RunError, checked_number, nearest
from ..sides import Side


@dataclass(frozen=True, kw_only=True)
class Stance:
    """How a robot is to stand; what is None is found."""

    bend: float | None = None
    """How far the legs stay from their singular posture, as `posture.BEND` [rad]."""
    com_height: float | None = None
    """Height of the CoM above the soles [m], instead of a bend."""
    half_width: float | None = None
    """Half of the distance between the soles' centres [m]."""


@dataclass(frozen=True)
class ServoGains:
    """Gains of one joint's position servo; what is None is designed."""

    stiffness: float | None = None
    """Position gain [N m/rad], of a slide [N/m]."""
    damping: float | None = None
    """Velocity gain [N m s/rad], of a slide [N s/m]."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of one joint; what is None is the file's."""

    lower: float | None = None
    """Lower limit [rad], of a slide [m]."""
    upper: float | None = None
    """Upper limit [rad], of a slide [m]."""
    speed: float | None = None
    """Speed limit [rad/s], of a slide [m/s]."""
    torque: float | None = None
    """Torque limit [N m], of a slide [N]."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """What is known of a robot; what is None or missing is found."""

    forward: float | None = None
    """Yaw of the forward axis in the zero posture of the file [rad]."""
    imu: str | None = None
    """Body that bears the IMU."""
    torso: tuple[str, ...] | None = None
    """Joints of the torso, from the base outwards."""
    head: tuple[str, ...] | None = None
    """Joints of the neck, from the base outwards."""
    locked: tuple[str, ...] = ()
    """Joints that are not to move."""
    feet: Mapping[Side, str] = field(default_factory=dict)
    """Bodies of the feet, both or none."""
    legs: Mapping[Side, tuple[str, ...]] = field(default_factory=dict)
    """Joints of the legs, from the base outwards, both or none."""
    arms: Mapping[Side, tuple[str, ...]] = field(default_factory=dict)
    """Joints of the arms, from the base outwards."""
    soles: Mapping[Side, Mapping[str, float]] = field(default_factory=dict)
    """Numbers of the soles [m], as `soles.make_sole` takes them."""
    stance: Stance = field(default_factory=Stance)
    """How the robot stands, where `home` leaves the legs' angles open."""
    home: Mapping[str, float] = field(default_factory=dict)
    """Angles of the walking posture [rad], by joint; locked joints stay there."""
    servo: Mapping[str, ServoGains] = field(default_factory=dict)
    """Gains by joint."""
    limits: Mapping[str, Limits] = field(default_factory=dict)
    """Limits by joint."""

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the fields that say something."""
        usual = Profile()
        names = [f.name for f in fields(self)]
        return tuple(n for n in names if getattr(self, n) != getattr(usual, n))

    @property
    def joints(self) -> Iterator[tuple[str, str]]:
        """Each joint that is named, with the key under which."""
        for key in ("torso", "head", "locked", "home", "servo", "limits"):
            yield from ((key, name) for name in getattr(self, key) or ())
        for key in ("legs", "arms"):
            for joints in getattr(self, key).values():
                yield from ((key, name) for name in joints)

    @property
    def bodies(self) -> Iterator[tuple[str, str]]:
        """Each body that is named, with the key under which."""
        yield from (("feet", name) for name in self.feet.values())
        if self.imu is not None:
            yield "imu", self.imu


# ---- Reading ----------------------------------------------------------------------


def read_profile(source: str | Path | Mapping[str, Any] | None) -> Profile:
    """Return a profile from a TOML file, or from a table with the same keys.

    Args:
        source: The file, or the table; None for a profile that says nothing.

    Returns:
        The profile.

    Raises:
        ParameterError: If the file cannot be read, a key is unknown, or a value is of
            the wrong kind or out of range; the message names file and key.

    Example:
        >>> read_profile({"forward": 90.0, "stance": {"half_width": 0.1}}).given
        ('forward', 'stance')
    """
    if source is None:
        return Profile()
    table = source if isinstance(source, Mapping) else _table_in(Path(source))
    try:
        values = {key: _read(key, value) for key, value in table.items()}
        _check_together(values)
    except ParameterError as error:
        where = "" if isinstance(source, Mapping) else f" {source}"
        raise ParameterError(f"profile{where}: {error}") from None
    return Profile(**values)


def _table_in(path: Path) -> dict[str, Any]:
    """Return the table in a TOML file."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise ParameterError(f"{path} is not valid TOML: {error}") from None


def _read(key: str, value: Any) -> Any:
    if key not in _READERS:
        raise ParameterError(f'unknown key "{key}"; {nearest(key, _READERS)}')
    return _READERS[key](key, value)


def _check_together(values: Mapping[str, Any]) -> None:
    """Check what one value says against another."""
    for key in ("feet", "legs"):
        if len(values.get(key, Side)) != len(Side):
            raise ParameterError(f"{key} needs both left and right")
    stance = values.get("stance", Stance())
    if stance.bend is not None and stance.com_height is not None:
        raise ParameterError("stance takes bend or com_height, not both")
    for joint, own in values.get("limits", {}).items():
        low = -math.inf if own.lower is None else own.lower
        high = math.inf if own.upper is None else own.upper
        if low >= high:
            raise ParameterError(
                f"limits.{joint}: lower, {low:.6g}, must be below upper, {high:.6g}"
            )
    parts = [*values.get("legs", {}).values(), *values.get("arms", {}).values()]
    parts += [values.get(key) or () for key in ("torso", "head", "locked")]
    named = [joint for part in parts for joint in part]
    twice = next((joint for joint in named if named.count(joint) > 1), None)
    if twice is not None:
        raise ParameterError(f'joint "{twice}" is named twice; a joint is in one part')


Reader = Callable[[str, Any], Any]
"""Takes where a value stands and the value, returns it checked."""


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise ParameterError(f'{key} must be a name, such as "torso", got {value!r}')
    return value


def _names(key: str, value: Any) -> tuple[str, ...]:
    """Return a list of names."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ParameterError(
            f'{key} must be a list of joints, such as ["neck_yaw"], got {value!r}'
        )
    return tuple(_text(key, name) for name in value)


def _table(key: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ParameterError(f"{key} must be a table, [{key}], got {value!r}")
    return value


def _number(low: float, high: float, unit: str, factor: float = 1.0) -> Reader:
    return lambda key, value: (
        checked_number(key, value, unit=unit, low=low, high=high) * factor
    )


def _sides(reader: Reader) -> Reader:
    """Return a reader of values by side; `both` stands for left and right."""

    def read(key: str, value: Any) -> dict[Side, Any]:
        found: dict[Side, Any] = {}
        for word, part in _table(key, value).items():
            if word not in ("left", "right", "both"):
                known = nearest(word, ("left", "right", "both"))
                raise ParameterError(f'{key} has no "{word}"; {known}')
            own = reader(f"{key}.{word}", part)
            found |= {s: own for s in (Side if word == "both" else (Side(word),))}
        return found

    return read


def _joints(reader: Reader) -> Reader:
    return lambda key, value: {
        name: reader(f"{key}.{name}", part) for name, part in _table(key, value).items()
    }


def _record(kind: Callable[..., Any], **readers: Reader) -> Reader:
    """Return a reader of tables with known keys."""

    def read(key: str, value: Any) -> Any:
        for word in _table(key, value):
            if word not in readers:
                raise ParameterError(f'{key} has no "{word}"; {nearest(word, readers)}')
        return kind(**{w: readers[w](f"{key}.{w}", v) for w, v in value.items()})

    return read


_LENGTH, _PLACE = _number(1e-3, 10.0, "m"), _number(-10.0, 10.0, "m")
_ANGLE = _number(-100.0, 100.0, "rad")

_READERS: dict[str, Reader] = {
    "forward": _number(-360.0, 360.0, "deg", math.pi / 180.0),
    "imu": _text,
    "torso": _names,
    "head": _names,
    "locked": _names,
    "feet": _sides(_text),
    "legs": _sides(_names),
    "arms": _sides(_names),
    "soles": _sides(
        _record(dict, length=_LENGTH, width=_LENGTH, x=_PLACE, y=_PLACE, height=_PLACE)
    ),
    "stance": _record(
        Stance,
        bend=_number(0.01, 1.0, "rad"),
        com_height=_LENGTH,
        half_width=_LENGTH,
    ),
    "home": _joints(_ANGLE),
    "servo": _joints(
        _record(
            ServoGains,
            stiffness=_number(1e-6, 1e9, "N m/rad"),
            damping=_number(0.0, 1e9, "N m s/rad"),
        )
    ),
    "limits": _joints(
        _record(
            Limits,
            lower=_ANGLE,
            upper=_ANGLE,
            speed=_number(1e-3, 1e6, "rad/s"),
            torque=_number(1e-6, 1e9, "N m"),
        )
    ),
}


def check_names(profile: Profile, joints: Iterable[str], bodies: Iterable[str]) -> None:
    """Check that a robot has the joints and bodies that a profile names.

    Args:
        profile: The profile.
        joints: Names of the robot's joints.
        bodies: Names of its bodies.

    Raises:
        ParameterError: If one is unknown; it names the nearest.
    """
    for kind, named, known in (
        ("joint", profile.joints, set(joints)),
        ("body", profile.bodies, set(bodies)),
    ):
        for key, name in named:
            if name not in known:
                hint = nearest(name, known)
                more = "" if len(hint) < 200 else "see `comwalk robot`"
                raise ParameterError(
                    f'profile: {key} names a {kind} "{name}" that the robot has not; '
                    f"{more or hint}"
                )


# ---- Writing ----------------------------------------------------------------------


def write_profile(profile: Profile, path: str | Path, title: str = "") -> None:
    """Write a profile as a TOML file that `read_profile` reads.

    Args:
        profile: The profile.
        path: The file.
        title: First line of the file, a comment.

    Raises:
        RunError: If the file cannot be written.
    """
    try:
        Path(path).write_text(profile_text(profile, title), encoding="utf-8")
    except OSError as error:
        raise RunError(
            f"cannot write the profile {path}: {error.strerror or error}"
        ) from None


def profile_text(profile: Profile, title: str = "") -> str:
    """Return a profile as TOML, numbers with seven digits.

    Args:
        profile: The profile.
        title: First line, a comment.

    Returns:
        The text of the file.
    """
    lines = [f"# {title}"] if title else []
    for key in ("forward", "imu", "torso", "head", "locked"):
        if key in profile.given:
            value = getattr(profile, key)
            value = math.degrees(value) if key == "forward" else value
            lines.append(f"{key} = {_toml(value)}{_COMMENTS.get(key, '')}")
    for key in ("feet", "legs", "arms", "soles", "stance", "home", "servo", "limits"):
        if key in profile.given:
            value = getattr(profile, key)
            rows = asdict(value) if key == "stance" else value
            lines += ["", f"[{key}]{_COMMENTS.get(key, '')}"]
            lines += [
                f"{_bare(name)} = {_toml(x)}"
                for name, x in rows.items()
                if x is not None
            ]
    return "\n".join([*lines, ""])


_COMMENTS = {
    "forward": "  # yaw of the forward axis in the file's zero posture, deg",
    "locked": "  # joints that do not move",
    "legs": "  # joints from the base outwards",
    "soles": "  # m; x, y: centre seen from the last joint; height of that joint",
    "stance": "  # m; where [home] leaves the legs' angles open",
    "home": "  # rad",
    "servo": "  # N m/rad, N m s/rad",
    "limits": "  # rad, rad/s, N m",
}


def _bare(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else _toml(name)


def _toml(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, (ServoGains, Limits)):
        value = asdict(value)
    if isinstance(value, Mapping):
        parts = [f"{_bare(k)} = {_toml(v)}" for k, v in value.items() if v is not None]
        return "{ " + ", ".join(parts) + " }"
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(part) for part in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    text = f"{float(value):.7g}"
    return text if set(text) & set(".einf") else f"{text}.0"
