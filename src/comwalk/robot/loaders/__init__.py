"""Read URDF and MJCF files, with their meshes, into MuJoCo models."""

from typing import TYPE_CHECKING

from ...lazy import exports_of

if TYPE_CHECKING:
    from .meshes import VISUAL_GROUP as VISUAL_GROUP
    from .meshes import compile_without_bad_meshes as compile_without_bad_meshes
    from .parts import Mimic as Mimic
    from .parts import first_of as first_of
    from .parts import quaternion_of as quaternion_of
    from .parts import rotation_of as rotation_of
    from .sources import ROBOTS as ROBOTS
    from .sources import LinkMesh as LinkMesh
    from .sources import ModelFile as ModelFile
    from .sources import mesh_vertices as mesh_vertices
    from .sources import profile_of_known as profile_of_known
    from .sources import read_model as read_model
    from .world import World as World
    from .world import first_key as first_key
    from .world import place_world as place_world

__getattr__, __dir__ = exports_of(__name__, __file__)
