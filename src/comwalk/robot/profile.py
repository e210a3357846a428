"""Profiles: TOML files with what a robot's own file does not say.

Whatever comwalk finds out about a robot, a profile may say otherwise, and a profile can
be written that says all of it. Angles are in rad, but `forward` is in degrees.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from ..control import ControlSettings, Gains
from ..errors import ParameterError, RunError, nearest
from ..pattern import Gait, Pendulum
from ..settings import Given, check_settings, decode, read_toml, setting, table_of
from ..sides import Side


@dataclass(frozen=True, kw_only=True)
class Stance:
    """The stance of a robot; None is searched for."""

    bend: float | None = setting(
        None,
        "How far the legs stay from their singular posture, as `posture.BEND`",
        "rad",
        "[0.01, 1]",
    )
    com_height: float | None = setting(
        None, "Height of the CoM above the soles, instead of a bend", "m", "[1e-3, 10]"
    )
    half_width: float | None = setting(
        None, "Half of the distance between the soles' centres", "m", "[1e-3, 10]"
    )

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ParameterError: If one is out of range, or two say the same.
        """
        check_settings(self)
        if self.bend is not None and self.com_height is not None:
            raise ParameterError("bend or com_height can be given, not both")


@dataclass(frozen=True, kw_only=True)
class SoleNumbers:
    """Dimensions of one sole; None is found from the model."""

    length: float | None = setting(None, "Length", "m", "[1e-3, 10]")
    width: float | None = setting(None, "Width", "m", "[1e-3, 10]")
    x: float | None = setting(
        None, "Centre, seen from the leg's last joint, forward", "m", "[-10, 10]"
    )
    y: float | None = setting(
        None, "Centre, seen from the leg's last joint, to the left", "m", "[-10, 10]"
    )
    height: float | None = setting(
        None, "Height of the leg's last joint above the sole", "m", "[-10, 10]"
    )

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ParameterError: If one is out of range.
        """
        check_settings(self)


@dataclass(frozen=True)
class ServoGains:
    """Gains and rotor of one joint's position servo; None is designed."""

    stiffness: float | None = setting(
        None, "Position gain, of a slide in N/m", "N m/rad", "[1e-6, 1e9]"
    )
    damping: float | None = setting(
        None, "Velocity gain, of a slide in N s/m", "N m s/rad", "[0, 1e9]"
    )
    armature: float | None = setting(
        None,
        "Rotor inertia at the joint, of a slide in kg; None is the file's, or designed",
        "kg m^2",
        "[1e-9, 1e3]",
    )

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ParameterError: If one is out of range.
        """
        check_settings(self)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of one joint; None keeps the file's."""

    lower: float | None = setting(
        None, "Lower limit, of a slide in m", "rad", "[-100, 100]"
    )
    upper: float | None = setting(
        None, "Upper limit, of a slide in m", "rad", "[-100, 100]"
    )
    speed: float | None = setting(
        None, "Speed limit, of a slide in m/s", "rad/s", "[1e-3, 1e6]"
    )
    torque: float | None = setting(
        None, "Torque limit, of a slide in N", "N m", "[1e-6, 1e9]"
    )

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ParameterError: If one is out of range, or the lower limit not below.
        """
        check_settings(self)
        low, high = self.lower, self.upper
        if low is not None and high is not None and low >= high:
            raise ParameterError(
                f"lower must be below upper, {high:.6g} rad, got {low:.6g}"
            )


@dataclass(frozen=True, kw_only=True)
class Profile:
    """What a user knows of a robot; anything left out is found."""

    forward: float | None = setting(
        None,
        "Yaw of the forward axis in the zero posture of the file",
        "deg",
        "[-360, 360]",
    )
    imu: str | None = setting(None, "Body that bears the IMU")
    torso: tuple[str, ...] | None = setting(
        None, "Joints of the torso, from the base outwards"
    )
    head: tuple[str, ...] | None = setting(
        None, "Joints of the neck, from the base outwards"
    )
    locked: tuple[str, ...] = setting((), "Joints that are not to move")
    feet: Mapping[Side, str] = setting(dict(), "Bodies of the feet, both or none")
    legs: Mapping[Side, tuple[str, ...]] = setting(
        dict(), "Joints of the legs, from the base outwards, both or none"
    )
    arms: Mapping[Side, tuple[str, ...]] = setting(
        dict(), "Joints of the arms, from the base outwards"
    )
    soles: Mapping[Side, SoleNumbers] = setting(dict(), "Numbers of the soles")
    stance: Stance = setting(
        Stance(), "How the robot stands, where `home` leaves the legs' angles open"
    )
    home: Mapping[str, float] = setting(
        dict(),
        "Angles of the walking posture, by joint; locked joints stay there",
        "rad",
        "[-100, 100]",
    )
    servo: Mapping[str, ServoGains] = setting(dict(), "Servos by joint")
    limits: Mapping[str, Limits] = setting(dict(), "Limits by joint")
    gait: Given[Gait] = setting(Given(Gait), "The gait that it walks with by default")
    gains: Given[Gains] = setting(Given(Gains), "The gains that it walks with")
    control: Given[ControlSettings] = setting(
        Given(ControlSettings), "Filter, delay and bounds of its controller"
    )
    pendulum: Given[Pendulum] = setting(Given(Pendulum), "Its simplified model")

    def __post_init__(self) -> None:
        """Check each value, and what one says against another.

        Raises:
            ParameterError: If they do not go together.
        """
        check_settings(self)
        for key in ("feet", "legs"):
            if len(getattr(self, key)) not in (0, len(Side)):
                raise ParameterError(f"{key} needs both left and right")
        parts = [*self.legs.values(), *self.arms.values()]
        parts += [getattr(self, key) or () for key in ("torso", "head", "locked")]
        named = [joint for part in parts for joint in part]
        twice = next((joint for joint in named if named.count(joint) > 1), None)
        if twice is not None:
            raise ParameterError(
                f'joint "{twice}" is named twice; a joint is in one part'
            )

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the fields that say something."""
        usual = Profile()
        names = [f.name for f in fields(self)]
        return tuple(n for n in names if getattr(self, n) != getattr(usual, n))

    def over(self, other: Profile) -> Profile:
        """Return another profile with what this one says in its place.

        Args:
            other: The other one.

        Returns:
            Both in one.
        """
        return replace(other, **{name: getattr(self, name) for name in self.given})

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
    table = {} if source is None else source
    try:
        return decode(
            Profile, table if isinstance(table, Mapping) else read_toml(table)
        )
    except ParameterError as error:
        where = "" if isinstance(table, Mapping) else f" {table}"
        raise ParameterError(f"profile{where}: {error}") from None


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
            lines.append(f"{key} = {_toml(value)}{_COMMENTS.get(key, '')}")
    for key in _TABLES:
        if key in profile.given:
            value = getattr(profile, key)
            rows = value if isinstance(value, Mapping) else table_of(value)
            lines += ["", f"[{key}]{_COMMENTS.get(key, '')}"]
            lines += [
                f"{_bare(name)} = {_toml(x)}"
                for name, x in rows.items()
                if x is not None
            ]
    return "\n".join([*lines, ""])


_TABLES = ("feet", "legs", "arms", "soles", "stance", "home", "servo", "limits")
_TABLES += ("gait", "gains", "control", "pendulum")
_COMMENTS = {
    "forward": "  # yaw of the forward axis in the file's zero posture, deg",
    "locked": "  # joints that do not move",
    "legs": "  # joints from the base outwards",
    "soles": "  # m; x, y: centre seen from the last joint; height of that joint",
    "stance": "  # m; where [home] leaves the legs' angles open",
    "home": "  # rad",
    "servo": "  # N m/rad, N m s/rad, kg m^2",
    "limits": "  # rad, rad/s, N m",
}


def _bare(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else _toml(name)


def _toml(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, (ServoGains, Limits, SoleNumbers)):
        value = table_of(value)
    if isinstance(value, Mapping):
        parts = [f"{_bare(k)} = {_toml(v)}" for k, v in value.items() if v is not None]
        return "{ " + ", ".join(parts) + " }"
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_toml(part) for part in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    text = f"{float(value):.7g}"
    return text if set(text) & set(".einf") else f"{text}.0"
