"""Gaps between borders of parts that lie side by side and are not joined: a deformation may open them."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from carigs.errors import CarigsWarning
from carigs.mesh.welding import border_edges

REACH, BESIDE = 0.3, 0.05
"""Widest gap, in mean lengths of the border edges at its vertex: in general, and between edges that meet in a vertex,
as the lips do in the corners of a mouth, where the border is always near."""
OPENS, SEEN = 1.5, 0.02
"""A gap opens if it becomes this many times as wide, and as wide as this share of the edges."""
_SAMPLES, _CANDIDATES = 8, 32
"""Points on each border edge, and the nearest of them that are looked at from each vertex."""


class Gaps(NamedTuple):
    """Vertices of a border, and the point of another border edge that is nearest to each."""

    vertex: Int[np.ndarray, " n"]
    edge: Int[np.ndarray, "n 2"]
    share: Float[np.ndarray, " n"]
    """Where on the edge the point lies: 0 at its first end, 1 at the second."""
    scale: Float[np.ndarray, " n"]
    """Mean length of the border edges at the vertex, in the unit of the mesh."""

    def widths(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " n"]:
        """Distance of each vertex from its point.

        Args:
            vertices: Positions.

        Returns:
            Widths, in the unit of the positions.
        """
        first, second = vertices[self.edge.T]
        point = first + self.share[:, None] * (second - first)
        return np.linalg.norm(vertices[self.vertex] - point, axis=1)


def find_gaps(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Gaps:
    """Find gaps that are at most as wide as `REACH` and `BESIDE` say.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        The gaps, each seen from the vertices of both sides.
    """
    ends = border_edges(faces).ends
    if len(ends) == 0:
        return Gaps(np.empty(0, np.int64), ends, np.empty(0), np.empty(0))
    start, along = vertices[ends[:, 0]], vertices[ends[:, 1]] - vertices[ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    border, place = np.unique(ends, return_inverse=True)
    place = place.reshape(-1, 2)
    scale = np.bincount(place.ravel(), np.repeat(length, 2)) / np.bincount(place.ravel())
    shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    samples = start[:, None] + shares[:, None] * along[:, None]
    count = min(_CANDIDATES, len(ends) * _SAMPLES)
    near = cKDTree(samples.reshape(-1, 3)).query(vertices[border], k=count)[1] // _SAMPLES
    vertex, edge = np.repeat(np.arange(len(border)), count), near.ravel()
    offset = vertices[border[vertex]] - start[edge]
    share = np.einsum("nx,nx->n", offset, along[edge]) / np.maximum(length[edge] ** 2, 1e-300)
    share = np.clip(share, 0, 1)
    width = np.linalg.norm(offset - share[:, None] * along[edge], axis=1)
    chosen = np.flatnonzero(width <= REACH * scale[vertex])
    v = len(border)
    neighbours = np.concatenate([place @ [v, 1], place @ [1, v]])
    is_beside = np.isin(vertex[chosen, None] * v + place[edge[chosen]], neighbours).any(axis=1)
    is_own = (place[edge[chosen]] == vertex[chosen, None]).any(axis=1)
    chosen = chosen[~is_own & (~is_beside | (width[chosen] <= BESIDE * scale[vertex[chosen]]))]
    chosen = chosen[np.lexsort((width[chosen], vertex[chosen]))]
    chosen = chosen[np.unique(vertex[chosen], return_index=True)[1]]
    return Gaps(border[vertex[chosen]], ends[edge[chosen]], share[chosen], scale[vertex[chosen]])


def warn_of_opened_gaps(
    vertices: Float[np.ndarray, "v 3"], moved: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], label: str
) -> None:
    """Warn of gaps that a deformation opens.

    Args:
        vertices: Positions, in any unit.
        moved: Positions after the deformation.
        faces: Vertex indices of the triangles.
        label: What was done, for example `level 0.25`.

    Warns:
        CarigsWarning: Gaps become `OPENS` times as wide, and wide enough to be seen.
    """
    gaps = find_gaps(vertices, faces)
    before, after = gaps.widths(vertices), gaps.widths(moved)
    opens = (after > OPENS * before) & (after > SEEN * gaps.scale)
    if opens.any():
        sizes = f"{before[opens].max():.2g} before and {after[opens].max():.2g} after (in the unit of the mesh)"
        problem = f"borders of parts that are not joined gape at {opens.sum()} vertices, by up to {sizes}"
        warnings.warn(
            f"{label}: {problem}; merge their vertices where the parts belong together", CarigsWarning, stacklevel=2
        )
