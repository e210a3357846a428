r"""Embedded joint-space motions of section VI (Fig. 5): dances, clips and their blends.

A `Motion` is a recording: joint angles at given times, joined by a cubic spline of
class C2. `embed_in` blends it in and out of the robot's home posture,

.. math:: q(t) = q_{home} + w(t) (q_{motion}(t - t_{start}) - q_{home}),

with a minimum-jerk weight w, so that angles and rates are continuous and the legs,
which carry the CoM of Eqs. (25)-(27), never see a jump of the embedded motion.

Motions come from `dances` or from `motion_files`. `prepare_motion` checks one against a
robot before anything moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..compiled import records
from ..errors import MotionError, checked_number, nearest
from .motion_playing import DANCE, find_weight, play

_SHORTEST_STEP = 1e-6
"""Smallest time between two samples [s]."""
_LARGEST_ANGLE = 1e4
"""Largest angle that a recording may hold [rad]; more is not an angle."""
_SEAM = 1e-6
"""Largest mismatch between the ends of a looping motion [rad]."""
_TOLERANCE = 1e-9
"""Relative slack of the limit checks."""


# ---- The recording ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Motion:
    """A joint-space motion: samples joined by a cubic spline of class C2 (final).

    A looping motion uses a periodic spline, so that it repeats without a seam. Any
    other motion starts and ends at rest (clamped spline) and holds its first and last
    posture before and after, so that its rates are continuous there too. Two samples
    are thus a smooth move from one to the other; a recording that is cut while moving
    is bent within its first and last few samples, where the blend weighs little.

    Raises:
        MotionError: If names, times and positions do not make a motion.
    """

    name: str
    """What the motion is called in messages and logs."""
    joints: tuple[str, ...]
    """Names of the m joints, in the order of the columns of `positions`."""
    times: np.ndarray
    """Sample times [s], of shape (n,), strictly increasing from 0, n >= 2."""
    positions: np.ndarray
    """Absolute joint angles [rad], of shape (n, m)."""
    loops: bool = False
    """Whether it repeats after `times[-1]`; the last sample then equals the first."""
    whole_body: bool = False
    """Whether it records the whole body, whose legs are left to the walking."""
    repairs: tuple[str, ...] = ()
    """What was changed so that a robot can play it, a phrase each."""
    dropped: tuple[str, ...] = ()
    """Names of the recorded joints which `select` or `renamed` took out."""
    _segments: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the samples and fit the spline."""
        from scipy.interpolate import CubicSpline

        if not _is_word(self.name):
            raise MotionError(f"name must be printable text, got {self.name!r}")
        joints = _checked_joints(self.name, self.joints)
        times = _checked_times(self.name, self.times)
        positions = _checked_positions(self.name, self.positions, times, joints)
        if self.loops:
            positions = _closed(self.name, positions, joints)
        ends = "periodic" if self.loops else "clamped"
        spline = CubicSpline(times, positions, bc_type=ends)
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "times", _frozen(times))
        object.__setattr__(self, "positions", _frozen(positions))
        segments = _frozen(np.moveaxis(spline.c, 0, 1))
        object.__setattr__(self, "_segments", segments)

    @property
    def duration(self) -> float:
        """Length of the recording, or of one cycle if it loops [s]."""
        return float(self.times[-1])

    @property
    def spline(self) -> tuple[np.ndarray, np.ndarray]:
        """Knots [s], of shape (n,), and the cubics between them, (n - 1, 4, m).

        A cubic is in the time since its knot, its highest power first.
        """
        return self.times, self._segments

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the angles and rates at a time.

        Args:
            t: Time since the motion started [s]; any finite number.

        Returns:
            Angles [rad] and rates [rad/s], each of shape (m,), in the order of
            `joints`.

        Raises:
            ParameterError: If `t` is not a finite number.

        Example:
            >>> lift = Motion(name="lift", joints=("elbow",), times=np.array([0.0, 2]),
            ...               positions=np.array([[0.0], [-1]]))
            >>> [round(float(x[0]), 3) for x in lift.at(1.0)]
            [-0.5, -0.75]
        """
        if not math.isfinite(t):
            checked_number("t", t, unit="s")
        found = np.empty((3, len(self.joints)))
        still = np.zeros(len(self.joints))
        play(*self.spline, int(self.loops), float(t), (1.0, 0.0, 0.0), still, found)
        return found[0], found[1]


def _frozen(array: np.ndarray) -> np.ndarray:
    copy = np.array(array, dtype=float, order="C")
    copy.setflags(write=False)
    return copy


def _is_word(text: object) -> bool:
    is_text = isinstance(text, str) and text.isprintable()
    return is_text and text == text.strip() and bool(text)


def _checked_joints(name: str, joints: Iterable[str]) -> tuple[str, ...]:
    """Return joint names that are present, not empty and different."""
    names = (joints,) if isinstance(joints, str) else tuple(joints)
    if not names:
        raise MotionError(f'motion "{name}" moves no joint; give at least one')
    for joint in names:
        if not _is_word(joint):
            raise MotionError(
                f'motion "{name}": name of a joint must be printable text, '
                f"got {joint!r}"
            )
        if names.count(joint) > 1:
            raise MotionError(
                f'motion "{name}" has joint "{joint}" more than once; keep one column'
            )
    return names


def as_numbers(what: str, values: object) -> np.ndarray:
    """Return an array of floats, or say that these are not numbers.

    Args:
        what: What they are called.
        values: Numbers in any shape.

    Returns:
        The same as floats.

    Raises:
        MotionError: If they are not numbers.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "fiu":
            raise ValueError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise MotionError(f"{what} must be an array of real numbers") from None


def _checked_times(name: str, values: object) -> np.ndarray:
    """Return sample times that rise strictly from 0."""
    times = as_numbers(f'motion "{name}": times', values)
    if times.ndim != 1 or times.size < 2:
        raise MotionError(
            f'motion "{name}" must have at least 2 samples, times of shape (n,), '
            f"got shape {times.shape}"
        )
    if not np.isfinite(times).all():
        k = int(np.argmin(np.isfinite(times)))
        raise MotionError(
            f'motion "{name}": time of sample {k + 1} is {times[k]}, '
            "it must be a finite number of seconds"
        )
    if times[0] != 0.0:
        raise MotionError(
            f'motion "{name}" must start at time 0 s, got {times[0]:.6g} s; '
            "subtract the first time from all"
        )
    steps = np.diff(times)
    if steps.min() < _SHORTEST_STEP:
        k = int(np.argmin(steps >= _SHORTEST_STEP))
        raise MotionError(
            f'motion "{name}": times must increase by at least {_SHORTEST_STEP:g} s, '
            f"sample {k + 2} at {times[k + 1]:.6g} s follows {times[k]:.6g} s; "
            "sort the samples and remove repeated times"
        )
    return times


def _checked_positions(
    name: str, values: object, times: np.ndarray, joints: tuple[str, ...]
) -> np.ndarray:
    """Return finite joint angles, one row a time and one column a joint."""
    positions = as_numbers(f'motion "{name}": positions', values)
    if positions.shape != (times.size, len(joints)):
        raise MotionError(
            f'motion "{name}": positions must have shape (samples, joints) = '
            f"({times.size}, {len(joints)}), got {positions.shape}"
        )
    good = np.isfinite(positions) & (np.abs(positions) <= _LARGEST_ANGLE)
    if not good.all():
        k, j = np.argwhere(~good)[0]
        raise MotionError(
            f'motion "{name}": angle of joint "{joints[j]}" at {times[k]:.6g} s is '
            f"{positions[k, j]:.6g}, it must be finite and within "
            f"+-{_LARGEST_ANGLE:g} rad"
        )
    return positions


def _closed(name: str, positions: np.ndarray, joints: tuple[str, ...]) -> np.ndarray:
    """Return positions whose last row is exactly the first."""
    gaps = np.abs(positions[-1] - positions[0])
    if gaps.max() > _SEAM:
        j = int(np.argmax(gaps))
        raise MotionError(
            f'motion "{name}" cannot loop: joint "{joints[j]}" ends {gaps[j]:.6g} rad '
            "away from where it starts; append the first sample at the end, "
            "or set loops to false"
        )
    return np.concatenate((positions[:-1], positions[:1]))


# ---- The embedding ----------------------------------------------------------------


@dataclass(frozen=True)
class JointLimit:
    """Limits of one joint.

    Raises:
        ParameterError: If a limit is not a number, or lower exceeds upper.
    """

    lower: float = -math.inf
    """Smallest angle [rad]; -inf if the joint turns freely."""
    upper: float = math.inf
    """Largest angle [rad], at least `lower`; inf if the joint turns freely."""
    speed: float = math.inf
    """Largest rate [rad/s], > 0; inf if not known."""

    def __post_init__(self) -> None:
        """Check the order of the limits; infinity means no limit."""
        if self.lower != -math.inf:
            checked_number("lower", self.lower, unit="rad")
        if self.upper != math.inf:
            low = self.lower if math.isfinite(self.lower) else -math.inf
            hint = "it must not be below lower"
            checked_number("upper", self.upper, unit="rad", low=low, hint=hint)
        if self.speed != math.inf:
            checked_number("speed", self.speed, unit="rad/s", low=0, open_low=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class EmbeddedMotion:
    """A motion blended in and out of the home posture; made by `embed_in` (final)."""

    motion: Motion
    """The motion; its time 0 is at `start`."""
    home: np.ndarray
    """Home angles of the motion's joints [rad], of shape (m,)."""
    start: float
    """When the motion leaves the home posture [s], from the plan's start."""
    stop: float
    """When it is back in the home posture [s], >= start + 2 blend; inf for never."""
    blend: float
    """Time to blend in, and to blend out [s], > 0."""
    record: np.ndarray = field(init=False, repr=False)
    """The same times, one record of `DANCE`."""

    def __post_init__(self) -> None:
        """Check the times and keep a copy of the home posture."""
        for name in ("start", "stop", "blend"):
            _set_window_time(self, name)
        if self.stop - self.start < 2.0 * self.blend * (1.0 - _TOLERANCE):
            span = self.stop - self.start
            raise MotionError(
                f'motion "{self.motion.name}" plays for {span:.6g} s, too short to '
                f"blend in and out over {self.blend:.6g} s each; blend over at most "
                f"{_rounded_down(span / 2.0)} s, or stop later"
            )
        home = as_numbers(f'motion "{self.motion.name}": home', self.home)
        if home.shape != (len(self.motion.joints),) or not np.isfinite(home).all():
            raise MotionError(
                f'motion "{self.motion.name}": home must be '
                f"{len(self.motion.joints)} finite angles, one for each joint"
            )
        object.__setattr__(self, "home", _frozen(home))
        record = records(DANCE)
        record[0] = self.start, self.stop, self.blend, self.motion.loops
        object.__setattr__(self, "record", record)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the embedded joints, in the order of the results of `at`."""
        return self.motion.joints

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        r"""Return the embedded angles and rates at a time.

        .. math::
            q = q_h + w (q_m - q_h), \quad
            \dot q = w \dot q_m + \dot w (q_m - q_h)

        Args:
            t: Time from the plan's start [s]; any finite number.

        Returns:
            Angles [rad] and rates [rad/s], each of shape (m,), in the order of
            `joints`; exactly the home posture at rest outside (start, stop).

        Raises:
            ParameterError: If `t` is not a finite number.
        """
        if not math.isfinite(t):
            checked_number("t", t, unit="s")
        motion, found = self.motion, np.empty((3, len(self.joints)))
        weight = find_weight(self.record[0], float(t))
        since = float(t - self.start)
        play(*motion.spline, int(motion.loops), since, weight, self.home, found)
        return found[0], found[1]


def _set_window_time(embedded: EmbeddedMotion, name: str) -> None:
    """Replace a time of the window by its checked float."""
    value = getattr(embedded, name)
    if name == "stop" and value == math.inf:
        return
    low = 0.0 if name == "blend" else -math.inf
    x = checked_number(name, value, unit="s", low=low, open_low=name == "blend")
    object.__setattr__(embedded, name, x)


def embed_in(
    motion: Motion,
    home: Mapping[str, float],
    *,
    start: float = 0.0,
    stop: float | None = None,
    blend: float = 1.0,
    limits: Mapping[str, JointLimit] | None = None,
) -> EmbeddedMotion:
    """Blend a motion in and out of the robot's home posture.

    The motion runs on its own clock from `start` on, also while it is blended. Each
    angle is a weighted mean of home and motion: where both respect the position
    limits, the blend does. Its rates can exceed those of the motion; give `limits` to
    check them.

    Args:
        motion: The motion to embed.
        home: Home angle of every joint of the motion [rad]; others are ignored.
        start: When the motion leaves the home posture [s].
        stop: When it is back home [s]. Without it, a motion that loops plays for
            ever, and any other plays once.
        blend: Time to blend in, and to blend out [s], > 0.
        limits: Limits of the joints; if given, the rates of both blends are checked.

    Returns:
        The embedded motion.

    Raises:
        MotionError: If a home angle is missing, the window is shorter than both
            blends, or a blend is faster than a joint's speed limit.
        ParameterError: If a time is not a number in its range.

    Example:
        >>> from comwalk.embedding import builtin_motion
        >>> dance = builtin_motion("paper", amplitude=0.5, frequency=0.5)
        >>> embedded = embed_in(dance, dict.fromkeys(dance.joints, 0.0), stop=6.0)
        >>> embedded.joints[2], round(float(embedded.at(3.0)[0][2]), 6)
        ('l_elbow_pitch', -0.5)
    """
    start = checked_number("start", start, unit="s")
    if stop is None:
        stop = math.inf if motion.loops else start + motion.duration
    angles = np.array([_entry(motion, home, "home angle", j) for j in motion.joints])
    embedded = EmbeddedMotion(
        motion=motion, home=angles, start=start, stop=stop, blend=blend
    )
    if limits is not None:
        _check_blends(embedded, limits)
    return embedded


def _entry(motion: Motion, table: Mapping[str, Any], what: str, joint: str) -> Any:
    """Return the table's entry of a joint, or say which is missing."""
    if joint not in table:
        raise MotionError(
            f'motion "{motion.name}" moves joint "{joint}", which has no {what}; '
            f"{nearest(joint, table)}"
        )
    return table[joint]


def _check_blends(embedded: EmbeddedMotion, limits: Mapping[str, JointLimit]) -> None:
    """Raise if a joint is too fast while the motion is blended in or out."""
    motion, blend = embedded.motion, embedded.blend
    times, rates, allowed = _blend_rates(embedded, limits)
    k, j = np.unravel_index(np.argmax(rates / allowed), rates.shape)
    if rates[k, j] > allowed[j] * (1.0 + _TOLERANCE):
        raise MotionError(
            f'blending motion "{motion.name}" over {blend:.6g} s needs '
            f'{rates[k, j]:.3g} rad/s of joint "{motion.joints[j]}" at '
            f"{times[k]:.3f} s, its limit is {allowed[j]:.3g} rad/s; blend over "
            f"about {_rounded_up(blend * rates[k, j] / allowed[j])} s, "
            "or scale the motion down"
        )


def _blend_rates(
    embedded: EmbeddedMotion, limits: Mapping[str, JointLimit], samples: int = 201
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, magnitudes of rates in both blends, (k, m), and limits, (m,)."""
    motion, blend = embedded.motion, embedded.blend
    begins = [b for b in (embedded.start, embedded.stop - blend) if math.isfinite(b)]
    times = np.concatenate([b + np.linspace(0.0, blend, samples) for b in begins])
    rates = np.abs([embedded.at(t)[1] for t in times.tolist()])
    limited = [_entry(motion, limits, "limit", j).speed for j in motion.joints]
    return times, rates, np.array(limited, dtype=float)


def _rounded_down(x: float) -> str:
    return _rounded(x, math.floor)


def _rounded_up(x: float) -> str:
    return _rounded(x, math.ceil)


def _rounded(x: float, round_to: Callable[[float], int]) -> str:
    if not x > 0.0:
        return "0"
    digits = 2 - math.floor(math.log10(x))
    return f"{round_to(x * 10.0**digits) / 10.0**digits:.12g}"


# ---- Checks against a robot -------------------------------------------------------


# ---- Variations -------------------------------------------------------------------
