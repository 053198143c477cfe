"""Which frames are tracked, the guess of the focal length, and a head whose truth is known."""

from pathlib import Path

import numpy as np
import pytest

from carigs.detection import FaceTrack
from carigs.detection.mesh_indices import COUNT
from carigs.embedding import landmark_embedding
from carigs.errors import InputError
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.footage import Footage
from carigs.footage.measures import FrameMeasures
from carigs.head import SurfacePoints, pose
from carigs.toy.rig.head_model import head_model
from carigs.tracking.cameras import Cameras
from carigs.tracking.footage_tracking import _kept_frames, guessed_focal_length
from carigs.tracking.landmark_tracking import Tracks, track_landmarks
from carigs.tracking.skull_motion import SkullMotion
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, oracle_landmarks
from evaluation.benchmarks.footage.scenes import talk


def footage(count=40, width=640, height=480):
    numbers = tuple(range(count))
    return Footage(
        Path("me.mp4"), width, height, numbers, np.arange(count) / 25, 25.0, count / 25, None, lambda: iter(())
    )


def faces(presence, jumped=()):
    count = len(presence)
    jumps = np.isin(np.arange(count), jumped)
    return FaceTrack(
        np.zeros((count, COUNT, 3), np.float32), np.array(presence, np.float32), np.zeros((count, 4), np.float32),
        np.ones(count, int), jumps,
    )  # fmt: skip


def measures(count, cut_at=None):
    still = np.full(count, 0.001)
    if cut_at is not None:
        still[cut_at] = 0.9
    ones = np.ones(count)
    return FrameMeasures(np.arange(count) / 25, ones, 0 * ones, np.zeros((count, 2)), ones, still, 0 * ones)


def test_frames_without_a_face_and_those_of_the_shorter_take_are_left_out():
    presence = np.ones(40)
    presence[[3, 20]] = 0
    kept, left_out = _kept_frames(footage(), faces(presence), measures(40, cut_at=15))
    assert kept.tolist() == [i for i in range(15, 40) if i != 20]
    assert sorted(np.concatenate(list(left_out.values())).tolist()) == [*range(15), 20]
    assert left_out["no face"].tolist() == [3, 20]


def test_a_face_that_jumps_begins_a_take():
    kept, _ = _kept_frames(footage(), faces(np.ones(40), jumped=[30]), measures(40))
    assert kept.tolist() == [*range(30)]


@pytest.mark.parametrize("shown", [0, 9])
def test_too_few_frames_with_a_face_are_an_error_that_names_the_video(shown):
    presence = np.zeros(40)
    presence[:shown] = 1
    with pytest.raises(InputError, match=rf"me\.mp4.* {shown} of 40 frames show a face"):
        _kept_frames(footage(), faces(presence), measures(40))


def test_a_wide_image_has_a_field_of_view_of_60_degrees():
    landmarks = np.random.default_rng(0).uniform(0, 100, (5, 30, 2))
    for width, height in ((640, 480), (480, 854)):
        found = guessed_focal_length(footage(width=width, height=height), landmarks)
        assert 2 * np.degrees(np.arctan(max(width, height) / 2 / found)) == pytest.approx(60)


def test_in_a_square_image_the_face_is_a_metre_away():
    landmarks = np.zeros((5, 2, 2))
    landmarks[:, 1, 0] = 150.0  # as wide as a face
    assert guessed_focal_length(footage(width=512, height=512), landmarks) == pytest.approx(1000)


@pytest.mark.slow
def test_a_talking_head_is_found_again_from_its_landmarks():
    model = head_model()
    shape = np.zeros(model.num_identity)
    shape[:8] = np.random.default_rng(0).normal(size=8)
    truth = talk(model, shape, 512, Talk(seconds=4, fps=10))
    embedding = landmark_embedding(model)
    chosen = np.arange(0, len(embedding.landmarks), 3)
    points = embedding.points(model)[chosen]
    values = oracle_landmarks(truth, points, EXACT).values
    tracks = Tracks(values[..., :2], values[..., 2], np.arange(len(values)) / 10)
    focal = 1.1 * truth.cameras[0][0].fx
    cameras = Cameras(np.array([focal]), np.array([[256.0, 256.0]]), np.array([[np.pi, 0, 0, 0, 0, 0.0]]))
    seen = np.unique(points.corners)
    fitted = fitted_parameters(model, seen, max_shape=20, max_expression=40)
    found = track_landmarks(model, fitted, points, tracks, cameras, focal_deviation=0.15)
    true = truth.vertices()
    errors = [
        np.linalg.norm(_aligned(pose(found.model, p)[seen], v[seen]) - v[seen], axis=1).mean()
        for p, v in zip(found.parameters, true, strict=True)
    ]
    assert np.mean(errors) < 0.0015
    assert np.nanmean(found.errors) < 0.3
    # The first camera stays level, and the origin lies at the head.
    np.testing.assert_allclose(found.cameras.poses[0, :3], [np.pi, 0, 0])
    assert np.linalg.norm(np.median([p.translation for p in found.parameters], axis=0)) < 1e-6


def _aligned(points, target):
    """The similarity that takes points nearest to others (Umeyama 1991)."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    signs = [1, 1, np.linalg.det(u @ vt)]
    return (s @ signs) / (a**2).sum() * a @ (u @ np.diag(signs) @ vt) + target.mean(axis=0)


@pytest.mark.slow
def test_a_known_turn_of_the_skull_outweighs_landmarks_that_understate_it():
    """A network that shows nods too small does not turn the skull less; without its motion, it does."""
    model = head_model()
    truth = talk(model, np.zeros(model.num_identity), 512, Talk(seconds=3, fps=8))
    embedding = landmark_embedding(model)
    points = embedding.points(model)[np.arange(0, len(embedding.landmarks), 4)]
    values = oracle_landmarks(truth, points, EXACT).values
    heads, camera = truth.vertices(), truth.cameras[0][0]
    middle = values[..., 1].mean(axis=2, keepdims=True)
    shape = (values[..., 1] - middle).mean(axis=0)
    values[..., 1] = middle + shape + 0.7 * (values[..., 1] - middle - shape)
    scalp = np.flatnonzero(model.vertex_region("scalp"))[::20]
    anchors = np.stack([camera.project(head[scalp])[0] for head in heads])
    skull = SkullMotion(SurfacePoints.at_vertices(scalp), anchors, np.ones(len(heads), bool))
    cameras = Cameras(np.array([camera.fx]), np.array([[256.0, 256.0]]), np.array([[np.pi, 0, 0, 0, 0, 0.0]]))
    fitted = fitted_parameters(model, np.unique(points.corners), max_shape=5, max_expression=20)
    tracks = Tracks(values[..., :2], values[..., 2], np.arange(len(values)) / 8)
    off = []
    for known in (None, skull):
        found = track_landmarks(model, fitted, points, tracks, cameras, focal_deviation=0.02, skull=known)
        seen = [found.cameras.project(pose(found.model, p)[scalp][None])[0][0, 0] for p in found.parameters]
        off.append(np.linalg.norm(np.stack(seen) - anchors, axis=-1).mean())
    assert off[1] < 1.0 < off[0]
    assert found.errors.shape[2] == len(points)
