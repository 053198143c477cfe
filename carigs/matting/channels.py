"""One number for each pixel from its channels: OpenCV takes a tenth of the time of NumPy's reductions of short axes."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8


def summed(image: Float32[np.ndarray, "h w 3"], weight: float = 1.0) -> Float32[np.ndarray, "h w"]:
    """Weighted sum of the channels.

    Args:
        image: Any values.
        weight: Of each channel.

    Returns:
        The sum.
    """
    return cv2.transform(image, np.full((1, 3), weight, np.float32))


def largest(
    image: Float32[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w 3"],
) -> Float32[np.ndarray, "h w"] | UInt8[np.ndarray, "h w"]:
    """The largest channel.

    Args:
        image: Any values.

    Returns:
        The maximum.
    """
    first, second, third = cv2.split(image)
    return cv2.max(cv2.max(first, second), third)


def mean_colour(image: Float32[np.ndarray, "h w 3"], region: Bool[np.ndarray, "h w"]) -> Float32[np.ndarray, "3"]:
    """Mean of the pixels in a region.

    Args:
        image: Any values.
        region: The region.

    Returns:
        The mean; 0 if the region is empty.
    """
    return np.array(cv2.mean(image, region.astype(np.uint8))[:3], np.float32)
