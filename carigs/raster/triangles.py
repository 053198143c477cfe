"""Z-buffered triangle rasteriser on the CPU (Numba): face ids, perspective-correct barycentrics, depth."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np
from jaxtyping import Float, Float32, Int, Int32

if TYPE_CHECKING:
    from carigs.capture.camera import Camera

NEAR = 0.01  # metres: triangles that reach nearer than this are dropped


class Fragments(NamedTuple):
    """What a pixel's centre ray hits first."""

    face: Int32[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none."""
    barycentric: Float32[np.ndarray, "h w 3"]
    """Perspective-correct weights of the face's corners: weights @ corners is the 3D point hit."""
    depth: Float32[np.ndarray, "h w"]
    """Depth along the optical axis in metres, inf where there is no face."""


@numba.njit(cache=True, error_model="numpy")
def _rasterize(pixel, depth, faces, height, width, cull_back):
    face_image = np.full((height, width), -1, np.int32)
    weight_image = np.zeros((height, width, 3), np.float32)
    depth_image = np.full((height, width), np.inf, np.float32)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        za, zb, zc = depth[i], depth[j], depth[k]
        if not (za > NEAR and zb > NEAR and zc > NEAR):
            continue
        ax, ay, bx, by, cx, cy = pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1]
        # Twice the signed area; y points down, so faces seen from outside (counter-clockwise) come out negative.
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0 or (cull_back and area > 0.0):
            continue
        x0 = max(int(np.ceil(max(min(ax, bx, cx), 0.0) - 0.5)), 0)
        x1 = min(int(np.floor(min(max(ax, bx, cx), float(width)) - 0.5)), width - 1)
        y0 = max(int(np.ceil(max(min(ay, by, cy), 0.0) - 0.5)), 0)
        y1 = min(int(np.floor(min(max(ay, by, cy), float(height)) - 0.5)), height - 1)
        for y in range(y0, y1 + 1):
            py = y + 0.5
            for x in range(x0, x1 + 1):
                px = x + 0.5
                # Each edge function is evaluated from the edge's lower to its higher vertex index, so that two faces
                # that share an edge see exactly opposite values: no cracks.  Ties go to both; depth decides.
                u = _edge(bx, by, cx, cy, px, py, j < k) / area
                v = _edge(cx, cy, ax, ay, px, py, k < i) / area
                w = _edge(ax, ay, bx, by, px, py, i < j) / area
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                u, v, w = u / za, v / zb, w / zc
                z = 1.0 / (u + v + w)
                if z < depth_image[y, x]:
                    face_image[y, x] = f
                    depth_image[y, x] = z
                    weight_image[y, x, 0] = u * z
                    weight_image[y, x, 1] = v * z
                    weight_image[y, x, 2] = w * z
    return face_image, weight_image, depth_image


@numba.njit(inline="always")
def _edge(ax, ay, bx, by, px, py, forward):
    if forward:
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return -((ax - bx) * (py - by) - (ay - by) * (px - bx))


def rasterize_mesh(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, *, cull_back: bool = False
) -> Fragments:
    """Render the mesh's visibility at pixel centres.

    Vertices are world points in metres.  Faces with a corner nearer than `NEAR` are dropped.  With `cull_back`, faces
    seen from behind (clockwise in the image) are dropped too.  A pixel on a shared edge belongs to exactly one of the
    faces (the nearer, then the first); neighbouring faces leave no cracks.
    """
    pixel, depth = camera.project(np.asarray(vertices, np.float64))
    return Fragments(
        *_rasterize(pixel, depth, np.ascontiguousarray(faces, np.int32), camera.height, camera.width, cull_back)
    )
