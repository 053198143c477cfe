"""The colour of an old background that shows at the outline of images.

Where an outline is sharp, the colour F of the foreground beside it is known, and a pixel of opacity a should show
`a F + (1 - a) N` before the background N. What it shows beyond that, is `a (1 - a) (B - F)` or `(1 - a) (B - N)` with
the colour B of another background (`carigs.capture.corrections.halo`). B is fitted by least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture.corrections.halo import Halo

WIDTH = 5
"""Width in pixels of the neighbourhood of a mixed pixel in which there are opaque and clear ones."""
OPAQUE, CLEAR = 0.98, 0.02
"""Opacity of such pixels."""
MIXED = 0.1, 0.9
"""Opacities of the pixels that are looked at."""
LEAST_OPAQUE = 0.1
"""Share of opaque pixels in the neighbourhood."""
LEAST_PIXELS = 200
"""Below, nothing is said."""
UNEXPLAINED = 0.25
"""Largest share of the squared differences that a halo may leave. Of a matte that is too small, it leaves a tenth or
more; of a sound one, nearly all."""
FAINT = 0.03
"""Root mean square of a halo that counts: 8 levels of 255."""
RANGE = 0.1
"""By which a fitted colour may lie outside [0, 1]: that of a matte of another size lies farther outside."""
DIFFERENT = 0.15
"""Distance of an old background from the colour of the foreground, below which it may be the foreground itself, of
which a matte that is too small leaves a rim."""


class OutlinePixels(NamedTuple):
    """Mixed pixels at sharp outlines."""

    shown: Float32[np.ndarray, "n 3"]
    """Their sRGB colours."""
    alpha: Float32[np.ndarray, "n 1"]
    """Their stated opacity."""
    foreground: Float32[np.ndarray, "n 3"]
    """The mean colour of opaque pixels beside them."""


def outline_pixels(image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"]) -> OutlinePixels:
    """Look at the sharp outlines of a matte.

    Args:
        image: sRGB values from 0 to 255.
        matte: Opacities from 0 to 255.

    Returns:
        Mixed pixels.
    """
    colours, alpha = image.astype(np.float32) / 255, matte.astype(np.float32) / 255
    opaque = (alpha > OPAQUE).astype(np.float32)
    share = cv2.blur(opaque, (WIDTH, WIDTH))
    beside = (share > LEAST_OPAQUE) & (cv2.erode(alpha, np.ones((WIDTH, WIDTH), np.uint8)) < CLEAR)
    used = beside & (alpha > MIXED[0]) & (alpha < MIXED[1])
    mean = cv2.blur(colours * opaque[..., None], (WIDTH, WIDTH))[used] / share[used][:, None]
    return OutlinePixels(colours[used], alpha[used][:, None], mean)


def fit_halo(pixels: Sequence[OutlinePixels], background: float) -> Halo | None:
    """Find the old background of the frames of a camera.

    Args:
        pixels: Of some of its frames.
        background: Grey value of the new background in [0, 1].

    Returns:
        The halo; None if there is none.
    """
    shown, alpha, foreground = (np.concatenate(parts).astype(np.float64) for parts in zip(*pixels, strict=True))
    if len(shown) < LEAST_PIXELS:
        return None
    excess = shown - alpha * foreground - (1 - alpha) * background
    best, least = None, UNEXPLAINED * float(np.square(excess).mean())
    for photograph in (True, False):
        weight = alpha * (1 - alpha) if photograph else 1 - alpha
        other = foreground if photograph else np.full_like(shown, background)
        colour = (weight * (excess + weight * other)).sum(axis=0) / np.square(weight).sum()
        halo = weight * (colour - other)
        left = float(np.square(excess - halo).mean())
        possible = bool(((colour > -RANGE) & (colour < 1 + RANGE)).all())
        distinct = photograph or np.linalg.norm(colour - foreground.mean(axis=0)) > DIFFERENT
        if possible and distinct and left < least and np.square(halo).mean() > FAINT**2:
            red, green, blue = np.round(colour.clip(0, 1), 4).tolist()
            best, least = Halo((red, green, blue), photograph), left
    return best
