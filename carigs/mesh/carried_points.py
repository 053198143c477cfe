"""Points beside a mesh, each carried by one of its triangles: places where surfels start."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Float, Int


class CarriedPoints(NamedTuple):
    """Points of hair or of the mouth."""

    face: Int[np.ndarray, " n"]
    """Triangle that carries each point."""
    position: Float[np.ndarray, "n 3"]
    """In metres, in the axes of the canonical head."""
    spacing: Float[np.ndarray, " n"]
    """Distance to neighbouring points in metres."""
    axes: Float[np.ndarray, "n 3 2"]
    """Unit vectors along both axes of a disc at the point."""
    elongation: Float[np.ndarray, " n"]
    """Length of this disc along the first axis over that along the second."""


def nearest_triangles(
    points: Float[np.ndarray, "n 3"],
    carriers: Int[np.ndarray, " c"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Int[np.ndarray, " n"]:
    """Find the nearest of some triangles.

    Args:
        points: Points.
        carriers: Indices of the triangles to choose from.
        vertices: Vertices of the mesh, in the unit of the points.
        faces: Vertex indices of its triangles.

    Returns:
        Index of the triangle nearest to each point.
    """
    _, nearest, _ = igl.point_mesh_squared_distance(
        np.asarray(points, np.float64), np.asarray(vertices, np.float64), np.asarray(faces[carriers], np.int64)
    )
    return carriers[nearest]
