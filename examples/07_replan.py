# /// script
# dependencies = ["comwalk"]
# ///
"""Command a walk while it is walked, as by a joystick: forward, a curve, back, stop."""

import sys

import comwalk as cw
from comwalk.certificates import default_control
from comwalk.control import WalkingController, walk
from comwalk.pattern import OnlinePattern
from comwalk.walking import SimulatedRobot, WholeBody

robot = cw.load_robot(sys.argv[1] if len(sys.argv) > 1 else "paper")
gait, control = cw.default_gait(robot), default_control(robot)
fast = 2 * gait.half_step / gait.period  # [m/s]
orders = [  # when [s], then forward and sideways [m/s] and turn [rad/s]
    (0.0, (fast, 0.0, 0.0)),
    (4.3, (0.6 * fast, 0.0, 0.15)),  # in the middle of a swing
    (7.6, (-0.5 * fast, 0.0, 0.0)),  # in double support
    (10.0, (0.0, 0.0, 0.0)),  # stop
]


def drive(online: OnlinePattern, time: float) -> None:
    """Give the orders that are due."""
    while orders and time >= orders[0][0]:
        start, velocity = orders.pop(0)
        online.set_velocity(*velocity)
        print(f"{start:5.2f} s, {len(online.footsteps)} steps so far")


online = OnlinePattern(
    gait,
    cw.default_pendulum(robot),
    duration=13.5,
    driver=drive,
    sole_size=robot.sole_size,
)
period = control.period
body = WholeBody(robot, period, None, control.body)
controller = WalkingController(control.gains, control.settings, period)
plant = SimulatedRobot(robot, period)
body.start(online.at(0.0))
plant.place(body.configuration)
errors: list[float] = []
outcome = walk(
    online,
    controller,
    body,
    plant,
    on_tick=lambda tick: errors.append(abs(tick.control.com_error).max()),
)
print(f"{outcome}, {len(online.footsteps)} steps")
print(f"the CoM was at most {1e3 * max(errors):.1f} mm from its reference")
