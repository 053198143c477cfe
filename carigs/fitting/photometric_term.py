"""Agreement of the images at points of the head, between cameras and over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import PointCost
from carigs.fitting.scattered_costs import scattered_cost, seen_from

WEIGHT = 0.1
"""Of each residual: those of neighbouring points and cameras are not independent."""
OUTLIER = 3.0
"""Scale of the loss in standard deviations."""


@dataclass(frozen=True)
class PhotometricTerm:
    """Differences between the value of each image at a point and the mean value of the point.

    The means are held fixed, as in alignment to a template (Lucas and Kanade 1981).
    """

    points: HeadPoints
    images: Float32[np.ndarray, "t c h w"]
    visible: Bool[np.ndarray, "t c n"]
    means: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]
    """Standard deviation of each point's values."""
    projections: Float[np.ndarray, "t c 3 4"]

    def evaluate(self, positions: Float[np.ndarray, "t n 3"], frames: slice) -> PointCost:
        """Evaluate the cost; see `DataTerm`.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """
        frame, camera, point = np.nonzero(self.visible[frames])
        pixels, derivative = seen_from(self.projections[frames][frame, camera], positions[frame, point])
        values, gradients = sample_with_gradient(self.images[frames], frame, camera, pixels)
        scale = np.sqrt(WEIGHT) / self.sigma[point]
        residual = scale * (values - self.means[point])
        slope = scale[:, None] * np.einsum("ki,kij->kj", gradients, derivative)
        outlier = np.full(len(point), np.sqrt(WEIGHT) * OUTLIER)
        return scattered_cost(residual, slope, outlier, (frame, point), positions.shape[:2])


def sample_with_gradient(
    images: Float32[np.ndarray, "t c h w"],
    frame: Int[np.ndarray, " k"],
    camera: Int[np.ndarray, " k"],
    pixels: Float[np.ndarray, "k 2"],
) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, "k 2"]]:
    """Interpolate images bilinearly.

    Args:
        images: Images of all frames and cameras.
        frame: Frame of each sample.
        camera: Camera of each sample.
        pixels: Positions (x, y), pixel centres at +0.5; those outside are moved to the border.

    Returns:
        Values, and their derivatives along x and y per pixel.
    """
    height, width = images.shape[2:]
    x, y = np.clip(pixels - 0.5, 0, [width - 1.001, height - 1.001]).T
    column, row = x.astype(np.int64), y.astype(np.int64)
    fx, fy = x - column, y - row
    first = ((frame * images.shape[1] + camera) * height + row) * width + column
    flat = images.reshape(-1)
    a, b, c, d = (flat[first + step].astype(np.float64) for step in (0, 1, width, width + 1))
    top, bottom = a + fx * (b - a), c + fx * (d - c)
    return top + fy * (bottom - top), np.stack([(1 - fy) * (b - a) + fy * (d - c), bottom - top], axis=1)
