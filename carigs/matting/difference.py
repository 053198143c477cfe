"""Difference matting: what the known colours of foreground and background say of alpha in a pixel, and how surely."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from carigs.matting.background import NOISE, Background
from carigs.matting.channels import summed

LEAST_VARIANCE, MOST_VARIANCE = 1e-3, 0.04
"""Of an estimate of alpha: from the second on, with a deviation of 0.2, it counts for nothing."""
MOST_CERTAIN = 1 / LEAST_VARIANCE - 1 / MOST_VARIANCE
"""Certainty of a known pixel."""
LEAST_SHARE = 0.3
"""Of the background's deviation that counts where alpha is 1: that it is 1 follows from the colour behind, too."""
UNEXPLAINED = 4.0
"""Mean squared deviation from every mixture at which the certainty has fallen to 1 / e, in variances."""
PYRAMID = 6
"""Levels by which colours are spread into the band, from half the size of the image: 64 pixels of the image."""


def spread(image: Float32[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]) -> Background:
    """Fill pixels with the colours of the known ones around them, near ones first (push-pull).

    Args:
        image: Colours.
        known: Which of them count.

    Returns:
        Mean and deviation of the colours around each pixel.
    """
    values = np.dstack([image, summed(image * image)]) * known[..., None]
    levels = [(cv2.pyrDown(values), cv2.pyrDown(known.astype(np.float32)))]
    for _ in range(PYRAMID - 1):
        levels.append(tuple(cv2.pyrDown(part) for part in levels[-1]))
    value, weight = levels[-1]
    filled = value / np.maximum(weight, 1e-6)[..., None]
    for value, weight in levels[-2::-1]:
        above = cv2.pyrUp(filled, dstsize=weight.shape[::-1])
        share = np.minimum(4 * weight, 1)[..., None]
        filled = share * value / np.maximum(weight, 1e-6)[..., None] + (1 - share) * above
    colour = filled[..., :3]
    variance = np.maximum(filled[..., 3] - summed(colour * colour), 0) / 3
    found = np.dstack([colour, np.sqrt(variance + NOISE**2)])
    found = cv2.pyrUp(found, dstsize=known.shape[::-1])
    return Background(found[..., :3], found[..., 3])


def surely(first: Background, second: Background) -> Background:
    """Of two estimates of a background, take the surer one in each pixel.

    Args:
        first: One estimate.
        second: Another one.

    Returns:
        Colours and deviations.
    """
    better = first.deviation <= second.deviation
    return Background(
        np.where(better[..., None], first.colour, second.colour), np.where(better, first.deviation, second.deviation)
    )


def difference_prior(
    image: UInt8[np.ndarray, "h w 3"], trimap: UInt8[np.ndarray, "h w"], background: Background | None
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Estimate alpha from `image = alpha F + (1 - alpha) B` with the colours of both around.

    Args:
        image: sRGB.
        trimap: 0 background, 255 foreground.
        background: B from other frames or of a plain wall. It is used where it is surer than the colours around.

    Returns:
        Alpha by least squares over the channels, and its certainty, the inverse of the variance
        `((1 - alpha)^2 s_B^2 + alpha^2 s_F^2) / |F - B|^2`. A pixel that no mixture of both colours explains, such as a
        strand in the light, has no certainty. Outside the band, alpha is that of the trimap.
    """
    colours = image.astype(np.float32) / 255
    front, behind = spread(colours, trimap == 255), spread(colours, trimap == 0)
    if background is not None:
        behind = surely(background, behind)
    band = (trimap > 0) & (trimap < 255)
    alpha, certainty = np.float32(trimap == 255), np.full(trimap.shape, MOST_CERTAIN, np.float32)
    alpha[band], certainty[band] = _mixture(
        colours[band], *(Background(known.colour[band], known.deviation[band]) for known in (front, behind))
    )
    return alpha, certainty


def _mixture(
    colours: Float32[np.ndarray, "n 3"], front: Background, behind: Background
) -> tuple[Float32[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """Alpha of pixels, and its certainty."""
    axis, difference = front.colour - behind.colour, colours - behind.colour
    length = np.maximum((axis**2).sum(axis=-1), 1e-6)
    alpha = ((axis * difference).sum(axis=-1) / length).clip(0, 1)
    noise = (np.maximum(1 - alpha, LEAST_SHARE) * behind.deviation) ** 2 + (alpha * front.deviation) ** 2
    unexplained = ((difference - alpha[:, None] * axis) ** 2).sum(axis=-1) / (3 * noise)
    certainty = 1 / np.maximum(noise / length, LEAST_VARIANCE) - 1 / MOST_VARIANCE
    return alpha, np.maximum(certainty, 0) * np.exp(-unexplained / UNEXPLAINED)
