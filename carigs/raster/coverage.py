"""The kernels of coverage (Numba): how much of each pixel on the outline of what is seen the mesh covers.

Inside a mesh one ray per pixel is enough; along its outline pixels are partly background.  Only those are looked at:
per triangle that reaches one and row of samples, the bits of the samples in its span.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.raster.bit_masks import ALL, LOG, NONE, ONE, add_beside, count, inverse, stretched
from carigs.raster.visibility import bounds

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


@kernel
def outline(on_mesh, height):
    """The pixels on the mesh with one of the eight neighbours off it; both are words of `bits`."""
    off = stretched(inverse(on_mesh, height), 1)
    beside = off.copy()
    add_beside(beside, off, 1)
    return beside & on_mesh


@kernel
def numbered(words):
    """The number of the first pixel of each word, and how many pixels there are."""
    first, total = np.empty(words.shape, np.int32), 0
    for j in range(words.shape[0]):
        for x in range(words.shape[1]):
            first[j, x] = total
            total += count(words[j, x])
    return first, total


@kernel
def number_of(words, first, y, x):
    """The number of a pixel of the mask, -1 for others."""
    word, bit = words[y >> LOG, x], ONE << np.uint64(y & 63)
    return first[y >> LOG, x] + np.int64(count(word & (bit - ONE))) if word & bit else np.int64(-1)


@kernel
def _gathered(words):
    """The bits of every eight columns in one word."""
    result = np.zeros((words.shape[0], (words.shape[1] + 7) // 8), np.uint64)
    for j in range(words.shape[0]):
        for x in range(words.shape[1]):
            result[j, x // 8] |= words[j, x]
    return result


@kernel
def _touches(words, left, right, top, bottom):
    """Whether any pixel of the mask lies in these columns and rows (both ends included)."""
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
def _edge(ax, ay, bx, by, turn):
    """The function of x and y that is positive on the inner side of an edge: its slopes, and its value at 0."""
    sx, sy = turn * (ay - by), turn * (bx - ax)
    return sx, sy, -(sx * ax + sy * ay)


@kernel
def _mark(pixel, i, j, k, sx, sy, left, right, top, bottom, words, first, samples):
    """Set the bits of the samples in one triangle, for the pixels of the mask within its box."""
    ax, ay, bx, by, cx, cy = pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    turn = 1.0 if area > 0.0 else -1.0
    ux, uy, u = _edge(ax, ay, bx, by, turn)
    vx, vy, v = _edge(bx, by, cx, cy, turn)
    wx, wy, w = _edge(cx, cy, ax, ay, turn)
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            number = number_of(words, first, y, x)
            if number < 0:
                continue
            pu, pv, pw = ux * x + uy * y + u, vx * x + vy * y + v, wx * x + wy * y + w
            found = NONE
            for s in range(len(sx)):
                least = min(pu + ux * sx[s] + uy * sy[s], pv + vx * sx[s] + vy * sy[s], pw + wx * sx[s] + wy * sy[s])
                found |= np.uint64(least >= 0.0) << np.uint64(s)
            samples[number] |= found


@kernel
def cover(seen, pixel, faces, words, first, total, n, near, height):
    """Bits of the n x n samples (n <= 8) that lie in any face, for each pixel of the mask `words`."""
    width, eighth = words.shape[1], _gathered(words)
    samples = np.zeros(total, np.uint64)
    sx, sy = (np.arange(n * n) % n + 0.5) / n, (np.arange(n * n) // n + 0.5) / n
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        x0, x1, y0, y1 = bounds(pixel, i, j, k)
        if not (min(seen[i, 2], seen[j, 2], seen[k, 2]) > near and np.isfinite(x0 + x1 + y0 + y1)):
            continue
        left, right = int(min(max(x0, 0.0), width)), int(min(x1, width - 1.0))
        top, bottom = int(min(max(y0, 0.0), height)), int(min(y1, height - 1.0))
        if left <= right and top <= bottom and _touches(eighth, left // 8, right // 8, top, bottom):
            _mark(pixel, i, j, k, sx, sy, left, right, top, bottom, words, first, samples)
    return samples


@kernel
def partly(words, samples, n):
    """The pixels of a mask with samples off the mesh, and the share of those on it."""
    part, shares, number, kept = words.copy(), np.empty(len(samples), np.float32), 0, 0
    for j in range(words.shape[0]):
        for x in range(words.shape[1]):
            left = words[j, x]
            while left:
                lowest = left & (~left + ONE)
                on_mesh = np.int64(count(samples[number]))
                if on_mesh == n * n:
                    part[j, x] ^= lowest
                else:
                    shares[kept] = np.float32(max(on_mesh, 1) / (n * n))
                    kept += 1
                left ^= lowest
                number += 1
    return part, shares[:kept]


@kernel
def share_of(words, first, shares, y, x):
    """How much of a pixel is covered."""
    number = number_of(words, first, y, x)
    return shares[number] if number >= 0 else np.float32(1.0)


@kernel
def image(words, first, shares, height):
    """The share at every pixel."""
    result = np.empty((height, words.shape[1]), np.float32)
    for y in range(height):
        for x in range(words.shape[1]):
            result[y, x] = share_of(words, first, shares, y, x)
    return result
