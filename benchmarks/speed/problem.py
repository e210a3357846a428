"""The task that all candidates solve, and the robots as each of them reads them.

One tick asks for the velocity of the CoM, the rate of the trunk, the twist of both feet
(the left one is the base and rests), and either

* `hands`: the twists of both hands too, with posture rates in the arms' null space, or
* `arms`: all joint rates of both arms (the paper's dances);

waist, neck and fingers follow given joint rates in both. A candidate that tracks poses
is given the poses that the wished velocities lead to within `DT`.
"""

from __future__ import annotations

import dataclasses
import pickle
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from comwalk.embedding import CartesianMotion, JointMotion, Resolver, Task, sigma_min
from comwalk.robot import LEGS, Kinematics, Robot, load_robot
from comwalk.sides import Side

ROBOTS = ("jvrc1", "talos", "g1")
TASKS = ("hands", "arms")
STATES = 256
DT = 0.002
"""Time between two ticks [s]."""

_FEET = tuple(LEGS[side] for side in Side)
_ARMS = tuple(f"{side}_arm" for side in Side)


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A robot, n states, and what is asked in each."""

    robot: Robot
    task: str
    ends: tuple[str, ...]
    """Limbs whose end's twist is given; the feet come first."""
    q: np.ndarray
    """Configurations, MuJoCo's, (n, 7 + joints)."""
    com_velocity: np.ndarray
    """(n, 3) [m/s]."""
    trunk_rate: np.ndarray
    """(n, 3) [rad/s]."""
    twists: np.ndarray
    """Of the limbs in `ends`, (n, ends, 6) [m/s; rad/s]."""
    rates: np.ndarray
    """Joint rates, (n, joints) [rad/s]: given, or wished in the null space."""
    com: np.ndarray
    """(n, 3) [m]."""
    trunk: np.ndarray
    """Rotation of the body center, (n, 3, 3)."""
    points: np.ndarray
    """Of the ends, (n, ends, 3) [m]."""
    rotations: np.ndarray
    """Of the ends, (n, ends, 3, 3)."""

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.q)

    @property
    def given(self) -> np.ndarray:
        """Joints whose rates are given, as indices into the robot's joints."""
        limbs = [x for x in self.robot.limbs if x.name not in self.ends]
        return np.array([j for x in limbs for j in x.joints], dtype=int)

    @property
    def wished(self) -> np.ndarray:
        """Joints whose rates are only wished, as indices into the robot's joints."""
        limbs = [x for x in self.robot.limbs if x.name in self.ends[len(_FEET) :]]
        return np.array([j for x in limbs for j in x.joints], dtype=int)

    @property
    def sites(self) -> list[int]:
        """MuJoCo's sites of the ends."""
        index = {limb.name: k for k, limb in enumerate(self.robot.limbs)}
        return [self.robot.ends[index[name]] for name in self.ends]

    def task_at(self, k: int) -> Task:
        """Return the task of a state for the reference implementation."""
        return _task(self.robot, self.ends, *self.wishes(k))

    def wishes(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return CoM velocity, trunk rate, twists and joint rates of a state."""
        return self.com_velocity[k], self.trunk_rate[k], self.twists[k], self.rates[k]

    def residual(self, velocities: np.ndarray) -> tuple[float, float]:
        """Return what velocities leave undone.

        Args:
            velocities: v = [xdot_o; qdot] of each state, world axes, (n, 6 + joints).

        Returns:
            The largest error of CoM, trunk, feet, hands and given joints, and the
            largest error among the joints that are only wished [m/s, rad/s].
        """
        kinematics, worst = Kinematics(self.robot), 0.0
        index = {limb.name: k for k, limb in enumerate(self.robot.limbs)}
        given, wished = self.given, self.wished
        for k, v in enumerate(velocities):
            posture = kinematics.posture(self.q[k])
            errors = [posture.com_jacobian @ v - self.com_velocity[k]]
            errors += [v[3:6] - self.trunk_rate[k]]
            for name, twist in zip(self.ends, self.twists[k], strict=True):
                errors.append(posture.end_jacobian(index[name]) @ v - twist)
            errors.append(v[6 + given] - self.rates[k][given])
            worst = max(worst, max(float(np.abs(e).max(initial=0.0)) for e in errors))
        misses = np.abs(velocities[:, 6 + wished] - self.rates[:, wished])
        return worst, float(misses.max(initial=0.0))


def make_problem(name: str, task: str, states: int = STATES) -> Problem:
    """Return smooth motion around a robot's walking posture, on the left foot."""
    robot = load_robot(name)
    if robot.coupling is not None:
        raise SystemExit(f"{name}: joints that follow others are not compared")
    arms = tuple(x.name for x in robot.limbs if x.name in _ARMS)
    ends = _FEET + (arms if task == "hands" else ())
    kinematics, resolver = Kinematics(robot), Resolver(robot.limbs)
    index = {limb.name: k for k, limb in enumerate(robot.limbs)}
    at = [index[name] for name in ends]
    q, rows = _away_from_singular(robot, kinematics, arms), []
    for k in range(states):
        wishes = _wishes(robot, ends, k * DT)
        posture = kinematics.posture(q)
        places = posture.com, posture.rotation, posture.ends[at]
        rows.append((q, *wishes, *places, posture.end_rotations[at]))
        found = resolver.resolve(posture, _task(robot, ends, *wishes))
        q = kinematics.integrate(q, found.velocity, DT)
    names = ("q", "com_velocity", "trunk_rate", "twists", "rates", "com", "trunk")
    names = (*names, "points", "rotations")
    columns = (np.array(column) for column in zip(*rows, strict=True))
    arrays = dict(zip(names, columns, strict=True))
    return Problem(robot=robot, task=task, ends=ends, **arrays)


def _away_from_singular(
    robot: Robot, kinematics: Kinematics, arms: tuple[str, ...]
) -> np.ndarray:
    """Return the walking posture with the best bent of some random arms."""
    rng, best = np.random.default_rng(3), robot.home.copy()
    for i, limb in enumerate(robot.limbs):
        if limb.name not in arms:
            continue
        joints, most = list(limb.joints), 0.0
        low, high = robot.lower[joints], robot.upper[joints]
        for _ in range(500):
            q = best.copy()
            share = rng.uniform(0.2, 0.8, len(joints))
            q[[7 + j for j in joints]] = low + (high - low) * share
            J = kinematics.posture(q).end_jacobian(i)[:, limb.columns]
            sigma = sigma_min(J)
            if sigma > most:
                best, most = q, sigma
    return best


def _wishes(
    robot: Robot, ends: tuple[str, ...], t: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return slow and smooth wishes at a time: all are rates of sines."""
    phase = 2.0 * np.pi * t
    com = np.array([0.12, 0.15, 0.05]) * np.cos(phase * np.array([1.0, 0.7, 1.3]))
    trunk = np.array([0.1, 0.15, 0.2]) * np.cos(phase * np.array([0.9, 1.1, 0.6]))
    twists = np.zeros((len(ends), 6))
    for i in range(1, len(ends)):
        waves = np.cos(phase * (0.6 + 0.1 * i + 0.07 * np.arange(6)))
        twists[i] = np.array([0.2, 0.1, 0.15, 0.2, 0.2, 0.3]) * waves
    n = len(robot.joints)
    rates = 0.4 * np.cos(phase * (0.5 + 0.9 * np.arange(n) / n))
    return com, trunk, twists, rates


def _task(
    robot: Robot,
    ends: tuple[str, ...],
    com: np.ndarray,
    trunk: np.ndarray,
    twists: np.ndarray,
    rates: np.ndarray,
) -> Task:
    """Return a task for the reference implementation."""
    motions = {}
    for limb in robot.limbs:
        own = rates[list(limb.joints)]
        if limb.name not in ends:
            motions[limb.name] = JointMotion(own)
        elif limb.name != ends[0]:
            wished = None if limb.name in _FEET else own
            twist = twists[ends.index(limb.name)]
            motions[limb.name] = CartesianMotion(twist, posture_rates=wished)
    return Task(com, ends[0], twists[0], trunk, motions)


def save_problem(problem: Problem, path: Path) -> None:
    """Write a problem for interpreters that have not the robot's files."""
    bare = dataclasses.replace(problem.robot, spec=None)  # it cannot be pickled
    path.write_bytes(pickle.dumps(dataclasses.replace(problem, robot=bare)))


def load_problem(path: Path) -> Problem:
    """Read a problem of `save_problem`."""
    return pickle.loads(path.read_bytes())


# ---- The robot as a URDF, for those that read no MJCF -----------------------------


def urdf_of(model: mujoco.MjModel) -> str:
    """Return the same bodies, joints and sites as a URDF; the root is the free body.

    Each link's frame is at its joint, as a URDF wants it; sites become links that are
    fixed to their body.
    """
    root = ET.Element("robot", name="robot")
    anchors = np.zeros((model.nbody, 3))
    for b in range(1, model.nbody):
        first, count = model.body_jntadr[b], model.body_jntnum[b]
        if b > 1 and count:
            anchors[b] = model.jnt_pos[first]
        _add_link(root, model, b, anchors[b])
        if b == 1:
            continue
        p = model.body_parentid[b]
        R = _matrix(model.body_quat[b])
        place = model.body_pos[b] + R @ anchors[b] - anchors[p]
        joint = _add_joint(root, model, b, f"body{p}", f"body{b}", place, R)
        if count:
            axis = " ".join(map(repr, model.jnt_axis[first].tolist()))
            ET.SubElement(joint, "axis", xyz=axis)
            low, high = model.jnt_range[first].tolist()
            if not model.jnt_limited[first]:
                low, high = -1e3, 1e3
            limit = {"lower": repr(low), "upper": repr(high)}
            ET.SubElement(joint, "limit", effort="1e4", velocity="1e3", **limit)
    for s in range(model.nsite):
        b = int(model.site_bodyid[s])
        ET.SubElement(root, "link", name=f"site{s}")
        joint = ET.SubElement(root, "joint", name=f"to_site{s}", type="fixed")
        ET.SubElement(joint, "parent", link=f"body{b}")
        ET.SubElement(joint, "child", link=f"site{s}")
        place = model.site_pos[s] - anchors[b]
        joint.append(_origin(place, _matrix(model.site_quat[s])))
    return ET.tostring(root, encoding="unicode")


def _add_link(
    root: ET.Element, model: mujoco.MjModel, b: int, anchor: np.ndarray
) -> None:
    """Append a body and its inertia."""
    link = ET.SubElement(root, "link", name=f"body{b}")
    inertial = ET.SubElement(link, "inertial")
    inertial.append(_origin(model.body_ipos[b] - anchor, _matrix(model.body_iquat[b])))
    ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[b])))
    x, y, z = (repr(v) for v in model.body_inertia[b].tolist())
    none = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    ET.SubElement(inertial, "inertia", ixx=x, iyy=y, izz=z, **none)


def _add_joint(
    root: ET.Element,
    model: mujoco.MjModel,
    b: int,
    parent: str,
    child: str,
    place: np.ndarray,
    R: np.ndarray,
) -> ET.Element:
    """Append the joint that a body hangs on."""
    kind, name = "fixed", f"to_body{b}"
    if model.body_jntnum[b]:
        j = model.body_jntadr[b]
        hinge = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        kind, name = "revolute" if hinge else "prismatic", model.joint(j).name
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    joint.append(_origin(place, R))
    return joint


def _origin(place: np.ndarray, R: np.ndarray) -> ET.Element:
    """Return a pose as a URDF writes it."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    if np.hypot(R[2, 1], R[2, 2]) < 1e-9:  # gimbal lock: all of it is yaw
        roll, yaw = 0.0, np.arctan2(-R[0, 1], R[1, 1])
    xyz = " ".join(repr(float(v)) for v in place)
    rpy = " ".join(repr(float(v)) for v in (roll, pitch, yaw))
    return ET.Element("origin", xyz=xyz, rpy=rpy)


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion wxyz."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return R.reshape(3, 3)
