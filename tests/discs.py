"""Images of soft discs before a plain background, whose opacity is known."""

from __future__ import annotations

import numpy as np

SIZE = 120
CENTRE = 60.3, 59.8
RADIUS = 35.0


def disc(radius: float = RADIUS) -> np.ndarray:
    """Opacity (SIZE, SIZE) of a disc, falling from 1 to 0 within a pixel across its outline."""
    y, x = np.mgrid[:SIZE, :SIZE]
    return np.clip(radius + 0.5 - np.hypot(x - CENTRE[0], y - CENTRE[1]), 0, 1).astype(np.float32)


def before(background, colour, alpha: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] of a foreground with some opacity before a background."""
    opacity = alpha[..., None]
    return (opacity * np.asarray(colour, np.float32) + (1 - opacity) * np.asarray(background, np.float32)).astype(
        np.float32
    )


def in_bytes(values: np.ndarray) -> np.ndarray:
    """Values in [0, 1] as they are stored."""
    return np.rint(255 * values).astype(np.uint8)
