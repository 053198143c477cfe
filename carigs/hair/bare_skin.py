"""The space right above bare skin, where no hair can be: the skin is seen."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

NEAR_SKIN = 0.01
"""Metres above bare skin up to which there is no hair: the blur of outlines, and errors of tracking, look like it."""
CELL = 0.002
"""Edge of a cell in metres."""
UNKNOWN, OUTSIDE, INSIDE = 0, 1, 2
"""States of a cell; unknown ones have not been computed."""


class SpaceAboveSkin:
    """Cells of a grid whose nearest triangle is bare, at a distance of less than `NEAR_SKIN`.

    Cells are computed when they are first asked for: hair reaches few of them.

    Args:
        vertices: Vertices of the canonical head in metres.
        faces: Vertex indices of the triangles.
        bare: Triangles that carry no hair, and that nothing covers. If there is none, the space is empty.
    """

    low: Float[np.ndarray, "3"]
    """Corner of the grid in metres."""

    def __init__(
        self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], bare: Bool[np.ndarray, " f"]
    ) -> None:
        self._vertices, self._faces, self._bare = np.asarray(vertices, np.float64), np.asarray(faces, np.int64), bare
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)
        self.low, shape = np.zeros(3), np.zeros(3, int)
        if bare.any():
            corners = self._vertices[self._faces[bare]]
            margin = NEAR_SKIN + CELL
            self.low = corners.min(axis=(0, 1)) - margin
            shape = np.ceil((corners.max(axis=(0, 1)) + margin - self.low) / CELL).astype(int) + 1
        self._cells = np.zeros(shape, np.int8)

    def contains(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether points lie in this space.

        Args:
            points: Points in metres, in the axes of the canonical head.

        Returns:
            True for those in one of the cells.
        """
        cell = np.floor((points - self.low) / CELL).astype(np.int64)
        on_grid = ((cell >= 0) & (cell < self._cells.shape)).all(axis=1)
        cell = cell[on_grid]
        self._compute(np.unique(cell[self._cells[tuple(cell.T)] == UNKNOWN], axis=0))
        found = np.zeros(len(points), bool)
        found[on_grid] = self._cells[tuple(cell.T)] == INSIDE
        return found

    def grid(self) -> Bool[np.ndarray, "i j k"]:
        """Compute all cells.

        Returns:
            Whether each cell belongs to this space.
        """
        if self._cells.size:
            corners = self._vertices[self._faces[self._bare]]
            far = np.ones(self._cells.shape, bool)
            samples = np.concatenate([corners.mean(axis=1), corners.reshape(-1, 3)])
            far[tuple(np.floor((samples - self.low) / CELL).astype(int).T)] = False
            longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
            far = distance_transform_edt(far, sampling=CELL) > NEAR_SKIN + longest + 2 * CELL
            self._cells[far] = OUTSIDE
            self._compute(np.argwhere(self._cells == UNKNOWN))
        return self._cells == INSIDE

    def _compute(self, cells: Int[np.ndarray, "n 3"]) -> None:
        if len(cells):
            centres = self.low + (cells + 0.5) * CELL
            squared, nearest, _ = self._tree.squared_distance(self._vertices, self._faces, centres)
            inside = self._bare[nearest] & (squared < NEAR_SKIN**2)
            self._cells[tuple(cells.T)] = np.where(inside, INSIDE, OUTSIDE)
