"""Colours of the foreground, and its compositing without the old background's halo."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numba import njit

from carigs.matting.channels import mean_colour
from carigs.simd.kernels import INLINE, kernel

SMOOTHNESS = 1e-5
"""Weight of the differences between neighbours, to which the difference of their alphas is added."""
SMALL, SMALL_SWEEPS, SWEEPS = 32, 10, 2
"""Side of the levels that get more sweeps, and the number of sweeps of both."""


def foreground_colours(
    image: UInt8[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w 3"]:
    """Estimate the colours of the person, without the background that shows through (Germer et al. 2020, multi-level).

    F and B minimise `(alpha F + (1 - alpha) B - image)^2` and the differences between neighbours, from a level of one
    pixel to the whole image: each level starts with the colours of the one before.

    Args:
        image: sRGB.
        alpha: Matte in [0, 1].

    Returns:
        sRGB in [0, 1]; `image = alpha F + (1 - alpha) B` for a smooth background B.
    """
    colours = image.astype(np.float32) / 255
    parts = [part[None, None] for part in (mean_colour(colours, alpha > 0.9), mean_colour(colours, alpha < 0.1))]
    levels = int(np.ceil(np.log2(max(alpha.shape))))
    for level in range(levels + 1):
        size = tuple(round(side ** (level / max(levels, 1))) for side in alpha.shape[::-1])
        small, opacity, *parts = (
            cv2.resize(whole, size, interpolation=cv2.INTER_NEAREST) for whole in (colours, alpha, *parts)
        )
        _relax(*parts, small, opacity, np.float32(SMOOTHNESS), SMALL_SWEEPS if max(size) <= SMALL else SWEEPS)
    return parts[0]


@kernel
def _relax(front, behind, image, alpha, smoothness, sweeps):
    """Sweep over the pixels; each gets the colours (h, w, 3) that are best for those of its neighbours."""
    height, width = alpha.shape
    for _ in range(sweeps):
        for y in range(height):
            for x in range(width):
                a = alpha[y, x]
                around = (max(y - 1, 0), x), (min(y + 1, height - 1), x), (y, max(x - 1, 0)), (y, min(x + 1, width - 1))
                if (a == 0 or a == 1) and _equal(alpha, around, a):  # all of it is one of both
                    certain = front if a == 1 else behind
                    for c in range(3):
                        certain[y, x, c] = image[y, x, c]
                    continue
                b = 1 - a
                aa, bb = a * a, b * b
                for j, i in around:
                    weight = smoothness + abs(a - alpha[j, i])
                    aa += weight
                    bb += weight
                scale = 1 / (aa * bb - a * b * (a * b))
                for c in range(3):
                    f, g = a * image[y, x, c], b * image[y, x, c]
                    for j, i in around:
                        weight = smoothness + abs(a - alpha[j, i])
                        f += weight * front[j, i, c]
                        g += weight * behind[j, i, c]
                    front[y, x, c] = min(max(scale * (bb * f - a * b * g), 0), 1)
                    behind[y, x, c] = min(max(scale * (aa * g - a * b * f), 0), 1)


@njit(**INLINE)
def _equal(alpha, places, value):
    for j, i in places:
        if alpha[j, i] != value:
            return False
    return True


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
