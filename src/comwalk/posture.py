"""A posture to walk from, found for any humanoid: bent legs, hanging arms.

The legs are bent until they are as far from their singular posture, by the smallest
singular value of their Jacobians, as those of the paper's robot; soles level and
parallel, the trunk upright, the CoM over the middle of the soles. The arms hang a
little away from the body, with bent elbows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import least_squares

from .anatomy import middle_joint
from .errors import ModelError
from .footsteps import Side
from .resolution import sigma_min
from .spatial import level_error

BEND = 0.18
"""Smallest singular value of a leg's Jacobian to walk with [rad], lengths taken in
units of the leg's length; that of the paper's robot."""

LEAST_BEND = 0.12
"""The least that it may be where joints are too weak for more."""

_EFFORT = 2.0 / 3.0  # share of the leg's torques that standing on one foot may take
_HEIGHTS = 0.98, 0.55, 44  # hips over ankles, in lengths of the leg, in steps

LEAST_GAP = 0.02
"""Smallest distance between the soles of a standing robot [m]."""


@dataclass(frozen=True, eq=False)
class Limbs:
    """What a posture is sought for: joints as indices into the model's."""

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


def find_posture(
    model: mujoco.MjModel,
    limbs: Limbs,
    given: Mapping[str, float] | None = None,
    torque: np.ndarray | None = None,
    bend: float | None = None,
    half_width: float | None = None,
) -> np.ndarray:
    """Return a posture to walk from.

    Args:
        model: The compiled model, x forward.
        limbs: Its limbs.
        given: Angles that are known [rad], by joint; the others are found.
        torque: Torque limits of the joints [N m], of shape (joints,); where bent legs
            would need more than two thirds of them on one foot, the legs are
            stretched, down to `LEAST_BEND`.
        bend: How far the legs stay from their singular posture; `BEND`, or what the
            torques allow, if None.
        half_width: Half of the distance between the soles' centres [m]; that of the
            zero posture if None, but never so that the soles meet.

    Returns:
        MuJoCo's qpos: the soles on the plane z = 0, (0, 0) in their middle.

    Raises:
        ModelError: If the legs cannot stand so.
    """
    seeker = _Seeker(model, limbs, given or {}, half_width)
    seeker.hang_arms()
    if bend is not None or torque is None:
        return seeker.bend_legs(BEND if bend is None else bend)
    for bend in np.linspace(BEND, LEAST_BEND, 7):
        q = seeker.bend_legs(float(bend))
        if seeker.effort(torque) <= _EFFORT:
            break
    return q


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
        low, high = model.jnt_range[1:].T.copy()
        free = model.jnt_limited[1:] == 0
        low[free], high[free] = -math.inf, math.inf
        margin = np.minimum(0.05, 0.2 * (high - low))
        self.low, self.high = low + margin, high - margin
        self.q = np.zeros(model.nq)
        self.q[3] = 1.0
        self.q[7:] = np.clip(0.0, self.low, self.high)
        self.fixed = {model.joint(name).id for name in given}
        for name, angle in given.items():
            self.q[model.joint(name).qposadr[0]] = angle
        self._update()
        self.half_width = self._spacing() if half_width is None else half_width

    def _update(self) -> None:
        """Compute the kinematics of the present posture."""
        self.data.qpos[:] = self.q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def _spacing(self) -> float:
        """Return half of the distance of the soles as the hips have it [m]."""
        left, right = (self.data.site_xpos[self.limbs.soles[s]][1] for s in Side)
        width = max(self.limbs.widths.values())
        return max(0.5 * float(left - right), 0.5 * (width + LEAST_GAP))

    # ---- Arms ----

    def hang_arms(self) -> None:
        """Let the arms hang."""
        for side, joints in self.limbs.arms.items():
            elbow = self._elbow(joints, self.limbs.hands[side])
            free = [j for j in joints if j <= elbow and j not in self.fixed]
            if free:
                self._hang(side, free, joints[0], elbow)
        self._update()

    def _hang(
        self, side: Side, joints: Sequence[int], first: int, elbow: int
    ) -> None:
        """Let one arm hang: upper arm down and out, forearm down and forward."""
        places = np.array([self.model.jnt_qposadr[j] for j in joints])
        columns = places - 7
        low, high = self.low[columns], self.high[columns]
        hand, start = self.limbs.hands[side], self.q[places].copy()

        def miss(angles: np.ndarray) -> np.ndarray:
            self.q[places] = angles
            self._update()
            shoulder = self.data.xanchor[first]
            bend, tip = self.data.xanchor[elbow], self.data.site_xpos[hand]
            upper = _unit(bend - shoulder) - _unit([0.05, 0.25 * side.sign, -1.0])
            fore = _unit(tip - bend) - _unit([0.45, 0.05 * side.sign, -1.0])
            return np.concatenate([upper, fore, 0.03 * (angles - start)])

        best = None
        for twist in (0.0, 0.3, -0.3):
            guess = np.clip(start + twist, low + 1e-6, high - 1e-6)
            found = least_squares(miss, guess, bounds=(low, high), xtol=1e-8)
            if best is None or found.cost < best.cost - 1e-9:
                best = found
        self.q[places] = best.x

    def _elbow(self, joints: Sequence[int], hand: int) -> int:
        """Return the joint between upper arm and forearm."""
        tip = self.data.site_xpos[hand]
        rows = list(joints)
        return rows[middle_joint(self.data.xanchor[rows], self.data.xaxis[rows], tip)]

    # ---- Legs ----

    def bend_legs(self, bend: float) -> np.ndarray:
        """Lower the body until the legs are far enough from being straight."""
        length = self._leg_length()
        self._pre_bend()
        found: list[tuple[float, np.ndarray]] = []
        for height in np.linspace(*_HEIGHTS) * length:
            q = self._stand(height)
            if q is not None:
                found.append((height, q))
                if self._bend(length) >= bend:
                    break
        if not found:
            raise ModelError(
                "no posture was found in which both soles are level on the ground; "
                "give angles of the legs' joints by --profile, under [home]"
            )
        high = found[-2][0] if len(found) > 1 else found[-1][0]
        return self._refined(high, *found[-1], bend, length)

    def effort(self, torque: np.ndarray) -> float:
        """Return the largest share of a leg's torques that standing on one foot takes.

        Args:
            torque: Torque limits [N m], of shape (joints,).

        Returns:
            The share; the force is that of the whole weight through the sole's centre.
        """
        m, d = self.model, self.data
        weight = float(m.body_subtreemass[m.jnt_bodyid[0]]) * abs(m.opt.gravity[2])
        mujoco.mj_forward(m, d)
        shares = [0.0]
        for side in Side:
            J = np.zeros((3, m.nv))
            mujoco.mj_jacSite(m, d, J, None, self.limbs.soles[side])
            columns = m.jnt_dofadr[list(self.limbs.legs[side])]
            needed = np.abs(d.qfrc_bias - weight * J[2])[columns]
            shares.append(float((needed / torque[columns - 6]).max()))
        return max(shares)

    def _refined(
        self, high: float, low: float, q: np.ndarray, bend: float, length: float
    ) -> np.ndarray:
        """Return the posture between two heights [m] that has the wanted bend."""
        best = q
        for _ in range(8):
            self.q[:] = best
            found = self._stand(0.5 * (low + high))
            if found is not None and self._bend(length) >= bend:
                low, best = 0.5 * (low + high), found
            else:
                high = 0.5 * (low + high)
        return best

    def _bend(self, length: float) -> float:
        """Return how far the legs are from being straight."""
        return min(self._sigma(side, length) for side in Side)

    def _leg_length(self) -> float:
        """Return the length of the stretched leg, hip to ankle [m]."""
        lengths = []
        for side in Side:
            anchors = self.data.xanchor[list(self.limbs.legs[side])]
            knee = self._knee(side)
            hip, ankle = anchors[0], anchors[-1]
            middle = self.data.xanchor[knee]
            lengths.append(
                np.linalg.norm(middle - hip) + np.linalg.norm(ankle - middle)
            )
        return float(min(lengths))

    def _knee(self, side: Side) -> int:
        """Return the joint between thigh and shank."""
        joints = list(self.limbs.legs[side])
        anchors = self.data.xanchor[joints]
        return joints[middle_joint(anchors, self.data.xaxis[joints], anchors[-1])]

    def _pre_bend(self) -> None:
        """Bend the knees the way that they bend, and hip and ankle against them."""
        for side in Side:
            joints = list(self.limbs.legs[side])
            knee = self._knee(side)
            pitch = [j for j in joints if abs(self.data.xaxis[j][1]) > 0.7]
            hips = [j for j in pitch if j < knee]
            ankles = [j for j in pitch if j > knee]
            for j, angle in [
                *((j, -0.35) for j in hips[-1:]),
                (knee, 0.7),
                *((j, -0.35) for j in ankles[:1]),
            ]:
                if j in self.fixed:
                    continue
                sign = math.copysign(1.0, self.data.xaxis[j][1])
                place = int(self.model.jnt_qposadr[j])
                k = place - 7
                self.q[place] = np.clip(sign * angle, self.low[k], self.high[k])
        self._update()

    def _sigma(self, side: Side, length: float) -> float:
        """Return how far a leg is from its singular postures."""
        J = np.zeros((6, self.model.nv))
        mujoco.mj_jacSite(
            self.model, self.data, J[:3], J[3:], self.limbs.soles[side]
        )
        columns = self.model.jnt_dofadr[list(self.limbs.legs[side])]
        J = J[:, columns]
        J[:3] /= length
        if J.shape[1] < 6:
            return float(np.linalg.svd(J, compute_uv=False)[-1])
        return sigma_min(J)

    def _stand(self, hip: float) -> np.ndarray | None:
        """Return the posture with the hips at a height over the ankles, or None."""
        columns = np.concatenate([self.model.jnt_dofadr[list(self.limbs.legs[s])] for s in Side])
        free = np.concatenate([np.arange(6), columns])
        for _ in range(60):
            self._update()
            J, e = self._rows(hip)
            lam = 1e-3
            step = np.linalg.solve(
                J[:, free].T @ J[:, free] + lam**2 * np.eye(len(free)),
                J[:, free].T @ e,
            )
            step *= min(1.0, 0.3 / max(np.abs(step[6:]).max(), 1e-12))
            v = np.zeros(self.model.nv)
            v[free] = step
            mujoco.mj_integratePos(self.model, self.q, v, 1.0)
            np.clip(self.q[7:], self.low, self.high, out=self.q[7:])
            if np.abs(step).max() < 1e-9:
                break
        self._update()
        _, e = self._rows(hip)
        tight = e if len(columns) == 12 else e[_WEAK_ROWS]
        return self.q.copy() if np.abs(tight).max() < 1e-4 else None

    def _rows(self, hip: float) -> tuple[np.ndarray, np.ndarray]:
        """Return Jacobian and error of a standing posture, 18 rows."""
        m, d = self.model, self.data
        J, e = np.zeros((18, m.nv)), np.zeros(18)
        for k, side in enumerate(Side):
            rows = slice(6 * k, 6 * k + 6)
            site = self.limbs.soles[side]
            mujoco.mj_jacSite(m, d, J[rows][:3], J[rows][3:], site)
            place = np.array([0.0, side.sign * self.half_width, 0.0])
            e[rows][:3] = place - d.site_xpos[site]
            e[rows][3:] = level_error(0.0, d.site_xmat[site].reshape(3, 3))
        root = int(m.jnt_bodyid[0])
        J_com = np.zeros((3, m.nv))
        mujoco.mj_jacSubtreeCom(m, d, J_com, root)
        J[12:14], e[12:14] = J_com[:2], -d.subtree_com[root][:2]
        R = d.xmat[root].reshape(3, 3)
        J[14:17, 3:6] = R
        e[14:17] = level_error(0.0, R)
        above = [
            d.xanchor[self.limbs.legs[s][0]][2] - d.xanchor[self.limbs.legs[s][-1]][2]
            for s in Side
        ]
        J[17, 2], e[17] = 1.0, hip - float(np.mean(above))
        return J, e


_WEAK_ROWS = [2, 8, 12, 17]  # what a leg of fewer joints must still reach


def _unit(v) -> np.ndarray:
    """Return a vector of length 1."""
    v = np.asarray(v, dtype=float)
    return v / max(float(np.linalg.norm(v)), 1e-9)
