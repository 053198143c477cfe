"""Sums and maxima over the lanes of a vector."""

from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import FLOAT, generate
from carigs.simd.vectors import FLAGS, WIDTH, arithmetic, lanes, unary_intrinsic

# Without reassoc, sums are a chain of scalar additions.
reduce_add = unary_intrinsic(
    lanes,
    types.float32,
    lambda a: a.call("vector.reduce.fadd", FLOAT(-0.0), result=FLOAT, fastmath=(*FLAGS, "reassoc")),
)
"""Sum of the sixteen lanes."""
reduce_max = unary_intrinsic(
    lanes, types.float32, lambda a: a.call("vector.reduce.fmax", result=FLOAT, fastmath=(*FLAGS, "nnan"))
)
"""Largest of the sixteen lanes."""


@intrinsic
def reduce_add_each(typingctx, vectors):
    """Sums of sixteen vectors over their lanes: a tree of shuffles and additions shared by all.

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        vectors: Tuple of sixteen lanes.

    Returns:
        Lanes: the sum of the first vector, the sum of the second, and so on.
    """

    def build(values):
        half, add = WIDTH // 2, arithmetic("fadd")
        while half:
            # Values hold groups of 2 half partial sums; two values merge into one with groups half as long.
            low = [i for i in range(2 * WIDTH) if not i & half]
            high = [i + half for i in low]
            pairs = zip(values[::2], values[1::2], strict=True)
            values = [add(x.shuffle(y, low), x.shuffle(y, high)) for x, y in pairs]
            half //= 2
        return values[0]

    return lanes(types.UniTuple(lanes, WIDTH)), generate(build)
