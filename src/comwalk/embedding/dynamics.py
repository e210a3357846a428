r"""Dynamics on a robot's records: velocities, accelerations and joint torques.

The resolution one derivative higher, and what it costs: with
:math:`\dot v` resolved from :math:`A \dot v = b - \dot A v`, in which A is the matrix
of Eqs. (14)-(27), the recursive Newton-Euler algorithm gives

.. math:: t = M(q) \dot v + h(q, v)

whose first six rows are the wrench that the ground has to exert on the robot. All
vectors are in world axes. `move_links` and `accelerate_links` come after
`kinematics.place_links`; MuJoCo's and Pinocchio's inverse dynamics are the oracles.
"""

from __future__ import annotations

import numpy as np

from ..compiled import Record, kernel
from .kinematic_records import SLIDE, Flat
from .kinematics import turned

BODY = np.dtype(
    [
        ("mass", "f8"),  # of the link [kg]
        ("first", "f8", 3),  # that times its CoM from the link's origin [kg m]
        ("inertia", "f8", (3, 3)),  # about the link's origin, link axes [kg m^2]
        ("armature", "f8"),  # rotor inertia at the joint [kg m^2]
        ("spin", "f8", 3),  # angular velocity [rad/s]
        ("velocity", "f8", 3),  # of the link's origin [m/s]
        ("turning", "f8", 3),  # angular acceleration [rad/s^2]
        ("acceleration", "f8", 3),  # of the link's origin [m/s^2]
        ("force", "f8", 3),  # that moves the link and all beyond it [N]
        ("moment", "f8", 3),  # the same about the link's origin [N m]
    ],
    align=True,
)
"""Inertia and motion of a link."""


@kernel
def _cross(a: Record, b: Record) -> tuple[float, float, float]:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def move_links(flat: Flat, bodies: np.ndarray, v: np.ndarray) -> None:
    """Find velocities of all links, and their accelerations while v is constant.

    Args:
        flat: The robot, placed.
        bodies: Records of `BODY`, one for each link.
        v: Velocity v = [xdot_o; qdot] [m/s, rad/s], world, (6 + joints,).
    """
    links, base = flat.links, bodies[0]
    for i in range(3):
        base.velocity[i], base.spin[i] = v[i], v[3 + i]
        base.acceleration[i] = base.turning[i] = 0.0
    for k in range(1, len(links)):
        link, body = links[k], bodies[k]
        up, rate, a = bodies[link.parent], v[5 + k], link.a
        o = links[link.parent].p
        r = (link.p[0] - o[0], link.p[1] - o[1], link.p[2] - o[2])
        w = up.spin
        around = _cross(w, r)
        central, tangent = _cross(w, around), _cross(up.turning, r)
        across = _cross(w, a)
        for i in range(3):
            body.velocity[i] = up.velocity[i] + around[i]
            body.acceleration[i] = up.acceleration[i] + central[i] + tangent[i]
            body.spin[i], body.turning[i] = w[i], up.turning[i]
            if link.kind == SLIDE:
                body.velocity[i] += rate * a[i]
                body.acceleration[i] += 2.0 * rate * across[i]
            else:
                body.spin[i] += rate * a[i]
                body.turning[i] += rate * across[i]


@kernel
def move_com(flat: Flat, bodies: np.ndarray, velocity: Record, bias: Record) -> None:
    """Write the CoM's velocity, and its acceleration while v is constant.

    Args:
        flat: The robot, placed.
        bodies: Its links after `move_links`.
        velocity: Where the velocity goes [m/s], world, (3,).
        bias: Where the acceleration goes [m/s^2], world, (3,).
    """
    mass = 0.0
    for i in range(3):
        velocity[i] = bias[i] = 0.0
    for k in range(len(bodies)):
        body, w = bodies[k], bodies[k].spin
        s = turned(flat.links[k].R, body.first)
        around = _cross(w, s)
        central, tangent = _cross(w, around), _cross(body.turning, s)
        mass += body.mass
        for i in range(3):
            velocity[i] += body.mass * body.velocity[i] + around[i]
            bias[i] += body.mass * body.acceleration[i] + central[i] + tangent[i]
    for i in range(3):
        velocity[i] /= mass
        bias[i] /= mass


@kernel
def move_site(
    flat: Flat, bodies: np.ndarray, site: int, twist: Record, bias: Record
) -> None:
    """Write the twist of a site, and its acceleration while v is constant.

    Args:
        flat: The robot, placed.
        bodies: Its links after `move_links`.
        site: Which of its sites.
        twist: Where the twist goes [m/s; rad/s], world, (6,).
        bias: Where its rate goes [m/s^2; rad/s^2], world, (6,).
    """
    k = flat.sites[site].link
    body, w = bodies[k], bodies[k].spin
    r = turned(flat.links[k].R, flat.sites[site].point)
    around = _cross(w, r)
    central, tangent = _cross(w, around), _cross(body.turning, r)
    for i in range(3):
        twist[i], twist[3 + i] = body.velocity[i] + around[i], w[i]
        bias[i] = body.acceleration[i] + central[i] + tangent[i]
        bias[3 + i] = body.turning[i]


@kernel
def accelerate_links(flat: Flat, bodies: np.ndarray, a: np.ndarray) -> None:
    """Add to the links' accelerations what the rate of v brings.

    Args:
        flat: The robot, placed.
        bodies: Its links after `move_links`.
        a: Rate of v [m/s^2, rad/s^2], world, (6 + joints,).
    """
    links = flat.links
    for i in range(3):
        bodies[0].acceleration[i] += a[i]
        bodies[0].turning[i] += a[3 + i]
    # What a link adds for its own joint is kept in force and moment on the way down.
    for i in range(3):
        bodies[0].force[i], bodies[0].moment[i] = a[i], a[3 + i]
    for k in range(1, len(links)):
        link, body = links[k], bodies[k]
        up, rate = bodies[link.parent], a[5 + k]
        o = links[link.parent].p
        r = (link.p[0] - o[0], link.p[1] - o[1], link.p[2] - o[2])
        tangent = _cross(up.moment, r)
        for i in range(3):
            body.force[i] = up.force[i] + tangent[i]
            body.moment[i] = up.moment[i]
            if link.kind == SLIDE:
                body.force[i] += rate * link.a[i]
            else:
                body.moment[i] += rate * link.a[i]
            body.acceleration[i] += body.force[i]
            body.turning[i] += body.moment[i]


@kernel
def _load_link(R: Record, body: Record, gravity: float) -> None:
    """Write force and moment that a link alone needs; gravity is an acceleration up."""
    s, w, A = turned(R, body.first), body.spin, body.acceleration
    x, y, z = A[0], A[1], A[2] + gravity
    around = _cross(w, s)
    central, tangent = _cross(w, around), _cross(body.turning, s)
    m, f = body.mass, body.force
    f[0] = m * x + central[0] + tangent[0]
    f[1] = m * y + central[1] + tangent[1]
    f[2] = m * z + central[2] + tangent[2]
    lift, t, inertia = _cross(s, (x, y, z)), body.turning, body.inertia
    w_x = R[0, 0] * w[0] + R[1, 0] * w[1] + R[2, 0] * w[2]
    w_y = R[0, 1] * w[0] + R[1, 1] * w[1] + R[2, 1] * w[2]
    w_z = R[0, 2] * w[0] + R[1, 2] * w[1] + R[2, 2] * w[2]
    t_x = R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2]
    t_y = R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2]
    t_z = R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2]
    h = turned(inertia, (w_x, w_y, w_z))
    gyric, own = _cross((w_x, w_y, w_z), h), turned(inertia, (t_x, t_y, t_z))
    n = turned(R, (own[0] + gyric[0], own[1] + gyric[1], own[2] + gyric[2]))
    for i in range(3):
        body.moment[i] = lift[i] + n[i]


@kernel
def load_links(
    flat: Flat, bodies: np.ndarray, a: np.ndarray, gravity: float, t: np.ndarray
) -> None:
    """Find the generalised forces t = M dv/dt + h of a motion (Newton-Euler).

    Args:
        flat: The robot, placed.
        bodies: Its links after `move_links` and `accelerate_links`.
        a: Rate of v, for the rotors [m/s^2, rad/s^2].
        gravity: Gravitational acceleration [m/s^2], downwards.
        t: Where they go: force [N] and moment about the body center [N m], world, then
            torques of the joints [N m], (6 + joints,). A joint that leads others bears
            their torques, and theirs are zero.
    """
    links = flat.links
    for k in range(len(links)):
        _load_link(links[k].R, bodies[k], gravity)
    for k in range(len(links) - 1, 0, -1):
        link, body = links[k], bodies[k]
        f, n, axis = body.force, body.moment, link.a
        own = f if link.kind == SLIDE else n
        t[5 + k] = axis[0] * own[0] + axis[1] * own[1] + axis[2] * own[2]
        t[5 + k] += body.armature * a[5 + k]
        up, o = bodies[link.parent], links[link.parent].p
        r = (link.p[0] - o[0], link.p[1] - o[1], link.p[2] - o[2])
        lift = _cross(r, f)
        for i in range(3):
            up.force[i] += f[i]
            up.moment[i] += n[i] + lift[i]
    for i in range(3):
        t[i], t[3 + i] = bodies[0].force[i], bodies[0].moment[i]
    fold_torques(links, t)


@kernel
def fold_torques(links: np.ndarray, t: np.ndarray) -> None:
    """Give the torques of joints that follow to those that lead them.

    Args:
        links: Records of `LINK`.
        t: Generalised forces, changed in place, (6 + joints,).
    """
    for k in range(1, len(links)):
        link = links[k]
        if link.leader:
            t[5 + link.leader] += link.ratio * t[5 + k]
            t[5 + k] = 0.0
