"""Eqs. (28) and (32) to (38), and the sampled loop."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from readable import simulate_error_dynamics

from comwalk.certificates import ideal_loop as s
from comwalk.certificates import largest_errors, pole_placement
from comwalk.certificates import sampled_loop as sampled
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
X, Y = (3.0, 6.6), (1.8, 3.8)

error = st.floats(-0.2, 0.2)
gain = st.floats(0.1, 12.0)
free = st.floats(0.05, 3.0)
height = st.floats(0.2, 2.0)
examples = settings(max_examples=100)


# --- The ideal model ---------------------------------------------------------------


@examples
@given(height, gain, gain, error, error, error, error)
def test_error_dynamics_follow_from_model_and_law(h, k_p, k_c, e_c, e_p, eps, eps_dot):
    """Eqs. (35), (36): A and B agree with (33), (34) and its time derivative."""
    pendulum = Pendulum(height=h)
    A, B = s.error_dynamics(pendulum, k_p, k_c)
    e_c_rate, e_p_rate = A @ (e_c, e_p) + B @ (eps, eps_dot)
    # (34) solved for e_p gives back the e_p of the state.
    assert s.zmp_error_from_com(k_p, k_c, e_c, e_c_rate, eps) == pytest.approx(
        e_p, abs=1e-9
    )
    # (34) differentiated, with the acceleration (33).
    acceleration = s.error_acceleration(pendulum, e_c, e_p)
    assert k_p * e_p_rate == pytest.approx(
        acceleration + k_c * e_c_rate + eps_dot, abs=1e-8
    )


def test_error_acceleration_is_the_difference_of_two_pendulums():
    """Eq. (33): from (29) and (30), p = c - cddot / omega^2 for both."""
    c_d, cddot_d, c, cddot = 0.10, 0.7, 0.07, -0.2
    w2 = PAPER.gravity / PAPER.height
    e_p = (c_d - cddot_d / w2) - (c - cddot / w2)
    assert s.error_acceleration(PAPER, c_d - c, e_p) == pytest.approx(cddot_d - cddot)


@examples
@given(height, gain, gain, error, error, error, error)
def test_lyapunov_rate_is_the_gradient_along_the_flow(
    h, k_p, k_c, e_c, e_p, eps, eps_dot
):
    """Eq. (37): its rate by central difference along (35), (36)."""
    pendulum = Pendulum(height=h)
    A, B = s.error_dynamics(pendulum, k_p, k_c)
    flow = A @ (e_c, e_p) + B @ (eps, eps_dot)
    d = 1e-3  # V is quadratic: the central difference is exact
    ahead = s.lyapunov(pendulum, k_p, k_c, e_c + d * flow[0], e_p + d * flow[1])
    behind = s.lyapunov(pendulum, k_p, k_c, e_c - d * flow[0], e_p - d * flow[1])
    rate = s.lyapunov_rate(pendulum, k_p, k_c, e_c, e_p, eps, eps_dot)
    assert (ahead - behind) / (2 * d) == pytest.approx(rate, rel=1e-6, abs=1e-6)


@examples
@given(height, gain, gain, free, free, free, error, error, error, error)
def test_rate_bound_by_completed_squares(
    h, k_p, k_c, alpha, beta, gamma, e_c, e_p, eps, eps_dot
):
    """Eq. (38): the bound exceeds the rate by the three squares above it."""
    pendulum = Pendulum(height=h)
    rate = s.lyapunov_rate(pendulum, k_p, k_c, e_c, e_p, eps, eps_dot)
    bound = s.lyapunov_rate_bound(
        pendulum, k_p, k_c, e_c, e_p, alpha, beta, gamma, eps, eps_dot
    )
    K = k_c**2 - pendulum.omega**2
    squares = (
        K * (alpha * e_c + eps / (2 * alpha)) ** 2
        + k_p * (beta * e_p - eps_dot / (2 * beta)) ** 2
        + k_p * k_c * (gamma * e_p + eps / (2 * gamma)) ** 2
    )
    assert bound - rate == pytest.approx(squares, rel=1e-9, abs=1e-9)
    if K >= 0.0:
        assert rate <= bound + 1e-9


@examples
@given(error, error, error, error)
def test_dissipation_inequality(e_c, e_p, eps, eps_dot):
    """Eq. (28): holds with the class K functions of the paper's y gains."""
    g = s.dissipation_gains(PAPER, *Y, alpha=1.2, beta=1.5, gamma=0.8)
    rate = s.lyapunov_rate(PAPER, *Y, e_c, e_p, eps, eps_dot)
    inside = -g.error * (e_c**2 + e_p**2) + g.disturbance * (eps**2 + eps_dot**2)
    assert g.error > 0.0
    assert rate <= inside + 1e-12


def test_no_dissipation_gains_for_the_paper_x_gains():
    """Eq. (38): not negative definite with k_p k_c = 19.8 > omega^2 = 14.28."""
    with pytest.raises(ParameterError, match="not negative definite"):
        s.dissipation_gains(PAPER, *X, alpha=1e-3, beta=1e-3, gamma=1e-3)
    with pytest.raises(ParameterError, match="k_c > omega"):
        s.dissipation_gains(PAPER, 0.5, 3.0, alpha=1.8, beta=0.1, gamma=0.1)


def test_paper_x_gains_let_v_grow():
    """Eq. (37): at e = (0, 1) without disturbance V grows at 16.56, y gains shrink."""
    rate = s.lyapunov_rate(PAPER, *X, 0.0, 1.0, 0.0, 0.0)
    assert rate == pytest.approx(16.56, abs=5e-3)
    assert s.lyapunov_rate(PAPER, *Y, 0.0, 1.0, 0.0, 0.0) < 0.0


@examples
@given(height, gain, st.floats(0.1, 30.0), st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_conditions_imply_each_other(h, k_p, k_c, at, part):
    """Eq. (32): (32) => Remark 1 => Hurwitz, and the proof's condition => Remark 1."""
    pendulum = Pendulum(height=h)
    beta = at * pendulum.omega
    gamma = part * math.sqrt((pendulum.omega**2 - beta**2) / pendulum.omega)
    theorem = s.theorem_1(pendulum, k_p, k_c, beta, gamma)
    remark = s.remark_1(pendulum, k_p, k_c)
    assert remark or not theorem
    assert s.is_hurwitz(k_p, k_c) or not remark
    assert remark or not s.proof_condition(pendulum, k_p, k_c)
    if remark and k_p < 0.999 * pendulum.omega:
        assert s.theorem_1(pendulum, k_p, k_c, 1e-3, 1e-3)


def test_theorem_1_as_printed():
    """Eq. (32): boundary (omega^2 - beta^2) / omega - gamma^2, and k_c > omega."""
    beta, gamma = 1.0, 0.7
    edge = (PAPER.omega**2 - beta**2) / PAPER.omega - gamma**2
    assert s.theorem_1(PAPER, edge - 1e-9, 6.6, beta, gamma)
    assert not s.theorem_1(PAPER, edge + 1e-9, 6.6, beta, gamma)
    assert not s.theorem_1(PAPER, 1.0, PAPER.omega, beta, gamma)
    assert not s.theorem_1(PAPER, 0.0, 6.6, beta, gamma)
    assert not s.theorem_1(PAPER, -1.0, 6.6, beta, gamma)
    with pytest.raises(ParameterError, match="beta"):
        s.theorem_1(PAPER, 1.0, 6.6, PAPER.omega, gamma)
    with pytest.raises(ParameterError, match="gamma"):
        s.theorem_1(PAPER, 1.0, 6.6, beta, 2.0)


def test_proof_condition_is_where_coefficients_can_be_positive():
    """Eq. (38): with alpha, beta, gamma near 0, on a grid of gains."""
    small = 1e-4
    for k_c in (3.0, 3.78, 3.7789, 5.0, 6.6, 9.0):
        for k_p in (0.5, 1.8, 2.1, 2.2, 3.0):
            q = s.rate_bound_coefficients(PAPER, k_p, k_c, small, small, small)
            positive = q.com > 0.0 and q.zmp > 0.0
            assert s.proof_condition(PAPER, k_p, k_c) == positive, (k_p, k_c)


def test_hurwitz_is_exact():
    """0 < k_p < k_c: eigenvalues of A agree on a grid, the edge included."""
    for k_p in np.linspace(0.5, 8.0, 16):
        for k_c in np.linspace(0.5, 8.0, 16):
            A, _ = s.error_dynamics(PAPER, float(k_p), float(k_c))
            growth = np.linalg.eigvals(A).real.max()
            if k_p == k_c:
                assert abs(growth) < 1e-9
                assert not s.is_hurwitz(k_p, k_c)
            else:
                assert s.is_hurwitz(k_p, k_c) == (growth < 0.0)
    assert not s.is_hurwitz(-1.0, 6.6)
    assert not s.is_hurwitz(0.0, 6.6)
    assert not s.is_hurwitz(math.nan, 6.6)
    assert not s.is_hurwitz(1.0, math.inf)


def test_conventional_sign_is_unstable():
    """Remark 1: with the other sign of k_p the trace of the dynamics is positive."""
    k_p, k_c = -3.0, 6.6
    w2 = PAPER.omega**2
    assert np.roots([k_p / w2, 1.0, k_c - k_p]).real.max() > 0.0


@examples
@given(height, gain, gain)
def test_poles_are_eigenvalues(h, k_p, k_c):
    """Eqs. (35), (36): poles, natural frequency and damping against numpy."""
    pendulum = Pendulum(height=h)
    A, _ = s.error_dynamics(pendulum, k_p, k_c)
    roots = pole_placement.poles(pendulum, k_p, k_c)
    assert np.poly(roots).real == pytest.approx(
        [1.0, -np.trace(A), np.linalg.det(A)], rel=1e-6, abs=1e-6
    )
    if s.is_hurwitz(k_p, k_c):
        w = pole_placement.natural_frequency(pendulum, k_p, k_c)
        zeta = pole_placement.damping(pendulum, k_p, k_c)
        assert w**2 == pytest.approx(np.prod(roots).real, rel=1e-6)
        assert 2 * zeta * w == pytest.approx(-np.sum(roots).real, rel=1e-6)
        assert pole_placement.design_gains(pendulum, w, zeta) == pytest.approx(
            (k_p, k_c)
        )


def test_paper_gains_frequency_and_damping():
    """Section VI: x 4.139 rad/s at 0.575, y 3.983 rad/s at 0.996."""
    assert pole_placement.natural_frequency(PAPER, *X) == pytest.approx(4.139, abs=5e-4)
    assert pole_placement.damping(PAPER, *X) == pytest.approx(0.575, abs=5e-4)
    assert pole_placement.natural_frequency(PAPER, *Y) == pytest.approx(3.983, abs=5e-4)
    assert pole_placement.damping(PAPER, *Y) == pytest.approx(0.996, abs=5e-4)
    assert pole_placement.poles(PAPER, *Y) == pytest.approx(
        [-3.967 + 0.364j, -3.967 - 0.364j], 1e-3
    )


@pytest.mark.parametrize(
    ("gains", "frequency", "com", "zmp"),
    [
        (X, 0.5, 0.2863022380, 0.4841869386),
        (X, 1.0, 0.1275019769, 0.4800062490),
        (X, 2.0, 0.0311184706, 0.3752509804),
        (Y, 0.5, 0.3094778699, 0.5233809676),
        (Y, 1.0, 0.1438325015, 0.5414857185),
        (Y, 2.0, 0.0457135093, 0.5512494300),
    ],
)
def test_frequency_response(gains, frequency, com, zmp):
    """Eqs. (35), (36): gain from eps to e_c and e_p; and as C (sI - A)^-1 B."""
    G_c, G_p = largest_errors.frequency_response(PAPER, *gains, frequency)
    assert (abs(G_c), abs(G_p)) == pytest.approx((com, zmp), rel=1e-8)
    A, B = s.error_dynamics(PAPER, *gains)
    w = 2j * math.pi * frequency
    response = np.linalg.solve(w * np.eye(2) - A, B @ (1.0, w))
    assert response == pytest.approx([G_c, G_p], rel=1e-10)


def test_highest_responses():
    """Eqs. (35), (36): peaks, x at 0.384 and 0.689 Hz; e_p in y rises to 1 / k_p."""
    frequencies = np.linspace(0.0, 3.0, 3001).tolist()
    responses = np.abs(
        [largest_errors.frequency_response(PAPER, *X, f) for f in frequencies]
    )
    assert responses.max(axis=0) == pytest.approx([0.295251, 0.532550], abs=2e-6)
    assert [frequencies[i] for i in responses.argmax(axis=0)] == pytest.approx(
        [0.384, 0.689], abs=1e-3
    )
    response = [
        abs(largest_errors.frequency_response(PAPER, *Y, f)[1]) for f in (10, 100, 1e4)
    ]
    assert response == sorted(response)
    assert response[-1] == pytest.approx(1.0 / Y[0], rel=1e-6)


def test_constant_disturbance_shifts_com_and_zmp_alike():
    """Eqs. (35), (36): e_c = e_p = -eps / (k_c - k_p) at rest."""
    for k_p, k_c in (X, Y):
        eps = np.full(400, 0.05)
        e_c, e_p = simulate_error_dynamics(PAPER, k_p, k_c, eps, 0.02)
        assert [e_c[-1], e_p[-1]] == pytest.approx([-0.05 / (k_c - k_p)] * 2, rel=1e-6)


def test_simulation_agrees_with_an_integrator():
    """Eqs. (35), (36): the exact steps against solve_ivp on the state (e_c, e_p)."""
    dt, rng = 0.05, np.random.default_rng(1)
    eps = rng.uniform(-0.05, 0.05, 21)
    t = dt * np.arange(21)
    A, B = s.error_dynamics(PAPER, *X)
    e_c, e_p = simulate_error_dynamics(PAPER, *X, eps, dt, initial=(0.02, -0.1))
    state = np.array([e_c[0], e_p[0]])
    for i in range(20):
        slope = (eps[i + 1] - eps[i]) / dt

        def rate(time, e, i=i, slope=slope):
            return A @ e + B @ (eps[i] + slope * (time - t[i]), slope)

        answer = scipy.integrate.solve_ivp(
            rate, (t[i], t[i + 1]), state, rtol=1e-10, atol=1e-12
        )
        state = answer.y[:, -1]
        assert state == pytest.approx([e_c[i + 1], e_p[i + 1]], abs=1e-8)


def test_gains_out_of_the_region_diverge():
    """k_p >= k_c: the error grows without disturbance."""
    quiet = np.zeros(500)
    e_c, _ = simulate_error_dynamics(PAPER, 6.7, 6.6, quiet, 0.05, (0.01, 0.0))
    assert abs(e_c[-1]) > 10 * abs(e_c[0])
    e_c, _ = simulate_error_dynamics(PAPER, 6.5, 6.6, quiet, 0.05, (0.01, 0.0))
    assert abs(e_c[-1]) < 0.1 * abs(e_c[0])


# --- Bounds ------------------------------------------------------------------------


def test_peak_gains_of_the_paper():
    """Theorem 1: exact peak gains from eps to e_c and e_p."""
    assert largest_errors.com_peak_gain(PAPER, *X) == pytest.approx(0.346424, abs=5e-7)
    assert largest_errors.zmp_peak_gain(PAPER, *X) == pytest.approx(1.143590, abs=5e-7)
    assert largest_errors.com_peak_gain(PAPER, *Y) == pytest.approx(0.5, abs=5e-7)
    assert largest_errors.zmp_peak_gain(PAPER, *Y) == pytest.approx(1.611112, abs=5e-7)


def impulse_area(pendulum, k_p, k_c, output):
    """Peak gain by quadrature of the impulse response, by the matrix exponential."""
    A, B = s.error_dynamics(pendulum, k_p, k_c)
    # eps_dot is the impulse's derivative: on x = e - b eps the input is eps alone.
    b = B[:, 1]
    start = A @ b + B[:, 0]
    values, vectors = np.linalg.eig(A)
    parts = np.linalg.solve(vectors, start.astype(complex))
    row = vectors[0 if output == "com" else 1] * parts
    t = np.linspace(0.0, 14.0 / -values.real.max(), 200_001)
    h = sum((r * np.exp(v * t)).real for r, v in zip(row, values, strict=True))
    through = abs(b[0 if output == "com" else 1])
    return through + scipy.integrate.trapezoid(np.abs(h), t)


@pytest.mark.parametrize(
    ("k_p", "k_c"),
    [X, Y, (0.5, 4.0), (0.5, 8.0), (1.5, 2.0), (5.0, 5.5), (3.0, 12.0), (8.0, 11.0)],
)
def test_peak_gains_against_quadrature(k_p, k_c):
    """Theorem 1: closed forms against the integral of |impulse response|."""
    assert largest_errors.com_peak_gain(PAPER, k_p, k_c) == pytest.approx(
        impulse_area(PAPER, k_p, k_c, "com"), rel=2e-5
    )
    assert largest_errors.zmp_peak_gain(PAPER, k_p, k_c) == pytest.approx(
        impulse_area(PAPER, k_p, k_c, "zmp"), rel=2e-5
    )


@examples
@given(height, gain, gain)
def test_peak_gain_closed_forms(h, k_p, k_c):
    """Theorem 1: coth form for e_c, and the lower bound for e_p."""
    if k_c - k_p < 0.05:
        return
    pendulum = Pendulum(height=h)
    zeta = pole_placement.damping(pendulum, k_p, k_c)
    peak = 1.0 / (k_c - k_p)
    if zeta < 1.0:
        peak /= math.tanh(0.5 * math.pi * zeta / math.sqrt(1.0 - zeta**2))
    assert largest_errors.com_peak_gain(pendulum, k_p, k_c) == pytest.approx(
        peak, rel=1e-9
    )
    least = 2.0 / k_p + 1.0 / (k_c - k_p)
    assert largest_errors.zmp_peak_gain(pendulum, k_p, k_c) >= least * (1 - 1e-12)


@pytest.mark.parametrize("nudge", [-1e-9, 0.0, 1e-9])
def test_peak_gains_at_critical_damping(nudge):
    """Theorem 1: no jump where the two poles meet."""
    k_p, k_c = pole_placement.design_gains(PAPER, 4.0, 1.0 + nudge)
    assert largest_errors.com_peak_gain(PAPER, k_p, k_c) == pytest.approx(
        1 / (k_c - k_p), rel=1e-6
    )
    near = largest_errors.zmp_peak_gain(
        PAPER, *pole_placement.design_gains(PAPER, 4.0, 1.0 + 1e-5)
    )
    assert largest_errors.zmp_peak_gain(PAPER, k_p, k_c) == pytest.approx(
        near, rel=1e-4
    )


BOUNDS = [
    (X, 0.05, 0.5, "zmp", 0.0403, 5e-5),
    (X, 0.05, 0.5, "com", 0.0172, 5e-5),
    (Y, 0.05, 0.5, "zmp", 0.0467, 5e-5),
    (Y, 0.05, 0.5, "com", 0.0250, 5e-5),
    (X, 0.05, 5.0, "zmp", 0.0556, 5e-5),
    (Y, 0.05, 5.0, "zmp", 0.0763, 5e-5),
    (Y, 0.05, 5.0, "com", 0.0250, 5e-5),
    (X, 0.02, 0.02, "zmp", 0.0073, 5e-5),
    (X, 0.02, 0.02, "com", 0.0059, 5e-5),
    (Y, 0.02, 0.02, "zmp", 0.0109, 5e-5),
    (Y, 0.02, 0.02, "com", 0.0100, 5e-5),
]


@pytest.mark.parametrize(("gains", "a", "b", "output", "bound", "tolerance"), BOUNDS)
def test_worst_case_is_reached(gains, a, b, output, bound, tolerance):
    """Theorem 1: the bound as known, and its disturbance reaches it to 0.1 %."""
    worst = largest_errors.worst_case(PAPER, *gains, a, b, output)
    assert worst.bound == pytest.approx(bound, abs=tolerance)
    eps = worst.disturbance
    assert np.abs(eps).max() <= a * (1 + 1e-9)
    assert np.abs(np.diff(eps)).max() <= b * worst.dt * (1 + 1e-6)
    k_p, k_c = gains
    errors = simulate_error_dynamics(PAPER, k_p, k_c, eps, worst.dt)
    reached = errors[0 if output == "com" else 1][-1]
    assert reached == pytest.approx(worst.bound, rel=1e-3)


def test_worst_case_tends_to_the_peak_gains():
    """Theorem 1: without a bound on the rate only the peak gain is left."""
    for k_p, k_c in (X, Y):
        com = largest_errors.worst_case(PAPER, k_p, k_c, 1.0, 1e4, "com").bound
        zmp = largest_errors.worst_case(PAPER, k_p, k_c, 1.0, 1e4, "zmp").bound
        assert 0.999 < com / largest_errors.com_peak_gain(PAPER, k_p, k_c) < 1.0 + 1e-4
        assert 0.99 < zmp / largest_errors.zmp_peak_gain(PAPER, k_p, k_c) < 1.0 + 1e-4


def test_worst_case_does_not_depend_on_the_grid():
    """Theorem 1: half the samples give the same bound to 0.1 %."""
    fine = largest_errors.worst_case(PAPER, *X, 0.05, 0.5, "zmp").bound
    coarse = largest_errors.worst_case(PAPER, *X, 0.05, 0.5, "zmp", samples=751).bound
    assert coarse == pytest.approx(fine, rel=1e-3)


@pytest.mark.parametrize("gains", [X, Y])
def test_random_disturbances_stay_inside_the_bounds(gains):
    """Theorem 1: |eps| <= .05, |eps'| <= .5 never exceed the exact bounds."""
    (k_p, k_c), rng = gains, np.random.default_rng(7)
    com = largest_errors.worst_case(PAPER, k_p, k_c, 0.05, 0.5, "com").bound
    zmp = largest_errors.worst_case(PAPER, k_p, k_c, 0.05, 0.5, "zmp").bound
    peak_c = peak_p = 0.0
    for _ in range(20):
        signs = np.where(np.cumsum(rng.random(1500) < 0.05) % 2, 1.0, -1.0)
        eps = np.zeros(1500)
        for i, sign in enumerate(signs[1:]):
            eps[i + 1] = min(max(eps[i] + 0.5 * 0.01 * sign, -0.05), 0.05)
        e_c, e_p = simulate_error_dynamics(PAPER, k_p, k_c, eps, 0.01)
        peak_c, peak_p = max(peak_c, *abs(e_c)), max(peak_p, *abs(e_p))
    assert 0.5 * com < peak_c <= com * (1 + 1e-3)
    assert 0.5 * zmp < peak_p <= zmp * (1 + 1e-3)


# --- The sampled loop --------------------------------------------------------------

# Highest stable cut-off [Hz] (x, y) for a delay of one tick, filter in real time.
CUTOFFS = {
    0.005: [(4.2, 7.1), (2.3, 3.9), (1.2, 2.0), (0.9, 1.5)],
    0.010: [(8.1, 13.7), (4.3, 7.2), (1.9, 3.3), (1.2, 2.0)],
    0.020: [(16.2, 27.8), (8.2, 14.3), (3.5, 6.1), (2.0, 3.4)],
    0.050: [(43.0, 80.0), (22.0, 40.0), (8.9, 16.5), (4.7, 8.6)],
}


@pytest.mark.parametrize("lag", CUTOFFS)
def test_highest_cutoff_table(lag):
    """Sampled Eq. (31): limits found elsewhere on a frequency grid 2 % wide."""
    for period, limits in zip((0.001, 0.002, 0.005, 0.010), CUTOFFS[lag], strict=True):
        loop = sampled.SampledLoop(
            period=period, servo_lag=lag, delay=1, analog_filter=True
        )
        for gains, limit in zip((X, Y), limits, strict=True):
            highest = sampled.highest_cutoff(PAPER, *gains, loop)
            assert limit - 0.05 < highest < 1.02 * limit + 0.05


@pytest.mark.parametrize(
    ("gains", "cutoff", "decay"),
    [(X, 1, 2.69), (X, 2, 2.45), (Y, 1, 2.01), (Y, 2, 2.92), (Y, 5, 3.10)],
)
def test_decay_of_the_sampled_loop(gains, cutoff, decay):
    """Sampled Eq. (31): decay rate at tau = 20 ms, dt = 5 ms, one tick of delay."""
    loop = sampled.SampledLoop(
        period=0.005, servo_lag=0.02, zmp_cutoff=cutoff, delay=1, analog_filter=True
    )
    rate = -math.log(sampled.spectral_radius(PAPER, *gains, loop)) / loop.period
    assert rate == pytest.approx(decay, abs=0.006)


def test_raw_zmp_needs_a_slow_servo():
    """Sampled Eq. (31): the raw ZMP is stable only if tau > k_p / omega^2."""
    for period in (0.001, 0.005, 0.010):
        for delay in (0, 1, 2):
            for lag in (0.005, 0.02, 0.1, 0.2, 0.25):
                loop = sampled.SampledLoop(
                    period=period, servo_lag=lag, zmp_cutoff=None, delay=delay
                )
                for gains in (X, Y):
                    stable = sampled.spectral_radius(PAPER, *gains, loop) < 1.0
                    assert stable == (lag > gains[0] / PAPER.omega**2), (loop, gains)
    loop = sampled.SampledLoop(period=0.001, servo_lag=0.02, zmp_cutoff=None, delay=1)
    assert sampled.spectral_radius(PAPER, *X, loop) == pytest.approx(3.2, abs=0.05)
    assert sampled.spectral_radius(PAPER, *Y, loop) == pytest.approx(2.5, abs=0.05)


def brute_force(gains, loop, ticks):
    """Return the errors of a plain time simulation, without any matrix."""
    k_p, k_c = gains
    w2, tau, fine = PAPER.omega**2, loop.servo_lag, 40
    c, v, u, f = 0.01, 0.0, 0.0, 0.01
    alpha = sampled.low_pass_coefficient(loop.zmp_cutoff, loop.period)
    seen, out = [(c, f)] * (loop.delay + 1), []
    h = loop.period / fine
    for _ in range(ticks):
        late_c, late_f = seen[-1 - loop.delay]
        u = k_p * late_f - k_c * late_c
        for _ in range(fine):  # midpoint rule
            v_half = v + 0.5 * h * (u - v) / tau
            c, v = c + h * v_half, v + h * (u - v_half) / tau
        p = c - (u - v) / (tau * w2)
        f += alpha * (p - f)
        seen.append((c, f))
        out.append(c)
    return np.array(out)


@pytest.mark.parametrize("period", [0.002, 0.010])
@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("cutoff", [1.0, 5.0, 30.0, None])
def test_matrix_against_a_time_simulation(period, delay, cutoff):
    """Sampled Eq. (31): powers of the matrix are the simulated loop."""
    loop = sampled.SampledLoop(period=period, zmp_cutoff=cutoff, delay=delay)
    M = sampled.sampled_loop_matrix(PAPER, *X, loop)
    assert M.shape == (3 + 2 * delay, 3 + 2 * delay)
    z = np.array([0.01, 0.0, 0.01] + [0.01, 0.01] * delay)
    ticks = 60
    expected = brute_force(X, loop, ticks)
    states = []
    for _ in range(ticks):
        z = M @ z
        states.append(z[0])
    scale = np.abs(expected).max()
    assert np.array(states) == pytest.approx(expected, rel=2e-3, abs=2e-3 * scale)


@pytest.mark.parametrize("fraction", [0.9, 1.1])
def test_highest_cutoff_separates_decay_from_growth(fraction):
    """Sampled Eq. (31): below the limit a simulation decays, above it grows."""
    loop = sampled.SampledLoop(period=0.005, delay=1)
    limit = sampled.highest_cutoff(PAPER, *X, loop)
    loop = sampled.SampledLoop(period=0.005, delay=1, zmp_cutoff=fraction * limit)
    c = np.abs(brute_force(X, loop, 800))
    grew = c[-100:].max() > c[300:400].max()
    assert grew == (fraction > 1.0)


def test_filters_at_sensor_rate_and_at_tick_rate_agree_for_short_periods():
    """Sampled Eq. (31): both filters tend to the same loop."""
    radii = [
        sampled.spectral_radius(
            PAPER, *X, sampled.SampledLoop(period=1e-4, delay=0, analog_filter=analog)
        )
        for analog in (False, True)
    ]
    decay = [-math.log(r) / 1e-4 for r in radii]
    assert decay[0] == pytest.approx(decay[1], rel=1e-2)


def test_highest_cutoff_at_its_ends():
    """Sampled Eq. (31): 0 where no filter helps, infinite where none is needed."""
    loop = sampled.SampledLoop()
    assert sampled.highest_cutoff(PAPER, 7.0, 6.6, loop) == 0.0
    assert (
        sampled.highest_cutoff(PAPER, 0.1, 6.6, sampled.SampledLoop(servo_lag=0.5))
        == math.inf
    )


@pytest.mark.parametrize("cutoff", [None, math.inf])
def test_no_filter_is_the_coefficient_one(cutoff):
    assert sampled.low_pass_coefficient(cutoff, 0.002) == 1.0


def test_low_pass_coefficient_is_the_exact_step_response():
    """dt long against the time constant, or short; ten steps are one of ten times."""
    assert sampled.low_pass_coefficient(1.0, 1.0) == pytest.approx(
        1 - math.exp(-2 * math.pi)
    )
    assert sampled.low_pass_coefficient(1e-6, 1e-6) == pytest.approx(2e-12 * math.pi)
    ten = 1 - (1 - sampled.low_pass_coefficient(5.0, 0.002)) ** 10
    assert ten == pytest.approx(sampled.low_pass_coefficient(5, 0.02))


# --- Bad input ---------------------------------------------------------------------

BAD = [math.nan, math.inf, -1.0, "3", None, True]


@pytest.mark.parametrize("bad", BAD)
def test_bad_numbers_are_refused(bad):
    with pytest.raises(ParameterError, match="k_p"):
        s.error_dynamics(PAPER, bad, 6.6)
    with pytest.raises(ParameterError, match="k_c"):
        pole_placement.poles(PAPER, 3.0, bad)
    with pytest.raises(ParameterError, match="alpha"):
        s.rate_bound_coefficients(PAPER, 3.0, 6.6, bad, 1.0, 1.0)
    with pytest.raises(ParameterError, match="a must be"):
        largest_errors.worst_case(PAPER, *X, bad, 0.5, "zmp")
    with pytest.raises(ParameterError, match="dt"):
        sampled.low_pass_coefficient(5.0, bad)
    with pytest.raises(ParameterError, match="natural_frequency"):
        pole_placement.design_gains(PAPER, bad, 1.0)
    with pytest.raises(ParameterError, match="k_p"):
        sampled.spectral_radius(PAPER, bad, 6.6, sampled.SampledLoop())


@pytest.mark.parametrize("field", ["period", "servo_lag", "delay"])
@pytest.mark.parametrize("bad", BAD)
def test_bad_loop_is_refused(field, bad):
    with pytest.raises(ParameterError, match=field):
        sampled.SampledLoop(**{field: bad})


def test_other_bad_input():
    with pytest.raises(ParameterError, match="delay must be a whole number"):
        sampled.SampledLoop(delay=1.5)  # ty: ignore[invalid-argument-type]
    with pytest.raises(ParameterError, match="zmp_cutoff"):
        sampled.SampledLoop(zmp_cutoff=0.0)
    with pytest.raises(ParameterError, match="below k_c"):
        largest_errors.com_peak_gain(PAPER, 7.0, 6.6)
    with pytest.raises(ParameterError, match='"com" or "zmp"'):
        largest_errors.worst_case(PAPER, *X, 0.05, 0.5, "cop")  # ty: ignore[invalid-argument-type]
    with pytest.raises(ParameterError, match="k_p"):
        s.zmp_error_from_com(0.0, 6.6, 0.0, 0.0, 0.0)
