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
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import MotionError, checked_number, nearest
from ..pattern import minimum_jerk

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
    dropped: tuple[str, ...] = ()
    """Names of the recorded joints which `select` or `renamed` took out."""
    _segments: np.ndarray = field(init=False, repr=False)
    _knots: tuple[float, ...] = field(init=False, repr=False)
    _still: np.ndarray = field(init=False, repr=False)

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
        object.__setattr__(self, "_knots", tuple(times.tolist()))
        object.__setattr__(self, "_still", _frozen(np.zeros(len(joints))))

    @property
    def duration(self) -> float:
        """Length of the recording, or of one cycle if it loops [s]."""
        return self._knots[-1]

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
            `joints`. Arrays of the held ends are read-only.

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
        knots = self._knots
        if self.loops:
            t = t % knots[-1]
        elif t <= 0.0:
            return self.positions[0], self._still
        elif t >= knots[-1]:
            return self.positions[-1], self._still
        k = bisect_right(knots, t, 1, len(knots) - 1) - 1
        s = t - knots[k]
        basis = ((s * s * s, s * s, s, 1.0), (3.0 * s * s, 2.0 * s, 1.0, 0.0))
        q, dq = np.array(basis) @ self._segments[k]
        return q, dq


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return a read-only contiguous copy."""
    copy = np.array(array, dtype=float, order="C")
    copy.setflags(write=False)
    return copy


def _is_word(text: object) -> bool:
    """Return whether a name is text that fits on one line of a file."""
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
    """What one joint can do.

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
    _still: np.ndarray = field(init=False, repr=False)

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
        object.__setattr__(self, "_still", self.motion._still)

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
        t_in, t_out, blend = t - self.start, self.stop - t, self.blend
        tau = t_in if t_in < t_out else t_out
        if tau <= 0.0:
            return self.home, self._still
        q_m, dq_m = self.motion.at(t_in)
        if tau >= blend:
            return q_m, dq_m
        w, dw = minimum_jerk(tau / blend)
        dw = dw / blend if t_in < t_out else -dw / blend
        d = q_m - self.home
        return self.home + w * d, w * dq_m + dw * d


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
    """Return a number rounded down to 3 digits, so that advice is safe to follow."""
    return _rounded(x, math.floor)


def _rounded_up(x: float) -> str:
    """Return a number rounded up to 3 digits."""
    return _rounded(x, math.ceil)


def _rounded(x: float, round_to: Callable[[float], int]) -> str:
    """Return a positive number rounded to 3 digits in the given direction."""
    if not x > 0.0:
        return "0"
    digits = 2 - math.floor(math.log10(x))
    return f"{round_to(x * 10.0**digits) / 10.0**digits:.12g}"


# ---- Checks against a robot -------------------------------------------------------


def prepare_motion(
    motion: Motion,
    *,
    allowed: Sequence[str],
    ignored: Sequence[str] = (),
    limits: Mapping[str, JointLimit],
    home: Mapping[str, float],
) -> Motion:
    """Return the part of a motion that a robot plays, checked against the robot.

    Position and speed limits are checked on the spline, between the samples too.

    Args:
        motion: The motion, from `builtin_motion` or `load_motion`.
        allowed: Names of the joints which may be moved by a motion (upper body).
        ignored: Names of the joints that walking needs (legs). They are dropped from
            a whole-body clip, and listed in the result's `dropped`; any other motion
            must not contain them.
        limits: Limits of every joint of `allowed`; with inf for none.
        home: Home angle of every joint of `allowed` [rad].

    Returns:
        The motion with joints of `allowed` only.

    Raises:
        MotionError: If a joint is unknown or is a leg joint, or the motion exceeds a
            position or speed limit; the message says by how much to scale it.
    """
    playable = _playable(motion, allowed, ignored)
    center, lower, upper, speed = _room(playable, limits, home)
    _check_home(playable, center, lower, upper)
    _check_range(playable, center, lower, upper)
    _check_speed(playable, speed)
    return playable


def fitted(
    embedded: EmbeddedMotion, limits: Mapping[str, JointLimit]
) -> tuple[EmbeddedMotion, tuple[str, ...]]:
    """Return a motion made smaller and slower until a robot can play it.

    A joint that would pass a position limit moves less; if one would be too fast, all
    are slower; if one would be too fast in a blend, all move less.

    Args:
        embedded: The motion, whose home angles are within their limits.
        limits: Limits of its joints.

    Returns:
        The motion within its limits, and what was changed, a phrase each.
    """
    motion, notes = embedded.motion, []
    home = dict(zip(motion.joints, embedded.home.tolist(), strict=True))
    center, lower, upper, speed = _room(motion, limits, home)
    shares = _position_shares(motion, center, lower, upper)
    for joint, share in zip(motion.joints, shares.tolist(), strict=True):
        if share < 1.0:
            notes.append(f"{joint} moves {share:.3g} times as far")
    positions = center + shares * (motion.positions - center)
    motion = replace(motion, positions=positions)
    slower = _share_of(speed, np.abs(_rate_extremes(motion)[1]))
    if slower < 1.0:
        notes.append(f"{slower:.3g} times as fast")
        motion = scaled(motion, speed=max(slower, 1e-3))
    _, rates, allowed = _blend_rates(replace(embedded, motion=motion), limits)
    smaller = _share_of(allowed, rates)
    if smaller < 1.0:
        notes.append(f"all joints move {smaller:.3g} times as far")
        motion = scaled(motion, smaller, about=home)
    return replace(embedded, motion=motion), tuple(notes)


def _room(
    motion: Motion, limits: Mapping[str, JointLimit], home: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return home angles, lower, upper and speed limits of a motion's joints."""
    limited = [_entry(motion, limits, "limit", j) for j in motion.joints]
    center = [_entry(motion, home, "home angle", j) for j in motion.joints]
    rows = [(x.lower, x.upper, x.speed) for x in limited]
    lower, upper, speed = np.array(rows, dtype=float).T
    return np.array(center), lower, upper, speed


def _position_shares(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Return by how much each joint must move less to keep its limits, (m,)."""
    away = _position_extremes(motion)[1] - home
    room = np.where(away > 0.0, upper - home, home - lower)
    columns = range(len(motion.joints))
    return np.array([_share_of(room[:, j], np.abs(away[:, j])) for j in columns])


def _share_of(allowed: np.ndarray, needed: np.ndarray) -> float:
    """Return the share of what is needed that is allowed everywhere, at most 1."""
    over = needed > allowed * (1.0 + _TOLERANCE)
    shares = np.divide(allowed, needed, where=over, out=np.ones(over.shape))
    least = float(shares.min())
    return 1.0 if least >= 1.0 else 0.999 * max(least, 0.0)


def _playable(motion: Motion, allowed: Sequence[str], ignored: Sequence[str]) -> Motion:
    """Return the motion without the legs of a whole-body clip."""
    for joint in motion.joints:
        if joint in allowed or (motion.whole_body and joint in ignored):
            continue
        if joint in ignored:
            raise MotionError(
                f'motion "{motion.name}" moves joint "{joint}", which the walking '
                "moves; remove it from the motion"
            )
        raise MotionError(
            f'motion "{motion.name}" moves joint "{joint}", which this robot does not '
            f"let dance; {nearest(joint, allowed)}"
        )
    return select(motion, [j for j in motion.joints if j in allowed])


def _check_home(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> None:
    """Raise if a home angle is not inside its limits."""
    for joint, q, low, high in zip(motion.joints, home, lower, upper, strict=True):
        name = f'home angle of joint "{joint}"'
        if not low - _TOLERANCE <= q <= high + _TOLERANCE:
            raise MotionError(
                f"{name} must be in [{low:.6g}, {high:.6g}] rad, got {q:.6g} rad; "
                "correct the home posture"
            )


def _check_range(
    motion: Motion, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> None:
    """Raise if the spline leaves the position limits, naming the worst joint."""
    t, q = _position_extremes(motion)
    over = np.maximum(q - upper, lower - q)
    if over.max() <= _TOLERANCE:
        return
    k, j = np.unravel_index(np.argmax(over), over.shape)
    limit = upper[j] if q[k, j] > upper[j] else lower[j]
    raise MotionError(
        f'motion "{motion.name}": joint "{motion.joints[j]}" reaches '
        f"{q[k, j]:.4g} rad at {t[k, j]:.3f} s, its limit is {limit:.4g} rad; "
        f"{_range_advice(q, home, lower, upper)}"
    )


def _range_advice(
    q: np.ndarray, home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> str:
    """Return what to do about a motion that leaves the position limits."""
    if np.abs(q).max() > 3.0 * math.pi:
        return "angles must be in radians, these look like degrees"
    away = q - home
    room = np.where(away > 0.0, upper - home, home - lower)
    moved = np.abs(away) > _TOLERANCE
    factor = float(np.min(np.divide(room, np.abs(away), where=moved, out=room + 1.0)))
    if factor < 0.01:
        return "the home posture is at this limit, so move the home posture off it"
    return f"scale its amplitude about home by {_rounded_down(factor)} or less"


def _check_speed(motion: Motion, speed: np.ndarray) -> None:
    """Raise if the spline is faster than a speed limit, naming the worst joint."""
    t, rates = _rate_extremes(motion)
    ratio = np.abs(rates) / speed
    if ratio.max() <= 1.0 + _TOLERANCE:
        return
    k, j = np.unravel_index(np.argmax(ratio), ratio.shape)
    raise MotionError(
        f'motion "{motion.name}" needs {abs(rates[k, j]):.4g} rad/s of joint '
        f'"{motion.joints[j]}" at {t[k, j]:.3f} s, its limit is {speed[j]:.4g} rad/s; '
        f"play it at {_rounded_down(float(1.0 / ratio[k, j]))} times its speed or less"
    )


def _position_extremes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return times and angles among which are all extremes of the spline."""
    a, b, c, _ = np.moveaxis(motion._segments, 1, 0)
    root = np.sqrt(np.maximum(b * b - 3.0 * a * c, 0.0))
    lean = -(b + np.copysign(root, b))
    candidates = [np.zeros_like(a), _ratio(lean, 3.0 * a), _ratio(c, lean)]
    return _sampled(motion, candidates, rates=False)


def _rate_extremes(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return times and rates among which are all extremes of the spline's rates."""
    a, b, _, _ = np.moveaxis(motion._segments, 1, 0)
    return _sampled(motion, [np.zeros_like(a), _ratio(-b, 3.0 * a)], rates=True)


def _ratio(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Return the quotient, zero where it is not a usable number."""
    usable = np.abs(below) > 1e-12 * np.abs(above)
    return np.divide(above, below, where=usable, out=np.zeros_like(above))


def _sampled(
    motion: Motion, candidates: list[np.ndarray], *, rates: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of all segments at the candidate local times."""
    a, b, c, d = np.moveaxis(motion._segments, 1, 0)
    length = np.diff(motion.times)[:, None]
    local = [np.clip(s, 0.0, length) for s in (*candidates, length + 0.0 * a)]
    if rates:
        values = [(3.0 * a * s + 2.0 * b) * s + c for s in local]
    else:
        values = [((a * s + b) * s + c) * s + d for s in local]
    begins = motion.times[:-1, None]
    return np.concatenate([begins + s for s in local]), np.concatenate(values)


# ---- Variations -------------------------------------------------------------------


def select(motion: Motion, joints: Iterable[str]) -> Motion:
    """Return a motion with some of its joints; the others go into `dropped`.

    Args:
        motion: The motion.
        joints: Names of the joints to keep; names it does not move are ignored.

    Returns:
        The motion of the joints kept, in their order in `motion`.

    Raises:
        MotionError: If none of the joints is in the motion.
    """
    wanted = set(joints)
    kept = [i for i, joint in enumerate(motion.joints) if joint in wanted]
    if not kept:
        raise MotionError(
            f'motion "{motion.name}" moves none of the joints asked for: '
            f"{', '.join(sorted(wanted)) or 'none'}; it moves "
            f"{', '.join(motion.joints)}"
        )
    out = tuple(joint for joint in motion.joints if joint not in wanted)
    return replace(
        motion,
        joints=tuple(motion.joints[i] for i in kept),
        positions=motion.positions[:, kept],
        dropped=motion.dropped + out,
    )


def renamed(motion: Motion, names: Mapping[str, str]) -> Motion:
    """Return a motion whose roles are the joint names of a robot.

    Args:
        motion: The motion, such as a built-in dance.
        names: The robot's joint for each role, `{"l_elbow_pitch": "L_ELBOW_P"}`;
            roles without an entry go into `dropped`.

    Returns:
        The motion of the roles that the robot has.

    Raises:
        MotionError: If the robot has none of the roles, or two roles share a joint.
    """
    kept = select(motion, names)
    return replace(kept, joints=tuple(names[joint] for joint in kept.joints))


def placed(
    motion: Motion,
    home: Mapping[str, float],
    signs: Mapping[str, float] | None = None,
) -> Motion:
    """Return a motion whose angles are counted from a home posture.

    Args:
        motion: The motion, such as a built-in dance with no home of its own.
        home: Home angle of every joint [rad], where angle 0 of the motion goes.
        signs: -1 for joints that turn the other way, by joint; +1 where none is given.

    Returns:
        The motion in absolute joint angles.

    Raises:
        MotionError: If a home angle is missing.
    """
    center = [_entry(motion, home, "home angle", j) for j in motion.joints]
    turned = [(signs or {}).get(j, 1.0) for j in motion.joints]
    positions = np.array(center) + np.array(turned) * motion.positions
    return replace(motion, positions=positions)


def scaled(
    motion: Motion,
    amplitude: float = 1.0,
    speed: float = 1.0,
    *,
    about: Mapping[str, float] | None = None,
) -> Motion:
    """Return a motion made larger or smaller, faster or slower.

    Args:
        motion: The motion.
        amplitude: Factor of the angles measured from `about`, in [0, 100].
        speed: Factor of the speed, in [0.001, 1000].
        about: Posture that stays where it is [rad], the robot's home as a rule;
            joints without an entry, and all without it, are scaled about 0.

    Returns:
        The scaled motion; its rates are `amplitude * speed` times as large.

    Raises:
        ParameterError: If a factor is out of range.
    """
    amplitude = checked_number("amplitude", amplitude, low=0.0, high=100.0)
    speed = checked_number("speed", speed, low=1e-3, high=1e3)
    center = posture_angles(motion.joints, about)
    positions = center + amplitude * (motion.positions - center)
    return replace(motion, times=motion.times / speed, positions=positions)


def posture_angles(
    joints: Sequence[str], angles: Mapping[str, float] | None
) -> np.ndarray:
    """Return the angles of the joints, zero where none is given.

    Args:
        joints: Names of m joints.
        angles: Angles [rad] by joint; None for all zero.

    Returns:
        Angles [rad], of shape (m,).
    """
    table = angles or {}
    named = [(joint, table.get(joint, 0.0)) for joint in joints]
    return np.array(
        [checked_number(f'angle of "{j}"', q, unit="rad") for j, q in named]
    )


def resampled(motion: Motion, rate: float) -> Motion:
    """Return a motion sampled evenly at about a rate.

    Args:
        motion: The motion.
        rate: Samples per second [Hz], in (0, 10000]; adjusted so that the last
            sample falls on the end of the motion.

    Returns:
        The motion of the new samples; its duration is unchanged.

    Raises:
        ParameterError: If the rate is out of range.
    """
    high = 1e4
    rate = checked_number("rate", rate, unit="Hz", low=0.0, high=high, open_low=True)
    n = max(round(motion.duration * rate), 3 if motion.loops else 1) + 1
    times = np.linspace(0.0, motion.duration, n)
    positions = np.array([motion.at(t)[0] for t in times.tolist()])
    return replace(motion, times=times, positions=positions)
