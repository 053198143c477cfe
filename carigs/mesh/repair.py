"""Repair input meshes and map results back to the vertices of the input.

Seams are welded along borders only (`carigs.mesh.welding`), so two closed surfaces that touch stay separate. Edges of
length zero are collapsed. Of a surface that is there twice, to be seen from both sides, the outer side stays.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import igl
import numpy as np
from jaxtyping import Float, Int

from carigs.errors import MeshError
from carigs.mesh.triangle_mesh import components, diagonal, face_areas, signed_volume
from carigs.mesh.two_sided import one_sided
from carigs.mesh.validation import MIN_AREA, check_corners, check_edges
from carigs.mesh.welding import border_edges, unique_faces, weld

MIN_ENCLOSED_VOLUME = 1e-3
"""In units of area^1.5: a surface that encloses less is a sheet, which has no outside."""
SAME_PLACE = 1e-7
"""Largest distance, in bounding box diagonals, of border vertices that are at the same place."""
FARTHEST = 1000
"""Largest distance of a vertex from the middle of the mesh, in units of the median distance. A head on a body reaches
about ten; beyond thousand, tolerances in units of the mesh's size would remove faces of the rest."""


@dataclass(frozen=True)
class MeshReport:
    """Counts of what an input mesh contained and of what was repaired."""

    vertices: int
    faces: int
    unused_vertices: int
    """Vertices of no face; they are not moved."""
    welded_vertices: int
    """Vertices merged with another one at the same position, or across a seam, as of a texture; they move with it."""
    widest_weld: float
    """Largest distance between merged vertices, in the unit of the mesh."""
    repeated_corners: int
    """Faces removed because a vertex occurs twice in them."""
    without_area: int
    """Faces removed because they have no area."""
    duplicate_faces: int
    """Faces removed because another one has the same corners, as the second side of a two-sided surface."""
    turned_faces: int
    """Faces reversed because they disagreed with their neighbours or faced inwards."""
    components: int
    boundary_loops: int

    def __str__(self) -> str:
        names = [name for name, n in asdict(self).items() if n and name not in ("vertices", "faces", "widest_weld")]
        counts = {name: f"{getattr(self, name)} {name.replace('_', ' ')}" for name in names}
        if self.widest_weld:
            counts["welded_vertices"] += f" (up to {self.widest_weld:.2g} apart)"
        details = ", ".join(counts.values())
        return f"{self.vertices} vertices, {self.faces} faces: {details}"


@dataclass(frozen=True)
class CleanMesh:
    """A mesh that `check_mesh` accepts, with the map from the vertices of the input."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    vertex_map: Int[np.ndarray, " g"]
    """Index in `vertices` of each vertex of the input; -1 for vertices that no face uses."""
    report: MeshReport

    def to_input(self, displacement: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "g 3"]:
        """Map displacements to the vertices of the input.

        Args:
            displacement: Displacement of each vertex of this mesh.

        Returns:
            Displacement of each vertex of the input, in the same unit; 0 for unused vertices.
        """
        return np.where(self.vertex_map[:, None] >= 0, displacement[self.vertex_map], 0.0)

    def from_input(self, values: Float[np.ndarray, " g"]) -> Float[np.ndarray, " v"]:
        """Map values, such as a painted region, from the vertices of the input.

        Args:
            values: A value at each vertex of the input.

        Returns:
            A value at each vertex of this mesh: the largest one of the vertices that were welded.
        """
        used = self.vertex_map >= 0
        mapped = np.full(len(self.vertices), -np.inf)
        np.maximum.at(mapped, self.vertex_map[used], values[used])
        return mapped


def clean_mesh(vertices: np.ndarray, faces: np.ndarray) -> CleanMesh:
    """Weld seams, remove unusable vertices and faces, and orient the faces consistently.

    Args:
        vertices: Positions (g, 3), in any unit.
        faces: Vertex indices (f, 3).

    Returns:
        The repaired mesh.

    Raises:
        MeshError: If the shapes are wrong, a corner is no vertex or not finite, a vertex is `FARTHEST` away from all
            others, no face with an area is left, or an edge belongs to three or more faces. The message uses the
            indices of the input.

    Example:
        >>> clean = clean_mesh(mesh.vertices, mesh.faces)
        >>> displacement = Exaggerator(clean.vertices, clean.faces).solve(0.25)
        >>> caricature = mesh.vertices + clean.to_input(displacement)
    """
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    check_corners(vertices, faces)
    positions, input_faces = np.asarray(vertices, np.float64), faces.astype(np.int64)
    proper = input_faces[(np.roll(input_faces, 1, axis=1) != input_faces).all(axis=1)]
    single, twin = one_sided(positions, proper)
    faces = unique_faces(single)  # a duplicate face would hide the boundary beside it
    extent = diagonal(positions[np.unique(faces)]) if len(faces) else 0.0
    _check_far_vertices(positions, np.unique(faces))
    representative = weld(positions, faces, SAME_PLACE * extent)[twin]
    welded = representative[faces]
    is_proper = (np.roll(welded, 1, axis=1) != welded).all(axis=1)
    has_area = is_proper & (face_areas(positions, welded) > MIN_AREA * extent**2)
    if not has_area.any():
        raise MeshError(f"none of the {len(input_faces)} faces has an area")
    kept = unique_faces(welded[has_area])
    check_edges(kept)
    used, corners = np.unique(kept, return_inverse=True)
    clean_vertices, corners = positions[used], corners.reshape(-1, 3)
    oriented, num_turned = _orient(clean_vertices, corners)
    new_index = np.full(len(positions), -1)
    new_index[used] = np.arange(len(used))
    vertex_map = new_index[representative]
    report = MeshReport(
        vertices=len(positions),
        faces=len(input_faces),
        unused_vertices=int((vertex_map < 0).sum()),
        welded_vertices=int((representative != np.arange(len(positions))).sum()),
        widest_weld=float(np.linalg.norm(positions - positions[representative], axis=1)[np.unique(faces)].max()),
        repeated_corners=len(input_faces) - len(proper) + int((~is_proper).sum()),
        without_area=int((is_proper & ~has_area).sum()),
        duplicate_faces=len(proper) - len(faces) + int(has_area.sum()) - len(kept),
        turned_faces=num_turned,
        components=int(components(oriented, len(clean_vertices)).max()) + 1,
        boundary_loops=len(igl.boundary_loop_all(oriented)),
    )
    return CleanMesh(clean_vertices, oriented, vertex_map, report)


def _check_far_vertices(vertices: Float[np.ndarray, "v 3"], used: Int[np.ndarray, " u"]) -> None:
    """Refuse a stray vertex: sizes are measured in units of the mesh's extent."""
    if len(used) < 4:
        return
    distance = np.linalg.norm(vertices[used] - np.median(vertices[used], axis=0), axis=1)
    ratio = float(distance.max() / max(np.median(distance), 1e-300))
    if ratio > FARTHEST:
        problem = f"is {ratio:.2g} times as far from the middle of the mesh as most others; remove it or its faces"
        raise MeshError(f"vertex {used[distance.argmax()]} {problem}")


def _orient(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "f 3"], int]:
    """Orient neighbours alike, and count the changes.

    Closed components face outwards, and so does the largest one, a head that is open at the neck, if it is no sheet.
    Other open components stay as most of their area was: a socket or the inside of a mouth faces into its hollow.
    """
    oriented, patch = igl.bfs_orient(faces)
    oriented = oriented.astype(np.int64)  # igl returns C's long long, a distinct NumPy type
    areas, count = face_areas(vertices, faces), int(patch.max()) + 1
    is_open = np.bincount(patch[border_edges(faces).face], minlength=count) > 0
    patch_areas = np.bincount(patch, areas)
    unchanged = oriented[:, 0] == faces[:, 0]  # a face is reversed by reversing its row
    for p in range(count):
        members = np.flatnonzero(patch == p)
        volume, area = signed_volume(vertices, oriented[members]), patch_areas[p]
        has_outside = not is_open[p] or p == patch_areas.argmax()
        mostly_unchanged = areas[members][unchanged[members]].sum() >= area / 2
        encloses = has_outside and abs(volume) > MIN_ENCLOSED_VOLUME * area**1.5
        if (volume < 0) if encloses else not mostly_unchanged:
            oriented[members] = oriented[members][:, ::-1]
    return oriented, int((oriented[:, 0] != faces[:, 0]).sum())
