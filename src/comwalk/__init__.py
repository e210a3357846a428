"""Humanoid walking by the CoM Jacobian with embedded motion (Choi, Kim, You 2006).

From a robot to a plot::

    import comwalk as cw

    robot = cw.load_robot("paper")
    plan = cw.plan_steps(cw.Gait(half_step=0.1), 20)
    pattern = cw.make_pattern(plan, cw.Pendulum())
    gains = cw.Gains(zmp=(3.0, 1.8), com=(6.6, 3.8))
    run = cw.simulate(robot, pattern, control=cw.Control(gains=gains))
    print(run.outcome)
    run.plot("walk.png")

The names here are what most users need; each is imported when it is first used. All
else is in the modules, whose docstrings name the equations that they hold.
"""

from importlib import metadata
from typing import TYPE_CHECKING, Any

from .lazy import exports_of

if TYPE_CHECKING:
    from .certificates import certify as certify
    from .certificates import default_gains as default_gains
    from .certificates import default_gait as default_gait
    from .certificates import default_pendulum as default_pendulum
    from .certificates import walk_pattern as walk_pattern
    from .control import BodySettings as BodySettings
    from .control import Control as Control
    from .control import ControlSettings as ControlSettings
    from .control import Gains as Gains
    from .control import Outcome as Outcome
    from .control import Push as Push
    from .control import SimulatorSettings as SimulatorSettings
    from .embedding import builtin_motion as builtin_motion
    from .embedding import embed_in as embed_in
    from .embedding import load_motion as load_motion
    from .errors import ComwalkError as ComwalkError
    from .pattern import Foothold as Foothold
    from .pattern import Footstep as Footstep
    from .pattern import FootstepPlan as FootstepPlan
    from .pattern import Gait as Gait
    from .pattern import Pattern as Pattern
    from .pattern import Pendulum as Pendulum
    from .pattern import load_plan as load_plan
    from .pattern import make_pattern as make_pattern
    from .pattern import plan_steps as plan_steps
    from .robot import Robot as Robot
    from .robot import load_robot as load_robot
    from .run import Run as Run
    from .run import simulate as simulate
    from .run import simulate_pendulum as simulate_pendulum

_export, __dir__ = exports_of(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name, or look up the version, when it is first used."""
    return metadata.version(__name__) if name == "__version__" else _export(name)
