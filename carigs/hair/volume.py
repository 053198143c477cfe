"""The space that hair fills: a visual hull around the head, carved by the background and by skin that is seen.

A point in front of the mesh is empty if a view shows background there, or a triangle that nothing covers. What is left
is hair, or something else that stands off the mesh; where no view shows its outline, it is as thick as where one does
(`carigs.hair.measured_reach`). What does not hang together with the hair above the scalp is none: before a single
camera, the hull also holds the space in front of brows, nose, lips and stubble. Hair moves with the scalp, so views of
different timesteps agree in the axes of the canonical head, to which the scalp's rigid motion takes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import igl
import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.ndimage import label
from scipy.spatial import cKDTree

from carigs.hair import carving
from carigs.hair.bare_skin import NEAR_SKIN
from carigs.hair.covered_faces import Covering
from carigs.hair.measured_reach import within_measured_reach
from carigs.hair.views import HairView, pixel_size, scalp_motion

COARSE, DIVISIONS = 0.012, 3
"""Size of the voxels of the first pass in metres, and their divisions along each axis in the second."""
REACH = 0.25
"""Metres from the head to the end of the grid."""
MARGIN = 0.002
"""Metres in front of the mesh from which on hair is looked for."""
QUANTILE = 0.1
"""Of the opacities over all views: some views may be wrong, by errors of tracking or matte."""
MIN_VIEWS = 4
MIN_SHARE = 0.2
"""Least share of the views that look at a point without the head in between."""
MIN_OPACITY = 0.1
"""Opacity of a voxel with hair."""
HIDING = 0.02
"""Metres from hair up to which it may hide skin."""
HALF_DIAGONAL = 0.87
"""Of a cube with edges of length 1."""


class HairVolume(NamedTuple):
    """Voxels with hair, in the axes of the canonical head."""

    centres: Float32[np.ndarray, "n 3"]
    """Metres."""
    opacity: Float32[np.ndarray, " n"]
    """In [0, 1]: a low quantile over the views."""
    size: float
    """Edge of a voxel in metres."""


def carve_hair(
    views: Sequence[HairView],
    covering: Covering,
    scalp: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    limit: float = 0.03,
) -> HairVolume:
    """Find the space that hair fills.

    Args:
        views: Frames of several timesteps and cameras.
        covering: What covers the triangles.
        scalp: Triangles that carry hair, whose motion the hair follows.
        canonical: Vertices of the subject's neutral head, in metres.
        faces: Vertex indices of the triangles.
        limit: Texture of a covered triangle.

    Returns:
        Its voxels; none if nothing stands off the mesh.
    """
    carrier = np.unique(faces[scalp])
    if len(carrier) == 0:  # a head model without the region
        return HairVolume(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), COARSE / DIVISIONS)
    cover = np.where(covering.covered, 1, np.minimum(covering.texture / max(limit, 1e-9), 1)).astype(np.float32)
    prepared = []
    for view in views:
        seen = view.visibility
        opacity = np.where(seen.face < 0, view.foreground, cover[np.maximum(seen.face, 0)]).astype(np.float32)
        transform = scalp_motion(canonical, seen, carrier)
        prepared.append((transform, seen, opacity))
    low, high = canonical[carrier].min(axis=0) - REACH, canonical[carrier].max(axis=0) + REACH
    axes = [np.arange(a, b, COARSE) for a, b in zip(low, high, strict=True)]
    coarse = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    kept = coarse[_opacities(coarse, prepared, COARSE) >= MIN_OPACITY]
    steps = (np.arange(DIVISIONS) + 0.5) / DIVISIONS - 0.5
    inside = COARSE * np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    fine = (kept[:, None] + inside).reshape(-1, 3)
    opacity = _opacities(fine, prepared, 0.0)
    fine, opacity = fine[opacity >= MIN_OPACITY], opacity[opacity >= MIN_OPACITY]
    found = np.ones(len(fine), bool)
    if len(fine):
        squared, nearest, closest = igl.point_mesh_squared_distance(fine, np.asarray(canonical, np.float64), faces)
        nearest = nearest.astype(np.int64)
        found = scalp[nearest] | (cover[nearest] > 0.5) | (squared > NEAR_SKIN**2)
        looks = [(transform, seen) for transform, seen, _ in prepared]
        found &= within_measured_reach(fine, closest, nearest, COARSE / DIVISIONS, looks, canonical, faces)
        found[found] = _hang_together(fine[found], COARSE / DIVISIONS, scalp[nearest[found]])
    return HairVolume(fine[found].astype(np.float32), opacity[found].astype(np.float32), COARSE / DIVISIONS)


def below_hair(
    volume: HairVolume, canonical: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " f"]:
    """Find the triangles that hair lies on.

    Args:
        volume: The hair.
        canonical: Vertices of the subject's neutral head, in metres.
        faces: Vertex indices of the triangles.

    Returns:
        True for triangles whose centre has a voxel within `HIDING`.
    """
    if not len(volume.centres):
        return np.zeros(len(faces), bool)
    distance, _ = cKDTree(volume.centres).query(canonical[faces].mean(axis=1))
    return distance <= HIDING


def _hang_together(
    centres: Float[np.ndarray, "n 3"], size: float, rooted: Bool[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Which voxels hang together with the rooted ones, over faces, edges or corners."""
    cell = np.rint((centres - centres.min(axis=0, initial=0)) / size).astype(int)
    filled = np.zeros(cell.max(axis=0, initial=0) + 1, bool)
    filled[tuple(cell.T)] = True
    parts = label(filled, np.ones((3, 3, 3)))[0][tuple(cell.T)]
    return np.isin(parts, parts[rooted])


def _opacities(points: Float[np.ndarray, "n 3"], prepared: list, size: float) -> Float[np.ndarray, " n"]:
    """Low quantile of the opacities of each point over the views; with a size, the largest opacity around it."""
    histograms = np.zeros((len(points), carving.OPACITY_BINS), np.uint16)
    for transform, seen, opacity in prepared:
        image, inverse_depth = opacity, seen.inverse_depth
        if size > 0:
            radius = int(np.ceil(HALF_DIAGONAL * size / pixel_size(seen)))
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
            image, inverse_depth = cv2.dilate(image, disc), cv2.erode(inverse_depth, disc)
        carving.add_view(
            histograms, points, transform, seen.camera.intrinsics, np.ascontiguousarray(image),
            np.ascontiguousarray(inverse_depth), MARGIN,
        )  # fmt: skip
    count = histograms.sum(axis=1)
    below = histograms.cumsum(axis=1) > np.maximum(QUANTILE * count, 0)[:, None]
    value = below.argmax(axis=1) / (carving.OPACITY_BINS - 1)
    return np.where(count >= max(MIN_VIEWS, MIN_SHARE * len(prepared)), value, 0)
