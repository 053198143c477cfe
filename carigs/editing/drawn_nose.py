"""An editor without networks: it enlarges the nose in the image, in each view on its own.

Its inconsistency between views is planted: the enlarged nose of every view lies `drift` pixels off, each in another
direction. Metrics of agreement between views can be tested by it, and the loop of edits without weights.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32

from carigs.editing.view import ViewToEdit
from carigs.head import HeadModel
from carigs.raster import compute_visibility

GROWTH = 1.5
"""Magnification at the middle of the nose; it falls to 1 at the edge of the circle that is changed."""
REACH = 1.0
"""Radius of this circle, over the larger side of the nose's rectangle in the image."""


class DrawnNose:
    """Enlarges noses.

    Args:
        model: Head model with a region `nose`.
        drift: How far the enlarged nose of each view is moved, in pixels.
        seed: Seed of the directions.
    """

    def __init__(self, model: HeadModel, drift: float = 0.0, seed: int = 0) -> None:
        self.model, self.drift, self.seed = model, drift, seed
        self._nose = model.face_region("nose")

    def __call__(self, view: ViewToEdit) -> Float32[np.ndarray, "h w 3"]:
        """Edit a view.

        Args:
            view: The view. What is rendered does not count: the edit of a view is always the same.

        Returns:
            The captured image with a larger nose; as it is where no nose is seen.
        """
        seen = compute_visibility(view.vertices, self.model.faces, view.camera)
        nose = (seen.face >= 0) & self._nose[seen.face]
        if not nose.any():
            return view.captured
        corners = seen.pixels[np.unique(self.model.faces[self._nose])]
        centre, radius = corners.mean(axis=0), REACH * float(np.ptp(corners, axis=0).max())
        moved = self.drift * _direction(self.seed, view.frame.timestep, view.frame.camera)
        return magnified(view.captured, centre, radius, GROWTH, moved)


def magnified(
    image: Float32[np.ndarray, "h w 3"],
    centre: np.ndarray,
    radius: float,
    growth: float,
    moved: np.ndarray,
) -> Float32[np.ndarray, "h w 3"]:
    """Magnify a disc of an image, smoothly towards its edge, and move what is magnified.

    A pixel at the distance d of the centre, in radii, shows what was at the place p with

        p = centre + f(d) (pixel - centre - (1 - s(d)) moved),   f(d) = 1/growth + (1 - 1/growth) s(d),

    where s(d) = d^2 (3 - 2 d) rises from 0 to 1.

    Args:
        image: The image.
        centre: Centre of the disc (x, y) in pixels, pixel centres at + 0.5.
        radius: Its radius in pixels.
        growth: Magnification at the centre.
        moved: By how much what is at the centre moves (x, y), in pixels.

    Returns:
        The image; unchanged outside the disc.
    """
    height, width = image.shape[:2]
    x, y = np.meshgrid(np.arange(width) + 0.5 - centre[0], np.arange(height) + 0.5 - centre[1])
    distance = np.minimum(np.hypot(x, y) / max(radius, 1e-9), 1.0)
    rise = distance**2 * (3 - 2 * distance)
    factor = 1 / growth + (1 - 1 / growth) * rise
    source = [
        (factor * (offset - (1 - rise) * by) + middle - 0.5).astype(np.float32)
        for offset, by, middle in ((x, moved[0], centre[0]), (y, moved[1], centre[1]))
    ]
    warped = cv2.remap(image, *source, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where((distance < 1)[..., None], warped, image)


def _direction(*seed: int) -> np.ndarray:
    """A unit vector by a seed."""
    angle = np.random.default_rng([*seed, 5]).uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])
