"""Header of a .ply file, whose claims are compared with the size of the file: readers allocate what it claims."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.errors import InputError
from carigs.readers.text import split_lines

MAX_HEADER_BYTES = 1 << 20
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
"""NumPy's sign for the byte order of each encoding; that of text is the one of the arrays made from it."""
TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""NumPy's names of the format's types."""
_FIRST_LINE = re.compile(rb"ply[ \t]*(?P<end>\r?\n|\r)")


class Property(NamedTuple):
    """A property of an element as the header describes it."""

    name: str
    dtype: np.dtype
    length_dtype: np.dtype | None = None
    """Type of a list's length; None for a property that is no list."""


class Header(NamedTuple):
    """Header of a .ply file."""

    encoding: str
    elements: dict[str, tuple[int, list[Property]]]
    """Number of rows, and properties, of each element."""
    comments: list[str]
    obj_info: list[str]
    size: int
    """Bytes of the header."""


def parse_ply_header(content: bytes, file: str | Path) -> Header:
    """Parse the header, and refuse one that claims more than the file can hold.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        The header.

    Raises:
        InputError: If the header is damaged or claims too much.
    """
    first = _FIRST_LINE.match(content)
    # The first byte of binary rows may be a line feed: after a CR it counts as one only if all lines end with CR LF.
    line_end = rb"\r" if first and first["end"] == b"\r" else rb"\r?\n"
    end = re.compile(rb"[\r\n]end_header[ \t]*" + line_end).search(content, 0, MAX_HEADER_BYTES)
    if first is None or end is None:
        raise InputError("not a readable .ply (no header)", file=file)
    encoding, texts = "", {"comment": [], "obj_info": []}
    elements: dict[str, tuple[int, dict[str, Property]]] = {}
    properties: dict[str, Property] | None = None
    for line in split_lines(content[: end.start()].decode("latin1"))[1:]:
        match line.split():
            case ["format", name, _] if name in BYTE_ORDERS and not encoding:
                encoding = name
            case ["comment" | "obj_info" as keyword, *_]:
                texts[keyword].append(line.strip()[len(keyword) + 1 :])
            case ["element", name, count] if encoding and name not in elements and re.fullmatch("[0-9]{1,15}", count):
                properties = {}
                elements[name] = int(count), properties
            case ["property", *types, name] if properties is not None and name not in properties and _known(types):
                *length, dtype = (np.dtype(BYTE_ORDERS[encoding] + TYPES[kind]) for kind in types if kind != "list")
                properties[name] = Property(name, dtype, *length)
            case []:
                pass
            case _:
                raise InputError(f"broken header: {line[:60]!r}", file=file)
    if not encoding:
        raise InputError("broken header: it names no format", file=file)
    claimed, body = 0, len(content) - end.end()
    for name, (count, properties) in elements.items():
        first_bytes = [2 if encoding == "ascii" else (p.length_dtype or p.dtype).itemsize for p in properties.values()]
        claimed += count * sum(first_bytes)  # in text: a digit and a blank
        if claimed > body + 1 or (count and not properties):
            raise InputError(f"claims {count} elements, more than the file holds", file=file, field=name)
    described = {name: (count, list(properties.values())) for name, (count, properties) in elements.items()}
    return Header(encoding, described, texts["comment"], texts["obj_info"], end.end())


def _known(types: list[str]) -> bool:
    """Whether these words describe a number, `float`, or a list, `list uchar int`: its length is a whole number."""
    if types[:1] == ["list"]:
        return len(types) == 3 and TYPES.get(types[1], "f")[0] in "iu" and types[2] in TYPES
    return len(types) == 1 and types[0] in TYPES
