"""Checks of a deformed mesh against the mesh that it was made from."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import CarigsWarning, MeshError
from carigs.mesh.triangle_mesh import diagonal, face_normals

MAX_DISPLACEMENT = 100.0
"""Largest displacement in bounding-box diagonals. Robustly solved heads move by less than 1 up to gamma = 1, and the
literal equation in metres, which changes the size of the head, moves them by less than 10."""
MAX_TURNED = 0.01
"""Share of turned faces above which a surface is said to be folded."""


def turned_faces(
    vertices: Float[np.ndarray, "v 3"], moved: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Bool[np.ndarray, " f"]:
    """Faces whose normal turns by 90 degrees or more.

    Args:
        vertices: Positions, in any unit.
        moved: Positions after the deformation.
        faces: Vertex indices of the triangles.

    Returns:
        Whether each face is turned, or has lost its area.
    """
    return np.einsum("fx,fx->f", face_normals(vertices, faces), face_normals(moved, faces)) <= 0


def check_deformation(
    vertices: Float[np.ndarray, "v 3"],
    displacement: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    label: str,
) -> None:
    """Refuse a deformation that cannot be meant, and warn of one that folds the surface.

    Args:
        vertices: Positions, in any unit.
        displacement: Displacement of each vertex, in the same unit.
        faces: Vertex indices of the triangles.
        label: What was done, for example `level 0.25`.

    Raises:
        MeshError: If a displacement is not finite or is larger than `MAX_DISPLACEMENT` diagonals.

    Warns:
        CarigsWarning: If a share of more than `MAX_TURNED` of the faces is turned.
    """
    with np.errstate(over="ignore"):
        distance = np.linalg.norm(displacement / diagonal(vertices), axis=1)
    if not (distance < MAX_DISPLACEMENT).all():
        vertex = int(np.argmax(np.where(np.isfinite(distance), distance, np.inf)))
        moved_by = f"moves by {distance[vertex]:.3g} times the size of the mesh; at most {MAX_DISPLACEMENT:g} is usable"
        raise MeshError(f"{label}: vertex {vertex} {moved_by}")
    share = turned_faces(vertices, vertices + displacement, faces).mean()
    if share > MAX_TURNED:
        problem = f"{100 * share:.2g} % of the faces turn over, the surface folds"
        warnings.warn(f"{label}: {problem}; a level nearer to 0 avoids it", CarigsWarning, stacklevel=2)
