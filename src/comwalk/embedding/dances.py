"""The built-in dances: functions of joint roles, Section VI and Fig. 5.

Signs: pitch turns about +y, roll about +x, yaw about +z, on both sides. Raising a
hanging arm forward and bending the elbow are therefore *negative* pitch; raising an arm
sideways is +roll on the left and -roll on the right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from ..errors import MotionError, checked_number, nearest
from .motion import Motion
from .motion_edits import posture_angles

_SAMPLES_PER_CYCLE = 64
"""Samples per cycle of a dance: spline error below 1e-6 of the amplitude."""

_Waves = dict[str, np.ndarray | float]
"""Angles for an amplitude of 1 rad, by role; numbers are constant."""


def _paper(phase: np.ndarray) -> _Waves:
    u = 0.5 * (1.0 - np.cos(phase))
    return _arm("l", pitch=-u, roll=u, elbow=-u) | _arm(
        "r", pitch=-u, roll=-u, elbow=-u
    )


def _counter(phase: np.ndarray) -> _Waves:
    u = 0.5 * (1.0 - np.cos(phase))
    v = 1.0 - u
    return _arm("l", pitch=-u, roll=u, elbow=-u) | _arm(
        "r", pitch=-v, roll=-v, elbow=-v
    )


def _wave(phase: np.ndarray) -> _Waves:
    arm = _arm("r", roll=-1.0, yaw=-0.5, elbow=-0.6 - 0.4 * np.sin(phase))
    return arm | {"head_yaw": -0.3}


def _swing(phase: np.ndarray) -> _Waves:
    s = np.sin(phase)
    return {
        **_arm("l", pitch=s, elbow=-0.25 * (1.0 - s)),
        **_arm("r", pitch=-s, elbow=-0.25 * (1.0 + s)),
        "waist_yaw": 0.15 * s,
    }


def _disco(phase: np.ndarray) -> _Waves:
    u = 0.5 * (1.0 - np.cos(phase))
    v, s = 1.0 - u, np.sin(phase)
    return {
        **_arm("l", pitch=-u, roll=0.6 * u, elbow=-0.8 * v),
        **_arm("r", pitch=-v, roll=-0.6 * v, elbow=-0.8 * u),
        "waist_yaw": 0.3 * s,
        "head_yaw": -0.3 * s,
        "head_pitch": 0.15 * (1.0 - np.cos(2.0 * phase)),
    }


def _conduct(phase: np.ndarray) -> _Waves:
    s, beat = np.sin(phase), np.cos(2.0 * phase)
    pitch, elbow = -0.4 - 0.1 * beat, -0.8 - 0.2 * beat
    return {
        **_arm("l", pitch=pitch, yaw=0.4 * s, elbow=elbow),
        **_arm("r", pitch=pitch, yaw=-0.4 * s, elbow=elbow),
        "head_yaw": 0.2 * s,
    }


def _bow(phase: np.ndarray) -> _Waves:
    u = 0.5 * (1.0 - np.cos(phase))
    arms = _arm("l", pitch=0.3 * u) | _arm("r", pitch=0.3 * u)
    return arms | {"waist_pitch": u, "head_pitch": 0.3 * u}


def _arm(side: str, **angles: np.ndarray | float) -> _Waves:
    """Return the angles of one arm under the names of its roles."""
    roles = {
        "pitch": "shoulder_pitch",
        "roll": "shoulder_roll",
        "yaw": "shoulder_yaw",
        "elbow": "elbow_pitch",
    }
    return {f"{side}_{roles[name]}": angle for name, angle in angles.items()}


_DANCES: dict[str, tuple[Callable[[np.ndarray], _Waves], str]] = {
    "paper": (
        _paper,
        "both arms rise and fall together (Fig. 5): shoulder pitch and roll, elbow",
    ),
    "counter": (
        _counter,
        "the arms rise and fall in turn: shoulder pitch and roll, elbow",
    ),
    "wave": (
        _wave,
        "the raised right arm waves: right shoulder roll and yaw, elbow; head yaw",
    ),
    "swing": (
        _swing,
        "natural arm swing, one cycle for two steps: shoulder pitch, elbow; waist yaw",
    ),
    "disco": (
        _disco,
        "arms thrust in turn, waist and head sway: shoulder pitch and roll, elbow; "
        "waist yaw; head yaw and pitch",
    ),
    "conduct": (
        _conduct,
        "both hands beat time in front: shoulder pitch and yaw, elbow; head yaw",
    ),
    "bow": (
        _bow,
        "bow from the waist: waist pitch, head pitch; shoulder pitch",
    ),
}

BUILTIN_MOTIONS: dict[str, str] = {name: text for name, (_, text) in _DANCES.items()}
"""What each built-in dance does and which joints it moves, by name."""


def builtin_motion(
    name: str,
    *,
    amplitude: float = 0.5,
    frequency: float = 0.5,
    home: Mapping[str, float] | None = None,
) -> Motion:
    """Return a built-in dance, which loops (section VI, Fig. 5).

    Its joints are roles such as `l_shoulder_pitch`; `renamed` puts the joint names of
    a robot in their place, `select` takes out those that it lacks.

    Args:
        name: One of `BUILTIN_MOTIONS`.
        amplitude: Largest angle that any joint moves away from `home` [rad], in
            (0, 2.5].
        frequency: Cycles per second [Hz], in (0, 3].
        home: Angles around which the dance is built [rad]; 0 where none is given.

    Returns:
        The motion, one cycle long.

    Raises:
        MotionError: If there is no such dance.
        ParameterError: If amplitude or frequency is out of range.

    Example:
        >>> builtin_motion("paper", amplitude=0.5, frequency=0.5).duration
        2.0
    """
    if name not in _DANCES:
        raise MotionError(f'no built-in motion "{name}"; {nearest(name, _DANCES)}')
    a = checked_number(
        "amplitude", amplitude, unit="rad", low=0.0, high=2.5, open_low=True
    )
    f = checked_number(
        "frequency", frequency, unit="Hz", low=0.0, high=3.0, open_low=True
    )
    phase = np.linspace(0.0, 2.0 * math.pi, _SAMPLES_PER_CYCLE + 1)
    waves = _DANCES[name][0](phase)
    joints = tuple(waves)
    columns = [a * np.broadcast_to(waves[joint], phase.shape) for joint in joints]
    positions = posture_angles(joints, home) + np.column_stack(columns)
    times = phase / (2.0 * math.pi * f)
    return Motion(
        name=name, joints=joints, times=times, positions=positions, loops=True
    )
