"""Compositing of surfels, front to back, tile by tile: the plain loops (Numba; `forward_simd` is the fast twin).

Per pixel, over its surfels by depth Z of the centre, T_1 = 1:

    g3 = s^2 + t^2 (ray-splat intersection),  g2 = 2 |pixel - m2|^2 (low-pass filter),  g = min(g3, g2)
    alpha = min(o exp(-g / 2), cap), dropped below 1/255;   w = T alpha;   T <- T (1 - alpha)
    a pixel ends before the surfel that would leave T <= 1e-4

Sums of w times (1, colour, Z, normal); distortion = sum 2 w (Z A - D), with A and D the sums of w and w Z in front:
equal to sum_ij w_i w_j |Z_i - Z_j| (2D Gaussian Splatting, Huang et al. 2024, eq. 10-13; constants as gsplat).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from carigs.simd.vectors import FASTMATH
from carigs.splat.rasterizer import culling as limits
from carigs.splat.rasterizer.binning import TILE

LOG_THRESHOLD = np.float32(math.log2(limits.THRESHOLD))
END = np.float32(limits.END)
HALF_LOG2E = np.float32(0.5 / math.log(2.0))
ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)

# Planes of the output.
TRANSMITTANCE, COLOUR, DEPTH, NORMAL, DISTORTION = 0, 1, 4, 5, 8
PLANES, COLOUR_PLANES = 9, 4  # with geometry, without


@numba.njit
def intersect(dx, dy, u0, u1, v0, v1, det, a3, b3):
    """Local disc coordinates (s, t) of the ray through the pixel, and 1 / zz; grazing rays give inf or NaN."""
    iz = ONE / (det + a3 * dx + b3 * dy)
    return (v1 * dx - u1 * dy) * iz, (u0 * dy - v0 * dx) * iz, iz


@numba.njit
def log2_alpha(g3, g2, log_opacity):
    """log2 of o exp(-g/2), g = min(g3, g2); written so that a NaN g3 (grazing ray) gives g2."""
    g = g3 if g3 < g2 else g2
    return log_opacity - g * HALF_LOG2E


@numba.njit(cache=True, parallel=True, fastmath=FASTMATH, error_model="numpy")
def composite(record, box, surfel, start, order, width, height, cap, geometry, background, workers):
    """Planes (9 or 4, height, width) float32: T, r, g, b and, with `geometry`, depth, normal x, y, z, distortion.

    Colours in `record` are relative to the background, those of the image are not.
    """
    cap, background = np.float32(cap), np.float32(background)
    planes = PLANES if geometry else COLOUR_PLANES
    image = np.empty((planes, height, width), np.float32)
    across = -(-width // TILE)
    for worker in numba.prange(workers):
        # State of the tile's pixels; T of a pixel that has ended is stored as -T.
        state = np.empty((planes, TILE, TILE), np.float32)
        for k in range(worker, order.size, workers):
            t = order[k]
            left, top = (t % across) * TILE, (t // across) * TILE
            right, bottom = min(left + TILE, width), min(top + TILE, height)
            state[0] = ONE
            state[1:] = ZERO
            pixels_left = (right - left) * (bottom - top)
            for e in range(start[t], start[t + 1]):
                if pixels_left == 0:
                    break
                i = surfel[e]
                u0, u1, v0, v1 = record[i, 2], record[i, 3], record[i, 4], record[i, 5]
                det, a3, b3 = record[i, 6], record[i, 7], record[i, 8]
                ex, ey, log_opacity = record[i, 9], record[i, 10], record[i, 11]
                red, green, blue, depth = record[i, 12], record[i, 13], record[i, 14], record[i, 15]
                nx, ny, nz = record[i, 16], record[i, 17], record[i, 18]
                for y in range(max(box[i, 2], top), min(box[i, 3], bottom)):
                    dy = record[i, 1] + np.float32(y - box[i, 2])
                    b = y - top
                    for x in range(max(box[i, 0], left), min(box[i, 1], right)):
                        dx = record[i, 0] + np.float32(x - box[i, 0])
                        s, u, _ = intersect(dx, dy, u0, u1, v0, v1, det, a3, b3)
                        g2 = TWO * ((dx + ex) * (dx + ex) + (dy + ey) * (dy + ey))
                        exponent = log2_alpha(s * s + u * u, g2, log_opacity)
                        a = x - left
                        before = state[0, b, a]
                        if exponent < LOG_THRESHOLD or before <= ZERO:
                            continue
                        alpha = min(np.exp2(exponent), cap)
                        w = before * alpha
                        after = before - w
                        if after <= END:
                            state[0, b, a] = -before
                            pixels_left -= 1
                            continue
                        state[0, b, a] = after
                        state[1, b, a] += w * red
                        state[2, b, a] += w * green
                        state[3, b, a] += w * blue
                        if geometry:
                            # The depth plane before this surfel is D of the distortion.
                            state[8, b, a] += TWO * w * (depth * (ONE - before) - state[4, b, a])
                            state[4, b, a] += w * depth
                            state[5, b, a] += w * nx
                            state[6, b, a] += w * ny
                            state[7, b, a] += w * nz
            for y in range(top, bottom):
                for x in range(left, right):
                    image[0, y, x] = abs(state[0, y - top, x - left])
            for plane in range(1, planes):
                behind = background if plane < DEPTH else ZERO
                for y in range(top, bottom):
                    for x in range(left, right):
                        image[plane, y, x] = state[plane, y - top, x - left] + behind
    return image
