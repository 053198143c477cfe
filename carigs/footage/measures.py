"""Measures of each frame, found in one pass: sharpness, exposure, white balance, and changes between frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8

from carigs.capture.evenly_spread import evenly_spread
from carigs.footage.footage import TimedFrame

THUMBNAIL = 64
"""Side of the small images that frames are compared by, in pixels: they hide noise and keep the layout."""
MEDIAN_FRAMES = 64
"""Frames that the median image is made of."""
DARK = 8.0
"""Levels added to both sides of a ratio of brightness, so that noise in the dark does not count."""


FLAT = 5.0
"""Deviation in levels, added to both images of a correlation: of a plain grey wall, noise and rounding are all that a
camera shows, and they never agree."""


class FrameMeasures(NamedTuple):
    """Measures of n frames."""

    times: Float[np.ndarray, " n"]
    """Seconds."""
    sharpness: Float[np.ndarray, " n"]
    """Variance of the Laplacian of the brightness in levels of 8 bits (Pech-Pacheco et al. 2000)."""
    exposure: Float[np.ndarray, " n"]
    """Brightness against the median frame in stops, by the median pixel: a head that moves changes few pixels."""
    white_balance: Float[np.ndarray, "n 2"]
    """Red and blue against green, against the median frame, in stops."""
    change: Float[np.ndarray, " n"]
    """Mean difference from the frame before, in levels of 8 bits, at a quarter of the size; infinite for the first."""
    layout_change: Float[np.ndarray, " n"]
    """1 - correlation with the small image of the frame before, whatever the brightness; 0 for the first."""
    combing: Float[np.ndarray, " n"]
    """How much lines differ from those between them: above 1 for interlaced frames with motion."""
    thumbnails: UInt8[np.ndarray, "n s s 3"]
    """The frames, reduced to `THUMBNAIL` pixels a side."""


def measure_frames(
    frames: Iterable[TimedFrame], face_box: Callable[[TimedFrame], tuple[int, int, int, int] | None] | None = None
) -> FrameMeasures:
    """Measure frames in one pass; of each, only a small image is kept.

    Args:
        frames: The frames, in order.
        face_box: Gives left, top, right and bottom of the face in pixels, or None; sharpness is measured in it, else in
            the whole image.

    Returns:
        The measures.
    """
    times, sharpness, change, layout, combing, thumbnails = [], [], [], [], [], []
    small_before = None
    for frame in frames:
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
        box = face_box(frame) if face_box else None
        part = grey[box[1] : box[3], box[0] : box[2]] if box else grey
        times.append(frame.time)
        sharpness.append(float(cv2.Laplacian(part, cv2.CV_32F).var()) if part.size else 0.0)
        combing.append(_combing(grey))
        height, width = grey.shape
        quarter = (max(width // 4, 1), max(height // 4, 1))
        small = cv2.resize(grey, quarter, interpolation=cv2.INTER_AREA).astype(np.float32)
        thumbnail = cv2.resize(frame.image, (THUMBNAIL, THUMBNAIL), interpolation=cv2.INTER_AREA)
        if small_before is None:
            change.append(np.inf)
            layout.append(0.0)
        else:
            change.append(float(np.abs(small - small_before).mean()))
            layout.append(1 - correlation(thumbnails[-1], thumbnail))
        small_before = small
        thumbnails.append(thumbnail)
    exposure, white_balance = _against_median(thumbnails)
    return FrameMeasures(
        *(np.array(values, np.float64) for values in (times, sharpness)),
        exposure,
        white_balance,
        *(np.array(values, np.float64) for values in (change, layout, combing)),
        np.array(thumbnails, np.uint8).reshape(-1, THUMBNAIL, THUMBNAIL, 3),
    )


def _combing(grey: UInt8[np.ndarray, "h w"]) -> float:
    """Second differences over one line against those over two lines, where they are largest."""
    if len(grey) < 5:
        return 0.0
    lines = grey.astype(np.int16)
    fine = np.abs(2 * lines[2:-2] - lines[1:-3] - lines[3:-1])
    coarse = np.abs(2 * lines[2:-2] - lines[:-4] - lines[4:])
    strong = fine + coarse > 40  # edges; noise is about as large over one line as over two
    return float(fine[strong].mean() / max(coarse[strong].mean(), 1)) if strong.mean() > 1e-3 else 0.0


def correlation(first: Shaped[np.ndarray, "*s 3"], second: Shaped[np.ndarray, "*s 3"]) -> float:
    """Compare two small images, or the same pixels of both, whatever their brightness and contrast.

    Args:
        first: Levels of 8 bits.
        second: The same of the other one.

    Returns:
        The correlation of their values; nearly 1 for two images without contrast, of which a camera's noise is left.
    """
    a, b = (image.astype(np.float64).ravel() - image.mean() for image in (first, second))
    length = np.sqrt((a @ a) * (b @ b))
    flat = FLAT**2 * np.sqrt(len(a) * len(b))
    return float((a @ b + flat) / (length + flat))


def _against_median(
    thumbnails: list[UInt8[np.ndarray, "h w 3"]],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Exposure and white balance of small images, in stops."""
    if not thumbnails:
        return np.zeros(0), np.zeros((0, 2))
    median = np.log2(np.median(evenly_spread(thumbnails, MEDIAN_FRAMES), axis=0) + DARK)
    ratios = [np.median((np.log2(image + DARK) - median).reshape(-1, 3), axis=0) for image in thumbnails]
    stops = np.array(ratios)
    return stops.mean(axis=1), stops[:, [0, 2]] - stops[:, [1]]
