"""PNG images (float32 in [0, 1] in memory, uint8 on disk), bit fields per pixel, and the sRGB transfer function."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8, UInt16

from carigs.capture.frame import Frame
from carigs.errors import InputError
from carigs.readers.images import read_pixels

BACKGROUND_TOLERANCE = 0.1
"""Difference from the background's colour, in a channel, from which a pixel is foreground."""


def to_linear(colours: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Convert sRGB values to linear light (IEC 61966-2-1).

    Args:
        colours: sRGB values in [0, 1].

    Returns:
        Linear values in [0, 1].
    """
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def to_srgb(light: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Convert linear light to sRGB values, the inverse of `to_linear`.

    Args:
        light: Linear values in [0, 1].

    Returns:
        sRGB values in [0, 1].
    """
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def read_rgb8(file: Path, background: float = 1.0) -> UInt8[np.ndarray, "h w 3"]:
    """Read a colour image; one with an alpha channel is composited on the background.

    Args:
        file: Image file.
        background: Grey value in [0, 1].

    Returns:
        RGB values from 0 to 255.

    Raises:
        InputError: If the file is missing or not an image.
    """
    pixels = _eight_bits(read_pixels(file))
    if pixels.ndim == 2 or pixels.shape[2] == 3:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB if pixels.ndim == 2 else cv2.COLOR_BGR2RGB)
    pixels = pixels.astype(np.float32)
    alpha = pixels[..., 3:] / 255
    return np.rint(pixels[..., 2::-1] * alpha + 255 * background * (1 - alpha)).astype(np.uint8)


def read_alpha8(file: Path) -> UInt8[np.ndarray, "h w"]:
    """Read the alpha channel of an image.

    Args:
        file: Image file.

    Returns:
        Opacities from 0 to 255.

    Raises:
        InputError: If the file is missing, is not an image, or has no alpha channel.
    """
    pixels = _eight_bits(read_pixels(file))
    if pixels.ndim != 3 or pixels.shape[2] != 4:
        raise InputError("the image has no alpha channel", file=file)
    return np.ascontiguousarray(pixels[..., 3])


def read_frame_matte8(folder: Path, frame: Frame) -> UInt8[np.ndarray, "h w"] | None:
    """Read the foreground matte of a frame.

    Args:
        folder: What the paths of the frame are relative to.
        frame: The frame.

    Returns:
        Opacity of the foreground from 0 to 255; None if the frame has no matte.

    Raises:
        InputError: If the file is missing or not an image.
    """
    if frame.mask is None:
        return None
    return read_alpha8(folder / frame.mask) if frame.mask == frame.image else read_grey8(folder / frame.mask)


def _eight_bits(pixels: UInt8[np.ndarray, "h w *c"] | UInt16[np.ndarray, "h w *c"]) -> UInt8[np.ndarray, "h w *c"]:
    return pixels if pixels.dtype == np.uint8 else np.rint(pixels / 257).astype(np.uint8)


def differs_from_background(
    image: UInt8[np.ndarray, "h w 3"], background: float, blur: int = 1
) -> Bool[np.ndarray, "h w"]:
    """Find the pixels that do not have the background's colour.

    Args:
        image: RGB values from 0 to 255.
        background: Grey value from 0 to 1.
        blur: Width of a box filter in pixels, against noise.

    Returns:
        Whether the filtered image differs by more than `BACKGROUND_TOLERANCE` in a channel.
    """
    distance = cv2.absdiff(cv2.blur(image, (blur, blur)), np.full_like(image, round(255 * background)))
    largest = cv2.max(cv2.max(distance[..., 0], distance[..., 1]), distance[..., 2])
    return largest > 255 * BACKGROUND_TOLERANCE


def read_rgb(file: Path, background: float = 1.0) -> Float32[np.ndarray, "h w 3"]:
    """Read a colour image; one with an alpha channel is composited on the background.

    Args:
        file: Image file.
        background: Grey value in [0, 1].

    Returns:
        sRGB values in [0, 1].

    Raises:
        InputError: If the file is missing or not an image.
    """
    return read_rgb8(file, background).astype(np.float32) / 255


def read_grey8(file: Path) -> UInt8[np.ndarray, "h w"]:
    """Read a matte or mask: grey values, or the opacity of a picture that was cut out.

    Args:
        file: Image file.

    Returns:
        Values from 0 to 255: of an alpha channel that is not the same everywhere, else the brightness.

    Raises:
        InputError: If the file is missing or not an image.
    """
    pixels = _eight_bits(read_pixels(file))
    if pixels.ndim == 2:
        return pixels
    if pixels.shape[2] == 4 and pixels[..., 3].min() < pixels[..., 3].max():
        return np.ascontiguousarray(pixels[..., 3])
    return cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), cv2.COLOR_BGR2GRAY)


def read_grey(file: Path) -> Float32[np.ndarray, "h w"]:
    """Read a matte or mask, as `read_grey8`.

    Args:
        file: Image file.

    Returns:
        Values in [0, 1].

    Raises:
        InputError: If the file is missing or not an image.
    """
    return read_grey8(file).astype(np.float32) / 255


def write_png(file: Path, image: Float[np.ndarray, "h w *c"]) -> None:
    """Write an 8-bit image; values are clipped to [0, 1] and rounded to the nearest of 256 levels.

    Args:
        file: PNG file.
        image: RGB (h, w, 3) or grey (h, w) values in [0, 1].

    Raises:
        OSError: If the file cannot be written.
    """
    levels = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
    if levels.ndim == 3:
        levels = np.ascontiguousarray(levels[:, :, ::-1])
    Path(file).write_bytes(cv2.imencode(".png", levels)[1].tobytes())


def read_bits(file: Path) -> UInt16[np.ndarray, "h w"]:
    """Read a 16-bit grey image that stores a bit field per pixel.

    Args:
        file: Image file.

    Returns:
        The bit fields.

    Raises:
        InputError: If the file is missing or not a 16-bit grey image.
    """
    pixels = read_pixels(file)
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise InputError(f"{pixels.dtype} {pixels.shape}, expected a 16-bit grey image", file=file)
    return pixels


def write_bits(file: Path, pixels: UInt16[np.ndarray, "h w"]) -> None:
    """Write a bit field per pixel as a 16-bit grey image.

    Args:
        file: PNG file.
        pixels: The bit fields.

    Raises:
        OSError: If the file cannot be written.
    """
    Path(file).write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
