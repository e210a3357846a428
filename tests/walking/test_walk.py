"""Walking in physics: the figures that comwalk promises, and what ends a run."""

from __future__ import annotations

import dataclasses
import json

import mujoco
import numpy as np
import pytest
from models import write
from robots import paper

from comwalk.certificates.defaults import walk_pattern
from comwalk.config import WalkConfig
from comwalk.control.gains import Gains
from comwalk.control.guard import End, Watch
from comwalk.control.law import ControlOutput, WalkingController
from comwalk.control.loop import walk
from comwalk.control.plant import Sensors, constant_disturbance, random_bounded
from comwalk.control.settings import BodySettings, Control, Push, SimulatorSettings
from comwalk.embedding.dances import builtin_motion
from comwalk.embedding.motion import embed_in
from comwalk.embedding.motion_checks import prepare_motion
from comwalk.errors import ModelError, ParameterError, PlanError, RunError
from comwalk.pattern.footsteps import Foothold, Footstep, FootstepPlan, Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.replay import replay
from comwalk.robot.loaders.sources import read_model
from comwalk.robot.model import load_robot
from comwalk.run import simulate, simulate_pendulum
from comwalk.runs.summary import sole_margins
from comwalk.setup import build_walk
from comwalk.sides import Side
from comwalk.walking.whole_body import WholeBody

OPEN_LOOP = Control(gains=Gains(zmp=0.0, com=0.0))
BARE = dataclasses.replace(OPEN_LOOP, body=BodySettings(imu=False, landing=0.0))
"""Neither the law nor what lets soles yield to the ground."""


def pattern_of(steps, **gait):
    return make_pattern(plan_steps(Gait(**gait), steps), Pendulum())


@pytest.fixture(scope="module")
def walk20():
    """The walk of the paper's experiment: 20 steps of 0.2 m."""
    return simulate(paper(), pattern_of(20))


@pytest.fixture(scope="module")
def short():
    """Two steps with a push."""
    push = Push(start=2.0, force=(0.0, 60.0, 0.0))
    return simulate(
        paper(), pattern_of(2), physics=SimulatorSettings(pushes=(push,), noise=1.0)
    )


def test_paper_gait_walks_four_metres(walk20):
    """Section VI: 20 steps under the paper's gait and gains."""
    figures = walk20.summary()
    assert figures["outcome"] == "completed"
    assert figures["steps_completed"] == 20
    assert abs(figures["distance_m"] - 4.0) < 0.08
    assert abs(figures["heading_error_deg"]) < 2.0
    assert figures["position_error_m"] < 0.08


def test_paper_gait_tracks_com_and_zmp(walk20):
    """Fig. 7: the errors, from the simulator's own CoM where it says true."""
    figures = walk20.summary()
    true = figures["com_error_rms_mm"]["true"]
    assert true["x"] < 6.0
    assert true["y"] < 6.0
    assert figures["zmp_error_rms_mm"]["x"] < 15.0
    assert figures["zmp_error_rms_mm"]["y"] < 10.0
    assert figures["sole_margin_p5_mm"] > 40.0
    assert figures["sole_margin_min_mm"] > 0.0
    assert figures["trunk_tilt_max_deg"] < 2.0
    assert figures["torque_saturation_pct"] == 0.0


def test_true_com_is_the_models_own(walk20):
    """The logged truth, against the CoM of the logged state, link by link."""
    model = walk20.scene
    data = mujoco.MjData(model)
    for k in range(0, len(walk20.log), 1000):
        data.qpos[:] = walk20.log["qpos"][k]
        mujoco.mj_kinematics(model, data)
        masses = model.body_mass[1:, None]
        com = (masses * data.xipos[1:]).sum(axis=0) / masses.sum()
        assert np.abs(com - walk20.log["com_true"][k]).max() < 1e-9


def test_measured_zmp_is_that_of_the_contacts(walk20):
    """ZMP from ankle sensors against the pressure of the simulator's contacts."""
    difference = walk20.log["zmp"] - walk20.log["zmp_true"]
    assert np.nanpercentile(np.abs(difference), 99) < 4e-3  # 1 mm is odometry
    weight = paper().mass * 9.81
    assert abs(walk20.log["load"][200] - weight) < 1.0


def test_feet_stay_flat_and_where_they_are_put(walk20):
    """The stance sole stands on the ground near its planned place."""
    log, site = walk20.log, paper().feet
    data = mujoco.MjData(walk20.scene)
    for k in np.flatnonzero(log["phase"] == Phase.SINGLE_LEFT)[::500]:
        data.qpos[:] = log["qpos"][k]
        mujoco.mj_kinematics(walk20.scene, data)
        name = paper().model.site(site["left"].site).name
        index = walk20.scene.site(name).id
        assert np.abs(data.site_xpos[index] - log["feet_ref"][k, 0]).max() < 3e-3
        assert data.site_xmat[index][8] > np.cos(np.radians(0.5))


def test_law_survives_soft_servos_and_the_bare_pattern_falls():
    """A quarter of the stiffness: the law completes, without any feedback it falls."""
    soft = load_robot("paper", stiffness=0.25)
    closed = simulate(soft, pattern_of(8))
    assert closed.outcome.ok
    bare = simulate(soft, pattern_of(8), control=BARE)
    assert bare.outcome.end is End.FELL
    assert "trunk tilted" in bare.outcome.cause or "CoM" in bare.outcome.cause
    assert bare.outcome.time < 10.0
    assert "after" in str(bare.outcome)
    # Soles that lie as the IMU says do not make up for the law.
    loose = simulate(soft, pattern_of(8), control=OPEN_LOOP)
    errors = [x.summary()["zmp_error_rms_mm"]["x"] for x in (closed, loose)]
    assert errors[1] > 2.0 * errors[0]


def test_open_loop_on_stiff_servos_is_allowed():
    run = simulate(paper(), pattern_of(2), control=OPEN_LOOP)
    assert run.outcome.ok
    assert np.array_equal(run.log["com_command"], run.log["com_ref"][:, :2])


@pytest.mark.parametrize(
    "gait",
    [
        {"half_step": -0.08},
        {"half_step": 0.0, "lateral": 0.05},
        {"half_step": 0.0, "turn": 0.3},
        {"half_step": 0.08, "turn": 0.2},
        {"double_support": "minjerk"},
    ],
    ids=["back", "side", "turn", "curve", "minjerk"],
)
def test_any_walk(gait):
    """Back, sideways, turning, a curve: the robot ends where and as it should."""
    run = simulate(paper(), pattern_of(4, **gait))
    figures = run.summary()
    assert run.outcome.ok
    assert figures["position_error_m"] < 0.01
    assert abs(figures["heading_error_deg"]) < 1.0
    assert figures["com_error_rms_mm"]["true"]["x"] < 6.0


def test_uneven_footsteps_and_timings():
    """An explicit list of footsteps, each of its own length and time."""
    plan = FootstepPlan(
        left=Foothold(0.0, 0.09, 0.0),
        right=Foothold(0.0, -0.09, 0.0),
        steps=(
            Footstep(side=Side.RIGHT, x=0.12, y=-0.10),
            Footstep(side=Side.LEFT, x=0.30, y=0.08, yaw=0.15, single_support=1.1),
            Footstep(side=Side.RIGHT, x=0.38, y=-0.13, yaw=0.2, double_support=0.4),
            Footstep(side=Side.LEFT, x=0.36, y=0.08, yaw=0.2, single_support=0.6),
        ),
    )
    run = simulate(paper(), make_pattern(plan, Pendulum()))
    assert run.outcome.ok
    assert run.summary()["position_error_m"] < 0.01


@pytest.mark.parametrize("place", [(0.4, 0.0, 0.0), (30.0, -5.0, 2.36), (1e3, 0, 3.2)])
def test_a_plan_is_walked_wherever_it_is(place):
    """Far from the origin and turned, just as at the origin."""
    x, y, yaw = place
    c, s = np.cos(yaw), np.sin(yaw)

    def at(side: Side, a: float) -> dict:
        b = 0.09 * side.sign
        return {"x": x + c * a - s * b, "y": y + s * a + c * b, "yaw": yaw}

    left, right = (Foothold(**at(side, 0.0)) for side in Side)
    steps = (Side.RIGHT, 0.15), (Side.LEFT, 0.15)
    plan = FootstepPlan(
        left=left,
        right=right,
        steps=tuple(Footstep(side=side, **at(side, a)) for side, a in steps),
    )
    run = simulate(paper(), make_pattern(plan, Pendulum()))
    assert run.outcome.ok
    figures = run.summary()
    assert figures["position_error_m"] < 1e-3
    assert max(figures["com_error_rms_mm"]["true"].values()) < 3.0


def dance(name="paper", amplitude=0.5, frequency=0.5, seconds=6.0, walking=None, **kw):
    robot = paper()
    home = robot.home_angles
    motion = prepare_motion(
        builtin_motion(name, amplitude=amplitude, frequency=frequency, home=home),
        allowed=robot.upper_body,
        limits=robot.joint_limits,
        home=home,
    )
    plan = FootstepPlan(
        left=Foothold(0.0, 0.09, 0.0),
        right=Foothold(0.0, -0.09, 0.0),
        stand_time=seconds / 2,
    )
    pattern = walking or make_pattern(plan, Pendulum())
    embedded = embed_in(motion, home, start=0.2, stop=pattern.duration - 0.2)
    return simulate(robot, pattern, motion=embedded, **kw)


def zmp_excursion(run):
    settled = (run.log["t"] > 1.3) & (run.log["t"] < run.log["t"][-1] - 1.3)
    return np.abs(run.log["zmp"][settled] - run.log["zmp_ref"][settled]).max()


def test_dance_keeps_zmp_within_ten_millimetres():
    """Fig. 6: CoM held, ZMP inside +-10 mm, far better than with unaware legs."""
    run = dance()
    log = run.log
    assert run.outcome.ok
    assert zmp_excursion(run) < 0.010
    assert np.abs(log["com_command"] - log["com_ref"][:, :2]).max() < 1e-3
    assert np.abs(log["com_true"] - log["com_ref"]).max() < 3e-3
    unaware = dance(control=Control(body=BodySettings(embed_motion=False)))
    assert zmp_excursion(unaware) > 4 * zmp_excursion(run)
    # The arms did dance, in both.
    elbow = paper().joints.index("l_elbow_pitch")
    for each in (run, unaware):
        assert np.ptp(each.log["joints"][:, elbow]) > 0.1


def test_fast_dance_and_dance_while_walking():
    """The ZMP stays at its reference as far as the paper's own dance allows."""
    still = dance("disco", frequency=1.0)
    assert still.outcome.ok
    assert still.summary()["zmp_error_max_mm"] < 10.0
    walking = dance("paper", frequency=1.0, walking=pattern_of(4))
    assert walking.outcome.ok
    figures = walking.summary()
    assert figures["steps_completed"] == 4
    assert figures["sole_margin_min_mm"] > 40.0
    assert figures["position_error_m"] < 2e-3


def test_pendulum_stays_within_the_exact_bound():
    """Eqs. (28), (38): bounded disturbances move the CoM by less than the exact bound.

    The loop is linear: what a disturbance does is the difference from a walk without.
    """
    gains = Gains(standing_zmp=(3.0, 1.8), standing_com=(6.6, 3.8))
    control = Control(gains=gains)
    calm = simulate_pendulum(pattern_of(4), control=control)
    largest = np.zeros(2)
    for seed in range(5):
        run = simulate_pendulum(
            pattern_of(4),
            control=control,
            disturbance=random_bounded(0.05, 0.5, seed, duration=12.0),
        )
        assert run.outcome.ok
        moved = np.abs(run.log["com"] - calm.log["com"])[:, :2]
        largest = np.maximum(largest, moved.max(axis=0))
    assert largest[0] < 0.0172
    assert largest[1] < 0.0250
    assert largest.min() > 0.005  # a bound that is never approached proves little


def test_pushed_and_noisy_walk_completes(short):
    assert short.outcome.ok
    pushed = np.abs(short.log["xfrc_applied"]).max(axis=(1, 2)) > 0
    assert pushed.sum() == 50
    assert short.log["t"][np.flatnonzero(pushed)[0]] == pytest.approx(2.0)


def test_a_hard_push_is_a_fall_with_time_phase_and_cause():
    push = Push(start=2.0, force=(0.0, 900.0, 0.0), duration=0.2)
    run = simulate(paper(), pattern_of(4), physics=SimulatorSettings(pushes=(push,)))
    assert run.outcome.end is End.FELL
    assert 2.0 < run.outcome.time < 4.5
    figures = run.summary()
    assert figures["outcome"] == "fell"
    assert figures["cause"]
    json.dumps(figures, allow_nan=False)


def test_saved_run_replays_with_mujoco_alone(short, tmp_path):
    folder = short.save(tmp_path / "run")
    names = {"summary.json", "run.npz", "scene.mjb", "walk.png"}
    assert names <= {path.name for path in folder.iterdir()}
    result = replay(folder)
    assert result.ticks == len(short.log)
    assert result.position_difference == 0.0
    assert result.velocity_difference == 0.0


def test_replay_by_a_stranger(short, tmp_path):
    """Nothing of comwalk: load the model, set the first state, apply ctrl."""
    folder = short.save(tmp_path / "run")
    model = mujoco.MjModel.from_binary_path(str(folder / "scene.mjb"))
    data = mujoco.MjData(model)
    record = dict(np.load(folder / "run.npz"))
    data.qpos[:], data.qvel[:] = record["qpos"][0], record["qvel"][0]
    for k in range(len(record["t"]) - 1):
        data.ctrl[:] = record["ctrl"][k]
        data.xfrc_applied[:] = record["xfrc_applied"][k]
        for _ in range(int(record["substeps"])):
            mujoco.mj_step(model, data)
    assert np.abs(data.qpos - record["qpos"][-1]).max() < 1e-12


def test_broken_recordings_are_refused(short, tmp_path):
    with pytest.raises(RunError, match=r"no run\.npz"):
        replay(tmp_path)
    folder = short.save(tmp_path / "run")
    (folder / "run.npz").write_bytes(b"PK nonsense")
    with pytest.raises(RunError, match="broken"):
        replay(folder)
    np.savez(folder / "run.npz", t=np.zeros(3))
    with pytest.raises(RunError, match="lacks"):
        replay(folder)
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="cannot write"):
        short.save(tmp_path / "file" / "run")


def test_runs_repeat_exactly():
    physics = SimulatorSettings(noise=1.0)
    one, two, other = (
        simulate(paper(), pattern_of(1), physics=physics, seed=seed)
        for seed in (7, 7, 8)
    )
    assert np.array_equal(one.log["qpos"], two.log["qpos"])
    assert not np.array_equal(one.log["qpos"], other.log["qpos"])


def test_resolution_stays_exact_while_walking(walk20):
    """No joint meets a limit, and nothing is lost, on the paper's gait."""
    figures = walk20.summary()
    assert figures["joint_speed_max_pct"] < 100.0
    tracked = walk20.log["com_command"] - walk20.log["com"][:, :2]
    assert np.abs(tracked).max() < 5e-3


def test_unstable_gains_are_refused_before_anything_moves():
    with pytest.raises(ParameterError, match="must be below"):
        simulate(paper(), pattern_of(1), control=Control(gains=Gains(zmp=7.0, com=6.6)))


def test_out_of_reach_plans_are_refused():
    with pytest.raises(PlanError, match=r"footstep \d+ is out of reach"):
        simulate(paper(), pattern_of(4, half_step=0.2))
    tall = make_pattern(plan_steps(Gait(), 2), Pendulum(height=0.8))
    with pytest.raises(PlanError, match="reach"):
        simulate(paper(), tall)


def test_period_must_fit_the_physics_step():
    with pytest.raises(ParameterError, match="multiple of the physics step"):
        simulate(paper(), pattern_of(1), control=Control(period=0.0025))


@pytest.mark.parametrize(
    "bad",
    [
        {"start": -1.0, "force": (0, 0, 0)},
        {"start": 0.0, "force": (0, np.nan, 0)},
        {"start": 0.0, "force": (0, 0)},
        {"start": 0.0, "force": (0, 0, 0), "duration": 0.0},
    ],
)
def test_bad_pushes(bad):
    with pytest.raises(ParameterError, match="push"):
        Push(**bad)


def test_interrupt_is_an_outcome():
    def interrupt(time):
        if time > 0.4:
            raise KeyboardInterrupt

    run = simulate(paper(), pattern_of(1), progress=interrupt)
    assert run.outcome.end is End.ABORTED
    assert "user" in run.outcome.cause


class Stub:
    """A plant that reads what it is told; it records how it was stopped."""

    period = 0.002

    def __init__(self, joint_names, **broken):
        self.joint_names, self.broken, self.reason = joint_names, broken, None

    def start(self, command):
        self.command = command
        return self.read()

    def write(self, command):
        self.command = command

    def read(self):
        weight = paper().mass * 9.81
        ankle = np.array([0.0, 0.0, weight / 2, 0.0, 0.0, 0.0])
        reading = {
            "time": 0.0,
            "positions": self.command.positions.copy(),
            "velocities": np.zeros(len(self.joint_names)),
            "wrenches": np.array([ankle, ankle]),
            "orientation": np.array([1.0, 0.0, 0.0, 0.0]),
            "gyro": np.zeros(3),
            "acceleration": np.zeros(3),
        }
        return Sensors(**{**reading, **self.broken})

    def stop(self, reason):
        self.reason = reason


def walk_stub(plant):
    robot, period = paper(), Stub.period
    body, controller = WholeBody(robot, period), WalkingController(period=period)
    return walk(pattern_of(1), controller, body, plant), body


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        ({"positions": np.full(30, np.nan)}, "encoders"),
        ({"wrenches": np.full((2, 6), np.inf)}, "ankle sensors"),
        ({"orientation": np.full(4, np.nan)}, "IMU"),
    ],
)
def test_sensors_that_read_no_numbers_abort(broken, cause):
    plant = Stub(paper().joints, **broken)
    outcome, _ = walk_stub(plant)
    assert outcome.end is End.ABORTED
    assert cause in outcome.cause
    assert plant.reason == outcome.cause


def test_a_lifted_robot_stops():
    """In the air the feet feel nothing: after a moment that is the end."""
    plant = Stub(paper().joints, wrenches=np.zeros((2, 6)))
    plant.broken["wrenches"][:, 2] = 300.0
    read, calls = plant.read, iter(range(10**6))

    def lifted():
        if next(calls) > 50:
            plant.broken["wrenches"] = np.zeros((2, 6))
        return read()

    plant.read = lifted
    outcome, _ = walk_stub(plant)
    assert outcome.end is End.FELL
    assert "lost the ground" in outcome.cause
    assert 0.25 < outcome.time < 0.4


def test_a_tilted_trunk_is_a_fall():
    tilted = np.array([np.cos(0.35), np.sin(0.35), 0.0, 0.0])
    outcome, _ = walk_stub(Stub(paper().joints, orientation=tilted))
    assert outcome.end is End.FELL
    assert "tilted by 40 deg" in outcome.cause


def test_joints_in_another_order_are_refused():
    with pytest.raises(ModelError, match="joint 1 is l_hip_yaw"):
        walk_stub(Stub(paper().joints[::-1]))


def test_commanded_posture_turns_with_the_plan():
    """Heading and swing foot follow their rates: no lag behind the feedback."""
    pattern = pattern_of(4, half_step=0.0, turn=0.3)
    run = simulate(paper(), pattern)
    data = mujoco.MjData(run.scene)
    joints = slice(7, None)
    errors = []
    for k in range(0, len(run.log), 50):
        data.qpos[:] = run.log["qpos"][k]
        mujoco.mj_kinematics(run.scene, data)
        R = data.xmat[1].reshape(3, 3)
        errors.append(np.arctan2(R[1, 0], R[0, 0]) - run.log["heading_ref"][k])
    assert np.ptp(run.log["heading_ref"]) > 1.0
    assert np.abs(errors).max() < 0.006
    assert run.log["qpos"][:, joints].shape[1] == len(paper().joints)


def test_commanded_arm_follows_the_dance():
    """The rate feed-forward: the commanded arm is where the dance is, not behind."""
    robot, home, period = paper(), paper().home_angles, 0.002
    dance = builtin_motion("paper", amplitude=0.5, frequency=1.0, home=home)
    embedded = embed_in(dance, home, start=0.0)
    body = WholeBody(robot, period, embedded)
    pattern = pattern_of(4)
    body.start(pattern.at(0.0))
    j = [robot.joints.index(name) for name in embedded.joints]
    for k in range(600):
        reference = pattern.at(k * period)
        body.act(ControlOutput.still(reference), reference)
    wanted, rates = embedded.at(600 * period)
    assert np.abs(rates).max() > 0.5
    assert np.abs(body.configuration[7:][j] - wanted).max() < 1e-3


def test_joint_limits_bind_while_walking():
    """A knee that may not bend further stops there, and the record says so."""
    robot = paper()
    knee = robot.joints.index("l_knee_pitch")
    upper = robot.upper.copy()
    upper[knee] = robot.home[7 + knee] + 0.05
    tight = dataclasses.replace(robot, upper=upper)
    run = simulate(tight, pattern_of(2), force=True)
    assert run.log["limited"].max() >= 1
    assert run.log["loss"].max() > 0
    assert run.summary()["joint_limits_met_pct"] > 0
    assert run.log["joints"][:, knee].max() < upper[knee] + 0.02


def test_sole_margin_agrees_with_the_contacts(walk20):
    """Each stance foot's pressure, by its ankle sensor and by the ground force."""
    log = walk20.log
    margins = sole_margins(log, paper())
    single = (log["phase"] == Phase.SINGLE_LEFT) | (log["phase"] == Phase.SINGLE_RIGHT)
    side = np.where(log["phase"] == Phase.SINGLE_LEFT, 0, 1)
    feet = log["feet_ref"][np.arange(len(log)), side, :2]
    inside = np.array([0.12, 0.065]) - np.abs(log["zmp_true"] - feet)
    true = inside.min(axis=1)
    rows = np.arange(len(log))
    weight = paper().mass * 9.81
    stance_load, swing_load = (log["loads_true"][rows, k] for k in (side, 1 - side))
    alone = single & (swing_load < 0.005 * weight) & (stance_load > 0.25 * weight)
    order = np.concatenate([np.flatnonzero(log["phase"] == p) for p in (3, 4)])
    order = order[alone[order]]
    assert len(order) == len(margins)
    assert len(order) > 0.9 * single.sum()
    bare = swing_load[order] < 1.0
    assert np.abs(margins - true[order])[bare].max() < 5e-3
    assert np.abs(margins - true[order]).max() < 12e-3


def test_zmp_averages_to_the_com_over_whole_steps(walk20):
    """Nothing accelerates on average, so neither may the pressure be biased."""
    log = walk20.log
    whole = (log["t"] >= 4.7) & (log["t"] < 14.7)
    for com, zmp in (("com_true", "zmp_true"), ("com", "zmp")):
        bias = (log[com][whole, :2] - log[zmp][whole]).mean(axis=0)
        assert np.abs(bias).max() < 1e-3


def test_wrong_kinds_say_what_to_call():
    with pytest.raises(ParameterError, match=r"make_pattern\(plan"):
        simulate(paper(), plan_steps(Gait(), 1))
    with pytest.raises(ParameterError, match="load_robot"):
        simulate("paper", pattern_of(1))
    with pytest.raises(ParameterError, match="embed_in"):
        simulate(paper(), pattern_of(1), motion=builtin_motion("paper"))


def test_a_fall_before_the_first_tick_is_saved(tmp_path):
    """With its one row, its picture and its figures."""
    run = simulate(paper(), walk_pattern(paper(), 2), watch=Watch(com_error=1e-9))
    assert run.outcome.end is End.FELL
    assert len(run.log["t"]) == 1
    folder = run.save(tmp_path / "run")
    told = json.loads((folder / "summary.json").read_text())
    assert (told["outcome"], told["time_s"]) == ("fell", 0.0)
    assert (folder / "walk.png").stat().st_size > 1e4


@pytest.mark.parametrize("height", [0.4, 0.687, 1.5])
def test_a_fall_is_as_far_off_as_the_robot_is_tall(height):
    """0.3 m for the paper's robot, and to scale for others; told in the cause."""
    scale = height / 0.687
    gait = Gait(half_step=0.0)
    run = simulate_pendulum(
        make_pattern(plan_steps(gait, 4), Pendulum(height=height)),
        control=OPEN_LOOP,
        disturbance=constant_disturbance((0.2 * scale, 0.0)),
    )
    assert run.outcome.end is End.FELL
    off = np.hypot(*(run.log["com"] - run.log["com_ref"])[:, :2].T).max()
    assert off == pytest.approx(0.3 * scale, abs=0.2 * scale * 0.002)


def test_on_the_moon_soles_bear_the_weight_of_the_moon(tmp_path):
    """The file's gravity is that of the plan, of the controller and of the physics."""
    moon = tmp_path / "moon.xml"
    option = '<option gravity="0 0 -1.62"/>'
    text = read_model(write(tmp_path)).spec.to_xml()
    moon.write_text(text.replace("<worldbody>", option + "<worldbody>", 1))
    run = build_walk(WalkConfig(robot=str(moon), steps=2)).run()
    assert run.outcome.ok
    assert run.pattern.pendulum.gravity == pytest.approx(1.62)
    forces = run.log["wrenches_true"][..., 2].sum(axis=1)
    feet = sum(foot.mass for foot in run.robot.feet.values())
    assert forces.mean() == pytest.approx(1.62 * (run.robot.mass - feet), rel=0.02)
