"""Pixels near the outline of the mesh, whose gradients count for more.

Few pixels of an image show the outline of the head, and they decide how its shape looks. GT* frames alone show the
outline of a caricature, and the training takes them seldom. So the trainer multiplies the gradients of these pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from carigs.capture import Camera
from carigs.raster import Visibility, compute_visibility
from carigs.splat.rig.head_sequence import HeadSequence

NEAR = 0.004
"""Distance from the outline in metres: about as far as the tracking, and the warp of GT* frames, misplace it."""


class Outlines:
    """Factors on the gradient of each pixel, for the meshes of a head.

    The outline of each view is found once, when the training first takes it. Refinement of the tracking, which moves
    the mesh later, does not change it.

    Args:
        sequence: Posed meshes per timestep and level.
        weight: Factor on pixels near the outline in real frames; its square in GT* frames.
    """

    def __init__(self, sequence: HeadSequence, weight: float) -> None:
        self._sequence, self._weight = sequence, weight
        self._near: dict[tuple[int, int, float], np.ndarray] = {}

    def emphasis(self, timestep: int, number: int, camera: Camera, level: float) -> Float32[np.ndarray, "h w"]:
        """Find the factors of a view.

        Args:
            timestep: Timestep of the capture.
            number: Number of the camera.
            camera: The camera.
            level: Exaggeration of the mesh: 0 for a real frame.

        Returns:
            Factor on the gradient of each pixel; 1 away from the outline.
        """
        key = timestep, number, level
        if key not in self._near:
            seen = compute_visibility(self._sequence.posed(timestep, level), self._sequence.rig.faces, camera)
            self._near[key] = np.packbits(near_outline(seen))  # a bit for each pixel: captures have thousands of views
        size = camera.height * camera.width
        near = np.unpackbits(self._near[key], count=size).reshape(camera.height, camera.width)
        return np.where(near, np.float32(self._weight if level == 0 else self._weight**2), np.float32(1))


def near_outline(seen: Visibility, distance: float = NEAR) -> Bool[np.ndarray, "h w"]:
    """Find the pixels near the outline of a mesh, on either side of it.

    Args:
        seen: What a camera sees of the mesh.
        distance: Distance in metres, at the depth of the mesh; at least one pixel counts as near.

    Returns:
        Whether each pixel is near.
    """
    on_mesh = np.array(seen.face >= 0, np.uint8)
    pixels = max(distance / seen.pixel_size, 1.0)
    # Distances to the nearest pixel on the other side; far away from any where there is none.
    to_other = [cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_5) for side in (on_mesh, 1 - on_mesh)]
    return np.where(on_mesh, to_other[0], to_other[1]) <= pixels + 1e-3
