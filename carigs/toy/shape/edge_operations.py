"""Edge operations on a triangle mesh that keep it a manifold: split, collapse, flip; and tangential smoothing.

These are the steps of isotropic remeshing (Botsch and Kobbelt 2004). All lengths are in millimetres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from carigs.simd.kernels import INLINE, kernel
from carigs.simd.matrix3 import cross, dot

MAX_DEGREE = 40  # faces around a vertex


class EditableMesh(NamedTuple):
    """Arrays with room for further vertices and faces.

    `border` has one bit for each of two border planes. Vertices on a border stay on it, and no inner edge joins two
    vertices of one border, so that the mesh can be mirrored there.
    """

    points: np.ndarray
    """Vertex positions, (v, 3), millimetres."""
    border: np.ndarray
    """Bits of the borders that a vertex lies on, (v,)."""
    size: np.ndarray
    """Target edge length at a vertex, (v,), millimetres."""
    faces: np.ndarray
    """Vertex indices, (f, 3); -1 in deleted faces."""
    ring: np.ndarray
    """Faces around a vertex, (v, MAX_DEGREE)."""
    degree: np.ndarray
    """Number of valid entries in `ring`, (v,)."""


def editable_mesh(vertices: np.ndarray, faces: np.ndarray, border: np.ndarray, size: np.ndarray) -> EditableMesh:
    """Build the incidence lists, and reserve room for half as many vertices and faces again.

    Args:
        vertices: Positions, (v, 3), millimetres.
        faces: Vertex indices, (f, 3).
        border: Bits of the borders that a vertex lies on, (v,).
        size: Target edge length at a vertex, (v,), millimetres.

    Returns:
        The mesh; its valid vertices and faces come first.
    """
    v, f = len(vertices), len(faces)
    room = v + v // 2 + 64
    corners = faces.reshape(-1)
    degree = np.bincount(corners, minlength=room)
    order = np.argsort(corners, kind="stable")
    ring = np.full((room, MAX_DEGREE), -1)
    ring[corners[order], np.arange(3 * f) - np.repeat(np.cumsum(degree) - degree, degree)] = order // 3
    return EditableMesh(
        points=np.pad(vertices.astype(float), ((0, room - v), (0, 0))),
        border=np.pad(border.astype(np.int64), (0, room - v)),
        size=np.pad(size, (0, room - v)),
        faces=np.pad(faces.astype(np.int64), ((0, 2 * room - f), (0, 0))),
        ring=ring,
        degree=degree,
    )


@njit(**INLINE)
def _difference(points, a, b):
    return points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]


@njit(**INLINE)
def _distance(points, a, b):
    d = _difference(points, a, b)
    return np.sqrt(dot(d, d))


@njit(**INLINE)
def _corners(mesh, f):
    return mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]


@njit(**INLINE)
def _edge_faces(mesh, a, b):
    """Number of faces at edge (a, b), and (face, third corner) of the first two; twice the same on a border."""
    count, sides = 0, ((-1, -1), (-1, -1))
    for f in mesh.ring[a, : mesh.degree[a]]:
        corners = _corners(mesh, f)
        if b in corners:
            side = (f, sum(corners) - a - b)
            sides = (side, side) if count == 0 else (sides[0], side)
            count += 1
    return count, sides


@njit(**INLINE)
def _unlink(mesh, v, f):
    ring, last, k = mesh.ring, mesh.degree[v] - 1, 0
    while k < last and ring[v, k] != f:
        k += 1
    ring[v, k] = ring[v, last]
    mesh.degree[v] = last


@njit(**INLINE)
def _link(mesh, v, f):
    mesh.ring[v, mesh.degree[v]] = f
    mesh.degree[v] += 1


@njit(**INLINE)
def _replace(mesh, f, old, new):
    """Put a vertex in the place of another one in a face."""
    for k in range(3):
        if mesh.faces[f, k] == old:
            mesh.faces[f, k] = new


@njit(**INLINE)
def _point(points, v):
    return points[v, 0], points[v, 1], points[v, 2]


@njit(**INLINE)
def _place(points, v, position):
    points[v, 0], points[v, 1], points[v, 2] = position


@njit(**INLINE)
def _normal(points, a, b, c):
    """Normal of a triangle, not normalised: twice its area long."""
    return cross(_difference(points, b, a), _difference(points, c, a))


@njit(**INLINE)
def _aligned(n, m, min_cosine):
    norm = np.sqrt(dot(n, n) * dot(m, m))
    return dot(n, m) > min_cosine * norm and norm > 0.0


@kernel
def split_long_edges(mesh, n_vertices, n_faces):
    """Split every edge longer than 4/3 of its target length at its midpoint.

    Args:
        mesh: The mesh, edited in place.
        n_vertices: Number of valid vertices.
        n_faces: Number of faces, deleted ones included.

    Returns:
        The new numbers of vertices and faces.
    """
    points, border, size, faces, _, degree = mesh
    for f in range(n_faces):
        if faces[f, 0] < 0:
            continue
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            count, sides = _edge_faces(mesh, a, b)
            # An inner edge between two border vertices would be doubled by mirroring: it is always split.
            chord = count == 2 and (border[a] & border[b]) != 0
            if not chord and _distance(points, a, b) <= 4.0 / 3.0 * 0.5 * (size[a] + size[b]):
                continue
            if n_vertices >= len(points) or n_faces + 2 >= len(faces):
                return n_vertices, n_faces
            if max(degree[sides[0][1]], degree[sides[1][1]]) >= MAX_DEGREE - 1:
                continue
            m = n_vertices
            n_vertices += 1
            for k in range(3):
                points[m, k] = 0.5 * (points[a, k] + points[b, k])
            size[m] = 0.5 * (size[a] + size[b])
            border[m] = border[a] & border[b] if count == 1 else 0
            for side in range(count):
                g, third = sides[side]
                for k in range(3):
                    faces[n_faces, k] = faces[g, k]
                _replace(mesh, n_faces, a, m)
                _replace(mesh, g, b, m)
                _unlink(mesh, b, g)
                _link(mesh, m, g)
                for v in (b, m, third):
                    _link(mesh, v, n_faces)
                n_faces += 1
    return n_vertices, n_faces


@njit(**INLINE)
def _can_move(mesh, v, other, target):
    """Whether the faces of `v` without `other` keep their orientation and stay small when `v` moves to `target`."""
    points = mesh.points
    old = _point(points, v)
    for f in mesh.ring[v, : mesh.degree[v]]:
        p, q, r = _corners(mesh, f)
        if other in (p, q, r):
            continue
        before = _normal(points, p, q, r)
        _place(points, v, target)
        after = _normal(points, p, q, r)
        longest = max(_distance(points, p, q), _distance(points, q, r), _distance(points, r, p))
        _place(points, v, old)
        if not (_aligned(before, after, 0.7) and longest < 4.0 / 3.0 * mesh.size[v]):
            return False
    return True


@kernel
def collapse_short_edges(mesh, n_faces):
    """Collapse every edge shorter than 4/5 of its target length, where the mesh stays a manifold.

    Args:
        mesh: The mesh, edited in place.
        n_faces: Number of faces, deleted ones included.
    """
    points, border, size, faces, ring, degree = mesh
    mark = np.zeros(len(points), np.int64)  # the last edge for which a vertex was a neighbour of `a`; < 0: of `b`, too
    for f in range(n_faces):
        for c in range(3):
            if faces[f, 0] < 0:
                break
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if _distance(points, a, b) >= 0.8 * 0.5 * (size[a] + size[b]):
                continue
            count, sides = _edge_faces(mesh, a, b)
            # b is merged into a, which must lie on every border that b lies on.
            if border[b] & ~border[a]:
                a, b = b, a
            if border[b] & ~border[a] or (count == 2 and border[b]):
                continue
            # Link condition: the common neighbours are the opposite corners of the edge and no others.
            edge = 3 * f + c + 1
            mark[a] = mark[b] = edge
            neighbours = 0
            for g in ring[a, : degree[a]]:
                for v in _corners(mesh, g):
                    neighbours += mark[v] != edge
                    mark[v] = edge
            mark[a] = mark[b] = -edge
            common = 0
            valid = neighbours + degree[b] < 14
            for g in ring[b, : degree[b]]:
                for v in _corners(mesh, g):
                    if mark[v] == edge:
                        common += 1
                        mark[v] = -edge
                    elif mark[v] != -edge and border[v] & border[a]:
                        # A new inner edge between two border vertices, unless it runs along the border.
                        valid = valid and _edge_faces(mesh, b, v)[0] == 1 and count == 1
            if not valid or common != count:
                continue
            share, p, d = 0.5 if border[a] == border[b] else 0.0, _point(points, a), _difference(points, b, a)
            target = (p[0] + share * d[0], p[1] + share * d[1], p[2] + share * d[2])
            if not (_can_move(mesh, a, b, target) and _can_move(mesh, b, a, target)):
                continue
            _place(points, a, target)
            size[a] = 0.5 * (size[a] + size[b])
            for side in range(count):
                g = sides[side][0]
                for v in _corners(mesh, g):
                    _unlink(mesh, v, g)
                faces[g] = -1
            for g in ring[b, : degree[b]]:
                _replace(mesh, g, b, a)
                _link(mesh, a, g)
            degree[b] = 0


@kernel
def flip_edges(mesh, n_faces):
    """Flip every edge whose flip brings vertex degrees closer to six (three on a border) and keeps the shape.

    Args:
        mesh: The mesh, edited in place.
        n_faces: Number of faces, deleted ones included.
    """
    points, border, _, faces, _, degree = mesh
    for f in range(n_faces):
        if faces[f, 0] < 0:
            continue
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            count, sides = _edge_faces(mesh, a, b)
            if count != 2:
                continue
            # f runs from a to b with third corner c0, the other face from b to a with third corner c1.
            (f0, c0), (f1, c1) = sides if sides[0][0] == f else (sides[1], sides[0])
            if (border[c0] & border[c1]) != 0 or max(degree[c0], degree[c1]) >= MAX_DEGREE - 1:
                continue
            growth = 0  # of the sum of squares
            for v, change in ((a, -1), (b, -1), (c0, 1), (c1, 1)):
                excess = degree[v] - (6 if border[v] == 0 else 3)
                growth += (excess + change) ** 2 - excess**2
            if growth >= 0 or _edge_faces(mesh, c0, c1)[0]:
                continue
            m, k = _normal(points, a, b, c0), _normal(points, b, a, c1)
            p, q = _normal(points, a, c1, c0), _normal(points, b, c0, c1)
            if not (_aligned(m, p, 0.8) and _aligned(m, q, 0.8) and _aligned(k, p, 0.8) and _aligned(k, q, 0.8)):
                continue
            faces[f0], faces[f1] = (a, c1, c0), (b, c0, c1)
            _unlink(mesh, b, f0)
            _unlink(mesh, a, f1)
            _link(mesh, c1, f0)
            _link(mesh, c0, f1)
            break


@kernel
def relax_vertices(mesh, n_vertices):
    """Move vertices towards the weighted centroid of their faces, within the tangent plane or along their border.

    Args:
        mesh: The mesh, edited in place.
        n_vertices: Number of valid vertices.
    """
    points, border, size, _, ring, degree = mesh
    for v in range(n_vertices):
        if degree[v] == 0 or border[v] == 3:
            continue
        x = y = z = 0.0
        if border[v] == 0:
            n = (0.0, 0.0, 0.0)
            total = 0.0
            for f in ring[v, : degree[v]]:
                p, q, r = _corners(mesh, f)
                m = _normal(points, p, q, r)
                weight = np.sqrt(dot(m, m)) / ((size[p] + size[q] + size[r]) / 3.0) ** 2
                total += weight
                n = (n[0] + m[0], n[1] + m[1], n[2] + m[2])
                x += weight * (points[p, 0] + points[q, 0] + points[r, 0]) / 3.0
                y += weight * (points[p, 1] + points[q, 1] + points[r, 1]) / 3.0
                z += weight * (points[p, 2] + points[q, 2] + points[r, 2]) / 3.0
            x, y, z = x / total - points[v, 0], y / total - points[v, 1], z / total - points[v, 2]
            norm = np.sqrt(dot(n, n)) + 1e-30
            n = (n[0] / norm, n[1] / norm, n[2] / norm)
            outward = dot((x, y, z), n)
            x, y, z = x - n[0] * outward, y - n[1] * outward, z - n[2] * outward
        else:
            ends = 0
            for f in ring[v, : degree[v]]:
                for w in _corners(mesh, f):
                    if w != v and (border[w] & border[v]) != 0 and _edge_faces(mesh, v, w)[0] == 1:
                        d = _difference(points, w, v)
                        x, y, z = x + d[0], y + d[1], z + d[2]
                        ends += 1
            x, y, z = x / max(ends, 1), y / max(ends, 1), z / max(ends, 1)
        points[v, 0] += 0.7 * x
        points[v, 1] += 0.7 * y
        points[v, 2] += 0.7 * z
