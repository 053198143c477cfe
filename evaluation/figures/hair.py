"""The part of an image that shows the hair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from carigs.capture import Camera
from carigs.head import HeadModel

BORDER = 0.25
"""What is shown around the mesh of the hair, as a share of its height: hair sticks out of the mesh."""


def hair_window(
    model: HeadModel, vertices: Float[np.ndarray, "v 3"], camera: Camera, regions: Sequence[str]
) -> tuple[slice, slice] | None:
    """Find the part of an image that shows the hair.

    Args:
        model: Head model.
        vertices: Posed vertices in world coordinates, in metres.
        camera: View.
        regions: Regions of the head model with hair.

    Returns:
        Rows and columns, of the proportions of the image; None without such regions.
    """
    known = [name for name in regions if name in model.regions]
    if not known:
        return None
    pixels, _ = camera.project(vertices[np.unique(np.concatenate([model.regions[name] for name in known]))])
    low, high, size = pixels.min(axis=0), pixels.max(axis=0), np.array([camera.width, camera.height])
    border = BORDER * (high[1] - low[1])
    extent = min(1.0, float(((high - low + 2 * border) / size).max())) * size
    start = np.clip((low + high - extent) / 2, 0, size - extent)
    (left, top), (right, bottom) = np.rint(start).astype(int), np.rint(start + extent).astype(int)
    return slice(int(top), int(bottom)), slice(int(left), int(right))
