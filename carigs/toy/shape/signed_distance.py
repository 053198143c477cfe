"""Signed distance function of the head: smoothly blended solids, minus the openings of eyes and mouth.

Lengths and coordinates are in millimetres. Solids are rows as built by `carigs.toy.shape.solids`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Shaped

from carigs.mesh.smoothstep import smoothstep
from carigs.simd.kernels import kernel
from carigs.simd.matrix3 import dot
from carigs.toy.shape.anatomy import EYE_X, EYE_Y, EYE_Z, MOUTH_CORNER, SOCKET_RADIUS, lid_margins, lip_height

_FAR = 1e3
_LIP_GAP = 0.1  # half the distance between the closed lips
_SPREAD_GAP = 3.2  # half the distance between the lips while the surface is meshed, see `_close_lips`


@kernel
def _solid_distance(solid, x, y, z):
    if solid.is_cone:
        a, b, r = solid.start, solid.end, solid.end[3] - solid.start[3]
        along, local = (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (x - a[0], y - a[1], z - a[2])
        t = min(max(dot(local, along) / dot(along, along), 0.0), 1.0)
        beside = (local[0] - t * along[0], local[1] - t * along[1], local[2] - t * along[2])
        return np.sqrt(dot(beside, beside)) - (a[3] + t * r)
    c, r, axes = solid.centre, solid.radii, solid.axes
    local = (x - c[0], y - c[1], z - c[2])
    scaled = (dot(axes[0], local) / r[0], dot(axes[1], local) / r[1], dot(axes[2], local) / r[2])
    slope = (scaled[0] / r[0], scaled[1] / r[1], scaled[2] / r[2])
    first, second = np.sqrt(dot(scaled, scaled)), np.sqrt(dot(slope, slope))
    # First-order distance, exact on the surface and for spheres; minus the smallest radius at the centre.
    return -min(r[0], r[1], r[2]) if second < 1e-12 else first * (first - 1.0) / second


@kernel
def _solids_distance(solids, x, y, z):
    """Approximate signed distance of a point to the solids, without the openings; symmetric in x, negative inside.

    Solids (a chain counts as one) are added or carved in their order with the quadratic polynomial smooth minimum
    (Quilez 2013).
    """
    x = np.sqrt(x * x + 1.0)  # a rounded |x|: no crease at the midline
    d = part = _FAR
    for i in range(len(solids)):
        solid = solids[i]
        blend, carve = solid.blend, solid.carve
        # The solid has no effect beyond this distance from the centre of its bounding sphere.
        reach = solid.reach + (blend - d if carve else d + blend)
        offset = (x - solid.centre[0], y - solid.centre[1], z - solid.centre[2])
        if reach > 0.0 and dot(offset, offset) < reach * reach:
            part = min(part, _solid_distance(solid, x, y, z))
        if solid.continued or part == _FAR:
            continue
        d = _carve(d, part, blend) if carve else -_carve(-d, part, blend)
        part = _FAR
    return d


@kernel
def _close_lips(x, y, z):
    """Map a point from meshing space, in which the lips are spread apart, to head space; returns its new y."""
    wide = 1.0 - smoothstep((abs(x) - MOUTH_CORNER + 2.0) / 8.0)
    front = smoothstep((z - 40.0) / 25.0)
    t = y - lip_height(x)
    inner = _SPREAD_GAP * wide * front
    a = abs(t)
    if a < inner:
        a *= _LIP_GAP / _SPREAD_GAP
    else:
        a -= inner * (1.0 - _LIP_GAP / _SPREAD_GAP) * (1.0 - smoothstep((a - inner) / 26.0))
    return lip_height(x) + (a if t > 0.0 else -a)


@kernel
def _carve(d, solid, blend):
    """Signed distance `d` after a solid is subtracted."""
    h = max(blend - abs(d + solid), 0.0)
    return max(d, -solid) + (h * h / (4.0 * blend) if blend > 0.0 else 0.0)


@kernel
def _head_distance(solids, x, y, z):
    """Signed distance in meshing space: the solids minus eye sockets, lid openings, mouth slit and mouth cavity."""
    y = _close_lips(x, y, z)
    d = _solids_distance(solids, x, y, z)
    ax = abs(x)
    if y > 5.0 and y < 50.0 and z > 45.0 and ax < 56.0:
        socket = np.sqrt((ax - EYE_X) ** 2 + (y - EYE_Y) ** 2 + (z - EYE_Z) ** 2) - SOCKET_RADIUS
        lower, upper = lid_margins(ax)
        floor = EYE_Z + 5.0 + 3.0 * smoothstep((21.5 - ax) / 3.0)  # the caruncle
        fissure = max(0.85 * max(y - upper, lower - y), floor - z)
        d = _carve(_carve(d, socket, 0.6), fissure, 1.6)
    if y > -90.0 and y < 0.0 and z > 35.0 and ax < 50.0:
        local = (ax / 26.0, (y + 44.0) / 14.0, (z - 78.0) / 21.0)
        bag = (np.sqrt(dot(local, local)) - 1.0) * 14.0
        half = _LIP_GAP * np.sqrt(max(1.0 - (ax / MOUTH_CORNER) ** 2, 0.0))
        slit = max(max(abs(y - lip_height(ax)) - half, ax - MOUTH_CORNER), 80.0 - z)
        d = _carve(_carve(d, bag, 1.0), slit, 1.2)
    return d


@kernel
def head_distance(solids, points):
    """Signed distance of points to the head, in meshing space (lips spread apart).

    Args:
        solids: One row per solid, in the order of blending.
        points: Positions in meshing space (n, 3), in millimetres.

    Returns:
        Distances (n,) in millimetres, positive outside.
    """
    return np.array([_head_distance(solids, p[0], p[1], p[2]) for p in points])


@kernel
def solids_distance(solids, points):
    """Approximate signed distance of points to the solids, without the openings of eyes and mouth.

    Args:
        solids: One row per solid, in the order of blending.
        points: Positions in head space (n, 3), in millimetres.

    Returns:
        Distances (n,) in millimetres, positive outside.
    """
    return np.array([_solids_distance(solids, p[0], p[1], p[2]) for p in points])


@kernel
def close_lips(points):
    """Map points from meshing space, in which the lips are spread apart, to head space, in place.

    Args:
        points: Positions (n, 3), in millimetres.
    """
    for p in points:
        p[1] = _close_lips(p[0], p[1], p[2])


def sample_head_distance(
    solids: Shaped[np.ndarray, " n"], low: Float[np.ndarray, "3"], step: float, shape: tuple[int, int, int]
) -> Float[np.ndarray, "nx ny nz"]:
    """Sample the signed distance of the head on a grid in meshing space.

    Args:
        solids: One row per solid, in the order of blending.
        low: Position of sample (0, 0, 0), in millimetres.
        step: Spacing of the grid, in millimetres.
        shape: Number of samples along each axis.

    Returns:
        Distances in millimetres, negative inside: evaluated at every sample near the surface, one value for each block
        of 4 x 4 x 4 samples elsewhere (of the right sign).
    """
    block = 4
    blocks = [-(-n // block) for n in shape]
    middles = block * np.array([*np.ndindex(*blocks)]) + (block - 1) / 2
    coarse = head_distance(solids, low + step * middles).reshape(blocks)
    values = np.kron(coarse, np.ones((block, block, block)))[: shape[0], : shape[1], : shape[2]]
    near = np.abs(values) <= 1.6 * step * block * 0.87  # 1.6 half diagonals of the block: the distance is approximate
    values[near] = head_distance(solids, low + step * np.stack(np.nonzero(near), axis=1))
    return np.where(np.abs(values) > 1e-6, values, 1e-6)


def project_to_surface(
    solids: Shaped[np.ndarray, " n"], points: Float[np.ndarray, "v 3"], border: Int[np.ndarray, " v"]
) -> None:
    """Move points of meshing space onto the surface of the head by Newton steps, in place.

    Args:
        solids: One row per solid, in the order of blending.
        points: Positions, in millimetres.
        border: Bit 1 keeps a point in its plane of constant x, bit 2 in its plane of constant y.
    """
    moving, h = np.arange(len(points)), 0.02
    for _ in range(4):
        d = head_distance(solids, points[moving])
        moving, d = moving[np.abs(d) >= 1e-4], d[np.abs(d) >= 1e-4]
        p = points[moving]
        differences = [head_distance(solids, p + e) - head_distance(solids, p - e) for e in h * np.eye(3)]
        gradient = np.stack(differences, axis=1) / (2 * h)
        gradient[:, :2] *= border[moving, None] & [1, 2] == 0
        square = (gradient**2).sum(axis=1)
        step = np.clip(d / np.maximum(square, 0.0025), -1.0, 1.0) * (square >= 0.0025)
        points[moving] -= step[:, None] * gradient
