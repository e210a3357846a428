r"""Desired ZMP and CoM over footsteps, Eqs. (4)-(13), Figs. 2 and 3.

First the paper's closed form for a regular walk. Then the same pattern for any plan of
footsteps: in each phase both axes of the CoM are

.. math:: c(t) = \sum_{j=0}^5 a_j (t/S)^j
   + \frac{\sinh(\omega_n (S - t)) \, r_0 + \sinh(\omega_n t) \, r_1}{\sinh(\omega_n S)}

and the positions at the junctions follow from continuous velocity: one symmetric
positive definite tridiagonal system, whatever the length of the plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import ParameterError, checked_number
from ..sides import Side
from . import records as r
from .footsteps import FootstepPlan
from .pendulum import Pendulum, zmp_of_motion
from .phases import plan_table
from .polygon import convex_hull, polygon_margin, rectangle
from .reference import (
    Phase,
    PhaseSpan,
    Reference,
    Samples,
    fill_com,
    fill_references,
    reference_of,
)

# The paper's closed form.


# The pattern over a plan.


@dataclass(frozen=True, eq=False, repr=False)
class Pattern:
    """The desired CoM, ZMP and feet of a footstep plan; made by `make_pattern`."""

    plan: FootstepPlan
    """The footsteps."""

    pendulum: Pendulum
    """The simplified model that links CoM and ZMP."""

    table: np.ndarray
    """All phases, records of `PHASE`, as `fill_reference` reads them. Read-only."""

    def __repr__(self) -> str:
        """Name the size of the plan."""
        return f"Pattern({self.plan.count} steps, {self.duration:g} s)"

    @property
    def duration(self) -> float:
        """Time from the first to the last moment of standing [s]."""
        return float(self.table["start"][-1] + self.table["duration"][-1])

    @cached_property
    def phases(self) -> tuple[PhaseSpan, ...]:
        """All phases in order."""
        sides = tuple(Side)
        return tuple(
            PhaseSpan(
                float(row["start"]),
                float(row["duration"]),
                Phase(int(row["kind"])),
                sides[row["bases"][1]],
            )
            for row in self.table
        )

    def at(self, time: float) -> Reference:
        """Return the reference at one time.

        Args:
            time: Time since the start of the plan [s]. Before it and after the end the
                robot stands. At a junction the later phase counts.

        Returns:
            CoM, ZMP, feet, heading and support, world.

        Raises:
            ParameterError: If the time is not a finite number.
        """
        return reference_of(self._fill([time])[0])

    def _fill(self, times: Sequence[float]) -> np.ndarray:
        """Return the references at some times as records of `REFERENCE`."""
        checked = [checked_number("time", time, unit="s") for time in times]
        records = np.zeros(len(checked), r.REFERENCE)
        omega, height = self.pendulum.omega, self.pendulum.height
        table = self.table if self.table.base is None else self.table.base
        fill_references(table, omega, height, np.array(checked), records)
        return records

    def sample(self, times: np.ndarray | Sequence[float] | float) -> Samples:
        """Return the pattern at many times.

        Args:
            times: Times [s], as for `at`.

        Returns:
            One array per quantity, for plots.

        Raises:
            ParameterError: If there is no time, or one is not a finite number.
        """
        found = self._fill(np.ravel(times).tolist())
        if not len(found):
            raise ParameterError("times must hold at least one time [s], got none")
        names = ("time", "com", "com_velocity", "com_acceleration", "zmp")
        return Samples(
            **{name: found[name].copy() for name in names},
            left=found["feet"]["position"][:, 0].copy(),
            right=found["feet"]["position"][:, 1].copy(),
            heading=found["heading"].copy(),
            phase=found["phase"].copy(),
        )

    def support_polygon(self, time: float) -> np.ndarray:
        """Return the hull of the soles that are on the ground.

        Args:
            time: Time [s], as for `at`.

        Returns:
            Vertices [m], shape (k, 2), counter-clockwise, world.
        """
        time = checked_number("time", time, unit="s")
        return self._hull(self._phase_at(time))

    def hull_margin(self, times: np.ndarray | Sequence[float] | float) -> np.ndarray:
        """Return the margin of the desired ZMP in the hull of the soles.

        Args:
            times: Times [s], as for `at`.

        Returns:
            Distance to the nearest edge [m], shape (k,): negative outside.
        """
        found = self._fill(np.ravel(times).tolist())
        phases = [self._phase_at(time) for time in found["time"]]
        hulls = {k: self._hull(k) for k in set(phases)}
        pairs = zip(phases, found["zmp"], strict=True)
        return np.array([polygon_margin(hulls[k], zmp) for k, zmp in pairs])

    def zmp_residual(self, times: np.ndarray | Sequence[float] | float) -> float:
        """Return the residual of Eqs. (1), (2) and (29) between ZMP and CoM.

        Args:
            times: Times [s], as for `at`.

        Returns:
            Largest abs(p - (c - cddot / omega_n^2)) [m]; 0 but for rounding.
        """
        samples = self.sample(times)
        p = zmp_of_motion(self.pendulum, samples.com, samples.com_acceleration)
        return float(np.abs(samples.zmp - p[:, :2]).max(initial=0.0))

    def continuity_residual(self) -> float:
        """Return the largest jump of the CoM [m] or its velocity [m/s].

        Returns:
            Largest difference at a junction of two phases; 0 but for rounding.
        """
        omega, jump = self.pendulum.omega, 0.0
        a, b = np.zeros(2, r.REFERENCE)
        for before, after in zip(self.table, self.table[1:], strict=False):
            fill_com(before, float(before["duration"]), omega, a)
            fill_com(after, 0.0, omega, b)
            for name in ("com", "com_velocity"):
                jump = max(jump, float(np.abs(a[name] - b[name])[:2].max()))
        return jump

    def _phase_at(self, time: float) -> int:
        """Return the number of the last phase that starts at a time or before."""
        k = int(np.searchsorted(self.table["start"], time, side="right"))
        return max(k - 1, 0)

    def _hull(self, k: int) -> np.ndarray:
        """Return the hull of the soles on the ground in the k-th phase."""
        feet = self.table["resting"][k]
        left, right = (
            rectangle(x, y, yaw, self.plan.sole_size) for x, y, yaw in feet.tolist()
        )
        kind = int(self.table["kind"][k])
        if kind in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
            return left if kind == Phase.SINGLE_LEFT else right
        return convex_hull(np.concatenate([left, right]))


def make_pattern(plan: FootstepPlan, pendulum: Pendulum) -> Pattern:
    r"""Return the pattern of a plan: Eqs. (4)-(13) for any footsteps.

    It minimises, as the paper's pattern does for a regular walk,

    .. math:: \sum_{DS} \int \tfrac12 |\dot c|^2 dt
       + \sum_{SS} \int \tfrac12 |\dot c|^2 + \tfrac12 \omega_n^2 |c - p_k|^2 dt

    so that c is linear in double support, follows Eqs. (1), (2) with the ZMP at the
    stance foot in single support, and cdot is continuous. It starts and stops at rest
    in the middle of the feet. With the style "minjerk" the ZMP is smooth throughout.

    Where a footstep ends in a pause, it stops and starts in the same way.

    Args:
        plan: Footsteps with times.
        pendulum: Gives omega_n and c_z.

    Returns:
        The pattern, ready for `Pattern.at`.

    Raises:
        PlanError: If a double support is too short for "minjerk".

    Example:
        >>> from comwalk.pattern import plan_steps
        >>> pattern = make_pattern(plan_steps(Gait(), 4), Pendulum())
        >>> pattern.duration, round(float(pattern.at(99.0).com[0]), 6)
        (8.2, 0.8)
    """
    table = plan_table(plan, pendulum)
    view = table.view()  # kernels, which only read, know one kind of table
    view.setflags(write=False)
    return Pattern(plan, pendulum, view)
