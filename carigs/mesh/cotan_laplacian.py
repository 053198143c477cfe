"""The cotan Laplacian: stiffness matrices, weighted divergence, and mixed Voronoi areas."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csc_array


class CotanLaplacian:
    """The cotan stiffness matrix W of a mesh, for any weights of the faces (Pinkall and Polthier 1993).

    The discrete Laplace-Beltrami operator is L = A^-1 W with the diagonal matrix A of `mixed_voronoi_areas` (paper,
    equation 3). W is positive semi-definite here, so L approximates minus the Laplacian.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        """Compute half the cotangent of every corner.

        Args:
            vertices: Positions, in any unit.
            faces: Vertex indices of the triangles.
        """
        self.v, self.faces = len(vertices), faces
        self._faces32 = faces.astype(np.int32)  # SciPy would otherwise search the index type of every matrix
        self.half_cotans = igl.cotmatrix_entries(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))

    def stiffness(self, weights: Float[np.ndarray, " f"] | None = None) -> csc_array:
        """Stiffness matrix W_w: x^T W_w x is the sum over the faces of w times the Dirichlet energy of x.

        Its entries are -(w cot a + w' cot b) / 2 for an edge with the opposite angles a and b.

        Args:
            weights: Weight w of each face; None for 1.

        Returns:
            Symmetric positive semi-definite matrix (v, v).
        """
        c = self.half_cotans if weights is None else self.half_cotans * weights[:, None]
        # The edge opposite to corner 0, 1, 2.
        i, j, c = self._faces32[:, [1, 2, 0]].ravel(), self._faces32[:, [2, 0, 1]].ravel(), c.ravel()
        diagonal, ids = np.bincount(i, c, self.v) + np.bincount(j, c, self.v), np.arange(self.v, dtype=np.int32)
        rows, columns = np.concatenate([i, j, ids]), np.concatenate([j, i, ids])
        return coo_array((np.concatenate([-c, -c, diagonal]), (rows, columns)), shape=(self.v, self.v)).tocsc()

    def weighted_divergence(
        self, x: Float[np.ndarray, "v 3"], weights: Float[np.ndarray, " f"]
    ) -> Float[np.ndarray, "v 3"]:
        """W_w x: minus the integrated divergence div(w grad x) at every vertex, without forming W_w.

        Args:
            x: A function on the vertices, for example their positions.
            weights: Weight w of each face.

        Returns:
            The product, in the unit of x.
        """
        return (self.divergence_matrix(x) @ weights).reshape(-1, 3)

    def divergence_matrix(self, x: Float[np.ndarray, "v 3"]) -> csc_array:
        """Matrix D_x with W_w x = D_x w, for one function x and many weights w.

        Args:
            x: A function on the vertices, for example their positions.

        Returns:
            Matrix (3 v, f); the three coordinates of a vertex are consecutive rows.
        """
        a, b, c = (x.take(corner, axis=0) for corner in self.faces.T)
        half = self.half_cotans[..., None]
        flow = half[:, 0] * (b - c), half[:, 1] * (c - a), half[:, 2] * (a - b)
        # Corner 0 is the end of the edge opposite to corner 1 and the start of the edge opposite to corner 2, etc.
        corners = np.stack([flow[2] - flow[1], flow[0] - flow[2], flow[1] - flow[0]], axis=1)
        rows = 3 * self._faces32[..., None] + np.arange(3, dtype=np.int32)
        columns = 9 * np.arange(len(self.faces) + 1, dtype=np.int32)
        return csc_array((corners.ravel(), rows.ravel(), columns), shape=(3 * self.v, len(self.faces)))


def mixed_voronoi_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " v"]:
    """Area of the mixed Voronoi cell of each vertex (Meyer et al. 2003, section 3.3).

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        Areas, in the squared unit of the vertices; their sum is the area of the surface.
    """
    mass = igl.massmatrix(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), igl.MASSMATRIX_TYPE_VORONOI)
    return mass.diagonal()
