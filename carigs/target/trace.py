"""The kernels of the warp (Numba): where each caricature pixel comes from in the frame, and its colour there."""

from __future__ import annotations

import numba
import numpy as np

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)
inlined = numba.njit(inline="always")

NEWLY_VISIBLE, OCCLUDED, GRAZING, STRETCHED, OUTSIDE_IMAGE, OUTSIDE_MESH = 1, 2, 4, 8, 16, 32  # as in `Reason`
HALF = np.float32(0.5)
MOST_SAMPLES = 4  # per axis of a footprint


@kernel
def look_up(face_image, of_faces):
    """The value of each pixel's face, 0 where there is none."""
    image = np.zeros(face_image.shape, of_faces.dtype)
    for y in range(face_image.shape[0]):
        for x in range(face_image.shape[1]):
            if face_image[y, x] >= 0:
                image[y, x] = of_faces[face_image[y, x]]
    return image


@kernel
def perspective_maps(source, target, faces, source_lens, target_lens):
    """Per face the homography of target pixels to frame pixels that keeps the 3D point (f, 3, 3).

    With corners in camera axes as columns of S and T, a ray d meets the face at z d = T w, so S w = z S T^-1 d.  Rows
    of T^-1 are cross products of its columns, up to the determinant, which drops out.
    """
    sfx, sfy, scx, scy = source_lens
    tfx, tfy, tcx, tcy = target_lens
    maps, inverse, point = np.empty((faces.shape[0], 3, 3)), np.empty((3, 3)), np.empty(3)
    for f in range(faces.shape[0]):
        for k in range(3):
            b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            for m in range(3):
                n, o = (m + 1) % 3, (m + 2) % 3
                inverse[k, m] = target[b, n] * target[c, o] - target[b, o] * target[c, n]
        a = faces[f, 0]
        determinant = target[a, 0] * inverse[0, 0] + target[a, 1] * inverse[0, 1] + target[a, 2] * inverse[0, 2]
        for m in range(3):  # columns of S T^-1 K_target^-1, after K_source
            for n in range(3):
                point[n] = 0.0
                for k in range(3):
                    point[n] += source[faces[f, k], n] * inverse[k, m]
                point[n] /= determinant
            maps[f, 0, m] = sfx * point[0] + scx * point[2]
            maps[f, 1, m] = sfy * point[1] + scy * point[2]
            maps[f, 2, m] = point[2]
        for n in range(3):
            maps[f, n, 0] /= tfx
            maps[f, n, 1] /= tfy
            maps[f, n, 2] -= maps[f, n, 0] * tcx + maps[f, n, 1] * tcy
    return maps


@kernel
def affine_maps(source, target, faces):
    """Per face the affine map of target pixels to frame pixels that takes corners to corners (paper, equation 5)."""
    maps = np.zeros((faces.shape[0], 3, 3))
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, vx, vy = (
            target[b, 0] - target[a, 0],
            target[b, 1] - target[a, 1],
            target[c, 0] - target[a, 0],
            target[c, 1] - target[a, 1],
        )
        area = ux * vy - uy * vx
        for k in range(2):
            p, q = source[b, k] - source[a, k], source[c, k] - source[a, k]
            maps[f, k, 0], maps[f, k, 1] = (p * vy - q * uy) / area, (q * ux - p * vx) / area
            maps[f, k, 2] = source[a, k] - maps[f, k, 0] * target[a, 0] - maps[f, k, 1] * target[a, 1]
        maps[f, 2, 2] = 1.0
    return maps


@kernel
def judge_faces(of_faces, source, source_pixel, target_pixel, faces, source_back, target_back, grazing, stretch):
    """Add to each face's reasons what this view makes of it; also the samples per axis that its footprint takes.

    `grazing` is the least cosine between the view and the normal in the frame, `stretch` the largest ratio of areas.
    """
    reasons, samples = of_faces.copy(), np.ones(faces.shape[0], np.uint8)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if source_back[f] != target_back[f]:
            reasons[f] |= np.uint16(NEWLY_VISIBLE)
        x, y, z = source[a, 0], source[a, 1], source[a, 2]
        ux, uy, uz = source[b, 0] - x, source[b, 1] - y, source[b, 2] - z
        vx, vy, vz = source[c, 0] - x, source[c, 1] - y, source[c, 2] - z
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))
        if abs(nx * x + ny * y + nz * z) < grazing * length:
            reasons[f] |= np.uint16(GRAZING)
        px, py = source_pixel[b, 0] - source_pixel[a, 0], source_pixel[b, 1] - source_pixel[a, 1]
        qx, qy = source_pixel[c, 0] - source_pixel[a, 0], source_pixel[c, 1] - source_pixel[a, 1]
        sx, sy = target_pixel[b, 0] - target_pixel[a, 0], target_pixel[b, 1] - target_pixel[a, 1]
        tx, ty = target_pixel[c, 0] - target_pixel[a, 0], target_pixel[c, 1] - target_pixel[a, 1]
        before, after = abs(px * qy - py * qx), abs(sx * ty - sy * tx)
        if after > stretch * before:
            reasons[f] |= np.uint16(STRETCHED)
        if after > 0.0:
            # The Jacobian's largest singular value from its Frobenius norm and determinant.
            xx, xy = (px * ty - qx * sy) / after, (qx * sx - px * tx) / after
            yx, yy = (py * ty - qy * sy) / after, (qy * sx - py * tx) / after
            norm = xx * xx + xy * xy + yx * yx + yy * yy
            ratio = before / after
            largest = np.sqrt(0.5 * (norm + np.sqrt(max(norm * norm - 4.0 * ratio * ratio, 0.0))))
            samples[f] = np.uint8(min(max(np.rint(largest), 1.0), float(MOST_SAMPLES)))
    return reasons, samples


@inlined
def _same(near, other, tolerance):
    """Whether two inverse depths are within `tolerance` metres; 0 is nothing: |1 / a - 1 / b| without divisions."""
    return near > 0.0 and abs(near - other) <= tolerance * near * other


@kernel
def smooth_blocks(nearness, tolerance):
    """Whether each pixel, its right, its lower neighbour and the one between them show one surface."""
    height, width = nearness.shape
    smooth = np.zeros((height, width), np.bool_)
    for y in range(height - 1):
        for x in range(width - 1):
            a, b, c, d = nearness[y, x], nearness[y, x + 1], nearness[y + 1, x], nearness[y + 1, x + 1]
            least, most = min(a, b, c, d), max(a, b, c, d)
            smooth[y, x] = _same(least, most, tolerance)
    return smooth


@kernel
def _fetch_edge(image, nearness, sa, sb, sc, tolerance, sx, sy):
    """Bilinear sample at (sx, sy) where surfaces meet: pixels of another one give their weight to the others.

    Returns the colour, 0 without any weight, and the weight.
    """
    height, width = nearness.shape
    x, y = max(sx - 0.5, 0.0), max(sy - 0.5, 0.0)
    x0, y0 = int(x), int(y)
    red = green = blue = total = 0.0
    for j in range(2):
        row = min(y0 + j, height - 1)
        for i in range(2):
            column = min(x0 + i, width - 1)
            expected = sa * (column + 0.5) + sb * (row + 0.5) + sc
            if _same(nearness[row, column], expected, tolerance):
                weight = (x - x0 if i else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
                total += weight
                red += weight * image[row, column, 0]
                green += weight * image[row, column, 1]
                blue += weight * image[row, column, 2]
    share = 1.0 / total if total > 0.0 else 0.0
    return np.float32(red * share), np.float32(green * share), np.float32(blue * share), total


@inlined
def _fetch(image, nearness, smooth, sa, sb, sc, tolerance, sx, sy):
    """Bilinear sample of the frame's own surface at (sx, sy), and how much of its weight shows that surface."""
    x, y = np.float32(sx) - HALF, np.float32(sy) - HALF
    i, j = np.int32(x), np.int32(y)
    if x >= 0 and y >= 0 and smooth[j, i] and _same(nearness[j, i], sa * (i + 0.5) + sb * (j + 0.5) + sc, tolerance):
        fx, fy = x - np.float32(i), y - np.float32(j)
        red, green, blue = (
            _bilinear(image, i, j, fx, fy, 0),
            _bilinear(image, i, j, fx, fy, 1),
            _bilinear(image, i, j, fx, fy, 2),
        )
        return red, green, blue, 1.0
    return _fetch_edge(image, nearness, sa, sb, sc, tolerance, sx, sy)


@inlined
def _bilinear(image, i, j, fx, fy, k):
    j, i = np.uint32(j), np.uint32(i)  # unsigned: no index counts from the end
    right, below = i + np.uint32(1), j + np.uint32(1)
    above = image[j, i, k] + fx * (image[j, right, k] - image[j, i, k])
    return above + fy * (image[below, i, k] + fx * (image[below, right, k] - image[below, i, k]) - above)


@inlined
def _map(maps, f, px, py):
    """Where in the frame a target pixel comes from; the third value is positive in front of its camera."""
    w = maps[f, 2, 0] * px + maps[f, 2, 1] * py + maps[f, 2, 2]
    inverse = 1.0 / w
    sx = (maps[f, 0, 0] * px + maps[f, 0, 1] * py + maps[f, 0, 2]) * inverse
    sy = (maps[f, 1, 0] * px + maps[f, 1, 1] * py + maps[f, 1, 2]) * inverse
    return sx, sy, w


@kernel
def _fetch_footprint(image, nearness, smooth, maps, slope, f, n, tolerance, x, y):
    """Mean of n x n samples over a target pixel's footprint in the frame, and their weight."""
    red = green = blue = total = 0.0
    rows, columns = nearness.shape
    for k in range(n * n):
        sx, sy, w = _map(maps, f, x + (k % n + 0.5) / n, y + (k // n + 0.5) / n)
        if w > 0.0 and sx >= 0.0 and sy >= 0.0 and sx < columns and sy < rows:
            r, g, b, weight = _fetch(
                image, nearness, smooth, slope[f, 0], slope[f, 1], slope[f, 2], tolerance, sx, sy
            )  # fmt: skip
            red, green, blue, total = red + weight * r, green + weight * g, blue + weight * b, total + weight
    share = 1.0 / total if total > 0.0 else 0.0
    return np.float32(red * share), np.float32(green * share), np.float32(blue * share), total / (n * n)


@kernel
def follow(face_image, maps, of_faces, of_frame):
    """Source pixel (h, w, 2; nan off the mesh) and first reasons (h, w) of every target pixel."""
    height, width = face_image.shape
    rows, columns = of_frame.shape
    source = np.full((height, width, 2), np.nan, np.float32)
    reasons = np.zeros((height, width), np.uint16)
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0:
                continue
            sx, sy, w = _map(maps, f, x + 0.5, y + 0.5)
            source[y, x, 0], source[y, x, 1] = sx, sy
            found = of_faces[f]
            if w > 0.0 and sx >= 0.0 and sy >= 0.0 and sx < columns and sy < rows:
                found |= of_frame[int(sy), int(sx)]
            else:
                found |= np.uint16(OUTSIDE_IMAGE)
            reasons[y, x] = found
    return source, reasons


@kernel
def sample(source, reasons, face_image, maps, samples, nearness, slope, image, tolerance, background):
    """Colour (h, w, 3) of every target pixel; those whose surface the frame does not show are marked in `reasons`.

    `face_image` is the caricature's; `nearness` and `slope` are the frame's; `tolerance` is in metres.
    """
    height, width = face_image.shape
    smooth = smooth_blocks(nearness, tolerance)
    colour = np.full((height, width, 3), background, np.float32)
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0 or reasons[y, x] & np.uint16(OUTSIDE_IMAGE):
                continue
            if samples[f] == 1:
                red, green, blue, weight = _fetch(
                    image, nearness, smooth, slope[f, 0], slope[f, 1], slope[f, 2], tolerance,
                    source[y, x, 0], source[y, x, 1],
                )  # fmt: skip
            else:
                red, green, blue, weight = _fetch_footprint(
                    image, nearness, smooth, maps, slope, f, samples[f], tolerance, x, y
                )
            if weight > 0.0:
                colour[y, x, 0], colour[y, x, 1], colour[y, x, 2] = red, green, blue
            if weight < 0.5:
                reasons[y, x] |= np.uint16(OCCLUDED)
    return colour


@kernel
def gather(colour, reasons, n):
    """Pixels from n x n samples each: the mean of their colours, and all their reasons."""
    height, width = reasons.shape[0] // n, reasons.shape[1] // n
    mean, all_reasons = np.empty((height, width, 3), np.float32), np.zeros((height, width), np.uint16)
    share = np.float32(1.0 / (n * n))
    for y in range(height):
        for x in range(width):
            red = green = blue = np.float32(0.0)
            for j in range(y * n, y * n + n):
                for i in range(x * n, x * n + n):
                    red += colour[j, i, 0]
                    green += colour[j, i, 1]
                    blue += colour[j, i, 2]
                    all_reasons[y, x] |= reasons[j, i]
            mean[y, x, 0], mean[y, x, 1], mean[y, x, 2] = red * share, green * share, blue * share
    return mean, all_reasons
