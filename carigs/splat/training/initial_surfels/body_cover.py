"""A cover over the sides of the body that no frame shows, such as its back before one camera.

Surfels of the body start where frames show it. From the side, a viewer would look between them into a hollow shell.
Opaque discs on the rest of the surface close it, in the colours of what is seen at about the same distance from the
middle. The training leaves them as they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, gaussian_filter
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from carigs.capture import Capture
from carigs.hair.body import Body
from carigs.mesh.carried_points import CarriedPoints, nearest_triangles
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.training.initial_surfels.grafted_hair import shown_as_background

DENSE = 0.5
"""Opacity from which on a voxel is part of the body."""
SMOOTHED = 2.0
"""Voxels over which the surface is smoothed to find its normals."""
GRID, SPACING = 0.005, 0.0075
"""Edge of the cells with one disc each, in the middle of their voxels, and distance by which the size of the discs is
chosen, in metres: they overlap."""
OPACITY = 0.98
"""Of the discs."""
COVER_CARRIERS = 8
"""Triangles along the border of the neck that carry the discs, which are not trained: those that frames show worst."""
ALONG = 0.3
"""Weight of a difference in height where colours are looked up: at the back, a collar is higher than at the front."""
SHARE = 0.05
"""Share of the points of the seen body from whose median a disc takes its colour: the nearest ones."""


class BodyCover(NamedTuple):
    """Discs on the surface of the body that no frame shows."""

    points: CarriedPoints
    """Where they are."""
    body: CarriedPoints
    """Points of the seen body."""

    def colours(self, seen: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, "n 3"]:
        """Colour the discs like the body at their distance from the middle: the median of the nearest of its points.

        Args:
            seen: RGB of the points of the body.

        Returns:
            RGB of the discs.
        """
        tree = KDTree(self.body.position[:, :2] * [1, ALONG])
        count = max(1, round(SHARE * len(seen)))
        _, nearest = tree.query(self.points.position[:, :2] * [1, ALONG], count)
        return np.median(seen[nearest.reshape(-1, count)], axis=1)


def cover_body(
    body: Body,
    points: CarriedPoints,
    carriers: Bool[np.ndarray, " f"],
    capture: Capture,
    sequence: HeadSequence,
) -> BodyCover | None:
    """Place discs on the surface of the body that no frame shows, but not before the background of a frame.

    Args:
        body: The space that the body fills.
        points: Where surfels of its visible part start.
        carriers: Triangles that move with the body and are not trained.
        capture: The capture.
        sequence: The subject.

    Returns:
        The discs; None if there is no such surface, or nothing to carry them.
    """
    size, centres = body.volume.size, body.volume.centres.astype(np.float64)
    dense = body.volume.opacity >= DENSE
    if not carriers.any() or not dense.any():
        return None
    cell = np.rint((centres - centres.min(axis=0)) / size).astype(int) + 3  # with a rim of empty voxels
    grid = np.zeros(cell.max(axis=0) + 4, bool)
    grid[tuple(cell[dense].T)] = True
    surface = grid & binary_dilation(~grid)
    outward = np.stack(np.gradient(-gaussian_filter(grid.astype(np.float64), SMOOTHED)), axis=-1)
    chosen = np.flatnonzero(dense & (body.visible == 0) & surface[tuple(cell.T)])
    if not len(chosen):
        return None
    _, group = np.unique(np.floor(centres[chosen] / GRID), axis=0, return_inverse=True)
    members = np.bincount(group.ravel())
    mean = csr_array((1 / members[group.ravel()], (group.ravel(), np.arange(len(chosen)))))
    position, normal = mean @ centres[chosen], mean @ outward[tuple(cell[chosen].T)]
    length = np.linalg.norm(normal, axis=1)
    position, normal = position[length > 0], normal[length > 0] / length[length > 0, None]
    rig = sequence.rig
    face = nearest_triangles(position, np.flatnonzero(carriers), rig.vertices, rig.faces)
    hidden = ~shown_as_background(position, face, capture, sequence)
    if not hidden.any():
        return None
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    axes = np.stack([along, np.cross(normal, along)], axis=2)
    shape = np.full(len(position), SPACING), axes, np.ones(len(position))
    return BodyCover(CarriedPoints(*(each[hidden] for each in (face, position, *shape)), OPACITY), points)
