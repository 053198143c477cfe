"""One picture with the worst and some typical frames, the outline of the fitted mesh, and the landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from carigs.capture.evenly_spread import evenly_spread
from carigs.tracking.judgement.quality import TrackedFrames

WORST, TYPICAL = 4, 8
"""Frames that are shown."""
COLUMNS, SIDE, LINE = 4, 320, 20
"""Frames in a row, width and height of each, and height of a line of text, in pixels."""
MARGIN = 0.12
"""Around the head, in its size."""
OUTLINE, FOUND, ERROR = (60, 230, 60), (255, 220, 0), (255, 40, 40)
"""RGB of the mesh's outline, of landmarks, and of the lines from them to the fitted head."""
SUB, BITS = 16, 4
"""OpenCV draws at fractions of a pixel."""


@dataclass(frozen=True)
class Overlay:
    """What is drawn into a frame."""

    image: UInt8[np.ndarray, "h w 3"]
    """sRGB."""
    vertices: Float[np.ndarray, "v 2"]
    """Projections of the fitted head, in pixels (pixel centres at +0.5)."""
    landmarks: Float[np.ndarray, "p 2"]
    """As found; NaN where there is none."""
    fitted: Float[np.ndarray, "p 2"]
    """The same points of the fitted head."""


def frames_to_show(frames: TrackedFrames) -> tuple[list[int], list[int]]:
    """Choose frames: only these must be decoded again.

    Args:
        frames: The frames of one camera.

    Returns:
        Positions of the worst frames, the worst first, none beside another one; and of frames spread evenly over the
        others.
    """
    error = np.where(frames.tracked, frames.error, np.nan)
    known = np.flatnonzero(np.isfinite(error))
    apart = max(len(known) // 20, 1)
    worst: list[int] = []
    for position in known[np.argsort(-error[known], kind="stable")]:
        if len(worst) < WORST and all(abs(position - other) >= apart for other in worst):
            worst.append(int(position))
    others = [int(position) for position in known if position not in worst]
    return worst, evenly_spread(others, TYPICAL)


def contact_sheet(
    frames: TrackedFrames, overlays: dict[int, Overlay], faces: Int[np.ndarray, "f 3"], title: str = ""
) -> UInt8[np.ndarray, "h w 3"]:
    """Draw frames with what was fitted to them.

    Args:
        frames: The frames of one camera.
        overlays: What to draw, by position among the frames: of all that `frames_to_show` names.
        faces: Triangles of the head.
        title: Line above.

    Returns:
        sRGB.
    """
    worst, typical = frames_to_show(frames)
    parts = [_text(title, COLUMNS * SIDE)] if title else []
    for name, chosen in (("worst frames", worst), ("frames in between", typical)):
        parts.append(_text(name, COLUMNS * SIDE))
        for first in range(0, len(chosen), COLUMNS):
            row = chosen[first : first + COLUMNS]
            cells = [np.vstack([_drawn(overlays[i], faces), _text(_caption(frames, i), SIDE, 0.42)]) for i in row]
            blank = np.full_like(cells[0], 255)
            parts.append(np.hstack([*cells, *[blank] * (COLUMNS - len(cells))]))
    return np.vstack(parts)


def _caption(frames: TrackedFrames, position: int) -> str:
    regions = {name: errors[position] for name, errors in frames.errors.items() if np.isfinite(errors[position])}
    largest = max(regions, key=regions.__getitem__)
    angles = f"yaw {frames.yaw[position]:+.0f} pitch {frames.pitch[position]:+.0f}"
    error = f"{frames.error[position]:.1f} px ({largest} {regions[largest]:.1f})"
    return f"{frames.numbers[position]}: {frames.times[position]:.1f} s, {angles}, {error}"


def _drawn(overlay: Overlay, faces: Int[np.ndarray, "f 3"]) -> UInt8[np.ndarray, "s s 3"]:
    """What the image shows of the head, with outline and landmarks."""
    height, width = overlay.image.shape[:2]
    low, high = (edge.clip(0, (width, height)) for edge in (overlay.vertices.min(axis=0), overlay.vertices.max(axis=0)))
    side = max(float((high - low).max()), 1.0) * (1 + 2 * MARGIN)
    scale, corner = SIDE / side, (low + high - side) / 2
    # Pixel centres lie at +0.5 here, and at whole numbers in OpenCV.
    cut = np.array(
        [[scale, 0, 0.5 * scale - 0.5 - scale * corner[0]], [0, scale, 0.5 * scale - 0.5 - scale * corner[1]]]
    )
    # A smaller picture is an average: warpAffine takes single pixels.
    source = cv2.GaussianBlur(overlay.image, (0, 0), 0.4 / scale) if scale < 1 else overlay.image
    picture = cv2.warpAffine(source, cut, (SIDE, SIDE), flags=cv2.INTER_LINEAR, borderValue=(255, 255, 255))

    def placed(points: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
        return np.rint(SUB * ((points - corner) * scale - 0.5)).astype(np.int32)

    cv2.drawContours(picture, _outline(placed(overlay.vertices), faces), -1, OUTLINE, 1, cv2.LINE_AA)
    known = np.isfinite(overlay.landmarks).all(axis=1)
    found, fitted = placed(overlay.landmarks[known]), placed(overlay.fitted[known])
    cv2.polylines(picture, list(np.stack([found, fitted], axis=1)), False, ERROR, 1, cv2.LINE_AA, BITS)
    for x, y in found.tolist():
        cv2.circle(picture, (x, y), SUB, FOUND, -1, cv2.LINE_AA, BITS)
    return picture


def _outline(points: Int[np.ndarray, "v 2"], faces: Int[np.ndarray, "f 3"]) -> Sequence[np.ndarray]:
    """Contours of what the triangles cover."""
    mask = np.zeros((SIDE, SIDE), np.uint8)
    for triangle in points[faces]:
        cv2.fillConvexPoly(mask, triangle, 1, cv2.LINE_8, BITS)
    return cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]


def _text(line: str, width: int, size: float = 0.5) -> UInt8[np.ndarray, "h w 3"]:
    strip = np.full((LINE, width, 3), 255, np.uint8)
    longest = cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]
    size *= min(1.0, (width - 8) / max(longest, 1))
    cv2.putText(strip, line, (4, LINE - 6), cv2.FONT_HERSHEY_SIMPLEX, size, (40, 40, 40), 1, cv2.LINE_AA)
    return strip
