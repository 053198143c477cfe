"""The kernels of light (Numba): which vertices a direction's light reaches, by a shadow map; new light on pixels."""

from __future__ import annotations

import numba
import numpy as np

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def light_up(found, points, faces, lifted, cosine, side, tolerance):
    """Write the cosine times the share of the four shadow-map pixels around each vertex that do not hide it.

    `points` and `lifted` (what is looked up) are x and y in pixels of the map, in [0, side], and the distance behind a
    plane before the lamp, in metres; what is more than `tolerance` behind the map is in shadow.
    """
    nearest = _nearest(points, faces, side)
    for i in range(points.shape[0]):
        found[i] = 0.0
        if cosine[i] <= 0.0:
            continue
        x, y = min(max(lifted[i, 0] - 0.5, 0.0), side - 1.001), min(max(lifted[i, 1] - 0.5, 0.0), side - 1.001)
        x0, y0 = int(x), int(y)
        lit = 0.0
        for j in range(2):
            for k in range(2):
                if lifted[i, 2] - tolerance < nearest[y0 + j, x0 + k]:
                    lit += (x - x0 if k else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
        found[i] = cosine[i] * lit


@kernel
def _nearest(points, faces, side):
    """The shadow map: the least third coordinate at each pixel centre over the triangles."""
    nearest, half = np.full((side, side), np.inf, np.float32), np.float32(0.5)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        ux, uy, vx, vy = points[j, 0] - ax, points[j, 1] - ay, points[k, 0] - ax, points[k, 1] - ay
        area = ux * vy - uy * vx
        if area < 0.0:  # heads are open at the neck: the inside hides as well
            ux, uy, vx, vy, j, k, area = vx, vy, ux, uy, k, j, -area
        if area == 0.0:
            continue
        left, right = max(int(ax + min(ux, vx, 0.0) + half), 0), min(int(ax + max(ux, vx, 0.0) + half), side)
        top, bottom = max(int(ay + min(uy, vy, 0.0) + half), 0), min(int(ay + max(uy, vy, 0.0) + half), side)
        uz, vz = (points[j, 2] - az) / area, (points[k, 2] - az) / area
        for y in range(top, bottom):
            for x in range(left, right):
                px, py = x + half - ax, y + half - ay
                of_j, of_k = px * vy - py * vx, py * ux - px * uy  # times the area
                if of_j >= 0.0 and of_k >= 0.0 and of_j + of_k <= area:
                    nearest[y, x] = min(nearest[y, x], az + of_j * uz + of_k * vz)
    return nearest


@kernel
def _lit(colour, factor):
    """An sRGB value under `factor` times the light, at most 1 (curves: `carigs.capture.images`)."""
    if colour <= np.float32(0.04045):
        light = colour / np.float32(12.92)
    else:
        light = ((colour + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    light = min(max(light * factor, np.float32(0.0)), np.float32(1.0))
    if light <= np.float32(0.0031308):
        return light * np.float32(12.92)
    return np.float32(1.055) * light ** np.float32(1 / 2.4) - np.float32(0.055)


@kernel
def relit(colour, face_image, barycentric, faces, of_vertices, except_faces):
    """Colours (h, w, 3) times the factors (v, 3) of the corners of each pixel's face, in linear light."""
    height, width = face_image.shape
    lit = colour.copy()
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0 or except_faces[f]:
                continue
            u, v, w = barycentric[y, x, 0], barycentric[y, x, 1], barycentric[y, x, 2]
            for k in range(3):
                factor = (
                    u * of_vertices[faces[f, 0], k] + v * of_vertices[faces[f, 1], k] + w * of_vertices[faces[f, 2], k]
                )
                if factor != 1.0:
                    lit[y, x, k] = _lit(colour[y, x, k], factor)
    return lit
