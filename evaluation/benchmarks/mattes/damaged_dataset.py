"""Copies of datasets whose mattes are wrong, or whose images were composited with the colours of an old background."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from carigs.capture import Capture
from carigs.capture.images import write_png
from carigs.errors import InputError

PIXELS = 2
"""By which mattes grow or shrink, and the standard deviation of the blur."""
SCREEN = (0.0, 0.6, 0.25)
"""Colour of the old background: a green screen."""

Matte = UInt8[np.ndarray, "h w"]


def grown(matte: Matte) -> Matte:
    """Make a matte larger by `PIXELS` on all sides.

    Args:
        matte: Opacities from 0 to 255.

    Returns:
        The largest opacity within a disc.
    """
    return cv2.dilate(matte, _disc())


def shrunk(matte: Matte) -> Matte:
    """Make a matte smaller by `PIXELS` on all sides.

    Args:
        matte: Opacities from 0 to 255.

    Returns:
        The least opacity within a disc.
    """
    return cv2.erode(matte, _disc())


def blurred(matte: Matte) -> Matte:
    """Blur a matte with a Gaussian of `PIXELS`.

    Args:
        matte: Opacities from 0 to 255.

    Returns:
        The blurred matte.
    """
    return cv2.GaussianBlur(matte, (0, 0), PIXELS)


def with_halo(
    image: Float32[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"], background: float
) -> Float32[np.ndarray, "h w 3"]:
    """Composite a photograph before `SCREEN` as if its pixels were those of the foreground.

    Args:
        image: sRGB in [0, 1], composited on the background with the colours of the foreground.
        alpha: Its matte in [0, 1].
        background: Grey value of the background in [0, 1].

    Returns:
        `alpha P + (1 - alpha) background` with the photograph `P = alpha F + (1 - alpha) SCREEN`.
    """
    opacity = alpha[..., None]
    photograph = image + (1 - opacity) * (np.array(SCREEN, np.float32) - background)
    return opacity * photograph + (1 - opacity) * background


def with_rim(
    image: Float32[np.ndarray, "h w 3"], alpha: Float32[np.ndarray, "h w"], background: float
) -> Float32[np.ndarray, "h w 3"]:
    """Cut out the pixels of a photograph before `SCREEN` that show any foreground.

    Args:
        image: As in `with_halo`.
        alpha: As in `with_halo`.
        background: As in `with_halo`.

    Returns:
        The photograph `alpha F + (1 - alpha) SCREEN` where alpha > 0, else the background.
    """
    opacity = alpha[..., None]
    photograph = image + (1 - opacity) * (np.array(SCREEN, np.float32) - background)
    return np.where(opacity > 0, photograph, image)


MATTES: dict[str, Callable[[Matte], Matte]] = {"grown": grown, "shrunk": shrunk, "blurred": blurred}
"""Wrong mattes by name."""
IMAGES = {"halo": with_halo, "rim": with_rim}
"""Images with an old background by name."""


def damage_dataset(capture: Capture, folder: Path, kind: str) -> None:
    """Write a copy of a dataset with wrong mattes or halos; what stays the same is linked.

    Args:
        capture: The dataset, as `read_dataset` gives it.
        folder: Where the copy is written; it does not exist.
        kind: Key of `MATTES` or `IMAGES`.

    Raises:
        InputError: If an image is no PNG file, or holds its own matte.
    """
    changed = "images" if kind in IMAGES else "fg_masks"
    folder.mkdir(parents=True)
    for entry in capture.root.iterdir():
        if entry.name != changed:
            os.symlink(entry.resolve(), folder / entry.name)
    (folder / changed).mkdir()
    for frame in capture.frames:
        matte = capture.mask8(frame)
        if matte is None or frame.mask == frame.image or not frame.image.endswith(".png"):
            raise InputError("expected a PNG file beside its matte", file=capture.root / frame.image)
        if kind in IMAGES:
            alpha = matte.astype(np.float32) / 255
            write_png(folder / frame.image, IMAGES[kind](capture.image(frame), alpha, capture.background))
        else:
            write_png(folder / str(frame.mask), MATTES[kind](matte).astype(np.float32) / 255)


def _disc() -> UInt8[np.ndarray, "n n"]:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * PIXELS + 1, 2 * PIXELS + 1))
