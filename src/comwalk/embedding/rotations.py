"""Rotations and twist transport, Eqs. (16), (17) and (20).

Twists are [linear; angular], linear first. Rotation matrices map the named frame
to the world. Quaternions are wxyz.
"""

from __future__ import annotations

import math

import numpy as np


def skew(v: np.ndarray) -> np.ndarray:
    r"""Return the matrix of the cross product, :math:`[v \times]`.

    Args:
        v: Vector, of shape (3,).

    Returns:
        Matrix S with S @ w equal to the cross product of v and w, of shape (3, 3).
    """
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def shift(r: np.ndarray) -> np.ndarray:
    r"""Return the twist transport X of an arm r, Eq. (16).

    .. math:: X = \begin{bmatrix} I & [r \times] \\ 0 & I \end{bmatrix}

    With r from the body center to a limb's end, X takes the twist of the end point
    to that of the body center; the inverse is ``shift(-r)``. Arms add:
    ``shift(a) @ shift(b) == shift(a + b)``, hence Eq. (20),
    :math:`X_{i1} = X_i^{-1} X_1` = ``shift(r_1 - r_i)``.

    Args:
        r: Arm [m], world axes, of shape (3,).

    Returns:
        Matrix X, of shape (6, 6).
    """
    X = np.eye(6)
    X[:3, 3:] = skew(r)
    return X


def rotate_twist(R: np.ndarray) -> np.ndarray:
    r"""Return the rotation of a twist, Eq. (17).

    .. math:: X_o = \begin{bmatrix} R_o & 0 \\ 0 & R_o \end{bmatrix}

    Args:
        R: Rotation body to world, of shape (3, 3).

    Returns:
        Matrix X_o, of shape (6, 6).
    """
    X_o = np.zeros((6, 6))
    X_o[:3, :3] = R
    X_o[3:, 3:] = R
    return X_o


def rotation_yaw(yaw: float) -> np.ndarray:
    """Return the rotation by a yaw angle about world z.

    Args:
        yaw: Angle [rad].

    Returns:
        Rotation matrix, of shape (3, 3).
    """
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_log(R: np.ndarray) -> np.ndarray:
    """Return the rotation vector of a rotation matrix, exact up to 180 degrees.

    Args:
        R: Rotation matrix, of shape (3, 3).

    Returns:
        Rotation vector [rad], angle in [0, pi], of shape (3,).
    """
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    vector = _log_from(h - f, c - g, d - b, a + e + i)
    return _half_turn_log(R) if vector is None else np.array(vector)


def level_error(yaw: float, R: np.ndarray) -> np.ndarray:
    """Return the rotation vector that takes a frame to level with a given heading.

    It is ``rotation_log(rotation_yaw(yaw) @ R.T)``, in a third of the time.

    Args:
        yaw: Desired heading [rad].
        R: Actual rotation, frame to world, of shape (3, 3).

    Returns:
        Rotation vector [rad], world axes, of shape (3,).
    """
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    C, S = math.cos(yaw), math.sin(yaw)
    x = f - S * g - C * h
    y = C * g - S * h - c
    z = S * (a + e) + C * (b - d)
    vector = _log_from(x, y, z, C * (a + e) - S * (b - d) + i)
    if vector is None:
        return _half_turn_log(rotation_yaw(yaw) @ R.T)
    return np.array(vector)


def _log_from(
    x: float, y: float, z: float, trace: float
) -> tuple[float, float, float] | None:
    """Return the log from the vector of R - R^T and the trace; None at half turns."""
    sine, cosine = math.sqrt(x * x + y * y + z * z), trace - 1.0
    if sine > 1e-6:
        k = math.atan2(sine, cosine) / sine
    elif cosine > 0.0:
        k = 0.5
    else:
        return None
    return k * x, k * y, k * z


def _half_turn_log(R: np.ndarray) -> np.ndarray:
    """Return the rotation vector near 180 degrees, where R - R^T vanishes."""
    sense = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    outer = 0.5 * (R + R.T) + np.eye(3)
    column = int(np.argmax(np.diag(outer)))
    axis = outer[:, column] / math.sqrt(float(outer[column] @ outer[column]))
    angle = math.pi - 0.5 * float(np.linalg.norm(sense))
    return angle * (axis if axis @ sense >= 0.0 else -axis)


def yaw_of_quaternion(quaternion: np.ndarray) -> float:
    """Return the yaw of a rotation given as a quaternion.

    Args:
        quaternion: Quaternion wxyz, of shape (4,).

    Returns:
        Angle [rad] in (-pi, pi].
    """
    w, x, y, z = quaternion.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def yaw_of(R: np.ndarray) -> float:
    """Return the yaw of a rotation: the heading of its x axis on the ground.

    Args:
        R: Rotation matrix, of shape (3, 3).

    Returns:
        Angle [rad] in (-pi, pi].
    """
    return math.atan2(R[1, 0], R[0, 0])
