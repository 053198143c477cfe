"""Projection as in `projection`, sixteen surfels at a time: loads, stores and sums of slots around its formulas."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, load, load3, load_rows, store, store2, store3, store4, store_rows
from carigs.simd.vector_math import absolute, halves, joined, select, whole_bits
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer import records
from carigs.splat.rasterizer.projection import surfel_gradients, surfel_record

PART_SIZE = 1024  # surfels of one task
SECOND_VECTOR = records.RECORD_SIZE - WIDTH  # first column of the second vector of a record or a gradient slot


# Vectors of sixteen floats as two vectors of eight doubles, and back.


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
def _halves19(g):
    a, b, c, d = _halves3(g[0:3]), _halves3(g[3:6]), _halves3(g[6:9]), _halves3(g[9:12])
    e, f, last = _halves3(g[12:15]), _halves3(g[15:18]), halves(g[18])
    return (
        records.GradientSlot(*a[0], *b[0], *c[0], *d[0], *e[0], *f[0], last[0]),
        records.GradientSlot(*a[1], *b[1], *c[1], *d[1], *e[1], *f[1], last[1]),
    )


@simd_inline
def _select3(condition, a, b):
    return select(condition, a[0], b), select(condition, a[1], b), select(condition, a[2], b)


@simd_inline
def _project(i, surfels, camera, background, projected):
    """Project surfels i to i + 15."""
    align_stack()
    m, u = _halves3(load3(surfels.centre, 3 * i)), _halves3(load3(surfels.tangent_u, 3 * i))
    v, opacity = _halves3(load3(surfels.tangent_v, 3 * i)), halves(load(surfels.opacity, i))
    rgb = load3(surfels.colour, 3 * i)
    magnitude = halves(absolute(rgb[0]) + absolute(rgb[1]) + absolute(rgb[2]))
    box_a, tiles_a, record_a = surfel_record(m[0], u[0], v[0], opacity[0], magnitude[0], camera)
    box_b, tiles_b, record_b = surfel_record(m[1], u[1], v[1], opacity[1], magnitude[1], camera)
    box = _joined4(box_a, box_b)
    box = (whole_bits(box[0]), whole_bits(box[1]), whole_bits(box[2]), whole_bits(box[3]))
    store4(projected.box, 4 * i, box)
    store(projected.num_tiles, i, whole_bits(joined(tiles_a, tiles_b)))
    geometry = _joined16(record_a, record_b)
    rgb = (rgb[0] - background, rgb[1] - background, rgb[2] - background)
    record = (*geometry[0:12], *rgb, *geometry[12:16], broadcast(np.float32(0)))
    # Two overlapping vectors per record.
    start = records.RECORD_SIZE * i
    store_rows(projected.record, start + SECOND_VECTOR, records.RECORD_SIZE, record[4:20])
    store_rows(projected.record, start, records.RECORD_SIZE, record[0:16])


@simd_inline
def _project_part(part, count, surfels, camera, background, projected):
    for start in range(part * PART_SIZE, min((part + 1) * PART_SIZE, count), WIDTH):
        _project(min(start, count - WIDTH), surfels, camera, background, projected)


@kernel
def _project_all(count, *arguments):
    parallel_for(_project_part, (count + PART_SIZE - 1) // PART_SIZE, (count, *arguments))


def project_surfels(
    surfels: records.SurfelArrays, camera: records.Pinhole, background: float
) -> records.ProjectedSurfels:
    """Project surfels to records and pixel boxes: as `projection.project_surfels`, to rounding.

    Args:
        surfels: Sixteen surfels or more in world space.
        camera: records.Pinhole camera.
        background: Grey value; records hold colours relative to it.

    Returns:
        Records, boxes and numbers of tiles.
    """
    n = len(surfels.opacity)
    projected = records.ProjectedSurfels(
        np.empty((n, records.RECORD_SIZE), np.float32), np.empty((n, 4), np.int32), np.empty(n, np.int32)
    )
    _project_all(n, surfels.flattened(), camera, np.float32(background), projected.flattened())
    return projected


@simd_inline
def _project_backward(i, slots, first_slot, surfels, camera, gradients, sums, counts):
    """Gradients of surfels i to i + 15; `sums` and `counts` are scratch space."""
    align_stack()
    for r in range(WIDTH):
        start, stop = first_slot[i + r], first_slot[i + r + 1]
        counts[r] = stop - start
        first, second = broadcast(np.float32(0)), broadcast(np.float32(0))
        for slot in range(start, stop):
            first = first + load(slots, records.GRADIENT_SIZE * slot)
            second = second + load(slots, records.GRADIENT_SIZE * slot + SECOND_VECTOR)
        store(sums, records.GRADIENT_SIZE * r, first)
        store(sums, records.GRADIENT_SIZE * r + SECOND_VECTOR, second)
    first_columns = load_rows(sums, 0, records.GRADIENT_SIZE)
    last_columns = load_rows(sums, SECOND_VECTOR, records.GRADIENT_SIZE)
    g = records.GradientSlot(*first_columns, *last_columns[12:15])
    visible, zero = load(counts, 0) > 0.0, broadcast(np.float32(0))
    g_a, g_b = _halves19(g)
    m, u = _halves3(load3(surfels.centre, 3 * i)), _halves3(load3(surfels.tangent_u, 3 * i))
    v = _halves3(load3(surfels.tangent_v, 3 * i))
    centre_a, u_a, v_a, pixel_a = surfel_gradients(g_a, m[0], u[0], v[0], camera)
    centre_b, u_b, v_b, pixel_b = surfel_gradients(g_b, m[1], u[1], v[1], camera)
    store3(gradients.centre, 3 * i, _select3(visible, _joined3(centre_a, centre_b), zero))
    store3(gradients.tangent_u, 3 * i, _select3(visible, _joined3(u_a, u_b), zero))
    store3(gradients.tangent_v, 3 * i, _select3(visible, _joined3(v_a, v_b), zero))
    x, y = joined(pixel_a[0], pixel_b[0]), joined(pixel_a[1], pixel_b[1])
    store2(gradients.projected_centre, 2 * i, (select(visible, x, zero), select(visible, y, zero)))
    store3(gradients.colour, 3 * i, (g.red, g.green, g.blue))
    opacity = g.log_opacity / load(surfels.opacity, i)
    store(gradients.opacity, i, select(visible, opacity, zero))


@simd_inline_alloc
def _project_backward_part(part, count, slots, first_slot, surfels, camera, gradients):
    sums, counts = np.empty(WIDTH * records.GRADIENT_SIZE, np.float32), np.empty(WIDTH, np.float32)
    for start in range(part * PART_SIZE, min((part + 1) * PART_SIZE, count), WIDTH):
        _project_backward(
            min(start, count - WIDTH), slots, first_slot, surfels, camera, gradients, sums, counts
        )  # fmt: skip


@kernel
def _project_backward_all(count, *arguments):
    parallel_for(_project_backward_part, (count + PART_SIZE - 1) // PART_SIZE, (count, *arguments))


def project_surfels_backward(
    slots: Float32[np.ndarray, "pairs 20"],
    first_slot: Int32[np.ndarray, "offsets"],
    surfels: records.SurfelArrays,
    camera: records.Pinhole,
) -> records.SurfelGradients:
    """Gradient of `project_surfels`: as `projection.project_surfels_backward`, with sums of slots in float32.

    Args:
        slots: Gradient slots of all (surfel, tile) pairs, see `records`.
        first_slot: Range of each surfel's slots.
        surfels: Sixteen surfels or more in world space.
        camera: records.Pinhole camera.

    Returns:
        Gradients with respect to the surfels and their projected centres.
    """
    n = len(surfels.opacity)
    gradients = records.SurfelGradients(*(np.empty((n, k) if k else n, np.float32) for k in (3, 3, 3, 0, 3, 2)))
    flat = records.SurfelGradients(*(array.reshape(-1) for array in gradients))
    _project_backward_all(n, slots.reshape(-1), first_slot, surfels.flattened(), camera, flat)
    return gradients
