"""Voxels of the hair that a view shows: neither denser hair nor the head hides them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from carigs.hair.hull import Voxels
from carigs.hair.views import HairView, scalp_motion

DENSE = 0.5
"""Opacity from which on a voxel hides those behind it."""
VISIBLE_DEPTH = 2.0
"""Depth behind the first dense voxel up to which hair counts as visible, in voxels."""


class VisibleVoxels(NamedTuple):
    """Voxels, and the pixels that show their centres."""

    voxel: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    row: Int[np.ndarray, " n"]


def visible_voxels(volume: Voxels, view: HairView, transform: Float[np.ndarray, "3 4"]) -> VisibleVoxels:
    """Find the voxels that a view shows.

    Args:
        volume: The hair.
        view: A frame.
        transform: Camera axes from the axes of the canonical head, of the scalp (`scalp_motion`).

    Returns:
        The voxels.
    """
    camera = view.visibility.camera
    x, y, z = (volume.centres.astype(np.float64) @ transform[:, :3].T + transform[:, 3]).T
    step = max(volume.size / view.visibility.pixel_size, 1.0)  # pixels of a voxel
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    inside = (z > 0) & (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    column, row = np.where(inside, u, 0).astype(int), np.where(inside, v, 0).astype(int)
    front = inside & ((z + volume.size) * view.visibility.inverse_depth[row, column] <= 1)
    i, j = (np.where(inside, w, 0) / step for w in (u, v))
    width = int(camera.width / step) + 1
    cell = j.astype(int) * width + i.astype(int)
    nearest = np.full((int(camera.height / step) + 1) * width, np.inf)
    dense = front & (volume.opacity >= DENSE)
    np.minimum.at(nearest, cell[dense], z[dense])
    shown = np.flatnonzero(front & (z <= nearest[cell] + VISIBLE_DEPTH * volume.size))
    return VisibleVoxels(shown, column[shown], row[shown])


def visible_shares(
    volume: Voxels, views: Sequence[HairView], canonical: Float[np.ndarray, "v 3"], carrier: Int[np.ndarray, " c"]
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
        seen[visible_voxels(volume, view, scalp_motion(canonical, view.visibility, carrier)).voxel] += 1
    return seen / max(len(views), 1)
