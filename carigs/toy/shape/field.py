"""The head as a signed field: blended solids, with the openings of eyes and mouth cut into them.  Millimetres.

All kernels that call each other are in this one module: Numba's cache looks no further when it decides what is stale.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Int

from carigs.toy.shape.solids import ELLIPSOID, FAR, LINK

EYE_X, EYE_Y, EYE_Z, EYE_RADIUS = 31.8, 28.0, 69.0, 12.3
SOCKET_RADIUS = 12.75
CANTHUS_INNER, CANTHUS_OUTER = 18.0, 46.0  # x of the corners of the eye
MOUTH_CORNER = 24.5  # x of the corner of the mouth
LIP_GAP = 0.1  # half the distance of the closed lips
SPREAD_GAP = 3.2  # half the distance of the lips while the surface is meshed, see `closed_mouth`


@numba.njit(cache=True, error_model="numpy")
def _solid(row, x, y, z):
    if row[0] == ELLIPSOID:
        x, y, z = x - row[7], y - row[8], z - row[9]
        u = (row[13] * x + row[14] * y + row[15] * z) / row[10]
        v = (row[16] * x + row[17] * y + row[18] * z) / row[11]
        w = (row[19] * x + row[20] * y + row[21] * z) / row[12]
        first = np.sqrt(u * u + v * v + w * w)
        second = np.sqrt((u / row[10]) ** 2 + (v / row[11]) ** 2 + (w / row[12]) ** 2)
        # First-order distance; exact on the surface and for spheres.  At the centre it is minus the least radius.
        return -min(row[10], row[11], row[12]) if second < 1e-12 else first * (first - 1.0) / second
    ax, ay, az = x - row[7], y - row[8], z - row[9]
    bx, by, bz = row[11] - row[7], row[12] - row[8], row[13] - row[9]
    t = min(max((ax * bx + ay * by + az * bz) / (bx * bx + by * by + bz * bz), 0.0), 1.0)
    dx, dy, dz = ax - t * bx, ay - t * by, az - t * bz
    return np.sqrt(dx * dx + dy * dy + dz * dz) - (row[10] + t * (row[14] - row[10]))


@numba.njit(cache=True, error_model="numpy")
def field_at(rows, x, y, z):
    """The blended field at one point: negative inside, about metric near the surface; symmetric in x.

    Solids (a chain counts as one) are added or carved in their order with the quadratic smooth minimum.
    """
    x = np.sqrt(x * x + 1.0)  # a rounded |x|: no crease at the midline
    d = FAR
    part = FAR
    for i in range(rows.shape[0]):
        row = rows[i]
        blend = row[2]
        reach = row[6] + (d + blend if row[1] > 0.0 else blend - d)  # farther from its bounding sphere it has no effect
        gx, gy, gz = x - row[3], y - row[4], z - row[5]
        if reach > 0.0 and gx * gx + gy * gy + gz * gz < reach * reach:
            part = min(part, _solid(row, x, y, z))
        if row[LINK] > 0.0 or part == FAR:
            continue
        s = row[1] * part
        h = max(blend - abs(d - s), 0.0)
        h = h * h / (4.0 * blend) if blend > 0.0 else 0.0
        d = min(d, s) - h if row[1] > 0.0 else max(d, s) + h
        part = FAR
    return d


@numba.njit(cache=True, error_model="numpy")
def lid_margins(x):
    """Heights of the lower and the upper lid margin over |x|; they cross at the corners of the eye."""
    t = (abs(x) - CANTHUS_INNER) / (CANTHUS_OUTER - CANTHUS_INNER)
    line = 25.9 + 2.6 * t
    upper = 4.0 * t * (1.0 - t) * (1.0 - 0.22 * (2.0 * t - 1.0))
    lower = 4.0 * t * (1.0 - t) * (1.0 + 0.25 * (2.0 * t - 1.0))
    return line - 4.2 * lower, line + 5.9 * upper


@numba.njit(cache=True, error_model="numpy")
def lip_line(x):
    """Height of the line where the closed lips meet."""
    t = abs(x) / MOUTH_CORNER
    return -43.4 + 0.9 * np.exp(-((t / 0.16) ** 2)) * -1.0 + 0.5 * np.exp(-(((t - 0.35) / 0.25) ** 2)) - 0.6 * t**4


@numba.njit(cache=True, error_model="numpy")
def closed_mouth(x, y, z):
    """From the space in which the lips are spread apart, where the surface is meshed, to the true one: y there."""
    ax = abs(x)
    wide = 1.0 - _smoothstep((ax - MOUTH_CORNER + 2.0) / 8.0)
    front = _smoothstep((z - 40.0) / 25.0)
    t = y - lip_line(x)
    inner = SPREAD_GAP * wide * front
    shift = inner * (1.0 - LIP_GAP / SPREAD_GAP)
    a = abs(t)
    if a < inner:
        a *= LIP_GAP / SPREAD_GAP
    else:
        a -= shift * (1.0 - _smoothstep((a - inner) / 26.0))
    return lip_line(x) + (a if t > 0.0 else -a)


@numba.njit(cache=True, error_model="numpy")
def _smoothstep(t):
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@numba.njit(cache=True, error_model="numpy")
def _carve(d, solid, blend):
    h = max(blend - abs(d + solid), 0.0)
    return max(d, -solid) + h * h / (4.0 * blend)


@numba.njit(cache=True, error_model="numpy")
def head_field_at(rows, x, y, z):
    """The sculpture with eye sockets, palpebral fissures, mouth slit and mouth bag: negative inside the flesh."""
    d = field_at(rows, x, y, z)
    ax = abs(x)
    if y > 5.0 and y < 50.0 and z > 45.0 and ax < 56.0:
        socket = np.sqrt((ax - EYE_X) ** 2 + (y - EYE_Y) ** 2 + (z - EYE_Z) ** 2) - SOCKET_RADIUS
        lower, upper = lid_margins(ax)
        floor = EYE_Z + 5.0 + 3.0 * _smoothstep((21.5 - ax) / 3.0)  # the caruncle
        fissure = max(0.85 * max(y - upper, lower - y), floor - z)
        d = _carve(d, socket, 0.6)
        d = _carve(d, fissure, 1.6)
    if y > -90.0 and y < 0.0 and z > 35.0 and ax < 50.0:
        u, v, w = ax / 26.0, (y + 44.0) / 14.0, (z - 78.0) / 21.0
        r = np.sqrt(u * u + v * v + w * w)
        bag = (r - 1.0) * 14.0
        half = LIP_GAP * np.sqrt(max(1.0 - (ax / MOUTH_CORNER) ** 2, 0.0))
        slit = max(max(abs(y - lip_line(ax)) - half, ax - MOUTH_CORNER), 80.0 - z)
        d = _carve(d, bag, 1.0)
        d = _carve(d, slit, 1.2)
    return d


@numba.njit(cache=True, error_model="numpy")
def spread_field_at(rows, x, y, z):
    """The same in the space where the lips are spread apart (see `closed_mouth`)."""
    return head_field_at(rows, x, closed_mouth(x, y, z), z)


@numba.njit(cache=True, error_model="numpy")
def sample(
    rows: Float[np.ndarray, "n 24"], low: Float[np.ndarray, "3"], step: float, shape: tuple[int, int, int]
) -> Float[np.ndarray, "nx ny nz"]:
    """The spread field on a grid, exact near the surface and of the right sign elsewhere."""
    block = 4
    values = np.empty(shape)
    for bx in range(0, shape[0], block):
        for by in range(0, shape[1], block):
            for bz in range(0, shape[2], block):
                centre = low + step * (np.array([bx, by, bz]) + (block - 1) / 2.0)
                d = spread_field_at(rows, centre[0], centre[1], centre[2])
                # 1.6 half diagonals: the field is only about metric.
                skip = abs(d) > 1.6 * step * block * 0.87
                for i in range(bx, min(bx + block, shape[0])):
                    for j in range(by, min(by + block, shape[1])):
                        for k in range(bz, min(bz + block, shape[2])):
                            if skip:
                                values[i, j, k] = d
                            else:
                                v = spread_field_at(rows, low[0] + i * step, low[1] + j * step, low[2] + k * step)
                                values[i, j, k] = v if abs(v) > 1e-6 else 1e-6
    return values


@numba.njit(cache=True, error_model="numpy")
def project(points: Float[np.ndarray, "v 3"], tag: Int[np.ndarray, "v"], rows: Float[np.ndarray, "n 24"]) -> None:
    """Newton steps onto the spread field's zero set, in place.

    Bit 1 of `tag` keeps a point in its plane of constant x, bit 2 in its plane of constant y.
    """
    h = 0.02
    for v in range(len(points)):
        for _ in range(4):
            x, y, z = points[v, 0], points[v, 1], points[v, 2]
            d = spread_field_at(rows, x, y, z)
            if abs(d) < 1e-4:
                break
            gx = (spread_field_at(rows, x + h, y, z) - spread_field_at(rows, x - h, y, z)) / (2 * h)
            gy = (spread_field_at(rows, x, y + h, z) - spread_field_at(rows, x, y - h, z)) / (2 * h)
            gz = (spread_field_at(rows, x, y, z + h) - spread_field_at(rows, x, y, z - h)) / (2 * h)
            if tag[v] & 1:
                gx = 0.0
            if tag[v] & 2:
                gy = 0.0
            norm = gx * gx + gy * gy + gz * gz
            if norm < 0.0025:
                break
            step = min(max(d / norm, -1.0), 1.0)
            points[v, 0] -= step * gx
            points[v, 1] -= step * gy
            points[v, 2] -= step * gz


@numba.njit(cache=True, error_model="numpy")
def close_mouth(points: Float[np.ndarray, "v 3"]) -> None:
    """Take points of the spread space to the true one, in place."""
    for v in range(len(points)):
        points[v, 1] = closed_mouth(points[v, 0], points[v, 1], points[v, 2])


@numba.njit(cache=True, error_model="numpy")
def distances(rows: Float[np.ndarray, "n 24"], points: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v"]:
    """About the signed distance of points to the solids, without the openings: positive outside."""
    d = np.empty(len(points))
    for v in range(len(points)):
        d[v] = field_at(rows, points[v, 0], points[v, 1], points[v, 2])
    return d
