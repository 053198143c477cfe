"""Which colours the person has, and which the background: what a coarse matte becomes when colours speak against it."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

BINS = 16
"""Of each channel."""
UNSEEN = 2e-4
"""Share of a region that a colour must have to count: below it, both regions are equally likely."""


def _histogram(colours: UInt8[np.ndarray, "n 3"]) -> Float32[np.ndarray, "b b b"]:
    """Share of each bin, with its neighbours: a step of light moves a colour by a bin."""
    bins = (colours // (256 // BINS)).astype(np.int64)
    flat = (bins[:, 0] * BINS + bins[:, 1]) * BINS + bins[:, 2]
    shares = np.bincount(flat, minlength=BINS**3).reshape(BINS, BINS, BINS) / max(len(colours), 1)
    for axis in range(3):
        along = np.moveaxis(shares, axis, 0)
        padded = np.pad(along, ((1, 1), (0, 0), (0, 0)))
        shares = np.moveaxis((padded[:-2] + 2 * along + padded[2:]) / 4, 0, axis)
    return shares.astype(np.float32)


def with_colours(
    coarse: Float[np.ndarray, "h w"], image: UInt8[np.ndarray, "h w 3"], trimap: UInt8[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """Weigh a coarse matte by the colours of the certain regions (Bayes' rule with histograms).

    Args:
        coarse: Probability of the foreground.
        image: sRGB.
        trimap: 0 background, 255 foreground.

    Returns:
        Probability of the foreground for the position and the colour of each pixel.
    """
    bins = cv2.blur(image, (3, 3)) // (256 // BINS)
    likely = [
        _histogram(image[trimap == value])[bins[..., 0], bins[..., 1], bins[..., 2]] + UNSEEN for value in (255, 0)
    ]
    front, behind = likely[0] * coarse, likely[1] * (1 - coarse)
    return (front / np.maximum(front + behind, 1e-12)).astype(np.float32)
