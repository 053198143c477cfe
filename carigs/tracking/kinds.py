"""Which kind of footage a recording is: a person who talks, a camera that circles a still one, or one moment."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.footage import Selection, read_photographs
from carigs.footage.measures import measure_frames
from carigs.footage.photographs import image_files
from carigs.readers.images import read_header
from carigs.tracking.judgement.quality import openings
from carigs.tracking.recording import Recording

AUTO, TALK, ORBIT, PHOTOGRAPHS = "auto", "talk", "orbit", "photographs"
"""To be found out; a person who talks before one or more cameras that stand still; a camera that circles a person who
keeps still; photographs of one moment."""
ALIKE = 0.05
"""Median change of the layout from one image of a folder to the next, below which they are frames of a video."""
SWEEP = 0.5
"""Way of the background through the image, in widths of it, from which a camera circles or pans."""
STILL_MOUTH = 0.05
"""Change of the mouth's opening, in distances of the eyes' outer corners, up to which a face keeps still."""
SIDE, CORNERS, LEAST_CORNERS = 320, 200, 12
"""Width that images are reduced to, and corners that are followed in them."""
PERSON = 1.0
"""Around the box of the face, in its size: hair, neck and shoulders."""


def why_photographs(folder: Path) -> str:
    """Find out whether images are photographs of one moment, or frames of a video.

    Args:
        folder: The images.

    Returns:
        Why they are photographs, in words; empty if they are not.

    Raises:
        InputError: If there are no images, or damaged ones.
    """
    headers = [read_header(file) for file in image_files(folder)]
    if len(headers) == 1:
        return "there is one image"
    if len({tuple(sorted((header.width, header.height))) for header in headers}) > 1:
        return "the images have several sizes"
    change = float(np.median(measure_frames(read_photographs(folder, Selection(largest_side=SIDE))).layout_change[1:]))
    return f"each image differs from the one before (by {change:.2f} of 1)" if change > ALIKE else ""


def why_orbit(recording: Recording) -> str:
    """Find out whether a camera circles a person who keeps still.

    Args:
        recording: What one camera recorded.

    Returns:
        Why it does, in words; empty if it does not.
    """
    faces = recording.faces
    mouth, _ = openings(faces.landmarks[faces.found].astype(np.float64))
    if not len(mouth) or float(np.subtract(*np.percentile(mouth, (95, 5)))) > STILL_MOUTH:
        return ""
    swept = background_sweep(recording)
    if swept < SWEEP:
        return ""
    return f"the background moves through the image by {swept:.1f} of its widths, and the mouth keeps still"


def background_sweep(recording: Recording) -> float:
    """How far the background moves through the image from the first frame to the last.

    Args:
        recording: What one camera recorded.

    Returns:
        Sum of the median horizontal motions of corners beside the person (Lucas and Kanade 1981), in widths of the
        image; 0 for a background without corners.
    """
    total, before = 0.0, None
    box = np.full(4, np.nan)
    for image, found in zip(recording.footage.decode(), recording.faces.boxes, strict=True):
        height, width = image.shape[:2]
        scale = SIDE / width
        grey = cv2.cvtColor(cv2.resize(image, (SIDE, max(round(height * scale), 1))), cv2.COLOR_RGB2GRAY)
        if before is not None:
            total += _median_motion(before, grey, box * scale)
        before, box = grey, np.where(np.isfinite(found), found, box)
    return abs(total) / SIDE


def _median_motion(
    before: UInt8[np.ndarray, "h w"], after: UInt8[np.ndarray, "h w"], box: Float[np.ndarray, "4"]
) -> float:
    """Median horizontal motion of corners beside the person, in pixels; 0 with too few corners."""
    beside = np.full_like(before, 255)
    if np.isfinite(box).all():
        left, top, right = box[:3]
        margin = PERSON * (right - left)
        beside[max(int(top - margin), 0) :, max(int(left - margin), 0) : max(int(right + margin), 0)] = 0
    corners = cv2.goodFeaturesToTrack(before, CORNERS, 0.02, 5, mask=beside)
    if corners is None or len(corners) < LEAST_CORNERS:
        return 0.0
    moved, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None)
    kept = found[:, 0] > 0
    return float(np.median((moved - corners)[kept, 0, 0])) if kept.sum() >= LEAST_CORNERS else 0.0
