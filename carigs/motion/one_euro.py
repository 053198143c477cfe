"""The one-euro filter (Casiez et al. 2012): a low-pass filter whose cut-off grows with the speed of the signal."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

SPEED_CUT_OFF = 1.0
"""Cut-off of the filter of the speed in hertz, as in the paper."""


def one_euro(values: Float[np.ndarray, "t n"], fps: float, cut_off: float, slope: float) -> Float[np.ndarray, "t n"]:
    """Smooth signals over time.

    Args:
        values: Signals in columns.
        fps: Samples per second.
        cut_off: Cut-off of a signal that rests, in hertz; lower smooths more.
        slope: Growth of the cut-off with the speed, in hertz for each unit per second; higher lags less.

    Returns:
        The smoothed signals. The first sample is kept.
    """
    smoothed, speed = values.astype(np.float64), np.zeros(values.shape[1:])
    speed_share = _share(SPEED_CUT_OFF, fps)
    for t in range(1, len(values)):
        speed = speed + speed_share * ((values[t] - values[t - 1]) * fps - speed)
        share = _share(cut_off + slope * np.abs(speed), fps)
        smoothed[t] = smoothed[t - 1] + share * (values[t] - smoothed[t - 1])
    return smoothed


def _share(cut_off: Float[np.ndarray, "*n"] | float, fps: float) -> Float[np.ndarray, "*n"] | float:
    """Weight of a new sample: 1 / (1 + tau / T) with tau = 1 / (2 pi cut-off)."""
    return 1 / (1 + fps / (2 * np.pi * np.maximum(cut_off, 1e-9)))
