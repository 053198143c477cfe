"""Landmarks by the truth: exact without noise, and with the errors that were asked for."""

from dataclasses import replace

import numpy as np
import pytest
from small_head import small_head

from carigs.head import HeadParameters, SurfacePoints
from carigs.toy.look.strands import triangle_frames
from evaluation.benchmarks.footage.landmark_spread import landmark_spread
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, LandmarkNoise, carrying_triangles, oracle_landmarks
from evaluation.benchmarks.footage.scenes import view
from evaluation.benchmarks.footage.truth import FootageTruth

MODEL = small_head()
FRONT = np.flatnonzero(MODEL.v_template[:, 2] > 0.06)[:60]


def footage(yaws: np.ndarray) -> FootageTruth:
    base = HeadParameters.zeros(MODEL)
    parameters = [replace(base, rotation=np.array([0, yaw, 0])) for yaw in yaws]
    return FootageTruth(MODEL, parameters, [[view(256), view(256, 30)] for _ in yaws], 25.0)


STILL = footage(np.zeros(400))


def test_without_noise_they_are_projections():
    truth = footage(np.array([0.0, 0.4]))
    exact = oracle_landmarks(truth, SurfacePoints.at_vertices(FRONT), EXACT)
    for t, posed in enumerate(truth.vertices()):
        for c, camera in enumerate(truth.cameras[t]):
            np.testing.assert_allclose(exact.values[t, c, :, :2], camera.project(posed[FRONT])[0], atol=1e-9)
    assert (exact.values[..., 2] == 1).all()


def test_the_back_of_the_head_is_hidden():
    everywhere = SurfacePoints.at_vertices(np.arange(len(MODEL.v_template)))
    values = oracle_landmarks(footage(np.zeros(1)), everywhere, replace(EXACT, hide=True)).values[0, 0]
    depth = MODEL.v_template[:, 2]
    assert (values[depth > 0.05, 2] == 1).all() and (values[depth < -0.02] == 0).all()


def test_offsets_are_the_same_in_all_frames_and_turn_with_the_head():
    points, noise = SurfacePoints.at_vertices(FRONT), LandmarkNoise(depth=0, shared=0, own=0, hide=False)
    truth = footage(np.array([0.0, 0.0, 0.5]))
    errors = oracle_landmarks(truth, points, noise).values - oracle_landmarks(truth, points, EXACT).values
    np.testing.assert_array_equal(errors[0], errors[1])
    assert np.abs(errors[2] - errors[0]).max() > 0.5
    metre = 0.75 / truth.cameras[0][0].fx  # of a pixel at the distance of the head
    assert errors[0, ..., :2].std() * metre == pytest.approx(noise.offset, rel=0.25)


def test_a_wrong_depth_lies_along_the_normals_and_neighbours_share_it():
    truth, points = footage(np.array([0.0, 0.5])), SurfacePoints.at_vertices(FRONT)
    noise = LandmarkNoise(offset=0, depth=3e-3, shared=0, own=0, hide=False, reach=10.0)
    moved, exact = (oracle_landmarks(truth, points, n, seed=4).values[1, 0, :, :2] for n in (noise, EXACT))
    posed, camera = truth.vertices()[1], truth.cameras[1][0]
    normals = triangle_frames(posed, carrying_triangles(points, MODEL.faces))[:, 2]
    of_a_millimetre = camera.project(posed[FRONT] + 1e-3 * normals)[0] - exact
    depths = ((moved - exact) * of_a_millimetre).sum(axis=1) / (of_a_millimetre**2).sum(axis=1)
    steep = np.linalg.norm(of_a_millimetre, axis=1) > 0.2
    np.testing.assert_allclose(depths[steep], np.median(depths), atol=0.1)
    assert 0.2 < abs(np.median(depths)) < 9


def test_image_errors_have_their_size_memory_and_reach():
    noise = LandmarkNoise(offset=0, depth=0, shared=0.8, own=0.2, hide=False, memory=0.2, reach=0.03)
    points = SurfacePoints.at_vertices(FRONT)
    errors = (oracle_landmarks(STILL, points, noise).values - oracle_landmarks(STILL, points, EXACT).values)[
        :, 0, :, :2
    ]
    assert errors.std() == pytest.approx(np.hypot(0.8, 0.2), rel=0.1)
    shared = 0.8**2 / (0.8**2 + 0.2**2)
    next_frame = np.mean(errors[1:] * errors[:-1]) / np.mean(errors**2)
    assert next_frame == pytest.approx(shared * np.exp(-0.2), abs=0.06)
    apart = np.linalg.norm(MODEL.v_template[FRONT][:, None] - MODEL.v_template[FRONT], axis=2)
    covariance = np.einsum("tpa,tqa->pq", errors, errors) / (2 * len(errors))
    assert covariance[(apart > 0) & (apart < 0.015)].mean() > 2 * abs(covariance[apart > 0.07].mean())


def test_missing_ones_have_no_confidence():
    some = oracle_landmarks(STILL, SurfacePoints.at_vertices(FRONT), replace(EXACT, missing=0.3)).values
    assert (some[..., 2] == 0).mean() == pytest.approx(0.3, abs=0.01) and not some[some[..., 2] == 0].any()


def test_landmark_spread_is_the_noise_whatever_the_places():
    truth, points = footage(np.linspace(-0.3, 0.3, 25)), SurfacePoints.at_vertices(FRONT)
    exact = landmark_spread(truth, oracle_landmarks(truth, points, EXACT).values[:, 0])
    assert np.median(exact.pixels) < 0.05
    noise = LandmarkNoise(offset=2e-3, depth=0, shared=0, own=0.5, hide=True)
    noisy = landmark_spread(truth, oracle_landmarks(truth, points, noise).values[:, 0])
    rayleigh = 0.5 * np.sqrt(2 * np.log(2))  # median distance of two normal coordinates
    assert np.nanmedian(noisy.pixels) == pytest.approx(rayleigh, rel=0.25)
