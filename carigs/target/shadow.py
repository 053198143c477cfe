"""The kernels of light (Numba): which vertices a direction's light reaches, by a shadow map; new light on pixels."""

from __future__ import annotations

import numba
import numpy as np

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def add_lit(transfer, column, points, pixel, cosine, nearness, tolerance):
    """Write the cosine times the share of the four shadow-map pixels around each vertex that do not hide it.

    `points` are in the lamp's camera axes; what is more than `tolerance` metres behind the map is in shadow.
    """
    side = nearness.shape[0]
    for i in range(points.shape[0]):
        transfer[i, column] = 0.0
        if cosine[i] <= 0.0:
            continue
        x, y = min(max(pixel[i, 0] - 0.5, 0.0), side - 1.001), min(max(pixel[i, 1] - 0.5, 0.0), side - 1.001)
        x0, y0 = int(x), int(y)
        lit = 0.0
        for j in range(2):
            for k in range(2):
                near = nearness[y0 + j, x0 + k]
                if near * (points[i, 2] - tolerance) < 1.0:  # nothing is at an inverse depth of 0
                    lit += (x - x0 if k else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
        transfer[i, column] = cosine[i] * lit


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
