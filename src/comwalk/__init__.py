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

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .certificate import certify as certify
    from .control import ControlSettings as ControlSettings
    from .control import Gains as Gains
    from .dances import builtin_motion as builtin_motion
    from .defaults import default_gains as default_gains
    from .defaults import default_gait as default_gait
    from .defaults import default_pendulum as default_pendulum
    from .defaults import walk_pattern as walk_pattern
    from .errors import ComwalkError as ComwalkError
    from .footsteps import Foothold as Foothold
    from .footsteps import Footstep as Footstep
    from .footsteps import FootstepPlan as FootstepPlan
    from .footsteps import Gait as Gait
    from .footsteps import load_plan as load_plan
    from .footsteps import plan_steps as plan_steps
    from .motion import embed_in as embed_in
    from .motion_files import load_motion as load_motion
    from .pattern import Pattern as Pattern
    from .pattern import make_pattern as make_pattern
    from .pendulum import Pendulum as Pendulum
    from .robot import Robot as Robot
    from .robot import load_robot as load_robot
    from .run import Run as Run
    from .run import simulate as simulate
    from .run import simulate_pendulum as simulate_pendulum
    from .settings import BodySettings as BodySettings
    from .settings import Control as Control
    from .settings import Push as Push
    from .settings import SimulatorSettings as SimulatorSettings
    from .walk import Outcome as Outcome

_PUBLIC = {
    "certificate": ("certify",),
    "control": ("ControlSettings", "Gains"),
    "errors": ("ComwalkError",),
    "footsteps": (
        "Foothold",
        "Footstep",
        "FootstepPlan",
        "Gait",
        "load_plan",
        "plan_steps",
    ),
    "dances": ("builtin_motion",),
    "defaults": ("default_gains", "default_gait", "default_pendulum", "walk_pattern"),
    "motion": ("embed_in",),
    "motion_files": ("load_motion",),
    "pattern": ("Pattern", "make_pattern"),
    "pendulum": ("Pendulum",),
    "robot": ("Robot", "load_robot"),
    "run": ("Run", "simulate", "simulate_pendulum"),
    "settings": ("BodySettings", "Control", "Push", "SimulatorSettings"),
    "walk": ("Outcome",),
}
_HOMES = {name: module for module, names in _PUBLIC.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__version__":
        return metadata.version(__name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, and those that every module has."""
    return sorted({*_HOMES, "__version__", *globals()})
