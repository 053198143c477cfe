"""Compositing as in `forward`, sixteen pixels at a time (`backend="cpu"`).

A worker takes the next tile from an atomic counter and traverses the tile's list once: for each surfel all blocks of
4 x 4 pixels that its box overlaps (see `tile_buffer`). All lanes of a block are computed; those outside the
surfel's box have an alpha below 1/255 by definition of the box.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, atomic_add, flattened, load, load_scalar
from carigs.simd.vector_math import block_columns, block_rows
from carigs.simd.vectors import WIDTH, simd_inline_alloc
from carigs.splat.rasterizer import surfel_blocks, tile_buffer
from carigs.splat.rasterizer.binning import TILE_SIZE, TileLists
from carigs.splat.rasterizer.forward import HALF_LOG2E, ONE, TWO, ZERO
from carigs.splat.rasterizer.records import (
    NUM_COLOUR_PLANES,
    NUM_GEOMETRY_PLANES,
    NUM_PLANES,
    PLANE,
    Compositing,
    Planes,
    ProjectedSurfels,
)
from carigs.splat.rasterizer.tile_buffer import PLANE_SIZE, STRIDE

START = Planes(*(plane * PLANE_SIZE for plane in PLANE))
"""Start of each plane in the buffer."""


def _tile_worker(num_planes: int):
    """The function that each thread runs: it composites one tile after the other until none is left.

    Args:
        num_planes: Number of planes that it computes.
    """
    geometry, distortion = num_planes > PLANE.depth, num_planes > PLANE.distortion

    @simd_inline_alloc
    def composite_tiles(_worker, projected, lists, compositing, image, next_tile):
        align_stack()
        record, box = projected.record, projected.box
        width, height = compositing.width, compositing.height
        across = -(-width // TILE_SIZE)
        state = np.empty(num_planes * PLANE_SIZE + WIDTH, np.float32)
        while True:
            k = atomic_add(next_tile, 0)
            if k >= lists.order.size:
                break
            left, top, begin, stop = surfel_blocks.tile_pairs(lists, k, across)
            tile_buffer.prefetch_tile_to_write(image, top * width + left, width, height, min(TILE_SIZE, height - top))
            tile_buffer.clear(state, PLANE_SIZE, num_planes * PLANE_SIZE)
            tile_buffer.open_pixels(state, width - left, height - top)
            for e in range(begin, stop):
                if tile_buffer.is_complete(state, e - begin):
                    break
                surfel_blocks.prefetch_surfel(record, box, lists.surfel, e, stop)
                i = np.int64(load_scalar(lists.surfel, e))
                x0, x1, y0, y1 = surfel_blocks.block_range(box, i, left, top)
                offset_x, offset_y = surfel_blocks.block_offset(record, box, i, left + x0, top + y0)
                surfel = surfel_blocks.broadcast_record(record, i)
                for y in range(y0, y1, 4):
                    row = surfel_blocks.row_terms(surfel, block_rows() + (offset_y + np.float32(y - y0)))
                    for x in range(x0, x1, 4):
                        dx = block_columns() + (offset_x + np.float32(x - x0))
                        _s, _t, _iz, squared = surfel_blocks.squared_distance(surfel, row, dx)
                        exponent = surfel.log2_opacity - squared * HALF_LOG2E
                        at = y * STRIDE + 4 * x
                        before, _, _, w, _ = tile_buffer.attenuate(state, at, exponent, compositing.alpha_cap)
                        tile_buffer.add_to_plane(state, at + START.red, w * surfel.red)
                        tile_buffer.add_to_plane(state, at + START.green, w * surfel.green)
                        tile_buffer.add_to_plane(state, at + START.blue, w * surfel.blue)
                        if distortion:
                            # The depth plane before this surfel is D_i.
                            spread = w * (surfel.depth * (ONE - before) - load(state, at + START.depth)) * TWO
                            tile_buffer.add_to_plane(state, at + START.distortion, spread)
                        if geometry:
                            tile_buffer.add_to_plane(state, at + START.depth, w * surfel.depth)
                            tile_buffer.add_to_plane(state, at + START.normal_x, w * surfel.normal_x)
                            tile_buffer.add_to_plane(state, at + START.normal_y, w * surfel.normal_y)
                            tile_buffer.add_to_plane(state, at + START.normal_z, w * surfel.normal_z)
            for plane in range(image.size // (width * height)):  # not a constant: LLVM would unroll the loop
                tile_buffer.write_plane(
                    image, (plane * height + top) * width + left, width, min(TILE_SIZE, width - left),
                    min(TILE_SIZE, height - top), state, plane * PLANE_SIZE, plane == 0,
                    compositing.background if PLANE.red <= plane < PLANE.depth else ZERO,
                )  # fmt: skip

    return composite_tiles


_composite_tiles_colour = _tile_worker(NUM_COLOUR_PLANES)
_composite_tiles_geometry = _tile_worker(NUM_GEOMETRY_PLANES)
_composite_tiles_distortion = _tile_worker(NUM_PLANES)


# Kernels that refer to their tasks by global names: Numba would compile a closure over compiled functions in every
# process, because its cache does not recognize it.
@kernel
def _composite_colour(workers, *arguments):
    parallel_for(_composite_tiles_colour, workers, arguments)


@kernel
def _composite_geometry(workers, *arguments):
    parallel_for(_composite_tiles_geometry, workers, arguments)


@kernel
def _composite_distortion(workers, *arguments):
    parallel_for(_composite_tiles_distortion, workers, arguments)


_KERNELS = {
    NUM_COLOUR_PLANES: _composite_colour,
    NUM_GEOMETRY_PLANES: _composite_geometry,
    NUM_PLANES: _composite_distortion,
}


def composite(
    projected: ProjectedSurfels, lists: TileLists, compositing: Compositing, num_planes: int, workers: int
) -> Float32[np.ndarray, "planes h w"]:
    """Composite the surfels of all tiles: as `forward.composite`, to rounding.

    Args:
        projected: Records and pixel boxes; colours are relative to the background.
        lists: Depth-sorted surfels of every tile.
        compositing: Image size and constants.
        num_planes: Number of planes to compute: one of those in `records`.
        workers: Number of threads; the result does not depend on it.

    Returns:
        The first planes of the image: T, r, g, b; depth, normal x, y, z; distortion.
    """
    image = np.empty((num_planes, compositing.height, compositing.width), np.float32)
    arguments = flattened(projected), lists, compositing, image.reshape(-1), np.zeros(1, np.int64)
    _KERNELS[num_planes](workers, *arguments)
    return image
