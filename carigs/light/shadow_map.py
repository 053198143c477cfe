"""Numba kernels of light: shadow maps of distant light, and factors on the irradiance of pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from carigs.simd.kernels import INLINE, kernel

ROW, COLUMN = np.divmod(np.arange(16, dtype=np.float32), 4) + np.float32(0.5)
"""Centres of the pixels of a tile."""
INFINITY = np.float32(np.inf)


@kernel
def shadowed_cosines(transfer, points, normals, faces, axes, side, scale, bias, tolerance, cubes, thickness, width):
    """Write each vertex's cosine times its visibility from each light, and the share of the cosines that is hidden.

    Visibility is filtered over the four nearest shadow-map pixels with bilinear weights (percentage-closer filtering,
    Reeves et al. 1987).

    Args:
        transfer: Output (d + 1, v): a row for each light, and the share in the last one.
        points: Vertices (v, 3), in metres from the middle of the maps.
        normals: Unit normals (v, 3).
        faces: Vertex indices (f, 3).
        axes: Rotation to the axes of each light's map (d, 3, 3); the third axis points away from the light.
        side: Width and height of a map in pixels.
        scale: Pixels per metre.
        bias: Metres that vertices are lifted along their normals before they are looked up.
        tolerance: Points that lie more than this behind the map, in metres, are in shadow.
        cubes: Centres of the cubes that hair fills (n, 3), in metres from the middle of the maps.
        thickness: Their optical thickness (n,).
        width: Their edge in metres.
    """
    count, half = points.shape[0], np.float32(0.5) * np.float32(side)
    x_map, y_map, z_map = np.empty(count, np.float32), np.empty(count, np.float32), np.empty(count, np.float32)
    total, cosine, hidden = np.zeros(count, np.float32), np.empty(count, np.float32), transfer[axes.shape[0]]
    hidden[:] = 0.0
    passing = np.ones((side, side), np.float32)
    for d in range(axes.shape[0]):
        right, down, away = axes[d, 0], axes[d, 1], axes[d, 2]
        for i in range(count):
            x_map[i] = _dot(right, points[i]) * scale + half
            y_map[i] = _dot(down, points[i]) * scale + half
            z_map[i] = _dot(away, points[i])
            cosine[i] = max(-_dot(away, normals[i]), np.float32(0.0))
        nearest = _shadow_map(x_map, y_map, z_map, faces, side)
        if len(cubes):
            _light_through(passing, nearest, cubes, thickness, axes[d], scale, np.float32(0.5) * width * scale)
        for i in range(count):
            transfer[d, i] = 0.0
            if cosine[i] <= 0.0:
                continue
            x = x_map[i] + scale * bias * _dot(right, normals[i]) - np.float32(0.5)
            y = y_map[i] + scale * bias * _dot(down, normals[i]) - np.float32(0.5)
            depth = z_map[i] - bias * cosine[i] - tolerance
            x, y = min(max(x, np.float32(0.0)), side - 1.001), min(max(y, np.float32(0.0)), side - 1.001)
            x0, y0 = int(x), int(y)
            lit = through = 0.0
            for j in range(2):
                for k in range(2):
                    if depth < nearest[(y0 + j) >> 2, (x0 + k) >> 2, (y0 + j) % 4 * 4 + (x0 + k) % 4]:
                        weight = (x - x0 if k else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
                        lit += weight
                        through += weight * passing[y0 + j, x0 + k]
            transfer[d, i] = cosine[i] * through
            hidden[i] += cosine[i] * (1.0 - lit)
            total[i] += cosine[i]
    for i in range(count):
        hidden[i] /= max(total[i], np.float32(1e-9))


@njit(**INLINE)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _light_through(passing, nearest, cubes, thickness, axes, scale, reach):
    """Write the share of the light that passes the hair in front of the surface, at each pixel centre (side, side).

    A cube is drawn as a square that faces the light, `reach` pixels to each side. Beside the surface all light passes:
    hair behind the surface would shade its edge.
    """
    side, half = passing.shape[0], np.float32(0.5) * np.float32(passing.shape[0])
    passing[:] = 0.0
    for i in range(len(cubes)):
        x, y = _dot(axes[0], cubes[i]) * scale + half, _dot(axes[1], cubes[i]) * scale + half
        depth = _dot(axes[2], cubes[i])
        left, right = max(int(np.ceil(x - reach - 0.5)), 0), min(int(np.ceil(x + reach - 0.5)), side)
        top, bottom = max(int(np.ceil(y - reach - 0.5)), 0), min(int(np.ceil(y + reach - 0.5)), side)
        for row in range(top, bottom):
            for column in range(left, right):
                if depth < nearest[row >> 2, column >> 2, row % 4 * 4 + column % 4] < INFINITY:
                    passing[row, column] += thickness[i]
    for row in range(side):
        for column in range(side):
            passing[row, column] = np.exp(-passing[row, column])


@kernel
def _shadow_map(x, y, z, faces, side):
    """Least third coordinate over the triangles at each pixel centre, in tiles of 4 x 4 pixels (y, x, 16).

    A triangle covers a few pixels. To test all sixteen of a tile at once is faster than to visit those of its box.
    """
    tiles, half, zero, end = (side + 3) // 4, np.float32(0.5), np.float32(0.0), np.float32(side)
    nearest = np.full((tiles, tiles, 16), INFINITY, np.float32)
    count = faces.shape[0]
    left, right = np.empty(count, np.int32), np.empty(count, np.int32)
    top, bottom = np.empty(count, np.int32), np.empty(count, np.int32)
    for f in range(count):  # without branches, so that the compiler makes vectors of it
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        left[f] = np.int32(min(max(min(x[i], x[j], x[k]) + half, zero), end))
        right[f] = np.int32(min(max(max(x[i], x[j], x[k]) + half, zero), end))
        top[f] = np.int32(min(max(min(y[i], y[j], y[k]) + half, zero), end))
        bottom[f] = np.int32(min(max(max(y[i], y[j], y[k]) + half, zero), end))
    drawn, n = np.empty(count, np.int32), 0
    for f in range(count):
        drawn[n] = f
        n += (left[f] < right[f]) & (top[f] < bottom[f])
    for f in drawn[:n]:
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = x[i], y[i], z[i]
        ux, uy, vx, vy = x[j] - ax, y[j] - ay, x[k] - ax, y[k] - ay
        area = ux * vy - uy * vx
        if area == 0.0:
            continue
        sign = np.float32(np.sign(area))
        uz, vz, size = (z[j] - az) / area, (z[k] - az) / area, abs(area)
        for row in range(top[f] >> 2, (bottom[f] + 3) >> 2):
            for column in range(left[f] >> 2, (right[f] + 3) >> 2):
                x_tile, y_tile = np.float32(4 * column) - ax, np.float32(4 * row) - ay
                for pixel in range(16):
                    px, py = x_tile + COLUMN[pixel], y_tile + ROW[pixel]
                    of_j, of_k = px * vy - py * vx, py * ux - px * uy  # times the area
                    inside = (sign * of_j >= 0.0) & (sign * of_k >= 0.0) & (sign * (of_j + of_k) <= size)
                    depth = az + of_j * uz + of_k * vz if inside else INFINITY
                    nearest[row, column, pixel] = min(nearest[row, column, pixel], depth)
    return nearest


@kernel
def _multiply_srgb(colour, factor):
    """Multiply an sRGB value in linear light, clipped to 1; the curves are those of `carigs.capture.images`."""
    if colour <= np.float32(0.04045):
        light = colour / np.float32(12.92)
    else:
        light = ((colour + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    light = min(max(light * factor, np.float32(0.0)), np.float32(1.0))
    if light <= np.float32(0.0031308):
        return light * np.float32(12.92)
    return np.float32(1.055) * light ** np.float32(1 / 2.4) - np.float32(0.055)


@kernel
def multiply_irradiance(colour, face_image, barycentric, faces, factors, kept):
    """Multiply colours in linear light by factors that are interpolated over triangles.

    Args:
        colour: sRGB image (h, w, 3).
        face_image: Face per pixel (h, w), -1 where there is none.
        barycentric: Weights of the face's corners (h, w, 3).
        faces: Vertex indices (f, 3).
        factors: Factor of each vertex and channel (v, 3).
        kept: Faces whose pixels do not change (f,).

    Returns:
        sRGB image (h, w, 3).
    """
    height, width = face_image.shape
    lit = colour.copy()
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0 or kept[f]:
                continue
            u, v, w = barycentric[y, x, 0], barycentric[y, x, 1], barycentric[y, x, 2]
            for k in range(3):
                factor = u * factors[faces[f, 0], k] + v * factors[faces[f, 1], k] + w * factors[faces[f, 2], k]
                if factor != 1.0:
                    lit[y, x, k] = _multiply_srgb(colour[y, x, k], factor)
    return lit
