"""Depth-sorted lists of surfels per tile: one radix sort of the surfels, then a counting scatter, both parallel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import load_scalar, prefetch
from carigs.simd.vectors import scalar_or_simd, simd_inline_alloc

TILE = 32  # pixels along a tile's side
DIGITS = 1 << 12  # of the radix sort
AHEAD = 16  # surfels by which boxes are fetched before they are needed


class TileLists(NamedTuple):
    """Which surfels touch which tile, front to back, and where each pair keeps its gradient."""

    surfel: Int32[np.ndarray, "pairs"]
    """Surfels, tile after tile, by depth of the centre within a tile; equal depths in surfel order."""
    slot: Int32[np.ndarray, "pairs"]
    """Gradient slot of each entry: numbered surfel by surfel, so that a surfel's slots lie together."""
    start: Int32[np.ndarray, "tiles+1"]
    """Range of each tile's entries."""
    first_slot: Int32[np.ndarray, "surfels+1"]
    """Range of each surfel's slots."""
    order: Int32[np.ndarray, "tiles"]
    """Tiles by number of entries, longest first: the order of work."""


# Every worker has an equal part of the surfels (of the sorted ones in `_scatter`): it counts, and once all counts are
# summed it knows where its own results go.  The lists do not depend on the number of workers.


@scalar_or_simd
def _part(worker, workers, count):
    size = (count + workers - 1) // workers
    return min(worker * size, count), min((worker + 1) * size, count)


@simd_inline_alloc
def _starts(counts):
    """Counts (workers, bins) become the places of each worker's first element of each bin; also returns the bins'."""
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


@scalar_or_simd
def _count_visible(w, tiles, pairs, seen):
    begin, stop = _part(w, len(seen), tiles.size)
    all_pairs, visible = 0, 0
    for i in range(begin, stop):
        all_pairs += tiles[i]
        visible += tiles[i] > 0
    pairs[w, 0], seen[w, 0] = all_pairs, visible


@scalar_or_simd
def _list_visible(w, depth_bits, tiles, pairs, seen, first_slot, key, surfel):
    begin, stop = _part(w, len(seen), tiles.size)
    slot, k = pairs[w, 0], seen[w, 0]
    for i in range(begin, stop):
        first_slot[i] = slot
        slot += tiles[i]
        if tiles[i] > 0:
            key[k], surfel[k] = depth_bits[i], i
            k += 1


@kernel
def _visible(depth_bits, tiles, workers):
    """Keys and numbers of the visible surfels, and every surfel's first slot."""
    n = tiles.size
    first_slot = np.empty(n + 1, np.int32)
    pairs, seen = np.empty((workers, 1), np.int32), np.empty((workers, 1), np.int32)
    parallel_for(_count_visible, workers, (tiles, pairs, seen))
    first_slot[n] = _starts(pairs)[1]
    count = _starts(seen)[1]
    key, surfel = np.empty(count, np.uint32), np.empty(count, np.int32)
    parallel_for(_list_visible, workers, (depth_bits, tiles, pairs, seen, first_slot, key, surfel))
    return key, surfel, first_slot


@scalar_or_simd
def _digit(key, low, shift):
    return ((key - low) >> np.uint32(shift)) & np.uint32(DIGITS - 1)


@scalar_or_simd
def _count_digits(w, key, low, shift, places):
    begin, stop = _part(w, len(places), key.size)
    for d in range(DIGITS):
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
    """Stable radix sort of surfels by unsigned keys, 12 bits at a time; only as many as their range has."""
    other_key, other = np.empty_like(key), np.empty_like(surfel)
    places = np.empty((workers, DIGITS), np.int32)
    low, high = key[0], key[0]
    for k in key:
        low, high = min(low, k), max(high, k)
    shift = 0
    while shift < 32 and (high - low) >> np.uint32(shift) > 0:
        parallel_for(_count_digits, workers, (key, low, shift, places))
        _starts(places)
        parallel_for(_move_by_digit, workers, (key, surfel, low, shift, places, other_key, other))
        key, other_key = other_key, key
        surfel, other = other, surfel
        shift += 12
    return surfel


@scalar_or_simd
def _tiles_of(box, at):
    """Ranges of the columns and rows of tiles that a box touches."""
    # A constant: division by an argument would take half of the time of `_scatter`.
    return (
        np.int64(load_scalar(box, at)) // TILE, (np.int64(load_scalar(box, at + 1)) - 1) // TILE + 1,
        np.int64(load_scalar(box, at + 2)) // TILE, (np.int64(load_scalar(box, at + 3)) - 1) // TILE + 1,
    )  # fmt: skip


@scalar_or_simd
def _count_entries(w, surfel, box, across, places):
    begin, stop = _part(w, len(places), surfel.size)
    for t in range(places.shape[1]):
        places[w, t] = 0
    for k in range(begin, stop):
        if k + AHEAD < stop:
            prefetch(box, 4 * np.int64(surfel[k + AHEAD]))
        left, right, top, bottom = _tiles_of(box, 4 * np.int64(surfel[k]))
        for ty in range(top, bottom):
            for tx in range(left, right):
                places[w, ty * across + tx] += 1


@scalar_or_simd
def _enter(w, surfel, box, first_slot, across, places, entry, slot):
    begin, stop = _part(w, len(places), surfel.size)
    for k in range(begin, stop):
        i = surfel[k]
        if k + AHEAD < stop:
            later = np.int64(surfel[k + AHEAD])
            prefetch(box, 4 * later)
            prefetch(first_slot, later)
        s = first_slot[i]
        left, right, top, bottom = _tiles_of(box, 4 * np.int64(i))
        for ty in range(top, bottom):
            for tx in range(left, right):
                to = places[w, ty * across + tx]
                places[w, ty * across + tx] = to + 1
                entry[to], slot[to] = i, s
                s += 1


@kernel
def _scatter(surfel, box, first_slot, across, down, workers):
    """Append each surfel, front to back, to the tiles that its box touches."""
    places = np.empty((workers, across * down), np.int32)
    parallel_for(_count_entries, workers, (surfel, box, across, places))
    start = _starts(places)
    entry, slot = np.empty(first_slot[-1], np.int32), np.empty(first_slot[-1], np.int32)
    parallel_for(_enter, workers, (surfel, box, first_slot, across, places, entry, slot))
    return entry, slot, start


def tile_lists(
    depth: Float32[np.ndarray, "n"],
    box: Int32[np.ndarray, "n 4"],
    tiles: Int32[np.ndarray, "n"],
    width: int,
    height: int,
    workers: int = 1,
) -> TileLists:
    """Sort the visible surfels (tiles > 0) by depth and append each to the tiles that its pixel box touches."""
    # Positive floats sort as their bit patterns.
    bits = np.ascontiguousarray(depth, np.float32).view(np.uint32)
    across, down = -(-width // TILE), -(-height // TILE)
    key, surfel, first_slot = _visible(bits, tiles, workers)
    if len(surfel):
        surfel = _sort_by_key(key, surfel, workers)
    entry, slot, start = _scatter(surfel, box.reshape(-1), first_slot, across, down, workers)
    order = np.argsort(-np.diff(start), kind="stable").astype(np.int32)
    return TileLists(entry, slot, start, first_slot, order)
