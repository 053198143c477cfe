"""Bands in a frame: rows of the sensor that were exposed while a lamp was brighter or darker (rolling shutter)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from carigs.exposure.known_median import median_of_known
from carigs.exposure.matching import MANY_CAMERAS, Exposures

ROWS = 10
"""Groups of rows with the same number of vertices."""
LEAST_VERTICES = 10 * ROWS
"""Vertices that a frame must show."""
LEAST_BAND = 0.01
"""Standard deviation of sRGB values over the groups, relative, from which a frame counts as banded."""
BAND_RATIO = 2.0
"""The same over the median deviation of the vertices within groups, from which a frame counts as banded. Shadows on a
head that moves reach 1.2 with several cameras (`ict_s7`; 0.7 in `ict_s1`) and 1.6 with one; bands of 5 % have more than
1.9."""
LEAST_SHARE = 0.1
"""Of the frames of a camera that must be banded: lamps flicker in all of them, one may be another fault."""


def band_strength(exposures: Exposures) -> Float64[np.ndarray, "c t"]:
    """How much the brightness of the frames changes with the row.

    Args:
        exposures: The exposures of a capture.

    Returns:
        Relative standard deviation of the brightness over the rows; 0 for frames without bands, and for cameras
        that have few with them.
    """
    residual = exposures.residual
    shared = np.isfinite(residual).sum(axis=0) >= MANY_CAMERAS
    # What most cameras see at a vertex is its light, wherever it is in their images.
    residual = residual - np.where(shared, median_of_known(residual), 0.0)
    strength = np.zeros(residual.shape[:2])
    for c, t in np.ndindex(strength.shape):
        known = np.isfinite(residual[c, t])
        if known.sum() < LEAST_VERTICES:
            continue
        values = residual[c, t, known]
        order = np.argsort(exposures.observations.row[c, t, known], kind="stable")
        groups = np.array_split(values[order], ROWS)
        medians = np.array([np.median(group) for group in groups])
        within = np.median(np.concatenate([np.abs(group - m) for group, m in zip(groups, medians, strict=True)]))
        band = float(medians.std())
        if band > LEAST_BAND and band > BAND_RATIO * within:
            strength[c, t] = band
    few = (strength > 0).sum(axis=1) < LEAST_SHARE * strength.shape[1]
    return np.where(few[:, None], 0.0, strength)
