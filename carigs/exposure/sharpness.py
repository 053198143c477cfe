"""Cameras that are out of focus, and frames that are blurred by motion: the fine detail that they show of the head.

The same part of a head shows the same detail to every sharp camera, and to one camera at all times. A blur of half a
pixel (standard deviation) halves it in the path-traced frames of `ict_s1`, one of two pixels leaves a quarter. Sharp
cameras and frames differ by 5 % there, in `ict_s7` and in the toy.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from carigs.exposure.observations import Observations
from carigs.exposure.offsets import Offsets, fit_offsets

BLURRED = np.log(1.5)
"""Logarithm of the ratio of detail from which a camera or frame counts as blurred."""


def camera_sharpness(seen: Observations) -> Float64[np.ndarray, " c"]:
    """Compare cameras.

    Args:
        seen: What the cameras show.

    Returns:
        Fine detail of each camera over that of the middle one; 1 for cameras that are not significantly blurred.
    """
    if len(seen.cameras) < 2:
        return np.ones(len(seen.cameras))
    found = fit_offsets(seen.detail, seen.patch)
    middle = np.sort(found.offset, axis=0)[len(found.offset) // 2]  # of two cameras, the sharper one
    return _blurred(found._replace(offset=found.offset - middle))


def frame_sharpness(seen: Observations) -> Float64[np.ndarray, "c t"]:
    """Compare the frames of each camera.

    Args:
        seen: What the cameras show.

    Returns:
        Fine detail of each frame over that of its camera's median frame; 1 for frames that are not significantly
        blurred.
    """
    found = [_blurred(fit_offsets(detail[:, None], seen.patch)) for detail in seen.detail]
    return np.array(found).reshape(seen.detail.shape[:2])


def _blurred(found: Offsets) -> Float64[np.ndarray, " u"]:
    offset = found.offset[:, 0]
    blurred = found.is_significant()[:, 0] & (offset < -BLURRED)
    return np.exp(np.where(blurred, offset, 0.0))
