"""From values on a grid to a fine surface: marching tetrahedra."""

from __future__ import annotations

import itertools

import numba
import numpy as np
from jaxtyping import Float, Int

# Kuhn's division of the cube: one tetrahedron per order of walking the three axes from corner 000 to 111.  Neighbouring
# cubes divide their common faces alike, so the surface is a manifold whatever the signs are.
_TETRAHEDRA = np.array(
    [
        np.cumsum([[0, 0, 0]] + [list(np.eye(3, dtype=int)[axis]) for axis in order], axis=0)
        for order in itertools.permutations(range(3))
    ]
)
_EVEN = np.array([np.linalg.det(t[1:].astype(float)) > 0 for t in _TETRAHEDRA])


def surface(
    values: Float[np.ndarray, "nx ny nz"], low: Float[np.ndarray, "3"], step: float
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Triangulate the zero set of grid values; open where it leaves the grid, faces counter-clockwise from outside."""
    keys, points = _march(values, low, step, _TETRAHEDRA, _EVEN)
    _, first, vertex = np.unique(keys, return_index=True, return_inverse=True)
    return points[first], vertex.reshape(-1, 3)


@numba.njit(cache=True, error_model="numpy")
def _march(values, low, step, tetrahedra, even):
    nx, ny, nz = values.shape
    capacity = 1 << 16
    keys = np.empty(capacity, np.int64)
    points = np.empty((capacity, 3))
    count = 0
    corner = np.empty((4, 3), np.int64)
    inside = np.empty(4, np.int64)
    outside = np.empty(4, np.int64)
    pairs = np.empty((6, 2), np.int64)
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                negative = 0
                for c in range(8):
                    negative += values[i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)] < 0.0
                if negative == 0 or negative == 8:
                    continue
                for t in range(6):
                    n_in = 0
                    n_out = 0
                    for c in range(4):
                        corner[c, 0] = i + tetrahedra[t, c, 0]
                        corner[c, 1] = j + tetrahedra[t, c, 1]
                        corner[c, 2] = k + tetrahedra[t, c, 2]
                        if values[corner[c, 0], corner[c, 1], corner[c, 2]] < 0.0:
                            inside[n_in] = c
                            n_in += 1
                        else:
                            outside[n_out] = c
                            n_out += 1
                    if n_in == 0 or n_in == 4:
                        continue
                    if n_in == 2:
                        a, b, c, d = inside[0], inside[1], outside[0], outside[1]
                        flip = _odd(a, b, c, d) == even[t]
                        quad = ((a, c), (b, c), (b, d), (a, d))
                        order = (0, 1, 2, 0, 2, 3)
                        corners = 6
                        for q in range(6):
                            pairs[q, 0], pairs[q, 1] = quad[order[q]]
                    else:
                        corners = 3
                        if n_in == 1:
                            apex = inside[0]
                            flip = _odd(apex, outside[0], outside[1], outside[2]) != even[t]
                            for q in range(3):
                                pairs[q, 0], pairs[q, 1] = apex, outside[q]
                        else:
                            apex = outside[0]
                            flip = _odd(apex, inside[0], inside[1], inside[2]) == even[t]
                            for q in range(3):
                                pairs[q, 0], pairs[q, 1] = apex, inside[q]
                    if count + 6 > capacity:
                        capacity *= 2
                        keys = _grown(keys, capacity)
                        points = _grown_points(points, capacity)
                    for q in range(corners):
                        r = q
                        if not flip:  # reverse each triangle
                            r = q - q % 3 + (2 - q % 3)
                        a, b = min(pairs[r, 0], pairs[r, 1]), max(pairs[r, 0], pairs[r, 1])
                        va = values[corner[a, 0], corner[a, 1], corner[a, 2]]
                        vb = values[corner[b, 0], corner[b, 1], corner[b, 2]]
                        w = va / (va - vb)
                        direction = 0
                        for axis in range(3):
                            points[count, axis] = low[axis] + step * (
                                corner[a, axis] + w * (corner[b, axis] - corner[a, axis])
                            )
                            direction |= (corner[b, axis] - corner[a, axis]) << axis
                        node = (corner[a, 0] * ny + corner[a, 1]) * nz + corner[a, 2]
                        keys[count] = node * 8 + direction
                        count += 1
    return keys[:count], points[:count]


@numba.njit(cache=True)
def _odd(a, b, c, d):
    """Whether the order of four different numbers is an odd permutation."""
    return ((a > b) + (a > c) + (a > d) + (b > c) + (b > d) + (c > d)) % 2 == 1


@numba.njit(cache=True)
def _grown(array, capacity):
    grown = np.empty(capacity, array.dtype)
    grown[: len(array)] = array
    return grown


@numba.njit(cache=True)
def _grown_points(array, capacity):
    grown = np.empty((capacity, 3))
    grown[: len(array)] = array
    return grown
