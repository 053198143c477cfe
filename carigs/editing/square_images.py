"""Images in the square format of diffusion models, and back."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32


def to_square(image: Float32[np.ndarray, "h w 3"], size: int, background: float) -> Float32[np.ndarray, "s s 3"]:
    """Pad an image to a square, and scale it.

    Args:
        image: RGB in [0, 1].
        size: Height and width of the result.
        background: Grey value of the padding.

    Returns:
        RGB in [0, 1].
    """
    height, width = image.shape[:2]
    side = max(height, width)
    top, left = (side - height) // 2, (side - width) // 2
    square = np.full((side, side, 3), background, np.float32)
    square[top : top + height, left : left + width] = image
    return _resized(square, size).clip(0, 1)


def from_square(square: Float32[np.ndarray, "s s 3"], shape: tuple[int, int]) -> Float32[np.ndarray, "h w 3"]:
    """Undo `to_square`.

    Args:
        square: RGB in [0, 1].
        shape: Height and width of the image.

    Returns:
        RGB in [0, 1].
    """
    height, width = shape
    side = max(shape)
    top, left = (side - height) // 2, (side - width) // 2
    scaled = _resized(square, side)
    return np.ascontiguousarray(scaled[top : top + height, left : left + width]).clip(0, 1)


def _resized(square: Float32[np.ndarray, "s s 3"], side: int) -> Float32[np.ndarray, "r r 3"]:
    return cv2.resize(square, (side, side), interpolation=cv2.INTER_AREA if side < len(square) else cv2.INTER_CUBIC)
