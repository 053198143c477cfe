"""Agreement of the head's outline with the mattes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import PointCost
from carigs.raster import Visibility

REACH = 0.02
"""How far from the outline of the mesh the outline of the matte is searched, in sizes of the silhouette."""
STEP = 0.5
"""Pixels between the samples of the search."""


@dataclass(frozen=True)
class OutlinePoints:
    """Points on the outline of the posed mesh and the nearest outline of the matte, a line through each."""

    frame: Int[np.ndarray, "k"]
    point: Int[np.ndarray, "k"]
    projections: Float[np.ndarray, "k 3 4"]
    normals: Float[np.ndarray, "k 2"]
    """Unit vectors in the image that point out of the silhouette."""
    offsets: Float[np.ndarray, "k"]
    """The line: normals @ pixel = offset."""


def outline_points(
    visibility: Visibility,
    normals: Float[np.ndarray, "v 3"],
    matte: Float32[np.ndarray, "h w"],
    candidates: Int[np.ndarray, "n"],
) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k 2"], Float[np.ndarray, "k"]]:
    """Find the candidates on the outline of the mesh and the crossing of the matte's outline along their normals.

    Args:
        visibility: What the camera sees of the posed mesh.
        normals: Unit vertex normals in world axes.
        matte: Opacities from 0 to 1.
        candidates: Vertices.

    Returns:
        Which candidates, the normals in the image, and the offsets of the lines.
    """
    camera, faces = visibility.camera, visibility.faces
    front = np.zeros(len(normals), bool)
    front[faces[~visibility.back_facing]] = True
    back = np.zeros(len(normals), bool)
    back[faces[visibility.back_facing]] = True
    distance = cv2.distanceTransform((visibility.face >= 0).astype(np.uint8), cv2.DIST_L2, 5)
    area = np.count_nonzero(visibility.face >= 0)
    reach = max(2.0, REACH * np.sqrt(area))
    pixels = visibility.pixels[candidates]
    size = np.array([camera.width, camera.height])
    inside = ((pixels > reach + 2) & (pixels < size - reach - 2)).all(axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(int).T
    found = np.flatnonzero(inside & front[candidates] & back[candidates] & (distance[row, column] < 1.6))
    pixels = pixels[found]
    across = normals[candidates[found]] @ camera.camera_from_world[:2, :3].T
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    steps = np.arange(-reach, reach + STEP, STEP)
    x, y = np.moveaxis(pixels[:, None] - 0.5 + steps[:, None] * across[:, None], 2, 0).astype(np.float32)
    opacity = cv2.remap(matte, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) if len(found) else x
    falls = (opacity[:, :-1] >= 0.5) & (opacity[:, 1:] < 0.5)
    nearest = np.where(falls, np.abs(steps[:-1] + STEP / 2), np.inf).argmin(axis=1)
    k = np.arange(len(found))
    has = falls.any(axis=1)
    high, low = opacity[k, nearest], opacity[k, nearest + 1]
    crossing = steps[nearest] + STEP * (high - 0.5) / np.where(has, high - low, 1)
    offset = np.einsum("ki,ki->k", across, pixels) + crossing
    return found[has], across[has], offset[has]


@dataclass(frozen=True)
class OutlineTerm:
    """Distances in pixels of outline points from the matte's outline, with the loss of Geman and McClure.

    Hair and clothes stand off the mesh: where the matte's outline lies outside, the loss saturates earlier.
    """

    points: HeadPoints
    lines: OutlinePoints
    sigma: float = 0.5
    outlier: float = 3.0
    outside: float = 1.0
    weight: float = 1.0

    def evaluate(self, positions: Float[np.ndarray, "t n 3"], frames: slice) -> PointCost:
        """Evaluate the cost; see `DataTerm`.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """
        lines = self.lines
        chosen = (lines.frame >= frames.start) & (lines.frame < frames.stop)
        t, n, rows = lines.frame[chosen] - frames.start, lines.point[chosen], lines.projections[chosen]
        across = lines.normals[chosen]
        seen = np.einsum("kij,kj->ki", rows[:, :, :3], positions[t, n]) + rows[:, :, 3]
        pixels = seen[:, :2] / seen[:, 2:]
        residual = (np.einsum("ki,ki->k", across, pixels) - lines.offsets[chosen]) / self.sigma
        limit = np.where(residual > 0, self.outlier, self.outside)
        relative = 1 + residual**2 / limit**2
        weight = self.weight / relative**2
        by_point = rows[:, :2, :3] - pixels[:, :, None] * rows[:, 2:, :3]
        direction = np.einsum("ki,kij->kj", across, by_point) / (seen[:, 2:] * self.sigma)
        gradient, curvature = np.zeros(positions.shape), np.zeros((*positions.shape, 3))
        np.add.at(gradient, (t, n), (weight * residual)[:, None] * direction)
        np.add.at(curvature, (t, n), weight[:, None, None] * direction[:, :, None] * direction[:, None, :])
        return PointCost(0.5 * self.weight * float((residual**2 / relative).sum()), gradient, curvature)
