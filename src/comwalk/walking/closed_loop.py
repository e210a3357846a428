"""Which loop walks: the compiled one where it can, the readable one for all else."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ..control import (
    PROGRESS_ROWS,
    Body,
    Outcome,
    Plant,
    Progress,
    Tick,
    Walkable,
    WalkingController,
    Watch,
    walk,
)
from ..pattern import Pattern
from ..runs import Log
from .mujoco_plant import SimulatedRobot
from .whole_body import WholeBody


def loop_of(
    pattern: Walkable,
    controller: WalkingController,
    body: Body,
    plant: Plant,
    log: Log,
    *,
    watch: Watch | None = None,
    progress: Progress | None = None,
    readable: bool = False,
) -> Callable[[], Outcome]:
    """Return what walks a pattern on a plant, Fig. 4, and keeps a log of it.

    Robots in MuJoCo are walked by `compiled_loop`, which is tested equal to `walk.walk`
    and many times faster, if numba is installed, the robot's limbs are usual ones, and
    its sensors are neither noisy nor late.

    Args:
        pattern: CoM, ZMP and feet over time.
        controller: The walking controller, Eq. (31).
        body: What lies between CoM velocity and set-points.
        plant: The robot.
        log: Where the rows go.
        watch: When a walk counts as a fall.
        progress: Called now and then.
        readable: Whether to walk by `walk.walk` in any case.

    Returns:
        To be called once; it returns the outcome. All that takes time before the
        first period is done already.
    """
    watch = watch or Watch()
    if (
        not readable
        and isinstance(pattern, Pattern)
        and isinstance(body, WholeBody)
        and isinstance(plant, SimulatedRobot)
        and not (plant.settings.noise or plant.settings.latency)
    ):
        from .compiled_loop import CompiledLoop

        loop = CompiledLoop(pattern, controller, body, plant, watch)
        if loop.solvable:
            loop.load(log)
            return partial(loop.run, log, progress)
    on_tick = _recorder(log, progress)
    return partial(walk, pattern, controller, body, plant, on_tick=on_tick, watch=watch)


def _recorder(log: Log, progress: Progress | None) -> Callable[[Tick], None]:
    """Return what the readable loop calls each period."""
    if progress is None:
        return log.record

    def record(tick: Tick) -> None:
        log.record(tick)
        if len(log) % PROGRESS_ROWS == 0:
            progress(tick.reference.time)

    return record
