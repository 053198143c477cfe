"""What moves the surfels: triangle-local frames on the canonical mesh, and each triangle's motion to a posed mesh.

Frames as SurFhead (Lee et al. 2025): third axis = normal, scale = (base + height) / 2.  Motions are deformation
gradients with the normal direction scaled by the square root of the area ratio (Sumner and Popović 2004), split into
rotation and stretch by the polar decomposition.  No torch here: gradients of the mesh are in `mesh_gradient`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32

from carigs.errors import MeshError
from carigs.simd import matrix3
from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.face_motion import CENTRE, MOTION_ROW, ROTATION, STRETCH, TURN, FaceMotion

DEGENERATE = 1e-6
"""Twice the area over the longest edge squared below which a triangle has no usable frame."""


@dataclass(frozen=True)
class Rig:
    """The canonical mesh and what is fixed once it is known."""

    vertices: Float64[np.ndarray, "v 3"]
    """Metres; the subject without expression and pose."""
    faces: Int32[np.ndarray, "f 3"]
    neighbours: Int32[np.ndarray, "f 3"]
    """The face across each edge (01, 12, 20); the own face where there is none."""
    scale: Float64[np.ndarray, "f"]
    """k_c = (base + height) / 2 in metres: the unit of triangle-local lengths."""
    frame_rows: Float32[np.ndarray, "f 16"]
    """`frame` row by row, then spare numbers: what a kernel reads at once."""
    canonical_edges: Float64[np.ndarray, "f 3 3"]
    """E^-1 with E = [v1 - v0, v2 - v0, normal sqrt(2 area)]; zeros for a degenerate triangle."""

    @property
    def frame(self) -> Float32[np.ndarray, "f 3 3"]:
        """k_c R_c with R_c = [edge, towards the third corner, normal]: canonical from triangle-local."""
        return self.frame_rows[:, :9].reshape(-1, 3, 3)


def build_rig(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Rig:
    """Frames of the canonical mesh; degenerate triangles get some frame and move with their neighbours.

    Raises `MeshError` for a vertex that is not finite.
    """
    vertices = _finite(vertices)
    faces = np.ascontiguousarray(faces, np.int32)
    scale, frame, inverse = _frames(vertices, faces)
    rows = np.zeros((len(faces), 16), np.float32)
    rows[:, :9] = (scale[:, None, None] * frame).reshape(-1, 9)
    return Rig(vertices, faces, edge_neighbours(faces), scale, rows, inverse)


def _finite(vertices: Float[np.ndarray, "v 3"]) -> Float64[np.ndarray, "v 3"]:
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise MeshError(f"vertex {int(np.argmax(bad))} of the mesh is not finite ({int(bad.sum())} of {len(bad)})")
    return np.ascontiguousarray(vertices, np.float64)


def edge_neighbours(faces: Int[np.ndarray, "f 3"]) -> Int32[np.ndarray, "f 3"]:
    """The face across each of the edges (01, 12, 20); the own face at a boundary or where more than two faces meet."""
    n = len(faces)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64), axis=1)
    key = edges[:, 0] * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    a, b = order[first[count == 2]], order[first[count == 2] + 1]
    across = np.repeat(np.arange(n), 3)
    across[a], across[b] = b // 3, a // 3
    return across.reshape(n, 3).astype(np.int32)


def face_motion(rig: Rig, posed: Float[np.ndarray, "v 3"]) -> FaceMotion:
    """Each triangle's Jacobian J = E(posed) E(canonical)^-1 and its polar parts.

    Triangles without area in either mesh take the mean rotation and stretch of their sound neighbours, ring by ring,
    and the identity if there are none: everything stays finite.  Raises `MeshError` for a vertex that is not.
    """
    centre, rotation, stretch, _ = polar_motion(rig, posed)
    return FaceMotion(rows_of(rig, centre, rotation, stretch))


def polar_motion(
    rig: Rig, posed: Float[np.ndarray, "v 3"]
) -> tuple[
    Float64[np.ndarray, "f 3"], Float64[np.ndarray, "f 3 3"], Float64[np.ndarray, "f 3 3"], Bool[np.ndarray, "f"]
]:
    """T, U, P of every triangle, and whether they are its own; raises `MeshError` for a vertex that is not finite."""
    centre, rotation, stretch, sound = _motion(_finite(posed), rig.faces, rig.canonical_edges)
    if not sound.all():
        _follow_neighbours(rotation, stretch, sound, rig.neighbours)
    return centre, rotation, stretch, sound


def rows_of(
    rig: Rig,
    centre: Float64[np.ndarray, "f 3"],
    rotation: Float64[np.ndarray, "f 3 3"],
    stretch: Float64[np.ndarray, "f 3 3"],
    dtype: type = np.float32,
) -> Float[np.ndarray, "f 32"]:
    """What `polar_motion` found as rows of a `FaceMotion`."""
    rows = np.zeros((len(rig.faces), MOTION_ROW), dtype)
    rows[:, STRETCH:CENTRE] = stretch[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    rows[:, CENTRE:ROTATION] = centre
    rows[:, ROTATION:TURN] = rotation.reshape(-1, 9)
    rows[:, TURN : TURN + 9] = _turns(rotation, rig.neighbours).reshape(-1, 9)
    return rows


def jacobians(motion: FaceMotion) -> Float64[np.ndarray, "f 3 3"]:
    """J = U P of every face."""
    stretch = motion.stretch.astype(np.float64)[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return motion.rotation.astype(np.float64) @ stretch


def _follow_neighbours(
    rotation: Float64[np.ndarray, "f 3 3"],
    stretch: Float64[np.ndarray, "f 3 3"],
    sound: Bool[np.ndarray, "f"],
    neighbours: Int32[np.ndarray, "f 3"],
) -> None:
    sound = sound.copy()
    while True:
        lost = np.flatnonzero(~sound)
        known = sound[neighbours[lost]]
        lost, known = lost[known.any(axis=1)], known[known.any(axis=1)]
        if len(lost) == 0:
            return  # the rest keeps the identity
        weight = (known / known.sum(axis=1, keepdims=True))[:, :, None, None]
        left, _, right = np.linalg.svd((weight * rotation[neighbours[lost]]).sum(axis=1))
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        rotation[lost] = left @ right
        stretch[lost] = (weight * stretch[neighbours[lost]]).sum(axis=1)
        sound[lost] = True


@scalar_or_simd
def _edges(vertices, faces, f):
    """E of a face, and whether it has an area."""
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    ax, ay, az = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
    bx, by, bz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    area = math.sqrt(cx * cx + cy * cy + cz * cz)
    third = (bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2
    longest = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz, third)
    sound = area > DEGENERATE * longest
    g = 1.0 / math.sqrt(area) if sound else 0.0
    return (ax, bx, cx * g, ay, by, cy * g, az, bz, cz * g), sound


@kernel
def _frames(vertices, faces):
    n = len(faces)
    scale, frame, inverse = np.zeros(n), np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    for f in range(n):
        e, sound = _edges(vertices, faces, f)
        base = math.sqrt(e[0] ** 2 + e[3] ** 2 + e[6] ** 2)
        if not sound:
            matrix3.store(frame, f, matrix3.IDENTITY)
            scale[f] = base / 2
            continue
        length = math.sqrt(e[2] ** 2 + e[5] ** 2 + e[8] ** 2)
        ex, ey, ez = e[0] / base, e[3] / base, e[6] / base
        nx, ny, nz = e[2] / length, e[5] / length, e[8] / length
        ux, uy, uz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
        matrix3.store(frame, f, (ex, ux, nx, ey, uy, ny, ez, uz, nz))
        scale[f] = (base + ux * e[1] + uy * e[4] + uz * e[7]) / 2
        c = matrix3.cofactor(e)
        det = e[0] * c[0] + e[1] * c[1] + e[2] * c[2]
        for i in range(9):
            inverse[f, i % 3, i // 3] = c[i] / det
    return scale, frame, inverse


@scalar_or_simd
def _face_motion(f, posed, faces, canonical_edges, centre, rotation, stretch, sound):
    for c in range(3):
        centre[f, c] = (posed[faces[f, 0], c] + posed[faces[f, 1], c] + posed[faces[f, 2], c]) / 3
    e, posed_sound = _edges(posed, faces, f)
    inverse = matrix3.load(canonical_edges, f)
    # det E = (2 area)^1.5 > 0 in both meshes: a triangle in space has no mirror image, so U is a proper rotation.
    sound[f] = posed_sound and (inverse[0] != 0.0 or inverse[1] != 0.0 or inverse[2] != 0.0)
    u = p = matrix3.IDENTITY
    if sound[f]:
        jacobian = matrix3.product(e, inverse)
        u = matrix3.polar_rotation(jacobian)
        p = matrix3.product(matrix3.transpose(u), jacobian)
    matrix3.store(rotation, f, u)
    xy, xz, yz = 0.5 * (p[1] + p[3]), 0.5 * (p[2] + p[6]), 0.5 * (p[5] + p[7])
    matrix3.store(stretch, f, (p[0], xy, xz, xy, p[4], yz, xz, yz, p[8]))


@kernel
def _motion(posed, faces, canonical_edges):
    n = len(faces)
    centre = np.empty((n, 3))
    rotation, stretch = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    sound = np.empty(n, np.bool_)
    parallel_for(_face_motion, n, (posed, faces, canonical_edges, centre, rotation, stretch, sound))
    return centre, rotation, stretch, sound


@scalar_or_simd
def _face_turns(f, rotation, neighbours, turn):
    own = matrix3.transpose(matrix3.load(rotation, f))
    for s in range(3):
        g, vector = neighbours[f, s], (0.0, 0.0, 0.0)
        if g != f:
            vector = matrix3.rotation_vector(matrix3.product(own, matrix3.load(rotation, g)))
        for c in range(3):
            turn[f, s, c] = vector[c]


@kernel
def _turns(rotation, neighbours):
    turn = np.empty((len(rotation), 3, 3))
    parallel_for(_face_turns, len(rotation), (rotation, neighbours, turn))
    return turn
