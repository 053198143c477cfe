"""The discrete operators of a surface: cotan stiffness, its weighted divergence, mass."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array


class CotanLaplacian:
    """Half cotangents of every corner, opposite to its edge: all stiffness matrices of a mesh come from these."""

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        self.v, self.faces = len(vertices), faces
        self._narrow = faces.astype(np.int32)  # or SciPy would look for the widest index in every matrix
        self.half_cotans = igl.cotmatrix_entries(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))

    def stiffness(self, weights: Float[np.ndarray, " f"] | None = None) -> csc_array:
        """W_w, positive semi-definite: x^T W_w x = sum over faces of w times the Dirichlet energy of x."""
        c = self.half_cotans if weights is None else self.half_cotans * weights[:, None]
        # The edge opposite to corner 0, 1, 2.
        i, j, c = self._narrow[:, [1, 2, 0]].ravel(), self._narrow[:, [2, 0, 1]].ravel(), c.ravel()
        own, every = np.bincount(i, c, self.v) + np.bincount(j, c, self.v), np.arange(self.v, dtype=np.int32)
        rows, columns = np.concatenate([i, j, every]), np.concatenate([j, i, every])
        return coo_array((np.concatenate([-c, -c, own]), (rows, columns)), shape=(self.v, self.v)).tocsc()

    def weighted_divergence(
        self, x: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, " f"]
    ) -> Float[np.ndarray, "v 3"]:
        """W_w x without forming W_w: minus the integrated divergence of w grad x."""
        return (self.divergence(x) @ weights).reshape(-1, 3)

    def divergence(self, x: Float[np.ndarray, "v 3"]) -> csc_array:
        """D_x of W_w x = D_x w: for one x and many weights; (3 v, f), the coordinates of a vertex together."""
        a, b, c = (x.take(corner, axis=0) for corner in self.faces.T)
        half = self.half_cotans[..., None]
        flow = half[:, 0] * (b - c), half[:, 1] * (c - a), half[:, 2] * (a - b)
        # Corner 0 is the end of the edge opposite to 1 and the start of that opposite to 2, and so on.
        corners = np.stack([flow[2] - flow[1], flow[0] - flow[2], flow[1] - flow[0]], axis=1)
        rows = 3 * self._narrow[..., None] + np.arange(3, dtype=np.int32)
        columns = 9 * np.arange(len(self.faces) + 1, dtype=np.int32)
        return csc_array((corners.ravel(), rows.ravel(), columns), shape=(3 * self.v, len(self.faces)))


def mixed_voronoi_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " v"]:
    """Area of each vertex's cell (Meyer et al. 2003, section 3.3); the cells add up to the surface."""
    mass = igl.massmatrix(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), igl.MASSMATRIX_TYPE_VORONOI)
    return mass.diagonal()
