"""Points of the visible part of the hair, and the triangles of the scalp that carry them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.mesh.carried_points import CarriedPoints, draw_points, nearest_triangles

MAX_ELONGATION = 6.0
"""Length over width of the first surfels where views agree on the direction of the strands."""
LEAST_SINE = 0.05
"""Of the angle between a strand and the direction to the cameras."""


def place_in_hair(
    volume: Voxels,
    visible: Float[np.ndarray, " n"],
    strands: Strands,
    scalp: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    count: int,
    rng: np.random.Generator,
    least_visible: float = 0.0,
) -> CarriedPoints:
    """Draw points of the hair, more where it is dense and more views see it.

    Args:
        volume: The hair.
        visible: Share of the views that see each voxel.
        strands: Directions in the voxels.
        scalp: Triangles that carry hair.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of the triangles.
        count: Number of points.
        rng: Draws them.
        least_visible: Share of the views for voxels that fewer see, so that the inside of the hair has points, too.

    Returns:
        The points, each carried by the nearest triangle of the scalp, with axes along the strand and across it.
    """
    weight = volume.opacity * np.sqrt(np.maximum(visible, least_visible))
    chosen, position, spacing = draw_points(volume.centres, volume.size, weight, count, rng)
    face = nearest_triangles(position, np.flatnonzero(scalp), canonical, faces)
    along, facing = strands.direction[chosen], strands.facing[chosen]
    across = np.cross(facing, along)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    lying = length[:, 0] > LEAST_SINE  # otherwise the strand points at the cameras: any direction across it will do
    across[~lying] = np.cross(along[~lying], np.eye(3)[np.abs(along[~lying]).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    elongation = 1 + (MAX_ELONGATION - 1) * strands.confidence[chosen]
    return CarriedPoints(face, position, spacing, np.stack([along, across], axis=2), elongation)
