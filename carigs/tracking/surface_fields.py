"""Smooth fields on a mesh from values at points of its surface."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array, dia_array

from carigs.head import SurfacePoints
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.linear_solver import CholeskySolver

WIDTH = 0.006
"""Metres over which a field follows its values."""
STIFFNESS = 0.002
"""Weight of smoothness, against the squared errors at the points."""


class SurfaceField:
    """Least squares between values at points and the smoothness of a field on a mesh.

    The field u minimises sum |u(p_n) - d_n|^2 + s (w^2 int |Lap u|^2 + int |u|^2 / w^2), a smoothing spline on the
    surface: it follows the values within the width w of them, and is 0 far away and on parts of the mesh without
    points, such as teeth. The distance is that along the surface, so that one lid does not follow the other.

    Args:
        vertices: The mesh, in metres.
        faces: Vertex indices of its triangles.
        points: Where the values are.
        width: The width w in metres.
        stiffness: The weight s.
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        points: SurfacePoints,
        *,
        width: float = WIDTH,
        stiffness: float = STIFFNESS,
    ) -> None:
        n, k = points.corners.shape
        rows = np.repeat(np.arange(n), k)
        self._values = csc_array(
            (points.barycentric.ravel(), (rows, points.corners.ravel())), shape=(n, len(vertices))
        )  # of a field at the points
        areas = np.maximum(mixed_voronoi_areas(np.asarray(vertices, np.float64), faces), 1e-12)
        laplacian = CotanLaplacian(vertices, faces).stiffness()
        inverse = dia_array((1 / areas[None], [0]), shape=laplacian.shape)
        mass = dia_array((areas[None], [0]), shape=laplacian.shape)
        smooth = width**2 * (laplacian @ inverse @ laplacian) + mass / width**2
        self._factors = CholeskySolver((self._values.T @ self._values + stiffness * smooth).tocsc())

    def fit(self, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "v k"]:
        """Compute the field.

        Args:
            values: Values at the points.

        Returns:
            Values at the vertices.
        """
        return self._factors.solve(np.ascontiguousarray(self._values.T @ values))
