"""The fit to landmarks: the minimum that scipy finds, the truth without noise, outliers, gaps, wrong starts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from small_head import ring_of_cameras, small_head

from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.fitting.head_points import HeadPoints
from carigs.fitting.landmarks.fit import (
    HeadFit,
    Observations,
    fit_landmarks,
    gaussian_prior,
    landmark_term,
    reprojection_errors,
)
from carigs.fitting.levenberg_marquardt import minimise
from carigs.fitting.objective import Objective
from carigs.fitting.triangulation import project, projection_matrices
from carigs.head import HeadModel, SurfacePoints, pose_frames

MODEL = small_head()
VERTICES = np.flatnonzero(MODEL.v_template[:, 2] > 0.03)[::3]
LANDMARKS = SurfacePoints.at_vertices(VERTICES)


def true_fit(frames: int = 4, seed: int = 0) -> HeadFit:
    """A sequence in motion: expressions of one half, turned by up to some 20 degrees."""
    random = np.random.default_rng(seed)
    fitted = fitted_parameters(MODEL, VERTICES)
    parameters = 0.5 * random.normal(size=(frames, fitted.frame_size))
    parameters[:, :3] *= 0.02
    parameters[:, 3:6] *= 0.3
    parameters[:, fitted.joint_slice] *= 0.2
    return HeadFit(fitted, parameters, random.normal(size=len(fitted.shape)), 1.0)


def observe(truth: HeadFit, noise: float = 0.0, seed: int = 0) -> Observations:
    projections = np.tile(projection_matrices(ring_of_cameras(6)), (len(truth.frames), 1, 1, 1))
    points = HeadPoints(MODEL, truth.fitted, LANDMARKS).positions(truth.frames, truth.shape)
    pixels, _ = project(points, projections)
    pixels = pixels + noise * np.random.default_rng(seed).normal(size=pixels.shape)
    return Observations(pixels, np.ones(pixels.shape[:3]), projections, np.ones(len(points) - 1, bool))


def vertex_errors(fit: HeadFit, truth: HeadFit, model: HeadModel = MODEL) -> np.ndarray:
    """Distances of all vertices in millimetres."""
    found, expected = (pose_frames(model, f.parameters(model)) for f in (fit, truth))
    return 1000 * np.linalg.norm(found - expected, axis=-1)


def fit(observations: Observations, start: np.ndarray | None = None) -> HeadFit:
    return fit_landmarks(MODEL, LANDMARKS, observations, start)


def test_without_noise_the_truth_is_found():
    truth = true_fit()
    assert vertex_errors(fit(observe(truth)), truth).max() < 0.2  # the priors pull by less


def test_noise_of_a_pixel_is_averaged_out():
    truth = true_fit()  # a pixel is 1.4 mm
    assert vertex_errors(fit(observe(truth, noise=1.0)), truth).mean() < 0.7


@pytest.mark.parametrize("linked", [True, False])
def test_the_minimum_is_that_of_scipy(linked):
    truth = true_fit(frames=2)
    observations = replace(observe(truth, noise=1.0), linked=np.array([linked]))
    points, prior = HeadPoints(MODEL, truth.fitted, LANDMARKS), gaussian_prior(truth.fitted, observations.linked)
    (t, q), s = truth.frames.shape, len(truth.shape)
    objective = Objective([landmark_term(points, observations, 1.5, np.inf)], prior)

    def residuals(x: np.ndarray) -> np.ndarray:
        frames, shape = x[: t * q].reshape(t, q), x[t * q :]
        projected, _ = project(points.positions(frames, shape), observations.projections)
        changes = np.sqrt(prior.links) * np.diff(frames, axis=0)
        parts = ((projected - observations.pixels) / 1.5, np.sqrt(prior.frames) * frames, np.sqrt(prior.shape) * shape)
        return np.concatenate([part.ravel() for part in (*parts, changes)])

    start = np.concatenate([truth.frames.ravel(), truth.shape])
    expected = least_squares(residuals, start, xtol=1e-12, ftol=1e-12, gtol=1e-8, x_scale="jac").x
    frames, shape = minimise(objective, np.zeros((t, q)), np.zeros(s), steps=300, tolerance=1e-14)
    np.testing.assert_allclose(objective.value(frames, shape), 0.5 * (residuals(expected) ** 2).sum(), rtol=1e-9)
    np.testing.assert_allclose(np.concatenate([frames.ravel(), shape]), expected, atol=1e-4)


def test_the_gradient_of_the_robust_objective_is_its_derivative():
    truth = true_fit(frames=3)
    observations = observe(truth, noise=3.0)
    points = HeadPoints(MODEL, truth.fitted, LANDMARKS)
    prior = gaussian_prior(truth.fitted, observations.linked)
    objective = Objective([landmark_term(points, observations, 1.0, 2.0)], prior)
    random = np.random.default_rng(5)
    _, equations = objective.linearise(truth.frames, truth.shape)
    for _ in range(5):
        frames, shape = (random.normal(size=x.shape) for x in (truth.frames, truth.shape))
        ends = [objective.value(truth.frames + h * frames, truth.shape + h * shape) for h in (1e-6, -1e-6)]
        slope = (equations.frame_gradient * frames).sum() + equations.shape_gradient @ shape
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 2e-6, rtol=1e-5)


def test_outliers_hardly_matter():
    truth, random = true_fit(), np.random.default_rng(1)
    observations = observe(truth, noise=0.5)
    wrong = random.random(observations.confidence.shape) < 0.2
    shifts = random.uniform(-60, 60, observations.pixels.shape)
    spoilt = replace(observations, pixels=observations.pixels + wrong[..., None] * shifts)
    clean = replace(observations, confidence=np.where(wrong, 0.0, 1.0))
    assert vertex_errors(fit(spoilt), truth).mean() < 1.2 * vertex_errors(fit(clean), truth).mean()


@pytest.mark.parametrize("seed", range(3))
def test_a_start_that_is_wrong_by_30_degrees_leads_to_the_same_minimum(seed):
    truth, random = true_fit(seed=seed), np.random.default_rng(seed)
    observations = observe(truth, noise=1.0)
    axes = random.normal(size=(len(truth.frames), 3))
    wrong = Rotation.from_rotvec(np.radians(30) * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    rotations = (wrong * Rotation.from_rotvec(truth.frames[:, 3:6])).as_rotvec()
    start = np.concatenate([truth.frames[:, :3], rotations], axis=1)
    np.testing.assert_allclose(
        vertex_errors(fit(observations, start), truth), vertex_errors(fit(observations), truth), atol=0.02
    )


def test_frames_without_landmarks_lie_between_their_neighbours():
    truth = true_fit(frames=5)
    truth.frames[:] = np.linspace(truth.frames[0], truth.frames[4], 5)
    observations = observe(truth)
    observations.confidence[2] = 0
    observations.pixels[2] = 0
    middle = pose_frames(MODEL, truth.parameters(MODEL))
    step = 1000 * np.linalg.norm(middle[2] - middle[1], axis=-1).mean()
    assert vertex_errors(fit(observations), truth)[2].mean() < 0.5 * step


def test_without_landmarks_in_its_sequence_a_frame_has_no_expression():
    truth = true_fit(frames=3)
    observations = replace(observe(truth), linked=np.array([True, False]))
    observations.confidence[2] = 0
    found = fit(observations)
    np.testing.assert_allclose(found.frames[2, found.fitted.expression_slice], 0, atol=1e-9)


def test_reprojection_errors_are_distances():
    truth = true_fit()
    observations = observe(truth)
    moved = replace(observations, pixels=observations.pixels + np.array([3.0, 4.0]))
    moved.confidence[0, 1, 2] = 0
    points = HeadPoints(MODEL, truth.fitted, LANDMARKS).positions(truth.frames, truth.shape)
    errors = reprojection_errors(points, moved)
    assert np.isnan(errors[0, 1, 2]) and np.isnan(errors).sum() == 1
    np.testing.assert_allclose(errors[np.isfinite(errors)], 5, atol=1e-9)
