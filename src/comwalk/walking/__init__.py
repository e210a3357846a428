"""A whole body that walks: measurement, action, foot contact, MuJoCo, closed loop."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .closed_loop import loop_of as loop_of
    from .compiled_loop import row_type as row_type
    from .compiled_loop import scene_arrays as scene_arrays
    from .compiled_tick import CompiledTick as CompiledTick
    from .mujoco_exchange import command as command
    from .mujoco_exchange import feel_step as feel_step
    from .mujoco_exchange import sense as sense
    from .mujoco_plant import SimulatedRobot as SimulatedRobot
    from .mujoco_plant import build_scene as build_scene
    from .tick import DONE as DONE
    from .whole_body import WholeBody as WholeBody

__getattr__, __dir__ = exports_of(__name__, __file__)
