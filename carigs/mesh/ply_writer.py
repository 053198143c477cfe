"""Writer of .ply files: the inverse of `carigs.readers.mesh_files.ply`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from carigs.readers.mesh_files.ply import LENGTH, Ply
from carigs.readers.mesh_files.ply_header import BYTE_ORDERS, TYPES

_NAMES = {dtype: name for name, dtype in reversed(TYPES.items())}
"""The format's names of NumPy's types: the older of both, which every reader knows."""


def ply_content(ply: Ply) -> bytes:
    """Compose a .ply file.

    Args:
        ply: Elements, as `parse_ply` returns them. Numbers in text get as many digits as tell them from others of
            their type.

    Returns:
        Content of the file.
    """
    header = ["ply", f"format {ply.encoding} 1.0"]
    header += [f"comment {text}" for text in ply.comments] + [f"obj_info {text}" for text in ply.obj_info]
    for name, rows in ply.elements.items():
        header += [f"element {name} {len(rows)}", *_property_lines(rows)]
    order = None if ply.encoding == "ascii" else BYTE_ORDERS[ply.encoding]
    body = [_body(rows, order) for rows in ply.elements.values()]
    return b"".join(["\n".join([*header, "end_header\n"]).encode("latin1"), *body])


def _property_lines(rows: np.ndarray) -> Iterator[str]:
    """Lines of the header that describe a row."""
    for name in rows.dtype.names:
        if not name.endswith(LENGTH):
            dtype = rows[name][0].dtype if rows.dtype[name].hasobject else rows.dtype[name].base
            length = rows.dtype.fields.get(name + LENGTH)
            words = ["list", _NAMES[length[0].str[1:]]] if length else []
            yield " ".join(["property", *words, _NAMES[dtype.str[1:]], name])


def _body(rows: np.ndarray, order: str | None) -> bytes | np.ndarray:
    """Bytes of rows in a byte order, which an array has in its memory; None for lines of text."""
    if order and not rows.dtype.hasobject:
        return np.ascontiguousarray(rows, rows.dtype.newbyteorder(order))
    columns = [_cells(rows[name], order) for name in rows.dtype.names]
    separator, end = (b"", b"") if order else (b" ", b"\n")
    return b"".join(separator.join(row) + end for row in zip(*columns, strict=True))


def _cells(column: np.ndarray, order: str | None) -> list[bytes]:
    """The numbers of each row in one field."""
    mixed = column.dtype.hasobject
    values = np.concatenate(column) if mixed else column.reshape(-1)
    lengths = [len(row) for row in column] if mixed else np.full(len(column), values.size // max(len(column), 1))
    ends = [0, *np.cumsum(lengths).tolist()]
    if order is None:
        words = values.astype(str).astype(bytes).tolist()
        return [b" ".join(words[a:b]) for a, b in pairwise(ends)]
    content, size = values.astype(values.dtype.newbyteorder(order)).tobytes(), values.itemsize
    return [content[a * size : b * size] for a, b in pairwise(ends)]
