"""Bilinear interpolation of three channels at once: LLVM does not see that the channels do the same."""

from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from carigs.simd.ir_values import generate


@intrinsic
def copy_sample(typingctx, image, start, stride, fx, fy, result, place):
    """Write the sample at (fx, fy) of a block of 2 x 2 pixels to result[place : place + 3].

    Args:
        typingctx: Supplied by Numba; callers leave it out.
        image: float32 RGB image, flat. A fourth float after each pixel is read and not used.
        start: Index of the first float of the block's upper left pixel.
        stride: Length of a row of the image in floats.
        fx: Horizontal position between the pixels' centres, 0 to 1.
        fy: Vertical position, 0 to 1.
        result: float32 RGB image, flat.
        place: Index of the first float of the pixel to write.

    Returns:
        None; `result` is changed.
    """

    def build(image, start, stride, fx, fy, result, place):
        def interpolate(a, b, t):
            return a + t * (b - a)

        def row(start):
            return interpolate(image.load(start, 4), image.load(start + 3, 4), fx)

        sample = interpolate(row(start), row(start + stride), fy)
        for k in range(3):
            result.store(place + k, sample[k])

    kinds = (types.intp, types.intp, types.float32, types.float32, result, types.intp)
    return types.void(image, *kinds), generate(build, contract=True)
