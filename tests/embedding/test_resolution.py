"""The kinematic resolution, Eqs. (14)-(27), on two robots and several oracles."""

from __future__ import annotations

import numpy as np
import pytest
from readable import rotation_log
from robots import jvrc, paper, posture_of, random_configuration, random_task

from comwalk.embedding.elimination import (
    damped_inverse,
    embed,
    resolve_by_elimination,
    sigma_min,
)
from comwalk.embedding.rotations import rotation_yaw, shift, skew
from comwalk.embedding.solver import RateLimits, Resolver
from comwalk.embedding.task import (
    CartesianMotion,
    Damping,
    JointMotion,
    Limb,
    Task,
    check_limbs,
)
from comwalk.errors import ModelError, ParameterError
from comwalk.robot.kinematics import Kinematics

ROBOTS = {"paper": paper, "jvrc1": jvrc}
CARTESIAN = {
    "joint-space arms": (),
    "7-joint hands": ("left_arm", "right_arm"),
    "torso and hands": ("torso", "left_arm", "right_arm"),
}

# The wrists of JVRC-1 are near singular in half of all postures: damp them late.
SHARP = Damping(threshold=1e-3)


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]()


def index_of(robot, name):
    return [limb.name for limb in robot.limbs].index(name)


@pytest.mark.parametrize("cartesian", CARTESIAN.values(), ids=CARTESIAN)
def test_elimination_meets_every_task(robot, cartesian):
    """Eqs. (19), (22), (25): CoM, base foot, trunk, and each limb as it was given."""
    rng = np.random.default_rng(1)
    rows = {"torso": (3, 5)} if robot.name == "paper" else {"torso": (3, 4, 5)}
    for _ in range(10):
        posture = posture_of(robot, random_configuration(robot, rng))
        task = random_task(
            robot, rng, cartesian=cartesian, base_twist=rng.normal(size=6), rows=rows
        )
        result = resolve_by_elimination(robot.limbs, posture, task, SHARP)
        assert result.loss() < 1e-9


@pytest.mark.parametrize("cartesian", CARTESIAN.values(), ids=CARTESIAN)
@pytest.mark.parametrize("base", ["left_leg", "right_leg"])
def test_stacked_solve_equals_elimination(robot, cartesian, base):
    """Eqs. (26), (27): the fast stacked system is the paper's elimination."""
    rng = np.random.default_rng(2)
    resolver = Resolver(robot.limbs)
    for _ in range(25):
        posture = posture_of(robot, random_configuration(robot, rng))
        task = random_task(
            robot, rng, base=base, cartesian=cartesian, base_twist=rng.normal(size=6)
        )
        slow = resolve_by_elimination(robot.limbs, posture, task)
        fast = resolver.resolve(posture, task)
        assert np.abs(slow.velocity - fast.velocity).max() < 1e-9


def test_embedding_is_the_printed_formula(robot):
    """Eqs. (20), (26), (27), with six-joint limbs, term by term in world axes."""
    rng = np.random.default_rng(3)
    posture = posture_of(robot, random_configuration(robot, rng))
    task = random_task(robot, rng, base_twist=rng.normal(size=6))
    embedding = embed(robot.limbs, posture, task)
    one, two = index_of(robot, "left_leg"), index_of(robot, "right_leg")
    J = [posture.end_jacobian(i)[:, robot.limbs[i].columns] for i in (one, two)]
    J_c = [posture.com_jacobian[:, robot.limbs[i].columns] for i in (one, two)]
    X = [shift(posture.ends[i] - posture.position) for i in (one, two)]
    X_21 = np.linalg.inv(X[1]) @ X[0]
    assert np.allclose(X_21, shift(posture.ends[one] - posture.ends[two]), atol=1e-14)
    r_c1 = posture.com - posture.ends[one]
    J_emc = (
        -J[0][:3] + skew(r_c1) @ J[0][3:] + J_c[0]
        + J_c[1] @ np.linalg.inv(J[1]) @ X_21 @ J[0]
    )  # fmt: skip
    assert np.allclose(embedding.J_emc, J_emc, atol=1e-12)
    x_1, x_2 = task.base_twist, task.motions["right_leg"].twist
    cdot = task.com_velocity - J_c[1] @ np.linalg.inv(J[1]) @ (x_2 - X_21 @ x_1)
    for i, limb in enumerate(robot.limbs):
        if isinstance(task.motions.get(limb.name), JointMotion):
            cdot = cdot - (
                posture.com_jacobian[:, robot.limbs[i].columns]
                @ task.motions[limb.name].rates
            )
    cdot = cdot - x_1[:3] - np.cross(x_1[3:], r_c1)  # the moving base of Eq. (23)
    assert np.allclose(embedding.cdot_emc, cdot, atol=1e-12)


def test_printed_frame_of_27_is_wrong():
    """Eq. (27) inside R_o[...] needs r_c1 in body axes: with world axes it is off."""
    robot, rng = paper(), np.random.default_rng(4)
    posture = posture_of(robot, random_configuration(robot, rng))
    R_o, r_c1 = posture.rotation, posture.com - posture.ends[0]
    o_J_w = R_o.T @ posture.end_jacobian(0)[3:, robot.limbs[0].columns]
    right = skew(r_c1) @ R_o @ o_J_w
    assert np.allclose(R_o @ skew(R_o.T @ r_c1) @ o_J_w, right, atol=1e-12)
    assert np.abs(R_o @ skew(r_c1) @ o_J_w - right).max() > 0.1


@pytest.mark.parametrize("cartesian", CARTESIAN.values(), ids=CARTESIAN)
def test_rates_move_the_robot_as_asked(robot, cartesian):
    """Eqs. (15), (21), (25): finite differences along the resolved velocity."""
    rng, h = np.random.default_rng(5), 1e-6
    kinematics, resolver = Kinematics(robot), Resolver(robot.limbs, SHARP)
    for _ in range(10):
        q = random_configuration(robot, rng)
        task = random_task(robot, rng, cartesian=cartesian)
        v = resolver.resolve(kinematics.posture(q), task).velocity
        ahead = kinematics.posture(kinematics.integrate(q, v, h))
        behind = kinematics.posture(kinematics.integrate(q, v, -h))
        com = (ahead.com - behind.com) / (2 * h)
        assert np.abs(com - task.com_velocity).max() < 1e-6
        turn = rotation_log(ahead.rotation @ behind.rotation.T) / (2 * h)
        assert np.abs(turn - task.trunk_rate).max() < 1e-6
        for i, limb in enumerate(robot.limbs):
            base = limb.name == task.base
            motion = None if base else task.motions[limb.name]
            if not base and isinstance(motion, JointMotion):
                continue
            twist = task.base_twist if base else motion.twist
            moved = (ahead.ends[i] - behind.ends[i]) / (2 * h)
            turned = rotation_log(ahead.end_rotations[i] @ behind.end_rotations[i].T)
            if not (limb.name == "torso" and len(limb.joints) < 6):
                assert np.abs(moved - twist[:3]).max() < 1e-6
                assert np.abs(turned / (2 * h) - twist[3:]).max() < 1e-6


@pytest.mark.parametrize("cartesian", CARTESIAN.values(), ids=CARTESIAN)
def test_support_side_swaps_without_a_jump(robot, cartesian):
    """Eq. (18): either leg as base gives the same rates, both feet standing."""
    rng, resolver = np.random.default_rng(6), Resolver(robot.limbs)
    for _ in range(20):
        posture = posture_of(robot, random_configuration(robot, rng))
        left = random_task(robot, rng, cartesian=cartesian)
        still = CartesianMotion(np.zeros(6))
        others = {n: m for n, m in left.motions.items() if "leg" not in n}
        tasks = [
            Task(left.com_velocity, base, np.zeros(6), left.trunk_rate,
                 {**others, swing: still})
            for base, swing in (("left_leg", "right_leg"), ("right_leg", "left_leg"))
        ]  # fmt: skip
        one, two = (resolver.resolve(posture, task).velocity for task in tasks)
        assert np.abs(one - two).max() < 1e-9


def test_clik_removes_drift():
    """Feedback on every Cartesian row: an error decays by (1 - K dt) each step."""
    robot, resolver = paper(), Resolver(paper().limbs)
    kinematics, K, dt = Kinematics(paper()), 20.0, 0.005
    q = robot.home.copy()
    goal = kinematics.posture(q)
    q[7:19] += 0.02 * np.random.default_rng(7).normal(size=12)
    misses = []
    for _ in range(100):
        posture = kinematics.posture(q)
        twists = [
            K * np.concatenate([
                goal.ends[i] - posture.ends[i],
                rotation_log(goal.end_rotations[i] @ posture.end_rotations[i].T),
            ])
            for i in (0, 1)
        ]  # fmt: skip
        still = {
            limb.name: JointMotion(np.zeros(len(limb.joints)))
            for limb in robot.limbs[2:]
        }
        task = Task(
            K * (goal.com - posture.com),
            "left_leg",
            twists[0],
            K * rotation_log(rotation_yaw(0.0) @ posture.rotation.T),
            {"right_leg": CartesianMotion(twists[1]), **still},
        )
        q = kinematics.integrate(q, resolver.resolve(posture, task).velocity, dt)
        misses.append(np.abs(posture.ends[:2] - goal.ends[:2]).max())
    assert misses[0] > 1e-3
    assert misses[-1] < 1e-4 * misses[0]


def test_null_space_posture_leaves_the_hand_alone(robot):
    """Note after Eq. (20): a redundant limb's own wish changes only its null space."""
    rng = np.random.default_rng(8)
    posture = posture_of(robot, random_configuration(robot, rng))
    task = random_task(robot, rng, cartesian=("left_arm", "right_arm"))
    motions = dict(task.motions)
    plain = {
        n: CartesianMotion(m.twist) if isinstance(m, CartesianMotion) else m
        for n, m in motions.items()
    }
    resolver = Resolver(robot.limbs, SHARP)
    wished = resolver.resolve(posture, task)
    least = resolver.resolve(
        posture,
        Task(task.com_velocity, task.base, task.base_twist, task.trunk_rate, plain),
    )
    arm = robot.limbs[index_of(robot, "left_arm")].columns
    assert np.abs(wished.velocity[arm] - least.velocity[arm]).max() > 1e-2
    assert wished.loss() < 1e-9
    assert least.loss() < 1e-9


def test_short_limb_loses_only_its_own_task(robot):
    """A limb with fewer joints than rows: CoM and both feet stay exact."""
    rng, resolver = np.random.default_rng(9), Resolver(robot.limbs)
    posture = posture_of(robot, random_configuration(robot, rng))
    task = random_task(robot, rng, cartesian=("torso",))  # 2 or 3 joints, 6 rows
    result = resolver.resolve(posture, task)
    slow = resolve_by_elimination(robot.limbs, posture, task)
    assert np.abs(result.velocity - slow.velocity).max() < 1e-9
    residuals = result.limb_residuals()
    assert np.abs(residuals["torso"]).max() > 1e-2
    assert np.abs(result.com_residual()).max() < 1e-10
    assert np.abs(residuals["right_leg"]).max() < 1e-10
    assert np.abs(residuals["left_leg"]).max() < 1e-10


def straight_legs(robot):
    q = robot.home.copy()
    leg = [limb.columns + 1 for limb in robot.limbs if limb.name.endswith("leg")]
    q[np.concatenate(leg)] = 0.0
    return q


def test_exactly_straight_legs_stay_bounded():
    """Singular by sigma_min, not by angle: rates stay small, only the height gives."""
    robot, resolver = paper(), Resolver(paper().limbs)
    posture = posture_of(robot, straight_legs(robot))
    assert sigma_min(posture.end_jacobian(0)[:, robot.limbs[0].columns]) < 1e-12
    still = {n.name: JointMotion(np.zeros(len(n.joints))) for n in robot.limbs[2:]}
    task = Task(
        np.array([0.0, 0.02, 0.1]), "left_leg", np.zeros(6), np.zeros(3),
        {"right_leg": CartesianMotion(np.zeros(6)), **still},
    )  # fmt: skip
    result = resolver.resolve(posture, task)
    assert result.damped
    assert np.abs(result.rates).max() < 1.0
    assert abs(result.com_residual()[2]) > 0.05
    assert np.abs(result.com_residual()[:2]).max() < 0.01
    assert np.abs(result.limb_residuals()["left_leg"]).max() < 1e-3


def test_reaching_too_high_keeps_feet_and_horizontal_com():
    """Asked 10 cm above its reach, the body stops rising and stays over its feet."""
    robot, resolver = paper(), Resolver(paper().limbs)
    kinematics, q, K, dt = Kinematics(robot), paper().home.copy(), 10.0, 0.005
    goal = kinematics.posture(q)
    fastest = 0.0
    for k in range(400):
        posture = kinematics.posture(q)
        height = goal.com[2] + min(0.1, 0.1 * k * dt)
        twist = [
            K * np.concatenate([
                goal.ends[i] - posture.ends[i],
                rotation_log(goal.end_rotations[i] @ posture.end_rotations[i].T),
            ])
            for i in (0, 1)
        ]  # fmt: skip
        still = {n.name: JointMotion(np.zeros(len(n.joints))) for n in robot.limbs[2:]}
        task = Task(
            K * (np.array([*goal.com[:2], height]) - posture.com),
            "left_leg", twist[0],
            K * rotation_log(np.eye(3) @ posture.rotation.T),
            {"right_leg": CartesianMotion(twist[1]), **still},
        )  # fmt: skip
        result = resolver.resolve(posture, task)
        fastest = max(fastest, np.abs(result.rates).max())
        q = kinematics.integrate(q, result.velocity, dt)
    end = kinematics.posture(q)
    assert fastest < 5.0
    assert 0.02 < end.com[2] - goal.com[2] < 0.1
    assert np.abs(end.com - goal.com)[:2].max() < 1e-3
    assert np.abs(end.ends[:2] - goal.ends[:2]).max() < 1e-3


def test_limits_are_respected_and_the_loss_reported(robot):
    """Joint speed limits hold, and the residuals say what they cost."""
    rng, resolver = np.random.default_rng(10), Resolver(robot.limbs)
    posture = posture_of(robot, random_configuration(robot, rng))
    task = random_task(robot, rng)
    n = len(robot.joints)
    free = resolver.resolve(posture, task)
    loose = RateLimits(np.full(n, -99.0), np.full(n, 99.0))
    same = resolver.resolve_within(posture, task, loose)
    assert np.array_equal(same.velocity, free.velocity)
    assert same.limited == ()
    bound = 0.5 * np.abs(free.rates[list(robot.limbs[0].joints)]).max()
    tight = RateLimits(np.full(n, -bound), np.full(n, bound))
    held = resolver.resolve_within(posture, task, tight)
    assert np.abs(held.rates).max() < bound + 1e-6
    assert held.limited
    assert held.loss() > 1e-3
    assert np.abs(held.limb_residuals()["left_leg"]).max() < 0.1 * held.loss()


def test_position_limits_give_zero_rate_at_the_bound():
    """A joint at its stop does not move further, others take over."""
    robot, resolver = paper(), Resolver(paper().limbs)
    posture = posture_of(robot, robot.home)
    still = {n.name: JointMotion(np.zeros(len(n.joints))) for n in robot.limbs[2:]}
    task = Task(
        np.array([0.0, 0.0, -0.1]), "left_leg", np.zeros(6), np.zeros(3),
        {"right_leg": CartesianMotion(np.zeros(6)), **still},
    )  # fmt: skip
    n, knee = len(robot.joints), robot.joints.index("l_knee_pitch")
    upper = np.full(n, 99.0)
    upper[knee] = 0.0
    held = resolver.resolve_within(posture, task, RateLimits(np.full(n, -99.0), upper))
    assert held.rates[knee] < 1e-6
    assert knee in held.limited
    assert abs(held.com_residual()[2]) > 0.01


def test_damped_inverse_is_exact_when_it_can_be():
    rng = np.random.default_rng(11)
    J = rng.normal(size=(6, 6))
    assert np.allclose(damped_inverse(J, Damping()), np.linalg.inv(J))
    tall, wide = rng.normal(size=(6, 4)), rng.normal(size=(6, 7))
    assert np.allclose(damped_inverse(tall, Damping()), np.linalg.pinv(tall))
    assert np.allclose(damped_inverse(wide, Damping()), np.linalg.pinv(wide))
    flat = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    assert np.abs(damped_inverse(flat, Damping())).max() < 1.01


def test_limbs_must_form_a_tree():
    a = Limb(name="a", joints=(0, 1))
    with pytest.raises(ModelError, match="repeats"):
        check_limbs([a, Limb(name="b", joints=(1,))])
    with pytest.raises(ModelError, match="must come before it"):
        check_limbs([Limb(name="b", joints=(2,), parent="a"), a])


def test_tasks_must_name_every_limb_once():
    robot, rng = paper(), np.random.default_rng(12)
    posture = posture_of(robot, robot.home)
    task = random_task(robot, rng)
    resolver = Resolver(robot.limbs)

    def changed(base="left_leg", **motions):
        kept = {n: m for n, m in task.motions.items() if n not in motions}
        kept |= {n: m for n, m in motions.items() if m is not None}
        return Task(task.com_velocity, base, np.zeros(6), task.trunk_rate, kept)

    with pytest.raises(ModelError, match='did you mean "head"'):
        resolver.resolve(posture, changed(haed=JointMotion(np.zeros(2))))
    with pytest.raises(ModelError, match="no motion is given for limb left_arm"):
        resolver.resolve(posture, changed(left_arm=None))
    with pytest.raises(ModelError, match="cannot be the base"):
        resolver.resolve(
            posture,
            changed("left_arm", left_arm=None, left_leg=CartesianMotion(np.zeros(6))),
        )


@pytest.mark.parametrize("field", ["threshold", "factor", "height_weight"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, 2.0, "x"])
def test_damping_ranges(field, value):
    with pytest.raises(ParameterError, match=field):
        Damping(**{field: value})


def test_support_side_swaps_without_a_jump_near_singular_postures():
    """Damped, both feet give way alike: the base limb's choice does not show."""
    robot, resolver = paper(), Resolver(paper().limbs)
    posture = posture_of(robot, straight_legs(robot))
    still = {n.name: JointMotion(np.zeros(len(n.joints))) for n in robot.limbs[2:]}
    results = [
        resolver.resolve(
            posture,
            Task(
                np.array([0.02, 0.03, 0.05]),
                base,
                np.zeros(6),
                np.array([0.0, 0.1, 0.0]),
                {swing: CartesianMotion(np.zeros(6)), **still},
            ),
        )
        for base, swing in (("left_leg", "right_leg"), ("right_leg", "left_leg"))
    ]
    assert all(result.damped for result in results)
    assert np.abs(results[0].rates).max() > 1e-2
    assert np.abs(results[0].velocity - results[1].velocity).max() < 1e-8
