"""Compositing as in `forward`, sixteen pixels at a time.

A worker keeps a tile's pixels in its own small buffer and walks the tile's list once: for each surfel all blocks of
4 x 4 pixels that its box touches, then the next.  A plane of the buffer is interleaved by four rows,

    at(x, y) = ((y >> 2) * STRIDE + x) * 4 + (y & 3),

so that a block may start at any x (y is a multiple of 4) and is still sixteen consecutive numbers.  Four more columns
take what hangs over on the right.  Lanes outside a surfel's box do no harm: their alpha is below 1/255, which is what
the box means.  A pixel that has ended, or lies outside the image, holds T <= 0: nothing is added to it any more, and
|T| is the result.
"""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import (
    align_stack,
    atomic_add,
    load,
    load_scalar,
    prefetch,
    prefetch_to_write,
    store,
    store_block,
    store_scalar,
)
from carigs.simd.vector_math import absolute, block_columns, block_rows, exp2, largest, maximum, minimum, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer import culling as limits
from carigs.splat.rasterizer.binning import TILE
from carigs.splat.rasterizer.forward import (
    COLOUR,
    COLOUR_PLANES,
    DEPTH,
    END,
    HALF_LOG2E,
    LOG_THRESHOLD,
    ONE,
    PLANES,
    TWO,
    ZERO,
)
from carigs.splat.rasterizer.projection import RECORD

STRIDE = TILE + 4
PLANE = TILE * STRIDE
AHEAD = 8  # list entries by which records are fetched before they are needed
CHECK = 16  # list entries between two looks at whether all pixels of the tile have ended
# No alpha of 1/255 or more is accepted below this transmittance.
ALL_ENDED = np.float32(limits.END / (1 - limits.THRESHOLD))
FAINTEST = np.float32(-9)  # exponents are clamped to this, below LOG_THRESHOLD


@simd_inline
def open_pixels(state, columns_left, rows_left):
    """T = 1 in the image, 0 outside and in the overhang."""
    for y in range(0, TILE, 4):
        for x in range(0, STRIDE, 4):
            inside_x = block_columns() < np.float32(min(columns_left, TILE) - x)
            inside_y = block_rows() < np.float32(rows_left - y)
            store(state, y * STRIDE + 4 * x, select(inside_x & inside_y, broadcast(ONE), broadcast(ZERO)))


@simd_inline
def clear(state, begin, stop):
    """Zeros from `begin` to `stop`, both multiples of WIDTH."""
    for at in range(begin, stop, WIDTH):
        store(state, at, broadcast(ZERO))


@simd_inline
def all_ended(state):
    """Whether no surfel behind can contribute to the tile."""
    most = load(state, 0)
    for at in range(WIDTH, PLANE, WIDTH):
        most = maximum(most, load(state, at))
    return largest(most) <= ALL_ENDED


@simd_inline
def blocks(box, i, left, top):
    """Ranges of the blocks of surfel i in the tile, x from anywhere, y from a multiple of 4, relative to the tile."""
    x0, x1 = max(load_scalar(box, 4 * i) - left, 0), min(load_scalar(box, 4 * i + 1) - left, TILE)
    y0, y1 = max(load_scalar(box, 4 * i + 2) - top, 0) & ~3, min(load_scalar(box, 4 * i + 3) - top, TILE)
    return x0, x1, y0, y1


@simd_inline
def fetch_ahead(record, box, surfel, e, stop):
    """Have the processor load the record and the box of a later entry."""
    if e + AHEAD < stop:
        i = np.int64(load_scalar(surfel, e + AHEAD))
        prefetch(record, i * RECORD)
        prefetch(record, i * RECORD + RECORD - 1)
        prefetch(box, i * 4)


def _fetch(hint):
    @simd_inline
    def fetch(image, offset, width, height, down):
        """Have the processor load a tile's rows of all planes: they lie far apart, which it would not foresee."""
        for plane in range(image.size // (width * height)):
            for row in range(down):
                at = (plane * height + row) * width + offset
                for column in range(0, TILE, WIDTH):
                    hint(image, at + column)
                hint(image, at + TILE - 1)

    return fetch


fetch_tile, _fetch_tile_to_write = _fetch(prefetch), _fetch(prefetch_to_write)


@simd_inline
def write_plane(image, offset, width, across, down, state, base, magnitude, behind):
    """A plane of the buffer, plus `behind`, to the image: `across` x `down` pixels, the first one at `offset` there."""
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


def _work(geometry: bool):
    planes = PLANES if geometry else COLOUR_PLANES

    @simd_inline_alloc
    def work(_worker, record, box, surfel, start, order, image, width, height, cap, background, counter):
        align_stack()
        across = -(-width // TILE)
        state = np.empty(planes * PLANE + WIDTH, np.float32)
        while True:
            k = atomic_add(counter, 0)
            if k >= order.size:
                break
            t = np.int64(load_scalar(order, k))
            left, top = (t % across) * TILE, (t // across) * TILE
            begin, stop = np.int64(load_scalar(start, t)), np.int64(load_scalar(start, t + 1))
            _fetch_tile_to_write(image, top * width + left, width, height, min(TILE, height - top))
            clear(state, PLANE, planes * PLANE)
            open_pixels(state, width - left, height - top)
            for e in range(begin, stop):
                if (e - begin) % CHECK == CHECK - 1 and all_ended(state):
                    break
                fetch_ahead(record, box, surfel, e, stop)
                i = np.int64(load_scalar(surfel, e))
                x0, x1, y0, y1 = blocks(box, i, left, top)
                r = i * RECORD
                offset_x = load_scalar(record, r) + np.float32(left + x0 - load_scalar(box, 4 * i))
                offset_y = load_scalar(record, r + 1) + np.float32(top + y0 - load_scalar(box, 4 * i + 2))
                u0, u1 = broadcast(load_scalar(record, r + 2)), broadcast(load_scalar(record, r + 3))
                v0, v1 = broadcast(load_scalar(record, r + 4)), broadcast(load_scalar(record, r + 5))
                det, a3, b3 = (
                    broadcast(load_scalar(record, r + 6)),
                    broadcast(load_scalar(record, r + 7)),
                    broadcast(load_scalar(record, r + 8)),
                )
                ex, ey = broadcast(load_scalar(record, r + 9)), broadcast(load_scalar(record, r + 10))
                opacity = broadcast(load_scalar(record, r + 11))
                red, green, blue = (
                    broadcast(load_scalar(record, r + 12)),
                    broadcast(load_scalar(record, r + 13)),
                    broadcast(load_scalar(record, r + 14)),
                )
                depth, nx = broadcast(load_scalar(record, r + 15)), broadcast(load_scalar(record, r + 16))
                ny, nz = broadcast(load_scalar(record, r + 17)), broadcast(load_scalar(record, r + 18))
                for y in range(y0, y1, 4):
                    dy = block_rows() + (offset_y + np.float32(y - y0))
                    # What is constant along the row of blocks.
                    u1_dy, u0_dy, plane, low = u1 * dy, u0 * dy, det + b3 * dy, (dy + ey) * (dy + ey)
                    for x in range(x0, x1, 4):
                        dx = block_columns() + (offset_x + np.float32(x - x0))
                        iz = ONE / (plane + a3 * dx)
                        s, u = (v1 * dx - u1_dy) * iz, (u0_dy - v0 * dx) * iz
                        g = minimum(s * s + u * u, ((dx + ex) * (dx + ex) + low) * TWO)
                        exponent = opacity - g * HALF_LOG2E
                        valid = exponent >= LOG_THRESHOLD
                        alpha = minimum(exp2(maximum(exponent, broadcast(FAINTEST))), broadcast(cap))
                        at = y * STRIDE + 4 * x
                        before = load(state, at)
                        w = before * alpha
                        after = before - w
                        goes_on = valid & (after > END)
                        w = select(goes_on, w, broadcast(ZERO))
                        ended = select(valid, broadcast(ZERO) - absolute(before), before)
                        store(state, at, select(goes_on, after, ended))
                        store(state, at + PLANE, load(state, at + PLANE) + w * red)
                        store(state, at + 2 * PLANE, load(state, at + 2 * PLANE) + w * green)
                        store(state, at + 3 * PLANE, load(state, at + 3 * PLANE) + w * blue)
                        if geometry:
                            # The depth plane before this surfel is D of the distortion.
                            front = load(state, at + 4 * PLANE)
                            spread = w * (depth * (ONE - before) - front) * TWO
                            store(state, at + 4 * PLANE, front + w * depth)
                            store(state, at + 5 * PLANE, load(state, at + 5 * PLANE) + w * nx)
                            store(state, at + 6 * PLANE, load(state, at + 6 * PLANE) + w * ny)
                            store(state, at + 7 * PLANE, load(state, at + 7 * PLANE) + w * nz)
                            store(state, at + 8 * PLANE, load(state, at + 8 * PLANE) + spread)
            for plane in range(image.size // (width * height)):  # a number that LLVM does not unroll
                write_plane(
                    image, (plane * height + top) * width + left, width, min(TILE, width - left),
                    min(TILE, height - top), state, plane * PLANE, plane == 0,
                    background if COLOUR <= plane < DEPTH else ZERO,
                )  # fmt: skip

    return work


_work_colour, _work_all = _work(geometry=False), _work(geometry=True)


# Two functions, and what they call by its global name: the key of a cached closure that holds compiled functions is new
# in every process, and the kernel would be compiled again and again.
@kernel
def _composite_colour(workers, *arguments):
    parallel_for(_work_colour, workers, arguments)


@kernel
def _composite_all(workers, *arguments):
    parallel_for(_work_all, workers, arguments)


def composite(record, box, surfel, start, order, width, height, cap, geometry, background, workers):
    """As `forward.composite`, to rounding."""
    image = np.empty((PLANES if geometry else COLOUR_PLANES, height, width), np.float32)
    composited = _composite_all if geometry else _composite_colour
    composited(
        workers, record.reshape(-1), box.reshape(-1), surfel, start, order, image.reshape(-1), width, height,
        np.float32(cap), np.float32(background), np.zeros(1, np.int64),
    )  # fmt: skip
    return image
