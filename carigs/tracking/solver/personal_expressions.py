"""How one person makes the expressions of a head model: corrections of its blendshapes at landmarks.

A model's blink closes the lids of the average of its makers' people. The coefficients of a person's frames, times the
blendshapes, leave errors at the landmarks that are proportional to the coefficients; these are learned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.fitting.head_points import HeadPoints
from carigs.tracking.cameras import Cameras

SHARE = 0.8
"""Standard deviation of a correction, in displacements of the blendshape at the landmark."""
LEAST = 0.0005
"""Metres, added to the same: expressions also move what the blendshapes leave where it is."""


class LandmarkErrors(NamedTuple):
    """What the images say about the landmarks of posed heads."""

    error: Float[np.ndarray, "t c n 2"]
    """Observed less projected, in pixels."""
    by_rest: Float[np.ndarray, "t c n 2 3"]
    """Derivatives of the projections with respect to displacements on the template, in pixels per metre."""
    information: Float[np.ndarray, "t c n"]
    """1 / variance of the observations, 0 for missing ones."""
    outlier: float
    """Standard deviations beyond which an error counts as an outlier."""

    def of(self, chosen: slice) -> LandmarkErrors:
        """The errors of some of the landmarks.

        Args:
            chosen: Which.

        Returns:
            Their errors.
        """
        parts = (array[:, :, chosen] for array in self[:3])
        return LandmarkErrors(*parts, self.outlier)


def landmark_errors(
    points: HeadPoints,
    cameras: Cameras,
    frames: Float[np.ndarray, "t q"],
    pixels: Float[np.ndarray, "t c n 2"],
    information: Float[np.ndarray, "t c n"],
    outlier: float,
) -> LandmarkErrors:
    """Compare a person's landmarks with the images.

    Args:
        points: The landmarks on the person's head.
        cameras: The cameras.
        frames: Parameters of each frame.
        pixels: Observations.
        information: Their 1 / variance.
        outlier: As of `LandmarkErrors`.

    Returns:
        The errors, with their derivatives.
    """
    shape = np.zeros(0)
    projected, depth, by_point, _ = cameras.linearise(points.positions(frames, shape))
    by_rest = by_point @ points.turned(frames, shape)[:, None]
    return LandmarkErrors(pixels - projected, by_rest, information * (depth > 0), outlier)


def learn_corrections(
    errors: LandmarkErrors,
    coefficients: Float[np.ndarray, "t e"],
    blendshapes: Float[np.ndarray, "n 3 e"],
    corrections: Float[np.ndarray, "n 3 e"],
) -> Float[np.ndarray, "n 3 e"]:
    """Learn corrections of blendshapes by ridge regression, one landmark after the other.

    Args:
        errors: Errors with the corrections so far.
        coefficients: Expression coefficients of the frames.
        blendshapes: The model's, at the landmarks, in metres.
        corrections: What has been added to them so far.

    Returns:
        Better corrections: the most probable ones under Gaussian priors about 0, with outliers weighted down as in
        `carigs.tracking.solver.objective`.
    """
    deviations = SHARE * np.linalg.norm(blendshapes, axis=1) + LEAST
    used = np.flatnonzero((coefficients**2).sum(axis=0) > 1e-6)
    if not used.size:
        return corrections
    own = coefficients[:, used]
    learned = corrections.copy()
    t, c = errors.error.shape[:2]
    for n in range(len(blendshapes)):
        error, information = errors.error[:, :, n], errors.information[:, :, n]
        squared = information * (error**2).sum(axis=-1)
        weight = information / (1 + squared / errors.outlier**2) ** 2
        rows = np.einsum("tcak,te->tcake", errors.by_rest[:, :, n], own).reshape(2 * t * c, -1)
        weights = np.repeat(weight.ravel(), 2)[:, None]
        precision = np.tile(deviations[n, used] ** -2.0, 3)
        matrix = rows.T @ (weights * rows) + np.diag(precision)
        right = rows.T @ (weights[:, 0] * error.ravel()) - precision * corrections[n][:, used].ravel()
        learned[n][:, used] += np.linalg.solve(matrix, right).reshape(3, -1)
    return learned
