"""Rays against a surface, in double precision: a mesh that was turned or shifted must see the same."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int

from carigs.mesh.triangle_mesh import size

CAST_SIZE = 1000.0
"""The head's size while rays are cast: libigl drops triangles by an absolute tolerance."""


class RayCaster:
    """The tree of a surface; origins and distances are in units of its `size`."""

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        self.faces = np.asarray(faces, np.int64)
        self.vertices = vertices * (CAST_SIZE / size(vertices, faces))
        self._tree = igl.AABB()
        self._tree.init(self.vertices, self.faces)

    def first(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], reach: float = np.inf
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """The first face along each ray up to `reach` (-1: none), its distance, the hit in barycentric coordinates."""
        face, distance, uv = self._tree.intersect_ray_first(
            self.vertices, self.faces, CAST_SIZE * origins, np.ascontiguousarray(directions), CAST_SIZE * reach
        )
        uv = np.where(face[:, None] >= 0, uv, 0.0)  # of a ray that hits nothing it is not set
        return face, distance / CAST_SIZE, np.column_stack([1 - uv.sum(axis=1), uv])
