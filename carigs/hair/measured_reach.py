"""How far hair can reach from the head, where views measure it and where none does.

A visual hull bounds hair from above where a view shows its outline: where the view looks along the surface of the head.
In front of a surface that all views look at from the front, the hull goes on towards the cameras, and behind an outline
it goes on away from them. Hair is as thick there as where it is measured, interpolated over the head.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.hair.harmonic_faces import faces_beside, harmonic_faces
from carigs.raster import Visibility

GRAZING = 0.34
"""Largest cosine between the direction from the head to a point and that to a camera which measures how far hair
reaches there: the hull of a ball is larger by 6 % of its radius at most."""
SLACK = 1.25
"""Reach that is allowed where it is interpolated, over the interpolated one."""
SHORT = 0.02
"""Metres up to which hair is never cut: where few views see outlines, short hair is hardly measured."""
USUAL = 0.95
"""Share of the measured points that are nearer to the head than hair may reach that no view measures, before few
cameras."""
RINGS = 3
"""Rings of triangles that a reach is taken from, because a voxel has only one nearest triangle."""


def within_measured_reach(
    points: Float[np.ndarray, "n 3"],
    closest: Float[np.ndarray, "n 3"],
    nearest: Int[np.ndarray, " n"],
    size: float,
    views: Sequence[tuple[Float[np.ndarray, "3 4"], Visibility]],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
) -> Bool[np.ndarray, " n"]:
    """Which points of a visual hull are as near to the head as views can tell.

    Args:
        points: Centres of the hull's voxels in the axes of the head, in metres.
        closest: The point of the head that is nearest to each.
        nearest: The triangle on which that point lies.
        size: Edge of a voxel.
        views: Camera axes from the axes of the head, and what the camera sees of the head.
        vertices: Vertices of the head.
        faces: Vertex indices of its triangles.

    Returns:
        True for points whose distance from the head a view measures, and for those that are not farther from it than
        the hair around, or than `SHORT`.
    """
    distance = np.linalg.norm(points - closest, axis=1)
    away = (points - closest) / np.maximum(distance, 1e-9)[:, None]
    measured = looked_across(points, away, views)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    known = looked_across(corners.mean(axis=1) + size * normal, normal, views)
    reach = np.zeros(len(faces))
    np.maximum.at(reach, nearest[measured], distance[measured])
    beside = faces_beside(faces)
    for _ in range(RINGS):
        reach = np.maximum(reach, beside.multiply(reach[None]).max(axis=1).toarray().ravel())
    reach = harmonic_faces(reach, known, beside)
    if measured.any() and len({tuple(seen.camera.centre.round(2)) for _, seen in views}) < ENOUGH_CAMERAS:
        # The hull of few views is open: it also has points before a shirt, which views across it measure.
        reach = np.minimum(reach, np.quantile(distance[measured], USUAL))
    return measured | (distance <= np.maximum(SLACK * reach[nearest] + size, SHORT))


def looked_across(
    points: Float[np.ndarray, "n 3"],
    away: Float[np.ndarray, "n 3"],
    views: Sequence[tuple[Float[np.ndarray, "3 4"], Visibility]],
) -> Bool[np.ndarray, " n"]:
    """Find the points whose distance from the head a view shows.

    Args:
        points: Points in the axes of the head, in metres.
        away: Directions from the head to them.
        views: Camera axes from the axes of the head, and what the camera sees of the head.

    Returns:
        True for those that a view shows, in front of the head, and looks at across that direction.
    """
    found = np.zeros(len(points), bool)
    for transform, seen in views:
        camera = seen.camera
        placed = points @ transform[:, :3].T + transform[:, 3]
        cosine = np.einsum("nc,nc->n", placed, away @ transform[:, :3].T) / np.linalg.norm(placed, axis=1)
        depth = placed[:, 2]
        column, row = (
            camera.intrinsics[:2] * placed[:, :2] / np.maximum(depth, 1e-9)[:, None] + camera.intrinsics[2:]
        ).T
        shown = (np.abs(cosine) <= GRAZING) & (depth > 0)
        shown &= (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        some = np.flatnonzero(shown)
        found[some] |= depth[some] * seen.inverse_depth[row[some].astype(int), column[some].astype(int)] <= 1
    return found
