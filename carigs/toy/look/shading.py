"""From fragments to pixels: texture, light and gloss at every sample, box-filtered (linear light, stored as sRGB)."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32

_LEVELS = np.arange(256) / 255
LINEAR = np.where(_LEVELS <= 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Linear value of each 8-bit sRGB level."""
_FINE = np.arange(4097) / 4096
STORED = np.where(_FINE <= 0.0031308, _FINE * 12.92, 1.055 * _FINE ** (1 / 2.4) - 0.055).astype(np.float32)
"""sRGB value of linear values in steps of 1/4096."""


def bounced(exposure: Float32[np.ndarray, "v"]) -> Float32[np.ndarray, "v 4"]:
    """Ambient light by colour, and the exposure itself: what light there is in folds of skin is red."""
    return np.stack([exposure**power for power in (0.80, 1.05, 1.15, 1.0)], axis=1).astype(np.float32)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _lit(shadow, eye_light, x, y, z):
    """Share of the key light that reaches a point: a tent-filtered shadow map."""
    depth = eye_light[2, 0] * x + eye_light[2, 1] * y + eye_light[2, 2] * z + eye_light[2, 3]
    u = (eye_light[0, 0] * x + eye_light[0, 1] * y + eye_light[0, 2] * z + eye_light[0, 3]) / depth - 0.5
    v = (eye_light[1, 0] * x + eye_light[1, 1] * y + eye_light[1, 2] * z + eye_light[1, 3]) / depth - 0.5
    i, j = int(np.floor(u)), int(np.floor(v))
    if i < 1 or j < 1 or i + 2 >= shadow.shape[1] or j + 2 >= shadow.shape[0]:
        return 1.0
    fu, fv = u - i, v - j
    total = 0.0
    weights = 0.0
    for b in range(-1, 3):
        wb = 2.0 - abs(b - fv)
        for a in range(-1, 3):
            w = (2.0 - abs(a - fu)) * wb
            weights += w
            # Soft over 3 mm in depth: no hard self-shadow edge.
            behind = (depth - shadow[j + b, i + a] - 0.0025) / 0.003
            total += w * (1.0 - min(max(behind, 0.0), 1.0))
    return total / weights


@numba.njit(cache=True, error_model="numpy", nogil=True)
def shade(
    face_image,
    weight_image,
    corners,
    n_skin,
    positions,
    normals,
    exposure,
    first,
    resolution,
    texels,
    vertex_colours,
    eye,
    light,
    square,
    shadow,
    eye_light,
    samples,
    linear,
    stored,
):
    """Colour over white (h w 3) and coverage (h w) of `samples` x `samples` fragments to the pixel.

    Faces below `n_skin` are lit here from the texture, the others take the lit linear `vertex_colours`, whose rows
    begin with the first vertex that is not of the skin.  `exposure` is as from `bounced`.
    """
    height, width = face_image.shape[0] // samples, face_image.shape[1] // samples
    colour = np.empty((height, width, 3), np.float32)
    alpha = np.empty((height, width), np.float32)
    n_vertices = len(normals)
    kx, ky, kz = light[0, 0], light[0, 1], light[0, 2]
    wrap = (0.34, 0.20, 0.15)  # light creeps around edges, red the farthest: skin is translucent
    for py in range(height):
        for px in range(width):
            red = 0.0
            green = 0.0
            blue = 0.0
            covered = 0
            for s in range(samples * samples):
                sy, sx = py * samples + s // samples, px * samples + s % samples
                f = face_image[sy, sx]
                if f < 0:
                    continue
                covered += 1
                a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
                wa, wb, wc = weight_image[sy, sx, 0], weight_image[sy, sx, 1], weight_image[sy, sx, 2]
                if f >= n_skin:
                    a, b, c = a - n_vertices, b - n_vertices, c - n_vertices
                    r = wa * vertex_colours[a, 0] + wb * vertex_colours[b, 0] + wc * vertex_colours[c, 0]
                    g = wa * vertex_colours[a, 1] + wb * vertex_colours[b, 1] + wc * vertex_colours[c, 1]
                    u = wa * vertex_colours[a, 2] + wb * vertex_colours[b, 2] + wc * vertex_colours[c, 2]
                else:
                    # The texel triangle around the sample: see atlas.
                    n = resolution[f]
                    i, j = min(int(wa * n), n - 1), min(int(wb * n), n - 1)
                    while i + j > n - 1:
                        if i > j:
                            i -= 1
                        else:
                            j -= 1
                    fi, fj = wa * n - i, wb * n - j
                    upper = fi + fj > 1.0 and i + j < n - 1
                    row = first[f] + i * (n + 1) - i * (i - 1) // 2
                    below = row + n + 1 - i
                    if upper:
                        t0, t1, t2 = below + j + 1, below + j, row + j + 1
                        w0, w1, w2 = fi + fj - 1.0, 1.0 - fj, 1.0 - fi
                    else:
                        t0, t1, t2 = row + j, below + j, row + j + 1
                        w0, w1, w2 = 1.0 - fi - fj, fi, fj
                    gloss = (w0 * texels[t0, 3] + w1 * texels[t1, 3] + w2 * texels[t2, 3]) / 255.0
                    nx = wa * normals[a, 0] + wb * normals[b, 0] + wc * normals[c, 0]
                    ny = wa * normals[a, 1] + wb * normals[b, 1] + wc * normals[c, 1]
                    nz = wa * normals[a, 2] + wb * normals[b, 2] + wc * normals[c, 2]
                    norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz + 1e-20)
                    nx, ny, nz = nx * norm, ny * norm, nz * norm
                    x = wa * positions[a, 0] + wb * positions[b, 0] + wc * positions[c, 0]
                    y = wa * positions[a, 1] + wb * positions[b, 1] + wc * positions[c, 1]
                    z = wa * positions[a, 2] + wb * positions[b, 2] + wc * positions[c, 2]
                    vx, vy, vz = eye[0] - x, eye[1] - y, eye[2] - z
                    norm = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
                    vx, vy, vz = vx * norm, vy * norm, vz * norm
                    toward = nx * kx + ny * ky + nz * kz
                    facing = max(nx * vx + ny * vy + nz * vz, 0.0)
                    free = wa * exposure[a, 3] + wb * exposure[b, 3] + wc * exposure[c, 3]
                    lit = 0.0
                    if toward > -0.35:
                        lit = _lit(shadow, eye_light, x + 0.0015 * nx, y + 0.0015 * ny, z + 0.0015 * nz)
                    hx, hy, hz = kx + vx, ky + vy, kz + vz
                    half = max((nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz), 0.0)
                    rim = (1.0 - facing) * (1.0 - facing)
                    rim *= rim
                    if gloss > 0.22:  # the eye: wet
                        shine = 9.0 * gloss * half**420.0 * (lit > 0.3) + 0.03 * free
                    else:
                        half = half**4
                        half *= half**4  # its 20th power
                        shine = gloss * (2.4 * half * lit * np.sqrt(max(toward, 0.0)) + (0.25 + 2.2 * rim) * free * 0.5)
                    r = 0.0
                    g = 0.0
                    u = 0.0
                    front = light[6, 0] * nx + light[6, 1] * ny + light[6, 2] * nz
                    front = front * front - 1.0 / 3.0
                    for k in range(3):
                        albedo = w0 * linear[texels[t0, k]] + w1 * linear[texels[t1, k]] + w2 * linear[texels[t2, k]]
                        diffuse = max((toward + wrap[k]) / (1.0 + wrap[k]), 0.0)
                        soft = lit if k > 0 else lit + 0.12 * lit * (1.0 - lit)
                        value = light[2, k] + light[3, k] * nx + light[4, k] * ny + light[5, k] * nz + square[k] * front
                        value *= wa * exposure[a, k] + wb * exposure[b, k] + wc * exposure[c, k]
                        value += light[1, k] * diffuse * soft * (0.35 + 0.65 * free)
                        value *= albedo
                        value += shine * light[1, k]
                        if k == 0:
                            r = value
                        elif k == 1:
                            g = value
                        else:
                            u = value
                red += stored[int(min(max(r, 0.0), 1.0) * 4096.0)]
                green += stored[int(min(max(g, 0.0), 1.0) * 4096.0)]
                blue += stored[int(min(max(u, 0.0), 1.0) * 4096.0)]
            total = samples * samples
            white = total - covered
            alpha[py, px] = covered / total
            colour[py, px, 0] = (red + white) / total
            colour[py, px, 1] = (green + white) / total
            colour[py, px, 2] = (blue + white) / total
    return colour, alpha
