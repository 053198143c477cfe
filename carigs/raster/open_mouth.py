"""Pixels of the open mouth."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool

from carigs.head import HeadModel
from carigs.raster.rasterizer import Visibility

INNER_LIPS = slice(60, 68)
"""Landmarks of the inner lips in the 68-point scheme of iBUG."""


def between_lips(visibility: Visibility, model: HeadModel) -> Bool[np.ndarray, "h w"]:
    """Find the pixels of the mesh within the outline of the inner lips.

    Args:
        visibility: What the camera sees of the posed head.
        model: The head model.

    Returns:
        The pixels; none if the model has no landmarks, or a landmark is behind the camera.
    """
    result = np.zeros(visibility.face.shape, bool)
    if model.landmarks68 is None:
        return result
    lips = model.landmarks68[INNER_LIPS].interpolate(visibility.camera_points)
    if not (lips[:, 2] > 0).all():
        return result
    fx, fy, cx, cy = visibility.camera.intrinsics
    pixels = lips[:, :2] / lips[:, 2:] * (fx, fy) + (cx, cy)
    outline = np.rint(pixels - 0.5).astype(np.int32)
    low = np.clip(outline.min(axis=0), 0, result.shape[::-1])
    high = np.clip(outline.max(axis=0) + 1, low, result.shape[::-1])
    box = slice(low[1], high[1]), slice(low[0], high[0])
    inside = np.zeros(result[box].shape, np.uint8)
    if inside.size:
        cv2.fillPoly(inside, [outline - low], 1)
        result[box] = inside.view(bool) & (visibility.face[box] >= 0)
    return result
