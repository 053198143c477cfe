"""How the skull moves: nothing where there is no texture, and as the picture does where there is some."""

import cv2
import numpy as np
import pytest

from carigs.embedding import landmark_embedding
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.toy.rig.head_model import head_model
from carigs.tracking.cameras import Cameras
from carigs.tracking.texture.skull_motion import ANCHORS, skull_motion
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, oracle_landmarks
from evaluation.benchmarks.footage.scenes import talk

SIDE, COUNT, STEP = 400, 12, 2.0


@pytest.fixture(scope="module")
def still():
    """A head that does not move, and its landmarks."""
    model = head_model()
    truth = talk(model, np.zeros(model.num_identity), SIDE, Talk(seconds=0.1, fps=10))
    points = landmark_embedding(model).points(model)
    landmarks = oracle_landmarks(truth, points, EXACT).values[:1, 0, :, :2]
    cameras = Cameras(
        np.array([truth.cameras[0][0].fx]), np.full((1, 2), SIDE / 2), np.array([[np.pi, 0, 0, 0, 0, 0.0]])
    )
    fitted = fitted_parameters(model, np.unique(points.corners), max_shape=3, max_expression=5)
    return model, fitted, points, landmarks, cameras


def motion_of(still, images, shift=0.0):
    model, fitted, points, landmarks, cameras = still
    moved = landmarks + np.arange(len(images))[:, None, None] * [shift, 0.0]
    return skull_motion(images, model, fitted, points, moved, cameras)


def textured(shift):
    rough = cv2.GaussianBlur(np.random.default_rng(0).random((SIDE, SIDE)), (0, 0), 2.0)
    base = np.uint8(255 * (rough - rough.min()) / np.ptp(rough))
    moves = [np.float32([[1, 0, shift * t], [0, 1, 0]]) for t in range(COUNT)]
    return [np.repeat(cv2.warpAffine(base, move, (SIDE, SIDE))[..., None], 3, 2) for move in moves]


def test_without_texture_nothing_is_said(still):
    assert motion_of(still, [np.full((SIDE, SIDE, 3), 120, np.uint8)] * COUNT) is None


def test_the_skull_goes_with_the_picture(still):
    found = motion_of(still, textured(STEP), STEP)
    assert found.known.all()
    assert len(found.points) == ANCHORS
    steps = np.diff(found.pixels, axis=0)
    np.testing.assert_allclose(np.median(steps, axis=(0, 1)), [STEP, 0], atol=0.1)


def test_landmarks_that_stay_do_not_hold_a_skull_that_moves(still):
    found = motion_of(still, textured(0.3))
    moved = np.median(found.pixels[-1] - found.pixels[0], axis=0)
    np.testing.assert_allclose(moved, [0.3 * (COUNT - 1), 0], atol=0.5)
