"""Text in any file: a byte order mark is no part of it, lines end as on any system, other encodings are named."""

from __future__ import annotations

import codecs
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from carigs.config.overrides import split_overrides
from carigs.errors import CarigsError, CarigsWarning, InputError
from carigs.mesh.mesh_file import moved_mesh_file
from carigs.readers.colmap import read_colmap
from carigs.readers.json_files import read_json
from carigs.readers.mesh_files.meshes import read_mesh
from carigs.readers.mesh_files.obj import read_obj_uvs
from carigs.readers.mesh_files.ply import read_ply_vertices
from carigs.readers.text import decode_text, encode_text, split_lines
from carigs.readers.yaml_files import read_yaml_text

SOLID = trimesh.creation.icosahedron()
V, F = np.asarray(SOLID.vertices), np.asarray(SOLID.faces)


def obj(comment=""):
    lines = [f"# {comment}", "v 9 9 9", *("v {!r} {!r} {!r}".format(*map(float, v)) for v in V)]
    return "\n".join([*lines, *("f {} {} {}".format(*(face + 2)) for face in F), ""])


def ply(comment=""):
    header = ["ply", "format ascii 1.0", f"comment {comment}", "element vertex 12"]
    header += [f"property double {name}" for name in "xyz"] + [
        "element face 20",
        "property list uchar int vertex_index",
    ]
    rows = [" ".join(map(repr, row)) for row in V.tolist()] + [f"3 {a} {b} {c}" for a, b, c in F]
    return "\n".join([*header, "end_header", *rows, ""])


def off(comment=""):
    rows = [" ".join(map(repr, row)) for row in V.tolist()] + [f"3 {a} {b} {c}" for a, b, c in F]
    return "\n".join([f"OFF # {comment}", "12 20 30", *rows, ""])


def stl(comment=""):
    facets = [
        "\n".join(["facet normal 0 0 0", "outer loop", *("vertex {!r} {!r} {!r}".format(*map(float, V[i])) for i in f)])
        + "\nendloop\nendfacet"
        for f in F
    ]
    return "\n".join([f"solid {comment}", *facets, "endsolid", ""])


MESHES = {"a.obj": obj, "a.ply": ply, "a.off": off, "a.stl": stl}
CAMERAS = "# Camera list\n# Number of cameras: 1\n1 PINHOLE 40 30 50 50 20 15\n"
IMAGES = "# Image list\n# Number of images: 2\n" + "".join(f"{k} 1 0 0 0 0 0 {k} 1 ä{k}.png\n\n" for k in (1, 2))


def colmap(folder):
    return [(image.name, image.translation, image.camera.fx) for image in read_colmap(folder)]


def write_colmap(folder, change):
    (folder / "cameras.txt").write_bytes(change(CAMERAS))
    (folder / "images.txt").write_bytes(change(IMAGES))


def one_file(name, read, text):
    """A reader of a folder with one file of this text."""
    return lambda folder: read(folder / name), lambda folder, change: (folder / name).write_bytes(change(text))


def triangles(file):
    return read_mesh(file).triangles.tolist()


DOORS = {
    **{name: one_file(name, triangles, text("a comment")) for name, text in MESHES.items()},
    "texture": one_file("a.obj", read_obj_uvs, "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"),
    "surfels": one_file("a.ply", lambda file: read_ply_vertices(file).tolist(), ply()),
    "json": one_file("a.json", read_json, '{\n "ä": [1, 2.5]\n}\n'),
    "yaml": one_file("a.yaml", lambda file: split_lines(read_yaml_text(file)), "a: 1\nb: ä\n"),
    "overrides": one_file("a", lambda file: split_overrides(f"@{file}", "overrides"), "train.seed=1\nsubject=ä\n"),
    "colmap": (colmap, write_colmap),
}
SAME = {
    "byte order mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "CR LF": lambda text: text.replace("\n", "\r\n").encode(),
    "CR": lambda text: text.replace("\n", "\r").encode(),
    "mark and CR": lambda text: codecs.BOM_UTF8 + text.replace("\n", "\r").encode(),
}
OTHER = {
    "UTF-16": [("utf-16-le", codecs.BOM_UTF16_LE), ("utf-16-be", codecs.BOM_UTF16_BE), ("utf-16-le", b""),
               ("utf-16-be", b"")],
    "UTF-32": [("utf-32-le", codecs.BOM_UTF32_LE), ("utf-32-be", b"")],
}  # fmt: skip


@pytest.mark.parametrize("change", SAME)
@pytest.mark.parametrize("door", DOORS)
def test_marks_and_line_ends_change_nothing(door, change, tmp_path):
    read, write = DOORS[door]
    write(tmp_path, str.encode)
    expected = read(tmp_path)
    write(tmp_path, SAME[change])
    assert repr(read(tmp_path)) == repr(expected)


@pytest.mark.parametrize("name", OTHER)
@pytest.mark.parametrize("door", DOORS)
def test_other_encodings_of_unicode_are_named(door, name, tmp_path):
    read, write = DOORS[door]
    for encoding, mark in OTHER[name]:
        write(tmp_path, lambda text, encoding=encoding, mark=mark: mark + text.encode(encoding))
        with pytest.raises(CarigsError, match=f"not text in UTF-8 but in {name}; save it as UTF-8") as raised:
            read(tmp_path)
        assert str(tmp_path) in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("door", ["json", "yaml", "overrides", "colmap"])
def test_latin_1_is_named_where_names_count(door, tmp_path):
    read, write = DOORS[door]
    write(tmp_path, lambda text: text.encode("latin1"))
    with pytest.raises(CarigsError, match=r"perhaps in Latin-1 \(.* in line \d\); save it as UTF-8"):
        read(tmp_path)


@pytest.mark.parametrize("name", MESHES)
def test_comments_of_meshes_may_be_in_any_encoding(name, tmp_path):
    """The first vertex of the .obj belongs to no face: a line that is lost shifts all numbers."""
    for comment in (b"Gr\xf6\xdfe in m", "\u9854".encode(), "\u9854".encode("shift_jis"), b"50 \x80 \xa0"):
        text = MESHES[name]("COMMENT").encode()
        (tmp_path / name).write_bytes(text.replace(b"COMMENT", comment))
        np.testing.assert_allclose(read_mesh(tmp_path / name).triangles, V[F])
        assert read_mesh(tmp_path / name).faces.max() < 60


def test_what_an_obj_holds_beside_positions_comes_out_as_it_went_in(tmp_path):
    names = b"o Gr\xf6\xdfe\nusemtl \xe9\x9d\xa2\nmtllib \xe4.mtl\n"
    (tmp_path / "a.obj").write_bytes(codecs.BOM_UTF8 + names + obj().encode())
    mesh = read_mesh(tmp_path / "a.obj")
    moved = moved_mesh_file(tmp_path / "a.obj", np.asarray(mesh.vertices) + 1, mesh.faces, tmp_path / "b.obj")
    assert moved.startswith(names)
    (tmp_path / "b.obj").write_bytes(moved)
    np.testing.assert_allclose(read_mesh(tmp_path / "b.obj").triangles, V[F] + 1)


@pytest.mark.parametrize("name", MESHES)
def test_nul_characters_are_named(name, tmp_path):
    """What a full disk or a crash leaves at the end of a file."""
    (tmp_path / name).write_bytes(MESHES[name]().encode() + bytes(512))
    with pytest.raises(InputError, match=rf"{name}: "):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize("mark", [b"", codecs.BOM_UTF8])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("first", [b"\n\0\0\1", b"\r\n\n\r", b"\0\0\0\0"])
def test_binary_rows_are_not_text(mark, end, first, tmp_path):
    """The first bytes of the rows may be those of line ends."""
    header = [b"ply", b"format binary_big_endian 1.0", b"element vertex 2", b"property int x", b"end_header", b""]
    (tmp_path / "a.ply").write_bytes(mark + end.join(header) + first + b"\xff\xfe\0\0")
    expected = [struct.unpack(">i", row) for row in (first, b"\xff\xfe\0\0")]
    assert read_ply_vertices(tmp_path / "a.ply").tolist() == expected


def test_a_binary_stl_is_not_text(tmp_path):
    content = SOLID.export(file_type="stl")
    for header in (b"solid of facets", codecs.BOM_UTF16_LE, b"s\0o\0l\0i\0d\0", b"\0" * 80):
        (tmp_path / "a.stl").write_bytes(header.ljust(80, b" ") + content[80:])
        np.testing.assert_allclose(read_mesh(tmp_path / "a.stl").triangles, V[F], atol=1e-6)


@given(st.binary(max_size=30))
def test_any_bytes_come_back_or_are_refused(content):
    try:
        text = decode_text(content, "a.obj", any_bytes=True)
    except InputError as error:
        assert "not text in UTF-8 but in UTF-" in str(error) or (b"\0" in content and "holds a NUL" in str(error))
    else:
        assert encode_text(text) == content.removeprefix(codecs.BOM_UTF8)


@given(st.lists(st.text(st.characters(exclude_characters="\r\n", exclude_categories=["Cs"]))))
def test_lines_end_nowhere_else(lines):
    """Names may hold what `str.splitlines` takes for ends, such as U+2028 and U+0085."""
    for end in ("\n", "\r", "\r\n"):
        assert split_lines(end.join(lines)) == (lines or [""])


@pytest.mark.parametrize("rest", [b"\0", b"solid", b"\xff" * 300])
def test_bytes_after_the_triangles_of_a_binary_stl_are_left_out_with_a_warning(tmp_path, rest):
    content = SOLID.export(file_type="stl")
    for header in (b"", b"solid of a program"):
        (tmp_path / "a.stl").write_bytes(header.ljust(80, b" ") + content[80:] + rest)
        with pytest.warns(CarigsWarning, match=rf"a\.stl: {len(rest)} bytes after its triangles are left out"):
            np.testing.assert_allclose(read_mesh(tmp_path / "a.stl").triangles, V[F], atol=1e-6)
    (tmp_path / "a.stl").write_bytes(content[:-1])
    with pytest.raises(InputError, match=r"a\.stl: "):
        read_mesh(tmp_path / "a.stl")
