"""Whether two faces are those of one person: the colours at their landmarks.

Brows, lips, beard and skin have the same colours wherever the head turns. Networks that recognise people know more, but
within a video, with one light, this is enough: between neighbouring frames of a real person the measure changes by less
than 0.1, to the nearest frame of another person it is 0.4.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

SURFACE = slice(0, 468, 3)
"""The landmarks whose colours are compared: every third one of the face mesh."""
COLOURS = 3 * len(range(468)[SURFACE])
"""Length of the vector of their colours."""
BLUR = 0.02
"""Standard deviation of the blur, in sides of the crop: landmarks are off by a pixel, and skin has pores."""
DARK = 16.0
"""Levels added before the logarithm, so that noise in the dark does not count."""
SAME = 0.25
"""Difference up to which two faces are of one person."""
NEWS, MOST = 0.1, 32
"""A view of a person that differs by more from all that are remembered is remembered, too, and how many are at most."""


def face_colours(crop: UInt8[np.ndarray, "s s 3"], points: Float[np.ndarray, "p d"]) -> Float32[np.ndarray, " k"]:
    """Colours at the landmarks of a face, whatever brightness and white balance the image has.

    Args:
        crop: Part of an image around the face.
        points: x and y of the landmarks in its pixels.

    Returns:
        Their logarithms as a vector of length 1, less the mean of each channel.
    """
    blurred = cv2.GaussianBlur(crop, (0, 0), BLUR * len(crop))
    x, y = points[SURFACE, :2].clip(0, len(crop) - 1).astype(int).T
    colours = np.log2(blurred[y, x] + DARK)
    colours = (colours - colours.mean(axis=0)).ravel()
    return (colours / max(float(np.linalg.norm(colours)), 1e-9)).astype(np.float32)


def differences(first: Float32[np.ndarray, "n k"], second: Float32[np.ndarray, "m k"]) -> Float32[np.ndarray, "n m"]:
    """How faces differ.

    Args:
        first: `face_colours` of some faces.
        second: Those of others.

    Returns:
        1 - correlation of each pair; NaN where one is missing.
    """
    return 1 - first @ second.T


class Acquaintance:
    """Views of one person that were seen before."""

    def __init__(self) -> None:
        self._seen: list[Float32[np.ndarray, " k"]] = []

    def recognises(self, colours: Float32[np.ndarray, " k"]) -> bool:
        """Whether a face is that of this person; the first one is. Its view is remembered then.

        Args:
            colours: `face_colours` of it.

        Returns:
            Whether it is.
        """
        nearest = float(differences(colours[None], np.array(self._seen)).min()) if self._seen else SAME
        if nearest > SAME:
            return False
        if nearest > NEWS and len(self._seen) < MOST:
            self._seen.append(colours)
        return True
