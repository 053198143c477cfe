"""Gradient of the compositing, front to back, with one running scalar per pixel: the plain loops (Numba).

With q_i = dL/dw_i (weights taken as independent) and S_i = sum_(j>i) w_j q_j,

    dL/dalpha_i = T_i q_i - S_i / (1 - alpha_i)

Q = sum_j w_j q_j over a whole pixel is known from the outputs, because colour, depth, normal and alpha are homogeneous
of degree 1 in the weights and the distortion of degree 2: Q = sum_c v_c output_c + v_a alpha + 2 v_x distortion.  So
the lists are walked in the forward's direction, with its end conditions, and S_i = Q - sum_(j<=i) w_j q_j.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.simd.vectors import FASTMATH
from carigs.splat.rasterizer.binning import TILE
from carigs.splat.rasterizer.forward import DEPTH, END, LOG_THRESHOLD, ONE, TWO, ZERO, intersect, log2_alpha
from carigs.splat.rasterizer.projection import SLOT


@numba.njit
def distortion_gradient(depth, a, d, a_total, d_total):
    """D distortion / d w_i = 2 (2 (Z_i A_i - D_i) + D - Z_i A): A_i, D_i the sums in front, A, D the whole sums."""
    return TWO * (TWO * (depth * a - d) + d_total - depth * a_total)


@numba.njit(cache=True, parallel=True, fastmath=FASTMATH, error_model="numpy")
def composite_backward(
    record, box, surfel, slot, start, order, image, upstream, width, height, cap, geometry, background, workers
):
    """Gradient slots (pairs, 20) float32: sums over the pixels of each (surfel, tile) pair.

    `image` holds the forward's planes, `upstream` the gradients of the same planes except that the first one is that of
    alpha = 1 - T, or those of the colours alone (3 planes).  Columns: zx, zy, zz, zx dx, zx dy, zy dx, zy dy, zz dx,
    zz dy (gradients of the ray's homogeneous disc coordinates and their moments), low-pass offset x, y, dL / d
    ln(alpha), colour, depth, normal.  Each slot is
    written once by one worker, so that neither atomics nor a fixed number of threads are needed.
    """
    cap, background = np.float32(cap), np.float32(background)
    first = 1 if len(upstream) == 3 else 0  # plane of the image whose gradient comes first
    slots = np.empty((surfel.size, SLOT), np.float32)
    across = -(-width // TILE)
    planes = 9 if geometry else 4
    for worker in numba.prange(workers):
        # Per pixel: upstream gradients (as the image's planes), T (negative where ended), Q, sums in front and in all.
        v = np.empty((planes, TILE, TILE), np.float32)
        transmittance, rest = np.empty((TILE, TILE), np.float32), np.empty((TILE, TILE), np.float32)
        front, a_total, d_total = (
            np.empty((TILE, TILE), np.float32),
            np.empty((TILE, TILE), np.float32),
            np.empty((TILE, TILE), np.float32),
        )
        for k in range(worker, order.size, workers):
            t = order[k]
            left, top = (t % across) * TILE, (t // across) * TILE
            right, bottom = min(left + TILE, width), min(top + TILE, height)
            for y in range(top, bottom):
                for x in range(left, right):
                    b, a = y - top, x - left
                    transmittance[b, a] = ONE
                    v[0, b, a] = ZERO if first else upstream[0, y, x]
                    total = v[0, b, a] * (ONE - image[0, y, x])
                    for plane in range(1, planes):
                        v[plane, b, a] = upstream[plane - first, y, x]
                        behind = background if plane < DEPTH else ZERO
                        total += v[plane, b, a] * (image[plane, y, x] - behind)
                    if geometry:
                        total += upstream[8, y, x] * image[8, y, x]
                        front[b, a] = ZERO
                        a_total[b, a] = ONE - image[0, y, x]
                        d_total[b, a] = image[4, y, x]
                    rest[b, a] = total
            pixels_left = (right - left) * (bottom - top)
            for e in range(start[t], start[t + 1]):
                i, to = surfel[e], slot[e]
                if pixels_left == 0:
                    slots[to] = ZERO
                    continue
                u0, u1, v0, v1 = record[i, 2], record[i, 3], record[i, 4], record[i, 5]
                det, a3, b3 = record[i, 6], record[i, 7], record[i, 8]
                ex, ey, log_opacity = record[i, 9], record[i, 10], record[i, 11]
                red, green, blue, depth = record[i, 12], record[i, 13], record[i, 14], record[i, 15]
                nx, ny, nz = record[i, 16], record[i, 17], record[i, 18]
                gx = gy = gz = gxx = gxy = gyx = gyy = gzx = gzy = ZERO
                mx = my = g_alpha = g_red = g_green = g_blue = g_depth = g_nx = g_ny = g_nz = ZERO
                for y in range(max(box[i, 2], top), min(box[i, 3], bottom)):
                    dy = record[i, 1] + np.float32(y - box[i, 2])
                    b = y - top
                    for x in range(max(box[i, 0], left), min(box[i, 1], right)):
                        dx = record[i, 0] + np.float32(x - box[i, 0])
                        s, u, iz = intersect(dx, dy, u0, u1, v0, v1, det, a3, b3)
                        g3 = s * s + u * u
                        g2 = TWO * ((dx + ex) * (dx + ex) + (dy + ey) * (dy + ey))
                        exponent = log2_alpha(g3, g2, log_opacity)
                        a = x - left
                        before = transmittance[b, a]
                        if exponent < LOG_THRESHOLD or before <= ZERO:
                            continue
                        raw = np.exp2(exponent)
                        alpha = min(raw, cap)
                        w = before * alpha
                        after = before - w
                        if after <= END:
                            transmittance[b, a] = -before
                            pixels_left -= 1
                            continue
                        transmittance[b, a] = after
                        q = v[0, b, a] + v[1, b, a] * red + v[2, b, a] * green + v[3, b, a] * blue
                        g_red += w * v[1, b, a]
                        g_green += w * v[2, b, a]
                        g_blue += w * v[3, b, a]
                        if geometry:
                            in_front = ONE - before
                            q += v[4, b, a] * depth + v[5, b, a] * nx + v[6, b, a] * ny + v[7, b, a] * nz
                            q += v[8, b, a] * distortion_gradient(
                                depth, in_front, front[b, a], a_total[b, a], d_total[b, a]
                            )
                            front[b, a] += w * depth
                            # d distortion / d Z_i = 2 w_i (2 A_i + w_i - A)
                            g_depth += w * (v[4, b, a] + TWO * v[8, b, a] * (TWO * in_front + w - a_total[b, a]))
                            g_nx += w * v[5, b, a]
                            g_ny += w * v[6, b, a]
                            g_nz += w * v[7, b, a]
                        behind = rest[b, a] - w * q
                        rest[b, a] = behind
                        if raw > cap:
                            continue
                        g = alpha * (before * q - behind / (ONE - alpha))
                        g_alpha += g
                        if g3 < g2:
                            c = g * iz
                            zx, zy, zz = -c * s, -c * u, c * g3
                            gx += zx
                            gy += zy
                            gz += zz
                            gxx += zx * dx
                            gxy += zx * dy
                            gyx += zy * dx
                            gyy += zy * dy
                            gzx += zz * dx
                            gzy += zz * dy
                        else:
                            mx -= TWO * g * (dx + ex)
                            my -= TWO * g * (dy + ey)
                row = slots[to]
                row[0], row[1], row[2], row[3], row[4], row[5] = gx, gy, gz, gxx, gxy, gyx
                row[6], row[7], row[8], row[9], row[10], row[11] = gyy, gzx, gzy, mx, my, g_alpha
                row[12], row[13], row[14], row[15] = g_red, g_green, g_blue, g_depth
                row[16], row[17], row[18], row[19] = g_nx, g_ny, g_nz, ZERO
    return slots
