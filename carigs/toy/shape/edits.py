"""Local edits of a triangle mesh that keep it a manifold: split, collapse and flip edges, move vertices.

A mesh is kept as points, triangles (dead ones hold -1), and the list of faces around each vertex (`ring`, of which
`degree` are valid).  `tag` marks vertices on up to two plane borders, one bit each; they stay on them, and no inner
edge joins two vertices of one border, so that the mesh can be mirrored there.  `size` is the edge length wanted at a
vertex.
"""

from __future__ import annotations

import numba
import numpy as np

RING = 40  # most faces around a vertex


@numba.njit(cache=True)
def link(triangles, n_faces, ring, degree):
    """Enter faces into the lists of their corners."""
    for f in range(n_faces):
        for c in range(3):
            v = triangles[f, c]
            ring[v, degree[v]] = f
            degree[v] += 1


@numba.njit(cache=True, error_model="numpy")
def _distance(points, a, b):
    return np.sqrt(
        (points[a, 0] - points[b, 0]) ** 2 + (points[a, 1] - points[b, 1]) ** 2 + (points[a, 2] - points[b, 2]) ** 2
    )


@numba.njit(cache=True)
def _opposite(triangles, ring, degree, a, b):
    """The faces on edge (a, b) and their third corners: count, face, corner, face, corner."""
    count, f0, c0, f1, c1 = 0, -1, -1, -1, -1
    for i in range(degree[a]):
        f = ring[a, i]
        for c in range(3):
            if triangles[f, c] == b:
                third = triangles[f, 0] + triangles[f, 1] + triangles[f, 2] - a - b
                if count == 0:
                    f0, c0 = f, third
                else:
                    f1, c1 = f, third
                count += 1
    return count, f0, c0, f1, c1


@numba.njit(cache=True)
def _unlink(ring, degree, v, f):
    for i in range(degree[v]):
        if ring[v, i] == f:
            degree[v] -= 1
            ring[v, i] = ring[v, degree[v]]
            return


@numba.njit(cache=True)
def _append(ring, degree, v, f):
    ring[v, degree[v]] = f
    degree[v] += 1


@numba.njit(cache=True, error_model="numpy")
def _normal(points, a, b, c):
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@numba.njit(cache=True, error_model="numpy")
def _alike(n, m, least):
    dot = n[0] * m[0] + n[1] * m[1] + n[2] * m[2]
    norm = np.sqrt((n[0] ** 2 + n[1] ** 2 + n[2] ** 2) * (m[0] ** 2 + m[1] ** 2 + m[2] ** 2))
    return dot > least * norm and norm > 0.0


@numba.njit(cache=True, error_model="numpy")
def split_all(points, tag, triangles, ring, degree, size, n_vertices, n_faces):
    """Halve every edge longer than 4/3 of the wanted length; returns the new numbers of vertices and faces."""
    for f in range(n_faces):
        if triangles[f, 0] < 0:
            continue
        for c in range(3):
            a, b = triangles[f, c], triangles[f, (c + 1) % 3]
            count, f0, c0, f1, c1 = _opposite(triangles, ring, degree, a, b)
            # An inner edge between two border vertices would be doubled by mirroring: it is always split.
            chord = count == 2 and (tag[a] & tag[b]) != 0
            if not chord and _distance(points, a, b) <= 4.0 / 3.0 * 0.5 * (size[a] + size[b]):
                continue
            if n_vertices >= len(points) or n_faces + 2 >= len(triangles):
                return n_vertices, n_faces
            if degree[c0] >= RING - 1 or (count == 2 and degree[c1] >= RING - 1):
                continue
            m = n_vertices
            n_vertices += 1
            points[m] = 0.5 * (points[a] + points[b])
            size[m] = 0.5 * (size[a] + size[b])
            tag[m] = tag[a] & tag[b] if count == 1 else 0
            degree[m] = 0
            for side in range(count):
                g, third = (f0, c0) if side == 0 else (f1, c1)
                n_corner = -1
                for q in range(3):
                    if triangles[g, q] == b:
                        n_corner = q
                new = n_faces
                n_faces += 1
                for q in range(3):
                    triangles[new, q] = triangles[g, q]
                    if triangles[g, q] == a:
                        triangles[new, q] = m
                triangles[g, n_corner] = m
                _unlink(ring, degree, b, g)
                _append(ring, degree, b, new)
                _append(ring, degree, m, g)
                _append(ring, degree, m, new)
                _append(ring, degree, third, new)
    return n_vertices, n_faces


@numba.njit(cache=True, error_model="numpy")
def collapse_all(points, tag, triangles, ring, degree, size, n_faces):
    """Merge the ends of every edge shorter than 4/5 of the wanted length, where the mesh stays a manifold."""
    neighbours = np.empty(RING * 2, np.int64)
    for f in range(n_faces):
        for c in range(3):
            if triangles[f, 0] < 0:
                break
            a, b = triangles[f, c], triangles[f, (c + 1) % 3]
            if _distance(points, a, b) >= 0.8 * 0.5 * (size[a] + size[b]):
                continue
            count, f0, c0, f1, c1 = _opposite(triangles, ring, degree, a, b)
            # b goes into a: a must keep every mark that b has.
            if (tag[a] & tag[b]) != tag[b]:
                a, b = b, a
                if (tag[a] & tag[b]) != tag[b]:
                    continue
            if count == 2 and tag[b] != 0:
                continue
            # Link condition: the common neighbours are the edge's opposite corners and no others.
            n = 0
            for i in range(degree[a]):
                for q in range(3):
                    v = triangles[ring[a, i], q]
                    known = v == a or v == b
                    for p in range(n):
                        known = known or neighbours[p] == v
                    if not known:
                        neighbours[n] = v
                        n += 1
            common = 0
            fits = degree[a] + degree[b] - 2 * count < RING - 2 and n + degree[b] < 14
            for i in range(degree[b]):
                for q in range(3):
                    v = triangles[ring[b, i], q]
                    if v == a or v == b:
                        continue
                    shared = False
                    for p in range(n):
                        shared = shared or neighbours[p] == v
                    if shared:
                        common += 1  # seen from two faces of b, from one at a border
                    elif tag[v] & tag[a]:
                        # A new inner edge between two border vertices, unless it runs along the border.
                        on_border, _, _, _, _ = _opposite(triangles, ring, degree, b, v)
                        fits = fits and on_border == 1 and count == 1
            expected = 0
            for side in range(count):
                third = c0 if side == 0 else c1
                faces_there, _, _, _, _ = _opposite(triangles, ring, degree, b, third)
                expected += faces_there
            # Faces of b on the collapsing edge show their third corner once each, the next face once more.
            if not fits or common != expected:
                continue
            weight = 0.5 if tag[a] == tag[b] else 0.0
            x = points[a] + weight * (points[b] - points[a])
            old_a, old_b = points[a].copy(), points[b].copy()
            valid = True
            for side in range(2):
                v, other = (a, b) if side == 0 else (b, a)
                for i in range(degree[v]):
                    g = ring[v, i]
                    p, q, r = triangles[g, 0], triangles[g, 1], triangles[g, 2]
                    if p == other or q == other or r == other:
                        continue
                    before = _normal(points, p, q, r)
                    points[v] = x
                    after = _normal(points, p, q, r)
                    longest = max(_distance(points, p, q), _distance(points, q, r), _distance(points, r, p))
                    points[v] = old_a if side == 0 else old_b
                    valid = valid and _alike(before, after, 0.7) and longest < 4.0 / 3.0 * size[v]
            if not valid:
                continue
            points[a] = x
            size[a] = 0.5 * (size[a] + size[b])
            for side in range(count):
                g, third = (f0, c0) if side == 0 else (f1, c1)
                _unlink(ring, degree, a, g)
                _unlink(ring, degree, b, g)
                _unlink(ring, degree, third, g)
                triangles[g] = -1
            for i in range(degree[b]):
                g = ring[b, i]
                for q in range(3):
                    if triangles[g, q] == b:
                        triangles[g, q] = a
                _append(ring, degree, a, g)
            degree[b] = 0


@numba.njit(cache=True, error_model="numpy")
def flip_all(points, tag, triangles, ring, degree, n_faces):
    """Turn edges between two faces where that brings the numbers of faces around vertices nearer to six."""
    for f in range(n_faces):
        if triangles[f, 0] < 0:
            continue
        for c in range(3):
            a, b = triangles[f, c], triangles[f, (c + 1) % 3]
            count, f0, c0, f1, c1 = _opposite(triangles, ring, degree, a, b)
            if count != 2 or (tag[c0] & tag[c1]) != 0:
                continue
            if degree[c0] >= RING - 1 or degree[c1] >= RING - 1:
                continue
            before = 0.0
            after = 0.0
            for v, change in ((a, -1), (b, -1), (c0, 1), (c1, 1)):
                # Faces around a vertex: 6 inside, 3 on a border (which is 6 after mirroring).
                excess = degree[v] - (6 if tag[v] == 0 else 3)
                before += excess * excess
                after += (excess + change) * (excess + change)
            if after >= before:
                continue
            exists, _, _, _, _ = _opposite(triangles, ring, degree, c0, c1)
            if exists:
                continue
            if f1 == f:
                f0, c0, f1, c1 = f1, c1, f0, c0
            # f runs a -> b, so its third corner is c0, and the other face runs b -> a.
            m, k = _normal(points, a, b, c0), _normal(points, b, a, c1)
            p, q = _normal(points, a, c1, c0), _normal(points, b, c0, c1)
            if not (_alike(m, p, 0.8) and _alike(m, q, 0.8) and _alike(k, p, 0.8) and _alike(k, q, 0.8)):
                continue
            triangles[f0, 0], triangles[f0, 1], triangles[f0, 2] = a, c1, c0
            triangles[f1, 0], triangles[f1, 1], triangles[f1, 2] = b, c0, c1
            _unlink(ring, degree, b, f0)
            _unlink(ring, degree, a, f1)
            _append(ring, degree, c1, f0)
            _append(ring, degree, c0, f1)
            break


@numba.njit(cache=True, error_model="numpy")
def relax_all(points, tag, triangles, ring, degree, size, n_vertices):
    """Move vertices within their tangent planes, or along their border, towards the middle of their faces."""
    target = np.empty(3)
    for v in range(n_vertices):
        if degree[v] == 0:
            continue
        target[:] = 0.0
        total = 0.0
        if tag[v] == 0:
            normal = np.zeros(3)
            for i in range(degree[v]):
                p, q, r = triangles[ring[v, i], 0], triangles[ring[v, i], 1], triangles[ring[v, i], 2]
                n = _normal(points, p, q, r)
                area = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
                local = (size[p] + size[q] + size[r]) / 3.0
                weight = area / (local * local)
                total += weight
                for axis in range(3):
                    normal[axis] += n[axis]
                    target[axis] += weight * (points[p, axis] + points[q, axis] + points[r, axis]) / 3.0
            normal /= np.sqrt((normal**2).sum()) + 1e-30
            step = target / total - points[v]
            step -= normal * (step * normal).sum()
        elif tag[v] == 3:
            continue
        else:
            step = np.zeros(3)
            ends = 0
            for i in range(degree[v]):
                for q in range(3):
                    w = triangles[ring[v, i], q]
                    if w != v and (tag[w] & tag[v]) != 0:
                        count, _, _, _, _ = _opposite(triangles, ring, degree, v, w)
                        if count == 1:
                            step += points[w] - points[v]
                            ends += 1
            step /= max(ends, 1)
        points[v] += 0.7 * step
