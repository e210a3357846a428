"""Soles on uneven ground: how they lie, where they stand, how they meet the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import jvrc, paper, random_configuration
from scipy.spatial.transform import Rotation

from comwalk.certificates.defaults import default_control, walk_pattern
from comwalk.control.law import LAW_STATE
from comwalk.control.plant import Sensors
from comwalk.control.settings import BodySettings, SimulatorSettings
from comwalk.embedding.kinematic_records import LINK, SITE, Flat
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.records import REFERENCE
from comwalk.pattern.reference import Phase, Reference, record_of
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.kinematics import Kinematics
from comwalk.run import simulate
from comwalk.sides import Side
from comwalk.walking import foot_contact as kernels
from comwalk.walking.records import STATE, rules_of
from comwalk.walking.whole_body import WholeBody

PERIOD = 0.002
CALM, FLAT = np.zeros(2), np.zeros((2, 2))
TILTED = np.array([0.1, 0.0, 0.0])  # a rotation vector [rad]
CURVE = make_pattern(plan_steps(Gait(half_step=0.08, turn=0.2), 4), Pendulum())


FOOT_INDEX = {side: k for k, side in enumerate(Side)}


def record(reference: Reference) -> np.void:
    """Return a reference as kernels see it."""
    records = np.zeros(1, REFERENCE)
    record_of(reference, records[0])
    return records[0]


def tilt_matrix(up) -> np.ndarray:
    """Return the smallest rotation that takes a direction to the vertical, (3, 3)."""
    out = np.zeros((3, 3))
    kernels.untilt(np.eye(3), float(up[0]), float(up[1]), out)
    return out.T


def planned_share(reference: Reference) -> float:
    """Return the share of the weight that the plan puts on the left foot [-]."""
    return kernels.planned_share(record(reference))


class Footing:
    """The kernels of `foot_contact` on the records of one robot."""

    def __init__(self, settings: BodySettings, period: float) -> None:
        self.rules = rules_of(paper(), period, settings)[0]
        self.state, self.law = np.zeros(1, STATE)[0], np.zeros(1, LAW_STATE)[0]
        self.leans = self.state["leans"]

    @property
    def heights(self) -> dict[Side, float]:
        return dict(zip(Side, self.state["heights"].tolist(), strict=True))

    def feel(self, soles, imu, orientation) -> None:
        links, sites = np.zeros(1, LINK), np.zeros(5, SITE)
        links["R"], sites["turn"] = imu, np.eye(3)
        self.state["soles"] = soles
        flat = Flat(links, np.zeros(0, LINK), sites)
        kernels.feel_tilt(flat, self.rules, self.state, np.array(orientation))

    def level(self, soles, side: Side) -> np.ndarray:
        self.state["soles"], out = soles, np.zeros((3, 3))
        kernels.level_frame(self.rules, self.state, FOOT_INDEX[side], out)
        return out

    def foothold(self, side: Side, reference: Reference) -> tuple:
        return kernels.foothold(self.state, record(reference), FOOT_INDEX[side])

    def change_support(self, old: Side, reference, seen, turn: float) -> None:
        links, sites = np.zeros(1, LINK), np.zeros(5, SITE)
        links["R"] = np.eye(3)
        k, new = FOOT_INDEX[old], FOOT_INDEX[old.other]
        sites["point"][new] = seen
        self.state["support"], self.state["soles"][k] = k, np.eye(3)
        self.state["soles"][new] = Rotation.from_euler("z", turn).as_matrix()
        flat = Flat(links, np.zeros(0, LINK), sites)
        kernels.change_support(flat, self.rules, self.state, record(reference), new)

    def follow(self, reference, left_share, edges, com_error) -> None:
        self.state["left_share"], self.state["edges"] = left_share, edges
        self.law["e_c"] = com_error
        kernels.follow_ground(self.rules, self.state, self.law, record(reference))


def footing(**options) -> Footing:
    return Footing(BodySettings(**options), PERIOD)


def when(phase: Phase, share: float = 0.5, which: int = 1) -> Reference:
    """Return the reference within a phase of the plan, the which-th of its kind."""
    span = [x for x in CURVE.phases if x.phase is phase][which]
    return CURVE.at(span.start + share * span.duration)


def up_of(rotations: np.ndarray) -> np.ndarray:
    """Return what is up in frames whose rotations to the world are given."""
    return rotations[..., 2, :]


# ---- How a sole lies ----------------------------------------------------------------


angles = st.floats(-math.pi, math.pi)
tilts = st.floats(0.0, 0.5 * math.pi)


@given(tilts, angles)
def test_tilt_matrix_is_the_smallest_rotation_to_the_vertical(tilt, way):
    """A rotation by the angle to the vertical, about a level axis."""
    x, y = math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way)
    R = tilt_matrix((x, y))
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-7
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-7)
    assert np.abs(R @ [x, y, math.cos(tilt)] - [0.0, 0.0, 1.0]).max() < 1e-7
    turn = Rotation.from_matrix(R).as_rotvec()
    assert abs(turn[2]) < 1e-7
    assert np.hypot(*turn[:2]) == pytest.approx(tilt, abs=1e-6)


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_opposite_tilts_undo_each_other(x, y):
    assert np.abs(tilt_matrix((x, y)) @ tilt_matrix((-x, -y)) - np.eye(3)).max() < 1e-12


def test_tilts_at_the_edges():
    assert np.array_equal(tilt_matrix((0.0, 0.0)), np.eye(3))
    lying = tilt_matrix((1.0, 0.0))
    assert np.abs(lying @ [1.0, 0.0, 0.0] - [0.0, 0.0, 1.0]).max() < 1e-12
    assert np.isfinite(tilt_matrix((1.0, 1e-9))).all()  # a rounding too long


@cache
def workspace() -> Kinematics:
    return Kinematics(paper())


def felt(rng: np.random.Generator, tilt: np.ndarray, yaw: float = 0.0):
    """Return encoders' frames and IMU of a robot whose left sole is tilted.

    Args:
        rng: Makes the joint angles.
        tilt: Rotation vector of the left sole in the world [rad].
        yaw: Drift of the IMU's heading [rad].

    Returns:
        What the encoders say, as a configuration with the base at rest; rotations of
        both soles and of the IMU in it; what the IMU reads; the true rotations of the
        soles in the world.
    """
    robot, kinematics = paper(), workspace()
    q = random_configuration(robot, rng)
    q[:7] = [0, 0, 0, 1, 0, 0, 0]
    sites = np.array([*(robot.feet[s].site for s in Side), robot.imu_site])
    kinematics.update(q)
    rotations = kinematics.sites(sites)[1].copy()
    base = Rotation.from_rotvec(tilt).as_matrix() @ rotations[0].T
    drift = Rotation.from_euler("z", yaw).as_matrix()
    seen = Rotation.from_matrix(drift @ base @ rotations[2])
    true = base @ rotations[:2]
    return q, rotations, seen.as_quat()[[3, 0, 1, 2]], true


@pytest.mark.parametrize("seed", range(8))
def test_the_imu_tells_how_both_soles_lie(seed):
    """MuJoCo's kinematics of a robot on a tilted sole; the IMU's heading may drift."""
    rng = np.random.default_rng(seed)
    tilt = np.append(rng.uniform(-0.2, 0.2, 2), rng.uniform(-3.0, 3.0))
    _, rotations, orientation, true = felt(rng, tilt, yaw=rng.uniform(-3.0, 3.0))
    ours = footing(landing=0.0, rolling=0.0)
    reference = when(Phase.DOUBLE)
    for _ in range(2000):
        ours.feel(rotations[:2], rotations[2], orientation)
        ours.follow(reference, planned_share(reference), FLAT, CALM)
    vertical = rotations[0] @ up_of(true[0])  # in the encoders' axes
    for side in Side:
        level = ours.level(rotations[:2], side)
        assert np.abs(level[:, 2] - vertical).max() < 1e-9
        assert np.abs(level @ level.T - np.eye(3)).max() < 1e-9
        # The sole's own frame is one level rotation away.
        sole = level.T @ rotations[FOOT_INDEX[side]]
        assert Rotation.from_matrix(sole).as_rotvec()[2] == pytest.approx(0, abs=1e-9)
    assert np.abs(ours.leans - up_of(true)[:, :2]).max() < 1e-6


def test_what_the_imu_says_is_filtered():
    """After the filter's time constant, 63 % of the tilt is believed."""
    _, rotations, orientation, true = felt(np.random.default_rng(0), TILTED)
    ours = footing(imu_cutoff=2.0)
    for _ in range(round(1.0 / (2.0 * math.pi * 2.0) / PERIOD)):
        ours.feel(rotations[:2], rotations[2], orientation)
    x, y, _ = up_of(true[0])
    share = 1.0 - math.exp(-1.0)
    level = ours.level(rotations[:2], Side.LEFT)
    seen = rotations[0] @ tilt_matrix((share * x, share * y)).T
    assert np.abs(level - seen).max() < 2e-3


def test_without_imu_soles_are_level():
    _, rotations, orientation, _ = felt(np.random.default_rng(1), TILTED)
    ours, reference = footing(imu=False), when(Phase.DOUBLE)
    for _ in range(100):
        ours.feel(rotations[:2], rotations[2], orientation)
        ours.follow(reference, planned_share(reference), np.ones((2, 2)), CALM)
    assert np.array_equal(ours.level(rotations[:2], Side.LEFT), rotations[0])
    assert not ours.leans.any()


def sensed(q: np.ndarray, orientation: np.ndarray) -> Sensors:
    """Return what a robot senses whose weight is on both feet alike."""
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = 0.5 * paper().mass * paper().gravity
    still = np.zeros(len(q) - 7)
    return Sensors(0.0, q[7:], still, wrenches, orientation, np.zeros(3), np.zeros(3))


def body_of(**options) -> WholeBody:
    body = WholeBody(paper(), PERIOD, settings=BodySettings(**options))
    body.start(CURVE.at(0.0))
    return body


@pytest.mark.parametrize("tilt", [(0.0, 0.04), (0.04, 0.0), (-0.03, 0.02)])
def test_a_tilted_sole_is_no_body_out_of_place(tilt):
    """The CoM over a sole that lies 2 deg off: 25 mm, which the encoders do not see."""
    reference = CURVE.at(0.0)
    x, y, yaw = Footing(BodySettings(), PERIOD).foothold(reference.support, reference)
    body = body_of(calibration=False)
    q = body.configuration.copy()
    robot, kinematics = paper(), workspace()
    kinematics.update(q)
    sites = np.array([robot.feet[reference.support].site, robot.imu_site])
    (sole, _), (R_sole, R_imu) = kinematics.sites(sites)
    com = kinematics.com.copy()
    assert np.abs(R_sole - np.eye(3)).max() < 1e-6
    assert yaw == 0.0
    turn = Rotation.from_rotvec([*tilt, 0.0])
    true = np.array([x, y, 0.0]) + turn.apply(com - sole)
    seen = (turn * Rotation.from_matrix(R_imu)).as_quat()[[3, 0, 1, 2]]
    for _ in range(1000):
        measured = body.measure(sensed(q, seen), reference)
    assert np.abs(measured.com - true).max() < 2e-4
    blind = body_of(calibration=False, imu=False)
    away = blind.measure(sensed(q, seen), reference).com - true
    assert np.hypot(*away[:2]) > 0.02


# ---- Where a sole stands ------------------------------------------------------------


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_dead_reckoning_composes_what_the_encoders_say(seed):
    """Feet that came down anywhere, against composed rotations of the plane."""
    rng, ours = np.random.default_rng(seed), footing()
    doubles = [x for x in CURVE.phases if x.phase is Phase.DOUBLE][1:-1]
    reference = CURVE.at(doubles[0].start)
    place = np.array(ours.foothold(reference.support, reference))
    for span in doubles:
        reference = CURVE.at(span.start + 0.5 * span.duration + 1e-6)
        old = reference.support.other
        *step, turn = rng.uniform(-0.2, 0.2, 3)
        ours.change_support(old, reference, [*step, 0.0], turn)
        level = Rotation.from_euler("z", place[2])
        place[:2] += level.apply([*step, 0.0])[:2]
        place[2] += turn
        there = np.array(ours.foothold(reference.support, reference))
        assert np.abs(there[:2] - place[:2]).max() < 1e-12
        assert abs(math.remainder(there[2] - place[2], math.tau)) < 1e-12


def test_the_planned_share_is_where_the_zmp_is_between_the_feet():
    """Moments about the line between the soles' centres balance."""
    for span in CURVE.phases:
        for t in np.linspace(span.start, span.start + span.duration, 7)[1:-1]:
            reference = CURVE.at(t)
            share = planned_share(reference)
            left, right = (reference.foot(s).position[:2] for s in Side)
            if span.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT):
                assert share == (span.phase is Phase.SINGLE_LEFT)
                continue
            centre = share * left + (1.0 - share) * right
            assert abs((reference.zmp - centre) @ (left - right)) < 1e-9


def test_a_swinging_foot_returns_to_its_path():
    """Where it stood is forgotten within tenths of a second; the stance foot's not."""
    ours, reference = footing(), when(Phase.SINGLE_LEFT)
    for side in Side:
        ours.change_support(side.other, reference, [0.3, 0.1, 0.0], 0.2)
    stood = ours.foothold(Side.LEFT, reference)
    planned = reference.foot(Side.RIGHT).position[:2]
    before = np.subtract(ours.foothold(Side.RIGHT, reference)[:2], planned)
    for _ in range(100):
        ours.follow(reference, planned_share(reference), FLAT, CALM)
    after = np.subtract(ours.foothold(Side.RIGHT, reference)[:2], planned)
    assert after == pytest.approx(before * math.exp(-2.0), rel=0.05)
    assert ours.foothold(Side.LEFT, reference) == stood


@pytest.mark.parametrize("seed", range(5))
def test_the_com_does_not_jump_when_the_support_changes(seed):
    """Feet that stand beside their places and tilted: the same CoM over either."""
    rng = np.random.default_rng(seed)
    q, _, seen, _ = felt(rng, np.array([*rng.uniform(-0.05, 0.05, 2), 0.0]))
    span = [x for x in CURVE.phases if x.phase is Phase.DOUBLE][1]
    half = span.start + 0.5 * span.duration
    before, after = CURVE.at(half - 1e-6), CURVE.at(half + 1e-6)
    assert before.support is after.support.other
    body = body_of(calibration=False)
    body.start(before)
    for _ in range(2000):
        old = body.measure(sensed(q, seen), before)
    new = body.measure(sensed(q, seen), after)
    assert np.abs(new.com - old.com)[:2].max() < 1e-4  # the plan itself moves on


# ---- How a foot lands ---------------------------------------------------------------


def test_a_foot_that_bears_too_early_yields():
    """It met the ground early: up, and no farther than the reach."""
    ours, reference = footing(), when(Phase.SINGLE_LEFT, 0.9)
    assert reference.right.velocity[2] < 0.0
    for _ in range(20):
        ours.follow(reference, 0.4, FLAT, CALM)
    assert ours.heights[Side.RIGHT] > 3e-4
    assert ours.heights[Side.LEFT] == 0.0
    for _ in range(2000):
        ours.follow(reference, 0.0, FLAT, CALM)
    assert ours.heights[Side.RIGHT] <= 0.05


def test_a_foot_that_rises_does_not_yield():
    ours, reference = footing(), when(Phase.SINGLE_LEFT, 0.1)
    assert reference.right.velocity[2] > 0.0
    for _ in range(20):
        ours.follow(reference, 0.4, FLAT, CALM)
    assert ours.heights[Side.RIGHT] == 0.0


@pytest.mark.parametrize("side", Side)
def test_a_foot_that_bears_too_little_reaches_down(side):
    """The ground comes late: down with this one, up with the other."""
    ours, reference = footing(), when(Phase.DOUBLE)
    share = 1.0 if side is Side.RIGHT else 0.0
    for _ in range(20):
        ours.follow(reference, share, FLAT, CALM)
    assert ours.heights[side] < -3e-4
    assert ours.heights[side.other] > 3e-4


@pytest.mark.parametrize("phase", [Phase.DOUBLE, Phase.SINGLE_LEFT])
def test_small_surprises_move_no_foot(phase):
    ours, reference = footing(), when(phase, 0.9)
    for share in (-0.2, 0.2):
        ours.follow(reference, planned_share(reference) + share, FLAT, CALM)
        assert set(ours.heights.values()) == {0.0}


def test_a_foot_may_land_as_planned():
    ours, reference = footing(landing=0.0), when(Phase.DOUBLE)
    ours.follow(reference, 0.0, FLAT, CALM)
    assert set(ours.heights.values()) == {0.0}


# ---- A sole on its edge -------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("side", Side)
def test_a_sole_on_its_edge_turns_away_from_it(side, sign, axis):
    """Pressed at the toe, the toe goes up: up leans to the toe in the sole's frame."""
    ours, reference = footing(), when(Phase.DOUBLE)
    edges = FLAT.copy()
    edges[FOOT_INDEX[side], axis] = sign
    for _ in range(10):
        ours.follow(reference, planned_share(reference), edges, CALM)
    lean = ours.leans[FOOT_INDEX[side]]
    assert sign * lean[axis] > 1e-3
    assert lean[1 - axis] == 0.0
    assert not ours.leans[FOOT_INDEX[side.other]].any()
    forward = tilt_matrix(lean.tolist()) @ np.eye(3)[axis]
    assert sign * forward[2] > 1e-3  # that edge of the sole is above its centre


def test_a_flat_sole_stays():
    ours, reference = footing(), when(Phase.DOUBLE)
    ours.follow(reference, planned_share(reference), np.full((2, 2), 0.6), CALM)
    assert not ours.leans.any()


def test_a_swinging_sole_is_level():
    ours = footing()
    edges = np.array([[1.0, 0.0], [1.0, 0.0]])
    for _ in range(20):
        ours.follow(when(Phase.DOUBLE), 0.5, edges, CALM)
    leaning = ours.leans.copy()
    assert (leaning[:, 0] > 1e-3).all()
    for _ in range(100):
        ours.follow(when(Phase.SINGLE_LEFT), 1.0, FLAT, CALM)
    right = ours.leans[FOOT_INDEX[Side.RIGHT]]
    assert right == pytest.approx(leaning[1] * math.exp(-2.0), rel=0.05)


def test_in_recovery_soles_stay_as_they_are():
    """An ankle that yields could not hold a body that was pushed."""
    _, rotations, orientation, _ = felt(np.random.default_rng(2), TILTED)
    ours, calm, reference = footing(), footing(), when(Phase.DOUBLE)
    edges, pushed = np.ones((2, 2)), np.array([0.02, 0.0])
    ours.follow(reference, planned_share(reference), FLAT, pushed)
    for _ in range(50):
        for x, error in ((ours, pushed), (calm, CALM)):
            x.feel(rotations[:2], rotations[2], orientation)
            x.follow(reference, planned_share(reference), edges, error)
    assert not ours.leans.any()
    assert np.abs(calm.leans).min() > 1e-3
    # The IMU itself is believed far more slowly: a tilt may be the push's.
    start, slow, quick = (
        x.level(rotations[:2], Side.LEFT) for x in (footing(), ours, calm)
    )
    assert 0.0 < np.abs(slow - start).max() < 0.5 * np.abs(quick - start).max()


def test_rough_floor_needs_soles_that_lie_down():
    """On boxes of 10 mm: flat soles, soles on their edges, and a fall without IMU."""
    robot = jvrc()
    pattern, control = walk_pattern(robot, 8), default_control(robot)

    def run(**options):
        return simulate(
            robot,
            pattern,
            control=replace(control, body=BodySettings(**options)),
            physics=SimulatorSettings(terrain=0.01, terrain_seed=3),
        )

    usual, edged, blind = run(), run(rolling=0.0), run(imu=False)
    assert usual.outcome.ok
    figures, worse = usual.summary(), edged.summary()
    assert figures["sole_margin_p5_mm"] > 5.0 > 0.0 > worse["sole_margin_p5_mm"]
    errors, larger = (x["com_error_rms_mm"]["true"]["y"] for x in (figures, worse))
    assert 1.5 * errors < larger
    assert not blind.outcome.ok
