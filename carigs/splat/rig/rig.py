"""The rig: canonical frames of the triangles, and the motion of each triangle to a posed mesh.

Frames as SurFhead (Lee et al. 2025): the third axis is the normal, the scale (base + height) / 2. The motion of a
triangle is its deformation gradient with the normal direction scaled by the square root of the area ratio (Sumner and
Popovic 2004), split into rotation and stretch by the polar decomposition. Gradients are in `mesh_gradient`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32
from numba import njit

from carigs.errors import MeshError
from carigs.simd import matrix3
from carigs.simd.kernels import INLINE_ALLOC, kernel, parallel_for
from carigs.simd.polar_wide import BLOCK, load_matrix, polar_rotations, store_matrix
from carigs.simd.tuples import add, divide, multiply, subtract, write_row
from carigs.simd.vectors import WIDE, scalar_or_simd
from carigs.splat.rig.face_motion import CENTRE, RECORD_SIZE, RELATIVE_ROTATION, ROTATION, STRETCH, FaceMotion
from carigs.splat.rig.skinning_arguments import KEPT, read3

PART_SIZE = 512
"""Triangles of one task of a parallel loop."""
FRAME_SIZE = 16
"""Numbers of a frame's record: nine, whether surfels keep their size (`KEPT`), and padding."""
DEGENERATE = 1e-6
"""A triangle is degenerate if twice its area is at most this fraction of its longest edge squared."""


@dataclass(frozen=True)
class Rig:
    """The canonical mesh and everything that depends on it alone.

    Attributes:
        vertices: Positions in metres: the subject without expression and pose.
        faces: Vertex indices of the triangles.
        neighbours: Index of the triangle across each edge (01, 12, 20); the own index where there is none.
        scale: k_c = (base + height) / 2 in metres: the unit of triangle-local lengths.
        frame_records: `frame` row by row, `keeps_size`, then padding: what a kernel reads at once.
        inverse_edges: E^-1 with E = [v1 - v0, v2 - v0, normal sqrt(2 area)]; zeros for a degenerate triangle.
    """

    vertices: Float64[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    neighbours: Int32[np.ndarray, "f 3"]
    scale: Float64[np.ndarray, " f"]
    frame_records: Float32[np.ndarray, "f 16"]
    inverse_edges: Float64[np.ndarray, "f 3 3"]

    @property
    def frame(self) -> Float32[np.ndarray, "f 3 3"]:
        """k_c R_c with R_c = [edge, towards the third corner, normal]: canonical from triangle-local."""
        return self.frame_records[:, :9].reshape(-1, 3, 3)

    @property
    def keeps_size(self) -> Bool[np.ndarray, " f"]:
        """Triangles whose surfels are as large on every posed mesh as on the canonical one, such as those of brows."""
        return self.frame_records[:, KEPT] > 0

    def with_kept_size(self, inside: Bool[np.ndarray, " f"]) -> Rig:
        """The same rig with other triangles whose surfels keep their size.

        Args:
            inside: The triangles.

        Returns:
            A new rig.
        """
        records = self.frame_records.copy()
        records[:, KEPT] = inside
        return replace(self, frame_records=records)


def build_rig(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Rig:
    """Build the rig of a canonical mesh.

    Args:
        vertices: Canonical positions in metres.
        faces: Vertex indices of the triangles.

    Returns:
        The rig. Degenerate triangles have the identity as frame, and move with their neighbours.

    Raises:
        MeshError: If a vertex is not finite.
    """
    vertices = _finite(vertices)
    faces = np.ascontiguousarray(faces, np.int32)
    scale, frame, inverse_edges = _frames(vertices, faces)
    records = np.zeros((len(faces), FRAME_SIZE), np.float32)
    records[:, :9] = (scale[:, None, None] * frame).reshape(-1, 9)
    return Rig(vertices, faces, edge_neighbours(faces), scale, records, inverse_edges)


def _finite(vertices: Float[np.ndarray, "v 3"]) -> Float64[np.ndarray, "v 3"]:
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise MeshError(f"vertex {int(np.argmax(bad))} of the mesh is not finite ({int(bad.sum())} of {len(bad)})")
    return np.ascontiguousarray(vertices, np.float64)


def edge_neighbours(faces: Int[np.ndarray, "f 3"]) -> Int32[np.ndarray, "f 3"]:
    """Find the triangle across each edge.

    Args:
        faces: Vertex indices of the triangles.

    Returns:
        Index of the triangle across the edges 01, 12 and 20; the own index at a boundary, and where more than two
        triangles meet.
    """
    n = len(faces)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64), axis=1)
    key = edges[:, 0] * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    a, b = order[first[count == 2]], order[first[count == 2] + 1]
    across = np.repeat(np.arange(n), 3)
    across[a], across[b] = b // 3, a // 3
    return across.reshape(n, 3).astype(np.int32)


def face_motion(
    rig: Rig,
    posed: Float[np.ndarray, "v 3"],
    average: Callable[..., None] | None = None,
    solidify: Callable[..., None] | None = None,
) -> FaceMotion:
    """Motion of every triangle: Jacobian J = E(posed) E(canonical)^-1 in its polar decomposition.

    E = [v1 - v0, v2 - v0, normal sqrt(2 area)] (Sumner and Popovic 2004). Triangles that are degenerate in either mesh
    take the mean rotation and stretch of their valid neighbours, ring by ring, and the identity if there are none:
    everything stays finite.

    Args:
        rig: Canonical mesh.
        posed: Posed vertices in metres.
        average: Changes rotations and stretches in place, as `SmoothMotion.apply`.
        solidify: Then changes centres, rotations and stretches in place, as `SolidMotion.apply`.

    Returns:
        The motion of every triangle.

    Raises:
        MeshError: If a vertex is not finite.
    """
    centre, rotation, stretch, _ = polar_decomposition(rig, posed)
    if average is not None:
        average(rotation, stretch)
    if solidify is not None:
        solidify(centre, rotation, stretch)
    return FaceMotion(motion_records(rig, centre, rotation, stretch))


def polar_decomposition(
    rig: Rig, posed: Float[np.ndarray, "v 3"]
) -> tuple[
    Float64[np.ndarray, "f 3"], Float64[np.ndarray, "f 3 3"], Float64[np.ndarray, "f 3 3"], Bool[np.ndarray, " f"]
]:
    """Centre, rotation and stretch of every triangle, see `face_motion`.

    Args:
        rig: Canonical mesh.
        posed: Posed vertices in metres.

    Returns:
        Centre T (metres), rotation U, symmetric stretch P with J = U P, and whether these are the triangle's own: false
        where it is degenerate and follows its neighbours.

    Raises:
        MeshError: If a vertex is not finite.
    """
    centre, rotation, stretch, valid = _polar_decompositions(_finite(posed), rig.faces, rig.inverse_edges)
    if not valid.all():
        _follow_neighbours(rotation, stretch, valid, rig.neighbours)
    return centre, rotation, stretch, valid


def motion_records(
    rig: Rig,
    centre: Float64[np.ndarray, "f 3"],
    rotation: Float64[np.ndarray, "f 3 3"],
    stretch: Float64[np.ndarray, "f 3 3"],
    dtype: type = np.float32,
) -> Float[np.ndarray, "f 32"]:
    """Arrange the results of `polar_decomposition` as the records of a `FaceMotion`.

    Args:
        rig: Canonical mesh.
        centre: Centre of every posed triangle in metres.
        rotation: Rotation U of every triangle.
        stretch: Stretch P of every triangle.
        dtype: Type of the records.

    Returns:
        One record per triangle.
    """
    records = np.zeros((len(rig.faces), RECORD_SIZE), dtype)
    _write_motion_records(centre, rotation, stretch, rig.neighbours, records)
    return records


def _follow_neighbours(
    rotation: Float64[np.ndarray, "f 3 3"],
    stretch: Float64[np.ndarray, "f 3 3"],
    valid: Bool[np.ndarray, " f"],
    neighbours: Int32[np.ndarray, "f 3"],
) -> None:
    """Give triangles that are not valid the mean motion of valid neighbours, in place, ring by ring."""
    valid = valid.copy()
    while True:
        missing = np.flatnonzero(~valid)
        known = valid[neighbours[missing]]
        missing, known = missing[known.any(axis=1)], known[known.any(axis=1)]
        if len(missing) == 0:
            return  # the rest keeps the identity
        weight = (known / known.sum(axis=1, keepdims=True))[:, :, None, None]
        left, _, right = np.linalg.svd((weight * rotation[neighbours[missing]]).sum(axis=1))
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        rotation[missing] = left @ right
        stretch[missing] = (weight * stretch[neighbours[missing]]).sum(axis=1)
        valid[missing] = True


@scalar_or_simd
def _edges(vertices, faces, f):
    """E of a triangle, and whether it is not degenerate."""
    i, j, k = read3(faces, f)
    origin = read3(vertices, i)
    a, b = subtract(read3(vertices, j), origin), subtract(read3(vertices, k), origin)
    c, third = matrix3.cross(a, b), subtract(b, a)
    area = math.sqrt(matrix3.dot(c, c))
    longest = max(matrix3.dot(a, a), matrix3.dot(b, b), matrix3.dot(third, third))
    valid = area > DEGENERATE * longest
    n = multiply(1.0 / math.sqrt(area) if valid else 0.0, c)
    return (a[0], b[0], n[0], a[1], b[1], n[1], a[2], b[2], n[2]), valid


@kernel
def _frames(vertices, faces):
    n = len(faces)
    scale, frame, inverse = np.zeros(n), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    for f in range(n):
        e, valid = _edges(vertices, faces, f)
        edge, other, normal = e[0::3], e[1::3], e[2::3]
        base = math.sqrt(matrix3.dot(edge, edge))
        if not valid:
            matrix3.store(frame, f, matrix3.IDENTITY)
            scale[f] = base / 2
            continue
        x, z = divide(edge, base), divide(normal, math.sqrt(matrix3.dot(normal, normal)))
        y = matrix3.cross(z, x)
        matrix3.store(frame, f, matrix3.transpose((*x, *y, *z)))
        scale[f] = (base + y[0] * other[0] + y[1] * other[1] + y[2] * other[2]) / 2
        c = matrix3.cofactor(e)
        det = e[0] * c[0] + e[1] * c[1] + e[2] * c[2]
        for i in range(9):
            inverse[f, i % 3, i // 3] = c[i] / det
    return scale, frame, inverse


@njit(**INLINE_ALLOC)
def _polar_decompositions_part(part, posed, faces, inverse_edges, centre, rotation, stretch, valid):
    """Decompositions of the triangles of a part, `WIDE` at a time; the last ones fill up with the last triangle."""
    end, block = min((part + 1) * PART_SIZE, len(faces)), np.empty(BLOCK)
    for first in range(part * PART_SIZE, end, WIDE):
        for r in range(WIDE):
            f = min(first + r, end - 1)
            i, j, k = read3(faces, f)
            write_row(centre, f, divide(add(add(read3(posed, i), read3(posed, j)), read3(posed, k)), 3))
            e, posed_valid = _edges(posed, faces, f)
            inverse = matrix3.load(inverse_edges, f)
            # det E = (2 area)^1.5 > 0 in both meshes: a triangle in space has no mirror image, U is a rotation.
            valid[f] = posed_valid and (inverse[0] != 0.0 or inverse[1] != 0.0 or inverse[2] != 0.0)
            jacobian = matrix3.product(e, inverse) if valid[f] else matrix3.IDENTITY
            matrix3.store(stretch, f, jacobian)
            store_matrix(block, r, jacobian)
        polar_rotations(block)
        for r in range(min(WIDE, end - first)):
            f, u = first + r, load_matrix(block, r)
            p = matrix3.product(matrix3.transpose(u), matrix3.load(stretch, f))
            xy, xz, yz = 0.5 * (p[1] + p[3]), 0.5 * (p[2] + p[6]), 0.5 * (p[5] + p[7])
            matrix3.store(rotation, f, u)
            matrix3.store(stretch, f, (p[0], xy, xz, xy, p[4], yz, xz, yz, p[8]))


@kernel
def _polar_decompositions(posed, faces, inverse_edges):
    n = len(faces)
    centre, rotation, stretch = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    valid = np.empty(n, np.bool_)
    arguments = (posed, faces, inverse_edges, centre, rotation, stretch, valid)
    parallel_for(_polar_decompositions_part, (n + PART_SIZE - 1) // PART_SIZE, arguments)
    return centre, rotation, stretch, valid


@scalar_or_simd
def _motion_record(f, centre, rotation, stretch, neighbours, records):
    """The record of a triangle. Vectors between two triangles differ by the sign: the lower index writes both."""
    k = 0
    for i in range(3):
        records[f, CENTRE + i] = centre[f, i]
        for j in range(3):
            records[f, ROTATION + 3 * i + j] = rotation[f, i, j]
            if j >= i:
                records[f, STRETCH + k] = stretch[f, i, j]
                k += 1
    own = matrix3.transpose(matrix3.load(rotation, f))
    for s in range(3):
        g = neighbours[f, s]
        if g > f:
            vector = matrix3.rotation_vector(matrix3.product(own, matrix3.load(rotation, g)))
            for c in range(3):
                records[f, RELATIVE_ROTATION + 3 * s + c] = vector[c]
            for t in range(3):
                if neighbours[g, t] == f:
                    for c in range(3):
                        records[g, RELATIVE_ROTATION + 3 * t + c] = -vector[c]


@kernel
def _write_motion_records(centre, rotation, stretch, neighbours, records):
    parallel_for(_motion_record, len(records), (centre, rotation, stretch, neighbours, records))
