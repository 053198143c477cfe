"""What is behind the person: a plain wall, blurred lights, shelves of books, and shelves that move."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

KINDS = ("plain", "lights", "books", "moving")
PAN = 2
"""Pixels a frame of `moving`."""


def background(
    kind: str, height: int, width: int, count: int, rng: np.random.Generator
) -> list[Float[np.ndarray, "h w 3"]]:
    """Draw backgrounds.

    Args:
        kind: One of `KINDS`.
        height: Of the images in pixels.
        width: Of the images in pixels.
        count: Number of frames.
        rng: Gives places and colours.

    Returns:
        RGB in [0, 1] of each frame; still ones are one array.
    """
    if kind == "plain":
        return [_wall(height, width)] * count
    if kind == "lights":
        return [_lights(height, width, rng)] * count
    shelves = _shelves(height, width + PAN * count, rng)
    return [shelves[:, PAN * i * (kind == "moving") :][:, :width] for i in range(count)]


def _wall(height: int, width: int) -> Float[np.ndarray, "h w 3"]:
    """Nearly grey, brighter on one side and below."""
    y, x = np.mgrid[:height, :width]
    slopes = ((0.62, 0.10, 0.08), (0.63, 0.08, 0.08), (0.66, 0.06, 0.10))
    return np.stack([c + a * x / width - b * y / height for c, a, b in slopes], axis=-1)


def _lights(height: int, width: int, rng: np.random.Generator) -> Float[np.ndarray, "h w 3"]:
    """Coloured lamps out of focus."""
    image = np.full((height, width, 3), 0.12)
    for _ in range(40):
        colour, lamp = rng.uniform(0.1, 0.9, 3), np.zeros((height, width))
        centre = int(rng.integers(width)), int(rng.integers(height))
        cv2.circle(lamp, centre, int(rng.integers(8, 45)), 1.0, -1)
        image += 0.6 * lamp[..., None] * colour
    return cv2.GaussianBlur(image.clip(0, 1), (0, 0), 4)


def _shelves(height: int, width: int, rng: np.random.Generator) -> Float[np.ndarray, "h w 3"]:
    """Books of many colours and sizes, with the grain of paper."""
    image = np.full((height, width, 3), 0.3)
    top = 0
    while top < height:
        shelf_height, x = int(rng.integers(50, 90)), 0
        while x < width:
            book = int(rng.integers(6, 22))
            image[top + 4 : top + shelf_height - 4, x : x + book - 1] = rng.uniform(0.05, 0.95, 3) * rng.uniform(0.5, 1)
            x += book
        top += shelf_height
    return cv2.GaussianBlur(image + rng.normal(0, 0.05, (height, width, 1)), (0, 0), 0.8).clip(0, 1)
