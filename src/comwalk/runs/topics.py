"""ROS 2 topics of a run, and how its columns become messages.

Frames follow REP-105 and REP-120: points in `odom`, wrenches in `l_sole` and `r_sole`,
links under their own names. Quaternions are xyzw here, and wxyz everywhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import mujoco
import numpy as np

from ..robot import Kinematics, Robot, link_names, robot_urdf
from ..sides import Side
from .ros_messages import Layout, encode, layout_of

Columns: TypeAlias = Mapping[str, np.ndarray]
"""Columns of a run by name, each of shape (rows, ...)."""

WORLD = "odom"
"""The frame that the robot walks in: x and y from where the plan starts, z up."""


@dataclass(frozen=True, eq=False)
class Stream:
    """A topic with a message at each row, or at some."""

    topic: str
    """Its name."""
    layout: Layout
    """What its messages look like."""
    values: Callable[[Columns], Mapping[str, np.ndarray]]
    """From n rows to arrays by the name of a field of the layout, n values each."""
    slow: bool = False
    """Whether there is a message at some rows only: link poses are many numbers."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """What fields are called in tables, if not by their own name."""
    letters: Sequence[str] = "xyzw"
    """What the numbers of a field are called."""

    def names(self, name: str) -> list[str]:
        """Return the names of a field's numbers in tables.

        Args:
            name: The field.

        Returns:
            A name for each number, such as "point.x".
        """
        label, count = self.labels.get(name, name), self.layout.dtype[name].shape[0]
        return [f"{label}.{letter}" for letter in self.letters[:count]]


@dataclass(frozen=True, eq=False)
class Latched:
    """A topic with one message, at the start."""

    topic: str
    """Its name."""
    kind: str
    """Type of the message."""
    message: bytes
    """The message."""


def streams_of(robot: Robot | None, columns: Collection[str]) -> tuple[Stream, ...]:
    """Return the topics that a run has numbers for.

    Args:
        robot: The robot; None for the simplified model, which has points alone.
        columns: Names of the run's columns.

    Returns:
        The topics, slow ones first.
    """
    points = [_points(topic, column) for topic, column in _POINTS.items()]
    if robot is None:
        return tuple(points)
    return (
        *([_transforms(robot)] if "qpos" in columns else []),
        _joint_states(robot, "torques_true" if "torques_true" in columns else None),
        _joint_commands(robot),
        *points,
        *(_wrench(robot, side) for side in Side),
        _imu(),
    )


_POINTS = {
    "/com": "com",
    "/com_ref": "com_ref",
    "/zmp": "zmp",
    "/zmp_ref": "zmp_ref",
}


def latched_of(robot: Robot | None) -> tuple[Latched, ...]:
    """Return the topics that are said once.

    Args:
        robot: The robot; None for the simplified model, which has none.

    Returns:
        Its description, and the frames that are fixed to its links.
    """
    if robot is None:
        return ()
    text = encode("std_msgs/String", {"data": robot_urdf(robot)})
    frames = encode("tf2_msgs/TFMessage", {"transforms": _fixed_frames(robot)})
    return (
        Latched("/robot_description", "std_msgs/String", text),
        Latched("/tf_static", "tf2_msgs/TFMessage", frames),
    )


def _header(frame: str) -> dict[str, Any]:
    return {"frame_id": frame}


def _points(topic: str, column: str) -> Stream:
    """Return a point in the world; one of two numbers is on the ground."""
    layout = layout_of("geometry_msgs/PointStamped", {"header": _header(WORLD)})

    def values(rows: Columns) -> dict[str, np.ndarray]:
        """Return the fields of the messages of some rows."""
        points = np.zeros((len(rows[column]), 3))
        points[:, : rows[column].shape[1]] = rows[column]
        return {"point": points}

    return Stream(topic, layout, values)


def _joint_states(robot: Robot, torques: str | None) -> Stream:
    """Return the joint states: encoders and servo torques."""
    zero, columns = np.zeros(len(robot.joints)), {"position": "joints"}
    columns |= {"velocity": "joint_rates"} | ({"effort": torques} if torques else {})
    example = {"name": robot.joints, **dict.fromkeys(columns, zero)}
    return Stream(
        "/joint_states",
        layout_of("sensor_msgs/JointState", example),
        lambda rows: {field: rows[column] for field, column in columns.items()},
        letters=robot.joints,
    )


def _joint_commands(robot: Robot) -> Stream:
    """Return the set-points of the servos."""
    example = {"name": robot.joints, "position": np.zeros(len(robot.joints))}
    return Stream(
        "/joint_commands",
        layout_of("sensor_msgs/JointState", example),
        lambda rows: {"position": rows["joint_set_points"]},
        letters=robot.joints,
    )


def _wrench(robot: Robot, side: Side) -> Stream:
    """Return an ankle wrench about the origin of the sole's frame."""
    letter, k = side.value[0], list(Side).index(side)
    frame = f"{letter}_sole"
    kinematics = Kinematics(robot)
    kinematics.update(robot.home)
    sites = np.array([robot.model.site(frame).id, robot.feet[side].sensor_site])
    (sole, sensor), (R_sole, R_sensor) = kinematics.sites(sites)
    arm, R = (sensor - sole) @ R_sole, R_sole.T @ R_sensor

    def values(rows: Columns) -> dict[str, np.ndarray]:
        """Return the fields of the messages of some rows."""
        felt = rows["wrenches"][:, k]
        force, torque = felt[:, :3] @ R.T, felt[:, 3:] @ R.T
        return {"wrench.force": force, "wrench.torque": torque + np.cross(arm, force)}

    layout = layout_of("geometry_msgs/WrenchStamped", {"header": _header(frame)})
    return Stream(f"/{frame}/wrench", layout, values)


def _imu() -> Stream:
    """Return the readings of the trunk's IMU, in its own frame."""
    return Stream(
        "/imu",
        layout_of("sensor_msgs/Imu", {"header": _header("imu")}),
        lambda rows: {
            "orientation": _xyzw(rows["imu_quat"]),
            "angular_velocity": rows["imu_gyro"],
            "linear_acceleration": rows["imu_acc"],
        },
    )


# ---- Frames -----------------------------------------------------------------------


def _transforms(robot: Robot) -> Stream:
    """Return the pose of each link in its parent, of the base in the world."""
    model, data = robot.model, mujoco.MjData(robot.model)
    names, bodies = [WORLD, *link_names(model)[1:]], np.arange(1, model.nbody)
    parents = model.body_parentid[bodies]
    pairs = [(names[p], names[b]) for p, b in zip(parents, bodies, strict=True)]
    example = {"transforms": [_transform(*pair) for pair in pairs]}

    def values(rows: Columns) -> dict[str, np.ndarray]:
        """Return the fields of the messages of some rows."""
        n = len(rows["qpos"])
        points, turns = np.empty((n, model.nbody, 3)), np.empty((n, model.nbody, 4))
        for k, configuration in enumerate(rows["qpos"]):
            data.qpos[:] = configuration[: model.nq]
            mujoco.mj_kinematics(model, data)
            points[k], turns[k] = data.xpos, data.xquat
        seen = _seen_from(
            points[:, parents], turns[:, parents], points[:, 1:], turns[:, 1:]
        )
        found = {}
        for i in range(len(bodies)):
            found[f"transforms.{i}.transform.translation"] = seen[0][:, i]
            found[f"transforms.{i}.transform.rotation"] = _xyzw(seen[1][:, i])
        return found

    labels = {
        f"transforms.{i}.transform.{part}": f"{child}.{part}"
        for i, (_, child) in enumerate(pairs)
        for part in ("translation", "rotation")
    }
    layout = layout_of("tf2_msgs/TFMessage", example)
    return Stream("/tf", layout, values, slow=True, labels=labels)


def _fixed_frames(robot: Robot) -> list[dict[str, Any]]:
    """Return the marked frames of the links, but those that have a link's name."""
    model, names = robot.model, link_names(robot.model)
    transforms = []
    for i in range(model.nsite):
        frame, link = model.site(i).name, names[model.site_bodyid[i]]
        if frame and frame not in names:
            pose = (model.site_pos[i], _xyzw(model.site_quat[i]))
            transforms.append(_transform(link, frame, *pose))
    return transforms


def _transform(
    parent: str,
    child: str,
    translation: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
) -> dict[str, Any]:
    """Return a transform; without a pose, it is that of the parent."""
    p = np.zeros(3) if translation is None else translation
    q = np.array([0.0, 0.0, 0.0, 1.0]) if rotation is None else rotation
    return {
        "header": _header(parent),
        "child_frame_id": child,
        "transform": {
            "translation": dict(zip("xyz", p.tolist(), strict=True)),
            "rotation": dict(zip("xyzw", q.tolist(), strict=True)),
        },
    }


def _xyzw(quaternions: np.ndarray) -> np.ndarray:
    return quaternions[..., [1, 2, 3, 0]]


def _seen_from(
    p: np.ndarray, q: np.ndarray, point: np.ndarray, turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and quaternions wxyz as seen from poses (p, q)."""
    w, v = q[..., :1], -q[..., 1:]  # of the inverse
    arm, u, x = point - p, turn[..., 1:], turn[..., :1]
    twice = 2.0 * np.cross(v, arm)
    position = arm + w * twice + np.cross(v, twice)
    real = w * x - np.sum(v * u, axis=-1, keepdims=True)
    rest = w * u + x * v + np.cross(v, u)
    return position, np.concatenate([real, rest], axis=-1)
