"""The pendulum: Eqs. (1)-(3) and (29)."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import (
    PAPER_PENDULUM,
    Pendulum,
    state_matrices,
    zmp_of_motion,
)

HEIGHTS = st.floats(0.05, 10.0)
NUMBERS = st.floats(-5.0, 5.0)


def test_omega_is_the_golden_one():
    """Eq. (3): omega_n of the paper is 3.78 rad/s."""
    assert math.isclose(PAPER_PENDULUM.omega, 3.778819390038739, rel_tol=1e-15)
    assert round(PAPER_PENDULUM.omega, 2) == 3.78


@given(HEIGHTS, NUMBERS, NUMBERS, NUMBERS)
def test_zmp_agrees_with_the_state_space_form(height, c, cdot, p):
    """Eqs. (1)-(3): the acceleration from the state space form gives p back."""
    pendulum = Pendulum(height=height)
    A, B = state_matrices(pendulum)
    rate = A @ np.array([c, cdot]) + B[:, 0] * p
    assert rate[0] == cdot
    back = zmp_of_motion(pendulum, np.array([c]), rate[1:])
    assert abs(back[0] - p) < 1e-12


@pytest.mark.parametrize("shape", [(2,), (3,), (7, 2), (4, 5, 3)])
def test_zmp_keeps_the_shape_and_balances_moments(shape):
    """Eqs. (1), (2) and (29): gravity and inertia have no moment about the ZMP."""
    rng = np.random.default_rng(3)
    c, a = rng.normal(size=shape), rng.normal(size=shape)
    p = zmp_of_motion(PAPER_PENDULUM, c, a)
    assert p.shape == shape
    g, c_z = PAPER_PENDULUM.gravity, PAPER_PENDULUM.height
    np.testing.assert_allclose((c - p) * g - c_z * a, 0.0, atol=1e-12)


def test_state_matrices_give_the_hyperbolic_solution():
    """Eq. (3): the matrix exponential is made of cosh and sinh of omega_n t."""
    omega, t = PAPER_PENDULUM.omega, 0.37
    cosh, sinh = math.cosh(omega * t), math.sinh(omega * t)
    expected = [[cosh, sinh / omega], [omega * sinh, cosh]]
    np.testing.assert_allclose(
        expm(state_matrices(PAPER_PENDULUM).A * t), expected, rtol=1e-13
    )


def test_integers_become_floats_and_fields_cannot_change():
    pendulum = Pendulum(height=1, gravity=9)
    assert isinstance(pendulum.height, float)
    assert pendulum.omega == 3.0
    frozen: Any = pendulum
    with pytest.raises(dataclasses.FrozenInstanceError):
        frozen.height = 2.0


@given(HEIGHTS, st.floats(-0.5, 2.0), NUMBERS, NUMBERS)
def test_momentum_of_legs_that_sway_makes_it_longer(height, kappa, c, cddot):
    """With L = kappa m c_z cdot, moments about the ZMP balance per unit of mass."""
    pendulum = Pendulum(height=height, inertia=kappa)
    p = zmp_of_motion(pendulum, np.array([c]), np.array([cddot]))[0]
    rate = kappa * height * cddot
    assert abs((c - p) * pendulum.gravity - height * cddot - rate) < 1e-9
    longer = Pendulum(height=10.0, inertia=kappa).omega
    assert math.isclose(longer, math.sqrt(9.81 / (10.0 * (1.0 + kappa))), rel_tol=1e-12)


@pytest.mark.parametrize("value", [-0.6, 2.1, math.nan, "0.1"])
def test_bad_inertia_is_refused(value):
    with pytest.raises(ParameterError, match=r"inertia must be .* in \[-0.5, 2\]"):
        Pendulum(inertia=value)


@pytest.mark.parametrize(
    "value", [0.0, -1.0, 11.0, math.nan, math.inf, "1", None, True]
)
def test_bad_height_is_refused(value):
    with pytest.raises(
        ParameterError, match=r"height must be a number in \[0.05, 10\] m"
    ):
        Pendulum(height=value)


def test_bad_gravity_and_shapes_are_refused():
    with pytest.raises(ParameterError, match="gravity"):
        Pendulum(gravity=0)
    with pytest.raises(ParameterError, match=r"shape of com, \(2,\), got \(3,\)"):
        zmp_of_motion(PAPER_PENDULUM, np.zeros(2), np.zeros(3))
