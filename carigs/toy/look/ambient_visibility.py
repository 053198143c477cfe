"""Ambient visibility of vertices (the complement of ambient occlusion), from depth maps of many directions."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.capture.camera import Camera, look_at
from carigs.light import fibonacci_sphere
from carigs.mesh import vertex_normals
from carigs.raster import rasterize_mesh

_DIRECTIONS, _SIDE, _TOLERANCE = 72, 160, 0.0025  # directions, pixels, metres


def ambient_visibility(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float32[np.ndarray, " v"]:
    """Cosine-weighted share of the directions from which each vertex is not occluded by the mesh.

    Args:
        vertices: Positions, in metres.
        faces: Vertex indices of the triangles.

    Returns:
        Shares: 1 in the open, 0 where enclosed.
    """
    normals = vertex_normals(vertices, faces)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = 1.02 * np.linalg.norm(vertices - middle, axis=1).max()
    visible, total = np.full(len(vertices), 1e-9), np.full(len(vertices), 1e-9)
    for direction in fibonacci_sphere(_DIRECTIONS)[:, [0, 2, 1]]:  # with its axis along y
        camera = distant_camera(middle, radius, direction, _SIDE)
        depth_map = rasterize_mesh(vertices, faces, camera).depth
        pixel, depth = camera.project(vertices + 0.001 * normals)
        column, row = np.clip(pixel.astype(int), 0, _SIDE - 1).T
        cosine = np.maximum(normals @ direction, 0.0)
        visible += cosine * (depth < depth_map[row, column] + _TOLERANCE)
        total += cosine
    return (visible / total).astype(np.float32)


def distant_camera(
    middle: Float[np.ndarray, "3"], radius: float, direction: Float[np.ndarray, "3"], side: int
) -> Camera:
    """A distant camera whose square image contains a sphere; its rays are nearly parallel.

    Args:
        middle: Centre of the sphere, in metres.
        radius: Radius of the sphere, in metres.
        direction: Unit vector from the sphere to the camera.
        side: Width and height of the image, in pixels.

    Returns:
        The camera.
    """
    distance = 14.0 * radius
    focal = 0.5 * side / radius * distance * 0.997
    return Camera(look_at(middle + distance * direction, middle), focal, focal, side / 2, side / 2, side, side)
