"""Eight pixels of a triangle's row at once: LLVM makes no vector code of a loop with so few rounds.

A pixel's key orders the faces that may be visible there: the inverse depth as the bits of a positive float, which sort
as the floats do, then a rank that decides between equal depths. Key 0 is an empty pixel.
"""

from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import FLOAT, INT, LONG, generate

WIDTH = 8
"""Pixels that `draw` touches from `start` on: rows need as many spare keys at their end."""


@intrinsic
def draw(typingctx, keys, start, count, first, slope, rank):
    """Raise keys[start + i], i < min(count, 8), to inverse depth first + i slope and `rank` where they are lower.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        keys: int64 keys of all pixels, flat.
        start: Index of the first pixel's key.
        count: Number of pixels left in the row.
        first: Inverse depth at the first pixel, in 1/metres.
        slope: Its change per pixel.
        rank: Lower 32 bits of the keys: of faces with equal depth, the one with the highest is visible.

    Returns:
        None; `keys` is changed.
    """

    def build(keys, start, count, first, slope, rank):
        depth = slope * slope.constants(range(WIDTH)) + first
        key = (depth.to(FLOAT).bits(INT).to(LONG) << 32) | rank
        old = keys.load(start, WIDTH)
        visible = (count.constants(range(WIDTH)) < count) & (key > old)
        keys.store(start, key.where(visible, old))

    return types.void(keys, types.intp, types.int64, types.float64, types.float64, types.int64), generate(build)
