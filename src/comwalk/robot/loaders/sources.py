"""Robot models: any URDF or MJCF, by name or path, as a model with a floating base."""

from __future__ import annotations

import dataclasses
import importlib
import re
import sys
import xml.etree.ElementTree as ET
from functools import cache
from importlib.resources import files
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError, nearest, one_line, utf8
from .mesh_files import mesh_vertices as mesh_vertices
from .mesh_files import package_folders
from .meshes import add_meshes, compile_without_bad_meshes
from .mjcf import read_mjcf
from .parts import LinkMesh as LinkMesh
from .parts import Mimic as Mimic
from .parts import ModelFile as ModelFile
from .parts import check_depth, with_limbs_leading
from .urdf import read_urdf

ROBOTS = {
    "paper": "the paper's humanoid: 67.68 kg, CoM at 0.687 m, 30 joints",
    "jvrc1": "JVRC-1, a virtual humanoid of 62 kg; pip install jvrc_description",
    "talos": "PAL Robotics TALOS, 90 kg, hands fixed; pip install example-robot-data",
    "talos_full": "TALOS with hands that move, 93 kg; pip install example-robot-data",
    "g1": "Unitree G1 with 29 joints, 33 kg; pip install example-robot-data",
    "romeo": "Aldebaran Romeo, 41 kg; pip install example-robot-data",
    "icub": "IIT iCub, 28 kg; pip install example-robot-data",
    "mjlab_g1": "Unitree G1 as mjlab trains it, 33 kg; pip install mjlab",
}
"""Names of the robots that are found in installed packages, and what they are."""

_PACKAGES = {
    "paper": ("comwalk", "robots/paper.xml"),
    "jvrc1": ("jvrc_description", "urdf/jvrc1.urdf"),
    "talos": ("example-robot-data", "talos_data/robots/talos_reduced.urdf"),
    "talos_full": ("example-robot-data", "talos_data/robots/talos_full_v2.urdf"),
    "g1": ("example-robot-data", "g1_description/urdf/g1_29dof_rev_1_0.urdf"),
    "romeo": ("example-robot-data", "romeo_description/urdf/romeo.urdf"),
    "icub": ("example-robot-data", "icub_description/robots/icub.urdf"),
    "mjlab_g1": ("mjlab", "asset_zoo/robots/unitree_g1/xmls/g1.xml"),
}
_PROFILES = {"paper": "robots/paper.toml"}
"""What known robots walk with, as profiles in this package."""

_LFS_POINTER = b"version https://git-lfs"  # how a file begins that was not fetched
_DECLARATION = re.compile(r"^\s*<\?xml[^>]*\?>")
_SUFFIXES = (".urdf", ".xml", ".mjcf", ".xacro")
_FARTHEST, _HEAVIEST = 100.0, 1e4
"""Largest extent [m] and mass [kg] of a robot in the right units."""


def profile_of_known(source: str | Path) -> Path | None:
    """Return the file of a known robot's profile, None if it has none.

    Args:
        source: Its name, or anything else that `read_model` takes.
    """
    inside = _PROFILES.get(str(source))
    return None if inside is None else Path(str(files("comwalk"))) / inside


def read_model(source: str | Path, *, geometry: bool = False) -> ModelFile:
    """Read a robot's model from a URDF, MJCF or xacro file, or by its name.

    Args:
        source: Path of a .urdf, .xml, .mjcf or .xacro file, or a name: one of `ROBOTS`,
            of mujoco_menagerie or of robot_descriptions.
        geometry: Whether meshes are loaded, for pictures and self-collision. Bodies,
            joints and inertias are the same without, and loading takes milliseconds.

    Returns:
        The model: the robot alone, with a floating base.

    Raises:
        ModelError: If the name is unknown, or the file is missing or broken.
    """
    name, path = _find(source)
    notes: list[str] = []
    try:
        root = _parse(path, notes)
        if root.tag == "robot":
            file = read_urdf(root, path)
            if geometry:
                add_meshes(file.spec, file.meshes, notes)
        else:
            file = read_mjcf(root, path, geometry=geometry)
        _bring_near(file.spec, notes)
        _use_own_physics(file.spec, notes)
        model = compile_without_bad_meshes(file.spec, notes)
        _check_model(model)
        file = with_limbs_leading(file, model)
    except ModelError as error:
        raise ModelError(f"robot {path}: {error}") from None
    return dataclasses.replace(file, name=name, notes=(*file.notes, *notes))


def _find(source: str | Path) -> tuple[str, Path]:
    """Return the name and the file of a robot."""
    text = str(source)
    if text in _PACKAGES:
        return text, _registered(text)
    path = Path(source).expanduser()
    is_path = isinstance(source, Path) or "/" in text or "\\" in text
    if not is_path and path.suffix.lower() not in _SUFFIXES and not path.is_file():
        return text, _from_zoo(text)
    if path.is_dir() or not path.exists():
        fault = (
            "is a folder; name the file in it" if path.is_dir() else "does not exist"
        )
        raise ModelError(f"robot file {text} {fault}")
    return utf8(path.stem), path


def _registered(name: str) -> Path:
    """Return the file of a robot in the registry."""
    package, inside = _PACKAGES[name]
    for folder in _package_folders(package):
        if (folder / inside).is_file():
            return folder / inside
    raise ModelError(
        f'robot "{name}" is in the package {package}, which is not installed: '
        f"pip install {package}"
    )


def _package_folders(package: str) -> list[Path]:
    """Return the folders that a package may have its files in."""
    if package == "comwalk":
        return [Path(str(files("comwalk")))]
    if package == "example-robot-data":
        prefixes = [Path(p) / "cmeel.prefix" for p in sys.path] + [Path(sys.prefix)]
        return [p / "share" / "example-robot-data" / "robots" for p in prefixes]
    return list(package_folders(package))


def _from_zoo(name: str) -> Path:
    """Return the file of a robot in one of the collections, if they are installed."""
    known = set(ROBOTS)
    for collection, list_names, fetch in _COLLECTIONS:
        names = list_names()
        known |= names
        if name in names:
            try:
                return fetch(name)
            except Exception as error:  # git, network and disk: all have their own
                raise ModelError(
                    f'robot "{name}" of {collection} could not be downloaded: '
                    f"{one_line(error)[:200]}"
                ) from None
    hint = nearest(name, known)
    raise ModelError(
        f'unknown robot "{name}"; '
        f"{nearest(name, ROBOTS) if hint.startswith('known') else hint}; "
        "a model of your own is given by its path, such as ./my_robot.urdf"
    )


def _menagerie_names() -> set[str]:
    """Return the names in mujoco_menagerie, none if it is not installed."""
    try:
        import mujoco_menagerie
    except ImportError:
        return set()
    return set(mujoco_menagerie.names())


def _fetch_from_menagerie(name: str) -> Path:
    import mujoco_menagerie

    return Path(mujoco_menagerie.get(name).path(progress=None))


def _description_names() -> set[str]:
    """Return the names in robot_descriptions, none if it is not installed."""
    try:
        from robot_descriptions import DESCRIPTIONS
    except ImportError:
        return set()
    return set(DESCRIPTIONS)


def _fetch_from_descriptions(name: str) -> Path:
    """Return the file of a robot in robot_descriptions, cloned at need."""
    module = importlib.import_module(f"robot_descriptions.{name}")
    for kind in ("MJCF_PATH", "URDF_PATH", "XACRO_PATH"):
        if hasattr(module, kind):
            return Path(getattr(module, kind))
    raise LookupError("it has neither URDF nor MJCF")


_COLLECTIONS = (
    ("mujoco_menagerie", _menagerie_names, _fetch_from_menagerie),
    ("robot_descriptions", _description_names, _fetch_from_descriptions),
)


@cache
def _read_once(path: Path) -> bytes:
    """Return what a pipe holds, which can be read only once."""
    return path.read_bytes()


def _parse(path: Path, notes: list[str]) -> ET.Element:
    """Return the root of a file, which must be a robot or a MuJoCo model."""
    try:
        text = path.read_bytes() if path.is_file() else _read_once(path)
        if path.suffix.lower() == ".xacro":
            text = _expand_xacro(path)
        root = _parsed(text, notes) if text.strip() else ET.Element("")
    except ET.ParseError as error:
        raise ModelError(f"it is not well-formed XML: {one_line(error)}") from None
    except ModelError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise ModelError(f"it is not readable: {one_line(error)}") from None
    if not text.strip():
        raise ModelError("it is empty; save it again")
    check_depth(root)
    if root.tag not in ("robot", "mujoco"):
        raise ModelError(
            f"its root is <{root.tag}>; a URDF starts with <robot>, an MJCF with "
            "<mujoco>"
        )
    return root


def _parsed(text: bytes, notes: list[str]) -> ET.Element:
    """Return the root of a text, repaired if it is not in the encoding it states."""
    if text.startswith(_LFS_POINTER):
        raise ModelError("it is a Git LFS pointer, not the file itself: git lfs pull")
    try:
        return ET.fromstring(text)
    except (ET.ParseError, ValueError, LookupError):
        try:
            text.decode("utf-8")
        except UnicodeDecodeError as error:
            wrong = text[error.start : error.start + 1]
        else:
            raise
    root = ET.fromstring(_DECLARATION.sub("", text.decode("cp1252", "replace"), 1))
    notes.append(f"not UTF-8 (it has the byte {wrong.hex()}), read as Windows-1252")
    return root


def _expand_xacro(path: Path) -> bytes:
    """Return the URDF that a xacro file expands to."""
    try:
        import xacrodoc
    except ImportError:
        raise ModelError("xacro files need: pip install comwalk[urdf]") from None
    try:
        document = xacrodoc.XacroDoc.from_file(path, resolve_packages=False)
        return document.to_urdf_string().encode()
    except Exception as error:  # xacro raises whatever its expressions raise
        raise ModelError(f"xacro cannot expand it: {one_line(error)}") from None


def _bring_near(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Shift a robot that is placed far away back to the origin."""
    base = spec.worldbody.first_body()
    if np.abs(base.pos).max() > _FARTHEST:
        notes.append(f"moved to the origin from {np.array(base.pos).tolist()} m")
        base.pos = np.zeros(3)
    for key in spec.keys:
        q = np.array(key.qpos)
        if len(q) and np.abs(q[:3]).max() > _FARTHEST:
            notes.append(f'keyframe "{key.name}" moved to the origin')
            q[:3] = 0.0
            key.qpos = q


def _use_own_physics(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Take back what a file says of the simulation: soles slip on a poor solver."""
    usual, changed = mujoco.MjSpec().option, []
    flags = mujoco.mjtDisableBit.__members__.items()
    off = [
        name[7:].lower()
        for name, bit in flags
        if name.startswith("mjDSBL_") and spec.option.disableflags & bit
    ]
    for name in (n for n in dir(usual) if n[0] != "_" and n not in _KEPT):
        value = getattr(usual, name)
        if not np.array_equal(value, getattr(spec.option, name)):
            setattr(spec.option, name, value)
            changed.append(name)
    told = [name for name in changed if name in _TOLD_OPTIONS]
    if told := [*told, *(f"{name} disabled" for name in off)]:
        notes.append(f"<option> {', '.join(told)} left out: comwalk sets its own")


_KEPT = "gravity", "timestep"
_TOLD_OPTIONS = "density", "viscosity", "wind", "o_margin"


def _check_model(model: mujoco.MjModel) -> None:
    """Check numbers, gravity, and that mass and size are a robot's in SI units."""
    for field in ("body_pos", "body_quat", "body_ipos", "body_inertia", "jnt_range"):
        if not np.isfinite(getattr(model, field)).all():
            raise ModelError(f"after compilation, {field} holds numbers not finite")
    x, y, z = model.opt.gravity.tolist()
    if z >= 0.0 or max(abs(x), abs(y)) > 1e-6 * -z:
        raise ModelError(
            f"its gravity is ({x:g}, {y:g}, {z:g}) m/s^2 and must be straight down, as "
            'in <option gravity="0 0 -9.81"/>'
        )
    mass = float(model.body_subtreemass[1])
    if not 0.0 < mass <= _HEAVIEST:
        hint = "give each body its inertia" if mass <= 0.0 else "is it in grams?"
        raise ModelError(
            f"its mass is {mass:.6g} kg and must be in (0, {_HEAVIEST:.0f}] kg; {hint}"
        )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    extent = float(np.ptp(data.xipos[1:], axis=0).max())
    if extent > _FARTHEST:
        raise ModelError(
            f"its bodies are {extent:.6g} m apart; are its lengths in mm? use metres"
        )
