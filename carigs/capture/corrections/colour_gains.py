"""Factors on the light of a frame, one per colour channel: exposure and white balance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

TOE, EXPONENT = 0.055, 2.4
"""Of the sRGB curve: light = ((value + TOE) / (1 + TOE)) ^ EXPONENT for values above 0.04 (IEC 61966-2-1). A factor g
on light is hence an affine map of stored values: value + TOE becomes g^(1 / EXPONENT) (value + TOE)."""

COMPOSITED = 4.0
"""Levels of 255 by which the median pixel outside the matte may differ from the stated background."""

Gains = tuple[float, float, float]
"""Factors on linear light of red, green and blue."""


def with_gains(
    image: UInt8[np.ndarray, "h w 3"], foreground: Float[np.ndarray, "h w"], background: float, gains: Gains
) -> UInt8[np.ndarray, "h w 3"]:
    """Multiply the light of the foreground of an image; a background that it was composited on keeps its colour.

    Args:
        image: sRGB values from 0 to 255. Where the matte is 0, it shows the stated background, or what the camera saw.
        foreground: Its opacity from 0 to 1.
        background: Grey value of the background from 0 to 1.
        gains: Factors on linear light.

    Returns:
        sRGB values from 0 to 255, rounded and clipped: a colour - TOE (1 - a) with a = gain ^ (1 / `EXPONENT`), of the
        foreground, which is composited again, or of all pixels.
    """
    factor = np.array(gains, np.float32) ** np.float32(1 / EXPONENT)
    rest = np.full(foreground.shape, -TOE, np.float32)
    if is_composited(image, foreground, background):
        rest = background - foreground.astype(np.float32) * np.float32(background + TOE)
    mapped = image * factor + 255 * (1 - factor) * rest[..., None]
    return np.rint(mapped.clip(0, 255)).astype(np.uint8)


def is_composited(image: UInt8[np.ndarray, "h w 3"], foreground: Float[np.ndarray, "h w"], background: float) -> bool:
    """Whether an image shows the stated background where there is no foreground, to the noise of a JPEG file.

    Args:
        image: sRGB values from 0 to 255.
        foreground: Its opacity from 0 to 1.
        background: Grey value of the background from 0 to 1.

    Returns:
        Whether the median colour outside the foreground is near the background's.
    """
    outside = image[foreground <= 0]
    return not len(outside) or bool(np.abs(np.median(outside, axis=0) - 255 * background).max() <= COMPOSITED)
