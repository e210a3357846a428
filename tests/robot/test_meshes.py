"""Meshes: finding files by any kind of name, reading formats, and converting them."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comwalk.errors import ModelError
from comwalk.robot.loaders.mesh_files import find_mesh, package_folders
from comwalk.robot.loaders.meshes import add_meshes, compile_without_bad_meshes
from comwalk.robot.loaders.parts import first_of, quaternion_of
from comwalk.robot.loaders.sources import LinkMesh, mesh_vertices, read_model

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{meter}"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert>
<diffuse><color>0.2 0.4 0.6 1</color></diffuse></lambert></technique></profile_COMMON>
</effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">{corners}</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X"
 type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="4" material="k"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{faces}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n">
<matrix>0 -1 0 5  1 0 0 0  0 0 1 0  0 0 0 1</matrix>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="k" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def words(array: np.ndarray) -> str:
    """Return the numbers of an array as text."""
    return " ".join(f"{x:g}" for x in np.ravel(array))


def write(path: Path) -> Path:
    """Write the tetrahedron in the format of the file's ending."""
    if path.name.endswith("text.stl"):
        facets = "".join(
            "facet normal 0 0 0\n outer loop\n"
            + "".join(f"  vertex {words(CORNERS[i])}\n" for i in face)
            + " endloop\nendfacet\n"
            for face in FACES
        )
        path.write_text(f"solid x\n{facets}endsolid x\n")
    elif path.suffix.lower() == ".stl":
        kind = [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]
        records = np.zeros(len(FACES), kind)
        records["c"] = CORNERS[FACES]
        count = len(FACES).to_bytes(4, "little")
        path.write_bytes(b"solid trap".ljust(80) + count + records.tobytes())
    elif path.suffix == ".obj":
        lines = [f"v {words(v)}" for v in CORNERS] + ["vn 0 0 1"]
        lines += [f"f {words(face + 1)}" for face in FACES]
        path.write_text("\n".join(lines))
    elif path.suffix == ".ply":
        head = (
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n"
            "property float y\nproperty float z\nelement face 4\nproperty list uchar "
            "int vertex_indices\nend_header\n"
        )
        lines = [words(v) for v in CORNERS] + [f"3 {words(face)}" for face in FACES]
        path.write_text(head + "\n".join(lines) + "\n")
    else:
        text = {"corners": words(CORNERS), "faces": words(FACES)}
        path.write_text(DAE.format(meter=1, up="Z_UP", **text))
    return path


def link_mesh(file: Path, **changes) -> LinkMesh:
    """Return a mesh of the body `a`, in its frame unless changed."""
    fields = {
        "position": np.zeros(3),
        "rotation": np.eye(3),
        "scale": np.ones(3),
        "collides": False,
    }
    return LinkMesh(body="a", file=file, **(fields | changes))


def one_body() -> mujoco.MjSpec:
    """Return a model with a floating body `a`."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="a", mass=1.0, inertia=[1.0, 1.0, 1.0])
    body.explicitinertial = True
    body.add_freejoint()
    return spec


def unique(points: np.ndarray) -> np.ndarray:
    """Return the points in order, each once."""
    return np.unique(points.round(6) + 0.0, axis=0)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Keep converted meshes out of the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "comwalk" / "meshes"


@pytest.mark.parametrize("name", ["a.stl", "b.STL", "text.stl", "a.obj", "a.ply"])
def test_formats_hold_the_same_vertices(tmp_path, name):
    got = mesh_vertices(link_mesh(write(tmp_path / name)))
    assert unique(got) == pytest.approx(unique(CORNERS))


def test_a_dae_has_its_nodes_transform(tmp_path):
    got = mesh_vertices(link_mesh(write(tmp_path / "a.dae")))
    turned = CORNERS @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [5, 0, 0]
    assert unique(got) == pytest.approx(unique(turned))


def test_a_dae_keeps_its_unit_and_not_its_up_axis(tmp_path):
    text = {"corners": words(CORNERS), "faces": words(FACES)}
    (tmp_path / "m.dae").write_text(DAE.format(meter=1, up="Z_UP", **text))
    (tmp_path / "mm.dae").write_text(DAE.format(meter=0.001, up="Y_UP", **text))
    metres, millimetres = (
        mesh_vertices(link_mesh(tmp_path / name)) for name in ("m.dae", "mm.dae")
    )
    assert 0.001 * metres == pytest.approx(millimetres)


def test_vertices_are_scaled_turned_and_moved(tmp_path):
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = link_mesh(
        write(tmp_path / "a.stl"),
        position=np.array([1.0, 2.0, 3.0]),
        rotation=R,
        scale=np.array([2.0, -1.0, 0.5]),
    )
    expected = (CORNERS * [2, -1, 0.5]) @ R.T + [1, 2, 3]
    assert unique(mesh_vertices(mesh)) == pytest.approx(unique(expected))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.stl", ""),
        ("a.stl", "solid x\nendsolid"),
        ("a.obj", "v 1 2 x"),
        ("a.obj", "v 1 2 nan"),
        ("a.dae", "<COLLADA"),
        ("a.ply", "ply"),
        ("a.unknown", "what"),
    ],
)
def test_a_broken_mesh_is_named_in_one_line(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(ModelError, match=name) as fault:
        mesh_vertices(link_mesh(tmp_path / name))
    assert "\n" not in str(fault.value)
    with pytest.raises(ModelError, match="not readable"):
        mesh_vertices(link_mesh(tmp_path / "absent.stl"))


@pytest.mark.parametrize("name", ["a.stl", "text.stl", "a.obj", "a.ply", "a.dae"])
def test_mujoco_sees_the_mesh_where_mesh_vertices_says(tmp_path, name):
    spec, notes = one_body(), []
    R = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    mesh = link_mesh(
        write(tmp_path / name),
        position=np.array([0.1, 0.2, 0.3]),
        rotation=R,
        scale=np.array([1.0, -2.0, 0.5]),
    )
    add_meshes(spec, [mesh, mesh], notes)
    model = compile_without_bad_meshes(spec, notes)
    assert (notes, model.nmesh, model.ngeom) == ([], 1, 2)
    pose = np.empty(9)
    mujoco.mju_quat2Mat(pose, model.geom_quat[0])
    seen = model.mesh_vert @ pose.reshape(3, 3).T + model.geom_pos[0]
    assert unique(seen.round(4)) == pytest.approx(
        unique(mesh_vertices(mesh).round(4)), abs=2e-4
    )


def test_conversion_happens_once_and_keeps_the_color(tmp_path, cache):
    file = write(tmp_path / "a.dae")
    for _ in range(2):
        spec = one_body()
        add_meshes(spec, [link_mesh(file)], [])
        assert spec.geoms[0].rgba == pytest.approx([0.2, 0.4, 0.6, 1.0])
        assert (spec.geoms[0].group, spec.geoms[0].contype) == (2, 0)
        converted = list(cache.glob("*/*.stl"))
        assert len(converted) == 1
        converted[0].touch()
    spec = one_body()
    add_meshes(spec, [link_mesh(file, color=(1.0, 0.0, 0.0, 1.0), collides=True)], [])
    assert spec.geoms[0].rgba == pytest.approx([1.0, 0.0, 0.0, 1.0])
    assert (spec.geoms[0].group, spec.geoms[0].contype) == (3, 1)


def test_a_cache_that_cannot_be_written_is_no_fault(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    spec, notes = one_body(), []
    add_meshes(spec, [link_mesh(write(tmp_path / "a.ply"))], notes)
    assert not notes
    assert spec.compile().nmesh == 1


def test_unreadable_and_flat_meshes_are_dropped_with_a_note(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"")
    flat = write(tmp_path / "flat.obj")
    flat.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    good = write(tmp_path / "good.stl")
    spec, notes = one_body(), []
    files = (tmp_path / "broken.stl", flat, good)
    add_meshes(spec, [link_mesh(file, collides=True) for file in files], notes)
    model = compile_without_bad_meshes(spec, notes)
    assert model.nmesh == model.ngeom == 1
    assert ["broken" in notes[0], "flat" in notes[1], len(notes)] == [True, True, 2]


def test_millimetres_are_guessed(tmp_path):
    mesh = link_mesh(write(tmp_path / "a.stl"), scale=np.full(3, 1000.0))
    with pytest.raises(ModelError, match="3000 m wide; if it is in mm, give it scale"):
        add_meshes(one_body(), [mesh], [])


PLACES = {
    "package://bot/meshes/a.stl": "ws/bot/meshes/a.stl",
    "package:///bot/meshes/a.stl": "ws/bot/meshes/a.stl",
    "model://bot/meshes/a.stl": "ws/bot/meshes/a.stl",
    "package://renamed/meshes/a.stl": "ws/bot/meshes/a.stl",
    "../meshes/a.stl": "ws/bot/meshes/a.stl",
    "meshes/a.stl": "ws/bot/meshes/a.stl",
    "..\\meshes\\a.stl": "ws/bot/meshes/a.stl",
    "local.stl": "ws/bot/urdf/local.stl",
    "package://ros1/a.stl": "one/ros1/a.stl",
    "package://itself/a.stl": "two/itself/a.stl",
    "package://ros2/a.stl": "ament/share/ros2/a.stl",
    "package://bot/meshes/absent.stl": None,
    "absent.stl": None,
    "package://": None,
    "": None,
    "/no/such/file.stl": None,
    "https://example.org/a.stl": None,
    "a\0b.stl": None,
}


@pytest.mark.parametrize("name", PLACES)
def test_names_of_all_kinds_are_found(tmp_path, monkeypatch, name):
    for place in {place for place in PLACES.values() if place}:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("x")
    (tmp_path / "ws/bot/urdf").mkdir(exist_ok=True)
    ros = f"{tmp_path}/one:{tmp_path}/two/itself"
    monkeypatch.setenv("ROS_PACKAGE_PATH", ros.replace(":", os.pathsep))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    found = find_mesh(name, [tmp_path / "ws/bot/urdf"])
    place = PLACES[name]
    assert (found and found.resolve()) == (place and (tmp_path / place).resolve())


def test_absolute_paths_and_uris_are_found(tmp_path):
    file = tmp_path / "with space.stl"
    file.write_text("x")
    uri = f"file://{file}".replace(" ", "%20")
    for name in (str(file), uri, f"file://{file}"):
        assert find_mesh(name, [Path("/nowhere")]) == file


def test_python_packages_are_found_without_import():
    found = find_mesh("package://jvrc_description/meshes/L_KNEE_S.dae", [Path("/x")])
    assert found
    assert found.parent.name == "meshes"
    assert package_folders("no_such_package_here") == ()
    assert package_folders("not-a-name") == ()


@given(st.text(max_size=40))
def test_no_name_breaks_the_search(name):
    found = find_mesh(name, [Path("/nonexistent/folder")])
    assert found is None or found.is_file()


def test_all_meshes_of_a_robot_with_dae_are_read():
    robot = read_model("jvrc1")
    assert len(robot.meshes) == 70
    shin = next(m for m in robot.meshes if m.body == "L_KNEE_S")
    points = mesh_vertices(shin)
    assert np.ptp(points, axis=0).max() == pytest.approx(0.45, abs=0.1)


def test_lists_of_names_are_short():
    assert first_of(["a", "b"]) == "a, b"
    assert first_of(list("abcdef"), 2) == "a, b and 4 more"
    assert quaternion_of(np.eye(3)) == pytest.approx([1, 0, 0, 0])
