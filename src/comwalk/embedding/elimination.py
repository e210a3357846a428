"""The paper's elimination: the embedded CoM Jacobian, Eqs. (19)-(27), to be read.

A walk runs the same elimination compiled, in `kinematics`, where the trunk's rate is
given as well; tests hold both to each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .rotations import shift, skew
from .task import (
    CartesianMotion,
    Damping,
    JointMotion,
    Limb,
    Posture,
    Resolution,
    Task,
    ancestors,
    check_task,
)


def sigma_min(J: np.ndarray) -> float:
    """Return the smallest singular value of a limb's Jacobian.

    Args:
        J: Jacobian, of shape (rows, n_i).

    Returns:
        The smallest of min(rows, n_i) singular values.
    """
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def damped_inverse(J: np.ndarray, damping: Damping) -> np.ndarray:
    """Return the generalised inverse of J: exact if it can be, damped if it must.

    A square regular J is inverted, a redundant limb gets the pseudo-inverse, a limb
    with fewer joints than rows the least-squares one; near a singular posture
    J^T (J J^T + lambda^2 I)^-1 bounds the rates.

    Args:
        J: Jacobian, of shape (rows, n_i).
        damping: When and how strongly to damp.

    Returns:
        G, of shape (n_i, rows).
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    lam2 = damping.squared(float(s[-1]))
    return (Vt.T * (s / (s * s + lam2))) @ U.T


@dataclass(frozen=True, slots=True, eq=False)
class Embedding:
    """The CoM Jacobian of the base limb with all other limbs' motion embedded."""

    cdot_emc: np.ndarray
    """CoM velocity left for the base limb [m/s], Eq. (26), of shape (3,)."""
    J_emc: np.ndarray
    """CoM Jacobian with embedded motion, Eq. (27), of shape (3, n_1)."""
    a: dict[str, np.ndarray]
    """Part of each limb's rates that does not depend on the body, of shape (n_i,)."""
    B: dict[str, np.ndarray]
    """Its rates per body twist: qdot_i = a_i + B_i xdot_o, of shape (n_i, 6)."""


def embed(
    limbs: Sequence[Limb], posture: Posture, task: Task, damping: Damping | None = None
) -> Embedding:
    r"""Embed all other limbs' motion in the base limb, Eqs. (18), (19), (23)-(27).

    Each limb's rates follow from the common body twist, parents first,

    .. math:: \dot q_i = G_i (\dot x_i - J_P \dot q_P) + N_i z_i - G_i X_i^{-1} \dot x_o

    with G_i = J_i^{-1} for six joints, which is Eq. (19) once the body twist is
    expressed by the base limb, Eq. (18). Their sum in Eq. (21) gives

    .. math::
        J_{emc} &= J_{c1} - J_{v1} + r_{c1} \times J_{\omega 1}
                   + \sum_i J_{ci} J_i^{-1} X_{i1} J_1 \\
        \dot c_{emc} &= \dot c - \sum_i J_{ci} J_i^{-1} (\dot x_i - X_{i1} \dot x_1)
                   - \dot r_1 - \omega_1 \times r_{c1}

    Args:
        limbs: The robot's limbs, parents before children.
        posture: Kinematics at the present configuration.
        task: What is asked.
        damping: How singular limbs give way.

    Returns:
        The embedding.

    Raises:
        ModelError: If the task names a limb that does not exist, or leaves one out.

    Note:
        Eq. (27) as printed puts the cross product inside R_o[...], where r_c1 would
        have to be in body axes; here every term is in world axes, as in Eq. (23).
    """
    damping = damping or Damping()
    check_task(limbs, task)
    index = {limb.name: i for i, limb in enumerate(limbs)}
    one = index[task.base]
    a: dict[str, np.ndarray] = {}
    B: dict[str, np.ndarray] = {}
    # Columns of the body twist in Eq. (21): cdot = r_o' + omega_o x (c - r_o) + ...
    S_B = np.hstack([np.eye(3), -skew(posture.com - posture.position)])
    s_a = np.zeros(3)
    for i, limb in enumerate(limbs):
        if i == one:
            continue
        a_i, B_i = _limb_rates(
            limbs, posture, i, task.motions[limb.name], a, B, damping
        )
        a[limb.name], B[limb.name] = a_i, B_i
        J_ci = posture.com_jacobian[:, limb.columns]
        S_B = S_B + J_ci @ B_i
        s_a = s_a + J_ci @ a_i
    X_1 = shift(posture.ends[one] - posture.position)
    J_1 = posture.end_jacobian(one)[:, limbs[one].columns]
    J_c1 = posture.com_jacobian[:, limbs[one].columns]
    return Embedding(
        cdot_emc=task.com_velocity - s_a - S_B @ X_1 @ task.base_twist,
        J_emc=J_c1 - S_B @ X_1 @ J_1,
        a=a,
        B=B,
    )


def _limb_rates(
    limbs: Sequence[Limb],
    posture: Posture,
    i: int,
    motion: CartesianMotion | JointMotion,
    a: Mapping[str, np.ndarray],
    B: Mapping[str, np.ndarray],
    damping: Damping,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a_i, B_i of qdot_i = a_i + B_i xdot_o, Eqs. (15) and (19)."""
    limb = limbs[i]
    n_i = len(limb.joints)
    if isinstance(motion, JointMotion):
        return motion.rates, np.zeros((n_i, 6))
    rows = list(motion.rows)
    J = posture.end_jacobian(i)[rows]
    J_i = J[:, limb.columns]
    X_inv = shift(posture.position - posture.ends[i])[rows]
    drift = motion.twist[rows]
    for carrier in ancestors(limbs, limb):
        J_P = J[:, carrier.columns]
        drift = drift - J_P @ a[carrier.name]
        X_inv = X_inv + J_P @ B[carrier.name]
    G = damped_inverse(J_i, damping)
    a_i = G @ drift
    if motion.posture_rates is not None:
        a_i = a_i + motion.posture_rates - G @ (J_i @ motion.posture_rates)
    return a_i, -G @ X_inv


def resolve_by_elimination(
    limbs: Sequence[Limb], posture: Posture, task: Task, damping: Damping | None = None
) -> Resolution:
    r"""Resolve a task the paper's way, Eqs. (19), (22), (25).

    The trunk's orientation is stacked under the embedded CoM Jacobian,

    .. math:: \begin{bmatrix} J_{emc} \\ -J_{\omega 1} \end{bmatrix} \dot q_1 =
              \begin{bmatrix} \dot c_{emc} \\ \omega_o - \omega_1 \end{bmatrix}

    then the body twist follows by Eq. (22) and every other limb by Eq. (19). CoM and
    base foot stay exact whatever generalised inverse a limb uses.

    Args:
        limbs: The robot's limbs, parents before children.
        posture: Kinematics at the present configuration.
        task: What is asked.
        damping: How singular limbs give way. The base limb does not: near its own
            singular postures `Resolver` is the one to use.

    Returns:
        The rates, with their residuals.

    Raises:
        ModelError: If the task names a limb that does not exist, or leaves one out.
    """
    embedding = embed(limbs, posture, task, damping)
    one = next(i for i, limb in enumerate(limbs) if limb.name == task.base)
    X_1 = shift(posture.ends[one] - posture.position)
    J_1 = posture.end_jacobian(one)[:, limbs[one].columns]
    A = np.vstack([embedding.J_emc, -J_1[3:]])
    b = np.concatenate([embedding.cdot_emc, task.trunk_rate - task.base_twist[3:]])
    dq_1 = np.linalg.lstsq(A, b, rcond=None)[0]
    x_o = X_1 @ (task.base_twist - J_1 @ dq_1)
    v = np.zeros(posture.jacobian.shape[1])
    v[:6] = x_o
    v[limbs[one].columns] = dq_1
    for limb in limbs:
        if limb.name != task.base:
            v[limb.columns] = embedding.a[limb.name] + embedding.B[limb.name] @ x_o
    return Resolution(v, posture, task, tuple(limbs))
