"""Projection of surfels to image space and its gradient (Numba).

A surfel `m + s u + t v` (camera space: centre m = (X, Y, Z), tangents u and v) projects through a pinhole as a
homography of its disc coordinates (s, t). Relative to the projected centre pc = (fx X/Z + cx, fy Y/Z + cy) it has
eight parameters (pc_x, pc_y, U0, U1, V0, V1, p, q):

    p  = u_z / Z                             q  = v_z / Z
    U0 = fx (u_x / Z - X/Z p)                U1 = fx (v_x / Z - X/Z q)
    V0 = fy (u_y / Z - Y/Z p)                V1 = fy (v_y / Z - Y/Z q)
    dx = (U0 s + U1 t) / (1 + p s + q t)     dy = (V0 s + V1 t) / (1 + p s + q t)     (dx, dy) = pixel - pc

The ray through a pixel meets the disc at the inverse of the homography (Cramer's rule):

    zx = V1 dx - U1 dy,    zy = U0 dy - V0 dx,    zz = det + a3 dx + b3 dy,    s = zx / zz,    t = zy / zz
    det = U0 V1 - U1 V0,   a3 = V0 q - V1 p,      b3 = U1 p - U0 q

This is the ray-splat intersection of 2D Gaussian Splatting (Huang et al. 2024, eq. 8-10). The cross product of two
planes in absolute pixel coordinates, which that paper uses, cancels in float32; offsets from the projected centre do
not.

The low-pass filter of that paper (eq. 11), which draws no surfel narrower than a disc of standard deviation 1/sqrt(2)
pixels, is left out: it widens outlines, and the more the smaller the image.

All arithmetic is in float64, on tuples of scalars in the loops of this module or of vectors in `projection_simd`.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32

from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.tuples import add, componentwise, multiply, read_row, subtract, write_row
from carigs.simd.vector_math import absolute, floor, log2, maximum, minimum, select, sqrt
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rasterizer import records
from carigs.splat.rasterizer.binning import TILE_SIZE
from carigs.splat.rasterizer.records import (
    ALPHA_THRESHOLD,
    CAMERA_PLANE_MARGIN,
    MAX_SQUARED_LENGTH,
    MIN_AREA,
    NEAR_PLANE,
)

BOX_MARGIN = 1e-3
"""Pixels by which boxes are enlarged against rounding."""
LN2, LOG2_255 = float(np.log(2)), float(np.log2(255))
TILE_WIDTH = float(TILE_SIZE)
_doubles, _select = componentwise(np.float64), componentwise(select)
_read3, _read_slot = read_row(3), read_row(len(records.GRADIENT_COLUMN))


@scalar_or_simd
def _to_camera(camera, centre, tangent_u, tangent_v):
    """Centre and tangents in camera space."""
    m = add(matrix3.apply(camera.rotation, centre), camera.translation)
    return m, matrix3.apply(camera.rotation, tangent_u), matrix3.apply(camera.rotation, tangent_v)


@scalar_or_simd
def _homography(m, u, v, fx, fy):
    """(X/Z, Y/Z, U0, U1, V0, V1, p, q) of a disc in camera space."""
    iz = 1.0 / m[2]
    xh, yh, p, q = m[0] * iz, m[1] * iz, u[2] * iz, v[2] * iz
    u0, u1 = fx * (u[0] * iz - xh * p), fx * (v[0] * iz - xh * q)
    v0, v1 = fy * (u[1] * iz - yh * p), fy * (v[1] * iz - yh * q)
    return xh, yh, u0, u1, v0, v1, p, q


@scalar_or_simd
def _facing_normal(m, u, v):
    """Unit normal n = sign (u x v) / |u x v| with n . m <= 0, the area |u x v|, and the sign."""
    n = matrix3.cross(u, v)
    area = sqrt(matrix3.dot(n, n))
    sign = select(matrix3.dot(n, m) > 0.0, -1.0, 1.0)
    return multiply(n, sign / area), area, sign


@scalar_or_simd
def _extent(a, b, p, q, rho2):
    """Range of offsets along one axis where alpha may reach 1/255.

    The projected circle s^2 + t^2 = rho2 touches the line at offset c where c^2 E - 2 c rho2 N + rho2 (a^2 + b^2) = 0,
    N = a p + b q, E = rho2 (p^2 + q^2) - 1.
    """
    e = rho2 * (p * p + q * q) - 1.0
    middle = rho2 * (a * p + b * q) / e
    half = sqrt(maximum(middle * middle - rho2 * (a * a + b * b) / e, 0.0))
    return middle - half, middle + half


@scalar_or_simd
def _pixel_range(low, high, size):
    """Half-open range of the pixels with centres in [low, high] and in the image."""
    first = -floor(-maximum(low - 0.5 - BOX_MARGIN, 0.0))
    return first, floor(minimum(high - 0.5 + BOX_MARGIN, size - 1.0)) + 1.0


@scalar_or_simd
def surfel_record(centre, tangent_u, tangent_v, opacity, colour_magnitude, camera):
    """Project one surfel, or one per lane.

    alpha >= 1/255 where s^2 + t^2 <= rho2 = 2 ln(255 opacity), which gives the box.

    Args:
        centre: Three numbers or vectors, float64, world space.
        tangent_u: First tangent.
        tangent_v: Second tangent.
        opacity: Opacity in [0, 1].
        colour_magnitude: Any number that is finite exactly if the colour is.
        camera: `Pinhole`.

    Returns:
        Box (x0, x1, y0, y1); number of tiles, 0 if culled; record without the colour (columns 0-9 and 13-16).
    """
    m, u, v = _to_camera(camera, centre, tangent_u, tangent_v)
    xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, camera.fx, camera.fy)
    log2_opacity = log2(opacity)
    rho2 = 2.0 * LN2 * (log2_opacity + LOG2_255)
    normal, area, _ = _facing_normal(m, u, v)
    pcx, pcy = camera.fx * xh + camera.cx, camera.fy * yh + camera.cy
    low_x, high_x = _extent(u0, u1, p, q, rho2)
    low_y, high_y = _extent(v0, v1, p, q, rho2)
    x0, x1 = _pixel_range(pcx + low_x, pcx + high_x, camera.width)
    y0, y1 = _pixel_range(pcy + low_y, pcy + high_y, camera.height)
    squared_length = matrix3.dot(m, m) + matrix3.dot(u, u) + matrix3.dot(v, v)
    visible = (squared_length < MAX_SQUARED_LENGTH) & (opacity + colour_magnitude < np.inf) & (area > MIN_AREA)
    visible = visible & (m[2] > NEAR_PLANE) & (opacity >= ALPHA_THRESHOLD)
    visible = visible & (rho2 * (p * p + q * q) - 1.0 < CAMERA_PLANE_MARGIN)
    visible = visible & (x1 > x0) & (y1 > y0)
    across = floor((x1 - 1.0) / TILE_WIDTH) - floor(x0 / TILE_WIDTH) + 1.0
    down = floor((y1 - 1.0) / TILE_WIDTH) - floor(y0 / TILE_WIDTH) + 1.0
    box = _select(visible, (x0, x1, y0, y1), 0.0)
    record = (
        x0 + 0.5 - pcx, y0 + 0.5 - pcy, u0, u1, v0, v1, u0 * v1 - u1 * v0, v0 * q - v1 * p, u1 * p - u0 * q,
        log2_opacity, m[2], normal[0], normal[1], normal[2],
    )  # fmt: skip
    return box, select(visible, across * down, 0.0), record


@scalar_or_simd
def _homography_gradient(g, u0, u1, v0, v1, p, q):
    """Derivatives with respect to (pc_x, pc_y, U0, U1, V0, V1, p, q) from a sum of gradient slots.

    zx, zy and zz are linear in the pixel offset. The sums over pixels of their derivatives, and of
    those times dx and dy, therefore suffice; for example dL/dU0 = sum dL/dzy dy + dL/dzz (V1 - q dy).
    """
    a3, b3 = v0 * q - v1 * p, u1 * p - u0 * q
    d_u0 = g.zy_dy + g.zz * v1 - g.zz_dy * q
    d_u1 = -g.zx_dy - g.zz * v0 + g.zz_dy * p
    d_v0 = -g.zy_dx - g.zz * u1 + g.zz_dx * q
    d_v1 = g.zx_dx + g.zz * u0 - g.zz_dx * p
    d_p = -g.zz_dx * v1 + g.zz_dy * u1
    d_q = g.zz_dx * v0 - g.zz_dy * u0
    d_pcx = -(g.zx * v1 - g.zy * v0 + g.zz * a3)
    d_pcy = -(-g.zx * u1 + g.zy * u0 + g.zz * b3)
    return d_pcx, d_pcy, d_u0, d_u1, d_v0, d_v1, d_p, d_q


@scalar_or_simd
def _disc_gradient(d, d_depth, m, u, v, xh, yh, p, q, fx, fy):
    """Chain rule of `_homography` and of the centre's depth: derivatives with respect to (m, u, v) in camera space."""
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
    """Chain rule of n = sign (u x v) / |u x v|: c = sign (I - n n^T) d_n / |u x v|; d_u = v x c, d_v = c x u."""
    along = matrix3.dot(n, d_n)
    c = multiply(subtract(d_n, multiply(along, n)), sign / area)
    return matrix3.cross(v, c), matrix3.cross(c, u)


@scalar_or_simd
def surfel_gradients(g, centre, tangent_u, tangent_v, camera):
    """Gradients of one surfel, or of one per lane, from the sum of its gradient slots.

    Args:
        g: `GradientSlot`, the sum of the surfel's slots.
        centre: Three numbers or vectors, float64, world space.
        tangent_u: First tangent.
        tangent_v: Second tangent.
        camera: `Pinhole`.

    Returns:
        Gradients with respect to centre, tangent_u, tangent_v (three numbers each) and the projected centre (two).
    """
    m, u, v = _to_camera(camera, centre, tangent_u, tangent_v)
    xh, yh, u0, u1, v0, v1, p, q = _homography(m, u, v, camera.fx, camera.fy)
    d = _homography_gradient(g, u0, u1, v0, v1, p, q)
    d_m, d_u, d_v = _disc_gradient(d, g.depth, m, u, v, xh, yh, p, q, camera.fx, camera.fy)
    n, area, sign = _facing_normal(m, u, v)
    normal_u, normal_v = _normal_gradient((g.normal_x, g.normal_y, g.normal_z), n, area, sign, u, v)
    return (
        matrix3.apply_transposed(camera.rotation, d_m),
        matrix3.apply_transposed(camera.rotation, add(d_u, normal_u)),
        matrix3.apply_transposed(camera.rotation, add(d_v, normal_v)),
        (d[0], d[1]),
    )


@kernel(parallel=True)
def project_surfels(
    surfels: records.SurfelArrays, camera: records.Pinhole, background: float
) -> records.ProjectedSurfels:
    """Project surfels to records and pixel boxes (scalar reference).

    Culled are surfels with a number that is not finite, without area, nearer than NEAR_PLANE, with an opacity below
    ALPHA_THRESHOLD, crossing the camera plane within their visible extent, or outside the image.

    Args:
        surfels: Surfels in world space.
        camera: records.Pinhole camera.
        background: Grey value; records hold colours relative to it.

    Returns:
        Records, boxes and numbers of tiles.
    """
    count = surfels.centre.shape[0]
    record = np.empty((count, records.RECORD_SIZE), np.float32)
    box = np.zeros((count, 4), np.int32)
    num_tiles = np.zeros(count, np.int32)
    centre, tangent_u, tangent_v, opacity, colour = surfels
    rotation, translation, fx, fy, cx, cy, width, height = camera  # `prange` does not accept nested tuples
    for i in numba.prange(count):
        pinhole = records.Pinhole(rotation, translation, fx, fy, cx, cy, width, height)
        rgb = _read3(colour, i)
        corners, number, geometry = surfel_record(
            _doubles(_read3(centre, i)), _doubles(_read3(tangent_u, i)), _doubles(_read3(tangent_v, i)),
            np.float64(opacity[i]), absolute(rgb[0]) + absolute(rgb[1]) + absolute(rgb[2]), pinhole,
        )  # fmt: skip
        if number == 0.0:
            continue
        num_tiles[i] = int(number)
        write_row(box, i, corners)
        write_row(record, i, (*geometry[0:10], *subtract(rgb, background), *geometry[10:14]))
    return records.ProjectedSurfels(record, box, num_tiles)


@kernel(parallel=True)
def project_surfels_backward(
    slots: Float32[np.ndarray, "pairs 17"],
    first_slot: Int32[np.ndarray, " offsets"],
    surfels: records.SurfelArrays,
    camera: records.Pinhole,
) -> records.SurfelGradients:
    """Gradient of `project_surfels` (scalar reference).

    Sums each surfel's gradient slots in order, in float64, and applies the chain rule of the projection.
    dL/dopacity = dL/dln(opacity) / opacity.

    Args:
        slots: Gradient slots of all (surfel, tile) pairs, see `records`.
        first_slot: Range of each surfel's slots.
        surfels: Surfels in world space.
        camera: records.Pinhole camera.

    Returns:
        Gradients with respect to the surfels and their projected centres.
    """
    centre, tangent_u, tangent_v, opacity, _ = surfels
    count = centre.shape[0]
    d_centre, d_tangent_u = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_tangent_v, d_colour = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    d_opacity, d_projected = np.zeros(count, np.float32), np.zeros((count, 2), np.float32)
    rotation, translation, fx, fy, cx, cy, width, height = camera
    for i in numba.prange(count):
        start, stop = first_slot[i], first_slot[i + 1]
        if stop == start:
            continue
        pinhole = records.Pinhole(rotation, translation, fx, fy, cx, cy, width, height)
        sums = (0.0,) * 17
        for slot in range(start, stop):
            sums = add(sums, _read_slot(slots, slot))
        g = records.GradientSlot(*sums)
        d_m, d_u, d_v, d_p = surfel_gradients(
            g, _doubles(_read3(centre, i)), _doubles(_read3(tangent_u, i)), _doubles(_read3(tangent_v, i)), pinhole
        )
        write_row(d_centre, i, d_m)
        write_row(d_tangent_u, i, d_u)
        write_row(d_tangent_v, i, d_v)
        write_row(d_colour, i, (g.red, g.green, g.blue))
        d_opacity[i] = g.log_opacity / opacity[i]
        write_row(d_projected, i, d_p)
    return records.SurfelGradients(d_centre, d_tangent_u, d_tangent_v, d_opacity, d_colour, d_projected)
