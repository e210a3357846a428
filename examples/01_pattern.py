# /// script
# dependencies = ["comwalk"]
# ///
"""Plan CoM and ZMP from footsteps, and check that the plan proves itself."""

import numpy as np

import comwalk as cw
from comwalk.views import plot_pattern

plan = cw.plan_steps(cw.Gait(half_step=0.1, turn=0.1), 8)  # a curve, 0.1 rad a step
pattern = cw.make_pattern(plan, cw.Pendulum(height=0.687))

times = np.linspace(0.0, pattern.duration, 1000)  # [s]
print(f"{plan.count} steps in {pattern.duration:.1f} s")
print(f"p = c - c''/omega^2 holds within {pattern.zmp_residual(times):.0e} m")
print(f"the ZMP stays {1e3 * pattern.hull_margin(times).min():.0f} mm inside the soles")

reference = pattern.at(3.0)  # all that is asked for at 3 s
print(f"at 3 s: CoM {reference.com.round(3)} m, {reference.phase.name.lower()}")
plot_pattern(pattern, "pattern.png")
