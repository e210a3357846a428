# /// script
# dependencies = ["comwalk"]
# ///
"""Walk footsteps of one's own: a long step, a turned one, a slow one; then a push."""

import comwalk as cw

plan = cw.FootstepPlan(
    left=cw.Foothold(0.0, 0.09),
    right=cw.Foothold(0.0, -0.09),
    steps=(
        cw.Footstep(side="right", x=0.15, y=-0.10),  # [m]
        cw.Footstep(side="left", x=0.30, y=0.09, yaw=0.2),  # [rad]
        cw.Footstep(side="right", x=0.36, y=-0.11, yaw=0.2, single_support=1.2),  # [s]
        cw.Footstep(side="left", x=0.32, y=0.08, yaw=0.2),
    ),
)
push = cw.Push(start=3.0, force=(0.0, 80.0, 0.0), duration=0.1)  # [s], [N]
run = cw.simulate(
    cw.load_robot("paper"),
    cw.make_pattern(plan, cw.Pendulum()),
    physics=cw.SimulatorSettings(pushes=(push,)),
)
print(run.outcome)
print(f"{1e3 * run.summary()['position_error_m']:.1f} mm from where it should end")
run.save("own_footsteps")
