"""Every image and matte is decoded whole once; what is measured meanwhile needs no mesh."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from rich.progress import track

from carigs.capture import Camera, Capture, Frame
from carigs.capture.images import read_rgb8
from carigs.errors import InputError
from carigs.plausibility.findings import Finding
from carigs.readers.images import read_pixels

OPAQUE, CLEAR = 128, 2
"""Values of a matte from which a pixel is foreground, and up to which it is background."""
COLOUR_TOLERANCE = 0.1
"""Difference from the background's colour that no noise or compression makes once `BLUR` pixels are averaged."""
BLUR = 5
"""Width of the box filter in pixels."""
OUTSIDE = 0.05
"""Pixels outside the matte that do not show the background, over the foreground's pixels: an outline that is off by
1.2 % of the diameter of a disc."""
INSIDE = 0.5
"""Share of the foreground that shows the background's colour. White clothes before white are less."""
THUMBNAIL = 8


class ImageSummary(NamedTuple):
    """What is kept of an image and its matte."""

    thumbnail: Float32[np.ndarray, "8 8 3"]
    digest: bytes
    """Of the pixels."""
    foreground: float
    """Share of the pixels that are foreground in the matte."""
    outside: float
    """Pixels outside the matte that do not show the background, over the number of the foreground's pixels."""
    inside: float
    """Share of the foreground's pixels that show the background's colour."""
    colour_outside: float
    """Median grey value outside the matte; NaN if there is no such pixel."""
    plain: bool
    """Whether all pixels have one colour."""


def summarize_images(capture: Capture) -> dict[Frame, ImageSummary]:
    """Decode all images and mattes.

    Args:
        capture: The capture.

    Returns:
        A summary per frame.

    Raises:
        InputError: If a file is damaged, or has another size than its camera.
    """

    def summarize(frame: Frame) -> ImageSummary:
        image, matte = read_frame(capture, frame)
        return _summary(image, matte, capture.background)

    with ThreadPoolExecutor(2) as pool:
        done = pool.map(summarize, capture.frames)
        few = len(capture.frames) < 1000
        return dict(zip(capture.frames, track(done, "checking images", len(capture.frames), disable=few), strict=True))


def read_frame(capture: Capture, frame: Frame) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"]]:
    """Read an image and its matte, and check their sizes.

    Args:
        capture: The capture.
        frame: One of its frames.

    Returns:
        RGB values, and opacities, from 0 to 255.

    Raises:
        InputError: If a file is damaged, or has another size than its camera.
    """
    camera = capture.cameras[frame.camera]
    image = read_rgb8(capture.root / frame.image)
    matte = read_pixels(capture.root / frame.mask, cv2.IMREAD_GRAYSCALE)
    _check_size(image, camera, capture.root / frame.image)
    _check_size(matte, camera, capture.root / frame.mask)
    return image, matte


def check_images(capture: Capture, summaries: dict[Frame, ImageSummary]) -> list[Finding]:
    """Compare images with their mattes and with the stated background.

    Args:
        capture: The capture.
        summaries: Summaries of the frames.

    Returns:
        What is likely to be wrong.
    """
    findings, known = [], {}
    stated = f"the background is stated as {capture.background:g}"
    for frame, seen in summaries.items():
        image, matte = capture.root / frame.image, capture.root / frame.mask
        if seen.plain:
            findings.append(Finding("the image has one colour", image, "", frame.name))
        elif seen.foreground < 1e-3:
            findings.append(Finding("the matte is empty", matte, "", f"{seen.foreground:.1%} of the pixels"))
        elif seen.inside > (0.1 if seen.foreground > 0.99 else INSIDE):
            details = f"{seen.inside:.0%} of its foreground show the background; {stated}"
            kind = "the matte is foreground where the image shows the background"
            findings.append(Finding(kind, matte, "", details, seen.inside))
        if seen.outside > OUTSIDE and abs(seen.colour_outside - capture.background) > COLOUR_TOLERANCE:
            details = f"grey value {seen.colour_outside:.2f}, {stated}"
            kind = "outside the matte, the image does not show the stated background"
            findings.append(Finding(kind, image, "capture.background", details, seen.outside))
        elif seen.outside > OUTSIDE and seen.foreground >= 1e-3:
            details = f"as many pixels as {seen.outside:.0%} of its foreground"
            kind = "the image shows more than the background outside the matte"
            findings.append(Finding(kind, image, "fg_mask_path", details, seen.outside))
        other = known.setdefault(seen.digest, frame)
        if other is not frame and not seen.plain and other.camera != frame.camera:
            details = f"cameras {other.camera} and {frame.camera}"
            findings.append(Finding(f"holds the same pixels as {other.image}", image, "", details))
    return findings


def shows_foreground(image: UInt8[np.ndarray, "h w 3"], background: float, blur: int) -> Bool[np.ndarray, "h w"]:
    """Find the pixels that do not have the background's colour.

    Args:
        image: RGB values from 0 to 255.
        background: Grey value from 0 to 1.
        blur: Width of a box filter in pixels, against noise.

    Returns:
        Whether the filtered image differs by more than `COLOUR_TOLERANCE` in a channel.
    """
    distance = cv2.absdiff(cv2.blur(image, (blur, blur)), np.full_like(image, round(255 * background)))
    largest = cv2.max(cv2.max(distance[..., 0], distance[..., 1]), distance[..., 2])
    return largest > 255 * COLOUR_TOLERANCE


def _check_size(pixels: np.ndarray, camera: Camera, file: Path) -> None:
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(f"{width} x {height} pixels, its camera has {camera.width} x {camera.height}", file=file)


def _summary(image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"], background: float) -> ImageSummary:
    foreground = matte >= OPAQUE
    count = int(foreground.sum())
    kernel = np.ones((BLUR + 2, BLUR + 2), np.uint8)
    outside = cv2.dilate(matte, kernel) <= CLEAR
    core = cv2.erode(matte, kernel) >= OPAQUE
    other = shows_foreground(image, background, BLUR)
    return ImageSummary(
        thumbnail=cv2.resize(image, (THUMBNAIL, THUMBNAIL), interpolation=cv2.INTER_AREA).astype(np.float32) / 255,
        digest=hashlib.blake2b(image.tobytes(), digest_size=16).digest(),
        foreground=count / matte.size,
        outside=int((other & outside).sum()) / max(count, 1),
        inside=int((~other & core).sum()) / max(count, 1),
        colour_outside=_median_grey(image, outside),
        plain=not cv2.absdiff(image, np.full_like(image, image[0, 0])).any(),
    )


def _median_grey(image: UInt8[np.ndarray, "h w 3"], where: Bool[np.ndarray, "h w"]) -> float:
    colours = image[where]
    return float(np.median(colours[:: max(1, len(colours) // 1000)])) / 255 if len(colours) else float("nan")
