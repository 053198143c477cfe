"""Which frames are tracked, the guess of the focal length, and a head whose truth is known."""

import numpy as np
import pytest
from tracking.shots import recording

from carigs.embedding import landmark_embedding
from carigs.errors import InputError
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.head import SurfacePoints, pose
from carigs.head.joint_transforms import rotation_matrices
from carigs.toy.rig.head_model import head_model
from carigs.tracking.cameras import Cameras
from carigs.tracking.footage_tracking import choose_frames, guessed_focal_length
from carigs.tracking.solver.landmark_tracking import track_landmarks
from carigs.tracking.solver.tracks import Tracks
from carigs.tracking.texture.skull_motion import SkullMotion
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, oracle_landmarks
from evaluation.benchmarks.footage.scenes import orbit, talk, three


def test_a_camera_that_sees_the_face_when_no_other_does_is_named():
    left, right = np.ones(40), np.zeros(40)
    left[20:], right[20:] = 0, 1
    cameras = [recording(left), recording(left), recording(right, name="right.mp4")]
    with pytest.raises(InputError, match=r"right\.mp4.*in no frame in which another camera sees it"):
        choose_frames(cameras)


def test_two_photographs_are_too_few():
    images = [recording([shown], name=f"{i}.jpg") for i, shown in enumerate((1, 0, 1))]
    with pytest.raises(InputError, match="2 of 3 images show a face; at least 3"):
        choose_frames(images)


def test_a_wide_image_has_a_field_of_view_of_60_degrees():
    landmarks = np.random.default_rng(0).uniform(0, 100, (5, 30, 2))
    for width, height in ((640, 480), (480, 854)):
        found = guessed_focal_length(width, height, landmarks)
        assert 2 * np.degrees(np.arctan(max(width, height) / 2 / found)) == pytest.approx(60)


def test_in_a_square_image_the_face_is_a_metre_away():
    landmarks = np.zeros((5, 2, 2))
    landmarks[:, 1, 0] = 150.0  # as wide as a face
    landmarks[2] = np.nan  # a frame without a face
    assert guessed_focal_length(512, 512, landmarks) == pytest.approx(1000)
    # One of several cameras is not nearer than that, whatever it sees beside the face.
    assert guessed_focal_length(640, 480, landmarks, on_stands=True) == pytest.approx(1000)


@pytest.mark.slow
def test_a_talking_head_is_found_again_from_its_landmarks():
    truth, found, seen = tracked(talk, Talk(seconds=4, fps=10))
    errors = [
        np.linalg.norm(_aligned(pose(found.model, p)[seen], v[seen]) - v[seen], axis=1).mean()
        for p, v in zip(found.parameters, truth.vertices(), strict=True)
    ]
    assert np.mean(errors) < 0.0015
    assert np.nanmean(found.errors) < 0.3
    # The first camera stays level, and the origin lies at the head.
    np.testing.assert_allclose(found.cameras.poses[0, :3], [np.pi, 0, 0])
    assert np.linalg.norm(np.median([p.translation for p in found.parameters], axis=0)) < 1e-6


@pytest.mark.slow
def test_three_cameras_are_placed_around_a_talking_head():
    truth, found, seen = tracked(three, Talk(seconds=3, fps=8))
    places = _centres(found.cameras)
    true = np.array([camera.centre for camera in truth.cameras[0]])
    world = _alignment(places, true)
    assert np.linalg.norm(world(places) - true, axis=1).max() < 0.02
    # One world for all frames: the head moves in it as it did.
    errors = [
        np.linalg.norm(world(pose(found.model, p)[seen]) - v[seen], axis=1).mean()
        for p, v in zip(found.parameters, truth.vertices(), strict=True)
    ]
    assert np.mean(errors) < 0.003
    assert np.nanmean(found.errors) < 0.3
    # The face looks along z in the mean.
    assert np.mean([rotation_matrices(p.rotation[None])[0][:, 2] for p in found.parameters], axis=0)[2] > 0.99


@pytest.mark.slow
def test_an_orbit_is_one_head_and_many_places_of_one_camera():
    truth, found, seen = tracked(orbit, Talk(seconds=3, fps=8))
    places, true = _centres(found.cameras), np.array([seen_by[0].centre for seen_by in truth.cameras])
    world = _alignment(places, true)
    assert np.linalg.norm(world(places) - true, axis=1).max() < 0.02
    [parameters], vertices = found.parameters, truth.vertices()[0]
    assert (
        np.linalg.norm(_aligned(pose(found.model, parameters)[seen], vertices[seen]) - vertices[seen], axis=1).mean()
        < 0.0015
    )
    assert np.ptp(found.cameras.focal) == 0


def tracked(scene, motion):
    """The truth, the head that is found from some of its landmarks, and the vertices beside these."""
    model = head_model()
    shape = np.zeros(model.num_identity)
    shape[:8] = np.random.default_rng(0).normal(size=8)
    truth = scene(model, shape, 512, motion)
    embedding = landmark_embedding(model)
    chosen = np.arange(0, len(embedding.landmarks), 3)
    points = embedding.points(model)[chosen]
    values = oracle_landmarks(truth, points, EXACT).values
    if scene is orbit:
        values = values.swapaxes(0, 1)
    tracks = Tracks(values[..., :2], values[..., 2], np.arange(len(values)) / 10)
    count = values.shape[1]
    focal, lenses = 1.1 * truth.cameras[0][0].fx, np.zeros(count, int)
    first = np.tile([np.pi, 0, 0, 0, 0, 0.0], (count, 1))
    cameras = Cameras(np.full(count, focal), np.full((count, 2), 256.0), first, lenses)
    seen = np.unique(points.corners)
    fitted = fitted_parameters(model, seen, max_shape=20, max_expression=40)
    return truth, track_landmarks(model, fitted, points, tracks, cameras, focal_deviation=0.15), seen


def _centres(cameras):
    matrices = cameras.camera_from_world()
    return -np.einsum("cji,cj->ci", matrices[:, :, :3], matrices[:, :, 3])


def _aligned(points, target):
    """Points, taken nearest to others by a similarity."""
    return _alignment(points, target)(points)


def _alignment(points, target):
    """The similarity that takes points nearest to others (Umeyama 1991)."""
    a, b = points - points.mean(axis=0), target - target.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    signs = [1, 1, np.linalg.det(u @ vt)]
    turn = (s @ signs) / (a**2).sum() * u @ np.diag(signs) @ vt
    return lambda others: (others - points.mean(axis=0)) @ turn + target.mean(axis=0)


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
