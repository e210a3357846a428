"""The compiled control tick of one robot: `WholeBody` and the law in microseconds.

It takes over a `WholeBody` and a `WalkingController` that have been started, and does
what they would do, tested equal to them; what its kernels do not solve (postures near
singular ones, joints at their limits) it hands to them.

Only where numba is installed; see `compiled`.
"""

from __future__ import annotations

import numpy as np

from ..control import (
    Command,
    ControlOutput,
    Measurement,
    Outcome,
    Sensors,
    WalkingController,
    Watch,
    astray,
    blind,
    lifted,
    tilted,
)
from ..embedding import (
    ALL_ROWS,
    WANTED,
    CartesianMotion,
    Flat,
    JointMotion,
    Task,
    records,
)
from ..handles import handle_of
from ..pattern import (
    REFERENCE,
    Pattern,
    Reference,
    reference_of,
)
from ..robot import (
    LEGS,
    Robot,
    can_resolve,
    flatten,
)
from ..sides import Side
from .records import (
    STATE,
    dance_of,
    joints_of,
    rules_of,
)
from .tick import (
    ASTRAY,
    DONE,
    ENCODERS,
    HANDED_OVER,
    LIFTED,
    ORIENTATION,
    TILTED,
    WRENCHES,
    Arrays,
    finish,
    look_up,
    tick,
)
from .whole_body import WholeBody


def walk_records(robot: Robot) -> Flat:
    """Return a robot's records for walking: both legs Cartesian, all else given.

    Args:
        robot: The robot.

    Returns:
        The records; first of the sites are soles, ankle sensors and the IMU.
    """
    feet = [robot.feet[side] for side in Side]
    soles, sensors = [foot.site for foot in feet], [foot.sensor_site for foot in feet]
    flat = flatten(robot, [*soles, *sensors, robot.imu_site])
    legs = [limb.name in LEGS.values() for limb in robot.limbs]
    flat.limbs["rows"] = np.where(legs, (1 << len(ALL_ROWS)) - 1, 0)
    return flat


class CompiledTick:
    """One control period after the other. Final.

    It owns the state from where it was made; the body's `configuration` stays the
    commanded one.
    """

    def __init__(
        self,
        pattern: Pattern,
        controller: WalkingController,
        body: WholeBody,
        watch: Watch | None = None,
    ) -> None:
        """Take over from the readable objects, which have been started.

        Args:
            pattern: What to walk.
            controller: The law.
            body: The body, standing as its `start` left it.
            watch: When a walk counts as a fall.
        """
        self.body = body
        flat = walk_records(body.robot)
        self.solvable = can_resolve(body.robot, flat)
        """Whether the kernels can do it for this robot."""
        rules = rules_of(body, controller, watch or Watch())
        rules["omega"], rules["height"] = (
            pattern.pendulum.omega,
            pattern.pendulum.height,
        )
        n, wanted = len(body.robot.joints), records(WANTED)
        damping = body.damping
        wanted["threshold"], wanted["factor"] = damping.threshold, damping.factor
        body.configuration = np.ascontiguousarray(body.configuration)
        still = pattern.at(0.0)
        state, past = _first_state(still, controller.settings.delay)
        self.arrays = Arrays(
            *flat,
            wanted,
            rules,
            state,
            joints_of(body),
            *dance_of(body.motion, body.robot.joints),
            past,
            pattern.table.ravel(),
            records(REFERENCE),
            body.configuration,
            np.zeros(6 + n),
            np.zeros(n),
            np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *np.zeros(n)]),
            np.zeros(16),
        )
        """All that it reads and writes."""
        self.handle = handle_of(*self.arrays)
        """The same, for kernels."""

    def look_up(self, time: float) -> None:
        """Find the reference at a time, which `step` does by itself.

        Args:
            time: Time since the plan's start [s].
        """
        look_up(self.handle, time)

    def feel(self, sensors: Sensors) -> None:
        """Take over what the sensors read.

        Args:
            sensors: Encoders, ankle wrenches and IMU.
        """
        self.arrays.sensed[7:] = sensors.positions
        self.arrays.felt[:12].reshape(2, 6)[:] = sensors.wrenches
        self.arrays.felt[12:] = sensors.orientation

    def step(self, time: float) -> int:
        """Go through one period, after the sensors were taken over.

        Args:
            time: Time since the plan's start [s].

        Returns:
            What `tick_kernels.tick` returns, but that nothing is left to do.
        """
        status = tick(self.handle, time)
        if status != HANDED_OVER:
            self.body.resolution = None
            return status
        self.arrays.v[:] = self.body.resolve(self.task)
        finish(self.handle)
        return DONE

    @property
    def task(self) -> Task:
        """What the last tick asked of the whole body."""
        robot, arrays = self.body.robot, self.arrays
        support = LEGS[tuple(Side)[int(arrays.reference[0]["support"])]]
        motions: dict[str, CartesianMotion | JointMotion] = {}
        for i, limb in enumerate(robot.limbs):
            if limb.name in LEGS.values():
                motions[limb.name] = CartesianMotion(arrays.limbs["twist"][i].copy())
            else:
                wishes = arrays.links["wish"][1:][list(limb.joints)]
                motions[limb.name] = JointMotion(wishes)
        base = motions.pop(support)
        twist = base.twist if isinstance(base, CartesianMotion) else np.zeros(6)
        com, trunk = arrays.wanted["com"][0].copy(), arrays.wanted["trunk"][0].copy()
        return Task(com, support, twist, trunk, motions)

    def outcome(self, status: int) -> Outcome:
        """Return why the walk has to end.

        Args:
            status: What `step` returned, other than DONE.
        """
        reference, s = self.reference(), self.arrays.state[0]
        if status == TILTED:
            return tilted(reference, float(s["trunk_tilt"]))
        if status == ASTRAY:
            return astray(reference, float(s["missed"]))
        if status == LIFTED:
            return lifted(reference)
        return blind(reference, _SENSORS[status])

    def reference(self) -> Reference:
        """Return what the plan asked for at the last tick."""
        return reference_of(self.arrays.reference[0])

    def measured(self) -> Measurement:
        """Return what was measured at the last tick."""
        s = self.arrays.state[0]
        com, zmp, tilt = s["com"].copy(), s["zmp"].copy(), float(s["trunk_tilt"])
        return Measurement(com, zmp, float(s["load"]), tilt, float(s["trust"]))

    def control(self) -> ControlOutput:
        """Return what the law said at the last tick."""
        s = self.arrays.state[0]
        p_d, p = s["zmp_reference"].copy(), s["zmp_filtered"].copy()
        u, c, e_c = s["u"].copy(), s["com_command"].copy(), s["e_c"].copy()
        return ControlOutput(u, c, e_c, p_d - p, p_d, p, bool(s["bounded"]))

    def command(self) -> Command:
        """Return the set-points of the last tick."""
        return Command(self.arrays.out.copy(), self.arrays.v[6:].copy())


_SENSORS = {ENCODERS: "encoders", WRENCHES: "ankle sensors", ORIENTATION: "IMU"}


def _first_state(reference: Reference, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the state of a loop at rest on its reference, and its ring of the past."""
    states = records(STATE)
    s = states[0]
    zmp, com = reference.zmp, reference.com[:2]
    s["zmp"] = s["zmp_filtered"] = s["zmp_reference"] = zmp
    s["support"] = tuple(Side).index(reference.support)
    s["left_share"], s["heaviness"], s["lightened"] = 0.5, 1.0, np.nan
    return states, np.tile([*com, *zmp], int(delay) + 1).astype(float)
