"""The gradient of the compositing as in `backward`, sixteen pixels at a time (see `forward_simd` for the buffer).

A surfel's sums over the pixels of a tile stay in registers until all of its blocks are done, and are then reduced
together.
"""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import (
    align_stack,
    atomic_add,
    load,
    load_block,
    load_scalar,
    prefetch_to_write,
    store,
    store_scalar,
)
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
from carigs.splat.rasterizer.binning import TILE
from carigs.splat.rasterizer.forward import END, HALF_LOG2E, LOG_THRESHOLD, ONE, TWO, ZERO
from carigs.splat.rasterizer.forward_simd import (
    AHEAD,
    CHECK,
    FAINTEST,
    PLANE,
    STRIDE,
    all_ended,
    blocks,
    clear,
    fetch_ahead,
    fetch_tile,
    open_pixels,
)
from carigs.splat.rasterizer.projection import RECORD, SLOT

# Planes of the buffer: T, Q, upstream gradients of alpha, colour and (geometry) depth, normal, distortion; then the
# sums of w Z in front, of w, and of w Z.
REST, ALPHA, RED, DEPTH, NORMAL, DISTORTION, FRONT, WHOLE_ALPHA, WHOLE_DEPTH = 1, 2, 3, 6, 7, 10, 11, 12, 13


@simd_inline
def read_plane(state, base, image, offset, width, across, down):
    """A plane of the image to the buffer; zero outside the image."""
    for y in range(0, TILE, 4):
        for x in range(0, TILE, 4):
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
def multiply_add(state, to, a, b):
    """Plane `to` += plane a * plane b."""
    for at in range(0, PLANE, WIDTH):
        product = load(state, a * PLANE + at) * load(state, b * PLANE + at)
        store(state, to * PLANE + at, load(state, to * PLANE + at) + product)


@simd_inline
def subtract(state, plane, number, sign):
    """The plane less a number, or the number less the plane (`sign` -1)."""
    for at in range(plane * PLANE, (plane + 1) * PLANE, WIDTH):
        store(state, at, (load(state, at) - number) * sign)


@simd_inline
def copy_plane(state, to, a):
    """Plane `to` = plane a."""
    for at in range(0, PLANE, WIDTH):
        store(state, to * PLANE + at, load(state, a * PLANE + at))


def _work(geometry: bool):
    buffers = WHOLE_DEPTH + 1 if geometry else DEPTH + 1  # without geometry DEPTH serves as scratch

    @simd_inline
    def fill(state, image, upstream, height, width, left, top, background):
        """Upstream gradients, T = 1 and Q = sum of upstream times output, the distortion's twice."""
        across, down = min(TILE, width - left), min(TILE, height - top)
        pixel, size = top * width + left, width * height
        fetch_tile(image, pixel, width, height, down)
        fetch_tile(upstream, pixel, width, height, down)
        clear(state, 0, buffers * PLANE)
        scratch = FRONT if geometry else DEPTH
        first = 1 if upstream.size == 3 * size else 0  # plane of the image whose gradient comes first
        for plane in range(first, first + upstream.size // size):  # a number that LLVM does not unroll
            read_plane(state, (ALPHA + plane) * PLANE, upstream, (plane - first) * size + pixel, width, across, down)
            read_plane(state, scratch * PLANE, image, plane * size + pixel, width, across, down)
            if plane == 0:
                # The image holds T, upstream is that of alpha.
                subtract(state, scratch, ONE, -ONE)
            elif plane < DEPTH - ALPHA:
                subtract(state, scratch, background, ONE)
            multiply_add(state, REST, ALPHA + plane, scratch)
            if geometry:
                if plane == 0:
                    copy_plane(state, WHOLE_ALPHA, scratch)
                if plane == DEPTH - ALPHA:
                    copy_plane(state, WHOLE_DEPTH, scratch)
                if plane == DISTORTION - ALPHA:
                    multiply_add(state, REST, DISTORTION, scratch)
        clear(state, scratch * PLANE, (scratch + 1) * PLANE)
        open_pixels(state, width - left, height - top)

    @simd_inline_alloc
    def work(
        _worker, record, box, surfel, slot, start, order, image, upstream, slots, width, height, cap, background,
        counter,
    ):  # fmt: skip
        align_stack()
        across = -(-width // TILE)
        state = np.empty(buffers * PLANE + WIDTH, np.float32)
        while True:
            k = atomic_add(counter, 0)
            if k >= order.size:
                break
            t = np.int64(load_scalar(order, k))
            left, top = (t % across) * TILE, (t // across) * TILE
            begin, stop = np.int64(load_scalar(start, t)), np.int64(load_scalar(start, t + 1))
            if begin == stop:
                continue
            fill(state, image, upstream, height, width, left, top, background)
            done = False
            for e in range(begin, stop):
                to = np.int64(load_scalar(slot, e)) * SLOT
                if done or ((e - begin) % CHECK == CHECK - 1 and all_ended(state)):
                    done = True
                    store(slots, to, broadcast(ZERO))
                    store(slots, to + SLOT - WIDTH, broadcast(ZERO))
                    continue
                fetch_ahead(record, box, surfel, e, stop)
                if e + AHEAD < stop:
                    later = np.int64(load_scalar(slot, e + AHEAD)) * SLOT
                    prefetch_to_write(slots, later)
                    prefetch_to_write(slots, later + SLOT - 1)
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
                none = broadcast(ZERO)
                gx = gy = gz = gxx = gxy = gyx = gyy = gzx = gzy = none
                mx = my = g_alpha = g_red = g_green = g_blue = g_depth = g_nx = g_ny = g_nz = none
                for y in range(y0, y1, 4):
                    dy = block_rows() + (offset_y + np.float32(y - y0))
                    low_y = dy + ey
                    u1_dy, u0_dy, plane, low = u1 * dy, u0 * dy, det + b3 * dy, low_y * low_y
                    for x in range(x0, x1, 4):
                        dx = block_columns() + (offset_x + np.float32(x - x0))
                        iz = ONE / (plane + a3 * dx)
                        s, u = (v1 * dx - u1_dy) * iz, (u0_dy - v0 * dx) * iz
                        low_x = dx + ex
                        g3, g2 = s * s + u * u, (low_x * low_x + low) * TWO
                        hit = g3 < g2
                        exponent = opacity - select(hit, g3, g2) * HALF_LOG2E
                        valid = exponent >= LOG_THRESHOLD
                        raw = exp2(maximum(exponent, broadcast(FAINTEST)))
                        alpha = minimum(raw, broadcast(cap))
                        at = y * STRIDE + 4 * x
                        before = load(state, at)
                        w = before * alpha
                        after = before - w
                        goes_on = valid & (after > END)
                        w = select(goes_on, w, none)
                        ended = select(valid, none - absolute(before), before)
                        store(state, at, select(goes_on, after, ended))
                        v_red, v_green = load(state, at + RED * PLANE), load(state, at + (RED + 1) * PLANE)
                        v_blue = load(state, at + (RED + 2) * PLANE)
                        q = load(state, at + ALPHA * PLANE) + v_red * red + v_green * green + v_blue * blue
                        g_red += w * v_red
                        g_green += w * v_green
                        g_blue += w * v_blue
                        if geometry:
                            v_depth = load(state, at + DEPTH * PLANE)
                            v_nx, v_ny = load(state, at + NORMAL * PLANE), load(state, at + (NORMAL + 1) * PLANE)
                            v_nz = load(state, at + (NORMAL + 2) * PLANE)
                            q = q + v_depth * depth + v_nx * nx + v_ny * ny + v_nz * nz
                            g_nx += w * v_nx
                            g_ny += w * v_ny
                            g_nz += w * v_nz
                            v_spread = load(state, at + DISTORTION * PLANE) * TWO
                            front = load(state, at + FRONT * PLANE)
                            whole = load(state, at + WHOLE_ALPHA * PLANE)
                            in_front = ONE - before
                            change = (depth * in_front - front) * TWO - depth * whole
                            q += v_spread * (change + load(state, at + WHOLE_DEPTH * PLANE))
                            g_depth += w * (v_depth + v_spread * (in_front * TWO + w - whole))
                            store(state, at + FRONT * PLANE, front + w * depth)
                        behind = load(state, at + REST * PLANE) - w * q
                        store(state, at + REST * PLANE, behind)
                        g = alpha * (before * q - behind / (ONE - alpha))
                        g = select(goes_on & (raw <= cap), g, none)
                        g_alpha += g
                        c = g * iz
                        zx, zy = select(hit, c * s, none), select(hit, c * u, none)
                        zz = select(hit, c * g3, none)
                        gx -= zx
                        gy -= zy
                        gz += zz
                        gxx -= zx * dx
                        gxy -= zx * dy
                        gyx -= zy * dx
                        gyy -= zy * dy
                        gzx += zz * dx
                        gzy += zz * dy
                        far = select(hit, none, g) * TWO
                        mx -= far * low_x
                        my -= far * low_y
                sums = reduce_add(
                    gx, gy, gz, gxx, gxy, gyx, gyy, gzx, gzy, mx, my, g_alpha, g_red, g_green, g_blue, g_depth
                )
                # The last four first: this store ends with the slot, whose neighbours belong to other workers.
                store(slots, to + SLOT - WIDTH, none)
                store(slots, to, sums)
                if geometry:
                    store_scalar(slots, to + 16, total(g_nx))
                    store_scalar(slots, to + 17, total(g_ny))
                    store_scalar(slots, to + 18, total(g_nz))

    return work


_work_colour, _work_all = _work(geometry=False), _work(geometry=True)


# As in `forward_simd`: no closures, so that the cache knows them again.
@kernel
def _backward_colour(workers, *arguments):
    parallel_for(_work_colour, workers, arguments)


@kernel
def _backward_all(workers, *arguments):
    parallel_for(_work_all, workers, arguments)


def composite_backward(
    record, box, surfel, slot, start, order, image, upstream, width, height, cap, geometry, background, workers
):
    """As `backward.composite_backward`, to rounding."""
    slots = np.empty(surfel.size * SLOT + WIDTH, np.float32)
    pulled_back = _backward_all if geometry else _backward_colour
    pulled_back(
        workers, record.reshape(-1), box.reshape(-1), surfel, slot, start, order, image.reshape(-1),
        upstream.reshape(-1), slots, width, height, np.float32(cap), np.float32(background), np.zeros(1, np.int64),
    )  # fmt: skip
    return slots[: surfel.size * SLOT].reshape(-1, SLOT)
