"""The knee of a curve of error against time.

Of two options the one with the lower `cost` is preferred,

    cost = error in dB + GAIN log2(time),

so that an option that takes twice as long must lower the error by `GAIN` to be as good. The knee is the option of least
cost. On it, no more expensive option gains `GAIN` or more per doubling of the time, and no cheaper option loses less
than that per halving. It is on the lower convex hull of the curve in logarithmic axes, where the slope passes -`GAIN`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

GAIN = 0.2
"""dB per doubling of the time: 2.3 % of the error. Smaller differences of PSNR are within the variation of another seed
in small regions."""
TOLERANCE = 0.05
"""dB of cost by which two options do not differ. CPU times repeat to about 10 %, which is 0.03 dB."""


def cost(seconds: Float[np.ndarray, " n"], decibels: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """What is least at the knee.

    Args:
        seconds: Positive times.
        decibels: Errors in dB: minus PSNR, or 20 log10 of an error.

    Returns:
        Error and time of each option in dB.
    """
    return np.asarray(decibels) + GAIN * np.log2(seconds)


def knee(seconds: Float[np.ndarray, " n"], decibels: Float[np.ndarray, " n"]) -> int:
    """Find the knee.

    Args:
        seconds: Positive times.
        decibels: Errors in dB.

    Returns:
        Index of the option of least cost; of equal ones the fastest.
    """
    return int(np.lexsort((seconds, cost(seconds, decibels)))[0])


def pareto_optimal(seconds: Float[np.ndarray, " n"], decibels: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Find the options that no other option beats in time or error without losing in the other.

    Args:
        seconds: Times.
        decibels: Errors in dB.

    Returns:
        Whether each option is Pareto-optimal.
    """
    time, error = np.asarray(seconds), np.asarray(decibels)
    no_worse = (time[:, None] <= time) & (error[:, None] <= error)
    better = (time[:, None] < time) | (error[:, None] < error)
    return ~(no_worse & better).any(axis=0)
