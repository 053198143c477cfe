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
from carigs.fitting.footage import frame_landmarks, frame_projections, frame_sizes
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.landmarks.convention import check_convention, check_residuals
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.fitting.landmarks.files import Landmarks
from carigs.fitting.landmarks.fit import HeadFit, Observations, fit_landmarks, reprojection_errors
from carigs.fitting.refinement import Refinement
from carigs.fitting.residuals import camera_residuals
from carigs.fitting.triangulation import LEAST_POINTS, well_seen_timesteps
from carigs.fitting.unit import check_unit
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
        on_frame: Called after each timestep of each pass over the frames.

    Returns:
        Head parameters of all timesteps, and residuals.

    Raises:
        InputError: If the embedding does not fit, no timestep has four landmarks that two cameras see, landmarks are in
            another unit, origin or order, cameras are in another unit than the head, or the fit is impossible.
    """
    model = capture.model
    timesteps, cameras = sorted({frame.timestep for frame in capture.frames}), sorted(capture.cameras)
    points, numbers = read_embedding(embedding, model, landmarks.values.shape[2])
    values = frame_landmarks(capture, landmarks, timesteps, cameras)[:, :, numbers]
    seen = well_seen_timesteps(values[..., 2])
    if not seen.size:
        problem = f"in no timestep do two cameras see {LEAST_POINTS} landmarks"
        raise InputError(problem, file=capture.root, field="landmarks")
    observations = Observations(
        values[..., :2], values[..., 2], frame_projections(capture, timesteps, cameras), _linked(capture, timesteps)
    )
    template, source = points.interpolate(model.v_template), landmarks.source or str(capture.root)
    check_convention(template, observations, frame_sizes(capture, timesteps, cameras), source)
    check_unit(template, observations, capture.root)
    fit: HeadFit = fit_landmarks(model, points, observations)
    if refine:
        work = Refinement(capture, timesteps, cameras, model, points, observations, on_frame)
        fit = work.refine(fit)
    positions = HeadPoints(model, fit.fitted, points).positions(fit.frames, fit.shape)
    residuals = camera_residuals(reprojection_errors(positions, observations))
    check_residuals(residuals, observations, source)
    blind = [timesteps[i] for i in np.setdiff1d(np.arange(len(timesteps)), seen)]
    return VideoFit(dict(zip(timesteps, fit.parameters(model), strict=True)), cameras, residuals, blind)


def _linked(capture: Capture, timesteps: Sequence[int]) -> np.ndarray:
    """Whether each timestep and the next one follow each other in one sequence."""
    sequence = {frame.timestep: frame.sequence for frame in capture.frames}
    return np.array([b == a + 1 and sequence[a] == sequence[b] for a, b in pairwise(timesteps)], bool)
