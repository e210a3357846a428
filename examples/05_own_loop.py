# /// script
# dependencies = ["comwalk"]
# ///
"""The loop of Fig. 4 by hand: what a driver of a real robot would do each period."""

import comwalk as cw
from comwalk.control import WalkingController
from comwalk.walking import SimulatedRobot, WholeBody

period = 0.002  # [s]
robot = cw.load_robot("paper")
pattern = cw.make_pattern(cw.plan_steps(cw.Gait(), 2), cw.Pendulum())
body = WholeBody(robot, period)
controller = WalkingController(cw.Gains(), cw.ControlSettings(), period)
plant = SimulatedRobot(robot, period)  # any object with start, read, write, stop

reference = pattern.at(0.0)
controller.reset(reference.com, reference.zmp)
command = body.start(reference)
ticker = body.ticker(pattern, controller)
plant.place(body.configuration)
sensors = plant.start(command)
for tick in range(int(pattern.duration / period)):
    outcome = ticker.step(tick * period, sensors)  # measure, guard, law, resolution
    if outcome is not None:  # a fall, or a dead sensor
        break
    plant.write(ticker.command)
    sensors = plant.read()
plant.stop("done" if outcome is None else outcome.cause)
error = controller.output().com_error
print(f"the CoM ended {1e3 * abs(error).max():.1f} mm from its reference")
