"""Robots and postures that several tests share."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from models import write

from comwalk.embedding.task import CartesianMotion, JointMotion, Task
from comwalk.errors import ModelError
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import Robot, load_robot


def toy_scene(
    folder: Path,
    around: str,
    base: str = 'pos="0 0 0.9"',
    more: str = "",
    change: Callable[[str], str] = lambda text: text,
    **options: Any,
) -> Path:
    """Write a humanoid as MJCF with things around it, and return the file.

    Args:
        folder: Where.
        around: Elements of the world, before the robot.
        base: Where the robot stands.
        more: Elements beside the world, such as keyframes.
        change: Changes the robot's own text.
        options: How it is built, `models.Build`.
    """
    text = change(read_model(write(folder, **options)).spec.to_xml())
    text = text.replace('<body name="base">', f'{around}<body name="base" {base}>')
    file = folder / "scene.xml"
    file.write_text(text.replace("</mujoco>", f"{more}</mujoco>"), encoding="utf-8")
    return file


@cache
def paper() -> Robot:
    """Return the robot that comes with comwalk."""
    return load_robot("paper")


def bare_urdf(path: Path) -> str:
    """Return a URDF without meshes, nor mimic tags, on which engines differ."""
    tree = ET.parse(path)
    for link in tree.getroot().iter("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for joint in tree.getroot().iter("joint"):
        for element in joint.findall("mimic"):
            joint.remove(element)
    return ET.tostring(tree.getroot(), encoding="unicode")


def jvrc_path() -> Path:
    """Return the file of JVRC-1."""
    import jvrc_description

    return Path(jvrc_description.__file__).parent / "urdf" / "jvrc1.urdf"


@cache
def jvrc() -> Robot:
    """Return JVRC-1, its fingers locked, on position servos."""
    return load_robot("jvrc1", actuation="position")


def random_configuration(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a configuration near home, with any pose of the base and bent elbows."""
    q = robot.home.copy()
    q[:3] = rng.normal(size=3)
    quaternion = rng.normal(size=4)
    q[3:7] = quaternion / np.linalg.norm(quaternion)
    q[7:] += rng.uniform(-0.2, 0.2, size=len(q) - 7)
    for j, name in enumerate(robot.joints):
        if "elbow_p" in name.lower():
            q[7 + j] = rng.uniform(-1.6, -0.8)
    return q


def random_task(
    robot: Robot,
    rng: np.random.Generator,
    *,
    base: str = "left_leg",
    base_twist: np.ndarray | None = None,
    cartesian: tuple[str, ...] = (),
    rows: dict[str, tuple[int, ...]] | None = None,
) -> Task:
    """Return a task with random wishes; both legs are Cartesian, others if named."""
    motions: dict[str, CartesianMotion | JointMotion] = {}
    for limb in robot.limbs:
        n = len(limb.joints)
        if limb.name == base:
            continue
        if limb.name.endswith("leg") or limb.name in cartesian:
            motions[limb.name] = CartesianMotion(
                0.3 * rng.normal(size=6),
                rows=(rows or {}).get(limb.name, (0, 1, 2, 3, 4, 5)),
                posture_rates=rng.normal(size=n) if n > 6 else None,
            )
        else:
            motions[limb.name] = JointMotion(rng.normal(size=n))
    return Task(
        com_velocity=0.3 * rng.normal(size=3),
        base=base,
        base_twist=np.zeros(6) if base_twist is None else base_twist,
        trunk_rate=0.3 * rng.normal(size=3),
        motions=motions,
    )


def posture_of(robot: Robot, q: np.ndarray):
    """Return the posture at a configuration."""
    return Kinematics(robot).posture(q)


def robot_of(name: str, stiffness: float = 1.0, actuation: str = "position") -> Robot:
    """Return a robot by name; skip where its package is not installed."""
    usual = stiffness == 1.0 and actuation == "position"
    known = {"paper": paper, "jvrc1": jvrc} if usual else {}
    try:
        if name in known:
            return known[name]()
        return load_robot(name, stiffness=stiffness, actuation=actuation)
    except ModelError as error:
        pytest.skip(str(error))
