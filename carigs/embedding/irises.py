"""Places of the landmarks of the irises: the middle of the eyeball's front, and a ring around it, at rest gaze.

They are points of the eyeball's triangles, which the joint of the eye turns: landmarks of an iris tell the gaze.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.detection.mesh_indices import LEFT_IRIS, RIGHT_IRIS
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import size

RADIUS = 5.85 / 63
"""Radius of an iris in distances between the eyes: the means of adults are 5.85 mm (Rüfer et al. 2005) and 63 mm."""
DIRECTIONS = ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1))
"""Centre; right, upper, left, lower edge as an image of the face shows them: the image's right is +x."""


class IrisPoints(NamedTuple):
    """Points of triangles."""

    landmarks: Int[np.ndarray, " n"]
    faces: Int[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]


def iris_points(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    eyeballs: tuple[Bool[np.ndarray, " f"], Bool[np.ndarray, " f"]],
    eyes: Float[np.ndarray, "2 3"],
) -> IrisPoints:
    """Find the landmarks of the irises on a head whose eyes look to +z.

    Args:
        vertices: Vertices in any unit.
        faces: Triangles.
        eyeballs: Triangles of the left and of the right eyeball; a head may have none.
        eyes: Centres of the left and the right eyeball, in the unit of the vertices.

    Returns:
        Points; none where a line of sight misses the eyeball.
    """
    found = []
    radius = RADIUS * np.linalg.norm(eyes[0] - eyes[1])
    for landmarks, own, centre in zip((RIGHT_IRIS, LEFT_IRIS), eyeballs, eyes, strict=True):  # the image's right first
        if not own.any():
            continue
        ids = np.flatnonzero(own)
        unit = size(vertices, faces[ids])
        origins = np.column_stack([centre[:2] + radius * np.array(DIRECTIONS), np.full(5, centre[2] + 2 * unit)])
        hit, _, barycentric = RayCaster(vertices, faces[ids]).first_hit(origins / unit, np.tile([0.0, 0, -1], (5, 1)))
        found.append(IrisPoints(np.array(landmarks)[hit >= 0], ids[hit[hit >= 0]], barycentric[hit >= 0]))
    if not found:
        return IrisPoints(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)))
    return IrisPoints(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
