"""The commands `log` and `export`, on runs that are whole, killed or none."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.highlevel import AnyReader

from comwalk.cli.app import main
from comwalk.runs.columns import load_columns
from comwalk.runs.mcap_file import MCAP_NAME


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """The folder of a step, as the command writes it."""
    folder = tmp_path_factory.mktemp("run")
    assert main(["walk", "--steps", "1", "--out", str(folder)]) == 0
    assert not (folder / MCAP_NAME).exists()
    assert main(["log", str(folder)]) == 0  # makes the log of the columns
    return folder


@pytest.fixture
def killed(made, tmp_path) -> Path:
    """What a killed run left: its rows, and what it was made with."""
    folder = tmp_path / "killed"
    folder.mkdir()
    with np.load(made / "run.npz") as file:
        columns = load_columns(file)
    names = [name for name, column in columns.items() if column.ndim]
    kind = np.dtype([(n, columns[n].dtype, columns[n].shape[1:]) for n in names])
    rows = np.zeros(len(columns["t"]), kind)
    for name in names:
        rows[name][:1000] = columns[name][:1000]
    np.save(folder / "run.npy", rows)
    settings = json.loads((made / "summary.json").read_text())["settings"]
    (folder / "run.json").write_text(json.dumps(settings))
    return folder


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open(encoding="utf-8") as file:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def test_a_log_is_summarised(made, capsys):
    assert main(["log", str(made)]) == 0
    printed = capsys.readouterr().out
    assert "completed in" in printed
    assert "comwalk walk --steps 1" in printed
    assert "/joint_states" in printed
    assert main(["log", str(made / MCAP_NAME), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    summary = json.loads((made / "summary.json").read_text())
    assert told["settings"]["config"] == summary["settings"]["config"]
    rates = {topic["topic"]: topic["rate_hz"] for topic in told["topics"]}
    assert rates["/com"] == pytest.approx(500.0)
    assert rates["/tf"] == pytest.approx(50.0)
    assert rates["/tf_static"] is None


def test_a_killed_run_is_saved_once(killed, capsys):
    assert main(["log", str(killed)]) == 0
    assert "the run was killed" in capsys.readouterr().out
    assert main(["log", str(killed), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["outcome"] is None
    assert told["duration_s"] == pytest.approx(998 * 0.002)
    files = sorted(x.name for x in killed.iterdir())
    assert files == ["run.json", MCAP_NAME, "run.npz"]


def test_csv_holds_the_numbers_of_the_run(made, tmp_path):
    assert main(["export", str(made), "--csv", "--out", str(tmp_path)]) == 0
    with np.load(made / "run.npz") as file:
        columns = load_columns(file)
        rows = rows_of(tmp_path / "csv" / "zmp.csv")
        found = np.array([[r["point.x"], r["point.y"]] for r in rows])
        assert np.array_equal(found, columns["zmp"])
        rows = rows_of(tmp_path / "csv" / "joint_states.csv")
        knees = np.array([r["position.l_knee_pitch"] for r in rows])
        assert knees.tolist() in columns["joints"].T.tolist()
        assert [r["time"] for r in rows] == columns["t"].round(9).tolist()


def test_parquet_holds_what_csv_holds(made, tmp_path):
    duckdb = pytest.importorskip("duckdb")
    out = ["--out", str(tmp_path)]
    assert main(["export", str(made), "--csv", "--parquet", *out]) == 0
    names = sorted(path.stem for path in (tmp_path / "csv").iterdir())
    assert names == sorted(path.stem for path in (tmp_path / "parquet").iterdir())
    for name in names:
        text = rows_of(tmp_path / "csv" / f"{name}.csv")
        table = duckdb.sql(f"from '{tmp_path}/parquet/{name}.parquet'")
        assert table.columns == list(text[0])
        assert table.fetchall() == [tuple(row.values()) for row in text]


@pytest.mark.parametrize("which", ["made", "killed"])
def test_rosbag2_opens_elsewhere(which, request, tmp_path, capsys):
    folder = request.getfixturevalue(which)
    out = tmp_path / "out"
    command = ["export", str(folder), "--rosbag2", "--out", str(out), "--json"]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(Path(file).is_file() for file in told["files"]["rosbag2"])
    with AnyReader([out / "rosbag2"]) as reader:
        counts: dict[str, int] = {}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
        assert counts == {c.topic: c.msgcount for c in reader.connections}
        assert len(counts) == 12


def test_parquet_says_what_it_needs(made, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "duckdb", None)
    assert main(["export", str(made), "--parquet"]) == 2
    assert "pip install 'comwalk[parquet]'" in capsys.readouterr().err


def foreign(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="another")
        writer.finish()


def unreadable(path: Path) -> None:
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(500))


def text(path: Path) -> None:
    path.write_text("time,x\n")


def empty(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (foreign, "another"),
        (text, "no MCAP file"),
        (empty, "no MCAP file"),
        (unreadable, "no MCAP file"),
    ],
)
def test_what_is_no_log_is_refused_on_one_line(write, message, tmp_path, capsys):
    write(tmp_path / MCAP_NAME)
    before = (tmp_path / MCAP_NAME).read_bytes()
    assert main(["log", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert (tmp_path / MCAP_NAME).read_bytes() == before
    assert main(["export", str(tmp_path), "--rosbag2"]) == 2
    assert capsys.readouterr().err == error


def test_wrong_words_are_refused(made, tmp_path, capsys):
    for words, message in (
        (["log", str(tmp_path / "none")], "run.mcap"),
        (["log", str(tmp_path)], "run.mcap"),
        (["export", str(made)], "--csv, --parquet or --rosbag2"),
        (["export", str(tmp_path), "--csv"], "run.npz"),
        (["export", str(tmp_path / "none"), "--csv"], "no such folder"),
    ):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error
    (tmp_path / "file").write_text("")
    command = ["export", str(made), "--csv", "--out", str(tmp_path / "file")]
    assert main(command) == 2
    assert "file" in capsys.readouterr().err


def test_a_run_without_summary_points_to_its_log(killed, capsys):
    assert main(["replay", str(killed)]) == 2
    assert "comwalk log" in capsys.readouterr().err
