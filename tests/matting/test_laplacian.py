"""The matting Laplacian and its solver against dense matrices in float64."""

import numpy as np
import pytest

from carigs.matting.closed_form import closed_form_alpha
from carigs.matting.laplacian import REACH, coefficients

EPSILON = 1e-4


def dense(image, epsilon=EPSILON):
    """By its definition: in each window, the residual of the best affine function of the colour (ridge regression)."""
    height, width, _ = image.shape
    number = np.arange(height * width).reshape(height, width)
    matrix = np.zeros((height * width,) * 2)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            window = slice(y - 1, y + 2), slice(x - 1, x + 2)
            rows = np.column_stack([image[window].reshape(9, 3), np.ones(9)])
            rows = np.vstack([rows, np.diag([epsilon**0.5] * 3 + [0])[:3]])
            errors = np.eye(12) - rows @ np.linalg.pinv(rows)
            pixels = number[window].ravel()
            matrix[np.ix_(pixels, pixels)] += errors[:9, :9]
    return matrix


@pytest.fixture
def image():
    return np.random.default_rng(0).integers(0, 256, (9, 11, 3), np.uint8)


@pytest.fixture
def band():
    """Regions that touch each other and the border."""
    band = np.random.default_rng(1).random((9, 11)) < 0.5
    band[4:6], band[:, 0] = True, True
    return band


def test_coefficients_are_those_of_the_definition(image, band):
    number = np.where(band, np.cumsum(band).reshape(band.shape) - 1, -1).astype(np.int32)
    colours = (image / 255).astype(np.float32)
    found, exact = coefficients(colours, number, int(band.sum()), EPSILON), dense(colours.astype(np.float64))
    height, width = band.shape
    for n, (y, x) in enumerate(np.argwhere(band)):
        row = np.pad(exact[y * width + x].reshape(height, width), REACH)
        np.testing.assert_allclose(found[..., n], row[y : y + 5, x : x + 5], atol=1e-5)
        assert np.count_nonzero(np.abs(row) > 1e-9) == np.count_nonzero(np.abs(row[y : y + 5, x : x + 5]) > 1e-9)


def test_a_constant_alpha_costs_nothing(image, band):
    number = np.where(band, np.cumsum(band).reshape(band.shape) - 1, -1).astype(np.int32)
    found = coefficients((image / 255).astype(np.float32), number, int(band.sum()), EPSILON)
    np.testing.assert_allclose(found.sum(axis=(0, 1)), 0, atol=1e-5)


def test_alpha_is_the_least_of_the_quadratic_cost(image, band):
    rng = np.random.default_rng(2)
    trimap = np.where(band, 128, rng.choice([0, 255], band.shape)).astype(np.uint8)
    prior, weight = rng.uniform(0.3, 0.7, band.shape), rng.uniform(0.5, 1, band.shape)
    unknown, known = np.flatnonzero(band), np.flatnonzero(~band)
    matrix = dense(image / 255.0, 1e-6)
    right = (weight * prior).ravel()[unknown] - matrix[np.ix_(unknown, known)] @ (trimap.ravel()[known] / 255.0)
    exact = np.linalg.solve(matrix[np.ix_(unknown, unknown)] + np.diag(weight.ravel()[unknown]), right)
    found = closed_form_alpha(image, trimap, prior, weight)
    np.testing.assert_allclose(found.ravel()[unknown], exact.clip(0, 1), atol=2e-3)
