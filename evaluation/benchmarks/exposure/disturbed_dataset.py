"""Copies of datasets in which cameras differ in exposure and white balance.

Factors are drawn from a uniform distribution: one for all channels of a camera, times one for each. They hold for
linear light, or for the values of the image files. The validation camera has the factor 1.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture, Frame
from carigs.capture.images import to_linear, to_srgb, write_png
from carigs.errors import InputError

EXPOSURE, WHITE_BALANCE = 0.2, 0.05
"""Half ranges of the factors of all channels, and of each channel."""
CLEAR = 1 / 255
"""Opacity below which a pixel has no colour of its own."""


def constant_factor(factors: dict[int, Float[np.ndarray, "3"]], frame: Frame) -> Float[np.ndarray, "3"] | None:
    """Factors of the camera of a training frame.

    Args:
        factors: Of `drawn_factors`.
        frame: A frame.

    Returns:
        Factors; None for other frames.
    """
    return factors[frame.camera] if frame.split == "train" else None


def drawn_factors(
    capture: Capture, seed: int, exposure: float = EXPOSURE, white_balance: float = WHITE_BALANCE
) -> dict[int, Float[np.ndarray, "3"]]:
    """Draw the factors of the cameras.

    Args:
        capture: The capture.
        seed: Of the random numbers.
        exposure: Half range of the factor of all channels.
        white_balance: Half range of the factors of each.

    Returns:
        Factors of red, green and blue by camera; 1 for the validation camera.
    """
    rng = np.random.default_rng(seed)
    factors = {
        c: rng.uniform(1 - exposure, 1 + exposure) * rng.uniform(1 - white_balance, 1 + white_balance, 3)
        for c in capture.cameras
    }
    return factors | {capture.validation_camera: np.ones(3)}


def disturbed_image(
    capture: Capture, frame: Frame, factor: Float[np.ndarray, "3"], *, stored: bool
) -> Float[np.ndarray, "h w 3"]:
    """The image of a frame as another camera would show it, composited on the same background.

    Args:
        capture: The capture.
        frame: One of its frames.
        factor: Factors of red, green and blue.
        stored: Whether they hold for stored values, not for linear light.

    Returns:
        sRGB values in [0, 1].
    """
    image, alpha = capture.image(frame).astype(np.float64), capture.foreground(frame)[..., None].astype(np.float64)
    behind = capture.background * (1 - alpha)
    colour = np.clip((image - behind) / np.maximum(alpha, CLEAR), 0, 1)
    changed = colour * factor if stored else to_srgb(to_linear(colour) * factor)
    return np.where(alpha > CLEAR, alpha * np.clip(changed, 0, 1) + behind, image)


def disturb_dataset(
    capture: Capture, folder: Path, factor_of: Callable[[Frame], Float[np.ndarray, "3"] | None], *, stored: bool = False
) -> None:
    """Write a copy of a dataset with other exposures.

    Args:
        capture: The dataset, as `read_dataset` gives it.
        folder: Where the copy is written.
        factor_of: Factors of a frame; None leaves it as it is.
        stored: As in `disturbed_image`.

    Raises:
        InputError: If an image is no PNG file, or holds its own matte.
    """
    shutil.copytree(capture.root, folder, ignore=shutil.ignore_patterns("truth"))
    for frame in capture.frames:
        factor = factor_of(frame)
        if factor is None:
            continue
        if frame.mask == frame.image or not frame.image.endswith(".png"):
            raise InputError("expected a PNG file beside its matte", file=capture.root / frame.image)
        write_png(folder / frame.image, disturbed_image(capture, frame, factor, stored=stored))
