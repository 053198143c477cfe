"""The body in the frames: neck below the border of the mesh, shoulders and clothes.

It lies below the border of the neck and moves with it, not with the head. Its outline bounds it from the sides, but
cameras before a person hardly tell how deep it is: it is taken to be rounded towards its outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.ndimage import binary_closing, distance_transform_edt

from carigs.hair.hull import FINE, HullView, Voxels, hull_views, opacities, visual_hull
from carigs.hair.views import HairView, some_views
from carigs.hair.visible_voxels import visible_shares
from carigs.head.neck_border import NeckBorder

WIDTH, DEPTH, HEIGHT = 0.4, 0.11, 0.35
"""Metres from the middle of the neck to the sides of the space that is looked at, to its front and back, and down."""
BELOW = (0.015, 0.03, 0.045, 0.06)
"""Metres below the border of the neck at which the body is looked for, within the width of the neck."""
FILLED, LEAST_SEEN = 0.5, 0.1
"""Least opacity there, and least share of the visible points that have it, if there is a body; and least share of the
points that are visible."""
CLOSED = 3
"""Voxels between parts of head and body that count as filled in its outline."""


class Body(NamedTuple):
    """The space that the body fills."""

    volume: Voxels
    visible: Float32[np.ndarray, " n"]
    """Share of the views that see each voxel."""


def shows_body(
    views: Sequence[HairView],
    border: NeckBorder,
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> bool:
    """Whether the neck goes on below the border of the mesh.

    Args:
        views: Frames of several timesteps and cameras.
        border: The border of the neck.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of its triangles.

    Returns:
        False where mattes end at the neck, and for heads that were rendered without a body.
    """
    arm = canonical[border.vertices] - border.centre
    inside = np.concatenate([border.centre + share * arm for share in (0.0, 0.3, 0.6)])
    below = np.concatenate([inside - [0.0, depth, 0.0] for depth in BELOW])
    opacity, is_seen = opacities(below, _looks(views, border, canonical, faces))
    return bool(is_seen.mean() >= LEAST_SEEN and (opacity[is_seen] >= FILLED).mean() >= FILLED)


def carve_body(
    views: Sequence[HairView],
    border: NeckBorder,
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Body:
    """Find the space that the body fills.

    Args:
        views: Frames of several timesteps and cameras.
        border: The border of the neck.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of its triangles.

    Returns:
        The body; without voxels if no view shows one.
    """
    ring = canonical[border.vertices]
    low = [border.centre[0] - WIDTH, ring[:, 1].min() - HEIGHT, border.centre[2] - DEPTH]
    high = [border.centre[0] + WIDTH, ring[:, 1].max() + FINE, border.centre[2] + DEPTH]
    centres, opacity = visual_hull(_looks(views, border, canonical, faces), np.array(low), np.array(high))
    kept = ~border.lies_above(centres)
    if kept.any():
        kept[kept] = _within_rounded(centres[kept], canonical, border.centre[2])
    volume = Voxels(centres[kept].astype(np.float32), opacity[kept].astype(np.float32), FINE)
    carrier = np.unique(faces[border.carriers])
    return Body(volume, visible_shares(volume, some_views(views), canonical, carrier).astype(np.float32))


def _looks(
    views: Sequence[HairView],
    border: NeckBorder,
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> list[HullView]:
    """Views of what moves with the border of the neck. Nothing of it lies in front of the mesh."""
    return hull_views(views, np.zeros(len(faces), np.float32), canonical, np.unique(faces[border.carriers]))


def _within_rounded(
    points: Float[np.ndarray, "n 3"], canonical: Float[np.ndarray, "v 3"], middle: float
) -> Bool[np.ndarray, " n"]:
    """Which points lie in a body that is rounded towards its outline, as seen from the front, like the edge of a coin.

    Its half depth at a distance d from the outline is that of a circle of the radius `DEPTH`, sqrt(2 d DEPTH - d^2).
    The head belongs to it, and it goes on below the images.
    """
    low = np.minimum(points.min(axis=0), canonical.min(axis=0))[:2] - 2 * FINE
    high = np.maximum(points.max(axis=0), canonical.max(axis=0))[:2] + 2 * FINE
    filled = np.zeros(np.ceil((high - low) / FINE).astype(int) + 1, bool)
    for each in (points, canonical):
        filled[tuple(np.rint((each[:, :2] - low) / FINE).astype(int).T)] = True
    filled = binary_closing(np.pad(filled, CLOSED), iterations=CLOSED)[CLOSED:-CLOSED, CLOSED:-CLOSED]
    filled = np.maximum.accumulate(filled[:, ::-1], axis=1)[:, ::-1]  # y is up: all below something that is filled
    filled = np.pad(filled, ((1, 1), (0, 1)))  # but there is no outline at the lower end
    distance = np.minimum(FINE * distance_transform_edt(np.pad(filled, ((0, 0), (len(filled), 0)), "edge")), DEPTH)
    column, row = np.rint((points[:, :2] - low) / FINE).astype(int).T
    away = distance[column + 1, row + len(filled)]
    return np.abs(points[:, 2] - middle) <= np.sqrt(away * (2 * DEPTH - away)) + FINE / 2
