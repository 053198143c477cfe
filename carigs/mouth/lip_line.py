"""The line along which the lips meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.head import HeadModel
from carigs.raster.open_mouth import INNER_LIPS


class LipLine(NamedTuple):
    """The line midway between the inner lips of a neutral head (y up, face towards +z)."""

    points: Float[np.ndarray, "5 3"]
    """From the right corner of the mouth to the left one: x increases."""

    @property
    def width(self) -> float:
        """Distance between the corners of the mouth in metres: the unit of lengths in the mouth."""
        return float(np.linalg.norm(self.points[-1] - self.points[0]))

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """Point in the middle of the line."""
        return self.points[2]

    def height(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """How far points are above the line.

        Args:
            points: Points in metres.

        Returns:
            Metres; negative below it.
        """
        return points[:, 1] - np.interp(points[:, 0], self.points[:, 0], self.points[:, 1])

    def depth(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """How far points are behind the line.

        Args:
            points: Points in metres.

        Returns:
            Metres; negative in front of it.
        """
        return np.interp(points[:, 0], self.points[:, 0], self.points[:, 2]) - points[:, 2]


def lip_line(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> LipLine | None:
    """Find where the lips meet.

    Args:
        model: Head model.
        neutral: Vertices of the subject's neutral head in metres.

    Returns:
        The line; None if the model has no landmarks, or these are not in the order of faces that look to +z.
    """
    if model.landmarks68 is None:
        return None
    lips = model.landmarks68[INNER_LIPS].interpolate(neutral)  # from the right corner over the upper lip, and back
    line = LipLine(np.array([lips[0], *(lips[[1, 2, 3]] + lips[[7, 6, 5]]) / 2, lips[4]]))
    return line if (np.diff(line.points[:, 0]) > 0).all() else None


def lip_gap(model: HeadModel, posed: Float[np.ndarray, "v 3"]) -> float:
    """Distance between the middles of the inner lips.

    Args:
        model: Head model with landmarks.
        posed: Vertices of the posed head in metres.

    Returns:
        Metres.
    """
    lips = model.landmarks68[INNER_LIPS].interpolate(posed)
    return float(np.linalg.norm(lips[2] - lips[6]))
