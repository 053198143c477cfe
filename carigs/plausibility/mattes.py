"""Mattes against the silhouette of the posed mesh and against the foreground of the images.

The mesh lies inside the matte; hair and shoulders may stand out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Int64, UInt8

from carigs.capture import Capture, Frame
from carigs.capture.image_checks import OPAQUE
from carigs.capture.images import differs_from_background
from carigs.plausibility.findings import Finding
from carigs.plausibility.views import MeshView

TOLERANCE = 0.02
"""Of an outline, in sizes of the head's silhouette (square root of its area): 4 mm."""
OVERHANG = 0.03
"""Share of the head's silhouette that may lie outside the matte by more than the tolerance. A mesh that is shifted by
x sizes, has about x - TOLERANCE of its silhouette there: this is a shift by 1 cm."""

BETTER = np.sqrt(0.5)
"""The matte of another timestep is believed to be the right one if it leaves less than this share of the pixels that
differ from the image's foreground. Of the right matte, only the soft edge differs."""
OUTLINE = 0.01
"""Least gain of another matte, as a share of the foreground: an outline that moves by 0.25 % of the diameter of a disc.
Where few pixels of an outline are in the image, chance decides which of them differ."""
LEAST_PIXELS = 32
"""Least gain in pixels, for the same reason at low resolutions."""
BOTH_SIDES = 0.25
"""Share of the gain that the image has beyond its matte, and that its matte has beyond the image, where a head moved
from one to the other. Blurred images have only the first, and grown mattes the second."""
UNUSUAL = 1.5
"""A difference on one side alone, as of an opened mouth, counts if it is this times the camera's median."""
EXCHANGE = "give the frames the mattes of their images"
MAX_PIXELS = 1 << 18
"""Larger masks are compared at every second pixel, every third ..."""


class ForegroundBits(NamedTuple):
    """Foreground of an image and of its matte, packed into bits."""

    image: UInt8[np.ndarray, " n"]
    matte: UInt8[np.ndarray, " n"]


def outlines(image: UInt8[np.ndarray, "h w 3"], matte: UInt8[np.ndarray, "h w"], background: float) -> ForegroundBits:
    """Find the foreground in an image and in its matte.

    Args:
        image: RGB values from 0 to 255.
        matte: Opacities from 0 to 255.
        background: Grey value of the background from 0 to 1.

    Returns:
        Both, packed.
    """
    step = max(1, int(np.ceil(np.sqrt(matte.size / MAX_PIXELS))))
    seen = differs_from_background(image, background, 1)  # unfiltered: a filter widens the outline
    return ForegroundBits(np.packbits(seen[::step, ::step]), np.packbits(matte[::step, ::step] >= OPAQUE))


def exchanged_mattes(capture: Capture, known: Mapping[Frame, ForegroundBits]) -> list[Finding]:
    """Find images to which the matte of another timestep of their camera belongs.

    Args:
        capture: The capture.
        known: Foregrounds by frame.

    Returns:
        What is likely to be wrong.
    """
    cameras: dict[int, list[Frame]] = {}
    for frame in known:
        cameras.setdefault(frame.camera, []).append(frame)
    findings = []
    for frames in cameras.values():
        images, mattes = (np.stack(masks) for masks in zip(*(known[frame] for frame in frames), strict=True))
        usual = np.median(_pixels(images ^ mattes))
        for k, frame in enumerate(frames):
            different = _pixels(images[k] ^ mattes)
            best, own = int(different.argmin()), int(different[k])
            gain, least = own - different[best], max(OUTLINE * int(_pixels(mattes[k])), LEAST_PIXELS)
            sides = _pixels(images[k] & ~mattes[k]), _pixels(mattes[k] & ~images[k])
            moved = min(sides) > BOTH_SIDES * gain or own > UNUSUAL * usual
            if different[best] < BETTER * own and gain > least and moved:
                kind = "the matte of another timestep fits the image better than its own"
                details = f"{frames[best].mask} differs at {different[best]} pixels, its own at {own}"
                findings.append(Finding(kind, capture.root / frame.mask, "fg_mask_path", details, EXCHANGE, float(own)))
    return findings


def _pixels(masks: UInt8[np.ndarray, "*t n"]) -> Int64[np.ndarray, "*t"]:
    """Number of pixels in each packed mask."""
    return np.asarray(np.bitwise_count(masks).sum(axis=-1, dtype=np.int64))


def matte_findings(
    capture: Capture, view: MeshView, matte: UInt8[np.ndarray, "h w"], head: Bool[np.ndarray, " f"]
) -> list[Finding]:
    """Compare a matte with the silhouette of the mesh.

    Args:
        capture: The capture.
        view: What the camera sees of the mesh.
        matte: The matte, from 0 to 255.
        head: Faces above the neck.

    Returns:
        What is likely to be wrong.
    """
    face = view.visibility.face
    silhouette = (face >= 0) & head[face]
    rows = np.flatnonzero((matte >= OPAQUE).any(axis=1))
    area = int(silhouette.sum())
    if area == 0 or len(rows) == 0:  # an empty matte has a finding of its own
        return []
    silhouette[rows[-1] + 1 :] = False  # GaussianAvatars' mattes end at a horizontal line below the head
    radius = max(1, round(TOLERANCE * np.sqrt(area)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    near = cv2.dilate((matte >= OPAQUE).astype(np.uint8), disc) > 0
    share = float((silhouette & ~near).sum()) / area
    if share <= OVERHANG:
        return []
    kind = "the projected mesh lies outside the matte; see the matte, the camera and the head parameters"
    details = f"{share:.0%} of the head of frame {view.frame.name}"
    remedy = "compare the tracking and the intrinsics of these frames with the others'"
    return [Finding(kind, capture.root / view.frame.mask, "fg_mask_path", details, remedy, share)]
