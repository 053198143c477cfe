"""Signed distance function of the head: smoothly blended solids, minus the openings of eyes and mouth.

Lengths and coordinates are in millimetres. Solids are rows of numbers, as built by `carigs.toy.shape.solids`.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Int
from numba.extending import register_jitable

from carigs.toy.shape.anatomy import EYE_X, EYE_Y, EYE_Z, MOUTH_CORNER, SOCKET_RADIUS, lid_margins, lip_line
from carigs.toy.shape.solids import ELLIPSOID, FAR, LINK

_LIP_GAP = 0.1  # half the distance between the closed lips
_SPREAD_GAP = 3.2  # half the distance between the lips while the surface is meshed, see `_close_lips`


@register_jitable
def smoothstep(t):
    """Cubic Hermite step: 3 t^2 - 2 t^3, clamped to t in [0, 1].

    Args:
        t: A number, or an array of any shape.

    Returns:
        0 where t <= 0, 1 where t >= 1, with zero slope at both ends; shaped as `t`.
    """
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@numba.njit(cache=True, error_model="numpy")
def _solid_distance(row, x, y, z):
    if row[0] == ELLIPSOID:
        x, y, z = x - row[7], y - row[8], z - row[9]
        u = (row[13] * x + row[14] * y + row[15] * z) / row[10]
        v = (row[16] * x + row[17] * y + row[18] * z) / row[11]
        w = (row[19] * x + row[20] * y + row[21] * z) / row[12]
        first = np.sqrt(u * u + v * v + w * w)
        second = np.sqrt((u / row[10]) ** 2 + (v / row[11]) ** 2 + (w / row[12]) ** 2)
        # First-order distance, exact on the surface and for spheres; minus the smallest radius at the centre.
        return -min(row[10], row[11], row[12]) if second < 1e-12 else first * (first - 1.0) / second
    ax, ay, az = x - row[7], y - row[8], z - row[9]
    bx, by, bz = row[11] - row[7], row[12] - row[8], row[13] - row[9]
    t = min(max((ax * bx + ay * by + az * bz) / (bx * bx + by * by + bz * bz), 0.0), 1.0)
    dx, dy, dz = ax - t * bx, ay - t * by, az - t * bz
    return np.sqrt(dx * dx + dy * dy + dz * dz) - (row[10] + t * (row[14] - row[10]))


@numba.njit(cache=True, error_model="numpy")
def _solids_distance(solids, x, y, z):
    """Approximate signed distance of a point to the solids, without the openings; symmetric in x, negative inside.

    Solids (a chain counts as one) are added or carved in their order with the quadratic polynomial smooth minimum
    (Quilez 2013).
    """
    x = np.sqrt(x * x + 1.0)  # a rounded |x|: no crease at the midline
    d = FAR
    part = FAR
    for i in range(solids.shape[0]):
        row = solids[i]
        blend = row[2]
        reach = row[6] + (d + blend if row[1] > 0.0 else blend - d)  # no effect beyond this distance from its centre
        gx, gy, gz = x - row[3], y - row[4], z - row[5]
        if reach > 0.0 and gx * gx + gy * gy + gz * gz < reach * reach:
            part = min(part, _solid_distance(row, x, y, z))
        if row[LINK] > 0.0 or part == FAR:
            continue
        s = row[1] * part
        h = max(blend - abs(d - s), 0.0)
        h = h * h / (4.0 * blend) if blend > 0.0 else 0.0
        d = min(d, s) - h if row[1] > 0.0 else max(d, s) + h
        part = FAR
    return d


@numba.njit(cache=True, error_model="numpy")
def _close_lips(x, y, z):
    """Map a point from meshing space, in which the lips are spread apart, to head space; returns its new y."""
    ax = abs(x)
    wide = 1.0 - smoothstep((ax - MOUTH_CORNER + 2.0) / 8.0)
    front = smoothstep((z - 40.0) / 25.0)
    t = y - lip_line(x)
    inner = _SPREAD_GAP * wide * front
    shift = inner * (1.0 - _LIP_GAP / _SPREAD_GAP)
    a = abs(t)
    if a < inner:
        a *= _LIP_GAP / _SPREAD_GAP
    else:
        a -= shift * (1.0 - smoothstep((a - inner) / 26.0))
    return lip_line(x) + (a if t > 0.0 else -a)


@numba.njit(cache=True, error_model="numpy")
def _carve(d, solid, blend):
    h = max(blend - abs(d + solid), 0.0)
    return max(d, -solid) + h * h / (4.0 * blend)


@numba.njit(cache=True, error_model="numpy")
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
        d = _carve(d, socket, 0.6)
        d = _carve(d, fissure, 1.6)
    if y > -90.0 and y < 0.0 and z > 35.0 and ax < 50.0:
        u, v, w = ax / 26.0, (y + 44.0) / 14.0, (z - 78.0) / 21.0
        r = np.sqrt(u * u + v * v + w * w)
        bag = (r - 1.0) * 14.0
        half = _LIP_GAP * np.sqrt(max(1.0 - (ax / MOUTH_CORNER) ** 2, 0.0))
        slit = max(max(abs(y - lip_line(ax)) - half, ax - MOUTH_CORNER), 80.0 - z)
        d = _carve(d, bag, 1.0)
        d = _carve(d, slit, 1.2)
    return d


@numba.njit(cache=True, error_model="numpy")
def sample_head_distance(
    solids: Float[np.ndarray, "n 24"], low: Float[np.ndarray, "3"], step: float, shape: tuple[int, int, int]
) -> Float[np.ndarray, "nx ny nz"]:
    """Sample the signed distance of the head on a grid in meshing space (lips spread apart).

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
    values = np.empty(shape)
    for bx in range(0, shape[0], block):
        for by in range(0, shape[1], block):
            for bz in range(0, shape[2], block):
                centre = low + step * (np.array([bx, by, bz]) + (block - 1) / 2.0)
                d = _head_distance(solids, centre[0], centre[1], centre[2])
                # 1.6 half diagonals of the block: the distance is approximate.
                far = abs(d) > 1.6 * step * block * 0.87
                for i in range(bx, min(bx + block, shape[0])):
                    for j in range(by, min(by + block, shape[1])):
                        for k in range(bz, min(bz + block, shape[2])):
                            v = d
                            if not far:
                                v = _head_distance(solids, low[0] + i * step, low[1] + j * step, low[2] + k * step)
                            values[i, j, k] = v if abs(v) > 1e-6 else 1e-6
    return values


@numba.njit(cache=True, error_model="numpy")
def project_to_surface(
    points: Float[np.ndarray, "v 3"], border: Int[np.ndarray, "v"], solids: Float[np.ndarray, "n 24"]
) -> None:
    """Move points of meshing space onto the surface of the head by Newton steps, in place.

    Args:
        points: Positions, in millimetres.
        border: Bit 1 keeps a point in its plane of constant x, bit 2 in its plane of constant y.
        solids: One row per solid, in the order of blending.
    """
    h = 0.02
    for v in range(len(points)):
        for _ in range(4):
            x, y, z = points[v, 0], points[v, 1], points[v, 2]
            d = _head_distance(solids, x, y, z)
            if abs(d) < 1e-4:
                break
            gx = (_head_distance(solids, x + h, y, z) - _head_distance(solids, x - h, y, z)) / (2 * h)
            gy = (_head_distance(solids, x, y + h, z) - _head_distance(solids, x, y - h, z)) / (2 * h)
            gz = (_head_distance(solids, x, y, z + h) - _head_distance(solids, x, y, z - h)) / (2 * h)
            if border[v] & 1:
                gx = 0.0
            if border[v] & 2:
                gy = 0.0
            norm = gx * gx + gy * gy + gz * gz
            if norm < 0.0025:
                break
            step = min(max(d / norm, -1.0), 1.0)
            points[v, 0] -= step * gx
            points[v, 1] -= step * gy
            points[v, 2] -= step * gz


@numba.njit(cache=True, error_model="numpy")
def close_lips(points: Float[np.ndarray, "v 3"]) -> None:
    """Map points from meshing space, in which the lips are spread apart, to head space, in place.

    Args:
        points: Positions, in millimetres.
    """
    for v in range(len(points)):
        points[v, 1] = _close_lips(points[v, 0], points[v, 1], points[v, 2])


@numba.njit(cache=True, error_model="numpy")
def solids_distance(solids: Float[np.ndarray, "n 24"], points: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v"]:
    """Approximate signed distance of points to the solids, without the openings of eyes and mouth.

    Args:
        solids: One row per solid, in the order of blending.
        points: Positions in head space, in millimetres.

    Returns:
        Distances in millimetres, positive outside.
    """
    d = np.empty(len(points))
    for v in range(len(points)):
        d[v] = _solids_distance(solids, points[v, 0], points[v, 1], points[v, 2])
    return d
