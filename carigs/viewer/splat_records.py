"""Surfels as the records that viser sends to the browser: flat Gaussians with covariances in half precision."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt32
from numba import njit

from carigs.simd.kernels import INLINE, kernel
from carigs.splat.rasterizer.interface import WorldSurfels

SCENE_SCALE = 20.0
"""Units of the page per metre. In metres, the covariance of a surfel of half a millimetre has six bits left in half
precision; in these units it has all of them."""
RECORD_SIZE = 8
"""Numbers of 32 bits: centre (3), unused, covariance (6 of 16 bits: xx, xy, xz, yy, yz, zz), RGBA (4 of 8 bits)."""


def splat_records(surfels: WorldSurfels) -> UInt32[np.ndarray, "n 8"]:
    """Pack surfels for viser's Gaussian splats (`GaussianSplatsProps.buffer`).

    The covariance of a disc with tangents u and v is u u^T + v v^T.

    Args:
        surfels: Surfels in world coordinates, in metres.

    Returns:
        One record per surfel, in units of the page (`SCENE_SCALE`). A surfel with a number that is not finite is
        transparent.
    """
    arrays = [tensor.detach().contiguous().numpy() for tensor in vars(surfels).values()]
    count = len(arrays[0])
    records, covariance = np.empty((count, RECORD_SIZE), np.uint32), np.empty((count, 6), np.float32)
    views = records.view(np.float32), records.view(np.uint16), records.view(np.uint8)
    _pack(*arrays, np.float32(SCENE_SCALE), *views, covariance, covariance.view(np.uint32))
    return records


@kernel
def _pack(centre, tangent_u, tangent_v, opacity, colour, scale, floats, halves, octets, covariance, bits):
    s2, largest = scale * scale, np.float32(65000)  # half precision ends at 65504
    for n in range(len(centre)):
        finite = True
        for i in range(3):
            x = centre[n, i] * scale
            finite &= abs(x) < 1e9
            floats[n, i] = x
            level = 255 * colour[n, i] + np.float32(0.5)
            octets[n, 28 + i] = np.uint8(min(max(level, np.float32(0)), np.float32(255)))
        floats[n, 3] = 0
        k = 0
        for i in range(3):
            for j in range(i, 3):
                value = s2 * (tangent_u[n, i] * tangent_u[n, j] + tangent_v[n, i] * tangent_v[n, j])
                finite &= abs(value) < largest
                covariance[n, k] = value
                k += 1
        if not finite:
            floats[n, :3], covariance[n] = 0, 0
        for k in range(6):
            halves[n, 8 + k] = _half(covariance, bits, n, k)
        octets[n, 31] = np.uint8(255 * opacity[n] + np.float32(0.5)) if finite else 0


@njit(**INLINE)
def _half(floats, bits, n, k):
    """Bits of a number in half precision, rounded to the nearest, ties to even; it must be below 65520.

    NumPy's conversion takes ten times as long. Numbers below 2^-14 are multiples of 2^-24 in half precision: adding
    0.5, whose last bit is 2^-24, rounds them. `bits` are those of `floats`, which is changed.
    """
    sign = bits[n, k] >> np.uint32(31)
    magnitude = bits[n, k] & np.uint32(0x7FFFFFFF)
    if magnitude < np.uint32(0x38800000):  # 2^-14
        floats[n, k] = abs(floats[n, k]) + np.float32(0.5)
        rounded = bits[n, k] - np.uint32(0x3F000000)
    else:
        odd = (magnitude >> np.uint32(13)) & np.uint32(1)
        rounded = (magnitude - np.uint32(0x38000000) + np.uint32(0xFFF) + odd) >> np.uint32(13)
    return np.uint16(rounded | (sign << np.uint32(15)))
