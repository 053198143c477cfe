"""Numba kernels of perspective projection: image positions, depths of face planes and barycentric coordinates."""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel


@kernel
def project_points(points, rotation, translation, fx, fy, cx, cy):
    """Transform points to camera axes and project them.

    Args:
        points: World points (n, 3) in metres.
        rotation: Of camera_from_world (3, 3).
        translation: Of camera_from_world (3,), in metres.
        fx: Focal length along x, in pixels.
        fy: Focal length along y, in pixels.
        cx: Principal point, x.
        cy: Principal point, y.

    Returns:
        Points in camera axes (n, 3) and their image positions (n, 2).
    """
    n = points.shape[0]
    seen, pixels = np.empty((n, 3)), np.empty((n, 2))
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(3):
            seen[i, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z + translation[k]
        pixels[i, 0] = fx * seen[i, 0] / seen[i, 2] + cx
        pixels[i, 1] = fy * seen[i, 1] / seen[i, 2] + cy
    return seen, pixels


@kernel
def inverse_depth_planes(points, faces, fx, fy, cx, cy):
    """Inverse depth of each face's plane as an affine function of the image position.

    The ray with direction d meets the plane n.(x - a) = 0 at the depth n.a / n.d.

    Args:
        points: Vertices (v, 3) in camera axes.
        faces: Vertex indices (f, 3).
        fx: Focal length along x, in pixels.
        fy: Focal length along y, in pixels.
        cx: Principal point, x.
        cy: Principal point, y.

    Returns:
        Coefficients (f, 3) of x, y and 1, all zero for faces points edge-on; and whether each face shows its back (f,).
    """
    planes, back = np.zeros((faces.shape[0], 3)), np.zeros(faces.shape[0], np.bool_)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
        cx_, cy_, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
        nx, ny, nz = by * cz - bz * cy_, bz * cx_ - bx * cz, bx * cy_ - by * cx_
        distance = nx * ax + ny * ay + nz * az
        back[f] = distance > 0.0
        if distance != 0.0:
            nx, ny, nz = nx / distance / fx, ny / distance / fy, nz / distance
            planes[f, 0], planes[f, 1], planes[f, 2] = nx, ny, nz - nx * cx - ny * cy
    return planes, back


@kernel
def barycentrics(points, faces, planes, face_image, fx, fy, cx, cy):
    """Perspective-correct barycentric coordinates and depth at every pixel centre.

    The point z d on the ray d equals w_a a + w_b b + w_c c. By Cramer's rule, w_a is proportional to d.(b x c), and
    the other weights follow cyclically.

    Args:
        points: Vertices (v, 3) in camera axes, in metres.
        faces: Vertex indices (f, 3).
        planes: Inverse depth planes (f, 3).
        face_image: Nearest faces (h, w), -1 where there is none.
        fx: Focal length along x, in pixels.
        fy: Focal length along y, in pixels.
        cx: Principal point, x.
        cy: Principal point, y.

    Returns:
        Weights (h, w, 3), 0 where there is no face, and depths (h, w) in metres, inf where there is no face.
    """
    height, width = face_image.shape
    weights, depth = np.zeros((height, width, 3), np.float32), np.full((height, width), np.inf, np.float32)
    rows = np.zeros((3, 3))
    last = -1
    for y in range(height):
        for x in range(width):
            f = face_image[y, x]
            if f < 0:
                continue
            if f != last:
                last = f
                for k in range(3):
                    b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
                    rows[k, 0] = (points[b, 1] * points[c, 2] - points[b, 2] * points[c, 1]) / fx
                    rows[k, 1] = (points[b, 2] * points[c, 0] - points[b, 0] * points[c, 2]) / fy
                    rows[k, 2] = points[b, 0] * points[c, 1] - points[b, 1] * points[c, 0]
            dx, dy = x + 0.5 - cx, y + 0.5 - cy
            u = rows[0, 0] * dx + rows[0, 1] * dy + rows[0, 2]
            v = rows[1, 0] * dx + rows[1, 1] * dy + rows[1, 2]
            w = rows[2, 0] * dx + rows[2, 1] * dy + rows[2, 2]
            total = u + v + w
            weights[y, x, 0], weights[y, x, 1], weights[y, x, 2] = u / total, v / total, w / total
            depth[y, x] = 1.0 / (planes[f, 0] * (x + 0.5) + planes[f, 1] * (y + 0.5) + planes[f, 2])
    return weights, depth
