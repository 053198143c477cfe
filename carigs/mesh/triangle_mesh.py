"""What must hold of a triangle mesh before anything is solved on it, and its basic measures."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from carigs.errors import MeshError

NO_AREA = 1e-14
"""In squares of the bounding box's diagonal: smaller faces have no normal."""


def check_mesh(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Raise `MeshError` naming the first vertex or face that no solver can use.

    Refused are: other shapes than (v, 3) and (f, 3), no faces, faces that are not of integers, values that are not
    finite, indices out of range, repeated corners, faces without area, vertices without a face, and edges of three or
    more faces.
    """
    check_corners(vertices, faces)
    _refuse(~np.isfinite(vertices).all(axis=1), "vertex", "is not finite")
    _refuse((faces == np.roll(faces, 1, axis=1)).any(axis=1), "face", "repeats a corner")
    _refuse(face_areas(vertices, faces) <= NO_AREA * diagonal(vertices) ** 2, "face", "has no area")
    _refuse(np.bincount(faces.ravel(), minlength=len(vertices)) == 0, "vertex", "belongs to no face")
    check_edges(faces)


def check_corners(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Raise `MeshError` unless there are faces and all have three corners that are vertices: finite where used."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise MeshError(f"expected (v, 3) vertices and (f, 3) faces, found {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise MeshError(f"faces must be vertex numbers, found {faces.dtype}")
    _refuse(((faces < 0) | (faces >= len(vertices))).any(axis=1), "face", "has a corner that is no vertex")
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    _refuse(used & ~np.isfinite(vertices).all(axis=1), "vertex", "is not finite")


def check_edges(faces: Int[np.ndarray, "f 3"]) -> None:
    """Raise `MeshError` for an edge of three or more faces."""
    edges, count = unique_edges(faces)
    if (count > 2).any():
        i, j = edges[count > 2][0]
        raise MeshError(f"edge {i}-{j} belongs to {count[count > 2][0]} faces; a surface has at most 2")


def diagonal(vertices: Float[np.ndarray, "v 3"]) -> float:
    """Length of the bounding box's diagonal."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def size(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Four times the surface's root-mean-square distance from its centroid.

    For heads this is the bounding box's diagonal within 5 %, but it does not change when the mesh is rotated.
    """
    vertices = vertices - vertices[0]  # sums far from the origin lose digits
    centroids, shares = barycenters(vertices, faces), face_areas(vertices, faces)
    shares /= shares.sum()
    x, y, z = (centroids - shares @ centroids).T
    return 4 * float(np.sqrt(shares @ (x * x + y * y + z * z)))


def barycenters(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """The mean of each face's corners."""
    return igl.barycenter(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))


def face_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " f"]:
    """Area of each face."""
    return igl.doublearea(np.asarray(vertices, np.float64), np.asarray(faces, np.int64)) / 2


def face_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Unit normal of each face."""
    return igl.per_face_normals(np.asarray(vertices, np.float64), np.asarray(faces, np.int64), np.zeros(3))


def signed_volume(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Volume between the faces and the middle of their vertices: negative where faces are turned inwards."""
    middles = barycenters(vertices, faces)
    a, b, c = (vertices - middles.mean(axis=0))[faces.T]
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6)


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    """Unit normals, area-weighted over the faces of each vertex."""
    a, b, c = vertices[faces.T]
    scaled = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    normals = np.stack([np.bincount(faces.ravel(), scaled[:, d], len(vertices)) for d in range(3)], axis=1)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def components(faces: Int[np.ndarray, "f 3"], v: int) -> Int[np.ndarray, " v"]:
    """Label of the connected component of each of the `v` vertices, 0, 1, ..."""
    graph = coo_array((np.ones(faces.size), (faces.ravel(), np.roll(faces, 1, axis=1).ravel())), shape=(v, v))
    return connected_components(graph, directed=False)[1]


def boundary_vertices(faces: Int[np.ndarray, "f 3"], v: int) -> Bool[np.ndarray, " v"]:
    """Whether each vertex lies on an edge of one face only."""
    edges, count = unique_edges(faces)
    on_boundary = np.zeros(v, bool)
    on_boundary[edges[count == 1]] = True
    return on_boundary


def unique_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, " e"]]:
    """Every edge once, its smaller vertex first, and the number of its faces."""
    i, j, n = faces.ravel(), np.roll(faces, 1, axis=1).ravel(), int(faces.max(initial=0)) + 1
    # As one number each they are sorted many times faster than as rows.
    edges, count = np.unique(np.minimum(i, j).astype(np.int64) * n + np.maximum(i, j), return_counts=True)
    return np.stack(np.divmod(edges, n), axis=1), count


def _refuse(bad: Bool[np.ndarray, " n"], what: str, problem: str) -> None:
    if bad.any():
        raise MeshError(f"{what} {int(np.flatnonzero(bad)[0])} {problem} ({int(bad.sum())} in all)")
