"""The command line: exit codes, what is printed, what is written, what is refused."""

import contextlib
import errno
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import pytest
from models import urdf
from pictures import inked

from comwalk.cli import app as cli
from comwalk.cli import output
from comwalk.cli.app import main
from comwalk.errors import ModelError
from comwalk.runs.columns import Log
from comwalk.walking.mujoco_plant import SimulatedRobot

SHORT = [
    *("--steps", "2", "--gait.period", "0.8"),
    *(
        "--gait.stand-time",
        "0.1",
        "--gait.start-time",
        "0.8",
        "--gait.stop-time",
        "0.8",
    ),
]
KEYS = {
    *("outcome", "steps_completed", "distance_m", "heading_error_deg"),
    *("position_error_m", "com_error_rms_mm", "zmp_error_rms_mm", "zmp_error_max_mm"),
    *("sole_margin_min_mm", "sole_margin_p5_mm", "trunk_tilt_max_deg"),
    *("torque_saturation_pct", "real_time_factor", "tick_us_p50", "tick_us_p99"),
    *("versions", "settings"),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys, *words):
    """Return the one line with which a command line is refused."""
    assert main(list(words)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("comwalk: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


# ---- What works -------------------------------------------------------------------


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a short walk."""
    folder = tmp_path_factory.mktemp("runs") / "deep" / "walk"
    assert main(["walk", *SHORT, "--seed", "7", "--out", str(folder)]) == 0
    return folder


def test_a_walk_writes_its_folder(run):
    summary = json.loads((run / "summary.json").read_text())
    assert set(summary) >= KEYS
    assert summary["outcome"] == "completed"
    assert set(summary["com_error_rms_mm"]) == {"true", "measured"}
    assert summary["settings"]["config"]["seed"] == 7
    assert summary["settings"]["command"].startswith("comwalk walk --steps 2")
    with np.load(run / "run.npz") as columns:
        assert {"t", "qpos", "qvel", "ctrl", "substeps", "phase"} <= set(columns)
    assert mujoco.MjModel.from_binary_path(str(run / "scene.mjb")).nq == 37
    assert (run / "walk.png").read_bytes().startswith(b"\x89PNG")


def test_a_walk_prints_a_short_table(run, capsys):
    assert main(["replay", str(run)]) == 0
    out = capsys.readouterr().out
    for words in (
        "completed",
        "2 of 2",
        "CoM error rms, true",
        "sole margin",
        str(run),
    ):
        assert words in "".join(out.splitlines())


def test_a_replay_is_verified(run, capsys):
    assert main(["replay", str(run), "--verify"]) == 0
    assert "verified" in capsys.readouterr().out
    assert main(["replay", str(run), "--verify", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["verified"] is True
    assert result["position_difference"] <= 1e-6


def test_a_forged_run_is_not_verified(run, tmp_path, capsys):
    with np.load(run / "run.npz") as file:
        columns = dict(file)
    columns["ctrl"] = columns["ctrl"] + 1e-3
    np.savez(tmp_path / "run.npz", allow_pickle=False, **columns)
    (tmp_path / "scene.mjb").write_bytes((run / "scene.mjb").read_bytes())
    assert main(["replay", str(tmp_path), "--verify"]) == 1
    assert "NOT" in capsys.readouterr().out


def test_a_summary_repeats_its_run(run, here, capsys):
    words = ["walk", "--config", str(run / "summary.json"), "--out", "again", "--json"]
    assert main(words) == 0
    again = json.loads(capsys.readouterr().out)
    first = json.loads((run / "summary.json").read_text())
    for key in ("distance_m", "com_error_rms_mm", "zmp_error_max_mm"):
        assert again[key] == first[key]
    assert again["settings"]["config"] == first["settings"]["config"]


def test_json_is_the_summary_and_nothing_else(here, capsys):
    assert main(["walk", *SHORT, "--plant", "pendulum", "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    (folder,) = (here / "runs").iterdir()
    assert folder.name.endswith("-walk")
    assert summary == json.loads((folder / "summary.json").read_text())
    assert err == ""


def test_a_file_and_flags_go_together(here, capsys):
    text = 'plant = "pendulum"\nsteps = 9\n[gains]\nzmp = [2, 1]'
    (here / "w.toml").write_text(text)
    assert main(["walk", *SHORT, "--config", "w.toml", "--json"]) == 0
    config = json.loads(capsys.readouterr().out)["settings"]["config"]
    assert (config["plant"], config["steps"]) == ("pendulum", 2)
    assert config["gains"]["zmp"] == [2.0, 1.0]


def test_a_terminal_shows_a_progress_bar_but_not_with_json(here, capsys, monkeypatch):
    words = ["walk", *SHORT, "--plant", "pendulum", "--out", "w"]
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main([*words, "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["outcome"] == "completed"
    assert err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "completed" in out
    assert " of 4.4 s" in err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["3"], [3.0, 3.0]),
        (["3", "1.8"], [3.0, 1.8]),
        (["3,1.8"], [3.0, 1.8]),
        (["0"], [0.0, 0.0]),
    ],
)
def test_one_gain_serves_both_axes_and_two_are_x_and_y(here, capsys, words, expected):
    fixed = [*SHORT, "--plant", "pendulum", "--json", "--gains.com", "6.6", "5"]
    assert main(["walk", *fixed, "--gains.zmp", *words]) == 0
    config = json.loads(capsys.readouterr().out)["settings"]["config"]
    assert config["gains"]["zmp"] == expected
    assert config["gains"]["com"] == [6.6, 5.0]


def test_underscores_and_hyphens_are_the_same(here, capsys):
    words = [
        "walk",
        *SHORT,
        "--plant",
        "pendulum",
        "--json",
        "--gait.half_step",
        "0.05",
    ]
    assert main([*words, "--gains.standing_zmp", "0.2"]) == 0
    config = json.loads(capsys.readouterr().out)["settings"]["config"]
    assert config["gait"]["half_step"] == 0.05
    assert config["gains"]["standing_zmp"] == [0.2, 0.2]


@pytest.mark.parametrize("word", ["none", "inf"])
def test_none_stands_against_a_file(here, capsys, word):
    (here / "w.toml").write_text(
        'plant = "pendulum"\ndisturbance = 0.01\n[control]\nzmp_cutoff = 3'
    )
    words = ["--config", "w.toml", "--json", "--disturbance", "none"]
    gains = ["--gains.zmp", "0", "--gains.com", "0", "--control.zmp-cutoff", word]
    assert main(["walk", *SHORT, *words, *gains]) == 0
    config = json.loads(capsys.readouterr().out)["settings"]["config"]
    assert config["control"]["zmp_cutoff"] == "none"
    assert "disturbance" not in config


def test_a_dance_reports_how_still_the_com_is(here, capsys):
    words = ["--duration", "3", "--blend", "0.8", "--out", "d", "--json"]
    assert main(["dance", *words]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["zmp_deviation_max_mm"]["x"] < 10.0
    assert set(summary["com_deviation_max_mm"]) == {"commanded", "measured", "true"}
    assert summary["com_deviation_max_mm"]["true"]["x"] < 3.0
    assert summary == json.loads((here / "d" / "summary.json").read_text())
    assert inked(here / "d" / "dance.png") > 0.02


def test_a_dance_that_is_too_large_is_made_to_fit(here, capsys):
    words = ["--amplitude", "2.4", "--duration", "3", "--out", "d"]
    assert main(["dance", *words, "--json"]) == 0
    (note,) = json.loads(capsys.readouterr().out)["settings"]["notes"]
    assert "l_elbow_pitch moves 0.812 times as far" in note
    assert main(["replay", "d"]) == 0
    assert "made to fit" in " ".join(capsys.readouterr().out.split())


def test_a_speed_chooses_the_gait_and_is_repeated(here, capsys):
    words = ["walk", "--plant", "pendulum", "--json", "--steps", "2"]
    assert main([*words, "--speed", "0.3", "--turn", "5"]) == 0
    settings = json.loads(capsys.readouterr().out)["settings"]
    assert settings["config"]["speed"] == 0.3
    first, second = settings["plan"]["steps"][:2]
    period = first["single_support"] + first["double_support"]
    assert second["x"] / (2 * period) == pytest.approx(0.3, rel=0.05)
    assert second["yaw"] == pytest.approx(2 * period * math.radians(5), rel=0.01)
    (folder,) = (here / "runs").iterdir()
    summary = str(folder / "summary.json")
    assert main(["walk", "--config", summary, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["settings"]["plan"] == settings["plan"]


def test_the_figures_of_a_dance_are_the_largest_distances():
    from comwalk.runs.summary import dance_figures

    log = {
        "com_ref": np.zeros((3, 3)),
        "com": np.array([[0.001, 0, 1], [-0.003, 0.002, 1], [0, 0, 1]]),
        "com_command": np.zeros((3, 2)),
        "zmp": np.array([[0.001, 0.004], [0.002, 0], [0, 0]]),
    }
    figures = dance_figures(log)  # type: ignore[arg-type]
    assert figures["zmp_deviation_max_mm"] == pytest.approx({"x": 2.0, "y": 4.0})
    deviations = figures["com_deviation_max_mm"]
    assert deviations["measured"] == pytest.approx({"x": 3.0, "y": 2.0})
    assert deviations["commanded"] == {"x": 0.0, "y": 0.0}
    assert "true" not in deviations


def test_the_pattern_has_the_papers_numbers(here, capsys):
    """Eqs. (6)-(8), (11)-(13): golden numbers."""
    assert main(["pattern", "--json", "--out", "p"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["K_x_m"] == pytest.approx(0.02940505564082988, rel=1e-12)
    assert numbers["K_y_m"] == pytest.approx(0.02297677952541488, rel=1e-12)
    assert numbers["C_y2_m"] == pytest.approx(0.06080412201224397, rel=1e-12)
    assert inked(here / "p" / "pattern.png") > 0.02
    assert main(["pattern"]) == 0
    assert "0.0294051" in capsys.readouterr().out


def test_a_check_tells_what_is_nearest_to_a_limit(here, capsys):
    assert main(["check", "--steps", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["used", "what", "of", "asked", "limit", "unit", "at"]
    assert lines[-2] == "it fits"
    assert (
        "no controller catches a push of 0.1 s above 1.29 m/s forward, 1.75"
        in lines[-1]
    )
    assert main(["check", "--steps", "3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    shares = [d["share"] for d in result["demands"]]
    assert result["ok"]
    assert shares == sorted(shares, reverse=True)
    assert result["nearest"] == []
    assert list(here.iterdir()) == []


def test_a_check_tells_what_would_fit(here, capsys):
    assert main(["check", "--steps", "3", "--gait.half-step", "0.16"]) == 1
    assert "it does not fit; it would fit with" in capsys.readouterr().out
    assert main(["check", "--gait.half-step", "0.16", "--steps", "3", "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert not result["ok"]
    amounts = [change["amount"] for change in result["nearest"]]
    assert amounts == sorted(amounts)
    assert amounts


def test_a_walk_that_does_not_fit_is_refused_unless_forced(here, capsys):
    words = ["walk", *SHORT[2:], "--steps", "1", "--gait.half-step", "0.15"]
    line = refused(capsys, *words)
    assert "straight" in line
    assert "it would fit with" in line
    assert "--force" in line
    assert list(here.iterdir()) == []
    assert main([*words, "--force"]) in (0, 1)
    assert "outcome" in capsys.readouterr().out


def test_motions_are_listed_and_described(here, capsys):
    assert main(["motions", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {"paper", "wave", "disco"} <= {row["name"] for row in rows}
    assert main(["motions", "paper", "--json"]) == 0
    lowest = {r["joint"]: r["lowest_rad"] for r in json.loads(capsys.readouterr().out)}
    assert lowest["l_elbow_pitch"] == -0.5
    (here / "m.csv").write_text("time,neck\n0,0\n1,0.5")
    assert main(["motions", "m.csv"]) == 0
    assert "neck" in capsys.readouterr().out


def test_robots_are_listed(capsys):
    assert main(["robots", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["paper"]["installed"] == "yes"
    assert {row["installed"].split()[0] for row in rows.values()} <= {"yes", "pip"}
    assert main(["robots"]) == 0
    assert "67.68" in capsys.readouterr().out


def test_a_robot_that_is_missing_is_listed_with_the_remedy(capsys, monkeypatch):
    from comwalk.robot import loaders as model_files

    def missing(name, **options):
        raise ModelError("not there")

    monkeypatch.setattr(model_files, "read_model", missing)
    assert main(["robots", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["talos"]["installed"] == "pip install example-robot-data"
    assert "TALOS" in rows["talos"]["what"]


def test_figures_are_drawn_with_their_numbers(here, capsys, monkeypatch):
    from comwalk.cli import figures

    def draw(folder, progress=None):
        (folder / "fig3.png").write_bytes(b"")
        return {"fig3": {"K_x": {"paper": None, "ours": 0.0294, "unit": "m"}}}

    monkeypatch.setattr(figures, "draw_figures", draw)
    assert main(["figures", "--out", "f"]) == 0
    assert "0.0294" in capsys.readouterr().out
    assert (here / "f" / "fig3.png").exists()
    assert main(["figures", "--out", "f", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fig3"]["K_x"]["ours"] == 0.0294


# ---- Help -------------------------------------------------------------------------


def test_help_names_all_commands(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for name in (
        "walk",
        "check",
        "dance",
        "pattern",
        "figures",
        "motions",
        "robots",
        "replay",
    ):
        assert name in out
    assert main([]) == 0
    assert "walk" in capsys.readouterr().out


def test_help_explains_every_flag_with_its_unit(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["walk", "--help"]) == 0
    out = capsys.readouterr().out
    for text in (
        *(
            "--gait.half-step",
            "--gains.zmp",
            "--control.zmp-cutoff",
            "--pendulum.height",
        ),
        *("--simulator.friction", "--body.feedback", "--push", "--config", "--seed"),
        *(
            "Time of one step, T [s], in [0.15, 10]",
            "(default: the robot's; paper 3, 1.8)",
            "Turning speed, left positive [deg/s]",
            "k_p (x, y) [1/s]",
        ),
    ):
        assert text in out
    assert "simulator.pushes" not in out


@pytest.mark.parametrize(
    ("words", "absent"),
    [
        ("['--help']", ("mujoco", "matplotlib", "scipy", "numpy")),
        ("['--version']", ("mujoco", "matplotlib", "scipy", "numpy")),
        ("['walk', '--help']", ("mujoco", "matplotlib")),
        ("['walk', '--gait.period', '-1']", ("mujoco", "matplotlib")),
    ],
)
def test_heavy_imports_wait_for_the_commands(words, absent):
    code = (
        f"import sys; from comwalk.cli import main; main({words}); "
        f"print([m for m in {absent} if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_module_runs_as_a_program():
    words = [sys.executable, "-m", "comwalk", "wlk"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert 'Did you mean "walk"' in done.stderr
    assert done.stderr.count("\n") == 1


# ---- What ends badly --------------------------------------------------------------


def test_a_fall_is_reported_and_saved(here, capsys):
    words = ["walk", *SHORT, "--push", "1.5:2000,0,0:0.3", "--out", "fall"]
    assert main(words) == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "fell at" in out
    assert "phase" in out
    summary = json.loads((here / "fall" / "summary.json").read_text())
    assert summary["outcome"] == "fell"
    assert summary["cause"]
    with np.load(here / "fall" / "run.npz") as columns:
        assert columns["xfrc_applied"].any()
    assert main(["replay", "fall", "--verify"]) == 0


def test_an_interrupted_walk_is_saved(here, capsys, monkeypatch):
    grow = Log.grow

    def interrupted(self, rows):
        grow(self, rows)
        if rows == 101:
            raise KeyboardInterrupt

    monkeypatch.setattr(Log, "grow", interrupted)
    assert main(["walk", *SHORT, "--out", "stopped"]) == 1
    out, err = capsys.readouterr()
    assert "aborted" in out
    assert err == ""
    summary = json.loads((here / "stopped" / "summary.json").read_text())
    assert (summary["outcome"], summary["time_s"]) == ("aborted", 0.2)


def test_an_interrupt_before_the_walk_leaves_nothing(here, capsys, monkeypatch):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedRobot, "place", interrupted)
    assert main(["walk", *SHORT]) == 130
    assert capsys.readouterr().err == "comwalk: interrupted\n"
    assert list(here.iterdir()) == []


def test_an_interrupted_import_is_no_crash(capsys, monkeypatch):
    def interrupted():
        raise ImportError("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr(cli, "_app", interrupted)
    assert main(["walk"]) == 130
    assert capsys.readouterr().err == "comwalk: interrupted\n"


def test_too_little_memory_is_said(here, capsys, monkeypatch):
    def exhausted(*args, **kwargs):
        raise MemoryError

    monkeypatch.setattr(SimulatedRobot, "place", exhausted)
    assert "memory" in refused(capsys, "walk", *SHORT)
    assert list(here.iterdir()) == []


def test_a_closed_pipe_is_no_error(monkeypatch):
    def closed(*args, **kwargs):
        raise BrokenPipeError

    monkeypatch.setattr(output, "print_table", closed)
    monkeypatch.setattr(cli.os, "dup2", lambda *args: None)
    assert main(["motions"]) == 1


# ---- What is refused --------------------------------------------------------------

WRONG_WORDS = [
    ("wlk", 'Did you mean "walk"'),
    ("walk ppaper", 'did you mean "paper"'),
    ("walk missing.xml", "does not exist"),
    ("walk broken.xml", "broken.xml"),
    ("walk binary.xml", "binary.xml"),
    ("walk empty.xml", "empty.xml"),
    ("walk bare.xml", "no bodies"),
    ("walk folder/", "folder"),
    ("walk paper second", 'unexpected "second"'),
    ("walk --gaits.period 1", "--gait.period"),
    ("walk --gait.perod 1", "--gait.period"),
    ("walk --gait.period", "requires an argument"),
    ("walk --gait.period abc", "--gait.period"),
    ("walk --gait.period nan", "gait.period must be a number in [0.15, 10] s"),
    ("walk --gait.period inf", "gait.period"),
    ("walk --gait.period -1", "gait.period"),
    ("walk --gait.transfer-time 0.6", "gait.transfer_time"),
    ("walk --gait.half-step nan", "gait.half_step"),
    ("walk --gait.half-step 3", "gait.half_step"),
    ("walk --gait.half-step 0.2 --gait.period 1", "out of reach"),
    ("walk --gait.half-width 0.05", "soles"),
    ("walk --gait.double-support papr", '"paper"'),
    ("walk --gains.zmp nan", "gains.zmp"),
    ("walk --gains.zmp inf", "gains.zmp"),
    ("walk --gains.zmp -1", "gains.zmp"),
    ("walk --gains.zmp abc", "--gains.zmp"),
    ("walk --gains.zmp 3 2 1", "--gains.zmp"),
    ("walk --gains.zmp none", "gains.zmp"),
    ("walk --control.zmp-cutoff abc", "--control.zmp-cutoff"),
    ("walk --gains.zmp 7", "0 < k_p < k_c"),
    ("walk --gains.zmp 6 --gains.com 6.5 --control.zmp-cutoff 50", "unstable"),
    ("walk --control.zmp-cutoff nan", "control.zmp_cutoff"),
    ("walk --control.delay 2.5", "--control.delay"),
    ("walk --control.delay -1", "control.delay"),
    ("walk --control.max-offset 0", "control.max_offset"),
    ("walk --body.feedback 1e9", "body.feedback"),
    ("walk --simulator.timestep 0", "simulator.timestep"),
    ("walk --simulator.friction -1", "simulator.friction"),
    ("walk --simulator.noise nan", "simulator.noise"),
    ("walk --pendulum.height nan", "pendulum.height"),
    ("walk --pendulum.height 20", "pendulum.height"),
    ("walk --pendulum.height 0.9", "out of reach"),
    ("walk --pendulum.height 0.2", "pendulum.height"),
    ("walk --plan missing.toml", "missing.toml"),
    ("walk --plan broken.toml", "not valid TOML"),
    ("walk --plan key.toml", '"period"'),
    ("walk --plan cross.toml", "cross"),
    ("walk --plan far.toml", "out of reach"),
    ("walk --plan binary.xml", "binary.xml"),
    ("walk --plan folder", "folder"),
    ("walk --motion papr", 'did you mean "paper"'),
    ("walk --motion missing.csv", "no such file"),
    ("walk --motion unknown.csv", "nose_pitch"),
    ("walk --motion nan.csv", "nan"),
    ("walk --motion past.csv", "its limit is"),
    ("walk --motion unsorted.csv", "must increase"),
    ("walk --motion empty.csv", "empty"),
    ("walk --motion legs.csv", "walking"),
    ("walk --motion binary.npz", "binary.npz"),
    ("walk --motion binary.xml", ".csv or .npz"),
    ("walk --motion paper --motion-amplitude 9", "motion_amplitude"),
    ("walk --motion paper --motion-frequency nan", "motion_frequency"),
    ("walk --speed 9", "speed must be a number in [-0.8, 0.8] m/s, got 9"),
    ("walk --speed abc", "--speed"),
    ("walk --speed nan", "speed must be"),
    ("walk --speed 0.2 --gait.half-step 0.1", "give speed or gait.half_step"),
    ("walk --turn 90", "that is +-68.8 deg/s"),
    ("walk --turn 9 --gait.turn 0.1", "give turn or gait.turn"),
    ("walk --side -5", "side must be a number in [-0.2, 0.2] m/s"),
    ("walk --plan key.toml --speed 0.1", "speed does nothing with a plan"),
    ("walk --out file", "File exists"),
    ("walk --out file/x", "Not a directory"),
    ("walk --out /proc/x", "/proc/x"),
    ("walk --push 3", "push"),
    ("walk --push 3:1,2", "push"),
    ("walk --push nan:1,2,3", "push"),
    ("walk --steps 0", "steps must be a whole number"),
    ("walk --steps -1", "steps must be a whole number"),
    ("walk --steps 1e9", "--steps"),
    ("walk --steps 1000000000", "steps must be a whole number"),
    ("walk --steps abc", "--steps"),
    ("walk --steps 2.5", "--steps"),
    ("walk --steps 2 --steps 3", "--steps"),
    ("walk --seed -1", "seed"),
    ("walk --seed x", "--seed"),
    ("walk --plant pendlum", '"pendulum"'),
    ("walk --plant pendulum --motion paper", "motion"),
    ("walk --plant pendulum --disturbance nan", "disturbance"),
    ("walk --disturbance 0.1", "disturbance"),
    ("walk --stiffness 0", "stiffness"),
    ("walk --stiffness nan", "stiffness"),
    ("walk --period nan", "period"),
    ("walk --period 0.0015", "multiple"),
    ("walk --config missing.toml", "missing.toml"),
    ("walk --config broken.toml", "not valid TOML"),
    ("walk --config stray.toml", "stray.toml: unknown key"),
    ("walk --config wrong.toml", "wrong.toml: gait.period"),
    ("check --plant pendulum", "check needs a robot"),
    ("check --out x", "--out"),
    ("check ppaper", 'did you mean "paper"'),
    ("dance --motion papr", 'did you mean "paper"'),
    ("dance --duration nan", "duration"),
    ("dance --duration 1", "too short"),
    ("dance --blend 0", "blend"),
    ("dance --frequency 9", "frequency"),
    ("dance --half-width 0.39", "pendulum.height"),
    ("dance --steps 3", "--steps"),
    ("pattern --gait.period 0", "gait.period"),
    ("pattern --out file", "File exists"),
    ("figures --out file", "File exists"),
    ("motions papr", 'did you mean "paper"'),
    ("motions missing.csv", "no such file"),
    ("robots paper", "unexpected"),
    ("replay", "requires an argument"),
    ("replay missing", "missing"),
    ("replay folder", "summary.json"),
    ("replay folder --verify", "run.npz"),
]

FILES = {
    "broken.xml": "<mujoco><bad/></mujoco>",
    "empty.xml": "",
    "bare.xml": "<mujoco/>",
    "broken.toml": "[[segment]",
    "key.toml": "[gait]\nperod = 1\n[[segment]]\nsteps = 2",
    "cross.toml": '[[footstep]]\nside = "right"\nx = 0.1\ny = 0.2',
    "far.toml": '[[footstep]]\nside = "right"\nx = 0.7\ny = -0.09',
    "stray.toml": "stepz = 4",
    "wrong.toml": "[gait]\nperiod = 100",
    "unknown.csv": "time,nose_pitch\n0,0\n1,1",
    "nan.csv": "time,l_elbow_pitch\n0,0\n1,nan",
    "past.csv": "time,l_elbow_pitch\n0,0\n9,-9",
    "unsorted.csv": "time,l_elbow_pitch\n0,0\n2,-0.1\n1,-0.2",
    "legs.csv": "time,l_knee_pitch\n0,0\n2,0.1",
    "empty.csv": "",
    "file": "x",
}


@pytest.fixture(scope="module")
def wrong_files(tmp_path_factory):
    """A folder of files that nothing can use."""
    folder = tmp_path_factory.mktemp("wrong")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    for name in ("binary.xml", "binary.npz"):
        (folder / name).write_bytes(bytes(range(256)))
    (folder / "folder").mkdir()
    return folder


@pytest.mark.parametrize(
    ("words", "part"), WRONG_WORDS, ids=[w for w, _ in WRONG_WORDS]
)
def test_bad_input_gives_one_clear_line(wrong_files, monkeypatch, capsys, words, part):
    monkeypatch.chdir(wrong_files)
    before = sorted(wrong_files.rglob("*"))
    assert part in refused(capsys, *words.split())
    assert sorted(wrong_files.rglob("*")) == before


# ---- A full disk ------------------------------------------------------------------


@contextlib.contextmanager
def little_space():
    """Files of 1 kB at most, as on a disk that is nearly full.

    No fixture: pytest writes its report, maybe to a longer file, before it ends one.
    """
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


WRITING = {
    "a walk": (["walk", *SHORT, "--out", "new"], "new/run"),
    "a dance": (["dance", "--out", "new"], "new/run"),
    "a pattern": (["pattern", "--out", "new"], "new/pattern.png"),
    "a certificate": (["certify", "--out", "new"], "new/certificate.json"),
    "a report": (["report", "{run}", "--out", "new.html"], "new.html"),
    "stills": (["film", "{run}", "new.png"], "new.png"),
    "a film": (["film", "{run}", "new.mp4", "--stop", "0.2"], "new.mp4"),
    "CSV": (["export", "{run}", "--csv", "--out", "new"], "new/csv"),
    "Parquet": (["export", "{run}", "--parquet", "--out", "new"], "new/parquet"),
    "rosbag2": (["export", "{run}", "--rosbag2", "--out", "new"], "run.mcap"),
    "a dataset": (["generate", "--count", "1", "--steps", "2"], "motions.npz"),
    "a profile": (["robot", "--write-profile", "new.toml"], "new.toml"),
    "a picture": (["robot", "--picture", "new.png"], "new.png"),
}


@pytest.mark.parametrize(("words", "file"), WRITING.values(), ids=WRITING)
def test_a_full_disk_is_told_with_the_file(run, here, capsys, words, file):
    """In one line that says what could not be written, and why."""
    (run / "run.mcap").unlink(missing_ok=True)
    with little_space():
        code = main([word.format(run=run) for word in words])
    assert code == 2
    error = capsys.readouterr().err
    assert file in error
    assert re.search("File too large|Invalid argument", error)
    assert error.count("comwalk: ") == 1
    assert "Traceback" not in error


def test_a_walk_that_cannot_be_saved_is_still_told(here, capsys, monkeypatch):
    """Its summary is printed, and its rows can be saved once there is space."""

    def full(path, data):
        if path.suffix == ".mjb":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, data)

    write = Path.write_bytes
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert main(["walk", *SHORT, "--out", "new"]) == 2
    out, error = capsys.readouterr()
    assert "2 of 2" in out
    assert "written to" not in out
    assert "new/scene.mjb: No space left on device" in error
    assert "the run is not saved" in error
    assert "comwalk log new" in error
    assert main(["log", "new"]) == 0
    with np.load(here / "new" / "run.npz") as columns:
        assert columns["t"][-1] > 3.0


def test_a_full_standard_output_is_told():
    """Also when the text fits into the buffer and only its end is missed."""
    if not Path("/dev/full").exists():
        pytest.skip("the system has no full device")
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "comwalk", "pattern"]
        told = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert told.returncode == 2
    assert told.stderr == "comwalk: the output: No space left on device\n"


# ---- Names with markup ------------------------------------------------------------

MARKED = "</script><script>alert(1)</script>\x9b31m\"onload='x"


@pytest.fixture(scope="module")
def marked_run(tmp_path_factory):
    """A walk of a robot whose file, links and joints are named to do harm."""
    folder = tmp_path_factory.mktemp("marked")
    text, name = urdf(), quoteattr(MARKED)
    for part in ("left_knee_y", "pelvis", "toy"):
        text = text.replace(f'"{part}"', name)
    robot = folder / "$\\frac$<b>.urdf"
    robot.write_text(text)
    words = ["walk", str(robot), "--steps", "1", "--report", "--out", folder / "<i>run"]
    assert main([*map(str, words)]) == 0
    return folder / "<i>run"


def test_names_with_markup_are_text_in_a_page(marked_run):
    """Of robot, links, joints and folder; nothing of them is an element or a script."""
    page = (marked_run / "report.html").read_text()
    assert "alert(1)" not in page.replace("&lt;script&gt;alert(1)&lt;/script&gt;", "")
    assert "&lt;b&gt;" in page
    assert "&lt;i&gt;run" in page
    assert not re.search("<b>[^<]*urdf|<i>run", page)


def test_names_with_formulas_are_drawn_as_they_are(marked_run):
    assert inked(marked_run / "walk.png") > 0.01


def test_names_do_not_steer_the_terminal(marked_run, capsys):
    """Neither in tables nor in errors; line breaks are those of the table."""
    robot = next(marked_run.parent.glob("*.urdf"))
    assert main(["robot", str(robot)]) == 0
    out = capsys.readouterr().out
    assert "alert(1)" in out
    assert "\\x9b31m" in "".join(out.split())
    assert re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]", out) is None
    assert "\\x1b[2Jrobot" in refused(capsys, "walk", "\x1b[2Jrobot")


ODD = {"spaces": " a b ", "signs": "#%20%s'\"&;$(x)", "letters": "ünï 名前"}
ODD |= {"not UTF-8": os.fsdecode(b"bad\xff")}


@pytest.mark.parametrize("name", ODD.values(), ids=ODD)
def test_files_may_have_any_names(here, capsys, name):
    """Robot, folder, motion and page; what is printed as JSON stays JSON."""
    robot, out, motion = f"r{name}.urdf", f"o{name}", f"m{name}.csv"
    try:
        Path(robot).write_text(urdf())
    except OSError:
        pytest.skip("the file system takes no such name")
    Path(motion).write_text("time,waist_z\n0,0\n2,0.1\n4,0\n")
    words = "walk", robot, "--steps", "1", "--motion", motion, "--report"
    for command in (
        ("robot", robot, "--write-profile", f"p{name}.toml"),
        ("robot", robot, "--profile", f"p{name}.toml", "--json"),
        (*words, "--out", out, "--json"),
        ("replay", out, "--verify", "--json"),
        ("export", out, "--csv", "--rosbag2", "--json"),
        ("motions", motion, "--robot", robot, "--json"),
        ("walk", "--config", f"{out}/summary.json", "--json"),
    ):
        assert main(list(command)) == 0, command
        told = capsys.readouterr().out
        if "--json" in command:
            json.loads(told)
    assert inked(here / out / "walk.png") > 0.01
    assert "CoM and ZMP" in (here / out / "report.html").read_text(encoding="utf-8")
