"""How far the outline of a matte lies from that of the image's foreground, and how much softer it is.

Images that were composited on the stated background tell the opacity of their pixels (`remake_matte`). The places where
the image is sharp are looked at: hair is softer than any matte.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from carigs.capture.corrections.colour_gains import is_composited
from carigs.capture.corrections.known_background import outline_reach, remake_matte

SHARP = 5
"""Width in pixels of a neighbourhood with opaque and clear pixels, where an outline is sharp."""
OPAQUE, CLEAR = 0.95, 0.05
"""Opacity of such pixels."""
LEAST_LENGTH = 30
"""Pixels of sharp outline, below which nothing is said."""


class OutlineError(NamedTuple):
    """How a matte differs from the image at its outline."""

    offset: float
    """Pixels by which the matte reaches beyond the outline of the foreground; negative if it ends inside."""
    spread: float
    """Pixels by which opacities differ otherwise: the mean over the outline of the integral of the absolute difference
    across it, less that of the offset. A Gaussian blur of deviation s at a straight outline has s sqrt(2 / pi)."""


def outline_error(
    image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"], background: float
) -> OutlineError | None:
    """Compare the outline of a matte with the image.

    The integral of the gradient of an opacity is the length of its outline (co-area formula), and the integral of the
    difference of two opacities over that length is the distance of their outlines.

    Args:
        image: sRGB values from 0 to 255.
        matte: Opacities from 0 to 255.
        background: Grey value of the background from 0 to 1.

    Returns:
        The error; None if the image was not composited on the background, or shows little sharp outline.
    """
    if not is_composited(image, matte / np.float32(255), background):
        return None
    alpha, known = remake_matte(image, matte, background)
    square = np.ones((SHARP, SHARP), np.uint8)
    sharp = known & (cv2.dilate(alpha, square) > OPAQUE) & (cv2.erode(alpha, square) < CLEAR)
    width = 2 * outline_reach(matte.shape) - 3  # less than the reach on both sides: farther out, nothing is known
    looked_at = known & (cv2.dilate(sharp.astype(np.uint8), np.ones((width, width), np.uint8)) > 0)
    length = float(np.hypot(*np.gradient(alpha))[looked_at].sum())
    if length < LEAST_LENGTH:
        return None
    difference = matte[looked_at] / np.float32(255) - alpha[looked_at]
    offset = float(difference.sum()) / length
    return OutlineError(offset, float(np.abs(difference).sum()) / length - abs(offset))
