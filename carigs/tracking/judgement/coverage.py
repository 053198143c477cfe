"""From which sides frames show a head."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

BIN = 5.0
"""Degrees of a bin."""
LEFT = RIGHT = 30.0
UP, DOWN = 10.0, 15.0
"""Degrees to each side that a recording should show: the range whose bins are counted."""
LEAST = 2
"""Frames that must lie in a bin, so that it is covered."""


@dataclass(frozen=True)
class Coverage:
    """The turns of a head against the camera, in degrees."""

    left: float
    """The farthest turn to the person's left; below 0 if no frame shows the head turned there."""
    right: float
    up: float
    down: float
    yaw_share: float
    """Share of the bins from `RIGHT` to `LEFT` that frames cover."""
    pitch_share: float
    """The same from `UP` to `DOWN`."""
    counts: Int[np.ndarray, "y p"]
    """Frames in each bin of yaw and pitch."""


def coverage(yaw: Float[np.ndarray, " n"], pitch: Float[np.ndarray, " n"]) -> Coverage:
    """Count the frames that show a head from each side.

    Args:
        yaw: Degrees, positive to the person's left; NaN where unknown.
        pitch: Degrees, positive down; NaN where unknown.

    Returns:
        The coverage; without any known frame, no side is seen.
    """
    known = np.isfinite(yaw) & np.isfinite(pitch)
    yaw, pitch = yaw[known], pitch[known]
    yaw_bins, pitch_bins = np.arange(-RIGHT, LEFT + BIN, BIN), np.arange(-UP, DOWN + BIN, BIN)
    counts = np.histogram2d(yaw, pitch, bins=(yaw_bins, pitch_bins))[0].astype(np.int64)
    shares = [float((np.histogram(v, bins)[0] >= LEAST).mean()) for v, bins in ((yaw, yaw_bins), (pitch, pitch_bins))]
    farthest = [float(values.max(initial=-180.0)) for values in (yaw, -yaw, -pitch, pitch)]
    return Coverage(*farthest, *shares, counts)
