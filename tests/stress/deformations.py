"""Deformations of a mesh, and the deformation gradients of its triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Float64, Int

SINGLE = 2e-6
"""Tolerance of what is stored in float32, relative to its size."""
DEFORMATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as it is": lambda v: v,
    "mirrored": lambda v: v * [-1, 1, 1],
    "inverted": lambda v: -v,
    "stretched a thousand times": lambda v: v * [1e3, 1, 1],
    "nearly flat": lambda v: v * [1, 1, 1e-3],
    "sheared": lambda v: v @ np.array([[1, 0, 0], [5, 1, 0], [0, -3, 1]]),
    "turned by pi": lambda v: v * [-1, -1, 1],
    "with noise": lambda v: v + 0.05 * np.abs(v).max() * np.random.default_rng(4).normal(size=v.shape),
    "tiny": lambda v: 1e-6 * v,
    "huge": lambda v: 1e6 * v,
}


def deformation_gradients(
    canonical: Float[np.ndarray, "v 3"], posed: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float64[np.ndarray, "f 3 3"]:
    """Jacobians from the edges and the normals (Sumner and Popovic 2004).

    Args:
        canonical: Vertices.
        posed: Vertices after the motion.
        faces: Vertex indices of the triangles.

    Returns:
        J with J e = e' for the edges, and for the normals n of length sqrt(2 area).
    """

    def frames(vertices: np.ndarray) -> np.ndarray:
        edges = (vertices[faces][:, 1:] - vertices[faces][:, :1]).transpose(0, 2, 1)
        normal = np.cross(edges[:, :, 0], edges[:, :, 1])
        return np.concatenate([edges, (normal / np.linalg.norm(normal, axis=1)[:, None] ** 0.5)[:, :, None]], axis=2)

    return frames(posed) @ np.linalg.inv(frames(canonical))
