"""Trimap: where a coarse matte is right for certain, and the band around the outline where alpha is solved."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

FOREGROUND, BACKGROUND = 0.9, 0.1
"""Values of a coarse matte from which, and up to which, it is taken for certain away from its outline."""
INWARD, OUTWARD, STRANDS = 6 / 512, 10 / 512, 32 / 512
"""Widths of the band to either side of the outline, and how far outside it strands of hair are searched for, in
larger sides of the image."""
DIFFERENT = 6.0
"""Deviations from the background from which a pixel outside the band may be a strand of hair."""


def in_pixels(share: float, shape: tuple[int, ...]) -> int:
    """A width that grows with the image.

    Args:
        share: Of the larger side of the image.
        shape: Of the image: height, width.

    Returns:
        The width in pixels, at least 1.
    """
    return max(round(share * max(shape[:2])), 1)


def grown(region: Bool[np.ndarray, "h w"], pixels: int) -> Bool[np.ndarray, "h w"]:
    """Dilate a region by a disc.

    Args:
        region: The region.
        pixels: Radius; negative to erode. What lies outside the image changes nothing.

    Returns:
        The grown region.
    """
    distance = cv2.distanceTransform((~region if pixels >= 0 else region).astype(np.uint8), cv2.DIST_L2, 5)
    return distance <= pixels if pixels >= 0 else distance > -pixels


def trimap(
    coarse: Float[np.ndarray, "h w"], distance: Float[np.ndarray, "h w"] | None = None
) -> UInt8[np.ndarray, "h w"]:
    """Divide an image into foreground, background and the band between them.

    Args:
        coarse: Coarse matte in [0, 1], at the size of the image.
        distance: Of each pixel from the known background, in deviations, or None if it is not known. Strands of hair
            that the coarse matte lacks are added to the band by it.

    Returns:
        0 background, 255 foreground, 128 unknown.
    """
    shape = coarse.shape
    foreground = grown(coarse > FOREGROUND, -in_pixels(INWARD, shape))
    possible = grown(coarse > BACKGROUND, in_pixels(OUTWARD, shape))
    if distance is not None:
        possible |= _strands(distance > DIFFERENT, possible)
    return np.where(foreground, 255, np.where(possible, 128, 0)).astype(np.uint8)


def _strands(different: Bool[np.ndarray, "h w"], possible: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What differs from the background, is connected to the band, and near it."""
    near = grown(possible, in_pixels(STRANDS, possible.shape))
    _, labels = cv2.connectedComponents(((different & near) | possible).astype(np.uint8), connectivity=8)
    touching = np.unique(labels[possible])
    strands = np.isin(labels, touching) & different & near
    return grown(strands, in_pixels(2 / 512, possible.shape)) & near
