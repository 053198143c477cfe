"""Small meshes and cameras that the stress suites share."""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float, Int32

from carigs.capture import Camera

Mesh = tuple[Float[np.ndarray, "v 3"], Int32[np.ndarray, "f 3"]]
"""Vertices in metres and the triangles' vertex indices."""


def sheet(n: int = 9, width: float = 0.4, height: float = 0.3) -> Mesh:
    """Flat grid of triangles in the plane z = 0, whose fronts face -z, as those of `camera_at` see them.

    Args:
        n: Vertices along each side.
        width: Extent along x in metres.
        height: Extent along y in metres.

    Returns:
        The mesh.
    """
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, n), np.linspace(-height / 2, height / 2, n))
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack([np.column_stack([i, i + n + 1, i + 1]), np.column_stack([i, i + n, i + n + 1])])
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)]), faces.astype(np.int32)


def ball(subdivisions: int = 2, radius: float = 0.35) -> Mesh:
    """Closed bumpy ball around the origin.

    Args:
        subdivisions: Of the icosahedron: 20 * 4^n faces.
        radius: Mean radius in metres.

    Returns:
        The mesh.
    """
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    vertices = np.asarray(mesh.vertices) * (1 + 0.15 * np.sin(3.2 / radius * mesh.vertices[:, :1]))
    return vertices, np.asarray(mesh.faces, np.int32)


def camera_at(depth: float = 2.0, size: tuple[int, int] = (24, 20), focal: float = 40.0, **changes: float) -> Camera:
    """Camera on the z axis that looks along +z, with the origin of the world at a depth in front of it.

    Args:
        depth: Depth of the world's origin in metres.
        size: Columns and rows of the image.
        focal: Focal length in pixels.
        **changes: Other values of the intrinsics `fx`, `fy`, `cx`, `cy`.

    Returns:
        The camera.
    """
    camera_from_world = np.eye(4)
    camera_from_world[2, 3] = depth
    intrinsics = {"fx": focal, "fy": focal, "cx": size[0] / 2, "cy": size[1] / 2, **changes}
    return Camera(camera_from_world, **intrinsics, width=size[0], height=size[1])
