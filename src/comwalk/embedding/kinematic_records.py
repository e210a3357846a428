"""A robot as flat records of plain numbers, which compiled kernels run on.

A *link* is all that moves with one joint; link 0 is the body center. In the model's
zero posture all link frames have the axes of the body center, and each has its origin
at its joint's anchor, so that kinematics are one rotation about one axis a joint.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..handles import inlined, records_at

ANY_AXIS, SLIDE = 3, 4
"""Kinds of joints; 0, 1 and 2 turn about x, y and z."""


LONGEST = 32
"""Most links that a limb's end may hang on."""


_LINK = (
    # What the robot is like.
    ("parent", "i8"),
    ("kind", "i8"),
    ("leader", "i8"),  # link that it follows, 0 if none
    ("ratio", "f8"),  # its rate over the leader's
    ("offset", "f8", 3),  # origin, in the parent [m]
    ("axis", "f8", 3),
    ("zero", "f8"),  # angle in the zero posture [rad]
    ("mass", "f8"),  # share of the robot's mass [-]
    ("first", "f8", 3),  # that times its CoM [m]
    ("below", "f8"),  # share of the mass of all that it carries [-]
    # Where it is, in the world.
    ("R", "f8", (3, 3)),
    ("p", "f8", 3),  # origin [m]
    ("a", "f8", 3),  # axis
    ("moment", "f8", 3),  # share of the mass below times its CoM [m]
    ("lever", "f8", 3),  # CoM's velocity per rate, Eq. (21) [m/rad]
    ("end", "f8", 6),  # twist of its limb's end per rate, Eq. (15)
    # How it moves.
    ("desired_rate", "f8"),  # rate that is given, or wished in the null space [rad/s]
    ("rate", "f8"),  # a_i: rate that does not depend on the body center [rad/s]
    ("gain", "f8", 3),  # B_i: rate per velocity of the body center [rad/m]
)


_LIMB = (
    ("own", "i8"),  # number of its own links, first in its chain
    ("chain_length", "i8"),  # number of links in its chain
    ("chain", "i8", LONGEST),  # its links, then those of others that carry its end
    ("site", "i8"),  # site of its end, -1 if none is marked
    ("rows", "i8"),  # bits of the end's twist that are given; 0 in joint space
    ("twist", "f8", 6),  # the end's twist [m/s; rad/s]
)


_SITE = (("link", "i8"), ("point", "f8", 3), ("turn", "f8", (3, 3)))


LINK, LIMB, SITE = (np.dtype(list(x), align=True) for x in (_LINK, _LIMB, _SITE))
"""Records of a link, a limb and a site."""


WANTED = np.dtype(
    [
        ("com", "f8", 3),  # CoM velocity [m/s]
        ("trunk", "f8", 3),  # angular velocity of the body center [rad/s]
        ("threshold", "f8"),  # `Damping.threshold` [m/rad]
        ("factor", "f8"),  # `Damping.factor` [-]
        ("K", "f8", (6, 6)),
        ("L", "f8", (6, 6)),
        ("Y", "f8", (6, 6)),
        ("s", "f8", 6),
        ("b", "f8", 3),
        ("scratch", "f8", 7),
    ],
    align=True,
)
"""What is wanted of the whole body, and scratch space."""


class Flat(NamedTuple):
    """A robot's records, and the workspace of kernels; not shared by two users."""

    links: np.ndarray
    """The body center, then the link of each joint."""
    limbs: np.ndarray
    """The limbs, in the robot's order."""
    sites: np.ndarray
    """Sites that were asked for, then the limbs' ends."""


@inlined
def flat_at(handle: np.ndarray) -> Flat:
    """Return the robot that the first three arrays of a handle are."""
    return Flat(
        records_at(handle, 0, LINK),
        records_at(handle, 1, LIMB),
        records_at(handle, 2, SITE),
    )


@inlined
def wanted_at(handle: np.ndarray) -> np.ndarray:
    """Return the targets of the whole body: the fourth array of a handle."""
    return records_at(handle, 3, WANTED)
