"""Smooth displacements in space: what lies side by side moves together, also inside and outside of a nostril."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

WIDTH, DEVIATION = 0.015, 0.008
"""Metres over which displacements change, and their standard deviation."""
SPACING = 0.75
"""Between centres, in widths."""
JITTER = 1e-4
"""Added to the diagonal of the covariance of neighbouring centres, which is nearly singular."""


class SpatialField:
    """A Gaussian process with the covariance s^2 exp(-r^2 / 2 w^2), on a lattice of centres.

    The centres are those of inducing points (Rasmussen and Williams 2006, section 8.3).

    Args:
        vertices: The mesh, in metres.
        support: Vertices near which there are displacements.
        width: The width w in metres.
        deviation: The standard deviation s in metres.
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        support: Int[np.ndarray, " n"],
        *,
        width: float = WIDTH,
        deviation: float = DEVIATION,
    ) -> None:
        cells = np.unique(np.floor(vertices[support] / (SPACING * width)).astype(int), axis=0)
        self._centres, self._width = (cells + 0.5) * SPACING * width, width
        self.values = self._at(vertices)
        """(v, c) of each basis function at the vertices."""
        self._precision = (self._at(self._centres) + JITTER * np.eye(len(cells))) / deviation**2

    def fit(
        self,
        values: Float[np.ndarray, "n c"],
        information: Float[np.ndarray, "n 3 3"],
        weighted: Float[np.ndarray, "n 3"],
    ) -> Float[np.ndarray, "v 3"]:
        """Compute the most probable displacement, given what is known of it at points.

        Args:
            values: Basis functions at the points.
            information: Inverse covariance of the displacement of each point, in 1 / metres^2; it may be singular.
            weighted: The information times the displacement.

        Returns:
            Displacements of the vertices in metres.
        """
        c = len(self._centres)
        matrix = np.zeros((c, 3, c, 3))
        for i in range(3):
            matrix[:, i, :, i] += self._precision
            for j in range(3):
                matrix[:, i, :, j] += values.T @ (information[:, i, j, None] * values)
        factors = cho_factor(matrix.reshape(3 * c, 3 * c), overwrite_a=True)
        return self.values @ cho_solve(factors, (values.T @ weighted).ravel()).reshape(c, 3)

    def _at(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n c"]:
        squared = ((points[:, None] - self._centres) ** 2).sum(axis=2) / self._width**2
        return np.exp(-squared / 2)
