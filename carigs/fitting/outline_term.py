"""Agreement of the head's outline with the mattes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import PointCost
from carigs.fitting.scattered_costs import scattered_cost, seen_from
from carigs.raster import Visibility

REACH = 0.02
"""How far from the mesh's outline the matte's is searched, in sizes of the silhouette (square root of its area), if the
mesh is nearly right."""
STEP = 0.5
"""Pixels between the samples of the search."""
SIGMA = 0.005
"""Standard deviation of outlines in sizes of the silhouette: 1 mm."""
OUTLIER_INSIDE, OUTLIER_OUTSIDE = 1.5, 0.5
"""Scales of the loss in standard deviations where the matte's outline lies inside and outside of the mesh's. Hair and
clothes stand off the mesh, so that what lies outside counts as an outlier earlier."""
NEAR_OUTLINE = 1.6
"""Pixels outside of a vertex at which there is no mesh if it lies on the outline: a pixel diagonal, and rounding."""


class OutlineLines(NamedTuple):
    """The matte's outline near points on the mesh's outline: a line in the image for each."""

    point: Int[np.ndarray, " k"]
    normals: Float[np.ndarray, "k 2"]
    """Unit vectors that point out of the silhouette."""
    offsets: Float[np.ndarray, " k"]
    """Pixels: the line is normal . pixel = offset."""
    sigma: Float[np.ndarray, " k"]
    """Standard deviation in pixels."""


def outline_lines(
    visibility: Visibility,
    normals: Float[np.ndarray, "v 3"],
    matte: Float32[np.ndarray, "h w"],
    candidates: Int[np.ndarray, " n"],
    *,
    reach: float = REACH,
) -> OutlineLines:
    """Find vertices on the mesh's outline and, along their normals, where the matte falls below one half.

    Args:
        visibility: What the camera sees of the posed mesh.
        normals: Unit vertex normals in world axes.
        matte: Opacities from 0 to 1.
        candidates: Vertices.
        reach: How far from the mesh's outline the matte's is searched, in sizes of the silhouette.

    Returns:
        Lines; `point` counts the candidates.
    """
    camera, silhouette = visibility.camera, visibility.face >= 0
    size = np.sqrt(np.count_nonzero(silhouette))
    reach = max(2.0, reach * size)
    pixels, limit = visibility.pixels[candidates], np.array([camera.width, camera.height])
    inside = ((pixels > reach + 1) & (pixels < limit - reach - 1)).all(axis=1)
    sides = [np.zeros(len(normals), bool) for _ in range(2)]
    for side, faces in zip(sides, (visibility.back_facing, ~visibility.back_facing), strict=True):
        side[visibility.faces[faces]] = True
    point = np.flatnonzero(inside & (sides[0] & sides[1])[candidates])
    across = normals[candidates[point]] @ camera.camera_from_world[:2, :3].T
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    column, row = (pixels[point] + NEAR_OUTLINE * across).astype(int).T
    on_outline = ~silhouette[row, column]
    point, across = point[on_outline], across[on_outline]
    pixels = pixels[point]
    steps = np.arange(-reach, reach + STEP, STEP)
    samples = (pixels[:, None] - 0.5 + steps[:, None] * across[:, None]).astype(np.float32)
    opacity = np.zeros((0, len(steps)), np.float32)
    if len(point):
        opacity = cv2.remap(matte, samples[..., 0], samples[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    falls = (opacity[:, :-1] >= 0.5) & (opacity[:, 1:] < 0.5)
    nearest = np.where(falls, np.abs(steps[:-1] + STEP / 2), np.inf).argmin(axis=1)
    found = np.flatnonzero(falls.any(axis=1))
    nearest, across = nearest[found], across[found]
    high, low = opacity[found, nearest], opacity[found, nearest + 1]
    crossing = steps[nearest] + STEP * (high - 0.5) / (high - low)
    offsets = np.einsum("ki,ki->k", across, pixels[found]) + crossing
    return OutlineLines(point[found], across, offsets, np.full(len(found), max(1.0, SIGMA * size)))


@dataclass(frozen=True)
class OutlineTerm:
    """Distances of outline points from the matte's outline."""

    points: HeadPoints
    projections: Float[np.ndarray, "t c 3 4"]
    frame: Int[np.ndarray, " k"]
    camera: Int[np.ndarray, " k"]
    lines: OutlineLines

    def evaluate(self, positions: Float[np.ndarray, "t n 3"], frames: slice) -> PointCost:
        """Evaluate the cost; see `DataTerm`.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """
        chosen = (self.frame >= frames.start) & (self.frame < frames.stop)
        point, normals, offsets, sigma = (array[chosen] for array in self.lines)
        frame = self.frame[chosen]
        at = frame - frames.start, point
        pixels, derivative = seen_from(self.projections[frame, self.camera[chosen]], positions[at])
        residual = (np.einsum("ki,ki->k", normals, pixels) - offsets) / sigma
        slope = np.einsum("ki,kij->kj", normals, derivative) / sigma[:, None]
        outlier = np.where(residual > 0, OUTLIER_INSIDE, OUTLIER_OUTSIDE)
        return scattered_cost(residual, slope, outlier, at, positions.shape[:2])
