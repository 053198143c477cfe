"""Depth-sorted lists of surfels per tile: a parallel radix sort by depth, then a parallel counting sort by tile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import load_scalar, prefetch
from carigs.simd.vectors import scalar_or_simd, simd_inline_alloc

TILE_SIZE = 32
"""Pixels along a tile's side."""
NUM_DIGITS = 1 << 12  # of the radix sort
PREFETCH_DISTANCE = 16  # surfels by which boxes are fetched before they are needed


class TileLists(NamedTuple):
    """Surfels of every tile, front to back, and the gradient slot of each (surfel, tile) pair."""

    surfel: Int32[np.ndarray, " pairs"]
    """Surfels of the pairs, ordered by tile, then by depth of the centre, then by surfel."""
    slot: Int32[np.ndarray, " pairs"]
    """Gradient slot of each pair. Slots are numbered surfel by surfel: those of one surfel are contiguous."""
    start: Int32[np.ndarray, " tiles+1"]
    """Range of each tile's pairs."""
    first_slot: Int32[np.ndarray, " surfels+1"]
    """Range of each surfel's slots."""
    order: Int32[np.ndarray, " tiles"]
    """Tiles by number of pairs, most first: the order in which workers take them."""


# Parallel counting sort: every worker counts within an equal part of the surfels (in `_scatter`, of the sorted ones).
# The prefix sums of all counts give each worker the positions of its results. The lists do not depend on the number of
# workers.


@scalar_or_simd
def _part(worker, workers, count):
    size = (count + workers - 1) // workers
    return min(worker * size, count), min((worker + 1) * size, count)


@simd_inline_alloc
def _prefix_sum(counts):
    """Replace counts (workers, bins) by each worker's first position in each bin; return the bins' starts."""
    workers, bins = counts.shape
    start = np.empty(bins + 1, np.int32)
    total = 0
    for b in range(bins):
        start[b] = total
        for w in range(workers):
            n = counts[w, b]
            counts[w, b] = total
            total += n
    start[bins] = total
    return start


@kernel
def _visible_surfels(depth_bits, num_tiles):
    """Sort keys and indices of the visible surfels, and every surfel's first slot."""
    n = num_tiles.size
    first_slot, key, surfel = np.empty(n + 1, np.int32), np.empty(n, np.uint32), np.empty(n, np.int32)
    slot, count = 0, 0
    for i in range(n):
        first_slot[i] = slot
        slot += num_tiles[i]
        if num_tiles[i] > 0:
            key[count], surfel[count] = depth_bits[i], i
            count += 1
    first_slot[n] = slot
    return key[:count], surfel[:count], first_slot


@scalar_or_simd
def _digit(key, low, shift):
    return ((key - low) >> np.uint32(shift)) & np.uint32(NUM_DIGITS - 1)


@scalar_or_simd
def _count_digits(w, key, low, shift, places):
    begin, stop = _part(w, len(places), key.size)
    for d in range(NUM_DIGITS):
        places[w, d] = 0
    for i in range(begin, stop):
        places[w, _digit(key[i], low, shift)] += 1


@scalar_or_simd
def _move_by_digit(w, key, surfel, low, shift, places, other_key, other):
    begin, stop = _part(w, len(places), key.size)
    for i in range(begin, stop):
        digit = _digit(key[i], low, shift)
        to = places[w, digit]
        places[w, digit] = to + 1
        other_key[to], other[to] = key[i], surfel[i]


@kernel
def _sort_by_key(key, surfel, workers):
    """Stable radix sort of surfels by unsigned keys, 12 bits per pass, for as many bits as the range of keys has."""
    other_key, other = np.empty_like(key), np.empty_like(surfel)
    places = np.empty((workers, NUM_DIGITS), np.int32)
    low, high = key[0], key[0]
    for k in key:
        low, high = min(low, k), max(high, k)
    shift = 0
    while shift < 32 and (high - low) >> np.uint32(shift) > 0:
        parallel_for(_count_digits, workers, (key, low, shift, places))
        _prefix_sum(places)
        parallel_for(_move_by_digit, workers, (key, surfel, low, shift, places, other_key, other))
        key, other_key = other_key, key
        surfel, other = other, surfel
        shift += 12
    return surfel


@scalar_or_simd
def _tile_range(box, at):
    """Half-open ranges of the columns and rows of tiles that a box overlaps."""
    # TILE_SIZE is a constant: division by an argument would take half of the time of `_scatter`.
    return (
        np.int64(load_scalar(box, at)) // TILE_SIZE, (np.int64(load_scalar(box, at + 1)) - 1) // TILE_SIZE + 1,
        np.int64(load_scalar(box, at + 2)) // TILE_SIZE, (np.int64(load_scalar(box, at + 3)) - 1) // TILE_SIZE + 1,
    )  # fmt: skip


@scalar_or_simd
def _count_pairs(w, surfel, box, across, places):
    begin, stop = _part(w, len(places), surfel.size)
    for t in range(places.shape[1]):
        places[w, t] = 0
    for k in range(begin, stop):
        if k + PREFETCH_DISTANCE < stop:
            prefetch(box, 4 * np.int64(surfel[k + PREFETCH_DISTANCE]))
        left, right, top, bottom = _tile_range(box, 4 * np.int64(surfel[k]))
        for ty in range(top, bottom):
            for tx in range(left, right):
                places[w, ty * across + tx] += 1


@scalar_or_simd
def _write_pairs(w, surfel, box, first_slot, across, places, pair_surfel, slot):
    begin, stop = _part(w, len(places), surfel.size)
    for k in range(begin, stop):
        i = surfel[k]
        if k + PREFETCH_DISTANCE < stop:
            ahead = np.int64(surfel[k + PREFETCH_DISTANCE])
            prefetch(box, 4 * ahead)
            prefetch(first_slot, ahead)
        s = first_slot[i]
        left, right, top, bottom = _tile_range(box, 4 * np.int64(i))
        for ty in range(top, bottom):
            for tx in range(left, right):
                to = places[w, ty * across + tx]
                places[w, ty * across + tx] = to + 1
                pair_surfel[to], slot[to] = i, s
                s += 1


@kernel
def _scatter(surfel, box, first_slot, across, down, workers):
    """Append each surfel, front to back, to the lists of the tiles that its box overlaps."""
    places = np.empty((workers, across * down), np.int32)
    parallel_for(_count_pairs, workers, (surfel, box, across, places))
    start = _prefix_sum(places)
    pair_surfel, slot = np.empty(first_slot[-1], np.int32), np.empty(first_slot[-1], np.int32)
    parallel_for(_write_pairs, workers, (surfel, box, first_slot, across, places, pair_surfel, slot))
    return pair_surfel, slot, start


def tile_lists(
    depth: Float32[np.ndarray, " n"],
    box: Int32[np.ndarray, "n 4"],
    num_tiles: Int32[np.ndarray, " n"],
    width: int,
    height: int,
    workers: int = 1,
) -> TileLists:
    """Depth-sorted lists of the surfels whose pixel box overlaps each tile.

    Args:
        depth: Depth of the centres in metres; positive where `num_tiles` is.
        box: Pixel boxes [x0, x1, y0, y1).
        num_tiles: Tiles that each box overlaps; 0 for culled surfels.
        width: Image width in pixels.
        height: Image height in pixels.
        workers: Number of threads; the result does not depend on it.

    Returns:
        Lists of all tiles, row by row.
    """
    # The bit patterns of positive floats have the order of the floats.
    bits = np.ascontiguousarray(depth, np.float32).view(np.uint32)
    across, down = -(-width // TILE_SIZE), -(-height // TILE_SIZE)
    key, surfel, first_slot = _visible_surfels(bits, num_tiles)
    if len(surfel):
        surfel = _sort_by_key(key, surfel, workers)
    pair_surfel, slot, start = _scatter(surfel, box.reshape(-1), first_slot, across, down, workers)
    order = np.argsort(-np.diff(start), kind="stable").astype(np.int32)
    return TileLists(pair_surfel, slot, start, first_slot, order)
