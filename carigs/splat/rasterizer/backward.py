"""Gradient of the compositing in scalar loops: the readable reference of `backward_simd` (`backend="scalar"`).

Notation as in `forward`; v_c, v_a, v_x are the given derivatives of the loss with respect to a pixel's colour, depth
and normal (c), alpha and distortion. With f_ic the seven features (colour, depth, normal) of surfel i,

    q_i = dL/dw_i = sum_c v_c f_ic + v_a + v_x d distortion/dw_i         (weights taken as independent)
    d distortion / dw_i = 2 (2 (Z_i A_i - D_i) + D - Z_i A)              A, D: sums of w and w Z over all surfels
    dL/dalpha_i = T_i q_i - S_i / (1 - alpha_i),   S_i = sum_(j>i) w_j q_j

Q = sum_j w_j q_j of a pixel follows from its outputs, because colour, depth, normal and alpha are homogeneous of degree
1 in the weights and the distortion of degree 2: Q = sum_c v_c output_c + v_a alpha + 2 v_x distortion. Therefore the
lists are traversed front to back, as in the forward pass, with S_i = Q - sum_(j<=i) w_j q_j in one number per pixel.

Features: dL/df_ic = w_i v_c; for the depth also through the distortion, d distortion/dZ_i = 2 w_i (2 A_i + w_i - A).

Geometry: let a = alpha dL/dalpha = dL/dln(alpha), 0 where the cap holds. Then dL/dln(opacity) = a and dL/dG = -a / 2.
With s = zx / zz and t = zy / zz,

    dL/dzx = -a s / zz,   dL/dzy = -a t / zz,   dL/dzz = a (s^2 + t^2) / zz
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32

from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.tuples import add, multiply, outer, write_row
from carigs.simd.vectors import FASTMATH
from carigs.splat.rasterizer import forward, records
from carigs.splat.rasterizer.binning import TILE_SIZE, TileLists
from carigs.splat.rasterizer.forward import LOG2_ALPHA_THRESHOLD, MIN_TRANSMITTANCE, ONE, TWO, ZERO
from carigs.splat.rasterizer.records import PLANE


@numba.njit
def _distortion_gradient(depth, a, d, a_total, d_total):
    """D distortion / dw_i = 2 (2 (Z_i A_i - D_i) + D - Z_i A)."""
    return TWO * (TWO * (depth * a - d) + d_total - depth * a_total)


@kernel(parallel=True, fastmath=FASTMATH)
def composite_backward(
    projected: records.ProjectedSurfels,
    lists: TileLists,
    compositing: records.Compositing,
    image: Float32[np.ndarray, "planes h w"],
    upstream: Float32[np.ndarray, "upstream_planes h w"],
    workers: int,
) -> Float32[np.ndarray, "pairs 17"]:
    """Gradient of `forward.composite` (scalar reference).

    Every slot is written once, by one worker: the result needs no atomics and does not depend on the number of threads.

    Args:
        projected: Records and pixel boxes.
        lists: Depth-sorted surfels of every tile.
        compositing: Image size and constants.
        image: Planes that `composite` returned.
        upstream: Gradients of the loss with respect to the first planes, as many as `records` names, the first one with
            respect to alpha = 1 - T; or with respect to the colours alone (3 planes).
        workers: Number of threads that share the tiles.

    Returns:
        Gradient slots: sums over the pixels of each (surfel, tile) pair, see `records`.
    """
    record, box, _ = projected
    surfel_of, slot_of, start, order = lists.surfel, lists.slot, lists.start, lists.order
    width, height, cap, background = compositing
    first = PLANE.red if len(upstream) == 3 else PLANE.transmittance  # plane of the image that upstream begins with
    num_planes = first + len(upstream)
    geometry, distortion = num_planes > PLANE.depth, num_planes > PLANE.distortion
    slots = np.empty((surfel_of.size, records.GRADIENT_SIZE), np.float32)
    across = -(-width // TILE_SIZE)
    for worker in numba.prange(workers):
        # Per pixel: upstream gradients, T (negative where complete), S, D_i, and the totals A and D.
        v = np.empty((num_planes, TILE_SIZE, TILE_SIZE), np.float32)
        shape = (TILE_SIZE, TILE_SIZE)
        transmittance, remainder = np.empty(shape, np.float32), np.empty(shape, np.float32)
        depth_in_front = np.empty(shape, np.float32)
        a_total, d_total = np.empty(shape, np.float32), np.empty(shape, np.float32)
        for k in range(worker, order.size, workers):
            tile = order[k]
            left, top = (tile % across) * TILE_SIZE, (tile // across) * TILE_SIZE
            right, bottom = min(left + TILE_SIZE, width), min(top + TILE_SIZE, height)
            for y in range(top, bottom):
                for x in range(left, right):
                    b, a = y - top, x - left
                    transmittance[b, a] = ONE
                    v[PLANE.transmittance, b, a] = ZERO if first else upstream[PLANE.transmittance, y, x]
                    total = v[PLANE.transmittance, b, a] * (ONE - image[PLANE.transmittance, y, x])
                    for plane in range(PLANE.red, num_planes):
                        v[plane, b, a] = upstream[plane - first, y, x]
                        behind = background if plane < PLANE.depth else ZERO
                        total += v[plane, b, a] * (image[plane, y, x] - behind)
                    if distortion:
                        total += upstream[PLANE.distortion, y, x] * image[PLANE.distortion, y, x]
                        depth_in_front[b, a] = ZERO
                        a_total[b, a] = ONE - image[PLANE.transmittance, y, x]
                        d_total[b, a] = image[PLANE.depth, y, x]
                    remainder[b, a] = total
            incomplete_pixels = (right - left) * (bottom - top)
            for e in range(start[tile], start[tile + 1]):
                i, slot = surfel_of[e], slot_of[e]
                if incomplete_pixels == 0:
                    slots[slot] = ZERO
                    continue
                surfel = records.SurfelRecord(*forward.read_record(record, i))
                colour = (surfel.red, surfel.green, surfel.blue)
                normal = (surfel.normal_x, surfel.normal_y, surfel.normal_z)
                # Sums over the pixels: see `records.GradientSlot`.
                g_alpha = g_depth = ZERO
                g_z = g_colour = g_normal = (ZERO, ZERO, ZERO)
                g_moments = (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
                for y in range(max(box[i, 2], top), min(box[i, 3], bottom)):
                    dy = surfel.dy + np.float32(y - box[i, 2])
                    b = y - top
                    for x in range(max(box[i, 0], left), min(box[i, 1], right)):
                        dx = surfel.dx + np.float32(x - box[i, 0])
                        s, t, iz = forward.intersect(dx, dy, surfel)
                        squared = s * s + t * t
                        exponent = forward.log2_alpha(squared, surfel.log2_opacity)
                        a = x - left
                        before = transmittance[b, a]
                        if not exponent >= LOG2_ALPHA_THRESHOLD or before <= ZERO:  # also NaN
                            continue
                        uncapped = np.exp2(exponent)
                        alpha = min(uncapped, cap)
                        w = before * alpha
                        after = before - w
                        if after <= MIN_TRANSMITTANCE:
                            transmittance[b, a] = -before
                            incomplete_pixels -= 1
                            continue
                        transmittance[b, a] = after
                        v_colour = (v[PLANE.red, b, a], v[PLANE.green, b, a], v[PLANE.blue, b, a])
                        q = v[PLANE.transmittance, b, a] + matrix3.dot(v_colour, colour)
                        g_colour = add(g_colour, multiply(w, v_colour))
                        if geometry:
                            v_depth = v[PLANE.depth, b, a]
                            v_normal = (v[PLANE.normal_x, b, a], v[PLANE.normal_y, b, a], v[PLANE.normal_z, b, a])
                            q += v_depth * surfel.depth + matrix3.dot(v_normal, normal)
                            g_depth += w * v_depth
                            g_normal = add(g_normal, multiply(w, v_normal))
                        if distortion:
                            in_front, v_distortion = ONE - before, v[PLANE.distortion, b, a]
                            q += v_distortion * _distortion_gradient(
                                surfel.depth, in_front, depth_in_front[b, a], a_total[b, a], d_total[b, a]
                            )
                            depth_in_front[b, a] += w * surfel.depth
                            g_depth += w * TWO * v_distortion * (TWO * in_front + w - a_total[b, a])
                        behind = remainder[b, a] - w * q
                        remainder[b, a] = behind
                        if uncapped > cap:
                            continue
                        g = alpha * (before * q - behind / (ONE - alpha))
                        g_alpha += g
                        c = g * iz
                        z = (-c * s, -c * t, c * squared)
                        g_z = add(g_z, z)
                        g_moments = add(g_moments, outer(z, (dx, dy)))
                columns = (*g_z, *g_moments, g_alpha, *g_colour, g_depth, *g_normal)
                write_row(slots, slot, columns)
    return slots
