"""Footsteps to CoM, ZMP and feet over time, Eqs. (1)-(13). No robot."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .adaptation import Agility as Agility
    from .adaptation import adapt as adapt
    from .adaptation import lower as lower
    from .capturability import Capturability as Capturability
    from .capturability import Stepping as Stepping
    from .capturability import capture_limits as capture_limits
    from .capturability import largest_push as largest_push
    from .closed_form import coefficients as coefficients
    from .closed_form import transfer_zmp as transfer_zmp
    from .footsteps import PAPER_GAIT as PAPER_GAIT
    from .footsteps import Foothold as Foothold
    from .footsteps import Footstep as Footstep
    from .footsteps import FootstepPlan as FootstepPlan
    from .footsteps import Gait as Gait
    from .footsteps import foot_poses as foot_poses
    from .online import OnlinePattern as OnlinePattern
    from .pendulum import PAPER_PENDULUM as PAPER_PENDULUM
    from .pendulum import Pendulum as Pendulum
    from .pendulum import zmp_of_motion as zmp_of_motion
    from .phases import fill_plan as fill_plan
    from .phases import step_records as step_records
    from .plan_files import load_plan as load_plan
    from .plans import excerpt as excerpt
    from .plans import plan_segments as plan_segments
    from .plans import plan_steps as plan_steps
    from .plans import shortened as shortened
    from .plans import slowed as slowed
    from .plans import without_repeats as without_repeats
    from .polygon import convex_hull as convex_hull
    from .polygon import polygon_margin as polygon_margin
    from .polygon import rectangle as rectangle
    from .polygon import rectangle_in as rectangle_in
    from .polygon import share_between as share_between
    from .records import ADAPTATION as ADAPTATION
    from .records import COMMAND as COMMAND
    from .records import ONLINE as ONLINE
    from .records import ONLINE_ARRAYS as ONLINE_ARRAYS
    from .records import PHASE as PHASE
    from .records import REFERENCE as REFERENCE
    from .records import STEP as STEP
    from .records import WORK as WORK
    from .reference import DOUBLE as DOUBLE
    from .reference import LEFT_ALONE as LEFT_ALONE
    from .reference import RIGHT_ALONE as RIGHT_ALONE
    from .reference import STAND as STAND
    from .reference import Phase as Phase
    from .reference import Reference as Reference
    from .reference import bend_of_minimum_jerk as bend_of_minimum_jerk
    from .reference import fill_reference as fill_reference
    from .reference import fill_references as fill_references
    from .reference import minimum_jerk as minimum_jerk
    from .reference import record_of as record_of
    from .reference import reference_of as reference_of
    from .walk_pattern import Pattern as Pattern
    from .walk_pattern import make_pattern as make_pattern

__getattr__, __dir__ = exports_of(__name__, __file__)
