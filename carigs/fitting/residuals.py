"""Reprojection errors per camera, and the cameras whose errors stand out."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

STANDS_OUT = 2.0
"""Times the median of the cameras."""
LEAST_DIFFERENCE = 1.0
"""Pixels above the median."""


def camera_residuals(errors: Float[np.ndarray, "t c p"]) -> Float[np.ndarray, " c"]:
    """Median reprojection error of each camera.

    Args:
        errors: Distances in pixels (`reprojection_errors`), NaN for missing landmarks.

    Returns:
        Pixels; NaN for a camera without landmarks.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # cameras without landmarks
        return np.nanmedian(errors.swapaxes(0, 1).reshape(errors.shape[1], -1), axis=1)


def outstanding_cameras(residuals: Float[np.ndarray, " c"], cameras: Sequence[int]) -> list[int]:
    """Cameras whose calibration or landmarks are likely to be wrong.

    Args:
        residuals: Error of each camera in pixels.
        cameras: Their numbers.

    Returns:
        Numbers of the cameras with more than twice the median of all, and at least a pixel more.
    """
    known = residuals[np.isfinite(residuals)]
    if known.size < 3:  # which of two is wrong cannot be told
        return []
    limit = max(STANDS_OUT * np.median(known), np.median(known) + LEAST_DIFFERENCE)
    return [camera for camera, residual in zip(cameras, residuals, strict=True) if residual > limit]
