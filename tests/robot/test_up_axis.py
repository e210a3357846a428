"""COLLADA meshes that declare Y up are turned when the masses agree."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from test_meshes import CORNERS, DAE, FACES, words

from comwalk.robot.loaders.mesh_files import mesh_vertices
from comwalk.robot.loaders.parts import LinkMesh
from comwalk.robot.loaders.up_axis import stand_up


def robot_with(com: tuple[float, float, float]) -> mujoco.MjSpec:
    """Return a robot of one link."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="link")
    body.mass, body.ipos, body.inertia = 2.0, com, [1, 1, 1]
    body.explicitinertial = True
    return spec


def mesh_of(folder, up: str) -> LinkMesh:
    """Return a mesh that is long along its z axis."""
    file = folder / "mesh.dae"
    text = {"corners": words(CORNERS), "faces": words(FACES)}
    file.write_text(DAE.format(meter=1, up=up, **text))
    scale, R = np.ones(3), np.eye(3)
    return LinkMesh("link", file, np.zeros(3), R, scale, collides=True)


def middle(mesh: LinkMesh) -> np.ndarray:
    """Return the middle of a mesh's extent."""
    points = mesh_vertices(mesh)
    return 0.5 * (points.min(axis=0) + points.max(axis=0))


def test_a_mesh_is_turned_to_where_its_mass_is(tmp_path):
    mesh, notes = mesh_of(tmp_path, "Y_UP"), []
    x, y, z = middle(mesh)
    (turned,) = stand_up([mesh], robot_with((x, -z, y)), notes)
    assert middle(turned) == pytest.approx([x, -z, y])
    assert len(notes) == 1
    assert "Y is up" in notes[0]


def test_a_mesh_that_fits_stays(tmp_path):
    mesh, notes = mesh_of(tmp_path, "Y_UP"), []
    assert stand_up([mesh], robot_with(tuple(middle(mesh))), notes) == (mesh,)
    assert not notes


def test_only_a_declared_axis_turns_a_mesh(tmp_path):
    mesh = mesh_of(tmp_path, "Z_UP")
    x, y, z = middle(mesh)
    assert stand_up([mesh], robot_with((x, -z, y)), []) == (mesh,)
