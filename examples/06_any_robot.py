# /// script
# dependencies = ["comwalk", "jvrc_description"]
# ///
"""Walk a humanoid from its file: `python 06_any_robot.py [my_robot.urdf]`."""

import sys

import comwalk as cw
from comwalk.certificates import feasibility

source = sys.argv[1] if len(sys.argv) == 2 else "jvrc1"  # a file, or a name
robot = cw.load_robot(source)
print(f"{robot.name}: {robot.mass:.1f} kg, {len(robot.joints)} joints")
for limb in robot.limbs:
    print(f"  {limb.name}: {len(limb.joints)} joints")
for note in robot.notes:
    print(f"  {note}")

pendulum = cw.default_pendulum(robot)
print(f"CoM at {pendulum.height:.3f} m, omega_n = {pendulum.omega:.2f} rad/s")
pattern = cw.walk_pattern(robot, 3)  # steps; speed=0.3 [m/s] would ask for more
asked = feasibility(robot, pattern)
print("the hardest it asks:", asked.table(3), sep="\n")
if not asked.ok:
    raise SystemExit("the robot is not able to walk so")

run = cw.simulate(robot, pattern)
print(run.outcome)
print(f"ZMP error, rms: {run.summary()['zmp_error_rms_mm']}")
run.plot("any_robot.png")
