"""Mattes of images before a background of a known grey, made anew near their outline (difference keying)."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

REACH = 1 / 80
"""How far from the stated outline a matte is made anew, as a share of the image's diagonal."""
LEAST_REACH = 6
"""The same in pixels, at least."""
CONTRAST = 0.05
"""Least squared distance of colours of foreground and background: where they are more alike, the image does not tell
how opaque a pixel is."""
OPAQUE, CLEAR = 0.98, 0.02
"""Opacities of the stated matte from which a pixel counts as foreground, and to which as background."""
ALMOST_OPAQUE = 0.9
"""Opacity in the first pass from which a pixel shows the colour of the foreground."""
WIDTHS = (33, 9, 3)
"""Of the neighbourhoods in which colours of the foreground are looked for, in pixels of the small image."""
LEAST_COUNT = 0.02
"""Share of the pixels of a neighbourhood that show the foreground."""


class RemadeMatte(NamedTuple):
    """A matte that fits the image."""

    alpha: Float32[np.ndarray, "h w"]
    """Opacity in [0, 1]; that of the stated matte where it is not known."""
    known: Bool[np.ndarray, "h w"]
    """Where it follows from the image."""


def outline_reach(shape: tuple[int, ...]) -> int:
    """How far from the outline a matte is made anew.

    Args:
        shape: Height and width of the image in pixels.

    Returns:
        Distance in pixels.
    """
    return max(LEAST_REACH, round(REACH * float(np.hypot(*shape[:2]))))


def remake_matte(image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"], background: float) -> RemadeMatte:
    """Estimate the opacity of the pixels near the outline of a matte from the image.

    A pixel shows `alpha F + (1 - alpha) B`; B is the background, and F the mean colour of the foreground nearby: of the
    pixels that lie deep inside the stated matte, and then of those that are opaque by the colours found from these.

    Args:
        image: sRGB values from 0 to 255 of an image that was composited on the background.
        matte: Stated opacities from 0 to 255; wrong by less than `outline_reach`.
        background: Grey value of the background from 0 to 1.

    Returns:
        The matte.
    """
    colours, stated = image.astype(np.float32) / 255, matte.astype(np.float32) / 255
    reach = outline_reach(matte.shape)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    inside = cv2.erode((stated > OPAQUE).astype(np.uint8), disc) > 0
    near = (cv2.dilate((stated > CLEAR).astype(np.uint8), disc) > 0) & ~inside
    if not inside.any():
        return RemadeMatte(stated, np.zeros(matte.shape, bool))
    found = _remake(colours, stated, near, inside, background, reach)
    opaque = cv2.erode((found.alpha > ALMOST_OPAQUE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return _remake(colours, stated, near, opaque, background, reach)


def _remake(
    colours: Float32[np.ndarray, "h w 3"],
    stated: Float32[np.ndarray, "h w"],
    near: Bool[np.ndarray, "h w"],
    foreground: Bool[np.ndarray, "h w"],
    background: float,
    reach: int,
) -> RemadeMatte:
    """The matte with the colours that some pixels of the foreground show."""
    contrast = np.float32(background) - _nearby_colours(colours, foreground, max(2 * reach // 3, 1))
    squared = np.einsum("hwc,hwc->hw", contrast, contrast)
    known = near & (squared > CONTRAST)
    difference = np.einsum("hwc,hwc->hw", np.float32(background) - colours, contrast)
    alpha = np.clip(difference / np.maximum(squared, CONTRAST), 0, 1)
    return RemadeMatte(np.where(known, alpha, stated), known)


def _nearby_colours(
    colours: Float32[np.ndarray, "h w 3"], foreground: Bool[np.ndarray, "h w"], step: int
) -> Float32[np.ndarray, "h w 3"]:
    """Mean colour of the foreground in the smallest neighbourhood that shows enough of it, on an image of 1 / step."""
    height, width = foreground.shape
    size = -(-width // step), -(-height // step)
    weight = foreground.astype(np.float32)
    count = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(colours * weight[..., None], size, interpolation=cv2.INTER_AREA)
    mean = np.broadcast_to(total.sum(axis=(0, 1)) / max(float(count.sum()), 1e-6), total.shape).astype(np.float32)
    for w in WIDTHS:
        share = cv2.blur(count, (w, w))[..., None]
        mean = np.where(share > LEAST_COUNT, cv2.blur(total, (w, w)) / np.maximum(share, LEAST_COUNT), mean)
    return cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR)
