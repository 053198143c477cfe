"""Deferred shading: texture, light and gloss at every sample, box-filtered to pixels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from carigs.capture.images import to_linear, to_srgb
from carigs.simd.kernels import kernel
from carigs.simd.matrix3 import dot

LINEAR_FROM_SRGB = to_linear(np.arange(256) / 255).astype(np.float32)
"""Linear value of each 8-bit sRGB level."""
SRGB_FROM_LINEAR = to_srgb(np.arange(4097) / 4096).astype(np.float32)
"""sRGB value of linear values in steps of 1/4096."""


def ambient_by_channel(visibility: Float32[np.ndarray, " v"]) -> Float32[np.ndarray, "v 4"]:
    """Ambient light by colour channel; interreflection makes it redder in folds of the skin.

    Args:
        visibility: Ambient visibility of each vertex, in [0, 1].

    Returns:
        Share of ambient light in red, green and blue, and the visibility itself.
    """
    return np.stack([visibility**power for power in (0.80, 1.05, 1.15, 1.0)], axis=1).astype(np.float32)


SHADOW_BIAS, SHADOW_RAMP = 0.0025, 0.003
"""Distance in metres behind the shadow map at which a point begins to be in shadow, and from there to full shadow. A
ramp avoids hard edges where a surface shadows itself."""


def shadow_bounds(shadow: Float[np.ndarray, "s s"]) -> Float[np.ndarray, "2 b b"]:
    """Least and largest depth under the filter of the shadow map: most points are lit, or dark, under all of it.

    Args:
        shadow: Shadow map.

    Returns:
        Least and largest depth of the 4 x 4 pixels from each pixel on.
    """
    bounds = []
    for bound in (np.minimum, np.maximum):
        rows = bound.reduce([shadow[k : len(shadow) - 3 + k] for k in range(4)])
        bounds.append(bound.reduce([rows[:, k : len(shadow) - 3 + k] for k in range(4)]))
    return np.stack(bounds)


@kernel
def _shadow_factor(shadow, bounds, pixel_from_world, point):
    """Share of the key light that reaches a point: percentage-closer filtering of a shadow map with a tent filter."""
    p = pixel_from_world
    depth = dot(p[2], point) + p[2, 3]
    u, v = (dot(p[0], point) + p[0, 3]) / depth - 0.5, (dot(p[1], point) + p[1, 3]) / depth - 0.5
    i, j = int(np.floor(u)), int(np.floor(v))
    if i < 1 or j < 1 or i + 2 >= shadow.shape[1] or j + 2 >= shadow.shape[0]:
        return 1.0
    if depth - bounds[0, j - 1, i - 1] <= SHADOW_BIAS:
        return 1.0
    if depth - bounds[1, j - 1, i - 1] >= SHADOW_BIAS + SHADOW_RAMP:
        return 0.0
    fu, fv = u - i, v - j
    total = 0.0
    weights = 0.0
    for b in range(-1, 3):
        wb = 2.0 - abs(b - fv)
        for a in range(-1, 3):
            w = (2.0 - abs(a - fu)) * wb
            weights += w
            behind = (depth - shadow[j + b, i + a] - SHADOW_BIAS) / SHADOW_RAMP
            total += w * (1.0 - min(max(behind, 0.0), 1.0))
    return total / weights


@kernel
def shadow_factors(shadow, bounds, pixel_from_world, points):
    """Share of the key light that reaches points.

    Args:
        shadow: Depth map seen from the key light.
        bounds: Its `shadow_bounds`.
        pixel_from_world: Projection of world points into the shadow map, (3, 4).
        points: World positions, (n, 3).

    Returns:
        Shares in [0, 1], (n,).
    """
    lit = np.empty(len(points))
    for i in range(len(points)):
        lit[i] = _shadow_factor(shadow, bounds, pixel_from_world, (points[i, 0], points[i, 1], points[i, 2]))
    return lit


@kernel
def _unit(a):
    scale = 1.0 / np.sqrt(dot(a, a) + 1e-20)
    return a[0] * scale, a[1] * scale, a[2] * scale


@kernel
def _interpolated(values, corner, weight, k):
    return dot(weight, (values[corner[0], k], values[corner[1], k], values[corner[2], k]))


@kernel
def _interpolated3(values, corner, weight):
    x, y = _interpolated(values, corner, weight, 0), _interpolated(values, corner, weight, 1)
    return x, y, _interpolated(values, corner, weight, 2)


@kernel
def _texel_triangle(first, n, weight):
    """The three texels around a point of a face of resolution `n`, and their weights (see `atlas`)."""
    i, j = min(int(weight[0] * n), n - 1), min(int(weight[1] * n), n - 1)
    while i + j > n - 1:
        i, j = (i - 1, j) if i > j else (i, j - 1)
    fi, fj = weight[0] * n - i, weight[1] * n - j
    row = first + i * (n + 1) - i * (i - 1) // 2
    below = row + n + 1 - i
    if fi + fj > 1.0 and i + j < n - 1:
        return (below + j + 1, below + j, row + j + 1), (fi + fj - 1.0, 1.0 - fj, 1.0 - fi)
    return (row + j, below + j, row + j + 1), (1.0 - fi - fj, fi, fj)


@kernel
def shade(
    face_image, weight_image, faces, n_textured, positions, normals, ambient, first, resolution, texels, vertex_colours,
    eye, light, shadow, bounds, shadow_from_world, samples, linear, stored,
):  # fmt: skip
    """Shade rasterised fragments and average them over the pixels, on a white background.

    Faces below `n_textured` are lit here, the others have lit vertex colours. Lengths are in metres.

    Args:
        face_image: Face seen at each sample, -1 for background, (h * samples, w * samples).
        weight_image: Barycentric coordinates of each sample, (h * samples, w * samples, 3).
        faces: Vertex indices of all faces, (f, 3).
        n_textured: Number of textured faces.
        positions: World positions of the vertices, (v, 3).
        normals: Unit normals of the vertices of textured faces, (n, 3).
        ambient: Their ambient light, from `ambient_by_channel`, (n, 4).
        first: First texel of each textured face (see `Atlas`).
        resolution: Resolution of each textured face.
        texels: Texture, (t, 4) uint8.
        vertex_colours: Linear colours of the vertices that follow those of textured faces, (v - n, 3).
        eye: World position of the camera, (3,).
        light: `StudioLight.coefficients`, (8, 3).
        shadow: Depth map seen from the key light.
        bounds: Its `shadow_bounds`.
        shadow_from_world: Projection of world points into the shadow map, (3, 4).
        samples: Samples per pixel and axis.
        linear: Linear value of each 8-bit sRGB level, (256,).
        stored: sRGB value of linear values in steps of 1/4096, (4097,).

    Returns:
        Colours as sRGB values (h, w, 3) and coverage (h, w), float32.
    """
    height, width, count = face_image.shape[0] // samples, face_image.shape[1] // samples, samples * samples
    colour, alpha = np.full((height, width, 3), float(count)), np.zeros((height, width))  # a white background
    n_vertices = len(normals)
    key, axis = (light[0, 0], light[0, 1], light[0, 2]), (light[6, 0], light[6, 1], light[6, 2])
    wrap = (0.34, 0.20, 0.15)  # wrap lighting stands for subsurface scattering, which is strongest in red
    value = np.empty(3)
    for y in range(height * samples):
        for x in range(width * samples):
            f = face_image[y, x]
            if f < 0:
                continue
            row, column = y // samples, x // samples
            alpha[row, column] += 1.0
            corner = (faces[f, 0], faces[f, 1], faces[f, 2])
            weight = (weight_image[y, x, 0], weight_image[y, x, 1], weight_image[y, x, 2])
            if f >= n_textured:
                corner = (corner[0] - n_vertices, corner[1] - n_vertices, corner[2] - n_vertices)
                value[0], value[1], value[2] = _interpolated3(vertex_colours, corner, weight)
            else:
                t, share = _texel_triangle(first[f], resolution[f], weight)
                gloss = _interpolated(texels, t, share, 3) / 255.0
                n, point = _unit(_interpolated3(normals, corner, weight)), _interpolated3(positions, corner, weight)
                view = _unit((eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]))
                toward, facing = dot(n, key), max(dot(n, view), 0.0)
                visible = _interpolated(ambient, corner, weight, 3)
                above = (point[0] + 0.0015 * n[0], point[1] + 0.0015 * n[1], point[2] + 0.0015 * n[2])
                lit = _shadow_factor(shadow, bounds, shadow_from_world, above) if toward > -0.35 else 0.0
                half = (key[0] + view[0], key[1] + view[1], key[2] + view[2])
                specular = max(dot(n, half) / np.sqrt(dot(half, half)), 0.0)
                if gloss > 0.22:  # the wet surface of the eye
                    shine = 9.0 * gloss * specular**420.0 * (lit > 0.3) + 0.03 * visible
                else:
                    reflected = 2.4 * specular**20 * lit * np.sqrt(max(toward, 0.0))
                    shine = gloss * (reflected + (0.25 + 2.2 * (1.0 - facing) ** 4) * visible * 0.5)
                front = dot(axis, n) ** 2 - 1.0 / 3.0
                for k in range(3):
                    albedo = dot(share, (linear[texels[t[0], k]], linear[texels[t[1], k]], linear[texels[t[2], k]]))
                    diffuse = max((toward + wrap[k]) / (1.0 + wrap[k]), 0.0)
                    soft = lit if k > 0 else lit + 0.12 * lit * (1.0 - lit)
                    irradiance = light[2, k] + light[3, k] * n[0] + light[4, k] * n[1] + light[5, k] * n[2]
                    irradiance += light[7, k] * front
                    irradiance *= _interpolated(ambient, corner, weight, k)
                    irradiance += light[1, k] * diffuse * soft * (0.35 + 0.65 * visible)
                    value[k] = irradiance * albedo + shine * light[1, k]
            for k in range(3):
                colour[row, column, k] += stored[int(min(max(value[k], 0.0), 1.0) * 4096.0)] - 1.0
    return (colour / count).astype(np.float32), (alpha / count).astype(np.float32)
