"""Motions in files: CSV, NPZ, and the clips of motion-tracking tools."""

from __future__ import annotations

import csv
import math
import os
import pickle
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MotionError, utf8
from .motion import Motion, as_numbers


def load_motion(
    path: str | Path,
    *,
    robot_joints: Sequence[str] | None = None,
    loops: bool | None = None,
) -> Motion:
    """Load a motion from a CSV or NPZ file.

    * **CSV**: a header `time,<joint>,...`, then one line a sample; seconds and radians.
      Lines that start with `#` are comments; of these `# name: ...`, `# loops: true`
      and `# whole_body: true` are understood.
    * **NPZ** of comwalk: `time` (n,), `joint_names` or `joints` (m,), `positions`
      (n, m) in radians; optional `name`, `loops`, `whole_body`.
    * **NPZ whole-body clip** of motion tracking tools (mjlab, whole_body_tracking of
      BeyondMimic): `fps`, `joint_pos` (n, J) in radians, optional `joint_names` (J,);
      other arrays are ignored. If `joint_names` has J - 7 names, the first 7 columns
      are the pose of the base and are left out.

    Note: Clips of mjlab hold the joints in the order of the MuJoCo model. Those of
    whole_body_tracking hold them in the order of Isaac Lab, breadth first, which is
    another one; neither tool writes the names. Pass the order of the tool that wrote
    the file as `robot_joints`.

    Args:
        path: The file; its ending, .csv or .npz, gives the format.
        robot_joints: Names of all joints of the robot without the base, in the order
            of the clip's columns; needed for clips without names.
        loops: Whether the motion repeats; None for what the file says, or else once.

    Returns:
        The motion with all its joints. Times are shifted so that they start at 0.

    Raises:
        MotionError: If the file is missing, empty, unreadable or not such a motion.
    """
    file = Path(path)
    readers = {".csv": _read_csv, ".npz": _read_npz}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise MotionError(
            f'cannot load motion "{file}": its name must end in .csv or .npz'
        )
    try:
        fields: dict[str, Any] = {"name": utf8(file.stem.strip())}
        fields |= reader(file, robot_joints)
        fields["times"] = _from_zero(fields["times"])
        if loops is not None:
            fields["loops"] = loops
        return Motion(**fields)
    except FileNotFoundError:
        raise MotionError(f'cannot load motion "{file}": no such file') from None
    except OSError as error:
        reason = error.strerror or "not readable"
        raise MotionError(f'cannot load motion "{file}": {reason}') from None
    except MotionError as error:
        raise MotionError(f'cannot load motion "{file}": {error}') from None


def _from_zero(times: np.ndarray) -> np.ndarray:
    """Return times counted from the first one, which must not be negative."""
    if times.ndim != 1 or not times.size or not math.isfinite(times[0]):
        return times
    if times[0] < 0.0:
        raise MotionError(
            f"times must not be negative, the first is {times[0]:.6g} s; "
            "count them from the start of the motion"
        )
    return times - times[0]


def _read_csv(file: Path, robot_joints: Sequence[str] | None) -> dict[str, Any]:
    """Return the fields of a motion from a CSV file."""
    with file.open(encoding="utf-8-sig", newline="") as stream:
        try:
            lines = stream.read().splitlines()
        except UnicodeDecodeError:
            raise MotionError("it is not a text file") from None
    fields: dict[str, Any] = {}
    rows: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines, start=1):
        if line.lstrip().startswith("#"):
            fields.update(_comment_field(line))
        elif line.strip(" \t,"):
            rows.append((number, _cells(number, line)))
    if not rows:
        raise MotionError("it is empty; the first line must be time,<joint>,...")
    header = _csv_header(rows[0][1])
    values = np.array([_csv_row(header, *row) for row in rows[1:]])
    values = values.reshape(-1, len(header))
    data = {"joints": tuple(header[1:]), "times": values[:, 0]}
    return {**fields, **data, "positions": values[:, 1:]}


def _cells(number: int, line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise MotionError(f"line {number}: {error}") from None


def _comment_field(line: str) -> dict[str, Any]:
    """Return the field that a comment of a CSV file sets, if any."""
    key, colon, value = line.lstrip(" \t#").partition(":")
    key, value = key.strip(), value.strip()
    if key == "name" and colon and value:
        return {"name": value}
    if key in ("loops", "whole_body") and value in ("true", "false"):
        return {key: value == "true"}
    return {}


def _csv_header(cells: list[str]) -> list[str]:
    """Return the header of a CSV file: time, then at least one joint."""
    if cells[0] == "time" and len(cells) > 1:
        return cells
    raise MotionError(
        "its first line must be time,<joint>,... with the names of the joints, "
        f'it starts with "{",".join(cells)[:40]}"'
    )


def _csv_row(header: list[str], number: int, cells: list[str]) -> list[float]:
    """Return the numbers of one line of a CSV file."""
    if len(cells) != len(header):
        raise MotionError(
            f"line {number} has {len(cells)} columns, the header has {len(header)}"
        )
    values = []
    for column, cell in zip(header, cells, strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise MotionError(
                f'line {number}, column "{column}": "{cell[:40]}" is not a number'
            ) from None
    return values


def _read_npz(file: Path, robot_joints: Sequence[str] | None) -> dict[str, Any]:
    """Return the fields of a motion from an NPZ file of either kind."""
    data = _npz_arrays(file)
    if "joint_pos" in data:
        return _clip_fields(data, robot_joints)
    names = "joint_names" if "joint_names" in data else "joints"
    missing = [key for key in ("time", names, "positions") if key not in data]
    if missing:
        raise MotionError(
            "it must hold time, joint_names and positions, or fps and joint_pos; "
            f"it holds {', '.join(sorted(data)) or 'nothing'}"
        )
    fields: dict[str, Any] = {
        "joints": _names(data[names]),
        "times": as_numbers("time", data["time"]),
        "positions": data["positions"],
    }
    for key, kind in (("name", "U"), ("loops", "b"), ("whole_body", "b")):
        if key in data and data[key].dtype.kind == kind and data[key].size == 1:
            fields[key] = data[key].item()
    return fields


_NPZ_KEYS = (
    *("time", "joint_names", "joints", "positions", "name", "loops", "whole_body"),
    *("fps", "joint_pos"),
)
"""Arrays that are read from an NPZ file; all others are only listed."""


_MOST_BYTES = 2**28
"""Size to which an array of a clip may unpack: 60 joints for an hour at 120 Hz [byte].
"""


def _check_sizes(archive: zipfile.ZipFile) -> None:
    """Refuse an archive that is small but swells, by its headers alone."""
    for entry in archive.infolist():
        name = entry.filename.removesuffix(".npy")
        if name in _NPZ_KEYS and entry.file_size > _MOST_BYTES:
            raise MotionError(
                f'array "{name}" unpacks to {entry.file_size / 2**20:.0f} MB, at '
                f"most {_MOST_BYTES / 2**20:.0f} MB are read; cut the clip shorter"
            )


def _npz_arrays(file: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an NPZ file, without ever unpickling an object."""
    with file.open("rb") as stream:
        key = ""
        try:
            with np.load(stream, allow_pickle=False) as archive:
                _check_sizes(archive.zip)
                arrays = dict.fromkeys(archive.files, np.empty(0))
                for key in (k for k in _NPZ_KEYS if k in arrays):
                    arrays[key] = np.asarray(archive[key])
        except MotionError:
            raise
        except (
            *(ValueError, EOFError, TypeError, AttributeError, NotImplementedError),
            *(
                MemoryError,
                RuntimeError,
                zipfile.BadZipFile,
                zlib.error,
                pickle.UnpicklingError,
            ),
        ):
            fault = f'array "{key}" is damaged or holds Python objects'
            raise MotionError(
                f"{fault if key else 'it is not an NPZ file'}; "
                "write plain arrays of numbers and text with numpy.savez"
            ) from None
    return arrays


def _names(array: np.ndarray) -> tuple[str, ...]:
    """Return joint names from an array of strings."""
    if array.dtype.kind == "S":
        array = np.char.decode(array, "utf-8", "replace")
    if array.dtype.kind != "U" or array.ndim != 1:
        raise MotionError("joint_names must be an array of strings of shape (joints,)")
    return tuple(str(name) for name in array)


def _clip_fields(
    data: dict[str, np.ndarray], robot_joints: Sequence[str] | None
) -> dict[str, Any]:
    """Return the fields of a motion from a whole-body clip."""
    positions = as_numbers("joint_pos", data["joint_pos"])
    if positions.ndim != 2:
        raise MotionError(
            f"joint_pos must have shape (frames, joints), got {positions.shape}"
        )
    if "joint_names" in data:
        joints = _names(data["joint_names"])
        if positions.shape[1] == len(joints) + 7:
            positions = positions[:, 7:]
    elif robot_joints is not None:
        joints = tuple(robot_joints)
    else:
        raise MotionError(
            f"this clip has {positions.shape[1]} joints and no joint_names; "
            "give the names of the robot's joints in the order of its columns"
        )
    if positions.shape[1] != len(joints):
        source = "its joint_names" if "joint_names" in data else "the robot"
        raise MotionError(
            f"joint_pos has {positions.shape[1]} joints, {source} has {len(joints)}; "
            "the clip must be made for this robot"
        )
    times = np.arange(positions.shape[0]) / _frame_rate(data)
    data_fields = {"joints": joints, "times": times, "positions": positions}
    return {**data_fields, "whole_body": True}


def _frame_rate(data: dict[str, np.ndarray]) -> float:
    """Return the frames per second of a clip."""
    if "fps" not in data:
        raise MotionError("joint_pos without fps; add fps, the frames per second")
    rates = as_numbers("fps", data["fps"]).reshape(-1)
    if rates.size != 1 or not 0.0 < rates[0] <= 1e4:
        got = f"{rates[0]:.6g}" if rates.size == 1 else f"{rates.size} numbers"
        raise MotionError(f"fps must be one number in (0, 10000] Hz, got {got}")
    return float(rates[0])


def save_motion(motion: Motion, path: str | Path) -> None:
    """Save a motion to a CSV or NPZ file, which `load_motion` reads back exactly.

    Args:
        motion: The motion; what was `dropped` from it is not saved.
        path: The file; its ending, .csv or .npz, gives the format. It is replaced.

    Raises:
        MotionError: If the ending is another one or the file cannot be written.
    """
    file = Path(path)
    writers = {".csv": _write_csv, ".npz": _write_npz}
    writer = writers.get(file.suffix.lower())
    if writer is None:
        raise MotionError(
            f'cannot save motion "{file}": its name must end in .csv or .npz'
        )
    try:
        writer(motion, file)
    except OSError as error:
        reason = error.strerror or "not writable"
        raise MotionError(f'cannot save motion "{file}": {reason}') from None


def _write_csv(motion: Motion, file: Path) -> None:
    """Write a CSV file with every digit that matters."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"# name: {motion.name}\n")
        for key in ("loops", "whole_body"):
            stream.write(f"# {key}: {str(getattr(motion, key)).lower()}\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["time", *motion.joints])
        rows = np.column_stack((motion.times, motion.positions)).tolist()
        writer.writerows([repr(x) for x in row] for row in rows)


def _write_npz(motion: Motion, file: Path) -> None:
    """Write an NPZ file of comwalk."""
    with file.open("wb") as stream:
        np.savez(
            stream,
            time=motion.times,
            joint_names=np.array(motion.joints),
            positions=motion.positions,
            name=np.array(motion.name),
            loops=np.array(motion.loops),
            whole_body=np.array(motion.whole_body),
        )


def is_motion_file(source: str) -> bool:
    """Return whether a motion is given by its file, not by its name.

    Args:
        source: What the user wrote.

    Returns:
        Whether it has the ending or the look of a path.
    """
    return "/" in source or os.sep in source or bool(Path(source).suffix)
