"""`projection` for sixteen surfels at a time: loads, stores and the sums of slots; the formulas are those of there."""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, load, load3, load_rows, store, store2, store3, store4, store_rows
from carigs.simd.vector_math import absolute, halves, joined, select, whole_bits
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer.projection import RECORD, SLOT, projected, pulled_back

PART = 1024  # surfels of one task


@simd_inline
def _halves3(x):
    a, b, c = halves(x[0]), halves(x[1]), halves(x[2])
    return (a[0], b[0], c[0]), (a[1], b[1], c[1])


@simd_inline
def _joined3(a, b):
    return joined(a[0], b[0]), joined(a[1], b[1]), joined(a[2], b[2])


@simd_inline
def _joined4(a, b):
    return joined(a[0], b[0]), joined(a[1], b[1]), joined(a[2], b[2]), joined(a[3], b[3])


@simd_inline
def _joined16(a, b):
    return (
        *_joined4(a[0:4], b[0:4]),
        *_joined4(a[4:8], b[4:8]),
        *_joined4(a[8:12], b[8:12]),
        *_joined4(a[12:16], b[12:16]),
    )


@simd_inline
def _project(
    i, centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height, tile, background,
    record, box, tiles,
):  # fmt: skip
    align_stack()
    m, u, v = _halves3(load3(centre, 3 * i)), _halves3(load3(tangent_u, 3 * i)), _halves3(load3(tangent_v, 3 * i))
    rgb, o = load3(colour, 3 * i), halves(load(opacity, i))
    paint = halves(absolute(rgb[0]) + absolute(rgb[1]) + absolute(rgb[2]))
    a = projected(m[0], u[0], v[0], o[0], paint[0], view, intrinsics, width, height, tile)
    b = projected(m[1], u[1], v[1], o[1], paint[1], view, intrinsics, width, height, tile)
    corners = _joined4(a[0], b[0])
    store4(box, 4 * i, (whole_bits(corners[0]), whole_bits(corners[1]), whole_bits(corners[2]), whole_bits(corners[3])))
    store(tiles, i, whole_bits(joined(a[1], b[1])))
    r = _joined16(a[2], b[2])
    rgb = (rgb[0] - background, rgb[1] - background, rgb[2] - background)
    # The last sixteen columns, then the first: the middle twice.
    last = (r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], rgb[0], rgb[1], rgb[2], r[12], r[13], r[14], r[15])
    store_rows(record, RECORD * i + 4, RECORD, (*last, broadcast(np.float32(0))))
    store_rows(record, RECORD * i, RECORD, (r[0], r[1], r[2], r[3], *last[0:12]))


@simd_inline
def _project_part(
    part, count, centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height, tile, background,
    record, box, tiles,
):  # fmt: skip
    for start in range(part * PART, min((part + 1) * PART, count), WIDTH):
        _project(
            min(start, count - WIDTH), centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height,
            tile, background, record, box, tiles,
        )  # fmt: skip


@kernel
def _project_all(count, *arguments):
    parallel_for(_project_part, (count + PART - 1) // PART, (count, *arguments))


def project(centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height, tile, background):
    """As `projection.project`, for sixteen surfels or more; records of surfels that are dropped are not defined."""
    n = len(opacity)
    record, box, tiles = np.empty((n, RECORD), np.float32), np.empty((n, 4), np.int32), np.empty(n, np.int32)
    surfels = (a.reshape(-1) for a in (centre, tangent_u, tangent_v, opacity, colour))
    _project_all(
        n, *surfels, view, intrinsics, float(width), float(height), float(tile), np.float32(background),
        record.reshape(-1), box.reshape(-1), tiles,
    )  # fmt: skip
    return record, box, tiles


@simd_inline
def _backward(
    i, slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics,
    d_centre, d_tangent_u, d_tangent_v, d_opacity, d_colour, d_pixel, sums, counts,
):  # fmt: skip
    align_stack()
    for r in range(WIDTH):
        start, stop = first_slot[i + r], first_slot[i + r + 1]
        counts[r] = stop - start
        first, last = broadcast(np.float32(0)), broadcast(np.float32(0))
        for slot in range(start, stop):
            first = first + load(slots, SLOT * slot)
            last = last + load(slots, SLOT * slot + SLOT - WIDTH)
        store(sums, SLOT * r, first)
        store(sums, SLOT * r + SLOT - WIDTH, last)
    g = load_rows(sums, 0, SLOT)
    normals = load_rows(sums, SLOT - WIDTH, SLOT)
    seen, none = load(counts, 0) > 0.0, broadcast(np.float32(0))
    moments, others = _halves19(g, normals)
    m, u, v = _halves3(load3(centre, 3 * i)), _halves3(load3(tangent_u, 3 * i)), _halves3(load3(tangent_v, 3 * i))
    a = pulled_back(moments, m[0], u[0], v[0], view, intrinsics)
    b = pulled_back(others, m[1], u[1], v[1], view, intrinsics)
    x, y, z = _joined3(a[0], b[0]), _joined3(a[1], b[1]), _joined3(a[2], b[2])
    store3(d_centre, 3 * i, (select(seen, x[0], none), select(seen, x[1], none), select(seen, x[2], none)))
    store3(d_tangent_u, 3 * i, (select(seen, y[0], none), select(seen, y[1], none), select(seen, y[2], none)))
    store3(d_tangent_v, 3 * i, (select(seen, z[0], none), select(seen, z[1], none), select(seen, z[2], none)))
    store2(d_pixel, 2 * i, (select(seen, joined(a[3][0], b[3][0]), none), select(seen, joined(a[3][1], b[3][1]), none)))
    store3(d_colour, 3 * i, g[12:15])
    store(d_opacity, i, select(seen, g[11] / load(opacity, i), none))


@simd_inline
def _halves19(g, normals):
    a = (
        *_halves3(g[0:3]), *_halves3(g[3:6]), *_halves3(g[6:9]), *_halves3(g[9:12]), *_halves3(g[12:15]),
        *_halves3((g[15], normals[12], normals[13])), *_halves3((normals[14], normals[14], normals[14])),
    )  # fmt: skip
    return (
        (*a[0], *a[2], *a[4], *a[6], *a[8], *a[10], *a[12]),
        (*a[1], *a[3], *a[5], *a[7], *a[9], *a[11], *a[13]),
    )


@simd_inline_alloc
def _backward_part(
    part, count, slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics,
    d_centre, d_tangent_u, d_tangent_v, d_opacity, d_colour, d_pixel,
):  # fmt: skip
    sums, counts = np.empty(WIDTH * SLOT, np.float32), np.empty(WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, count), WIDTH):
        _backward(
            min(start, count - WIDTH), slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics,
            d_centre, d_tangent_u, d_tangent_v, d_opacity, d_colour, d_pixel, sums, counts,
        )  # fmt: skip


@kernel
def _backward_all(count, *arguments):
    parallel_for(_backward_part, (count + PART - 1) // PART, (count, *arguments))


def project_backward(slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics):
    """As `projection.project_backward`, for sixteen surfels or more; the sums of slots are in float32."""
    n = len(opacity)
    gradients = [np.empty((n, k) if k else n, np.float32) for k in (3, 3, 3, 0, 3, 2)]
    surfels = (a.reshape(-1) for a in (centre, tangent_u, tangent_v, opacity))
    flat = (g.reshape(-1) for g in gradients)
    _backward_all(n, slots.reshape(-1), first_slot, *surfels, view, intrinsics, *flat)
    return gradients
