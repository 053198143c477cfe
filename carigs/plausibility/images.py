"""Images and mattes are decoded whole once; what is measured meanwhile needs no mesh.

Of a large capture, that is done for evenly spread timesteps. (The header and the end of every image have been read.)
"""

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
from carigs.capture.image_checks import OPAQUE, RESTORE, other_size
from carigs.capture.images import BACKGROUND_TOLERANCE, differs_from_background
from carigs.capture.thinning import spread_timesteps
from carigs.errors import InputError, collecting
from carigs.plausibility.findings import Finding
from carigs.readers.images import ImageHeader

CLEAR = 2
"""Value of a matte up to which a pixel is background."""
BLUR = 5
"""Width of a box filter in pixels; noise and compression then stay below `BACKGROUND_TOLERANCE`."""
OUTSIDE = 0.05
"""Pixels outside the matte that do not show the background, over the foreground's pixels: an outline that is off by
1.2 % of the diameter of a disc."""
INSIDE = 0.5
"""Share of the foreground that shows the background's colour. White clothes before white are less."""
EXPORT = "export the image again, or remove the frame"
OPACITIES = "write opacities from 0 (background) to 255 (foreground)"
THUMBNAIL = 8
MAX_DECODED = 3000
"""Frames that are decoded, all of a smaller capture: a minute for images of 802x550."""


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


def summarize_images(capture: Capture, errors: list[InputError] | None = None) -> dict[Frame, ImageSummary]:
    """Decode images and mattes.

    Args:
        capture: The capture.
        errors: Receives the errors of frames, which are left out then; None to raise the first.

    Returns:
        A summary per decoded frame: of all frames, or of `MAX_DECODED` at evenly spread timesteps.

    Raises:
        InputError: If a file is damaged, or has another size than its camera.
    """

    def summarize(frame: Frame) -> ImageSummary | None:
        with collecting(errors, RESTORE):
            image, matte = read_frame(capture, frame)
            return _summary(image, matte, capture.background)
        return None

    timesteps = set(spread_timesteps(capture.frames, MAX_DECODED))
    frames = [frame for frame in capture.frames if frame.timestep in timesteps]
    with ThreadPoolExecutor(2) as pool:
        done = track(pool.map(summarize, frames), "checking images", len(frames), disable=len(frames) < 1000)
        return {frame: summary for frame, summary in zip(frames, done, strict=True) if summary is not None}


def read_frame(capture: Capture, frame: Frame) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"] | None]:
    """Read an image and its matte, and check their sizes.

    Args:
        capture: The capture.
        frame: One of its frames.

    Returns:
        RGB values, and opacities or None, from 0 to 255.

    Raises:
        InputError: If a file is damaged, or has another size than its camera.
    """
    camera, image, matte = capture.camera(frame), capture.image8(frame), capture.mask8(frame)
    _check_size(image, camera, capture.root / frame.image)
    if matte is not None:
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
    findings, known, without = [], {}, []
    stated = f"the background is stated as {capture.background:g}"
    for frame, seen in summaries.items():
        image, matte = capture.root / frame.image, capture.root / (frame.mask or frame.image)
        if frame.mask is not None and seen.foreground < 1e-3:  # an alpha channel then hides the colours
            details = f"{seen.foreground:.1%} of the pixels"
            findings.append(Finding("the matte is empty", matte, "", details, OPACITIES))
        elif seen.plain:
            findings.append(Finding("the image has one colour", image, "", frame.name, EXPORT))
        elif frame.mask is None:
            without.append(frame)
        elif seen.inside > (0.1 if seen.foreground > 0.99 else INSIDE):
            details = f"{seen.inside:.0%} of its foreground show the background; {stated}"
            kind = "the matte is foreground where the image shows the background"
            findings.append(Finding(kind, matte, "", details, OPACITIES, seen.inside))
        if seen.outside > OUTSIDE and abs(seen.colour_outside - capture.background) > BACKGROUND_TOLERANCE:
            details = f"grey value {seen.colour_outside:.2f}, {stated}"
            kind = "outside the matte, the image does not show the stated background"
            remedy = "state the background of the images (--background, capture.background)"
            findings.append(Finding(kind, image, "capture.background", details, remedy, seen.outside))
        elif seen.outside > OUTSIDE and seen.foreground >= 1e-3:
            details = f"as many pixels as {seen.outside:.0%} of its foreground"
            kind = "the image shows more than the background outside the matte"
            remedy = "composite the images on the background with their mattes"
            findings.append(Finding(kind, image, "fg_mask_path", details, remedy, seen.outside))
        other = known.setdefault(seen.digest, frame)
        if other is not frame and not seen.plain and other.camera != frame.camera:
            details = f"cameras {other.camera} and {frame.camera}"
            findings.append(Finding(f"holds the same pixels as {other.image}", image, "", details, EXPORT))
    if without:
        details = f"{len(without)} of {len(summaries)} frames, for example {without[0].name}"
        kind = "frames have no matte: what differs from the background counts as foreground"
        remedy = "export mattes and name them by fg_mask_path"
        findings.append(Finding(kind, capture.root, "fg_mask_path", details, remedy))
    return findings


def _check_size(pixels: np.ndarray, camera: Camera, file: Path) -> None:
    height, width = pixels.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise other_size(ImageHeader(width, height), camera, file)


def _summary(
    image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"] | None, background: float
) -> ImageSummary:
    if matte is None:  # the measures below then hold for every image
        matte = 255 * differs_from_background(image, background).astype(np.uint8)
    foreground = matte >= OPAQUE
    count = int(foreground.sum())
    kernel = np.ones((BLUR + 2, BLUR + 2), np.uint8)
    outside = cv2.dilate(matte, kernel) <= CLEAR
    core = cv2.erode(matte, kernel) >= OPAQUE
    other = differs_from_background(image, background, BLUR)
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
