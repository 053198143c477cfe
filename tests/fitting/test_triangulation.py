"""Triangulation: exact without noise, unmoved by outliers, silent where depth is not determined."""

import numpy as np
import pytest
from small_head import ring_of_cameras

from carigs.fitting.triangulation import LEAST_POINTS, project, projection_matrices, triangulate, well_seen_timesteps

CAMERAS = ring_of_cameras(6)


def observe(points: np.ndarray, cameras=CAMERAS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    projections = np.tile(projection_matrices(cameras), (len(points), 1, 1, 1))
    pixels, _ = project(points, projections)
    return pixels, np.ones(pixels.shape[:3]), projections


def points(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.1, 0.1, (3, 10, 3))


def test_projection_is_that_of_the_camera():
    pixels, depth = project(points(), np.tile(projection_matrices(CAMERAS), (3, 1, 1, 1)))
    for c, camera in enumerate(CAMERAS):
        expected, expected_depth = camera.project(points()[1])
        np.testing.assert_allclose(pixels[1, c], expected, atol=1e-9)
        np.testing.assert_allclose(depth[1, c], expected_depth, atol=1e-12)


def test_exact_observations_give_the_points():
    found, distances = triangulate(*observe(points()))
    np.testing.assert_allclose(found, points(), atol=1e-9)
    np.testing.assert_allclose(distances, 0, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_outliers_lose_their_influence(seed):
    random = np.random.default_rng(seed)
    pixels, confidence, projections = observe(points(seed))
    pixels += 0.1 * random.normal(size=pixels.shape)
    for t, p in np.ndindex(3, 10):  # two of six views of every point are far off
        pixels[t, random.choice(6, 2, replace=False), p] += random.uniform(40, 200, (2, 2))
    found, _ = triangulate(pixels, confidence, projections)
    assert np.linalg.norm(found - points(seed), axis=-1).max() < 0.001  # 0.1 pixels are 0.14 mm


def test_missing_views_do_not_count():
    pixels, confidence, projections = observe(points())
    confidence[:, 2:, 4], pixels[:, 2:, 4] = 0, np.nan
    found, distances = triangulate(pixels, confidence, projections)
    np.testing.assert_allclose(found, points(), atol=1e-9)
    assert np.isnan(distances[:, 2:, 4]).all()


def test_one_view_or_parallel_rays_give_no_point():
    pixels, confidence, projections = observe(points())
    confidence[:, 1:, 3] = 0
    found, distances = triangulate(pixels, confidence, projections)
    assert np.isnan(found[:, 3]).all() and np.isnan(distances[:, :, 3]).all()
    assert np.isfinite(np.delete(found, 3, axis=1)).all()
    twice, _ = triangulate(*observe(points(), [CAMERAS[0], CAMERAS[0]]))
    assert np.isnan(twice).all()


def test_a_timestep_is_well_seen_from_two_cameras_that_see_enough_points_both():
    """Not where each point is seen by one camera alone, and not where one point too few is seen by both."""
    confidence = np.zeros((4, 3, 2 * LEAST_POINTS))
    confidence[0, :2, :LEAST_POINTS] = 0.5
    confidence[1, 0, :LEAST_POINTS] = confidence[1, 1, LEAST_POINTS:] = 1
    confidence[2, 1:, 1:LEAST_POINTS] = 1
    confidence[3] = 1
    assert well_seen_timesteps(confidence).tolist() == [0, 3]
    assert well_seen_timesteps(confidence, 1).tolist() in ([0], [3])


def test_a_world_far_from_its_origin_is_no_worse():
    shift, moved = np.array([30.0, -20.0, 50.0]), projection_matrices(CAMERAS)
    moved[:, :, 3] -= moved[:, :, :3] @ shift
    projections = np.tile(moved, (3, 1, 1, 1))
    pixels, _ = project(points() + shift, projections)
    found, _ = triangulate(pixels, np.ones(pixels.shape[:3]), projections)
    np.testing.assert_allclose(found, points() + shift, atol=1e-7)
