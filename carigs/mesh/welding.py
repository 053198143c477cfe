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

    A seam is left open where welding it would give an edge more than two faces: there more than two borders meet, or
    lips that are closed would be joined so that faces beside them coincide.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, without duplicates.
        same_place: Vertices of the border, and ends of an edge, at most this far apart are at the same place.

    Returns:
        Index of the first of the vertices that each vertex is welded with.
    """
    v = len(vertices)
    border = np.flatnonzero(boundary_vertices(faces, v)) if len(faces) else np.empty(0, np.int64)
    same = border[cKDTree(vertices[border]).query_pairs(same_place, output_type="ndarray")] if len(border) else []
    # The slivers beside a short edge have no area; removing them without collapsing the edge would leave a crack.
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    short = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) <= same_place
    same, short = np.reshape(same, (-1, 2)).astype(np.int64), edges[short]
    representative = _merged(np.concatenate([same, short]), v)
    if len(same) and len(_crowded_vertices(representative[faces])):
        found = opposite_vertices(vertices, faces)
        around_holes = np.sort(found.pairs[found.turns_back], axis=1) @ [v, 1]
        same = same[~np.isin(np.sort(same, axis=1) @ [v, 1], around_holes)]
        representative = _merged(np.concatenate([same, short]), v)
    found = opposite_vertices(vertices, _proper(representative[faces]))
    seams = Opposites(*(values[found.is_seam] for values in found))
    while len(seams.pairs):
        welded = _merged(np.concatenate([same, short, seams.pairs]), v)
        crowded = np.isin(welded[seams.pairs], _crowded_vertices(welded[faces])).any(axis=1)
        if not crowded.any():
            return welded
        is_left = crowded | (seams.turns_back & np.isin(seams.chain, seams.chain[crowded]))
        seams = Opposites(*(values[~is_left] for values in seams))
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


class Opposites(NamedTuple):
    """Pairs of vertices that lie opposite each other on two sides of the border."""

    pairs: Int[np.ndarray, "p 2"]
    chain: Int[np.ndarray, " p"]
    """Number of the chain of border edges that follow each other."""
    turns_back: Bool[np.ndarray, " p"]
    """Whether the two sides of the chain meet in a vertex, as lips do in the corners of a mouth."""
    is_seam: Bool[np.ndarray, " p"]
    """Whether the chain is a seam."""


def opposite_vertices(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Opposites:
    """Find where two sides of the border lie edge by edge along each other.

    Chains of such edges are judged as a whole: they are no seam if the faces of both sides lie upon each other, and if
    they turn back at a vertex, they are one only if they are as good as closed.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, without duplicates.

    Returns:
        The pairs.
    """
    border = border_edges(faces)
    sides, is_reversed = _matching_edges(vertices, border)
    ends = border.ends[sides].swapaxes(1, 2)  # edge, end, side
    ends[is_reversed, :, 1] = ends[is_reversed, ::-1, 1]
    directions = _into_faces(vertices, border)[sides]
    cosine = np.einsum("mx,mx->m", directions[:, 0], directions[:, 1])
    places, place = np.unique(np.sort(ends, axis=2) @ [len(vertices), 1], return_inverse=True)
    place = place.reshape(-1, 2)
    graph = coo_array((np.ones(len(place)), place.T), shape=(len(places),) * 2)
    count, chain_of_place = connected_components(graph, directed=False)
    chain, turns_back = chain_of_place[place[:, 0]], np.zeros(count, bool)
    turns_back[chain_of_place[places // len(vertices) == places % len(vertices)]] = True
    gap = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2).max(axis=1)
    length = np.linalg.norm(vertices[ends[:, 0, 0]] - vertices[ends[:, 1, 0]], axis=1)
    widest = np.zeros(count)
    np.maximum.at(widest, chain, gap)
    total = np.bincount(chain, length, count)
    is_closed = widest <= HINGE_REACH * total / np.bincount(chain, minlength=count)
    is_folded = np.bincount(chain, length * cosine, count) > FOLD * total
    is_seam, chain, pairs = ~is_folded & (~turns_back | is_closed), np.repeat(chain, 2), ends.reshape(-1, 2)
    apart = pairs[:, 0] != pairs[:, 1]
    pairs, chain = pairs[apart], chain[apart]
    return Opposites(pairs, chain, turns_back[chain], is_seam[chain])


def _proper(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    """Faces with three corners, each once."""
    return unique_faces(faces[(np.roll(faces, 1, axis=1) != faces).all(axis=1)])


def _merged(pairs: Int[np.ndarray, "p 2"], v: int) -> Int[np.ndarray, " v"]:
    """Index of the first vertex of each group that pairs connect."""
    if len(pairs) == 0:
        return np.arange(v)
    group = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(v, v)), directed=False)[1]
    return np.unique(group, return_index=True)[1][group]


def _crowded_vertices(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " n"]:
    """Vertices of edges with more than two faces."""
    edges, count = unique_edges(_proper(faces))
    return np.unique(edges[count > 2])


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
