"""The pixels of one tile in a worker's buffer, in blocks of 4 x 4 pixels = one vector, for the vector kernels.

A plane of the buffer is interleaved by four rows,

    offset(x, y) = ((y >> 2) * STRIDE + x) * 4 + (y & 3),

so that a block may start at any x (y is a multiple of 4) and is still sixteen consecutive floats: lane = 4 * column +
row. Four additional columns on the right take the overhang of the last block. Plane 0 holds the transmittance T; pixels
that are complete or outside the image have T <= 0 and receive no more contributions.
"""

from __future__ import annotations

import numpy as np

from carigs.simd.memory import (
    load,
    load_block,
    load_scalar,
    prefetch,
    prefetch_to_write,
    store,
    store_block,
    store_scalar,
)
from carigs.simd.reductions import reduce_max
from carigs.simd.vector_math import absolute, block_columns, block_rows, exp2, maximum, minimum, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline
from carigs.splat.rasterizer.binning import TILE_SIZE
from carigs.splat.rasterizer.forward import LOG2_ALPHA_THRESHOLD, MIN_TRANSMITTANCE, ONE, ZERO
from carigs.splat.rasterizer.records import ALPHA_THRESHOLD, TRANSMITTANCE_THRESHOLD

STRIDE = TILE_SIZE + 4
PLANE_SIZE = TILE_SIZE * STRIDE
CHECK_INTERVAL = 16  # pairs between two tests whether all pixels of the tile are complete
# Below this transmittance no alpha of 1/255 or more is accepted.
COMPLETE = np.float32(TRANSMITTANCE_THRESHOLD / (1 - ALPHA_THRESHOLD))
MIN_EXPONENT = np.float32(-9)  # lower limit of log2(alpha) in the exponential; less than log2(1/255)


@simd_inline
def open_pixels(state, columns_left, rows_left):
    """Set T = 1 inside the image, 0 outside and in the overhang.

    Args:
        state: Buffer.
        columns_left: Columns of the image from the tile's left edge on.
        rows_left: Rows of the image from the tile's top edge on.
    """
    for y in range(0, TILE_SIZE, 4):
        for x in range(0, STRIDE, 4):
            inside_x = block_columns() < np.float32(min(columns_left, TILE_SIZE) - x)
            inside_y = block_rows() < np.float32(rows_left - y)
            store(state, y * STRIDE + 4 * x, select(inside_x & inside_y, broadcast(ONE), broadcast(ZERO)))


@simd_inline
def clear(state, begin, stop):
    """Set a range of the buffer to zero.

    Args:
        state: Buffer.
        begin: First element, a multiple of WIDTH.
        stop: End of the range, a multiple of WIDTH.
    """
    for at in range(begin, stop, WIDTH):
        store(state, at, broadcast(ZERO))


@simd_inline
def is_complete(state, pair):
    """Whether no further surfel can contribute to the tile; tested before each CHECK_INTERVAL-th pair.

    Args:
        state: Buffer.
        pair: Number of pairs before.

    Returns:
        True if the largest transmittance was tested and is at most COMPLETE.
    """
    if pair % CHECK_INTERVAL != CHECK_INTERVAL - 1:
        return False
    most = load(state, 0)
    for at in range(WIDTH, PLANE_SIZE, WIDTH):
        most = maximum(most, load(state, at))
    return reduce_max(most) <= COMPLETE


@simd_inline
def attenuate(state, at, log2_alpha, alpha_cap):
    """Composite a surfel in one block: pass on the transmittance.

    Args:
        state: Buffer.
        at: Position of the block.
        log2_alpha: log2 of alpha before the cap; NaN where there is none.
        alpha_cap: Upper limit of alpha.

    Returns:
        Vectors of the pixels: transmittance before, alpha before the cap, alpha, weight w (0 where the surfel does not
        contribute), and the mask of the pixels to which it contributes.
    """
    valid = log2_alpha >= LOG2_ALPHA_THRESHOLD
    uncapped = exp2(maximum(log2_alpha, broadcast(MIN_EXPONENT)))
    alpha = minimum(uncapped, broadcast(alpha_cap))
    before = load(state, at)
    w = before * alpha
    after = before - w
    continues = valid & (after > MIN_TRANSMITTANCE)
    complete = select(valid, broadcast(ZERO) - absolute(before), before)
    store(state, at, select(continues, after, complete))
    return before, uncapped, alpha, select(continues, w, broadcast(ZERO)), continues


def _prefetch_rows(hint):
    @simd_inline
    def prefetch_rows(image, offset, width, height, down):
        # The rows of a tile lie far apart: hardware does not prefetch them.
        for plane in range(image.size // (width * height)):
            for row in range(down):
                at = (plane * height + row) * width + offset
                for column in range(0, TILE_SIZE, WIDTH):
                    hint(image, at + column)
                hint(image, at + TILE_SIZE - 1)

    return prefetch_rows


prefetch_tile, prefetch_tile_to_write = _prefetch_rows(prefetch), _prefetch_rows(prefetch_to_write)
"""Prefetch `down` rows of a tile in all planes of a flat image (image, offset, width, height, down)."""


@simd_inline
def write_plane(image, offset, width, across, down, state, base, magnitude, behind):
    """Copy a plane of the buffer to the image.

    Args:
        image: Flat image.
        offset: Position of the tile's first pixel in the image.
        width: Image width.
        across: Columns to copy.
        down: Rows to copy.
        state: Buffer.
        base: Start of the plane in the buffer.
        magnitude: Whether to take the absolute value.
        behind: Number to add.
    """
    for y in range(0, down, 4):
        for x in range(0, across, 4):
            at = base + y * STRIDE + 4 * x
            value = load(state, at) + behind
            if magnitude:
                value = absolute(value)
            if x + 4 <= across and y + 4 <= down:
                store_block(image, offset + y * width + x, width, value)
            else:
                store(state, at, value)
                for row in range(min(4, down - y)):
                    for column in range(min(4, across - x)):
                        pixel = offset + (y + row) * width + x + column
                        store_scalar(image, pixel, load_scalar(state, at + 4 * column + row))


@simd_inline
def read_plane(state, base, image, offset, width, across, down):
    """Copy a plane of the image to the buffer; zero outside the image.

    Args:
        state: Buffer.
        base: Start of the plane in the buffer.
        image: Flat image.
        offset: Position of the tile's first pixel in the image.
        width: Image width.
        across: Columns to copy.
        down: Rows to copy.
    """
    for y in range(0, TILE_SIZE, 4):
        for x in range(0, TILE_SIZE, 4):
            at = base + y * STRIDE + 4 * x
            if x + 4 <= across and y + 4 <= down:
                store(state, at, load_block(image, offset + y * width + x, width))
            else:
                store(state, at, broadcast(ZERO))
                for row in range(min(4, down - y)):
                    for column in range(min(4, across - x)):
                        pixel = offset + (y + row) * width + x + column
                        store_scalar(state, at + 4 * column + row, load_scalar(image, pixel))


@simd_inline
def add_to_plane(state, at, value):
    """Add to one block of the buffer.

    Args:
        state: Buffer.
        at: Position of the block.
        value: Vector.
    """
    store(state, at, load(state, at) + value)


@simd_inline
def multiply_add(state, to, a, b):
    """Plane `to` += plane `a` * plane `b`.

    Args:
        state: Buffer.
        to: Start of the plane that is added to.
        a: Start of the first factor's plane.
        b: Start of the second factor's plane.
    """
    for at in range(0, PLANE_SIZE, WIDTH):
        add_to_plane(state, to + at, load(state, a + at) * load(state, b + at))


@simd_inline
def subtract(state, plane, number, sign):
    """Plane = (plane - number) * sign.

    Args:
        state: Buffer.
        plane: Start of the plane.
        number: Number to subtract.
        sign: 1 or -1.
    """
    for at in range(plane, plane + PLANE_SIZE, WIDTH):
        store(state, at, (load(state, at) - number) * sign)


@simd_inline
def copy_plane(state, to, a):
    """Plane `to` = plane `a`.

    Args:
        state: Buffer.
        to: Start of the destination.
        a: Start of the source.
    """
    for at in range(0, PLANE_SIZE, WIDTH):
        store(state, to + at, load(state, a + at))
