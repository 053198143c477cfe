"""Numba kernels of the rasterizer: scan conversion of triangles with a depth buffer.

The pixels of a row that lie inside a triangle form a span between the two edges that the row crosses. An edge includes
its upper end and excludes its lower one; a span includes a pixel centre on its left edge and excludes one on its right
edge; and the crossing of a row with an edge is computed from the edge's upper end in both adjacent faces. Hence pixels
centres on shared edges and corners belong to exactly one face (top-left rule).
"""

from __future__ import annotations

import numpy as np

from carigs.raster.span import WIDTH, draw
from carigs.simd.kernels import kernel

TILE = 8  # pixels
FRONT, LAST = 1 << 31, (1 << 31) - 1
"""Rank of a face among faces of equal depth: front faces come first, then lower indices."""
CLOSER = 1.0001
"""Factor on an inverse depth that exceeds its rounding error."""
SLACK = 1e-6
"""Pixels; exceeds the rounding error of the ends of a span."""


@kernel
def _pixel_range(start, stop, count):
    """First of `count` pixels whose centre lies between two positions, and one past the last such pixel."""
    last = float(count)  # limited before the conversion: positions may exceed the range of integers
    return int(min(max(np.ceil(start - 0.5), 0.0), last)), int(max(min(np.ceil(stop - 0.5), last), 0.0))


@kernel
def _fill(pixels, i, j, k, plane, rank, keys, height, width):
    """Draw a triangle with an inverse depth plane into the depth buffer."""
    top, middle, bottom = (pixels[i, 1], pixels[i, 0]), (pixels[j, 1], pixels[j, 0]), (pixels[k, 1], pixels[k, 0])
    if not np.isfinite(top[1] + top[0] + middle[1] + middle[0] + bottom[1] + bottom[0]):
        return
    # From top to bottom, then from left to right.
    if middle < top:
        top, middle = middle, top
    if bottom < middle:
        middle, bottom = bottom, middle
    if middle < top:
        top, middle = middle, top
    (ty, tx), (my, mx), (by, bx) = top, middle, bottom
    long, upper, lower = (bx - tx) / (by - ty), (mx - tx) / (my - ty), (bx - mx) / (by - my)
    middle_is_right = (mx - tx) * (by - ty) > (bx - tx) * (my - ty)
    first, last = _pixel_range(ty, by, height)
    for y in range(first, last):
        py = y + 0.5
        start = tx + (py - ty) * long
        stop = tx + (py - ty) * upper if py < my else mx + (py - my) * lower
        if not middle_is_right:
            start, stop = stop, start
        x0, x1 = _pixel_range(start, stop, width)
        near = plane[0] * (x0 + 0.5) + (plane[1] * py + plane[2])
        for x in range(x0, x1, WIDTH):
            draw(keys, y * (width + WIDTH) + x, x1 - x, near, plane[0], rank)
            near += WIDTH * plane[0]


@kernel
def _fill_clipped(points, pixels, corners, near, intrinsics, plane, rank, keys, height, width):
    """Clip a triangle at the near plane, and draw the one or two triangles that remain."""
    polygon, n = np.empty((4, 2)), 0
    for k in range(3):
        i, j = corners[k], corners[(k + 1) % 3]
        if points[i, 2] > near:
            polygon[n] = pixels[i]
            n += 1
        if (points[i, 2] > near) != (points[j, 2] > near):
            i, j = min(i, j), max(i, j)  # the same position in both adjacent faces
            t = (near - points[i, 2]) / (points[j, 2] - points[i, 2])
            for axis in range(2):
                position = points[i, axis] + t * (points[j, axis] - points[i, axis])
                polygon[n, axis] = intrinsics[axis] * position / near + intrinsics[axis + 2]
            n += 1
    for k in range(2, n):
        _fill(polygon, 0, k - 1, k, plane, rank, keys, height, width)


@kernel
def bounding_box(pixels, i, j, k):
    """Bounding box of a face in the image.

    Args:
        pixels: Image positions (v, 2) of the vertices.
        i: First corner.
        j: Second corner.
        k: Third corner.

    Returns:
        Least and largest x, least and largest y.
    """
    ax, bx, cx = pixels[i, 0], pixels[j, 0], pixels[k, 0]
    ay, by, cy = pixels[i, 1], pixels[j, 1], pixels[k, 1]
    return min(ax, bx, cx), max(ax, bx, cx), min(ay, by, cy), max(ay, by, cy)


@kernel
def _minimum_into(lowest, keys):
    for x in range(len(lowest)):
        lowest[x] = min(lowest[x], keys[x])


@kernel
def _farthest_keys(keys, height, width):
    """Lowest key, hence the farthest surface, of every tile of pixels."""
    lowest = np.empty(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE), np.int64)
    column_keys = np.empty(width, np.int64)
    for row in range(lowest.shape[0]):
        column_keys[:] = np.int64(1) << 62
        for y in range(row * TILE, min(row * TILE + TILE, height)):
            _minimum_into(column_keys, keys[y * (width + WIDTH) : y * (width + WIDTH) + width])
        for column in range(lowest.shape[1]):
            low = column_keys[column * TILE]
            for x in range(column * TILE + 1, min(column * TILE + TILE, width)):
                low = min(low, column_keys[x])
            lowest[row, column] = low
    return lowest


@kernel
def _hidden(pixels, i, j, k, depth, lowest, height, width):
    """Whether nearer surfaces cover all tiles that a face may touch."""
    x0, x1, y0, y1 = bounding_box(pixels, i, j, k)
    left, right = int(min(max(x0, 0.0), width)) // TILE, int(max(min(x1, width - 1.0), -1.0)) // TILE
    top, bottom = int(min(max(y0, 0.0), height)) // TILE, int(max(min(y1, height - 1.0), -1.0)) // TILE
    key = np.int64(np.float32(CLOSER / depth).view(np.int32)) << 32
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if lowest[row, column] < key:
                return False
    return True


@kernel
def _draw_side(keys, lowest, side, points, pixels, faces, planes, back, near, intrinsics, height, width):
    """Draw the faces that show their front (side 0), or those that show their back (side 1) and are not hidden."""
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        za, zb, zc = points[i, 2], points[j, 2], points[k, 2]
        plane = planes[f, 0], planes[f, 1], planes[f, 2]
        if back[f] != (side == 1) or not max(za, zb, zc) > near or not np.isfinite(plane[0] + plane[1] + plane[2]):
            continue
        rank = LAST - f + (0 if side else FRONT)
        depth = min(za, zb, zc)
        if not depth > near:
            _fill_clipped(points, pixels, faces[f], near, intrinsics, plane, rank, keys, height, width)
            continue
        x0, x1, y0, y1 = bounding_box(pixels, i, j, k)
        if np.ceil(x0 - 0.5 - SLACK) >= np.ceil(x1 - 0.5 + SLACK) or np.ceil(y0 - 0.5) >= np.ceil(y1 - 0.5):
            continue  # covers no pixel centre
        if side == 0 or not _hidden(pixels, i, j, k, depth, lowest, height, width):
            _fill(pixels, i, j, k, plane, rank, keys, height, width)


@kernel
def _decode(keys, height, width):
    face_image, inverse_depth = np.empty((height, width), np.int32), np.empty((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            key = keys[y * (width + WIDTH) + x]
            face_image[y, x] = np.int32(LAST - (key & LAST) if key > 0 else -1)
            inverse_depth[y, x] = np.int32(key >> 32).view(np.float32)
    return face_image, inverse_depth


@kernel
def nearest_faces(points, pixels, faces, planes, back, cull_back, near, intrinsics, height, width):
    """Nearest face and its inverse depth at every pixel centre; among equals, front faces and lower indices win.

    Args:
        points: Vertices (v, 3) in camera axes, in metres.
        pixels: Their image positions (v, 2).
        faces: Vertex indices (f, 3).
        planes: Inverse depth planes (f, 3).
        back: Whether each face shows its back (f,).
        cull_back: Leave out faces that show their back.
        near: Depth of the near plane in metres.
        intrinsics: fx, fy, cx, cy in pixels.
        height: Rows of the image.
        width: Columns of the image.

    Returns:
        Face indices (h, w), -1 where there is none, and inverse depths (h, w) in 1/metres, 0 where there is no face.
    """
    keys = np.zeros(height * (width + WIDTH), np.int64)
    lowest = np.zeros((0, 0), np.int64)
    _draw_side(keys, lowest, 0, points, pixels, faces, planes, back, near, intrinsics, height, width)
    if not cull_back:
        lowest = _farthest_keys(keys, height, width)
        _draw_side(keys, lowest, 1, points, pixels, faces, planes, back, near, intrinsics, height, width)
    return _decode(keys, height, width)
