"""Registered meshes of a dome: one topology, the vertices of each frame, and matrices as text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, Int

from carigs.capture.calibration.camera_checks import FARTHEST
from carigs.errors import InputError
from carigs.readers.mesh_files.meshes import read_polygons
from carigs.readers.mesh_files.polygons import triangulate_polygons
from carigs.readers.text import decode_text, split_lines

MILLIMETRE = 1e-3
"""Metres in the unit of both datasets."""
MAX_MATRIX_BYTES = 1 << 16
"""Largest text of a matrix."""


@dataclass(frozen=True)
class Surface:
    """Topology of registered meshes without the vertices that no triangle has."""

    file: Path
    """Where it comes from."""
    faces: Int[np.ndarray, "f 3"]
    used: Int[np.ndarray, " v"]
    """Numbers of the vertices in the files of the frames."""
    stored: int
    """How many vertices those files have."""

    @classmethod
    def read(cls, file: Path) -> Surface:
        """Read the topology.

        Args:
            file: A mesh, whose positions do not count.

        Returns:
            The topology.

        Raises:
            InputError: If the file is missing or broken.
        """
        mesh = read_polygons(file)
        used, faces = np.unique(triangulate_polygons(mesh, file), return_inverse=True)
        return cls(file, faces.reshape(-1, 3).astype(np.int32), used, len(mesh.vertices))

    def vertices(self, stored: Float[np.ndarray, "n 3"], file: str | Path) -> Float64[np.ndarray, "v 3"]:
        """Take the vertices of the surface out of those of a frame.

        Args:
            stored: All vertices of a frame in millimetres.
            file: Where they come from, for messages.

        Returns:
            Vertices in metres.

        Raises:
            InputError: If there are more or fewer than the topology has, or one is not finite or too far away.
        """
        if len(stored) != self.stored:
            raise InputError(f"{len(stored)} vertices, {self.file.name} has {self.stored}", file=file)
        vertices = MILLIMETRE * stored[self.used].astype(np.float64)
        far = np.flatnonzero(~(np.abs(vertices) < FARTHEST).all(axis=1))  # NaN as well
        if far.size:
            problem = f"vertex {self.used[far[0]]} is not finite, or {FARTHEST:g} m or more from the origin"
            raise InputError(problem, file=file)
        return vertices


class MeshesOnDisk(Sequence):
    """The vertices of each frame, read when they are asked for.

    Args:
        count: Number of frames.
        read: Reads the vertices of a frame by its position.
    """

    def __init__(self, count: int, read: Callable[[int], Float64[np.ndarray, "v 3"]]) -> None:
        self._count, self._read = count, read

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, place: int) -> Float64[np.ndarray, "v 3"]:
        return self._read(place)


def text_matrix(
    text: bytes | str, shape: tuple[int, int], file: str | Path, field: str | None = None
) -> Float64[np.ndarray, "r c"]:
    """Parse a matrix, a row per line.

    Args:
        text: The text.
        shape: Rows and columns.
        file: Where it comes from, for messages.
        field: Its field, for messages.

    Returns:
        The matrix.

    Raises:
        InputError: If it has another shape, or a word is no finite number.
    """
    text = decode_text(text, file, field) if isinstance(text, bytes) else text
    rows = [line.split() for line in split_lines(text) if line.strip()]
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise InputError(f"expected {shape[0]} lines of {shape[1]} numbers", file=file, field=field)
    try:
        matrix = np.array(rows).astype(np.float64)
    except ValueError as error:
        raise InputError("a word is no number", file=file, field=field) from error
    if not np.isfinite(matrix).all():
        raise InputError("a number is not finite", file=file, field=field)
    return matrix


def rigid_in_metres(rows: Float[np.ndarray, "3 4"]) -> Float64[np.ndarray, "4 4"]:
    """Complete the rows of a rigid transform.

    Args:
        rows: Rotation and translation in millimetres.

    Returns:
        The transform in metres.
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rows[:, :3], MILLIMETRE * rows[:, 3]
    return matrix
