"""Bounds by Lyapunov functions: known values, optimality, and that they are bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import simulate_error_dynamics

from comwalk.certificates import bounds, largest_errors
from comwalk.certificates import ideal_loop as s
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
X, Y = (3.0, 6.6), (1.8, 3.8)

# By the best ellipsoid, and by the best one for a rate without a bound [m].
ELLIPSOIDS = [
    (X, 0.05, 0.5, "zmp", 0.1231, 0.0592),
    (X, 0.05, 0.5, "com", 0.0623, 0.0196),
    (Y, 0.05, 0.5, "zmp", 0.0915, 0.0806),
    (Y, 0.05, 0.5, "com", 0.0600, 0.0272),
    (X, 0.05, 5.0, "zmp", 0.927, 0.0592),
    (Y, 0.05, 5.0, "zmp", 0.690, 0.0806),
    (Y, 0.05, 5.0, "com", 0.369, 0.0272),
    (X, 0.02, 0.02, "zmp", 0.0171, 0.0237),
    (X, 0.02, 0.02, "com", 0.0100, 0.0078),
    (Y, 0.02, 0.02, "zmp", 0.0127, 0.0322),
    (Y, 0.02, 0.02, "com", 0.0115, 0.0109),
]


@pytest.mark.parametrize(("gains", "a", "b", "output", "both", "free"), ELLIPSOIDS)
def test_ellipsoids_of_the_paper_gains(gains, a, b, output, both, free):
    """Theorem 1: values found elsewhere by semidefinite programs, to 0.1 %."""
    found = bounds.ellipsoid_bound(PAPER, *gains, a, b, output)
    assert found.bound == pytest.approx(both, rel=1e-3, abs=6e-5)
    found = bounds.invariant_set(PAPER, *gains, a, output)
    assert found.bound == pytest.approx(free, abs=6e-5)


@pytest.mark.parametrize(
    ("a", "b", "zmp", "com"),
    [
        (0.05, 0.5, 0.0928, 0.4169),
        (0.05, 5.0, 0.698, 3.13),
        (0.02, 0.02, 0.0130, 0.0582),
    ],
)
def test_paper_bound_of_the_y_gains(a, b, zmp, com):
    """Eq. (38): what it proves at best with the paper's y gains."""
    found = bounds.paper_bound(PAPER, *Y, a, b)
    assert (found.zmp, found.com) == pytest.approx((zmp, com), rel=2e-3, abs=5e-5)


def level(gains, a, b, numbers):
    """Return where V ends by Eq. (38), for any alpha, beta, gamma; infinite if none."""
    q = s.rate_bound_coefficients(PAPER, *gains, *numbers)
    k_p, k_c = gains
    rate = min(2 * q.com / (k_c**2 - PAPER.omega**2), 2 * q.zmp / k_p**2)
    d = q.disturbance * a**2 + q.disturbance_rate * b**2
    return d / rate if rate > 0.0 else math.inf


@pytest.mark.parametrize("gains", [Y, (1.0, 5.0), (2.5, 4.5), (0.3, 12.0)])
@pytest.mark.parametrize(("a", "b"), [(0.05, 0.5), (0.02, 0.02), (0.1, 3.0)])
def test_alpha_beta_gamma_are_the_best(gains, a, b):
    """Eq. (38): the level is that of the coefficients, and a search finds no lower."""
    found = bounds.paper_bound(PAPER, *gains, a, b)
    numbers = found.alpha, found.beta, found.gamma
    assert level(gains, a, b, numbers) == pytest.approx(found.level, rel=1e-5)
    searched = scipy.optimize.minimize(
        lambda x: min(level(gains, a, b, np.exp(x)), 1e6),
        np.log(numbers) - (0.1, 0.15, 0.05),
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-12, "maxiter": 4000},
    )
    assert found.level <= searched.fun * (1 + 1e-6)
    assert found.level == pytest.approx(searched.fun, rel=2e-2)


def test_no_paper_bound_for_the_x_gains():
    """Eq. (38): it proves nothing there, and says what it would need."""
    with pytest.raises(ParameterError, match=r"k_p k_c < omega_n\^2 = 14.3"):
        bounds.paper_bound(PAPER, *X, 0.05, 0.5)


def test_gains_that_meet_the_theorem_let_v_grow():
    """Eqs. (32), (37): the gap of the proof, on the way of the errors themselves."""
    assert s.theorem_1(PAPER, *X, beta=0.5, gamma=0.5)
    dt, quiet = 1e-3, np.zeros(60)
    e_c, e_p = 0.0, 0.01
    start = X[0] * e_p - X[1] * e_c  # the rate of e_c, Eq. (34)
    com, zmp = simulate_error_dynamics(PAPER, *X, quiet, dt, (e_c, start))
    V = s.lyapunov(PAPER, *X, com, zmp)
    assert zmp[0] == pytest.approx(e_p)
    assert (V[1] - V[0]) / dt == pytest.approx(16.56 * e_p**2, rel=5e-3)
    assert V.max() > 1.05 * V[0]
    later, _ = simulate_error_dynamics(PAPER, *X, np.zeros(4000), dt, (e_c, start))
    assert abs(later[-1]) < 1e-3 * np.abs(later).max()  # and yet it is stable


def test_how_much_of_the_theorem_is_not_proved():
    """Eqs. (32), (38): the share of omega < k_c < 2.5 omega, k_p < omega is 39 %."""
    w = PAPER.omega
    middle = (np.arange(200) + 0.5) / 200
    grid = [(p * w, (1 + 1.5 * c) * w) for p in middle for c in middle]
    assert all(s.remark_1(PAPER, *gains) for gains in grid)
    fails = np.mean([not s.proof_condition(PAPER, *gains) for gains in grid])
    assert fails == pytest.approx(0.39, abs=5e-3)


def leaves(A, B, Q):
    """Return the largest rate of x Q^-1 x on the edge of an ellipsoid, inputs +-1."""
    P, half = np.linalg.inv(Q), np.linalg.cholesky(Q)
    rates = []
    for angle in np.linspace(0.0, 2 * math.pi, 181):
        x = half @ (math.cos(angle), math.sin(angle))
        rates.append(2 * x @ P @ A @ x + 2 * np.abs(x @ P @ B).sum())
    return max(rates)


gain = st.floats(0.3, 8.0)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.3, 1.5), gain, st.floats(1.1, 4.0), st.sampled_from(["com", "zmp"]))
def test_ellipsoids_are_not_left(height, k_p, ratio, output):
    """Theorem 1: on their edge every admissible disturbance points inward."""
    pendulum, k_c, a, b = Pendulum(height=height), ratio * k_p, 0.05, 0.5
    A, B = s.error_dynamics(pendulum, k_p, k_c)
    found = bounds.ellipsoid_bound(pendulum, k_p, k_c, a, b, output)
    assert leaves(A, B * (a, b), found.Q) < 1e-6 * np.abs(A).max()
    row = 0 if output == "com" else 1
    assert math.sqrt(found.Q[row, row]) == pytest.approx(found.bound, rel=1e-9)
    free = bounds.invariant_set(pendulum, k_p, k_c, a, output)
    a_1 = pendulum.omega**2 / k_p
    A = np.array([[0.0, 1.0], [-a_1 * (k_c - k_p), -a_1]])
    assert leaves(A, np.array([[0.0], [-a_1 * a]]), free.Q) < 1e-6 * np.abs(A).max()


@settings(max_examples=15, deadline=None)
@given(gain, st.floats(1.1, 4.0), st.sampled_from(["com", "zmp"]))
def test_from_loose_to_tight(k_p, ratio, output):
    """Theorem 1: exact <= L1 <= ellipsoid of any rate; exact <= ellipsoid <= V."""
    k_c, a, b = ratio * k_p, 0.05, 0.5
    exact = largest_errors.worst_case(PAPER, k_p, k_c, a, b, output, samples=501).bound
    peak = (
        largest_errors.com_peak_gain
        if output == "com"
        else largest_errors.zmp_peak_gain
    )
    free = bounds.invariant_set(PAPER, k_p, k_c, a, output).bound
    both = bounds.ellipsoid_bound(PAPER, k_p, k_c, a, b, output).bound
    more = 1 + 1e-6
    assert exact <= a * peak(PAPER, k_p, k_c) * more <= free * more**2
    assert exact <= both * more
    if s.proof_condition(PAPER, k_p, k_c):
        paper = bounds.paper_bound(PAPER, k_p, k_c, a, b)
        assert both <= (paper.com if output == "com" else paper.zmp) * more


def test_bad_input():
    with pytest.raises(ParameterError, match="a must be"):
        bounds.paper_bound(PAPER, *Y, 0.0, 0.5)
    with pytest.raises(ParameterError, match="b must be"):
        bounds.ellipsoid_bound(PAPER, *Y, 0.05, math.nan, "com")
    with pytest.raises(ParameterError, match="0 < k_p < k_c"):
        bounds.ellipsoid_bound(PAPER, 7.0, 6.6, 0.05, 0.5, "com")
    with pytest.raises(ParameterError, match="0 < k_p < k_c"):
        bounds.invariant_set(PAPER, 7.0, 6.6, 0.05, "zmp")
