"""Mattes and images whose outlines are wrong: which cameras have them, and what is changed when they are read.

All frames of a camera were cut out by one method: the medians over some frames count. Mattes of cameras with a halo are
believed to be right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from carigs.capture import Capture
from carigs.capture.corrections.halo import Halo
from carigs.capture.corrections.known_background import outline_reach
from carigs.capture.thinning import spread_timesteps
from carigs.errors import InputError
from carigs.plausibility.findings import Finding
from carigs.plausibility.halos import fit_halo, outline_pixels
from carigs.plausibility.matte_outlines import OutlineError, outline_error

VIEWS = 64
"""Frames that are looked at, at evenly spread timesteps, all of a smaller capture."""
TOLERANCE = 1 / 1000
"""Error of an outline that is accepted, as a share of the image's diagonal."""
LEAST_TOLERANCE = 0.5
"""The same in pixels, at least. Sound mattes are off by 0.3 pixels at most."""
REMADE = (
    "none is needed: mattes are made anew near the outline (capture.mend_outlines); export mattes that fit the images"
)
REMOVED = (
    "none is needed: it is removed from training frames (capture.mend_outlines); "
    "composite images with the colours of the foreground"
)
EXPORT = "export mattes that fit the images"


class CameraOutlines(NamedTuple):
    """What is wrong with the outlines of a camera."""

    error: OutlineError | None
    """Of its mattes; None if it is not known or small."""
    halo: Halo | None
    """Of its images."""
    remade: bool
    """Whether the mattes can be made anew: their outlines are near the true ones."""


def measure_outlines(capture: Capture) -> dict[int, CameraOutlines]:
    """Compare the outlines of mattes and images.

    Args:
        capture: The capture.

    Returns:
        Cameras for which something is wrong, by their number.
    """
    timesteps = set(spread_timesteps(capture.frames, VIEWS))
    errors: dict[int, list[OutlineError]] = {}
    pixels: dict[int, list] = {}
    for frame in capture.frames:
        if frame.timestep not in timesteps or frame.mask is None:
            continue
        try:
            image, matte = capture.image8(frame), capture.mask8(frame)
        except InputError:  # other checks name it
            continue
        error = outline_error(image, matte, capture.background)
        if error is not None:
            errors.setdefault(frame.camera, []).append(error)
            pixels.setdefault(frame.camera, []).append(outline_pixels(image, matte))
    found = {}
    for camera, of_frames in errors.items():
        halo = fit_halo(pixels[camera], capture.background)
        shape = capture.cameras[camera].height, capture.cameras[camera].width
        median = OutlineError(*np.median(of_frames, axis=0).tolist())
        limit = max(LEAST_TOLERANCE, TOLERANCE * float(np.hypot(*shape)))
        wrong = halo is None and max(abs(median.offset), median.spread) > limit
        if wrong or halo is not None:
            near = wrong and max(abs(median.offset), median.spread) < outline_reach(shape) - 2
            found[camera] = CameraOutlines(median if wrong else None, halo, near)
    return dict(sorted(found.items()))


def mend_outlines(capture: Capture, outlines: Mapping[int, CameraOutlines]) -> Capture:
    """Let mattes be made anew, and halos be removed from training frames, when they are read.

    Images that are held out stay as they are: metrics compare with them.

    Args:
        capture: The capture.
        outlines: What is wrong with its cameras.

    Returns:
        The capture; the same if nothing is wrong.
    """
    if not outlines:
        return capture
    frames = []
    for frame in capture.frames:
        wrong = outlines.get(frame.camera)
        if wrong is not None and frame.mask is not None:
            frame = replace(frame, remade=wrong.remade, halo=wrong.halo if frame.split == "train" else None)
        frames.append(frame)
    return replace(capture, frames=tuple(frames))


def outline_findings(capture: Capture, outlines: Mapping[int, CameraOutlines]) -> list[Finding]:
    """Describe what is wrong with outlines.

    Args:
        capture: The capture.
        outlines: What is wrong with its cameras.

    Returns:
        What is likely to be wrong.
    """
    findings = []
    for camera, (error, halo, remade) in outlines.items():
        field = f"camera {camera}"
        if halo is not None:
            kind = "the outline shows the colour of an old background"
            details = f"RGB {', '.join(str(round(255 * c)) for c in halo.colour)}"
            findings.append(Finding(kind, capture.root, field, details, REMOVED))
        elif error is not None:
            size = max(error.spread, abs(error.offset))
            kind = "mattes are softer or harder than the outline of the foreground in the images"
            if size > error.spread:
                place = "outside" if error.offset > 0 else "inside"
                kind = f"mattes end {place} the outline of the foreground in the images"
            details = f"by {size:.1f} pixels"
            findings.append(Finding(kind, capture.root, field, details, REMADE if remade else EXPORT, size))
    return findings
