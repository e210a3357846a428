"""The up axis of COLLADA meshes: as the file declares it, if the masses agree.

A .dae file says which of its axes points up. Most tools for robots ignore that, some do
not, and robots are made with either in mind. Where meshes declare Y up, they are taken
as turned if that brings them nearer to their links' CoMs.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence

import mujoco
import numpy as np

from ...errors import ModelError
from .mesh_files import mesh_vertices
from .parts import LinkMesh

_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_CLEARLY = 0.8  # how much smaller the distances must get for meshes to be turned


def stand_up(
    meshes: Sequence[LinkMesh], spec: mujoco.MjSpec, notes: list[str]
) -> tuple[LinkMesh, ...]:
    """Return meshes as their links' masses say that they are meant.

    Args:
        meshes: The meshes of a robot.
        spec: The robot, whose bodies have their CoM and mass.
        notes: Gets a line if meshes are turned.

    Returns:
        The meshes, those that declare Y up turned by a right angle, or as they were.
    """
    doubtful = {k: _turned(m) for k, m in enumerate(meshes) if _declares_y_up(m)}
    telling = [k for k in doubtful if meshes[k].collides] or list(doubtful)
    if not telling:
        return tuple(meshes)
    before = sum(_distance(meshes[k], spec) for k in telling)
    after = sum(_distance(doubtful[k], spec) for k in telling)
    if after > _CLEARLY * before:
        return tuple(meshes)
    notes.append(f"{len(doubtful)} meshes turned: their files say that Y is up")
    return tuple(doubtful.get(k, mesh) for k, mesh in enumerate(meshes))


def _declares_y_up(mesh: LinkMesh) -> bool:
    if mesh.file.suffix.lower() != ".dae":
        return False
    with mesh.file.open("rb") as file:
        return bool(re.search(rb"<up_axis>\s*Y_UP\s*<", file.read(20000)))


def _turned(mesh: LinkMesh) -> LinkMesh:
    return dataclasses.replace(mesh, rotation=mesh.rotation @ _Y_UP)


def _distance(mesh: LinkMesh, spec: mujoco.MjSpec) -> float:
    """Return the distance of a mesh from its link's CoM, times the mass [kg m]."""
    body = spec.body(mesh.body)
    try:
        points = mesh_vertices(mesh)
    except ModelError:
        return 0.0
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return float(body.mass * np.linalg.norm(middle - body.ipos))
