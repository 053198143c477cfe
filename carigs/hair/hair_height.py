"""How high hair stands above the triangles of the scalp, where views that are far apart leave the visual hull open.

Such a hull has corners far from the head, which no view shows to be empty. A view that looks along the
surface of the head shows where the hair above a triangle ends: there the hull above it ends for the first time. Above
the other triangles of the scalp hair is as high as around them. Above ears such views meet hair or clothes that hang
elsewhere, so that the height beside the scalp is at most that of the scalp around, down to none above bare skin; a
beard is lower.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.hair.harmonic_faces import faces_beside, harmonic_faces
from carigs.hair.hull import FINE, MIN_OPACITY, HullView, opacities
from carigs.hair.measured_reach import looked_across

HIGHEST = 0.16
"""Metres above a triangle at which hair that has not ended before is not measured."""
USUAL = 0.95
"""Share of the measured heights that count: the others are those of tufts, or of something behind the hair."""
UNMEASURED = 0.02
"""Metres of hair where no view measures any."""


def hair_heights(
    views: Sequence[HullView],
    scalp: Bool[np.ndarray, " f"],
    bare: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Float[np.ndarray, " f"]:
    """Measure the height of the hair above every triangle.

    Args:
        views: What cameras see, with the motion of the scalp.
        scalp: Triangles that carry hair.
        bare: Triangles of the skin that nothing covers.
        canonical: Vertices of the subject's neutral head, in metres.
        faces: Vertex indices of the triangles.

    Returns:
        Metres; 0 above bare skin.
    """
    corners = np.asarray(canonical, np.float64)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    centre, some, beside = corners.mean(axis=1), np.flatnonzero(scalp | ~bare), faces_beside(faces)
    end, ends = np.zeros(len(faces)), np.zeros(len(faces), bool)
    end[some], ends[some] = _first_end(views, centre[some], normal[some])
    ends &= looked_across(centre + FINE * normal, normal, [view[:2] for view in views])
    measured, bare = ends & scalp, bare & ~scalp
    usual = np.quantile(end[measured], USUAL) if measured.any() else UNMEASURED
    known = measured | bare if measured.any() else scalp | bare
    height = harmonic_faces(np.where(bare, 0, np.where(measured, np.minimum(end, usual), usual)), known, beside)
    lower = ends & ~known
    height[lower] = np.minimum(end, height)[lower]
    height = harmonic_faces(height, known | lower, beside)
    return np.maximum(height, beside.multiply(height[None]).max(axis=1).toarray().ravel())


def _first_end(
    views: Sequence[HullView], start: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Where the hull ends on rays, in metres from their starts, and whether enough views see that."""
    steps = FINE * np.arange(1, int(HIGHEST / FINE))
    points = start[:, None] + steps[:, None] * direction[:, None]
    opacity, is_seen = (each.reshape(len(start), len(steps)) for each in opacities(points.reshape(-1, 3), views))
    is_empty = opacity < MIN_OPACITY
    first = np.where(is_empty.any(axis=1), is_empty.argmax(axis=1), len(steps))
    rows = np.arange(len(start))
    return FINE * first, (first < len(steps)) & is_seen[rows, np.minimum(first, len(steps) - 1)]
