"""Numba kernel: what the views say about the opacity at points of space."""

from __future__ import annotations

from numba import njit

from carigs.simd.kernels import INLINE, kernel, parallel_for

OPACITY_BINS = 16
"""Bins of a histogram of opacities in [0, 1]."""
PART = 4096


@njit(**INLINE)
def _carve_part(part, points, transform, intrinsics, opacity, inverse_depth, margin, histograms):
    fx, fy, cx, cy = intrinsics
    height, width = opacity.shape
    for i in range(part * PART, min((part + 1) * PART, len(points))):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = transform[2, 0] * x + transform[2, 1] * y + transform[2, 2] * z + transform[2, 3]
        if depth <= 0.01:
            continue
        u = fx * (transform[0, 0] * x + transform[0, 1] * y + transform[0, 2] * z + transform[0, 3]) / depth + cx
        v = fy * (transform[1, 0] * x + transform[1, 1] * y + transform[1, 2] * z + transform[1, 3]) / depth + cy
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        column, row = int(u), int(v)
        if (depth + margin) * inverse_depth[row, column] > 1.0:
            continue  # behind the mesh
        value = min(int(opacity[row, column] * OPACITY_BINS), OPACITY_BINS - 1)
        histograms[i, value] += 1


@kernel
def add_view(histograms, points, transform, intrinsics, opacity, inverse_depth, margin):
    """Add the opacity of a view at each point that the mesh does not hide to the point's histogram.

    Args:
        histograms: Counts (n, OPACITY_BINS), changed in place.
        points: Points (n, 3).
        transform: Camera axes from the points' (3, 4).
        intrinsics: fx, fy, cx, cy in pixels.
        opacity: Opacity of what stands in front of the mesh (h, w).
        inverse_depth: Of the mesh (h, w), in 1/metres; 0 where there is none.
        margin: Least distance in front of the mesh, in metres.
    """
    parallel_for(
        _carve_part, (len(points) + PART - 1) // PART,
        (points, transform, intrinsics, opacity, inverse_depth, margin, histograms),
    )  # fmt: skip
