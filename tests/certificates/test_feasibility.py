"""What a plan asks of a robot: against the simulation, and at moved limits."""

import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import urdf, with_shape
from robots import paper, robot_of

from comwalk.certificates.defaults import walk_pattern
from comwalk.certificates.plan_check import (
    Feasibility,
    check_feasible,
    feasibility,
    nearest_plans,
)
from comwalk.certificates.reach import stance_stiffness
from comwalk.config import DanceConfig
from comwalk.embedding.motion import Motion, embed_in
from comwalk.errors import ModelError, PlanError
from comwalk.pattern.footsteps import Foothold, FootstepPlan, Gait, foot_poses
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import (
    excerpt,
    plan_steps,
    shortened,
    slowed,
    without_repeats,
)
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.model import load_robot
from comwalk.robot.self_collision import CLEARANCE, SelfCollision
from comwalk.run import simulate
from comwalk.setup import build_dance
from comwalk.sides import Side


@cache
def usual() -> Feasibility:
    """What four steps of the paper's walk ask of the paper's robot."""
    return feasibility(paper(), walk_pattern(paper(), 4))


@cache
def walked():
    return simulate(paper(), walk_pattern(paper(), 4))


def demand(result, what, joint):
    (found,) = [d for d in result.demands if (d.what, d.joint) == (what, joint)]
    return found


def limited(joint, **limits):
    """Return the paper's robot with other limits of one joint."""
    j = paper().joints.index(joint)
    changed = {name: getattr(paper(), name).copy() for name in limits}
    for name, value in limits.items():
        changed[name][j] = value
    return replace(paper(), **changed)


def test_the_papers_walk_fits_the_papers_robot():
    result = usual()
    assert result.ok
    shares = [d.share for d in result.demands]
    assert shares == sorted(shares, reverse=True)
    assert result.worst.share == shares[0] < 1.0
    assert {d.what for d in result.demands} == {
        *("position", "speed", "torque", "reach", "stiffness", "singularity", "ZMP")
    }
    assert len(result.table().splitlines()) == len(shares)
    assert result.table(1).split()[1] == result.worst.what
    check_feasible(paper(), walk_pattern(paper(), 4))


@pytest.mark.parametrize("joint", ["l_hip_roll", "r_hip_roll", "l_knee_pitch"])
def test_torques_are_those_of_the_simulation(joint):
    """Apart from landings and the servos' softness."""
    j = paper().joints.index(joint)
    seen = np.percentile(np.abs(walked().log["torques_true"][:, j]), 99.5)
    assert demand(usual(), "torque", joint).demanded == pytest.approx(seen, rel=0.12)


@pytest.mark.parametrize("joint", ["l_hip_pitch", "r_knee_pitch", "l_ankle_pitch"])
def test_speeds_and_angles_are_those_of_the_simulation(joint):
    j = paper().joints.index(joint)
    rates = np.abs(walked().log["qvel"][:, 6 + j])
    angles = walked().log["qpos"][:, 7 + j]
    speed = demand(usual(), "speed", joint).demanded
    assert speed == pytest.approx(rates.max(), rel=0.1)
    angle = demand(usual(), "position", joint).demanded
    assert min(abs(angle - angles.min()), abs(angle - angles.max())) < 0.07


@pytest.mark.parametrize(
    ("what", "joint", "limit"),
    [
        ("torque", "l_knee_pitch", "torque"),
        ("speed", "r_knee_pitch", "speed"),
        ("position", "l_ankle_pitch", "lower"),
    ],
)
def test_a_lower_limit_is_found_and_named(what, joint, limit):
    needed = demand(usual(), what, joint).demanded
    pattern = walk_pattern(paper(), 4)
    enough = limited(joint, **{limit: 1.001 * needed})
    assert feasibility(enough, pattern).ok
    scarce = feasibility(limited(joint, **{limit: 0.9 * needed}), pattern)
    assert not scarce.ok
    assert (scarce.worst.what, scarce.worst.joint) == (what, joint)
    assert scarce.worst.demanded == pytest.approx(needed)
    assert joint in str(scarce.worst)
    assert f"{needed:.3g}" in str(scarce.worst)


def test_joints_without_limits_are_left_out():
    far = np.full(len(paper().joints), np.inf)
    robot = replace(paper(), lower=-far, upper=far, speed=far, torque=far)
    whats = {d.what for d in feasibility(robot, walk_pattern(paper(), 2)).demands}
    assert whats == {"reach", "stiffness", "singularity", "ZMP"}


def test_footsteps_out_of_reach_are_named_and_nothing_else_is_looked_at():
    pattern = walk_pattern(paper(), 2, half_step=0.2)
    result = feasibility(paper(), pattern)
    assert {d.what for d in result.demands} == {"reach"}
    assert result.worst.demanded > result.worst.limit
    with pytest.raises(PlanError, match=r"footstep \d+ is out of reach.*it would fit"):
        check_feasible(paper(), pattern)


def test_straight_legs_are_singular():
    result = feasibility(paper(), walk_pattern(paper(), 3, half_step=0.15))
    assert result.worst.what == "singularity"
    assert "straight" in str(result.worst)


def test_a_zmp_beside_the_sole_is_seen():
    """A tiny sole on a plan that says so."""
    pattern = walk_pattern(paper(), 3)
    tiny = replace(pattern.plan, sole_size=(0.01, 0.01))
    result = feasibility(paper(), make_pattern(tiny, Pendulum()))
    assert result.worst.what == "ZMP"
    assert "sole" in str(result.worst)


def test_the_robot_must_stand_as_the_pattern_begins():
    pattern = make_pattern(plan_steps(Gait(), 2), Pendulum(height=0.2))
    with pytest.raises(PlanError, match=r"pendulum\.height"):
        feasibility(paper(), pattern)


def test_legs_of_another_number_of_joints_are_refused():
    limbs = tuple(
        replace(x, joints=x.joints[:5]) if x.name == "left_leg" else x
        for x in paper().limbs
    )
    with pytest.raises(ModelError, match="5 joints; the roll of the ankle"):
        feasibility(replace(paper(), limbs=limbs), walk_pattern(paper(), 1))


def test_finer_samples_tell_the_same():
    """To 3 %, but for what changes within a few hundredths of a second."""
    fine = feasibility(paper(), walk_pattern(paper(), 4), period=0.005)
    for d in usual().demands:
        if d.what in ("torque", "position", "reach", "singularity") and d.share > 0.3:
            assert demand(fine, d.what, d.joint).share == pytest.approx(
                d.share, rel=0.03
            )


# ---- Links that meet --------------------------------------------------------------


def arms_crossed(angle=1.4):
    """Return the home posture with the left forearm in the chest."""
    q = paper().home.copy()
    for joint, value in (
        ("l_shoulder_yaw", -angle),
        ("l_elbow_pitch", -angle),
        ("l_shoulder_pitch", 0.0),
    ):
        q[7 + paper().joints.index(joint)] = value
    return q


def test_links_meet_where_their_geoms_do():
    """The distance is that of the nearest pair of geoms, asked one by one."""
    collision = SelfCollision(paper())
    assert collision.distances(paper().home) == {}
    found = collision.distances(arms_crossed())
    links, distance = min(found.items(), key=lambda item: item[1])
    assert distance < CLEARANCE
    model, data = collision.model, mujoco.MjData(collision.model)
    data.qpos[:] = arms_crossed()
    mujoco.mj_kinematics(model, data)
    a, b = (model.body(name).id for name in links.split(" and "))
    geoms = [np.flatnonzero(model.geom_bodyid == body) for body in (a, b)]
    nearest = min(
        mujoco.mj_geomDistance(model, data, i, j, 1.0, None)
        for i in geoms[0].tolist()
        for j in geoms[1].tolist()
    )
    assert distance == pytest.approx(nearest, abs=2e-3)


def test_more_geometry_may_have_more_joints():
    """Joints go by their names; the base does not matter."""
    spec = paper().spec.copy()
    more = spec.bodies[-1].add_body(name="finger", pos=[0, 0, -0.1])
    more.add_joint(name="finger", axis=[1, 0, 0])
    more.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.005, 0, 0], mass=0.01)
    del spec.keys[:]
    wider = SelfCollision(paper(), spec)
    q = arms_crossed()
    same = SelfCollision(paper()).distances(q)
    q[:3] = 5.0
    assert wider.distances(q) == pytest.approx(same)


def test_a_dance_through_the_chest_is_refused():
    names = ("l_shoulder_yaw", "l_elbow_pitch", "l_shoulder_pitch")
    angles = paper().home_angles
    crossed = dict(zip(paper().joints, arms_crossed()[7:].tolist(), strict=True))
    positions = np.array([[pose[n] for n in names] for pose in (angles, crossed)])
    motion = Motion(
        name="cross",
        joints=names,
        times=np.array([0.0, 1.0]),
        positions=positions,
    )
    embedded = embed_in(motion, angles, start=0.2, stop=3.0, blend=0.5)
    result = feasibility(paper(), walk_pattern(paper(), 1), embedded)
    assert result.worst.what == "self-collision"
    assert "meet" in str(result.worst)


# ---- Plans that fit -----------------------------------------------------------------


def test_the_nearest_plans_fit_and_smaller_changes_do_not():
    pattern = walk_pattern(paper(), 12, half_step=0.16)
    changes = nearest_plans(paper(), pattern)
    assert [c.amount for c in changes] == sorted(c.amount for c in changes)
    texts = [change.text for change in changes]
    assert any("pendulum.height" in text for text in texts)
    assert any("as long" in text for text in texts)
    for change in changes:
        assert feasibility(paper(), change.pattern).ok
    # An excerpt also stops, its feet apart, for which it may need some more.
    (step,) = [c for c in changes if "as long" in c.text]
    longer = shortened(pattern.plan, 1.0 - step.amount + 0.10)
    assert not feasibility(paper(), make_pattern(longer, Pendulum())).ok


def test_slower_steps_help_slow_joints():
    needed = demand(usual(), "speed", "l_knee_pitch").demanded
    robot = limited("l_knee_pitch", speed=0.85 * needed)
    texts = [c.text for c in nearest_plans(robot, walk_pattern(paper(), 4))]
    assert any("times the time" in text for text in texts)


def test_changes_that_make_no_plan_are_passed_over(monkeypatch):
    """Such as steps that would put a sole on the other."""
    from comwalk.certificates import plan_check as module

    def meeting(plan, factor):
        raise PlanError("soles meet")

    monkeypatch.setattr(module, "shortened", meeting)
    pattern = walk_pattern(paper(), 3, half_step=0.16)
    (change,) = nearest_plans(paper(), pattern)
    assert "pendulum.height" in change.text


def test_where_nothing_helps_it_says_so():
    robot = limited("l_knee_pitch", torque=5.0)
    with pytest.raises(PlanError, match="no shorter, slower or lower plan"):
        check_feasible(robot, walk_pattern(paper(), 2))


def test_simulate_refuses_and_can_be_forced():
    robot = limited("l_knee_pitch", speed=1.5)
    pattern = walk_pattern(paper(), 1)
    with pytest.raises(PlanError, match="l_knee_pitch needs a speed"):
        simulate(robot, pattern)
    assert simulate(robot, pattern, force=True).outcome.ok


gaits = st.builds(
    Gait,
    half_step=st.floats(-0.1, 0.1),
    lateral=st.floats(-0.08, 0.08),
    half_width=st.just(0.11),
)
turning = st.builds(Gait, half_step=st.floats(-0.1, 0.1), turn=st.floats(-0.2, 0.2))


@settings(max_examples=50)
@given(gait=gaits, factor=st.floats(0, 1), steps=st.integers(1, 6))
def test_a_shortened_straight_walk_is_that_of_a_shorter_gait(gait, factor, steps):
    short = replace(
        gait, half_step=factor * gait.half_step, lateral=factor * gait.lateral
    )
    side = Side.LEFT if gait.lateral >= 0 else Side.RIGHT
    plan = shortened(plan_steps(gait, steps, first=side), factor)
    expected = plan_steps(short, steps, first=side)
    ours, theirs = foot_poses(plan), foot_poses(expected)
    assert ours[: steps + 1] == pytest.approx(theirs[: steps + 1], abs=1e-9)


@settings(max_examples=50)
@given(gait=turning, steps=st.integers(1, 6))
def test_a_plan_shortened_by_one_is_itself(gait, steps):
    plan = plan_steps(gait, steps)
    assert foot_poses(shortened(plan, 1.0)) == pytest.approx(foot_poses(plan))
    still = foot_poses(shortened(plan, 0.0))
    assert still == pytest.approx(np.broadcast_to(still[0], still.shape), abs=1e-9)


@given(factor=st.floats(0.5, 3.0))
def test_a_slowed_plan_takes_longer(factor):
    plan = plan_steps(Gait(), 4)
    slow = slowed(plan, factor)
    assert foot_poses(slow) == pytest.approx(foot_poses(plan))
    ratios = [
        b.single_support / a.single_support
        for a, b in zip(plan.steps, slow.steps, strict=True)
    ]
    assert ratios == pytest.approx([factor] * len(ratios))
    assert slow.start_time == pytest.approx(factor * plan.start_time)


def test_an_excerpt_keeps_places_and_sides():
    plan = plan_steps(Gait(turn=0.1), 8)
    assert excerpt(plan, -5, 99) == plan
    part = excerpt(plan, 3, 6)
    assert part.steps == plan.steps[3:6]
    assert foot_poses(part) == pytest.approx(foot_poses(plan)[3:7])
    assert excerpt(plan, 20, 25).steps == ()


def _around(plan):
    """Return a plan whose steps in the middle are one of a kind, twice."""
    steps = list(plan.steps)
    for k in (9, 16):
        steps[k] = replace(steps[k], swing_height=0.05)
    return replace(plan, steps=tuple(steps))


@given(
    count=st.integers(1, 40),
    keep=st.integers(0, 8),
    turn=st.sampled_from((0.0, 0.15)),
    lateral=st.sampled_from((0.0, 0.03)),
)
def test_steps_that_repeat_themselves_are_taken_out(count, keep, turn, lateral):
    """In pairs, and what is left looks the same from foot to foot."""
    plan = plan_steps(Gait(turn=turn, lateral=lateral, half_width=0.15), count)
    less = without_repeats(plan, keep)
    spare = len(plan.steps) - len(less.steps)
    assert spare % 2 == 0
    assert less is plan or len(less.steps) >= keep
    assert len(less.steps) <= max(6, keep + 6)
    assert [s.side for s in less.steps[-2:]] == [s.side for s in plan.steps[-2:]]
    apart = [np.diff(foot_poses(p), axis=1)[:, 0] for p in (plan, less)]
    reach = [np.hypot(*d[:, :2].T) for d in apart]
    np.testing.assert_allclose(reach[1][:3], reach[0][:3], atol=1e-9)
    np.testing.assert_allclose(reach[1][-3:], reach[0][-3:], atol=1e-9)
    assert without_repeats(less, keep) is less


def test_steps_that_stand_out_are_kept():
    """Between rows of the same steps, and with what is two steps after them."""
    plan = _around(plan_steps(Gait(), 30))
    less = without_repeats(plan, 2)
    heights = [step.swing_height for step in less.steps]
    assert heights.count(0.05) == 2
    assert len(less.steps) < 20
    assert without_repeats(plan, 40) is plan


@pytest.mark.parametrize("gait", [Gait(), Gait(turn=0.1, half_step=0.05)])
def test_repeats_ask_for_nothing_new(gait):
    """So that a walk of a thousand steps is checked like one of ten."""
    whole = make_pattern(plan_steps(gait, 16), Pendulum())
    part = make_pattern(without_repeats(whole.plan, 4), Pendulum())
    shares = [
        {(d.what, d.joint): d.share for d in feasibility(paper(), p).demands}
        for p in (whole, part)
    ]
    del shares[0]["ZMP", "sole"]  # how often it is off depends on them
    assert len(part.plan.steps) < 9
    for key, share in shares[0].items():
        assert shares[1][key] == pytest.approx(share, abs=2e-3)


def test_a_long_walk_that_does_not_fit_is_refused():
    """The short look only ever says yes."""
    slow = limited("l_knee_pitch", speed=0.5)
    with pytest.raises(PlanError, match="l_knee_pitch needs a speed"):
        check_feasible(slow, walk_pattern(paper(), 10))


def pushed_com(robot, side: Side, force: np.ndarray) -> np.ndarray:
    """Return how far a static force moves the CoM of a robot whose one foot is fixed.

    Found without Jacobians: the work of small turns of each joint gives its torque, the
    servo gives way by torque / stiffness, and kinematics tells where the CoM is then.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    joints = [
        robot.joints.index(name)
        for limb in robot.limbs
        if limb.name == f"{side}_leg"
        for name in (robot.joints[j] for j in limb.joints)
    ]
    site = robot.feet[side].site

    def com(bend: np.ndarray) -> np.ndarray:
        q = robot.home.copy()
        q[[7 + j for j in joints]] += bend
        q[:7] = 0.0
        q[3] = 1.0
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        R = data.site_xmat[site].reshape(3, 3)
        return R.T @ (data.subtree_com[robot.base_body] - data.site_xpos[site])

    h, zero = 1e-5, com(np.zeros(len(joints)))
    unit = np.eye(len(joints))
    G = np.stack([(com(h * e) - com(-h * e)) / (2 * h) for e in unit], axis=1)
    torque = G.T @ force
    return com(torque / robot.servo.stiffness[joints]) - zero


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("name", ["paper", "g1", "jvrc1"])
def test_a_force_at_the_com_moves_it_by_the_stance_legs_stiffness(name, side):
    """In the frame of the fixed sole, by kinematics alone."""
    robot = robot_of(name)
    k = stance_stiffness(robot)[side]
    for i in range(2):
        force = np.zeros(3)
        force[i] = 5.0
        assert pushed_com(robot, side, force)[i] == pytest.approx(5.0 / k[i], rel=3e-3)


def test_stiffness_grows_with_the_servos():
    for factor in (0.5, 2.0):
        softer, usual = (
            stance_stiffness(load_robot("paper", stiffness=f)) for f in (factor, 1.0)
        )
        for side in Side:
            assert softer[side] == pytest.approx(factor * usual[side])


@pytest.mark.parametrize("name", ["paper", "g1", "icub"])
def test_servos_that_cannot_hold_the_robot_are_refused_and_the_advice_works(name):
    """Forced, the robot tips over by itself; as stiff as is advised, it walks."""
    soft = robot_of(name, stiffness=0.045)
    pattern = walk_pattern(soft, 4)
    with pytest.raises(PlanError, match=r"servos of the .* leg, forward") as caught:
        simulate(soft, pattern)
    assert not simulate(soft, pattern, force=True).outcome.ok
    found = re.search(r"with servos ([\d.]+) times as stiff", str(caught.value))
    assert found is not None
    factor = 0.045 * float(found[1])
    stiff = robot_of(name, stiffness=factor)
    assert simulate(stiff, pattern).outcome.ok


def test_standing_asks_for_no_stance_leg():
    soft = load_robot("paper", stiffness=0.05)
    demands = feasibility(soft, make_pattern(excerpt_of_standing(), Pendulum())).demands
    assert "stiffness" not in {demand.what for demand in demands}


def excerpt_of_standing() -> FootstepPlan:
    return FootstepPlan(left=Foothold(0.0, 0.09), right=Foothold(0.0, -0.09))


def test_advice_on_a_dance_works(tmp_path):
    """A clip that is too fast for the ZMP: slower or smaller, as the message says."""
    robot_of("g1")
    t = np.arange(200) / 50
    rows = [f"{x:.3f},{0.4 * np.sin(14.0 * x):.6f}" for x in t]
    file = tmp_path / "fast.csv"
    file.write_text("\n".join(["time,waist_pitch_joint", *rows]))
    words = {"robot": "g1", "motion": str(file), "actuation": "position"}
    with pytest.raises(PlanError, match="the ZMP is") as caught:
        build_dance(DanceConfig(**words)).run()
    told = dict(
        re.findall(r"motion ([\d.]+) times as \w+ \(--(\w+)\)", str(caught.value))
    )
    assert set(told.values()) == {"scale", "speed"}
    for factor, flag in told.items():
        run = build_dance(DanceConfig(**words, **{flag: float(factor)})).run()
        assert run.outcome.ok
    assert build_dance(DanceConfig(**words, force=True)).run().outcome is not None


def test_arms_that_hang_into_the_legs_are_told_and_walked(tmp_path):
    """Their shapes are rough; what a motion does with them is refused."""
    text = urdf()
    fat = '<collision><geometry><box size="0.3 0.3 0.3"/></geometry></collision>'
    for side in Side:
        text = with_shape(text, f"link_{side}_wrist_z", fat)
    file = tmp_path / "fat.urdf"
    file.write_text(text)
    robot = load_robot(file)
    pattern = walk_pattern(robot, 2)
    found = [
        d for d in feasibility(robot, pattern).demands if d.what == "self-collision"
    ]
    assert all(d.share <= 1.0 for d in found)
    check_feasible(robot, pattern)
