"""The rows of a run in a file while it runs, so that a killed run leaves them."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from ..errors import RunError
from ..robot import Robot, load_robot
from .columns import Log, rows_left, save_columns, write_file
from .mcap_file import MCAP_NAME, write_mcap
from .run_data import read_columns, read_summary
from .summary import outcome_text

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None

ROWS_NAME = "run.npy"
"""Rows of a run that is not saved yet, in its folder."""

RUN_FILES = ("summary.json", "run.npz", "scene.mjb", "walk.png", "dance.png")
RUN_FILES += ("report.html", MCAP_NAME)
"""Files of a saved run."""

_EXPORTS = {"csv": (".csv",), "parquet": (".parquet",), "rosbag2": (".mcap", ".yaml")}


class Recorder:
    """Keeps the rows of a run in a file while they grow. Final.

    Used as a context. The rows are mapped from the file, so that it costs the walk
    nothing; messages are made of them when the context is left, whatever happened.
    """

    def __init__(
        self,
        path: str | Path | None,
        log: Log,
        robot: Robot | None,
        settings: dict[str, Any],
    ) -> None:
        """Open the file.

        Args:
            path: The file, written anew: .npy for the rows, .mcap for messages, which
                has the rows beside it until it is written. Nothing is if None.
            log: The record, which the run fills.
            robot: The robot; None for the simplified model.
            settings: What the run is made with, ready for JSON.

        Raises:
            RunError: If the file cannot be written.
        """
        self.outcome: str | None = None
        self.path = None if path is None else Path(path)
        self.log, self._robot, self.settings = log, robot, settings
        if self.path is not None:
            log.file = self.path.with_suffix(".npy")
            if log.file.name == ROWS_NAME:
                clear_folder(log.file.parent)
            self._file = _open(log.file)  # locked; the log maps the same file
            try:  # beside the rows, for the case of a crash
                about = json.dumps(settings, allow_nan=False)
                write_file(log.file.with_suffix(".json"), about)
            except RunError:
                self._file.close()
                raise

    def __enter__(self) -> Recorder:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put the last rows into the file, and make messages if they were asked for.

        Raises:
            RunError: If it cannot be written.
        """
        if self.path is None or self.log.file is None:
            return
        columns, rows = self.log.columns, self.log.file
        self._file.close()
        if self.path != rows and len(columns.get("t", ())):
            write_mcap(self.path, columns, self._robot, self.settings, self.outcome)
            rows.unlink()
            rows.with_suffix(".json").unlink()


def _open(path: Path) -> BinaryIO:
    """Open a file to write it anew; as long as it is open, `_is_open` says so."""
    try:
        file = path.open("ab")
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from None
    if not _lock(file):
        file.close()
        raise RunError(
            f"{path} is being written by another run; choose another by --out"
        )
    file.truncate(0)
    return file


def _is_open(path: Path) -> bool:
    """Return whether a run is writing; never where the system has no such locks."""
    try:
        with path.open("rb") as file:
            return not _lock(file)
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror}") from None


def _lock(file: BinaryIO) -> bool:
    """Lock a file until it is closed; return whether no other process has done so."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def prepare_folder(folder: str | Path) -> Path:
    """Make a folder for a run, before hours are spent on it.

    Args:
        folder: Its path.

    Returns:
        The folder, which can be written.

    Raises:
        RunError: If it cannot be made or written.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".comwalk"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise RunError(
            f"cannot write the folder {path}: {error.strerror}; choose another by --out"
        ) from None
    return path


def clear_folder(folder: Path, keep: str | Path | None = None) -> None:
    """Remove what an earlier run left in a folder, so that all in it is of one run.

    Args:
        folder: The folder. What comwalk does not write stays.
        keep: A file that stays.

    Raises:
        RunError: If a file cannot be removed.
    """
    exported = [
        file
        for name, endings in _EXPORTS.items()
        for file in sorted(folder.glob(f"{name}/*"))
        if file.suffix in endings
    ]
    try:
        for file in (*(folder / name for name in RUN_FILES), *exported):
            if keep is None or file != Path(keep):
                file.unlink(missing_ok=True)
        for name in _EXPORTS:
            if (folder / name).is_dir() and not any((folder / name).iterdir()):
                (folder / name).rmdir()
    except OSError as error:
        raise RunError(
            f"cannot clear {folder}: {error}; choose another by --out"
        ) from None


def recover(folder: Path) -> bool:
    """Write run.npz of the rows that a killed run left, in place of an earlier run.

    Args:
        folder: Folder of the run.

    Returns:
        Whether there was something to recover.

    Raises:
        RunError: If a run still writes the rows, they cannot be read, or run.npz
            cannot be written.
    """
    rows = folder / ROWS_NAME
    if not rows.is_file():
        return False
    if _is_open(rows):
        raise RunError(f"{rows} is still being written; wait until the run is over")
    columns = rows_left(rows)
    for name in ("summary.json", MCAP_NAME):
        (folder / name).unlink(missing_ok=True)
    save_columns(folder / "run.npz", columns)
    rows.unlink()
    return True


def log_path(run: str | Path) -> Path:
    """Return the messages of a run, which are made of its columns if need be.

    A run that was killed before it was saved is saved first, as far as it came.

    Args:
        run: Folder of the run, or the file of messages itself.

    Returns:
        The file.

    Raises:
        RunError: If there is none, and no columns to make it of.
    """
    path = Path(run)
    if path.is_dir():
        recover(path)
        file = path / MCAP_NAME
        if not file.is_file() and (path / "run.npz").is_file():
            robot, settings, outcome = origin(path)
            write_mcap(file, read_columns(path), robot, settings, outcome)
        path = file
    if not path.is_file():
        raise RunError(f"{run} is not a run: it has no {MCAP_NAME}")
    return path


def origin(folder: Path) -> tuple[Robot | None, dict[str, Any], str | None]:
    """Return robot, settings and outcome of a saved run.

    Args:
        folder: Folder of the run.

    Returns:
        The robot, None for the simplified model; the settings; the outcome as text,
        None if the run was killed.

    Raises:
        RunError: If there are no readable settings.
    """
    outcome = None
    try:
        summary = read_summary(folder)
        settings, outcome = summary["settings"], outcome_text(summary)
    except RunError:
        settings = _left_settings(folder)
    known = settings.get("config") or {}
    robot = None
    if settings.get("robot") is not None:
        name = known.get("robot") or settings["robot"]
        robot = load_robot(name, profile=known.get("profile"))
    return robot, settings, outcome


def _left_settings(folder: Path) -> dict[str, Any]:
    try:
        return json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise RunError(f"{folder} is not a run: it has no readable settings") from None
