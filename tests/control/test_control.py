"""Eq. (31) and the controller around it."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comwalk.certificates import gain_check
from comwalk.certificates import ideal_loop as stability
from comwalk.certificates import sampled_loop as sampled
from comwalk.certificates.sampled_loop import SampledLoop
from comwalk.control import law as control
from comwalk.control.gains import PAPER_GAINS, Gains
from comwalk.control.law import ControlOutput, ControlSettings
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum

PAPER = Pendulum()
DT = 0.002
OPEN = Gains(zmp=(0.0, 0.0), com=(0.0, 0.0))

coordinate = st.floats(-0.3, 0.3)
pair = st.tuples(coordinate, coordinate)
gain = st.floats(0.0, 10.0)
gain_pair = st.tuples(gain, gain)
examples = settings(max_examples=100)


@dataclass
class Asked:
    """A reference, as the controller sees it."""

    com: Any = (0.0, 0.0, 0.7)
    com_velocity: Any = (0.0, 0.0, 0.0)
    zmp: Any = (0.0, 0.0)
    heading: float = 0.0
    walking: float = 1.0

    def __post_init__(self):
        self.com, self.com_velocity, self.zmp = (
            np.array(x, float) for x in (self.com, self.com_velocity, self.zmp)
        )


def gains_of(**fields: Any) -> Gains:
    """Gains of anything, as from a file."""
    return Gains(**fields)


# --- Gains -------------------------------------------------------------------------


def test_paper_gains():
    """Section VI: k_p = {3.0, 1.8}, k_c = {6.6, 3.8}."""
    assert PAPER_GAINS.zmp == (3.0, 1.8)
    assert PAPER_GAINS.com == (6.6, 3.8)
    assert not PAPER_GAINS.is_open_loop


@pytest.mark.parametrize("value", [2, 2.0, np.float64(2.0), [2], (2,), np.array([2.0])])
def test_one_number_serves_both_axes(value):
    assert gains_of(zmp=value, com=5).zmp == (2.0, 2.0)
    assert all(isinstance(k, float) for k in gains_of(zmp=value).zmp)
    assert gains_of(standing_zmp=value).standing[0] == (2.0, 2.0)


@pytest.mark.parametrize("value", [[3, 2], (3, 2), np.array([3.0, 2.0])])
def test_two_numbers_are_x_and_y(value):
    assert gains_of(com=value).com == (3.0, 2.0)


@pytest.mark.parametrize("name", ["zmp", "com", "standing_zmp", "standing_com"])
@pytest.mark.parametrize(
    "bad", [-1.0, math.nan, math.inf, "3", [1, 2, 3], [], [1, "2"], True, {}, [[1, 2]]]
)
def test_bad_gains_are_refused(name, bad):
    with pytest.raises(ParameterError, match=f"^{name} "):
        gains_of(**{name: bad})


def test_gains_of_none_are_refused():
    with pytest.raises(ParameterError, match=r"^zmp "):
        gains_of(zmp=None)


@examples
@given(gain_pair, gain_pair, st.floats(-0.5, 1.5))
def test_derived_standing_gains_are_as_stable_as_walking(k_p, k_c, walking):
    """0 < k_p < k_c walking implies it standing and in between."""
    gains = Gains(zmp=k_p, com=k_c)
    blended = gains.blend(walking)
    for axis in (0, 1):
        if stability.is_hurwitz(k_p[axis], k_c[axis]):
            assert stability.is_hurwitz(blended[0][axis], blended[1][axis])
        if k_p[axis] == k_c[axis] == 0.0:
            assert blended[0][axis] == blended[1][axis] == 0.0
    assert gains.blend(1.0) == gains.walking == (k_p, k_c)
    assert gains.blend(0.0) == gains.standing


def test_open_loop_stays_open_when_standing():
    assert OPEN.is_open_loop
    assert OPEN.standing == ((0.0, 0.0), (0.0, 0.0))
    assert replace(PAPER_GAINS, zmp=(0.0, 0.0), com=(0.0, 0.0)).is_open_loop
    given = replace(OPEN, standing_zmp=(0.5, 0.5), standing_com=(4.0, 4.0))
    assert not given.is_open_loop
    assert given.blend(0.0) == ((0.5, 0.5), (4.0, 4.0))


# --- The law -----------------------------------------------------------------------


def test_walking_control_on_arrays():
    """Eq. (31): u = cdot_d - k_p e_p + k_c e_c, per axis."""
    u = control.walking_control(
        np.array([0.2, -0.1]),
        np.array([0.01, 0.02]),
        np.array([0.03, -0.04]),
        np.array(PAPER_GAINS.zmp),
        np.array(PAPER_GAINS.com),
    )
    assert u == pytest.approx([0.2 - 0.03 + 0.198, -0.1 - 0.036 - 0.152])


@examples
@given(pair, pair, pair, pair, gain, gain, st.floats(-7.0, 7.0))
def test_control_closes_the_error_dynamics(c_d, c, p_d, p, k_p, k_c, heading):
    """Eqs. (31), (34): with cdot = u + eps, k_p e_p = e_c' + k_c e_c + eps."""
    e_p = p_d[0] - p[0], p_d[1] - p[1]
    e_c = c_d[0] - c[0], c_d[1] - c[1]
    w = control.heading_correction(heading, e_p, e_c, (k_p, k_p), (k_c, k_c))
    eps = 0.03
    for i in (0, 1):  # cdot_d = 0, so that e_c' = -(w + eps)
        assert k_p * e_p[i] == pytest.approx(
            -(w[i] + eps) + k_c * e_c[i] + eps, abs=1e-9
        )


@examples
@given(st.floats(-7.0, 7.0), pair, pair, gain_pair, gain_pair)
def test_correction_turns_with_the_heading(heading, e_p, e_c, k_p, k_c):
    """Eq. (31): R diag(k) R^T, with R from complex numbers."""
    w = control.heading_correction(heading, e_p, e_c, k_p, k_c)
    turn = complex(math.cos(heading), math.sin(heading))
    p, c = complex(*e_p) / turn, complex(*e_c) / turn
    forward = -k_p[0] * p.real + k_c[0] * c.real
    left = -k_p[1] * p.imag + k_c[1] * c.imag
    expected = complex(forward, left) * turn
    assert w == pytest.approx((expected.real, expected.imag), abs=1e-9)


# --- The controller ----------------------------------------------------------------


def started(gains=PAPER_GAINS, reference=None, period=DT, **fields):
    """A controller reset to a reference."""
    reference = reference or Asked()
    controller = control.WalkingController(gains, ControlSettings(**fields), period)
    controller.reset(reference.com, reference.zmp)
    return controller


def test_open_loop_plays_the_reference_exactly():
    """Eq. (31): without gains u = cdot_d and the command is c_d, to the last bit."""
    rng = np.random.default_rng(3)
    controller = started(OPEN)
    for _ in range(200):
        reference = Asked(rng.normal(size=3), rng.normal(size=3), rng.normal(size=2))
        reference.walking = rng.random()
        out = controller.step(reference, rng.normal(size=3), rng.normal(size=2))
        assert (out.u == reference.com_velocity[:2]).all()
        assert (out.com_command == reference.com[:2]).all()
        assert not out.saturated


def test_one_tick_by_hand():
    """Eq. (31): with the filter's first step on ZMP and reference alike."""
    controller = started()
    reference = Asked(com=(0.01, 0.02), com_velocity=(0.1, 0.0), zmp=(0.03, 0.0))
    out = controller.step(reference, com=(0.0, 0.03), zmp=(0.01, -0.02))
    a = 1 - math.exp(-2 * math.pi * 4.0 * DT)
    e_p = np.array([a * 0.02, a * 0.02])
    assert out.com_error == pytest.approx([0.01, -0.01])
    assert out.zmp_error == pytest.approx(e_p)
    assert out.zmp_reference == pytest.approx([a * 0.03, 0.0])
    assert out.zmp_filtered == pytest.approx([a * 0.01, a * -0.02])
    assert out.u == pytest.approx([0.1 - 3.0 * e_p[0] + 0.066, -1.8 * e_p[1] - 0.038])
    assert out.com_command == pytest.approx([0.01, 0.02])
    assert not out.saturated


def test_com_command_is_the_integral_of_u():
    """Fig. 4: u is the rate of the command, with and without the bounds."""
    for max_offset in (0.10, 0.01):
        rng = np.random.default_rng(5)
        controller, out, saturated = started(max_offset=max_offset), None, 0
        velocity = np.array([0.2, 0.05])
        for k in range(500):
            reference = Asked(com=k * DT * velocity, com_velocity=velocity)
            reference.heading = 0.01 * k
            noise = rng.normal(scale=0.05, size=2)
            last, out = out, controller.step(reference, noise, noise[::-1])
            saturated += out.saturated
            if last is not None:
                moved = out.com_command - last.com_command
                assert moved == pytest.approx(last.u * DT, abs=1e-12)
            offset = out.com_command - reference.com[:2]
            assert np.hypot(*offset) <= max_offset * (1 + 1e-12)
            assert np.hypot(*(out.u - velocity)) <= 2 * 0.5
        assert saturated > 0


def test_bound_on_the_correction():
    """|u - cdot_d| stays in its bound and points the same way."""
    out = started().step(Asked(), com=(-3.0, 4.0), zmp=(0.0, 0.0))
    assert out.saturated
    assert np.hypot(*out.u) == pytest.approx(0.5)
    assert out.u[1] / out.u[0] == pytest.approx(3.8 * -4.0 / (6.6 * 3.0))
    free = started(max_correction=100.0, max_offset=1.0)
    assert not free.step(Asked(), com=(-3.0, 4.0), zmp=(0.0, 0.0)).saturated


def test_nothing_winds_up():
    """At the bound of the offset the integral stops; it leaves it at once."""
    controller = started()
    for _ in range(2000):
        out = controller.step(Asked(), com=(-0.2, 0.0), zmp=(0.0, 0.0))
    assert out.saturated
    assert out.com_command == pytest.approx([0.10, 0.0])
    assert out.u == pytest.approx([0.0, 0.0], abs=1e-9)
    out = controller.step(Asked(), com=(0.05, 0.0), zmp=(0.0, 0.0))
    assert out.u[0] == pytest.approx(-0.05 * 6.6)
    assert not out.saturated


def test_reference_passes_the_same_filter_and_delay():
    """A robot that follows exactly, seen late, shows no error at all."""
    delay = 7
    rng = np.random.default_rng(11)
    references = [Asked(rng.normal(size=3), zmp=rng.normal(size=2)) for _ in range(80)]
    start = references[0]
    controller = started(reference=start, delay=delay)
    for k, reference in enumerate(references):
        seen = references[max(0, k - delay)]
        out = controller.step(reference, seen.com, seen.zmp)
        assert out.com_error == pytest.approx([0.0, 0.0], abs=1e-14)
        assert out.zmp_error == pytest.approx([0.0, 0.0], abs=1e-14)
        assert out.com_command == pytest.approx(reference.com[:2], abs=1e-12)


def test_unfiltered_zmp():
    out = started(zmp_cutoff=None).step(Asked(zmp=(0.1, 0.0)), (0, 0), (0.04, 0.01))
    assert out.zmp_error == pytest.approx([0.06, -0.01])


def test_filter_settles_in_its_time_constant():
    """A step of the ZMP: 1 - 1/e after 1 / (2 pi f_c)."""
    controller = started(OPEN, zmp_cutoff=1.0, period=1e-3)
    ticks = round(1 / (2 * math.pi * 1.0) / 1e-3)
    for _ in range(ticks):
        out = controller.step(Asked(), (0.0, 0.0), (1.0, 0.0))
    assert out.zmp_filtered[0] == pytest.approx(1 - math.exp(-1), abs=2e-3)


def test_reset_forgets():
    controller, fresh = started(delay=3), started(delay=3)
    for _ in range(50):
        controller.step(Asked(), (0.1, 0.1), (0.1, 0.2))
    controller.reset((0.0, 0.0), (0.0, 0.0))
    one = controller.step(Asked(), (0.01, 0.0), (0.0, 0.02))
    two = fresh.step(Asked(), (0.01, 0.0), (0.0, 0.02))
    assert (one.u == two.u).all()
    assert (one.com_command == two.com_command).all()


def test_standing_uses_the_standing_gains():
    gains = Gains(standing_zmp=(1.0, 1.0), standing_com=(2.0, 3.0))
    out = started(gains).step(Asked(walking=0.0), com=(-0.01, -0.01), zmp=(0.0, 0.0))
    assert out.u == pytest.approx([0.02, 0.03])


def test_output_at_rest():
    reference = Asked(com=(0.1, 0.2, 0.7), zmp=(0.3, 0.4))
    out = ControlOutput.still(reference)
    assert out.com_command.tolist() == [0.1, 0.2]
    assert out.zmp_reference.tolist() == out.zmp_filtered.tolist() == [0.3, 0.4]
    for rest in (out.u, out.com_error, out.zmp_error):
        assert not rest.any()
    reference.zmp[0] = reference.com[0] = 9.0
    assert out.com_command[0] == 0.1
    assert out.zmp_filtered[0] == 0.3


@pytest.mark.parametrize(
    "bad", [(math.nan, 0.0), (0.0, math.inf), (0.0,), 0.0, None, "ab", ("x", "y")]
)
def test_bad_measurements_are_refused(bad):
    controller = started()
    with pytest.raises(ParameterError, match=r"^zmp must be"):
        controller.step(Asked(), (0.0, 0.0), bad)
    with pytest.raises(ParameterError, match=r"^com must be"):
        controller.step(Asked(), bad, (0.0, 0.0))
    with pytest.raises(ParameterError, match="reference_zmp"):
        controller.reset((0.0, 0.0), bad)


BAD = [0.0, -1.0, math.nan, "5", True]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", ["zmp_cutoff", "max_correction", "max_offset"])
def test_bad_settings_are_refused(name, bad):
    fields: dict[str, Any] = {name: bad}
    with pytest.raises(ParameterError, match=name):
        ControlSettings(**fields)


@pytest.mark.parametrize("bad", [-1, 0.5, math.nan, "1", None])
def test_bad_delay_is_refused(bad):
    with pytest.raises(ParameterError, match="delay"):
        ControlSettings(delay=bad)


def test_bad_period_is_refused():
    with pytest.raises(ParameterError, match="period"):
        control.WalkingController(period=0.0)


# --- The check of the gains --------------------------------------------------------


def test_paper_gains_pass_at_the_defaults():
    """Section VI: stable at 500 Hz with a 4 Hz filter, one tick late."""
    assert gain_check.check_gains(PAPER_GAINS, PAPER, SampledLoop()) is None


@pytest.mark.parametrize("height", [0.3, 0.5, 0.7, 0.9, 1.2])
@pytest.mark.parametrize("period", [0.001, 0.002, 0.004])
def test_paper_gains_pass_on_other_robots(height, period):
    loop = SampledLoop(period=period)
    limit = sampled.highest_cutoff(Pendulum(height=height), 3.0, 6.6, loop)
    if limit > loop.zmp_cutoff:
        gain_check.check_gains(PAPER_GAINS, Pendulum(height=height), loop)
    else:
        with pytest.raises(ParameterError, match="set zmp_cutoff to"):
            gain_check.check_gains(PAPER_GAINS, Pendulum(height=height), loop)


def test_open_loop_and_com_feedback_alone_pass():
    gain_check.check_gains(OPEN, PAPER, SampledLoop())
    gain_check.check_gains(Gains(zmp=(0.0, 0.0)), PAPER, SampledLoop())
    gain_check.check_gains(Gains(zmp=(0.0, 1.8), com=(0.0, 3.8)), PAPER, SampledLoop())


def test_zmp_gain_must_be_below_com_gain():
    """The exact condition 0 < k_p < k_c, on each axis, walking and standing."""
    loop = SampledLoop()
    message = r"gains\.zmp \(k_p\) = 7 must be below gains\.com \(k_c\) = 6\.6 in x"
    with pytest.raises(ParameterError, match=message):
        gain_check.check_gains(Gains(zmp=(7.0, 1.8)), PAPER, loop)
    with pytest.raises(ParameterError, match=r"= 3\.8 in y"):
        gain_check.check_gains(Gains(zmp=(3.0, 3.8)), PAPER, loop)
    with pytest.raises(ParameterError, match=r"gains\.standing_zmp \(k_p\) = 5"):
        gain_check.check_gains(Gains(standing_zmp=(5.0, 0.5)), PAPER, loop)
    with pytest.raises(ParameterError, match=r"must be below gains\.com \(k_c\) = 0"):
        gain_check.check_gains(Gains(com=(0.0, 0.0)), PAPER, loop)


def test_check_names_a_cutoff_that_works():
    """The sampled loop: the message's cut-off is stable, and half of the limit."""
    loop = SampledLoop(period=0.005, delay=2)
    with pytest.raises(ParameterError, match="errors grow") as caught:
        gain_check.check_gains(PAPER_GAINS, PAPER, loop)
    words = str(caught.value).split("zmp_cutoff to ")[1]
    advised = float(words.split()[0])
    limit = sampled.highest_cutoff(PAPER, 3.0, 6.6, loop)
    assert advised == pytest.approx(0.5 * limit, rel=0.06)
    gain_check.check_gains(PAPER_GAINS, PAPER, replace(loop, zmp_cutoff=advised))


def test_check_refuses_the_raw_zmp():
    """The sampled loop: no filter and a quick servo are unstable at any rate."""
    with pytest.raises(ParameterError, match="zmp_cutoff inf Hz"):
        gain_check.check_gains(PAPER_GAINS, PAPER, SampledLoop(zmp_cutoff=None))


def test_check_refuses_com_feedback_that_is_too_late():
    """The sampled loop: k_p = 0 with a long delay has no cut-off to blame."""
    with pytest.raises(ParameterError, match=r"lower gains\.zmp"):
        gain_check.check_gains(
            Gains(zmp=(0.0, 0.0), com=(60.0, 60.0)), PAPER, SampledLoop(delay=20)
        )
