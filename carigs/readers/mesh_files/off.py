"""Reader of the vertices and faces of .off files, in the order of the file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.readers.mesh_files.polygons import Polygons
from carigs.readers.text import decode_text, split_lines

_KEYWORD = re.compile(r"(?:ST)?C?N?OFF")
"""Texture coordinates, colours and normals, which the keyword announces, follow the position of a vertex."""


def parse_off(content: bytes, file: str | Path) -> Polygons:
    """Parse positions and faces; colours, normals and texture coordinates are ignored.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        Positions in the unit of the file, and the faces, with at least one.

    Raises:
        InputError: If it is no text of this format, a line is broken, or there are fewer lines than it claims.
    """
    text = decode_text(content, file, any_bytes=True)
    rows = [
        (number, words) for number, line in enumerate(split_lines(text), 1) if (words := line.partition("#")[0].split())
    ]
    if not rows or not _KEYWORD.fullmatch(rows[0][1][0]):
        raise InputError("not a readable .off (its first word is none of OFF, COFF, NOFF)", file=file)
    counts, *rows = [(number, words) for number, words in [(rows[0][0], rows[0][1][1:]), *rows[1:]] if words] or [
        (1, [])
    ]
    if len(counts[1]) < 2 or not all(re.fullmatch("[0-9]{1,15}", word) for word in counts[1][:2]):
        raise InputError("expected the numbers of vertices and faces", file=file, field=f"line {counts[0]}")
    num_vertices, num_faces = int(counts[1][0]), int(counts[1][1])
    if num_vertices + num_faces > len(rows):
        problem = f"claims {num_vertices} vertices and {num_faces} faces, has {len(rows)} lines of them"
        raise InputError(problem, file=file)
    vertices, corners, lengths = [], [], []
    for k, (number, words) in enumerate(rows[: num_vertices + num_faces]):
        try:
            if k < num_vertices:
                x, y, z = map(float, words[:3])
                vertices.append((x, y, z))
            else:
                length, *numbers = map(int, words[: 1 + int(words[0])])
                if length < 3 or len(numbers) < length or min(numbers) < 0:
                    raise ValueError
                corners += numbers
                lengths.append(length)
        except (ValueError, OverflowError) as error:
            raise InputError(f"broken line: {' '.join(words)[:60]!r}", file=file, field=f"line {number}") from error
    try:
        indices = np.array(corners, np.int64)
    except OverflowError as error:
        raise InputError("a vertex number is too large", file=file, field="faces") from error
    return Polygons(np.array(vertices, np.float64).reshape(-1, 3), indices, np.array(lengths, np.int64))
