"""Ambient occlusion: how much of the hemisphere over a vertex the surface itself hides."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.surface.mesh import size, vertex_normals

RAYS = 100
CAST_SIZE = 1000.0  # the head's size while rays are cast
OFFSET = 1e-4  # of the head's size: rays start this far off the surface


def ambient_occlusion(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    rays: int = RAYS,
    at: Bool[np.ndarray, " v"] | None = None,
) -> Float[np.ndarray, " v"]:
    """Share of hidden directions, 0 on a convex surface, near 1 deep in a cavity; averaged once over neighbours.

    Only the vertices `at` are looked from (default: all); the others get 0, but hide.  All vertices use the same
    Fibonacci directions, turned to their outside, so that equal meshes give equal bytes.
    """
    import igl

    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    # The ray caster drops triangles by an absolute tolerance: in metres it would miss those of a head.
    vertices = vertices * (CAST_SIZE / size(vertices, faces))
    at = np.ones(len(vertices), bool) if at is None else at
    normals, directions = vertex_normals(vertices, faces)[at], fibonacci_sphere(rays)
    outward = np.where(normals @ directions.T < 0, -1.0, 1.0)[..., None] * directions
    origins = np.repeat(vertices[at] + OFFSET * CAST_SIZE * normals, rays, axis=0)
    tree = igl.AABB()
    tree.init(vertices, faces)
    hit, *_ = tree.intersect_ray_first(vertices, faces, origins, outward.reshape(-1, 3))
    hidden = np.zeros(len(vertices))
    hidden[at] = (hit.reshape(-1, rays) >= 0).mean(axis=1)
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    return (hidden + np.bincount(i, hidden[j], len(hidden))) / (1 + np.bincount(i, minlength=len(hidden)))


def fibonacci_sphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly spread unit vectors (Gonzalez 2010)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    angle, radius = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def smoothstep(x: Float[np.ndarray, " n"], low: float, high: float) -> Float[np.ndarray, " n"]:
    """0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
