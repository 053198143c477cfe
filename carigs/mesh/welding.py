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
_CANDIDATES, _SAMPLES = 8, 4
"""Border edges that are compared with each, and points on each edge that decide which ones are near."""


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
    same = _without(same, _across_open_slits(vertices, faces, same))
    representative = _merged(np.concatenate([same, short]), v)
    if len(same) and len(_crowded_vertices(representative[faces])):
        found = opposite_vertices(vertices, border_edges(faces))[0]
        same = _without(same, found.pairs[found.turns_back])
        representative = _merged(np.concatenate([same, short]), v)
    found = opposite_vertices(vertices, border_edges(_proper(representative[faces])))[0]
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


def opposite_vertices(
    vertices: Float[np.ndarray, "v 3"], border: BorderEdges
) -> tuple[Opposites, Int[np.ndarray, "n 2"]]:
    """Find where two sides of the border lie edge by edge along each other.

    Chains of edges that lie along others are judged as a whole: they are no seam if the faces of both sides lie upon
    each other, and if they turn back at a vertex, they are one only if they are as good as closed at each of their
    edges. Edges that lie along others without ending where these end belong to the chain, but are not joined.

    Args:
        vertices: Positions, in any unit.
        border: The edges of the border.

    Returns:
        The pairs; and all pairs of ends of edges that lie along each other in chains which turn back and are no seam.
    """
    v = len(vertices)
    sides, is_reversed = _matching_edges(vertices, border)
    along = np.concatenate([sides, _edges_along_others(vertices, border)])
    corners = border.ends[along]  # edge, side, end
    places = np.stack([corners[:, 0, [0, 0, 1, 1]], corners[:, 1, [0, 1, 0, 1]]], axis=2)
    places, place = np.unique(np.sort(places, axis=2) @ [v, 1], return_inverse=True)
    edge, place = np.arange(len(along)), place.reshape(len(along), 4)
    links = np.repeat(edge, 4), len(along) + place.ravel()
    graph = coo_array((np.ones(len(links[0])), links), shape=(len(along) + len(places),) * 2)
    count, part = connected_components(graph, directed=False)
    turns_back = np.zeros(count, bool)
    turns_back[part[len(along) :][places // v == places % v]] = True
    is_matched = np.isin(along, sides)
    all_match = np.ones(count, bool)
    all_match[part[: len(along)][~is_matched.all(axis=1)]] = False
    chain = part[: len(sides)]

    ends = border.ends[sides].swapaxes(1, 2)  # edge, end, side
    ends[is_reversed, :, 1] = ends[is_reversed, ::-1, 1]
    directions = _into_faces(vertices, border)[sides]
    cosine = np.einsum("mx,mx->m", directions[:, 0], directions[:, 1])
    gap = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2).max(axis=1)
    length = np.linalg.norm(vertices[ends[:, 0, 0]] - vertices[ends[:, 1, 0]], axis=1)
    widest = np.zeros(count)
    np.maximum.at(widest, chain, gap)
    total, number = np.bincount(chain, length, count), np.bincount(chain, minlength=count)
    is_closed = all_match & (widest <= HINGE_REACH * total / np.maximum(number, 1))
    is_folded = np.bincount(chain, length * cosine, count) > FOLD * total
    is_seam, chain, pairs = ~is_folded & (~turns_back | is_closed), np.repeat(chain, 2), ends.reshape(-1, 2)
    apart = pairs[:, 0] != pairs[:, 1]
    pairs, chain = pairs[apart], chain[apart]
    in_slits = np.unique(place[np.isin(part[: len(along)], np.flatnonzero(turns_back & ~is_seam))])
    across = np.stack([places[in_slits] // v, places[in_slits] % v], axis=1)
    return Opposites(pairs, chain, turns_back[chain], is_seam[chain]), across


def _across_open_slits(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], same: Int[np.ndarray, "p 2"]
) -> Int[np.ndarray, "n 2"]:
    """Pairs of vertices on the two sides of slits that stay open, of the borders that pairs at one place belong to."""
    border, v = border_edges(faces), len(vertices)
    loop = connected_components(coo_array((np.ones(len(border.ends)), border.ends.T), shape=(v, v)), directed=False)[1]
    inside = same[loop[same[:, 0]] == loop[same[:, 1]], 0]
    if len(inside) == 0:
        return inside.reshape(0, 2)
    chosen = np.isin(loop[border.ends[:, 0]], loop[inside])
    return opposite_vertices(vertices, BorderEdges(*(values[chosen] for values in border)))[1]


def _without(pairs: Int[np.ndarray, "p 2"], others: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "q 2"]:
    """Pairs that are not among others, in either order."""
    n = int(max(pairs.max(initial=0), others.max(initial=0))) + 1
    return pairs[~np.isin(np.sort(pairs, axis=1) @ [n, 1], np.sort(others, axis=1) @ [n, 1])]


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


def _edges_along_others(vertices: Float[np.ndarray, "v 3"], border: BorderEdges) -> Int[np.ndarray, "m 2"]:
    """Each border edge whose middle lies on the border of another face, within the reach, with the edge there.

    Where edges meet in a vertex, there must be a gap between them, and not the tip of a part.
    """
    a, b = vertices[border.ends.T]
    length, middle, count = np.linalg.norm(b - a, axis=1), (a + b) / 2, len(a)
    if count < 2:
        return np.empty((0, 2), np.int64)
    shares = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    samples = (a[:, None] + shares[:, None] * (b - a)[:, None]).reshape(-1, 3)
    farthest = (REACH + 1 / _SAMPLES) * length.max()
    near = cKDTree(samples).query(middle, k=min(_SAMPLES * _CANDIDATES, len(samples)), distance_upper_bound=farthest)[1]
    edge, other = np.repeat(np.arange(count), near.shape[1]), near.ravel() // _SAMPLES
    found = (other < count) & (other != edge)
    edge, other = np.unique(np.stack([edge[found], other[found]], axis=1), axis=0).T
    share = np.einsum("mx,mx->m", middle[edge] - a[other], b[other] - a[other]) / np.maximum(length[other] ** 2, 1e-300)
    offset = a[other] + np.clip(share, 0, 1)[:, None] * (b[other] - a[other]) - middle[edge]
    gap = np.linalg.norm(offset, axis=1)
    across_face = np.einsum("mx,mx->m", offset, _into_faces(vertices, border)[edge])
    is_tip = (border.ends[edge][:, :, None] == border.ends[other][:, None]).any(axis=(1, 2)) & (
        across_face > np.maximum(gap / 2, 1e-9 * length[edge])
    )
    is_along = (gap <= REACH * length[edge]) & (border.face[edge] != border.face[other]) & ~is_tip
    return np.stack([edge, other], axis=1)[is_along]
