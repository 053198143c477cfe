"""The kernels of a warp's pixels (Numba): where each caricature pixel comes from in the frame, and its colour there.

What runs for every pixel touches arrays in the kernel's own body: Numba counts references where functions take them.
"""

from __future__ import annotations

import numba
import numpy as np

from carigs.gtstar.bilinear import copy_sample
from carigs.gtstar.warp_kernels_simd import BEYOND, OFF, SMOOTH, WIDTH, locate
from carigs.raster.bit_masks import LOG, NONE, ONE
from carigs.raster.coverage import share_of

kernel = numba.njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
inlined = numba.njit(
    error_model="numpy", fastmath={"contract"}, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
)

OCCLUDED, OUTSIDE_IMAGE = 2, 16  # as in `Reason`


@inlined
def _same(near, other, tolerance):
    """Whether two inverse depths are within `tolerance` metres; 0 is nothing: |1 / a - 1 / b| without divisions."""
    return near > 0.0 and abs(near - other) <= tolerance * near * other


@kernel
def smooth_blocks(nearness, outline, tolerance):
    """The nearness of pixels that show, with the right, the lower and the neighbour between, one surface and all of it.

    0 elsewhere; `outline` are words of `bits`.
    """
    height, width = nearness.shape
    smooth = np.zeros((height, width), np.float32)
    for y in range(height - 1):
        row, below, result = nearness[y], nearness[y + 1], smooth[y]
        mixed, mixed_below = outline[y >> LOG], outline[(y + 1) >> LOG]
        bit, bit_below = np.uint64(y & 63), np.uint64((y + 1) & 63)
        for x in range(width - 1):
            least = min(row[x], row[x + 1], below[x], below[x + 1])
            most = max(row[x], row[x + 1], below[x], below[x + 1])
            part = (mixed[x] | mixed[x + 1]) >> bit | (mixed_below[x] | mixed_below[x + 1]) >> bit_below
            one = (most - least <= tolerance * least * most) & (part & ONE == NONE)  # least = 0 stays 0
            result[x] = least if one else np.float32(0.0)
        for x in range(width - 1):
            result[x] = row[x] if result[x] > 0.0 else np.float32(0.0)
    if height > 1 and width > 1:
        smooth[height - 2, width - 2] = 0.0  # after it there is no float to be read
    return smooth


@inlined
def _unmixed(colour, share, background):
    """The colour of a surface that covers this share of a pixel, the rest of which is background."""
    return np.float32(background + (colour - background) / share)


@inlined
def _mixed(colour, share, background):
    """Its inverse, where that can be shown."""
    return np.float32(min(max(background + share * (colour - background), 0.0), 1.0))


@kernel
def _fetch(image, nearness, outline, first, shares, sa, sb, sc, tolerance, background, sx, sy):
    """Bilinear sample at (sx, sy) where surfaces meet: pixels of another one give their weight to the others.

    Pixels on the outline are freed of their background.  Returns the colour, 0 without any weight, and the weight.
    """
    height, width = nearness.shape
    x, y = max(sx - 0.5, 0.0), max(sy - 0.5, 0.0)
    x0, y0 = int(x), int(y)
    red = green = blue = total = covered = 0.0
    for j in range(2):
        row = min(y0 + j, height - 1)
        for i in range(2):
            column = min(x0 + i, width - 1)
            expected = sa * (column + 0.5) + sb * (row + 0.5) + sc
            if _same(nearness[row, column], expected, tolerance):
                weight = (x - x0 if i else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
                total += weight
                covered += weight * share_of(outline, first, shares, row, column)
                red += weight * image[row, column, 0]
                green += weight * image[row, column, 1]
                blue += weight * image[row, column, 2]
    if not total > 0.0:
        return np.float32(0.0), np.float32(0.0), np.float32(0.0), 0.0
    red, green, blue, covered = red / total, green / total, blue / total, covered / total
    red, green, blue = (
        _unmixed(red, covered, background),
        _unmixed(green, covered, background),
        _unmixed(blue, covered, background),
    )
    return red, green, blue, total


@inlined
def _map(maps, f, px, py):
    """Where in the frame a target pixel comes from; the third value is positive in front of its camera."""
    w = maps[f, 2, 0] * px + maps[f, 2, 1] * py + maps[f, 2, 2]
    inverse = 1.0 / w
    sx = (maps[f, 0, 0] * px + maps[f, 0, 1] * py + maps[f, 0, 2]) * inverse
    sy = (maps[f, 1, 0] * px + maps[f, 1, 1] * py + maps[f, 1, 2]) * inverse
    return sx, sy, w


@inlined
def _inside(sx, sy, w, columns, rows):
    return w > 0.0 and sx >= 0.0 and sy >= 0.0 and sx < columns and sy < rows


@kernel
def _fetch_footprint(image, nearness, outline, first, shares, slope, maps, f, n, tolerance, background, x, y):
    """Mean of n x n samples over a target pixel's footprint in the frame, and their weight."""
    red = green = blue = total = 0.0
    for k in range(n * n):
        sx, sy, w = _map(maps, f, x + (k % n + 0.5) / n, y + (k // n + 0.5) / n)
        if _inside(sx, sy, w, image.shape[1], image.shape[0]):
            r, g, b, weight = _fetch(
                image, nearness, outline, first, shares, slope[f, 0], slope[f, 1], slope[f, 2], tolerance, background,
                sx, sy,
            )  # fmt: skip
            red, green, blue, total = red + weight * r, green + weight * g, blue + weight * b, total + weight
    share = 1.0 / total if total > 0.0 else 0.0
    return np.float32(red * share), np.float32(green * share), np.float32(blue * share), total / (n * n)


@kernel
def source_pixels(face_image, maps):
    """Where in the frame each pixel comes from (h, w, 2; nan off the mesh)."""
    height, width = face_image.shape
    source = np.full((height, width, 2), np.nan, np.float32)
    for y in range(height):
        for x in range(width):
            if face_image[y, x] >= 0:
                source[y, x, 0], source[y, x, 1], _ = _map(maps, face_image[y, x], x + 0.5, y + 0.5)
    return source


@kernel
def _warp_smooth(
    colour, reasons, rest, face_image, outline, maps, of_faces, samples, smooth, slope, image, of_frame, tolerance,
    background,
):  # fmt: skip
    """Colours where one surface is all there is to see, and first reasons; the number of pixels left in `rest`."""
    (height, width), (rows, columns) = face_image.shape, smooth.shape
    faces, maps, slope, smooth, image = (
        face_image.reshape(-1), maps.reshape(-1), slope.reshape(-1), smooth.reshape(-1), image.reshape(-1)
    )  # fmt: skip
    colour, reasons, of_frame = colour.reshape(-1), reasons.reshape(-1), of_frame.reshape(-1)
    fx, fy = np.empty(width + WIDTH, np.float32), np.empty(width + WIDTH, np.float32)
    corner, pixel, state = (
        np.empty(width + WIDTH, np.int32),
        np.empty(width + WIDTH, np.int32),
        np.empty(width + WIDTH, np.int32),
    )
    left = 0
    for y in range(height):
        for x in range(0, width, WIDTH):
            locate(
                faces, y * width + x, width - x, float(x), y + 0.5, maps, slope, smooth, rows, columns, tolerance,
                fx, fy, corner, pixel, state, x,
            )  # fmt: skip
        for x in range(width):
            said, place = state[x], y * width + x
            known, mixed = np.uint16(0), outline[y >> LOG, x] >> np.uint64(y & 63) & ONE
            if said != OFF:
                f = np.uint64(faces[place])  # unsigned: no index counts from the end
                known = of_faces[f]
                if said == BEYOND:
                    known |= np.uint16(OUTSIDE_IMAGE)
                else:
                    known |= of_frame[np.uint64(pixel[x])]
                    if said == SMOOTH and not mixed and samples[f] == 1:
                        reasons[place] = known
                        copy_sample(image, 3 * np.int64(corner[x]), 3 * columns, fx[x], fy[x], colour, 3 * place)
                        continue
                    rest[left] = place
                    left += 1
            reasons[place] = known
            colour[3 * place] = colour[3 * place + 1] = colour[3 * place + 2] = background
    return left


@kernel
def _warp_pixel(maps, samples, nearness, outline, first, shares, slope, image, tolerance, background, f, x, y):
    """Colour of a target pixel whose source needs a closer look, and its weight."""
    if samples[f] > 1:
        return _fetch_footprint(
            image, nearness, outline, first, shares, slope, maps, f, samples[f], tolerance, background, x, y
        )  # fmt: skip
    sx, sy, _ = _map(maps, f, x + 0.5, y + 0.5)
    return _fetch(
        image, nearness, outline, first, shares, slope[f, 0], slope[f, 1], slope[f, 2], tolerance, background, sx, sy
    )  # fmt: skip


@kernel
def warp(face_image, target, maps, of_faces, samples, nearness, source, slope, image, of_frame, tolerance, background):
    """Colour (h, w, 3) and reasons (h, w) of every target pixel.

    `face_image` and the coverage `target` are the caricature's; `nearness`, the coverage `source` and `slope` the
    frame's; `of_faces` and `of_frame` are reasons of triangles and of pixels of the frame; `tolerance` is in metres.
    """
    height, width = face_image.shape
    outline, first, shares = source
    target_outline, target_first, target_shares = target
    smooth = smooth_blocks(nearness, outline, np.float32(tolerance))
    colour, reasons = np.empty((height, width, 3), np.float32), np.empty((height, width), np.uint16)
    rest = np.empty(height * width, np.int32)
    left = _warp_smooth(
        colour, reasons, rest, face_image, target_outline, maps, of_faces, samples, smooth, slope, image, of_frame,
        tolerance, np.float32(background),
    )  # fmt: skip
    for k in range(left):
        y, x = rest[k] // width, rest[k] % width
        red, green, blue, weight = _warp_pixel(
            maps, samples, nearness, outline, first, shares, slope, image, tolerance, background, face_image[y, x], x, y
        )  # fmt: skip
        if weight > 0.0:
            covered = share_of(target_outline, target_first, target_shares, y, x)
            colour[y, x, 0] = _mixed(red, covered, background)
            colour[y, x, 1] = _mixed(green, covered, background)
            colour[y, x, 2] = _mixed(blue, covered, background)
        if weight < 0.5:
            reasons[y, x] |= np.uint16(OCCLUDED)
    return colour, reasons
