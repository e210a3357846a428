r"""Compiled kinematics and resolution on a robot's records, Eqs. (14)-(27).

`elimination.embed` writes Eqs. (26) and (27) out and is the one to read first; tests
hold these kernels to it, to `robot.Kinematics` and to Pinocchio. As the trunk's rate is
given, each limb with a given end is solved for in terms of the body center's velocity,

.. math:: \dot q_i = a_i + B_i v_o, \quad
    G_i = J_i^T (J_i J_i^T + \lambda^2 I)^{-1}

and Eq. (21) is left as three equations for v_o.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import Record, kernel
from .kinematic_records import ANY_AXIS, SLIDE, Flat, flat_at, wanted_at

SOLVED, SINGULAR = 0, 1
"""What `resolve` returns: solved, or a leg is near a singular posture."""


@kernel
def rotation(w: float, x: float, y: float, z: float, R: Record) -> None:
    """Write the rotation matrix of a quaternion of any length."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    R[0, 0], R[0, 1] = 1.0 - s * (y * y + z * z), s * (x * y - w * z)
    R[0, 2], R[1, 0] = s * (x * z + w * y), s * (x * y + w * z)
    R[1, 1], R[1, 2] = 1.0 - s * (x * x + z * z), s * (y * z - w * x)
    R[2, 0], R[2, 1] = s * (x * z - w * y), s * (y * z + w * x)
    R[2, 2] = 1.0 - s * (x * x + y * y)


@kernel
def turned(R: Record, v: Record) -> tuple[float, float, float]:
    """Return R v."""
    x, y, z = v[0], v[1], v[2]
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel
def _turn_about(axis: int, angle: float, up: Record, R: Record) -> None:
    """Turn a link about an axis that its parent has too: two columns change."""
    c, s = math.cos(angle), math.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    for row in range(3):
        y, z = up[row, j], up[row, k]
        R[row, axis] = up[row, axis]
        R[row, j], R[row, k] = c * y + s * z, c * z - s * y


@kernel
def _turn_any(axis: Record, angle: float, up: Record, R: Record) -> None:
    """Turn a link about any unit axis of its parent (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    for row in range(3):
        a, b, d = up[row, 0], up[row, 1], up[row, 2]
        along = (1.0 - c) * (a * x + b * y + d * z)
        R[row, 0] = c * a + s * (b * z - d * y) + along * x
        R[row, 1] = c * b + s * (d * x - a * z) + along * y
        R[row, 2] = c * d + s * (a * y - b * x) + along * z


@kernel
def _place(link: Record, up: Record, angle: float) -> None:
    """Place a link after its parent, and its joint's axis."""
    R, kind = link.R, link.kind
    x, y, z = turned(up.R, link.offset)
    a, b, c = turned(up.R, link.axis)
    link.a[0], link.a[1], link.a[2] = a, b, c
    link.p[0], link.p[1], link.p[2] = up.p[0] + x, up.p[1] + y, up.p[2] + z
    if kind < ANY_AXIS:
        _turn_about(kind, angle * link.axis[kind], up.R, R)
    elif kind == ANY_AXIS:
        _turn_any(link.axis, angle, up.R, R)
    else:
        for i in range(3):
            link.p[i] += angle * link.a[i]
            for j in range(3):
                R[i, j] = up.R[i, j]


@kernel
def place_links(links: np.ndarray, q: np.ndarray) -> None:
    """Place all links, and the first moment of each alone.

    Args:
        links: Records of `LINK`.
        q: Configuration: base position [m], quaternion wxyz, joint angles [rad].
    """
    rotation(q[3], q[4], q[5], q[6], links[0].R)
    for i in range(3):
        links[0].p[i] = q[i]
    for k in range(1, len(links)):
        link = links[k]
        _place(link, links[link.parent], q[6 + k] - link.zero)
    for k in range(len(links)):
        link = links[k]
        m, p = link.mass, link.p
        x, y, z = turned(link.R, link.first)
        link.moment[0], link.moment[1] = m * p[0] + x, m * p[1] + y
        link.moment[2] = m * p[2] + z


@kernel
def find_levers(flat: Flat) -> None:
    """Find each joint's column of the CoM Jacobian, Eq. (21), after `place_links`.

    It is the axis times the first moment of what is below, about the joint's anchor.
    The moment of the body center becomes the CoM.
    """
    links = flat.links
    for k in range(len(links) - 1, 0, -1):
        link = links[k]
        up, m, p, a = links[link.parent], link.moment, link.p, link.a
        for i in range(3):
            up.moment[i] += m[i]
        if link.kind == SLIDE:
            for i in range(3):
                link.lever[i] = link.below * a[i]
            continue
        x, y = m[0] - link.below * p[0], m[1] - link.below * p[1]
        z = m[2] - link.below * p[2]
        link.lever[0], link.lever[1] = a[1] * z - a[2] * y, a[2] * x - a[0] * z
        link.lever[2] = a[0] * y - a[1] * x


@kernel
def site_point(flat: Flat, site: int) -> tuple[float, float, float]:
    """Return the position of a site [m], world."""
    link = flat.links[flat.sites[site].link]
    x, y, z = turned(link.R, flat.sites[site].point)
    return link.p[0] + x, link.p[1] + y, link.p[2] + z


@kernel
def site_rotation(flat: Flat, site: int, out: Record) -> None:
    """Write a site's rotation to the world, (3, 3)."""
    R, turn = flat.links[flat.sites[site].link].R, flat.sites[site].turn
    for i in range(3):
        for j in range(3):
            out[i, j] = (
                R[i, 0] * turn[0, j] + R[i, 1] * turn[1, j] + R[i, 2] * turn[2, j]
            )


@kernel
def _end_column(link: Record, x: float, y: float, z: float) -> None:
    """Write the twist of the point (x, y, z) per rate of a joint, Eq. (15)."""
    a, b, c = link.a[0], link.a[1], link.a[2]
    J, p = link.end, link.p
    if link.kind == SLIDE:
        J[0], J[1], J[2], J[3], J[4], J[5] = a, b, c, 0.0, 0.0, 0.0
        return
    x, y, z = x - p[0], y - p[1], z - p[2]
    J[0], J[1], J[2] = b * z - c * y, c * x - a * z, a * y - b * x
    J[3], J[4], J[5] = a, b, c


@kernel
def end_columns(flat: Flat, limb: Record) -> None:
    """Write the Jacobian of a limb's end, Eq. (15), to the links of its chain."""
    x, y, z = site_point(flat, limb.site)
    for n in range(limb.chain_length):
        _end_column(flat.links[limb.chain[n]], x, y, z)


@kernel
def is_square(limb: Record) -> bool:
    """Return whether a limb has six joints for six given rows."""
    return limb.own == 6 and limb.rows == 63


@kernel
def _drift(flat: Flat, limb: Record, trunk: Record, s: Record) -> None:
    """Write the twist that remains for a limb's own joints, (6,).

    Taken away is what the trunk's turning, the joints that carry the limb, and the
    rates wished in its null space do. Its columns are made on the way.
    """
    x, y, z = site_point(flat, limb.site)
    a, b, c, p, twist = trunk[0], trunk[1], trunk[2], flat.links[0].p, limb.twist
    u, v, w = x - p[0], y - p[1], z - p[2]
    s[0], s[3] = twist[0] - (b * w - c * v), twist[3] - a
    s[1], s[4] = twist[1] - (c * u - a * w), twist[4] - b
    s[2], s[5] = twist[2] - (a * v - b * u), twist[5] - c
    square = is_square(limb)
    for n in range(limb.chain_length):
        link = flat.links[limb.chain[n]]
        _end_column(link, x, y, z)
        if square and n < limb.own:
            continue
        for r in range(6):
            s[r] -= link.desired_rate * link.end[r]


@kernel
def _gram(flat: Flat, limb: Record, K: Record) -> None:
    """Write J J^T of a limb, its lower half.

    A row that is not given is made that of the identity, so that there are always six.
    """
    for r in range(6):
        for c in range(r + 1):
            K[r, c] = 0.0
    for n in range(limb.own):
        J = flat.links[limb.chain[n]].end
        for r in range(6):
            for c in range(r + 1):
                K[r, c] += J[r] * J[c]
    for r in range(6):
        if not limb.rows >> r & 1:
            for c in range(6):
                K[max(r, c), min(r, c)] = 0.0
            K[r, r] = 1.0


@kernel
def _inverse_factor(K: Record, lam2: float, L: Record) -> float:
    """Write L, lower, with L^T L = (K + lam2 I)^-1; return its squared norm.

    The norm is the inverse's trace: no eigenvalue of K + lam2 I is below its
    reciprocal. It is infinite if there is no inverse.
    """
    norm = 0.0
    for r in range(6):
        rest = K[r, r] + lam2
        for c in range(r):
            L[r, c] = 0.0
        for c in range(r):  # Gram-Schmidt in the scalar product of K
            x = 0.0
            for k in range(c + 1):
                x += L[c, k] * K[r, k]
            rest -= x * x
            for k in range(c + 1):
                L[r, k] -= x * L[c, k]
        if not rest > 0.0:
            return math.inf
        scale = 1.0 / math.sqrt(rest)
        L[r, r] = 1.0
        for c in range(r + 1):
            L[r, c] *= scale
            norm += L[r, c] * L[r, c]
    return norm


@kernel
def _least_eigenvalue(L: Record, scratch: Record) -> float:
    """Return the least eigenvalue of the matrix whose inverse is L^T L.

    By the power method on the inverse: its error shrinks with the square of the ratio
    of the two least eigenvalues, and is small from the start where they are equal.
    """
    x, y = scratch[0], scratch[1]
    for r in range(6):
        x[r] = 1.0 / (1.0 + r)
    largest = 0.0
    for _ in range(300):
        before, square = largest, 0.0
        for r in range(6):
            y[r] = 0.0
            for c in range(r + 1):
                y[r] += L[r, c] * x[c]
            square += y[r] * y[r]
        length = 0.0
        for c in range(6):
            x[c] = 0.0
            for r in range(c, 6):
                x[c] += L[r, c] * y[r]
            length += x[c] * x[c]
        largest = length / square
        scale = 1.0 / math.sqrt(length)
        for r in range(6):
            x[r] *= scale
        if abs(largest - before) < 1e-13 * largest:
            break
    return 1.0 / largest


@kernel
def _factorize(flat: Flat, limb: Record, wanted: Record) -> int:
    """Write the inverse factor of a limb's J J^T + lambda^2 I into `wanted.L`."""
    K, L = wanted.K, wanted.L
    _gram(flat, limb, K)
    threshold2 = wanted.threshold * wanted.threshold
    trace = _inverse_factor(K, 0.0, L)
    if trace * threshold2 < 1.0:
        return SOLVED  # no singular value is below the threshold
    ratio2 = 0.0
    if trace < math.inf:
        ratio2 = _least_eigenvalue(L, wanted.Y) / threshold2
    if ratio2 >= 1.0:
        return SOLVED
    if is_square(limb):
        return SINGULAR
    _inverse_factor(K, wanted.factor * wanted.factor * (1.0 - ratio2), L)
    return SOLVED


@kernel
def _solve_limb(flat: Flat, limb: Record, wanted: Record) -> int:
    """Write a_i and B_i of a limb's links."""
    s, L, Y = wanted.s, wanted.L, wanted.Y
    _drift(flat, limb, wanted.trunk, s)
    if _factorize(flat, limb, wanted) != SOLVED:
        return SINGULAR
    for r in range(6):
        given = limb.rows >> r & 1
        Y[r, 5] = s[r] if given else 0.0
        Y[r, 4] = 1.0 if given else 0.0
    for r in range(6):  # L [s, E], with E the first columns of the identity
        x = 0.0
        for c in range(r + 1):
            x += L[r, c] * Y[c, 5]
        Y[r, 0] = x
        for c in range(3):
            Y[r, 1 + c] = L[r, c] * Y[c, 4] if c <= r else 0.0
    _project(flat, limb, L, Y, is_square(limb))
    return SOLVED


@kernel
def _project(flat: Flat, limb: Record, L: Record, Y: Record, square: bool) -> None:
    """Write J^T L^T Y as a_i and B_i, and add the rates wished in the null space."""
    for c in range(4):
        for r in range(6):
            x = 0.0
            for k in range(r, 6):
                x += L[k, r] * Y[k, c]
            Y[r, c] = x
    for n in range(limb.own):
        link = flat.links[limb.chain[n]]
        link.rate = 0.0 if square else link.desired_rate
        for r in range(6):
            link.rate += link.end[r] * Y[r, 0]
        for c in range(3):
            x = 0.0
            for r in range(6):
                x += link.end[r] * Y[r, 1 + c]
            link.gain[c] = -x


@kernel
def _solve_3(M: Record, b: Record) -> bool:
    """Solve three equations by Cramer's rule, in place; return if it was possible."""
    u = M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1]
    v = M[1, 2] * M[2, 0] - M[1, 0] * M[2, 2]
    w = M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0]
    det = M[0, 0] * u + M[0, 1] * v + M[0, 2] * w
    if not abs(det) > 1e-6:
        return False
    x, y, z = b[0] / det, b[1] / det, b[2] / det
    b[0] = (
        u * x
        + (M[0, 2] * M[2, 1] - M[0, 1] * M[2, 2]) * y
        + (M[0, 1] * M[1, 2] - M[0, 2] * M[1, 1]) * z
    )
    b[1] = (
        v * x
        + (M[0, 0] * M[2, 2] - M[0, 2] * M[2, 0]) * y
        + (M[0, 2] * M[1, 0] - M[0, 0] * M[1, 2]) * z
    )
    b[2] = (
        w * x
        + (M[0, 1] * M[2, 0] - M[0, 0] * M[2, 1]) * y
        + (M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]) * z
    )
    return True


@kernel
def _prepare(flat: Flat) -> None:
    """Take all rates as given, before limbs are solved for."""
    links = flat.links
    for k in range(1, len(links)):
        link = links[k]
        if link.leader:
            link.desired_rate = link.ratio * links[link.leader].desired_rate
        link.rate = link.desired_rate
        link.gain[0] = link.gain[1] = link.gain[2] = 0.0


@kernel
def _solve_base(flat: Flat, wanted: Record) -> bool:
    """Solve Eq. (21) for the velocity of the body center, into `wanted.b`."""
    M, b, w = wanted.K, wanted.b, wanted.trunk
    com, p = flat.links[0].moment, flat.links[0].p
    x, y, z = com[0] - p[0], com[1] - p[1], com[2] - p[2]
    b[0] = wanted.com[0] - (w[1] * z - w[2] * y)
    b[1] = wanted.com[1] - (w[2] * x - w[0] * z)
    b[2] = wanted.com[2] - (w[0] * y - w[1] * x)
    for i in range(3):
        for j in range(3):
            M[i, j] = 1.0 if i == j else 0.0
    for k in range(1, len(flat.links)):
        link = flat.links[k]
        for i in range(3):
            b[i] -= link.lever[i] * link.rate
            for j in range(3):
                M[i, j] += link.lever[i] * link.gain[j]
    return _solve_3(M, b)


@kernel
def resolve(flat: Flat, wanted: Record, v: np.ndarray) -> int:
    """Resolve a task where the links are placed, Eqs. (22)-(25).

    Args:
        flat: The robot after `place_links` and `find_levers`, with what is wanted of
            its limbs and links.
        wanted: A record of the dtype `WANTED`.
        v: Where v = [xdot_o; qdot] is written, of shape (6 + joints,).

    Returns:
        SOLVED, or SINGULAR where the damped and weighted resolution has to be used.
    """
    _prepare(flat)
    for i in range(len(flat.limbs)):
        limb = flat.limbs[i]
        if limb.rows and _solve_limb(flat, limb, wanted) != SOLVED:
            return SINGULAR
    if not _solve_base(flat, wanted):
        return SINGULAR
    b, w = wanted.b, wanted.trunk
    for i in range(3):
        v[i], v[3 + i] = b[i], w[i]
    for k in range(1, len(flat.links)):
        link = flat.links[k]
        g = link.gain
        v[5 + k] = link.rate + g[0] * b[0] + g[1] * b[1] + g[2] * b[2]
    return SOLVED


@kernel
def resolve_limb(
    flat: Flat, limb: Record, wanted: Record, velocity: Record, spin: Record
) -> int:
    """Resolve the twist of one limb's end, the body's being given, Eq. (18).

    Args:
        flat: The robot, placed.
        limb: The limb, with its twist. Joints that carry it rest.
        wanted: Scratch, and how singular limbs give way.
        velocity: Velocity of the body center [m/s], world, (3,).
        spin: Angular velocity of the body [rad/s], world, (3,).

    Returns:
        SOLVED, with the rates of its own links in their `rate`; or SINGULAR.
    """
    for n in range(limb.chain_length):
        flat.links[limb.chain[n]].desired_rate = 0.0
    for i in range(3):
        wanted.trunk[i] = spin[i]
    if _solve_limb(flat, limb, wanted) != SOLVED:
        return SINGULAR
    for n in range(limb.own):
        link = flat.links[limb.chain[n]]
        for i in range(3):
            link.rate += link.gain[i] * velocity[i]
    return SOLVED


@kernel
def resolve_at(handle: np.ndarray, q: np.ndarray, v: np.ndarray) -> int:
    """Resolve a task at a configuration; see `place_links` and `resolve`."""
    flat = flat_at(handle)
    place_links(flat.links, q)
    find_levers(flat)
    return resolve(flat, wanted_at(handle)[0], v)


@kernel
def integrate(flat: Flat, q: np.ndarray, v: np.ndarray, dt: float) -> None:
    """Move a configuration by a velocity for a time; `Kinematics.integrate`.

    The rotation is that of a constant angular velocity.
    """
    for i in range(3):
        q[i] += dt * v[i]
    rate = math.sqrt(v[3] * v[3] + v[4] * v[4] + v[5] * v[5])
    half = 0.5 * dt * rate
    c, k = math.cos(half), (math.sin(half) / rate if rate > 1e-12 else 0.5 * dt)
    x, y, z = k * v[3], k * v[4], k * v[5]
    a, b, d, e = q[3], q[4], q[5], q[6]
    w = c * a - x * b - y * d - z * e
    u = c * b + x * a + y * e - z * d
    s = c * d + y * a + z * b - x * e
    t = c * e + z * a + x * d - y * b
    scale = 1.0 / math.sqrt(w * w + u * u + s * s + t * t)
    q[3], q[4], q[5], q[6] = scale * w, scale * u, scale * s, scale * t
    for j in range(len(flat.links) - 1):
        q[7 + j] += dt * v[6 + j]
