"""The reader and the writer of .ply files against bytes that the struct module packs, and against trimesh."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import InputError
from carigs.mesh.ply_writer import ply_content
from carigs.readers.mesh_files.ply import LENGTH, parse_ply
from carigs.readers.mesh_files.ply_header import TYPES

CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
"""Codes of the struct module."""
OLDER_NAMES = ("char", "uchar", "short", "ushort", "int", "uint", "float", "double")
ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def numbers(kind: str) -> st.SearchStrategy:
    """Values of a type of the format."""
    code = TYPES[kind]
    if code[0] == "f":
        return st.floats(width=8 * int(code[1]), allow_nan=False)
    limits = np.iinfo(code)
    return st.integers(int(limits.min), int(limits.max))


@st.composite
def elements(draw: st.DrawFn) -> tuple[str, list[tuple[str, str | None, str]], list[list]]:
    """An element: its name, its properties as name, type of the length and type, and its rows."""
    properties = [
        (f"p{k}", draw(st.sampled_from([None, "uchar", "int8", "uint"])), draw(st.sampled_from(list(TYPES))))
        for k in range(draw(st.integers(1, 4)))
    ]
    same_length = draw(st.none() | st.integers(0, 3))
    lengths = {"max_size": 4} if same_length is None else {"min_size": same_length, "max_size": same_length}
    values = (st.lists(numbers(kind), **lengths) if length else numbers(kind) for _, length, kind in properties)
    return f"part_{draw(st.uuids())}", properties, draw(st.lists(st.tuples(*values), max_size=5))


def packed(encoding: str, parts: list, comments: list[str], end_of_line: str = "\n") -> bytes:
    """A .ply file, value by value."""
    header, body = ["ply", f"format {encoding} 1.0", *(f"comment {text}" for text in comments)], b""
    for name, properties, rows in parts:
        header.append(f"element {name} {len(rows)}")
        header += [f"property {f'list {length} {kind}' if length else kind} {p}" for p, length, kind in properties]
        for row in rows:
            flat = []
            for (_, length, kind), value in zip(properties, row, strict=True):
                flat += [(length, len(value)), *((kind, x) for x in value)] if length else [(kind, value)]
            if encoding == "ascii":
                body += " ".join(repr(value) for _, value in flat).encode() + b"\n"
            else:
                body += b"".join(struct.pack(ENCODINGS[encoding] + CODES[TYPES[kind]], value) for kind, value in flat)
    return end_of_line.join([*header, "end_header", ""]).encode() + body


files = st.tuples(
    st.sampled_from(list(ENCODINGS)),
    st.lists(elements(), max_size=3, unique_by=lambda part: part[0]),
    st.lists(st.text("ab =\xe9", min_size=1, max_size=5).map(str.strip).filter(str.isascii), max_size=2),
)


@given(files, st.sampled_from(["\n", "\r\n"]))
def test_every_value_of_every_type_is_read(file, end_of_line):
    encoding, parts, comments = file
    ply = parse_ply(packed(encoding, parts, comments, end_of_line), "a.ply")
    assert (ply.encoding, ply.comments, list(ply.elements)) == (encoding, comments, [name for name, _, _ in parts])
    for name, properties, rows in parts:
        found = ply.elements[name]
        assert len(found) == len(rows)
        for row, values in zip(found, rows, strict=True):
            for (p, length, kind), value in zip(properties, values, strict=True):
                assert np.asarray(row[p]).dtype.str[1:] == TYPES[kind]
                np.testing.assert_array_equal(row[p], np.array(value, TYPES[kind]))
                assert length is None or row[p + LENGTH] == len(value)


@given(files)
def test_what_was_read_is_written_as_it_was(file):
    encoding, parts, comments = file
    older = {TYPES[name]: name for name in OLDER_NAMES}
    parts = [
        (name, [(p, length and older[TYPES[length]], older[TYPES[kind]]) for p, length, kind in properties], rows)
        for name, properties, rows in parts
    ]
    content = packed(encoding, parts, comments)
    ply = parse_ply(content, "a.ply")
    written = ply_content(ply)
    if encoding == "ascii":  # one number may be written in several ways
        again = parse_ply(written, "a.ply")
        assert written.partition(b"end_header")[0] == content.partition(b"end_header")[0]
        assert written.count(b"\n") == content.count(b"\n")
        assert repr([rows.tolist() for rows in again.elements.values()]) == repr(
            [rows.tolist() for rows in ply.elements.values()]
        )
    else:
        assert written == content


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_mesh_of_trimesh_is_read_and_written(encoding):
    ball = trimesh.creation.icosphere(subdivisions=1)
    ply = parse_ply(ball.export(file_type="ply", encoding=encoding), "ball.ply")
    corners = np.stack([ply.elements["vertex"][name] for name in "xyz"], axis=1)
    np.testing.assert_allclose(corners, ball.vertices, atol=1e-6)
    np.testing.assert_array_equal(ply.elements["face"]["vertex_indices"], ball.faces)
    for other in ENCODINGS:
        written = io.BytesIO(ply_content(ply._replace(encoding=other)))
        again = trimesh.load(written, file_type="ply", process=False)
        np.testing.assert_array_equal(again.vertices.astype(np.float32), corners.astype(np.float32))
        np.testing.assert_array_equal(again.faces, ball.faces)


def test_a_number_in_text_that_its_type_cannot_hold_is_refused():
    header = b"ply\nformat ascii 1.0\nelement vertex 2\nproperty uchar red\nend_header\n"
    for word in (b"256", b"-1", b"0.5", b"nan", b"1e300"):
        with pytest.raises(InputError, match=r"a\.ply: vertex: .*red"):
            parse_ply(header + b"7\n" + word + b"\n", "a.ply")
    assert parse_ply(header + b"7\n255\n", "a.ply").elements["vertex"]["red"].tolist() == [7, 255]


def test_rows_of_triangles_are_a_view_of_the_file():
    content = trimesh.creation.icosphere(subdivisions=1).export(file_type="ply")
    faces = parse_ply(content, "ball.ply").elements["face"]
    assert np.shares_memory(faces, np.frombuffer(content, np.uint8))
