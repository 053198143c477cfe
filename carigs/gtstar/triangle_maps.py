"""The kernels of a warp's triangles (Numba): their maps from caricature to frame, and what speaks against them."""

from __future__ import annotations

import numba
import numpy as np

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)

NEWLY_VISIBLE, GRAZING, STRETCHED = 1, 4, 8  # as in `Reason`
MOST_SAMPLES = 4  # per axis of a footprint
CLEARLY = 1.25  # times the cosine: what was seen as obliquely, to this factor, lost nothing on its way


@kernel
def perspective_maps(source, target, faces, source_lens, target_lens):
    """Per face the homography of target pixels to frame pixels that keeps the 3D point (f, 3, 3).

    With corners in camera axes as columns of S and T, a ray d meets the face at z d = T w, so S w = z S T^-1 d.  Rows
    of T^-1 are cross products of its columns, up to the determinant, which drops out.
    """
    sfx, sfy, scx, scy = source_lens
    tfx, tfy, tcx, tcy = target_lens
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
def _cosine(points, a, b, c):
    """Between the normal of a triangle in camera axes and the view; nan without an area."""
    x, y, z = points[a, 0], points[a, 1], points[a, 2]
    ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
    vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return abs(nx * x + ny * y + nz * z) / np.sqrt((nx * nx + ny * ny + nz * nz) * (x * x + y * y + z * z))


@kernel
def flag_triangles(
    of_faces, source, target, source_pixel, target_pixel, faces, source_back, target_back, grazing, stretch
):
    """Add to each face's reasons what this view makes of it; also the samples per axis that its footprint takes.

    `grazing` is the least cosine between the view and the normal in the frame, where the target does not see the face
    just as obliquely; `stretch` is the largest ratio of areas.
    """
    reasons, samples = of_faces.copy(), np.ones(faces.shape[0], np.uint8)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if source_back[f] != target_back[f]:
            reasons[f] |= np.uint16(NEWLY_VISIBLE)
        cosine = _cosine(source, a, b, c)
        if cosine < grazing and CLEARLY * cosine < _cosine(target, a, b, c):
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
