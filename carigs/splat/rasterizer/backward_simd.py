"""Gradient of the compositing as in `backward`, sixteen pixels at a time (`backend="cpu"`; see `tile_buffer`).

The sums over the pixels of a (surfel, tile) pair stay in registers until all of its blocks are done; then they are
reduced over the lanes together.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, atomic_add, load, load_scalar, prefetch_to_write, store, store_scalar
from carigs.simd.vector_math import (
    absolute,
    block_columns,
    block_rows,
    exp2,
    maximum,
    minimum,
    reduce_add,
    select,
    total,
)
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer import tile_buffer
from carigs.splat.rasterizer.binning import TILE_SIZE, TileLists
from carigs.splat.rasterizer.forward import HALF_LOG2E, LOG2_ALPHA_THRESHOLD, MIN_TRANSMITTANCE, ONE, TWO, ZERO
from carigs.splat.rasterizer.records import GRADIENT_COLUMN, GRADIENT_SIZE, PLANE, Compositing, ProjectedSurfels
from carigs.splat.rasterizer.tile_buffer import PLANE_SIZE, STRIDE

# Starts of the planes in the buffer: T, the remainder S_i, upstream gradients of alpha, colour and (with geometry)
# depth, normal, distortion; then D_i and the totals A and D of the distortion.
STARTS = tuple(plane * PLANE_SIZE for plane in range(14))
REMAINDER, ALPHA, RED, GREEN, BLUE, DEPTH, NORMAL_X, NORMAL_Y, NORMAL_Z, DISTORTION = STARTS[1:11]
DEPTH_IN_FRONT, TOTAL_ALPHA, TOTAL_DEPTH = STARTS[11:]


def _tile_worker(geometry: bool):
    """The task of one worker, with or without depth, normal and distortion."""
    size_of_state = (TOTAL_DEPTH if geometry else DEPTH) + PLANE_SIZE  # without geometry DEPTH is scratch space

    @simd_inline
    def fill(state, image, upstream, height, width, left, top, background):
        """Read the upstream gradients; T = 1, remainder Q = sum_c v_c output_c + v_a alpha + 2 v_x distortion."""
        across, down = min(TILE_SIZE, width - left), min(TILE_SIZE, height - top)
        pixel, size = top * width + left, width * height
        tile_buffer.prefetch_tile(image, pixel, width, height, down)
        tile_buffer.prefetch_tile(upstream, pixel, width, height, down)
        tile_buffer.clear(state, 0, size_of_state)
        scratch = DEPTH_IN_FRONT if geometry else DEPTH
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
            if geometry:
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
            tile = np.int64(load_scalar(lists.order, k))
            left, top = (tile % across) * TILE_SIZE, (tile // across) * TILE_SIZE
            begin, stop = np.int64(load_scalar(lists.start, tile)), np.int64(load_scalar(lists.start, tile + 1))
            if begin == stop:
                continue
            fill(state, image, upstream, height, width, left, top, compositing.background)
            done = False
            for e in range(begin, stop):
                slot = np.int64(load_scalar(lists.slot, e)) * GRADIENT_SIZE
                if done or (
                    (e - begin) % tile_buffer.CHECK_INTERVAL == tile_buffer.CHECK_INTERVAL - 1
                    and tile_buffer.all_complete(state)
                ):
                    done = True
                    store(slots, slot, broadcast(ZERO))
                    store(slots, slot + GRADIENT_SIZE - WIDTH, broadcast(ZERO))
                    continue
                tile_buffer.prefetch_surfel(record, box, lists.surfel, e, stop)
                if e + tile_buffer.PREFETCH_DISTANCE < stop:
                    ahead = np.int64(load_scalar(lists.slot, e + tile_buffer.PREFETCH_DISTANCE)) * GRADIENT_SIZE
                    prefetch_to_write(slots, ahead)
                    prefetch_to_write(slots, ahead + GRADIENT_SIZE - 1)
                i = np.int64(load_scalar(lists.surfel, e))
                x0, x1, y0, y1 = tile_buffer.block_range(box, i, left, top)
                offset_x, offset_y = tile_buffer.block_offset(record, box, i, left + x0, top + y0)
                surfel = tile_buffer.broadcast_record(record, i)
                zero = broadcast(ZERO)
                gx = gy = gz = gxx = gxy = gyx = gyy = gzx = gzy = zero
                mx = my = g_alpha = g_red = g_green = g_blue = g_depth = g_nx = g_ny = g_nz = zero
                for y in range(y0, y1, 4):
                    dy = block_rows() + (offset_y + np.float32(y - y0))
                    low_y = dy + surfel.lowpass_y
                    u1_dy, u0_dy, zz_row, low = (
                        surfel.u1 * dy,
                        surfel.u0 * dy,
                        surfel.det + surfel.b3 * dy,
                        low_y * low_y,
                    )
                    for x in range(x0, x1, 4):
                        dx = block_columns() + (offset_x + np.float32(x - x0))
                        iz = ONE / (zz_row + surfel.a3 * dx)
                        s, t = (surfel.v1 * dx - u1_dy) * iz, (u0_dy - surfel.v0 * dx) * iz
                        low_x = dx + surfel.lowpass_x
                        g3, g2 = s * s + t * t, (low_x * low_x + low) * TWO
                        intersects = g3 < g2
                        exponent = surfel.log2_opacity - select(intersects, g3, g2) * HALF_LOG2E
                        valid = exponent >= LOG2_ALPHA_THRESHOLD
                        uncapped = exp2(maximum(exponent, broadcast(tile_buffer.MIN_EXPONENT)))
                        cap = broadcast(compositing.alpha_cap)
                        alpha = minimum(uncapped, cap)
                        at = y * STRIDE + 4 * x
                        before = load(state, at)
                        w = before * alpha
                        after = before - w
                        continues = valid & (after > MIN_TRANSMITTANCE)
                        w = select(continues, w, zero)
                        complete = select(valid, zero - absolute(before), before)
                        store(state, at, select(continues, after, complete))
                        v_red, v_green = load(state, at + RED), load(state, at + GREEN)
                        v_blue = load(state, at + BLUE)
                        q = load(state, at + ALPHA) + v_red * surfel.red + v_green * surfel.green
                        q = q + v_blue * surfel.blue
                        g_red += w * v_red
                        g_green += w * v_green
                        g_blue += w * v_blue
                        if geometry:
                            v_depth = load(state, at + DEPTH)
                            v_nx, v_ny = (
                                load(state, at + NORMAL_X),
                                load(state, at + NORMAL_Y),
                            )
                            v_nz = load(state, at + NORMAL_Z)
                            q = q + v_depth * surfel.depth + v_nx * surfel.normal_x + v_ny * surfel.normal_y
                            q = q + v_nz * surfel.normal_z
                            g_nx += w * v_nx
                            g_ny += w * v_ny
                            g_nz += w * v_nz
                            v_spread = load(state, at + DISTORTION) * TWO
                            front = load(state, at + DEPTH_IN_FRONT)
                            total_alpha = load(state, at + TOTAL_ALPHA)
                            in_front = ONE - before
                            change = (surfel.depth * in_front - front) * TWO - surfel.depth * total_alpha
                            q += v_spread * (change + load(state, at + TOTAL_DEPTH))
                            g_depth += w * (v_depth + v_spread * (in_front * TWO + w - total_alpha))
                            store(state, at + DEPTH_IN_FRONT, front + w * surfel.depth)
                        behind = load(state, at + REMAINDER) - w * q
                        store(state, at + REMAINDER, behind)
                        g = alpha * (before * q - behind / (ONE - alpha))
                        g = select(continues & (uncapped <= cap), g, zero)
                        g_alpha += g
                        c = g * iz
                        zx, zy = select(intersects, c * s, zero), select(intersects, c * t, zero)
                        zz = select(intersects, c * g3, zero)
                        gx -= zx
                        gy -= zy
                        gz += zz
                        gxx -= zx * dx
                        gxy -= zx * dy
                        gyx -= zy * dx
                        gyy -= zy * dy
                        gzx += zz * dx
                        gzy += zz * dy
                        lowpass = select(intersects, zero, g) * TWO
                        mx -= lowpass * low_x
                        my -= lowpass * low_y
                # In the order of the columns of a gradient slot.
                sums = reduce_add(
                    gx, gy, gz, gxx, gxy, gyx, gyy, gzx, gzy, mx, my, g_alpha, g_red, g_green, g_blue, g_depth
                )
                # The last four columns first. No store exceeds the slot: its neighbours belong to other workers.
                store(slots, slot + GRADIENT_SIZE - WIDTH, zero)
                store(slots, slot, sums)
                if geometry:
                    store_scalar(slots, slot + GRADIENT_COLUMN.normal_x, total(g_nx))
                    store_scalar(slots, slot + GRADIENT_COLUMN.normal_y, total(g_ny))
                    store_scalar(slots, slot + GRADIENT_COLUMN.normal_z, total(g_nz))

    return differentiate_tiles


_differentiate_tiles_colour, _differentiate_tiles_geometry = _tile_worker(geometry=False), _tile_worker(geometry=True)


# As in `forward_simd`: Numba's cache does not recognize closures over compiled functions.
@kernel
def _backward_colour(workers, *arguments):
    parallel_for(_differentiate_tiles_colour, workers, arguments)


@kernel
def _backward_geometry(workers, *arguments):
    parallel_for(_differentiate_tiles_geometry, workers, arguments)


def composite_backward(
    projected: ProjectedSurfels,
    lists: TileLists,
    compositing: Compositing,
    image: Float32[np.ndarray, "planes h w"],
    upstream: Float32[np.ndarray, "upstream_planes h w"],
    geometry: bool,
    workers: int,
) -> Float32[np.ndarray, "pairs 20"]:
    """Gradient of `forward_simd.composite`: as `backward.composite_backward`, to rounding.

    Args:
        projected: Records and pixel boxes.
        lists: Depth-sorted surfels of every tile.
        compositing: Image size and constants.
        image: Planes that `composite` returned.
        upstream: Gradients of the loss with respect to those planes, the first one with respect to alpha = 1 - T; or
            with respect to the colours alone (3 planes).
        geometry: Whether `upstream` has planes for depth, normal and distortion.
        workers: Number of threads; the result does not depend on it.

    Returns:
        Gradient slots: sums over the pixels of each (surfel, tile) pair, see `records`.
    """
    size = lists.surfel.size * GRADIENT_SIZE
    slots = np.empty(size + WIDTH, np.float32)
    run = _backward_geometry if geometry else _backward_colour
    run(
        workers, projected.flattened(), lists, compositing, image.reshape(-1), upstream.reshape(-1), slots,
        np.zeros(1, np.int64),
    )  # fmt: skip
    return slots[:size].reshape(-1, GRADIENT_SIZE)
