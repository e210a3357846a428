"""Messages as bytes, read back by rosbags, which knows the types by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from comwalk.errors import RunError
from comwalk.runs.ros_messages import (
    TYPES,
    Field,
    definition,
    encode,
    fields_of,
    layout_of,
)

STORE = get_typestore(Stores.ROS2_HUMBLE)
NUMBERS = {
    "int32": st.integers(-(2**31), 2**31 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "float64": st.floats(allow_nan=False),
    "string": st.text(
        st.characters(codec="utf-8", exclude_characters="\0"), max_size=9
    ),
}
KINDS = sorted(TYPES)


def of_field(field: Field) -> st.SearchStrategy[Any]:
    one = of_kind(field.kind) if field.kind in TYPES else NUMBERS[field.kind]
    if field.count is None:
        return one
    size = (field.count, field.count) if field.count else (0, 4)
    return st.lists(one, min_size=size[0], max_size=size[1])


def of_kind(kind: str) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({f.name: of_field(f) for f in fields_of(kind)})


def ros_name(kind: str) -> str:
    return kind.replace("/", "/msg/")


def plain(value: Any) -> Any:
    """Return a message of rosbags, or of ours, as dictionaries and lists."""
    if hasattr(value, "__msgtype__"):
        names = [n for n in vars(value) if n != "__msgtype__"]
        return {n: plain(getattr(value, n)) for n in names}
    if isinstance(value, dict):
        return {n: plain(v) for n, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [plain(v) for v in value] if isinstance(value, list) else value


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_messages_are_read_back_by_a_stranger(kind, data):
    value = data.draw(of_kind(kind))
    message = encode(kind, value)
    assert plain(STORE.deserialize_cdr(message, ros_name(kind))) == value


@pytest.mark.parametrize("kind", KINDS)
def test_definitions_are_those_of_ros(kind):
    """Their digests, which a ROS 2 node compares, are the same."""
    ours = get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(definition(kind), ros_name(kind)))
    name = ros_name(kind)
    assert ours.hash_rihs01(name) == STORE.hash_rihs01(name)


def test_a_layout_puts_numbers_where_a_message_has_them():
    value = {"header": {"frame_id": "odom"}, "name": ["hip", "knee"]}
    value |= {"position": [0.0, 0.0], "effort": [0.0, 0.0]}
    layout = layout_of("sensor_msgs/JointState", value)
    buffer = bytearray(layout.template * 3)
    rows, size = np.frombuffer(buffer, layout.dtype), len(layout.template)
    rows["position"] = np.arange(6.0).reshape(3, 2)
    rows["effort"] = -rows["position"]
    rows["header.stamp.sec"] = 7
    for k in range(3):
        value["position"] = [2.0 * k, 2.0 * k + 1]
        value["effort"] = [-2.0 * k, -2.0 * k - 1]
        value["header"]["stamp"] = {"sec": 7}
        message = encode("sensor_msgs/JointState", value)
        assert buffer[k * size : (k + 1) * size] == message


def test_what_is_left_out_is_zero():
    message = encode("sensor_msgs/Imu", {})
    assert (
        STORE.deserialize_cdr(message, ros_name("sensor_msgs/Imu")).orientation.w == 0.0
    )
    assert len(message) == layout_of("sensor_msgs/Imu", {}).dtype.itemsize


def test_unknown_types_are_refused():
    with pytest.raises(RunError, match="sensor_msgs/Image"):
        encode("sensor_msgs/Image", {})
