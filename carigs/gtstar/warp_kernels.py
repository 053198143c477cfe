"""Numba kernels of the warp: the source of each caricature pixel in the frame, and its bilinear colour.

The loops over all pixels access arrays in the body of their own kernel, because Numba counts references when arrays are
passed to functions.
"""

from __future__ import annotations

from functools import partial

import numba
import numpy as np

from carigs.gtstar.bilinear import copy_sample
from carigs.gtstar.warp_kernels_simd import BEYOND, OFF, SMOOTH, WIDTH, locate
from carigs.raster.bit_masks import LOG, ONE, ZERO
from carigs.raster.coverage import covered_share
from carigs.simd.kernels import kernel

_kernel = partial(kernel, fastmath={"contract"})
_inlined = numba.njit(
    error_model="numpy", fastmath={"contract"}, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
)

OCCLUDED, OUTSIDE_IMAGE = 2, 16
"""Bits of `MaskFlag`; kernels cannot use the enumeration."""


@_inlined
def _same_depth(near, other, tolerance):
    """Whether |1 / near - 1 / other| <= tolerance for two inverse depths; false where there is no surface (0)."""
    return near > 0.0 and abs(near - other) <= tolerance * near * other


@_kernel
def _smooth_blocks(inverse_depth, outline, tolerance):
    """Inverse depth where the block of 2 x 2 pixels that begins at a pixel shows one surface, fully covered; else 0.

    `outline` holds words of the mask of partly covered pixels.
    """
    height, width = inverse_depth.shape
    smooth = np.zeros((height, width), np.float32)
    for y in range(height - 1):
        row, below, result = inverse_depth[y], inverse_depth[y + 1], smooth[y]
        mixed, mixed_below = outline[y >> LOG], outline[(y + 1) >> LOG]
        bit, bit_below = np.uint64(y & 63), np.uint64((y + 1) & 63)
        for x in range(width - 1):
            least = min(row[x], row[x + 1], below[x], below[x + 1])
            most = max(row[x], row[x + 1], below[x], below[x + 1])
            part = (mixed[x] | mixed[x + 1]) >> bit | (mixed_below[x] | mixed_below[x + 1]) >> bit_below
            one = (most - least <= tolerance * least * most) & (part & ONE == ZERO)  # false where least = 0
            result[x] = least if one else np.float32(0.0)
        for x in range(width - 1):
            result[x] = row[x] if result[x] > 0.0 else np.float32(0.0)
    if height > 1 and width > 1:
        smooth[height - 2, width - 2] = 0.0  # the vector load of this block would read past the end of the image
    return smooth


@_inlined
def _remove_background(colour, share, background):
    """Colour of a surface that covers a share of a pixel in front of the background."""
    return np.float32(background + (colour - background) / share)


@_inlined
def _add_background(colour, share, background):
    """Composite a surface that covers a share of a pixel over the background, clipped to [0, 1]."""
    return np.float32(min(max(background + share * (colour - background), 0.0), 1.0))


@_kernel
def _sample_surface(image, inverse_depth, outline, first, shares, sa, sb, sc, tolerance, background, sx, sy):
    """Bilinear sample at (sx, sy) from the pixels that show the same surface, with renormalised weights.

    The background is removed from partly covered pixels. Returns the colour and the sum of the weights, which is 0 if
    no pixel shows the surface.
    """
    height, width = inverse_depth.shape
    x, y = max(sx - 0.5, 0.0), max(sy - 0.5, 0.0)
    x0, y0 = int(x), int(y)
    red = green = blue = total = covered = 0.0
    for j in range(2):
        row = min(y0 + j, height - 1)
        for i in range(2):
            column = min(x0 + i, width - 1)
            expected = sa * (column + 0.5) + sb * (row + 0.5) + sc
            if _same_depth(inverse_depth[row, column], expected, tolerance):
                weight = (x - x0 if i else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
                total += weight
                covered += weight * covered_share(outline, first, shares, row, column)
                red += weight * image[row, column, 0]
                green += weight * image[row, column, 1]
                blue += weight * image[row, column, 2]
    if not total > 0.0:
        return np.float32(0.0), np.float32(0.0), np.float32(0.0), 0.0
    red, green, blue, covered = red / total, green / total, blue / total, covered / total
    red = _remove_background(red, covered, background)
    green = _remove_background(green, covered, background)
    blue = _remove_background(blue, covered, background)
    return red, green, blue, total


@_inlined
def _apply_map(maps, f, px, py):
    """Source of a target pixel in the frame, and a third value that is positive in front of the camera."""
    w = maps[f, 2, 0] * px + maps[f, 2, 1] * py + maps[f, 2, 2]
    inverse = 1.0 / w
    sx = (maps[f, 0, 0] * px + maps[f, 0, 1] * py + maps[f, 0, 2]) * inverse
    sy = (maps[f, 1, 0] * px + maps[f, 1, 1] * py + maps[f, 1, 2]) * inverse
    return sx, sy, w


@_inlined
def _inside(sx, sy, w, columns, rows):
    return w > 0.0 and sx >= 0.0 and sy >= 0.0 and sx < columns and sy < rows


@_kernel
def _sample_footprint(image, inverse_depth, outline, first, shares, planes, maps, f, n, tolerance, background, x, y):
    """Mean of n x n samples over the footprint of a target pixel in the frame, and their mean weight."""
    red = green = blue = total = 0.0
    for k in range(n * n):
        sx, sy, w = _apply_map(maps, f, x + (k % n + 0.5) / n, y + (k // n + 0.5) / n)
        if _inside(sx, sy, w, image.shape[1], image.shape[0]):
            r, g, b, weight = _sample_surface(
                image, inverse_depth, outline, first, shares, planes[f, 0], planes[f, 1], planes[f, 2], tolerance,
                background, sx, sy,
            )  # fmt: skip
            red, green, blue, total = red + weight * r, green + weight * g, blue + weight * b, total + weight
    share = 1.0 / total if total > 0.0 else 0.0
    return np.float32(red * share), np.float32(green * share), np.float32(blue * share), total / (n * n)


@_kernel
def _warp_smooth_pixels(
    colour, mask_flags, rest, face_image, outline, maps, face_flags, samples, smooth, planes, image, frame_flags,
    tolerance, background,
):  # fmt: skip
    """Colours of pixels whose source shows a single surface, and the flags of all; lists the other pixels in `rest`."""
    (height, width), (rows, columns) = face_image.shape, smooth.shape
    faces, maps, planes, smooth, image = (
        face_image.reshape(-1), maps.reshape(-1), planes.reshape(-1), smooth.reshape(-1), image.reshape(-1)
    )  # fmt: skip
    colour, mask_flags, frame_flags = colour.reshape(-1), mask_flags.reshape(-1), frame_flags.reshape(-1)
    fx, fy = np.empty(width + WIDTH, np.float32), np.empty(width + WIDTH, np.float32)
    corner, pixel = np.empty(width + WIDTH, np.int32), np.empty(width + WIDTH, np.int32)
    state = np.empty(width + WIDTH, np.int32)
    left = 0
    for y in range(height):
        for x in range(0, width, WIDTH):
            locate(
                faces, y * width + x, width - x, float(x), y + 0.5, maps, planes, smooth, rows, columns, tolerance,
                fx, fy, corner, pixel, state, x,
            )  # fmt: skip
        for x in range(width):
            status, place = state[x], y * width + x
            flags, mixed = np.uint16(0), outline[y >> LOG, x] >> np.uint64(y & 63) & ONE
            if status != OFF:
                f = np.uint64(faces[place])  # unsigned, so that Numba does not wrap negative indices
                flags = face_flags[f]
                if status == BEYOND:
                    flags |= np.uint16(OUTSIDE_IMAGE)
                else:
                    flags |= frame_flags[np.uint64(pixel[x])]
                    if status == SMOOTH and not mixed and samples[f] == 1:
                        mask_flags[place] = flags
                        copy_sample(image, 3 * np.int64(corner[x]), 3 * columns, fx[x], fy[x], colour, 3 * place)
                        continue
                    rest[left] = place
                    left += 1
            mask_flags[place] = flags
            colour[3 * place] = colour[3 * place + 1] = colour[3 * place + 2] = background
    return left


@_kernel
def _sample_pixel(maps, samples, inverse_depth, outline, first, shares, planes, image, tolerance, background, f, x, y):
    """Colour and weight of a target pixel near an edge, or with a footprint of several samples."""
    if samples[f] > 1:
        return _sample_footprint(
            image, inverse_depth, outline, first, shares, planes, maps, f, samples[f], tolerance, background, x, y
        )  # fmt: skip
    sx, sy, _ = _apply_map(maps, f, x + 0.5, y + 0.5)
    return _sample_surface(
        image, inverse_depth, outline, first, shares, planes[f, 0], planes[f, 1], planes[f, 2], tolerance, background,
        sx, sy,
    )  # fmt: skip


@_kernel
def warp(
    face_image, target, maps, face_flags, samples, inverse_depth, source, planes, image, frame_flags, tolerance,
    background,
):  # fmt: skip
    """Bilinear inverse warp of a frame, with its occlusion mask.

    A target pixel is occluded if less than half of the bilinear weight falls on frame pixels that show its surface:
    their depth is within the tolerance of the plane of its triangle.

    Args:
        face_image: Face per target pixel (h, w), -1 where there is none.
        target: Coverage of the caricature (`Coverage`).
        maps: Map of each face from target pixels to frame pixels (f, 3, 3).
        face_flags: Mask flags of each face (f,).
        samples: Samples per axis of a footprint (f,).
        inverse_depth: Of the tracked mesh in the frame (rows, columns).
        source: Coverage of the tracked mesh.
        planes: Inverse depth planes of the tracked mesh (f, 3).
        image: sRGB colours of the frame (rows, columns, 3).
        frame_flags: Mask flags of each frame pixel (rows, columns).
        tolerance: Depth tolerance in metres.
        background: Grey value of the background.

    Returns:
        Colours (h, w, 3) and mask flags (h, w).
    """
    height, width = face_image.shape
    outline, first, shares = source
    target_outline, target_first, target_shares = target
    smooth = _smooth_blocks(inverse_depth, outline, np.float32(tolerance))
    colour, mask_flags = np.empty((height, width, 3), np.float32), np.empty((height, width), np.uint16)
    rest = np.empty(height * width, np.int32)
    left = _warp_smooth_pixels(
        colour, mask_flags, rest, face_image, target_outline, maps, face_flags, samples, smooth, planes, image,
        frame_flags, tolerance, np.float32(background),
    )  # fmt: skip
    for k in range(left):
        y, x = rest[k] // width, rest[k] % width
        red, green, blue, weight = _sample_pixel(
            maps, samples, inverse_depth, outline, first, shares, planes, image, tolerance, background,
            face_image[y, x], x, y,
        )  # fmt: skip
        if weight > 0.0:
            covered = covered_share(target_outline, target_first, target_shares, y, x)
            colour[y, x, 0] = _add_background(red, covered, background)
            colour[y, x, 1] = _add_background(green, covered, background)
            colour[y, x, 2] = _add_background(blue, covered, background)
        if weight < 0.5:
            mask_flags[y, x] |= np.uint16(OCCLUDED)
    return colour, mask_flags
