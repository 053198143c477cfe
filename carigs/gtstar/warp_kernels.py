"""Numba kernels of the warp: the source of each caricature pixel in the frame, and its bilinear colour."""

from __future__ import annotations

from functools import partial

import numpy as np

from carigs.gtstar.warp_kernels_simd import BEYOND, OFF, SMOOTH, WIDTH, copy_sample, locate
from carigs.simd.kernels import kernel

_kernel = partial(kernel, fastmath={"contract"})

OCCLUDED, OUTSIDE_IMAGE = 2, 16
"""Bits of `MaskFlag`; kernels cannot use the enumeration."""


@_kernel
def _smooth_blocks(inverse_depth, shares, tolerance):
    """Inverse depth where the block of 2 x 2 pixels that begins at a pixel shows one surface, fully covered; else 0."""
    height, width = inverse_depth.shape
    smooth = np.zeros((height, width), np.float32)
    for y in range(height - 1):
        row, below, result = inverse_depth[y], inverse_depth[y + 1], smooth[y]
        share, share_below = shares[y], shares[y + 1]
        for x in range(width - 1):
            least = min(row[x], row[x + 1], below[x], below[x + 1])
            most = max(row[x], row[x + 1], below[x], below[x + 1])
            covered = min(share[x], share[x + 1], share_below[x], share_below[x + 1])
            one = (most - least <= tolerance * least * most) & (covered == 1.0)  # false where least = 0
            result[x] = least if one else np.float32(0.0)
        for x in range(width - 1):
            result[x] = row[x] if result[x] > 0.0 else np.float32(0.0)
    if height > 1 and width > 1:
        smooth[height - 2, width - 2] = 0.0  # the vector load of this block would read past the end of the image
    return smooth


@_kernel
def _sample_surface(sample, image, inverse_depth, shares, planes, f, tolerance, background, sx, sy):
    """Bilinear sample at (sx, sy) from the pixels that show the plane of face f, with renormalised weights.

    The background is removed from partly covered pixels. Writes the colour to `sample`, unless the sum of the weights,
    which is returned, is 0: no pixel shows the surface.
    """
    height, width = inverse_depth.shape
    x, y = max(sx - 0.5, 0.0), max(sy - 0.5, 0.0)
    x0, y0 = int(x), int(y)
    total = covered = 0.0
    sample[:] = 0.0
    for j in range(2):
        row = min(y0 + j, height - 1)
        for i in range(2):
            column = min(x0 + i, width - 1)
            near = inverse_depth[row, column]
            expected = planes[f, 0] * (column + 0.5) + planes[f, 1] * (row + 0.5) + planes[f, 2]
            if near > 0.0 and abs(near - expected) <= tolerance * near * expected:
                weight = (x - x0 if i else 1.0 - x + x0) * (y - y0 if j else 1.0 - y + y0)
                total += weight
                covered += weight * shares[row, column]
                for k in range(3):
                    sample[k] += weight * image[row, column, k]
    if total > 0.0:
        for k in range(3):
            sample[k] = np.float32(background + (sample[k] / total - background) / (covered / total))
    return total


@_kernel
def _sample_pixel(sample, image, inverse_depth, shares, planes, maps, f, tolerance, background, x, y):
    """Sample of the centre of target pixel (x, y), as `_sample_surface`; 0 also where it lies outside of the frame."""
    px, py = x + 0.5, y + 0.5
    w = maps[f, 2, 0] * px + maps[f, 2, 1] * py + maps[f, 2, 2]
    inverse = 1.0 / w
    sx = (maps[f, 0, 0] * px + maps[f, 0, 1] * py + maps[f, 0, 2]) * inverse
    sy = (maps[f, 1, 0] * px + maps[f, 1, 1] * py + maps[f, 1, 2]) * inverse
    if w > 0.0 and sx >= 0.0 and sy >= 0.0 and sx < image.shape[1] and sy < image.shape[0]:
        return _sample_surface(sample, image, inverse_depth, shares, planes, f, tolerance, background, sx, sy)
    return 0.0


@_kernel
def warp(
    face_image, target_shares, maps, face_flags, inverse_depth, shares, planes, image, frame_flags, tolerance,
    background,
):  # fmt: skip
    """Bilinear inverse warp of a frame, with its occlusion mask.

    A target pixel is occluded if less than half of the bilinear weight falls on frame pixels that show its surface:
    their depth is within the tolerance of the plane of its triangle.

    Args:
        face_image: Face per target pixel (h, w), -1 where there is none.
        target_shares: Share of each target pixel that the caricature covers (h, w).
        maps: Map of each face from target pixels to frame pixels (f, 3, 3).
        face_flags: Mask flags of each face (f,).
        inverse_depth: Of the tracked mesh in the frame (rows, columns).
        shares: Share of each frame pixel that the tracked mesh covers (rows, columns).
        planes: Inverse depth planes of the tracked mesh (f, 3).
        image: sRGB colours of the frame (rows, columns, 3).
        frame_flags: Mask flags of each frame pixel (rows, columns).
        tolerance: Depth tolerance in metres.
        background: Grey value of the background.

    Returns:
        Colours (h, w, 3) and mask flags (h, w).
    """
    (height, width), (rows, columns) = face_image.shape, inverse_depth.shape
    smooth = _smooth_blocks(inverse_depth, shares, np.float32(tolerance))
    colour, mask_flags = np.empty((height, width, 3), np.float32), np.empty((height, width), np.uint16)
    faces, flat_colour, flat_image = face_image.reshape(-1), colour.reshape(-1), image.reshape(-1)
    flat_maps, flat_planes, flat_smooth = maps.reshape(-1), planes.reshape(-1), smooth.reshape(-1)
    flat_flags = frame_flags.reshape(-1)
    fx, fy = np.empty(width + WIDTH, np.float32), np.empty(width + WIDTH, np.float32)
    corner, pixel = np.empty(width + WIDTH, np.int32), np.empty(width + WIDTH, np.int32)
    state = np.empty(width + WIDTH, np.int32)
    sample = np.empty(3)
    for y in range(height):
        for x in range(0, width, WIDTH):
            locate(
                faces, y * width + x, width - x, float(x), y + 0.5, flat_maps, flat_planes, flat_smooth, rows, columns,
                tolerance, fx, fy, corner, pixel, state, x,
            )  # fmt: skip
        for x in range(width):
            flags, weight = np.uint16(0), 0.0
            if state[x] != OFF:
                f = np.uint64(face_image[y, x])  # unsigned, so that Numba does not wrap negative indices
                flags = face_flags[f]
                if state[x] == BEYOND:
                    flags |= np.uint16(OUTSIDE_IMAGE)
                else:
                    flags |= flat_flags[np.uint64(pixel[x])]
                    if state[x] == SMOOTH and target_shares[y, x] == 1.0:
                        mask_flags[y, x] = flags
                        place = 3 * (y * width + x)
                        copy_sample(flat_image, 3 * np.int64(corner[x]), 3 * columns, fx[x], fy[x], flat_colour, place)
                        continue
                    weight = _sample_pixel(  # near an edge
                        sample, image, inverse_depth, shares, planes, maps, f, tolerance, background, x, y
                    )  # fmt: skip
                    if weight < 0.5:
                        flags |= np.uint16(OCCLUDED)
            mask_flags[y, x] = flags
            for k in range(3):
                mixed = background + target_shares[y, x] * (np.float32(sample[k]) - background)
                colour[y, x, k] = min(max(mixed, 0.0), 1.0) if weight > 0.0 else background
    return colour, mask_flags
