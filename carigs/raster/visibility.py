"""The kernels of the rasteriser (Numba): which face is nearest at every pixel centre, and where on it.

A row of pixels lies inside a triangle between the two edges that it crosses.  An edge holds its upper end and not its
lower one, a span the centre on its left edge and not that on its right one, and a crossing is computed from the edge's
upper end in both of its faces: pixels on shared edges and corners belong to one face, and there are no cracks.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.raster.span import WIDTH, draw

TILE = 8  # pixels
FRONT, LAST = 1 << 31, (1 << 31) - 1  # the rank of a face: fronts first, then in their order
CLOSER = 1.0001  # more than what rounding adds to an inverse depth
SLACK = 1e-6  # pixels: more than what rounding moves the end of a span

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def project(points, rotation, translation, fx, fy, cx, cy):
    """Points in camera axes, and their pixels."""
    n = points.shape[0]
    seen, pixel = np.empty((n, 3)), np.empty((n, 2))
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            seen[i, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + translation[k]
        pixel[i, 0] = fx * seen[i, 0] / seen[i, 2] + cx
        pixel[i, 1] = fy * seen[i, 1] / seen[i, 2] + cy
    return seen, pixel


@kernel
def planes(seen, faces, fx, fy, cx, cy):
    """Inverse depth of each face's plane as an affine function of the pixel (f, 3), and whether it shows its back.

    The plane n.(x - a) = 0 is met by the ray d at depth n.a / n.d.  Edge-on planes are all zero.
    """
    slope, back = np.zeros((faces.shape[0], 3)), np.zeros(faces.shape[0], np.bool_)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = seen[i, 0], seen[i, 1], seen[i, 2]
        bx, by, bz = seen[j, 0] - ax, seen[j, 1] - ay, seen[j, 2] - az
        cx_, cy_, cz = seen[k, 0] - ax, seen[k, 1] - ay, seen[k, 2] - az
        nx, ny, nz = by * cz - bz * cy_, bz * cx_ - bx * cz, bx * cy_ - by * cx_
        distance = nx * ax + ny * ay + nz * az
        back[f] = distance > 0.0
        if distance != 0.0:
            nx, ny, nz = nx / distance / fx, ny / distance / fy, nz / distance
            slope[f, 0], slope[f, 1], slope[f, 2] = nx, ny, nz - nx * cx - ny * cy
    return slope, back


@kernel
def ordered(ax, ay, bx, by, cx, cy):
    """Corners from top to bottom, then from left to right."""
    if by < ay or (by == ay and bx < ax):
        ax, ay, bx, by = bx, by, ax, ay
    if cy < by or (cy == by and cx < bx):
        bx, by, cx, cy = cx, cy, bx, by
        if by < ay or (by == ay and bx < ax):
            ax, ay, bx, by = bx, by, ax, ay
    return ax, ay, bx, by, cx, cy


@kernel
def rows(top, bottom, height):
    """First row whose centre lies between two heights, and the one after the last."""
    return int(max(np.ceil(top - 0.5), 0.0)), int(min(np.ceil(bottom - 0.5), float(height)))


@kernel
def slopes(tx, ty, mx, my, bx, by):
    """Columns per row along the long, the upper and the lower edge, and whether the middle corner is on the right."""
    right = (mx - tx) * (by - ty) > (bx - tx) * (my - ty)
    return (bx - tx) / (by - ty), (mx - tx) / (my - ty), (bx - mx) / (by - my), right


@kernel
def span(tx, ty, mx, my, long, upper, lower, right, y, width):
    """First column whose centre lies in the triangle in row y, and the one after the last."""
    py = y + 0.5
    start = tx + (py - ty) * long
    stop = tx + (py - ty) * upper if py < my else mx + (py - my) * lower
    if not right:
        start, stop = stop, start
    return int(max(np.ceil(start - 0.5), 0.0)), int(min(np.ceil(stop - 0.5), float(width)))


@kernel
def _fill(ax, ay, bx, by, cx, cy, sx, sy, s, rank, keys, height, width):
    """Draw one triangle, of inverse depth sx x + sy y + s, where it is nearer than what is there."""
    if not np.isfinite(ax + ay + bx + by + cx + cy):
        return
    tx, ty, mx, my, bx, by = ordered(ax, ay, bx, by, cx, cy)
    first, last = rows(ty, by, height)
    long, upper, lower, right = slopes(tx, ty, mx, my, bx, by)
    for y in range(first, last):
        x0, x1 = span(tx, ty, mx, my, long, upper, lower, right, y, width)
        near = sx * (x0 + 0.5) + (sy * (y + 0.5) + s)
        place = y * (width + WIDTH) + x0
        while x0 < x1:
            draw(keys, place, x1 - x0, near, sx, rank)
            x0, place, near = x0 + WIDTH, place + WIDTH, near + WIDTH * sx


@kernel
def _cut(seen, i, j, near, fx, fy, cx, cy):
    """Pixel where the edge meets the near plane; the same for i, j and j, i."""
    if j < i:
        i, j = j, i
    t = (near - seen[i, 2]) / (seen[j, 2] - seen[i, 2])
    x = seen[i, 0] + t * (seen[j, 0] - seen[i, 0])
    y = seen[i, 1] + t * (seen[j, 1] - seen[i, 1])
    return fx * x / near + cx, fy * y / near + cy


@kernel
def _fill_clipped(seen, pixel, corners, near, fx, fy, cx, cy, sx, sy, s, rank, keys, height, width):
    """Draw what of a triangle lies beyond the near plane: a triangle, or two."""
    x, y = np.empty(4), np.empty(4)
    n = 0
    for k in range(3):
        i, j = corners[k], corners[(k + 1) % 3]
        if seen[i, 2] > near:
            x[n], y[n] = pixel[i, 0], pixel[i, 1]
            n += 1
        if (seen[i, 2] > near) != (seen[j, 2] > near):
            x[n], y[n] = _cut(seen, i, j, near, fx, fy, cx, cy)
            n += 1
    for k in range(2, n):
        _fill(x[0], y[0], x[k - 1], y[k - 1], x[k], y[k], sx, sy, s, rank, keys, height, width)


@kernel
def bounds(pixel, i, j, k):
    """Least and largest column, least and largest row of a face."""
    ax, bx, cx = pixel[i, 0], pixel[j, 0], pixel[k, 0]
    ay, by, cy = pixel[i, 1], pixel[j, 1], pixel[k, 1]
    return min(ax, bx, cx), max(ax, bx, cx), min(ay, by, cy), max(ay, by, cy)


@kernel
def tiles(x0, x1, y0, y1, height, width):
    """The tiles of pixels that a box touches: first and last column, first and last row."""
    left, right = int(max(x0, 0.0)) // TILE, int(min(x1, width - 1.0)) // TILE
    return left, right, int(max(y0, 0.0)) // TILE, int(min(y1, height - 1.0)) // TILE


@kernel
def _lower(lowest, keys):
    for x in range(len(lowest)):
        lowest[x] = min(lowest[x], keys[x])


@kernel
def _farthest(keys, height, width):
    """Per tile the lowest key of its pixels: first of its columns, then of the tile."""
    lowest = np.empty(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE), np.int64)
    of_columns = np.empty(width, np.int64)
    for row in range(lowest.shape[0]):
        of_columns[:] = np.int64(1) << 62
        for y in range(row * TILE, min(row * TILE + TILE, height)):
            _lower(of_columns, keys[y * (width + WIDTH) : y * (width + WIDTH) + width])
        for column in range(lowest.shape[1]):
            low = of_columns[column * TILE]
            for x in range(column * TILE + 1, min(column * TILE + TILE, width)):
                low = min(low, of_columns[x])
            lowest[row, column] = low
    return lowest


@kernel
def _hidden(pixel, i, j, k, depth, lowest, height, width):
    """Whether all that a face may cover is covered by something nearer."""
    left, right, top, bottom = tiles(*bounds(pixel, i, j, k), height, width)
    key = np.int64(np.float32(CLOSER / depth).view(np.int32)) << 32
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if lowest[row, column] < key:
                return False
    return True


@kernel
def _scan_side(keys, lowest, side, seen, pixel, faces, slope, back, near, fx, fy, cx, cy, height, width):
    """Draw the faces that show their front (side 0), or those that show their back and are not hidden."""
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        sx, sy, s = slope[f, 0], slope[f, 1], slope[f, 2]
        za, zb, zc = seen[i, 2], seen[j, 2], seen[k, 2]
        if back[f] != (side == 1) or not max(za, zb, zc) > near or not np.isfinite(sx + sy + s):
            continue
        rank = LAST - f + (0 if side else FRONT)
        depth = min(za, zb, zc)
        if depth > near:
            x0, x1, y0, y1 = bounds(pixel, i, j, k)
            if np.ceil(x0 - 0.5 - SLACK) >= np.ceil(x1 - 0.5 + SLACK) or np.ceil(y0 - 0.5) >= np.ceil(y1 - 0.5):
                continue  # between the pixel centres
        if not depth > near:
            _fill_clipped(
                seen, pixel, faces[f], near, fx, fy, cx, cy, sx, sy, s, rank, keys, height, width
            )  # fmt: skip
        elif side == 0 or not _hidden(pixel, i, j, k, depth, lowest, height, width):
            _fill(
                pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1],
                sx, sy, s, rank, keys, height, width,
            )  # fmt: skip


@kernel
def _read(keys, height, width):
    face_image, nearness = np.empty((height, width), np.int32), np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            key = keys[y * (width + WIDTH) + x]
            face_image[y, x] = np.int32(LAST - (key & LAST) if key > 0 else -1)
            nearness[y, x] = np.int32(key >> 32).view(np.float32)
    return face_image, nearness


@kernel
def scan(seen, pixel, faces, slope, back, cull_back, near, fx, fy, cx, cy, height, width):
    """The nearest face (-1: none) and its inverse depth at every pixel centre; of equals the first front."""
    keys = np.zeros(height * (width + WIDTH), np.int64)
    lowest = np.zeros((0, 0), np.int64)
    _scan_side(keys, lowest, 0, seen, pixel, faces, slope, back, near, fx, fy, cx, cy, height, width)
    if not cull_back:
        lowest = _farthest(keys, height, width)
        _scan_side(keys, lowest, 1, seen, pixel, faces, slope, back, near, fx, fy, cx, cy, height, width)
    return _read(keys, height, width)


@kernel
def locate(seen, faces, slope, face_image, fx, fy, cx, cy):
    """Perspective-correct barycentrics and depth of what `scan` found (h, w, 3 and h, w; inf where nothing).

    The point z d on the face is a w_a + b w_b + c w_c: by Cramer's rule w_a is proportional to d.(b x c), and so on.
    """
    height, width = face_image.shape
    weights, depth = np.zeros((height, width, 3), np.float32), np.full((height, width), np.inf, np.float32)
    rows = np.zeros((3, 3))
    last = -1
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0:
                continue
            if f != last:
                last = f
                for k in range(3):
                    b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                    rows[k, 0] = (seen[b, 1] * seen[c, 2] - seen[b, 2] * seen[c, 1]) / fx
                    rows[k, 1] = (seen[b, 2] * seen[c, 0] - seen[b, 0] * seen[c, 2]) / fy
                    rows[k, 2] = seen[b, 0] * seen[c, 1] - seen[b, 1] * seen[c, 0]
            dx, dy = x + 0.5 - cx, y + 0.5 - cy
            u = rows[0, 0] * dx + rows[0, 1] * dy + rows[0, 2]
            v = rows[1, 0] * dx + rows[1, 1] * dy + rows[1, 2]
            w = rows[2, 0] * dx + rows[2, 1] * dy + rows[2, 2]
            total = u + v + w
            weights[y, x, 0], weights[y, x, 1], weights[y, x, 2] = u / total, v / total, w / total
            depth[y, x] = 1.0 / (slope[f, 0] * (x + 0.5) + slope[f, 1] * (y + 0.5) + slope[f, 2])
    return weights, depth
