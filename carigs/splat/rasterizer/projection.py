"""Surfels to image space and back: the homography record of each surfel, its pixel box, and their gradients (Numba).

A disc `centre + s u + t v` seen by a pinhole is a homography of (s, t); relative to the projected centre it has eight
numbers (pc_x, pc_y, U0, U1, V0, V1, p, q):

    dx = (U0 s + U1 t) / (1 + p s + q t),   dy = (V0 s + V1 t) / (1 + p s + q t),   (dx, dy) = pixel - pc

Its inverse (Cramer) is linear over linear in the pixel, which is what the tile kernels evaluate:

    zx = V1 dx - U1 dy,   zy = U0 dy - V0 dx,   zz = det + a3 dx + b3 dy,   s = zx / zz,  t = zy / zz

This is the ray-splat intersection of 2D Gaussian Splatting (Huang et al. 2024, eq. 8-10), in a form fit for float32.

Everything here is in float64, on tuples of numbers: scalars in the loops below, or vectors of eight surfels in
`projection_simd`.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.simd.vector_math import absolute, floor, log2, maximum, minimum, select, sqrt
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rasterizer.culling import HORIZON, NEAR, SMALLEST_AREA, THRESHOLD

SLACK = 1e-3  # pixels by which boxes are widened against rounding

# Columns of a surfel's record.  PIXEL is the first pixel centre of its box relative to the projected centre: small
# numbers where the absolute position would cost float32 its last digits.
PIXEL, HOMOGRAPHY, PLANE, LOWPASS, LOG_OPACITY, COLOUR, DEPTH, NORMAL = 0, 2, 6, 9, 11, 12, 15, 16
RECORD = 20
# Columns of a gradient slot: sums over the pixels of one (surfel, tile) pair, see `backward`.
MOMENT, SHIFT, EXPONENT = 0, 9, 11  # then COLOUR, DEPTH and NORMAL as above
SLOT = 20


@scalar_or_simd
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@scalar_or_simd
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@scalar_or_simd
def _rotate(view, x):
    return (
        view[0] * x[0] + view[1] * x[1] + view[2] * x[2],
        view[4] * x[0] + view[5] * x[1] + view[6] * x[2],
        view[8] * x[0] + view[9] * x[1] + view[10] * x[2],
    )


@scalar_or_simd
def _rotate_back(view, x):
    return (
        view[0] * x[0] + view[4] * x[1] + view[8] * x[2],
        view[1] * x[0] + view[5] * x[1] + view[9] * x[2],
        view[2] * x[0] + view[6] * x[1] + view[10] * x[2],
    )


@scalar_or_simd
def _camera_space(view, centre, tangent_u, tangent_v):
    """Centre and tangents in camera axes; `view` is camera_from_world row by row."""
    m = _rotate(view, centre)
    m = (m[0] + view[3], m[1] + view[7], m[2] + view[11])
    return m, _rotate(view, tangent_u), _rotate(view, tangent_v)


@scalar_or_simd
def _homography(m, u, v, fx, fy):
    """(xh, yh, U0, U1, V0, V1, p, q) of a disc: perspective division of centre and tangents."""
    iz = 1.0 / m[2]
    xh, yh, p, q = m[0] * iz, m[1] * iz, u[2] * iz, v[2] * iz
    u0, u1 = fx * (u[0] * iz - xh * p), fx * (v[0] * iz - xh * q)
    v0, v1 = fy * (u[1] * iz - yh * p), fy * (v[1] * iz - yh * q)
    return xh, yh, u0, u1, v0, v1, p, q


@scalar_or_simd
def _facing_normal(m, u, v):
    """Unit normal towards the camera, the area |u x v| and the sign of the flip."""
    n = _cross(u, v)
    area = sqrt(_dot(n, n))
    sign = select(_dot(n, m) > 0.0, -1.0, 1.0)
    scale = sign / area
    return (n[0] * scale, n[1] * scale, n[2] * scale), area, sign


@scalar_or_simd
def _interval(a, b, p, q, rho2, rho_lowpass):
    """Extent along one axis of the visible ellipse relative to the projected centre, and the low-pass centre.

    The circle s^2 + t^2 = rho2 touches the line at offset c where c^2 E - 2 c rho2 N + rho2 (a^2 + b^2) = 0 with
    N = a p + b q and E = rho2 (p^2 + q^2) - 1; united with the low-pass disc around N / E1.
    """
    n = a * p + b * q
    squared = p * p + q * q
    e = rho2 * squared - 1.0
    middle = rho2 * n / e
    half = sqrt(maximum(middle * middle - rho2 * (a * a + b * b) / e, 0.0))
    lowpass = n / (squared - 1.0)
    return minimum(middle - half, lowpass - rho_lowpass), maximum(middle + half, lowpass + rho_lowpass), lowpass


@scalar_or_simd
def _pixels(low, high, size):
    """Indices [first, last) of the pixels whose centres lie in [low, high] and in the image."""
    first = -floor(-maximum(low - 0.5 - SLACK, 0.0))
    return first, floor(minimum(high - 0.5 + SLACK, size - 1.0)) + 1.0


@scalar_or_simd
def projected(centre, tangent_u, tangent_v, opacity, paint, view, intrinsics, width, height, tile):
    """Whether a surfel is seen, its box [x0, x1, y0, y1), its number of tiles, and its record without the colour.

    `paint` is anything that is finite if the colour is.
    """
    fx, fy, cx, cy = intrinsics
    m, u, v = _camera_space(view, centre, tangent_u, tangent_v)
    xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, fx, fy)
    bits = log2(opacity)
    rho2 = 2.0 * LN2 * (bits + LOG2_255)  # where alpha is 1/255
    squared = p * p + q * q
    normal, area, _ = _facing_normal(m, u, v)
    pcx, pcy = fx * xh + cx, fy * yh + cy
    rho_lowpass = sqrt(0.5 * rho2)
    low_x, high_x, ex = _interval(u0, u1, p, q, rho2, rho_lowpass)
    low_y, high_y, ey = _interval(v0, v1, p, q, rho2, rho_lowpass)
    x0, x1 = _pixels(pcx + low_x, pcx + high_x, width)
    y0, y1 = _pixels(pcy + low_y, pcy + high_y, height)
    checksum = _dot(m, m) + _dot(u, u) + _dot(v, v) + opacity + paint
    seen = (checksum < np.inf) & (m[2] > NEAR) & (opacity >= THRESHOLD) & (area > SMALLEST_AREA)
    seen = seen & (rho2 * squared - 1.0 < HORIZON) & (squared - 1.0 < HORIZON) & (x1 > x0) & (y1 > y0)
    across = floor((x1 - 1.0) / tile) - floor(x0 / tile) + 1.0
    down = floor((y1 - 1.0) / tile) - floor(y0 / tile) + 1.0
    box = (select(seen, x0, 0.0), select(seen, x1, 0.0), select(seen, y0, 0.0), select(seen, y1, 0.0))
    record = (
        x0 + 0.5 - pcx, y0 + 0.5 - pcy, u0, u1, v0, v1, u0 * v1 - u1 * v0, v0 * q - v1 * p, u1 * p - u0 * q, -ex, -ey,
        bits, m[2], normal[0], normal[1], normal[2],
    )  # fmt: skip
    return box, select(seen, across * down, 0.0), record


LN2, LOG2_255 = float(np.log(2)), float(np.log2(255))


@scalar_or_simd
def _homography_gradient(g, u0, u1, v0, v1, p, q):
    """Chain rule from the summed moments `g` to (pc_x, pc_y, U0, U1, V0, V1, p, q).

    zx, zy, zz and the low-pass centre are linear in the pixel offset: sums over pixels of their gradients, and of those
    times dx, dy, are all that is needed.
    """
    gx, gy, gz, gxx, gxy, gyx, gyy, gzx, gzy = g[0], g[1], g[2], g[3], g[4], g[5], g[6], g[7], g[8]
    a3, b3 = v0 * q - v1 * p, u1 * p - u0 * q
    d_u0 = gyy + gz * v1 - gzy * q
    d_u1 = -gxy - gz * v0 + gzy * p
    d_v0 = -gyx - gz * u1 + gzx * q
    d_v1 = gxx + gz * u0 - gzx * p
    d_p = -gzx * v1 + gzy * u1
    d_q = gzx * v0 - gzy * u0
    d_pcx = -(gx * v1 - gy * v0 + gz * a3)
    d_pcy = -(-gx * u1 + gy * u0 + gz * b3)
    # Low-pass centre m2 = pc + N / E1.
    mx, my = -g[9], -g[10]
    e1 = p * p + q * q - 1.0
    kx, ky = mx / e1, my / e1
    nx, ny = u0 * p + u1 * q, v0 * p + v1 * q
    d_e1 = -(kx * nx + ky * ny) / e1
    d_u0 += kx * p
    d_u1 += kx * q
    d_v0 += ky * p
    d_v1 += ky * q
    d_p += kx * u0 + ky * v0 + 2.0 * p * d_e1
    d_q += kx * u1 + ky * v1 + 2.0 * q * d_e1
    return d_pcx + mx, d_pcy + my, d_u0, d_u1, d_v0, d_v1, d_p, d_q


@scalar_or_simd
def _disc_gradient(d, d_depth, m, u, v, xh, yh, p, q, fx, fy):
    """Chain rule of `_homography`, and of the centre's depth, to (m, u, v) in camera axes."""
    d_pcx, d_pcy, d_u0, d_u1, d_v0, d_v1, d_p, d_q = d
    iz = 1.0 / m[2]
    d_xh = fx * (d_pcx - d_u0 * p - d_u1 * q)
    d_yh = fy * (d_pcy - d_v0 * p - d_v1 * q)
    d_p = d_p - fx * d_u0 * xh - fy * d_v0 * yh
    d_q = d_q - fx * d_u1 * xh - fy * d_v1 * yh
    d_iz = fx * (d_u0 * u[0] + d_u1 * v[0]) + fy * (d_v0 * u[1] + d_v1 * v[1])
    d_iz += d_p * u[2] + d_q * v[2] + d_xh * m[0] + d_yh * m[1]
    d_m = (d_xh * iz, d_yh * iz, d_depth - d_iz * iz * iz)
    d_u = (fx * d_u0 * iz, fy * d_v0 * iz, d_p * iz)
    d_v = (fx * d_u1 * iz, fy * d_v1 * iz, d_q * iz)
    return d_m, d_u, d_v


@scalar_or_simd
def _normal_gradient(d_n, n, area, sign, u, v):
    """Chain rule of n = sign (u x v) / |u x v| to (u, v)."""
    along = _dot(n, d_n)
    scale = sign / area
    c = ((d_n[0] - along * n[0]) * scale, (d_n[1] - along * n[1]) * scale, (d_n[2] - along * n[2]) * scale)
    return _cross(v, c), _cross(c, u)


@scalar_or_simd
def pulled_back(g, centre, tangent_u, tangent_v, view, intrinsics):
    """Gradients of centre, tangents and projected centre from the sums `g` of a surfel's slots."""
    fx, fy, _, _ = intrinsics
    m, u, v = _camera_space(view, centre, tangent_u, tangent_v)
    xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, fx, fy)
    d = _homography_gradient(g, u0, u1, v0, v1, p, q)
    d_m, d_u, d_v = _disc_gradient(d, g[15], m, u, v, xh, yh, p, q, fx, fy)
    n, area, sign = _facing_normal(m, u, v)
    along_u, along_v = _normal_gradient((g[16], g[17], g[18]), n, area, sign, u, v)
    return (
        _rotate_back(view, d_m),
        _rotate_back(view, (d_u[0] + along_u[0], d_u[1] + along_u[1], d_u[2] + along_u[2])),
        _rotate_back(view, (d_v[0] + along_v[0], d_v[1] + along_v[1], d_v[2] + along_v[2])),
        (d[0], d[1]),
    )


@numba.njit
def _three(array, i):
    return np.float64(array[i, 0]), np.float64(array[i, 1]), np.float64(array[i, 2])


@numba.njit(cache=True, parallel=True, error_model="numpy")
def project(centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height, tile, background):
    """Records (n, 20) float32, pixel boxes (n, 4) int32 [x0, x1, y0, y1) and numbers of tiles (n,) int32, 0 if dropped.

    `view` is camera_from_world row by row (>= 12 numbers), `intrinsics` fx fy cx cy.  Dropped: surfels with a number
    that is not finite, without area, nearer than NEAR, fainter than THRESHOLD, crossing the camera plane within their
    visible extent, or outside the image.
    """
    count = centre.shape[0]
    record = np.empty((count, RECORD), np.float32)
    box = np.zeros((count, 4), np.int32)
    tiles = np.zeros(count, np.int32)
    for i in numba.prange(count):
        r, g, b = _three(colour, i)
        corners, number, line = projected(
            _three(centre, i), _three(tangent_u, i), _three(tangent_v, i), np.float64(opacity[i]),
            absolute(r) + absolute(g) + absolute(b), view, intrinsics, float(width), float(height), float(tile),
        )  # fmt: skip
        if number == 0.0:
            continue
        tiles[i] = int(number)
        for k in range(4):
            box[i, k] = int(corners[k])
        for k in range(12):
            record[i, k] = line[k]
        record[i, 12], record[i, 13], record[i, 14] = r - background, g - background, b - background
        for k in range(12, 16):
            record[i, k + 3] = line[k]
        record[i, 19] = 0.0
    return record, box, tiles


@numba.njit(cache=True, parallel=True, error_model="numpy")
def project_backward(slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics):
    """Gradients of centre, tangent_u, tangent_v (n, 3), opacity (n,), colour (n, 3) and projected centre (n, 2).

    Sums each surfel's gradient slots (rows first_slot[i] .. first_slot[i + 1]) in order and in float64.
    """
    count = centre.shape[0]
    d_centre, d_tangent_u = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_tangent_v, d_colour = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_opacity, d_pixel = np.zeros(count, np.float32), np.zeros((count, 2), np.float32)
    for i in numba.prange(count):
        start, stop = first_slot[i], first_slot[i + 1]
        if stop == start:
            continue
        g = (0.0,) * 19
        for slot in range(start, stop):
            g = _add_slot(g, slots, slot)
        d_m, d_u, d_v, d_p = pulled_back(
            g, _three(centre, i), _three(tangent_u, i), _three(tangent_v, i), view, intrinsics
        )
        for axis in range(3):
            d_centre[i, axis] = d_m[axis]
            d_tangent_u[i, axis] = d_u[axis]
            d_tangent_v[i, axis] = d_v[axis]
        d_colour[i, 0], d_colour[i, 1], d_colour[i, 2] = g[12], g[13], g[14]
        d_opacity[i] = g[11] / opacity[i]
        d_pixel[i, 0], d_pixel[i, 1] = d_p
    return d_centre, d_tangent_u, d_tangent_v, d_opacity, d_colour, d_pixel


@numba.njit
def _add_slot(g, slots, slot):
    return (
        g[0] + slots[slot, 0],
        g[1] + slots[slot, 1],
        g[2] + slots[slot, 2],
        g[3] + slots[slot, 3],
        g[4] + slots[slot, 4],
        g[5] + slots[slot, 5],
        g[6] + slots[slot, 6],
        g[7] + slots[slot, 7],
        g[8] + slots[slot, 8],
        g[9] + slots[slot, 9],
        g[10] + slots[slot, 10],
        g[11] + slots[slot, 11],
        g[12] + slots[slot, 12],
        g[13] + slots[slot, 13],
        g[14] + slots[slot, 14],
        g[15] + slots[slot, 15],
        g[16] + slots[slot, 16],
        g[17] + slots[slot, 17],
        g[18] + slots[slot, 18],
    )
