"""Configurations: flags over files over defaults, and what is built of them."""

import json
import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import paper

from comwalk.certificates.defaults import default_gains, default_gait
from comwalk.config import DanceConfig, PatternConfig, WalkConfig, parse_push
from comwalk.config_files import (
    command_line,
    make_config,
    read_table,
)
from comwalk.control.gains import PAPER_GAINS, Gains
from comwalk.control.settings import Control
from comwalk.embedding.motion_checks import prepare_motion
from comwalk.embedding.motion_files import is_motion_file
from comwalk.errors import ComwalkError, MotionError, ParameterError, PlanError
from comwalk.pattern.footsteps import Foothold, FootstepPlan, Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.profile import Profile
from comwalk.settings import Given, settings_of, table_of
from comwalk.setup import build_dance, build_walk, robot_dance
from comwalk.sides import Side
from comwalk.walking.whole_body import WholeBody


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_defaults_are_the_papers():
    config = make_config(WalkConfig)
    assert config == WalkConfig()
    assert (config.steps, config.robot) == (20, "paper")
    setup = build_walk(config)
    step = setup.pattern.plan.steps[1]
    assert (step.x, step.y, step.single_support) == pytest.approx((0.4, 0.09, 0.8))
    assert setup.pattern.pendulum == Pendulum()
    assert setup.control == Control()


def test_a_file_gives_every_kind_of_value(tmp_path):
    text = """
        robot = "paper"
        steps = 4
        stiffness = 2            # an int for a float
        push = ["1:10,0,0", "2:0,5,0:0.2"]
        motion = "wave"
        motion-amplitude = 0.3   # hyphens are underscores
        [gait]
        half-step = 0.05
        double_support = "minjerk"
        [gains]
        zmp = 2                  # one number for both axes
        com = [5, 4.5]
        [control]
        zmp_cutoff = "none"
        [body]
        deflection_compensation = false
    """
    config = make_config(WalkConfig, file=write(tmp_path / "walk.toml", text))
    assert (config.steps, config.stiffness, config.motion) == (4, 2, "wave")
    assert config.motion_amplitude == 0.3
    assert config.gait.values == {"half_step": 0.05, "double_support": "minjerk"}
    assert config.gains.values == {"zmp": (2.0, 2.0), "com": (5.0, 4.5)}
    assert config.control.values == {"zmp_cutoff": None}
    assert config.body.deflection_compensation is False
    assert [push.start for push in config.physics.pushes] == [1.0, 2.0]


def test_flags_win_over_the_file(tmp_path):
    file = write(tmp_path / "w.toml", "steps = 4\n[gait]\nperiod = 2\nhalf_step = 0.05")
    config = make_config(WalkConfig, {"steps": 6, "gait": {"period": 1.5}}, file)
    assert config.steps == 6
    assert config.gait.values == {"period": 1.5, "half_step": 0.05}


def test_a_value_of_the_file_may_be_mended_by_a_flag(tmp_path):
    file = write(tmp_path / "w.toml", "[gait]\nperiod = 100")
    config = make_config(WalkConfig, {"gait": {"period": 1.2}}, file)
    assert config.gait.values == {"period": 1.2}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("stepz = 4", ['"stepz"', '"steps"']),
        ("[gait]\nperod = 1", ['"gait.perod"', '"period"']),
        ("[gate]\nperiod = 1", ['"gate"', '"gait"']),
        ("[simulator]\npushes = []", ['"simulator.pushes"']),
        ("gait = 3", ["gait must be a table", "[gait]"]),
        ("steps = 'four'", ["steps must be a whole number", "'four'"]),
        ("steps = 4.0", ["steps must be a whole number"]),
        ("steps = true", ["steps must be a whole number"]),
        ("stiffness = true", ["stiffness must be a number"]),
        ("[gait]\nperiod = '1'", ["gait.period must be a number"]),
        ("[gait]\nperiod = [1]", ["gait.period must be a number"]),
        ("[gait]\nperiod = {x = 1}", ["gait.period must be a number"]),
        ("[gait]\nperiod = 100", ["gait.period must be a number in [0.15, 10] s"]),
        ("[gait]\nperiod = nan", ["gait.period", "nan"]),
        ("[gait]\ndouble_support = 'papr'", ["gait.double_support", '"paper"']),
        (
            "[gains]\nzmp = [1, 2, 3]",
            ["gains.zmp must be one number or 2 in 1/s, got 3"],
        ),
        ("[gains]\nzmp = ['a', 'b']", ["gains.zmp must be a number"]),
        ("[gains]\nzmp = -1", ["gains.zmp must be a number in [0"]),
        ("[body]\nembed_motion = 1", ["body.embed_motion must be true or false"]),
        ("robot = 3", ["robot must be text"]),
        ('out = "a\\u0000b"', ["out must be printable text"]),
        ("plant = 'pendlum'", ["plant", '"robot" or "pendulum"', '"pendulum"?']),
        ("plant = []", ["plant", '"robot" or "pendulum"']),
        ("push = [3]", ["push must be text"]),
        ("push = 'soon'", ["push must be START:FX,FY,FZ"]),
        ("seed = -1", ["seed must be a whole number"]),
        ("motion_blend = 0", ["motion_blend must be a number in (0"]),
        ("disturbance = [0.1, -1]", ["disturbance (b)"]),
        ("steps =", ["not valid TOML"]),
    ],
)
def test_a_wrong_file_is_refused_with_its_name_and_key(tmp_path, text, parts):
    file = write(tmp_path / "mine.toml", text)
    with pytest.raises(ComwalkError) as error:
        make_config(WalkConfig, file=file)
    for part in ("mine.toml", *parts):
        assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"[" * 5000, None])
def test_an_unreadable_file_is_refused(tmp_path, content):
    file = tmp_path / "mine.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ParameterError, match=r"mine\.toml"):
        read_table(file)
    with pytest.raises(ParameterError, match="Is a directory"):
        read_table(tmp_path)


@pytest.mark.parametrize("text", ["{}", "[]", "3", '{"settings": {}}', "{"])
def test_a_json_file_that_is_no_summary_is_refused(tmp_path, text):
    file = write(tmp_path / "summary.json", text)
    with pytest.raises(ParameterError, match=r"summary\.json"):
        read_table(file)


def test_a_range_error_of_a_flag_does_not_blame_the_file(tmp_path):
    file = write(tmp_path / "w.toml", "steps = 4")
    with pytest.raises(ParameterError) as error:
        make_config(WalkConfig, {"gait": {"period": -1.0}}, file)
    assert str(error.value).startswith("gait.period must be")


gaits = st.builds(
    dict, period=st.floats(0.5, 5.0), half_step=st.floats(-0.1, 0.1), turn=st.just(0.1)
)
gains = st.builds(dict, zmp=st.tuples(st.floats(0, 3), st.floats(0, 3)))


@given(gait=gaits, gains=gains, steps=st.integers(1, 100), seed=st.integers(0, 99))
def test_a_table_gives_the_configuration_back(gait, gains, steps, seed):
    values = {"gait": gait, "gains": gains, "steps": steps, "seed": seed}
    config = make_config(WalkConfig, {**values, "push": ("1:1,2,3",)})
    table = json.loads(json.dumps(table_of(config)))
    lists_to_tuples = {**table, **{k: tuple(table[k]) for k in ("push", "video")}}
    assert make_config(WalkConfig, lists_to_tuples) == config


@pytest.mark.parametrize("cutoff", [None, math.inf])
def test_a_run_can_be_repeated_from_its_summary(tmp_path, cutoff):
    config = make_config(DanceConfig, {"control": {"zmp_cutoff": cutoff}, "speed": 0.5})
    document = {"settings": {"config": table_of(config)}}
    file = write(tmp_path / "summary.json", json.dumps(document, allow_nan=False))
    again = make_config(DanceConfig, file=file)
    assert again.control.values["zmp_cutoff"] is None
    assert again.speed == 0.5


def test_every_field_is_a_key_but_pushes():
    declared = settings_of(WalkConfig)
    assert {"steps", "gait", "gains", "motion", "push", "out", "json"} <= set(declared)
    assert "pushes" not in settings_of(declared["simulator"].hint)


def test_the_command_line_is_quoted_and_complete():
    flags = {
        "robot": "my robot.xml",
        "push": ("1:1,0,0", "2:0,1,0"),
        "json": True,
        "body": {"embed_motion": False},
        "gains": {"standing_zmp": (0.1, 0.2)},
    }
    assert command_line("walk", flags, "f.toml") == (
        "comwalk walk 'my robot.xml' --config f.toml --push 1:1,0,0 --push 2:0,1,0 "
        "--json --body.no-embed-motion --gains.standing-zmp 0.1,0.2"
    )


@pytest.mark.parametrize(
    "text", ["", "3", ":", "a:1,2,3", "1:1,2", "1:1,2,3,4", "1:1,2,3:1:1", "1:1,2,x"]
)
def test_a_push_of_another_form_is_refused(text):
    with pytest.raises(ParameterError, match="push must be START"):
        parse_push(text)


@pytest.mark.parametrize(
    "text", ["nan:1,2,3", "-1:1,2,3", "1:1,2,inf", "1:1,2,3:0", "1:1,2,3:nan"]
)
def test_a_push_out_of_range_is_refused(text):
    with pytest.raises(ParameterError, match="push"):
        parse_push(text)


def test_a_push_lasts_as_long_as_asked():
    assert parse_push("1:1,2,3").duration == 0.1
    assert parse_push("1:1,2,3:0.5").duration == 0.5


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"steps": 0}, "steps"),
        ({"steps": 10**9}, "steps"),
        ({"seed": -1}, "seed"),
        ({"period": math.nan}, "period"),
        ({"period": 0.0}, "period"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"plant": "pendulum", "motion": "paper"}, "motion"),
        ({"plant": "pendulum", "push": ("1:1,2,3",)}, "push"),
        ({"disturbance": (0.1, 0.1)}, "disturbance"),
        ({"plant": "pendulum", "disturbance": (math.nan, 0.1)}, "disturbance"),
        ({"motion_amplitude": math.inf}, "motion_amplitude"),
    ],
)
def test_wrong_values_are_refused(values, word):
    with pytest.raises(ParameterError, match=word):
        WalkConfig(**values)


@pytest.mark.parametrize(
    "values", [{"duration": 0.5}, {"half_width": math.nan}, {"frequency": 9.0}]
)
def test_wrong_values_of_a_dance_are_refused(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        DanceConfig(**values)


def test_wrong_values_of_a_pattern_are_refused():
    with pytest.raises(ParameterError, match="steps"):
        PatternConfig(steps=0)


def test_a_walk_is_built_of_its_parts():
    config = make_config(WalkConfig, {"steps": 3, "stiffness": 0.5, "motion": "swing"})
    setup = build_walk(config)
    assert setup.robot is not None
    assert setup.pattern.plan.count == 3
    soles = setup.robot.feet[Side.LEFT].sole
    assert setup.pattern.plan.sole_size == pytest.approx(tuple(np.ptp(soles, axis=0)))
    full = build_walk(WalkConfig(steps=3)).robot
    assert full is not None
    assert setup.robot.servo.stiffness == pytest.approx(0.5 * full.servo.stiffness)
    assert setup.motion is not None
    assert setup.motion.stop == pytest.approx(setup.pattern.duration - 0.2)
    q, dq = setup.motion.at(0.0)
    assert q.tolist() == [setup.robot.home_angles[j] for j in setup.motion.joints]
    assert not dq.any()


def test_the_pendulum_needs_no_robot():
    config = WalkConfig(plant="pendulum", disturbance=(0.05, 0.1), seed=3)
    setup = build_walk(config)
    assert setup.robot is None
    assert setup.motion is None
    times = np.linspace(0, setup.pattern.duration, 200).tolist()
    assert 0.0 < max(np.abs(setup.disturbance(t)[0]).max() for t in times) <= 0.05


def test_only_what_was_given_is_kept():
    """So that a table repeats on another robot what the user asked for."""
    config = make_config(WalkConfig, {"gains": {"zmp": 2.0}, "speed": 0.3})
    table = table_of(config)
    assert table["gains"] == {"zmp": [2.0, 2.0]}
    assert table["gait"] == table["control"] == table["pendulum"] == {}
    assert table["speed"] == 0.3
    assert config.gains.over(Gains(com=9.0)) == Gains(zmp=2.0, com=9.0)


def test_a_given_number_is_checked_alone():
    """Against its own range; against the robot's other numbers when it is built."""
    assert Given(Gait, {"transfer_time": 0.6}).values == {"transfer_time": 0.6}
    with pytest.raises(ParameterError, match="transfer_time"):
        Given(Gait, {"transfer_time": 6.0})
    with pytest.raises(ParameterError, match=r"^gait.transfer_time must be"):
        build_walk(WalkConfig(gait=Given(Gait, {"transfer_time": 0.6})))


def other(monkeypatch, **changes):
    """Let the commands load a robot that is the paper's with some changes."""
    from comwalk import robot

    changed = replace(paper(), **changes)
    monkeypatch.setattr(robot, "load_robot", lambda *a, **k: changed)


def test_what_is_not_given_comes_from_the_robot(monkeypatch, tmp_path):
    """A robot that stands lower has a lower pendulum, and walks quicker."""
    home = WholeBody(paper(), 0.002)
    plan = FootstepPlan(left=Foothold(0, 0.12), right=Foothold(0, -0.12))
    home.start(make_pattern(plan, Pendulum(height=0.55)).at(0.0))
    other(monkeypatch, home=home.configuration, profile=Profile())
    setup = build_walk(WalkConfig(steps=2))
    r = 0.55 / 0.687
    gait = default_gait(setup.robot)
    assert setup.pattern.pendulum.height == pytest.approx(0.55)
    assert setup.pattern.plan.left.y == pytest.approx(0.12)
    step = setup.pattern.plan.steps[0]
    assert step.single_support == pytest.approx(0.8 * math.sqrt(r), rel=1e-3)
    assert setup.control.gains == default_gains(setup.robot) != PAPER_GAINS
    assert build_dance(DanceConfig()).pattern.plan.left.y == pytest.approx(0.12)
    file = write(tmp_path / "p.toml", "[[segment]]\nsteps = 2\nhalf_step = 0.03")
    step = build_walk(WalkConfig(plan=str(file))).pattern.plan.steps[0]
    assert step.x == pytest.approx(0.06)
    assert step.swing_height == gait.swing_height == pytest.approx(0.04 * r, rel=1e-3)


def test_a_built_in_dance_is_made_to_fit(monkeypatch):
    """A narrow joint moves less, a slow one slows all; both show in the notes."""
    j = paper().joints.index("r_elbow_pitch")
    k = paper().joints.index("l_shoulder_roll")
    lower, speed = paper().lower.copy(), paper().speed.copy()
    lower[j], speed[k] = paper().home[7 + j] - 0.1, 0.5
    other(monkeypatch, lower=lower, speed=speed)
    setup = build_dance(DanceConfig(amplitude=0.5, frequency=0.5))
    assert setup.motion is not None
    times = np.linspace(0, 10, 2001)
    q, dq = (np.array(x) for x in zip(*map(setup.motion.at, times), strict=True))
    names = {n: i for i, n in enumerate(setup.motion.joints)}
    moved = np.ptp(q, axis=0)
    elbows = moved[names["r_elbow_pitch"]] / moved[names["l_elbow_pitch"]]
    assert elbows == pytest.approx(0.2, abs=1e-3)
    assert 0.47 < np.abs(dq[:, names["l_shoulder_roll"]]).max() <= 0.5
    robot = setup.robot
    assert robot is not None
    prepare_motion(
        setup.motion.motion,
        allowed=robot.upper_body,
        limits=robot.joint_limits,
        home=robot.home_angles,
    )
    (note,) = setup.notes
    assert "r_elbow_pitch moves 0.2 times as far" in note
    assert "times as fast" in note


def test_a_dance_uses_the_joints_of_the_roles(monkeypatch):
    """Roles of other names and other senses of rotation."""

    class Other:
        roles = MappingProxyType({"l_elbow_pitch": ("r_wrist_roll", -1.0)})

        def __getattr__(self, name):
            return getattr(paper(), name)

    motion = robot_dance(Other(), "paper", {"amplitude": 0.5})
    assert motion.joints == ("r_wrist_roll",)
    j = paper().joints.index("r_wrist_roll")
    assert np.ptp(motion.positions) == pytest.approx(0.5)
    assert motion.positions.max() == pytest.approx(paper().home[7 + j] + 0.5)


def test_a_profile_is_given_to_the_loader(monkeypatch):
    from comwalk import robot

    def load(source, **options):
        joints = {"actuation": None, "pd": None}
        assert options == {"stiffness": 1.0, "profile": "mine.toml", **joints}
        return paper()

    monkeypatch.setattr(robot, "load_robot", load)
    build_walk(WalkConfig(profile="mine.toml"))


def test_a_plan_comes_from_its_file(tmp_path):
    file = write(tmp_path / "p.toml", "[[segment]]\nsteps = 2\n[[segment]]\nsteps = 3")
    assert build_walk(WalkConfig(plan=str(file))).pattern.plan.count == 5


def test_a_dance_stands_for_its_whole_time():
    setup = build_dance(DanceConfig(duration=6.0, half_width=0.1))
    assert setup.pattern.duration == 6.0
    assert {span.phase for span in setup.pattern.phases} == {Phase.STAND}
    assert setup.pattern.at(3.0).left.position[1] == pytest.approx(0.1)


def test_a_file_that_does_not_loop_is_danced_once(tmp_path):
    text = "time,l_elbow_pitch\n0,-0.2\n2,-0.6\n4,-0.2"
    setup = build_dance(DanceConfig(motion=str(write(tmp_path / "m.csv", text))))
    assert setup.pattern.duration == pytest.approx(4.4)
    assert setup.motion is not None
    assert (setup.motion.start, setup.motion.stop) == pytest.approx((0.2, 4.2))


def test_a_clip_without_names_is_read_with_the_robots_joints(tmp_path):
    robot = build_walk(WalkConfig(steps=1)).robot
    assert robot is not None
    frames = np.tile(robot.home[7:], (150, 1))
    np.savez(tmp_path / "clip.npz", fps=50, joint_pos=frames)
    setup = build_dance(DanceConfig(motion=str(tmp_path / "clip.npz")))
    assert setup.motion is not None
    assert set(setup.motion.joints) == set(robot.upper_body)


def test_files_are_changed_by_scale_and_speed(tmp_path):
    text = "time,l_elbow_pitch\n0,0\n2,-1\n4,0"
    motion = str(write(tmp_path / "m.csv", text))
    setup = build_dance(DanceConfig(motion=motion, scale=0.5, speed=0.5))
    assert setup.motion is not None
    assert setup.motion.motion.duration == pytest.approx(8.0)
    with pytest.raises(MotionError, match="amplitude"):
        build_dance(DanceConfig(motion=motion, amplitude=0.5))
    config = WalkConfig(motion=motion, motion_frequency=0.5)
    with pytest.raises(MotionError, match="motion_speed"):
        build_walk(config)


def test_limits_are_the_robots():
    robot = build_walk(WalkConfig(steps=1)).robot
    assert robot is not None
    limits = robot.joint_limits
    j = robot.joints.index("l_elbow_pitch")
    assert limits["l_elbow_pitch"].lower == robot.lower[j]
    assert limits["l_elbow_pitch"].speed == robot.speed[j]


@pytest.mark.parametrize(
    ("values", "error"),
    [
        ({"gains": {"zmp": (7.0, 7.0)}}, ParameterError),
        ({"gait": {"half_step": 0.2}}, PlanError),
        ({"pendulum": {"height": 0.9}}, PlanError),
        ({"plan": "missing.toml", "steps": 20}, PlanError),
        ({"plan": "missing.toml"}, ParameterError),
        ({"motion_amplitude": 0.5}, ParameterError),
        ({"motion": "papr"}, MotionError),
    ],
)
def test_what_does_not_go_together_is_refused(values, error):
    with pytest.raises(error):
        build_walk(make_config(WalkConfig, {"steps": 2, **values})).run()


@pytest.mark.parametrize(
    ("source", "expected"),
    [("paper", False), ("papr", False), ("a.csv", True), ("x/y", True), ("./d", True)],
)
def test_a_file_is_told_from_a_name(source, expected):
    assert is_motion_file(source) is expected
