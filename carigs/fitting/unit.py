"""Whether cameras are in metres, as the head model is: a COLMAP model has a unit of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.fitting.landmarks.fit import Observations
from carigs.fitting.triangulation import LEAST_POINTS, triangulate, well_seen_timesteps

LARGEST_RATIO = 1.5
"""Between the sizes of two heads."""
TIMESTEPS = 12
"""Timesteps that are triangulated."""


def check_unit(template: Float[np.ndarray, "p 3"], observations: Observations, file: Path) -> None:
    """Refuse cameras that see a head of an impossible size.

    Args:
        template: The landmarks on the head model, in metres.
        observations: The landmarks in the images.
        file: Where the cameras come from, for messages.

    Raises:
        InputError: If the triangulated landmarks are larger or smaller than those of the head model by more than
            `LARGEST_RATIO`; names the unit that agrees.
    """
    chosen = well_seen_timesteps(observations.confidence, TIMESTEPS)
    views = (array[chosen] for array in (observations.pixels, observations.confidence, observations.projections))
    ratios = []
    for points in triangulate(*views)[0]:
        known = np.isfinite(points).all(axis=1)
        if known.sum() >= LEAST_POINTS:
            ratios.append(_size(points[known]) / _size(template[known]))
    ratio = float(np.median(ratios)) if ratios else 1.0
    if not 1 / LARGEST_RATIO < ratio < LARGEST_RATIO:
        problem = f"triangulated landmarks are {ratio:.3g} times as large as those of the head model"
        advice = f"the unit of the cameras is about {1 / ratio:.2g} of what is stated: see --metres-per-unit"
        raise InputError(f"{problem}; {advice}", file=file, field="cameras")


def _size(points: Float[np.ndarray, "n 3"]) -> float:
    """Root mean square distance from the mean."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
