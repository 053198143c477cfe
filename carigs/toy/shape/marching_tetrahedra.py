"""Isosurface extraction: marching tetrahedra on a regular grid."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
from jaxtyping import Float, Int

# Kuhn's subdivision of the cube: one tetrahedron per order of walking the three axes from corner 000 to corner 111.
# Adjacent cubes split their common face in the same way, so the surface is a manifold for every sign pattern.
_TETRAHEDRA = np.array([np.cumsum([[0, 0, 0], *np.eye(3, dtype=int)[list(p)]], axis=0) for p in permutations(range(3))])


def marching_tetrahedra(
    values: Float[np.ndarray, "nx ny nz"], low: Float[np.ndarray, "3"], step: float
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Triangulate the zero level set of a sampled function (Doi and Koide 1991).

    Args:
        values: Samples on the grid, negative inside.
        low: Position of sample (0, 0, 0), in any unit.
        step: Spacing of the grid, in the same unit.

    Returns:
        Vertices in the unit of the grid, each once, and faces that run counter-clockwise seen from outside. The surface
        is open where it leaves the grid.
    """
    inside = values < 0.0
    nx, ny, nz = (n - 1 for n in values.shape)
    negative = sum(inside[i : i + nx, j : j + ny, k : k + nz].astype(np.int8) for i, j, k in np.ndindex(2, 2, 2))
    strides = np.array([values.shape[1] * values.shape[2], values.shape[2], 1])
    cells = np.argwhere((negative > 0) & (negative < 8)) @ strides
    nodes = cells[:, None, None] + _TETRAHEDRA @ strides  # (cells, 6, 4)
    edges = _CASES[np.arange(6), inside.ravel()[nodes] @ np.array([1, 2, 4, 8])]
    cell, tetrahedron, used = np.nonzero(edges[..., 0] >= 0)
    a, b = edges[cell, tetrahedron, used].T
    start, end = nodes[cell, tetrahedron, a], nodes[cell, tetrahedron, b]
    direction = _TETRAHEDRA[tetrahedron, b] - _TETRAHEDRA[tetrahedron, a]
    # The start of an edge and its direction identify the vertex on it.
    _, first, vertex = np.unique(start * 8 + direction @ [1, 2, 4], return_index=True, return_inverse=True)
    start, end, direction = start[first], end[first], direction[first]
    value = values.ravel()[start]
    weight = value / (value - values.ravel()[end])
    origin = np.stack(np.unravel_index(start, values.shape), axis=1)
    return low + step * (origin + weight[:, None] * direction), vertex.reshape(-1, 3)


def _cases() -> Int[np.ndarray, "6 16 6 2"]:
    """Edges (pairs of corners) that bound up to two triangles, by tetrahedron and inside corners; -1 where unused."""
    table = np.full((6, 16, 6, 2), -1, np.int8)
    for t, case in np.ndindex(6, 16):
        inside, outside = ([c for c in range(4) if (case >> c & 1) == flag] for flag in (1, 0))
        if not inside or not outside:
            continue
        apex, others = (inside, outside) if len(inside) < 3 else (outside, inside)
        if len(inside) == 2:
            (a, b), (c, d) = inside, outside
            edges = [(a, c), (b, c), (b, d), (a, c), (b, d), (a, d)]
        else:
            edges = [(apex[0], other) for other in others]
        odd = sum(x > y for x, y in combinations([*apex, *others], 2)) % 2 == 1
        positive = np.linalg.det(_TETRAHEDRA[t, 1:]) > 0
        if (odd == positive) == (len(inside) == 1):
            edges = [edges[q - q % 3 + 2 - q % 3] for q in range(len(edges))]
        table[t, case, : len(edges)] = np.sort(edges, axis=1)
    return table


_CASES = _cases()
