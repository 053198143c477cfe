"""Mattes against the silhouette of the posed mesh: the mesh lies inside, hair and shoulders may stand out."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from carigs.capture import Capture
from carigs.plausibility.findings import Finding
from carigs.plausibility.images import OPAQUE
from carigs.plausibility.views import View

TOLERANCE = 0.02
"""Of an outline, in sizes of the head's silhouette (square root of its area): 4 mm."""
OVERHANG = 0.03
"""Share of the head's silhouette that may lie outside the matte by more than the tolerance. A mesh that is shifted by
x sizes, has about x - TOLERANCE of its silhouette there: this is a shift by 1 cm."""


def matte_findings(
    capture: Capture, view: View, matte: UInt8[np.ndarray, "h w"], head: Bool[np.ndarray, "f"]
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
    area = int(silhouette.sum())
    if area == 0 or not (matte >= OPAQUE).any():  # an empty matte has a finding of its own
        return []
    radius = max(1, round(TOLERANCE * np.sqrt(area)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    near = cv2.dilate((matte >= OPAQUE).astype(np.uint8), disc) > 0
    share = float((silhouette & ~near).sum()) / area
    if share <= OVERHANG:
        return []
    kind = "the projected mesh lies outside the matte; see the matte, the camera and the head parameters"
    details = f"{share:.0%} of the head of frame {view.frame.name}"
    return [Finding(kind, capture.root / view.frame.mask, "fg_mask_path", details, share)]
