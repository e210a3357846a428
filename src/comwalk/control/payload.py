"""Payload estimation: mass and CoM offset of the standing robot.

At rest the CoM is over the ZMP, whatever the model says. A load unknown to the model
shows as a distance b between the two, and as a larger weight. Left alone, the law would
amplify it: at rest k_p (p - p_d) + k_c (c_m - c_d) = 0, and p = c_m + b gives an error
of the true CoM of b k_c / (k_c - k_p), nearly 2 b with the paper's gains.
"""

from __future__ import annotations

import math

from ..compiled import Record, kernel
from ..pattern import STAND, minimum_jerk

WEIGHING_TIME = 0.25
"""Time over which the standing robot is weighed [s]."""

RISE_TIME = 0.25
"""Time over which the law's feedback rises from zero after that [s]."""


@kernel
def weigh_standing(rules: Record, state: Record, reference: Record) -> None:
    """Learn what the standing robot weighs, and correct the measured CoM.

    Readings are averaged for `WEIGHING_TIME`. The law must not act meanwhile: fed with
    a CoM that follows the ZMP, it would chase it. So `state.feedback_scale` is zero
    until then, and rises smoothly to 1.

    Args:
        rules: Its `weight` is the model's [N], `most` the number of readings.
        state: `com`, `zmp` and `load` of this tick; what is learnt stays in
            `mass_ratio`, `lean` (in the heading's axes [m]) and `seen`.
        reference: A record of `REFERENCE`.
    """
    heading = reference.heading
    c, s, lean = math.cos(heading), math.sin(heading), state.lean
    state.feedback_scale = 1.0
    if reference.phase == STAND and reference.step == 0:
        mass_ratio = state.load / rules.weight
        if state.seen < rules.most and 0.5 < mass_ratio < 2.0:
            state.seen += 1
            a = 1.0 / state.seen
            x, y = state.zmp[0] - state.com[0], state.zmp[1] - state.com[1]
            state.mass_ratio += a * (mass_ratio - state.mass_ratio)
            lean[0] += a * (c * x + s * y - lean[0])
            lean[1] += a * (c * y - s * x - lean[1])
        state.feedback_scale = minimum_jerk(
            (reference.time - WEIGHING_TIME) / RISE_TIME
        )[0]
    state.com[0] += c * lean[0] - s * lean[1]
    state.com[1] += s * lean[0] + c * lean[1]
