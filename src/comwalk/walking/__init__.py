"""A whole body that walks: measurement, action, foot contact, MuJoCo, closed loop."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .mujoco_exchange import command as command
    from .mujoco_exchange import feel_step as feel_step
    from .mujoco_exchange import sense as sense
    from .mujoco_link import MujocoLink as MujocoLink
    from .mujoco_link import take_log as take_log
    from .mujoco_plant import SimulatedRobot as SimulatedRobot
    from .mujoco_scene import BEGIN as BEGIN
    from .mujoco_scene import FLOOR as FLOOR
    from .mujoco_scene import TERRAIN_BIT as TERRAIN_BIT
    from .mujoco_scene import build_scene as build_scene
    from .records import STRETCH as STRETCH
    from .whole_body import WholeBody as WholeBody
    from .whole_body import WholeBodyTicker as WholeBodyTicker

__getattr__, __dir__ = exports_of(__name__, __file__)
