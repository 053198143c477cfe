"""Depth-sorted lists of surfels per tile: one radix sort of the surfels, then a counting scatter (Numba)."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from jaxtyping import Float32, Int32

from carigs.splat.simd_memory import prefetch

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


@numba.njit(cache=True)
def _sort_by_key(key, surfel):
    """Stable radix sort of surfels by unsigned keys, 12 bits at a time; only as many as their range has."""
    count = key.size
    other_key, other = np.empty_like(key), np.empty_like(surfel)
    low, high = key.min(), key.max()
    shift = 0
    while shift < 32 and (high - low) >> np.uint32(shift) > 0:
        begin = np.zeros(DIGITS, np.int32)
        for i in range(count):
            begin[((key[i] - low) >> np.uint32(shift)) & np.uint32(DIGITS - 1)] += 1
        total = 0
        for b in range(DIGITS):
            n = begin[b]
            begin[b] = total
            total += n
        for i in range(count):
            b = ((key[i] - low) >> np.uint32(shift)) & np.uint32(DIGITS - 1)
            to = begin[b]
            begin[b] = to + 1
            other_key[to] = key[i]
            other[to] = surfel[i]
        key, other_key = other_key, key
        surfel, other = other, surfel
        shift += 12
    return surfel


@numba.njit(cache=True)
def _scatter(depth_bits, box, tiles, tile, across, down):
    count = tiles.size
    first_slot = np.empty(count + 1, np.int32)
    start = np.zeros(across * down + 1, np.int32)
    visible = 0
    pairs = 0
    for i in range(count):
        first_slot[i] = pairs
        if tiles[i] > 0:
            visible += 1
            pairs += tiles[i]
            for ty in range(box[i, 2] // tile, (box[i, 3] - 1) // tile + 1):
                for tx in range(box[i, 0] // tile, (box[i, 1] - 1) // tile + 1):
                    start[ty * across + tx + 1] += 1
    first_slot[count] = pairs
    key, surfel = np.empty(visible, np.uint32), np.empty(visible, np.int32)
    k = 0
    for i in range(count):
        if tiles[i] > 0:
            key[k], surfel[k] = depth_bits[i], i
            k += 1
    if visible > 0:
        surfel = _sort_by_key(key, surfel)
    for t in range(across * down):
        start[t + 1] += start[t]
    cursor = start.copy()
    entry, slot = np.empty(pairs, np.int32), np.empty(pairs, np.int32)
    flat = box.reshape(-1)
    for k in range(visible):
        i = surfel[k]
        if k + AHEAD < visible:
            later = np.int64(surfel[k + AHEAD])
            prefetch(flat, 4 * later)
            prefetch(first_slot, later)
        s = first_slot[i]
        for ty in range(box[i, 2] // tile, (box[i, 3] - 1) // tile + 1):
            for tx in range(box[i, 0] // tile, (box[i, 1] - 1) // tile + 1):
                to = cursor[ty * across + tx]
                cursor[ty * across + tx] = to + 1
                entry[to] = i
                slot[to] = s
                s += 1
    return entry, slot, start, first_slot


def tile_lists(
    depth: Float32[np.ndarray, "n"],
    box: Int32[np.ndarray, "n 4"],
    tiles: Int32[np.ndarray, "n"],
    width: int,
    height: int,
) -> TileLists:
    """Sort the visible surfels (tiles > 0) by depth and append each to the tiles that its pixel box touches."""
    # Positive floats sort as their bit patterns.
    bits = np.ascontiguousarray(depth, np.float32).view(np.uint32)
    across, down = -(-width // TILE), -(-height // TILE)
    entry, slot, start, first_slot = _scatter(bits, box, tiles, TILE, across, down)
    order = np.argsort(-np.diff(start), kind="stable").astype(np.int32)
    return TileLists(entry, slot, start, first_slot, order)
