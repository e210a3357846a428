"""The scene in MuJoCo that a robot walks in: floor, light, rough ground, payload.

What the robot's file holds around it comes last, so that the robot's joints, actuators
and sensors have the places that they have in the robot alone.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from ..control import SimulatorSettings
from ..errors import ModelError, ParameterError
from ..pattern import FootstepPlan
from ..robot import Robot, World
from ..sides import Side
from .terrain import CELL, Terrain, random_terrain

FLOOR = "comwalk_floor"
"""Name of the floor, where there is no other ground."""
BEGIN = "comwalk_begin"
"""Name of the keyframe in which what is around a robot begins, if something is."""
# By default MuJoCo's dry friction creeps: a servo's error would be gone in 0.3 s.
_STICKING = (0.004, 1.0), (0.99, 0.999, 0.001, 0.5, 2.0)  # solref, solimp


def sensor_at(model: mujoco.MjModel, name: str) -> slice:
    """Return the place of a named sensor's reading in sensordata."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, name)
    if index < 0:
        raise ModelError(
            f'the model has no sensor "{name}"; walking needs imu_quat, imu_gyro, '
            "imu_acc and force and torque sensors named l_force, l_torque, r_force, "
            "r_torque at the ankles"
        )
    start = int(model.sensor_adr[index])
    return slice(start, start + int(model.sensor_dim[index]))


def imu_readings(model: mujoco.MjModel) -> list[slice]:
    """Return where quaternion, gyro and accelerometer of the IMU stand in sensordata.

    Args:
        model: A compiled robot.

    Raises:
        ModelError: If there is no IMU.
    """
    return [sensor_at(model, name) for name in ("imu_quat", "imu_gyro", "imu_acc")]


def ankle_readings(model: mujoco.MjModel, side: Side) -> list[int]:
    """Return where force and torque of an ankle stand in sensordata.

    Args:
        model: A compiled robot.
        side: Which ankle.

    Raises:
        ModelError: If it has no sensors.
    """
    names = (f"{side.value[0]}_{kind}" for kind in ("force", "torque"))
    parts = [sensor_at(model, name) for name in names]
    return [i for part in parts for i in range(part.start, part.stop)]


def trunk_body(model: mujoco.MjModel) -> int:
    """Return the body that pushes act on and that bears a payload.

    Args:
        model: A compiled robot.

    Returns:
        Index of the body that bears the IMU.

    Raises:
        ModelError: If there is no IMU.
    """
    sensor_at(model, "imu_quat")
    return int(model.site_bodyid[model.sensor("imu_quat").objid[0]])


def build_scene(
    robot: Robot, settings: SimulatorSettings, plan: FootstepPlan | None = None
) -> mujoco.MjModel:
    """Return the robot on a floor, with light.

    Args:
        robot: The robot.
        settings: Physics.
        plan: Where a rough floor is needed.

    Returns:
        The compiled model. The robot's joints come first, in their order.

    Raises:
        ParameterError: If a rough floor is wanted without a plan.
        PlanError: If the plan is too long for a rough floor.
    """
    spec = robot.spec.copy()
    for light in spec.lights:  # those of a robot's file would add to ours
        spec.delete(light)
    for geom in spec.geoms:  # soles may have priority over the floor: both must slip
        geom.friction[0] = min(geom.friction[0], settings.friction)
    spec.option.timestep = settings.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    world = robot.world if settings.scene else None
    material = _add_look(spec)
    if world is None or world.floor is not None:
        _add_floor(spec, material, settings.friction)
    if settings.terrain:
        if plan is None:
            raise ParameterError("simulator.terrain needs a plan to lie under")
        terrain = random_terrain(plan, settings.terrain, settings.terrain_seed)
        _add_terrain(spec, terrain, settings)
    if settings.payload:
        _add_payload(spec, robot, settings.payload)
    for actuator in spec.actuators:
        if settings.torque_lag and robot.servos is not None:
            actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            actuator.dynprm[0] = settings.torque_lag
    for joint in spec.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE:
            joint.damping[0] += settings.joint_damping
            if settings.joint_friction:
                joint.frictionloss += settings.joint_friction
                joint.solref_friction[:], joint.solimp_friction[:] = _STICKING
    if world is not None:
        _add_world(spec, world, robot)
    return spec.compile()


_PREFIX = "world/"
# Bits of contype and conaffinity: soles against the floor, and kinds of the robot's
# shapes against what is around it, from the highest down.
_SOLE_BIT, _KIND_BIT, _LAST_KIND = 1 << 30, 29, 21


def _add_world(spec: mujoco.MjSpec, world: World, robot: Robot) -> None:
    """Add what is around the robot; pictures keep the robot's size."""
    things, alone = world.spec.copy(), robot.model
    things.option, things.visual = spec.option, spec.visual  # two are a conflict
    if world.floor is not None:
        floor = spec.geom(FLOOR)
        floor.contype, floor.conaffinity = world.floor
    _let_touch(spec, things, robot.anatomy.solid)
    frame = spec.worldbody.add_frame(
        pos=world.position.tolist(), quat=world.quaternion.tolist()
    )
    drives = len(spec.actuators)
    spec.attach(things, prefix=_PREFIX, frame=frame)
    for ours, theirs in world.excluded:
        spec.add_exclude(bodyname1=ours, bodyname2=_PREFIX + theirs)
    spec.add_key(
        name=BEGIN,
        qpos=[*alone.qpos0, *world.qpos],
        qvel=[*np.zeros(alone.nv), *world.qvel],
        ctrl=[*np.zeros(drives), *world.ctrl],
    )
    spec.stat.extent, spec.stat.center = alone.stat.extent, alone.stat.center


def _let_touch(
    spec: mujoco.MjSpec,
    things: mujoco.MjSpec,
    solid: Mapping[str, tuple[int, int]],
) -> None:
    """Let shapes of the robot touch what is around it as the robot's file says.

    Those that were muted, so that only soles touch the floor, get a bit for each kind
    of contype and conaffinity that they had. Soles have priority over what they touch,
    but not over what has priority itself. Marked models keep their own bits.
    """
    kinds: dict[tuple[int, int], int] = {}
    for geom in spec.geoms:
        if geom.name in solid:
            bit = 1 << max(_KIND_BIT - len(kinds), _LAST_KIND)
            bit = kinds.setdefault(solid[geom.name], bit)
            geom.contype = geom.contype & ~1 | (_SOLE_BIT if geom.contype else 0) | bit
    floor = spec.geom(FLOOR)
    if floor is not None:
        floor.contype |= 0 if solid else 1
        floor.conaffinity |= _SOLE_BIT if solid else 1
    for geom in things.geoms:
        own = geom.contype, geom.conaffinity
        geom.priority += bool(solid and geom.priority > 0)
        for (contype, conaffinity), bit in kinds.items():
            if contype & own[1] or own[0] & conaffinity:
                geom.conaffinity |= bit


def _add_floor(spec: mujoco.MjSpec, material: str, friction: float) -> None:
    """Add the level floor."""
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        material=material,
        contype=1,
        conaffinity=1,
        friction=[friction, 0.005, 0.0001],
    )


TERRAIN_BIT = 1 << 20
"""Conaffinity of the boxes of a rough floor, which only soles touch."""
_BOX_DEPTH = 0.05  # how far boxes go below the floor [m]


def _add_terrain(
    spec: mujoco.MjSpec, terrain: Terrain, settings: SimulatorSettings
) -> None:
    """Add the boxes of a rough floor, which only the soles can touch."""
    for site in ("l_sole", "r_sole"):
        for geom in spec.site(site).parent.geoms:
            if geom.contype or geom.conaffinity:
                geom.contype |= TERRAIN_BIT
    side = CELL / 2
    for (x, y), height in zip(
        terrain.centers.tolist(), terrain.heights.tolist(), strict=True
    ):
        half = (height + _BOX_DEPTH) / 2
        light = 0.72 + 0.2 * height / settings.terrain
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[x, y, height - half],
            size=[side, side, half],
            rgba=[light, light, light + 0.02, 1.0],
            contype=0,
            conaffinity=TERRAIN_BIT,
            friction=[settings.friction, 0.005, 0.0001],
        )


_BEHIND = 0.12  # how far behind the trunk's CoM a payload is [m]
_PAYLOAD_SIZE = np.array([0.06, 0.12, 0.15])  # half lengths of its box [m]


def _add_payload(spec: mujoco.MjSpec, robot: Robot, share: float) -> None:
    """Add a box on the back: a body of its own, since a geom's mass may not count."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = robot.home
    mujoco.mj_kinematics(model, data)
    trunk = trunk_body(model)
    # Behind is against the way the soles point, whatever the axes of the trunk.
    x, y = data.site_xmat[robot.feet[Side.LEFT].site][[0, 3]]
    c, s = np.array([x, y]) / np.hypot(x, y)
    upright = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    axes = data.xmat[trunk].reshape(3, 3).T @ upright
    quat, mass = np.empty(4), share * robot.mass
    mujoco.mju_mat2Quat(quat, axes.ravel())
    squares = _PAYLOAD_SIZE**2
    body = spec.body(model.body(trunk).name).add_body(
        name="comwalk_payload",
        pos=model.body_ipos[trunk] - _BEHIND * axes[:, 0],
        quat=quat.tolist(),
        mass=mass,
        ipos=[0.0, 0.0, 0.0],  # MuJoCo would take the body's own place
        iquat=[1.0, 0.0, 0.0, 0.0],
        inertia=mass / 3.0 * (squares.sum() - squares),
        explicitinertial=True,
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=_PAYLOAD_SIZE,
        rgba=[0.72, 0.42, 0.22, 1.0],
        contype=0,
        conaffinity=0,
        mass=0.0,
    )


def _add_look(spec: mujoco.MjSpec) -> str:
    """Add sky, light and a floor material; return the material's name."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    spec.visual.quality.offsamples, spec.visual.quality.shadowsize = 4, 2048
    spec.visual.headlight.ambient = np.full(3, 0.45, np.float32)
    spec.visual.headlight.diffuse = np.full(3, 0.35, np.float32)
    spec.visual.map.znear = 0.02
    spec.add_texture(
        name="comwalk_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.86, 0.90, 0.95],
        rgb2=[0.55, 0.64, 0.75],
        width=256,
        height=256,
    )
    spec.add_texture(
        name="comwalk_tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.78, 0.80, 0.82],
        rgb2=[0.70, 0.72, 0.75],
        width=512,
        height=512,
    )
    material = spec.add_material(name=FLOOR, texrepeat=[2.5, 2.5], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "comwalk_tiles"
    spec.worldbody.add_light(
        name="comwalk_sun",
        pos=[0, 0, 4],
        dir=[0.25, 0.35, -1],
        diffuse=[0.5, 0.5, 0.5],
    ).type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    return FLOOR
