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
    opacity: float = 0.2
    """Of these discs at the start of a training."""


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


def draw_points(
    centres: Float[np.ndarray, "c 3"],
    size: float,
    weight: Float[np.ndarray, " c"],
    count: int,
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Draw points in cells of a grid, in proportion to the weights of the cells.

    Sampling is systematic: the number of points in a cell differs from its expectation by less than 1.

    Args:
        centres: Centres of the cells in metres.
        size: Edge of a cell in metres.
        weight: Weight of each cell, 0 or larger; not all are 0.
        count: Number of points.
        rng: Draws them.

    Returns:
        Cell of each point, its position, and its distance to neighbouring points in metres.
    """
    weight = weight / weight.sum()
    cell = np.searchsorted(np.cumsum(weight), (np.arange(count) + rng.random()) / count)
    cell = np.minimum(cell, np.flatnonzero(weight)[-1])
    position = centres[cell] + size * (rng.random((count, 3)) - 0.5)
    return cell, position, size / np.cbrt(np.maximum(count * weight[cell], 1e-6))
