"""Isotropic remeshing: split, collapse, flip, relax, project (Botsch and Kobbelt 2004).

`tag` marks vertices on up to two plane borders, one bit each; they stay on them, and no inner edge joins two vertices
of one border, so that the mesh can be mirrored there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from carigs.toy.shape.edits import RING, collapse_all, flip_all, link, relax_all, split_all


def remesh(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    tag: Int[np.ndarray, "v"],
    edge_lengths: Callable[[Float[np.ndarray, "v 3"]], Float[np.ndarray, "v"]],
    project: Callable[[Float[np.ndarray, "v 3"], Int[np.ndarray, "v"]], None],
    rounds: int,
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"], Int[np.ndarray, "w"]]:
    """Give a mesh the edge lengths asked for at its points; `project` puts moved points back onto the surface."""
    mesh = _Mesh.of(vertices, faces, tag)
    for step in range(rounds):
        mesh.size[: mesh.vertices] = edge_lengths(mesh.points[: mesh.vertices])
        for _ in range(8 if step == 0 else 2):
            collapse_all(mesh.points, mesh.tag, mesh.triangles, mesh.ring, mesh.degree, mesh.size, mesh.faces)
        mesh.vertices, mesh.faces = split_all(
            mesh.points, mesh.tag, mesh.triangles, mesh.ring, mesh.degree, mesh.size, mesh.vertices, mesh.faces
        )
        for _ in range(2):
            flip_all(mesh.points, mesh.tag, mesh.triangles, mesh.ring, mesh.degree, mesh.faces)
        mesh = mesh.compact()
        for _ in range(2):
            relax_all(mesh.points, mesh.tag, mesh.triangles, mesh.ring, mesh.degree, mesh.size, mesh.vertices)
            project(mesh.points[: mesh.vertices], mesh.tag[: mesh.vertices])
            mesh.size[: mesh.vertices] = edge_lengths(mesh.points[: mesh.vertices])
    return mesh.points[: mesh.vertices], mesh.triangles[: mesh.faces], mesh.tag[: mesh.vertices]


@dataclass
class _Mesh:
    """Triangles with the list of faces around each vertex, with room to grow; dead faces hold -1."""

    points: np.ndarray
    tag: np.ndarray
    triangles: np.ndarray
    ring: np.ndarray
    degree: np.ndarray
    size: np.ndarray
    vertices: int
    faces: int

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray, tag: np.ndarray) -> _Mesh:
        v, f = len(vertices), len(faces)
        room = v + v // 2 + 64

        def grown(array: np.ndarray, length: int) -> np.ndarray:
            return np.concatenate([array, np.zeros((length - len(array), *array.shape[1:]), array.dtype)])

        ring, degree = np.full((room, RING), -1, np.int32), np.zeros(room, np.int64)
        link(faces, f, ring, degree)
        points, marks = grown(vertices.astype(float), room), grown(tag.astype(np.int64), room)
        return cls(points, marks, grown(faces.astype(np.int64), 2 * room), ring, degree, np.zeros(room), v, f)

    def compact(self) -> _Mesh:
        alive = self.triangles[: self.faces]
        alive = alive[alive[:, 0] >= 0]
        used, faces = np.unique(alive, return_inverse=True)
        mesh = _Mesh.of(self.points[used], faces.reshape(-1, 3), self.tag[used])
        mesh.size[: len(used)] = self.size[used]
        return mesh
