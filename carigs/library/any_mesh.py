"""The caricature of any triangle mesh, in one call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration import Exaggerator
from carigs.mesh.gaps import warn_of_opened_gaps
from carigs.mesh.regions import vertex_field
from carigs.mesh.repair import clean_mesh
from carigs.settings import Exaggerate


def exaggerate(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    gamma: float,
    regions: Mapping[str, Int[np.ndarray, " _"]] | None = None,
    levels: Mapping[str, float] | None = None,
    **options: Any,
) -> Float[np.ndarray, "v 3"]:
    """Exaggerate a mesh: gradients of the surface grow with its curvature (paper, equations 1 to 3).

    To try several levels, keep a `carigs.exaggeration.Exaggerator`: it factorizes the equation once.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.
        gamma: Level; 0 returns the mesh as it is, 0.5 is about the most that is useful.
        regions: Vertices of regions by name.
        levels: Levels of some of the regions, instead of `gamma`.
        **options: Fields of `carigs.settings.Exaggerate`, such as `limit_cavities=False`.

    Returns:
        Positions of the caricature, in the order and unit of the input.

    Raises:
        MeshError: If the mesh cannot be exaggerated.
        SettingsError: If an option, a region or a level is not valid.

    Warns:
        CarigsWarning: Gaps between parts that are not joined open.

    Example:
        >>> import carigs, trimesh
        >>> ball = trimesh.creation.icosphere(subdivisions=3)
        >>> squashed = ball.vertices * [1.0, 0.8, 0.6]
        >>> caricature = carigs.exaggerate(squashed, ball.faces, 0.3)
        >>> caricature.shape == squashed.shape
        True
    """
    vertices = np.asarray(vertices, np.float64)
    clean = clean_mesh(vertices, np.asarray(faces))
    fields = {name: clean.from_input(vertex_field(ids, len(vertices), name)) for name, ids in (regions or {}).items()}
    solver = Exaggerator(clean.vertices, clean.faces, Exaggerate(**options), regions=fields)
    if gamma == 0 and levels:  # nothing but the regions
        displacement = sum(solver.local_edit(name).solve(level) for name, level in levels.items())
    else:
        displacement = solver.solve(gamma, levels)
    warn_of_opened_gaps(clean.vertices, clean.vertices + displacement, clean.faces, f"level {gamma:g}")
    return vertices + clean.to_input(displacement)
