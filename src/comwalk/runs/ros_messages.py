"""ROS 2 messages as bytes: types, definitions and layouts.

A message is CDR in little endian: four bytes that say so, then the fields in order,
each aligned to its own size. Messages of one topic differ in numbers alone, as long as
names and counts stay the same; so a `Layout` is made once of an example, and a thousand
messages are a few assignments to columns of a structured array.

Values are nested dictionaries of the fields; those left out are zero or empty.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..errors import RunError

TYPES = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point",
    "geometry_msgs/Wrench": (
        "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque"
    ),
    "geometry_msgs/WrenchStamped": (
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench"
    ),
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
        "float64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance"
    ),
}
"""Fields of each message, in the language of .msg files."""

_NUMBERS = {"int32": "<i4", "uint32": "<u4", "float64": "<f8"}
_HEADER = b"\x00\x01\x00\x00"  # CDR, little endian
_SEPARATOR = "=" * 80


class Field(NamedTuple):
    """A field of a message."""

    name: str
    """Its name."""
    kind: str
    """Its type, or that of its elements."""
    count: int | None
    """Number of elements; 0 if any, None if it is no array."""


@cache
def fields_of(kind: str) -> tuple[Field, ...]:
    """Return the fields of a message.

    Args:
        kind: Its type, such as "geometry_msgs/Point".

    Returns:
        The fields in order.

    Raises:
        RunError: If a log of comwalk holds no such messages.
    """
    if kind not in TYPES:
        raise RunError(f"messages of the type {kind} are not known to comwalk")
    found = []
    for line in TYPES[kind].splitlines():
        match = re.fullmatch(r"([\w/]+)(?:\[(\d*)\])? (\w+)", line)
        if match is not None:
            base, count, name = match.groups()
            found.append(Field(name, base, None if count is None else int(count or 0)))
    return tuple(found)


def definition(kind: str) -> str:
    """Return the text of a message and of all that it is made of.

    Args:
        kind: Its type.

    Returns:
        The definition as logs hold it, with the parts after lines of "=".
    """
    parts, found = [kind], [TYPES[kind]]
    for part in parts:
        for field in fields_of(part):
            if field.kind in TYPES and field.kind not in parts:
                parts.append(field.kind)
                found.append(f"{_SEPARATOR}\nMSG: {field.kind}\n{TYPES[field.kind]}")
    return "\n".join(found) + "\n"


@dataclass(frozen=True, eq=False)
class Layout:
    """Offsets of the numbers in a message's bytes."""

    kind: str
    """Type of the message."""
    template: bytes
    """The message that it was made of."""
    dtype: np.dtype
    """One message, as long as the template; its fields are the numbers by their path,
    such as "header.stamp.sec". What holds float64 alone is one array: "point"."""

    def read(self, messages: bytes) -> np.ndarray:
        """Return messages that stand one after the other, as an array of `dtype`.

        Args:
            messages: Their bytes.

        Returns:
            Of shape (messages,).
        """
        return np.frombuffer(messages, self.dtype)


def layout_of(kind: str, value: Mapping[str, Any]) -> Layout:
    """Return the layout of messages like one.

    Args:
        kind: Type of the message.
        value: The example.

    Returns:
        Its layout.
    """
    encoder = _Encoder()
    encoder.message(kind, value, "")
    dtype = np.dtype(
        {
            "names": [path for path, _, _ in encoder.places],
            "formats": [number for _, number, _ in encoder.places],
            "offsets": [len(_HEADER) + offset for _, _, offset in encoder.places],
            "itemsize": len(_HEADER) + len(encoder.body),
        }
    )
    return Layout(kind, _HEADER + bytes(encoder.body), dtype)


def encode(kind: str, value: Mapping[str, Any]) -> bytes:
    """Return the bytes of a message.

    Args:
        kind: Its type.
        value: Its fields.

    Returns:
        CDR, little endian.

    Example:
        >>> encode("std_msgs/String", {"data": "hi"}).hex()
        '0001000003000000686900'
    """
    encoder = _Encoder()
    encoder.message(kind, value, "")
    return _HEADER + bytes(encoder.body)


class _Encoder:
    """Writes a message, and notes where its numbers are. Final."""

    def __init__(self) -> None:
        self.body = bytearray()
        self.places: list[tuple[str, Any, int]] = []

    def message(self, kind: str, value: Mapping[str, Any], path: str) -> None:
        """Write all fields of a message."""
        if is_vector(kind):
            numbers = [value.get(f.name, 0.0) for f in fields_of(kind)]
            self._numbers("float64", np.array(numbers, float), path)
            return
        for field in fields_of(kind):
            self._field(field, value.get(field.name), f"{path}.{field.name}".strip("."))

    def _field(self, field: Field, value: Any, path: str) -> None:
        """Write a field: one element, or an array of them."""
        if field.count is None:
            self._element(field.kind, value, path)
            return
        if field.count:
            value = np.zeros(field.count) if value is None else value
        else:
            value = () if value is None else value
            self._numbers("uint32", np.array(len(value)))
        if field.kind in _NUMBERS:
            if len(value):
                self._numbers(field.kind, np.array(value), path)
            return
        for i, element in enumerate(value):
            self._element(field.kind, element, f"{path}.{i}")

    def _element(self, kind: str, value: Any, path: str) -> None:
        """Write a number, a string or a message."""
        if kind in _NUMBERS:
            self._numbers(kind, np.array(0 if value is None else value), path)
        elif kind == "string":
            text = (value or "").encode() + b"\0"
            self._numbers("uint32", np.array(len(text)))
            self.body += text
        else:
            self.message(kind, value or {}, path)

    def _numbers(self, kind: str, values: np.ndarray, path: str = "") -> None:
        """Write numbers at the next place that suits them."""
        dtype = np.dtype(_NUMBERS[kind])
        self.body += bytes(-len(self.body) % dtype.itemsize)
        if path:
            self.places.append((path, (dtype, values.shape), len(self.body)))
        self.body += values.astype(dtype).tobytes()


@cache
def is_vector(kind: str) -> bool:
    """Return whether a message is float64 numbers and nothing else.

    Args:
        kind: Its type.

    Returns:
        Whether it is, as points and quaternions are.
    """
    return all(f.kind == "float64" and f.count is None for f in fields_of(kind))
