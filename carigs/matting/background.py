"""What is behind the person: a colour and its deviation for each pixel, from a plain wall or from other frames.

With one static camera, what the head covers in a frame is seen in another one. A plain wall is seen around the head in
every frame. Both give the same: a colour that the background would have, and how far it is to be trusted.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from carigs.matting.channels import largest

NOISE = 1.5 / 255
"""Least deviation of a colour: a camera's noise after its compression."""
UNKNOWN = 1.0
"""Deviation of a colour that no frame shows."""
FEWEST_SEEN = 3
"""Frames that show a pixel of the background before its colour counts."""
BORDER = 0.04
"""Width of the borders that a plain background is recognised by, in heights of the image."""
PLAIN_DEVIATION, PLAIN_SHARE = 0.02, 0.9
"""A plain background: this share of its borders lies within three such deviations of a smooth colour."""


class Background(NamedTuple):
    """The background of a frame as it would be without the person."""

    colour: Float32[np.ndarray, "h w 3"]
    """sRGB in [0, 1]."""
    deviation: Float32[np.ndarray, "h w"]
    """Of a channel; `UNKNOWN` where the colour says nothing."""


def clean_plate(
    frames: Iterable[tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]],
) -> Background | None:
    """Collect the background behind a person from the frames of a static camera.

    A background that moves gets a large deviation, and where no frame shows it, `UNKNOWN`.

    Args:
        frames: Images, and where each certainly shows the background.

    Returns:
        Mean and standard deviation; None without frames.
    """
    count = total = squares = None
    for image, is_background in frames:
        if count is None:
            count = np.zeros(image.shape[:2], np.float32)
            total, squares = np.zeros((2, *image.shape), np.float32)
        seen = is_background.astype(np.float32)
        colour = image.astype(np.float32) / 255
        count += seen
        total += colour * seen[..., None]
        squares += colour**2 * seen[..., None]
    if count is None:
        return None
    often = np.maximum(count, 1)[..., None]
    mean = total / often
    variance = np.maximum(squares / often - mean**2, 0).mean(axis=2)
    deviation = np.where(count >= FEWEST_SEEN, np.sqrt(variance + NOISE**2), UNKNOWN)
    return Background(mean, deviation.astype(np.float32))


def plain_background(image: UInt8[np.ndarray, "h w 3"]) -> Background | None:
    """Recognise a plain background by the upper and the side borders of an image.

    Its colour is a polynomial of second degree in x and y: a wall under a lamp, with the vignette of a lens.

    Args:
        image: The image. The person may touch the lower border, and the lower half of the others.

    Returns:
        The background of the whole image; None if the borders are not plain.
    """
    height, width = image.shape[:2]
    border = np.zeros((height, width), bool)
    side = max(round(BORDER * height), 2)
    border[:side] = True
    border[: height // 2, :side] = border[: height // 2, -side:] = True
    terms = _second_degree(height, width)
    rows, colours = terms[border].astype(np.float64), image[border] / 255.0
    inside = np.ones(len(rows), bool)
    for _ in range(4):  # least squares without what lies far off, such as hair at the upper border
        chosen = rows[inside]
        solution = np.linalg.lstsq(chosen.T @ chosen, chosen.T @ colours[inside], rcond=None)[0]
        residual = np.abs(colours - rows @ solution).max(axis=1)
        inside = residual <= 3 * max(float(np.median(residual)) * 1.5, NOISE)
    if (residual <= 3 * PLAIN_DEVIATION).mean() < PLAIN_SHARE:
        return None
    deviation = float(np.sqrt(np.mean((colours - rows @ solution)[inside] ** 2) + NOISE**2))
    # The polynomial is fitted to the borders: below them, and where it would leave [0, 1], it is less certain.
    farther = np.maximum(np.linspace(0, 2, height, dtype=np.float32) - 1, 0)[:, None] * np.ones((1, width), np.float32)
    colour = cv2.blur((terms @ solution.astype(np.float32)).clip(0, 1), (3, 3))
    return Background(colour, (deviation * (1 + 4 * farther)).astype(np.float32))


@lru_cache(1)
def _second_degree(height: int, width: int) -> Float32[np.ndarray, "h w 6"]:
    """The terms of a polynomial in x and y at each pixel; the frames of a clip have one size."""
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).astype(np.float32)


def distance_from(image: UInt8[np.ndarray, "h w 3"], background: Background) -> Float[np.ndarray, "h w"]:
    """How far the pixels of an image are from the background, in deviations.

    Args:
        image: The image.
        background: Its background.

    Returns:
        Of the channel that differs most, over the mean of 3 x 3 pixels.
    """
    difference = cv2.blur(image.astype(np.float32) / 255 - background.colour, (3, 3))
    return largest(np.abs(difference)) / background.deviation
