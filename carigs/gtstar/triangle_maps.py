"""Numba kernels: per triangle, the map from caricature pixels to frame pixels, and its mask flags."""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel

NEWLY_VISIBLE, GRAZING, STRETCHED = 1, 4, 8
"""Bits of `MaskFlag`; kernels cannot use the enumeration."""
"""Per axis."""
GRAZING_GAIN = 1.25
"""A triangle is grazing only if its cosine grows by more than this factor; otherwise the warp loses no detail."""


@kernel
def perspective_maps(source, target, faces, source_intrinsics, target_intrinsics):
    """Per triangle, the homography from caricature pixels to frame pixels that preserves the 3D point.

    Let the columns of T and S be the corners of the triangle in camera axes, in the caricature and in the frame. A ray
    d meets the caricature's triangle at z d = T w with barycentric weights w, and the same point lies at S w = z S T^-1
    d in the frame. The rows of T^-1 are cross products of the columns of T over its determinant.

    Args:
        source: Vertices of the tracked mesh (v, 3) in camera axes.
        target: Vertices of the caricature (v, 3) in camera axes.
        faces: Vertex indices (f, 3).
        source_intrinsics: fx, fy, cx, cy of the frame.
        target_intrinsics: fx, fy, cx, cy of the target.

    Returns:
        Homographies (f, 3, 3) of homogeneous pixel coordinates.
    """
    sfx, sfy, scx, scy = source_intrinsics
    tfx, tfy, tcx, tcy = target_intrinsics
    per_tfx, per_tfy = 1.0 / tfx, 1.0 / tfy
    maps, inverse, point = np.empty((faces.shape[0], 3, 3)), np.empty((3, 3)), np.empty(3)
    for f in range(faces.shape[0]):
        for k in range(3):
            b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            for m in range(3):
                n, o = (m + 1) % 3, (m + 2) % 3
                inverse[k, m] = target[b, n] * target[c, o] - target[b, o] * target[c, n]
        a = faces[f, 0]
        determinant = target[a, 0] * inverse[0, 0] + target[a, 1] * inverse[0, 1] + target[a, 2] * inverse[0, 2]
        whole = 1.0 / determinant
        for m in range(3):  # columns of S T^-1 K_target^-1, after K_source
            for n in range(3):
                point[n] = 0.0
                for k in range(3):
                    point[n] += source[faces[f, k], n] * inverse[k, m]
                point[n] *= whole
            maps[f, 0, m] = sfx * point[0] + scx * point[2]
            maps[f, 1, m] = sfy * point[1] + scy * point[2]
            maps[f, 2, m] = point[2]
        for n in range(3):
            maps[f, n, 0] *= per_tfx
            maps[f, n, 1] *= per_tfy
            maps[f, n, 2] -= maps[f, n, 0] * tcx + maps[f, n, 1] * tcy
    return maps


@kernel
def affine_maps(source, target, faces):
    """Per triangle, the affine map from caricature pixels to frame pixels: local affine transformation, inverse warp.

    Equation 5 of the paper: with the projections x_i of a triangle's corners in the frame and y_i in the caricature,
    Phi(x) = A x + b is the unique affine map with Phi(x_i) = y_i. The warp needs its inverse, which is the affine map
    that takes y_i to x_i and is computed here directly. It is undefined for triangles of zero area.

    Args:
        source: Image positions of the tracked mesh's vertices (v, 2), the x_i.
        target: Image positions of the caricature's vertices (v, 2), the y_i.
        faces: Vertex indices (f, 3).

    Returns:
        Maps (f, 3, 3) of homogeneous pixel coordinates; the last row is (0, 0, 1).
    """
    maps = np.zeros((faces.shape[0], 3, 3))
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy = target[b, 0] - target[a, 0], target[b, 1] - target[a, 1]
        vx, vy = target[c, 0] - target[a, 0], target[c, 1] - target[a, 1]
        area = ux * vy - uy * vx
        for k in range(2):
            p, q = source[b, k] - source[a, k], source[c, k] - source[a, k]
            maps[f, k, 0], maps[f, k, 1] = (p * vy - q * uy) / area, (q * ux - p * vx) / area
            maps[f, k, 2] = source[a, k] - maps[f, k, 0] * target[a, 0] - maps[f, k, 1] * target[a, 1]
        maps[f, 2, 2] = 1.0
    return maps


@kernel
def _cosine(points, a, b, c):
    """Absolute cosine between the normal of a triangle and the view; nan for a triangle of zero area."""
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
    vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return abs(nx * x + ny * y + nz * z) / np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))


@kernel
def flag_triangles(
    face_flags, source, target, source_pixel, target_pixel, faces, source_back, target_back, grazing, stretch
):
    """Mask flags of every triangle in one view: the visibility mask (newly visible triangles), grazing and stretched.

    The visibility mask of the paper's appendix marks triangles that are visible in the caricature and turn away from
    the camera in the frame; here also the converse, since the frame then shows the inside of the mesh. Points that
    other triangles hide are flagged per pixel (`warp_kernels.warp`).

    Args:
        face_flags: Flags that hold in every frame (f,).
        source: Vertices of the tracked mesh (v, 3) in camera axes.
        target: Vertices of the caricature (v, 3) in camera axes.
        source_pixel: Image positions of the tracked mesh's vertices (v, 2).
        target_pixel: Image positions of the caricature's vertices (v, 2).
        faces: Vertex indices (f, 3).
        source_back: Whether each face shows its back in the frame (f,).
        target_back: Whether each face shows its back in the caricature (f,).
        grazing: Least cosine between normal and view in the frame, unless the target view is about as oblique.
        stretch: Largest ratio of a triangle's area in the target to its area in the frame.

    Returns:
        Flags (f,).
    """
    flags = face_flags.copy()
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if source_back[f] != target_back[f]:
            flags[f] |= np.uint16(NEWLY_VISIBLE)
        cosine = _cosine(source, a, b, c)
        if cosine < grazing and GRAZING_GAIN * cosine < _cosine(target, a, b, c):
            flags[f] |= np.uint16(GRAZING)
        px, py = source_pixel[b, 0] - source_pixel[a, 0], source_pixel[b, 1] - source_pixel[a, 1]
        qx, qy = source_pixel[c, 0] - source_pixel[a, 0], source_pixel[c, 1] - source_pixel[a, 1]
        sx, sy = target_pixel[b, 0] - target_pixel[a, 0], target_pixel[b, 1] - target_pixel[a, 1]
        tx, ty = target_pixel[c, 0] - target_pixel[a, 0], target_pixel[c, 1] - target_pixel[a, 1]
        before, after = abs(px * qy - py * qx), abs(sx * ty - sy * tx)
        if after > stretch * before:
            flags[f] |= np.uint16(STRETCHED)
    return flags
