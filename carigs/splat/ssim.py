"""L1 and SSIM of two images and their gradient in one pass over the pixels (Numba, no torch).

SSIM as Wang et al. 2004: 11 Gaussian taps of sigma 1.5, C1 = 0.01^2, C2 = 0.03^2, zero padding, mean over pixels and
channels.  With G the filter, m = G x, n = G y:

    A1 = 2 m n + C1    A2 = 2 (G(xy) - m n) + C2    B1 = m^2 + n^2 + C1    B2 = G(x^2) - m^2 + G(y^2) - n^2 + C2
    S = A1 A2 / (B1 B2)
    dS/dG(xy) = 2 A1 / (B1 B2)     dS/dG(x^2) = -S / B2
    dS/dm = 2 n (A2 - A1) / (B1 B2) - 2 m S (1/B1 - 1/B2)
    d(sum S)/dx = G(dS/dm) + 2 x G(dS/dG(x^2)) + y G(dS/dG(xy))          (G is symmetric)

Strips of rows are independent tasks whose sums are added in order: the number of threads changes nothing.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32

from carigs.splat.simd import FASTMATH

RADIUS = 5
C1, C2 = np.float32(0.01**2), np.float32(0.03**2)
REDUCING = FASTMATH | {"reassoc"}  # or sums along rows would not be vectorised
ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)
STRIP = 32  # rows per task; 10 more on either side are filtered again

_taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
T0, T1, T2, T3, T4, T5 = (_taps / _taps.sum()).astype(np.float32)[: RADIUS + 1]  # the other half mirrors these


@numba.njit(fastmath=REDUCING, error_model="numpy", forceinline=True)
def _across(row, x):
    """Taps along a row, x being the leftmost."""
    return (
        T0 * (row[x] + row[x + 10])
        + T1 * (row[x + 1] + row[x + 9])
        + T2 * (row[x + 2] + row[x + 8])
        + T3 * (row[x + 3] + row[x + 7])
        + T4 * (row[x + 4] + row[x + 6])
        + T5 * row[x + 5]
    )


@numba.njit(fastmath=REDUCING, error_model="numpy", forceinline=True)
def _down(p, i, r, x):
    """Taps along a column of plane i, r being the topmost."""
    return (
        T0 * (p[i, r, x] + p[i, r + 10, x])
        + T1 * (p[i, r + 1, x] + p[i, r + 9, x])
        + T2 * (p[i, r + 2, x] + p[i, r + 8, x])
        + T3 * (p[i, r + 3, x] + p[i, r + 7, x])
        + T4 * (p[i, r + 4, x] + p[i, r + 6, x])
        + T5 * p[i, r + 5, x]
    )


# In a function of its own: Numba would infer the types of a parallel loop's body twice.
@numba.njit(fastmath=REDUCING, error_model="numpy", forceinline=True)
def _strip(x, y, valid, l1_weight, ssim_weight, gradient, strips, task):
    """Sums of |x - y| and S over a strip of one channel; writes its part of the gradient."""
    _, height, width = x.shape
    c, r0 = task // strips, (task % strips) * STRIP
    r1 = min(r0 + STRIP, height)
    m0, m1 = max(r0 - RADIUS, 0), min(r1 + RADIUS, height)  # rows with derivative maps
    h0, h1 = max(m0 - RADIUS, 0), min(m1 + RADIUS, height)  # rows with horizontal moments
    # Where x = y, S = 1, and what such pixels contribute to the gradient of others cancels: only columns with a
    # difference, and those within reach of one, are computed.
    c0, c1 = width, 0
    for r in range(h0, h1):
        q = 0
        while q < c0 and (x[c, r, q] == y[c, r, q] or not valid[r, q]):
            q += 1
        c0, q = q, width
        while q > c1 and (x[c, r, q - 1] == y[c, r, q - 1] or not valid[r, q - 1]):
            q -= 1
        c1 = q
    for r in range(r0, r1):
        gradient[c, r, :] = ZERO
    if c1 <= c0:
        return 0.0, float((r1 - r0) * width)
    f0, f1 = max(c0 - 2 * RADIUS, 0), min(c1 + 2 * RADIUS, width)  # columns that are read and have a gradient
    d0, d1 = max(c0 - RADIUS, 0), min(c1 + RADIUS, width)  # columns with derivative maps
    read, mapped, left = f1 - f0, d1 - d0, d0 - f0
    # Rows that the filter wants and that lie outside the image or, for the maps, outside the strip's reach, are 0.
    moments = np.zeros((5, m1 - m0 + 2 * RADIUS, mapped), np.float32)
    maps = np.zeros((3, r1 - r0 + 2 * RADIUS, mapped), np.float32)
    row = np.zeros((5, read + 2 * RADIUS), np.float32)
    # Loops begin at 0, in one-dimensional views where need be: Numba guards other indices against being negative, and
    # does not know that two-dimensional views have contiguous rows; either way nothing would be vectorised.
    for r in range(h0, h1):
        at = r - (m0 - RADIUS)
        x_row, y_row, valid_row = x[c, r, f0:f1], y[c, r, f0:f1], valid[r, f0:f1]
        for q in range(read):
            a = x_row[q]
            b = y_row[q] if valid_row[q] else a
            row[0, q + RADIUS], row[1, q + RADIUS] = a, b
            row[2, q + RADIUS], row[3, q + RADIUS], row[4, q + RADIUS] = a * a, b * b, a * b
        for i in range(5):
            from_left = row[i, left:]
            for q in range(mapped):
                moments[i, at, q] = _across(from_left, q)
    total = 0.0
    for r in range(m0, m1):
        at, to = r - m0, r - (r0 - RADIUS)
        for i in range(5):
            for q in range(mapped):
                row[i, q] = _down(moments, i, at, q)
        row_total = np.float32(width - mapped)
        for q in range(mapped):
            m, n, xx, yy, xy = row[0, q], row[1, q], row[2, q], row[3, q], row[4, q]
            a1, a2 = TWO * m * n + C1, TWO * (xy - m * n) + C2
            b1, b2 = m * m + n * n + C1, xx - m * m + yy - n * n + C2
            i1, i2 = ONE / b1, ONE / b2
            s = a1 * a2 * i1 * i2
            row_total += s
            maps[0, to, q] = TWO * (n * (a2 - a1) * i1 * i2 - m * s * (i1 - i2))
            maps[1, to, q] = -s * i2
            maps[2, to, q] = TWO * a1 * i1 * i2
        if r0 <= r < r1:
            total += row_total
    similarity, total = total, 0.0
    row[:] = ZERO
    for r in range(r0, r1):
        for i in range(3):
            to_row = row[i, left + RADIUS :]
            for q in range(mapped):
                to_row[q] = _down(maps, i, r - r0, q)
        x_row, y_row, valid_row, gradient_row = x[c, r, f0:f1], y[c, r, f0:f1], valid[r, f0:f1], gradient[c, r, f0:f1]
        row_0, row_1, row_2 = row[0], row[1], row[2]
        row_total = ZERO
        for q in range(read):
            a, b = x_row[q], y_row[q]
            slope = _across(row_0, q) + TWO * a * _across(row_1, q) + b * _across(row_2, q)
            step = ONE if a > b else (-ONE if a < b else ZERO)
            counts = ONE if valid_row[q] else ZERO
            row_total += counts * abs(a - b)
            gradient_row[q] = counts * (l1_weight * step - ssim_weight * slope)
        total += row_total
    return total, similarity


@numba.njit(cache=True, parallel=True)
def l1_and_ssim(x, y, valid, l1_weight, ssim_weight):
    """Sums over all pixels of |x - y| and of S, and the gradient of l1_weight sum|x - y| - ssim_weight sum S.

    `x`, `y` are planes (c, h, w) float32.  Where `valid` (h, w) is false, x takes the place of y and the gradient is 0.
    """
    channels, height, _ = x.shape
    strips = (height + STRIP - 1) // STRIP
    gradient = np.empty_like(x)
    absolute, similarity = np.zeros(channels * strips), np.zeros(channels * strips)
    for task in numba.prange(channels * strips):
        absolute[task], similarity[task] = _strip(x, y, valid, l1_weight, ssim_weight, gradient, strips, task)
    return absolute.sum(), similarity.sum(), gradient


def l1_ssim_gradient(
    x: Float32[np.ndarray, "c h w"],
    y: Float32[np.ndarray, "c h w"],
    valid: Bool[np.ndarray, "h w"],
    ssim_share: float,
) -> tuple[float, Float32[np.ndarray, "c h w"]]:
    """(1 - share) mean|x - y| + share (1 - mean SSIM), and its gradient with respect to x."""
    absolute, similarity, gradient = l1_and_ssim(
        x, y, valid, np.float32((1 - ssim_share) / x.size), np.float32(ssim_share / x.size)
    )
    return (1 - ssim_share) * absolute / x.size + ssim_share * (1 - similarity / x.size), gradient
