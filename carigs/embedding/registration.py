"""Non-rigid registration of a mesh to a surface: an iterative closest point method with locally affine transforms.

Amberg, Romdhani and Vetter, "Optimal Step Nonrigid ICP Algorithms for Surface Registration", CVPR 2007. Each vertex
has an affine transform of its own; a stiffness that decreases from pass to pass keeps neighbours similar.
"""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, diags_array, eye_array, kron, vstack

from carigs.embedding.anchors import Anchors
from carigs.mesh.linear_solver import CholeskySolver
from carigs.mesh.triangle_mesh import boundary_vertices, face_normals, unique_edges, vertex_normals

STIFFNESS = (64.0, 32.0, 16.0, 8.0, 4.0, 2.0)
PASSES = 4
"""Passes for each stiffness."""
LEAST_COSINE = 0.6
"""Of the angle between the normals of a vertex and of its closest point."""


class Surface(NamedTuple):
    """What a mesh is registered to."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


class ClosestPoints(NamedTuple):
    """The points of a surface that are closest to given ones."""

    distance: Float[np.ndarray, " n"]
    face: Int[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]


def closest_points(points: Float[np.ndarray, "n 3"], surface: Surface) -> ClosestPoints:
    """Find the points of a surface that are closest to given ones.

    Args:
        points: Points, in the unit of the surface.
        surface: The surface.

    Returns:
        Distances, triangles and positions.
    """
    squared, face, position = igl.point_mesh_squared_distance(
        points, np.asarray(surface.vertices, np.float64), np.asarray(surface.faces, np.int64)
    )
    return ClosestPoints(np.sqrt(squared), face.astype(np.int64), position)  # libigl's indices are long long


def register(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "g 3"],
    surface: Surface,
    anchors: Anchors,
) -> Float[np.ndarray, "n 3"]:
    """Deform a mesh until it lies on a surface.

    Args:
        vertices: The mesh, roughly at its place already, in units of about a tenth of its size.
        faces: Its triangles.
        surface: The surface, in the same unit. Closest points on its border do not count.
        anchors: Vertices whose place on the surface is known; a closest point has the weight 1.

    Returns:
        The deformed vertices.
    """
    n = len(vertices)
    edges = unique_edges(faces)[0]
    rows = np.arange(len(edges))
    incidence = csc_array(
        (np.repeat([-1.0, 1.0], len(edges)), (np.tile(rows, 2), edges.T.ravel())), shape=(len(edges), n)
    )
    similar = kron(incidence, eye_array(4), format="csc")
    homogeneous = np.column_stack([vertices, np.ones(n)])
    apply = csc_array((homogeneous.ravel(), np.arange(4 * n), 4 * np.arange(n + 1)), shape=(4 * n, n)).T.tocsc()
    normals_there = face_normals(surface.vertices, surface.faces)
    on_border = boundary_vertices(surface.faces, len(surface.vertices))
    placed = vertices
    for stiffness in STIFFNESS:
        for _ in range(PASSES):
            closest = closest_points(placed, surface)
            agree = np.einsum("nx,nx->n", vertex_normals(placed, faces), normals_there[closest.face]) > LEAST_COSINE
            beyond = _at_border(closest, surface, on_border)
            weights, targets = (agree & ~beyond).astype(np.float64), closest.position.copy()
            weights[anchors.vertices], targets[anchors.vertices] = anchors.weights, anchors.places
            system = vstack([stiffness * similar, diags_array(weights) @ apply], format="csc")
            right = np.concatenate([np.zeros((similar.shape[0], 3)), weights[:, None] * targets])
            solution = CholeskySolver((system.T @ system + 1e-9 * eye_array(4 * n)).tocsc()).solve(system.T @ right)
            placed = apply @ solution
    return placed


def _at_border(closest: ClosestPoints, surface: Surface, on_border: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " n"]:
    """Whether closest points lie on a border: the points are beyond the surface then."""
    corners = surface.faces[closest.face]
    a, b, c = surface.vertices[corners.T]
    weights = igl.barycentric_coordinates(closest.position, a, b, c)
    return (on_border[corners] | (weights < 1e-6)).all(axis=1)
