"""The pattern in plain objects and matrices: an oracle for the kernels.

It solves for all junctions at once by scipy; slow, and used by tests alone.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from comwalk.errors import ParameterError, PlanError, checked_number
from comwalk.pattern.footsteps import (
    Foothold,
    FootstepPlan,
    foot_poses,
    shortest_turn,
)
from comwalk.pattern.pendulum import Pendulum, zmp_of_motion
from comwalk.pattern.phases import MIN_MINJERK, START_SPEED
from comwalk.pattern.plans import excerpt
from comwalk.pattern.polygon import convex_hull, polygon_margin, rectangle
from comwalk.pattern.reference import (
    VERTICAL_SHARE,
    FootMotion,
    Phase,
    PhaseSpan,
    Reference,
    Samples,
    minimum_jerk,
)
from comwalk.sides import Side


class _Piece(NamedTuple):
    """One phase, ready for evaluation; pairs are values at its start and end."""

    start: float
    duration: float
    phase: Phase
    support: tuple[Side, Side]
    left_load: tuple[float, float]
    walking: tuple[float, float]
    step: int
    feet: tuple[FootMotion, FootMotion]  # left, right, at rest
    swing: tuple[Foothold, Foothold, float] | None  # start, end, height
    x: list[float]  # a_0 .. a_5, r_0, r_1 [m]
    y: list[float]


@dataclass(frozen=True, eq=False, repr=False)
class ReadablePattern:
    """The desired CoM, ZMP and feet of a footstep plan; made by `readable_pattern`."""

    plan: FootstepPlan
    """The footsteps."""

    pendulum: Pendulum
    """The simplified model that links CoM and ZMP."""

    _pieces: tuple[_Piece, ...]
    _heading: tuple[list[float], list[list[float]]]
    _starts: list[float] = field(init=False)
    _omega: float = field(init=False)

    def __post_init__(self) -> None:
        """Keep what every tick needs."""
        object.__setattr__(self, "_starts", [piece.start for piece in self._pieces])
        object.__setattr__(self, "_omega", self.pendulum.omega)

    def __repr__(self) -> str:
        """Name the size of the plan."""
        return f"ReadablePattern({self.plan.count} steps, {self.duration:g} s)"

    @property
    def duration(self) -> float:
        """Time from the first to the last moment of standing [s]."""
        return self._pieces[-1].start + self._pieces[-1].duration

    @cached_property
    def phases(self) -> tuple[PhaseSpan, ...]:
        """All phases in order."""
        return tuple(
            PhaseSpan(p.start, p.duration, p.phase, p.support[1]) for p in self._pieces
        )

    def at(self, time: float) -> Reference:
        """Return the reference at one time.

        Args:
            time: Time since the start of the plan [s]. Before it and after the end the
                robot stands. At a junction the later phase counts.

        Returns:
            CoM, ZMP, feet, heading and support, world.

        Raises:
            ParameterError: If the time is not a finite number.
        """
        piece, s = self._find(time)
        S, omega = piece.duration, self._omega
        c_x, v_x, a_x, p_x = _axis(piece.x, s, S, omega)
        c_y, v_y, a_y, p_y = _axis(piece.y, s, S, omega)
        tau = s / S if S > 0.0 else 0.0
        heading, heading_rate = self._heading_at(piece.start + s)
        left, right = piece.feet
        if piece.swing is not None:
            moving = swing_foot(*piece.swing, S, s)
            if piece.phase is Phase.SINGLE_RIGHT:
                left = moving
            else:
                right = moving
        return Reference(
            float(time),
            np.array((c_x, c_y, self.pendulum.height)),
            np.array((v_x, v_y, 0.0)),
            np.array((a_x, a_y, 0.0)),
            np.array((p_x, p_y)),
            piece.phase,
            piece.support[tau >= 0.5],
            _blend(piece.left_load, tau),
            heading,
            heading_rate,
            left,
            right,
            _blend(piece.walking, tau),
            piece.step,
        )

    def sample(self, times: np.ndarray | Sequence[float] | float) -> Samples:
        """Return the pattern at many times.

        Args:
            times: Times [s], as for `at`.

        Returns:
            One array per quantity, for plots.

        Raises:
            ParameterError: If there is no time, or one is not a finite number.
        """
        refs = [self.at(t) for t in np.ravel(times).tolist()]
        if not refs:
            raise ParameterError("times must hold at least one time [s], got none")
        return Samples(
            time=np.array([r.time for r in refs]),
            com=np.array([r.com for r in refs]),
            com_velocity=np.array([r.com_velocity for r in refs]),
            com_acceleration=np.array([r.com_acceleration for r in refs]),
            zmp=np.array([r.zmp for r in refs]),
            left=np.array([r.left.position for r in refs]),
            right=np.array([r.right.position for r in refs]),
            heading=np.array([r.heading for r in refs]),
            phase=np.array([int(r.phase) for r in refs]),
        )

    def support_polygon(self, time: float) -> np.ndarray:
        """Return the hull of the soles that are on the ground.

        Args:
            time: Time [s], as for `at`.

        Returns:
            Vertices [m], shape (k, 2), counter-clockwise, world.
        """
        return self._hull(self._find(time)[0])

    def hull_margin(self, times: np.ndarray | Sequence[float] | float) -> np.ndarray:
        """Return how deep the desired ZMP lies in the hull of the soles.

        Args:
            times: Times [s], as for `at`.

        Returns:
            Distance to the nearest edge [m], shape (k,): negative outside.
        """
        hulls: dict[int, np.ndarray] = {}
        margins = []
        for time in np.ravel(times).tolist():
            piece, s = self._find(time)
            if id(piece) not in hulls:
                hulls[id(piece)] = self._hull(piece)
            p = [
                _axis(a, s, piece.duration, self._omega)[3] for a in (piece.x, piece.y)
            ]
            margins.append(polygon_margin(hulls[id(piece)], p))
        return np.array(margins)

    def zmp_residual(self, times: np.ndarray | Sequence[float] | float) -> float:
        """Return how well ZMP and CoM fit together, Eqs. (1), (2) and (29).

        Args:
            times: Times [s], as for `at`.

        Returns:
            Largest abs(p - (c - cddot / omega_n^2)) [m]; 0 but for rounding.
        """
        samples = self.sample(times)
        p = zmp_of_motion(self.pendulum, samples.com, samples.com_acceleration)
        return float(np.abs(samples.zmp - p[:, :2]).max(initial=0.0))

    def continuity_residual(self) -> float:
        """Return the largest jump of the CoM [m] or its velocity [m/s].

        Returns:
            Largest difference at a junction of two phases; 0 but for rounding.
        """
        jump = 0.0
        for before, after in zip(self._pieces, self._pieces[1:], strict=False):
            for a, b in ((before.x, after.x), (before.y, after.y)):
                end = _axis(a, before.duration, before.duration, self._omega)
                begin = _axis(b, 0.0, after.duration, self._omega)
                jump = max(jump, abs(end[0] - begin[0]), abs(end[1] - begin[1]))
        return jump

    def _find(self, time: float) -> tuple[_Piece, float]:
        """Return the phase at a time, and the time since its start."""
        t = time if type(time) is float else checked_number("time", time, unit="s")
        if not math.isfinite(t):
            checked_number("time", t, unit="s")
        piece = self._pieces[max(bisect_right(self._starts, t) - 1, 0)]
        return piece, min(max(t - piece.start, 0.0), piece.duration)

    def _heading_at(self, t: float) -> tuple[float, float]:
        """Return the yaw of the trunk and its rate."""
        knots, cubics = self._heading
        k = min(max(bisect_right(knots, t) - 1, 0), len(cubics) - 1)
        s = min(max(t, knots[0]), knots[-1]) - knots[k]
        a, b, c, d = cubics[k]
        return ((a * s + b) * s + c) * s + d, (3.0 * a * s + 2.0 * b) * s + c

    def _hull(self, piece: _Piece) -> np.ndarray:
        """Return the hull of the soles on the ground in a phase."""
        left, right = (
            rectangle(*foot.position[:2], foot.yaw, self.plan.sole_size)
            for foot in piece.feet
        )
        if piece.phase is Phase.SINGLE_LEFT:
            return left
        if piece.phase is Phase.SINGLE_RIGHT:
            return right
        return convex_hull(np.concatenate([left, right]))


def _axis(
    curve: list[float], s: float, S: float, omega: float
) -> tuple[float, float, float, float]:
    r"""Return c, cdot, cddot and p of one axis of one phase.

    The hyperbolic part moves without ZMP, so p is that of the polynomial alone.

    Args:
        curve: a_0 .. a_5, r_0, r_1 [m].
        s: Time since the start of the phase [s].
        S: Duration of the phase [s].
        omega: Natural frequency [rad/s].
    """
    a_0, a_1, a_2, a_3, a_4, a_5, r_0, r_1 = curve
    if S <= 0.0:
        return a_0, 0.0, 0.0, a_0
    x = s / S
    q = a_0 + x * (a_1 + x * (a_2 + x * (a_3 + x * (a_4 + x * a_5))))
    dq = (a_1 + x * (2 * a_2 + x * (3 * a_3 + x * (4 * a_4 + x * 5 * a_5)))) / S
    ddq = (2 * a_2 + x * (6 * a_3 + x * (12 * a_4 + x * 20 * a_5))) / (S * S)
    p = q - ddq / (omega * omega)
    if r_0 == 0.0 and r_1 == 0.0:
        return q, dq, ddq, p
    scale = 1.0 / math.sinh(omega * S)
    u, v = omega * (S - s), omega * s
    r = (math.sinh(u) * r_0 + math.sinh(v) * r_1) * scale
    dr = (math.cosh(v) * r_1 - math.cosh(u) * r_0) * scale * omega
    return q + r, dq + dr, ddq + omega * omega * r, p


def _pose_of(foot: FootMotion) -> tuple[float, float, float]:
    """Return x [m], y [m], yaw [rad] of a foot."""
    return float(foot.position[0]), float(foot.position[1]), foot.yaw


def _blend(pair: tuple[float, float], tau: float) -> float:
    """Return a smooth value between the values at start and end of a phase."""
    begin, end = pair
    return begin if begin == end else begin + (end - begin) * minimum_jerk(tau)[0]


class _Links(NamedTuple):
    """End velocities of phases as functions of the CoM at both ends (c_0, c_1).

    v_1 = diagonal c_1 + off c_0 - load_1 and v_0 = load_0 - diagonal c_0 - off c_1.
    """

    diagonal: np.ndarray  # (k,) [1/s]
    off: np.ndarray  # (k,) [1/s]
    load_0: np.ndarray  # (k, 2) [m/s]
    load_1: np.ndarray  # (k, 2) [m/s]


class _Shape(NamedTuple):
    """A start from rest over a unit distance: polynomial, (r_0, r_1), end speed."""

    curve: np.ndarray  # (8,)
    kappa: float  # [1/s]


_MINJERK = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])


_BUMP = np.array([0.0, 0.0, 16.0, -32.0, 16.0, 0.0])


def readable_pattern(plan: FootstepPlan, pendulum: Pendulum) -> ReadablePattern:
    r"""Return the pattern of a plan: Eqs. (4)-(13) for any footsteps.

    It minimises, as the paper's pattern does for a regular walk,

    .. math:: \sum_{DS} \int \tfrac12 |\dot c|^2 dt
       + \sum_{SS} \int \tfrac12 |\dot c|^2 + \tfrac12 \omega_n^2 |c - p_k|^2 dt

    so that c is linear in double support, follows Eqs. (1), (2) with the ZMP at the
    stance foot in single support, and cdot is continuous. It starts and stops at rest
    in the middle of the feet. With the style "minjerk" the ZMP is smooth throughout.

    Where a footstep ends in a pause, it stops and starts in the same way.

    Args:
        plan: Footsteps with times.
        pendulum: Gives omega_n and c_z.

    Returns:
        The pattern, ready for `ReadablePattern.at`.

    Raises:
        PlanError: If a double support is too short for "minjerk".

    Example:
        >>> from comwalk.pattern import plan_steps
        >>> pattern = readable_pattern(plan_steps(Gait(), 4), Pendulum())
        >>> pattern.duration, round(float(pattern.at(99.0).com[0]), 6)
        (8.2, 0.8)
    """
    poses = foot_poses(plan)
    if not plan.steps:
        return _standing(plan, pendulum, poses)
    rows = []
    for first, last in _walks(plan):
        rows += _walk_rows(plan, poses, pendulum.omega, first, last)
    starts = accumulate((row[0] for row in rows), initial=0.0)
    pieces = tuple(_Piece(t, *row) for t, row in zip(starts, rows, strict=False))
    return ReadablePattern(plan, pendulum, pieces, _heading_curve(plan, pieces, poses))


def _standing(
    plan: FootstepPlan, pendulum: Pendulum, poses: np.ndarray
) -> ReadablePattern:
    """Return the pattern of a plan without steps."""
    left, right = (resting_foot(Foothold(*pose)) for pose in poses[0].tolist())
    curve = _still(poses[0, :, :2].mean(axis=0))
    piece = _Piece(
        0.0,
        2 * plan.stand_time,
        Phase.STAND,
        (Side.LEFT, Side.LEFT),
        (0.5, 0.5),
        (0.0, 0.0),
        0,
        (left, right),
        None,
        *curve.tolist(),
    )
    yaw = float(_mean_yaw(poses)[0])
    return ReadablePattern(
        plan, pendulum, (piece,), ([0.0, 1.0], [[0.0, 0.0, 0.0, yaw]])
    )


def _com_curves(plan: FootstepPlan, omega: float, poses: np.ndarray) -> np.ndarray:
    """Return a_0 .. a_5, r_0, r_1 of all phases from start to stop, (k, 2, 8)."""
    feet = _stances(plan, poses)
    c_0, c_f = poses[0, :, :2].mean(axis=0), poses[-1, :, :2].mean(axis=0)
    D, S = _durations(plan)
    zmps = np.concatenate([[c_0], feet, [c_f]])
    double = _double_zmp(plan, omega * D, zmps)
    single = np.zeros((len(S), 2, 6))
    single[:, :, 0] = feet
    begin = _start_shape(plan.double_support, omega, plan.start_time)
    end = _start_shape(plan.double_support, omega, plan.stop_time)
    if double is None:
        double_links = _linear_links(D)
    else:
        double_links = _lip_links(double, omega, D)
    links = _interleave(double_links, _lip_links(single, omega, S))
    u = _solve(links, begin.kappa, end.kappa, c_0, c_f)
    curves = np.empty((len(u) + 1, 2, 8))
    curves[0] = _scaled(begin.curve, c_0, u[0] - c_0)
    curves[-1] = _scaled(_reversed(end.curve), c_f, u[-1] - c_f)
    curves[1:-1:2] = (
        _linear(u[::2], u[1::2]) if double is None else _lip(double, u[::2], u[1::2])
    )
    curves[2:-1:2] = _lip(single, u[1:-1:2], u[2::2])
    return curves


def _stances(plan: FootstepPlan, poses: np.ndarray) -> np.ndarray:
    """Return the stance foot of each step [m], (n, 2)."""
    stance = [1 if step.side is Side.LEFT else 0 for step in plan.steps]
    return poses[np.arange(len(stance)), stance, :2]


def _durations(plan: FootstepPlan) -> tuple[np.ndarray, np.ndarray]:
    """Return durations of the n + 1 double and n single supports [s]."""
    D = [step.double_support for step in plan.steps]
    S = [step.single_support for step in plan.steps]
    return np.array([*D, D[-1]]), np.array(S)


def _double_zmp(
    plan: FootstepPlan, angle: np.ndarray, zmps: np.ndarray
) -> np.ndarray | None:
    """Return the ZMP polynomials of "minjerk" double supports as particular CoMs."""
    if plan.double_support == "paper":
        return None
    k = int(np.argmin(angle))
    if angle[k] < MIN_MINJERK:
        least = MIN_MINJERK / angle[k]
        raise PlanError(
            f"double support before footstep {min(k, len(plan.steps) - 1) + 1} is too "
            f'short for double_support = "minjerk": make it {least:.3g} times longer, '
            'or use "paper"'
        )
    p = zmps[:-1, :, None] * np.eye(6)[0] + np.diff(zmps, axis=0)[:, :, None] * _MINJERK
    return _particular(p, angle)


def _particular(p: np.ndarray, angle: np.ndarray) -> np.ndarray:
    r"""Return the polynomial CoM that belongs to a polynomial ZMP.

    .. math:: c_p = \sum_j p^{(2j)} / \omega_n^{2j}

    Args:
        p: Coefficients of the ZMP [m] over t/S, shape (k, 2, 6).
        angle: omega_n S, shape (k,).

    Returns:
        Coefficients of c_p [m], shape (k, 2, 6).
    """
    total, term = p.copy(), p
    factor = np.array([2.0, 6.0, 12.0, 20.0])
    for _ in range(2):
        term = np.concatenate([term[..., 2:] * factor, np.zeros((*p.shape[:2], 2))], -1)
        term = term / angle[:, None, None] ** 2
        total = total + term
    return total


def _linear_links(D: np.ndarray) -> _Links:
    """Return the links of linear CoM: v_0 = v_1 = (c_1 - c_0) / D."""
    zero = np.zeros((len(D), 2))
    return _Links(1 / D, -1 / D, zero, zero)


def _lip_links(q: np.ndarray, omega: float, S: np.ndarray) -> _Links:
    """Return the links of the pendulum, Eq. (3), with a particular CoM q."""
    coth, csch = 1 / np.tanh(omega * S), 1 / np.sinh(omega * S)
    q_0, q_1 = q[..., 0], q.sum(axis=-1)
    dq_0 = q[..., 1] / S[:, None]
    dq_1 = q @ np.arange(6.0) / S[:, None]
    a, b = omega * coth[:, None], omega * csch[:, None]
    load_0, load_1 = dq_0 + a * q_0 - b * q_1, -dq_1 + a * q_1 - b * q_0
    return _Links(omega * coth, -omega * csch, load_0, load_1)


def _interleave(double: _Links, single: _Links) -> _Links:
    """Return links in the order double, single, ..., double."""
    mixed = []
    for a, b in zip(double, single, strict=True):
        both = np.empty((len(a) + len(b), *a.shape[1:]))
        both[::2], both[1::2] = a, b
        mixed.append(both)
    return _Links(*mixed)


def _solve(
    links: _Links, kappa_0: float, kappa_f: float, c_0: np.ndarray, c_f: np.ndarray
) -> np.ndarray:
    """Return the CoM at the junctions [m], (k, 2), from continuous velocity.

    The start and the stop give v = kappa (u - c) at the ends (Robin rows).
    """
    from scipy.linalg import solveh_banded

    k = len(links.diagonal) + 1
    bands, load = np.zeros((2, k)), np.zeros((k, 2))
    bands[1, :-1] += links.diagonal
    bands[1, 1:] += links.diagonal
    bands[0, 1:] = links.off
    load[:-1] += links.load_0
    load[1:] += links.load_1
    bands[1, 0] += kappa_0
    bands[1, -1] += kappa_f
    load[0] += kappa_0 * c_0
    load[-1] += kappa_f * c_f
    return solveh_banded(bands, load, check_finite=False)


def _start_shape(style: str, omega: float, T_0: float) -> _Shape:
    """Return how the CoM goes a unit distance from rest in the time T_0.

    "paper": a quintic that ends without acceleration; the ZMP is continuous. "minjerk":
    the pendulum with a ZMP that swings back and returns to its place.
    """
    if style == "paper":
        eta = START_SPEED
        quintic = [0.0, 0.0, 0.0, 10 - 4 * eta, 7 * eta - 15, 6 - 3 * eta, 0.0, 0.0]
        return _Shape(np.array(quintic), eta / T_0)
    angle = omega * T_0
    q = -_particular(np.broadcast_to(_BUMP, (1, 2, 6)), np.array([angle]))[0, 0]
    r_0 = -q[0]
    r_1 = math.cosh(angle) * r_0 - math.sinh(angle) * q[1] / angle
    distance = q.sum() + r_1
    speed = q @ np.arange(6.0) / T_0 + omega * (
        r_1 / math.tanh(angle) - r_0 / math.sinh(angle)
    )
    return _Shape(np.array([*q, r_0, r_1]) / distance, float(speed / distance))


def _scaled(curve: np.ndarray, origin: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return a unit curve put at an origin over a way, both axes, (2, 8)."""
    both = way[:, None] * curve
    both[:, 0] += origin
    return both


def _reversed(curve: np.ndarray) -> np.ndarray:
    """Return a curve that runs backward in time."""
    power = [[math.comb(j, i) * (-1.0) ** i for j in range(6)] for i in range(6)]
    return np.array([*(np.array(power) @ curve[:6]), curve[7], curve[6]])


def _linear(c_0: np.ndarray, c_1: np.ndarray) -> np.ndarray:
    """Return straight curves between CoMs (k, 2)."""
    curves = np.zeros((*c_0.shape, 8))
    curves[..., 0], curves[..., 1] = c_0, c_1 - c_0
    return curves


def _lip(q: np.ndarray, c_0: np.ndarray, c_1: np.ndarray) -> np.ndarray:
    """Return curves of the pendulum between CoMs (k, 2) with a particular CoM q."""
    r_0, r_1 = c_0 - q[..., 0], c_1 - q.sum(axis=-1)
    return np.concatenate([q, r_0[..., None], r_1[..., None]], axis=-1)


def _still(c: np.ndarray) -> np.ndarray:
    """Return the curve of a CoM at rest, (2, 8)."""
    return _linear(c, c)


def _walks(plan: FootstepPlan) -> list[tuple[int, int]]:
    """Return the first step of each walk between pauses, and the one after its last."""
    rests = [k for k, step in enumerate(plan.steps[:-1], 1) if step.stand is not None]
    return list(pairwise([0, *rests, len(plan.steps)]))


def _walk_rows(
    plan: FootstepPlan, poses: np.ndarray, omega: float, first: int, last: int
) -> list[tuple]:
    """Return the fields of `_Piece` but its start, of the phases of one walk, in order.

    They begin with the pause before it, and the last walk ends with standing.
    """
    walk, poses = excerpt(plan, first, last), poses[first : last + 1]
    curves = _com_curves(walk, omega, poses)
    still = _still(poses[[0, -1], :, :2].mean(axis=1))
    numbers = [still[0].tolist(), *curves.tolist(), still[1].tolist()]
    pause = plan.steps[first - 1].stand if first else plan.stand_time
    rows = _phase_rows(walk, poses, first)
    rows[0] = (pause, *rows[0][1:])
    whole = [(*row, *axes) for row, axes in zip(rows, numbers, strict=True)]
    return whole if last == len(plan.steps) else whole[:-1]


def _phase_rows(plan: FootstepPlan, poses: np.ndarray, landed: int = 0) -> list[tuple]:
    """Return the fields of `_Piece` from its duration to its swing, in order.

    Args:
        plan: A plan without pauses.
        poses: Both feet before the first step and after each one.
        landed: Number of footsteps that landed before.
    """
    holds = [[Foothold(*foot) for foot in pair] for pair in poses.tolist()]
    feet = [(resting_foot(left), resting_foot(right)) for left, right in holds]
    stances = [step.side.other for step in plan.steps]
    base = [stances[0], *stances, stances[-1]]
    load = [0.5, *(1.0 if side is Side.LEFT else 0.0 for side in stances), 0.5]
    D, S = (times.tolist() for times in _durations(plan))
    n, walk, half = len(stances), (1.0, 1.0), (0.5, 0.5)

    def ends(values: list, k: int) -> tuple:
        return values[k], values[k + 1]

    def still(time: float, phase: Phase, k: int, blend: tuple) -> tuple:
        sides = (base[k], base[k])
        return time, phase, sides, half, blend, landed + k, feet[k], None

    def double(k: int) -> tuple:
        sides, loads = ends(base, k), ends(load, k)
        step = landed + k
        return D[k], Phase.DOUBLE, sides, loads, walk, step, feet[k], None

    def single(k: int) -> tuple:
        side, left = stances[k], load[k + 1]
        i = 1 if side is Side.LEFT else 0
        swing = holds[k][i], holds[k + 1][i], plan.steps[k].swing_height
        phase = Phase.SINGLE_LEFT if side is Side.LEFT else Phase.SINGLE_RIGHT
        sides, loads, step = (side, side), (left, left), landed + k
        return S[k], phase, sides, loads, walk, step, feet[k], swing

    return [
        still(plan.stand_time, Phase.STAND, 0, (0.0, 0.0)),
        still(plan.start_time, Phase.START, 0, (0.0, 1.0)),
        *(row for k in range(n) for row in (double(k), single(k))),
        double(n),
        still(plan.stop_time, Phase.STOP, n, (1.0, 0.0)),
        still(plan.stand_time, Phase.STAND, n, (0.0, 0.0)),
    ]


def _heading_curve(
    plan: FootstepPlan, pieces: tuple[_Piece, ...], poses: np.ndarray
) -> tuple[list[float], list[list[float]]]:
    """Return knots [s] and cubics of the heading: the mean of the feet when one lands.

    The cubics are monotone between knots (PCHIP), and still where the robot rests.
    """
    yaw, knots, cubics = _mean_yaw(poses), [], []
    rests = [k for k, piece in enumerate(pieces) if piece.phase is Phase.STAND]
    for (i, j), (first, last) in zip(pairwise(rests), _walks(plan), strict=True):
        landings = [piece.start for piece in pieces[i + 4 : j - 1 : 2]]
        if knots:
            cubics.append([0.0, 0.0, 0.0, float(yaw[first])])
        starts = [pieces[i + 1].start, pieces[i + 2].start]
        own = [*starts, *landings, pieces[j].start]
        angles = [yaw[first], *yaw[first : last + 1], yaw[last]]
        cubics += _monotone_cubics(own, angles)
        knots += own
    return knots, cubics


def _monotone_cubics(times: list[float], angles: list[float]) -> list[list[float]]:
    """Return the cubics between angles [rad] that never overshoot (PCHIP)."""
    if min(angles) == max(angles):
        return [[0.0, 0.0, 0.0, float(angles[0])]] * (len(angles) - 1)
    from scipy.interpolate import PchipInterpolator

    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        # A denormal turn overflows in its slopes' harmonic mean, which is 0 then.
        return PchipInterpolator(times, angles).c.T.tolist()


def _mean_yaw(poses: np.ndarray) -> np.ndarray:
    """Return the mean heading of both feet [rad], (n + 1,), without jumps."""
    left, right = poses[:, 0, 2], poses[:, 1, 2]
    turn = np.remainder(right - left + np.pi, 2 * np.pi) - np.pi
    return np.unwrap(left + turn / 2)


def resting_foot(foothold: Foothold) -> FootMotion:
    """Return a foot that stands still on the ground.

    Args:
        foothold: Where it stands.

    Returns:
        Its pose and zero velocity, as read-only arrays that may be shared.
    """
    position, velocity = np.array([foothold.x, foothold.y, 0.0]), np.zeros(3)
    position.setflags(write=False)
    velocity.setflags(write=False)
    return FootMotion(position, foothold.yaw, velocity, 0.0)


def swing_foot(
    start: Foothold, end: Foothold, height: float, duration: float, time: float
) -> FootMotion:
    r"""Return where the swing foot is and how it moves.

    .. math:: z = 64\, h_{max} s^3 (1-s)^3, \quad s = t / S

    and x, y, yaw by `minimum_jerk` over the middle 96 % of the swing; the yaw turns
    the short way. The path is twice continuously differentiable.

    Args:
        start: Foothold at lift-off.
        end: Foothold at landing.
        height: Clearance in the middle of the swing [m].
        duration: Duration of the swing S [s], > 0.
        time: Time since lift-off t [s]; held at 0 and S outside.

    Returns:
        Pose and velocity of the centre of the sole, world.

    Raises:
        ParameterError: If the time or the height is not finite, or the duration is
            not positive.

    Example:
        >>> foot = swing_foot(Foothold(0, 0), Foothold(0.4, 0), 0.04, 0.8, 0.4)
        >>> foot.position.round(6).tolist()
        [0.2, 0.0, 0.04]
    """
    s = min(max(time / duration, 0.0), 1.0)
    middle = 1.0 - 2.0 * VERTICAL_SHARE
    h, dh = minimum_jerk((s - VERTICAL_SHARE) / middle)
    dh /= middle * duration
    bow = s * (1.0 - s)
    z, dz = 64.0 * bow**3, 192.0 * bow * bow * (1.0 - 2.0 * s) / duration
    dx, dy = end.x - start.x, end.y - start.y
    turn = shortest_turn(start.yaw, end.yaw)
    position = np.array([start.x + h * dx, start.y + h * dy, height * z])
    velocity = np.array([dh * dx, dh * dy, height * dz])
    return FootMotion(position, start.yaw + h * turn, velocity, dh * turn)
