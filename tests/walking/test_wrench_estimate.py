"""The ground's wrenches from torques: the fit, what ankles would read, and walks."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import paper, random_configuration, robot_of

from comwalk.compiled import records
from comwalk.config import WalkConfig
from comwalk.control.guard import End
from comwalk.control.law import WalkingController
from comwalk.control.settings import BodySettings, SimulatorSettings
from comwalk.embedding.dynamics import accelerate_links, load_links, move_links
from comwalk.embedding.kinematic_records import Flat
from comwalk.embedding.kinematics import place_links
from comwalk.pattern.records import REFERENCE
from comwalk.pattern.reference import Phase
from comwalk.robot.compiled_robot import bodies_of
from comwalk.robot.kinematics import Kinematics
from comwalk.robot.model import Robot
from comwalk.run import Run
from comwalk.setup import Setup, build_walk
from comwalk.sides import Side
from comwalk.walking import wrench_estimate
from comwalk.walking.measurement import _ground_force
from comwalk.walking.records import JOINT, RULES, STATE
from comwalk.walking.whole_body import WholeBody
from comwalk.walking.wrench_estimate import (
    Observer,
    _fit,
    _weigh_leg,
    fit_wrenches,
    follow_forces,
    read_ankle,
)

NAMES = ("paper", "jvrc1", "g1")
PHASES = (Phase.DOUBLE, Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
seeds = st.integers(0, 2**32 - 1)


# ---- The fit ----------------------------------------------------------------------


@given(seed=seeds)
def test_six_equations_are_solved(seed):
    """Of a symmetric matrix the lower half is read."""
    rng = np.random.default_rng(seed)
    A, b, H = rng.normal(size=(9, 6)), rng.normal(size=6), np.full((6, 7), np.nan)
    matrix = A.T @ A + 1e-3 * np.eye(6)
    below = np.tril_indices(6)
    H[:, :6][below], H[:, 6] = matrix[below], b
    _fit(H)
    expected = np.linalg.solve(matrix, b)
    error = np.abs(H[:, 6] - expected).max()
    assert error < 1e-14 * np.linalg.cond(matrix) * max(1.0, np.abs(expected).max())


@cache
def body_of(name: str) -> WholeBody:
    return WholeBody(robot_of(name), 0.002, settings=BodySettings(sensors="torque"))


class Scene:
    """A robot in any motion, whose joints feel two wrenches."""

    def __init__(self, name: str, seed: int, phase: Phase) -> None:
        rng, self.body = np.random.default_rng(seed), body_of(name)
        self.robot, arrays = self.body.robot, self.body.arrays
        self.rules, self.flat = arrays.rules[0], Flat(*arrays[:3])
        self.q = self._posture(rng)
        place_links(self.flat.links, self.q)
        self.posture = Kinematics(self.robot).posture(self.q)
        self.phase, self.reference = phase, np.zeros(1, REFERENCE)
        self.reference["phase"] = int(phase)
        self.weight = self.robot.mass * self.robot.gravity
        self.moment = self.weight * self.robot.com_height
        self.wrenches = 0.3 * rng.normal(size=(2, 6))
        self.wrenches *= [self.weight] * 3 + [self.moment] * 3
        for k, alone in enumerate((Phase.SINGLE_RIGHT, Phase.SINGLE_LEFT)):
            if phase is alone:
                self.wrenches[k] = 0.0
        n = len(self.robot.joints)
        self.v, self.a = rng.normal(size=(2, 6 + n))
        self.a *= 3.0
        self.observer = observer_of(self.robot)
        self.observer.a[:] = self.a
        self.forces = self._forces()
        self.observer.torques[:] = self.forces[6:]
        for k in range(2):
            own = self.joints(k)
            self.observer.torques[own] -= self.jacobian(k).T @ self.wrenches[k]

    def _posture(self, rng: np.random.Generator) -> np.ndarray:
        """Return any posture whose legs are not straight."""
        q, legs = random_configuration(self.robot, rng), [*self.joints(0)]
        near = 7 + np.array(legs + self.joints(1))
        q[near] = self.robot.home[near] + 0.25 * (q[near] - self.robot.home[near])
        return q

    def joints(self, k: int) -> list[int]:
        """Return the joints of leg k."""
        return list(self.robot.limbs[k].joints)

    def jacobian(self, k: int) -> np.ndarray:
        """Return MuJoCo's Jacobian of sole k for the joints of its leg, (6, 6)."""
        return self.posture.end_jacobian(k)[:, 6 + np.array(self.joints(k))]

    def swings(self, k: int) -> bool:
        """Return whether foot k is in the air."""
        return self.phase is (Phase.SINGLE_RIGHT, Phase.SINGLE_LEFT)[k]

    def _forces(self) -> np.ndarray:
        """Return the generalised forces of the motion."""
        bodies, t = bodies_of(self.robot), np.zeros(len(self.a))
        move_links(self.flat, bodies, self.v)
        accelerate_links(self.flat, bodies, self.a)
        load_links(self.flat, bodies, self.a, self.robot.gravity, t)
        return t

    def fit(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the wrenches that the kernels fit, and what ankles would read."""
        felt, wrenches, state = np.full(12, np.nan), np.zeros((2, 6)), records(STATE)
        given = self.reference[0], self.v, self.observer, felt
        fit_wrenches(self.flat, self.rules, state[0], *given)
        for k in range(2):
            limb = self.flat.limbs[k]
            _weigh_leg(self.flat, self.rules, limb, self.observer, self.swings(k))
            _fit(self.observer.H)
            wrenches[k] = self.observer.H[:, 6]
        return wrenches, felt.reshape(2, 6)

    def least_squares(self, k: int) -> np.ndarray:
        """Return the wrench on sole k that numpy finds, of stacked weighted rows."""
        w = wrench_estimate
        force, moment = w._STANCE, w._STANCE
        if self.swings(k):
            force, moment = w._SWING_FORCE, w._SWING_MOMENT
        prior = [force * self.weight] * 3 + [moment * self.moment] * 3
        scales = np.array([w._JOINT * self.moment] * 6 + prior)
        J, own = self.jacobian(k), self.joints(k)
        felt = self.forces[6:][own] - self.observer.torques[own]
        A, b = np.vstack([J.T, np.eye(6)]), np.concatenate([felt, np.zeros(6)])
        return np.linalg.lstsq(A / scales[:, None], b / scales, rcond=None)[0]


def observer_of(robot: Robot) -> Observer:
    """Return an observer that has seen nothing."""
    n = len(robot.joints)
    shapes = (n, n, n, 6 + n, 6 + n, 6 + n, (6, 7))
    return Observer(bodies_of(robot), *(np.zeros(shape) for shape in shapes))


phases = pytest.mark.parametrize("phase", PHASES, ids=lambda phase: phase.name.lower())


@phases
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15)
@given(seed=seeds)
def test_wrenches_that_joints_feel_are_found(name, phase, seed):
    """But for what the weak belief that they are small takes away."""
    scene = Scene(name, seed, phase)
    found, scale = scene.fit()[0], np.abs(scene.wrenches).max()
    assert scale > 0.05 * scene.weight
    assert np.abs(found - scene.wrenches).max() < 2e-4 * scale


@phases
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15)
@given(seed=seeds)
def test_the_fit_is_that_of_weighted_least_squares(name, phase, seed):
    """With errors of the torques, by the readable Jacobians."""
    scene, rng = Scene(name, seed, phase), np.random.default_rng(seed)
    scene.observer.torques[:] += (
        0.01 * scene.moment * rng.normal(size=len(scene.observer.torques))
    )
    found, expected = scene.fit()[0], [scene.least_squares(k) for k in range(2)]
    scale = np.abs(expected).max()
    assert np.abs(found - expected).max() < 1e-9 * scale
    assert np.abs(found - scene.wrenches).max() > 1e-3 * scale


@pytest.mark.parametrize("k", [0, 1], ids=["left", "right"])
def test_a_foot_that_swings_is_not_believed_to_press(k):
    """A moment that its joints seem to feel counts less than if it stood."""
    found = []
    for phase in ((Phase.SINGLE_RIGHT, Phase.SINGLE_LEFT)[k], Phase.DOUBLE):
        scene = Scene("paper", 3, phase)
        moment = np.zeros(6)
        moment[4] = 0.02 * scene.moment
        before = scene.fit()[0][k]
        scene.observer.torques[scene.joints(k)] -= scene.jacobian(k).T @ moment
        found.append((scene.fit()[0][k] - before)[4] / moment[4])
    assert 0.0 < 1.5 * found[0] < found[1] < 1.1


@phases
def test_ankles_would_read_what_was_fitted(phase):
    """The swinging foot is that of the phase."""
    scene = Scene("paper", 9, phase)
    wrenches, felt = scene.fit()
    assert np.array_equal(felt, read(scene, wrenches))
    assert np.abs(felt[0] - felt[1]).max() > 1.0


# ---- What ankles would read -------------------------------------------------------


def read(scene: Scene, wrenches: np.ndarray) -> np.ndarray:
    """Return what both ankle sensors would read of wrenches on the soles, (2, 6)."""
    felt, state = np.full(12, np.nan), records(STATE)
    for k in range(2):
        read_ankle(scene.flat, scene.rules, state[0], k, wrenches[k], felt)
    return felt.reshape(2, 6)


def ground(scene: Scene, felt: np.ndarray) -> np.ndarray:
    """Return F_z, M_x and M_y about the world's origin that they stand for, (2, 3)."""
    state = records(STATE)
    state["level"] = np.eye(3)
    origin = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    given = scene.flat, scene.rules, state[0]
    return np.array([_ground_force(*given, k, felt[k], origin) for k in range(2)])


def pressing(scene: Scene, seed: int, reach: float) -> np.ndarray:
    """Return wrenches on the soles, pressing by a reach of their half sizes, (2, 6)."""
    rng = np.random.default_rng(seed)
    wrenches = np.zeros((2, 6))
    for k, R in enumerate(scene.posture.end_rotations[:2]):
        load = scene.weight * rng.uniform(0.1, 1.0)
        half = scene.rules["sole_half"][k]
        x, y = reach * half * rng.uniform(0.5, 1.0, 2) * rng.choice([-1.0, 1.0], 2)
        wrenches[k, :3] = *(0.2 * load * rng.normal(size=2)), load
        wrenches[k, 3:] = R @ [y * load, -x * load, 0.05 * load * rng.normal()]
    return wrenches


def about_origin(scene: Scene, wrenches: np.ndarray) -> np.ndarray:
    """Return F_z, M_x and M_y of wrenches about the world's origin, (2, 3)."""
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    moments = moments + np.cross(scene.posture.ends[:2], forces)
    return np.column_stack([forces[:, 2], moments[:, :2]])


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20)
@given(seed=seeds)
def test_ankles_would_read_what_measures_as_the_wrench(name, seed):
    """With the weight of the feet, wherever they are."""
    scene = Scene(name, seed, Phase.DOUBLE)
    wrenches = pressing(scene, seed, 0.99)
    expected = about_origin(scene, wrenches)
    found = ground(scene, read(scene, wrenches))
    assert np.abs(found - expected).max() < 1e-12 * scene.weight


@pytest.mark.parametrize("name", NAMES)
def test_an_ankle_would_read_all_six_of_the_wrench(name):
    """In its own axes, about its own place, without the weight of the foot."""
    scene = Scene(name, 5, Phase.DOUBLE)
    wrenches = pressing(scene, 5, 0.9)
    felt, robot = read(scene, wrenches), scene.robot
    kinematics, g = Kinematics(robot), robot.gravity
    kinematics.update(scene.q)
    for k, side in enumerate(Side):
        foot = robot.feet[side]
        (p,), (R,) = kinematics.sites(np.array([foot.sensor_site]))
        force, moment = wrenches[k, :3], wrenches[k, 3:]
        weight = np.array([0.0, 0.0, -foot.mass * g])
        total = moment + np.cross(scene.posture.ends[k] - p, force)
        total += np.cross(R @ foot.com, weight)
        expected = np.concatenate([R.T @ (force + weight), R.T @ total])
        assert felt[k] == pytest.approx(expected, abs=1e-9 * scene.weight)


@settings(max_examples=20)
@given(seed=seeds)
def test_the_pressure_is_kept_within_the_sole(seed):
    """Beyond an edge it is put there; what is inside the other way stays."""
    scene = Scene("paper", seed, Phase.DOUBLE)
    wrenches = pressing(scene, seed, 3.0)
    clipped = wrenches.copy()
    for k, R in enumerate(scene.posture.end_rotations[:2]):
        half, load = scene.rules["sole_half"][k], wrenches[k, 2]
        n = R.T @ wrenches[k, 3:]
        n[0] = np.clip(n[0], -half[1] * load, half[1] * load)
        n[1] = np.clip(n[1], -half[0] * load, half[0] * load)
        clipped[k, 3:] = R @ n
    assert np.abs(clipped - wrenches).max() > 1e-3 * scene.weight
    found = ground(scene, read(scene, wrenches))
    expected = about_origin(scene, clipped)
    assert np.abs(found - expected).max() < 1e-12 * scene.weight


def test_the_ground_does_not_pull():
    """Where it seems to, there is no load, and no moment that tips the sole."""
    scene = Scene("paper", 8, Phase.DOUBLE)
    wrenches = np.zeros((2, 6))
    for k, R in enumerate(scene.posture.end_rotations[:2]):
        wrenches[k, 2], wrenches[k, 3:] = -100.0, R @ [5.0, -3.0, 0.0]
    found = ground(scene, read(scene, wrenches))
    assert np.abs(found).max() < 1e-9 * scene.weight


# ---- The filters ------------------------------------------------------------------


def filtered(
    steps: int, rates: np.ndarray, torques: np.ndarray, jump: int = -1, **joint: float
) -> tuple[Observer, np.ndarray]:
    """Return an observer after steps at constant acceleration, and its largest rate.

    Args:
        steps: How many readings.
        rates: Acceleration, (6 + joints,).
        torques: What the motors report.
        jump: Reading at which the base's velocity jumps, told by the other sole.
        joint: Known friction.
    """
    n = len(torques)
    observer, rules, state = observer_of(paper()), records(RULES), records(STATE)
    rules["period"], rules["observer_share"], rules["rate_share"] = 0.002, 0.5, 0.4
    joints, most = records(JOINT, n), np.zeros(6 + n)
    for name, value in joint.items():
        joints[name] = value
    v = np.zeros(6 + n)
    for k in range(steps):
        state["readings"] = k + 1
        observer.motors[:] = torques
        v += rules["period"][0] * rates
        if k == jump:
            v[:3] += 0.5
        follow_forces(rules[0], state[0], joints, v, observer, k == jump)
        most = np.maximum(most, np.abs(observer.a))
    return observer, most


def test_filters_end_where_nothing_changes_any_more():
    """Torques and rates pass them whole."""
    rng = np.random.default_rng(2)
    rates, torques = rng.normal(size=36), 50.0 * rng.normal(size=30)
    observer, _ = filtered(200, rates, torques)
    assert observer.torques == pytest.approx(torques, rel=1e-12)
    assert observer.slow == pytest.approx(torques, rel=1e-12)
    assert observer.a == pytest.approx(rates, rel=1e-9)


def test_a_step_to_the_other_foot_is_no_acceleration():
    """What the base's velocity is told by changes; the rates of joints go on."""
    rng = np.random.default_rng(3)
    rates, torques = rng.normal(size=36), np.zeros(30)
    plain, most = filtered(60, rates, torques)
    stepped, worst = filtered(60, rates, torques, jump=30)
    assert np.abs(worst[:3]).max() <= np.abs(most[:3]).max() + 1e-9
    assert np.array_equal(stepped.a[3:], plain.a[3:])
    assert stepped.a[:3] == pytest.approx(plain.a[:3], rel=1e-3)


def test_friction_that_is_known_is_taken_from_the_torques():
    """Dry friction against the rate, and viscous friction with it."""
    rates, torques = np.zeros(36), np.full(30, 10.0)
    rates[6:] = 1e3  # so fast that the last rate is the first but for the steps
    observer, _ = filtered(1, rates, torques, dry=2.0, viscous=0.5)
    assert observer.torques == pytest.approx(10.0 - 2.0 - 0.5 * 2.0, abs=1e-9)
    backwards, _ = filtered(1, -rates, torques, dry=2.0, viscous=0.5)
    assert backwards.torques == pytest.approx(10.0 + 2.0 + 0.5 * 2.0, abs=1e-9)


# ---- Walks ------------------------------------------------------------------------


@cache
def setup(
    actuation: str, sensors: str, friction: float = 0.0, known: float = 0.0
) -> Setup:
    """Return a short walk of the paper's robot with perfect sensors, as planned."""
    config = WalkConfig(
        robot="paper",
        steps=4,
        actuation=actuation,
        sensors=sensors,
        body=BodySettings(known_friction=known),
        simulator=SimulatorSettings(joint_friction=friction),
        adapt=False,
    )
    return build_walk(config)


@cache
def walked(
    actuation: str, sensors: str, friction: float = 0.0, known: float = 0.0
) -> Run:
    run = setup(actuation, sensors, friction, known).run()
    assert run.outcome.end is End.COMPLETED
    return run


def zmp_error(run: Run) -> np.ndarray:
    """Return the rms of the measured ZMP's error, x and y [m]."""
    error = run.log["zmp"] - run.log["zmp_true"]
    return np.sqrt(np.nanmean(error**2, axis=0))


@pytest.mark.parametrize("actuation", ["position", "pd", "torque"])
def test_the_zmp_is_known_by_torques(actuation):
    """Within 8 mm, jumps at landings included, and 1.5 mm nearly always."""
    run = walked(actuation, "torque")
    error = np.abs(run.log["zmp"] - run.log["zmp_true"])
    assert np.hypot(*zmp_error(run)) < 0.008
    assert np.nanmedian(error, axis=0).max() < 0.0015
    # That of the plan is no estimate as good.
    plan = np.abs(run.log["zmp_ref"] - run.log["zmp_true"])
    assert (np.nanmedian(error, axis=0) < 0.7 * np.nanmedian(plan, axis=0)).all()
    load = run.log["load"] - run.log["loads_true"].sum(axis=1)
    weight = paper().mass * 9.81
    assert np.sqrt(np.mean(load**2)) < 0.03 * weight


@pytest.mark.parametrize("actuation", ["position", "pd"])
def test_friction_that_is_known_does_not_disturb_it(actuation):
    """Three newton metres at every joint."""
    known, unknown = (zmp_error(walked(actuation, "torque", 3.0, x)) for x in (3.0, 0))
    assert (known < 0.7 * unknown).all()


@pytest.mark.parametrize("actuation", ["position", "pd"])
def test_without_sensors_the_law_has_no_zmp(actuation):
    """None is logged, and u is that of k_p = 0."""
    walk, run = setup(actuation, "none"), walked(actuation, "none")
    log, period = run.log, walk.control.period
    assert np.isnan(log["zmp"]).all()
    laws = []
    for k_p in (0.0, 1.0):
        own = walk.control.gains
        assert own.zmp == (0.0, 0.0)
        gains = dataclasses.replace(
            own,
            zmp=(k_p, k_p),
            standing_zmp=(0.5 * k_p, 0.5 * k_p),
            standing_com=own.standing[1],
        )
        law = WalkingController(gains, walk.control.settings, period)
        law.law["integrates"] = actuation == "position"
        law.reset(log["com_ref"][0], log["zmp_ref"][0])
        laws.append(law)
    u = np.zeros((2, len(log), 2))
    for k in range(len(log)):
        reference = walk.pattern.at(k * period)
        for i, law in enumerate(laws):
            zmp = log["zmp_true"][k] if i else np.array([9.0, -9.0])
            u[i, k] = law.step(reference, log["com"][k], zmp).u
    assert np.abs(u[0] - log["u"]).max() < 1e-12
    assert np.abs(u[1] - log["u"]).max() > 1e-3
