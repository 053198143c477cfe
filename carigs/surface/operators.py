"""The discrete operators of a surface: cotan stiffness, its weighted divergence, mass."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array


class EdgeCotans:
    """Half cotangents of every corner, opposite to its edge: all stiffness matrices of a mesh come from these."""

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        self.v, self.faces = len(vertices), faces
        self.start, self.end = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]  # the edge opposite to corner 0, 1, 2
        self.half_cotans = igl.cotmatrix_entries(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))

    def stiffness(self, weights: Float[np.ndarray, " f"] | None = None) -> csc_array:
        """W_w, positive semi-definite: x^T W_w x = sum over faces of w times the Dirichlet energy of x."""
        c = self.half_cotans if weights is None else self.half_cotans * weights[:, None]
        i, j, c = self.start.ravel(), self.end.ravel(), c.ravel()
        own, every = np.bincount(i, c, self.v) + np.bincount(j, c, self.v), np.arange(self.v)
        rows, columns = np.concatenate([i, j, every]), np.concatenate([j, i, every])
        return coo_array((np.concatenate([-c, -c, own]), (rows, columns)), shape=(self.v, self.v)).tocsc()

    def weighted_divergence(
        self, x: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, " f"]
    ) -> Float[np.ndarray, "v 3"]:
        """W_w x without forming W_w: minus the integrated divergence of w grad x."""
        return (self.divergence(x) @ weights).reshape(-1, 3)

    def divergence(self, x: Float[np.ndarray, "v 3"]) -> csc_array:
        """D_x of W_w x = D_x w: for one x and many weights; (3 v, f), the coordinates of a vertex together."""
        flow = self.half_cotans[..., None] * (x[self.start] - x[self.end])
        # Corner 0 is the end of the edge opposite to 1 and the start of that opposite to 2, and so on.
        corners = flow[:, [2, 0, 1]] - flow[:, [1, 2, 0]]
        rows, f = 3 * self.faces[..., None] + np.arange(3), len(self.faces)
        return csc_array((corners.ravel(), rows.ravel(), 9 * np.arange(f + 1)), shape=(3 * self.v, f))


def mixed_voronoi_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " v"]:
    """Area of each vertex's cell (Meyer et al. 2003, section 3.3); the cells add up to the surface."""
    mass = igl.massmatrix(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), igl.MASSMATRIX_TYPE_VORONOI)
    return mass.diagonal()
