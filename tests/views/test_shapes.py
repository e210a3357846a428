"""What a model looks like: closed, outward triangles where MuJoCo has its geoms."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from comwalk.robot.model import load_robot
from comwalk.views.geoms import shapes_of

VOLUMES = {
    "sphere": ("0.1", 4 / 3 * math.pi * 0.1**3),
    "capsule": ("0.1 0.2", math.pi * 0.01 * (0.4 + 4 / 3 * 0.1)),
    "cylinder": ("0.1 0.2", math.pi * 0.01 * 0.4),
    "ellipsoid": ("0.1 0.2 0.3", 4 / 3 * math.pi * 0.006),
    "box": ("0.1 0.2 0.3", 8 * 0.006),
}


def volume_of(vertices, faces):
    """Return the volume that triangles enclose: positive if they look outward."""
    a, b, c = vertices[faces].astype(float).transpose(1, 0, 2)
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0)


def model_of(geoms):
    """Return a model of a single body."""
    return mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom name='comwalk_floor' type='plane' size='1 1 1'/>"
        f"<body pos='1 2 3'>{geoms}</body></worldbody></mujoco>"
    )


@pytest.mark.parametrize("kind", VOLUMES)
def test_triangles_enclose_the_volume_of_the_geom(kind):
    """Turned and moved in its body, with every triangle looking outward."""
    size, volume = VOLUMES[kind]
    model = model_of(
        f"<geom type='{kind}' size='{size}' pos='1 0 0' euler='30 40 50'/>"
    )
    (shape,) = shapes_of(model)
    assert shape.body == 1
    assert volume_of(shape.vertices - np.float32([1, 0, 0]), shape.faces) == (
        pytest.approx(volume, rel=0.06)
    )
    far = np.linalg.norm(shape.vertices - [1, 0, 0], axis=1).max()
    assert far == pytest.approx(model.geom_rbound[1], rel=0.03)


def test_colours_are_those_of_mujoco():
    """A geom's own colour wins over its material; one shape per body and colour."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><asset><material name='m' rgba='0 1 0 0.5'/></asset><worldbody><body>"
        "<geom size='0.1' material='m'/><geom size='0.1' rgba='1 0 0 1'/>"
        "<geom size='0.1' material='m' rgba='1 0 0 1'/><geom size='.1' rgba='0 0 0 0'/>"
        "</body></worldbody></mujoco>"
    )
    seen = {(s.color, round(s.opacity, 1)): len(s.faces) for s in shapes_of(model)}
    assert set(seen) == {((0, 255, 0), 0.5), ((255, 0, 0), 1.0)}
    assert seen[(255, 0, 0), 1.0] == 2 * seen[(0, 255, 0), 0.5]


def test_meshes_keep_their_place_and_volume():
    """Of a robot with meshes: each mesh against MuJoCo's own volume of it."""
    pytest.importorskip("jvrc_description")
    model = load_robot("jvrc1", geometry=True).model
    shapes = shapes_of(model)
    assert not {s.body for s in shapes} & {0}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for shape in shapes:
        R = data.xmat[shape.body].reshape(3, 3)
        points = data.xpos[shape.body] + shape.vertices @ R.T
        geoms = np.flatnonzero(
            (model.geom_bodyid == shape.body) & (model.geom_group < 3)
        )
        reach = model.geom_rbound[geoms, None]
        near = np.linalg.norm(points - data.geom_xpos[geoms][:, None], axis=2) - reach
        assert near.min(axis=0).max() < 1e-3


def test_a_heavy_mesh_becomes_coarser_within_its_lattice():
    """Fifty thousand triangles of a ball: fewer, none further off than 2 mm."""
    n = 160
    u, v = np.meshgrid(np.linspace(0.02, np.pi - 0.02, n), np.linspace(0, 2 * np.pi, n))
    ball = 0.03 * np.stack(
        [np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], -1
    )
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]
    faces = np.stack([a, d, b, b, d, c], -1).reshape(-1, 3)
    spec = mujoco.MjSpec()
    spec.add_mesh(name="ball", uservert=ball.ravel(), userface=faces.ravel())
    body = spec.worldbody.add_body()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ball")
    (shape,) = shapes_of(spec.compile())
    assert len(shape.faces) < 0.3 * len(faces)
    radius = np.linalg.norm(shape.vertices, axis=1)
    np.testing.assert_allclose(radius, 0.03, atol=2e-3)
    volume = volume_of(shape.vertices, shape.faces)
    assert volume == pytest.approx(4 / 3 * math.pi * 0.03**3, rel=0.05)


def test_planes_and_height_fields_are_surfaces():
    """Looking up, as high as MuJoCo has them; the level floor is left to the page."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><asset><hfield name='h' nrow='2' ncol='3' size='1 2 0.6 0.1' "
        "elevation='0 0.5 1  0 0 0'/></asset><worldbody>"
        "<geom name='comwalk_floor' type='plane' size='0 0 1'/>"
        "<geom type='plane' size='3 4 1' pos='0 0 1' rgba='1 0 0 1'/>"
        "<geom type='hfield' hfield='h' pos='5 0 2'/></worldbody></mujoco>"
    )
    data, hit = mujoco.MjData(model), np.zeros(1, np.int32)
    mujoco.mj_forward(model, data)
    plane, field = shapes_of(model)
    assert np.ptp(plane.vertices, axis=0).tolist() == [6, 8, 0]
    for shape in (plane, field):
        a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    for place in field.vertices:
        start = np.array([*(place[:2] * [1, 1] + 1e-6 * ([5, 0] - place[:2])), 9.0])
        down = np.array([0.0, 0.0, -1.0])
        away = mujoco.mj_ray(model, data, start, down, None, True, -1, hit)
        assert 9.0 - away == pytest.approx(place[2], abs=1e-4)
