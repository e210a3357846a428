"""The peers: pink, mink, placo and TSID, each given the same tasks in its own terms.

Costs are 1 for what is asked for exactly, and 1e-3 for joint rates that are only
wished. Targets are the poses that the wished velocities lead to within a
tick.
"""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from candidates import Candidate, Read, Tick
from problem import DT, Problem, urdf_of

WISHED = 1e-3
"""Cost of joint rates that are only wished."""


def _turned(R: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return a rotation after a tick at an angular velocity [rad/s], world."""
    angle = float(np.linalg.norm(rate)) * DT
    if angle == 0.0:
        return R
    x, y, z = rate * (DT / angle)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K) @ R


def _end_targets(problem: Problem, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rotation and position of each end after a tick."""
    ends = zip(problem.rotations[k], problem.points[k], problem.twists[k], strict=True)
    return [(_turned(R, twist[3:]), p + DT * twist[:3]) for R, p, twist in ends]


def _trunk_target(problem: Problem, k: int) -> np.ndarray:
    """Return the rotation of the trunk after a tick."""
    return _turned(problem.trunk[k], problem.trunk_rate[k])


def _posture_costs(problem: Problem) -> np.ndarray:
    """Return the cost of each joint's rate."""
    costs = np.zeros(len(problem.robot.joints))
    costs[problem.given], costs[problem.wished] = 1.0, WISHED
    return costs


# ---- Pinocchio's conventions ------------------------------------------------------


class _Layout:
    """Where pinocchio has our joints, and its configurations."""

    def __init__(self, problem: Problem, names: list[str]) -> None:
        """Find the joints by their names, the free joint left out."""
        order = [problem.robot.joints.index(name) for name in names]
        self._order, self._back = np.array(order), np.argsort(order)
        self._trunk = problem.trunk
        q, joints = problem.q, problem.q[:, 7:]
        free = q[:, [0, 1, 2, 4, 5, 6, 3]]  # quaternions are xyzw there
        self.q = np.hstack([free, joints[:, self._order]])
        ahead = joints + DT * problem.rates
        self.next_q = np.hstack([free, ahead[:, self._order]])

    def theirs(self, values: np.ndarray) -> np.ndarray:
        """Return what each joint has in pinocchio's order."""
        return values[..., self._order]

    def read(self, k: int, v: np.ndarray) -> np.ndarray:
        """Return a velocity in our form: its base has body axes there."""
        R = self._trunk[k]
        return np.concatenate([R @ v[:3], R @ v[3:6], v[6:][self._back]])


@contextmanager
def _urdf_file(problem: Problem) -> Iterator[str]:
    """Write the robot's URDF; yields its path, and removes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(urdf_of(problem.robot.model), encoding="utf-8")
        yield str(path)


def _pinocchio_model(problem: Problem) -> Any:
    """Return Pinocchio's model of the robot, with a free base."""
    import pinocchio as pin

    with _urdf_file(problem) as path:
        return pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())


# ---- pink ------------------------------------------------------------------------


def pink(solver: str, limited: bool = False) -> Callable:
    """Return what prepares pink with a QP solver."""

    def make(problem: Problem) -> tuple[Tick, Read]:
        import pinocchio as pin
        from pink import Configuration, solve_ik
        from pink.tasks import ComTask, FrameTask, PostureTask

        model = _pinocchio_model(problem)
        layout = _Layout(problem, list(model.names)[2:])
        ends = [FrameTask(f"site{s}", 1.0, 1.0) for s in problem.sites]
        trunk, com = FrameTask("body1", 0.0, 1.0), ComTask(1.0)
        posture = PostureTask(layout.theirs(_posture_costs(problem)))
        tasks = [*ends, trunk, com, posture]
        targets = []
        for k in range(len(problem)):
            poses = [pin.SE3(R, p) for R, p in _end_targets(problem, k)]
            body = pin.SE3(_trunk_target(problem, k), problem.q[k, :3])
            targets.append((poses, body, problem.com[k] + DT * problem.com_velocity[k]))
        configuration = Configuration(model, model.createData(), layout.q[0])
        limits = None if limited else []

        def tick(k: int) -> np.ndarray:
            configuration.update(layout.q[k])
            poses, body, point = targets[k]
            for task, pose in zip(ends, poses, strict=True):
                task.set_target(pose)
            trunk.set_target(body)
            com.set_target(point)
            posture.set_target(layout.next_q[k])
            return solve_ik(
                configuration, tasks, DT, solver, limits=limits, safety_break=False
            )

        return tick, layout.read

    return make


# ---- mink ------------------------------------------------------------------------


def mink(solver: str, limits: str = "none") -> Callable:
    """Return what prepares mink with a QP solver and no, default or kept limits."""

    def make(problem: Problem) -> tuple[Tick, Read]:
        import mink as lib

        model = problem.robot.model
        configuration = lib.Configuration(model)
        ends = [lib.FrameTask(s, "site", 1.0, 1.0) for s in problem.sites]
        trunk = lib.FrameTask(problem.robot.base_body, "body", 0.0, 1.0)
        com, costs = lib.ComTask(1.0), [np.zeros(6), _posture_costs(problem)]
        posture = lib.PostureTask(model, np.concatenate(costs))
        tasks = [*ends, trunk, com, posture]
        targets = _mink_targets(problem)
        ahead = problem.q.copy()
        ahead[:, 7:] += DT * problem.rates
        kept = {"none": [], "default": None, "kept": [lib.ConfigurationLimit(model)]}
        wanted = kept[limits]

        def tick(k: int) -> np.ndarray:
            configuration.update(problem.q[k])
            poses, body, point = targets[k]
            for task, target in zip(ends, poses, strict=True):
                task.set_target(target)
            trunk.set_target(body)
            com.set_target(point)
            posture.set_target(ahead[k])
            return lib.solve_ik(configuration, tasks, DT, solver, limits=wanted)

        def read(k: int, v: np.ndarray) -> np.ndarray:
            return np.concatenate([v[:3], problem.trunk[k] @ v[3:6], v[6:]])

        return tick, read

    return make


def _mink_targets(problem: Problem) -> list[tuple[list[Any], Any, np.ndarray]]:
    """Return where ends, trunk and CoM are to be a tick ahead, for each state."""
    from mink import SE3, SO3

    def pose(R: np.ndarray, p: np.ndarray) -> SE3:
        return SE3.from_rotation_and_translation(SO3.from_matrix(R), p)

    return [
        (
            [pose(R, p) for R, p in _end_targets(problem, k)],
            pose(_trunk_target(problem, k), problem.q[k, :3]),
            problem.com[k] + DT * problem.com_velocity[k],
        )
        for k in range(len(problem))
    ]


# ---- placo -----------------------------------------------------------------------


def placo(limited: bool = False) -> Callable:
    """Return what prepares placo's kinematics solver, in C++."""

    def make(problem: Problem) -> tuple[Tick, Read]:
        import placo

        with _urdf_file(problem) as path:
            robot = placo.RobotWrapper(path, placo.Flags.ignore_collisions)
        layout = _Layout(problem, list(robot.joint_names()))
        solver = placo.KinematicsSolver(robot)
        solver.dt = DT
        solver.enable_joint_limits(limited)
        solver.enable_velocity_limits(limited)
        robot.state.q = layout.q[0]
        robot.update_kinematics()
        com = solver.add_com_task(problem.com[0])
        com.configure("com", "soft", 1.0)
        trunk = solver.add_orientation_task("body1", np.eye(3))
        trunk.configure("trunk", "soft", 1.0)
        ends = [solver.add_frame_task(f"site{s}", np.eye(4)) for s in problem.sites]
        for end in ends:
            end.configure("end", "soft", 1.0, 1.0)
        weights, targets = _postures(problem).values(), _placo_targets(problem)
        postures = [solver.add_joints_task() for _ in weights]
        for posture, weight in zip(postures, weights, strict=True):
            posture.configure("posture", "soft", weight)

        def tick(k: int) -> np.ndarray:
            robot.state.q = layout.q[k]
            robot.update_kinematics()
            poses, body, point, wishes = targets[k]
            for task, pose in zip(ends, poses, strict=True):
                task.T_world_frame = pose
            trunk.R_world_frame = body
            com.target_world = point
            for task, wish in zip(postures, wishes, strict=True):
                task.set_joints(wish)
            return solver.solve(False)

        return tick, lambda k, step: layout.read(k, step / DT)

    return make


def _postures(problem: Problem) -> dict[str, float]:
    """Return the weights of the groups of joints whose rates are asked for."""
    weights = {"given": 1.0, "wished": WISHED**2}
    return {name: w for name, w in weights.items() if len(getattr(problem, name))}


def _placo_targets(problem: Problem) -> list[tuple[Any, ...]]:
    """Return where ends, trunk, CoM and joints are to be a tick ahead, by state."""
    names, targets = problem.robot.joints, []
    for k in range(len(problem)):
        poses = [np.eye(4) for _ in problem.sites]
        for pose, (R, p) in zip(poses, _end_targets(problem, k), strict=True):
            pose[:3, :3], pose[:3, 3] = R, p
        angles = problem.q[k, 7:] + DT * problem.rates[k]
        wishes = [
            {names[j]: float(angles[j]) for j in getattr(problem, group)}
            for group in _postures(problem)
        ]
        point = problem.com[k] + DT * problem.com_velocity[k]
        targets.append((poses, _trunk_target(problem, k), point, wishes))
    return targets


# ---- TSID ------------------------------------------------------------------------


def tsid(problem: Problem) -> tuple[Tick, Read]:
    """Prepare TSID: accelerations and contact forces from rest.

    It is asked for accelerations as large, per second, as the velocities that the
    others are asked for; it finds the ground's forces too, within friction cones.
    """

    lib = _tsid()
    model = _pinocchio_model(problem)
    layout = _Layout(problem, list(model.names)[2:])
    robot = lib.RobotWrapper(model, lib.FLOATING_BASE_SYSTEM, False)
    formulation = lib.InverseDynamicsFormulationAccForce("tsid", robot, False)
    rest = np.zeros(model.nv)
    formulation.computeProblemData(0.0, layout.q[0], rest)
    data = formulation.data()
    contact = _contact(lib, robot, f"site{problem.sites[0]}")
    contact.setReference(robot.framePosition(data, model.getFrameId(contact.name)))
    formulation.addRigidContact(contact, 1e-8, 1.0, 0)
    frames = [(f"site{s}", np.ones(6)) for s in problem.sites[1:]]
    frames.append(("body1", np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])))
    bodies = [_frame_task(lib, robot, formulation, *frame) for frame in frames]
    com = _without_feedback(lib.TaskComEquality("com", robot), 3)
    formulation.addMotionTask(com, 1.0, 1, 0.0)
    postures = [
        _posture_task(lib, robot, formulation, layout.theirs(mask), weight)
        for mask, weight in _masks(problem)
    ]
    solver = lib.SolverHQuadProgFast("qp")
    solver.resize(formulation.nVar, formulation.nEq, formulation.nIn)
    samples = _tsid_samples(lib, problem, layout.theirs(problem.rates))

    def tick(k: int) -> np.ndarray:
        ends, point, wish = samples[k]
        for task, sample in zip(bodies, ends, strict=True):
            task.setReference(sample)
        com.setReference(point)
        for task in postures:
            task.setReference(wish)
        problem_data = formulation.computeProblemData(0.0, layout.q[k], rest)
        return formulation.getAccelerations(solver.solve(problem_data))

    tick.kept = (contact, solver, robot, model)  # it holds raw references to them
    return tick, layout.read


def _without_feedback(task: Any, size: int) -> Any:
    task.setKp(np.zeros(size))
    task.setKd(np.zeros(size))
    return task


def _tsid_samples(
    lib: Any, problem: Problem, rates: np.ndarray
) -> list[tuple[list[Any], Any, Any]]:
    """Return the accelerations of ends, CoM and joints to ask for, by state."""
    count = rates.shape[1]
    return [
        (
            [_sample(lib, 12, 6, a) for a in _twists(problem, k)],
            _sample(lib, 3, 3, problem.com_velocity[k]),
            _sample(lib, count, count, rates[k]),
        )
        for k in range(len(problem))
    ]


def _masks(problem: Problem) -> list[tuple[np.ndarray, float]]:
    """Return which joints are in a posture task, as zeros and ones, and its weight."""
    masks = []
    for group, weight in _postures(problem).items():
        mask = np.zeros(len(problem.robot.joints))
        mask[getattr(problem, group)] = 1.0
        masks.append((mask, weight))
    return masks


def _posture_task(
    lib: Any, robot: Any, formulation: Any, mask: np.ndarray, weight: float
) -> Any:
    """Add a task of joint accelerations without feedback."""
    task = lib.TaskJointPosture(f"posture {weight:g}", robot)
    _without_feedback(task, robot.na).setMask(mask)
    formulation.addMotionTask(task, weight, 1, 0.0)
    return task


def _tsid() -> Any:
    """Return the module, whose wheel may lack its __init__."""
    import eigenpy  # noqa: F401  before it, or its types are unknown

    package = importlib.import_module("tsid")
    if hasattr(package, "RobotWrapper"):
        return package
    return importlib.import_module("tsid.tsid_pywrap")


def _twists(problem: Problem, k: int) -> list[np.ndarray]:
    """Return the twists of all ends but the base's, and the trunk's."""
    trunk = np.concatenate([np.zeros(3), problem.trunk_rate[k]])
    return [*problem.twists[k, 1:], trunk]


def _sample(lib: Any, size: int, rates: int, acceleration: np.ndarray) -> Any:
    """Return an acceleration as a reference."""
    sample = lib.TrajectorySample(size, rates)
    zeros = np.zeros(size)
    if size == 12:
        zeros[[3, 7, 11]] = 1.0
    sample.value(zeros)
    sample.derivative(np.zeros(rates))
    sample.second_derivative(acceleration)
    return sample


def _contact(lib: Any, robot: Any, frame: str) -> Any:
    """Return a contact with the ground, so wide that its edges are no limit."""
    x, y = 2.0, 2.0
    corners = np.array([[-x, -x, x, x], [-y, y, -y, y], [0.0] * 4])
    up = np.array([0.0, 0.0, 1.0])
    contact = lib.Contact6d(frame, robot, frame, corners, up, 0.7, 1.0, 1e4)
    contact.setKp(np.zeros(6))
    contact.setKd(np.zeros(6))
    return contact


def _frame_task(
    lib: Any, robot: Any, formulation: Any, frame: str, mask: np.ndarray
) -> Any:
    """Add the task of a frame."""
    task = lib.TaskSE3Equality(frame, robot, frame)
    task.setKp(np.zeros(6))
    task.setKd(np.zeros(6))
    task.setMask(mask)
    task.useLocalFrame(False)
    formulation.addMotionTask(task, 1.0, 1, 0.0)
    return task


PIN, MINK = ("pinocchio", "pink", "qpsolvers"), ("mink", "qpsolvers")
PEERS = (
    Candidate("pink, daqp", pink("daqp"), (*PIN, "daqp"), 1e-3),
    Candidate("pink, quadprog", pink("quadprog"), (*PIN, "quadprog"), 1e-3),
    Candidate("pink, daqp, limits", pink("daqp", True), (*PIN, "daqp")),
    Candidate("mink, daqp", mink("daqp"), (*MINK, "daqp"), 1e-3),
    Candidate("mink, quadprog", mink("quadprog"), (*MINK, "quadprog"), 1e-3),
    Candidate("mink, daqp, default limits", mink("daqp", "default"), (*MINK, "daqp")),
    Candidate("mink, daqp, limits kept", mink("daqp", "kept"), (*MINK, "daqp")),
    Candidate("placo (C++)", placo(), ("placo",), 5e-3),
    Candidate("placo (C++), limits", placo(True), ("placo",)),
    Candidate("TSID (C++), with forces", tsid, ("pinocchio", "tsid"), 5e-3),
)
