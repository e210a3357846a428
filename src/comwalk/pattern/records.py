"""References and phases of a pattern as records of plain numbers, for kernels.

What is computed in every tick, or for thousands of robots at once, has no objects: a
reference is one record of `REFERENCE`, and a pattern is a table with one row of
`PHASE_SIZE` numbers per phase. All in SI units, radians and world axes, as in
`Reference`. Feet are 0 left and 1 right.
"""

from __future__ import annotations

import numpy as np

FOOT = np.dtype(
    [
        ("position", "f8", 3),  # centre of the sole [m]
        ("yaw", "f8"),  # [rad]
        ("velocity", "f8", 3),  # [m/s]
        ("yaw_rate", "f8"),  # [rad/s]
    ]
)
"""Where a foot is to be, and how it moves."""

REFERENCE = np.dtype(
    [
        ("time", "f8"),  # [s]
        ("com", "f8", 3),  # [m]
        ("com_velocity", "f8", 3),  # [m/s]
        ("com_acceleration", "f8", 3),  # [m/s^2]
        ("zmp", "f8", 2),  # [m]
        ("phase", "i8"),  # `Phase` as a number
        ("support", "i8"),  # foot of the base limb
        ("left_load", "f8"),  # planned share of the weight on the left foot [-]
        ("heading", "f8"),  # yaw of the trunk [rad]
        ("heading_rate", "f8"),  # [rad/s]
        ("walking", "f8"),  # 0 standing to 1 walking [-]
        ("step", "i8"),  # number of footsteps that have landed
        ("feet", FOOT, 2),
    ]
)
"""What a pattern asks for at one time."""

# A phase.

START = 0
"""When it starts [s]."""
DURATION = 1
"""How long it lasts, S [s]."""
KIND = 2
"""`pattern.Phase` as a number."""
LANDED = 3
"""Number of footsteps that have landed."""
BASES = 4
"""First of two: foot of the base limb in its first and in its second half."""
LOADS = 6
"""First of two: load of the left foot at its start and its end [-]."""
BLENDS = 8
"""First of two: `Reference.walking` at its start and its end [-]."""
CURVE_X = 10
"""First of eight: a_0 .. a_5, r_0, r_1 of the CoM in x [m]."""
CURVE_Y = 18
"""First of eight: the same in y."""
INVERSE_SINH = 26
"""1 / sinh(omega_n S), or 0 where no curve has a hyperbolic part [-]."""
SWINGING = 27
"""The foot that swings, or -1."""
RESTING = 28
"""First of six: x, y [m], yaw [rad] of the left and of the right foot at its start."""
TRAVEL = 34
"""First of three: way of the swing foot in x and y [m], and its turn [rad]."""
CLEARANCE = 37
"""Height of the swing foot in the middle [m]."""
TURN = 38
"""First of four: the cubic of the heading, its highest power first [rad, s]."""
TURN_START = 42
"""Time at which the argument of the cubic is 0 [s]."""
TURN_END = 43
"""Time after which the heading rests [s]."""
PHASE_SIZE = 44
"""Numbers of a phase."""
