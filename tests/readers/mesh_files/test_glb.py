"""GLB: the triangles of a scene as trimesh reads them, and nothing that the file does not hold."""

from __future__ import annotations

import base64
import json
import os
import struct
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.errors import CarigsWarning, InputError
from carigs.readers.mesh_files.glb import parse_glb
from carigs.readers.mesh_files.meshes import read_mesh

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], "<u4")


def document() -> dict[str, Any]:
    """A tetrahedron."""
    return {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 96}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 48}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
        ],
    }  # fmt: skip


def glb(content: dict[str, Any], binary: bytes = VERTICES.tobytes() + FACES.tobytes()) -> bytes:
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_positions_and_triangles_come_back():
    vertices, faces = parse_glb(glb(document()), "a.glb")
    np.testing.assert_array_equal(vertices, VERTICES)
    np.testing.assert_array_equal(faces, FACES)


@pytest.mark.parametrize("seed", range(3))
def test_scenes_are_read_as_by_trimesh(seed, tmp_path):
    """A tree of nodes with transforms, two meshes and an instance: the same triangles in space, in any order."""
    rng = np.random.default_rng(seed)
    scene = trimesh.Scene()
    parent = None
    for k, mesh in enumerate((trimesh.creation.icosahedron(), trimesh.creation.box(), trimesh.creation.icosahedron())):
        transform = np.eye(4)
        transform[:3, :3] = Rotation.random(random_state=10 * seed + k).as_matrix() * rng.uniform(0.5, 2)
        transform[:3, 3] = rng.normal(size=3)
        scene.add_geometry(mesh, node_name=f"n{k}", geom_name=f"g{k}", parent_node_name=parent, transform=transform)
        parent = f"n{k}"
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    found = read_mesh(tmp_path / "a.glb")
    theirs = trimesh.load(tmp_path / "a.glb", force="mesh", process=False)

    def sorted_triangles(mesh: trimesh.Trimesh) -> np.ndarray:
        rows = np.asarray(mesh.triangles).reshape(-1, 9).round(4)
        return rows[np.lexsort(rows.T)]

    np.testing.assert_allclose(sorted_triangles(found), sorted_triangles(theirs), atol=2e-4)


def sparse(order=(1, 3), count=2, **more) -> bytes:
    """The tetrahedron, of whose vertices two are stored as replacements."""
    content, first = document(), VERTICES.copy()
    first[[1, 3]] = 7
    binary = first.tobytes() + FACES.tobytes() + np.array(order, "<u2").tobytes() + VERTICES[[1, 3]].tobytes()
    content["buffers"] = [{"byteLength": len(binary)}]
    content["bufferViews"] += [
        {"buffer": 0, "byteOffset": 96, "byteLength": 4},
        {"buffer": 0, "byteOffset": 100, "byteLength": 24},
    ]
    content["accessors"][0]["sparse"] = {
        "count": count, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}
    }  # fmt: skip
    content["accessors"][0] |= more
    return glb(content, binary)


def test_sparse_positions_replace_those_of_the_view():
    np.testing.assert_array_equal(parse_glb(sparse(), "a.glb")[0], VERTICES)


def test_sparse_positions_without_a_view_replace_zeros():
    content = sparse().replace(b'"bufferView": 0, "componentType": 5126', b'"componentType": 5126                 ', 1)
    vertices = parse_glb(content, "a.glb")[0]
    np.testing.assert_array_equal(vertices, VERTICES * [[0], [1], [0], [1]])
    with pytest.raises(InputError, match=r"accessors\[0\]: 1000000000 elements; at most"):
        parse_glb(
            content.replace(b'"count": 4, ', b'"count":1000000000,', 1).replace(b"                 ", b"          "),
            "a.glb",
        )


@pytest.mark.parametrize("order", [(3, 1), (1, 1), (1, 4)])
def test_sparse_indices_increase_and_exist(order):
    with pytest.raises(InputError, match=r"accessors\[0\]\.sparse\.indices: expected increasing numbers below 4"):
        parse_glb(sparse(order), "a.glb")
    with pytest.raises(InputError, match=r"accessors\[0\]\.sparse\.indices: 200 x 2 bytes, more than there are"):
        parse_glb(sparse(count=200), "a.glb")


@pytest.mark.parametrize("uri", ["data", "a b.bin", "parts/a.bin", "parts\\a.bin"])
def test_a_gltf_is_read_with_buffers_inside_and_beside(tmp_path, uri):
    binary, content = VERTICES.tobytes() + FACES.tobytes(), document()
    data = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    content["buffers"][0]["uri"] = data if uri == "data" else uri.replace(" ", "%20")
    if uri != "data":
        (tmp_path / "parts").mkdir()
        (tmp_path / uri.replace("\\", "/")).write_bytes(binary)
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    found = read_mesh(tmp_path / "a.gltf")
    np.testing.assert_array_equal(found.vertices, VERTICES)
    np.testing.assert_array_equal(found.faces, FACES)


@pytest.mark.parametrize(
    ("uri", "says"),
    [
        ("../a.bin", "outside"), ("%2e%2e/a.bin", "outside"), ("..\\a.bin", "outside"), ("/etc/passwd", "outside"),
        ("file:///etc/passwd", "outside"), ("http://localhost/a", "outside"), ("C:\\a.bin", "outside"),
        ("", "outside"),
        ("data:;base64,QQ=", "broken base64"), ("data:,abc", "outside"), ("none.bin", "no such buffer"),
        (3, "a string"), ("pipe", "pipe"), (None, "no data"),
    ],
)  # fmt: skip
def test_a_gltf_opens_nothing_outside_of_its_folder(tmp_path, uri, says):
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.bin").write_bytes(VERTICES.tobytes() + FACES.tobytes())
    os.mkfifo(tmp_path / "folder/pipe")
    content = document()
    content["buffers"][0] |= {} if uri is None else {"uri": uri}
    (tmp_path / "folder/a.gltf").write_text(json.dumps(content))
    with pytest.raises(InputError, match=says) as caught:
        read_mesh(tmp_path / "folder/a.gltf")
    assert "\n" not in str(caught.value) and "folder" in str(caught.value)


def test_translation_rotation_and_scale_apply_in_this_order():
    content = document()
    rotation = Rotation.from_rotvec([0.3, -0.2, 0.9])
    content["nodes"] = [{"translation": [1, 2, 3], "children": [1]}, {"mesh": 0}]
    content["nodes"][1] |= {"rotation": rotation.as_quat().tolist(), "scale": [2, 3, 4]}
    vertices, _ = parse_glb(glb(content), "a.glb")
    np.testing.assert_allclose(vertices, rotation.apply(VERTICES * [2, 3, 4]) + np.array([1, 2, 3]), atol=1e-12)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, -2, 1], [-1, -1, -1], [-1, -1, 1]])
def test_a_mirrored_node_keeps_what_faces_outwards(scale):
    """The faces of a tetrahedron: its volume is positive, mirrored or not."""
    content = document()
    content["nodes"][0]["scale"] = scale
    vertices, faces = parse_glb(glb(content), "a.glb")
    assert volume(vertices, faces) == pytest.approx(abs(np.prod(scale)) * volume(VERTICES, FACES))
    assert volume(vertices, faces) > 0


@pytest.mark.filterwarnings("error")
def test_joints_and_morph_targets_that_move_vertices_are_warned_of():
    content = document()
    content["nodes"][0] |= {"skin": 0, "translation": [0, 0, 3]}
    with pytest.warns(CarigsWarning, match=r"a\.glb: nodes\[0\]: its joints \(skin\) are not applied"):
        vertices, _ = parse_glb(glb(content), "a.glb")
    np.testing.assert_array_equal(vertices, VERTICES)  # joints alone would place them
    for place in ("nodes", "meshes"):
        content = document()
        content[place][0]["weights"] = [0, 1]
        with pytest.warns(CarigsWarning, match="its morph targets have weights"):
            parse_glb(glb(content), "a.glb")
        content[place][0]["weights"] = [0, 0.0]
        parse_glb(glb(content), "a.glb")


def test_vertices_that_primitives_share_appear_once():
    content = document()
    content["meshes"][0]["primitives"] *= 3
    vertices, faces = parse_glb(glb(content), "a.glb")
    assert len(vertices) == 4
    np.testing.assert_array_equal(faces, np.tile(FACES, (3, 1)))


def test_a_primitive_without_indices_is_a_list_of_corners():
    content = document()
    del content["meshes"][0]["primitives"][0]["indices"]
    content["accessors"][0]["count"] = 3
    np.testing.assert_array_equal(parse_glb(glb(content), "a.glb")[1], [[0, 1, 2]])


def change(*path: Any, **values: Any) -> Callable[[dict[str, Any]], None]:
    def apply(content: Any) -> None:
        for key in path:
            content = content[key]
        content.update(values)

    return apply


def twice_each(content: dict[str, Any]) -> None:
    """2^30 instances, if a node could be the child of two."""
    content["nodes"] = [{"children": [i + 1, i + 1]} for i in range(30)] + [{"mesh": 0}]


REFUSED = {
    "no data, 60 million zeros": (
        lambda c: (c["accessors"][0].update(count=60_000_000), c["accessors"][0].pop("bufferView")),
        r"accessors\[0\].bufferView: this key is missing",
    ),
    "lying count": (change("accessors", 0, count=10**9), r"accessors\[0\]: .* more than there are"),
    "lying view": (change("bufferViews", 0, byteLength=10**9), r"accessors\[0\]: .* more than there are"),
    "offset at the end": (change("accessors", 0, byteOffset=4), r"accessors\[0\]: .* more than there are"),
    "negative offset": (change("accessors", 0, byteOffset=-12), r"accessors\[0\].byteOffset: expected 0 or larger"),
    "huge offset": (change("bufferViews", 0, byteOffset=2**62), r"accessors\[0\]: .* more than there are"),
    "stride 0": (change("bufferViews", 0, byteStride=0), r"accessors\[0\]: "),
    "sparse": (change("accessors", 0, sparse={"count": 1}), r"accessors\[0\]\.sparse\.indices: this key is missing"),
    "positions of integers": (change("accessors", 0, componentType=5122), r"accessors\[0\]: expected a VEC3"),
    "another file": (change("buffers", 0, uri="../../etc/passwd"), "data outside the file"),
    "an address": (change("buffers", 0, uri="http://localhost/"), "data outside the file"),
    "another buffer": (change("bufferViews", 0, buffer=7), r"buffers\[7\]: no such object"),
    "a vertex that is not there": (change("accessors", 0, count=3), "no triangles of its vertices"),
    "half a triangle": (change("accessors", 1, count=10), "no triangles of its vertices"),
    "a strip": (change("meshes", 0, "primitives", 0, mode=5), "only lists of triangles"),
    "its own child": (change("nodes", 0, children=[0]), r"nodes\[0\]: hangs on two nodes, or on itself"),
    "2^30 instances": (twice_each, r"nodes\[30\]: hangs on two nodes"),
    "no such mesh": (change("nodes", 0, mesh=-1), r"meshes\[-1\]: no such object"),
    "no rotation": (change("nodes", 0, rotation=[0, 0, 0, 0]), r"nodes\[0\].rotation: no unit quaternion"),
    "half a matrix": (change("nodes", 0, matrix=[1] * 8), r"nodes\[0\].matrix: shape"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_named_and_nothing_is_allocated(name):
    damage, says = REFUSED[name]
    content = document()
    damage(content)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=says):
            parse_glb(glb(content), "a.glb")
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_instances_without_end_are_refused(monkeypatch):
    monkeypatch.setattr("carigs.readers.mesh_files.glb.MAX_CORNERS", 30)
    content = document()
    content["nodes"] = [{"mesh": 0}] * 3
    content["scenes"] = [{"nodes": [0, 1, 2]}]
    with pytest.raises(InputError, match="more than 30 corners"):
        parse_glb(glb(content), "a.glb")


def test_a_small_file_shows_no_more_than_its_size_allows(monkeypatch):
    monkeypatch.setattr("carigs.readers.limits.SMALL_BYTES", 0)
    content = document()
    content["nodes"] = [{"mesh": 0}] * 1000
    content["scenes"] = [{"nodes": list(range(1000))}]
    with pytest.raises(InputError, match="corners of triangles"):
        parse_glb(glb(content), "a.glb")
    content["scenes"] = [{"nodes": [0, 1]}]
    assert len(parse_glb(glb(content), "a.glb")[1]) > 0


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_file_cut_or_changed_anywhere_is_data_or_a_typed_error(data):
    content = bytearray(glb(document()))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    try:
        vertices, faces = parse_glb(bytes(content), "a.glb")
    except InputError as error:
        assert str(error).startswith("a.glb: ")
    else:
        assert len(faces) == 0 or faces.max() < len(vertices)
