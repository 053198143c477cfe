"""Landmarks of one person in images, and how far they count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.objective import Prior
from carigs.tracking.cameras import Cameras
from carigs.tracking.solver.objective import LandmarkObjective, Shared

INDEPENDENT = 0.25
"""Independent observations for each landmark of a dense face mesh: a network's errors are correlated along the face."""
ANCHOR_SIGMA = 0.1
"""Standard deviation of an anchor in pixels."""
OUTLIERS = (30.0, 5.0)
"""Scales of the loss in standard deviations."""
LEAST_SIGMA = 0.1
"""Pixels."""
MEDIAN_LENGTH = 1.1774
"""Median length of a vector of two normal variables with deviation 1."""


@dataclass(frozen=True)
class Tracks:
    """Landmarks of one person in one or more cameras that stand still; of a moment, one timestep in many cameras."""

    pixels: Float[np.ndarray, "t c n 2"]
    confidence: Float[np.ndarray, "t c n"]
    """From 0 (missing) to 1."""
    times: Float[np.ndarray, " t"]
    """Seconds."""

    def at(self, chosen: Int[np.ndarray, " m"]) -> Tracks:
        """The landmarks of some frames.

        Args:
            chosen: Indices of the frames.

        Returns:
            Their landmarks.
        """
        return Tracks(self.pixels[chosen], self.confidence[chosen], self.times[chosen])

    def less(self, errors: Float[np.ndarray, "c n 2"]) -> Tracks:
        """The landmarks without errors that those of a camera have in all frames alike.

        Args:
            errors: In pixels.

        Returns:
            The landmarks elsewhere.
        """
        return Tracks(self.pixels - errors, self.confidence, self.times)

    def objective(
        self,
        points: HeadPoints,
        cameras: Cameras,
        shared: Shared,
        weights: Float[np.ndarray, " n"],
        outlier: float,
        prior: Prior,
    ) -> LandmarkObjective:
        """How well a head explains the landmarks.

        Args:
            points: The landmarks on the head.
            cameras: The cameras.
            shared: What the frames share.
            weights: Of each landmark, in 1 / pixels^2.
            outlier: As of `LandmarkObjective`.
            prior: The priors.

        Returns:
            The objective.
        """
        information = (weights * self.confidence)[..., None, None] * np.eye(2)
        return LandmarkObjective(points, cameras, shared, self.pixels, information, outlier, prior)


def information(sigma: float, landmarks: int, count: int) -> Float[np.ndarray, " n"]:
    """Weights of landmarks, of which a share counts, and of anchors.

    Args:
        sigma: Standard deviation of the landmarks in pixels.
        landmarks: Their number.
        count: Number of both.

    Returns:
        1 / pixels^2.
    """
    return np.repeat([INDEPENDENT / sigma**2, ANCHOR_SIGMA**-2], [landmarks, count - landmarks])


def face_size(tracks: Tracks) -> float:
    """Measure the median diagonal of the landmarks' box.

    Args:
        tracks: The landmarks.

    Returns:
        Pixels.
    """
    known, seen = (values[(tracks.confidence > 0).any(axis=2)] for values in (tracks.pixels, tracks.confidence > 0))
    low = np.where(seen[..., None], known, np.inf).min(axis=1)
    high = np.where(seen[..., None], known, -np.inf).max(axis=1)
    return float(np.median(np.linalg.norm(high - low, axis=1)))


def landmark_sigma(errors: Float[np.ndarray, "t c n"], seen: Bool[np.ndarray, "t c n"] | bool = True) -> float:
    """Estimate the standard deviation of landmarks, by the median of their errors.

    Args:
        errors: Distances in pixels; NaN for missing ones.
        seen: Which of them count.

    Returns:
        Pixels.
    """
    return max(float(np.nanmedian(np.where(seen, errors, np.nan))) / MEDIAN_LENGTH, LEAST_SIGMA)
