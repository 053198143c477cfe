"""Numba kernels of coverage: the share of each outline pixel that the mesh covers.

Pixels along the outline of a mesh are partly background. Only they are sampled, on a regular grid: each triangle that
touches one sets the bits of the samples that it contains.
"""

from __future__ import annotations

import numpy as np

from carigs.raster.bit_masks import ALL, LOG, ONE, ZERO, complement, dilate_vertically, or_shifted, popcount
from carigs.raster.scan_conversion import bounding_box
from carigs.simd.kernels import kernel


@kernel
def outline(on_mesh, height):
    """Pixels on the mesh with one of their eight neighbours off it.

    Args:
        on_mesh: Words (j, w) of the mask of the mesh.
        height: Rows of the image.

    Returns:
        Words of the outline's mask.
    """
    off_mesh = dilate_vertically(complement(on_mesh, height), 1)
    dilated = off_mesh.copy()
    or_shifted(dilated, off_mesh, 1)
    return dilated & on_mesh


@kernel
def _pixel_numbers(words):
    """Number of the first pixel of each word (j, w) of a mask, and the number of its pixels in total."""
    first, total = np.empty(words.shape, np.int32), 0
    for j in range(words.shape[0]):
        for x in range(words.shape[1]):
            first[j, x] = total
            total += popcount(words[j, x])
    return first, total


@kernel
def _number(words, first, y, x):
    """Number of a pixel of the mask, -1 for other pixels."""
    word, bit = words[y >> LOG, x], ONE << np.uint64(y & 63)
    return first[y >> LOG, x] + np.int64(popcount(word & (bit - ONE))) if word & bit else np.int64(-1)


@kernel
def _merge_columns(words):
    """Combine the bits of every eight columns into one word."""
    result = np.zeros((words.shape[0], (words.shape[1] + 7) // 8), np.uint64)
    for j in range(words.shape[0]):
        for x in range(words.shape[1]):
            result[j, x // 8] |= words[j, x]
    return result


@kernel
def _touches(words, left, right, top, bottom):
    """Whether any pixel of the mask lies in a range of columns and rows, both ends included."""
    for j in range(top >> LOG, (bottom >> LOG) + 1):
        inside = ALL
        if j == top >> LOG:
            inside &= ALL << np.uint64(top & 63)
        if j == bottom >> LOG:
            inside &= ALL >> np.uint64(63 - (bottom & 63))
        for x in range(left, right + 1):
            if words[j, x] & inside:
                return True
    return False


@kernel
def _edge_function(ax, ay, bx, by, sign):
    """Edge function (Pineda 1988), positive inside: its coefficients of x and y, and its constant."""
    sx, sy = sign * (ay - by), sign * (bx - ax)
    return sx, sy, -(sx * ax + sy * ay)


@kernel
def _sample_triangle(pixels, i, j, k, sx, sy, left, right, top, bottom, outline, first, samples):
    """Set the bits of the samples inside a triangle, for the outline pixels within its bounding box."""
    ax, ay, bx, by, cx, cy = pixels[i, 0], pixels[i, 1], pixels[j, 0], pixels[j, 1], pixels[k, 0], pixels[k, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    sign = 1.0 if area > 0.0 else -1.0
    ux, uy, u = _edge_function(ax, ay, bx, by, sign)
    vx, vy, v = _edge_function(bx, by, cx, cy, sign)
    wx, wy, w = _edge_function(cx, cy, ax, ay, sign)
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            number = _number(outline, first, y, x)
            if number < 0:
                continue
            pu, pv, pw = ux * x + uy * y + u, vx * x + vy * y + v, wx * x + wy * y + w
            inside = ZERO
            for s in range(len(sx)):
                least = min(pu + ux * sx[s] + uy * sy[s], pv + vx * sx[s] + vy * sy[s], pw + wx * sx[s] + wy * sy[s])
                inside |= np.uint64(least >= 0.0) << np.uint64(s)
            samples[number] |= inside


@kernel
def covered_shares(points, pixels, faces, outline, n, near, height):
    """Share of each pixel that the mesh covers.

    Args:
        points: Vertices (v, 3) in camera axes, in metres.
        pixels: Their image positions (v, 2).
        faces: Vertex indices (f, 3).
        outline: Words (j, w) of the mask of the pixels to sample.
        n: Samples per pixel and axis, at most 8.
        near: Faces that reach nearer than this depth, in metres, are not counted.
        height: Rows of the image.

    Returns:
        Shares (h, w): at least 1 / n^2 in pixels of the mask, 1 in the others.
    """
    width, merged = outline.shape[1], _merge_columns(outline)
    first, total = _pixel_numbers(outline)
    samples = np.zeros(total, np.uint64)
    sx, sy = (np.arange(n * n) % n + 0.5) / n, (np.arange(n * n) // n + 0.5) / n
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        x0, x1, y0, y1 = bounding_box(pixels, i, j, k)
        if not (min(points[i, 2], points[j, 2], points[k, 2]) > near and np.isfinite(x0 + x1 + y0 + y1)):
            continue
        left, right = int(min(max(x0, 0.0), width)), int(max(min(x1, width - 1.0), -1.0))
        top, bottom = int(min(max(y0, 0.0), height)), int(max(min(y1, height - 1.0), -1.0))
        if left <= right and top <= bottom and _touches(merged, left // 8, right // 8, top, bottom):
            _sample_triangle(pixels, i, j, k, sx, sy, left, right, top, bottom, outline, first, samples)
    shares = np.ones((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            number = _number(outline, first, y, x)
            if number >= 0:
                shares[y, x] = max(np.int64(popcount(samples[number])), 1) / (n * n)
    return shares
