"""Measures and connectivity of triangle meshes: areas, normals, size, components, edges and boundary."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def diagonal(vertices: Float[np.ndarray, "v 3"]) -> float:
    """Length of the bounding box's diagonal.

    Args:
        vertices: Positions, in any unit.

    Returns:
        The length, in the unit of the vertices.
    """
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def size(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Size of a surface: four times its root-mean-square distance from its centroid.

    For heads this is the bounding box's diagonal within 5 %, but it does not change when the mesh is rotated.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        The size, in the unit of the vertices.
    """
    vertices = vertices - vertices[0]  # sums far from the origin lose digits
    centroids, area_shares = barycenters(vertices, faces), face_areas(vertices, faces)
    area_shares /= area_shares.sum()
    x, y, z = (centroids - area_shares @ centroids).T
    return 4 * float(np.sqrt(area_shares @ (x * x + y * y + z * z)))


def barycenters(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Mean of the corners of each face.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        Positions, in the unit of the vertices.
    """
    return igl.barycenter(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))


def face_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Area of each face.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        Areas, in the squared unit of the vertices.
    """
    return igl.doublearea(np.asarray(vertices, np.float64), np.asarray(faces, np.int64)) / 2


def face_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Unit normal of each face.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, counterclockwise seen from outside.

    Returns:
        Unit vectors; 0 for a face without area.
    """
    return igl.per_face_normals(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), np.zeros(3))


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    """Unit normal of each vertex: the area-weighted mean of the normals of its faces.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, counterclockwise seen from outside.

    Returns:
        Unit vectors; 0 for a vertex without faces.
    """
    a, b, c = vertices[faces.T]
    scaled = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normals = np.stack([np.bincount(faces.ravel(), scaled[:, d], len(vertices)) for d in range(3)], axis=1)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def signed_volume(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Volume between the faces and their mean barycenter (divergence theorem).

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        The volume, in the cubed unit of the vertices; negative if the faces point inwards.
    """
    centroids = barycenters(vertices, faces)
    a, b, c = (vertices - centroids.mean(axis=0))[faces.T]
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6)


def components(faces: Int[np.ndarray, "f 3"], v: int) -> Int[np.ndarray, " v"]:
    """Connected components of a mesh.

    Args:
        faces: Vertex indices of the triangles.
        v: Number of vertices.

    Returns:
        Label 0, 1, ... of the component of each vertex.
    """
    graph = coo_array((np.ones(faces.size), (faces.ravel(), np.roll(faces, 1, axis=1).ravel())), shape=(v, v))
    return connected_components(graph, directed=False)[1]


def boundary_vertices(faces: Int[np.ndarray, "f 3"], v: int) -> Bool[np.ndarray, " v"]:
    """Vertices on the boundary of an open surface.

    Args:
        faces: Vertex indices of the triangles.
        v: Number of vertices.

    Returns:
        Whether each vertex lies on an edge of only one face.
    """
    edges, count = unique_edges(faces)
    on_boundary = np.zeros(v, bool)
    on_boundary[edges[count == 1]] = True
    return on_boundary


def unique_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, " e"]]:
    """Undirected edges of a mesh.

    Args:
        faces: Vertex indices of the triangles.

    Returns:
        Each edge once, the smaller vertex index first, and the number of faces at each edge.
    """
    i, j, n = faces.ravel(), np.roll(faces, 1, axis=1).ravel(), int(faces.max(initial=0)) + 1
    # An edge is encoded as one integer: integers are sorted many times faster than rows.
    edges, count = np.unique(np.minimum(i, j).astype(np.int64) * n + np.maximum(i, j), return_counts=True)
    return np.stack(np.divmod(edges, n), axis=1), count


def neighbour_pairs(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Ordered pairs of neighbouring vertices, one in each direction for every edge of every face.

    Args:
        faces: Vertex indices of the triangles.

    Returns:
        The vertices (i, j) of the pairs. An edge of two faces occurs twice in each direction.
    """
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    return np.concatenate([i, j]), np.concatenate([j, i])
