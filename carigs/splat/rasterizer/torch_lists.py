"""Depth-sorted lists of surfels per tile in plain PyTorch, on any device: the twin of `binning`."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

TILE_SIZE = 8
"""Pixels along a tile's side."""


class TileLists(NamedTuple):
    """Surfels of every tile, front to back, and the gradient slot of each (surfel, tile) pair."""

    surfel: Int[Tensor, " pairs"]
    """Surfels of the pairs, ordered by tile, then by depth of the centre, then by surfel."""
    slot: Int[Tensor, " pairs"]
    """Gradient slot of each pair: those of one surfel are contiguous."""
    start: Int[Tensor, " tiles"]
    """First pair of each tile, row by row."""
    count: Int[Tensor, " tiles"]
    """Number of pairs of each tile."""
    order: Int[Tensor, " m"]
    """The visible surfels, front to back: the order of the slots."""
    num_slots: Int[Tensor, " m"]
    """Number of slots of each of them."""


def tile_lists(
    depth: Float[Tensor, " n"], box: Int[Tensor, "n 4"], visible: Bool[Tensor, " n"], width: int, height: int
) -> TileLists:
    """Depth-sorted lists of the surfels whose pixel box overlaps each tile.

    Args:
        depth: Depth of the centres in metres.
        box: Pixel boxes [x0, x1, y0, y1).
        visible: Surfels that are drawn.
        width: Image width in pixels.
        height: Image height in pixels.

    Returns:
        Lists of all tiles.
    """
    across, down = -(-width // TILE_SIZE), -(-height // TILE_SIZE)
    order = torch.nonzero(visible)[:, 0]
    order = order[torch.argsort(depth[order], stable=True)]
    low, high = box[order][:, 0::2] // TILE_SIZE, (box[order][:, 1::2] - 1) // TILE_SIZE + 1
    size = high - low  # columns and rows of tiles
    num_slots = size[:, 0] * size[:, 1]
    owner = torch.repeat_interleave(torch.arange(len(order), device=depth.device), num_slots)
    within = torch.arange(len(owner), device=depth.device) - (num_slots.cumsum(0) - num_slots)[owner]
    row, column = within // size[owner, 0], within % size[owner, 0]
    tile = (low[owner, 1] + row) * across + low[owner, 0] + column
    slot = torch.argsort(tile, stable=True)
    count = torch.bincount(tile, minlength=across * down)
    return TileLists(order[owner[slot]], slot, count.cumsum(0) - count, count, order, num_slots)


def sum_slots(slots: Float[Tensor, "pairs c"], lists: TileLists, n: int) -> Float[Tensor, "n c"]:
    """Sum the slots of each surfel in their order: the same bytes in every run on a device.

    Args:
        slots: Numbers of all pairs.
        lists: Whose slots they are.
        n: Number of surfels.

    Returns:
        Sums; 0 for surfels without slots.
    """
    total = slots.new_zeros((n, slots.shape[1]))
    surfel, left = lists.order, lists.num_slots
    at = left.cumsum(0) - left
    while len(surfel):
        total[surfel] += slots[at]  # every surfel once
        more = left > 1
        surfel, at, left = surfel[more], at[more] + 1, left[more] - 1
    return total
