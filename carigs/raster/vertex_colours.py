"""Colours of an image at the mesh vertices that it shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64

from carigs.raster.rasterizer import Visibility

DEPTH_TOLERANCE = 0.003
"""Metres between a vertex and the surface that its pixel shows, up to which the vertex counts as visible."""
MIN_COSINE = 0.3
"""Least cosine between the normal and the direction to the camera."""


class VisibleVertices(NamedTuple):
    """The vertices that a camera sees well."""

    index: Int64[np.ndarray, " n"]
    pixels: Float64[np.ndarray, "n 2"]
    """Image positions (x, y), pixel centres at +0.5."""
    cosine: Float64[np.ndarray, " n"]
    """Between the normal and the direction to the camera."""


def visible_vertices(
    visibility: Visibility, vertices: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]
) -> VisibleVertices:
    """Vertices that face the camera and lie on the surface that their pixel shows, away from the image border.

    Args:
        visibility: What the camera sees of the mesh.
        vertices: World points in metres, the same as for `visibility`.
        normals: Unit vertex normals in world axes.

    Returns:
        Indices, image positions and cosines.
    """
    to_camera = visibility.camera.centre - vertices
    cosine = np.einsum("vk,vk->v", normals, to_camera) / np.linalg.norm(to_camera, axis=1)
    size = np.array([visibility.camera.width, visibility.camera.height])
    depth, pixels = visibility.camera_points[:, 2], visibility.pixels
    inside = (depth > 0) & (cosine > MIN_COSINE) & ((pixels > 1.5) & (pixels < size - 2.5)).all(axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(int).T
    inverse = visibility.inverse_depth[row, column]
    index = np.flatnonzero(inside & (inverse > 0) & (np.abs(inverse * depth - 1) < DEPTH_TOLERANCE * inverse))
    return VisibleVertices(index, pixels[index], cosine[index])


def sample_colours(
    image: Float32[np.ndarray, "h w 3"], pixels: Float64[np.ndarray, "n 2"]
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 2"]]:
    """Bilinear interpolation of an image, and its gradient.

    Args:
        image: Colours.
        pixels: Positions (x, y) inside the image, at least half a pixel from its border; pixel centres at +0.5.

    Returns:
        Colours, and their derivatives along x and y per pixel.
    """
    x, y = (pixels - 0.5).astype(int).T
    fx, fy = (pixels - 0.5 - np.stack([x, y], axis=1))[:, :, None].transpose(1, 0, 2)
    a, b, c, d = image[y, x], image[y, x + 1], image[y + 1, x], image[y + 1, x + 1]
    colours = (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d)
    return colours, np.stack([(1 - fy) * (b - a) + fy * (d - c), (1 - fx) * (c - a) + fx * (d - b)], axis=2)
