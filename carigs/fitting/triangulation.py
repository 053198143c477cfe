"""Triangulation of points from several cameras, robust to outliers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from carigs.capture import Camera
from carigs.capture.evenly_spread import evenly_spread

ROUNDS = 12
"""Reweighted least-squares solves. The first half minimises the sum of the distances, which has one minimum nearly
always; the second half lets outliers vanish."""
LEAST_POINTS = 4
"""Landmarks that two cameras must see in a timestep from which a head is placed."""
LEAST_ANGLE = np.radians(2.0)
"""Angle between the rays of a point below which its depth is not determined."""


def projection_matrix(camera: Camera) -> Float[np.ndarray, "3 4"]:
    """Matrix P of a camera: P (X, 1) = depth (x, y, 1).

    Args:
        camera: The camera.

    Returns:
        P, in pixels and metres.
    """
    fx, fy, cx, cy = camera.intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) @ camera.camera_from_world[:3]


def projection_matrices(cameras: Sequence[Camera]) -> Float[np.ndarray, "c 3 4"]:
    """Matrices of several cameras.

    Args:
        cameras: The cameras.

    Returns:
        `projection_matrix` of each.
    """
    return np.stack([projection_matrix(camera) for camera in cameras])


def project(
    points: Float[np.ndarray, "*n p 3"], projections: Float[np.ndarray, "*n c 3 4"]
) -> tuple[Float[np.ndarray, "*n c p 2"], Float[np.ndarray, "*n c p"]]:
    """Project points into cameras.

    Args:
        points: World points in metres.
        projections: Matrices of the cameras.

    Returns:
        Image positions in pixels, and depths in metres.
    """
    seen = np.einsum("...cij,...pj->...cpi", projections[..., :3], points) + projections[..., None, :, 3]
    return seen[..., :2] / seen[..., 2:], seen[..., 2]


def well_seen_timesteps(confidence: Float[np.ndarray, "t c p"], count: int | None = None) -> Int[np.ndarray, " k"]:
    """Timesteps in which two cameras see enough landmarks.

    Args:
        confidence: Weight of each observation, 0 for none.
        count: Largest number of timesteps, which are evenly spaced among them; None for all.

    Returns:
        Positions in ascending order.
    """
    enough = ((confidence > 0).sum(axis=1) >= 2).sum(axis=1) >= LEAST_POINTS
    found = np.flatnonzero(enough)
    return found if count is None else found[evenly_spread(range(len(found)), count)]


def triangulate(
    pixels: Float[np.ndarray, "t c p 2"],
    confidence: Float[np.ndarray, "t c p"],
    projections: Float[np.ndarray, "t c 3 4"],
) -> tuple[Float[np.ndarray, "t p 3"], Float[np.ndarray, "t c p"]]:
    """Triangulate by the direct linear transform, reweighted so that outliers lose their influence.

    Each view gives two equations (x p_3 - p_1) (X, 1) = 0 and (y p_3 - p_2) (X, 1) = 0 with the rows p of its matrix
    (Hartley and Zisserman 2003, section 12.2). Divided by the depth they are residuals in pixels. Their weights are
    first those of the sum of distances, then those of Geman and McClure's loss; its scale is estimated from the median
    of all residuals.

    Args:
        pixels: Observed image positions.
        confidence: Weight of each observation, 0 for none.
        projections: Matrices of the cameras at each timestep.

    Returns:
        World points in metres, NaN where fewer than two views, or rays that are nearly parallel, see a point; and
        distances in pixels of the observations from the projected points, NaN where either is missing.
    """
    seen = confidence > 0
    pixels = np.where(seen[..., None], pixels, 0)
    rows = pixels[..., None] * projections[:, :, None, 2:3] - projections[:, :, None, :2]  # (t, c, p, 2, 4)
    weights, points = confidence.astype(np.float64), np.zeros((*pixels.shape[::2], 3))
    for k in range(ROUNDS):
        normal = np.einsum("tcpki,tcp,tcpkj->tpij", rows, weights, rows)
        values, axes = np.linalg.eigh(normal[..., :3, :3])
        determined = values[..., 0] > np.sin(LEAST_ANGLE / 2) ** 2 * values[..., 2]
        inverse = 1 / np.where(determined[..., None], values, 1)
        points = -np.einsum("tpia,tpa,tpja,tpj->tpi", axes, inverse, axes, normal[..., :3, 3])
        projected, depth = project(points, projections)
        distance = np.where(seen, np.linalg.norm(projected - pixels, axis=-1), np.nan)
        scale = max(1.4826 * float(np.nanmedian(distance)) if seen.any() else 1.0, 1e-3)
        if k < ROUNDS // 2:
            robust = 1 / np.maximum(distance, 0.1 * scale)
        else:
            robust = 1 / (1 + (distance / (3 * scale)) ** 2) ** 2
        weights = np.where(seen, confidence * robust / np.maximum(depth**2, 1e-12), 0)
    return np.where(determined[..., None], points, np.nan), np.where(determined[:, None], distance, np.nan)
