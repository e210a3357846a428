"""Robots and postures that several tests share."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from comwalk.resolution import CartesianMotion, JointMotion, Limb, Task
from comwalk.robot import Kinematics, Robot, Servo, load_robot

# Chains of JVRC-1, by joint names.
_JVRC_LEG = ("HIP_P", "HIP_R", "HIP_Y", "KNEE", "ANKLE_R", "ANKLE_P")
_JVRC_ARM = (
    "SHOULDER_P",
    "SHOULDER_R",
    "SHOULDER_Y",
    "ELBOW_P",
    "ELBOW_Y",
    "WRIST_R",
    "WRIST_Y",
)


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
    """Return JVRC-1, kinematics only: limbs named by hand, no soles, no servos."""
    spec = mujoco.MjSpec.from_string(bare_urdf(jvrc_path()))
    spec.compiler.fusestatic = False
    spec.compiler.balanceinertia = True
    spec.worldbody.first_body().add_freejoint()
    ends = {
        "right_leg": "R_ANKLE_P_S",
        "left_leg": "L_ANKLE_P_S",
        "right_arm": "R_WRIST_Y_S",
        "left_arm": "L_WRIST_Y_S",
        "torso": "WAIST_R_S",
        "head": "NECK_P_S",
    }
    for name, body in ends.items():
        spec.body(body).add_site(name=name, pos=[0.02, 0.01, -0.05])
    model = spec.compile()
    joints = tuple(model.joint(i).name for i in range(1, model.njnt))
    index = {name: j for j, name in enumerate(joints)}

    def chain(*names: str) -> tuple[int, ...]:
        return tuple(index[name] for name in names)

    limbs = [
        Limb(name="left_leg", joints=chain(*(f"L_{j}" for j in _JVRC_LEG))),
        Limb(name="right_leg", joints=chain(*(f"R_{j}" for j in _JVRC_LEG))),
        Limb(name="torso", joints=chain("WAIST_Y", "WAIST_P", "WAIST_R")),
        Limb(
            name="left_arm",
            joints=chain(*(f"L_{j}" for j in _JVRC_ARM)),
            parent="torso",
        ),
        Limb(
            name="right_arm",
            joints=chain(*(f"R_{j}" for j in _JVRC_ARM)),
            parent="torso",
        ),
        Limb(name="head", joints=chain("NECK_Y", "NECK_R", "NECK_P"), parent="torso"),
    ]
    used = {j for limb in limbs for j in limb.joints}
    rest = tuple(j for j in range(len(joints)) if j not in used)
    limbs.append(Limb(name="rest", joints=rest))
    sites = tuple(model.site(limb.name).id for limb in limbs[:-1])
    n = len(joints)
    home = model.qpos0.copy()
    home[2] = 0.8
    for name, angle in (("HIP_P", -0.5), ("KNEE", 1.0), ("ANKLE_P", -0.5)):
        for side in "LR":
            home[7 + index[f"{side}_{name}"]] = angle
    return Robot(
        name="jvrc1",
        spec=spec,
        model=model,
        joints=joints,
        limbs=tuple(limbs),
        ends=(*sites, -1),
        feet={},
        servo=Servo(np.ones(n), np.ones(n), np.zeros(n, dtype=int)),
        lower=np.full(n, -np.inf),
        upper=np.full(n, np.inf),
        speed=np.full(n, np.inf),
        torque=np.full(n, np.inf),
        home=home,
    )


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
