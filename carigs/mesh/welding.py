"""Which vertices of a mesh are one: those of borders at the same place, and those of the two sides of a seam.

Parts of a mesh that were rounded, or moved, on their own have seams that gape by a little. Two border edges are sides
of a seam if the ends of one lie at the ends of the other and their faces do not lie upon each other. What merely
touches is none: lips and lids without a border, an eyeball in its socket, a border whose vertices are elsewhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from carigs.mesh.triangle_mesh import boundary_vertices, unique_edges

REACH = 0.1
"""Largest distance between the ends of two edges of a seam, in lengths of the shorter edge."""
HINGE_REACH = 2e-3
"""The same where the two sides meet in a vertex, in mean lengths of the seam's edges: the border of a mouth or an eye
turns back in its corners, and lips or lids that touch must not be joined. What rounding leaves apart is narrower."""
FOLD = 0.5
"""Largest mean cosine of the angle between the two faces at the edges of a seam. Above, the faces lie upon each other,
as those of lips that roll inwards."""
_CANDIDATES = 8
"""Border edges with the nearest middles that are compared with each."""


class BorderEdges(NamedTuple):
    """Edges that belong to one face."""

    ends: Int[np.ndarray, "e 2"]
    opposite: Int[np.ndarray, " e"]
    """The third corner of the edge's face."""
    face: Int[np.ndarray, " e"]


def weld(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], same_place: float) -> Int[np.ndarray, " v"]:
    """Find the vertices that are one.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, without duplicates.
        same_place: Vertices of the border, and ends of an edge, at most this far apart are at the same place.

    Returns:
        Index of the first of the vertices that each vertex is welded with.
    """
    identity = np.arange(len(vertices))
    border = np.flatnonzero(boundary_vertices(faces, len(vertices))) if len(faces) else identity[:0]
    same = border[cKDTree(vertices[border]).query_pairs(same_place, output_type="ndarray")] if len(border) else []
    # The slivers beside a short edge have no area; removing them without collapsing the edge would leave a crack.
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    short = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) <= same_place
    pairs = np.concatenate([np.reshape(same, (-1, 2)), edges[short]]).astype(np.int64)
    representative = _merged(pairs, len(vertices))
    seams = seam_pairs(vertices, _proper(representative[faces]))
    while len(seams):
        welded = _merged(np.concatenate([pairs, seams]), len(vertices))
        edges, count = unique_edges(_proper(welded[faces]))
        is_doubtful = np.isin(welded[seams], edges[count > 2]).any(axis=1)  # more than two borders meet there
        if not is_doubtful.any():
            return welded
        seams = seams[~is_doubtful]
    return representative


def unique_faces(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    """Remove faces that have the same corners as an earlier one.

    Args:
        faces: Vertex indices of the triangles.

    Returns:
        The others, in their order.
    """
    # Corners are encoded as integers, which are compared several times faster than rows.
    (a, b, c), n = np.sort(faces, axis=1).T, int(faces.max(initial=0)) + 1
    pair = np.unique(a * n + b, return_inverse=True)[1]
    return faces[np.sort(np.unique(pair * n + c, return_index=True)[1])]


def border_edges(faces: Int[np.ndarray, "f 3"]) -> BorderEdges:
    """Find the edges that belong to one face.

    Args:
        faces: Vertex indices of the triangles, without duplicates.

    Returns:
        The edges.
    """
    i, j, k = (np.roll(faces, -shift, axis=1).ravel() for shift in range(3))
    keys = np.minimum(i, j).astype(np.int64) * (int(faces.max(initial=0)) + 1) + np.maximum(i, j)
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    chosen = first[count == 1]
    return BorderEdges(np.stack([i, j], axis=1)[chosen], k[chosen], chosen // 3)


def seam_pairs(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "p 2"]:
    """Find the vertices that lie at the same place of a seam.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, without duplicates.

    Returns:
        Pairs of vertices; those that belong to no seam are in none.
    """
    border = border_edges(faces)
    sides, is_reversed = _matching_edges(vertices, border)
    if len(sides) == 0:
        return np.empty((0, 2), np.int64)
    ends = border.ends[sides].swapaxes(1, 2)  # edge, end, side
    ends[is_reversed, :, 1] = ends[is_reversed, ::-1, 1]
    directions = _into_faces(vertices, border)[sides]
    cosine = np.einsum("mx,mx->m", directions[:, 0], directions[:, 1])
    pairs = ends[_is_seam(vertices, np.sort(ends, axis=2), cosine)].reshape(-1, 2)
    return pairs[pairs[:, 0] != pairs[:, 1]]


def _proper(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    """Faces with three corners, each once."""
    return unique_faces(faces[(np.roll(faces, 1, axis=1) != faces).all(axis=1)])


def _merged(pairs: Int[np.ndarray, "p 2"], v: int) -> Int[np.ndarray, " v"]:
    """Index of the first vertex of each group that pairs connect."""
    if len(pairs) == 0:
        return np.arange(v)
    group = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(v, v)), directed=False)[1]
    return np.unique(group, return_index=True)[1][group]


def _into_faces(vertices: Float[np.ndarray, "v 3"], border: BorderEdges) -> Float[np.ndarray, "e 3"]:
    """Unit vector from each edge into its face, at right angles to the edge."""
    a, b = vertices[border.ends.T]
    along = (b - a) / np.maximum(np.linalg.norm(b - a, axis=1, keepdims=True), 1e-300)
    across = vertices[border.opposite] - a
    across -= np.einsum("ex,ex->e", across, along)[:, None] * along
    return across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)


def _matching_edges(
    vertices: Float[np.ndarray, "v 3"], border: BorderEdges
) -> tuple[Int[np.ndarray, "m 2"], Bool[np.ndarray, " m"]]:
    """Pairs of border edges that are each other's nearest within the reach, and whether they run in opposite ways."""
    a, b = vertices[border.ends.T]
    length, middle, count = np.linalg.norm(b - a, axis=1), (a + b) / 2, len(a)
    if count < 2:
        return np.empty((0, 2), np.int64), np.empty(0, bool)
    farthest = REACH * length.max() * (1 + 1e-9)
    near = cKDTree(middle).query(middle, k=min(_CANDIDATES + 1, count), distance_upper_bound=farthest)[1]
    edge, other = np.repeat(np.arange(count), near.shape[1]), near.ravel()
    found = (other < count) & (other != edge)  # the number of edges stands for none
    edge, other = edge[found], other[found]
    alike, opposite = (
        np.maximum(np.linalg.norm(a[edge] - p[other], axis=1), np.linalg.norm(b[edge] - q[other], axis=1))
        for p, q in ((a, b), (b, a))
    )
    gap = np.minimum(alike, opposite)
    fits = np.flatnonzero(gap <= REACH * np.minimum(length[edge], length[other]))
    order = fits[np.lexsort((other[fits], gap[fits], edge[fits]))]
    with_nearest, first = np.unique(edge[order], return_index=True)
    nearest, is_reversed = np.full(count, -1), np.zeros(count, bool)
    nearest[with_nearest] = other[order[first]]
    is_reversed[with_nearest] = (opposite < alike)[order[first]]
    mutual = np.flatnonzero((nearest[nearest] == np.arange(count)) & (np.arange(count) < nearest))
    return np.stack([mutual, nearest[mutual]], axis=1), is_reversed[mutual]


def _is_seam(
    vertices: Float[np.ndarray, "v 3"], ends: Int[np.ndarray, "m 2 2"], cosine: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " m"]:
    """Whether pairs of edges belong to a seam.

    Chains of such pairs that follow each other are judged as a whole: faces that lie upon each other are not sides of a
    seam, and a border that turns back at a vertex, as around a mouth, is one only if it is as good as closed.
    """
    low, high = ends.reshape(-1, 2).T
    places, place = np.unique(low * len(vertices) + high, return_inverse=True)
    place = place.reshape(-1, 2)
    graph = coo_array((np.ones(len(place)), place.T), shape=(len(places),) * 2)
    count, chain_of_place = connected_components(graph, directed=False)
    turns_back, chain = np.zeros(count, bool), chain_of_place[place[:, 0]]
    turns_back[chain_of_place[places // len(vertices) == places % len(vertices)]] = True
    gap = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2).max(axis=1)
    length = np.linalg.norm(vertices[ends[:, 0, 0]] - vertices[ends[:, 1, 0]], axis=1)
    widest = np.zeros(count)
    np.maximum.at(widest, chain, gap)
    total = np.bincount(chain, length)
    is_closed = widest <= HINGE_REACH * total / np.bincount(chain)
    is_folded = np.bincount(chain, length * cosine) > FOLD * total
    return (~is_folded & (~turns_back | is_closed))[chain]
