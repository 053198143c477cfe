"""Checks that a triangle mesh must pass before an equation is solved on it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int

from carigs.errors import MeshError
from carigs.mesh.triangle_mesh import diagonal, face_areas, unique_edges

MIN_AREA = 1e-14
"""Smallest area of a face in squares of the bounding box's diagonal; smaller faces have no usable normal."""


def check_mesh(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Check that a mesh can be solved on.

    Args:
        vertices: Positions (v, 3), in any unit.
        faces: Vertex indices (f, 3).

    Raises:
        MeshError: If the shapes differ from (v, 3) and (f, 3), there is no face, the faces do not hold integers, a
            value is not finite, an index is out of range, a face repeats a corner or has no area, a vertex belongs to
            no face, or an edge belongs to three or more faces. The message names the first such vertex or face.
    """
    check_corners(vertices, faces)
    _refuse(~np.isfinite(vertices).all(axis=1), "vertex", "is not finite")
    _refuse((faces == np.roll(faces, 1, axis=1)).any(axis=1), "face", "repeats a corner")
    _refuse(face_areas(vertices, faces) <= MIN_AREA * diagonal(vertices) ** 2, "face", "has no area")
    _refuse(np.bincount(faces.ravel(), minlength=len(vertices)) == 0, "vertex", "belongs to no face")
    check_edges(faces)


def check_corners(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Check that there are faces and that their corners are finite vertices.

    Args:
        vertices: Positions (v, 3), in any unit. Vertices that no face uses may hold any value.
        faces: Vertex indices (f, 3).

    Raises:
        MeshError: If the shapes or types are wrong, an index is out of range, or a used vertex is not finite.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise MeshError(f"expected (v, 3) vertices and (f, 3) faces, found {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise MeshError(f"faces must be vertex numbers, found {faces.dtype}")
    _refuse(((faces < 0) | (faces >= len(vertices))).any(axis=1), "face", "has a corner that is no vertex")
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    _refuse(used & ~np.isfinite(vertices).all(axis=1), "vertex", "is not finite")


def check_edges(faces: Int[np.ndarray, "f 3"]) -> None:
    """Check that the mesh is edge-manifold.

    Args:
        faces: Vertex indices of the triangles.

    Raises:
        MeshError: If an edge belongs to three or more faces.
    """
    edges, count = unique_edges(faces)
    if (count > 2).any():
        i, j = edges[count > 2][0]
        raise MeshError(f"edge {i}-{j} belongs to {count[count > 2][0]} faces; a surface has at most 2")


def _refuse(is_bad: Bool[np.ndarray, " n"], element: str, problem: str) -> None:
    """Raise `MeshError` for the first bad vertex or face, with the number of bad ones."""
    if is_bad.any():
        raise MeshError(f"{element} {int(np.flatnonzero(is_bad)[0])} {problem} ({int(is_bad.sum())} in all)")
