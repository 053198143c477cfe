"""Projection as in `projection`, sixteen surfels at a time: loads, stores and sums of slots around its formulas."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int32

from carigs.simd.kernels import kernel
from carigs.simd.memory import align_stack, flattened, load, store
from carigs.simd.records import load3, load_records, store2, store3, store4, store_records
from carigs.simd.tuples import componentwise, subtract
from carigs.simd.vector_loops import parallel_for_vectors
from carigs.simd.vector_math import absolute, demote, promote_lower, promote_upper, select, to_int
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rasterizer import records
from carigs.splat.rasterizer.projection import surfel_gradients, surfel_record

SECOND_VECTOR = records.RECORD_SIZE - WIDTH  # first column of the second vector of a gradient slot
_lower, _upper, _demote = componentwise(promote_lower), componentwise(promote_upper), componentwise(demote)
_select, _to_int = componentwise(select), componentwise(to_int)
_load_slots, _store_surfel_records = load_records(records.GRADIENT_SIZE), store_records(records.RECORD_SIZE)


@simd_inline
def _project(i, surfels, camera, background, projected):
    """Project surfels i to i + 15."""
    align_stack()
    m, u = load3(surfels.centre, 3 * i), load3(surfels.tangent_u, 3 * i)
    v, opacity, rgb = load3(surfels.tangent_v, 3 * i), load(surfels.opacity, i), load3(surfels.colour, 3 * i)
    magnitude = absolute(rgb[0]) + absolute(rgb[1]) + absolute(rgb[2])
    box_a, tiles_a, record_a = surfel_record(
        _lower(m), _lower(u), _lower(v), promote_lower(opacity), promote_lower(magnitude), camera
    )
    box_b, tiles_b, record_b = surfel_record(
        _upper(m), _upper(u), _upper(v), promote_upper(opacity), promote_upper(magnitude), camera
    )
    store4(projected.box, 4 * i, _to_int(_demote(box_a, box_b)))
    store(projected.num_tiles, i, to_int(demote(tiles_a, tiles_b)))
    geometry = _demote(record_a, record_b)
    record = (*geometry[0:10], *subtract(rgb, background), *geometry[10:14])
    _store_surfel_records(projected.record, records.RECORD_SIZE * i, record)


@kernel
def _project_all(count, *arguments):
    parallel_for_vectors(_project, count, arguments)


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
    _project_all(n, flattened(surfels), camera, np.float32(background), flattened(projected))
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
    g = records.GradientSlot(*_load_slots(sums, 0))
    visible, zero = load(counts, 0) > 0.0, broadcast(np.float32(0))
    m, u = load3(surfels.centre, 3 * i), load3(surfels.tangent_u, 3 * i)
    v = load3(surfels.tangent_v, 3 * i)
    a = surfel_gradients(records.GradientSlot(*_lower(g)), _lower(m), _lower(u), _lower(v), camera)
    b = surfel_gradients(records.GradientSlot(*_upper(g)), _upper(m), _upper(u), _upper(v), camera)
    store3(gradients.centre, 3 * i, _select(visible, _demote(a[0], b[0]), zero))
    store3(gradients.tangent_u, 3 * i, _select(visible, _demote(a[1], b[1]), zero))
    store3(gradients.tangent_v, 3 * i, _select(visible, _demote(a[2], b[2]), zero))
    store2(gradients.projected_centre, 2 * i, _select(visible, _demote(a[3], b[3]), zero))
    store3(gradients.colour, 3 * i, (g.red, g.green, g.blue))
    store(gradients.opacity, i, select(visible, g.log_opacity / load(surfels.opacity, i), zero))


@simd_inline_alloc
def _sums_and_counts():
    return np.empty(WIDTH * records.GRADIENT_SIZE, np.float32), np.empty(WIDTH, np.float32)


@kernel
def _project_backward_all(count, *arguments):
    parallel_for_vectors(_project_backward, count, arguments, _sums_and_counts)


def project_surfels_backward(
    slots: Float32[np.ndarray, "pairs 17"],
    first_slot: Int32[np.ndarray, " offsets"],
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
    _project_backward_all(n, slots.reshape(-1), first_slot, flattened(surfels), camera, flattened(gradients))
    return gradients
