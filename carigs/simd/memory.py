"""Loads and stores of the vectors of `carigs.simd.vectors`: rows, blocks, fields of records, transposes; prefetching.

All functions take flat arrays and check nothing. An array that is stored to needs as many spare elements at its end as
the last store may overhang.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from carigs.simd.ir_values import DOUBLE, FLOAT, LONG, generate
from carigs.simd.vectors import WIDE, WIDTH, Vector, lanes, wide


def flattened(group: tuple) -> tuple:
    """The arrays of a named tuple with one dimension, as the functions of this module take them.

    Args:
        group: Named tuple of arrays and other values.

    Returns:
        The same named tuple with views of the arrays.
    """
    return type(group)(*(value.reshape(-1) if isinstance(value, np.ndarray) else value for value in group))


@intrinsic
def align_stack(typingctx):
    """Align the stack of the calling kernel to 64 bytes.

    Otherwise, vectors that do not fit into registers lie across two cache lines in three processes out of four.

    Args:
        typingctx: Supplied by Numba; callers leave it out.

    Returns:
        None.
    """

    def codegen(context, builder, signature, values):
        slot = cgutils.alloca_once(builder, ir.VectorType(FLOAT, WIDTH))
        slot.align = 64
        # An empty instruction that LLVM must assume to use the slot.
        builder.asm(ir.FunctionType(ir.VoidType(), [slot.type]), "", "r", [slot], side_effect=True)
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic
def load(typingctx, array, index):
    """Sixteen consecutive elements.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of four-byte elements.
        index: Index of the first element.

    Returns:
        Lanes of the same bits.
    """
    return lanes(array, types.intp), generate(lambda array, index: array.load(index, WIDTH, FLOAT))


@intrinsic
def store(typingctx, array, index, value):
    """Write sixteen consecutive elements.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of four-byte elements.
        index: Index of the first element.
        value: Vector, whose bits are stored.

    Returns:
        None; `array` is changed.
    """
    if not isinstance(value, Vector):
        return None
    return types.void(array, types.intp, value), generate(lambda array, index, value: array.store(index, value))


@intrinsic
def load_wide(typingctx, array, index):
    """Eight consecutive elements in double precision.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of float64.
        index: Index of the first element.

    Returns:
        A wide vector.
    """
    return wide(array, types.intp), generate(lambda array, index: array.load(index, WIDE, DOUBLE))


@intrinsic
def store_wide(typingctx, array, index, value):
    """Write eight consecutive elements in double precision.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of float64.
        index: Index of the first element.
        value: A wide vector.

    Returns:
        None; `array` is changed.
    """
    return types.void(array, types.intp, wide), generate(lambda array, index, value: array.store(index, value))


# Between four rows of four (memory) and lanes (columns first): its own inverse.
_TRANSPOSE = [4 * (i % 4) + i // 4 for i in range(WIDTH)]


@intrinsic
def load_block(typingctx, array, index, stride):
    """A block of 4 x 4 pixels of an image.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of four-byte elements.
        index: Index of its upper left pixel.
        stride: Length of a row of the image.

    Returns:
        Lanes, columns first.
    """

    def build(array, index, stride):
        quads = []
        for _ in range(4):
            quads.append(array.load(index, 4, FLOAT))
            index = index + stride
        top, bottom = (quads[i].shuffle(quads[i + 1], range(8)) for i in (0, 2))
        block = top.shuffle(bottom, range(WIDTH))
        return block.shuffle(block, _TRANSPOSE)

    return lanes(array, types.intp, types.intp), generate(build)


@intrinsic
def store_block(typingctx, array, index, stride, value):
    """Write a block of 4 x 4 pixels of an image.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array of four-byte elements.
        index: Index of its upper left pixel.
        stride: Length of a row of the image.
        value: Lanes, columns first.

    Returns:
        None; `array` is changed.
    """

    def build(array, index, stride, value):
        by_rows = value.shuffle(value, _TRANSPOSE)
        for row in range(4):
            array.store(index, by_rows.shuffle(by_rows, range(4 * row, 4 * row + 4)))
            index = index + stride

    return types.void(array, types.intp, types.intp, lanes), generate(build)


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


@intrinsic
def load_scalar(typingctx, array, index):
    """array[index], without wrapping of negative indices.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array.
        index: Index of the element.

    Returns:
        The element.
    """
    return array.dtype(array, types.intp), generate(lambda array, index: array.load(index))


@intrinsic
def store_scalar(typingctx, array, index, value):
    """array[index] = value, without wrapping of negative indices.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        array: Flat array.
        index: Index of the element.
        value: Number, converted to the type of the array.

    Returns:
        None; `array` is changed.
    """
    return types.void(array, types.intp, array.dtype), generate(lambda array, index, value: array.store(index, value))


def _prefetch(write):
    @intrinsic
    def function(typingctx, array, index):
        return types.void(array, types.intp), generate(lambda array, index: array.prefetch(index, write))

    return function


prefetch, prefetch_to_write = _prefetch(0), _prefetch(1)
"""Bring the cache line of array[index] into the caches, to read or to write it soon."""


@intrinsic
def atomic_add(typingctx, counter, index):
    """Increase counter[index] by one, atomically.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        counter: Flat int64 array.
        index: Index of the element.

    Returns:
        The value before.
    """

    def build(counter, index):
        return index.new(counter.builder.atomic_rmw("add", counter.address(index), LONG(1), "monotonic"))

    return types.int64(counter, types.intp), generate(build)
