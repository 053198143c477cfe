"""Which colours are a person's skin, by the landmarks of the face: where hair or clothes end, the head does not."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

DEVIATIONS = 3.5
"""Standard deviations up to which a colour counts as skin."""
LEAST = np.array([0.015, 0.015, 0.25])
"""Least standard deviations of the shares of red and green, and of the logarithm of the brightness: the skin beside an
outline is lit otherwise than the middle of the face."""
MOST = 1.6 * LEAST
"""Largest ones: hair may hang over half of a face."""
CONSISTENT = 1.4826
"""Of a normal distribution: standard deviation over the median distance from the median."""


class SkinColours:
    """A normal distribution of hue and brightness, estimated by medians: eyes, lips and brows are few.

    Args:
        colours: Of points on the face, in [0, 1].
    """

    def __init__(self, colours: Float[np.ndarray, "n 3"]) -> None:
        values = _hue_and_brightness(colours)
        self._median = np.median(values, axis=0)
        self._deviation = np.clip(CONSISTENT * np.median(np.abs(values - self._median), axis=0), LEAST, MOST)

    def contains(self, colours: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether colours are those of the skin.

        Args:
            colours: In [0, 1].

        Returns:
            True for those within `DEVIATIONS`.
        """
        distance = np.abs(_hue_and_brightness(colours) - self._median) / self._deviation
        return (distance < DEVIATIONS).all(axis=1)


def _hue_and_brightness(colours: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    colours = np.maximum(colours.astype(np.float64), 1 / 255)
    total = colours.sum(axis=1, keepdims=True)
    return np.hstack([colours[:, :2] / total, np.log(total)])
