"""Reader of .ply files: each element as a structured NumPy array.

A list property `faces` becomes two fields: its length, `faces length`, and its values, `faces`. Where all rows have
lists of the same length, as in a mesh of triangles, an array of a binary file is a view of the file's bytes.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from carigs.errors import InputError
from carigs.readers.limits import MAX_ARRAY_BYTES, read_bytes
from carigs.readers.mesh_files.ply_header import Property, parse_ply_header
from carigs.readers.mesh_files.polygons import Polygons
from carigs.readers.text import without_byte_order_mark

MAX_MIXED_ROWS = 20_000_000
"""Most rows of an element whose lists differ in length: each list becomes an array of its own, of about 100 bytes."""
FACE_LISTS = ("vertex_indices", "vertex_index")
"""Names that programs give to the corners of a face."""
LENGTH = " length"
"""Ends the name of the field with the lengths of a list. Names in a .ply file contain no blank."""
_NUMBER = np.dtype(np.float64)
"""What numbers in text are parsed as: it holds every value of every type of the format."""


class Ply(NamedTuple):
    """Content of a .ply file."""

    encoding: str
    """A key of `BYTE_ORDERS`."""
    elements: dict[str, np.ndarray]
    """Structured arrays by name, in the order of the file. Lists of different lengths are a field of arrays."""
    comments: Sequence[str] = ()
    obj_info: Sequence[str] = ()


def read_ply_vertices(file: str | Path) -> np.ndarray:
    """Read the element `vertex` of a .ply file.

    Args:
        file: The file, of any of the three encodings.

    Returns:
        A structured array with one field per number and two per list; at least one vertex.

    Raises:
        InputError: If the file is missing, too large or damaged, or has no vertices.
    """
    vertices = parse_ply(read_bytes(file, MAX_ARRAY_BYTES), file).elements.get("vertex", np.empty(0))
    if len(vertices) == 0:
        raise InputError("holds no vertices", file=file, field="vertex")
    return vertices


def parse_ply_polygons(content: bytes, file: str | Path) -> Polygons:
    """Parse the mesh of a .ply file: positions of its vertices, and its faces.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        Positions in the unit of the file, and the faces, of which there may be none.

    Raises:
        InputError: If the file is damaged, or has no positions, strips of triangles, or faces of fewer than three
            corners.
    """
    elements = parse_ply(content, file).elements
    if "tristrips" in elements:
        raise InputError("strips of triangles are not read; save the mesh with faces", file=file, field="tristrips")
    rows, faces = elements.get("vertex", np.empty(0)), elements.get("face", np.empty(0))
    names = rows.dtype.names or ()
    if missing := [name for name in "xyz" if name not in names or rows.dtype[name].kind not in "iuf"]:
        raise InputError("expected numbers x, y, z", file=file, field=f"vertex.{missing[0]}")
    vertices = np.stack([rows[name].astype(np.float64) for name in "xyz"], axis=1)
    if len(faces) == 0:
        return Polygons(vertices, np.empty(0, np.int64), np.empty(0, np.int64))
    name = next((name for name in FACE_LISTS if name + LENGTH in faces.dtype.names), None)
    if name is None:
        raise InputError(f"expected a list {' or '.join(FACE_LISTS)}", file=file, field="face")
    lengths = faces[name + LENGTH].astype(np.int64)
    if lengths.min() < 3:
        raise InputError(f"face {lengths.argmin()} has {lengths.min()} corners", file=file, field=f"face.{name}")
    column = faces[name]
    corners = np.concatenate(column) if column.dtype.hasobject else column.ravel()
    if corners.dtype.kind == "f" and (corners != np.floor(corners)).any():
        raise InputError("a vertex number is a fraction, or not finite", file=file, field=f"face.{name}")
    return Polygons(vertices, corners.astype(np.int64), lengths)


def parse_ply(content: bytes, file: str | Path) -> Ply:
    """Parse a .ply file.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        Its elements and comments. Arrays may be read-only.

    Raises:
        InputError: If the file is damaged, or holds more or less than its header claims.
    """
    content = without_byte_order_mark(content, file)
    header = parse_ply_header(content, file)
    text, at, elements, name = header.encoding == "ascii", header.size, {}, None
    try:
        if text:  # from here on as a binary file in which every number is of one type
            content, at = _numbers(content[at:]).tobytes(), 0
        for name, (count, properties) in header.elements.items():
            stored = [Property(p.name, _NUMBER, p.length_dtype and _NUMBER) for p in properties] if text else properties
            elements[name], at = _rows(content, at, count, properties, stored)
    except (ValueError, OverflowError) as error:
        raise InputError(f"not a readable .ply ({error})", file=file, field=name) from error
    rest = len(content) - at if text else len(content[at:].strip())
    if rest:
        raise InputError(f"{rest} bytes more than the header claims", file=file)
    return Ply(header.encoding, elements, header.comments, header.obj_info)


def _numbers(text: bytes) -> Float64[np.ndarray, " n"]:
    """Parse all numbers of a text."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how older versions of NumPy report other words
        try:
            return np.fromstring(text.strip(), np.float64, sep=" ")
        except (ValueError, DeprecationWarning) as error:
            raise ValueError("a word is no number") from error


def _rows(
    content: bytes, at: int, count: int, properties: list[Property], stored: list[Property]
) -> tuple[np.ndarray, int]:
    """The rows of an element and where the next one begins. `stored` has the types of the content, which text lacks."""
    if count == 0:
        return np.empty(0, _row_dtype(properties, {p.name: 0 for p in properties})), at
    values, _ = _row(content, at, properties, stored)
    lengths = {p.name: len(row) for p, row in zip(properties, values, strict=True)}
    dtype = _row_dtype(stored, lengths)
    end = at + count * dtype.itemsize
    if end <= len(content):
        rows = np.frombuffer(content, dtype, count, at)
        if all((rows[p.name + LENGTH] == lengths[p.name]).all() for p in properties if p.length_dtype is not None):
            return _cast_rows(rows, _row_dtype(properties, lengths)), end
    return _mixed_rows(content, at, count, properties, stored)


def _mixed_rows(
    content: bytes, at: int, count: int, properties: list[Property], stored: list[Property]
) -> tuple[np.ndarray, int]:
    """The rows of an element with lists of different lengths, one after the other: each begins where another ends."""
    if count > MAX_MIXED_ROWS:
        raise ValueError(f"{count} rows with lists of different lengths; at most {MAX_MIXED_ROWS} are read")
    rows = np.empty(count, _row_dtype(properties, None))
    for k in range(count):
        values, at = _row(content, at, properties, stored)
        fields: list[object] = []
        for p, value in zip(properties, values, strict=True):
            fields += [value[0]] if p.length_dtype is None else [len(value), value]
        rows[k] = tuple(fields)
    return rows, at


def _row(content: bytes, at: int, properties: list[Property], stored: list[Property]) -> tuple[list[np.ndarray], int]:
    """One row of an element: an array for each property, of one number if it is no list; and where the row ends."""
    values = []
    for wanted, found in zip(properties, stored, strict=True):
        length = 1
        if wanted.length_dtype is not None:
            length = int(_cast(_view(content, at, 1, found.length_dtype), wanted.length_dtype, wanted.name + LENGTH)[0])
            at += found.length_dtype.itemsize
        values.append(_cast(_view(content, at, length, found.dtype), wanted.dtype, wanted.name))
        at += length * found.dtype.itemsize
    return values, at


def _row_dtype(properties: list[Property], lengths: dict[str, int] | None) -> np.dtype:
    """Type of a row whose lists have these lengths; without lengths, each list is an array."""
    fields: list[tuple] = []
    for p in properties:
        if p.length_dtype is None:
            fields.append((p.name, p.dtype))
        else:
            values = (p.name, object) if lengths is None else (p.name, p.dtype, (lengths[p.name],))
            fields += [(p.name + LENGTH, p.length_dtype), values]
    return np.dtype(fields)


def _view(content: bytes, at: int, count: int, dtype: np.dtype) -> np.ndarray:
    """Numbers of one type, if the content holds as many."""
    if count < 0 or at + count * dtype.itemsize > len(content):
        raise ValueError("ends within a row" if count >= 0 else f"a list of {count} values")
    return np.frombuffer(content, dtype, count, at) if count else np.empty(0, dtype)


def _cast_rows(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Rows in other types, if they can represent the values."""
    if rows.dtype == dtype:
        return rows
    result = np.empty(len(rows), dtype)
    for name in dtype.names:
        result[name] = _cast(rows[name], dtype[name].base, name)
    return result


def _cast(values: np.ndarray, dtype: np.dtype, name: str) -> np.ndarray:
    """Numbers in another type; a whole number must be one and in its range."""
    if values.dtype == dtype:
        return values
    with np.errstate(invalid="ignore", over="ignore"):
        result = values.astype(dtype)
    if dtype.kind in "iu" and (result != values).any():
        raise ValueError(f"a value of {name} is no {dtype.name}")
    return result
