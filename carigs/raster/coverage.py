"""The kernels of coverage (Numba): how much of each pixel on the outline of what is seen the mesh covers.

Inside a mesh one ray per pixel is enough; along its outline pixels are partly background.  Only those are looked at:
per triangle near the outline and row of samples, the bits of the samples in its span.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.raster.scan import TILE, bounds, ordered, rows, slopes, span, tiles

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)
ONE = np.uint64(1)


@kernel
def outline(face_image):
    """1 for the pixels on the mesh with one of the eight neighbours off it, else 0."""
    height, width = face_image.shape
    found = np.zeros((height, width), np.uint8)
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width - 2):
            any_off = face_image[above, x] | face_image[above, x + 1] | face_image[above, x + 2]
            any_off |= face_image[y, x] | face_image[y, x + 2]
            any_off |= face_image[below, x] | face_image[below, x + 1] | face_image[below, x + 2]
            found[y, x + 1] = any_off < 0 <= face_image[y, x + 1]
        for x, beside in ((0, min(1, width - 1)), (width - 1, max(width - 2, 0))):
            any_off = face_image[above, x] | face_image[above, beside] | face_image[y, beside]
            any_off |= face_image[below, x] | face_image[below, beside]
            found[y, x] = any_off < 0 <= face_image[y, x]
    return found


@kernel
def _number(found):
    """The number of each outline pixel (undefined elsewhere), the pixels by number, and which tiles hold some."""
    height, width = found.shape
    number, where, count = np.empty((height, width), np.int32), np.empty(height * width, np.int32), 0
    held = np.zeros(((height + TILE - 1) // TILE, (width + TILE - 1) // TILE), np.bool_)
    for y in range(height):
        for x in range(width):
            if found[y, x]:
                number[y, x], where[count] = count, y * width + x
                held[y // TILE, x // TILE] = True
                count += 1
    return number, where[:count], held


@kernel
def _mark(ax, ay, bx, by, cx, cy, n, found, number, bits):
    """Set the bits of the samples in one triangle; corners are in samples."""
    if not np.isfinite(ax + ay + bx + by + cx + cy):
        return
    height, width = found.shape
    left, right = max(min(ax, bx, cx), 0.0), min(max(ax, bx, cx), width * n - 1.0)
    tx, ty, mx, my, bx, by = ordered(ax, ay, bx, by, cx, cy)
    first, last = rows(ty, by, height * n)
    long, upper, lower, turn = slopes(tx, ty, mx, my, bx, by)
    for y in range(first // n, (last + n - 1) // n):
        column, end = int(left) // n, int(right) // n + 1
        while column < end and not found[y, column]:
            column += 1
        if column >= end:
            continue
        for row in range(max(first, y * n), min(last, y * n + n)):
            x0, x1 = span(tx, ty, mx, my, long, upper, lower, turn, row, width * n)
            for x in range(max(x0 // n, column), (x1 + n - 1) // n if x0 < x1 else 0):
                if found[y, x]:
                    low, high = max(x0 - x * n, 0), min(x1 - x * n, n)
                    samples = ((ONE << np.uint64(high)) - ONE) & ~((ONE << np.uint64(low)) - ONE)
                    bits[number[y, x]] |= samples << np.uint64(row % n * n)


@kernel
def _share(bits, n):
    count = 0
    while bits:
        bits &= bits - ONE
        count += 1
    return np.float32(max(count, 1) / (n * n))


@kernel
def cover(seen, pixel, faces, face_image, n, near):
    """Share of each pixel's n x n samples (n <= 8) that lie in any face, for those on the outline; 1 elsewhere."""
    found = outline(face_image)
    number, where, held = _number(found)
    height, width = found.shape
    bits = np.zeros(len(where), np.uint64)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        if not min(seen[i, 2], seen[j, 2], seen[k, 2]) > near:
            continue
        left, right, top, bottom = tiles(*bounds(pixel, i, j, k), height, width)
        near_outline = False
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                near_outline |= held[row, column]
        if near_outline:
            _mark(
                pixel[i, 0] * n, pixel[i, 1] * n, pixel[j, 0] * n, pixel[j, 1] * n, pixel[k, 0] * n, pixel[k, 1] * n,
                n, found, number, bits,
            )  # fmt: skip
    share = np.ones((height, width), np.float32)
    for k in range(len(where)):
        share[where[k] // width, where[k] % width] = _share(bits[k], n)
    return share
