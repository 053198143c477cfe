"""The part of an image that shows some regions of the head, such as hair or lips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from carigs.capture import Camera
from carigs.head import HeadModel
from carigs.raster import compute_visibility

PROPORTIONS = 4 / 3
"""Width of the part divided by its height."""
BORDER = 0.15
"""What is shown around the regions, as a share of their extent: hair sticks out of the mesh."""


def region_window(
    model: HeadModel, vertices: Float[np.ndarray, "v 3"], camera: Camera, regions: Sequence[str]
) -> tuple[slice, slice] | None:
    """Find the part of an image that shows some regions.

    Args:
        model: Head model.
        vertices: Posed vertices in world coordinates, in metres.
        camera: View.
        regions: Regions of the head model.

    Returns:
        Rows and columns, of the same proportions for every view; None if they are not in view.
    """
    face = compute_visibility(vertices, model.faces, camera).face
    rows, columns = np.nonzero((face >= 0) & model.face_region(*regions)[face])
    if not len(rows):
        return None
    centre = np.array([rows.min() + rows.max(), columns.min() + columns.max()]) / 2
    height = (1 + 2 * BORDER) * max(np.ptp(rows), np.ptp(columns) / PROPORTIONS)
    height = min(height, camera.height, camera.width / PROPORTIONS)
    size = np.array([max(height, 1.0), max(height * PROPORTIONS, 1.0)])  # a pixel at least
    start = np.clip(centre - size / 2, 0, np.array([camera.height, camera.width]) - size)
    (top, left), (bottom, right) = (np.rint(ends).astype(int).tolist() for ends in (start, start + size))
    return slice(top, bottom), slice(left, right)
