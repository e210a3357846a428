"""Rotations and twist transport, Eqs. (16), (17) and (20).

Twists are [linear; angular], linear first. Rotation matrices map the named frame
to the world. Quaternions are wxyz.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel


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


def level_error(yaw: float, R: np.ndarray) -> np.ndarray:
    """Return the rotation vector that takes a frame to level with a given heading.

    It is the logarithm of ``rotation_yaw(yaw) @ R.T``, exact up to 180 degrees.

    Args:
        yaw: Desired heading [rad].
        R: Actual rotation, frame to world, of shape (3, 3).

    Returns:
        Rotation vector [rad], world axes, of shape (3,).
    """
    scratch = np.empty((3, 3))
    return np.array(turn_to_level(float(yaw), np.array(R, order="C"), scratch))


@kernel
def _half_turn_log(R: Record) -> tuple[float, float, float]:
    """Return the rotation vector near 180 degrees."""
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    k = 0
    for i in range(1, 3):
        if R[i, i] > R[k, k]:
            k = i
    a, b, c = R[0, k] + R[k, 0], R[1, k] + R[k, 1], R[2, k] + R[k, 2]
    a += 2.0 if k == 0 else 0.0
    b += 2.0 if k == 1 else 0.0
    c += 2.0 if k == 2 else 0.0
    scale = (math.pi - 0.5 * math.sqrt(x * x + y * y + z * z)) / math.sqrt(
        a * a + b * b + c * c
    )
    if a * x + b * y + c * z < 0.0:
        scale = -scale
    return scale * a, scale * b, scale * c


@kernel
def turn_to_level(yaw: float, R: Record, scratch: Record) -> tuple[float, float, float]:
    """Return `level_error` as a rotation vector, for kernels.

    Args:
        yaw: Desired heading [rad].
        R: Actual rotation, frame to world, (3, 3).
        scratch: Workspace, (3, 3).
    """
    C, S = math.cos(yaw), math.sin(yaw)
    x = R[1, 2] - S * R[2, 0] - C * R[2, 1]
    y = C * R[2, 0] - S * R[2, 1] - R[0, 2]
    z = S * (R[0, 0] + R[1, 1]) + C * (R[0, 1] - R[1, 0])
    trace = C * (R[0, 0] + R[1, 1]) - S * (R[0, 1] - R[1, 0]) + R[2, 2]
    sine, cosine = math.sqrt(x * x + y * y + z * z), trace - 1.0
    if sine > 1e-6:
        k = math.atan2(sine, cosine) / sine
        return k * x, k * y, k * z
    if cosine > 0.0:
        return 0.5 * x, 0.5 * y, 0.5 * z
    for j in range(3):
        scratch[0, j] = C * R[j, 0] - S * R[j, 1]
        scratch[1, j] = S * R[j, 0] + C * R[j, 1]
        scratch[2, j] = R[j, 2]
    return _half_turn_log(scratch)


def yaw_of_quaternion(quaternion: np.ndarray) -> float:
    """Return the yaw of a rotation given as a quaternion.

    Args:
        quaternion: Quaternion wxyz, of shape (4,).

    Returns:
        Angle [rad] in (-pi, pi].
    """
    w, x, y, z = quaternion.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
