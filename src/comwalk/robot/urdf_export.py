"""A robot as URDF, for tools that draw it from `/robot_description` and `/tf`.

It is made of the compiled model, so that links, frames and limits are those of the run,
whatever file the robot came from. Links have boxes, spheres and cylinders for the eye;
where some have none, as in robots of meshes, rods lead from each link to the next ones.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import mujoco
import numpy as np

from .loaders import rotation_of
from .model import Robot

_GEOM, _JOINT = mujoco.mjtGeom, mujoco.mjtJoint
_ROD = 0.02  # radius of a rod that stands for a link [m]
_BOUNDLESS = 1e6  # what URDF says for a limit that is none


def link_names(model: mujoco.MjModel) -> list[str]:
    """Return the names of the links, those without a name counted.

    Args:
        model: A robot's model.

    Returns:
        A name for each body, the world's first.
    """
    return [model.body(i).name or f"body_{i}" for i in range(model.nbody)]


def robot_urdf(robot: Robot) -> str:
    """Return a robot as URDF.

    Args:
        robot: The robot.

    Returns:
        The text; its links are the model's bodies, its root is the base.
    """
    model, names = robot.model, link_names(robot.model)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    mujoco.mj_kinematics(model, data)
    root = ET.Element("robot", name=robot.name)
    bare = (model.body_geomnum[1:] == 0).any()
    for body in range(1, model.nbody):
        link = ET.SubElement(root, "link", name=names[body])
        _add_inertia(link, model, body)
        link.extend(_shapes(model, body))
        if bare:
            link.extend(_rods(model, data, body))
        if body != robot.base_body:
            _add_joints(root, robot, data, body, names)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{x + 0.0:.9g}" for x in np.round(values, 12).tolist())


def _add_origin(parent: ET.Element, position: np.ndarray, R: np.ndarray) -> None:
    """Add the pose of a frame, its angles about the fixed axes x, y, z."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    rpy = _numbers(np.array([roll, pitch, yaw]))
    ET.SubElement(parent, "origin", xyz=_numbers(position), rpy=rpy)


def _axes(data: mujoco.MjData, body: int) -> np.ndarray:
    return data.xmat[body].reshape(3, 3)


def _add_inertia(link: ET.Element, model: mujoco.MjModel, body: int) -> None:
    """Add mass and moments of inertia."""
    inertial = ET.SubElement(link, "inertial")
    R = rotation_of(model.body_iquat[body])
    _add_origin(inertial, model.body_ipos[body], R)
    ET.SubElement(inertial, "mass", value=f"{model.body_mass[body]:.9g}")
    moments = [f"{x:.9g}" for x in model.body_inertia[body].tolist()]
    parts = dict(zip(("ixx", "iyy", "izz"), moments, strict=True))
    ET.SubElement(inertial, "inertia", {**parts, "ixy": "0", "ixz": "0", "iyz": "0"})


def _shapes(model: mujoco.MjModel, body: int) -> Iterator[ET.Element]:
    """Yield what a link looks like, of the geoms that URDF can say."""
    first = model.body_geomadr[body]
    geoms = range(first, first + model.body_geomnum[body])
    shown = [g for g in geoms if model.geom_group[g] < 3]  # others are for contact
    for g in shown or geoms:
        position, R = model.geom_pos[g], rotation_of(model.geom_quat[g])
        x, y, z = model.geom_size[g].tolist()
        kind, color = int(model.geom_type[g]), _numbers(model.geom_rgba[g])
        if kind == _GEOM.mjGEOM_BOX:
            size = _numbers(2 * model.geom_size[g])
            yield _visual("box", {"size": size}, position, R, color)
        elif kind == _GEOM.mjGEOM_SPHERE:
            yield _visual("sphere", {"radius": f"{x:.9g}"}, position, R, color)
        elif kind == _GEOM.mjGEOM_ELLIPSOID:
            size = _numbers(np.array([x, y, z]) * 2 / np.sqrt(3))
            yield _visual("box", {"size": size}, position, R, color)
        elif kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
            yield _cylinder(x, 2 * y, position, R, color)
            for end in (-y, y) if kind == _GEOM.mjGEOM_CAPSULE else ():
                ball = {"radius": f"{x:.9g}"}
                yield _visual("sphere", ball, position + end * R[:, 2], R, color)


def _rods(
    model: mujoco.MjModel, data: mujoco.MjData, body: int
) -> Iterator[ET.Element]:
    """Yield rods from a link to those that it carries, or to its CoM."""
    below = [b for b in range(1, model.nbody) if model.body_parentid[b] == body]
    R = _axes(data, body)
    ends = [(data.xpos[b] - data.xpos[body]) @ R for b in below]
    for end in ends or [model.body_ipos[body]]:
        length = float(np.linalg.norm(end))
        if length > _ROD:
            turn, quaternion = end / length, np.empty(4)
            mujoco.mju_quatZ2Vec(quaternion, turn)
            axes = rotation_of(quaternion)
            yield _cylinder(_ROD, length, end / 2, axes, "0.6 0.65 0.7 1")


def _cylinder(
    radius: float, length: float, position: np.ndarray, R: np.ndarray, color: str
) -> ET.Element:
    size = {"radius": f"{radius:.9g}", "length": f"{length:.9g}"}
    return _visual("cylinder", size, position, R, color)


def _visual(
    kind: str, size: dict[str, str], position: np.ndarray, R: np.ndarray, color: str
) -> ET.Element:
    """Return a shape for the eye."""
    visual = ET.Element("visual")
    _add_origin(visual, position, R)
    ET.SubElement(ET.SubElement(visual, "geometry"), kind, size)
    material = ET.SubElement(visual, "material", name=f"rgba {color}")
    ET.SubElement(material, "color", rgba=color)
    return visual


def _add_joints(
    root: ET.Element, robot: Robot, data: mujoco.MjData, body: int, names: list[str]
) -> None:
    """Add what ties a link to its parent: its joints, with links of nothing between.

    A joint of URDF turns about the origin of its link, one of MuJoCo about a point.
    """
    model, parent = robot.model, robot.model.body_parentid[body]
    above, place, R_above = names[parent], data.xpos[parent], _axes(data, parent)
    R = _axes(data, body)
    first = model.body_jntadr[body]
    joints = range(first, first + model.body_jntnum[body])
    for j in joints:
        fits = (
            j == joints[-1] and np.abs(data.xanchor[j] - data.xpos[body]).max() < 1e-9
        )
        below = names[body] if fits else f"{names[body]}_{model.joint(j).name}"
        joint = _joint(robot, j, data.xaxis[j] @ R)
        anchor = data.xanchor[j]
        _tie(root, joint, above, below, (anchor - place) @ R_above, R_above.T @ R)
        if not fits:
            ET.SubElement(root, "link", name=below)
        above, place, R_above = below, anchor, R
    if above != names[body]:
        joint = ET.Element("joint", name=f"{names[body]}_fixed", type="fixed")
        position = (data.xpos[body] - place) @ R_above
        _tie(root, joint, above, names[body], position, R_above.T @ R)


def _tie(
    root: ET.Element,
    joint: ET.Element,
    above: str,
    below: str,
    position: np.ndarray,
    R: np.ndarray,
) -> None:
    """Put a joint between two links."""
    ET.SubElement(joint, "parent", link=above)
    ET.SubElement(joint, "child", link=below)
    _add_origin(joint, position, R)
    root.append(joint)


def _joint(robot: Robot, j: int, axis: np.ndarray) -> ET.Element:
    """Return a joint with its limits."""
    k, hinge = j - 1, robot.model.jnt_type[j] == _JOINT.mjJNT_HINGE
    bounded = np.isfinite([robot.lower[k], robot.upper[k]]).all()
    kind = ("revolute" if bounded else "continuous") if hinge else "prismatic"
    joint = ET.Element("joint", name=robot.joints[k], type=kind)
    ET.SubElement(joint, "axis", xyz=_numbers(axis))
    limits = {
        "lower": robot.lower[k],
        "upper": robot.upper[k],
        "effort": robot.torque[k],
        "velocity": robot.speed[k],
    }
    text = {
        name: f"{np.clip(value, -_BOUNDLESS, _BOUNDLESS):.9g}"
        for name, value in limits.items()
        if kind != "continuous" or name in ("effort", "velocity")
    }
    ET.SubElement(joint, "limit", text)
    return joint
