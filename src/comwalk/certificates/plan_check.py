"""Feasibility of a plan before it moves: required over available, joint by joint.

The reference is followed without limits by the kinematic resolution; its angles, rates
and torques stand beside the robot's limits, and so do the reach of the legs, their
distance from singular postures, the ZMP of the whole body, and links that meet. A
demand fits up to its limit: there is no reserve for feedback, and none for the impact
of a foot on the ground, which no plan foresees.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ..control import Actuation
from ..embedding import EmbeddedMotion, scaled
from ..errors import MotionError, PlanError
from ..pattern import (
    Pattern,
    excerpt,
    make_pattern,
    polygon_margin,
    shortened,
    slowed,
    without_repeats,
)
from ..robot import CLEARANCE, LEGS, InverseDynamics, Kinematics, Robot, SelfCollision
from .reach import LEAST_STANCE, _period, _Sweep, _sweep, leg_reaches, stance_stiffness

PERIOD = 0.02
"""Time between samples of the reference [s]; less where steps are short."""

_COLLISION_PERIOD = 0.08  # [s]
_USUALLY = 0.95  # share of the time in which the ZMP must be over the soles


@dataclass(frozen=True, slots=True)
class Demand:
    """The most that a plan asks of one joint, leg or link in one respect."""

    what: str
    """The respect: "position", "speed", "torque", "reach", "stiffness", "singularity",
    "ZMP" or "self-collision"."""
    joint: str
    """The joint; or the leg, the sole or the links."""
    demanded: float
    """What is asked, in `unit`; of a ZMP, its distance from the middle of the sole."""
    limit: float
    """What there is, in `unit`; of a singularity and a collision, the least allowed."""
    unit: str
    """Unit of both."""
    share: float
    """How much of what there is is used [-]; above 1 the plan does not fit."""
    time: float
    """When [s]."""

    def __str__(self) -> str:
        """Say what is asked and what there is."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return f"at {self.time:.2f} s " + _SENTENCES[self.what].format(**values)


_SENTENCES = {
    **dict.fromkeys(
        ("position", "speed", "torque"),
        "{joint} needs a {what} of {demanded:.3g} {unit}, and its limit is {limit:.3g}",
    ),
    "reach": "the {joint} would have to be {demanded:.3f} m long, and {limit:.3f} m "
    "are there",
    "singularity": "the {joint} is as good as straight (smallest singular value "
    "{demanded:.3g} m/rad, at least {limit:.3g} is needed)",
    "stiffness": "the servos of the {joint}, hold the CoM with {limit:.0f} N/m, and a "
    "robot that walks by position needs {demanded:.0f} against gravity",
    "ZMP": "the ZMP is {demanded:.3f} m off the middle of the soles, and their edge is "
    "at {limit:.3f} m",
    "self-collision": "{joint} meet (distance {demanded:.3f} m)",
}


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Demands of a plan on a robot. Made by `feasibility`."""

    demands: tuple[Demand, ...]
    """All demands, the worst first."""

    @property
    def ok(self) -> bool:
        """Whether all demands are met."""
        return not self.demands or self.worst.share <= 1.0

    @property
    def worst(self) -> Demand:
        """The demand that uses the largest share of its limit."""
        return self.demands[0]

    def table(self, rows: int | None = None) -> str:
        """Return the demands as text, the worst first.

        Args:
            rows: How many; all if None.

        Returns:
            One line each.
        """
        return "\n".join(
            f"{d.share:7.0%}  {d.what:14} {d.joint:24} {d.demanded:9.3g} of "
            f"{d.limit:.3g} {d.unit} at {d.time:.2f} s"
            for d in self.demands[:rows]
        )


@dataclass(frozen=True, eq=False)
class Change:
    """One change by which a plan fits a robot."""

    text: str
    """What to change."""
    amount: float
    """Relative size of the change [-], above 0."""
    pattern: Pattern
    """The pattern that fits."""


def feasibility(
    robot: Robot,
    pattern: Pattern,
    motion: EmbeddedMotion | None = None,
    *,
    period: float = PERIOD,
    geometry: mujoco.MjSpec | None = None,
) -> Feasibility:
    """Return the demands of a pattern on a robot: required over available.

    Args:
        robot: The robot.
        pattern: What is to be walked.
        motion: Motion of the upper body, embedded.
        period: Time between samples [s]; less where steps are short.
        geometry: The robot with the geoms that may meet; those it has if None.

    Returns:
        The demands. If a leg cannot reach its footholds, nothing else is looked at; at
        the first singular posture the rest is left out.

    Raises:
        ModelError: If a leg has not six joints.
        PlanError: If the robot cannot even stand as the pattern begins.
    """
    reaches = _reach_demands(robot, pattern)
    if any(demand.share > 1.0 for demand in reaches):
        return Feasibility(_sorted(reaches))
    sweep = _sweep(robot, pattern, motion, _period(pattern, period))
    return Feasibility(
        _sorted(
            [
                *reaches,
                *_stiffness_demands(robot, pattern),
                *_joint_demands(robot, sweep),
                *_load_demands(robot, pattern, sweep),
                *_singularity_demands(robot, sweep),
                *_collision_demands(robot, sweep, geometry, motion),
            ]
        )
    )


def check_feasible(
    robot: Robot, pattern: Pattern, motion: EmbeddedMotion | None = None
) -> None:
    """Refuse a pattern that asks more of a robot than it has.

    Args:
        robot: The robot.
        pattern: What is to be walked.
        motion: Motion of the upper body, embedded.

    Raises:
        ModelError: If a leg has not six joints.
        PlanError: If it does not fit; names the worst demand, and changes by which it
            would.
    """
    if motion is None and _fits_easily(robot, pattern):
        return
    result = feasibility(robot, pattern, motion)
    if result.ok:
        return
    changes = nearest_plans(robot, pattern, motion, result.worst)
    complaint, what = _complaint(pattern, result.worst), advice(changes, result.worst)
    raise PlanError(f"{complaint}; {what}; --force walks it all the same")


_SETTLED = 7.0  # times omega_n: the CoM has forgotten what was before, to 0.1 %
_EASILY = 0.98  # share of the limits that a plan without its repeats may use
_ZMP_EASILY = 0.8  # the same of the ZMP's: how often it is off depends on the repeats


def _fits_easily(robot: Robot, pattern: Pattern) -> bool:
    """Return whether a plan fits, with each repeated step looked at once."""
    steps, omega = pattern.plan.steps, pattern.pendulum.omega
    times = [step.double_support + step.single_support for step in steps]
    keep = 2 * math.ceil(_SETTLED / (omega * min(times, default=1.0)))
    plan = without_repeats(pattern.plan, keep)
    if plan is pattern.plan:
        return False
    demands = feasibility(robot, make_pattern(plan, pattern.pendulum)).demands
    return all(
        demand.share <= (_ZMP_EASILY if demand.what == "ZMP" else _EASILY)
        for demand in demands
    )


def advice(changes: Sequence[Change], worst: Demand) -> str:
    """Return advice on one line.

    Args:
        changes: What `nearest_plans` found.
        worst: The worst demand.

    Returns:
        All changes, the smallest first.
    """
    if worst.what == "stiffness":
        return f"it would fit with servos {1.02 * worst.share:.2f} times as stiff"
    if not changes:
        return "no shorter, slower or lower plan, nor a smaller motion alone helps"
    return "it would fit with " + ", or ".join(change.text for change in changes)


def _complaint(pattern: Pattern, worst: Demand) -> str:
    if worst.what != "reach":
        return f"the robot is not able to do this: {worst}"
    step = f"footstep {pattern.at(worst.time).step + 1} is"
    return f"{step if pattern.plan.steps else 'the feet are'} out of reach: {worst}"


# ---- Plans that fit -----------------------------------------------------------------

_TRIALS = {
    "step": (5, 10, 20, 40, 70, 90),
    "time": (10, 20, 40, 80),
    "body": (2, 4, 8, 14),
}
"""Sizes of the changes that are tried first, in %."""

_MOTION_TRIALS = dict.fromkeys(("scale", "speed"), (5, 10, 20, 40, 60, 80))

_EXCERPT = 3  # footsteps before and after the worst moment that are looked at
_COARSE = 0.03  # [s]


def nearest_plans(
    robot: Robot,
    pattern: Pattern,
    motion: EmbeddedMotion | None = None,
    worst: Demand | None = None,
) -> tuple[Change, ...]:
    """Return plans near one that does not fit: shorter, slower, or with a lower body.

    A motion may be made smaller or slower instead. Each is the smallest change of its
    kind, to 1 %, by which some steps around the worst moment can be walked, with a stop
    after them; it is verified on the whole.

    Args:
        robot: The robot.
        pattern: What does not fit.
        motion: Motion of the upper body, embedded.
        worst: Its worst demand, if it is known.

    Returns:
        The changes by which it fits, the smallest first.
    """
    if worst is None:
        worst = feasibility(robot, pattern, motion).worst
    if worst.what == "stiffness":  # no plan makes servos stiffer
        return ()
    step = pattern.at(worst.time).step
    plan = excerpt(pattern.plan, step - _EXCERPT, step + _EXCERPT + 1)
    part = make_pattern(plan, pattern.pendulum)
    kinds = list(_TRIALS if pattern.plan.steps else ("body",))
    kinds += [] if motion is None else list(_MOTION_TRIALS)
    changes = [
        _smallest(kind, part, pattern, motion, lambda *x: _fits(robot, *x))
        for kind in kinds
    ]
    found = [change for change in changes if change is not None]
    return tuple(sorted(found, key=lambda change: change.amount))


def _smallest(
    kind: str,
    part: Pattern,
    whole: Pattern,
    motion: EmbeddedMotion | None,
    fits: Callable[[Pattern, EmbeddedMotion | None, float], bool],
) -> Change | None:
    """Return the smallest change of a kind by which a pattern fits."""

    def tried(base: Pattern, percent: int, period: float) -> Change | None:
        try:
            pattern, moves, text = _changed(base, motion, kind, percent)
        except (PlanError, MotionError):
            return None
        fit = fits(pattern, moves, period)
        return Change(text, 0.01 * percent, pattern) if fit else None

    low = 0
    for high in (_TRIALS | _MOTION_TRIALS)[kind]:
        if tried(part, high, _COARSE):
            break
        low = high
    else:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        helps = tried(part, middle, _COARSE)
        low, high = (low, middle) if helps else (middle, high)
    more = (tried(whole, high + extra, PERIOD) for extra in (0, 1, 3, 6))
    return next((change for change in more if change), None)


def _fits(
    robot: Robot, pattern: Pattern, motion: EmbeddedMotion | None, period: float
) -> bool:
    try:
        return feasibility(robot, pattern, motion, period=period).ok
    except PlanError:
        return False


def _changed(
    pattern: Pattern, motion: EmbeddedMotion | None, kind: str, percent: int
) -> tuple[Pattern, EmbeddedMotion | None, str]:
    """Return a pattern and a motion changed by some percent, and what was done."""
    plan, pendulum = pattern.plan, pattern.pendulum
    less, more = 1.0 - 0.01 * percent, 1.0 + 0.01 * percent
    if kind == "step":
        text = f"steps {less:.2f} times as long"
        return make_pattern(shortened(plan, less), pendulum), motion, text
    if kind == "time":
        text = f"{more:.2f} times the time for each step"
        return make_pattern(slowed(plan, more), pendulum), motion, text
    if kind in _MOTION_TRIALS and motion is not None:
        return _with_less(pattern, motion, kind, less)
    height = math.floor(1e3 * pendulum.height * less) / 1e3
    lower = dataclasses.replace(pendulum, height=height)
    return make_pattern(plan, lower), motion, f"pendulum.height {height:.3f} m"


def _with_less(
    pattern: Pattern, motion: EmbeddedMotion, kind: str, less: float
) -> tuple[Pattern, EmbeddedMotion, str]:
    """Return a motion made smaller or slower; who only stands does so for longer."""
    flag, plan = "motion-" if pattern.plan.steps else "", pattern.plan
    if kind == "scale":
        home = dict(zip(motion.joints, motion.home.tolist(), strict=True))
        clip = scaled(motion.motion, less, about=home)
        text = f"the motion {less:.2f} times as far (--{flag}scale)"
        return pattern, dataclasses.replace(motion, motion=clip), text
    stop = motion.stop
    if not plan.steps:
        plan = dataclasses.replace(plan, stand_time=plan.stand_time / less)
        pattern = make_pattern(plan, pattern.pendulum)
        stop = motion.start + (stop - motion.start) / less
    clip = scaled(motion.motion, speed=less)
    text = f"the motion {less:.2f} times as fast (--{flag}speed)"
    return pattern, dataclasses.replace(motion, motion=clip, stop=stop), text


# ---- Demands ------------------------------------------------------------------------


def _sorted(demands: Sequence[Demand]) -> tuple[Demand, ...]:
    return tuple(sorted(demands, key=lambda demand: -demand.share))


def _reach_demands(robot: Robot, pattern: Pattern) -> list[Demand]:
    return [
        Demand("reach", f"{side} leg", needed, length, "m", needed / length, time)
        for side, (needed, length, time) in leg_reaches(robot, pattern).items()
    ]


def _stiffness_demands(robot: Robot, pattern: Pattern) -> Iterator[Demand]:
    """Yield how stiffly a stance leg must hold the CoM, beside how stiffly it does."""
    if not pattern.plan.steps or robot.actuation is not Actuation.POSITION:
        return
    least = LEAST_STANCE * robot.mass * robot.gravity / robot.com_height
    for side, both in stance_stiffness(robot).items():
        for way, k in zip(("forward", "sideways"), both.tolist(), strict=True):
            where = f"{side} leg, {way}"
            yield Demand("stiffness", where, least, k, "N/m", least / k, 0.0)


def _joint_demands(robot: Robot, sweep: _Sweep) -> Iterator[Demand]:
    """Yield the largest use of each joint's speed, and of its range if it moves."""
    q, rates = sweep.configurations[:, 7:], np.abs(sweep.velocities[:, 6:])
    limits = zip(robot.lower.tolist(), robot.upper.tolist(), strict=True)
    for j, (name, (low, high)) in enumerate(zip(robot.joints, limits, strict=True)):
        if math.isfinite(high - low) and np.ptp(q[:, j]) > 1e-3:
            used = np.abs(2.0 * q[:, j] - low - high) / (high - low)
            k = int(np.argmax(used))
            angle, time = float(q[k, j]), float(sweep.times[k])
            limit = high if 2.0 * angle > low + high else low
            share = float(used[k])
            yield Demand("position", name, angle, limit, "rad", share, time)
        column = rates[:, j]
        yield from _largest("speed", name, column, robot.speed[j], "rad/s", sweep.times)


def _largest(
    what: str,
    name: str,
    values: np.ndarray,
    limit: float,
    unit: str,
    times: np.ndarray,
) -> Iterator[Demand]:
    """Yield the largest of some values beside its limit, if there is a limit."""
    if math.isfinite(limit) and len(values):
        k = int(np.argmax(values))
        value = float(values[k])
        share = value / limit if limit > 0.0 else math.inf
        yield Demand(what, name, value, float(limit), unit, share, float(times[k]))


def _load_demands(robot: Robot, pattern: Pattern, sweep: _Sweep) -> Iterator[Demand]:
    """Yield the largest torque of each joint, and how far the ZMP leaves the middle.

    Accelerations are differences of two neighbouring samples of the same phase, for the
    pattern's acceleration may jump from phase to phase; the resolution settles in the
    first of them, which is left out.
    """
    dynamics, kinematics = InverseDynamics(robot), Kinematics(robot, ())
    steps, same = np.diff(sweep.times), np.diff(sweep.phases) == 0
    inside = np.flatnonzero(same & np.append(True, same[:-1]))
    torques, offs = np.zeros((len(inside), len(robot.joints))), np.zeros(len(inside))
    half = 0.5 * min(pattern.plan.sole_size)
    hull, seen = np.zeros((0, 2)), -1
    for i, k in enumerate(inside.tolist()):
        v_0, v_1 = sweep.velocities[k : k + 2]
        dt, v = steps[k], 0.5 * (v_0 + v_1)
        q = kinematics.integrate(sweep.configurations[k], v, 0.5 * dt)
        load = dynamics.load(q, v, (v_1 - v_0) / dt, sweep.loads[k])
        if sweep.phases[k] != seen:
            seen = sweep.phases[k]
            hull = pattern.support_polygon(float(sweep.times[k] + 0.5 * dt))
        torques[i] = np.abs(load.torques)
        offs[i] = max(0.0, half - polygon_margin(hull, load.zmp))
    times = sweep.times[inside]
    for j, name in enumerate(robot.joints):
        yield from _largest(
            "torque", name, torques[:, j], robot.torque[j], "N m", times
        )
    if len(inside):
        k = int(np.argsort(offs)[round(_USUALLY * (len(offs) - 1))])
        off, share = float(offs[k]), float(offs[k]) / half
        yield Demand("ZMP", "sole", off, half, "m", share, float(times[k]))


def _singularity_demands(robot: Robot, sweep: _Sweep) -> Iterator[Demand]:
    """Yield how near the legs come to a singular posture."""
    least = robot.damping.threshold
    sigmas = np.linalg.svd(sweep.jacobians, compute_uv=False)[..., -1]
    for i, name in enumerate(x.name for x in robot.limbs if x.name in LEGS.values()):
        k = int(np.argmin(sigmas[:, i]))
        sigma, time = float(sigmas[k, i]), float(sweep.times[k])
        share = least / sigma if sigma > 0.0 else math.inf
        label = name.replace("_", " ")
        yield Demand("singularity", label, sigma, least, "m/rad", share, time)


def _collision_demands(
    robot: Robot,
    sweep: _Sweep,
    geometry: mujoco.MjSpec | None,
    motion: EmbeddedMotion | None,
) -> list[Demand]:
    """Return links that come near each other; arms that hang are told, not refused."""
    collision, worst = SelfCollision(robot, geometry), {}
    hanging = collision.arms if motion is None else frozenset()
    due = -math.inf
    for time, q in zip(sweep.times.tolist(), sweep.configurations, strict=True):
        if time < due:
            continue
        due = time + _COLLISION_PERIOD
        for links, distance in collision.distances(q).items():
            worst[links] = min((distance, time), worst.get(links, (math.inf, 0.0)))
    return [
        Demand("self-collision", links, d, 0.0, "m", min(1.0 - d / CLEARANCE, most), t)
        for links, (d, t) in worst.items()
        for most in (math.inf if hanging.isdisjoint(links.split(" and ")) else 1.0,)
    ]
