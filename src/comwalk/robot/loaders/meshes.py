"""Meshes and shapes of a URDF in MuJoCo's model: for the eye, and for contact."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError, one_line
from .mesh_files import Part, file_vertices, readable_parts
from .parts import LinkMesh, quaternion_of

_WIDEST = 100.0
"""Extent [m] above which a mesh is in other units."""
VISUAL_GROUP, COLLISION_GROUP = 2, 3
"""Groups of geoms for the eye, and of those for contact."""
_GRAY = (0.7, 0.7, 0.7, 1.0)


def style_geom(
    geom: mujoco.MjsGeom, collides: bool, color: tuple[float, ...] | None
) -> None:
    """Mark a shape of a URDF as meant for the eye or for contact.

    Args:
        geom: The shape.
        collides: Whether it is meant for contact: group 3, else group 2.
        color: Red, green, blue, alpha; None for gray.
    """
    geom.group = COLLISION_GROUP if collides else VISUAL_GROUP
    geom.contype = geom.conaffinity = int(collides)
    geom.rgba = np.array(color or _GRAY)


def add_meshes(
    spec: mujoco.MjSpec, meshes: Iterable[LinkMesh], notes: list[str]
) -> None:
    """Add the meshes of a URDF's links to the model, without mass.

    Args:
        spec: The model with the bodies of the meshes; it is changed.
        meshes: The meshes.
        notes: Gets a line for each mesh that is not readable.

    Raises:
        ModelError: If a mesh is wider than 100 m.
    """
    assets: dict[tuple[Path, tuple[float, ...]], list[tuple[str, Part]]] = {}
    for mesh in meshes:
        key = (mesh.file, tuple(mesh.scale.tolist()))
        if key not in assets:
            assets[key] = _add_assets(spec, mesh, len(assets), notes)
        body = spec.body(mesh.body)
        for name, part in assets[key]:
            geom = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=name,
                pos=mesh.position.tolist(),
                quat=quaternion_of(mesh.rotation).tolist(),
                mass=0.0,
            )
            style_geom(geom, mesh.collides, mesh.color or part.color)


def _add_assets(
    spec: mujoco.MjSpec, mesh: LinkMesh, number: int, notes: list[str]
) -> list[tuple[str, Part]]:
    """Add the parts of a mesh to the model, and return them with their names."""
    try:
        parts = readable_parts(mesh.file)
        for part in parts:
            _check_extent(mesh, file_vertices(part.file) * mesh.scale)
    except (OSError, ValueError) as error:
        notes.append(f"mesh {mesh.file} is not readable, dropped: {one_line(error)}")
        return []
    named = [(f"{mesh.file.stem}_{number}_{k}", part) for k, part in enumerate(parts)]
    for name, part in named:
        spec.add_mesh(
            name=name,
            file=str(part.file.resolve()),
            scale=mesh.scale.tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
    return named


def _check_extent(mesh: LinkMesh, vertices: np.ndarray) -> None:
    """Check that a mesh is not in millimetres."""
    extent = float(np.ptp(vertices, axis=0).max())
    if extent > _WIDEST:
        raise ModelError(
            f'link "{mesh.body}": mesh {mesh.file.name} is {extent:.6g} m wide; if it '
            'is in mm, give it scale="0.001 0.001 0.001"'
        )


def compile_without_bad_meshes(spec: mujoco.MjSpec, notes: list[str]) -> mujoco.MjModel:
    """Compile a model; meshes that MuJoCo refuses are dropped from it.

    Args:
        spec: The model; it is changed.
        notes: Gets a line for each mesh that is dropped.

    Returns:
        The compiled model.

    Raises:
        ModelError: If it does not compile for another reason.
    """
    while True:
        try:
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            text = one_line(error)
        culprit = re.search(r"Element name '([^']+)'", text)
        mesh = spec.mesh(culprit[1]) if culprit else None
        if mesh is None:
            raise ModelError(f"it does not compile: {text}")
        notes.append(f'mesh "{mesh.name}" dropped: {text.removeprefix("Error: ")}')
        for geom in list(spec.geoms):
            if geom.meshname == mesh.name:
                spec.delete(geom)
        spec.delete(mesh)
