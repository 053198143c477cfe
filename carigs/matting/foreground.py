"""Colours of the foreground, and its compositing without the old background's halo."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, UInt8

from carigs.matting.pymatting_modules import pymatting_module


def foreground_colours(
    image: UInt8[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w 3"]:
    """Estimate the colours of the person, without the background that shows through (Germer et al. 2020, multi-level).

    Args:
        image: sRGB.
        alpha: Matte in [0, 1].

    Returns:
        sRGB in [0, 1]; `image = alpha F + (1 - alpha) B` for a smooth background B.

    Raises:
        CarigsError: If pymatting is not installed.
    """
    estimate = pymatting_module("foreground.estimate_foreground_ml").estimate_foreground_ml
    return estimate(image.astype(np.float32) / 255, alpha).clip(0, 1).astype(np.float32)


def composite(
    foreground: Float[np.ndarray, "h w 3"], alpha: Float[np.ndarray, "h w"], background: float
) -> UInt8[np.ndarray, "h w 3"]:
    """Put a foreground before a grey, in sRGB values as they are stored.

    Light adds up in linear values. But alpha is solved for stored values, renderers of surfels blend stored values, and
    `carigs.capture.images.read_rgb8` composites stored values: one rule for all of them lets a matte mean one thing.

    Args:
        foreground: sRGB in [0, 1].
        alpha: Matte in [0, 1].
        background: Grey value in [0, 1].

    Returns:
        sRGB.
    """
    opacity = alpha[..., None]
    return np.rint(255 * (opacity * foreground + (1 - opacity) * background).clip(0, 1)).astype(np.uint8)
