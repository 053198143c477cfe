"""Isotropic remeshing to a sizing field (Botsch and Kobbelt 2004). All lengths are in millimetres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from carigs.toy.shape import edge_operations as edges


def remesh(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    border: Int[np.ndarray, " v"],
    target_edge_lengths: Callable[[Float[np.ndarray, "v 3"]], Float[np.ndarray, " v"]],
    project: Callable[[Float[np.ndarray, "v 3"], Int[np.ndarray, " v"]], None],
    rounds: int,
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"], Int[np.ndarray, " w"]]:
    """Give a mesh the edge lengths of a sizing field: collapse, split, flip, relax, project.

    Args:
        vertices: Positions, in millimetres.
        faces: Vertex indices of the triangles.
        border: Bits of the planar borders that a vertex lies on (up to two). Vertices on a border stay on it, and no
            inner edge joins two vertices of one border, so that the mesh can be mirrored there.
        target_edge_lengths: The sizing field: edge length at positions, in millimetres.
        project: Moves positions back onto the surface, in place; its second argument is `border`.
        rounds: Number of passes.

    Returns:
        Positions, faces and border bits of the new mesh.
    """
    mesh = edges.editable_mesh(vertices, faces, border, target_edge_lengths(vertices))
    v, f = len(vertices), len(faces)
    for step in range(rounds):
        for _ in range(8 if step == 0 else 2):
            edges.collapse_short_edges(mesh, f)
        v, f = edges.split_long_edges(mesh, v, f)
        for _ in range(2):
            edges.flip_edges(mesh, f)
        used, faces = np.unique(mesh.faces[:f][mesh.faces[:f, 0] >= 0], return_inverse=True)
        v, f = len(used), len(faces)
        mesh = edges.editable_mesh(mesh.points[used], faces, mesh.border[used], mesh.size[used])
        for _ in range(2):
            edges.relax_vertices(mesh, v)
            project(mesh.points[:v], mesh.border[:v])
            mesh.size[:v] = target_edge_lengths(mesh.points[:v])
    return mesh.points[:v], mesh.faces[:f], mesh.border[:v]
