"""The space that hair fills: a visual hull around the head, carved by the background and by skin that is seen.

A point in front of the mesh is empty if a view shows background there, or a triangle that nothing covers. What is left
is hair, or something else that stands off the mesh; where no view shows its outline, it is as thick as where one does
(`carigs.hair.measured_reach`, or `carigs.hair.hair_height` where views are far apart). What does not hang together with
the hair above the scalp is none: before a single camera, the hull also holds the space in front of brows, nose, lips
and stubble. Hair moves with the scalp, so views of different timesteps agree in the axes of the canonical head, to
which the scalp's rigid motion takes them.
"""

from __future__ import annotations

from collections.abc import Sequence

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import label
from scipy.spatial import cKDTree

from carigs.hair.bare_skin import NEAR_SKIN
from carigs.hair.covered_faces import Covering
from carigs.hair.hair_height import hair_heights
from carigs.hair.hull import FINE, Voxels, hull_views, visual_hull
from carigs.hair.measured_reach import within_measured_reach
from carigs.hair.views import WIDE, HairView, largest_gap
from carigs.head.neck_border import NeckBorder

REACH = 0.25
"""Metres from the head to the end of the grid."""
HIDING = 0.02
"""Metres from hair up to which it may hide skin."""


def carve_hair(
    views: Sequence[HairView],
    covering: Covering,
    scalp: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    limit: float = 0.03,
    border: NeckBorder | None = None,
) -> Voxels:
    """Find the space that hair fills.

    Args:
        views: Frames of several timesteps and cameras.
        covering: What covers the triangles.
        scalp: Triangles that carry hair, whose motion the hair follows.
        canonical: Vertices of the subject's neutral head, in metres.
        faces: Vertex indices of the triangles.
        limit: Texture of a covered triangle.
        border: Of the neck: what lies below it is the body. None if no body is in the frames.

    Returns:
        Its voxels; none if nothing stands off the mesh.
    """
    carrier = np.unique(faces[scalp])
    if len(carrier) == 0:  # a head model without the region
        return Voxels(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), FINE)
    cover = covering.opacity(limit)
    looks = hull_views(views, cover, canonical, carrier)
    low, high = canonical[carrier].min(axis=0) - REACH, canonical[carrier].max(axis=0) + REACH
    fine, opacity = visual_hull(looks, low, high)
    if border is not None:
        above = border.lies_above(fine)
        fine, opacity = fine[above], opacity[above]
    found = np.ones(len(fine), bool)
    if len(fine):
        squared, nearest, closest = igl.point_mesh_squared_distance(fine, np.asarray(canonical, np.float64), faces)
        nearest = nearest.astype(np.int64)
        found = scalp[nearest] | (cover[nearest] > 0.5) | (squared > NEAR_SKIN**2)
        towards = np.array([-look.transform[:, :3].T @ look.transform[:, 3] for look in looks])
        towards -= canonical[carrier].mean(axis=0)
        if largest_gap(towards / np.linalg.norm(towards, axis=1, keepdims=True)) > WIDE:
            heights = hair_heights(looks, scalp, cover <= 0.5, canonical, faces)
            found &= np.sqrt(squared) <= heights[nearest] + FINE
        else:
            found &= within_measured_reach(fine, closest, nearest, FINE, [look[:2] for look in looks], canonical, faces)
        found[found] = _hang_together(fine[found], FINE, scalp[nearest[found]])
    return Voxels(fine[found].astype(np.float32), opacity[found].astype(np.float32), FINE)


def below_hair(
    volume: Voxels, canonical: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
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
