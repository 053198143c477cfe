"""Crops: there and back, and what is seen in them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.detection.crop import Crop, image_from_crop, sample, to_image, turned_around

CROPS = st.builds(Crop, st.floats(-50, 500), st.floats(-50, 500), st.floats(1, 4000), st.floats(-4, 4))


def ramp(height: int, width: int) -> np.ndarray:
    """An image whose red and green are the positions of its pixel centres."""
    y, x = np.mgrid[:height, :width] + 0.5
    return np.stack([x, y, np.zeros_like(x)], axis=-1).round().astype(np.uint8)


@given(CROPS, st.integers(8, 256))
def test_corners_and_centre_of_a_crop_are_where_it_says(crop, side):
    corners = np.array([[side / 2, side / 2, 0], [0, 0, 0], [side, 0, 0], [0, side, 0.0]])
    centre, first, right, below = to_image(corners, crop, side)[:, :2]
    np.testing.assert_allclose(centre, (crop.x, crop.y), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm([right - first, below - first], axis=1), crop.size, rtol=1e-9)
    upper = (math.cos(crop.angle), math.sin(crop.angle))
    np.testing.assert_allclose((right - first) / crop.size, upper, atol=1e-6)
    np.testing.assert_allclose((below - first) / crop.size, (-upper[1], upper[0]), atol=1e-6)


@given(CROPS, st.integers(8, 256))
def test_points_through_a_crop_and_back_are_the_same(crop, side):
    points = np.random.default_rng(0).uniform(0, side, (20, 3))
    moved = to_image(points, crop, side)
    matrix = image_from_crop(crop, side)
    np.testing.assert_allclose(np.linalg.solve(matrix[:, :2], (moved[:, :2] - matrix[:, 2]).T).T, points[:, :2])
    np.testing.assert_allclose(moved[:, 2], points[:, 2] * crop.size / side)


@pytest.mark.parametrize("size", [48, 96, 150, 200, 400])  # enlarged to reduced
@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 2, -2.0])
def test_pixels_come_from_where_points_go(size, angle):
    crop, side = Crop(120, 110, size / 2, angle), 24
    pixels = sample(ramp(230, 240), crop, side).astype(float)
    y, x = np.mgrid[:side, :side] + 0.5
    points = to_image(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), crop, side).reshape(side, side, 3)
    inside = ((points[..., :2] > 10) & (points[..., :2] < 220)).all(axis=-1)
    errors = (pixels[..., :2] - points[..., :2])[inside]
    assert np.abs(errors).max() < 1.1 and abs(errors.mean()) < 0.1


def test_the_edge_of_the_image_goes_on_beyond_it():
    image = np.full((10, 10, 3), 77, np.uint8)
    for crop in (Crop(5, 5, 100, 0.3), Crop(-500, 5, 20, 0), Crop(5, 900, 3, 1)):
        assert (sample(image, crop, 16) == 77).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40_000), (9000, 2)])
def test_images_of_all_shapes_are_sampled(shape):
    image = np.full((*shape, 3), 5, np.uint8)
    assert (sample(image, Crop(shape[1] / 2, shape[0] / 2, max(shape), 0), 16) == 5).all()


@given(st.floats(-3, 3), st.floats(0.2, 5))
def test_the_square_around_points_turns_and_grows_with_them(angle, factor):
    points = np.random.default_rng(1).normal(size=(30, 2)) * (3, 5) + (7, 1)
    ends = points[0], points[1]
    turn = factor * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    before = turned_around(points, *ends)
    after = turned_around(points @ turn.T, *(turn @ end for end in ends))
    np.testing.assert_allclose((after.x, after.y), turn @ (before.x, before.y), atol=1e-6)
    np.testing.assert_allclose(after.size, factor * before.size)
    assert math.isclose(math.cos(after.angle - before.angle - angle), 1, abs_tol=1e-9)
