"""How much light from all around reaches each vertex: depth maps from many directions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.capture.camera import Camera, look_at
from carigs.raster import rasterize_mesh

_DIRECTIONS, _SIDE, _TOLERANCE = 72, 160, 0.0025  # directions, pixels, metres


def exposure(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float32[np.ndarray, "v"]:
    """Cosine-weighted share of the directions around each vertex's normal that leave the mesh: 1 open, 0 enclosed."""
    normals = vertex_normals(vertices, faces)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = 1.02 * np.linalg.norm(vertices - middle, axis=1).max()
    k = np.arange(_DIRECTIONS)  # Fibonacci's sphere
    height, turn = 1 - (2 * k + 1) / _DIRECTIONS, k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    free, total = np.full(len(vertices), 1e-9), np.full(len(vertices), 1e-9)
    for direction in np.stack([ring * np.cos(turn), height, ring * np.sin(turn)], axis=1):
        camera = distant_camera(middle, radius, direction, _SIDE)
        depth = rasterize_mesh(vertices, faces, camera).depth
        pixel, own = camera.project(vertices + 0.001 * normals)
        column, row = np.clip(pixel.astype(int), 0, _SIDE - 1).T
        cosine = np.maximum(normals @ direction, 0.0)
        free += cosine * (own < depth[row, column] + _TOLERANCE)
        total += cosine
    return (free / total).astype(np.float32)


def distant_camera(
    middle: Float[np.ndarray, "3"], radius: float, direction: Float[np.ndarray, "3"], side: int
) -> Camera:
    """A camera far away along `direction` whose square image holds a ball; nearly parallel rays, like a lamp's."""
    distance = 14.0 * radius
    focal = 0.5 * side / radius * distance * 0.997
    return Camera(look_at(middle + distance * direction, middle), focal, focal, side / 2, side / 2, side, side)


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    """Area-weighted unit normals."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    face_normals = np.cross(b - a, c - a)
    corner, n = faces.T.reshape(-1), len(vertices)
    normals = np.stack([np.bincount(corner, np.tile(face_normals[:, axis], 3), n) for axis in range(3)], axis=1)
    return normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30)
