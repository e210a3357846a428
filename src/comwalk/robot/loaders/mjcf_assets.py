"""Files that an MJCF names, meshes, textures and height fields: missing, or not needed.

A shape goes with its file, and with it what names the shape.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from ...errors import ModelError, one_line
from .meshes import compile_without_bad_meshes
from .parts import first_of, rotation_of

_MESH = mujoco.mjtGeom.mjGEOM_MESH


def meshes_of(spec: mujoco.MjSpec) -> dict[str, mujoco.MjsMesh]:
    """Return the meshes that come from files, by name.

    Args:
        spec: The model.
    """
    return {m.name or Path(m.file).stem: m for m in spec.meshes if m.file}


def mesh_path(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh | mujoco.MjsHField) -> Path:
    """Return the file of a mesh or a height field.

    Args:
        spec: The model.
        mesh: One of its own.
    """
    return _path(spec, mesh.compiler.meshdir, mesh.file)


def _path(spec: mujoco.MjSpec, folder: str, file: str) -> Path:
    return Path(spec.modelfiledir, folder, Path(file).name if spec.strippath else file)


def drop_missing_heights(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Drop height fields whose files are not on disk.

    Args:
        spec: The model; it is changed.
        notes: Gets a line if one is dropped.
    """
    missing = {
        field.name or Path(field.file).stem: field
        for field in spec.hfields
        if field.file and not mesh_path(spec, field).is_file()
    }
    delete_geoms(spec, [g for g in spec.geoms if g.hfieldname in missing])
    if missing:
        names = first_of([field.file for field in missing.values()])
        notes.append(f"height fields not found: {names}")
    for field in missing.values():
        spec.delete(field)


def drop_missing_textures(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Drop textures whose files are not on disk; their colours stay.

    Args:
        spec: The model; it is changed.
        notes: Gets a line if one is dropped.
    """
    missing, names = [], []
    for texture in spec.textures:
        folder = texture.compiler.texturedir
        files = [file for file in (texture.file, *texture.cubefiles) if file]
        lost = [file for file in files if not _path(spec, folder, file).is_file()]
        if lost:
            missing.append(texture)
            names.append(lost[0])
    _delete_textures(spec, missing)
    if names:
        notes.append(f"textures not found: {first_of(names)}")


def drop_textures(spec: mujoco.MjSpec) -> None:
    """Delete textures that come from files.

    Args:
        spec: The model; it is changed.
    """
    _delete_textures(spec, [t for t in spec.textures if t.file or any(t.cubefiles)])


def _delete_textures(spec: mujoco.MjSpec, textures: list[mujoco.MjsTexture]) -> None:
    """Delete textures; materials with them lose their picture alone."""
    dropped = {texture.name or Path(texture.file).stem for texture in textures}
    for texture in textures:
        spec.delete(texture)
    for material in spec.materials:
        for i, name in enumerate(material.textures):
            if name in dropped:
                material.textures[i] = ""


def delete_geoms(spec: mujoco.MjSpec, geoms: list[mujoco.MjsGeom]) -> None:
    """Delete geoms, and the contact pairs and sensors that name them.

    Args:
        spec: The model; it is changed.
        geoms: Geoms of its own.
    """
    names = {geom.name for geom in geoms} - {""}
    is_geom = mujoco.mjtObj.mjOBJ_GEOM
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & names:
            spec.delete(pair)
    for sensor in list(spec.sensors):
        own = sensor.objtype == is_geom and sensor.objname in names
        if own or (sensor.reftype == is_geom and sensor.refname in names):
            spec.delete(sensor)
    for geom in geoms:
        spec.delete(geom)


def missing_meshes(spec: mujoco.MjSpec) -> dict[str, mujoco.MjsMesh]:
    """Return the meshes that are not on disk, by name.

    Args:
        spec: The model.
    """
    meshes = meshes_of(spec).items()
    return {n: mesh for n, mesh in meshes if not mesh_path(spec, mesh).is_file()}


def drop_missing_meshes(spec: mujoco.MjSpec, notes: list[str]) -> None:
    """Drop the meshes that are not on disk; what needs their mass is at fault.

    Args:
        spec: The model; it is changed.
        notes: Gets a line if a mesh is dropped that a geom uses.

    Raises:
        ModelError: If a body has its mass from such a mesh.
    """
    missing = missing_meshes(spec)
    geoms = [geom for geom in spec.geoms if geom.meshname in missing]
    for geom in geoms:
        if _gives_inertia(spec, geom):
            raise ModelError(
                f'body "{geom.parent.name}" has no <inertial>, and its mesh '
                f"{mesh_path(spec, missing[geom.meshname])} does not exist; add one"
            )
    delete_geoms(spec, geoms)
    for mesh in missing.values():
        spec.delete(mesh)
    if geoms:
        names = [Path(mesh.file).name for mesh in missing.values()]
        notes.append(f"{len(names)} mesh files not found: {first_of(names)}")


def drop_meshes(spec: mujoco.MjSpec, notes: list[str], *, solid: bool) -> None:
    """Drop meshes from files; bodies keep the inertia that they had from them.

    Args:
        spec: The model; it is changed.
        notes: Gets a line for each mesh that is not readable.
        solid: Whether those that touch go too; if not, their convex hulls stay, which
            contacts are computed with.

    Raises:
        ModelError: If the model does not compile, which is needed for an inertia or a
            hull.
    """
    drop_textures(spec)
    gone, kept = _mesh_geoms(spec, solid)
    delete_geoms(spec, [geom for geom in gone if not _gives_inertia(spec, geom)])
    drop_unused_meshes(spec)
    if kept:
        compile_without_bad_meshes(spec, notes)
    gone, kept = _mesh_geoms(spec, solid)
    if any(_gives_inertia(spec, geom) for geom in (*gone, *kept)):
        _freeze_inertia(spec)
        delete_geoms(spec, gone)
        drop_unused_meshes(spec)
    if kept:
        _keep_hulls(spec)


def _mesh_geoms(
    spec: mujoco.MjSpec, solid: bool
) -> tuple[list[mujoco.MjsGeom], list[mujoco.MjsGeom]]:
    """Return the geoms with meshes from files that go, and those that stay."""
    files = meshes_of(spec)
    gone, kept = [], []
    for geom in spec.geoms:
        if geom.meshname in files and geom.type == _MESH and not _is_named(spec, geom):
            touches = bool(geom.contype or geom.conaffinity)
            (kept if touches and not solid else gone).append(geom)
    return gone, kept


def _keep_hulls(spec: mujoco.MjSpec) -> None:
    """Put the convex hulls of meshes that touch in their place."""
    model, hulls = _compiled(spec), dict[str, str]()
    for name, mesh in meshes_of(spec).items():
        k = mesh.id
        start, graph = int(model.mesh_vertadr[k]), int(model.mesh_graphadr[k])
        if graph >= 0:
            count = int(model.mesh_graph[graph])
            own = start + model.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]
            points = model.mesh_vert[own] @ rotation_of(model.mesh_quat[k]).T
            points = (points + model.mesh_pos[k]).ravel().tolist()
            hull = spec.add_mesh(name=f"hull of {name}", uservert=points)
            hull.scale, hull.refpos = np.ones(3), np.zeros(3)  # no defaults of the file
            hull.refquat = np.eye(4)[0]
            hulls[name] = hull.name
    for geom in spec.geoms:
        geom.meshname = hulls.get(geom.meshname, geom.meshname)
    drop_unused_meshes(spec)


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"it does not compile: {one_line(error)}") from None


def _gives_inertia(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if geom.parent.explicitinertial and spec.compiler.inertiafromgeom != always:
        return False
    return bool(geom.density if np.isnan(geom.mass) else geom.mass)


def _is_named(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> bool:
    names = {n for pair in spec.pairs for n in (pair.geomname1, pair.geomname2)}
    names |= {n for sensor in spec.sensors for n in (sensor.objname, sensor.refname)}
    return bool(geom.name) and geom.name in names


def drop_unused_meshes(spec: mujoco.MjSpec) -> None:
    """Delete the meshes that no geom uses, unless something soft may.

    Args:
        spec: The model; it is changed.
    """
    used = {geom.meshname for geom in spec.geoms}
    for name, mesh in meshes_of(spec).items():
        if name not in used and not spec.skins and not spec.flexes:
            spec.delete(mesh)


def drop_unused_looks(spec: mujoco.MjSpec, *, sky: bool) -> None:
    """Delete the materials and textures that nothing shows.

    Args:
        spec: The model; it is changed.
        sky: Whether the sky goes too.
    """
    shown = {part.material for part in (*spec.geoms, *spec.sites, *spec.tendons)}
    shown |= {part.material for part in (*spec.skins, *spec.flexes)}
    for material in [m for m in spec.materials if m.name not in shown]:
        spec.delete(material)
    used = {name for material in spec.materials for name in material.textures}
    for texture in list(spec.textures):
        is_sky = texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX
        name = texture.name or Path(texture.file).stem
        if sky if is_sky else name not in used:
            spec.delete(texture)


def _freeze_inertia(spec: mujoco.MjSpec) -> None:
    """Write the inertia that each body gets from its geoms into the body itself."""
    model = _compiled(spec)
    for body in spec.bodies[1:]:
        compiled = model.body(body.name)
        body.explicitinertial = True
        body.mass, body.inertia = float(compiled.mass[0]), compiled.inertia
        body.ipos, body.iquat = compiled.ipos, compiled.iquat
        body.fullinertia = np.full(6, np.nan)
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
