"""Find limbs, torso, head and forward axis in a humanoid model.

Nothing is read from names. The model is looked at in its zero posture, z up: the two
limbs that reach the ground are the legs, the toes of their soles tell what is forward;
of the other limbs those on the left and the right are arms, the highest in the middle
is the head, and joints which these share are the torso. Joints in no limb (fingers,
eyes, toes) are to be locked.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile

import mujoco
import numpy as np

from ..errors import ModelError
from ..sides import Side
from .kinematic_tree import Skeleton, zero_posture
from .loaders import LinkMesh, Mimic, first_of
from .profile import Profile
from .soles import CROSSWISE, FITTED, Face, Sole, find_face, make_sole, sole_notes

Joints = tuple[int, ...]
"""Joints as indices into the model's, from the base outwards."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """The parts of a humanoid; joints by name, from the base outwards."""

    forward: float
    """Yaw of the forward axis in the zero posture of the file [rad]."""
    legs: Mapping[Side, tuple[str, ...]]
    """Joints of the legs."""
    arms: Mapping[Side, tuple[str, ...]]
    """Joints of the arms; a side without an arm is missing."""
    torso: tuple[str, ...]
    """Joints between the base and what arms and head share."""
    head: tuple[str, ...]
    """Joints of the neck."""
    locked: tuple[str, ...]
    """Joints that do not move: fingers, eyes, toes."""
    soles: Mapping[Side, Sole]
    """The soles."""
    coupled: tuple[Mimic, ...] = ()
    """Joints in the limbs that follow others; no limb lists them."""
    imu: str = ""
    """Body that bears the IMU."""
    designed: tuple[str, ...] = ()
    """Joints whose servos are comwalk's, not the file's."""
    marked: bool = False
    """Whether the file marks all this itself."""
    solid: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Contype and conaffinity that shapes had before all but the soles were muted."""
    notes: tuple[str, ...] = ()
    """What a user should know, a line each."""


_GROUND = 0.25  # share of the height within which the end of a limb is a foot
_SKEW = 0.015  # angle under which a forward axis is that of the file [rad]
_ARMPIT = 0.1  # how high over the CoM of the rest legs may begin, in leg lengths
_TOGETHER = 0.03, 0.015  # hips, feet that are in one place, in leg lengths
_TOE = 0.05  # distance of a toe's joint from the ankle, in leg lengths
_LEG = 6  # joints that a leg needs to place its foot
_FEWEST = 4  # joints that a leg must have to walk at all
_ARM = 7  # joints of an arm; what comes after them is a gripper
_HAND = 3  # joints that all fingers of one hand have in common, at least
_MIDDLE = 0.3, 0.04  # how far aside a head may be, in arm spans and leg lengths
_TRUNK = 0.2  # share of the mass that a joint of the torso moves, at least


def find_anatomy(
    model: mujoco.MjModel,
    meshes: Sequence[LinkMesh],
    name: str,
    mimics: Sequence[Mimic] = (),
    given: Profile | None = None,
) -> Anatomy:
    """Find the parts of a humanoid.

    Args:
        model: The compiled model; its first joint is the free joint of the base.
        meshes: Meshes of its bodies, for the soles.
        name: What messages call the model.
        mimics: Joints that follow others.
        given: What is known; it replaces what would be found.

    Returns:
        The anatomy.

    Raises:
        ModelError: If there are not two legs with feet, which the message explains.
    """
    given = given or Profile()
    zero = zero_posture(model, name, mimics)
    followers = {model.joint(m.joint).id for m in mimics}
    legs, notes = _find_legs(zero, given, followers)
    faces = [find_face(zero, leg, meshes) for leg in legs]
    forward = None if given.forward is None else math.radians(given.forward)
    if forward is None:
        forward = _find_forward(zero, legs, faces)
    sides = dict(zip(_sides(zero, legs, forward, given), range(2), strict=True))
    soles = {
        side: make_sole(zero, legs[k], faces[k], forward, given.soles.get(side))
        for side, k in sides.items()
    }
    parts = _find_upper_body(zero, legs, forward, given)
    parts |= {f"{side} leg": legs[k] for side, k in sides.items()}
    locked = {model.joint(j).id for j in given.locked}
    coupled = _coupled(zero, parts, mimics, locked)
    own = {
        part: zero.names(j for j in joints if j not in followers | locked)
        for part, joints in parts.items()
    }
    apart = [mimic for mimic in mimics if mimic not in coupled]
    moving = {j for joints in own.values() for j in joints}
    moving |= {m.joint for m in coupled}
    every = zero.names(range(1, model.njnt))
    return Anatomy(
        forward=float(forward),
        legs={side: own[f"{side} leg"] for side in Side},
        arms={side: own[f"{side} arm"] for side in Side if own[f"{side} arm"]},
        torso=own["torso"],
        head=own["head"],
        locked=tuple(j for j in every if j not in moving),
        soles={side: soles[side] for side in Side},
        coupled=coupled,
        imu=given.imu or _trunk(zero, own["torso"]),
        notes=(*notes, *sole_notes(soles), *_notes(zero, parts, own, apart)),
    )


def _trunk(zero: Skeleton, torso: Sequence[str]) -> str:
    last = zero.model.joint(torso[-1]).id if torso else 0
    return zero.model.body(zero.body_of(last)).name


def _coupled(
    zero: Skeleton,
    parts: Mapping[str, Joints],
    mimics: Sequence[Mimic],
    locked: Collection[int],
) -> tuple[Mimic, ...]:
    """Return the mimics whose joint and leader belong to one limb; others are locked.

    Args:
        zero: The model.
        parts: All limbs.
        mimics: Joints that follow others.
        locked: Joints that are locked.
    """
    found = []
    for mimic in mimics:
        pair = [zero.model.joint(n).id for n in (mimic.joint, mimic.primary)]
        for joints in parts.values():
            path = zero.chain(zero.body_of(joints[-1])) if joints else ()
            if pair[0] in path and pair[1] in joints and not set(pair) & set(locked):
                found.append(mimic)
                break
    return tuple(found)


def _notes(
    zero: Skeleton,
    parts: Mapping[str, Joints],
    own: Mapping[str, tuple[str, ...]],
    apart: Iterable[Mimic],
) -> list[str]:
    """Return notes on legs that lack a joint, or share its motor, for the user."""
    few = [side for side in Side if len(own[f"{side} leg"]) < _LEG]
    legs = {*parts["left leg"], *parts["right leg"]}
    return [
        *(f"the {s} leg has {len(own[f'{s} leg'])} joints, not six" for s in few),
        *(
            f"{m.joint} shares a motor with {m.primary} of another limb: it is locked"
            for m in apart
            if zero.model.joint(m.joint).id in legs
        ),
    ]


# ---- Legs -------------------------------------------------------------------------


def _find_legs(
    zero: Skeleton, given: Profile, followers: Collection[int]
) -> tuple[list[Joints], list[str]]:
    """Return the joints of both legs, in any order, and notes."""
    if given.legs:
        legs = [_ids(zero, given.legs[side]) for side in Side]
        return [_checked_leg(zero, leg, followers) for leg in legs], []
    feet = [zero.model.body(given.feet[s]).id for s in Side if given.feet]
    ends = feet or _low_ends(zero)
    chains = [zero.chain(body) for body in ends]
    shared = set(chains[0]).intersection(*chains) if len(chains) > 1 else set()
    own = [tuple(j for j in chain if j not in shared) for chain in chains]
    groups = _disjoint(own)
    if len(groups) != 2:
        count = _LEG_COUNTS.get(len(groups), _MANY_LEGS)
        raise ModelError(f"{zero.name}: it has {count}")
    picked = [min(g, key=lambda k: float(zero.centre(ends[k])[2])) for g in groups]
    limbs = [own[k] for k in picked]
    low = zero.root_height(limbs) <= _ARMPIT * zero.leg_length(limbs[0])
    if not (low or given.feet):
        raise ModelError(f"{zero.name}: it {_NO_LEGS}")
    found = [_leg_of(zero, limb, followers) for limb in limbs]
    notes = [f"a leg has more than six joints: {n} is locked" for _, n in found if n]
    if shared:
        names = first_of(zero.names(sorted(shared)))
        notes.append(f"between the base and both legs, locked: {names}")
    return [_checked_leg(zero, leg, followers) for leg, _ in found], notes


_LEG_COUNTS = {
    0: "no limb that reaches the ground; walking needs two legs",
    1: "one limb that reaches the ground; walking needs two legs, each a chain of "
    "its own from the base, and z up in the root link",
}
_NO_LEGS = (
    "has no legs: the limbs that reach lowest hang from above the middle of its body, "
    "as arms do; walking needs two legs"
)
_MANY_LEGS = (
    "more than two limbs that reach the ground; comwalk walks on two legs (a file "
    'of --profile can name them: feet = { left = "body", right = "body" })'
)


def _ids(zero: Skeleton, names: Iterable[str]) -> Joints:
    return tuple(zero.model.joint(name).id for name in names)


def _low_ends(zero: Skeleton) -> list[int]:
    """Return the last jointed bodies of all limbs that reach down to the ground."""
    m = zero.model
    jointed = [b for b in range(1, m.nbody) if m.body_jntnum[b] and zero.chain(b)]
    ends = [b for b in jointed if not set(zero.beyond(b)[1:]) & set(jointed)]
    if not ends:
        return []
    heights = np.array([zero.centre(b)[2] for b in ends])
    top = max(float(zero.data.xipos[1:, 2].max()), float(zero.data.xpos[1, 2]))
    reach = heights.min() + _GROUND * (top - heights.min())
    return [b for b, z in zip(ends, heights, strict=True) if z <= reach]


def _disjoint(chains: Sequence[Joints]) -> list[list[int]]:
    """Return groups of chains that share joints, by their indices."""
    groups: list[tuple[set[int], list[int]]] = []
    for k, chain in enumerate(chains):
        joined = [g for g in groups if g[0] & set(chain)]
        groups = [g for g in groups if not g[0] & set(chain)]
        joints = set(chain).union(*(g[0] for g in joined))
        if joints:
            groups.append((joints, [*(i for g in joined for i in g[1]), k]))
    return [members for _, members in groups]


def _leg_of(
    zero: Skeleton, chain: Joints, followers: Collection[int]
) -> tuple[Joints, str]:
    """Return the joints of a leg, without toes, and a joint too many, or ""."""
    chain = _without_toes(zero, chain)
    free = [j for j in chain if j not in followers][: _LEG + 1]
    if len(free) <= _LEG:
        return chain, ""
    extra = _redundant(zero, free)
    leg = [j for j in free if j != extra]
    kept = chain[: chain.index(leg[-1]) + 1]
    return tuple(j for j in kept if j != extra), zero.model.joint(extra).name


def _without_toes(zero: Skeleton, chain: Joints) -> Joints:
    """Return a chain without joints of toes: parallel to the ankle's, and before it."""
    while len(chain) > _FEWEST:
        *leg, toe = chain
        axis = zero.axes([toe])[0]
        pitch = [j for j in leg if abs(zero.axes([j])[0] @ axis) > 0.9]
        if not pitch:
            break
        dx, dy, dz = np.diff(zero.anchors([pitch[-1], toe]), axis=0)[0].tolist()
        ahead = math.hypot(dx, dy)
        if ahead < abs(dz) or ahead < _TOE * zero.leg_length(leg):
            break
        chain = tuple(leg)
    return chain


def _redundant(zero: Skeleton, leg: Sequence[int]) -> int:
    """Return the joint of a leg that is missed the least: the others move the foot.

    Each is left out in turn, in a few postures; the one without which the leg stays
    farthest from its singular postures is it.
    """
    m, data = zero.model, mujoco.MjData(zero.model)
    rng, scores = np.random.default_rng(0), np.zeros(len(leg))
    length, body = zero.leg_length(leg), zero.body_of(leg[-1])
    for _ in range(8):
        data.qpos[:] = zero.data.qpos
        data.qpos[m.jnt_qposadr[list(leg)]] += rng.uniform(-0.4, 0.4, len(leg))
        mujoco.mj_kinematics(m, data)
        mujoco.mj_comPos(m, data)
        J = np.zeros((6, m.nv))
        mujoco.mj_jac(m, data, J[:3], J[3:], data.xanchor[leg[-1]], body)
        J = J[:, m.jnt_dofadr[list(leg)]] / np.repeat([length, 1.0], 3)[:, None]
        for k in range(len(leg)):
            rest = np.delete(J, k, axis=1)
            scores[k] += np.linalg.svd(rest, compute_uv=False)[_LEG - 1]
    return leg[int(np.argmax(scores))]


def _checked_leg(zero: Skeleton, leg: Joints, followers: Collection[int]) -> Joints:
    """Return a leg if it has joints enough."""
    count = len(set(leg) - set(followers))
    if count < _FEWEST:
        foot = zero.model.body(zero.body_of(leg[-1])).name if leg else "the ground"
        raise ModelError(
            f"{zero.name}: the leg to {foot} has {count} joints and so no foot to "
            "stand on; walking needs at least 4 (hip roll and pitch, knee, ankle), and "
            "does best with 6"
        )
    return leg


# ---- The forward axis -------------------------------------------------------------


def _find_forward(
    zero: Skeleton, legs: Sequence[Joints], faces: Sequence[Face]
) -> float:
    """Return the yaw of the forward axis: across the hips, to where the toes are.

    If the toes do not tell, the knees do: shanks fold backward.
    """
    length = zero.leg_length(legs[0])
    hips, ankles = (
        np.array([zero.anchors(leg)[k, :2] for leg in legs]) for k in (0, -1)
    )
    apart, ankles_apart = hips[0] - hips[1], ankles[0] - ankles[1]
    if np.hypot(*apart) < _TOGETHER[0] * length:
        apart = ankles_apart
    x, y = apart.tolist()
    if math.hypot(x, y) < _TOGETHER[1] * length:
        raise ModelError(
            f"{zero.name}: both feet are in one place, so left and right cannot be "
            "told; the legs must stand beside each other"
        )
    f = np.array([y, -x]) / math.hypot(x, y)
    toes = sum(
        _toes(face.points[:, :2] - ankle, f)
        for face, ankle in zip(faces, ankles, strict=True)
        if face.origin != FITTED
    )
    way = toes or sum(_knee_way(zero, leg, f) for leg in legs) or float(f[0])
    yaw = math.atan2(*(math.copysign(1.0, way) * f)[::-1].tolist())
    square = round(yaw / (math.pi / 2)) * math.pi / 2
    return square if abs(yaw - square) < _SKEW else yaw


def _toes(points: np.ndarray, f: np.ndarray) -> float:
    """Return the middle of a sole along f, from the ankle; 0 if unclear."""
    along, across = points @ f, points @ [-f[1], f[0]]
    length, width = np.ptp(along), np.ptp(across)
    middle = 0.5 * float(along.min() + along.max())
    clear = length > width / CROSSWISE and abs(middle) > 0.05 * length
    return middle if clear else 0.0


def _knee_way(zero: Skeleton, leg: Joints, f: np.ndarray) -> float:
    """Return whether f is forward (+1) or backward (-1), by how the knee folds."""
    knee = leg[zero.middle(leg, zero.anchors(leg)[-1])]
    if not zero.model.jnt_limited[knee]:
        return 0.0
    low, high = zero.model.jnt_range[knee]
    left = np.array([-f[1], f[0]])
    return float(np.sign((high + low) * (zero.axes([knee])[0, :2] @ left)))


def _sides(
    zero: Skeleton, legs: Sequence[Joints], forward: float, given: Profile
) -> tuple[Side, Side]:
    """Return the side of each leg."""
    if given.legs:
        return Side.LEFT, Side.RIGHT
    left = [-math.sin(forward), math.cos(forward)]
    first, second = (
        float(zero.anchors(leg)[:, :2].mean(axis=0) @ left) for leg in legs
    )
    pair = (Side.LEFT, Side.RIGHT)
    return pair if first > second else pair[::-1]


# ---- Upper body -------------------------------------------------------------------


def _find_upper_body(
    zero: Skeleton, legs: Sequence[Joints], forward: float, given: Profile
) -> dict[str, Joints]:
    """Return the joints of "left arm", "right arm", "torso" and "head"."""
    chains = _tip_chains(zero, legs)
    limbs = {
        part: _limb(zero, own) for part, own in _by_side(zero, chains, forward).items()
    }
    shared = {
        j for a in limbs for b in limbs if a != b for j in {*limbs[a]} & {*limbs[b]}
    }
    total = zero.moved_mass(0)
    every = {j for chain in limbs.values() for j in chain}
    heavy = {j for j in every if zero.moved_mass(j) > _TRUNK * total}
    torso = tuple(sorted(shared | heavy))
    parts = {p: tuple(j for j in c if j not in torso) for p, c in limbs.items()}
    parts = {part: joints[:_ARM] for part, joints in parts.items()}
    parts |= {"torso": torso}
    return _with_given(zero, parts, given)


def _with_given(
    zero: Skeleton, parts: dict[str, Joints], given: Profile
) -> dict[str, Joints]:
    """Return the parts with those that a profile names; a joint is in one at most."""
    arms = {f"{side} arm": joints for side, joints in given.arms.items()}
    named = {**arms, "torso": given.torso, "head": given.head}
    known = {p: _ids(zero, names) for p, names in named.items() if names is not None}
    taken = {j for joints in known.values() for j in joints}
    rest = {p: tuple(j for j in own if j not in taken) for p, own in parts.items()}
    return rest | known


def _tip_chains(zero: Skeleton, legs: Sequence[Joints]) -> dict[int, Joints]:
    """Return the chains that end in tips, by body; limbs that stand left out."""
    m = zero.model
    own = {j for leg in legs for j in leg}
    paths = {j for leg in legs for j in zero.chain(zero.body_of(leg[-1]))}
    chains = {b: zero.chain(b) for b in range(1, m.nbody) if m.body_jntnum[b]}
    low = {j for body in _low_ends(zero) for j in chains[body]}
    upper = {
        body: tuple(j for j in chain if j not in paths)
        for body, chain in chains.items()
        if chain and not own & {*chain} and chain[-1] not in low | paths
    }
    inner = {j for chain in upper.values() for j in chain[:-1]}
    return {b: chain for b, chain in upper.items() if chain[-1] not in inner}


def _by_side(
    zero: Skeleton, chains: Mapping[int, Joints], forward: float
) -> dict[str, list[Joints]]:
    """Return the chains of left arm, right arm and head.

    A limb is on the side to which its joints or its tip lie farthest; in the middle,
    what hangs from below the shoulders is a tail, or something worn, and no head.
    """
    left = np.array([-math.sin(forward), math.cos(forward)])
    across = {}
    for body, chain in chains.items():
        points = np.vstack([zero.anchors(chain), zero.centre(body)])[:, :2] @ left
        across[body] = float(points[np.argmax(np.abs(points))])
    span = max((abs(y) for y in across.values()), default=0.0)
    height = float(np.ptp(zero.data.xipos[1:, 2]))
    near = max(_MIDDLE[0] * span, 0.5 * _MIDDLE[1] * height)
    sides: dict[str, list[Joints]] = {"left arm": [], "right arm": [], "head": []}
    for body, y in across.items():
        if abs(y) >= near:
            sides["left arm" if y > 0 else "right arm"].append(chains[body])
    middle = [b for b, y in across.items() if abs(y) < near]
    return sides | {"head": _highest(zero, middle, chains)}


def _highest(
    zero: Skeleton, tips: Sequence[int], chains: Mapping[int, Joints]
) -> list[Joints]:
    """Return the chains of those limbs whose tips are the highest of some."""
    trunk = float(zero.centre(zero.body_of(0))[2])
    heights = {b: float(zero.centre(b)[2]) for b in tips}
    above = [b for b in tips if heights[b] > trunk]
    if not above:
        return []
    best = chains[max(above, key=heights.__getitem__)]
    return [c for c in (chains[b] for b in above) if c[:_HAND] == best[:_HAND]]


def _limb(zero: Skeleton, chains: Sequence[Joints]) -> Joints:
    """Return the common part of a limb's chains: the limb without its hand.

    Of several limbs on one side the heaviest counts.
    """
    if not chains:
        return ()
    heaviest = max(chains, key=lambda c: zero.moved_mass(c[len(c) // 2]))
    own = [c for c in chains if c[:_HAND] == heaviest[:_HAND]]
    columns = zip(*own, strict=False)
    return tuple(c[0] for c in takewhile(lambda c: len(set(c)) == 1, columns))
