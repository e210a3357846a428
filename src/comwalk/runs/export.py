"""Runs for other programs: CSV, Parquet, and the folder that rosbag2 wants."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import RunError, one_line
from ..robot import Robot
from .mcap_file import LogFacts, inspect, nanoseconds
from .recorder import log_path, origin, recover
from .run_data import read_columns
from .topics import Columns, streams_of

Table = dict[str, np.ndarray]
"""Columns by name."""


def tables(columns: Columns, robot: Robot | None) -> dict[str, Table]:
    """Return the numbers of a run, a table for each topic of its messages.

    Args:
        columns: The run's columns.
        robot: The robot; None for the simplified model.

    Returns:
        Columns by name, by topic, such as "point.x" of "/com" and
        "position.l_knee" of "/joint_states"; "time" [s] is the first. The poses of
        links, "/tf", come in each row as well.
    """
    rows = {name: array for name, array in columns.items() if array.ndim}
    time = nanoseconds(columns["t"]) / 1e9
    return {
        stream.topic: {
            "time": time,
            **{
                name: column
                for field, values in stream.values(rows).items()
                for name, column in zip(stream.names(field), values.T, strict=True)
            },
        }
        for stream in streams_of(robot, columns.keys())
    }


def export_csv(run: Path, folder: Path) -> list[Path]:
    """Write a table for each topic as CSV; the numbers are exact.

    Args:
        run: Folder of the run.
        folder: Made if it does not exist.

    Returns:
        The files.

    Raises:
        RunError: If the run cannot be read, or the files cannot be written.
    """
    return _export(run, folder, "csv", _write_csv)


def export_parquet(run: Path, folder: Path) -> list[Path]:
    """Write a table for each topic as Parquet.

    Args:
        run: Folder of the run.
        folder: Made if it does not exist.

    Returns:
        The files.

    Raises:
        RunError: If the run cannot be read, the files cannot be written, or duckdb is
            not installed.
    """
    try:
        import duckdb
    except ImportError:
        raise RunError("Parquet needs: pip install 'comwalk[parquet]'") from None

    def write(file: Path, table: Table) -> None:
        """Write one table into a file."""
        columns = {n: np.ascontiguousarray(c) for n, c in table.items()}
        target = str(file).replace("'", "''")
        to = f"COPY columns TO '{target}' (FORMAT parquet, COMPRESSION zstd)"
        try:
            with duckdb.connect() as connection:
                connection.register("columns", columns)
                connection.execute(to)
        except duckdb.Error as error:
            raise RunError(f"cannot write {file}: {one_line(error)}") from None

    return _export(run, folder, "parquet", write)


def _export(
    run: Path, folder: Path, suffix: str, write: Callable[[Path, Table], None]
) -> list[Path]:
    """Write a file for each topic."""
    recover(run)
    columns, written = read_columns(run), []
    robot, _, _ = origin(run)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for topic, table in tables(columns, robot).items():
            file = folder / f"{topic.strip('/').replace('/', '_')}.{suffix}"
            write(file, table)
            written.append(file)
    except OSError as error:
        raise RunError(f"cannot write {folder}: {error.strerror}") from None
    return written


def _write_csv(file: Path, table: Table) -> None:
    columns = [column.tolist() for column in table.values()]
    with file.open("w", encoding="utf-8") as out:
        out.write(",".join(table) + "\n")
        for row in zip(*columns, strict=True):
            out.write(",".join(map(repr, row)) + "\n")


# ---- rosbag2 ----------------------------------------------------------------------

_BAG_VERSION = 5  # of metadata.yaml, which ROS 2 Humble and all later ones read


def export_rosbag2(run: Path, folder: Path) -> list[Path]:
    """Write the folder that `ros2 bag play` takes: the messages and metadata.yaml.

    Args:
        run: Folder of the run.
        folder: Made if it does not exist.

    Returns:
        The files.

    Raises:
        RunError: If the run cannot be read, or the files cannot be written.
    """
    path = log_path(run)
    facts = inspect(path)
    bag, about = folder / f"{folder.name}_0.mcap", folder / "metadata.yaml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, bag)
        about.write_text(_bag_metadata(facts, bag.name), encoding="utf-8")
    except OSError as error:
        raise RunError(f"cannot write {folder}: {error.strerror}") from None
    return [bag, about]


def _bag_metadata(facts: LogFacts, name: str) -> str:
    """Return metadata.yaml."""
    first = min((t.first_s for t in facts.topics), default=0.0)
    start, length = round(1e9 * first), round(1e9 * (facts.duration - first))
    time = [f"nanoseconds_since_epoch: {start}", f"nanoseconds: {length}"]
    lines = [
        "rosbag2_bagfile_information:",
        f"  version: {_BAG_VERSION}",
        "  storage_identifier: mcap",
        "  duration:",
        f"    {time[1]}",
        "  starting_time:",
        f"    {time[0]}",
        f"  message_count: {facts.messages}",
        '  compression_format: ""',
        '  compression_mode: ""',
        "  topics_with_message_count:",
    ]
    for topic in facts.topics:
        lines += [
            "    - topic_metadata:",
            f"        name: {topic.topic}",
            f"        type: {topic.kind.replace('/', '/msg/')}",
            "        serialization_format: cdr",
            "        offered_qos_profiles: |-",
            *(f"          {line}" for line in topic.qos.splitlines()),
            f"      message_count: {topic.messages}",
        ]
    lines += [
        "  relative_file_paths:",
        f"    - {name}",
        "  files:",
        f"    - path: {name}",
    ]
    lines += ["      starting_time:", f"        {time[0]}"]
    lines += ["      duration:", f"        {time[1]}"]
    lines += [f"      message_count: {facts.messages}"]
    return "\n".join(lines) + "\n"
