"""Shift of the principal point, common to all cameras, at which the images agree best on the colours of the head.

Programs disagree whether the centre of the first pixel lies at 0 or at 0.5. A mistake shifts all images by half a
pixel in x and y, which silhouettes do not show.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from carigs.plausibility.diagnosis.reprojection import vertex_pixels
from carigs.plausibility.diagnosis.scene import Scene, Shot
from carigs.plausibility.vertex_misfit import disagreement, sample
from carigs.raster import compute_visibility

STEP = 0.75
"""Pixels between the shifts that are compared."""
LEAST_GROUPS = 4
"""Timesteps that are needed to know how sure the shift is."""
SURE = 3.0
"""Standard errors of a shift that is believed."""
TOLERANCE = 0.25
"""Pixels by which the shift may differ from half a pixel: imperfect tracking shifts it as well."""


class PrincipalPointShift(NamedTuple):
    """What must be added to cx and cy for the colours to agree best, in pixels."""

    shift: Float[np.ndarray, "2"]
    error: Float[np.ndarray, "2"]
    """Standard errors; inf if the colours do not tell."""

    @property
    def half_pixel(self) -> float:
        """0.5 or -0.5 if the shift is half a pixel beyond doubt, else 0."""
        sign = float(np.sign(self.shift[0]))
        is_half = np.abs(self.shift - 0.5 * sign).max() < TOLERANCE
        return 0.5 * sign if is_half and (np.abs(self.shift) > SURE * self.error).all() else 0.0


def principal_point_shift(scene: Scene) -> PrincipalPointShift:
    """Measure the shift: the minimum of a quadratic function through nine shifts, with jackknife errors.

    Args:
        scene: The scene, at the full resolution.

    Returns:
        The shift and its errors over the timesteps.
    """
    unknown = PrincipalPointShift(np.zeros(2), np.full(2, np.inf))
    costs = _costs(scene)
    if len(costs) < LEAST_GROUPS:
        return unknown
    parts = [_minimum(np.delete(costs, k, axis=0).mean(axis=0)) for k in range(len(costs))]
    best = _minimum(costs.mean(axis=0))
    if best is None or any(part is None for part in parts):
        return unknown
    n, deviations = len(parts), np.array(parts) - np.mean(parts, axis=0)
    return PrincipalPointShift(best, np.sqrt((n - 1) / n * (deviations**2).sum(axis=0)))


def _costs(scene: Scene) -> Float[np.ndarray, "t 9"]:
    """Disagreement of the cameras at each timestep under each shift."""
    seen: dict[int, list[tuple[Shot, Float32[np.ndarray, "n 2"]]]] = {}
    for shot in scene.shots:
        visibility = compute_visibility(scene.heads[shot.timestep].vertices, scene.model.faces, shot.image_camera)
        seen.setdefault(shot.frame.timestep, []).append((shot, vertex_pixels(scene, shot, visibility)))

    def cost(members: list[tuple[Shot, Float32[np.ndarray, "n 2"]]], shift: Float32[np.ndarray, "2"]) -> float:
        scales = [np.float32(shot.image.shape[1] / shot.camera.width) for shot, _ in members]
        return disagreement(
            np.stack([sample(shot.image, p + s * shift) for (shot, p), s in zip(members, scales, strict=True)])
        )

    rows = [[cost(members, shift) for shift in _shifts()] for members in seen.values() if len(members) > 2]
    return np.array([row for row in rows if np.isfinite(row).all()]).reshape(-1, 9)


def _shifts() -> Float32[np.ndarray, "9 2"]:
    return np.array(list(product((-STEP, 0, STEP), repeat=2)), np.float32)


def _minimum(costs: Float[np.ndarray, "9"]) -> Float[np.ndarray, "2"] | None:
    """Minimum of the quadratic function that fits the costs best; None if it has none near the shifts."""
    x, y = _shifts().astype(np.float64).T
    design = np.stack([np.ones(9), x, y, x * x / 2, x * y, y * y / 2], axis=1)
    _, gx, gy, xx, xy, yy = np.linalg.lstsq(design, costs, rcond=None)[0]
    if not (xx > 0 and xx * yy > xy * xy):
        return None
    minimum = -np.linalg.solve([[xx, xy], [xy, yy]], [gx, gy])
    return minimum if np.abs(minimum).max() < 2 * STEP else None
