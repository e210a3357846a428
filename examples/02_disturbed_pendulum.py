# /// script
# dependencies = ["comwalk"]
# ///
"""Disturb the paper's simplified model, Eq. (30), and compare with what is proved."""

import numpy as np

import comwalk as cw
from comwalk.certificates import is_hurwitz, proof_condition, worst_case
from comwalk.control import random_bounded

pendulum = cw.Pendulum(height=0.687)
gains = cw.Gains(zmp=3.0, com=6.6, standing_zmp=3.0, standing_com=6.6)
print("stable:", is_hurwitz(3.0, 6.6))
print("covered by the paper's Lyapunov function:", proof_condition(pendulum, 3.0, 6.6))

bound = worst_case(pendulum, 3.0, 6.6, 0.05, 0.5, "com").bound  # [m]
print(f"a disturbance below 0.05 m/s moves the CoM by at most {1e3 * bound:.1f} mm")

pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 4), pendulum)
control = cw.Control(gains=gains)
calm = cw.simulate_pendulum(pattern, control=control)
for seed in range(3):
    noise = random_bounded(0.05, 0.5, seed, duration=pattern.duration + 1.0)
    run = cw.simulate_pendulum(pattern, control=control, disturbance=noise)
    moved = np.abs(run.log["com"] - calm.log["com"]).max()
    print(f"seed {seed}: moved by {1e3 * moved:.1f} mm")
