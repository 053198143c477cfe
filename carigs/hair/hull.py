"""A visual hull: voxels that no view shows to be empty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from carigs.hair import carving
from carigs.hair.views import HairView, scalp_motion
from carigs.raster import Visibility

COARSE, DIVISIONS = 0.012, 3
"""Size of the voxels of the first pass in metres, and their divisions along each axis in the second."""
FINE = COARSE / DIVISIONS
MARGIN = 0.002
"""Metres in front of the mesh from which on voxels are looked for."""
QUANTILE = 0.1
"""Of the opacities over all views: some views may be wrong, by errors of tracking or matte."""
MIN_VIEWS = 4
MIN_SHARE = 0.2
"""Least share of the views that look at a point without the head in between."""
MIN_OPACITY = 0.1
"""Opacity of a voxel that belongs to the hull."""
HALF_DIAGONAL = 0.87
"""Of a cube with edges of length 1."""


class Voxels(NamedTuple):
    """Voxels of what stands off the mesh, in the axes of the canonical head."""

    centres: Float32[np.ndarray, "n 3"]
    """Metres."""
    opacity: Float32[np.ndarray, " n"]
    """In [0, 1]: a low quantile over the views."""
    size: float
    """Edge of a voxel in metres."""


class HullView(NamedTuple):
    """A view of something that moves as a solid."""

    transform: Float[np.ndarray, "3 4"]
    """Camera axes from the axes of the canonical head, by the motion of what is looked for."""
    seen: Visibility
    opacity: Float32[np.ndarray, "h w"]
    """Of what may stand in front of the mesh."""


def hull_views(
    views: Sequence[HairView],
    cover: Float32[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    carrier: Int[np.ndarray, " c"],
) -> list[HullView]:
    """Look at what moves with some vertices of the head.

    Args:
        views: Frames of several timesteps and cameras.
        cover: Opacity of what covers each triangle.
        canonical: Vertices of the subject's neutral head, in metres.
        carrier: Vertices that move with what is looked for.

    Returns:
        The views, with mattes, and on the mesh what covers it.
    """
    found = []
    for view in views:
        seen = view.visibility
        opacity = np.where(seen.face < 0, view.foreground, cover[np.maximum(seen.face, 0)]).astype(np.float32)
        found.append(HullView(scalp_motion(canonical, seen, carrier), seen, opacity))
    return found


def visual_hull(
    views: Sequence[HullView], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Find the voxels between the mesh and the cameras that all but a few views show to be filled.

    Args:
        views: Views of several timesteps and cameras.
        low: Lowest corner of the space that is looked at, in metres.
        high: Its highest corner.

    Returns:
        Centres of voxels of the size `FINE`, and their opacities, at least `MIN_OPACITY`.
    """
    axes = [np.arange(a, b, COARSE) for a, b in zip(low, high, strict=True)]
    coarse = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    kept = coarse[opacities(coarse, views, COARSE)[0] >= MIN_OPACITY]
    steps = (np.arange(DIVISIONS) + 0.5) / DIVISIONS - 0.5
    inside = COARSE * np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    fine = (kept[:, None] + inside).reshape(-1, 3)
    opacity, _ = opacities(fine, views)
    return fine[opacity >= MIN_OPACITY], opacity[opacity >= MIN_OPACITY]


def opacities(
    points: Float[np.ndarray, "n 3"], views: Sequence[HullView], size: float = 0.0
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Low quantile over the views of the opacity of what they show at points.

    Args:
        points: In the axes of the canonical head, in metres.
        views: Views of several timesteps and cameras.
        size: Edge of a cube around each point, in which the largest opacity of each view counts.

    Returns:
        Opacities, and whether enough views see the points; those that few views see have opacity 0.
    """
    histograms = np.zeros((len(points), carving.OPACITY_BINS), np.uint16)
    for transform, seen, opacity in views:
        image, inverse_depth = opacity, seen.inverse_depth
        if size > 0:
            radius = int(np.ceil(HALF_DIAGONAL * size / seen.pixel_size))
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
            image, inverse_depth = cv2.dilate(image, disc), cv2.erode(inverse_depth, disc)
        carving.add_view(
            histograms, points, transform, seen.camera.intrinsics, np.ascontiguousarray(image),
            np.ascontiguousarray(inverse_depth), MARGIN,
        )  # fmt: skip
    count = histograms.sum(axis=1)
    below = histograms.cumsum(axis=1) > np.maximum(QUANTILE * count, 0)[:, None]
    value = below.argmax(axis=1) / (carving.OPACITY_BINS - 1)
    seen_by_enough = count >= max(MIN_VIEWS, MIN_SHARE * len(views))
    return np.where(seen_by_enough, value, 0), seen_by_enough
