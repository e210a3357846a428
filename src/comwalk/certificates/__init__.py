"""Guarantees before motion, Eqs. (28) and (32)-(38): loops, bounds, limits."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .certificate import AxisCertificate as AxisCertificate
    from .certificate import Certificate as Certificate
    from .certificate import IdealBounds as IdealBounds
    from .certificate import IdealCertificate as IdealCertificate
    from .certificate import LoopCertificate as LoopCertificate
    from .certificate import SampledBound as SampledBound
    from .certificate import SoleRoom as SoleRoom
    from .certificate import certify as certify
    from .defaults import SIDE_STEP as SIDE_STEP
    from .defaults import default_control as default_control
    from .defaults import default_control_settings as default_control_settings
    from .defaults import default_gains as default_gains
    from .defaults import default_gait as default_gait
    from .defaults import default_pendulum as default_pendulum
    from .defaults import largest_gait as largest_gait
    from .defaults import similar_gains as similar_gains
    from .defaults import sole_room as sole_room
    from .defaults import stated_gains as stated_gains
    from .defaults import walk_pattern as walk_pattern
    from .description import describe as describe
    from .description import profile_of as profile_of
    from .description import rows_of as rows_of
    from .doctor import Finding as Finding
    from .doctor import findings as findings
    from .ensemble import monte_carlo as monte_carlo
    from .gain_check import check_control as check_control
    from .gain_check import sampled_loop_of as sampled_loop_of
    from .gain_check import servo_lag_of as servo_lag_of
    from .gain_design import PUBLISHED as PUBLISHED
    from .gain_design import Aim as Aim
    from .gain_design import DesignGoal as DesignGoal
    from .gain_design import design as design
    from .ideal_loop import is_hurwitz as is_hurwitz
    from .ideal_loop import lyapunov_rate as lyapunov_rate
    from .ideal_loop import proof_condition as proof_condition
    from .ideal_loop import theorem_1 as theorem_1
    from .largest_errors import worst_case as worst_case
    from .plan_check import advice as advice
    from .plan_check import check_feasible as check_feasible
    from .plan_check import feasibility as feasibility
    from .plan_check import nearest_plans as nearest_plans
    from .reach import adaptive as adaptive
    from .reach import agility_of as agility_of
    from .reach import check_friction as check_friction
    from .reach import friction_fault as friction_fault
    from .reach import stance_ratio as stance_ratio
    from .reach import stepping_of as stepping_of
    from .sampled_loop import SampledLoop as SampledLoop
    from .sampled_loop import open_loop as open_loop
    from .sampled_loop import text_of_loop as text_of_loop
    from .stability_margins import largest_zmp_gain as largest_zmp_gain
    from .stability_margins import loop_gain as loop_gain
    from .stability_margins import margins as margins
    from .stability_margins import zmp_sensitivity as zmp_sensitivity
    from .validation import lines_of_observed as lines_of_observed
    from .validation import numbers_of_observed as numbers_of_observed
    from .validation import observe as observe
    from .validation import observe_run as observe_run

__getattr__, __dir__ = exports_of(__name__, __file__)
