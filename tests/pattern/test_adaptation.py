"""Step adaptation: a pendulum that is pushed, and the closed forms behind it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from comwalk.pattern import adaptation, replan
from comwalk.pattern.adaptation import Agility, adapt, adaptation_record
from comwalk.pattern.footsteps import PAPER_SOLE, Gait
from comwalk.pattern.online import OnlinePattern
from comwalk.pattern.pendulum import PAPER_PENDULUM
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.records import REFERENCE
from comwalk.pattern.reference import SINGLE_LEFT, Phase, fill_reference
from comwalk.pattern.walk_pattern import make_pattern

OMEGA, HEIGHT = PAPER_PENDULUM.omega, PAPER_PENDULUM.height
HALF = 0.85 * np.array(PAPER_SOLE) / 2
AGILE = Agility(
    half=(float(HALF[0]), float(HALF[1])),
    leg=0.563,
    tall=0.52,
    hip=(0.0, 0.09),
    lowest=0.087,
    aside=0.42,
    beside=0.14,
    speed=2.5,
    rush=60.0,
)
PLAN = plan_steps(Gait(), 10)
WHOLE = make_pattern(PLAN, PAPER_PENDULUM)
DT = 0.002


class Pendulum:
    """A point mass on a ZMP in the soles, or between, which follows a pattern."""

    def __init__(self, agility: Agility | None = AGILE) -> None:
        self.online = OnlinePattern.of(WHOLE, agility=agility)
        reference = self.online.fill(0.0)
        self.c, self.v = reference["com"].copy(), reference["com_velocity"].copy()
        self.time = 0.0

    def tick(self, push: np.ndarray) -> np.void:
        """Go through a control period; return its reference."""
        reference = self.online.fill(self.time)
        table, state, command, work, steps, how = self.online.arrays
        if len(how):
            away, parts = np.zeros(2), (table, state[0], command[0], work, steps)
            if adapt(*parts, how[0], reference, self.c, self.v, away):
                fill_reference(table[:1], OMEGA, HEIGHT, self.time, reference)
        zmp = reference["zmp"] + 3.0 * (
            self.c[:2] + self.v[:2] / OMEGA
            - reference["com"][:2] - reference["com_velocity"][:2] / OMEGA
        )  # fmt: skip
        feet = reference["feet"]["position"][:, :2]
        if reference["phase"] in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
            feet = feet[[reference["support"]]]
        zmp = np.clip(zmp, feet.min(axis=0) - HALF, feet.max(axis=0) + HALF)
        self.v[:2] += DT * (OMEGA**2 * (self.c[:2] - zmp) + push)
        self.c[:2] += DT * self.v[:2]
        self.time += DT
        return reference

    def survives(self, push: np.ndarray, start: float, duration: float = 0.1) -> bool:
        """Return whether it gets to the end with a push in between [m/s]."""
        while self.time < WHOLE.duration:
            on = start <= self.time < start + duration
            reference = self.tick(push / duration if on else np.zeros(2))
            if np.hypot(*(self.c - reference["com"])[:2]) > 0.3:
                return False
        return True


def swing(share: float) -> float:
    """Return a time in the second swing of the right foot [s]."""
    spans = [s for s in WHOLE.phases if s.phase is Phase.SINGLE_LEFT]
    return spans[1].start + share * spans[1].duration


def test_nobody_pushes():
    """No step is moved, and the pattern is that of the whole plan."""
    walker = Pendulum()
    while walker.time < WHOLE.duration:
        reference = walker.tick(np.zeros(2))
        planned = WHOLE.at(float(reference["time"]))
        np.testing.assert_allclose(reference["com"], planned.com, atol=1e-6)
    assert walker.online.moved == 0


WAYS = {"forward": (1, 0), "back": (-1, 0), "inward": (0, -1), "outward": (0, 1)}
CAUGHT = {"forward": 1.2, "back": 1.3, "inward": 0.65, "outward": 0.4}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("share", [0.1, 0.85])
def test_a_push_is_caught_by_steps(way, share):
    """Steps catch a pendulum that ankles alone cannot, and it walks on as planned."""
    push = CAUGHT[way] * np.array(WAYS[way], dtype=float)
    assert not Pendulum(None).survives(push, swing(share))
    walker = Pendulum()
    assert walker.survives(push, swing(share))
    assert walker.online.moved > 0
    feet = walker.online.fill(walker.time)["feet"]["position"]
    apart = np.abs(feet[0] - feet[1])[:2]
    np.testing.assert_allclose(apart, (0.0, 0.18), atol=1e-6)


def test_the_plan_comes_back():
    """A pushed walk ends beside where it was to end, not where the push brought it."""
    walker = Pendulum()
    assert walker.survives(np.array([0.0, -0.7]), swing(0.35))
    landed = walker.online.footsteps
    away = [
        math.hypot(step.x - planned.x, step.y - planned.y)
        for step, planned in zip(landed, PLAN.steps, strict=False)
    ]
    assert max(away) > 0.1
    assert away[-1] < 1e-6


# The closed forms.

small = st.floats(-0.1, 0.1)


@given(c=small, v=st.floats(-0.6, 0.6), u=st.floats(-0.2, 0.4), b=small,
       T=st.floats(0.05, 0.8))  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_the_foothold_against_an_integration(c, v, u, b, T):
    """The DCM is b ahead of it after double support, in which the CoM goes straight."""
    how = adaptation_record(AGILE, OMEGA, HEIGHT)[0]
    how["com"], how["rate"] = (c, 0.0), (v, 0.0)
    how["planned"], how["ahead"] = (u, 0.0), (b, 0.0)
    foothold, there, speed = adaptation._land(how, 0, T)

    def ahead(p: float) -> tuple[float, float, float]:
        """Return CoM, velocity and foothold for a constant ZMP."""
        found = solve_ivp(
            lambda _, x: (x[1], OMEGA**2 * (x[0] - p)), (0.0, T), (c, v),
            rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
        x, w = found.tolist()
        D = adaptation.TRANSFER / OMEGA
        # In double support the ZMP is the CoM: c'' = 0, and the DCM goes on by D w.
        return x, w, x + w / OMEGA + D * w - b

    at, over = ahead(0.0)[2], ahead(1.0)[2]
    p = float(np.clip((u - at) / (over - at), -HALF[0], HALF[0]))
    x, w, wanted = ahead(p)
    np.testing.assert_allclose((there, speed, foothold), (x, w, wanted), atol=1e-6)


@given(v=st.floats(-4.0, 4.0), T=st.floats(0.05, 0.6), share=st.floats(0.0, 1.0))
@settings(max_examples=100, deadline=None)
def test_a_swing_foot_is_not_rushed(v, T, share):
    """Where it can be sent, its acceleration is within bounds, and it comes to rest."""
    how = adaptation_record(AGILE, OMEGA, HEIGHT)[0]
    low, high = adaptation._way(how, v, T)
    if high - low < 1e-9:  # too fast to stop in time
        return
    path = np.zeros(4)
    adaptation._cubic(path, T, 0.0, v, low + share * (high - low))
    one = np.polynomial.Polynomial(path)
    assert one(1.0) == pytest.approx(low + share * (high - low), abs=1e-12)
    assert one.deriv()(1.0) == pytest.approx(0.0, abs=1e-12)
    assert one.deriv()(0.0) == pytest.approx(v * T, abs=1e-12)
    most = max(abs(one.deriv(2)(s)) for s in (0.0, 1.0)) / T**2
    assert most <= AGILE.rush * (1.0 + 1e-9)


@given(c=small, v=st.floats(-0.5, 0.5), since=st.floats(0.0, 0.7))
@settings(max_examples=50, deadline=None)
def test_the_plan_goes_on_from_where_the_robot_is(c, v, since):
    """The curve of the running phase passes the measured CoM, on the ZMP given."""
    online = OnlinePattern.of(WHOLE)
    online.fill(swing(0.0) + 1e-6)
    piece = online.table[:1].copy()
    assert piece["kind"][0] == SINGLE_LEFT
    start, zmp = float(piece["start"][0]), 0.02
    replan.pass_through(piece[0], since, 0, c, v, zmp, OMEGA)
    found = np.zeros(1, REFERENCE)[0]
    fill_reference(piece, OMEGA, HEIGHT, start + since, found)
    assert found["com"][0] == pytest.approx(c, abs=1e-9)
    assert found["com_velocity"][0] == pytest.approx(v, abs=1e-9)
    assert found["zmp"][0] == pytest.approx(zmp, abs=1e-9)


def test_the_swing_foot_goes_on():
    """Retargeted, it jumps neither in position nor in velocity, and lands as sent."""
    walker, push = Pendulum(), np.array([0.5, 0.0])
    start, feet, moved = swing(0.35), [], False
    while walker.time < start + 1.2:
        on = start <= walker.time < start + 0.1
        reference = walker.tick(push / 0.1 if on else np.zeros(2))
        feet.append(reference["feet"][1].copy())
        moved = moved or walker.online.moved > 0
    assert moved
    where = np.array([foot["position"] for foot in feet])
    rate = np.array([foot["velocity"] for foot in feet])
    steps = np.diff(where, axis=0) - 0.5 * DT * (rate[1:] + rate[:-1])
    assert np.abs(steps).max() < 2e-4  # of an acceleration of 60 m/s^2: 1.2e-4
    assert np.abs(np.diff(rate, axis=0)).max() < 1.2 * AGILE.rush * DT
    assert where[:, 2].min() > -1e-9
