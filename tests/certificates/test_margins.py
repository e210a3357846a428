"""Margins of the sampled loop: by frequency response, by eigenvalues, by simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from comwalk.certificates import stability_margins as m
from comwalk.certificates.sampled_loop import (
    SampledLoop,
    highest_cutoff,
    sampled_loop_matrix,
    spectral_radius,
)
from comwalk.control.filters import low_pass_coefficient
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
X, Y = (3.0, 6.6), (1.8, 3.8)


def random_loop(rng) -> SampledLoop:
    """Return a loop with all there is to a loop."""
    mode = rng.choice([0.0, 3.0, 15.0, 40.0])
    return SampledLoop(
        period=float(rng.choice([0.001, 0.002, 0.005, 0.01])),
        servo_lag=float(rng.choice([0.005, 0.02, 0.05, 0.2])),
        zmp_cutoff=float(rng.choice([1.0, 3.0, 10.0])),
        delay=int(rng.integers(0, 8)),
        analog_filter=bool(rng.integers(0, 2)),
        dead_time=float(rng.choice([0.0, 0.0033, 0.012])),
        mode_frequency=float(mode) if mode else None,
        mode_damping=float(rng.choice([0.1, 0.5, 1.0])),
    )


@pytest.mark.parametrize("seed", range(60))
def test_margins_agree_with_eigenvalues(seed):
    """Sampled Eq. (31): each margin is where the spectral radius crosses 1."""
    rng = np.random.default_rng(seed)
    loop, k_c = random_loop(rng), rng.uniform(1.0, 10.0)
    k_p = rng.uniform(0.05, 1.0) * k_c

    def radius(factor=1.0, k_p=k_p, **changes):
        return spectral_radius(
            PAPER, factor * k_p, factor * k_c, replace(loop, **changes)
        )

    largest = m.largest_zmp_gain(PAPER, k_c, loop)
    if largest > 0.0:
        assert radius(k_p=largest) == pytest.approx(1.0, abs=1e-9)
        assert radius(k_p=0.999 * largest) < 1.0 < radius(k_p=1.001 * largest)
    if radius() >= 1.0:
        with pytest.raises(ParameterError, match="unstable"):
            m.margins(PAPER, k_p, k_c, loop)
        return
    found = m.margins(PAPER, k_p, k_c, loop)
    if found.gain_up < 100.0:
        assert radius(found.gain_up) == pytest.approx(1.0, abs=1e-9)
        assert radius(0.999 * found.gain_up) < 1.0 < radius(1.001 * found.gain_up)
    if found.delay < 50 * loop.period:
        more = math.floor(found.delay / loop.period)
        assert radius(delay=loop.delay + more) < 1.0
        assert radius(delay=loop.delay + more + 1) >= 1.0
    highest = highest_cutoff(PAPER, k_p, k_c, loop)
    if 0.0 < highest < math.inf:
        assert radius(zmp_cutoff=0.999 * highest) < 1.0
        assert radius(zmp_cutoff=1.001 * highest) > 1.0
    assert found.modulus <= 2.0 * math.sin(0.5 * found.phase) + 1e-6
    assert found.modulus <= 1.0 - 1.0 / found.gain_up + 1e-6


@pytest.mark.parametrize(
    ("lag", "gains", "height", "dead"),
    [
        (0.02, X, 0.687, 3),
        (0.02, Y, 0.687, 5),
        (0.02, (1.8, 5.0), 0.70, 5),
        (0.02, (1.3, 5.0), 0.70, 7),
        (0.02, (1.0, 3.0), 0.70, 10),
        (0.02, (0.5, 4.0), 0.70, 480),
        (0.02, (0.1, 4.0), 0.70, 400),
        (0.05, X, 0.687, 7),
        (0.05, Y, 0.687, 15),
        (0.05, (1.8, 5.0), 0.70, 14),
        (0.05, (1.3, 5.0), 0.70, 25),
        (0.05, (1.0, 3.0), 0.70, 51),
    ],
)
def test_dead_time_of_published_gains(lag, gains, height, dead):
    """Eq. (31), a 10 Hz filter, hardly sampled: dead times [ms] known elsewhere."""
    loop = SampledLoop(period=1e-4, servo_lag=lag, zmp_cutoff=10.0, delay=0)
    found = m.margins(Pendulum(height=height), *gains, loop)
    assert 1e3 * found.delay == pytest.approx(dead, abs=0.5, rel=0.03)


@pytest.mark.parametrize(("cutoff", "limit"), [(2.0, 5.2), (5.0, 2.2), (10.0, 1.2)])
def test_largest_gains_in_a_fixed_ratio(cutoff, limit):
    """Sampled Eq. (31): largest k_p at k_c = 2.2 k_p, dt 5 ms, one tick, 20 ms."""
    loop = SampledLoop(period=0.005, zmp_cutoff=cutoff, analog_filter=True)
    k_p = 0.1
    found = m.margins(PAPER, k_p, 2.2 * k_p, loop)
    assert k_p * found.gain_up == pytest.approx(limit, abs=0.05)


def test_margins_at_their_ends():
    """Sampled Eq. (31): feedback of the CoM alone; no feedback at all is refused."""
    found = m.margins(PAPER, 0.0, 3.0, SampledLoop())
    assert found.gain_up > 5.0
    assert found.gain_down == 0.0
    assert m.largest_zmp_gain(PAPER, 0.0, SampledLoop()) == 0.0
    with pytest.raises(ParameterError, match="k_c"):
        m.margins(PAPER, 0.0, 0.0, SampledLoop())
    assert m.decay_rate(PAPER, 7.0, 6.6, SampledLoop()) < 0.0
    assert m.largest_zmp_gain(PAPER, 60.0, SampledLoop(delay=50)) == 0.0


# --- Against simulation ------------------------------------------------------------


class Bank:
    """Many loops simulated at once in small steps, without any matrix."""

    def __init__(self, cells, steps: int = 24):
        """Prepare cells of (k_p, k_c, loop), all off their rest."""
        self.k_p, self.k_c = (np.array([c[i] for c in cells]) for i in (0, 1))
        loops = [c[2] for c in cells]
        self.dt = np.array([loop.period for loop in loops])
        self.tau = np.array([loop.servo_lag for loop in loops])
        self.dead = np.array([loop.dead_time for loop in loops])
        self.delay = np.array([loop.delay for loop in loops])
        self.alpha = np.array(
            [low_pass_coefficient(x.zmp_cutoff, x.period) for x in loops]
        )
        self.w = np.array([2 * math.pi * (x.mode_frequency or 0.0) for x in loops])
        self.zeta = np.array([x.mode_damping for x in loops])
        self.steps, n = steps, len(cells)
        self.x = np.zeros((4, n))  # c, v, q, dq
        self.x[0] = self.x[2] = 1.0
        self.f = np.ones(n)
        self.seen, self.commands = [], []

    def rate(self, x, u):
        """Return the rates of c, v, q, dq."""
        c, v, q, dq = x
        p = c - (u - v) / self.tau / PAPER.omega**2
        return np.array(
            [
                v,
                (u - v) / self.tau,
                dq,
                self.w**2 * (p - q) - 2 * self.zeta * self.w * dq,
            ]
        )

    def silence(self, cells):
        """Put cells to rest, for good."""
        self.x[:, cells] = self.f[cells] = 0.0
        for row in (*self.commands, *(part for pair in self.seen for part in pair)):
            row[cells] = 0.0

    def tick(self):
        """Advance each loop by its own period; return its CoM."""
        self.seen.append((self.x[0].copy(), self.f.copy()))
        late = np.maximum(len(self.seen) - 1 - self.delay, 0)
        cells = np.arange(len(late))
        c, f = (np.array([s[k] for s in self.seen])[late, cells] for k in (0, 1))
        self.commands.append(self.k_p * f - self.k_c * c)
        h, table = self.dt / self.steps, np.array(self.commands)
        for k in range(self.steps):
            at = len(table) - 1 + ((k + 0.5) * h - self.dead) / self.dt
            i = np.floor(at + 1e-9).astype(int)
            u = np.where(i >= 0, table[np.maximum(i, 0), cells], 0.0)
            half = self.x + 0.5 * h * self.rate(self.x, u)
            self.x = self.x + h * self.rate(half, u)
        p = self.x[0] - (u - self.x[1]) / self.tau / PAPER.omega**2
        sensed = np.where(self.w > 0.0, self.x[2], p)
        self.f = self.f + self.alpha * (sensed - self.f)
        keep = int(max(self.delay.max(), (self.dead / self.dt).max())) + 3
        self.seen, self.commands = self.seen[-keep:], self.commands[-keep:]
        return self.x[0]


@pytest.mark.parametrize("dead_time", [0.0, 0.004, 0.0055])
@pytest.mark.parametrize("mode", [None, 6.0])
@pytest.mark.parametrize("delay", [0, 2])
def test_matrix_with_dead_time_and_contact(dead_time, mode, delay):
    """Sampled Eq. (31): powers of the matrix are the simulated loop."""
    loop = SampledLoop(
        period=0.002, delay=delay, dead_time=dead_time, mode_frequency=mode
    )
    M = sampled_loop_matrix(PAPER, *X, loop)
    bank, n = Bank([(*X, loop)], steps=80), 3 if mode is None else 5
    z = np.zeros(len(M))
    z[0] = z[2] = 1.0
    z[3:n] = (1.0, 0.0)[: n - 3]
    # before the first command the servo rests: the same as commands of zero
    simulated, expected = [], []
    k = delay + loop.dead_ticks[0] + (loop.dead_ticks[1] > 0.0)
    for _ in range(k):
        bank.tick()
    pairs = [bank.seen[-1 - i] for i in range(k)]
    z[:2] = bank.x[:2, 0]
    z[2] = bank.f[0]
    z[3:n] = bank.x[2 : n - 1, 0]
    z[n:] = [value[0] for pair in pairs for value in pair]
    for _ in range(100):
        simulated.append(bank.tick()[0])
        z = M @ z
        expected.append(z[0])
    assert np.array(simulated) == pytest.approx(np.array(expected), abs=1e-6)


def grid_cells():
    """Return 200 loops and gains on both sides of the edge of stability."""
    rng, cells = np.random.default_rng(11), []
    while len(cells) < 200:
        k_c = rng.uniform(2.0, 9.0)
        loop = SampledLoop(
            period=float(rng.choice([0.001, 0.002, 0.005, 0.01])),
            servo_lag=float(rng.choice([0.005, 0.01, 0.02, 0.05])),
            delay=int(rng.integers(0, 5)),
            zmp_cutoff=float(np.exp(rng.uniform(math.log(0.7), math.log(25.0)))),
        )
        cells.append((rng.uniform(0.1, 1.05) * k_c, k_c, loop))
    return cells


def test_stability_boundary_on_a_grid_of_200():
    """Sampled Eq. (31): what eigenvalues predict is what a simulation does.

    Cells whose answer changes when gains or cut-off change by 2 % are next to the edge;
    they may differ.
    """
    cells = grid_cells()
    stable = [spectral_radius(PAPER, *cell) < 1.0 for cell in cells]
    bank, peaks, gone = Bank(cells, steps=8), [], np.zeros(200, bool)
    for _ in range(1600):
        peaks.append(np.abs(bank.tick()))
        gone |= peaks[-1] > 1e12
        bank.silence(gone)
    early, late = (np.max(peaks[i : i + 400], axis=0) for i in (300, 1200))
    near = 0
    for (k_p, k_c, loop), is_stable, first, last, lost in zip(
        cells, stable, early, late, gone, strict=True
    ):
        found = last < first and not lost
        others = {
            spectral_radius(PAPER, g * k_p, k_c, replace(loop, zmp_cutoff=f)) < 1.0
            for g in (0.98, 1.02)
            for f in (0.98 * loop.zmp_cutoff, 1.02 * loop.zmp_cutoff)
        }
        near += len(others) > 1
        assert found == is_stable or len(others) > 1, (k_p, k_c, loop, first, last)
    assert near < 20
    assert 60 < sum(stable) < 140
