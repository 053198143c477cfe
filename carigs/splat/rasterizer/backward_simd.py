"""Gradient of the compositing as in `backward`, sixteen pixels at a time (`backend="cpu"`; see `tile_buffer`).

The sums over the pixels of a (surfel, tile) pair stay in registers until all of its blocks are done; then they are
reduced over the lanes together.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import (
    align_stack,
    atomic_add,
    flattened,
    load,
    load_scalar,
    prefetch_to_write,
    store,
    store_scalar,
)
from carigs.simd.reductions import reduce_add, reduce_add_each
from carigs.simd.tuples import add, componentwise, multiply, outer, subtract
from carigs.simd.vector_math import block_columns, block_rows, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer import surfel_blocks, tile_buffer
from carigs.splat.rasterizer.binning import TILE_SIZE, TileLists
from carigs.splat.rasterizer.forward import HALF_LOG2E, ONE, TWO, ZERO
from carigs.splat.rasterizer.records import (
    GRADIENT_COLUMN,
    GRADIENT_SIZE,
    NUM_COLOUR_PLANES,
    NUM_GEOMETRY_PLANES,
    NUM_PLANES,
    PLANE,
    Compositing,
    ProjectedSurfels,
)
from carigs.splat.rasterizer.tile_buffer import PLANE_SIZE, STRIDE

# Starts of the planes in the buffer: T, the remainder S_i, upstream gradients of alpha, colour, depth, normal and
# distortion as far as there are any; then D_i and, for the distortion, the totals A and D.
STARTS = tuple(plane * PLANE_SIZE for plane in range(14))
REMAINDER, ALPHA = STARTS[1:3]
COLOUR, DEPTH, NORMAL = STARTS[3:6], STARTS[6], STARTS[7:10]
DISTORTION, DEPTH_IN_FRONT, TOTAL_ALPHA, TOTAL_DEPTH = STARTS[10:]
_load, _select = componentwise(load), componentwise(select)


def _tile_worker(num_planes: int):
    """The function that each thread runs: it differentiates one tile after the other until none is left.

    Args:
        num_planes: Number of planes of the image that have a gradient.
    """
    geometry, distortion = num_planes > PLANE.depth, num_planes > PLANE.distortion
    scratch = ALPHA + num_planes * PLANE_SIZE  # with distortion this is D_i
    size_of_state = (TOTAL_DEPTH if distortion else scratch) + PLANE_SIZE

    @simd_inline
    def fill(state, image, upstream, height, width, left, top, background):
        """Read the upstream gradients; T = 1, remainder Q = sum_c v_c output_c + v_a alpha + 2 v_x distortion."""
        across, down = min(TILE_SIZE, width - left), min(TILE_SIZE, height - top)
        pixel, size = top * width + left, width * height
        tile_buffer.prefetch_tile(image, pixel, width, height, down)
        tile_buffer.prefetch_tile(upstream, pixel, width, height, down)
        tile_buffer.clear(state, 0, size_of_state)
        first = 1 if upstream.size == 3 * size else 0  # plane of the image that upstream begins with
        for plane in range(first, first + upstream.size // size):  # not a constant: LLVM would unroll the loop
            gradient = ALPHA + plane * PLANE_SIZE
            tile_buffer.read_plane(state, gradient, upstream, (plane - first) * size + pixel, width, across, down)
            tile_buffer.read_plane(state, scratch, image, plane * size + pixel, width, across, down)
            if plane == 0:
                # The image holds T, upstream is the gradient of alpha = 1 - T.
                tile_buffer.subtract(state, scratch, ONE, -ONE)
            elif plane < PLANE.depth:
                tile_buffer.subtract(state, scratch, background, ONE)
            tile_buffer.multiply_add(state, REMAINDER, gradient, scratch)
            if distortion:
                if plane == 0:
                    tile_buffer.copy_plane(state, TOTAL_ALPHA, scratch)
                if plane == PLANE.depth:
                    tile_buffer.copy_plane(state, TOTAL_DEPTH, scratch)
                if plane == PLANE.distortion:
                    tile_buffer.multiply_add(state, REMAINDER, DISTORTION, scratch)
        tile_buffer.clear(state, scratch, scratch + PLANE_SIZE)
        tile_buffer.open_pixels(state, width - left, height - top)

    @simd_inline_alloc
    def differentiate_tiles(_worker, projected, lists, compositing, image, upstream, slots, next_tile):
        align_stack()
        record, box = projected.record, projected.box
        width, height = compositing.width, compositing.height
        across = -(-width // TILE_SIZE)
        state = np.empty(size_of_state + WIDTH, np.float32)
        while True:
            k = atomic_add(next_tile, 0)
            if k >= lists.order.size:
                break
            left, top, begin, stop = surfel_blocks.tile_pairs(lists, k, across)
            if begin == stop:
                continue
            fill(state, image, upstream, height, width, left, top, compositing.background)
            done = False
            for e in range(begin, stop):
                slot = np.int64(load_scalar(lists.slot, e)) * GRADIENT_SIZE
                done = done or tile_buffer.is_complete(state, e - begin)
                if done:
                    store(slots, slot, broadcast(ZERO))
                    store(slots, slot + GRADIENT_SIZE - WIDTH, broadcast(ZERO))
                    continue
                surfel_blocks.prefetch_surfel(record, box, lists.surfel, e, stop)
                if e + surfel_blocks.PREFETCH_DISTANCE < stop:
                    ahead = np.int64(load_scalar(lists.slot, e + surfel_blocks.PREFETCH_DISTANCE)) * GRADIENT_SIZE
                    prefetch_to_write(slots, ahead)
                    prefetch_to_write(slots, ahead + GRADIENT_SIZE - 1)
                i = np.int64(load_scalar(lists.surfel, e))
                x0, x1, y0, y1 = surfel_blocks.block_range(box, i, left, top)
                offset_x, offset_y = surfel_blocks.block_offset(record, box, i, left + x0, top + y0)
                surfel = surfel_blocks.broadcast_record(record, i)
                # Sums over the pixels: see `records.GradientSlot`.
                zero = broadcast(ZERO)
                g_zz = g_alpha = g_depth = zero
                g_xy = g_zz_moments = (zero, zero)
                g_colour = g_normal = (zero, zero, zero)
                g_xy_moments = (zero, zero, zero, zero)
                for y in range(y0, y1, 4):
                    dy = block_rows() + (offset_y + np.float32(y - y0))
                    row = surfel_blocks.row_terms(surfel, dy)
                    for x in range(x0, x1, 4):
                        dx = block_columns() + (offset_x + np.float32(x - x0))
                        s, t, iz, squared = surfel_blocks.squared_distance(surfel, row, dx)
                        exponent = surfel.log2_opacity - squared * HALF_LOG2E
                        at = y * STRIDE + 4 * x
                        before, uncapped, alpha, w, continues = tile_buffer.attenuate(
                            state, at, exponent, compositing.alpha_cap
                        )
                        v = _load(state, add(at, COLOUR))
                        q = load(state, at + ALPHA) + v[0] * surfel.red + v[1] * surfel.green + v[2] * surfel.blue
                        g_colour = add(g_colour, multiply(w, v))
                        if geometry:
                            v, v_depth = _load(state, add(at, NORMAL)), load(state, at + DEPTH)
                            q = q + v_depth * surfel.depth + v[0] * surfel.normal_x + v[1] * surfel.normal_y
                            q = q + v[2] * surfel.normal_z
                            g_normal = add(g_normal, multiply(w, v))
                            g_depth += w * v_depth
                        if distortion:
                            v_spread = load(state, at + DISTORTION) * TWO
                            front = load(state, at + DEPTH_IN_FRONT)
                            total_alpha = load(state, at + TOTAL_ALPHA)
                            in_front = ONE - before
                            change = (surfel.depth * in_front - front) * TWO - surfel.depth * total_alpha
                            q += v_spread * (change + load(state, at + TOTAL_DEPTH))
                            g_depth += w * v_spread * (in_front * TWO + w - total_alpha)
                            store(state, at + DEPTH_IN_FRONT, front + w * surfel.depth)
                        behind = load(state, at + REMAINDER) - w * q
                        store(state, at + REMAINDER, behind)
                        g = alpha * (before * q - behind / (ONE - alpha))
                        c = g * iz
                        # Selected after the products: grazing rays have infinite s and t.
                        varies = continues & (uncapped <= compositing.alpha_cap)
                        g, zx, zy, zz = _select(varies, (g, c * s, c * t, c * squared), zero)
                        g_alpha += g
                        g_xy = subtract(g_xy, (zx, zy))
                        g_zz += zz
                        g_xy_moments = subtract(g_xy_moments, outer((zx, zy), (dx, dy)))
                        g_zz_moments = add(g_zz_moments, multiply(zz, (dx, dy)))
                # No store exceeds the slot: its neighbours belong to other workers.
                columns = (*g_xy, g_zz, *g_xy_moments, *g_zz_moments, g_alpha, *g_colour, g_depth, *g_normal[:2])
                store(slots, slot, reduce_add_each(columns))
                store_scalar(slots, slot + GRADIENT_COLUMN.normal_z, reduce_add(g_normal[2]) if geometry else ZERO)

    return differentiate_tiles


_differentiate_tiles_colour = _tile_worker(NUM_COLOUR_PLANES)
_differentiate_tiles_geometry = _tile_worker(NUM_GEOMETRY_PLANES)
_differentiate_tiles_distortion = _tile_worker(NUM_PLANES)


# As in `forward_simd`: Numba's cache does not recognize closures over compiled functions.
@kernel
def _backward_colour(workers, *arguments):
    parallel_for(_differentiate_tiles_colour, workers, arguments)


@kernel
def _backward_geometry(workers, *arguments):
    parallel_for(_differentiate_tiles_geometry, workers, arguments)


@kernel
def _backward_distortion(workers, *arguments):
    parallel_for(_differentiate_tiles_distortion, workers, arguments)


_KERNELS = {
    3: _backward_colour,
    NUM_COLOUR_PLANES: _backward_colour,
    NUM_GEOMETRY_PLANES: _backward_geometry,
    NUM_PLANES: _backward_distortion,
}
"""Kernels by the number of planes that have a gradient."""


def composite_backward(
    projected: ProjectedSurfels,
    lists: TileLists,
    compositing: Compositing,
    image: Float32[np.ndarray, "planes h w"],
    upstream: Float32[np.ndarray, "upstream_planes h w"],
    workers: int,
) -> Float32[np.ndarray, "pairs 17"]:
    """Gradient of `forward_simd.composite`: as `backward.composite_backward`, to rounding.

    Args:
        projected: Records and pixel boxes.
        lists: Depth-sorted surfels of every tile.
        compositing: Image size and constants.
        image: Planes that `composite` returned.
        upstream: Gradients of the loss with respect to the first planes, as many as `records` names, the first one with
            respect to alpha = 1 - T; or with respect to the colours alone (3 planes).
        workers: Number of threads; the result does not depend on it.

    Returns:
        Gradient slots: sums over the pixels of each (surfel, tile) pair, see `records`.
    """
    size = lists.surfel.size * GRADIENT_SIZE
    slots = np.empty(size + WIDTH, np.float32)
    arguments = flattened(projected), lists, compositing, image.reshape(-1), upstream.reshape(-1), slots
    _KERNELS[len(upstream)](workers, *arguments, np.zeros(1, np.int64))
    return slots[:size].reshape(-1, GRADIENT_SIZE)
