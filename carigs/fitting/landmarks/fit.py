"""Fit of a head to landmarks: triangulation, rigid alignment, then minimisation of the reprojection error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from carigs.fitting.fitted_parameters import FittedParameters, fitted_parameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.landmarks.term import LandmarkTerm
from carigs.fitting.levenberg_marquardt import minimise
from carigs.fitting.objective import Objective, Prior
from carigs.fitting.triangulation import LEAST_POINTS, project, triangulate
from carigs.head import HeadModel, HeadParameters, SurfacePoints
from carigs.mesh.rigid_alignment import rigid_alignment

JOINT_DEVIATION = 0.2
"""Standard deviation of the rotations of joints other than the root, in radians."""
CHANGES = {"translation": 0.02, "rotation": 0.1, "joints": 0.1, "expression": 0.5}
"""Standard deviations of what changes from one timestep to the next, in metres, radians and units of coefficients:
weak, so that frames with landmarks follow them and frames without follow their neighbours."""
OUTLIERS = (300.0, 30.0, 5.0)
"""Scales of the loss in standard deviations, from nearly quadratic to robust (graduated non-convexity)."""
LEAST_SIGMA = 0.1
"""Pixels."""


@dataclass(frozen=True)
class Observations:
    """Landmarks in the images."""

    pixels: Float[np.ndarray, "t c p 2"]
    """0 where missing."""
    confidence: Float[np.ndarray, "t c p"]
    """From 0 (missing) to 1."""
    projections: Float[np.ndarray, "t c 3 4"]
    """Matrices of the cameras (`projection_matrix`)."""
    linked: Bool[np.ndarray, " t-1"]
    """Whether each timestep and the next one are neighbours in one sequence."""


@dataclass(frozen=True)
class HeadFit:
    """Fitted parameters of a subject."""

    fitted: FittedParameters
    frames: Float[np.ndarray, "t q"]
    shape: Float[np.ndarray, " s"]
    sigma: float
    """Standard deviation of the landmarks in pixels: noise, and what the head model cannot follow."""

    def parameters(self, model: HeadModel) -> list[HeadParameters]:
        """Head parameters of all frames.

        Args:
            model: The head model.

        Returns:
            One entry per frame.
        """
        return [self.fitted.head_parameters(model, frame, self.shape) for frame in self.frames]


def fit_landmarks(
    model: HeadModel,
    landmarks: SurfacePoints,
    observations: Observations,
    start: Float[np.ndarray, "t 6"] | None = None,
) -> HeadFit:
    """Fit shape, expressions and poses.

    Args:
        model: The head model.
        landmarks: The landmarks on the head.
        observations: The landmarks in the images.
        start: Translation and rotation of each frame to start from; triangulated and aligned if None.

    Returns:
        The fit.
    """
    fitted = fitted_parameters(model, np.unique(landmarks.corners))
    points = HeadPoints(model, fitted, landmarks)
    triangulated, distances = triangulate(observations.pixels, observations.confidence, observations.projections)
    if start is None:
        start = _align(points, triangulated)
    frames, shape = np.zeros((len(start), fitted.frame_size)), np.zeros(len(fitted.shape))
    frames[:, :6] = start
    sigma = max(_component_deviation(distances), LEAST_SIGMA)
    prior = gaussian_prior(fitted, observations.linked)
    for outlier in OUTLIERS:
        term = landmark_term(points, observations, sigma, outlier)
        frames, shape = minimise(Objective([term], prior), frames, shape)
    distances = reprojection_errors(points.positions(frames, shape), observations)
    return HeadFit(fitted, frames, shape, max(sigma, _component_deviation(distances)))


def landmark_term(
    points: HeadPoints, observations: Observations, sigma: float, outlier: float = OUTLIERS[-1]
) -> LandmarkTerm:
    """The reprojection error of observations.

    Args:
        points: The landmarks on the head.
        observations: The landmarks in the images.
        sigma: Standard deviation in pixels.
        outlier: Scale of the loss, in standard deviations.

    Returns:
        The term.
    """
    return LandmarkTerm(points, observations.pixels, observations.confidence, observations.projections, sigma, outlier)


def gaussian_prior(fitted: FittedParameters, linked: Bool[np.ndarray, " m"]) -> Prior:
    """Priors of unit variance on coefficients, and temporal smoothness within sequences.

    Args:
        fitted: The fitted parameters.
        linked: Whether each timestep and the next one are neighbours.

    Returns:
        The prior.
    """
    frames, changes = np.zeros(fitted.frame_size), np.empty(fitted.frame_size)
    frames[fitted.joint_slice] = JOINT_DEVIATION**-2
    frames[fitted.expression_slice] = 1.0
    parts = (slice(0, 3), slice(3, 6), fitted.joint_slice, fitted.expression_slice)
    for part, deviation in zip(parts, CHANGES.values(), strict=True):
        changes[part] = deviation**-2
    return Prior(frames, np.ones(len(fitted.shape)), linked[:, None] * changes)


def reprojection_errors(
    positions: Float[np.ndarray, "t p 3"], observations: Observations
) -> Float[np.ndarray, "t c p"]:
    """Distances between observed and projected landmarks.

    Args:
        positions: World points of the landmarks in metres.
        observations: The landmarks in the images.

    Returns:
        Distances in pixels, NaN for missing observations.
    """
    projected, _ = project(positions, observations.projections)
    distances = np.linalg.norm(projected - observations.pixels, axis=-1)
    return np.where(observations.confidence > 0, distances, np.nan)


def _component_deviation(distances: Float[np.ndarray, "*n"]) -> float:
    """Standard deviation of x and y, from the median of distances: that of a Rayleigh distribution is 1.1774 sigma."""
    known = distances[np.isfinite(distances)]
    return float(np.median(known)) / 1.1774 if known.size else 1.0


def _align(points: HeadPoints, triangulated: Float[np.ndarray, "t p 3"]) -> Float[np.ndarray, "t 6"]:
    """Translation and rotation of the template in each frame; those of the nearest frame where too few points are."""
    root, template = points.joints[0], points.template_points
    poses = np.full((len(triangulated), 6), np.nan)
    for pose, target in zip(poses, triangulated, strict=True):
        known = np.isfinite(target).all(axis=1)
        if known.sum() >= LEAST_POINTS:
            rotation, translation = rigid_alignment(template[known], target[known])
            pose[:3] = translation + rotation @ root - root  # the model turns about its root joint
            pose[3:] = Rotation.from_matrix(rotation).as_rotvec()
    aligned = np.flatnonzero(np.isfinite(poses[:, 0]))
    nearest = np.abs(np.arange(len(poses))[:, None] - aligned).argmin(axis=1)
    return poses[aligned[nearest]]
