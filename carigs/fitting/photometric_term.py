"""Agreement of the images at points of the head, between cameras and over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import PointCost
from carigs.fitting.triangulation import project


@dataclass(frozen=True)
class PhotometricTerm:
    """Differences between the value of each image at a point and the mean value of the point.

    The loss is Geman and McClure's (see `LandmarkTerm`). The means are held fixed, as by the inverse of Lucas and
    Kanade's alignment: they are computed again between minimisations.
    """

    points: HeadPoints
    images: Float32[np.ndarray, "t c h w"]
    visible: Bool[np.ndarray, "t c n"]
    means: Float[np.ndarray, "n"]
    sigma: Float[np.ndarray, "n"]
    """Standard deviation of each point's values."""
    projections: Float[np.ndarray, "t c 3 4"]
    weight: float = 1.0
    outlier: float = 3.0

    def evaluate(self, positions: Float[np.ndarray, "t n 3"], frames: slice) -> PointCost:
        """Evaluate the cost; see `DataTerm`.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """
        projections, images = self.projections[frames], self.images[frames]
        t, c, n = np.nonzero(self.visible[frames])
        rows = projections[t, c]
        seen = np.einsum("kij,kj->ki", rows[:, :, :3], positions[t, n]) + rows[:, :, 3]
        pixels = seen[:, :2] / seen[:, 2:]
        values, slopes = sample(images, t, c, pixels)
        residual = (values - self.means[n]) / self.sigma[n]
        relative = 1 + residual**2 / self.outlier**2
        weight = self.weight / relative**2
        by_point = rows[:, :2, :3] - pixels[:, :, None] * rows[:, 2:, :3]
        direction = np.einsum("ki,kij->kj", slopes, by_point) / (seen[:, 2] * self.sigma[n])[:, None]
        flat, size = t * positions.shape[1] + n, positions.shape[0] * positions.shape[1]
        weighted = weight[:, None] * direction

        def total(values: Float[np.ndarray, "k"]) -> Float[np.ndarray, "m"]:
            return np.bincount(flat, values, size)

        gradient = np.stack([total(weighted[:, i] * residual) for i in range(3)], axis=-1)
        curvature = np.stack([total(weighted[:, i] * direction[:, j]) for i in range(3) for j in range(3)], axis=-1)
        return PointCost(
            value=0.5 * self.weight * float((residual**2 / relative).sum()),
            gradient=gradient.reshape(*positions.shape),
            curvature=curvature.reshape(*positions.shape, 3),
        )


def sample(images, t, c, pixels):
    """Bilinear."""
    height, width = images.shape[2:]
    x = np.clip(pixels[:, 0] - 0.5, 0, width - 1.001)
    y = np.clip(pixels[:, 1] - 0.5, 0, height - 1.001)
    column, row = x.astype(np.int64), y.astype(np.int64)
    fx, fy = x - column, y - row
    flat = images.reshape(-1)
    first = ((t * images.shape[1] + c) * height + row) * width + column
    a, b, d, e = flat[first], flat[first + 1], flat[first + width], flat[first + width + 1]
    top, bottom = a + fx * (b - a), d + fx * (e - d)
    slopes = np.stack([(1 - fy) * (b - a) + fy * (e - d), bottom - top], axis=1)
    return top + fy * (bottom - top), slopes
