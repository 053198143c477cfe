"""Arrays as whole numbers in planes of bytes: what the page unpacks (`page.data.js`).

The numbers of a column lie together, and of these first all low bytes, then all high bytes. High bytes are mostly
equal, which deflate (RFC 1951) turns into nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple
from zlib import compress

import numpy as np
from jaxtyping import Float, Int, Shaped


class PackedArray(NamedTuple):
    """An array of numbers as bytes.

    Attributes:
        name: Name in the page.
        layout: What the page needs to unpack it: `rows`, `columns`, `planes` (bytes of a number), `step` (value of a
            whole number), `signed` (0, -1, 1, -2, .. are stored as 0, 1, 2, 3, ..), `delta` (differences of successive
            rows are stored), `exact` (the bytes are those of float32).
        content: The bytes.
    """

    name: str
    layout: dict[str, Any]
    content: bytes


def pack_steps(name: str, array: Float[np.ndarray, "*n"], step: float) -> PackedArray:
    """Round numbers to multiples of a step.

    Args:
        name: Name in the page.
        array: Finite numbers, a row or a table.
        step: Distance of the values that can be stored; the error is half of it.

    Returns:
        The packed array.
    """
    return pack_integers(name, np.rint(np.asarray(array, np.float64) / step).astype(np.int64), step=step)


def pack_integers(name: str, array: Int[np.ndarray, "*n"], *, delta: bool = False, step: float = 1.0) -> PackedArray:
    """Pack whole numbers, of up to 32 bits.

    Args:
        name: Name in the page.
        array: The numbers, a row or a table.
        delta: Store the differences of successive rows.
        step: Value of 1 in the page.

    Returns:
        The packed array.
    """
    numbers = _table(np.asarray(array, np.int64))
    if delta:
        numbers = np.diff(numbers, axis=0, prepend=0)
    signed = bool((numbers < 0).any())
    unsigned = np.where(numbers < 0, -2 * numbers - 1, 2 * numbers) if signed else numbers
    planes = max((int(unsigned.max(initial=0)).bit_length() + 7) // 8, 1)
    layout = {"planes": planes, "step": step, "signed": signed, "delta": delta, "exact": False}
    return _packed(name, unsigned, layout)


def pack_exact(name: str, array: Shaped[np.ndarray, "*n"]) -> PackedArray:
    """Pack numbers as float32.

    Args:
        name: Name in the page.
        array: The numbers, a row or a table.

    Returns:
        The packed array.
    """
    bits = np.ascontiguousarray(_table(np.asarray(array)), np.float32).view(np.uint32)
    return _packed(name, bits, {"planes": 4, "step": 1.0, "signed": False, "delta": False, "exact": True})


def deflated(arrays: Iterable[PackedArray]) -> tuple[list[dict[str, Any]], bytes]:
    """Compress arrays.

    Args:
        arrays: The arrays.

    Returns:
        The layout of every array with its name, and a zlib stream (RFC 1950) of their contents in this order.
    """
    arrays = list(arrays)
    return [{"name": a.name} | a.layout for a in arrays], compress(b"".join(a.content for a in arrays), 9)


def _table(array: np.ndarray) -> np.ndarray:
    return array.reshape(len(array), -1) if array.size else array.reshape(len(array), 0)


def _packed(name: str, unsigned: np.ndarray, layout: dict[str, Any]) -> PackedArray:
    rows, columns = unsigned.shape
    as_bytes = np.ascontiguousarray(unsigned.T, "<u4").view(np.uint8).reshape(columns, rows, 4)
    content = np.ascontiguousarray(as_bytes[:, :, : layout["planes"]].transpose(0, 2, 1)).tobytes()
    return PackedArray(name, {"rows": rows, "columns": columns} | layout, content)
