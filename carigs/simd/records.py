"""Loads and stores of sixteen records at a time, such as points (n, 3): one vector for each field.

As in `carigs.simd.memory`, arrays are flat, nothing is checked, and an array that is stored to needs spare elements.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import FLOAT, LONG, generate
from carigs.simd.vectors import WIDTH, lanes


def _transposed(rows):
    """Sixteen vectors with rows and columns exchanged: four rounds of 2 x 2 blocks."""
    rows = list(rows)
    for half in (8, 4, 2, 1):
        low = [WIDTH + (e ^ half) if e & half else e for e in range(WIDTH)]
        high = [WIDTH + e if e & half else e | half for e in range(WIDTH)]
        for i in range(WIDTH):
            if not i & half:
                a, b = rows[i], rows[i | half]
                rows[i], rows[i | half] = a.shuffle(b, low), a.shuffle(b, high)
    return rows


def _squares(count):
    """First columns of squares of 16 x 16 elements that cover rows of `count`; the last one overlaps."""
    return [*range(0, count - WIDTH, WIDTH), count - WIDTH]


def load_records(count: int) -> Callable:
    """A function that loads sixteen consecutive records.

    Args:
        count: Elements per record.

    Returns:
        Function of a flat array of four-byte elements and the index of the first one. It returns a tuple of lanes: one
        for each field, with one lane for each record.
    """

    def shuffle(array, index):
        start = array.offset(index)
        memory = [start.load(WIDTH * j, WIDTH, FLOAT) for j in range(count)]
        fields = []
        for k in range(count):
            at = [count * i + k for i in range(WIDTH)]  # where lane i lies in memory
            field = memory[0]
            for j in range(1, count):
                own = [a - WIDTH * (j - 1) if a < WIDTH else 0 for a in at] if j == 1 else range(WIDTH)
                order = [WIDTH + a % WIDTH if a // WIDTH == j else o for a, o in zip(at, own, strict=True)]
                field = field.shuffle(memory[j], order)
            fields.append(field)
        return fields

    def transpose(array, index):
        start, fields = array.offset(index), [None] * count
        for k in _squares(count):
            fields[k : k + WIDTH] = _transposed(start.load(count * r + k, WIDTH, FLOAT) for r in range(WIDTH))
        return fields

    @intrinsic
    def function(typingctx, array, index):
        build = shuffle if count < WIDTH else transpose
        return types.UniTuple(lanes, count)(array, types.intp), generate(build)

    return function


def store_records(count: int) -> Callable:
    """A function that stores sixteen consecutive records: the inverse of `load_records`.

    Args:
        count: Elements per record.

    Returns:
        Function of a flat array of four-byte elements, the index of the first one, and the tuple of vectors.
    """

    def shuffle(array, index, fields):
        start = array.offset(index)
        for j in range(count):
            at = [divmod(WIDTH * j + e, count) for e in range(WIDTH)]  # record and field of each element
            value = fields[0]
            for k in range(1, count):
                own = [record for record, _ in at] if k == 1 else range(WIDTH)
                order = [WIDTH + record if field == k else o for (record, field), o in zip(at, own, strict=True)]
                value = value.shuffle(fields[k], order)
            start.store(WIDTH * j, value)

    def transpose(array, index, fields):
        start = array.offset(index)
        for k in reversed(_squares(count)):
            for r, row in enumerate(_transposed(fields[k : k + WIDTH])):
                start.store(count * r + k, row)

    @intrinsic
    def function(typingctx, array, index, fields):
        build = shuffle if count < WIDTH else transpose
        return types.void(array, types.intp, types.UniTuple(fields.dtype, count)), generate(build)

    return function


load2, load3, load4 = (load_records(count) for count in (2, 3, 4))
store2, store3, store4 = (store_records(count) for count in (2, 3, 4))


@intrinsic
def gather_rows(typingctx, array, row_indices, index, stride, column):
    """Sixteen elements from each of sixteen rows anywhere, transposed.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of four-byte elements.
        row_indices: Integer array of numbers of rows.
        index: Index of the first of sixteen elements of `row_indices` to use.
        stride: Distance between rows.
        column: First of the sixteen columns.

    Returns:
        A tuple of lanes: one for each column, one lane for each row.
    """

    def build(array, row_indices, index, stride, column):
        starts = (row_indices.load(index + r).to(LONG) * stride + column for r in range(WIDTH))
        return _transposed([array.load(start, WIDTH, FLOAT) for start in starts])

    return types.UniTuple(lanes, WIDTH)(array, row_indices, types.intp, types.intp, types.intp), generate(build)
