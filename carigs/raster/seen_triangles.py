"""Triangles whose centres a camera sees, and how squarely."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from carigs.capture import Camera
from carigs.mesh.triangle_mesh import barycenters, face_normals
from carigs.raster.rasterizer import compute_visibility

BEHIND = 0.003
"""Metres that the centre of a triangle may lie behind the surface that a pixel shows, and still count as seen."""


class SeenTriangles(NamedTuple):
    """What a camera sees of a mesh."""

    index: Int[np.ndarray, " n"]
    """Triangles that face the camera, and whose centres it sees."""
    cosine: Float[np.ndarray, " n"]
    """Cosine between their normals and the directions to the camera."""
    row: Int[np.ndarray, " n"]
    """Pixels of their centres."""
    column: Int[np.ndarray, " n"]


def seen_triangles(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera) -> SeenTriangles:
    """Find the triangles that a camera sees.

    Args:
        vertices: World positions in metres.
        faces: Vertex indices of the triangles.
        camera: The camera.

    Returns:
        The triangles in ascending order.
    """
    centre, inverse_depth = barycenters(vertices, faces), compute_visibility(vertices, faces, camera).inverse_depth
    towards = camera.centre - centre
    cosine = np.einsum("nc,nc->n", face_normals(vertices, faces), towards) / np.linalg.norm(towards, axis=1)
    pixel, depth = camera.project(centre)
    inside = (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < [camera.width, camera.height]).all(axis=1)
    column, row = np.where(inside[:, None], pixel, 0).astype(int).T
    seen = np.flatnonzero(inside & (cosine > 0) & ((depth - BEHIND) * inverse_depth[row, column] < 1))
    return SeenTriangles(seen, cosine[seen], row[seen], column[seen])
