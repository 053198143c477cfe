"""The space right above bare skin, where no hair can be: the skin is seen."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

NEAR_SKIN = 0.01
"""Metres above bare skin up to which there is no hair: the blur of outlines, and errors of tracking, look like it."""
CELL = 0.002
"""Edge of a cell in metres."""


class SpaceAboveSkin(NamedTuple):
    """Cells of a grid whose nearest triangle is bare, at a distance of less than `NEAR_SKIN`."""

    low: Float[np.ndarray, "3"]
    """Corner of the grid in metres."""
    inside: Bool[np.ndarray, "i j k"]

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether points lie in this space.

        Args:
            points: Points in metres, in the axes of the canonical head.

        Returns:
            True for those in one of the cells.
        """
        cell = np.floor((points - self.low) / CELL).astype(np.int64)
        on_grid = ((cell >= 0) & (cell < self.inside.shape)).all(axis=1)
        found = np.zeros(len(points), bool)
        found[on_grid] = self.inside[tuple(cell[on_grid].T)]
        return found


def space_above_skin(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], bare: Bool[np.ndarray, " f"]
) -> SpaceAboveSkin:
    """Find the space above bare skin.

    Args:
        vertices: Vertices of the canonical head in metres.
        faces: Vertex indices of the triangles.
        bare: Triangles that carry no hair, and that nothing covers.

    Returns:
        The space; empty if no triangle is bare.
    """
    if not bare.any():
        return SpaceAboveSkin(np.zeros(3), np.zeros((0, 0, 0), bool))
    corners = vertices[faces[bare]]
    low, high = corners.min(axis=(0, 1)) - NEAR_SKIN - CELL, corners.max(axis=(0, 1)) + NEAR_SKIN + CELL
    inside = np.zeros(np.ceil((high - low) / CELL).astype(int) + 1, bool)
    samples = np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3)])
    inside[tuple(np.floor((samples - low) / CELL).astype(int).T)] = True
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    near = distance_transform_edt(~inside, sampling=CELL) <= NEAR_SKIN + longest + 2 * CELL
    cells = np.argwhere(near)
    squared, nearest, _ = igl.point_mesh_squared_distance(
        low + (cells + 0.5) * CELL, np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    )
    inside[:] = False
    inside[tuple(cells[bare[nearest] & (squared < NEAR_SKIN**2)].T)] = True
    return SpaceAboveSkin(low, inside)
