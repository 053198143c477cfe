"""Accuracy on rendered captures of which the true mesh is known (slow)."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_data import DATA, needs_data

from carigs.capture import Capture, read_dataset
from carigs.fitting.footage import frame_projections
from carigs.fitting.landmarks.fit import HeadFit, Observations, fit_landmarks
from carigs.fitting.refinement import Refinement
from carigs.fitting.triangulation import project
from carigs.head import pose, pose_frames

pytestmark = [pytest.mark.slow, needs_data]


def timesteps_of(capture: Capture) -> list[int]:
    """Every third one: all of them together make the fit more accurate, and the bounds easier to keep."""
    return sorted(capture.parameter_files)[::3]


def prepared(name: str, seed: int) -> tuple[Capture, np.ndarray, Observations]:
    """The capture, its true vertices, and its own landmarks in 16 views with noise of one pixel."""
    capture = read_dataset(DATA / name, DATA / "ict_model.npz")
    timesteps, cameras = timesteps_of(capture), sorted(capture.cameras)
    truth = np.stack([pose(capture.model, capture.parameters(t)) for t in timesteps])
    projections = frame_projections(capture, timesteps, cameras)
    pixels, _ = project(truth[:, capture.model.landmarks68.corners[:, 0]], projections)
    pixels += np.random.default_rng(seed).normal(size=pixels.shape)
    sequences = [capture.frame_at[t, cameras[0]].sequence for t in timesteps]
    linked = np.array([a == b for a, b in pairwise(sequences)])
    return capture, truth, Observations(pixels, np.ones(pixels.shape[:3]), projections, linked)


def face_error(capture: Capture, fit: HeadFit, truth: np.ndarray) -> float:
    """Mean vertex error of the face in millimetres."""
    found = pose_frames(capture.model, fit.parameters(capture.model))
    return 1000 * float(np.linalg.norm(found - truth, axis=-1)[:, capture.model.regions["face"]].mean())


@pytest.mark.parametrize(("name", "seed"), [("ict_s1", 0), ("ict_s1", 1), ("ict_s7", 0)])
def test_face_errors_after_landmarks_and_after_refinement(name, seed):
    capture, truth, observations = prepared(name, seed)
    fit = fit_landmarks(capture.model, capture.model.landmarks68, observations)
    assert face_error(capture, fit, truth) <= 0.5
    timesteps, cameras = timesteps_of(capture), sorted(capture.cameras)
    work = Refinement(capture, timesteps, cameras, capture.model, capture.model.landmarks68, observations)
    assert face_error(capture, work.refine(fit), truth) <= 0.3


@pytest.mark.parametrize("seed", range(3))
def test_a_start_that_is_wrong_by_30_degrees_leads_to_the_same_fit(seed):
    capture, truth, observations = prepared("ict_s1", seed)
    random = np.random.default_rng(seed)
    parameters = [capture.parameters(t) for t in timesteps_of(capture)]
    axes = random.normal(size=(len(parameters), 3))
    wrong = Rotation.from_rotvec(np.radians(30) * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    rotations = (wrong * Rotation.from_rotvec([p.rotation for p in parameters])).as_rotvec()
    start = np.concatenate([np.array([p.translation for p in parameters]), rotations], axis=1)
    errors = [
        face_error(capture, fit_landmarks(capture.model, capture.model.landmarks68, observations, start=s), truth)
        for s in (None, start)
    ]
    assert abs(errors[1] - errors[0]) < 0.01
