"""Points of the visible part of the hair, and the triangles of the scalp that carry them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.hair.views import View, pixel_size, scalp_motion
from carigs.hair.volume import HairVolume

DENSE = 0.5
"""Opacity from which on a voxel hides those behind it."""
VISIBLE_DEPTH = 2.0
"""Depth behind the first dense voxel up to which hair counts as visible, in voxels."""


class HairPoints(NamedTuple):
    """Points inside the hair."""

    face: Int[np.ndarray, " n"]
    """Triangle of the scalp that carries each point: the nearest."""
    position: Float[np.ndarray, "n 3"]
    """In metres, in the axes of the canonical head."""
    spacing: Float[np.ndarray, " n"]
    """Distance to neighbouring points in metres."""


def visible_shares(
    volume: HairVolume, views: Sequence[View], canonical: Float[np.ndarray, "v 3"], carrier: Int[np.ndarray, " c"]
) -> Float[np.ndarray, " n"]:
    """Share of the views in which each voxel is not hidden by denser hair or the head.

    Args:
        volume: The hair.
        views: Frames.
        canonical: Vertices of the neutral head in metres.
        carrier: Vertices of the scalp.

    Returns:
        Shares in [0, 1].
    """
    seen = np.zeros(len(volume.centres))
    for view in views if len(seen) else ():
        camera, transform = view.visibility.camera, scalp_motion(canonical, view.visibility, carrier)
        x, y, z = (volume.centres.astype(np.float64) @ transform[:, :3].T + transform[:, 3]).T
        step = max(volume.size / pixel_size(view.visibility), 1.0)  # pixels of a voxel
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside = (z > 0) & (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
        column, row = np.where(inside, u, 0).astype(int), np.where(inside, v, 0).astype(int)
        front = (z + volume.size) * view.visibility.inverse_depth[row, column] <= 1
        i, j = (np.where(inside, w, 0) / step for w in (u, v))
        width = int(camera.width / step) + 1
        cell = j.astype(int) * width + i.astype(int)
        nearest = np.full((int(camera.height / step) + 1) * width, np.inf)
        dense = inside & front & (volume.opacity >= DENSE)
        np.minimum.at(nearest, cell[dense], z[dense])
        seen += inside & front & (z <= nearest[cell] + VISIBLE_DEPTH * volume.size)
    return seen / max(len(views), 1)


def place_in_hair(
    volume: HairVolume,
    visible: Float[np.ndarray, " n"],
    scalp: Bool[np.ndarray, " f"],
    canonical: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    count: int,
    rng: np.random.Generator,
) -> HairPoints:
    """Draw points of the hair, more where it is dense and more views see it.

    Args:
        volume: The hair.
        visible: Share of the views that see each voxel.
        scalp: Triangles that carry hair.
        canonical: Vertices of the neutral head in metres.
        faces: Vertex indices of the triangles.
        count: Number of points.
        rng: Draws them.

    Returns:
        The points.
    """
    weight = volume.opacity * np.sqrt(visible)
    weight = weight / weight.sum()
    # Systematic sampling: the number of points in a voxel differs from its expectation by less than 1.
    chosen = np.searchsorted(np.cumsum(weight), (np.arange(count) + rng.random()) / count)
    chosen = np.minimum(chosen, len(weight) - 1)
    position = volume.centres[chosen] + volume.size * (rng.random((count, 3)) - 0.5)
    spacing = volume.size / np.cbrt(np.maximum(count * weight[chosen], 1e-6))
    carrying = np.flatnonzero(scalp)
    _, nearest, _ = igl.point_mesh_squared_distance(
        np.asarray(position, np.float64), np.asarray(canonical, np.float64), np.asarray(faces[carrying], np.int64)
    )
    return HairPoints(carrying[nearest], position, spacing)
