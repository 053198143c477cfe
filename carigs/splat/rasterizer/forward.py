"""Front-to-back compositing in scalar loops: the readable reference of `forward_simd` (`backend="scalar"`).

Per pixel, over its surfels in order of the depth Z of their centres, with transmittance T_1 = 1:

    G = s^2 + t^2                        squared disc coordinates of the ray-splat intersection (see `projection`)
    alpha_i = min(o_i exp(-G / 2), cap)  dropped below 1/255
    w_i = T_i alpha_i,                   T_(i+1) = T_i (1 - alpha_i)

A pixel is complete before the surfel that would leave T <= 1e-4. Images are sums of w times colour, Z and normal, and

    distortion = sum_i 2 w_i (Z_i A_i - D_i),   A_i = sum_(j<i) w_j = 1 - T_i,   D_i = sum_(j<i) w_j Z_j

which equals sum_ij w_i w_j |Z_i - Z_j| for sorted Z (2D Gaussian Splatting, Huang et al. 2024: compositing eq. 12,
distortion eq. 13; constants as in gsplat).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from jaxtyping import Float32

from carigs.simd.kernels import kernel
from carigs.simd.tuples import read_row
from carigs.simd.vectors import FASTMATH
from carigs.splat.rasterizer import records
from carigs.splat.rasterizer.binning import TILE_SIZE, TileLists
from carigs.splat.rasterizer.records import ALPHA_THRESHOLD, PLANE, TRANSMITTANCE_THRESHOLD

LOG2_ALPHA_THRESHOLD = np.float32(math.log2(ALPHA_THRESHOLD))
MIN_TRANSMITTANCE = np.float32(TRANSMITTANCE_THRESHOLD)
HALF_LOG2E = np.float32(0.5 / math.log(2.0))
ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)


read_record = read_row(len(records.RECORD_COLUMN))
"""The numbers of a `SurfelRecord` (records, surfel)."""


@numba.njit
def intersect(dx, dy, surfel):
    """Ray-splat intersection: disc coordinates of the ray through a pixel (2DGS eq. 10).

    Args:
        dx: Pixel offset from the projected centre.
        dy: The same in y.
        surfel: `SurfelRecord`.

    Returns:
        s, t and 1 / zz; grazing rays give inf or NaN.
    """
    iz = ONE / (surfel.det + surfel.a3 * dx + surfel.b3 * dy)
    return (surfel.v1 * dx - surfel.u1 * dy) * iz, (surfel.u0 * dy - surfel.v0 * dx) * iz, iz


@numba.njit
def log2_alpha(g, log2_opacity):
    """log2(o exp(-G / 2)).

    Args:
        g: Squared disc coordinates of the intersection.
        log2_opacity: log2 of the opacity o.

    Returns:
        log2 of alpha before the cap; -inf or NaN for grazing rays.
    """
    return log2_opacity - g * HALF_LOG2E


@kernel(parallel=True, fastmath=FASTMATH)
def composite(
    projected: records.ProjectedSurfels,
    lists: TileLists,
    compositing: records.Compositing,
    num_planes: int,
    workers: int,
) -> Float32[np.ndarray, "planes h w"]:
    """Composite the surfels of all tiles (scalar reference).

    Args:
        projected: Records and pixel boxes; colours are relative to the background.
        lists: Depth-sorted surfels of every tile.
        compositing: Image size and constants.
        num_planes: Number of planes to compute: one of those in `records`.
        workers: Number of threads that share the tiles.

    Returns:
        The first planes of the image: T, r, g, b; depth, normal x, y, z; distortion.
    """
    record, box, _ = projected
    surfel_of, start, order = lists.surfel, lists.start, lists.order
    width, height, cap, background = compositing
    image = np.empty((num_planes, height, width), np.float32)
    across = -(-width // TILE_SIZE)
    for worker in numba.prange(workers):
        # Planes of the tile. The transmittance of a complete pixel is stored as -T.
        state = np.empty((num_planes, TILE_SIZE, TILE_SIZE), np.float32)
        for k in range(worker, order.size, workers):
            tile = order[k]
            left, top = (tile % across) * TILE_SIZE, (tile // across) * TILE_SIZE
            right, bottom = min(left + TILE_SIZE, width), min(top + TILE_SIZE, height)
            state[PLANE.transmittance] = ONE
            state[PLANE.red :] = ZERO
            incomplete_pixels = (right - left) * (bottom - top)
            for e in range(start[tile], start[tile + 1]):
                if incomplete_pixels == 0:
                    break
                i = surfel_of[e]
                surfel = records.SurfelRecord(*read_record(record, i))
                for y in range(max(box[i, 2], top), min(box[i, 3], bottom)):
                    dy = surfel.dy + np.float32(y - box[i, 2])
                    b = y - top
                    for x in range(max(box[i, 0], left), min(box[i, 1], right)):
                        dx = surfel.dx + np.float32(x - box[i, 0])
                        s, t, _ = intersect(dx, dy, surfel)
                        exponent = log2_alpha(s * s + t * t, surfel.log2_opacity)
                        a = x - left
                        before = state[PLANE.transmittance, b, a]
                        if not exponent >= LOG2_ALPHA_THRESHOLD or before <= ZERO:  # also NaN
                            continue
                        alpha = min(np.exp2(exponent), cap)
                        w = before * alpha
                        after = before - w
                        if after <= MIN_TRANSMITTANCE:
                            state[PLANE.transmittance, b, a] = -before
                            incomplete_pixels -= 1
                            continue
                        state[PLANE.transmittance, b, a] = after
                        state[PLANE.red, b, a] += w * surfel.red
                        state[PLANE.green, b, a] += w * surfel.green
                        state[PLANE.blue, b, a] += w * surfel.blue
                        if num_planes > PLANE.distortion:
                            # The depth plane before this surfel is D_i.
                            in_front = surfel.depth * (ONE - before) - state[PLANE.depth, b, a]
                            state[PLANE.distortion, b, a] += TWO * w * in_front
                        if num_planes > PLANE.depth:
                            state[PLANE.depth, b, a] += w * surfel.depth
                            state[PLANE.normal_x, b, a] += w * surfel.normal_x
                            state[PLANE.normal_y, b, a] += w * surfel.normal_y
                            state[PLANE.normal_z, b, a] += w * surfel.normal_z
            for y in range(top, bottom):
                for x in range(left, right):
                    image[PLANE.transmittance, y, x] = abs(state[PLANE.transmittance, y - top, x - left])
            for plane in range(PLANE.red, num_planes):
                behind = background if plane < PLANE.depth else ZERO
                for y in range(top, bottom):
                    for x in range(left, right):
                        image[plane, y, x] = state[plane, y - top, x - left] + behind
    return image
