"""The bench: each job once, whatever happens, and a document of what came out."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from PIL import Image

from comwalk.bench import ledger as bench
from comwalk.bench.cases import (
    ABOUT,
    OPEN_LOOP,
    SPEED,
    TORQUE,
    Ablation,
    Case,
    all_cases,
    pushes,
)
from comwalk.bench.ledger import (
    Job,
    chosen,
    jobs_of,
    read_ledger,
    run_jobs,
    write_entry,
)
from comwalk.bench.table import (
    Findings,
    document,
    draw_robot,
    tables_of_findings,
    write_report,
)
from comwalk.bench.trials import prepare
from comwalk.cli import bench as bench_commands
from comwalk.cli.app import main
from comwalk.errors import ParameterError, RunError

CASES = tuple(Case(name=f"case {k}", steps=k + 1) for k in range(12))
JOBS = jobs_of(["a", "b"], CASES, ())

# Run in processes of its own: notes when a case begins, and takes a moment.
SLOW = """
import os, sys, time
from pathlib import Path
from comwalk.bench import jobs_of, run_jobs
from comwalk.bench.cases import Case

HERE = Path(__file__).parent
CASES = tuple(Case(name=f"case {k}", steps=k + 1) for k in range(12))

def slow(robot, case):
    with (HERE / "begun").open("a") as file:
        file.write(f"{robot} {case.name}\\n")
    time.sleep(0.1)
    return {"outcome": "completed", "steps": case.steps}

if __name__ == "__main__":
    from slow import slow
    jobs = jobs_of(["a", "b"], CASES, ())
    run_jobs(jobs, HERE / "ledger.jsonl", workers=2, perform=slow)
"""


def counting(calls):
    """Return what does a case at once, and counts."""

    def perform(robot, case):
        calls.append((robot, case.name))
        return {"outcome": "completed", "steps": case.steps}

    return perform


def entries_of(ledger):
    """Return the robot and the case of each whole line of a ledger."""
    entries = []
    for line in ledger.read_text().splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        entries.append((entry["robot"], entry["case"]))
    return entries


# ---- The ledger -------------------------------------------------------------------


def test_each_job_is_done_once(tmp_path):
    ledger, calls, said = tmp_path / "ledger.jsonl", [], []
    one = run_jobs(JOBS[:5], ledger, perform=counting(calls))
    two = run_jobs(JOBS, ledger, perform=counting(calls), progress=said.append)
    assert Counter(calls) == Counter((j.robot, j.case.name) for j in JOBS)
    assert two[:5] == one
    assert [r["steps"] for r in two] == [j.case.steps for j in JOBS]
    assert said == list(range(5, 25))


def test_a_line_cut_short_is_done_again(tmp_path):
    """A kill in the middle of a write costs that one result."""
    ledger, calls = tmp_path / "ledger.jsonl", []
    run_jobs(JOBS[:3], ledger, perform=counting(calls))
    text = ledger.read_text()
    ledger.write_text(text[:-20])
    assert len(read_ledger(ledger)) == 2
    run_jobs(JOBS[:4], ledger, perform=counting(calls))
    assert len(calls) == 3 + 2
    assert len(read_ledger(ledger)) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_a_killed_bench_resumes(tmp_path):
    """Killed without warning: what was kept is not done again, the rest is, once."""
    (tmp_path / "slow.py").write_text(SLOW)
    ledger, begun = tmp_path / "ledger.jsonl", tmp_path / "begun"
    command = [sys.executable, str(tmp_path / "slow.py")]
    first = subprocess.Popen(command)
    deadline = time.monotonic() + 60.0
    while not ledger.exists() or len(entries_of(ledger)) < 5:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    time.sleep(0.5)  # its processes end by themselves
    lines = begun.read_text().splitlines()
    time.sleep(0.4)
    assert begun.read_text().splitlines() == lines
    kept = entries_of(ledger)
    assert 5 <= len(kept) < len(JOBS)
    subprocess.run(command, check=True, timeout=60)
    everything = Counter((j.robot, j.case.name) for j in JOBS)
    assert Counter(entries_of(ledger)) == everything
    again = Counter(begun.read_text().splitlines()[len(lines) :])
    left = everything - Counter(kept)
    assert again == Counter(f"{robot} {case}" for robot, case in left.elements())


def test_keys_tell_apart_all_that_matters(tmp_path, monkeypatch):
    robot = tmp_path / "robot.xml"
    robot.write_text("<mujoco/>")
    job = Job(robot=str(robot), case=CASES[0])
    other = dataclasses.replace(CASES[0], keys={"simulator.noise": 1.0})
    keys = [
        job.key,
        Job(robot="paper", case=CASES[0]).key,
        Job(robot=str(robot), case=other).key,
        Job(robot=str(robot), case=CASES[0], ablation=OPEN_LOOP).key,
    ]
    robot.write_text("<mujoco></mujoco>")
    keys.append(job.key)
    monkeypatch.setattr(bench, "source_digest", lambda: "other")
    keys.append(job.key)
    assert len(set(keys)) == len(keys)


def test_broken_ledgers_are_refused(tmp_path):
    with pytest.raises(RunError, match="cannot read the ledger"):
        read_ledger(tmp_path)
    with pytest.raises(RunError, match="cannot write the ledger"):
        write_entry(tmp_path / "none" / "ledger", JOBS[0], {})
    (tmp_path / "ledger").write_text('[1]\n{"key": "a"}\nnull\n\n')
    assert read_ledger(tmp_path / "ledger") == {}


# ---- What is done -----------------------------------------------------------------


def test_groups_and_names_choose_cases():
    cases = all_cases(range(2))
    assert chosen(cases, []) == cases
    assert {c.group for c in chosen(cases, ["push", "turn"])} == {"push", "turn"}
    assert [c.name for c in chosen(cases, ["payload 20 %"])] == ["payload 20 %"]
    with pytest.raises(ParameterError, match='unknown case "fly"; there are about'):
        chosen(cases, ["fly"])


def test_ablations_walk_forward_and_over_floors():
    cases = chosen(all_cases(range(1)), ["forward", "turn", "floor"])
    named = Ablation(name="other", changes={})
    jobs = jobs_of(["paper"], cases, [OPEN_LOOP, named])
    others = {j.case.group for j in jobs if j.ablation.name == "other"}
    assert others == {"forward", "floor"}
    assert len(jobs) == 1 + 3 * (1 + 3)
    jobs = jobs_of(["paper"], all_cases(range(1)))
    torque = {j.case.name for j in jobs if j.ablation is TORQUE}
    assert torque == {j.case.name for j in jobs if j.case.task in ("walk", "dance")}


def test_torques_walk_with_the_flaws_of_real_joints():
    """What a case states holds: its own delay is not made less."""
    case = Case(name="latency", steps=2, keys={"simulator.latency": 0.01})
    setup = prepare("paper", TORQUE.of(case))
    assert setup.robot.actuation == "pd"
    assert setup.physics.joint_friction == 0.5
    assert setup.physics.latency == 0.01


# ---- The document -----------------------------------------------------------------


def walked(**changes):
    xy = {"x": 1.0, "y": 2.0}
    return {
        "outcome": "completed",
        "cause": "",
        "time_s": 5.0,
        "steps_planned": 20,
        "position_error_m": 0.0123,
        "heading_error_deg": -0.34,
        "end_error_pct": 0.5,
        "com_error_rms_mm": {"true": xy},
        "zmp_error_rms_mm": xy,
        "sole_margin_p5_mm": 40.0,
        "sole_margin_min_mm": 4.0,
        "joint_speed_max_pct": 30.0,
        "joint_speed_max_joint": "knee",
        "torque_max_pct": 60.0,
        "torque_max_joint": "ankle",
        "real_time_factor": 5.0,
        **changes,
    }


def findings_of_everything():
    """Return made-up results of two robots, the second of which is refused."""
    jobs = jobs_of(["one", "two"], all_cases(range(4)))
    results = []
    for job in jobs:
        case, fell = job.case, walked(outcome="fell", cause="x")
        result = walked()
        if job.robot == "two":
            result = {"outcome": "refused", "cause": "no feet | none; add feet"}
        elif case is ABOUT:
            result |= {"mass_kg": 50.0, "joints": 20, "com_height_m": 0.6}
            result |= {"sole_mm": [200.0, 100.0], "step_m": 0.2, "period_s": 1.0}
        elif case is SPEED:
            result = {"outcome": "found", "speed_m_s": 0.5, "cause": "torque of knee"}
        elif case.push is not None:
            result = {"outcome": "found", "push_m_s": case.push.share, "foot": "right"}
        elif case.task == "dance":
            result |= {"steps_planned": 0, "zmp_deviation_max_mm": {"x": 7.0, "y": 3.0}}
        elif case.group == "floor" and case.name.endswith("#3"):
            result = fell
        elif job.ablation is OPEN_LOOP:
            result = fell
        results.append(result)
    return Findings(jobs, results)


def test_tables_say_what_was_found():
    tables = tables_of_findings(findings_of_everything())
    cells = {}
    for title, head, rows in tables:
        assert all(len(row) == len(head) for row in rows)
        drives = ["one", "one, by torque", "two", "two, by torque"]
        assert [row[0] for row in rows] in (["one", "two"], drives)
        cells[title.split()[0] + str(len(cells))] = dict(
            zip(head, rows[0], strict=True)
        )
    about, ends, figures, laws, wrong, speed, rough, hard = cells.values()
    assert (about["mass [kg]"], about["sole [mm]"]) == ("50.0", "200 x 100")
    assert (ends["turn"], ends["dance"]) == ("ok, 12 mm 0.3 deg", "ok, ZMP 7 mm")
    assert (figures["torque"], figures["end error / path"]) == ("60 % ankle", "0.50 %")
    assert (laws["default"], laws["open loop"]) == ("1.0 / 2.0", "fell at 5.0 s")
    assert wrong["latency"] == "ok, 12 mm 0.3 deg"
    assert list(speed.values())[1] == "0.50 m/s, then torque of knee"
    assert rough["5 mm, default"] == "3/4"
    assert rough["15 mm, open loop"] == "0/4"
    assert hard["outward"] == "0.10 (0.10 0.35 0.60 0.85)"
    assert all("refused" in table[2][-1][1] for table in tables[1:])


def test_tables_hold_only_what_was_done():
    findings = findings_of_everything()
    rows = zip(findings.jobs, findings.results, strict=True)
    turns = [(j, r) for j, r in rows if j.case.name == "turn"]
    ((_, head, _),) = tables_of_findings(Findings(*zip(*turns, strict=True)))
    assert head == ("robot", "turn")


def test_document_is_whole_markdown(tmp_path):
    text = document(findings_of_everything(), tmp_path / "robots.md", ["one"])
    assert "![one walks](images/robot-one.webp)" in text
    tables, lines = [], text.splitlines()
    for before, line in zip(["", *lines], lines, strict=False):
        if line.startswith("|"):
            if not before.startswith("|"):
                tables.append([])
            tables[-1].append(line.count("|"))
    assert len(tables) == 9
    assert all(len(set(widths)) == 1 for widths in tables)
    assert not any("  " in line for line in lines if line.startswith("#"))


def test_report_shows_pictures_that_exist(tmp_path):
    path = tmp_path / "robots.md"
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "robot-two.webp").write_bytes(b"")
    assert write_report(findings_of_everything(), path, pictures=False) == []
    assert "robot-two.webp" in path.read_text()
    assert "robot-one.webp" not in path.read_text()
    with pytest.raises(RunError, match="cannot write"):
        write_report(findings_of_everything(), tmp_path, pictures=False)


def test_robots_that_cannot_be_drawn_are_told(tmp_path):
    findings = Findings([Job(robot="nobody", case=ABOUT)], [{"outcome": "refused"}])
    findings.results[0]["cause"] = "unknown"
    faults = write_report(findings, tmp_path / "robots.md")
    assert len(faults) == 1
    assert faults[0].startswith("nobody: ")


def test_picture_of_a_robot_is_small(tmp_path):
    path = tmp_path / "paper.webp"
    draw_robot("paper", path)
    assert path.stat().st_size < 60_000
    with Image.open(path) as picture:
        assert picture.width == 480


# ---- The command ------------------------------------------------------------------


def test_command_tries_robots(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["bench", "robots", "--robots", "nobody", "--cases", "turn", "--workers=1"]
    assert main(words) == 1
    out = capsys.readouterr().out
    assert "refused" in out
    assert 'unknown robot "nobody"' in out.replace("\n", " ")
    assert main([*words, "--json"]) == 1
    row, torque = json.loads(capsys.readouterr().out)
    assert torque["ablation"] == "torque"
    assert (row["robot"], row["case"], row["outcome"]) == ("nobody", "turn", "refused")
    assert len(read_ledger(tmp_path / "runs" / "bench" / "results.jsonl")) == 2


def test_command_writes_the_document_from_floors_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").mkdir()
    seen = []

    def run(jobs, ledger, **options):
        seen.extend(job.case.keys.get("simulator.terrain_seed") for job in jobs)
        return [{"outcome": "refused", "cause": "no"} for _ in jobs]

    monkeypatch.setattr(bench_commands, "run_jobs", run)
    monkeypatch.setattr(bench_commands, "ROBOTS", {"paper": "untried"})
    words = ["bench", "--robots", "nobody", "--cases", "floor"]
    main(words)
    assert set(seen) == set(range(20))
    seen.clear()
    main([*words, "--write"])
    assert set(seen) == set(range(100, 120))
    text = (tmp_path / "docs" / "robots.md").read_text()
    assert "nobody" in text
    assert "paper" not in text


def test_quick_bench_is_a_part_of_the_whole():
    quick = bench_commands._cases([], quick=True, write=False)
    whole = all_cases(range(20))
    assert set(c.name for c in quick) < set(c.name for c in whole)
    assert sum(c.group == "push" for c in quick) == len(pushes()) // 4
    assert sum(c.group == "floor" for c in quick) == 9


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--cases", "fly"], 'unknown case "fly"'),
        (["--ablations", "no land"], 'did you mean "no landing"'),
        (["--workers", "0"], "workers"),
        (["--write"], "needs the folder docs"),
    ],
)
def test_bad_words_give_one_line(words, parts, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    error = capsys.readouterr().err
    assert parts in error
    assert error.count("\n") == 1
    assert not Path("runs").exists()
