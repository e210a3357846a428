"""Models that mark their frames themselves, as `robots/paper.xml` does.

Sites named after REP-120 end the limbs: `l_sole`, `r_sole`, `l_gripper` or `l_wrist`,
`gaze`. Joints between them and the base are the limbs, shared ones the torso.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from ..errors import ModelError
from ..pattern import convex_hull
from ..sides import Side
from .anatomy import Anatomy
from .annotation import compile_model
from .kinematic_tree import Skeleton
from .loaders import Mimic, rotation_of
from .soles import Sole

_ENDS = {
    "left leg": ("l_sole",),
    "right leg": ("r_sole",),
    "left arm": ("l_gripper", "l_wrist"),
    "right arm": ("r_gripper", "r_wrist"),
    "head": ("gaze",),
}
_FLAT = 0.005  # how far above the lowest corner of a contact box a sole reaches [m]


def is_marked(spec: mujoco.MjSpec) -> bool:
    """Return whether a model marks its soles itself.

    Args:
        spec: The model.
    """
    return {"l_sole", "r_sole"} <= {site.name for site in spec.sites}


def read_marks(spec: mujoco.MjSpec, path: Path, mimics: Sequence[Mimic]) -> Anatomy:
    """Return the anatomy of a model that marks its frames itself.

    Args:
        spec: The model; a site at the centre of each sole is added.
        path: Its file, for messages.
        mimics: Joints that follow others.

    Returns:
        Its parts.

    Raises:
        ModelError: If a sole has no contact box, or no joint leads to it.
    """
    model = compile_model(spec, f"robot {path}")
    soles = {side: _add_centre(spec, model, side, path) for side in Side}
    look = Skeleton(model, mujoco.MjData(model), str(path))
    mujoco.mj_kinematics(model, look.data)
    sites = {model.site(i).name: i for i in range(model.nsite)}
    chains: dict[str, tuple[int, ...]] = {part: () for part in _ENDS}
    for part, frames in _ENDS.items():
        site = next((sites[frame] for frame in frames if frame in sites), -1)
        if site >= 0:
            chains[part] = look.chain(int(model.site_bodyid[site]))
        if part.endswith("leg") and not chains[part]:
            raise ModelError(f"robot {path}: no joint between the base and {frames[0]}")
    upper = [chain for part, chain in chains.items() if not part.endswith("leg")]
    shared = {j for c in upper for j in c if sum(j in other for other in upper) > 1}
    return _anatomy(look, chains, shared, soles, mimics)


def _anatomy(
    look: Skeleton,
    chains: dict[str, tuple[int, ...]],
    shared: set[int],
    soles: dict[Side, Sole],
    mimics: Sequence[Mimic],
) -> Anatomy:
    """Return the anatomy of limbs that are known."""
    own = {
        p: {*c} - (set() if p.endswith("leg") else shared) for p, c in chains.items()
    }
    parts = {part: look.names(sorted(joints)) for part, joints in own.items()}
    parts["torso"] = look.names(sorted(shared))
    coupled = tuple(
        m for m in mimics if any({m.joint, m.primary} <= {*j} for j in parts.values())
    )
    followers = {m.joint for m in coupled}
    free = {p: tuple(j for j in js if j not in followers) for p, js in parts.items()}
    apart = [m.joint for m in mimics if m not in coupled]
    return Anatomy(
        forward=0.0,
        legs={side: free[f"{side} leg"] for side in Side},
        arms={side: free[f"{side} arm"] for side in Side if free[f"{side} arm"]},
        torso=free["torso"],
        head=free["head"],
        locked=(),
        soles={s: _over_ankle(look, soles[s], chains[f"{s} leg"][-1]) for s in Side},
        coupled=coupled,
        imu=_imu_body(look.model),
        marked=True,
        notes=tuple(f'joint "{j}" follows one of another limb: ignored' for j in apart),
    )


def _over_ankle(look: Skeleton, sole: Sole, ankle: int) -> Sole:
    """Return a sole that knows where the leg's last joint is."""
    body = look.model.body(sole.body).id
    R = look.rotation(body)
    centre = look.data.xpos[body] + R @ sole.position
    x, y, z = ((look.anchors([ankle])[0] - centre) @ R @ sole.rotation).tolist()
    return replace(sole, ankle=(x, y, z))


def _imu_body(model: mujoco.MjModel) -> str:
    names = [model.site(i).name for i in range(model.nsite)]
    body = model.site_bodyid[names.index("imu")] if "imu" in names else 1
    return model.body(body).name


def _add_centre(
    spec: mujoco.MjSpec, model: mujoco.MjModel, side: Side, path: Path
) -> Sole:
    """Add a site at the centre of a sole, where plans put it; return the sole."""
    letter = side.value[0]
    sole = model.site(f"{letter}_sole")
    corners = _sole_corners(model, sole.id)
    if len(corners) < 3:
        raise ModelError(
            f'robot {path}: the body of site "{letter}_sole" has no box that touches '
            "the ground; give the foot a contact box"
        )
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    R = rotation_of(sole.quat)
    position = sole.pos + R @ [*centre, 0.0]
    body = next(s for s in spec.sites if s.name == f"{letter}_sole").parent
    body.add_site(name=f"{letter}_sole_centre", pos=position, quat=sole.quat, group=4)
    length, width = np.ptp(corners, axis=0).tolist()
    return Sole(
        body=body.name,
        position=position,
        rotation=R,
        size=(length, width),
        polygon=corners - centre,
        origin="contact box",
    )


def _sole_corners(model: mujoco.MjModel, site: int) -> np.ndarray:
    """Return the corners of a foot's contact boxes in the plane of its sole site."""
    R, corners = rotation_of(model.site_quat[site]), [np.zeros((0, 3))]
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    for geom in np.flatnonzero(model.geom_bodyid == model.site_bodyid[site]).tolist():
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if collides and model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_BOX):
            turn = rotation_of(model.geom_quat[geom])
            points = signs * model.geom_size[geom] @ turn.T
            corners.append((points + model.geom_pos[geom] - model.site_pos[site]) @ R)
    points = np.vstack(corners)
    lowest = points[:, 2] < points[:, 2].min(initial=np.inf) + _FLAT
    return convex_hull(points[lowest, :2]) if len(points) else points[:, :2]


Role = tuple[str, float]
"""A joint, and the sign by which it turns as its role does."""


_AXES = {"pitch": 1, "roll": 0, "yaw": 2}


_LEAST_SHARE = 0.6  # of a joint's axis along that of its role


def find_roles(
    model: mujoco.MjModel, q: np.ndarray, anatomy: Anatomy
) -> dict[str, Role]:
    """Return the roles of joints, as dances name them, at a standing posture.

    A pitch turns about y (left), a roll about x (forward), a yaw about z (up).

    Args:
        model: The compiled model, x forward.
        q: The posture, MuJoCo's qpos, arms hanging.
        anatomy: The model's parts.

    Returns:
        Joint and sign by role.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    posture, roles = Skeleton(model, data, ""), dict[str, Role]()
    hinge = int(mujoco.mjtJoint.mjJNT_HINGE)

    def hinges(names: Sequence[str]) -> list[int]:
        joints = [model.joint(name).id for name in names]
        return [j for j in joints if model.jnt_type[j] == hinge]

    for side, names in anatomy.arms.items():
        arm, letter = hinges(names), side.value[0]
        if arm:
            k = posture.middle(arm, posture.centre(posture.body_of(arm[-1])))
            roles |= _turning(posture, arm[:k], f"{letter}_shoulder")
            roles |= _turning(posture, arm[k : k + 1], f"{letter}_elbow", ("pitch",))
    for part, names in (("waist", anatomy.torso), ("head", anatomy.head)):
        roles |= _turning(posture, hinges(names), part)
    return roles


def _turning(
    posture: Skeleton,
    joints: Sequence[int],
    part: str,
    wanted: Sequence[str] = tuple(_AXES),
) -> dict[str, Role]:
    """Assign joints to axes, each to one at most."""
    if not joints:
        return {}
    shares = posture.axes(joints)[:, [_AXES[name] for name in wanted]]
    pairs = _best_pairs(np.abs(shares))
    return {
        f"{part}_{wanted[c]}": (
            posture.model.joint(joints[r]).name,
            math.copysign(1.0, shares[r, c]),
        )
        for r, c in pairs
        if abs(shares[r, c]) > _LEAST_SHARE
    }


def _best_pairs(shares: np.ndarray) -> list[tuple[int, int]]:
    """Return pairs of a row and a column, each in one at most, of the largest sum."""
    rows, columns = shares.shape
    if rows < columns:
        return [(r, c) for c, r in _best_pairs(shares.T)]
    every = itertools.permutations(range(rows), columns)
    best = max(every, key=lambda rows: sum(shares[rows, range(columns)]))
    return list(zip(best, range(columns), strict=True))
