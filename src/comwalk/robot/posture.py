"""A posture to walk from, found for any humanoid: bent legs, hanging arms.

The legs are bent until they are as far from their singular posture, by the smallest
singular value of their Jacobians, as those of the paper's robot; soles level and
parallel, the trunk upright, the CoM over the middle of the soles. They are bent less
or more where a step of the paper's gait, to scale, would need angles or torques that
the joints do not have. The arms hang a little away from the body, with bent elbows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ..embedding import level_error, sigma_min
from ..errors import ModelError
from ..sides import Side
from .kinematic_tree import Skeleton
from .mimic import Coupling
from .profile import Stance

BEND = 0.18
"""Smallest singular value of a leg's Jacobian to walk with [rad], lengths taken in
units of the leg's length; that of the paper's robot."""

LEAST_BEND = 0.12
"""The least that it may be where joints are too weak, or turn too little, for more."""

LEAST_GAP = 0.033
"""Smallest distance between the soles of a standing robot, in leg lengths [-]."""

_BENDS = *np.linspace(BEND, LEAST_BEND, 7).tolist(), 0.2, 0.22, 0.24  # in this order
_EFFORT = 0.7  # share of the leg's torques that a force straight up may take
_SWAYING = 0.95  # the same of a force to the CoM, as far out as the gait sways
_AHEAD, _BEHIND, _LIFT = 0.1456, 0.2, 0.022  # where soles go to, in CoM heights
_SWAY = 0.706  # how far the CoM goes to the foot: 1 - 1 / cosh(omega_n T / 2)
_STRIDES = 1.0, 0.85, 0.7, 0.5, 0.25, 0.0  # shares of the stride that are tried
_STRAIGHT = 0.11  # smallest singular value of a leg at the end of a stride [rad]
_HEIGHTS = 0.98, 0.5, 49  # hips over ankles, in leg lengths: from, to, how many
_HALVINGS = 14  # of the last step between two heights
_MARGIN = 0.05, 0.2  # kept to joint limits: at most [rad], and as a share of the range
_UPPER_ARM, _FOREARM = (0.05, 0.4, -1.0), (0.45, 0.1, -1.0)  # x, outwards, z
_TWISTS = (0.0, 0.3, -0.3)  # from where an arm is sought [rad]
_CLOSE = 1e-4  # error of a posture that stands [rad, leg lengths]
_WHAT = (
    *["the place of the left sole"] * 3,
    *["the left sole's level"] * 3,
    *["the place of the right sole"] * 3,
    *["the right sole's level"] * 3,
    *["the CoM over the soles"] * 2,
)
"""What the rows of `_Seeker._rows` are about, but for trunk and height."""
_WEAK_ROWS = [2, 3, 4, 8, 9, 10, 12, 17]
"""What legs of fewer than six joints must reach: height and level of the soles, the
CoM's x and the hips' height, as rows of `_Seeker._rows`."""


@dataclass(frozen=True, eq=False)
class Limbs:
    """The limbs of a posture search: joints as indices into the model's."""

    legs: Mapping[Side, Sequence[int]]
    """Joints of the legs, base first."""
    arms: Mapping[Side, Sequence[int]]
    """Joints of the arms, base first."""
    soles: Mapping[Side, int]
    """Sites at the centres of the soles."""
    hands: Mapping[Side, int]
    """Sites of the hands."""
    widths: Mapping[Side, float]
    """Widths of the soles [m]."""
    coupling: Coupling | None = None
    """Joints that follow others."""


def find_posture(
    model: mujoco.MjModel,
    limbs: Limbs,
    given: Mapping[str, float] | None = None,
    torque: np.ndarray | None = None,
    stance: Stance | None = None,
) -> np.ndarray:
    """Return a posture to walk from.

    Args:
        model: The compiled model, x forward.
        limbs: Its limbs.
        given: Angles that are known [rad], by joint; the others are found.
        torque: Torque limits of the joints [N m], of shape (joints,); where a step
            would need too much of them, or more than the joints' ranges, the legs are
            stretched, down to `LEAST_BEND`, or bent more.
        stance: How it is to stand. By default the legs are bent as `BEND`, or as the
            torques allow, and as far apart as in the zero posture, but never so that
            the soles meet.

    Returns:
        MuJoCo's qpos: the soles on the plane z = 0, (0, 0) in their middle.

    Raises:
        ModelError: If the legs cannot stand so.
    """
    given, stance = given or {}, stance or Stance()
    seeker = _Seeker(model, limbs, given, stance.half_width)
    seeker.hang_arms()
    if {*limbs.legs[Side.LEFT], *limbs.legs[Side.RIGHT]} <= seeker.fixed:
        return seeker.put_down()
    if stance.com_height is not None:
        return seeker.lower_com(stance.com_height)
    if stance.bend is not None or torque is None:
        return seeker.bend_legs(BEND if stance.bend is None else stance.bend)
    return seeker.able_posture(torque)


class _Seeker:
    """Finds a posture of one model. Final."""

    def __init__(
        self,
        model: mujoco.MjModel,
        limbs: Limbs,
        given: Mapping[str, float],
        half_width: float | None,
    ) -> None:
        self.model, self.limbs = model, limbs
        self.data = mujoco.MjData(model)
        self.low, self.high = _ranges(model, limbs.coupling)
        self.q = np.zeros(model.nq)
        self.q[3] = 1.0
        self.q[7:] = np.clip(0.0, self.low, self.high)
        self.fixed = {model.joint(name).id for name in given}
        for name, angle in given.items():
            self.q[model.joint(name).qposadr[0]] = angle
        self.nearest: tuple[float, np.ndarray] = (math.inf, self.q.copy())
        self._update()
        look = Skeleton(model, self.data, "")
        self.length = min(look.leg_length(limbs.legs[s]) for s in Side)
        self.spans = [[look.hip(leg), leg[-1]] for leg in limbs.legs.values()]
        self.half_width = self._spacing() if half_width is None else half_width
        self.com = np.zeros(2)
        self.soles = {s: np.array([0.0, s.sign * self.half_width, 0.0]) for s in Side}
        joints = [j for s in Side for j in limbs.legs[s] if j not in self.fixed]
        self.free = np.concatenate([np.arange(6), model.jnt_dofadr[joints]]).astype(int)

    def _update(self) -> None:
        """Compute the kinematics of the present posture."""
        if self.limbs.coupling is not None:
            self.limbs.coupling.follow(self.q[7:])
        self.data.qpos[:] = self.q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def _spacing(self) -> float:
        """Return half of the distance of the soles as the hips have it [m]."""
        left, right = (self.data.site_xpos[self.limbs.soles[s]][1] for s in Side)
        widest = max(self.limbs.widths.values()) + LEAST_GAP * self.length
        return max(0.5 * float(left - right), 0.5 * widest)

    # ---- Arms ----

    def hang_arms(self) -> None:
        """Pose hanging arms: upper arm down and out, forearm down and forward."""
        look = Skeleton(self.model, self.data, "")
        for side, joints in self.limbs.arms.items():
            tip = self.data.site_xpos[self.limbs.hands[side]]
            elbow = look.middle(joints, tip)
            free = [j for j in joints[: elbow + 1] if j not in self.fixed]
            if free:
                self._hang(side, free, joints[0], joints[elbow])
        self._update()

    def _hang(self, side: Side, joints: Sequence[int], first: int, elbow: int) -> None:
        """Turn the joints of one arm, from the first to the elbow, until it hangs."""
        from scipy.optimize import least_squares

        places = self.model.jnt_qposadr[list(joints)]
        low, high = self.low[places - 7], self.high[places - 7]
        start, hand = self.q[places].copy(), self.limbs.hands[side]
        outwards = np.array([1.0, side.sign, 1.0])

        def miss(angles: np.ndarray) -> np.ndarray:
            """Return how far an arm with some angles [rad] is from hanging."""
            self.q[places] = angles
            self._update()
            shoulder, bend = self.data.xanchor[[first, elbow]]
            upper = _unit(bend - shoulder) - _unit(outwards * _UPPER_ARM)
            fore = _unit(self.data.site_xpos[hand] - bend) - _unit(outwards * _FOREARM)
            return np.concatenate([upper, fore, 0.03 * (angles - start)])

        tries = []
        for twist in _TWISTS:
            guess = np.clip(start + twist, low + 1e-6, high - 1e-6)
            tries.append(least_squares(miss, guess, bounds=(low, high), xtol=1e-8))
        self.q[places] = min(tries, key=lambda found: round(found.cost, 9)).x

    # ---- Legs ----

    def able_posture(self, torque: np.ndarray) -> np.ndarray:
        """Return the posture nearest to `BEND` from which the longest steps are free.

        The one that needs least of the torques [N m], (joints,), if none is free.
        """
        tried: dict[float, tuple[np.ndarray, float]] = {}
        for share in _STRIDES:
            for bend in _BENDS:
                if bend not in tried:
                    tried[bend] = self.bend_legs(bend), round(self._load(torque), 3)
                q, load = tried[bend]
                if load <= 1.0 and self._strides(self._settled(q), share):
                    return q
        return self._settled(min(tried.values(), key=lambda found: found[1])[0])

    def _load(self, torque: np.ndarray) -> float:
        """Return the share of usable torques on one foot, swaying if it can."""
        home, com_height = self.q.copy(), self._com_height()
        load = max(self._effort(side, torque) for side in Side) / _EFFORT
        for side in Side:
            foot = side.sign * self.half_width
            if self._shifted(self.soles, _SWAY * foot):
                lean = (_SWAY - 1.0) * foot / com_height
                load = max(load, self._effort(side, torque, lean) / _SWAYING)
            self._settled(home)
        return load

    def _strides(self, home: np.ndarray, share: float) -> bool:
        """Return whether a share of the paper's stride is free from a posture."""
        com_height = self._com_height()
        for side in Side:
            ahead, behind = self.soles[side].copy(), self.soles[side.other].copy()
            ahead[0] += share * _AHEAD * com_height
            behind += com_height * np.array([-share * _BEHIND, 0.0, _LIFT])
            free = self._shifted({side: ahead, side.other: behind})
            bent = self._sigma(side)
            self._settled(home)
            if not free or bent < _STRAIGHT:
                return False
        return True

    def _shifted(self, soles: dict[Side, np.ndarray], com_y: float = 0.0) -> bool:
        """Move soles and CoM to other places [m], and return whether that is possible.

        The hips stay at their height; joints may go to the ends of their ranges.
        """
        kept, nearest = (self.low, self.high, self.soles), self.nearest
        self.low, self.high = _ranges(self.model, self.limbs.coupling, margin=0.0)
        self.soles, self.com[1] = soles, com_y
        lifted = 0.5 * sum(float(place[2]) for place in soles.values())
        found = self._stand(self._hips() - lifted)
        self.low, self.high, self.soles = kept
        self.com[1], self.nearest = 0.0, nearest
        return found is not None

    def _hips(self) -> float:
        """Return the mean height of the hips over the ankles [m]."""
        hips, ankles = self.data.xanchor[np.transpose(self.spans), 2]
        return float(np.mean(hips - ankles))

    def bend_legs(self, bend: float) -> np.ndarray:
        """Lower the body until the legs are far enough from being straight."""
        return self._lower(lambda: min(self._sigma(side) for side in Side) - bend)

    def lower_com(self, height: float) -> np.ndarray:
        """Lower the body until the CoM has a height [m]."""
        q = self._lower(lambda: height - self._com_height())
        reached = self._com_height()
        if abs(reached - height) > 1e-2 * self.length:
            raise ModelError(
                f"the legs cannot stand with the CoM {height:.3g} m above the soles, "
                f"nearest is {reached:.3g} m; change com_height under [stance]"
            )
        return q

    def _com_height(self) -> float:
        """Return the height of the CoM over the soles [m]."""
        return float(self.data.subtree_com[self.model.jnt_bodyid[0]][2])

    def _lower(self, surplus: Callable[[], float]) -> np.ndarray:
        """Lower the body until a surplus is positive, as near to zero as can be.

        If it never is, the posture with the largest surplus is returned.
        """
        self._pre_bend()
        start = self.q.copy()
        before, best = math.nan, (-math.inf, math.nan, self.q)
        for height in (np.linspace(*_HEIGHTS) * self.length).tolist():
            q = self._stand(height)
            if q is None:
                self.q[:] = start
                continue
            start = q
            if surplus() > best[0]:
                best = surplus(), height, q
            if best[0] >= 0.0:
                break
            before = height
        if best[0] == -math.inf:
            raise ModelError(self._why_not())
        if best[0] > 0.0 and math.isfinite(before):
            return self._refined(before, best[1], best[2], surplus)
        return self._settled(best[2])

    def _why_not(self) -> str:
        """Return why the legs cannot stand, by the attempt that came nearest."""
        look = Skeleton(self.model, self.data, "")
        for side in Side:
            if lacks := look.lacks(self.limbs.legs[side]):
                return f"it cannot stand: its {side} leg has {lacks}"
        self.q[:] = self.nearest[1]
        self._update()
        e = self._rows(0.0)[1][: len(_WHAT)]
        missed = {}
        for what, error in zip(_WHAT, np.abs(e).tolist(), strict=True):
            missed[what] = max(error, missed.get(what, 0.0))
        what = max(missed, key=lambda name: missed[name])
        legs = [j for side in Side for j in self.limbs.legs[side]]
        places = self.model.jnt_qposadr[legs]
        q, low, high = self.q[places], self.low[places - 7], self.high[places - 7]
        at_end = np.flatnonzero(np.minimum(q - low, high - q) <= 1e-6).tolist()
        ends = [f"{self.model.joint(legs[k]).name} at {q[k]:.3g} rad" for k in at_end]
        stuck = f"; at the end of their ranges: {', '.join(ends)}" if ends else ""
        return (
            f"it cannot stand on bent legs: {what} misses by {missed[what]:.2g} rad or "
            f"leg lengths{stuck}; give angles of the legs' joints by --profile, under "
            "[home], or wider ranges under [limits]"
        )

    def _refined(
        self, high: float, low: float, q: np.ndarray, surplus: Callable[[], float]
    ) -> np.ndarray:
        """Return the posture between two heights [m] at which a surplus is zero."""
        for _ in range(_HALVINGS):
            self.q[:] = q
            middle = 0.5 * (low + high)
            found = self._stand(middle)
            if found is not None and surplus() >= 0.0:
                low, q = middle, found
            else:
                high = middle
        return self._settled(q)

    def _settled(self, q: np.ndarray) -> np.ndarray:
        self.q[:] = q
        self._update()
        return q.copy()

    def put_down(self) -> np.ndarray:
        """Put the soles of legs whose angles are all known on the ground."""
        for _ in range(20):
            self._update()
            J, e = self._rows(0.0)
            self._move(np.arange(6), np.linalg.lstsq(J[:12, :6], e[:12], None)[0])
        self._update()
        height = min(self.data.site_xpos[self.limbs.soles[s]][2] for s in Side)
        self.q[2] -= float(height)
        return self._settled(self.q)

    def _effort(self, side: Side, torque: np.ndarray, lean: float = 0.0) -> float:
        """Return the largest share of a leg's torques that standing on it takes.

        The force acts on the sole's centre and leans to the left by `lean` [-].
        """
        m, d = self.model, self.data
        weight = float(m.body_subtreemass[m.jnt_bodyid[0]]) * abs(m.opt.gravity[2])
        mujoco.mj_forward(m, d)
        J = np.zeros((3, m.nv))
        mujoco.mj_jacSite(m, d, J, None, self.limbs.soles[side])
        needed = d.qfrc_bias - weight * (J[2] + lean * J[1])
        if self.limbs.coupling is not None:
            self.limbs.coupling.fold(needed)
        columns = m.jnt_dofadr[list(self.limbs.legs[side])]
        return float((np.abs(needed)[columns] / torque[columns - 6]).max())

    def _pre_bend(self) -> None:
        """Bend the knees the way that they bend, and hip and ankle against them.

        They bend as ours, unless the ranges allow it better the other way round.
        """
        look = Skeleton(self.model, self.data, "")
        for side in Side:
            bent = look.bent(self.limbs.legs[side])
            free = [(j, angle) for j, angle in bent if j not in self.fixed]
            if not free:
                continue
            turned, angles = zip(*free, strict=True)
            places = self.model.jnt_qposadr[list(turned)]
            low, high = self.low[places - 7], self.high[places - 7]
            ours = np.array(angles)
            ways = {way: np.clip(way * ours, low, high) for way in (1.0, -1.0)}
            missed = {way: np.abs(q - way * ours).sum() for way, q in ways.items()}
            self.q[places] = ways[-1.0 if missed[-1.0] < missed[1.0] - 1e-9 else 1.0]
        self._update()

    def _sigma(self, side: Side) -> float:
        """Return the smallest singular value of a leg's Jacobian."""
        J = self._jacobian(self.limbs.soles[side])
        J = J[:, self.model.jnt_dofadr[list(self.limbs.legs[side])]]
        J[:3] /= self.length
        if J.shape[1] != 6:
            return float(np.linalg.svd(J, compute_uv=False)[-1])
        return sigma_min(J)

    def _jacobian(self, site: int) -> np.ndarray:
        """Return the Jacobian of a site, world, (6, nv), followers in their leaders."""
        J = np.zeros((6, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, J[:3], J[3:], site)
        if self.limbs.coupling is not None:
            self.limbs.coupling.fold(J)
        return J

    def _stand(self, hip: float) -> np.ndarray | None:
        """Return the posture with the hips at a height [m] over the ankles, or None."""
        for _ in range(60):
            self._update()
            step = self._step(*self._rows(hip))
            self._move(self.free, step)
            if np.abs(step).max() < 1e-9:
                break
        self._update()
        e = np.abs(self._rows(hip)[1])
        missed = float((e if len(self.free) == 6 + 12 else e[_WEAK_ROWS]).max())
        if missed < self.nearest[0]:
            self.nearest = missed, self.q.copy()
        return self.q.copy() if missed < _CLOSE else None

    def _step(self, J: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Return the next step of the free coordinates towards e = 0.

        Joints that would leave their ranges are held, and the others step anew.
        """
        step, moving = np.zeros(len(self.free)), np.ones(len(self.free), dtype=bool)
        angles, low, high = (
            np.concatenate([np.zeros(6), x[self.free[6:] - 6]])
            for x in (self.q[7:], self.low, self.high)
        )
        low[:6], high[:6] = -math.inf, math.inf
        for _ in range(3):
            A = J[:, self.free[moving]]
            found = np.linalg.solve(A.T @ A + 1e-6 * np.eye(A.shape[1]), A.T @ e)
            step[:] = 0.0
            step[moving] = found
            stuck = (angles <= low) & (step < 0.0) | (angles >= high) & (step > 0.0)
            if not stuck.any():
                break
            moving &= ~stuck
        return step * min(1.0, 0.3 / max(np.abs(step[6:]).max(initial=0.0), 1e-12))

    def _move(self, columns: np.ndarray, step: np.ndarray) -> None:
        """Move some coordinates by a step, joints within their ranges."""
        v = np.zeros(self.model.nv)
        v[columns] = step
        mujoco.mj_integratePos(self.model, self.q, v, 1.0)
        moved = columns[columns >= 6] + 1
        ranges = self.low[moved - 7], self.high[moved - 7]
        self.q[moved] = np.clip(self.q[moved], *ranges)

    def _rows(self, hip: float) -> tuple[np.ndarray, np.ndarray]:
        """Return Jacobian and error of a standing posture, 18 rows.

        Poses of the soles, x and y of the CoM, the upright trunk, the hips' height;
        lengths in units of the leg's.
        """
        m, d, root = self.model, self.data, int(self.model.jnt_bodyid[0])
        J, e = np.zeros((18, m.nv)), np.zeros(18)
        for k, side in enumerate(Side):
            rows, site = slice(6 * k, 6 * k + 6), self.limbs.soles[side]
            J[rows] = self._jacobian(site)
            e[rows][:3] = self.soles[side] - d.site_xpos[site]
            e[rows][3:] = level_error(0.0, d.site_xmat[site].reshape(3, 3))
        J_com = np.zeros((3, m.nv))
        mujoco.mj_jacSubtreeCom(m, d, J_com, root)
        if self.limbs.coupling is not None:
            self.limbs.coupling.fold(J_com)
        J[12:14], e[12:14] = J_com[:2], self.com - d.subtree_com[root][:2]
        R = d.xmat[root].reshape(3, 3)
        J[14:17, 3:6], e[14:17] = R, level_error(0.0, R)
        J[17, 2], e[17] = 1.0, hip - self._hips()
        for rows in (slice(0, 3), slice(6, 9), slice(12, 14), slice(17, 18)):
            J[rows] /= self.length
            e[rows] /= self.length
        return J, e


def _ranges(
    model: mujoco.MjModel, coupling: Coupling | None, margin: float = _MARGIN[0]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the angles that a posture may have [rad]: joint limits, with a margin."""
    low, high = model.jnt_range[1:].T.copy()
    free = model.jnt_limited[1:] == 0
    low[free], high[free] = -math.inf, math.inf
    if coupling is not None:
        low, high, _ = coupling.limits(low, high, np.full(len(low), math.inf))
    kept = np.minimum(margin, _MARGIN[1] * (high - low))
    return low + kept, high - kept


def _unit(v: np.ndarray) -> np.ndarray:
    return v / max(float(np.linalg.norm(v)), 1e-9)
