"""Surfels to image space and back: the homography record of each surfel, its pixel box, and their gradients (Numba).

A disc `centre + s u + t v` seen by a pinhole is a homography of (s, t); relative to the projected centre it has eight
numbers (pc_x, pc_y, U0, U1, V0, V1, p, q):

    dx = (U0 s + U1 t) / (1 + p s + q t),   dy = (V0 s + V1 t) / (1 + p s + q t),   (dx, dy) = pixel - pc

Its inverse (Cramer) is linear over linear in the pixel, which is what the tile kernels evaluate:

    zx = V1 dx - U1 dy,   zy = U0 dy - V0 dx,   zz = det + a3 dx + b3 dy,   s = zx / zz,  t = zy / zz

This is the ray-splat intersection of 2D Gaussian Splatting (Huang et al. 2024, eq. 8-10), in a form fit for float32.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from carigs.splat.limits import HORIZON, NEAR, SMALLEST_AREA, THRESHOLD

SLACK = 1e-3  # pixels by which boxes are widened against rounding

# Columns of a surfel's record.  PIXEL is the first pixel centre of its box relative to the projected centre: small
# numbers where the absolute position would cost float32 its last digits.
PIXEL, HOMOGRAPHY, PLANE, LOWPASS, LOG_OPACITY, COLOUR, DEPTH, NORMAL = 0, 2, 6, 9, 11, 12, 15, 16
RECORD = 20
# Columns of a gradient slot: sums over the pixels of one (surfel, tile) pair, see `backward`.
MOMENT, SHIFT, EXPONENT = 0, 9, 11  # then COLOUR, DEPTH and NORMAL as above
SLOT = 20


@numba.njit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit
def _rotate(view, x, y, z):
    return (
        view[0, 0] * x + view[0, 1] * y + view[0, 2] * z,
        view[1, 0] * x + view[1, 1] * y + view[1, 2] * z,
        view[2, 0] * x + view[2, 1] * y + view[2, 2] * z,
    )


@numba.njit
def _rotate_back(view, v):
    return (
        view[0, 0] * v[0] + view[1, 0] * v[1] + view[2, 0] * v[2],
        view[0, 1] * v[0] + view[1, 1] * v[1] + view[2, 1] * v[2],
        view[0, 2] * v[0] + view[1, 2] * v[1] + view[2, 2] * v[2],
    )


@numba.njit
def _camera_space(view, centre, tangent_u, tangent_v, i):
    """Centre and tangents of surfel i in camera axes, float64."""
    m = _rotate(view, float(centre[i, 0]), float(centre[i, 1]), float(centre[i, 2]))
    m = (m[0] + view[0, 3], m[1] + view[1, 3], m[2] + view[2, 3])
    u = _rotate(view, float(tangent_u[i, 0]), float(tangent_u[i, 1]), float(tangent_u[i, 2]))
    v = _rotate(view, float(tangent_v[i, 0]), float(tangent_v[i, 1]), float(tangent_v[i, 2]))
    return m, u, v


@numba.njit
def _homography(m, u, v, fx, fy):
    """(xh, yh, U0, U1, V0, V1, p, q) of a disc: perspective division of centre and tangents."""
    iz = 1.0 / m[2]
    xh, yh, p, q = m[0] * iz, m[1] * iz, u[2] * iz, v[2] * iz
    u0, u1 = fx * (u[0] * iz - xh * p), fx * (v[0] * iz - xh * q)
    v0, v1 = fy * (u[1] * iz - yh * p), fy * (v[1] * iz - yh * q)
    return xh, yh, u0, u1, v0, v1, p, q


@numba.njit
def _facing_normal(m, u, v):
    """Unit normal towards the camera, the area |u x v| and the sign of the flip."""
    n = _cross(u, v)
    area = math.sqrt(_dot(n, n))
    sign = -1.0 if _dot(n, m) > 0.0 else 1.0
    scale = sign / area
    return (n[0] * scale, n[1] * scale, n[2] * scale), area, sign


@numba.njit
def _interval(a, b, p, q, rho2, rho_lowpass, size):
    """Half-open pixel interval, relative offsets added by the caller: extent along one axis of the visible ellipse.

    The circle s^2 + t^2 = rho2 touches the line at offset c where c^2 E - 2 c rho2 N + rho2 (a^2 + b^2) = 0 with
    N = a p + b q and E = rho2 (p^2 + q^2) - 1; united with the low-pass disc around N / E1.
    """
    n = a * p + b * q
    squared = p * p + q * q
    e = rho2 * squared - 1.0
    middle = rho2 * n / e
    half = math.sqrt(max(0.0, middle * middle - rho2 * (a * a + b * b) / e))
    lowpass = n / (squared - 1.0)
    return min(middle - half, lowpass - rho_lowpass), max(middle + half, lowpass + rho_lowpass), lowpass


@numba.njit
def _pixels(low, high, size):
    """Indices [first, last) of the pixels whose centres lie in [low, high] and in the image."""
    first = math.ceil(max(low - 0.5 - SLACK, 0.0))
    last = math.floor(min(high - 0.5 + SLACK, size - 1.0)) + 1.0
    if not (last > first):
        return 0, 0
    return int(first), int(last)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def project(centre, tangent_u, tangent_v, opacity, colour, view, intrinsics, width, height, tile):
    """Records (n, 20) float32, pixel boxes (n, 4) int32 [x0, x1, y0, y1) and numbers of tiles (n,) int32, 0 if dropped.

    `view` is camera_from_world (>= 3 rows), `intrinsics` fx fy cx cy.  Dropped: surfels with a number that is not
    finite, without area, nearer than NEAR, fainter than THRESHOLD, crossing the camera plane within their visible
    extent, or outside the image.
    """
    count = centre.shape[0]
    record = np.empty((count, RECORD), np.float32)
    box = np.zeros((count, 4), np.int32)
    tiles = np.zeros(count, np.int32)
    fx, fy, cx, cy = intrinsics
    for i in numba.prange(count):
        m, u, v = _camera_space(view, centre, tangent_u, tangent_v, i)
        o = float(opacity[i])
        checksum = _dot(m, m) + _dot(u, u) + _dot(v, v)
        checksum += o + abs(float(colour[i, 0])) + abs(float(colour[i, 1])) + abs(float(colour[i, 2]))
        if not (checksum < np.inf) or m[2] <= NEAR or o < THRESHOLD:
            continue
        xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, fx, fy)
        rho2 = 2.0 * math.log(255.0 * o)
        squared = p * p + q * q
        if not (rho2 * squared - 1.0 < HORIZON and squared - 1.0 < HORIZON):
            continue
        normal, area, _ = _facing_normal(m, u, v)
        if not (area > SMALLEST_AREA):
            continue
        pcx, pcy = fx * xh + cx, fy * yh + cy
        rho_lowpass = math.sqrt(0.5 * rho2)
        low, high, ex = _interval(u0, u1, p, q, rho2, rho_lowpass, width)
        x0, x1 = _pixels(pcx + low, pcx + high, width)
        low, high, ey = _interval(v0, v1, p, q, rho2, rho_lowpass, height)
        y0, y1 = _pixels(pcy + low, pcy + high, height)
        if x1 <= x0 or y1 <= y0:
            continue
        box[i, 0], box[i, 1], box[i, 2], box[i, 3] = x0, x1, y0, y1
        tiles[i] = ((x1 - 1) // tile - x0 // tile + 1) * ((y1 - 1) // tile - y0 // tile + 1)
        record[i, 0], record[i, 1] = x0 + 0.5 - pcx, y0 + 0.5 - pcy
        record[i, 2], record[i, 3], record[i, 4], record[i, 5] = u0, u1, v0, v1
        record[i, 6], record[i, 7], record[i, 8] = u0 * v1 - u1 * v0, v0 * q - v1 * p, u1 * p - u0 * q
        record[i, 9], record[i, 10] = -ex, -ey
        record[i, 11] = math.log2(o)
        record[i, 12], record[i, 13], record[i, 14] = colour[i, 0], colour[i, 1], colour[i, 2]
        record[i, 15] = m[2]
        record[i, 16], record[i, 17], record[i, 18], record[i, 19] = normal[0], normal[1], normal[2], 0.0
    return record, box, tiles


@numba.njit
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


@numba.njit
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


@numba.njit
def _normal_gradient(d_n, n, area, sign, u, v):
    """Chain rule of n = sign (u x v) / |u x v| to (u, v)."""
    along = _dot(n, d_n)
    scale = sign / area
    c = ((d_n[0] - along * n[0]) * scale, (d_n[1] - along * n[1]) * scale, (d_n[2] - along * n[2]) * scale)
    return _cross(v, c), _cross(c, u)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def project_backward(slots, first_slot, centre, tangent_u, tangent_v, opacity, view, intrinsics):
    """Gradients of centre, tangent_u, tangent_v (n, 3), opacity (n,), colour (n, 3) and projected centre (n, 2).

    Sums each surfel's gradient slots (rows first_slot[i] .. first_slot[i + 1]) in order and in float64.
    """
    count = centre.shape[0]
    d_centre, d_tangent_u = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_tangent_v, d_colour = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_opacity, d_pixel = np.zeros(count, np.float32), np.zeros((count, 2), np.float32)
    fx, fy, _, _ = intrinsics
    for i in numba.prange(count):
        start, stop = first_slot[i], first_slot[i + 1]
        if stop == start:
            continue
        g = (0.0,) * 19
        for slot in range(start, stop):
            g = _add_slot(g, slots, slot)
        m, u, v = _camera_space(view, centre, tangent_u, tangent_v, i)
        xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, fx, fy)
        d = _homography_gradient(g, u0, u1, v0, v1, p, q)
        d_m, d_u, d_v = _disc_gradient(d, g[15], m, u, v, xh, yh, p, q, fx, fy)
        n, area, sign = _facing_normal(m, u, v)
        along_u, along_v = _normal_gradient((g[16], g[17], g[18]), n, area, sign, u, v)
        d_m = _rotate_back(view, d_m)
        d_u = _rotate_back(view, (d_u[0] + along_u[0], d_u[1] + along_u[1], d_u[2] + along_u[2]))
        d_v = _rotate_back(view, (d_v[0] + along_v[0], d_v[1] + along_v[1], d_v[2] + along_v[2]))
        for axis in range(3):
            d_centre[i, axis] = d_m[axis]
            d_tangent_u[i, axis] = d_u[axis]
            d_tangent_v[i, axis] = d_v[axis]
        d_colour[i, 0], d_colour[i, 1], d_colour[i, 2] = g[12], g[13], g[14]
        d_opacity[i] = g[11] / opacity[i]
        d_pixel[i, 0], d_pixel[i, 1] = d[0], d[1]
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
