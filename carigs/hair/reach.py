"""How far hair reaches from the scalp that carries it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from carigs.mesh.carried_points import CarriedPoints

NEIGHBOURS = 64
"""Points of the hair whose mean distance is the reach at a triangle."""


def hair_reach(
    points: CarriedPoints,
    scalp: Bool[np.ndarray, " f"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Float[np.ndarray, " f"]:
    """Measure how far the hair around every triangle of the scalp reaches.

    Args:
        points: Points inside the hair.
        scalp: Triangles that carry it.
        vertices: Vertices of the neutral head in metres.
        faces: Vertex indices of the triangles.

    Returns:
        Mean distance (metres) of the points on the nearest triangles from the centres of these; 0 off the scalp and
        without points.
    """
    reach = np.zeros(len(faces))
    if len(points.face) == 0 or not scalp.any():
        return reach
    centres = vertices[faces].mean(axis=1)
    distance = np.linalg.norm(points.position - centres[points.face], axis=1)
    _, near = cKDTree(centres[points.face]).query(centres[scalp], k=[*range(1, min(NEIGHBOURS, len(distance)) + 1)])
    reach[scalp] = distance[near].mean(axis=1)
    return reach
