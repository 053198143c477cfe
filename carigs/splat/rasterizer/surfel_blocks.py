"""The surfels of a tile for the vector kernels: their records, and the blocks of 4 x 4 pixels that a box overlaps."""

from __future__ import annotations

import numpy as np

from carigs.simd.memory import load_scalar, prefetch
from carigs.simd.tuples import tuple_function
from carigs.simd.vectors import broadcast, simd_inline
from carigs.splat.rasterizer.binning import TILE_SIZE
from carigs.splat.rasterizer.forward import ONE
from carigs.splat.rasterizer.records import RECORD_COLUMN, RECORD_SIZE, SurfelRecord

PREFETCH_DISTANCE = 8  # pairs by which records are fetched before they are needed


@simd_inline
def _broadcast_element(array, first, k):
    return broadcast(load_scalar(array, first + k))


_broadcast_elements = tuple_function(
    lambda call, record, first: [call(_broadcast_element, record, first, k) for k in RECORD_COLUMN]
)


@simd_inline
def tile_pairs(lists, k, across):
    """The tile that comes next, and its pairs.

    Args:
        lists: `TileLists`.
        k: Number of the tile in the order of work.
        across: Number of tiles in a row of the image.

    Returns:
        Left column and top row of the tile in the image; range of its pairs.
    """
    tile = np.int64(load_scalar(lists.order, k))
    begin, stop = np.int64(load_scalar(lists.start, tile)), np.int64(load_scalar(lists.start, tile + 1))
    return (tile % across) * TILE_SIZE, (tile // across) * TILE_SIZE, begin, stop


@simd_inline
def block_range(box, i, left, top):
    """Ranges of the blocks of a surfel, relative to the tile.

    Args:
        box: Flat pixel boxes.
        i: Surfel.
        left: First column of the tile.
        top: First row of the tile.

    Returns:
        x0, x1, y0, y1, half open, in pixels; y0 is a multiple of 4.
    """
    x0, x1 = max(load_scalar(box, 4 * i) - left, 0), min(load_scalar(box, 4 * i + 1) - left, TILE_SIZE)
    y0, y1 = max(load_scalar(box, 4 * i + 2) - top, 0) & ~3, min(load_scalar(box, 4 * i + 3) - top, TILE_SIZE)
    return x0, x1, y0, y1


@simd_inline
def broadcast_record(record, i):
    """The record of a surfel.

    Args:
        record: Flat records.
        i: Surfel.

    Returns:
        `SurfelRecord` of vectors with equal lanes.
    """
    return SurfelRecord(*_broadcast_elements(record, i * RECORD_SIZE))


@simd_inline
def block_offset(record, box, i, x, y):
    """Offset of a block's first pixel centre from the projected centre.

    Args:
        record: Flat records.
        box: Flat pixel boxes.
        i: Surfel.
        x: Column of the block in the image.
        y: Row of the block in the image.

    Returns:
        dx and dy in pixels.
    """
    r = i * RECORD_SIZE
    return (
        load_scalar(record, r + RECORD_COLUMN.dx) + np.float32(x - load_scalar(box, 4 * i)),
        load_scalar(record, r + RECORD_COLUMN.dy) + np.float32(y - load_scalar(box, 4 * i + 2)),
    )


@simd_inline
def row_terms(surfel, dy):
    """Terms of `squared_distance` that are constant along a row of blocks.

    Args:
        surfel: `SurfelRecord` of vectors.
        dy: Offsets of the pixels from the projected centre, in y.

    Returns:
        Three vectors.
    """
    return surfel.u1 * dy, surfel.u0 * dy, surfel.det + surfel.b3 * dy


@simd_inline
def squared_distance(surfel, row, dx):
    """Disc coordinates of the rays through the pixels of a block.

    Args:
        surfel: `SurfelRecord` of vectors.
        row: `row_terms` of the block's row.
        dx: Offsets of the pixels from the projected centre, in x.

    Returns:
        s, t and 1 / zz as `forward.intersect`, and s^2 + t^2.
    """
    u1_dy, u0_dy, zz_row = row
    iz = ONE / (zz_row + surfel.a3 * dx)
    s, t = (surfel.v1 * dx - u1_dy) * iz, (u0_dy - surfel.v0 * dx) * iz
    return s, t, iz, s * s + t * t


@simd_inline
def prefetch_surfel(record, box, surfel, e, stop):
    """Prefetch the record and the box of the surfel PREFETCH_DISTANCE pairs ahead.

    Args:
        record: Flat records.
        box: Flat pixel boxes.
        surfel: Surfels of the pairs.
        e: Current pair.
        stop: End of the tile's pairs.
    """
    if e + PREFETCH_DISTANCE < stop:
        i = np.int64(load_scalar(surfel, e + PREFETCH_DISTANCE))
        prefetch(record, i * RECORD_SIZE)
        prefetch(record, i * RECORD_SIZE + RECORD_SIZE - 1)
        prefetch(box, i * 4)
