"""Reader of the vertices and faces of .obj files, in the order of the file.

Libraries split a vertex wherever texture coordinates, normals or materials change. Here a vertex is a line `v`, so that
vertex numbers mean the same as in the program that wrote the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.polygons import Polygons
from carigs.readers.text import decode_text, split_lines


def parse_obj(content: bytes, file: str | Path) -> Polygons:
    """Parse positions and faces; everything else is ignored.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        Positions in the unit of the file, and the faces. Numbers of vertices that do not exist are not checked, except
        that they are at least 0.

    Raises:
        InputError: If a line of a vertex or a face is broken.
    """
    vertices: list[tuple[float, float, float]] = []
    corners: list[int] = []
    lengths: list[int] = []
    for number, line in enumerate(obj_lines(content, file), 1):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                x, y, z = words[1:4]
                vertices.append((float(x), float(y), float(z)))
            elif words[:1] == ["f"]:
                if len(words) < 4:
                    raise ValueError
                corners += [_vertex_number(word, len(vertices)) for word in words[1:]]
                lengths.append(len(words) - 1)
        except (ValueError, OverflowError) as error:
            raise InputError(f"broken line: {line.strip()[:60]!r}", file=file, field=f"line {number}") from error
    try:
        indices = np.array(corners, np.int64)
    except OverflowError as error:
        raise InputError("a vertex number is too large", file=file, field="faces") from error
    return Polygons(np.array(vertices, np.float64).reshape(-1, 3), indices, np.array(lengths, np.int64))


def read_obj_uvs(file: str | Path) -> tuple[Int64[np.ndarray, "f 3"], Float64[np.ndarray, "f 3 2"]]:
    """Read the faces of a textured triangle mesh with the texture coordinates of their corners.

    Args:
        file: The .obj file.

    Returns:
        Vertex numbers from 0, and (u, v) of the corners.

    Raises:
        InputError: If the file is missing or too large, a line is broken, or a face is no triangle or has a corner
            without texture coordinates.
    """
    uvs: list[tuple[float, float]] = []
    faces, corners = [], []
    for number, line in enumerate(obj_lines(read_bytes(file, MAX_TEXT_BYTES, "mesh"), file), 1):
        words = line.split()
        try:
            if words[:1] == ["vt"]:
                uvs.append((float(words[1]), float(words[2])))
            elif words[:1] == ["f"]:
                vertex, texture = np.array([word.split("/")[:2] for word in words[1:]], np.int64).T
                if len(vertex) != 3 or vertex.min() < 1 or texture.min() < 1:
                    raise ValueError
                faces.append(vertex - 1)
                corners.append(texture - 1)
        except (ValueError, OverflowError, IndexError) as error:
            raise InputError(f"broken line: {line.strip()[:60]!r}", file=file, field=f"line {number}") from error
    if not faces:
        raise InputError("no faces", file=file)
    indices = np.array(corners, np.int64).reshape(-1, 3)
    positions = checked_array({"vt": np.array(uvs).reshape(-1, 2)}, "vt", (None, 2), np.float64, file=file)
    if indices.size and indices.max() >= len(positions):
        raise InputError("a face names texture coordinates that do not exist", file=file, field="vt")
    return np.array(faces, np.int64).reshape(-1, 3), positions[indices]


def obj_lines(content: bytes, file: str | Path) -> list[str]:
    """Split a file into lines; those that end with a backslash are joined with the next, unless they are comments.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        The lines without line breaks. Bytes of comments and names that are not UTF-8 are kept, as by `decode_text`.

    Raises:
        InputError: If the text is in UTF-16 or UTF-32.
    """
    joined: list[str] = []
    continues = False
    for line in split_lines(decode_text(content, file, any_bytes=True)):
        if continues:
            joined[-1] = f"{joined[-1]} {line}"
        else:
            joined.append(line)
        continues = line.endswith("\\") and not joined[-1].lstrip().startswith("#")  # a comment may name C:\heads\
        if continues:
            joined[-1] = joined[-1][:-1]
    return joined


def _vertex_number(word: str, count: int) -> int:
    """Parse `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative numbers count back from the latest vertex."""
    number = int(word.partition("/")[0])
    index = number - 1 if number > 0 else count + number
    if number == 0 or index < 0:
        raise ValueError
    return index
