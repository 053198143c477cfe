"""Mattes of a clip: from coarse mattes, or from a plain background alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from carigs.matting.background import UNKNOWN, Background, clean_plate, distance_from, plain_background
from carigs.matting.closed_form import closed_form_alpha
from carigs.matting.difference import difference_prior
from carigs.matting.foreground import foreground_colours
from carigs.matting.steadiness import SteadyMatte
from carigs.matting.trimap import BACKGROUND, OUTWARD, grown, in_pixels, trimap

PRIOR_WEIGHT = 1e-4
"""Weight of the difference matte against the matting Laplacian, for a variance of 1."""
COARSE_WEIGHT = 2e-4
"""Weight of the coarse matte in the band, where colours say nothing."""
PLATE_MARGIN = 1.0
"""Distance from a coarse outline from which a pixel counts as background, in widths of the trimap's band."""


class MattedFrame(NamedTuple):
    """A frame with its matte."""

    alpha: Float32[np.ndarray, "h w"]
    """In [0, 1]."""
    foreground: Float32[np.ndarray, "h w 3"]
    """Colours of the person in sRGB, in [0, 1]."""


def at_size(coarse: Float[np.ndarray, "h w"], shape: tuple[int, ...]) -> Float32[np.ndarray, "h2 w2"]:
    """Scale a coarse matte to an image.

    Args:
        coarse: In [0, 1], of any resolution.
        shape: Of the image.

    Returns:
        In [0, 1].
    """
    scaled = cv2.resize(coarse.astype(np.float32), shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return np.nan_to_num(scaled).clip(0, 1)


def certain_background(coarse: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What lies far enough outside a coarse outline to hold no hair.

    Args:
        coarse: Coarse matte in [0, 1], at the size of the image.

    Returns:
        The region.
    """
    return ~grown(coarse > BACKGROUND, round(PLATE_MARGIN * in_pixels(OUTWARD, coarse.shape)))


def refined_alpha(
    image: UInt8[np.ndarray, "h w 3"], coarse: Float[np.ndarray, "h w"], background: Background | None
) -> Float32[np.ndarray, "h w"]:
    """Refine a coarse matte.

    Args:
        image: sRGB.
        coarse: Coarse matte in [0, 1], at the size of the image.
        background: What is behind the person, if anything is known.

    Returns:
        Alpha in [0, 1].
    """
    regions = trimap(coarse, None if background is None else distance_from(image, background))
    estimate, certainty = difference_prior(image, regions, background)
    weight = PRIOR_WEIGHT * certainty + COARSE_WEIGHT
    prior = (PRIOR_WEIGHT * certainty * estimate + COARSE_WEIGHT * coarse) / weight
    return closed_form_alpha(image, regions, prior, weight)
