"""Cases as data: what is asked of a robot, and what a search finds."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from robots import paper

from comwalk.bench import cases, trials
from comwalk.bench.cases import (
    ABLATIONS,
    OPEN_LOOP,
    TORQUE,
    Case,
    RelativePush,
    all_cases,
    floors,
    pushes,
)
from comwalk.bench.trials import (
    REPORT_SEEDS,
    TUNING_SEEDS,
    Limit,
    fault_of,
    find_limit,
    gait_of,
    perform,
    prepare,
    push_of,
    stop_and_go,
)
from comwalk.certificates.defaults import default_gait
from comwalk.errors import ParameterError, PlanError
from comwalk.pattern.footsteps import Gait, foot_poses
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.walking.mujoco_plant import SimulatedRobot

SHORT = Case(name="short", steps=2)
FINE = {
    "outcome": "completed",
    "joint_speed_max_pct": 50.0,
    "joint_speed_max_joint": "knee",
    "torque_max_pct": 50.0,
    "torque_max_joint": "ankle",
    "torque_saturation_pct": 0.0,
}


# ---- Searches ---------------------------------------------------------------------


@pytest.mark.parametrize("limit", [0.001, 0.3, math.sqrt(2.0), 3.99])
def test_bisection_finds_a_known_limit(limit):
    """Between the limit and a tolerance below it, in as few tries as halving needs."""
    tried = []

    def fault(x):
        tried.append(x)
        return f"{x} is too much" if x > limit else ""

    found = find_limit(fault, 0.0, 4.0, 0.01)
    assert limit - 0.01 <= found.value <= limit
    assert found.tries == len(tried) == 2 + math.ceil(math.log2(4.0 / 0.01))
    above = min(x for x in tried if x > limit)
    assert found.cause == f"{above} is too much"


def test_bisection_without_a_limit_and_without_a_start():
    assert find_limit(lambda x: "", 0.0, 4.0, 0.01) == Limit(4.0, "", 2)
    assert find_limit(lambda x: "no", 1.0, 4.0, 0.01) == Limit(1.0, "no", 1)
    with pytest.raises(ParameterError, match="tolerance"):
        find_limit(lambda x: "", 0.0, 4.0, 0.0)


def test_faults_are_named():
    assert fault_of(FINE, limits=True) == ""
    fast, strong = {"joint_speed_max_pct": 101.0}, {"torque_saturation_pct": 1.1}
    impact = {"torque_saturation_pct": 0.9, "torque_max_pct": 100.0}
    assert fault_of(FINE | fast, limits=True) == "speed of knee"
    assert fault_of(FINE | strong, limits=True) == "torque of ankle"
    assert fault_of(FINE | impact, limits=True) == ""
    assert fault_of(FINE | fast | strong, limits=False) == ""
    fell = {"outcome": "fell", "cause": "the trunk tilted by 40 deg"}
    assert fault_of(FINE | fell, limits=False) == "fell: the trunk tilted by 40 deg"


def test_speed_is_searched_inside_the_limits(monkeypatch):
    """Joints that use 40 % of their speed at natural speed allow 2.5 of it."""

    def walk(robot, case):
        return FINE | {"joint_speed_max_pct": 40.0 * case.speed_ratio}

    monkeypatch.setattr(trials, "perform", walk)
    gait = default_gait(paper())
    found = trials._find_speed("paper", Case(name="speed", task="speed"))
    natural = 2.0 * gait.half_step / gait.period
    assert found["outcome"] == "found"
    assert found["cause"] == "speed of knee"
    assert found["speed_m_s"] == pytest.approx(2.5 * natural, abs=0.02 * natural)


def test_pushes_are_searched_until_the_fall(monkeypatch):
    def walk(robot, case):
        fell = {"outcome": "fell", "cause": "it fell"}
        return FINE if case.push.speed <= 0.37 else FINE | fell

    monkeypatch.setattr(trials, "perform", walk)
    (case,) = pushes((0.6,), ("outward",))
    found = trials._find_push("paper", case)
    assert found["push_m_s"] == pytest.approx(0.37, abs=case.tolerance)
    pattern = prepare("paper", dataclasses.replace(case, task="walk")).pattern
    phase = pattern.at(found["start_s"]).phase
    assert phase.name == f"SINGLE_{found['foot'].upper()}"
    monkeypatch.setattr(trials, "perform", lambda robot, case: FINE | fell)
    fell = {"outcome": "refused", "cause": "no"}
    assert trials._find_push("paper", case)["outcome"] == "failed"


# ---- What a case is ---------------------------------------------------------------


def test_cases_have_names_of_their_own():
    cases = all_cases(TUNING_SEEDS)
    assert len({case.name for case in cases}) == len(cases)
    assert len({ablation.name for ablation in ABLATIONS}) == len(ABLATIONS)


def test_floors_for_reports_are_never_those_for_tuning():
    assert not set(REPORT_SEEDS) & set(TUNING_SEEDS)
    names = {case.name for case in floors(REPORT_SEEDS)}
    assert not names & {case.name for case in floors(TUNING_SEEDS)}
    assert len(names) == 60


def test_floor_of_a_case_is_that_of_the_simulator():
    case = dataclasses.replace(floors([7], [0.01])[0], steps=1)
    physics = prepare("paper", case).physics
    assert (physics.terrain, physics.terrain_seed) == (0.01, 7)


def test_ablation_changes_the_controller_alone():
    setup = prepare("paper", OPEN_LOOP.of(SHORT))
    assert setup.control.gains.is_open_loop
    usual = prepare("jvrc1", SHORT)
    for ablation in ABLATIONS:
        changed = prepare("jvrc1", ablation.of(SHORT))
        laws = [(x.control, x.pattern.pendulum) for x in (changed, usual)]
        assert laws[0] != laws[1]
        assert changed.physics == usual.physics or ablation is TORQUE
        assert changed.pattern.plan == usual.pattern.plan


def test_gaits_are_in_natural_measures():
    natural = default_gait(paper())
    assert gait_of("paper", SHORT) == natural
    back = gait_of("paper", dataclasses.replace(SHORT, forward=-0.5))
    assert back.half_step == -0.5 * natural.half_step
    for speed_ratio in (0.5, 2.0):
        fast = gait_of("paper", dataclasses.replace(SHORT, speed_ratio=speed_ratio))
        speeds = [gait.half_step / gait.period for gait in (fast, natural)]
        assert speeds[0] / speeds[1] == pytest.approx(speed_ratio, rel=1e-3)


@pytest.mark.parametrize(
    ("way", "axis", "sign"),
    [("forward", 0, 1), ("back", 0, -1), ("outward", 1, 1), ("inward", 1, -1)],
)
@pytest.mark.parametrize("step", [1, 2])
def test_pushes_have_their_impulse_way_and_time(way, axis, sign, step):
    """Impulse by mass is the speed; outward is over the foot that stands."""
    pattern = make_pattern(plan_steps(Gait(), 4), Pendulum())
    push = RelativePush(way=way, share=0.35, speed=0.2, step=step)
    push = push_of(push, pattern, 70.0)
    impulse = np.array(push.force) * push.duration / 70.0
    reference = pattern.at(push.start)
    left = reference.phase is Phase.SINGLE_LEFT
    if axis == 1 and not left:
        sign = -sign
    expected = np.zeros(3)
    expected[axis] = 0.2 * sign
    assert np.abs(impulse - expected).max() < 1e-12
    assert reference.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
    assert reference.step == step - 1
    began = pattern.at(push.start - 0.35 * 0.8 + 1e-6)
    assert began.phase is reference.phase
    assert pattern.at(push.start - 0.35 * 0.8 - 1e-6).phase is Phase.DOUBLE


def test_pushes_turn_with_the_heading():
    gait = Gait(half_step=0.05, turn=0.4)
    pattern = make_pattern(plan_steps(gait, 6), Pendulum())
    push = RelativePush(way="forward", share=0.5, speed=0.1, step=4)
    push = push_of(push, pattern, 50.0)
    heading = pattern.at(push.start).heading
    assert abs(heading) > 0.5
    assert math.atan2(push.force[1], push.force[0]) == pytest.approx(heading)
    assert math.hypot(*push.force) == pytest.approx(50.0 * 0.1 / 0.1)


def test_pushes_need_their_step():
    pattern = make_pattern(plan_steps(Gait(), 1), Pendulum())
    with pytest.raises(PlanError, match="walk more steps"):
        push_of(RelativePush(way="back", share=0.1, step=4), pattern, 50.0)


def test_stop_and_go_stands_side_by_side_on_the_way():
    gait = Gait()
    base = make_pattern(plan_steps(gait, 1), Pendulum())
    pattern = stop_and_go(base, gait, 3, pause=2.0)
    poses = foot_poses(pattern.plan)
    stands = [step.stand for step in pattern.plan.steps]
    (k,) = np.flatnonzero([stand == 2.0 for stand in stands])
    left, right = poses[k + 1]
    assert left[0] == pytest.approx(right[0])
    middle = poses[:, :, 0].mean(axis=1)
    assert middle[-1] - middle[k + 1] == pytest.approx(middle[k + 1] - middle[0])
    rests = [s for s in pattern.phases if s.phase is Phase.STAND]
    assert len(rests) == 3
    times = rests[1].start + np.linspace(0.0, rests[1].duration, 20)
    assert rests[1].duration == pytest.approx(2.0)
    com = pattern.sample(times).com[:, :2]
    assert np.abs(com - (middle[k + 1], 0.0)).max() < 1e-9


# ---- Doing it ---------------------------------------------------------------------


def test_a_walk_gives_plain_figures():
    result = perform("paper", SHORT)
    json.dumps(result, allow_nan=False)
    assert result["outcome"] == "completed"
    assert not {"settings", "versions"} & set(result)
    step = 2.0 * default_gait(paper()).half_step
    assert result["path_m"] == pytest.approx(2 * step)
    share = 100.0 * result["position_error_m"] / result["path_m"]
    assert result["end_error_pct"] == pytest.approx(share)
    assert result["torque_max_joint"] in paper().joints


def test_largest_speed_and_torque_are_those_of_the_log():
    run = prepare("paper", SHORT).run()
    figures, robot = run.summary(), paper()
    torque = 100.0 * np.abs(run.log["torques_true"]) / robot.torque
    speed = 100.0 * np.abs(run.log["qvel"][:, 6:]) / robot.speed
    for name, shares in (("torque", torque), ("joint_speed", speed)):
        assert figures[f"{name}_max_pct"] == pytest.approx(shares.max())
        j = robot.joints.index(figures[f"{name}_max_joint"])
        assert shares[:, j].max() == shares.max()


def test_refusals_are_results():
    unknown = perform("nobody", SHORT)
    assert unknown["outcome"] == "refused"
    assert "nobody" in unknown["cause"]
    long = perform("paper", dataclasses.replace(SHORT, forward=1.9))
    assert long["outcome"] == "refused"
    assert "reach" in long["cause"]
    wrong = perform("paper", dataclasses.replace(SHORT, keys={"simulator.noise": -1.0}))
    assert "simulator.noise" in wrong["cause"]


def test_a_robot_is_described():
    result = perform("paper", cases.ABOUT)
    assert result["mass_kg"] == pytest.approx(paper().mass)
    assert result["joints"] == 30
    assert result["speed_m_s"] == pytest.approx(result["step_m"] / result["period_s"])


def test_an_interruption_is_no_result(monkeypatch):
    def interrupted(plant, command):
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedRobot, "start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        perform("paper", SHORT)
