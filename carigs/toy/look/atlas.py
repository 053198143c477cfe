"""Texture atlas without seams: a triangular patch of texels on every face (Yuksel et al. 2010, "Mesh colors")."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8


class Atlas(NamedTuple):
    """Texels of all faces: (r+1)(r+2)/2 on a face of resolution r, at barycentrics (i, j, r-i-j)/r, i-major."""

    first: Int[np.ndarray, " f"]
    """Index of a face's first texel."""
    resolution: Int[np.ndarray, " f"]
    texels: UInt8[np.ndarray, "t 4"]
    """Red, green, blue (sRGB), gloss."""


def texel_count(resolution: Int[np.ndarray, "*f"]) -> Int[np.ndarray, "*f"]:
    """Number of texels on faces.

    Args:
        resolution: Texels along an edge, less one.

    Returns:
        Counts, one per face.
    """
    return (resolution + 1) * (resolution + 2) // 2


def allocate_texels(
    lengths: Float[np.ndarray, " f"], budget: int
) -> tuple[Int[np.ndarray, " f"], Int[np.ndarray, " f"], int]:
    """Choose the largest resolutions in proportion to edge lengths that fit into a budget.

    Args:
        lengths: Edge length of each face, in any unit.
        budget: Largest number of texels.

    Returns:
        Index of the first texel of each face, resolution of each face, total number of texels.
    """
    low, high = 1e-3, float(lengths.max()) + 1e-3
    for _ in range(40):  # bisection on the size of a texel
        size = np.sqrt(low * high)
        fits = texel_count(np.maximum(np.ceil(lengths / size), 1).astype(np.int64)).sum() <= budget
        low, high = (low, size) if fits else (size, high)
    resolution = np.maximum(np.ceil(lengths / high), 1).astype(np.int64)
    count = texel_count(resolution)
    return np.cumsum(count) - count, resolution, int(count.sum())


def texel_points(corners: Float[np.ndarray, "f 3 3"], resolution: Int[np.ndarray, " f"]) -> Float[np.ndarray, "t 3"]:
    """Positions of the texels.

    Args:
        corners: Positions of the corners of each face.
        resolution: Resolution of each face.

    Returns:
        Positions in the unit of the corners, in the order of the texels.
    """
    count = texel_count(resolution)
    first = np.cumsum(count) - count
    points = np.empty((int(count.sum()), 3), np.float32)
    for r in np.unique(resolution):
        i, j = np.nonzero(np.add.outer(np.arange(r + 1), np.arange(r + 1)) <= r)
        weights = np.stack([i, j, r - i - j], axis=1) / r
        faces = np.flatnonzero(resolution == r)
        points[first[faces][:, None] + np.arange(len(i))] = weights @ corners[faces]
    return points
