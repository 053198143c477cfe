"""Ambient occlusion: how much of the hemisphere over a vertex the surface itself hides."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, Int

from carigs.surface.mesh import vertex_normals


def ambient_occlusion(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], rays: int = 100
) -> Float[np.ndarray, " v"]:
    """Share of hidden directions, 0 on a convex surface, near 1 deep in a cavity; averaged once over neighbours."""
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    hidden = np.asarray(igl.ambient_occlusion(vertices, faces, vertices, vertex_normals(vertices, faces), rays)).ravel()
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    return (hidden + np.bincount(i, hidden[j], len(hidden))) / (1 + np.bincount(i, minlength=len(hidden)))


def smoothstep(x: Float[np.ndarray, " n"], low: float, high: float) -> Float[np.ndarray, " n"]:
    """0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
