"""Points on the surface of a mesh, such as landmarks: weighted means of vertices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import InputError
from carigs.readers.arrays import checked_array

TOLERANCE = 1e-3
"""Of sums of barycentric coordinates, which should be 1."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points of triangles, by barycentric coordinates (k = 3), or vertices (k = 1)."""

    corners: Int[np.ndarray, "n k"]
    """Vertices whose weighted mean each point is."""
    barycentric: Float[np.ndarray, "n k"]
    """Their weights, which add up to 1."""

    @classmethod
    def at_vertices(cls, vertices: Int[np.ndarray, " n"]) -> SurfacePoints:
        """Points that are vertices.

        Args:
            vertices: Their indices.

        Returns:
            The points.
        """
        return cls(vertices[:, None], np.ones((len(vertices), 1)))

    def __len__(self) -> int:
        """Number of points."""
        return len(self.corners)

    def __getitem__(self, chosen: Any) -> SurfacePoints:
        """Some of the points.

        Args:
            chosen: A slice or indices.

        Returns:
            The points.
        """
        return SurfacePoints(self.corners[chosen], self.barycentric[chosen])

    def joined(self, others: SurfacePoints) -> SurfacePoints:
        """These points and others.

        Args:
            others: Points of the same mesh; vertices may follow points of triangles.

        Returns:
            The points.
        """
        missing = self.corners.shape[1] - others.corners.shape[1]
        corners = np.pad(others.corners, ((0, 0), (0, missing)), "edge")
        barycentric = np.pad(others.barycentric, ((0, 0), (0, missing)))
        return SurfacePoints(np.concatenate([self.corners, corners]), np.concatenate([self.barycentric, barycentric]))

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """The points as arrays; `checked_points` is the inverse.

        Args:
            name: Name of the array of the corners.

        Returns:
            `name`: vertices (n,), or the corners of triangles (n, 3) with their coordinates in `{name}_barycentric`.
        """
        if self.corners.shape[1] == 1:
            return {name: self.corners[:, 0]}
        return {name: self.corners, f"{name}_barycentric": self.barycentric}

    def interpolate(self, values: Float[np.ndarray, "v ..."]) -> Float[np.ndarray, "n ..."]:
        """Values at the points.

        Args:
            values: Values at the vertices, for example positions.

        Returns:
            Weighted means in float64.
        """
        return np.einsum("nk,nk...->n...", self.barycentric, values[self.corners])


def checked_points(
    arrays: Mapping[str, Any], name: str, num_points: int, num_vertices: int, file: Path
) -> SurfacePoints:
    """Check points in the form of `SurfacePoints.arrays`.

    Args:
        arrays: Arrays of the file.
        name: Name of the array of the corners.
        num_points: Expected number of points.
        num_vertices: Number of vertices of the mesh.
        file: The file, for messages.

    Returns:
        The points.

    Raises:
        InputError: If an array is missing, of another shape or kind, names a vertex that the mesh lacks, or if the
            coordinates of a point do not add up to 1.
    """
    second = f"{name}_barycentric"
    if second not in arrays:
        vertices = checked_array(arrays, name, (num_points,), np.int64, below=num_vertices, file=file)
        return SurfacePoints.at_vertices(vertices)
    corners = checked_array(arrays, name, (num_points, 3), np.int64, below=num_vertices, file=file)
    barycentric = checked_array(arrays, second, (num_points, 3), np.float64, file=file)
    check_sums(barycentric, file, second)
    return SurfacePoints(corners, barycentric)


def points_of_faces(
    arrays: Mapping[str, Any], names: tuple[str, str], faces: Int[np.ndarray, "f 3"], file: Path
) -> SurfacePoints:
    """Read points that a file gives as indices of faces and barycentric coordinates.

    Args:
        arrays: Arrays of the file. A leading axis of length 1, as some of FLAME's files have, is dropped.
        names: Names of the indices (n,) and of the coordinates (n, 3).
        faces: Triangles of the mesh.
        file: The file, for messages.

    Returns:
        The points.

    Raises:
        InputError: If an array is missing, of another shape or kind, names a face that the mesh lacks, or if the
            coordinates of a point do not add up to 1.
    """
    ids, weights = (_without_batch(checked_array(arrays, name, file=file), i) for i, name in enumerate(names, start=1))
    ids = checked_array({names[0]: ids}, names[0], (None,), np.int64, below=len(faces), file=file)
    weights = checked_array({names[1]: weights}, names[1], (len(ids), 3), np.float64, file=file)
    check_sums(weights, file, names[1])
    return SurfacePoints(faces[ids].astype(np.int64), weights)


def check_sums(barycentric: Float[np.ndarray, "n k"], file: Path, field: str) -> None:
    """Refuse barycentric coordinates that do not add up to 1.

    Args:
        barycentric: The coordinates.
        file: Where they come from, for messages.
        field: Their name, for messages.

    Raises:
        InputError: If those of a point do not.
    """
    wrong = np.flatnonzero(np.abs(barycentric.sum(axis=1) - 1) > TOLERANCE)
    if wrong.size:
        problem = f"the coordinates of point {wrong[0]} add up to {barycentric[wrong[0]].sum():g}, expected 1"
        raise InputError(problem, file=file, field=field)


def _without_batch(array: np.ndarray, axes: int) -> np.ndarray:
    return array[0] if array.ndim == axes + 1 and len(array) == 1 else array
