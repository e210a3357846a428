"""Any robot file to a `Robot`: limbs, soles, servos, kinematics and dynamics."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .compiled_robot import bodies_of as bodies_of
    from .compiled_robot import flatten as flatten
    from .compiled_robot import links_in as links_in
    from .compiled_solver import BatchResolver as BatchResolver
    from .compiled_solver import FastResolver as FastResolver
    from .compiled_solver import can_resolve as can_resolve
    from .dynamics import InverseDynamics as InverseDynamics
    from .dynamics import sway_inertia as sway_inertia
    from .kinematic_tree import Skeleton as Skeleton
    from .kinematics import Kinematics as Kinematics
    from .kinematics import carried as carried
    from .loaders import World as World
    from .model import LEGS as LEGS
    from .model import Foot as Foot
    from .model import Robot as Robot
    from .model import load_robot as load_robot
    from .profile import Limits as Limits
    from .profile import Profile as Profile
    from .profile import ServoGains as ServoGains
    from .profile import SoleNumbers as SoleNumbers
    from .profile import Stance as Stance
    from .profile import write_profile as write_profile
    from .self_collision import CLEARANCE as CLEARANCE
    from .self_collision import SelfCollision as SelfCollision
    from .servos import DOUBTED_FRICTION as DOUBTED_FRICTION
    from .servos import MOST_FRICTION as MOST_FRICTION
    from .soles import fitted_note as fitted_note
    from .soles import sole_numbers as sole_numbers
    from .urdf_export import link_names as link_names
    from .urdf_export import robot_urdf as robot_urdf

__getattr__, __dir__ = exports_of(__name__, __file__)
