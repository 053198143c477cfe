"""Fit of a calibrated video: landmarks, refinement, dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture
from carigs.errors import InputError
from carigs.fitting.footage import frame_projections
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.landmark_files import Landmarks, read_embedding
from carigs.fitting.landmark_fit import LEAST_POINTS, HeadFit, Observations, fit_landmarks, reprojection_errors
from carigs.fitting.refinement import Refinement
from carigs.fitting.residuals import camera_residuals
from carigs.head import HeadParameters


@dataclass(frozen=True)
class VideoFit:
    """The result of `fit_video`."""

    parameters: dict[int, HeadParameters]
    """By timestep."""
    cameras: list[int]
    residuals: Float[np.ndarray, " c"]
    """Median reprojection error of each camera's landmarks in pixels."""
    blind: list[int]
    """Timesteps without landmarks enough: they follow their neighbours."""


def fit_video(
    capture: Capture,
    landmarks: Landmarks,
    embedding: Path | None = None,
    *,
    refine: bool = True,
    on_frame: Callable[[], None] = lambda: None,
) -> VideoFit:
    """Fit a head model to a calibrated video.

    Args:
        capture: The footage (`read_footage`).
        landmarks: Its landmarks.
        embedding: File of the landmarks on the head model; None for the model's own.
        refine: Whether to refine on mattes and images.
        on_frame: Called as the work goes on: `work_units` times at most.

    Returns:
        Head parameters of all timesteps, and residuals.

    Raises:
        InputError: If the embedding does not fit, or no timestep has four landmarks that two cameras see.
    """
    model = capture.model
    timesteps, cameras = sorted({frame.timestep for frame in capture.frames}), sorted(capture.cameras)
    values = landmarks.at(timesteps, cameras)
    for t, c in np.ndindex(values.shape[:2]):
        if (timesteps[t], cameras[c]) not in capture.frame_at:
            values[t, c] = 0
    corners, barycentric = read_embedding(embedding, model, values.shape[2])
    several = ((values[..., 2] > 0).sum(axis=1) >= 2).sum(axis=1) >= LEAST_POINTS
    if not several.any():
        problem = f"in no timestep do two cameras see {LEAST_POINTS} landmarks"
        raise InputError(problem, file=capture.root, field="landmarks")
    observations = Observations(
        values[..., :2], values[..., 2], frame_projections(capture, timesteps, cameras), _linked(capture, timesteps)
    )
    fit: HeadFit = fit_landmarks(model, corners, barycentric, observations)
    if refine:
        work = Refinement(capture, timesteps, cameras, model, corners, barycentric, observations, on_frame)
        fit = work.refine(fit)
    positions = HeadPoints(model, fit.fitted, corners, barycentric).positions(fit.frames, fit.shape)
    residuals = camera_residuals(reprojection_errors(positions, observations))
    blind = [timestep for timestep, enough in zip(timesteps, several, strict=True) if not enough]
    return VideoFit(dict(zip(timesteps, fit.parameters(model), strict=True)), cameras, residuals, blind)


def _linked(capture: Capture, timesteps: Sequence[int]) -> np.ndarray:
    """Whether each timestep and the next one follow each other in one sequence."""
    sequence = {frame.timestep: frame.sequence for frame in capture.frames}
    return np.array([b == a + 1 and sequence[a] == sequence[b] for a, b in pairwise(timesteps)], bool)
