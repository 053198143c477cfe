"""Loads and stores of the vectors of `carigs.simd.vectors`: rows and blocks; single elements; prefetching.

All functions take flat arrays and check nothing. An array that is stored to needs as many spare elements at its end as
the last store may overhang.
"""

from __future__ import annotations

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
