"""The CoM Jacobian with embedded motion, Eqs. (14)-(27): kinematics, tasks, motions."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from ..compiled import Record as Record
    from ..compiled import records as records
    from .dances import BUILTIN_MOTIONS as BUILTIN_MOTIONS
    from .dances import builtin_motion as builtin_motion
    from .dynamics import BODY as BODY
    from .dynamics import accelerate_links as accelerate_links
    from .dynamics import load_links as load_links
    from .dynamics import move_com as move_com
    from .dynamics import move_links as move_links
    from .dynamics import move_site as move_site
    from .elimination import resolve_by_elimination as resolve_by_elimination
    from .elimination import sigma_min as sigma_min
    from .kinematic_records import ANY_AXIS as ANY_AXIS
    from .kinematic_records import LIMB as LIMB
    from .kinematic_records import LINK as LINK
    from .kinematic_records import LONGEST as LONGEST
    from .kinematic_records import SITE as SITE
    from .kinematic_records import SLIDE as SLIDE
    from .kinematic_records import WANTED as WANTED
    from .kinematic_records import Flat as Flat
    from .kinematic_records import flat_at as flat_at
    from .kinematic_records import wanted_at as wanted_at
    from .kinematics import SOLVED as SOLVED
    from .kinematics import end_columns as end_columns
    from .kinematics import find_levers as find_levers
    from .kinematics import integrate as integrate
    from .kinematics import place_links as place_links
    from .kinematics import resolve as resolve
    from .kinematics import resolve_at as resolve_at
    from .kinematics import resolve_limb as resolve_limb
    from .kinematics import rotation as rotation
    from .kinematics import site_point as site_point
    from .kinematics import site_rotation as site_rotation
    from .kinematics import turned as turned
    from .motion import EmbeddedMotion as EmbeddedMotion
    from .motion import JointLimit as JointLimit
    from .motion import Motion as Motion
    from .motion import embed_in as embed_in
    from .motion_checks import fitted as fitted
    from .motion_checks import prepare_motion as prepare_motion
    from .motion_edits import placed as placed
    from .motion_edits import renamed as renamed
    from .motion_edits import scaled as scaled
    from .motion_files import is_motion_file as is_motion_file
    from .motion_files import load_motion as load_motion
    from .motion_playing import DANCE as DANCE
    from .motion_playing import blended as blended
    from .motion_playing import find_segment as find_segment
    from .motion_playing import find_weight as find_weight
    from .rotations import level_error as level_error
    from .rotations import rotate_twist as rotate_twist
    from .rotations import rotation_yaw as rotation_yaw
    from .rotations import turn_to_level as turn_to_level
    from .rotations import yaw_of_quaternion as yaw_of_quaternion
    from .solver import RateLimits as RateLimits
    from .solver import Resolver as Resolver
    from .solver import bounded_solver as bounded_solver
    from .task import ALL_ROWS as ALL_ROWS
    from .task import CartesianMotion as CartesianMotion
    from .task import Damping as Damping
    from .task import JointMotion as JointMotion
    from .task import Limb as Limb
    from .task import Posture as Posture
    from .task import Resolution as Resolution
    from .task import Task as Task
    from .task import check_task as check_task

__getattr__, __dir__ = exports_of(__name__, __file__)
