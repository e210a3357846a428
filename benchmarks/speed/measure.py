"""Timing on a machine that others use too: short interleaved blocks, paired ratios.

Every round times each candidate once, in a shuffled order, in a block of a few
milliseconds. What disturbs a round disturbs all of it, so the ratio of two candidates
is taken within the round, and the median over the rounds is what counts.
"""

from __future__ import annotations

import gc
import random
import statistics
from collections.abc import Callable, Mapping
from time import perf_counter_ns
from typing import Any

import numpy as np

BLOCK = 4e-3
"""Length of a block [s]."""
LEAST_CALLS = 5
"""Fewest calls in a block."""


def interleaved(
    calls: Mapping[str, Callable[[int], Any]],
    baseline: str,
    *,
    rounds: int,
    states: int = 1,
) -> dict[str, dict[str, float]]:
    """Time calls against each other.

    Args:
        calls: What to call, with the number of a state.
        baseline: The name that ratios are relative to.
        rounds: How many blocks of each.
        states: Number of states, gone through in turn.

    Returns:
        By name: least, median and 99th percentile of a call [us], and the median and
        the quartiles over the rounds of its ratio to the baseline.
    """
    sizes = {name: _block_size(call, states) for name, call in calls.items()}
    times: dict[str, list[list[int]]] = {name: [] for name in calls}
    order, shuffle = list(calls), random.Random(7).shuffle
    enabled = gc.isenabled()
    gc.disable()
    try:
        for turn in range(rounds):
            gc.collect()
            shuffle(order)
            for name in order:
                ks = [(turn * sizes[name] + i) % states for i in range(sizes[name])]
                times[name].append(_block(calls[name], ks))
    finally:
        if enabled:
            gc.enable()
    medians = {n: [statistics.median(block) for block in times[n]] for n in calls}
    return {
        name: {
            **_spread([t for block in times[name] for t in block]),
            **_ratios(medians[name], medians[baseline]),
        }
        for name in calls
    }


def _block_size(call: Callable[[int], Any], states: int) -> int:
    """Return how many calls fill a block; warms up on the way."""
    _block(call, [0])
    (once,) = _block(call, [0])
    if once * 1e-9 > BLOCK:
        return 1
    ks = [k % states for k in range(3 * LEAST_CALLS)]
    _block(call, ks)
    each = statistics.median(_block(call, ks)) * 1e-9
    return max(LEAST_CALLS, int(BLOCK / max(each, 1e-7)))


def _block(call: Callable[[int], Any], states: list[int]) -> list[int]:
    """Return the time of each call [ns]."""
    now, times = perf_counter_ns, []
    for k in states:
        begin = now()
        call(k)
        times.append(now() - begin)
    return times


def _spread(times: list[int]) -> dict[str, float]:
    """Return least, median and 99th percentile [us]."""
    array = 1e-3 * np.array(times)
    median, p99 = np.percentile(array, [50, 99])
    return {"least": float(array.min()), "median": float(median), "p99": float(p99)}


def _ratios(ours: list[float], baseline: list[float]) -> dict[str, float]:
    """Return the median and the quartiles of the ratio within a round."""
    paired = np.array(ours) / np.array(baseline)
    low, middle, high = np.percentile(paired, [25, 50, 75])
    return {"ratio": float(middle), "ratio_25": float(low), "ratio_75": float(high)}
