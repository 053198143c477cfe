"""The texture: a triangular patch of texels on every face, so that there is no seam and no unwrapping.

Yuksel et al. 2010, "Mesh colors", with a resolution per face.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8


class Atlas(NamedTuple):
    """A face of resolution r has (r+1)(r+2)/2 texels at barycentrics (i, j, r-i-j)/r, i-major from `first`."""

    first: Int[np.ndarray, "f"]
    resolution: Int[np.ndarray, "f"]
    texels: UInt8[np.ndarray, "t 4"]
    """Red, green, blue, gloss."""


def layout(lengths: Float[np.ndarray, "f"], budget: int) -> tuple[Int[np.ndarray, "f"], Int[np.ndarray, "f"], int]:
    """First texels, resolutions and number of texels (at most `budget`) for faces of the given edge lengths."""
    low, high = 1e-3, float(lengths.max()) + 1e-3
    for _ in range(40):  # bisect the texel's size
        size = np.sqrt(low * high)
        resolution = np.maximum(np.ceil(lengths / size), 1).astype(np.int64)
        if ((resolution + 1) * (resolution + 2) // 2).sum() > budget:
            low = size
        else:
            high = size
    resolution = np.maximum(np.ceil(lengths / high), 1).astype(np.int64)
    count = (resolution + 1) * (resolution + 2) // 2
    return np.cumsum(count) - count, resolution, int(count.sum())


def texel_points(corners: Float[np.ndarray, "f 3 3"], resolution: Int[np.ndarray, "f"]) -> Float[np.ndarray, "t 3"]:
    """Where the texels lie on the faces, in their order."""
    points = np.empty((int(((resolution + 1) * (resolution + 2) // 2).sum()), 3), np.float32)
    count = (resolution + 1) * (resolution + 2) // 2
    first = np.cumsum(count) - count
    for r in np.unique(resolution):
        i, j = np.nonzero(np.add.outer(np.arange(r + 1), np.arange(r + 1)) <= r)
        weights = np.stack([i, j, r - i - j], axis=1) / r
        faces = np.flatnonzero(resolution == r)
        points[first[faces][:, None] + np.arange(len(i))] = weights @ corners[faces]
    return points
