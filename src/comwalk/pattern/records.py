"""How a reference and the phases of a pattern lie in flat arrays of numbers.

What is computed every tick by compiled code, or for thousands of robots at once, has no
objects: a reference is one row of `ROW_SIZE` numbers, and a pattern is a table with one
row of `PHASE_SIZE` numbers per phase. Here is what stands where; all in SI units,
radians and world axes, as in `pattern.Reference`. Feet are 0 left and 1 right.
"""

from __future__ import annotations

# A reference.

TIME = 0
"""Time [s]."""
COM = 1
"""First of three: CoM [m]."""
COM_VELOCITY = 4
"""First of three: velocity of the CoM [m/s]."""
COM_ACCELERATION = 7
"""First of three: acceleration of the CoM [m/s^2]."""
ZMP = 10
"""First of two: ZMP [m]."""
PHASE = 12
"""`pattern.Phase` as a number."""
SUPPORT = 13
"""Foot of the base limb."""
LEFT_LOAD = 14
"""Planned share of the weight on the left foot [-]."""
HEADING = 15
"""Yaw of the trunk [rad]."""
HEADING_RATE = 16
"""Rate of the yaw of the trunk [rad/s]."""
WALKING = 17
"""0 standing to 1 walking [-]."""
STEP = 18
"""Number of footsteps that have landed."""
LEFT_FOOT = 19
"""First of eight: x, y, z [m] and yaw [rad] of the left sole, then their rates."""
RIGHT_FOOT = 27
"""First of eight: the same of the right sole."""
ROW_SIZE = 35
"""Numbers of a reference."""

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
