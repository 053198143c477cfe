"""Images as data URIs, which a page holds without other files."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.errors import CarigsError

QUALITY = 85
"""Of WebP, 0 to 100: errors are not seen, and plots keep their edges."""

MAX_WIDTH = 16_383
"""Of an image in WebP, in pixels."""


def data_uri(image: Float[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w 3"], height: int) -> str:
    """Encode an image as WebP in a data URI.

    Args:
        image: RGB, in [0, 1] or in 0..255.
        height: Its height in the page in pixels; smaller images are not enlarged, and none is wider than `MAX_WIDTH`.

    Returns:
        The URI.

    Raises:
        CarigsError: The image cannot be encoded.
    """
    pixels = image if image.dtype == np.uint8 else np.round(image * 255).astype(np.uint8)
    full, shown = pixels.shape[1], min(height, pixels.shape[0])
    size = min(max(round(full * shown / pixels.shape[0]), 1), MAX_WIDTH), shown
    if size != (full, pixels.shape[0]):
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    encodes, encoded = cv2.imencode(".webp", pixels[:, :, ::-1], [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    if not encodes:
        raise CarigsError(f"an image of {pixels.shape[1]} x {pixels.shape[0]} pixels cannot be encoded as WebP")
    return "data:image/webp;base64," + base64.b64encode(encoded.tobytes()).decode()


def fitting_height(width: int, height: int, max_width: int) -> int:
    """The height of an image that is reduced to a width.

    Args:
        width: Width in pixels.
        height: Height in pixels.
        max_width: Largest width in pixels.

    Returns:
        Height in pixels.
    """
    return height if width <= max_width else max(height * max_width // width, 1)
