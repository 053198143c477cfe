"""Numba kernels: cells of the surface that pixels show, histograms of their colours, and medians of histograms.

A cell is a part of a triangle: large triangles are divided, so that a cell shows about one pixel of a close view.
"""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel

BINS = 64
"""Bins of a histogram of colours in [0, 1]."""


@kernel
def facing_faces(points, faces, min_cosine):
    """Faces whose front a camera sees at an angle that is not too oblique.

    Args:
        points: Vertices (v, 3) in camera axes.
        faces: Vertex indices (f, 3).
        min_cosine: Least cosine between the normal of a face and the direction to the camera, greater than 0.

    Returns:
        Whether the cosine between the normal of each face and the direction from its centre to the camera is larger
        than that (f,).
    """
    facing = np.zeros(faces.shape[0], np.bool_)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
        cx, cy, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        ax, ay, az = ax + (bx + cx) / 3.0, ay + (by + cy) / 3.0, az + (bz + cz) / 3.0
        toward = -(nx * ax + ny * ay + nz * az)
        lengths = (nx * nx + ny * ny + nz * nz) * (ax * ax + ay * ay + az * az)
        facing[f] = toward > 0.0 and toward * toward > min_cosine * min_cosine * lengths
    return facing


@kernel
def cell_image(
    face_image, barycentric, inverse_depth, planes, matte, usable, component, first, parts, matte_limit, jump
):
    """Cell that each pixel shows, without pixels near outlines.

    A pixel is left out unless its eight neighbours show the same component of the mesh, without a jump in depth.

    Args:
        face_image: Nearest faces (h, w), -1 where there is none.
        barycentric: Weights of the corners (h, w, 3).
        inverse_depth: Inverse depth (h, w) in 1/metres.
        planes: Inverse depth planes of the faces (f, 3).
        matte: Opacity of the foreground (h, w).
        usable: Faces to look at (f,).
        component: Connected component of each face (f,).
        first: Number of the first cell of each face (f,).
        parts: Divisions of each edge of a face (f,): it has their square of cells.
        matte_limit: Least opacity.
        jump: Largest difference in depth of a neighbour from the plane of the face, in metres.

    Returns:
        Cells (h, w), -1 where a pixel is left out.
    """
    height, width = face_image.shape
    cells = np.full((height, width), -1, np.int32)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            f = face_image[y, x]
            if f < 0 or not usable[f] or matte[y, x] < matte_limit:
                continue
            inside = True
            for v in range(y - 1, y + 2):
                for u in range(x - 1, x + 2):
                    g = face_image[v, u]
                    if g < 0 or component[g] != component[f]:
                        inside = False
                        break
                    plane = planes[f, 0] * (u + 0.5) + planes[f, 1] * (v + 0.5) + planes[f, 2]
                    if abs(plane - inverse_depth[v, u]) > jump * plane * inverse_depth[v, u]:
                        inside = False
                        break
            if not inside:
                continue
            n = parts[f]
            b, c = barycentric[y, x, 1] * n, barycentric[y, x, 2] * n
            i, j = int(b), int(c)
            i, j = min(max(i, 0), n - 1), min(max(j, 0), n - 1)
            upper = 1 if b - i + c - j > 1.0 and i + j < n - 1 else 0
            # Row i of cells has 2 (n - i) - 1 of them.
            cells[y, x] = first[f] + i * (2 * n - i) + min(2 * j + upper, 2 * (n - i) - 2)
    return cells


@kernel
def add_colours(histograms, cells, image):
    """Add the colours of an image to the histograms of the cells that its pixels show.

    Args:
        histograms: Counts (c, 3, BINS), changed in place.
        cells: Cells (h, w), -1 for pixels to leave out.
        image: Colours (h, w, 3) in [0, 1].
    """
    height, width = cells.shape
    for y in range(height):
        for x in range(width):
            if cells[y, x] >= 0:
                for k in range(3):
                    value = min(max(int(image[y, x, k] * BINS), 0), BINS - 1)
                    histograms[cells[y, x], k, value] += 1


@kernel
def quantiles(histograms, share):
    """Quantile of each histogram, interpolated linearly inside its bin.

    Args:
        histograms: Counts (n, b) of values in [0, 1], in bins of equal width.
        share: Share of the values below the quantile.

    Returns:
        Quantiles (n,); nan for an empty histogram.
    """
    n, bins = histograms.shape
    result = np.full(n, np.nan)
    for i in range(n):
        total = 0.0
        for b in range(bins):
            total += histograms[i, b]
        rest = share * total
        if total > 0:
            for b in range(bins):
                count = float(histograms[i, b])
                if count > 0 and (rest <= count):
                    result[i] = (b + rest / count) / bins
                    break
                rest -= count
    return result


@kernel
def residuals(cells, image, median):
    """Difference of each pixel from the median of its cell, averaged over the channels.

    Args:
        cells: Cells (h, w), -1 for pixels to leave out.
        image: Colours (h, w, 3).
        median: Median colours of the cells (c, 3), nan where unknown.

    Returns:
        Differences (h, w), 0 where the pixel is left out, and 1 or 0 for whether it is used (h, w).
    """
    height, width = cells.shape
    difference, used = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            c = cells[y, x]
            if c >= 0 and median[c, 0] == median[c, 0]:
                total = 0.0
                for k in range(3):
                    total += image[y, x, k] - median[c, k]
                difference[y, x], used[y, x] = total / 3.0, 1.0
    return difference, used


@kernel
def add_values(histograms, faces, used, values, largest):
    """Add the values of pixels to the histograms of the faces that they show.

    Args:
        histograms: Counts (f, b), changed in place; the last bin has all values above `largest`.
        faces: Faces (h, w).
        used: Greater than 0 for pixels to add (h, w).
        values: Values of at least 0 (h, w).
        largest: Upper end of the last bin.
    """
    height, width = faces.shape
    bins = histograms.shape[1]
    for y in range(height):
        for x in range(width):
            if used[y, x] > 0:
                histograms[faces[y, x], min(int(values[y, x] / largest * bins), bins - 1)] += 1
