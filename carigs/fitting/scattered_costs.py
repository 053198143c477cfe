"""Costs of single residuals, summed over the points of the head that they belong to."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from carigs.fitting.objective import PointCost


def scattered_cost(
    residual: Float[np.ndarray, " k"],
    slope: Float[np.ndarray, "k 3"],
    outlier: Float[np.ndarray, " k"],
    point: tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]],
    shape: tuple[int, int],
) -> PointCost:
    """Sum residuals with the loss of Geman and McClure (see `LandmarkTerm`).

    Args:
        residual: Residuals in standard deviations.
        slope: Their derivatives with respect to the world position of their point, per metre.
        outlier: Scale of the loss of each residual.
        point: Frame and number of the point of each residual.
        shape: Numbers of frames and points.

    Returns:
        The cost, with gradient and Gauss-Newton curvature for each point.
    """
    relative = 1 + (residual / outlier) ** 2
    weighted = slope / relative[:, None] ** 2
    flat, size = np.ravel_multi_index(point, shape), shape[0] * shape[1]
    gradient = [np.bincount(flat, weighted[:, i] * residual, size) for i in range(3)]
    curvature = [np.bincount(flat, weighted[:, i] * slope[:, j], size) for i in range(3) for j in range(3)]
    return PointCost(
        value=0.5 * float((residual**2 / relative).sum()),
        gradient=np.stack(gradient, axis=-1).reshape(*shape, 3),
        curvature=np.stack(curvature, axis=-1).reshape(*shape, 3, 3),
    )


def seen_from(
    rows: Float[np.ndarray, "k 3 4"], positions: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2 3"]]:
    """Project each point with its own matrix.

    Args:
        rows: Matrices (`projection_matrix`).
        positions: World points in metres.

    Returns:
        Image positions, and their derivatives in pixels per metre.
    """
    seen = np.einsum("kij,kj->ki", rows[:, :, :3], positions) + rows[:, :, 3]
    pixels = seen[:, :2] / seen[:, 2:]
    derivative = rows[:, :2, :3] - pixels[:, :, None] * rows[:, 2:, :3]
    return pixels, derivative / seen[:, 2, None, None]
