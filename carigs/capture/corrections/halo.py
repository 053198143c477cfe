"""An old background that shows at the outline of an image, and its removal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

FAINTEST = 1 / 512
"""Opacity below which a pixel is background."""


class Halo(NamedTuple):
    """How an old background B shows where the foreground F, with opacity a, is put before a new background N."""

    colour: tuple[float, float, float]
    """B: sRGB in [0, 1]."""
    photograph: bool
    """Whether pixels P = a F + (1 - a) B of a photograph were taken for those of the foreground: the image shows
    a P + (1 - a) N. Else it shows P, and N where a = 0."""


def without_halo(
    image: UInt8[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"], background: float, halo: Halo
) -> UInt8[np.ndarray, "h w 3"]:
    """Composite the foreground of an image again, without the old background.

    Args:
        image: sRGB values from 0 to 255.
        alpha: Its matte in [0, 1].
        background: Grey value of the new background in [0, 1].
        halo: The old one.

    Returns:
        `a F + (1 - a) N`. F is solved for, and clipped to [0, 1]. Opaque and clear pixels stay as they are.
    """
    mixed = (alpha > FAINTEST) & (alpha < 1)
    a, shown = alpha[mixed][:, None], image[mixed].astype(np.float32) / 255
    old, new = np.array(halo.colour, np.float32), np.float32(background)
    photograph = (shown - (1 - a) * new) / a if halo.photograph else shown
    foreground = np.clip((photograph - (1 - a) * old) / a, 0, 1)
    result = image.copy()
    result[mixed] = np.rint(255 * (a * foreground + (1 - a) * new))
    faint = (alpha > 0) & (alpha <= FAINTEST)
    result[faint] = round(255 * background)
    return result
