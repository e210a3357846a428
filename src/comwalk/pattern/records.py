"""References and phases of a pattern as records of plain numbers, for kernels.

What is computed in every tick, or for thousands of robots at once, has no objects: a
reference is one record of `REFERENCE`, and a pattern a table of `PHASE`. All in SI
units, radians and world axes, as in `Reference`. Feet are 0 left and 1 right. Records
are aligned, since a kernel is compiled anew for arrays that are not.
"""

from __future__ import annotations

import numpy as np

FOOT = np.dtype(
    [
        ("position", "f8", 3),  # centre of the sole [m]
        ("yaw", "f8"),  # [rad]
        ("velocity", "f8", 3),  # [m/s]
        ("yaw_rate", "f8"),  # [rad/s]
        ("acceleration", "f8", 3),  # [m/s^2]
        ("yaw_acceleration", "f8"),  # [rad/s^2]
    ],
    align=True,
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
    ],
    align=True,
)
"""What a pattern asks for at one time."""

PHASE = np.dtype(
    [
        ("start", "f8"),  # when it starts [s]
        ("duration", "f8"),  # how long it lasts, S [s]
        ("kind", "i8"),  # `Phase` as a number
        ("landed", "i8"),  # number of footsteps that have landed
        ("bases", "i8", 2),  # foot of the base limb, first and second half
        ("loads", "f8", 2),  # load of the left foot at its start and end [-]
        ("blends", "f8", 2),  # `Reference.walking` at its start and end [-]
        ("curve", "f8", (2, 8)),  # a_0 .. a_5, r_0, r_1 of the CoM in x and y [m]
        ("inverse_sinh", "f8"),  # 1 / sinh(omega_n S), 0 without hyperbolic part [-]
        ("swinging", "i8"),  # the foot that swings, or -1
        ("resting", "f8", (2, 3)),  # x, y [m], yaw [rad] of the feet at its start
        ("travel", "f8", 3),  # way of the swing foot in x and y [m], its turn [rad]
        ("clearance", "f8"),  # height of the swing foot in the middle [m]
        ("turn", "f8", 4),  # cubic of the heading, highest power first [rad, s]
        ("turn_start", "f8"),  # time at which the argument of the cubic is 0 [s]
        ("turn_end", "f8"),  # time after which the heading rests [s]
        ("path_start", "f8"),  # when the swing foot was sent elsewhere [s]
        ("path_time", "f8"),  # how long it goes there [s]; 0 if it never was
        ("path_lift", "f8"),  # by how much it is lifted on the way [m]
        ("path", "f8", (4, 4)),  # cubics of its x, y, z and yaw, lowest power first
    ],
    align=True,
)
"""One phase of a pattern; a pattern is an array of them in order of time."""

STEP = np.dtype(
    [
        ("foot", "i8"),  # the one that swings
        ("pose", "f8", 3),  # where it lands: x, y [m], yaw [rad]
        ("single", "f8"),  # duration of the single support [s]
        ("double", "f8"),  # duration of the double support before it [s]
        ("clearance", "f8"),  # of the swing foot [m]
        ("stand", "f8"),  # time to stand still after it [s]; negative to walk on
    ],
    align=True,
)
"""A footstep."""

WORK = np.dtype(
    [
        (
            "diag",
            "f8",
        ),  # diagonal of the tridiagonal system that links the phases [1/s]
        ("beside", "f8"),  # its next element in the row [1/s]
        ("com", "f8", 2),  # right side [m/s], then the CoM at a phase's start [m]
        ("knot", "f8"),  # a knot of the heading [s]
        ("yaw", "f8"),  # the heading there [rad]
        ("rate", "f8"),  # its rate [rad/s]
    ],
    align=True,
)
"""Scratch of one phase while a pattern is made."""

COMMAND = np.dtype(
    [
        ("length", "f8"),  # of a step, 2 B [m]
        ("shift", "f8"),  # sideways, of the body per step [m]
        ("turn", "f8"),  # of the body per step [rad]
        ("width", "f8"),  # half of the distance between the feet, A [m]
        ("single", "f8"),  # single support [s]
        ("double", "f8"),  # double support [s]
        ("clearance", "f8"),  # of the swing foot [m]
        ("start", "f8"),  # time of starting [s]
        ("stop", "f8"),  # time of stopping [s]
        ("walk", "b1"),  # whether to walk
        ("given", "b1"),  # whether the next foothold is given
        ("foothold", "f8", 3),  # then, where: x, y [m], yaw [rad]
        ("ahead", "i8"),  # steps planned beyond the one being made
        ("least", "f8"),  # shortest rest of a phase that is changed [s]
        ("minjerk", "b1"),  # whether the ZMP crosses by minimum jerk
        ("omega", "f8"),  # omega_n [rad/s]
        ("height", "f8"),  # c_z [m]
        ("sole", "f8", 2),  # length and width [m]
        ("first", "i8"),  # foot that swings first
        ("steps", "i8"),  # footsteps of the plan that is followed; 0 for a gait
        ("stand", "f8"),  # time of standing after them [s]
        ("back", "f8"),  # how far a step comes back to where it was planned [m]
    ],
    align=True,
)
"""What an `OnlinePattern` is told to walk."""

ONLINE = np.dtype(
    [
        ("rows", "i8"),  # phases of the table that are in use
        ("knot", "f8"),  # last knot of the heading [s]
        ("knot_yaw", "f8"),  # the heading there [rad]
        ("single", "f8"),  # of the last step that landed: its single support [s]
        ("double", "f8"),  # its double support [s]
        ("clearance", "f8"),  # its clearance [m]
        ("feet", "f8", (2, 3)),  # scratch: x, y [m], yaw [rad] of the feet
        ("step", STEP, 1),  # scratch: the step that is being planned
    ],
    align=True,
)
"""Where an `OnlinePattern` is."""

ADAPTATION = np.dtype(
    [
        # What the legs can do, `adaptation.Agility`, and the pendulum.
        ("half", "f8", 2),
        ("leg", "f8"),
        ("tall", "f8"),
        ("hip", "f8", 2),
        ("lowest", "f8"),
        ("swings", "f8"),
        ("aside", "f8"),
        ("beside", "f8"),
        ("speed", "f8"),
        ("rush", "f8"),
        ("omega", "f8"),  # omega_n [rad/s]
        ("height", "f8"),  # c_z [m]
        # The step that is made.
        ("start", "f8"),  # its lift-off [s]
        ("until", "f8"),  # its touchdown, as planned [s]
        ("foothold", "f8", 2),  # as planned [m], world
        ("lead", "f8", 2),  # of the DCM after double support, as planned [m], world
        ("moved", "i8"),  # whether it was moved
        ("active", "i8"),  # whether it, or the one before, was
        ("moves", "i8"),  # number of steps that were moved
        # The same in the frame of the stance foot: ahead, and towards the swing foot.
        ("away", "f8", 2),  # the stance foot from its reference [m], world
        ("origin", "f8", 2),  # of the frame [m], world
        ("cos", "f8"),  # of its yaw
        ("sin", "f8"),
        ("sign", "f8"),  # 1 if the left foot swings, else -1
        ("com", "f8", 2),  # [m]
        ("rate", "f8", 2),  # of the CoM [m/s]
        ("planned", "f8", 2),  # foothold [m]
        ("ahead", "f8", 2),  # lead of the DCM [m]
        ("foot", "f8", 2),  # that swings [m]
        ("foot_rate", "f8", 2),  # [m/s]
        ("goal", "f8", 2),  # where it goes [m]
        # The CoM's height.
        ("drop", "f8"),  # by how much it is to be lowered [m]
        ("sink", "f8"),  # by how much it is [m]
        ("sink_rate", "f8"),  # [m/s]
    ],
    align=True,
)
"""How steps are moved with the measured CoM, and what is known of the one made."""

ONLINE_ARRAYS = PHASE, ONLINE, COMMAND, WORK, STEP, ADAPTATION
"""What `OnlinePattern.arrays` are records of."""
