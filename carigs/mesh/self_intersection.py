"""Faces of a triangle mesh that cut others.

Two triangles in general position cut each other if and only if an edge of one passes through the other. So the edges of
every face are cast as rays that end at the next corner: an edge of two faces in both directions.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import components, size

END = 1e-6
"""Share of an edge that is left out at both ends, where it touches the faces around its corners."""


def self_intersecting_faces(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " f"]:
    """Find the faces that cut another face of the same connected component.

    Parts that reach into each other, such as eyeballs in their sockets, are not meant. Of the faces that an edge passes
    through, the first and the last are found. Faces that lie in one plane do not cut each other.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        Whether each face cuts another.
    """
    i, j, own = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel(), np.tile(np.arange(len(faces)), 3)
    extent, part = size(vertices, faces), components(faces, len(vertices))
    edge = (vertices[j] - vertices[i]) / extent
    length = np.linalg.norm(edge, axis=1)
    origin, direction = vertices[i] / extent + END * edge, edge / np.maximum(length, 1e-300)[:, None]
    hit, distance, _ = RayCaster(vertices, faces).first_hit(origin, direction, float(length.max()))
    touched = ((faces[hit] == i[:, None]) | (faces[hit] == j[:, None])).any(axis=1)
    cut = (hit >= 0) & ~touched & (distance < length * (1 - 2 * END)) & (part[faces[hit, 0]] == part[i])
    found = np.zeros(len(faces), bool)
    found[own[cut]] = found[hit[cut]] = True
    return found
