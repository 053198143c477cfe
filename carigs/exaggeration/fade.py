"""A caricature that fades to the natural head towards some vertices, which it leaves where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from carigs.exaggeration.gamma_path import GammaPath
from carigs.mesh.triangle_mesh import unique_edges


def faded_path(path: GammaPath, fixed: Int[np.ndarray, " n"], distance: float) -> GammaPath:
    """Let a path fade out towards some vertices.

    Args:
        path: Caricatures of a head.
        fixed: Vertices that stay.
        distance: Length along the edges of the mesh, in metres, over which the rest follows: displacements and changes
            of blendshapes are multiplied by 3 t^2 - 2 t^3, with the distance t from the fixed vertices in this unit.

    Returns:
        The path; the same one if no vertex is fixed.
    """
    if len(fixed) == 0:
        return path
    away = _edge_distances(path.neutral, path.faces, fixed)
    t = np.minimum(away / distance, 1)  # parts that do not hang together with a fixed vertex are infinitely far away
    share = (t * t * (3 - 2 * t)).astype(np.float32)[:, None]
    changes = None if path.changes is None else path.changes * share
    return replace(path, displacements=path.displacements * share, changes=changes)


def _edge_distances(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], sources: Int[np.ndarray, " n"]
) -> Float[np.ndarray, " v"]:
    """Length of the shortest path along edges from any source to each vertex."""
    edges, _ = unique_edges(faces)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = csr_array((lengths, tuple(edges.T)), shape=(len(vertices), len(vertices)))
    return dijkstra(graph, directed=False, indices=sources, min_only=True)
