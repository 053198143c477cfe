"""The reader of .obj: vertices and faces in the order of the file."""

import numpy as np
import pytest
import trimesh

from carigs.errors import InputError
from carigs.readers.mesh_files.meshes import read_mesh
from carigs.readers.mesh_files.obj import parse_obj

CUBE = trimesh.creation.box()


def test_vertices_are_those_of_the_file_whatever_belongs_to_their_corners(tmp_path):
    """Two materials, texture seams, an unused vertex, negative numbers, a polygon, a continued line."""
    content = b"""mtllib missing.mtl
v 0 0 0 1 0 0
v 1 0 0
v 1 1 0\r
v 0 1 0
v 7 7 7
 v 0 0 1
vt 0 0
vt 1 1
usemtl a
f 1/1 2/2 3/1 4/2
usemtl b
f 1/2/1 2//1 \\
  6/1
f -6 -1 -3
"""
    (tmp_path / "head.obj").write_bytes(content)
    mesh = read_mesh(tmp_path / "head.obj")
    expected = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [7, 7, 7], [0, 0, 1]]
    np.testing.assert_array_equal(mesh.vertices, expected)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 5], [0, 5, 3]])


def test_agrees_with_an_independent_writer():
    found = parse_obj(CUBE.export(file_type="obj").encode(), "cube.obj")
    np.testing.assert_allclose(found.vertices, CUBE.vertices, atol=1e-8)
    np.testing.assert_array_equal(found.corners.reshape(-1, 3), CUBE.faces)
    assert set(found.lengths) == {3}


@pytest.mark.parametrize(
    "line",
    ["v 0 0", "v 0 0 x", "f 1 2", "f 1 2 0", "f 1 2 -4", "f 1 2 x", "f 1/1 2/1 /1", "f 1.5 2 3", f"f 1 2 {10**30}"],
)
def test_a_broken_line_is_named(line):
    with pytest.raises(InputError, match=r"head\.obj: (line 4|faces): "):
        parse_obj(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\n".encode(), "head.obj")


def test_vertices_of_a_ply_are_not_split_at_seams(tmp_path):
    """Texture coordinates per corner: libraries split the vertices, which changes their numbers."""
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    (tmp_path / "seam.ply").write_text(
        header + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2 6 0 0 1 0 0 1\n3 1 3 2 6 .5 .5 .6 .6 .7 .7\n"
    )
    mesh = read_mesh(tmp_path / "seam.ply")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [1, 3, 2]])


@pytest.mark.parametrize("comment", ["# folder C:\\heads\\", "  # a\\", "#\\"])
def test_a_comment_that_ends_with_a_backslash_swallows_no_vertex(comment):
    plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n"
    found, expected = (parse_obj(text.encode(), "a.obj") for text in (f"{comment}\n{plain}", plain))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_line_that_ends_with_a_backslash_goes_on():
    parts = parse_obj(b"v 0 0 \\\n0\nv 1 0 0\nv 0 1 0\nf 1 \\\r\n2 \\\n3\n", "a.obj")
    assert len(parts[0]) == 3 and parts[1].tolist() == [0, 1, 2]
