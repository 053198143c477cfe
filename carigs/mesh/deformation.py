"""Checks of a deformed mesh against the mesh that it was made from."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import CarigsWarning, MeshError
from carigs.mesh.gaps import warn_of_opened_gaps
from carigs.mesh.self_intersection import self_intersecting_faces
from carigs.mesh.triangle_mesh import diagonal, face_normals

MAX_DISPLACEMENT = 100.0
"""Largest displacement in bounding-box diagonals. Robustly solved heads move by less than 1 up to gamma = 1, and the
literal equation in metres, which changes the size of the head, moves them by less than 10."""
MAX_DAMAGED = 5e-4
"""Share of turned faces, and of faces that newly cut others of their part, above which there is a warning. Robustly
solved heads have none of either at gamma = 0.25, and 0.001 to 0.005 at 0.5."""


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
    cut_before: Bool[np.ndarray, " f"],
) -> None:
    """Refuse a deformation that cannot be meant, and warn of one after which the surface folds, cuts itself or gapes.

    Args:
        vertices: Positions, in any unit.
        displacement: Displacement of each vertex, in the same unit.
        faces: Vertex indices of the triangles.
        label: What was done, for example `level 0.25`.
        cut_before: Faces that cut others before the deformation, from `self_intersecting_faces`.

    Raises:
        MeshError: If a displacement is not finite or is larger than `MAX_DISPLACEMENT` diagonals.

    Warns:
        CarigsWarning: If a share of more than `MAX_DAMAGED` of the faces is turned, or newly cuts others, or if gaps
            between parts open (`carigs.mesh.gaps`).
    """
    with np.errstate(over="ignore"):
        distance = np.linalg.norm(displacement / diagonal(vertices), axis=1)
    if not (distance < MAX_DISPLACEMENT).all():
        vertex = int(np.argmax(np.where(np.isfinite(distance), distance, np.inf)))
        moved_by = f"moves by {distance[vertex]:.3g} times the size of the mesh; at most {MAX_DISPLACEMENT:g} is usable"
        raise MeshError(f"{label}: vertex {vertex} {moved_by}")
    moved = vertices + displacement
    turned = turned_faces(vertices, moved, faces).mean()
    cut = (self_intersecting_faces(moved, faces) & ~cut_before).mean()
    shares = {"turn over": turned, "newly cut others": cut}
    problems = [f"{100 * share:.2g} % of the faces {what}" for what, share in shares.items() if share > MAX_DAMAGED]
    if problems:
        advice = "a level nearer to 0 avoids it"
        warnings.warn(f"{label}: the surface folds: {' and '.join(problems)}; {advice}", CarigsWarning, stacklevel=2)
    warn_of_opened_gaps(vertices, moved, faces, label)
