"""How far the avatar moves when its level rises, against how far its mesh moves: 1 is exact, 0 an avatar at rest."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Float, Float64, Int

NEAR = 0.01
"""Metres between a surfel and the natural mesh up to which it must move with the mesh; hair stands farther off."""


@dataclass(frozen=True)
class SurfaceAnchors:
    """The points of a mesh nearest to surfels."""

    surfels: Int[np.ndarray, " n"]
    """Surfels within `NEAR` of the mesh; the other fields belong to them."""
    face: Int[np.ndarray, " n"]
    corners: Int[np.ndarray, "n 3"]
    """Vertices of the face."""
    barycentric: Float64[np.ndarray, "n 3"]

    def displacements(self, vertex_displacements: Float[np.ndarray, "v 3"]) -> Float64[np.ndarray, "n 3"]:
        """Displacement of the mesh at the anchors.

        Args:
            vertex_displacements: Of the vertices, in metres.

        Returns:
            Interpolated displacements in metres.
        """
        return np.einsum("nc,nck->nk", self.barycentric, vertex_displacements[self.corners])


def find_anchors(
    centres: Float[np.ndarray, "s 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> SurfaceAnchors:
    """Find the nearest point of a mesh to each surfel, whatever triangle the surfel is bound to.

    Args:
        centres: Surfels in world coordinates, in metres.
        vertices: The mesh of the same timestep and level.
        faces: Its triangles.

    Returns:
        Nearest points of the surfels that are `NEAR`.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    squared, face, points = igl.point_mesh_squared_distance(np.asarray(centres, np.float64), vertices, faces)
    surfels = np.flatnonzero(squared < NEAR**2)
    face = face[surfels].astype(np.int64)
    corners = faces[face]
    a, b, c = (np.ascontiguousarray(vertices[corners[:, k]]) for k in range(3))
    barycentric = igl.barycentric_coordinates(np.ascontiguousarray(points[surfels]), a, b, c)
    return SurfaceAnchors(surfels, face, corners, barycentric)


def exaggeration_gain(
    measured: Float[np.ndarray, "n 3"],
    intended: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"],
) -> float:
    """Least-squares factor between measured and intended displacements.

        gain = sum_i w_i <m_i, d_i> / sum_i w_i |d_i|^2

    Points whose intended displacement is large count most; those that are not to move have no weight.

    Args:
        measured: Displacements of the avatar between two levels, in metres.
        intended: Displacements of the mesh at the same points, in metres.
        weights: Weights of the points, such as area times opacity.

    Returns:
        The gain; nan if no point is to move.
    """
    squares = float(weights @ np.einsum("nk,nk->n", intended, intended))
    return float(weights @ np.einsum("nk,nk->n", measured, intended)) / squares if squares > 0 else float("nan")
