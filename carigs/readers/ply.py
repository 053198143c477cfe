"""Reader of the vertices of .ply files, whose claims are compared with the size of the file first."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.readers.limits import MAX_ARRAY_BYTES, read_bytes

MAX_HEADER_BYTES = 1 << 20
SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4, "uint": 4,
    "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
"""Bytes of each type."""


class _StaysOpen(io.BytesIO):
    """A stream that plyfile does not close: of a file in text it closes what it reads from."""

    def close(self) -> None:
        """Do nothing."""


def read_ply_vertices(file: str | Path) -> np.ndarray:
    """Read the element `vertex` of a .ply file.

    Args:
        file: The file, of any of the three encodings.

    Returns:
        A structured array with one field per property; at least one vertex.

    Raises:
        InputError: If the file is missing, too large or damaged, or has no vertices.
    """
    from plyfile import PlyData

    content = read_bytes(file, MAX_ARRAY_BYTES)
    check_ply_header(content, file)
    try:
        stream = _StaysOpen(content)
        vertices = PlyData.read(stream, mmap=False)["vertex"].data
        rest = stream.read().strip()
    except Exception as error:  # damaged bodies raise many types
        raise InputError(f"not a readable .ply ({type(error).__name__}: {str(error)[:200]})", file=file) from error
    if rest:
        raise InputError(f"{len(rest)} bytes more than the header claims", file=file)
    if len(vertices) == 0:
        raise InputError("holds no vertices", file=file, field="vertex")
    return vertices


def check_ply_header(content: bytes, file: str | Path) -> None:
    """Refuse a header that claims more than the file can hold: readers allocate what it claims.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Raises:
        InputError: If the header is damaged or claims too much.
    """
    end = content.find(b"end_header", 0, MAX_HEADER_BYTES)
    if not content.startswith(b"ply") or end < 0:
        raise InputError("not a readable .ply (no header)", file=file)
    lines = content[:end].decode("latin1").split("\n")
    ascii_format = any(line.split()[:2] == ["format", "ascii"] for line in lines)
    body, claimed, count, element = len(content) - end - len("end_header"), 0, 0, "?"
    for line in lines:
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdigit() or len(words[2]) > 15:
                raise InputError(f"broken header: {line[:60]!r}", file=file)
            element, count = words[1], int(words[2])
        elif words[:1] == ["property"] and len(words) >= 3:
            kind = words[2] if words[1] == "list" else words[1]
            if kind not in SIZES:
                raise InputError(f"broken header: {line[:60]!r}", file=file)
            claimed += count * (2 if ascii_format else SIZES[kind])  # in text: a digit and a blank
        if claimed > body + 1:
            raise InputError(f"claims {count} elements, more than the file holds", file=file, field=element)
