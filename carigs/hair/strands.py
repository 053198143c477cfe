"""Directions of strands in the hair, from the orientation of the images' structure in several views.

A strand that a camera shows lies in the plane through the camera's centre and the line that it draws in the image. The
direction that lies in the planes of all views best is the eigenvector of the least eigenvalue of the sum of n n^T over
their normals n.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.ndimage import gaussian_filter

from carigs.hair.hull import Voxels
from carigs.hair.views import HairView, scalp_motion
from carigs.hair.visible_voxels import visible_voxels

FINE, COARSE = 0.7, 1.5
"""Standard deviations in pixels between which structure is looked for: coarser is the outline of the hair."""
WINDOW = 2.0
"""Standard deviation in pixels of the window over which the orientation of structure is averaged."""
SMOOTHING = 0.006
"""The same in space, in metres: locks are smooth, and single views are noisy."""


class Strands(NamedTuple):
    """Strands in the voxels of a hair volume, in the axes of the canonical head."""

    direction: Float32[np.ndarray, "n 3"]
    """Unit vectors along the strands; their sign has no meaning."""
    confidence: Float32[np.ndarray, " n"]
    """1 where the planes of all views meet in one line, 0 where no direction fits better than another."""
    facing: Float32[np.ndarray, "n 3"]
    """Unit vectors to the middle of the cameras that see the voxel; 0 where none does."""


def strand_directions(
    volume: Voxels, views: Sequence[HairView], canonical: Float[np.ndarray, "v 3"], carrier: Int[np.ndarray, " c"]
) -> Strands:
    """Find the directions of the strands.

    Args:
        volume: The hair.
        views: Frames.
        canonical: Vertices of the neutral head in metres.
        carrier: Vertices of the scalp.

    Returns:
        The strands of each voxel.
    """
    n = len(volume.centres)
    tensor, facing = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for view in views if n else ():
        camera, transform = view.visibility.camera, scalp_motion(canonical, view.visibility, carrier)
        shown = visible_voxels(volume, view, transform)
        x, y, coherence = (image[shown.row, shown.column] for image in orientation(view.image))
        # The line x (u' - u) + y (v' - v) = 0 in the image is the plane n . p = 0 in camera axes.
        u, v = shown.column + 0.5 - camera.cx, shown.row + 0.5 - camera.cy
        normal = _normalized(np.stack([x * camera.fx, y * camera.fy, -(x * u + y * v)], axis=1)) @ transform[:, :3]
        tensor[shown.voxel] += coherence[:, None, None] ** 2 * normal[:, :, None] * normal[:, None, :]
        centre = -transform[:, :3].T @ transform[:, 3]
        facing[shown.voxel] += _normalized(centre - volume.centres[shown.voxel])
    values, vectors = np.linalg.eigh(_smoothed(volume, tensor))
    confidence = (values[:, 1] - values[:, 0]) / np.maximum(values[:, 1] + values[:, 0], 1e-12)
    return Strands(
        vectors[:, :, 0].astype(np.float32), confidence.clip(0, 1).astype(np.float32),
        _normalized(facing).astype(np.float32),
    )  # fmt: skip


def orientation(
    image: Float[np.ndarray, "h w 3"],
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Orientation of the fine structure of an image, by the structure tensor (Bigun and Granlund 1987).

    Args:
        image: Colours.

    Returns:
        Unit vector across the lines of the structure (x and y, of either sign), and coherence: 1 for parallel lines,
        0 where all directions are equal.
    """
    grey = (image[..., 0] + image[..., 1] + image[..., 2]) / 3  # several times faster than image.mean(axis=2)
    fine = cv2.GaussianBlur(grey, (0, 0), FINE) - cv2.GaussianBlur(grey, (0, 0), COARSE)
    x, y = cv2.Scharr(fine, cv2.CV_32F, 1, 0), cv2.Scharr(fine, cv2.CV_32F, 0, 1)
    xx, yy, xy = (cv2.GaussianBlur(product, (0, 0), WINDOW) for product in (x * x, y * y, x * y))
    coherence = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-8)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    return np.cos(angle), np.sin(angle), coherence


def _smoothed(volume: Voxels, tensor: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Average over the neighbouring voxels, weighted by a Gaussian."""
    if len(tensor) == 0:
        return tensor
    cell = tuple(np.round((volume.centres - volume.centres.min(axis=0)) / volume.size).astype(int).T)
    grid, result = np.zeros([int(index.max()) + 1 for index in cell], np.float32), np.empty_like(tensor)
    for i, j in zip(*np.triu_indices(3), strict=True):
        grid[cell] = tensor[:, i, j]
        result[:, i, j] = result[:, j, i] = gaussian_filter(grid, SMOOTHING / volume.size, truncate=2)[cell]
    return result


def _normalized(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
