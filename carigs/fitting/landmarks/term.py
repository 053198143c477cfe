"""Reprojection error of landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import PointCost
from carigs.fitting.triangulation import project


@dataclass(frozen=True)
class LandmarkTerm:
    """Distances in pixels between observed and projected landmarks, with the loss of Geman and McClure.

    A residual of r standard deviations costs rho(r) = r^2 / 2 / (1 + r^2 / k^2): quadratic near 0, at most k^2 / 2.
    """

    points: HeadPoints
    pixels: Float[np.ndarray, "t c p 2"]
    confidence: Float[np.ndarray, "t c p"]
    """Weight of the squared residual, 0 for missing observations."""
    projections: Float[np.ndarray, "t c 3 4"]
    sigma: float
    """Standard deviation of the observations in pixels."""
    outlier: float
    """Standard deviations k beyond which a residual counts as an outlier; inf for least squares."""

    def evaluate(self, positions: Float[np.ndarray, "t p 3"], frames: slice) -> PointCost:
        """Evaluate the cost; see `DataTerm`.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """
        projections = self.projections[frames]
        projected, depth = project(positions, projections)
        seen = self.confidence[frames] * (depth > 0) / self.sigma**2
        residual = np.where((seen > 0)[..., None], projected - self.pixels[frames], 0)
        squared = (residual**2).sum(axis=-1) / self.sigma**2
        relative = 1 + squared / self.outlier**2
        weight = seen / relative**2
        rows = projections[:, :, None, :2, :3] - projected[..., None] * projections[:, :, None, 2:, :3]
        rows /= depth[..., None, None]  # derivative of the projection (t, c, p, 2, 3)
        weighted = weight[..., None, None] * rows
        return PointCost(
            value=0.5 * float((seen * self.sigma**2 * squared / relative).sum()),
            gradient=np.einsum("tcpki,tcpk->tpi", weighted, residual),
            curvature=np.einsum("tcpki,tcpkj->tpij", weighted, rows),
        )
