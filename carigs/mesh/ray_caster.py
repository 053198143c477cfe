"""Intersection of rays with a triangle mesh, in double precision."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int

from carigs.mesh.triangle_mesh import size

CAST_SIZE = 1000.0
"""Size that the mesh is scaled to while rays are cast: libigl drops triangles by an absolute tolerance."""


class RayCaster:
    """Bounding volume hierarchy of a mesh. Origins and distances are in units of the mesh's `size`.

    Rotating or translating the mesh together with the rays does not change the hits: libigl's tree works in double
    precision.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        """Build the hierarchy.

        Args:
            vertices: Positions, in any unit.
            faces: Vertex indices of the triangles.
        """
        self.faces = np.asarray(faces, np.int64)
        self.vertices = vertices * (CAST_SIZE / size(vertices, faces))
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)

    def first_hit(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], max_distance: float = np.inf
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Find the first face along each ray.

        Args:
            origins: Start of each ray, in units of the mesh's size.
            directions: Unit vectors.
            max_distance: Length of the rays, in units of the mesh's size.

        Returns:
            Index of the face hit (-1: none), distance in units of the mesh's size, and barycentric coordinates of the
            hit.
        """
        face, distance, uv = self._tree.intersect_ray_first(
            self.vertices, self.faces, CAST_SIZE * origins, np.ascontiguousarray(directions), CAST_SIZE * max_distance
        )
        uv = np.where(face[:, None] >= 0, uv, 0.0)  # libigl does not set it for rays without a hit
        return face, distance / CAST_SIZE, np.column_stack([1 - uv.sum(axis=1), uv])
