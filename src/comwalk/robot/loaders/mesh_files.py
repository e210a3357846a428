"""Mesh files of a robot: search and vertices.

MuJoCo is given binary STL. Everything else is converted to it once, split by color, and
kept in the user's cache under a hash of its content.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import re
import shutil
import tempfile
import urllib.parse
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ModelError, one_line
from .parts import LinkMesh

_MOST_FACES = 200_000
"""Most triangles that MuJoCo takes from an STL file."""
_STL_TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)


def find_mesh(filename: str, folders: Sequence[Path]) -> Path | None:
    """Return the file that a model names by a path or by `package://`.

    A relative path or the name of a package is searched in the folders and all above
    them, in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH, and among the installed Python
    packages.

    Args:
        filename: What the model says: a path, or `package://`, `model://`, `file://`.
        folders: Folders that relative paths count from, the model's own first.

    Returns:
        The file, None if it is nowhere.
    """
    scheme, separator, rest = filename.strip().replace("\\", "/").partition("://")
    if not separator:
        scheme, rest = "", scheme.removeprefix("package:").removeprefix("file:")
    if scheme == "file":
        rest = urllib.parse.unquote(rest)
    path = Path(rest)
    if scheme in ("", "file") and path.is_absolute() and _is_file(path):
        return path
    relative = rest.strip("/")
    return _search(relative, folders) if relative else None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _search(relative: str, folders: Sequence[Path]) -> Path | None:
    """Return the first file of that relative path below one of the places."""
    package, _, inside = relative.partition("/")
    above = [place for folder in folders for place in (folder, *folder.parents)]
    for place in dict.fromkeys([*above, *_ros_folders()]):
        if _is_file(place / relative):
            return place / relative
    for place in [*package_folders(package), *above[:4]] if inside else []:
        if _is_file(place / inside):
            return place / inside
    return None


def _ros_folders() -> list[Path]:
    """Return the folders in which ROS looks for packages."""
    ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    ament = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    listed = [Path(entry) for entry in ros if entry]
    shares = [Path(entry) / "share" for entry in ament if entry]
    return [*listed, *(folder.parent for folder in listed), *shares]


@functools.cache
def package_folders(name: str) -> tuple[Path, ...]:
    """Return the folders of an installed Python package, which is not imported.

    Args:
        name: Name of the package.

    Returns:
        Its folders, none if it is not installed.
    """
    if not name.isidentifier():
        return ()
    try:
        found = importlib.util.find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return ()
    folders = found.submodule_search_locations if found else None
    return tuple(Path(folder) for folder in folders or ())


@dataclass(frozen=True, eq=False)
class Part:
    """A piece of a mesh in one color, as MuJoCo can read it."""

    file: Path
    """A binary STL file."""
    color: tuple[float, ...] | None
    """Red, green, blue, alpha in [0, 1], None if unknown."""


def mesh_vertices(mesh: LinkMesh) -> np.ndarray:
    """Read the vertices of a mesh: STL, OBJ, and what trimesh reads (DAE, PLY, ...).

    Args:
        mesh: The mesh of a body.

    Returns:
        Vertices [m] in the body's frame, of shape (n, 3); some may be there twice.

    Raises:
        ModelError: If the file cannot be read.
    """
    try:
        vertices = file_vertices(mesh.file)
    except (OSError, ValueError) as error:
        raise ModelError(
            f"mesh {mesh.file} is not readable: {one_line(error)}"
        ) from None
    return vertices * mesh.scale @ mesh.rotation.T + mesh.position


def file_vertices(file: Path) -> np.ndarray:
    """Read the vertices in a file.

    Args:
        file: The file.

    Returns:
        Vertices in the file's own frame, of shape (n, 3); some may be there twice.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it holds no vertices, or something that is no mesh.
    """
    quick = {".stl": _stl_vertices, ".obj": _obj_vertices}.get(file.suffix.lower())
    if quick is not None:
        vertices = quick(file.read_bytes())
    else:
        triangles = [corners for _, corners in _colored_triangles(file)]
        vertices = np.concatenate(triangles).reshape(-1, 3)
    if not len(vertices):
        raise ValueError("it has no vertices")
    if not np.isfinite(vertices).all():
        raise ValueError("some of its coordinates are no finite numbers")
    return vertices


def _stl_count(data: bytes) -> int:
    count = int.from_bytes(data[80:84], "little")
    enough = len(data) >= 84 + 50 * count
    is_text = data[:5].lower() == b"solid" and len(data) != 84 + 50 * count
    return count if enough and not is_text else 0


def _stl_vertices(data: bytes) -> np.ndarray:
    """Return the vertices of an STL file, binary or text, of shape (n, 3)."""
    count = _stl_count(data)
    if count:
        records: Any = np.frombuffer(data, _STL_TRIANGLE, count, 84)
        return records["corners"].reshape(-1, 3).astype(float)
    return _numbers_after(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)


def _obj_vertices(data: bytes) -> np.ndarray:
    return _numbers_after(rb"^\s*v\s+(\S+)\s+(\S+)\s+(\S+)", data)


def _numbers_after(pattern: bytes, data: bytes) -> np.ndarray:
    return np.array(re.findall(pattern, data, re.M), dtype=float).reshape(-1, 3)


def _colored_triangles(
    file: Path,
) -> list[tuple[tuple[float, ...] | None, np.ndarray]]:
    """Return the triangles in any file, of shape (n, 3, 3), by color.

    As in ROS, the `up_axis` of a DAE is ignored and its unit is not.
    """
    data = file.read_bytes()
    if file.suffix.lower() == ".stl":
        return [(None, file_vertices(file).reshape(-1, 3, 3))]
    import trimesh

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(file)
            pieces = [
                (_color_of(scene.geometry[name]), transform, scene.geometry[name])
                for transform, name in map(scene.graph.get, scene.graph.nodes_geometry)
            ]
    except Exception as error:  # trimesh raises whatever its readers raise
        raise ValueError(one_line(error)) from None
    unit = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", data[:20000])
    factor = float(unit[1]) if unit and file.suffix.lower() == ".dae" else 1.0
    by_color: dict[tuple[float, ...] | None, list[np.ndarray]] = {}
    for color, T, piece in pieces:
        if len(getattr(piece, "faces", ())):
            corners = piece.vertices[piece.faces] @ T[:3, :3].T + T[:3, 3]
            by_color.setdefault(color, []).append(factor * corners)
    if not by_color:
        raise ValueError("it holds no triangles")
    return [(color, np.concatenate(corners)) for color, corners in by_color.items()]


def _color_of(piece: Any) -> tuple[float, ...] | None:
    """Return the color of a mesh of trimesh, that of a texture being its mean."""
    material = getattr(piece.visual, "material", None)
    for key in ("image", "baseColorTexture"):
        image = getattr(material, key, None)
        if image is not None:
            small = np.asarray(image.convert("RGB").resize((16, 16)), dtype=float)
            return (*(small.mean(axis=(0, 1)) / 255.0).round(3).tolist(), 1.0)
    if material is None and not getattr(piece.visual, "defined", False):
        return None
    source = piece.visual if material is None else material
    color = np.asarray(source.main_color, dtype=float) / 255.0
    return tuple(color.round(3).tolist())


def cache_folder() -> Path:
    """Return the folder for converted meshes: in the user's cache, or a temporary one.

    Returns:
        A folder that exists.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(home) / "comwalk" / "meshes"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    folder = Path(tempfile.gettempdir()) / "comwalk-meshes"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def readable_parts(file: Path) -> list[Part]:
    """Return binary STL files that hold what any mesh file holds, split by color.

    Args:
        file: The file.

    Returns:
        The file itself if MuJoCo can read it, else its parts in the user's cache.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it is not a mesh.
    """
    data = file.read_bytes()
    suffix = file.suffix.lower()
    if suffix == ".stl" and 0 < _stl_count(data) <= _MOST_FACES:
        return [Part(file, None)]
    digest = hashlib.sha256(b"1" + suffix.encode() + data).hexdigest()[:32]
    folder = cache_folder() / digest
    if not folder.is_dir():
        _convert(file, folder)
    return [Part(path, _header_color(path)) for path in sorted(folder.glob("*.stl"))]


def _convert(file: Path, folder: Path) -> None:
    """Write the triangles of a mesh as binary STL files, all at once or not at all."""
    work = Path(tempfile.mkdtemp(dir=folder.parent))
    try:
        number = 0
        for color, triangles in _colored_triangles(file):
            for start in range(0, len(triangles), _MOST_FACES):
                path = work / f"{number:03d}.stl"
                _write_stl(path, triangles[start : start + _MOST_FACES], color)
                number += 1
        work.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _write_stl(
    path: Path, triangles: np.ndarray, color: tuple[float, ...] | None
) -> None:
    """Write a binary STL file; its header holds the color."""
    records: Any = np.zeros(len(triangles), _STL_TRIANGLE)
    records["corners"] = triangles
    text = "comwalk " + " ".join(f"{x:.3f}" for x in color or ())
    count = len(triangles).to_bytes(4, "little")
    path.write_bytes(text.encode().ljust(80) + count + records.tobytes())


def _header_color(path: Path) -> tuple[float, ...] | None:
    with path.open("rb") as stream:
        words = stream.read(80).split()[1:]
    return tuple(float(word) for word in words) or None
