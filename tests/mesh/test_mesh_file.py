"""Mesh files with other positions."""

import io

import numpy as np
import pytest
import trimesh

from carigs.errors import CarigsWarning, InputError
from carigs.mesh.mesh_file import moved_mesh_file
from carigs.readers.mesh_files.meshes import read_mesh

NORMAL = ("nx", "ny", "nz")
BALL = trimesh.creation.icosphere(subdivisions=1)


@pytest.mark.parametrize("text", [True, False])
def test_a_ply_keeps_all_but_positions_and_normals(tmp_path, text):
    v, f = BALL.vertices, BALL.faces
    names = ("x", "s", "y", "z", *NORMAL)
    rows = np.zeros(len(v), [(name, "<f8" if name in "xyz" else "<f4") for name in names])
    rows["x"], rows["y"], rows["z"] = v.T
    rows["s"] = np.linspace(0, 1, len(v))
    corners = np.zeros(len(f), [("count", "u1"), ("vertex_indices", "<i4", (3,)), ("quality", "u1")])
    corners["count"], corners["vertex_indices"], corners["quality"] = 3, f, np.arange(len(f))
    header = [
        "ply", f"format {'ascii' if text else 'binary_little_endian'} 1.0", "comment TextureFile skin.png",
        "comment by hand", f"element vertex {len(v)}",
        *(f"property {'double' if name in 'xyz' else 'float'} {name}" for name in names), f"element face {len(f)}",
        "property list uchar int vertex_indices", "property uchar quality", "end_header\n",
    ]  # fmt: skip
    face_lines = (f"3 {' '.join(map(str, face))} {k}" for k, face in enumerate(f))
    lines = [*(" ".join(map(repr, row)) for row in rows.tolist()), *face_lines]
    body = "\n".join([*lines, ""]).encode() if text else rows.tobytes() + corners.tobytes()
    source, output = tmp_path / "ball.ply", tmp_path / "out" / "ball.ply"
    source.write_bytes("\n".join(header).encode() + body)
    output.parent.mkdir()
    made = moved_mesh_file(source, 3 * v, f, output)
    made_header, _, made_body = made.partition(b"end_header\n")
    assert made_header.decode().splitlines() == [line.replace("skin.png", "../skin.png") for line in header[:-1]]
    if text:
        made_lines = made_body.decode().splitlines()
        vertex = np.array([line.split() for line in made_lines[: len(v)]], float)
        assert made_lines[len(v) :] == lines[len(v) :]
    else:
        assert made_body[rows.nbytes :] == corners.tobytes()
        vertex = np.array(np.frombuffer(made_body, rows.dtype, len(v)).tolist())
    np.testing.assert_array_equal(vertex[:, [0, 2, 3]], 3 * v)
    np.testing.assert_array_equal(vertex[:, 1].astype(np.float32), rows["s"])
    assert ((vertex[:, 4:] * v).sum(axis=1) > 0.99).all()


def test_positions_stored_as_whole_numbers_are_not_rounded(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty int x\nproperty int y\nproperty int z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(header + faces + "0 0 0\n4 0 0\n0 4 0\n3 0 1 2\n")
    moved = np.array([[0.25, 0, 0], [4, 0, 0], [0, 4, 0.5]])
    content = moved_mesh_file(tmp_path / "a.ply", moved, np.array([[0, 1, 2]]), tmp_path / "b.ply")
    np.testing.assert_array_equal(trimesh.load(io.BytesIO(content), file_type="ply", process=False).vertices, moved)


def test_an_obj_that_does_not_move_keeps_its_lines(tmp_path):
    text = "# a comment\r\no head\r\nv 0.10 0 0 255 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nv nan 0 0\r\ns 1\r\nf 1 2 3\r\n"
    (tmp_path / "a.obj").write_bytes(text.encode())
    vertices = np.array([[0.1, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]])
    faces = np.array([[0, 1, 2]])
    same = moved_mesh_file(tmp_path / "a.obj", vertices, faces, tmp_path / "b.obj").decode()
    assert same == text
    vertices[0] = 1 / 3
    moved = moved_mesh_file(tmp_path / "a.obj", vertices, faces, tmp_path / "b.obj").decode()
    assert "v 0.333333333333 0.333333333333 0.333333333333 255 0 0\r\n" in moved


@pytest.mark.parametrize("source", ["obj", "ply", "off", "stl", "glb"])
@pytest.mark.parametrize("output", ["obj", "ply", "off", "stl", "glb"])
def test_every_pair_of_formats_keeps_vertices_and_triangles(tmp_path, source, output):
    BALL.export(tmp_path / f"a.{source}")
    given = read_mesh(tmp_path / f"a.{source}")
    vertices = 2 * np.asarray(given.vertices)
    file = tmp_path / f"b.{output}"
    file.write_bytes(moved_mesh_file(tmp_path / f"a.{source}", vertices, np.asarray(given.faces), file))
    made = read_mesh(file)
    np.testing.assert_allclose(made.vertices[made.faces], vertices[given.faces], rtol=1e-6)
    if output != "stl":
        np.testing.assert_array_equal(made.faces, given.faces)


@pytest.mark.parametrize("kind", ["obj", "ply", "glb"])
def test_lost_texture_coordinates_are_said(tmp_path, kind):
    from PIL import Image

    textured = BALL.copy()
    uv = np.abs(BALL.vertices[:, :2])
    textured.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.new("RGB", (2, 2)))
    textured.export(tmp_path / f"a.{kind}")
    mesh = read_mesh(tmp_path / f"a.{kind}")
    with pytest.warns(CarigsWarning, match="without the texture coordinates"):
        moved_mesh_file(tmp_path / f"a.{kind}", np.asarray(mesh.vertices), np.asarray(mesh.faces), tmp_path / "b.off")


def test_a_file_that_changed_meanwhile_is_refused(tmp_path):
    for kind in ("obj", "ply"):
        BALL.export(tmp_path / f"a.{kind}")
        with pytest.raises(InputError, match="42 vertices, 3 a moment ago"):
            moved_mesh_file(tmp_path / f"a.{kind}", np.eye(3), np.array([[0, 1, 2]]), tmp_path / f"b.{kind}")


def test_a_list_as_a_coordinate_of_a_ply_is_refused(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty list uchar float x\n"
    header += "property float y\nproperty float z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(header + faces + "1 0 0 0\n1 4 0 0\n1 0 4 0\n3 0 1 2\n")
    with pytest.raises(InputError, match=r"a\.ply: vertex\.x: a list"):
        moved_mesh_file(tmp_path / "a.ply", np.eye(3), np.array([[0, 1, 2]]), tmp_path / "b.ply")
