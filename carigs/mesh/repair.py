"""The door for meshes from anywhere: what can be mended is, what cannot be has a name, and results find their way back.

Seams are welded at the boundary only: two closed surfaces that touch stay two.  Edges of no length are collapsed.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from carigs.errors import MeshError
from carigs.mesh.triangle_mesh import (
    NO_AREA,
    boundary_vertices,
    check_corners,
    check_edges,
    components,
    diagonal,
    face_areas,
    signed_volume,
)

OUTWARDS = 1e-3
"""In (area)^1.5: components that enclose less are sheets, which have no inside."""


@dataclass(frozen=True)
class MeshReport:
    """What was found and mended."""

    vertices: int
    faces: int
    unused_vertices: int
    """Belong to no face: they do not move."""
    welded_vertices: int
    """Lie on another one's place, as along a texture's seam, and move with it."""
    repeated_corners: int
    """Faces with the same vertex twice, left out, as are the next two."""
    without_area: int
    duplicate_faces: int
    turned_faces: int
    """Had their corners in the other order than their neighbours, or faced inwards."""
    components: int
    boundary_loops: int

    def __str__(self) -> str:
        found = asdict(self)
        mended = {name: n for name, n in found.items() if n and name not in ("vertices", "faces")}
        details = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in mended.items())
        return f"{self.vertices} vertices, {self.faces} faces: {details}"


@dataclass(frozen=True)
class CleanMesh:
    """A mesh that `check_mesh` accepts, and where its vertices come from."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    of_given: Int[np.ndarray, "g"]
    """The vertex here of every vertex given; -1 where that was not used."""
    report: MeshReport

    def to_given(self, displacement: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "g 3"]:
        """Displacements of the vertices as they were given; unused ones stay."""
        return np.where(self.of_given[:, None] >= 0, displacement[self.of_given], 0.0)

    def from_given(self, values: Float[np.ndarray, " g"]) -> Float[np.ndarray, " v"]:
        """Numbers per vertex as given, such as a painted region; the largest of those that became one vertex."""
        used = self.of_given >= 0
        here = np.full(len(self.vertices), -np.inf)
        np.maximum.at(here, self.of_given[used], values[used])
        return here


def clean_mesh(vertices: np.ndarray, faces: np.ndarray, weld: float = 1e-7) -> CleanMesh:
    """Weld, drop and turn until the mesh is one that can be solved on.

    `weld` is the largest distance of vertices that are one, in bounding box diagonals of the used vertices.  Raises
    `MeshError` with the numbers of the mesh as given: for wrong shapes, corners that are no vertices or not finite, no
    face that is left, and edges of three or more faces.
    """
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    check_corners(vertices, faces)
    given, faces_given = np.asarray(vertices, np.float64), faces.astype(np.int64)
    proper = faces_given[(np.roll(faces_given, 1, axis=1) != faces_given).all(axis=1)]
    faces = _single(proper)  # or the boundary would not be seen where a face beside it lies twice
    extent = diagonal(given[np.unique(faces)]) if len(faces) else 0.0
    first = _welded(given, faces, weld * extent)
    welded = first[faces]
    whole = (np.roll(welded, 1, axis=1) != welded).all(axis=1)
    with_area = whole & (face_areas(given, welded) > NO_AREA * extent**2)
    kept = welded[with_area]
    if len(kept) == 0:
        raise MeshError(f"none of the {len(faces_given)} faces has an area")
    single = _single(kept)
    duplicates, kept = len(proper) - len(faces) + len(kept) - len(single), single
    check_edges(kept)
    used, corner = np.unique(kept, return_inverse=True)
    clean, corner = given[used], corner.reshape(-1, 3)
    turned, count = _turn(clean, corner)
    place = np.full(len(given), -1)
    place[used] = np.arange(len(used))
    of_given = place[first]
    report = MeshReport(
        vertices=len(given),
        faces=len(faces_given),
        unused_vertices=int((of_given < 0).sum()),
        welded_vertices=int((first != np.arange(len(given))).sum()),
        repeated_corners=len(faces_given) - len(proper) + int((~whole).sum()),
        without_area=int((whole & ~with_area).sum()),
        duplicate_faces=duplicates,
        turned_faces=count,
        components=int(components(turned, len(clean)).max()) + 1,
        boundary_loops=len(igl.boundary_loop_all(turned)),
    )
    return CleanMesh(clean, turned, of_given, report)


def _single(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    """The first of the faces that have the same corners."""
    # As numbers they are compared several times faster than as rows.
    (a, b, c), n = np.sort(faces, axis=1).T, int(faces.max(initial=0)) + 1
    pair = np.unique(a * n + b, return_inverse=True)[1]
    return faces[np.sort(np.unique(pair * n + c, return_index=True)[1])]


def _welded(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], reach: float) -> Int[np.ndarray, "v"]:
    """For every vertex the first of those that are one with it."""
    first = np.arange(len(vertices))
    boundary = np.flatnonzero(boundary_vertices(faces, len(vertices))) if len(faces) else first[:0]
    seams = boundary[cKDTree(vertices[boundary]).query_pairs(reach, output_type="ndarray")] if len(boundary) else []
    # The slivers beside such an edge have no area: left out, they would leave a crack.
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    short = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) <= reach
    pairs = np.concatenate([np.reshape(seams, (-1, 2)), edges[short]]).astype(np.int64)
    if len(pairs) == 0:
        return first
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2)
    group = connected_components(graph, directed=False)[1]
    return np.unique(group, return_index=True)[1][group]


def _turn(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "f 3"], int]:
    """Neighbours in the same order; components that enclose something outwards, sheets as most of them was."""
    agreeing, patch = igl.bfs_orient(faces)
    agreeing = agreeing.astype(np.int64)  # from C's long long, which NumPy tells apart
    areas = face_areas(vertices, faces)
    same = agreeing[:, 0] == faces[:, 0]  # a face is turned by reversing its row
    for p in range(int(patch.max()) + 1):
        inside = np.flatnonzero(patch == p)
        volume, area = signed_volume(vertices, agreeing[inside]), areas[inside].sum()
        enclosing = abs(volume) > OUTWARDS * area**1.5
        most = areas[inside][same[inside]].sum() >= area / 2
        if (volume < 0) if enclosing else not most:
            agreeing[inside] = agreeing[inside][:, ::-1]
    return agreeing, int((agreeing[:, 0] != faces[:, 0]).sum())
